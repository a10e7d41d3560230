"""Choosing a first plan with which bounds are proved: what is found holds, a little less does not."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from small_plants import small
from small_studies import in_plant_units

import workbench as wb
from models.quantity import InvalidValue
from verification.checks.funnel import Open
from verification.decide.judge import Judge
from verification.theorems.dossier import Dossier
from verification.theorems.limits import limits
from workbench import Study, TrialLength, Verification
from workbench.contracts.finding import Grounds, Standing
from workbench.contracts.law import LearningGain
from workbench.contracts.scenario import From, NormalNoise, UniformNoise
from workbench.contracts.settings import changed
from workbench.contracts.study import Inverse, composed
from workbench.controllers import ICFDL, PD, Increment

N = 10
RAMP = np.sin(np.linspace(0, 2, N + 1))
FIRST = small("First", lambda x, u, k: (0.6 * x[0] + 0.5 * u,))
UNIT = small("Unit", lambda x, u, k: (0.5 * x[0] + u,))
UNSTABLE = small("Unstable", lambda x, u, k: (6 * x[0] + 0.5 * u,))
STUCK = small("Stuck", lambda x, u, k: (0.6 * x[0] + 0.2 * (u > 0.5) + 0.5 * (u > 0.7),))


def law(kind: Any = Increment, **changes: Any) -> Any:
    return in_plant_units(kind, **changes)


def study(plant: Any = FIRST, controller: Any = None, **changes: Any) -> Study:
    return Study(
        name="small",
        plant=plant,
        reference=changes.pop("reference", RAMP),
        controllers={"law": controller or law(), "pd": PD(kp=0.1, kd=0.1), "icfdl": law(ICFDL)},
        trials=4,
        trial_length=changes.pop("lengths", TrialLength(law="uniform", minimum=4)),
        **changes,
    )


def proved(of: Study, bounds: Any, share: float) -> bool:
    """Tell whether bounds are PROVED with a share of the inverse, by claims of a campaign of its own."""
    made = changed(
        dataclasses.replace(of, controllers={"law": of.controllers["law"]}),
        {"first_plan": Inverse(share=share), "verify": {"limits": bounds}},
    )
    judge = Judge()
    return all(judge.verdict(one).standing is Standing.PROVED for one in limits(wb.run(made, show_progress=False)))


FOUND = [
    # what, study, bounds, least share lies between
    ("an input", study(), {"u": (0.1, 2)}, (0.2, 0.4)),
    ("noise", study(noise=UniformNoise(largest=0.01)), {"x0": (-0.1, 1.3), "u": (0, 2)}, (0.0, 0.6)),
    ("starts scatter", study(initial=From(state=(0.0,), spread=(0.1,))), {"x0": (-0.2, 1.2)}, (0.0, 1.0)),
    ("unstable", study(UNSTABLE), {"x0": (None, 1.05)}, (0.999, 1.0)),
    ("all do", study(), {"x0": (None, 1.05)}, (0.0, 0.0)),
]  # fmt: skip


@pytest.mark.parametrize(("of", "bounds", "least"), [one[1:] for one in FOUND], ids=[one[0] for one in FOUND])
def test_the_share_that_is_found_is_proved_and_the_least_is_just_not_beyond(of, bounds, least):
    found = wb.safe_plan(of, "law", bounds)
    assert found and not found.reason and found.controller == "law" and found.study is not None
    assert [one.standing for one in found.verdicts] == [Standing.PROVED] * len(bounds)
    assert all(one.grounds is Grounds.INDUCTION for one in found.verdicts)
    assert proved(of, bounds, found.least_share)
    assert least[0] <= found.least_share <= least[1] and found.least_share <= found.share
    if 0 < found.least_share < 1:
        assert not proved(of, bounds, found.least_share - 0.01)
    for name, (low, high) in bounds.items():
        assert (low is None or low <= found.bands[name][0]) and (high is None or found.bands[name][1] <= high)
    best = max((one for one in found.tried if not one.reason), key=lambda one: one.room)
    chosen = next(one.room for one in found.tried if one.share == found.share)
    assert chosen == pytest.approx(best.room, abs=1e-9)
    assert set(found.settings) == {"first_plan"} and found.study.first_plan == Inverse(share=found.share)
    assert str(found).count("PROVED") == len(bounds) and f"{found.share:g} of the nominal inverse" in str(found)


@pytest.mark.parametrize("reach", [1.4, 3.0])
def test_a_gain_is_lowered_where_it_overshoots(reach):
    of = study(UNIT, law(rho=1.0, lam=1 / (4 * reach**2)))
    found = wb.safe_plan(of, "law", {"x0": (-0.1, 1.05)})
    assert found and set(found.settings) == {"first_plan", "controllers.law.rho"}
    tamed = found.study.law("law").learning_gain
    assert 0.99 < tamed.high <= 1 < of.law("law").learning_gain.high
    d = Dossier(wb.run(found.study, show_progress=False), "law")
    assert not isinstance(d.funnels.found, Open) and d.funnels.found.reach <= 1
    rho = found.settings["controllers.law.rho"]
    assert found.study.controllers["law"].rho == rho < 1 and f"controllers.law.rho = {rho}" in str(found)


class Stiff(Increment):
    """Nothing of it is tuned."""

    def ranges(self, task: Any) -> Any:
        return {}


class Silent(Increment):
    """It does not say between which ends its gain lies."""

    @property
    def learning_gain(self) -> LearningGain | None:
        return None


NOTHING = [
    # what, study, law, bounds, words of the reason
    ("a bound below the reference", study(), "law", {"x0": (None, 0.5)}, "has bands of x0 0 to 0.99"),
    ("a start beyond", study(initial=From(state=(2.0,))), "law", {"x0": (None, 1.2)}, "ask for less, or prove it for"),
    ("a scope that is wide", study(verify=Verification(scope={"noise.x0": (-0.1, 0.1)})), "law", {"x0": (None, 1.2)},
     "a narrower scope"),
    ("noise without a bound", study(noise=NormalNoise(sigma=0.01)), "law", {"x0": (None, 1.2)}, "noise has no bound"),
    ("starts without a bound", study(continues=True), "law", {"x0": (None, 1.2)}, "what trials begin with"),
    ("a gain below 0", study(), law(phi0=-1.0), {"x0": (None, 1.2)}, "learning gains above 0"),
    ("a filter", study(reference=np.repeat(RAMP, 4), lengths=TrialLength(law="fixed")), law(q_cutoff_hz=0.1),
     {"x0": (None, 1.2)}, "without its filter"),
    ("no inverse", study(STUCK), "law", {"x0": (None, 1.2)}, "the nominal model has no inverse to take a share of"),
    ("a gain that nothing lowers", study(UNIT, law(Stiff, rho=1.0, lam=1 / 36)), "law", {"x0": (None, 1.2)},
     "none of its tuned fields lowers it enough"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("of", "which", "bounds", "words"), [one[1:] for one in NOTHING], ids=[one[0] for one in NOTHING]
)
def test_where_nothing_is_found_it_says_why(of, which, bounds, words):
    found = wb.safe_plan(of, which, bounds)
    assert not found and words in found.reason, found.reason
    assert found.share is None and found.study is None and not found.settings and not found.verdicts
    assert str(found) == f"no first plan was proved for law: {found.reason}" and "\n" not in str(found)
    assert not {"nan", "inf", "None"} & set(found.reason.replace(",", " ").split())


REFUSED = [
    # law, bounds, what is said
    ("lw", {"x0": (0, 1)}, "law must be one of law, pd, icfdl, or a law; got 'lw'"),
    (3, {"x0": (0, 1)}, "controllers.law must be a Law"),
    ("law", {}, "bounds must name at least one signal, as in {'speed': (0, 80)}; got {}"),
    ("law", [1], "bounds must name at least one signal, as in {'speed': (0, 80)}; got [1]"),
    ("law", {"speed": (0, 1)}, "verify.limits names 'speed', which there is not; there are: x0, u"),
    ("law", {"x0": (2, 1)}, "low at most high for 'x0', got (2, 1)"),
    ("law", {"x0": (None, None)}, "one of which may be null, for 'x0'"),
    ("law", {"x0": (float("nan"), 1)}, "finite numbers"),
    ("law", {"x0": (0, float("inf"))}, "finite numbers"),
    ("law", {"x0": "far"}, "a pair [low, high]"),
    ("law", {"x0": (1, 2, 3)}, "a pair [low, high]"),
    ("pd", {"x0": (0, 1)}, "pd must learn on increments with a gain between declared ends"),
    ("icfdl", {"x0": (0, 1)}, "icfdl must learn on increments with a gain between declared ends"),
    (law(Silent), {"x0": (0, 1)}, "law must learn on increments with a gain between declared ends"),
]


@pytest.mark.parametrize(("which", "bounds", "said"), REFUSED)
def test_what_is_no_question_is_told_in_one_line(which, bounds, said):
    with pytest.raises(InvalidValue) as raised:
        wb.safe_plan(study(), which, bounds)
    assert said in str(raised.value) and "\n" not in str(raised.value)


def made_of_its_own(*fields: str) -> Study:
    """Return the study, some of whose fields it makes of settings of its own."""
    whole = study()
    given = {"reference": whole.reference, "controllers": whole.controllers, "first_plan": 0.3}
    others = {name: value for name, value in given.items() if name not in (*fields, "first_plan")}
    others |= {"name": "small", "plant": FIRST, "trials": 4, "trial_length": whole.trial_length}
    return composed(None, lambda own, seed: {name: given[name] for name in fields}, **others)


@pytest.mark.parametrize("field", ["controllers", "first_plan"])
def test_a_study_that_makes_what_is_to_be_changed_is_told_in_one_line(field):
    of = made_of_its_own(field)
    with pytest.raises(InvalidValue) as raised:
        wb.safe_plan(of, "law", {"x0": (None, 1.05)})
    assert f"it makes {field} of settings of its own" in str(raised.value) and "\n" not in str(raised.value)
    assert wb.safe_plan(dataclasses.replace(of, compose=None), "law", {"x0": (None, 1.05)})


def test_a_study_that_makes_other_fields_has_the_plan_of_one_that_makes_none():
    of, plain = made_of_its_own("reference"), study()
    bounds = {"u": (0.1, 2)}
    assert wb.safe_plan(of, "law", bounds).share == wb.safe_plan(plain, "law", bounds).share
