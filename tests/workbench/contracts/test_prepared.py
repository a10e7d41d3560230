"""Slips in what a law says before its first trial: each is one line with its place, class and method."""

from __future__ import annotations

import inspect
import re
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest

from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, quantity
from workbench.contracts.law import Law
from workbench.contracts.study import Study
from workbench.trials.campaign import run


@declared
class Cart(Plant):
    """A cart."""

    states = outputs = signals(speed="m/s")
    inputs = signals(force="N")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.9 * x.speed + 0.1 * u.force,)

    def output(self, x):
        return (x.speed,)


@declared
class Mine(Law):
    """A law without a slip."""

    source: ClassVar[str] = "ours"

    def start(self, task):
        return ()

    def act(self, memory_k, state, r, r_next, y):
        return r_next - y, state


def study_of(law):
    return Study(plant=Cart(), reference=np.ones(9), controllers={"mine": law}, trials=2)


@declared
class NoChance(Mine):
    def chance(self, seed):
        return None


@declared
class WordsOfChance(Mine):
    def chance(self, seed):
        return ["a", "b"]


@declared
class OneChance(Mine):
    def chance(self, seed):
        return 1.0


@declared
class TableOfChance(Mine):
    def chance(self, seed):
        return np.zeros((2, 2))


@declared
class FailingChance(Mine):
    def chance(self, seed):
        return [1.0][seed + 1]


@declared
class NumberedRefusal(Mine):
    def refusal(self, task):
        return 5


@declared
class DoubtingRefusal(Mine):
    def refusal(self, task):
        return False


@declared
class FailingRefusal(Mine):
    def refusal(self, task):
        return task.nothing


@declared
class NotReady(Mine):
    def ready_for(self, task):
        return None


@declared
class ClassReady(Mine):
    def ready_for(self, task):
        return type(self)


@declared
class FailingReady(Mine):
    def ready_for(self, task):
        return 1 / 0


@declared
class BareAct(Mine):
    def act(self, memory_k, state, r, r_next, y):
        return r - y


@declared
class FlatPlace(Mine):
    def place(self, memory, x0):
        return ca.vertcat(x0, x0)


SLIPS = [
    (NoChance, "chance", "NoChance.chance must give numbers in a row, () for none; got None"),
    (WordsOfChance, "chance", "WordsOfChance.chance must give numbers in a row, () for none; got ['a', 'b']"),
    (OneChance, "chance", "OneChance.chance must give numbers in a row, () for none; got 1.0"),
    (TableOfChance, "chance", "TableOfChance.chance must give numbers in a row, () for none; got array("),
    (FailingChance, "chance", "IndexError: list index out of range"),
    (NumberedRefusal, "refusal", "NumberedRefusal.refusal must give why it cannot be used, in words, or None; got 5"),
    (DoubtingRefusal, "refusal", "in words, or None; got False"),
    (FailingRefusal, "refusal", "AttributeError: 'Task' object has no attribute 'nothing'"),
    (NotReady, "ready_for", "NotReady.ready_for must give the law, made ready; got None"),
    (ClassReady, "ready_for", "ClassReady.ready_for must give the law, made ready; got <class"),
    (FailingReady, "ready_for", "ZeroDivisionError: division by zero"),
    (BareAct, "act", "BareAct.act must give (u, state), the input and the next acting state; got one SX"),
    (FlatPlace, "place", "FlatPlace.place must give the initial state in the shape (1, 1), got one MX of shape (2, 1)"),
]


@pytest.mark.parametrize(("kind", "method", "says"), SLIPS, ids=[kind.__name__ for kind, *_ in SLIPS])
def test_a_slip_is_one_line_at_its_own_place(kind, method, says):
    with pytest.raises(InvalidValue) as caught:
        run(study_of(kind()), show_progress=False)
    said = str(caught.value)
    lines, first = inspect.getsourcelines(vars(kind)[method])
    line = re.search(r"test_prepared\.py, line (\d+)", said)
    assert says in said and "\n" not in said, said
    assert line and first <= int(line[1]) < first + len(lines), said


@pytest.mark.parametrize("numbers", [(), [0.5], (1, 2), np.array([0.1, 0.2, 0.3])], ids=str)
def test_numbers_in_a_row_come_back(numbers):
    class Drawing(Mine):
        def chance(self, seed):
            return numbers

    drawn = study_of(Mine()).task(declared(Drawing)()).chance
    assert drawn.shape == (len(numbers), 1)
    np.testing.assert_array_equal(np.array(drawn).ravel(), np.array(numbers, dtype=float))
