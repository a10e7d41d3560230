"""Stepped laws against a plain loop, and against the same law folded: noise, disturbance, truth, ends, learning."""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest

from models.actuator import Actuator
from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, given, quantity
from workbench.contracts.law import Channels, Decision, Law, Task
from workbench.contracts.record import TrialInput
from workbench.contracts.scenario import Between, From, NormalDisturbance, UniformNoise
from workbench.contracts.study import Study
from workbench.controllers.parts.rows import known
from workbench.fold.fold import build, stream
from workbench.fold.stepping import Stepped
from workbench.trials.campaign import run

N, T, TRIALS = 30, 0.1, 4


@declared
class Sledge(Plant):
    """A mass on ice: it slides, and with ``halts`` a trial is over where it stands."""

    source: ClassVar[str] = "ours"
    states = signals(speed="m/s", place="m")
    inputs = signals(force="N")
    outputs = signals(speed="m/s")
    disturbances = signals(push="N")
    sampling_time: float = quantity(default=T, unit="s", doc="sampling time", above=0)
    mass: float = quantity(default=2.0, unit="kg", doc="mass", above=0)
    drag: float = quantity(default=0.3, unit="N s^2/m^2", doc="drag", least=0)
    halts: bool = given(default=False, doc="whether trials end where it stands")

    def step(self, x, u, w, k):
        force = u.force + w.push - self.drag * x.speed * ca.fabs(x.speed) * (1 + 0.01 * k)
        return x.speed + T / self.mass * force, x.place + T * x.speed

    def output(self, x):
        return (x.speed,)

    def ended(self, x):
        return x.speed <= 0 if self.halts else None


class Total(NamedTuple):
    e: object


class Row(NamedTuple):
    r: object


@declared
class FoldedPI(Law):
    source: ClassVar[str] = "ours"
    kp: float = quantity(default=3.0, unit="N s/m", doc="gain")
    ki: float = quantity(default=0.4, unit="N/m", doc="gain of the sum")

    def start(self, task):
        return ()

    def ready(self, memory):
        return Total(0)

    def act(self, memory_k, state, r, r_next, y):
        total = state.e + (r - y)
        return self.kp * (r_next - y) + self.ki * total, Total(total)


@declared
class SteppedPI(Law):
    source: ClassVar[str] = "ours"
    tells = signals(total="m/s")
    kp: float = quantity(default=3.0, unit="N s/m", doc="gain")
    ki: float = quantity(default=0.4, unit="N/m", doc="gain of the sum")

    def start(self, task):
        return Row(ca.DM(task.reference).full()[0])

    def ready(self, memory):
        return Total(0.0)

    def decide(self, memory, state, seen):
        total = state.e + memory.r[seen.k] - seen.y[0]
        note = "fast" if seen.y[0] > 2.5 else ""
        u = self.kp * (memory.r[seen.k + 1] - seen.y[0]) + self.ki * total
        return Decision(np.array([u]), (total,), note), Total(total)


def reference(braking=False):
    t = np.arange(N + 1) * T
    return np.atleast_2d(2.0 - 1.5 * t if braking else np.sin(t) + 1)


def by_a_loop(one, r, *, mass=2.0, halts=False, kp=3.0, ki=0.4):
    """One trial, number by number."""
    (v, s), total = one.x0, 0.0
    x, u = [(v, s)], []
    for k in range(one.length):
        if halts and v <= 0:
            break
        y = v + one.noise[0, k]
        total += r[k] - y
        u.append(kp * (r[k + 1] - y) + ki * total)
        force = u[-1] + one.w[0, k] - 0.3 * v * abs(v) * (1 + 0.01 * k)
        v, s = v + T / mass * force, s + T * v
        x.append((v, s))
    squares = [(r[k] - x[k][0]) ** 2 for k in range(1, len(x))]
    return x, u, sum(squares) / len(squares), len(x) - 1


def inputs(*, noise=0.0, push=0.0, lengths=(N,) * TRIALS, masses=None, x0=(1.0, 0.0)):
    random = np.random.default_rng(3)
    made = []
    for i, length in enumerate(lengths):
        w, seen = push * random.normal(size=(1, N)), noise * random.normal(size=(1, N + 1))
        truth = None if masses is None else np.array([T, masses[i], 0.3])
        made.append(TrialInput(length, np.array(x0), w, seen, truth))
    return made


def task(r):
    return Task(ca.SX(r), ca.SX(T))


CASES = {
    "plain": ({}, {}),
    "noise": ({"noise": 0.05}, {}),
    "disturbance": ({"push": 0.5}, {}),
    "truth": ({"masses": (1.5, 2.0, 2.5, 3.0), "push": 0.2}, {}),
    "short": ({"lengths": (30, 12, 1, 29), "noise": 0.05}, {}),
    "ends by the event": ({"noise": 0.02, "push": 0.3, "lengths": (30, 8, 30, 30)}, {"halts": True}),
}


@pytest.mark.parametrize("engine", ["stepped", "folded"])
@pytest.mark.parametrize("case", CASES)
def test_trials_are_those_of_a_plain_loop(case, engine):
    given_inputs, fields = CASES[case]
    ins, plant, r = inputs(**given_inputs), Sledge(**fields), reference(braking="halts" in fields)
    if engine == "stepped":
        lefts = list(Stepped(plant, SteppedPI(), N, task(r)).trials(ins))
    else:
        lefts = list(stream(build(plant, FoldedPI(), N, task(r)), r, ins))
    for one, left in zip(ins, lefts, strict=True):
        mass = 2.0 if one.truth is None else one.truth[1]
        x, u, mse, last = by_a_loop(one, r[0], mass=mass, **fields)
        assert left.length == last
        np.testing.assert_allclose(left.x[:, : last + 1], np.array(x).T, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(left.y[0, : last + 1], [v for v, _ in x], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(left.u[0, :last], u, rtol=1e-12, atol=1e-12)
        assert np.isnan(left.u[0, last:]).all() and np.isnan(left.y[0, last + 1 :]).all()
        assert left.mse == pytest.approx([mse], rel=1e-12)
        if engine == "folded":  # the state stands still once the trial is over
            np.testing.assert_array_equal(left.x[:, last:], np.repeat(left.x[:, last : last + 1], N + 1 - last, axis=1))
    assert "halts" not in fields or {left.length for left in lefts} > {8}


@pytest.mark.parametrize("engine", ["stepped", "folded"])
def test_a_trial_begins_where_the_last_one_ended(engine):
    ins, r = inputs(push=0.4, lengths=(30, 11, 30, 20)), reference()
    if engine == "stepped":
        lefts = list(Stepped(Sledge(), SteppedPI(), N, task(r)).trials(ins, carry_state=True))
    else:
        lefts = list(stream(build(Sledge(), FoldedPI(), N, task(r)), r, ins, carry_state=True))
    begin = (1.0, 0.0)
    for one, left in zip(ins, lefts, strict=True):
        x, _, _, last = by_a_loop(one._replace(x0=begin), r[0])
        np.testing.assert_allclose(left.x[:, : last + 1], np.array(x).T, rtol=1e-12, atol=1e-13)
        begin = x[-1]


STUDIES = {
    "plain": {},
    "scenario": {
        "noise": UniformNoise(largest=0.05),
        "disturbance": NormalDisturbance(sigmas=(0.3,)),
        "initial": From(state=(1.0, 0.0), spread=(0.2, 1.0)),
        "truth": {"mass": Between(low=0.8, high=1.2)},
        "trial_length": (30, 22, 25, 30),
    },
    "actuator": {"actuator": Actuator(lower=-2.0, upper=2.0, rate=15.0, delay=0.1), "truth": {"drag": 1.3}},
    "event": {"plant": Sledge(halts=True), "reference": reference(braking=True), "initial": (1.5, 0.0)},
    "carried": {"continues": True, "disturbance": NormalDisturbance(sigmas=(0.3,))},
}


@pytest.mark.parametrize("name", STUDIES)
def test_the_same_law_folded_and_stepped_leaves_the_same_record(name):
    fields = {"plant": Sledge(), "reference": reference(), "trials": TRIALS, "seed": 5} | STUDIES[name]
    data = run(
        Study(name="both", controllers={"folded": FoldedPI(), "stepped": SteppedPI()}, **fields), show_progress=False
    ).data
    folded, stepped = data.sel(controller="folded"), data.sel(controller="stepped")
    for variable in ("output", "error", "input", "applied", "state_speed", "state_place", "mse", "trial_length"):
        np.testing.assert_allclose(stepped[variable], folded[variable], rtol=1e-12, atol=1e-12, err_msg=variable)
    missed = (data["reference"] - stepped["output"] - data["noise"]).transpose("trial", "sample").values
    total = np.cumsum(missed, axis=1)[:, :-1]
    told = stepped["law_total"].values[:, :-1]
    np.testing.assert_allclose(told, np.where(np.isnan(told), np.nan, total), atol=1e-11)
    assert np.isnan(folded["law_total"]).all()
    if name == "event":
        assert (data["trial_length"] < N).all() and data["trial_length"].dims == ("controller", "trial")


class Learned(NamedTuple):
    plan: np.ndarray


@declared
class SteppedILC(Law):
    """u <- u + e(k+1), as numbers."""

    source: ClassVar[str] = "ours"
    learns_on = "output"

    def start(self, task):
        return Learned(np.zeros((1, task.samples)))

    def decide(self, memory, state, seen):
        return Decision(memory.plan[:, seen.k]), state

    def learn(self, memory, trial):
        missed = ca.DM(known(trial.reached, trial.e)).full()[:, 1:]
        return Learned(memory.plan + missed)


@declared
class FoldedILC(Law):
    source: ClassVar[str] = "ours"
    learns_on = "output"

    def start(self, task):
        return Learned(ca.MX.zeros(1, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.plan, state

    def learn(self, memory, trial):
        return Learned(memory.plan + known(trial.reached[1:], trial.e[1:]))


def test_a_stepped_law_learns_between_trials_as_a_folded_one_does():
    ins, r = inputs(noise=0.02, lengths=(30, 17, 30, 24)), reference()
    stepped = list(Stepped(Sledge(), SteppedILC(), N, task(r)).trials(ins, keep_memory=True))
    folded = list(stream(build(Sledge(), FoldedILC(), N, task(r)), r, ins, keep_memory=True))
    plan = np.zeros((1, N))
    for one, mine, theirs in zip(ins, stepped, folded, strict=True):
        np.testing.assert_allclose(mine.memory[0], plan, atol=1e-13)
        np.testing.assert_allclose(mine.memory[0], theirs.memory[0], atol=1e-12)
        assert mine.mse == pytest.approx(theirs.mse, rel=1e-12)
        plan = plan + np.nan_to_num(r - mine.y - one.noise)[:, 1:]
    assert stepped[-1].mse < 0.5 * stepped[0].mse
    (again,) = Stepped(Sledge(), SteppedILC(), N, task(r)).trials(ins[2:3], memory=stepped[2].memory)
    np.testing.assert_array_equal(again.u, stepped[2].u)


@declared
class Wrong(Law):
    """Zero until a sample, then whatever it was told to decide."""

    source: ClassVar[str] = "wrong on purpose"
    channels: ClassVar[Channels] = Channels(inputs=None)
    tells = signals(hold="1", cost="1")
    decision: Decision = given(doc="what it decides at sample 2")

    def start(self, task):
        return ()

    def decide(self, memory, state, seen):
        return (self.decision if seen.k == 2 else Decision(np.zeros(1), (0.0, 0.0))), state


@pytest.mark.parametrize(
    ("decision", "message"),
    [
        (Decision(np.zeros(2), (0, 0)), r"Wrong.decide must give 1 input\(s\) \(force\), got 2 at sample 2"),
        (Decision(np.zeros(0), (0, 0)), r"Wrong.decide must give 1 input\(s\) \(force\), got 0 at sample 2"),
        (Decision("much", (0, 0)), r"Wrong.decide must give 1 input\(s\) \(force\), got 'much' at sample 2"),
        (Decision(np.zeros(1), (0,)), r"Wrong.decide must tell 2 value\(s\) \(hold, cost\), got 1 at sample 2"),
        (Decision(np.zeros(1)), r"Wrong.decide must tell 2 value\(s\) \(hold, cost\), got 0 at sample 2"),
    ],
)
def test_a_decision_of_the_wrong_shape_is_told(decision, message):
    with pytest.raises(InvalidValue, match=message):
        list(Stepped(Sledge(), Wrong(decision=decision), N, task(reference())).trials(inputs()))


@pytest.mark.parametrize(("value", "said"), [(math.nan, "nan"), (math.inf, "inf")])
def test_an_input_that_is_not_finite_ends_the_run_and_is_told(value, said):
    law = Wrong(decision=Decision(np.array([value]), (1.0, 2.0)))
    study = Study(name="wrong", plant=Sledge(), reference=reference(), trials=3, controllers={"wrong": law})
    data = run(study, show_progress=False).data.sel(controller="wrong")
    reason = str(data["stopped"].values)
    assert reason.startswith("diverged at trial 1: the error is no longer finite; ")
    assert reason.endswith(f"; sample 2: force is {said}")
    assert data["diverged_at_trial"] == 1 and np.isnan(data["mse"]).all()
    assert np.isnan(data["output"].values[0, 3:]).all() and np.isfinite(data["output"].values[0, :3]).all()
    assert data["law_cost"].values[0, 2] == 2.0


def test_a_state_that_is_not_finite_is_not_shown_to_the_law():
    law = Wrong(decision=Decision(np.array([1e200]), (0.0, 0.0)))  # its drag overflows
    (left,) = Stepped(Sledge(), law, N, task(reference())).trials(inputs(lengths=(N,)))
    assert left.note == "sample 4: speed is -inf" and left.length == 4 and np.isnan(left.mse).all()


def test_the_first_note_is_recorded():
    study = Study(
        name="fast",
        plant=Sledge(),
        reference=reference(),
        controllers={"pi": SteppedPI()},
        trials=2,
        initial=(3.0, 0.0),
    )
    data = run(study, show_progress=False).data
    assert str(data["stopped"].sel(controller="pi").values) == "trial 1, sample 0: fast"
