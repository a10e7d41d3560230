"""What a trial is run with, and what it leaves."""

from __future__ import annotations

from typing import NamedTuple

from models.array import Array


class TrialInput(NamedTuple):
    """What a trial is run with: its length, where it starts, disturbances, noise and the plant's true quantities."""

    length: int
    """The last sample that may be reached."""
    x0: Array
    """Initial state of the plant that runs, (nx,)."""
    w: Array
    """Disturbances, (nw, N)."""
    noise: Array
    """Added to the outputs that the law sees, (ny, N + 1)."""
    truth: Array | None = None
    """The plant's quantities in this trial, in the order of its parameters; None where they are the declared ones."""


class TrialRecord(NamedTuple):
    """What a trial left: true signals, missing samples are NaN."""

    u: Array
    """Input, (nu, N); the plan at every sample for a law that does not feed back."""
    x: Array
    """State, (nx, N + 1)."""
    y: Array
    """True output, (ny, N + 1)."""
    estimate: Array
    """PPD estimate, (ny nu, N), row by row, or an empty array."""
    mse: Array
    """Mean of e^2 over the samples reached but the first, by output, (ny,)."""
    applied: Array
    """The input that acted behind the plant's actuators, (nu, N), or an empty array for a plant without."""
    told: Array
    """What a law tells, one row a signal, (nt, N)."""
    length: int
    """The last sample that was reached."""
    note: str = ""
    """What the law had to say, e.g. why no plan could be made; empty where there is nothing."""
    memory: tuple[Array, ...] = ()
    """The memory that the trial was run with, where it was asked for; shapes as in ``start``."""
