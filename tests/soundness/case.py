"""A plant, a law and what a campaign meets, with their plain run in NumPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.actuator import Actuator
from models.array import Array as Given
from models.plant import Plant, signals
from models.quantity import declared, quantity, symbolised
from soundness.curves import Numbers, cut
from soundness.laws import Memory, Told, begun, learned
from soundness.plants import Chain
from workbench.contracts.scenario import (
    AtRest,
    Between,
    Disturbance,
    From,
    NormalDisturbance,
    NormalNoise,
    Undisturbed,
    UniformNoise,
)
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength
from workbench.contracts.verifying import Verification

Array = NDArray[np.float64]


@declared
class Bounded(Disturbance):
    """One disturbance, uniform between two ends, drawn anew for every trial."""

    largest: float = quantity(default=0.1, unit="1", doc="largest magnitude", least=0)

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Given:
        return rng.uniform(-self.largest, self.largest, (1, samples))

    @property
    def repeats(self) -> bool:
        return self.largest == 0

    def bound(self, plant: Plant) -> Given:
        return np.array([[-self.largest, self.largest]])


FIXED = TrialLength(law="fixed")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A campaign whose truth is known."""

    family: str
    chain: Chain
    law: Told
    reference: tuple[float, ...]
    trials: int = 6
    lengths: TrialLength = FIXED
    start: tuple[float, ...] | None = None
    """None: at rest."""
    spread: float = 0.0
    noise: float = 0.0
    unbounded: bool = False
    """Whether what is random is normal, else uniform."""
    given: tuple[float, ...] | None = None
    """A disturbance that is the same in every trial."""
    drawn: float = 0.0
    """The size of one that is drawn anew."""
    share: tuple[float, float] = (1.0, 1.0)
    """Ends of what the gain is multiplied by from trial to trial."""
    clipped: tuple[float, float] | None = None
    """Ends of the actuator."""
    limits: Mapping[str, tuple[float | None, float | None]] | None = None
    channels: int = 1
    seed: int = 0

    @cached_property
    def study(self) -> Study:
        plant: Any = self.chain.plant(f"Small{self.seed}") if self.channels == 1 else _two(self.seed)
        start = self.start or (0.0,) * self.chain.states
        disturbance: Any = Undisturbed()
        if self.given is not None:
            disturbance = [self.given]
        elif self.drawn:
            disturbance = NormalDisturbance(sigmas=(self.drawn,)) if self.unbounded else Bounded(largest=self.drawn)
        noise = NormalNoise(sigma=self.noise) if self.unbounded else UniformNoise(largest=self.noise)
        reference = np.array(self.reference)
        return Study(
            plant=plant,
            reference=reference if self.channels == 1 else np.stack([reference] * 2),
            controllers={self.law.kind: self.law.made()},
            trials=self.trials,
            trial_length=self.lengths,
            initial=AtRest()
            if not any(start) and not self.spread
            else From(state=start, spread=(self.spread,) * len(start)),
            noise=noise,
            disturbance=disturbance,
            truth={"b": Between(low=self.share[0], high=self.share[1])} if self.chain.changes else {},
            actuator=Actuator() if self.clipped is None else Actuator(lower=self.clipped[0], upper=self.clipped[1]),
            verify=Verification(limits=self.limits or {}),
            seed=self.seed,
        )

    @property
    def horizon(self) -> int:
        return len(self.reference) - 1

    @cached_property
    def acting(self) -> Chain:
        """The plant with what its actuator does."""
        if self.clipped is None:
            return self.chain
        return replace(self.chain, drive=cut(self.chain.drive, *self.clipped))

    @cached_property
    def run(self) -> Run:
        return plain_run(self)


@dataclass(frozen=True, kw_only=True)
class Run:
    """What a plain loop over trials and samples leaves; rows by trial, up to where the law fell."""

    x: Sequence[Array]
    """(n, N + 1), NaN after the trial's end."""
    u: Sequence[Array]
    seen: Sequence[Array]
    memory: Sequence[Memory]
    """What each trial was run with, and the next would be."""
    w: Sequence[Array]
    lengths: Sequence[int]
    mse: Sequence[float]
    fell: bool


def trial(case: Case, u: Array, x0: Array, w: Array, length: int, share: float) -> Array:
    """Return the states of one trial, (n, N + 1), NaN after its end."""
    x = np.full((case.acting.states, case.horizon + 1), np.nan)
    x[:, 0] = x0
    with np.errstate(all="ignore"):
        for k in range(length):
            x[:, k + 1] = case.acting.step(Numbers, x[:, k], u[k], w[k], k, share)
    return x


def plain_run(case: Case) -> Run:
    study, r, n = case.study, np.array(case.reference), case.horizon
    memory = begun(case.law, n)
    names = symbolised(study.plant).names
    x, u, seen, kept, w, lengths, mse, fell = [], [], [], [memory], [], [], [], False
    for one in study.inputs():
        drawn = one.w[0] if case.chain.disturbed else np.zeros(n)
        share = 1.0 if one.truth is None else float(one.truth[names.index("b")])
        states = trial(case, memory.u, one.x0, drawn, one.length, share)
        error = (r - states[0])[1 : one.length + 1]
        with np.errstate(all="ignore"):
            mean = float(np.mean(error**2))
        if not np.isfinite(states[:, : one.length + 1]).all() or not np.sqrt(mean) <= 1000 * np.abs(r).max():
            fell = True
            break
        x.append(states)
        u.append(memory.u)
        seen.append(states[0] + one.noise[0])
        w.append(drawn)
        lengths.append(one.length)
        mse.append(mean)
        with np.errstate(all="ignore"):
            memory = learned(case.law, memory, np.nan_to_num(seen[-1]), r, one.length)
        kept.append(memory)
    return Run(x=x, u=u, seen=seen, memory=kept, w=w, lengths=lengths, mse=mse, fell=fell)


def _two(seed: int) -> Plant:
    """A plant of two inputs and two outputs."""

    def step(self: Any, x: Any, u: Any, w: Any, k: Any) -> Any:
        return 0.5 * x.x0 + u.u0, 0.4 * x.x1 + 0.1 * x.x0 + u.u1

    def output(self: Any, x: Any) -> Any:
        return x.x0, x.x1

    body = {
        "__annotations__": {"sampling_time": float},
        "__doc__": "Two channels.",
        "source": "made for tests",
        "sampling_time": quantity(default=1.0, unit="s", doc="sampling time", above=0),
        "states": signals(x0="1", x1="1"),
        "inputs": signals(u0="1", u1="1"),
        "outputs": signals(x0="1", x1="1"),
        "step": step,
        "output": output,
    }
    return declared(type(f"Two{seed}", (Plant,), body))()
