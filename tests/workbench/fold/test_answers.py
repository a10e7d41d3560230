"""Slips in a law's methods: each is one line that names class and method, what was expected and what came."""

from __future__ import annotations

import re
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest

from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, quantity
from workbench.contracts.law import Decision, Law, LearnedSignal
from workbench.contracts.study import Study
from workbench.fold.fold import build
from workbench.fold.named import fields_of, flat, like, names
from workbench.trials.campaign import run

N = 12


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


class Memory(NamedTuple):
    u: ca.SX
    gain: ca.SX


class State(NamedTuple):
    last: ca.SX


@declared
class Good(Law):
    """A law without a slip."""

    source: ClassVar[str] = "ours"
    learns_on: ClassVar[LearnedSignal | None] = "output"
    tells = signals(gain="1")

    def start(self, task):
        return Memory(ca.DM.zeros(1, task.samples), 1.0)

    def ready(self, memory):
        return State(0)

    def place(self, memory, x0):
        return x0

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u + 0.5 * (r - y) + state.last, State(r - y)

    def learn(self, memory, trial):
        return memory._replace(u=memory.u + 0.1 * trial.e[:, 1:])

    def tell(self, memory, trial):
        return (memory.gain * ca.DM.ones(1, N),)

    def ppd_estimate(self, memory):
        return memory.u


SLIPS = {
    "start: a list": ("start", lambda self, task: [0.0], "must give a NamedTuple, or () for nothing; got 1 value(s)"),
    "start: a plain tuple": ("start", lambda self, task: (0.0, 1.0), "must give a NamedTuple, .* got 2 value(s)"),
    "start: an array": ("start", lambda self, task: np.zeros(3), "must give a NamedTuple.*one ndarray of shape (3,)"),
    "start: nothing": ("start", lambda self, task: None, "must give a NamedTuple, or () for nothing; got None"),
    "start: a word": (
        "start",
        lambda self, task: Memory("zero", 1),
        "must give u as an expression or a number, got 'zero'",
    ),
    "start: columns": (
        "start",
        lambda self, task: Memory(ca.DM.zeros(1, 5), 1),
        "must give u with 1, N = 12 or N + 1 columns, got 5",
    ),
    "start: arity": ("start", lambda self: (), "must take (task): .*takes 1 positional argument but 2 were given"),
    "ready: a number": ("ready", lambda self, memory: 0.0, "must give a NamedTuple, or () for nothing; got 0.0"),
    "ready: arity": ("ready", lambda self: (), "must take (memory): "),
    "place: two": ("place", lambda self, memory, x0: ca.DM([1, 2]), "must give the initial state in the shape (1, 1)"),
    "place: a word": ("place", lambda self, memory, x0: "there", "the initial state in the shape (1, 1), got 'there'"),
    "act: no state": ("act", lambda self, m, s, r, n, y: r - y, "must give (u, state), .* got one SX of shape (1, 1)"),
    "act: three": ("act", lambda self, m, s, r, n, y: (r, s, y), "must give (u, state), .* got 3 value(s)"),
    "act: inputs": (
        "act",
        lambda self, m, s, r, n, y: (ca.vertcat(r, y), s),
        "must give 1 value(s) (force), got shape (2, 1)",
    ),
    "act: a word": ("act", lambda self, m, s, r, n, y: ("full", s), "must give 1 value(s) (force), got 'full'"),
    "act: no tuple": (
        "act",
        lambda self, m, s, r, n, y: (r, r),
        "must give the acting state as a State of last, got one SX",
    ),
    "act: empty": (
        "act",
        lambda self, m, s, r, n, y: (r, ()),
        "must give the acting state as a State of last, got 0 value",
    ),
    "act: longer": (
        "act",
        lambda self, m, s, r, n, y: (r, State(ca.vertcat(r, y))),
        "must keep the shape of last, (1, 1); got (2, 1)",
    ),
    "act: other fields": (
        "act",
        lambda self, m, s, r, n, y: (r, Memory(r, y)),
        "the acting state as a State of last, got 2 value",
    ),
    "act: arity": (
        "act",
        lambda self, m, s, r: (r, s),
        "must take (memory_k, state, r, r_next, y): .*takes 4 .*6 were given",
    ),
    "learn: nothing": (
        "learn",
        lambda self, memory, trial: None,
        "must give the memory as a Memory of u, gain, got None",
    ),
    "learn: half": ("learn", lambda self, memory, trial: (memory.u,), "the memory as a Memory of u, gain, got 1 value"),
    "learn: shorter": (
        "learn",
        lambda self, memory, trial: memory._replace(u=memory.u[:-1]),
        "must keep the shape of u, (1, 12); got (1, 11)",
    ),
    "learn: arity": ("learn", lambda self, memory: memory, "must take (memory, trial): "),
    "tell: too many": (
        "tell",
        lambda self, memory, trial: (memory.u, memory.u),
        "must give 1 row(s) (gain), got 2 value(s)",
    ),
    "tell: one": (
        "tell",
        lambda self, memory, trial: memory.u,
        "must give 1 row(s) (gain), got one MX of shape (1, 12)",
    ),
    "tell: a number": ("tell", lambda self, memory, trial: (1.0,), "must give gain in the shape (1, 12), got 1.0"),
    "tell: arity": ("tell", lambda self, memory: (), "must take (memory, trial): "),
    "ppd_estimate: shape": (
        "ppd_estimate",
        lambda self, memory: memory.gain,
        "the estimate in the shape (1, 12), got one MX",
    ),
}


def with_slip(method, written):
    written.__name__, written.__qualname__ = method, f"Mine.{method}"
    return declared(type("Mine", (Good,), {method: written}))()


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_one_line(slip):
    method, written, says = SLIPS[slip]
    with pytest.raises(InvalidValue) as caught:
        build(Cart(), with_slip(method, written), N)
    said = str(caught.value)
    pattern = re.escape(says).replace(r"\.\*", ".*")
    assert re.match(rf"Mine\.{method} ", said) and re.search(pattern, said) and "\n" not in said, said


def test_what_fails_within_a_method_is_not_a_slip_of_its_arguments():
    def act(self, memory_k, state, r, r_next, y):
        return len(3), state

    with pytest.raises(TypeError, match="has no len"):
        build(Cart(), with_slip("act", act), N)
    assert build(Cart(), Good(), N).law_memory == ("memory_u", "memory_gain")


@declared
class Deciding(Law):
    """A law that is asked in numbers."""

    source: ClassVar[str] = "ours"

    def start(self, task):
        return ()

    def decide(self, memory, state, seen):
        return Decision(u=np.array([1.0 - seen.y[0]])), state


STEPPED = {
    "start": ("start", lambda self, task: [1], "must give a NamedTuple, or () for nothing; got 1 value(s)"),
    "decide": (
        "decide",
        lambda self, memory, state, seen: 1.0,
        "must give (Decision(u=...), state), .* got 1.0 at sample 0",
    ),
    "decide: no state": ("decide", lambda self, m, s, seen: Decision(np.ones(1)), "must give (Decision(u=...), state)"),
    "decide: inputs": (
        "decide",
        lambda self, m, s, seen: (Decision(np.ones(2)), s),
        "must give 1 input(s) (force), got 2",
    ),
    "decide: arity": ("decide", lambda self, memory: 1.0, "must take (memory, state, seen): "),
}


@pytest.mark.parametrize("slip", STEPPED)
def test_a_slip_of_a_stepped_law_is_one_line(slip):
    method, written, says = STEPPED[slip]
    written.__name__, written.__qualname__ = method, f"Mine.{method}"
    law = declared(type("Mine", (Deciding,), {method: written}))()
    made = Study(plant=Cart(), reference=np.ones(N + 1), controllers={"law": law}, trials=2)
    with pytest.raises(InvalidValue) as caught:
        run(made, show_progress=False)
    pattern = re.escape(says).replace(r"\.\*", ".*")
    assert re.search(rf"Mine\.{method} {pattern}", str(caught.value)), str(caught.value)


class Inner(NamedTuple):
    a: object
    b: object


class Outer(NamedTuple):
    inner: Inner
    c: object
    nothing: tuple[()]


def test_what_is_kept_within_is_a_list_and_back():
    kept = Outer(Inner(1, 2), 3, ())
    assert flat(kept) == [1, 2, 3] and names(kept) == ["inner_a", "inner_b", "c"]
    assert like(kept, [4, 5, 6]) == Outer(Inner(4, 5), 6, ()) and type(like(kept, [4, 5, 6]).inner) is Inner
    assert like((), []) == () and names(()) == [] and fields_of((1,)) is None
    with pytest.raises(ValueError, match="expected 3 values, got 4"):
        like(kept, [1, 2, 3, 4])
