"""What a trial is run with, and what it leaves."""

from __future__ import annotations

from typing import Any, NamedTuple


class TrialInput(NamedTuple):
    """What a trial is run with: its length, where it starts, plant disturbances and measurement noise."""

    length: int
    """The last sample that is reached."""
    x0: Any
    """Initial state, (nx,)."""
    w: Any
    """Disturbances, (nw, N)."""
    noise: Any
    """Added to the outputs that the law sees, (ny, N + 1)."""


class TrialRecord(NamedTuple):
    """What a trial left: true signals, missing samples are NaN."""

    u: Any
    """Input, (nu, N); the plan at every sample for a law that does not feed back."""
    x: Any
    """State, (nx, N + 1)."""
    y: Any
    """True output, (ny, N + 1)."""
    estimate: Any
    """PPD estimate, (1, N), or an empty array."""
    mse: float
    """Mean of e^2 over samples 1..length, summed over outputs."""
    applied: Any
    """The input that acted behind the plant's actuators, (nu, N), or an empty array for a plant without."""
    told: Any
    """What a law tells, one row a signal, (nt, N)."""
    memory: tuple[Any, ...] = ()
    """The memory that the trial was run with, where it was asked for; shapes as in ``start``."""
