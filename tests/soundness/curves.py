"""Functions of one number of which everything is known: value, slope, where it bends, jumps or ends.

Each is written once, for the arithmetic that it is given: CasADi's symbols for the plant, NumPy's numbers for truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

NEAR = 1e-9
"""How far from a kink, to either side, its slopes are looked at."""


class Numbers:
    """The operations of curves in NumPy."""

    sin, fabs, sqrt, log, tanh = np.sin, np.abs, np.sqrt, np.log, np.tanh
    fmax, fmin = np.fmax, np.fmin

    @staticmethod
    def choose(condition: Any, met: Any, other: Any) -> Any:
        return np.where(condition, met, other)

    @staticmethod
    def table(grid: Sequence[float], values: Sequence[float], v: Any) -> Any:
        """Return what lies on the lines through the values, which go on beyond the ends."""
        at = np.clip(np.searchsorted(grid, v, side="right") - 1, 0, len(grid) - 2)
        grid_, values_ = np.asarray(grid), np.asarray(values)
        return values_[at] + (v - grid_[at]) * (values_[at + 1] - values_[at]) / (grid_[at + 1] - grid_[at])


class Symbols:
    """The same in CasADi."""

    sin, fabs, sqrt, log, tanh = ca.sin, ca.fabs, ca.sqrt, ca.log, ca.tanh
    fmax, fmin = ca.fmax, ca.fmin
    choose = staticmethod(ca.if_else)

    @staticmethod
    def table(grid: Sequence[float], values: Sequence[float], v: Any) -> Any:
        return ca.pw_lin(v, ca.DM(list(grid)), ca.DM(list(values)))


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A function of one number."""

    value: Callable[[Any, Any], Any]
    """Of an arithmetic and an argument."""
    slope: Callable[[Any], Any]
    """Its derivative, in NumPy, away from breaks."""
    turns: Callable[[float, float], Sequence[float]] = lambda low, high: ()
    """Where the slope is least or largest within a range, besides ends and breaks."""
    kinks: Sequence[float] = ()
    """Where the slope jumps."""
    jumps: Sequence[float] = ()
    misses: Sequence[float] = ()
    """Where pieces that are meant to meet miss each other by what a number was rounded: by exact rules, a jump."""
    steep: Sequence[float] = ()
    """Where it is continuous with a slope that has no bound."""
    poles: Sequence[float] = ()
    least: float = -np.inf
    """There is no value below."""
    guards: bool = False

    def slopes(self, low: float, high: float) -> tuple[float, float]:
        """Return the least and the largest slope on a range, both sides of what breaks in it looked at."""
        inside = [p for p in (*self.kinks, *self.jumps) if low <= p <= high]
        at = [low, high, *(p for p in self.turns(low, high) if low <= p <= high)]
        at += [p + side for p in inside for side in (-NEAR, NEAR) if low <= p + side <= high]
        at = [p for p in at if all(abs(p - q) > NEAR / 2 for q in inside)] or at
        with np.errstate(all="ignore"):
            values = [float(self.slope(p)) for p in at]
        if not np.isfinite(values).all() or self.meets(self.steep + tuple(self.poles), low, high) or low < self.least:
            return -np.inf, np.inf
        return min(values), max(values)

    @staticmethod
    def meets(places: Sequence[float], low: float, high: float) -> bool:
        return any(low <= p <= high for p in places)

    def unbroken(self, low: float, high: float) -> bool:
        """Whether it is defined and continuous, with slopes that have a bound, on a range."""
        broken = (*self.jumps, *self.misses, *self.steep, *self.poles)
        return not self.meets(broken, low, high) and low > self.least


def none() -> Curve:
    return Curve(value=lambda m, v: 0 * v, slope=lambda v: 0.0 * v)


def linear(b: float) -> Curve:
    return Curve(value=lambda m, v: b * v, slope=lambda v: b + 0.0 * v)


def cubic(b: float, c: float) -> Curve:
    return Curve(
        value=lambda m, v: b * v + c * v * v * v, slope=lambda v: b + 3 * c * v**2, turns=lambda low, high: (0.0,)
    )


def wavy(b: float, c: float, w: float, p: float = 0.0) -> Curve:
    """b v + c sin(w v + p)."""

    def turns(low: float, high: float) -> Sequence[float]:
        first, last = np.floor((w * low + p) / np.pi), np.ceil((w * high + p) / np.pi)
        return [float((n * np.pi - p) / w) for n in np.arange(first, last + 1)] if last - first < 1e6 else ()

    return Curve(
        value=lambda m, v: b * v + c * m.sin(w * v + p), slope=lambda v: b + c * w * np.cos(w * v + p), turns=turns
    )


def bent(b: float, c: float, p: float, by: str = "fabs") -> Curve:
    """b v + c |v - p|, or c max(v, p)."""
    if by == "fabs":
        return Curve(value=lambda m, v: b * v + c * m.fabs(v - p), slope=lambda v: b + c * np.sign(v - p), kinks=(p,))
    return Curve(value=lambda m, v: b * v + c * m.fmax(v, p), slope=lambda v: b + c * (v > p), kinks=(p,))


def stepped(b: float, c: float, p: float) -> Curve:
    """b v, and c more above p."""
    return Curve(value=lambda m, v: b * v + m.choose(v > p, c, 0.0), slope=lambda v: b + 0.0 * v, jumps=(p,))


def gated(b: float, c: float, p: float) -> Curve:
    """b v + c sqrt(v - p) where v is above p: the condition guards the root."""

    def slope(v: Any) -> Any:
        return b + np.where(v > p, c / (2 * np.sqrt(np.where(v > p, v - p, 1.0))), 0.0)

    return Curve(
        value=lambda m, v: b * v + c * m.choose(v > p, m.sqrt(m.fmax(v - p, 0.0) if m is Numbers else v - p), 0.0),
        slope=slope,
        steep=(p,),
        guards=True,
    )


def shared(b: float, c: float, p: float, reach: float) -> Curve:
    """b v + c/(v - p) where v is away from p by more than a reach, and a line there that fits on both sides.

    It fits exactly where the square of the reach is a double; else the two miss each other by a rounding.
    """
    fits = Fraction(reach) ** 2 == Fraction(reach**2)

    def value(m: Any, v: Any) -> Any:
        off = v - p
        far = m.fabs(off) > reach
        safe = np.where(far, off, 1.0) if m is Numbers else off
        return b * v + c * m.choose(far, 1 / safe, off / reach**2)

    return Curve(
        value=value,
        slope=lambda v: b + c * np.where(np.abs(v - p) > reach, -1 / np.maximum(np.abs(v - p), reach) ** 2, reach**-2),
        kinks=(p - reach, p + reach),
        misses=() if fits else (p - reach, p + reach),
        guards=True,
    )


def tabled(b: float, grid: Sequence[float], values: Sequence[float]) -> Curve:
    grid, rises = tuple(grid), np.diff(values) / np.diff(grid)
    return Curve(
        value=lambda m, v: b * v + m.table(grid, values, v),
        slope=lambda v: b + rises[np.clip(np.searchsorted(grid, v, side="right") - 1, 0, len(grid) - 2)],
        kinks=grid[1:-1],
    )


def pole(b: float, c: float, p: float) -> Curve:
    return Curve(value=lambda m, v: b * v + c / (v - p), slope=lambda v: b - c / (v - p) ** 2, poles=(p,))


def rooted(b: float, c: float, p: float) -> Curve:
    """b v + c sqrt(v - p), which has no value below p."""
    return Curve(
        value=lambda m, v: b * v + c * m.sqrt(v - p), slope=lambda v: b + c / (2 * np.sqrt(v - p)), steep=(p,), least=p
    )


def cut(inner: Curve, low: float, high: float) -> Curve:
    """A curve of an argument that is kept between two ends."""
    return Curve(
        value=lambda m, v: inner.value(m, m.fmin(m.fmax(v, low), high)),
        slope=lambda v: np.where((v > low) & (v < high), inner.slope(np.clip(v, low, high)), 0.0),
        turns=inner.turns,
        kinks=(*inner.kinks, low, high),
        jumps=inner.jumps,
        misses=inner.misses,
    )


def clutch(b: float, bite: float, full: float, slip: float) -> Curve:
    """A clutch's torque: nothing within a dead zone, a soft bite, then b v, and a part ``slip`` that always drags.

    b (v - v kept in [-bite, bite]) tanh(|v|/full) + slip v: kinks where it bites, smooth elsewhere.
    """

    def value(m: Any, v: Any) -> Any:
        beyond = v - m.fmin(m.fmax(v, -bite), bite)
        return b * beyond * m.tanh(m.fabs(v) / full) + slip * v

    def slope(v: Any) -> Any:
        beyond, outside = v - np.clip(v, -bite, bite), np.abs(v) > bite
        soft = np.tanh(np.abs(v) / full)
        return b * (outside * soft + beyond * np.sign(v) * (1 - soft**2) / full) + slip + 0.0 * v

    def turns(low: float, high: float) -> Sequence[float]:
        return [float(one) for one in np.linspace(low, high, 201)] if high > low else ()

    return Curve(value=value, slope=slope, turns=turns, kinks=(-bite, bite))
