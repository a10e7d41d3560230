"""Laws of every form of learning, made for tests, with plants to run them on; some are wrong on purpose."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models.plant import Plant, signals
from models.quantity import declared, given, quantity
from workbench.contracts.law import Law
from workbench.controllers.parts.rows import known


@declared
class Second(Plant):
    """Two states, a curved spring: the output answers the input at the next sample."""

    source: ClassVar[str] = "made for tests"
    states = signals(x="1", v="1")
    inputs = signals(u="1")
    outputs = signals(x="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
    curve: float = quantity(default=0.0, unit="1", doc="how far the spring is from linear", structural=True)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        pull = 0.2 * x.x + self.curve * ca.sin(x.x)
        return 0.7 * x.x + 0.2 * x.v + 0.5 * u.u, 0.6 * x.v - pull + 0.3 * u.u

    def output(self, x: Any) -> Any:
        return (x.x,)


@declared
class Late(Second):
    """The same with the input one sample later: relative degree 2."""

    states = signals(x="1", v="1", before="1")

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        pull = 0.2 * x.x + self.curve * ca.sin(x.x)
        return 0.7 * x.x + 0.2 * x.v + 0.5 * x.before, 0.6 * x.v - pull + 0.3 * x.before, u.u


class Plan(NamedTuple):
    u: Any


class Two(NamedTuple):
    u: Any
    e: Any


class Started(NamedTuple):
    u: Any
    moved: Any


class Sum(NamedTuple):
    e: Any


@declared
class Planned(Law):
    """u <- u + gain e(k+1): what the others are variations of."""

    source: ClassVar[str] = "made for tests, 2026"
    learns_on: ClassVar[str] = "output"
    gain: float = quantity(default=0.8, unit="1", doc="learning gain")
    first: float = quantity(default=0.1, unit="1", doc="first plan", structural=True)

    def start(self, task: Any) -> Any:
        return Plan(self.first * ca.DM.ones(1, task.samples))

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        return memory_k.u, state

    def learn(self, memory: Any, trial: Any) -> Any:
        return Plan(memory.u + self.gain * known(trial.reached, trial.e)[1:])


@declared
class Full(Planned):
    """A full learning matrix: u <- u + E e with every entry of E there."""

    matrix: Any = given(default=None, doc="the learning matrix, (N, N)")

    def learn(self, memory: Any, trial: Any) -> Any:
        e = known(trial.reached, trial.e)[1:]
        return Plan(memory.u + ca.mtimes(e, ca.DM(np.asarray(self.matrix).T)))


@declared
class Shifted(Planned):
    """It learns from the error 1 + ahead samples later."""

    ahead: float = quantity(default=1, unit="samples", doc="shift", structural=True)

    def learn(self, memory: Any, trial: Any) -> Any:
        m = int(self.ahead)
        e = known(trial.reached, trial.e)
        return Plan(memory.u + self.gain * ca.horzcat(e[:, 1 + m :], ca.DM.zeros(1, m)))


@declared
class Forgetting(Planned):
    """u <- keep u + gain e: M is not I, and an error is left at the limit."""

    keep: float = quantity(default=0.9, unit="1", doc="share of the plan that is kept")

    def learn(self, memory: Any, trial: Any) -> Any:
        return Plan(self.keep * memory.u + self.gain * known(trial.reached, trial.e)[1:])


@declared
class Older(Planned):
    """It learns from the error of the trial before as well: memory beside the plan."""

    def start(self, task: Any) -> Any:
        return Two(self.first * ca.DM.ones(1, task.samples), ca.DM.zeros(1, task.samples))

    def learn(self, memory: Any, trial: Any) -> Any:
        e = known(trial.reached, trial.e)[1:]
        return Two(memory.u + self.gain * e + 0.2 * memory.e, e)


@declared
class Feeding(Planned):
    """It also feeds back within the trial, with the sum of the error."""

    def ready(self, memory: Any) -> Any:
        return Sum(ca.DM(0))

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        e = r - y
        return memory_k.u + 0.3 * e + 0.05 * state.e, Sum(0.9 * state.e + e)


@declared
class Overall(Feeding):
    """It learns from the whole input that it gave, and from its acting state."""

    def learn(self, memory: Any, trial: Any) -> Any:
        e = known(trial.reached, trial.e)
        return Plan(0.9 * memory.u + 0.1 * trial.u + self.gain * e[1:] + 0.01 * trial.state.e)


@declared
class Starting(Planned):
    """It learns where a trial begins, too."""

    def start(self, task: Any) -> Any:
        return Started(self.first * ca.DM.ones(1, task.samples), ca.DM.zeros(1, 1))

    def place(self, memory: Any, x0: Any) -> Any:
        return x0 + ca.vertcat(memory.moved, *[0] * (x0.shape[0] - 1))

    def learn(self, memory: Any, trial: Any) -> Any:
        e = known(trial.reached, trial.e)
        return Started(memory.u + self.gain * e[1:], memory.moved + 0.6 * e[0])


@declared
class Curved(Planned):
    """The step is no linear function of the error."""

    def learn(self, memory: Any, trial: Any) -> Any:
        e = known(trial.reached, trial.e)[1:]
        return Plan(memory.u + self.gain * ca.tanh(e))


class FeedsBack:
    """A part of laws that plan in a unit of their own: they also feed the error back within the trial."""

    force_unit: float

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        return memory_k.u * self.force_unit + 0.1 * (r - y), state
