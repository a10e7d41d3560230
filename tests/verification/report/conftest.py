"""A hand-made report of a small study, in whose every text there is markup."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from matplotlib import pyplot as plt

from models.plant import Plant, signals
from models.quantity import declared, quantity
from verification import Claim, Examination, Figure, Finding, Standing, Table, verify
from verification.report.write import write
from workbench.contracts.claim import Expectations, Expected, Held, Range, Role
from workbench.contracts.finding import Grounds, undecided
from workbench.contracts.study import Study
from workbench.controllers import ICFDL
from workbench.trials.campaign import run

EVIL = "<script>alert('a&b')</script>"


@declared
class Lag(Plant):
    """A first-order lag with a gain."""

    source: ClassVar[str] = "ours & <nobody's>"
    states = signals(x="m")
    inputs = signals(**{"a&b": "N"})
    outputs = signals(**{"<script>": "m"})
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    gain_1: float = quantity(default=0.5, unit="m/N", doc="gain <b>bold</b>", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return ((1 - self.sampling_time) * x.x + self.gain_1 * u[0],)

    def output(self, x: Any) -> Any:
        return (x.x,)


def crash() -> Finding:
    raise RuntimeError(f"no {EVIL}\x00\x1b")


def drawn() -> Any:
    figure, axes = plt.subplots()
    axes.plot([1, 2, 3])
    return figure


def undrawable() -> Any:
    raise ValueError(f"nothing to draw {EVIL}")


def claim(name: str, finding: Any, controller: str | None = None, **further: Any) -> Claim:
    check = finding if callable(finding) else lambda: finding
    return Claim(
        name=name,
        statement=f"{name} holds {EVIL}",
        source=f"paper {EVIL}",
        check=check,
        controller=controller,
        **further,
    )


PROVED = Finding(
    grounds=Grounds.ALGEBRA, method="algebra", margin=1.5e-6, unit="m/N", bound=0.25, bound_unit="1/s",
    witness={"k": np.int64(3)},
)  # fmt: skip
REFUTED = Finding(
    method=f"replayed {EVIL}",
    margin=-np.float64(2.0),
    unit=EVIL,
    witness={"trial": 2, EVIL: np.arange(2000.0), "box": {"x": (0, 1)}, "bad": float("nan")},
)
PREMISE = claim("lag.first", Finding(method="read", holds=True))
CLAIMS = (
    claim(
        "lag.A1",
        PROVED,
        role=Role.REPAIRED,
        scope=lambda: {f"x{EVIL}": Range(-1.0, 2.0, "m"), "n": Range(0.0, float("inf"))},
        attack=lambda finding: Held(149, 0.125, {"trial": 3}),
    ),
    claim("lag.A2", Finding(method="sampled", holds=True), "icfdl", premises=(PREMISE,)),
    claim("lag.A2", REFUTED, EVIL, replay=lambda witness: -2.0),
    claim("lag.A3", undecided("budget spent"), "icfdl"),
    claim("lag.A4", crash),
    claim("lag.A5", PROVED, "icfdl", lacks=f"a horizon {EVIL}"),
)
EXPECTED: Expectations = {
    "A2": (
        Expected(standing=Standing.SUPPORTED, why=f"seen {EVIL}", controllers=("icfdl",)),
        Expected(
            standing=Standing.REFUTED, why=f"a slip {EVIL}", controllers=(EVIL,), published=f"3 mm {EVIL}",
            role=Role.PRINTED,
        ),
    ),
    "A4": (Expected(standing=Standing.PROVED, why=f"by hand {EVIL}"),),
}  # fmt: skip


def examination(claims: Any = CLAIMS) -> Examination:
    return Examination(
        claims=claims,
        expectations=EXPECTED,
        conclude=lambda verdicts: [f"{len(verdicts)} claims {EVIL}", "Do nothing."],
        figures=lambda: {
            "evidence/x": Figure(caption=f"Evidence {EVIL}", draw=drawn),
            "broken": Figure(caption="Broken", draw=undrawable),
        },
        tables=lambda: [Table(title=f"Table {EVIL}", header=["what", EVIL], rows=[[EVIL, "1"], ["two", "2"]])],
        scores=lambda: {"icfdl": {"extra": 0.25, "worse": float("inf"), "none": None}, "other": {"extra": 1.0}},
    )


def study() -> Study:
    return Study(
        name="lag",
        title=f"A lag {EVIL}",
        source=f"ours {EVIL}",
        plant=Lag(),
        reference=np.sin(np.linspace(0, 3, 31)),
        controllers={"icfdl": ICFDL(), "again": ICFDL()},
        trials=4,
        drawings=lambda study, data: {"mse": drawn, "wide_figure": drawn},
    )


@pytest.fixture(scope="session")
def lag_report() -> Any:
    """A hand-made report whose every text is hostile."""
    made = verify(run(study(), show_progress=False), examination(), show_progress=False)
    # Studies made of trials refuse such a name; those of another kind may not.
    object.__setattr__(made.campaign.study, "name", f"lag {EVIL}")
    return made


@pytest.fixture(scope="session")
def lag_folder(lag_report: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(lag_report, tmp_path_factory.mktemp("report"))
