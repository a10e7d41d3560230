"""Learning curves that end in one funnel for all later trials, against those with a pass for every trial."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from models.plant import Plant, signals
from models.quantity import declared, quantity
from verification.checks import funnel_curve
from verification.checks.funnel import Maker, Open
from verification.checks.funnel_curve import Curve
from verification.theorems.dossier import Dossier
from workbench import Study, run
from workbench.contracts.finding import Standing
from workbench.contracts.law import LearningGain
from workbench.contracts.scenario import Between, From, UniformNoise
from workbench.contracts.study import Inverse
from workbench.contracts.trial_length import TrialLength
from workbench.contracts.verifying import Verification
from workbench.controllers import Increment

N, TRIALS = 20, 100
LOST = 2e-3
"""More than a share ``GAINED``: where learning ends is itself known with some slack."""
LEARNING = {"force_unit": 1.0, "lam": 1.0, "rho": 1.0, "initial_input": 0.1, "mu": 1.0}


@declared
class Cart(Plant):
    """A cart that something curved drags on."""

    source: ClassVar[str] = "made for tests, 2026"
    states = outputs = signals(x="1")
    inputs = signals(u="1")
    mass: float = quantity(default=1.0, unit="kg", doc="mass", above=0)
    drag: float = quantity(default=0.2, unit="1", doc="drag")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (x.x + (u.u - self.drag * x.x**2) / self.mass,)

    def output(self, x: Any) -> Any:
        return (x.x,)


@declared
class Idle(Increment):
    """The law on increments, of which no least learning gain is known."""

    @property
    def learning_gain(self) -> LearningGain:
        return LearningGain(0.0, 0.5)


STARTS = From(state=(0.0,), spread=(0.02,))
VARYING = TrialLength(law="uniform", minimum=15)
STUDIES: dict[str, dict[str, Any]] = {
    "starts that differ": {"initial": STARTS, "trial_length": VARYING},
    "noise": {"noise": UniformNoise(largest=0.01), "trial_length": VARYING},
    "masses that differ": {"truth": {"mass": Between(low=0.95, high=1.05)}},
    "several at once": {
        "truth": {"mass": Between(low=0.95, high=1.05), "drag": Between(low=0.1, high=0.3)},
        "initial": STARTS,
        "trial_length": VARYING,
    },
    "a gain that may vanish": {"initial": STARTS, "controllers": {"law": Idle(**LEARNING)}, "trial_length": VARYING},
    "parts of what stays the same": {"verify": Verification(scope={"plant.drag": (0.1, 0.3)}), "initial": STARTS},
    "noise from the best plan on": {"first_plan": Inverse(), "noise": UniformNoise(largest=0.01)},
    "nothing that differs": {"trial_length": VARYING},
}
COMES_TO_AN_END = set(STUDIES) - {"nothing that differs"}


def dossier(name: str) -> Dossier:
    fields = {
        "plant": Cart(),
        "reference": np.linspace(0.0, 1.0, N + 1) ** 2,
        "controllers": {"law": Increment(**LEARNING)},
        "trials": TRIALS,
        **STUDIES[name],
    }
    return Dossier(run(Study(**fields), show_progress=False), "law")


def passes(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Return a list to which every pass is added."""
    made: list[object] = []
    carry = Maker.carry
    monkeypatch.setattr(Maker, "carry", lambda self, question: (made.append(question), carry(self, question))[1])
    return made


def curve(d: Dossier) -> Curve:
    found = d.funnels.curve
    assert not isinstance(found, Open), found.reason
    return found


@pytest.mark.parametrize("name", STUDIES)
def test_a_curve_that_ends_in_one_funnel_is_that_of_all_passes(name, monkeypatch):
    d = dossier(name)
    made = passes(monkeypatch)
    short, few = curve(d), len(made)
    monkeypatch.setattr(funnel_curve, "GAINED", -1.0)
    vars(d.funnels).pop("curve")
    full = curve(d)
    assert full.alike is None and (short.alike is not None) == (name in COMES_TO_AN_END)
    assert (few < len(made) - few) == (name in COMES_TO_AN_END)
    assert (short.common >= full.common * (1 - 1e-9)).all() and (short.own >= full.own * (1 - 1e-9)).all()
    assert (short.common <= full.common * (1 + LOST)).all()
    assert short.final == full.final and short.rounded == full.rounded


@pytest.mark.parametrize("name", STUDIES)
def test_no_campaign_lies_above_a_curve(name):
    """Recorded trials and campaigns that are made to err stay below, those after the last pass as well."""
    d = dossier(name)
    found = funnel_curve.falls(curve(d), "1")
    assert d.funnels.held_curve(found).margin >= 0
    if found.standing is Standing.PROVED and name in COMES_TO_AN_END:
        assert f"first {curve(d).alike} of {TRIALS} trials" in found.method


def test_sets_that_still_grow_end_nothing():
    """Where the gain may vanish the first bound is the least of all: one funnel must not stand for it."""
    found = curve(dossier("a gain that may vanish"))
    assert found.alike is not None and found.alike > 1
    assert found.common[found.alike] > found.common[0] * (1 + LOST)


def test_a_curve_falls_on_where_it_is_not_known_where_learning_ends(monkeypatch):
    carry = Maker.carry
    monkeypatch.setattr(
        Maker, "carry", lambda self, asked: Open(reason="none") if asked.settled else carry(self, asked)
    )
    found = curve(dossier("starts that differ"))
    assert found.alike is None and found.final is None and found.common[-1] < 0.01 * found.common[0]
