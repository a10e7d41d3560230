"""What the laws of a shuttle share: errors, and the force without any learning or integral."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from models.expression import Expression, Number
from models.vehicle import Vehicle
from workbench.contracts.law import Task


class Errors(NamedTuple):
    """Position error, speed error and S = e_v + lam e_x, output minus reference as in the paper."""

    x: Expression
    v: Expression
    s: Expression


def errors(r: Expression, y: Expression, lam: Number) -> Errors:
    """Return the errors (8)-(10) of measured position and speed y against the reference r, row by row."""
    e_x, e_v = y[0, :] - r[0, :], y[1, :] - r[1, :]  # (8), (9)
    return Errors(e_x, e_v, e_v + lam * e_x)  # (10)


def base_force(
    model: Vehicle, e: Errors, acceleration: Expression, v: Expression, alpha: Number, lam: Number
) -> Expression:
    """Return M dv_d/dt + D(v) - M [(alpha + lam) e_v + alpha lam e_x] in N: feed-forward, compensation and PD."""
    feedback = (alpha + lam) * e.v + alpha * lam * e.x
    return model.mass * (acceleration - feedback) + model.resistance_at(v)  # (12) without the learned part


def overlong(late: int, task: Task) -> str | None:
    """Return the refusal of an assumed period that is wrong by a whole period or more, or None."""
    if abs(late) < task.samples:
        return None
    return f"late must be fewer samples than the {task.samples} of a period, got {late}"


def late_by(samples: int, before: Expression, now: Expression) -> Expression:
    """Return what the next period reads, (1, N), where the assumed period is ``samples`` samples too long.

    now and before are the rows of the last period and of the one before it. Where the assumed period is too short
    (samples below 0), the end of the period should read its own beginning; it reads that of the last period.
    """
    if samples == 0:
        return now
    if samples > 0:
        return ca.horzcat(before[:, -samples:], now[:, :-samples])
    return ca.horzcat(now[:, -samples:], now[:, :-samples])
