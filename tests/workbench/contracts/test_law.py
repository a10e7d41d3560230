"""The contract of a law: what it must give, what is neutral, and slips that are told at once."""

from __future__ import annotations

from typing import ClassVar

import pytest

from models.plant import signals
from models.quantity import InvalidValue, declared
from studies.metro.study import STUDY
from workbench import Law
from workbench.contracts.law import LearnedSignal
from workbench.contracts.study import Study
from workbench.controllers import ICFDL, PD, Increment
from workbench.controllers.odometry import Odometry
from workbench.controllers.palc import PALC
from workbench.controllers.pid import PID


@declared
class Idle(Law):
    """A law that does nothing."""

    source: ClassVar[str] = "ours, 2026"

    def start(self, task):
        return ()

    def act(self, memory_k, state, r, r_next, y):
        return 0.0, state


def test_everything_optional_is_neutral():
    law = Idle()
    assert law.learns_on is None and law.tells == () and law.estimator is None and not law.keeps_state
    assert law.ready("memory") == () and law.place("memory", "x0") == "x0" and law.learn("memory", None) == "memory"
    assert (
        law.ppd_estimate("memory") is None and law.tell("memory", None) == () and law.refusal(STUDY.task(law)) is None
    )
    assert law.solves_per_sample == 0


@pytest.mark.parametrize(
    ("law", "learns_on", "keeps_state", "estimates"),
    [
        (ICFDL(), "output", False, True),
        (Increment(), "increment", False, True),
        (PD(), "output", False, False),
        (PID(), None, True, False),
        (Odometry(law=PALC()), "output", True, False),
        (Odometry(law=PID()), None, True, False),
    ],
)
def test_what_laws_say_of_themselves(law, learns_on, keeps_state, estimates):
    assert (law.learns_on, law.keeps_state) == (learns_on, keeps_state)
    assert (law.estimator is law) == estimates


def test_a_law_that_learns_says_on_what():
    with pytest.raises(TypeError, match='Silent has learn, so it must say learns_on = "output" or "increment"'):

        class Silent(Idle):
            def learn(self, memory, trial):
                return memory

    class Said(Idle):
        learns_on: ClassVar[LearnedSignal | None] = "output"

        def learn(self, memory, trial):
            return memory

    assert Said().learns_on == "output"


def test_a_law_that_tells_names_its_signals():
    with pytest.raises(TypeError, match="Silent has tell, so it must name the signals that it tells"):

        class Silent(Idle):
            def tell(self, memory, trial):
                return (1.0,)

    class Said(Idle):
        tells = signals(gain="1")

        def tell(self, memory, trial):
            return (1.0,)

    assert Said().tells[0].name == "gain"


def test_a_law_without_act_is_none():
    @declared
    class Half(Law):
        source = "ours, 2026"

        def start(self, task):
            return ()

    with pytest.raises(InvalidValue, match="Half must give act, as expressions, or decide, in numbers"):
        Study(plant=STUDY.plant, reference=STUDY.reference, controllers={"half": Half()})


@pytest.mark.parametrize("law", [3, ICFDL, object(), None])
def test_what_is_no_law_is_refused(law):
    with pytest.raises(InvalidValue, match=r"controllers\.mine must be a Law"):
        STUDY.__class__(plant=STUDY.plant, reference=STUDY.reference, controllers={"mine": law})
