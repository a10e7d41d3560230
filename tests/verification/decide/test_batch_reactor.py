"""A batch reactor of a user's own is verified to its end; what ends a search is a number of boxes, never a clock."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from verification import verify
from verification.checks.row_sums import BUDGET
from verification.enclosure import bounds
from verification.enclosure.branch_and_bound import Search, minimise
from workbench import run
from workbench.contracts.settings import changed
from workbench.contracts.study import Study
from workbench.trials.find import find

USERS = Path(__file__).parents[2] / "users"
JACKET = """
import casadi as ca
import numpy as np

from models import RK4, Plant, declared, quantity, signals
from workbench import Study
from workbench.contracts.scenario import From
from workbench.controllers import ICFDL, PD, Increment


@declared
class Reactor(Plant):
    states = signals(concentration="mol/l", temperature="K")
    inputs = signals(jacket="K")
    outputs = signals(temperature="K")
    sampling_time: float = quantity(default=2.0, unit="s", doc="sampling time", above=0)
    frequency: float = quantity(default=7.2e7, unit="1/s", doc="frequency factor", above=0)
    activation: float = quantity(default=7.0e4, unit="J/mol", doc="activation energy", above=0)
    gas: float = quantity(default=8.314, unit="J/(mol*K)", doc="gas constant", above=0)
    heating: float = quantity(default=2.0, unit="K*l/mol", doc="rise of temperature by what reacts", above=0)
    exchange: float = quantity(default=0.004, unit="1/s", doc="heat exchange with the jacket", above=0)
    integrator = RK4(substeps=4)

    def rhs(self, x, u, w, t):
        rate = self.frequency * ca.exp(-self.activation / (self.gas * x.temperature)) * x.concentration
        return -rate, self.heating * rate + self.exchange * (u.jacket - x.temperature)

    def output(self, x):
        return (x.temperature,)


told = {"initial_input": 300.0, "force_unit": 1.0}
study = Study(
    name="jacket", plant=Reactor(), reference=300 + 40 * (1 - np.exp(-np.arange(301) / 150)), trials=20,
    initial=From(state=(2.0, 300.0)),
    controllers={
        "icfdl": ICFDL(lam=1e-3, **told),
        "increment": Increment(lam=1e-4, phi0=0.008, **told),
        "pd": PD(kp=3.0, kd=0.0, initial_input=300.0),
    },
)
"""


Stands = dict[tuple[str, str | None], str]
"""How a claim on a controller stands."""


class Counted:
    """What searches were given to spend, and what they spent."""

    def __init__(self, search: Callable[..., Search]) -> None:
        self.search, self.given, self.spent = search, list[int](), list[int]()

    def __call__(
        self, scalar: object, table: object, lower: object, upper: object, budget: int, settled: object
    ) -> Search:
        found = self.search(scalar, table, lower, upper, budget, settled)
        self.given.append(budget)
        self.spent.append(found.used)
        return found


def verified(study: Study, monkeypatch: pytest.MonkeyPatch) -> tuple[Stands, Counted]:
    """Return how the claims stand, and what was spent on them."""
    counted = Counted(minimise)
    monkeypatch.setattr(bounds, "minimise", counted)
    report = verify(run(study, show_progress=False), show_progress=False)
    return {(one.claim, one.controller): str(one.standing) for one in report.verdicts}, counted


def mad(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every clock of Python go on by an hour whenever it is looked at."""
    hours = itertools.count(0, 3600)
    for clock in ("time", "monotonic", "perf_counter", "process_time"):
        monkeypatch.setattr(time, clock, lambda: float(next(hours)))


def held(study: Study, monkeypatch: pytest.MonkeyPatch) -> tuple[Stands, Counted]:
    """Verify a study twice, by a mad clock the second time: the same claims stand alike for the same boxes."""
    stands, counted = verified(study, monkeypatch)
    assert counted.spent and all(used <= max(most, 1) for used, most in zip(counted.spent, counted.given, strict=True))
    assert max(counted.spent) > 100, "some question must be hard for this to be a test"
    with monkeypatch.context() as patched:
        mad(patched)
        again, anew = verified(study, patched)
    assert (again, anew.given, anew.spent) == (stands, counted.given, counted.spent)
    return stands, counted


def test_a_slow_machine_finds_the_same(monkeypatch):
    """Trials that begin anywhere leave open what asks for all slopes, so none is looked for but that by the input."""
    reactor = changed(find(str(USERS / "batch_reactor.py")), {"trials": 3})
    stands, counted = held(reactor, monkeypatch)
    assert stands["batch-reactor.A1", "batch"] == stands["batch-reactor.A4.partial", "batch"] == "PROVED"
    assert sum(counted.spent) <= BUDGET and len(counted.spent) < 9, "there are nine slopes, of two ends each"


@pytest.mark.slow
def test_a_reactor_with_three_laws_is_verified_to_its_end(tmp_path, monkeypatch):
    (tmp_path / "jacket.py").write_text(JACKET)
    stands, _ = held(find(str(tmp_path / "jacket.py")), monkeypatch)
    for law in ("icfdl", "increment", "pd"):
        assert stands["jacket.A2.lifted", law] == stands["jacket.A4.partial", law] == "PROVED"
    assert stands["jacket.increment_funnel", "increment"] == stands["jacket.learning_curve", "increment"] == "PROVED"
