"""Functions kept by what they compute: nothing is made twice, and nothing stale is ever handed out."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest

from models.actuator import Delayed
from models.plant import Plant, signals
from models.quantity import count, declared, given, quantity, table
from workbench.contracts.law import Law
from workbench.contracts.record import TrialInput
from workbench.fold import machine_code
from workbench.fold.equations import equations
from workbench.fold.fold import build, stream
from workbench.fold.machine_code import compiled, compiler

N = 12
STIFFNESS = 2.0
TABLE = {"first": 0.5, "second": 0.25}
needs_compiler = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


def damping(speed):
    return 0.1 * speed


def closed(factor):
    return lambda speed: factor * speed


@declared
class Cart(Plant):
    """A cart whose equations read a global, a global function, a table, a class attribute and a given function."""

    inputs = signals(force="N")
    states = outputs = signals(speed="m/s")
    extra = 0.01

    mass: float = quantity(default=2.0, unit="kg", doc="mass", above=0)
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    times: int = count(default=1, doc="how often the table is applied", least=1)
    heights: tuple[float, ...] = table(default=(1.0, 2.0), unit="N", doc="a table")
    pull: Any = given(default=closed(0.2), doc="a function")

    def step(self, x, u, w, k):
        force = u.force - STIFFNESS * x.speed - damping(x.speed) - self.extra - self.pull(x.speed)
        force = force - self.times * sum(TABLE.values()) - sum(self.heights)
        return (x.speed + self.sampling_time / self.mass * force,)

    def output(self, x):
        return (x.speed,)


@declared
class Faster(Cart):
    """The same cart, read in other units."""

    def output(self, x):
        return (3.6 * x.speed,)


class Memory(NamedTuple):
    u: Any


@declared
class Adding(Law):
    """A law that adds a part of the error to the plan; its first plan is a number."""

    source = "ours"
    learns_on = "output"
    first = 1.0
    part = 0.5

    gain: float = quantity(default=1.0, unit="N/(m/s)", doc="gain")

    def start(self, task):
        return Memory(self.first * ca.DM.ones(1, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        return Memory(memory.u + self.gain * self.part * ca.if_else(trial.reached[1:], trial.e[1:], 0))


@declared
class Feedback(Adding):
    """The same law, its input fed back from the output."""

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u - y, state


def ran(plant, law, samples=N):
    fold = build(plant, law, samples)
    one = TrialInput(samples, [0.0] * len(plant.states), np.zeros((0, samples)), np.zeros((1, samples + 1)))
    lefts = list(stream(fold, np.linspace(0, 1, samples + 1)[None, :], [one] * 3))
    return fold, [left.mse for left in lefts]


def other_global(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "STIFFNESS", np.nextafter(2.0, 3.0))


def other_global_in_place(monkeypatch):
    monkeypatch.setitem(TABLE, "second", 0.3)


def other_function(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "damping", lambda speed: 0.3 * speed)


def other_attribute(monkeypatch):
    monkeypatch.setattr(Cart, "extra", 0.02)


def other_method(monkeypatch):
    monkeypatch.setattr(Cart, "output", lambda self, x: (2 * x.speed,))


def other_learning(monkeypatch):
    monkeypatch.setattr(Adding, "learn", lambda self, memory, trial: Memory(2 * memory.u))


def other_part(monkeypatch):
    monkeypatch.setattr(Adding, "part", 0.4)


def other_first(monkeypatch):
    monkeypatch.setattr(Adding, "first", 2.0)


def estimating(monkeypatch):
    monkeypatch.setattr(Adding, "ppd_estimate", lambda self, memory: memory.u, raising=False)


def placing(monkeypatch):
    monkeypatch.setattr(Adding, "place", lambda self, memory, x0: x0 + 1, raising=False)


CHANGES = [
    other_global,
    other_global_in_place,
    other_function,
    other_attribute,
    other_method,
    other_learning,
    other_part,
    other_first,
    estimating,
    placing,
]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_what_changed_behind_the_declarations_is_seen(change, monkeypatch):
    plant, law = Cart(), Adding()
    before, was = ran(plant, law)
    change(monkeypatch)
    after, now = ran(plant, law)
    assert after.trial is not before.trial
    assert now != was or change in (
        other_global,
        estimating,
    )  # one bit may be lost in a sum, an estimate changes no error
    monkeypatch.undo()
    again, back = ran(plant, law)
    assert again.trial is before.trial and back == was


@pytest.mark.parametrize(
    ("plant", "law", "samples"),
    [
        (Cart(times=2), Adding(), N),
        (Cart(heights=(1.0, 2.0 + 2**-51)), Adding(), N),
        (Cart(pull=closed(0.3)), Adding(), N),
        (Faster(), Adding(), N),
        (Delayed(plant=Cart(), dead_time=0.1), Adding(), N),
        (Delayed(plant=Faster(), dead_time=0.1), Adding(), N),
        (Cart(), Feedback(), N),
        (Cart(), Adding(), N + 1),
        (Cart(sampling_time=ca.DM(0.1)), Adding(), N),
    ],
    ids=lambda value: type(value).__name__,
)
def test_other_declarations_are_other_functions(plant, law, samples):
    first, other = build(Cart(), Adding(), N), build(plant, law, samples)
    assert other.trial is not first.trial and other.start is not first.start
    assert other.trial.serialize() != first.trial.serialize()
    assert build(plant, law, samples).trial is other.trial


def test_other_numbers_are_the_same_function():
    one, two = build(Cart(), Adding(), N), build(Cart(mass=3.0), Adding(gain=0.25), N)
    assert one.trial is two.trial and one.start is two.start and one.parameters == two.parameters
    assert one.values == (2.0, 0.1, 1.0) and two.values == (3.0, 0.1, 0.25)
    assert (one.plant.mass, two.plant.mass, two.law.gain) == (2.0, 3.0, 0.25)
    plain = ran(Cart(mass=3.0), Adding(gain=0.25))[1]
    assert plain != ran(Cart(), Adding())[1]


def test_equations_of_the_same_content_are_equal():
    assert equations(Cart(), Adding(), N) == equations(Cart(mass=5.0), Adding(), N)
    assert equations(Cart(), Adding(), N) != equations(Cart(), Adding(), N + 1)
    assert hash(equations(Cart(), Adding(), N)) == hash(equations(Cart(), Adding(), N))


def scaled(factor):
    x = ca.MX.sym("x", 5)
    return ca.Function("scaled", [x], [ca.sin(factor * x)], ["x"], ["y"])


@pytest.mark.parametrize(
    ("one", "other"),
    [(2.0, np.nextafter(2.0, 3.0)), (1e-300, 1.0000000000000002e-300), (np.inf, 1e308), (2.0, np.nan)],
)
def test_a_function_is_told_apart_to_the_last_bit(one, other):
    assert machine_code._determined(scaled(one)) != machine_code._determined(scaled(other))
    assert machine_code._determined(scaled(one)) == machine_code._determined(scaled(one))


def test_zeros_of_both_signs_are_told_apart():
    x = ca.SX.sym("x")
    plus, minus = (ca.Function("f", [x], [ca.atan2(zero, x)]) for zero in (ca.SX(0.0), ca.SX(-0.0)))
    if float(plus(-1.0)) != float(minus(-1.0)):  # where CasADi keeps the sign at all
        assert machine_code._determined(plus) != machine_code._determined(minus)


NAMED = """
from studies.metro.study import STUDY
from workbench.fold import machine_code as m
from workbench.trials.simulation import Runner
for name in ("icfdl", "pd", "increment"):
    trial = Runner(STUDY, name).fold.trial
    print(m._digest(m._determined(trial), trial.name()))
"""


def test_another_process_finds_the_same_library():
    said = [
        subprocess.run(
            [sys.executable, "-c", NAMED],
            env=os.environ | {"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    ]
    assert said[0] == said[1] and len(set(said[0].split())) == 3


@needs_compiler
def test_no_c_is_generated_where_there_is_a_library(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    made = []
    generate = machine_code._c
    monkeypatch.setattr(machine_code, "_c", lambda of: made.append(1) or generate(of))
    one = scaled(3.0)
    first = compiled(one)
    assert made == [1]
    assert compiled(one) is first and made == [1]
    other = compiled(scaled(3.0))  # found on disk
    assert other is not first and made == [1]
    assert np.array_equal(other(np.arange(5)).full(), first(np.arange(5)).full())
    (library,) = tmp_path.glob("*.so")
    library.unlink()
    compiled(scaled(3.0))
    assert made == [1, 1]


@needs_compiler
def test_a_library_is_of_its_compiler_and_flags(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    wrapper, real = tmp_path / "mycc", compiler()
    wrapper.write_text(f'#!/bin/sh\nexec {real} "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setenv("CC", str(wrapper))
    one = scaled(3.0)

    def libraries():
        compiled(one)
        return len(list((tmp_path / "cache").glob("*.so")))

    assert libraries() == 1
    wrapper.write_text(f'#!/bin/sh\n# another version\nexec {real} "$@"\n')
    assert libraries() == 2
    monkeypatch.setattr(machine_code, "FLAGS", (*machine_code.FLAGS, "-g"))
    assert libraries() == 3
    monkeypatch.setattr(machine_code, "_own_source", lambda: "another text")
    assert libraries() == 4


@needs_compiler
def test_a_failure_is_tried_again(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    compiler_of_today, real = tmp_path / "mycc", compiler()
    compiler_of_today.write_text("#!/bin/sh\nexit 1\n")
    compiler_of_today.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler_of_today))
    monkeypatch.setattr(machine_code, "_recipe", lambda command: (command,))
    one = scaled(4.0)
    assert compiled(one) is one
    compiler_of_today.write_text(f'#!/bin/sh\nexec {real} "$@"\n')
    assert compiled(one) is not one


@needs_compiler
def test_a_cache_that_can_only_be_read_is_read(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    wanted = compiled(scaled(5.0))

    def refused():
        raise AssertionError("a library that is there needs no writing")

    monkeypatch.setattr(machine_code, "cache_folder", refused)
    assert np.array_equal(compiled(scaled(5.0))(np.arange(5)).full(), wanted(np.arange(5)).full())


def test_what_casadi_cannot_serialise_is_told_apart_by_its_c(monkeypatch):
    def refusing(self, *arguments):
        raise RuntimeError("cannot be serialised")

    monkeypatch.setattr(ca.Function, "serialize", refusing)
    one, same, other = (machine_code._determined(scaled(factor)) for factor in (2.0, 2.0, 3.0))
    assert one == same != other and "sin" in one
