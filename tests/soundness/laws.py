"""The laws in plain NumPy, written anew from their papers, and the users' law u + l e that goes with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.quantity import declared, quantity
from workbench.contracts.law import AnyLaw, Law, LearningGain
from workbench.controllers.cfdl import CFDL
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.increment import Increment
from workbench.controllers.parts.rows import constant_row, known
from workbench.controllers.pd import PD

Array = NDArray[np.float64]
ESTIMATING = ("icfdl", "cfdl", "increment")


class Plan(NamedTuple):
    u: Any


@declared
class Simple(Law):
    """A user's law: u <- u + gain e(k+1), e the error of the output."""

    source: ClassVar[str] = "made for tests"
    learns_on: ClassVar[str] = "output"
    gain: float = quantity(default=0.5, unit="1", doc="learning gain", structural=True)
    first: float = quantity(default=0.0, unit="1", doc="first plan", structural=True)

    @property
    def learning_gain(self) -> LearningGain:
        return LearningGain(self.gain, self.gain)

    def start(self, task: Any) -> Any:
        return Plan(constant_row(self.first, task.samples))

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        return memory_k.u, state

    def learn(self, memory: Any, trial: Any) -> Any:
        return Plan(memory.u + self.gain * known(trial.reached, trial.e)[1:])


@declared
class SimpleIncrement(Simple):
    """The same on the increments of the error."""

    learns_on: ClassVar[str] = "increment"

    def learn(self, memory: Any, trial: Any) -> Any:
        gained = trial.e[1:] - trial.e[:-1]
        return Plan(memory.u + self.gain * known(trial.reached[1:], gained))


@dataclass(frozen=True, kw_only=True)
class Told:
    """A law's settings."""

    kind: str
    """icfdl, cfdl, increment, pd, simple or simple-increment."""
    first: float = 0.1
    rho: float = 0.5
    lam: float = 1.0
    mu: float = 1.0
    eta: float = 0.5
    eps: float = 1e-5
    phi0: float = 1.0
    gain: float = 0.5
    """Of pd (on e(k+1)) and of a user's law."""
    back: float = 0.0
    """Of pd, on e(k)."""

    @property
    def increment(self) -> bool:
        return self.kind in ("increment", "simple-increment")

    @property
    def estimates(self) -> bool:
        return self.kind in ESTIMATING

    def made(self) -> AnyLaw:
        """Return the workbench's law."""
        if self.estimates:
            kind = {"icfdl": ICFDL, "cfdl": CFDL, "increment": Increment}[self.kind]
            names = ("rho", "lam", "mu", "eta", "eps", "phi0")
            return kind(force_unit=1.0, initial_input=self.first, **{name: getattr(self, name) for name in names})
        if self.kind == "pd":
            return PD(kp=self.gain, kd=self.back, force_unit=1.0, initial_input=self.first)
        return (SimpleIncrement if self.increment else Simple)(gain=self.gain, first=self.first)

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the largest learning gain, whatever is estimated."""
        if not self.estimates:
            return self.gain, self.gain
        sign, size = np.sign(self.phi0), abs(self.phi0)
        least, most = (size / 3, 3 * size) if self.kind == "increment" else (min(self.eps, size), np.inf)
        at = [self.rho * p / (self.lam + p * p) if np.isfinite(p) else 0.0 for p in (least, most)]
        peak = self.rho / (2 * np.sqrt(self.lam)) if least**2 <= self.lam <= most**2 else max(at)
        return (min(at), peak) if sign > 0 else (-peak, -min(at))


class Memory(NamedTuple):
    """What a law carries from trial to trial; rows of N or N + 1 numbers."""

    u: Array
    phi: Array
    u_before: Array
    s_before: Array
    """The signal that is learned on, at 1..N."""
    reached_before: Array
    """Whether the trial before reached 1..N."""


def begun(law: Told, n: int) -> Memory:
    u = np.full(n, law.first)
    return Memory(u, np.full(n, law.phi0), u, np.zeros(n), np.zeros(n, dtype=bool))


def learned(law: Told, memory: Memory, seen: Array, r: Array, length: int) -> Memory:
    """Return the next trial's memory, from what was measured, (N + 1,), in a trial of a length."""
    n = memory.u.size
    reached = np.arange(1, n + 1) <= length
    signal, wanted = (np.diff(one) if law.increment else one[1:] for one in (seen, r))
    error = np.where(reached, wanted - signal, 0.0)
    if not law.estimates:
        held = np.where(np.arange(n) <= length, r[:-1] - seen[:-1], 0.0) if law.kind == "pd" else 0.0
        return memory._replace(u=memory.u + law.gain * error + law.back * held)
    du = memory.u - memory.u_before
    both = reached & memory.reached_before
    missed = np.where(both, signal - memory.s_before - memory.phi * du, 0.0)
    phi = memory.phi + law.eta * du / (law.mu + du**2) * missed
    keep = (np.abs(phi) > law.eps) & (np.abs(du) > law.eps) & (np.sign(phi) == np.sign(law.phi0))
    phi = np.where(keep, phi, law.phi0)
    if law.kind == "increment":
        low, high = sorted((law.phi0 / 3, 3 * law.phi0))
        phi = np.clip(phi, low, high)
    u = memory.u + law.rho * phi / (law.lam + phi**2) * error
    return Memory(u, phi, memory.u, signal, reached)


def gains(law: Told, memory: Memory) -> Array:
    """Return the learning gains that an estimate gives, (N,)."""
    if not law.estimates:
        return np.full(memory.u.size, law.gain)
    return law.rho * memory.phi / (law.lam + memory.phi**2)
