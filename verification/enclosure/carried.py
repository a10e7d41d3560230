"""What is asked when sets are carried from sample to sample, and what comes back, whoever carries them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from models.array import Array
from models.quantity import InvalidValue

Ended = Literal["fine", "undefined", "unreached", "not rising", "gain", "unbounded"]
ENDS: tuple[Ended, ...] = ("fine", "undefined", "unreached", "not rising", "gain", "unbounded")
"""How a pass may end, in the order in which the C counts them."""


class Carried(NamedTuple):
    """Sets by sample; the last axis holds the lower and the upper end. Where a pass ended early, NaN from there on."""

    x: Array
    """States, (N + 1, states, 2)."""
    y: Array
    """Output, (N + 1, 2)."""
    u: Array
    """Inputs, (N, 2)."""
    target: Array
    """Inputs with which the learned signal gains what is wanted, from every state of the set, (N, 2)."""
    slope: Array
    """Slope of that gain by the input, (N, 2)."""
    after: Array
    """Where inputs that were given may be in the next trial, (N, 2)."""
    ended: Ended
    """``fine``, or why it ended."""
    sample: int
    """The sample at which it ended; -1 where it did not."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """What a pass is asked about; rows are samples, the last axis holds the lower and the upper end."""

    start: Array
    """States with which trials begin, (states, 2)."""
    disturbance: Array
    """(N, disturbances, 2)."""
    parameters: Array
    """(parameters, 2)."""
    wanted: Array
    """What the learned signal should gain at a sample, widened by noise, (N, 2)."""
    plan: Array
    """First plan, or the inputs that are given, (N, 2)."""
    most_gain: float
    """The largest learning gain."""
    moves: Array | None = None
    """Learning gains of a trial whose inputs are given, (N, 2); None: what every trial may meet is asked for."""
    settled: bool = False
    """Whether to ask where inputs end up when trials go on without end, in place of where they may ever be."""
    jolt: Array | None = None
    """What a sample may add to a state besides, (states,), such as rounding; ``wanted`` holds what a law sees of it."""

    def __post_init__(self) -> None:
        """Raise InvalidValue for a range that is empty or no number, and for gains that are none."""
        ranges = {
            "start": self.start, "disturbance": self.disturbance, "parameters": self.parameters,
            "wanted": self.wanted, "plan": self.plan,
        }  # fmt: skip
        if self.moves is not None:
            ranges["moves"] = self.moves
        for name, ends in ranges.items():
            low, high = ends[..., 0], ends[..., 1]
            for i in np.argwhere(~(low <= high))[:1]:
                raise InvalidValue(
                    f"{name} must hold ranges, the lower end first, got {ends[tuple(i)].tolist()} at {i.tolist()}"
                )
        for name, least in (
            ("most_gain", self.most_gain),
            ("moves", 0.0 if self.moves is None else self.moves.min(initial=0.0)),
        ):
            if not least >= 0:
                raise InvalidValue(f"{name} must be at least 0, got {least:g}")
        if self.jolt is not None and not np.all(self.jolt >= 0):
            raise InvalidValue(f"jolt must be at least 0, got {self.jolt.tolist()}")

    def fits(self, samples: int, states: int, disturbances: int, parameters: int) -> None:
        """Raise InvalidValue where an array has not the shape that so many samples and signals ask for."""
        shapes: list[tuple[str, Array | None, tuple[int, ...]]] = [
            ("start", self.start, (states, 2)),
            ("disturbance", self.disturbance, (samples, disturbances, 2)),
            ("parameters", self.parameters, (parameters, 2)),
            ("wanted", self.wanted, (samples, 2)),
            ("plan", self.plan, (samples, 2)),
            ("moves", self.moves, (samples, 2)),
            ("jolt", self.jolt, (states,)),
        ]
        for name, array, shape in shapes:
            if array is not None and array.shape != shape:
                raise InvalidValue(f"{name} must have shape {shape}, got {array.shape}")
