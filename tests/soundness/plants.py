"""Small plants in a chain of states, of which every slope is known in closed form.

x_i(k+1) = a_i x_i + c_i x_{i+1}, with what the state does besides (``drift``) in one row, and in row d - 1 what the
input does, gain(k) (1 + scale(x_0)) drive(u): so d is the relative degree. The output is x_0, and w disturbs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.plant import Plant, signals
from models.quantity import declared, quantity
from soundness.curves import Curve, Numbers, Symbols, linear, none

Array = NDArray[np.float64]
Ends = tuple[float, float]
LINE, NOTHING = linear(1.0), none()


@dataclass(frozen=True, kw_only=True)
class Relay:
    """A hidden state with hysteresis: 1 once the output was above ``high``, and -1 once it was below ``low``."""

    low: float
    high: float
    push: float
    """What the output does besides, times the hidden state."""


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A plant's equations."""

    a: Sequence[float]
    c: Sequence[float] = ()
    """(states - 1,)."""
    drive: Curve = LINE
    drift: Curve = NOTHING
    row: int = 0
    """Of the drift, which is of that row's own state."""
    scale: Curve | None = None
    """The gain is multiplied by 1 + scale(x_0)."""
    gain: float = 1.0
    swing: float = 0.0
    period: int = 0
    """The gain is gain (1 + swing sin(2 pi k/period))."""
    later: tuple[int, float] | None = None
    """From which sample on the gain is another."""
    degree: int = 1
    disturbed: bool = False
    changes: bool = False
    """Whether its gain is a quantity, which may change from trial to trial."""
    relay: Relay | None = None
    """Its hidden state is the last one."""
    ceiling: float = np.inf
    """The first state is kept between minus and plus that: it is what an integrator does that saturates."""

    @property
    def states(self) -> int:
        return len(self.a) + (self.relay is not None)

    def gain_at(self, m: Any, k: Any) -> Any:
        made = self.gain
        if self.period:
            made = made * (1 + self.swing * m.sin(2 * np.pi * k / self.period))
        if self.later is not None:
            made = m.choose(k >= self.later[0], self.later[1], made)
        return made

    def step(self, m: Any, x: Sequence[Any], u: Any, w: Any, k: Any, share: Any = 1.0) -> list[Any]:
        """Return the next state, in an arithmetic; ``share`` multiplies the gain."""
        rows = [self.a[i] * x[i] for i in range(len(self.a))]
        for i, c in enumerate(self.c):
            rows[i] = rows[i] + c * x[i + 1]
        rows[self.row] = rows[self.row] + self.drift.value(m, x[self.row])
        scale = 1.0 if self.scale is None else 1 + self.scale.value(m, x[0])
        rows[self.degree - 1] = rows[self.degree - 1] + share * self.gain_at(m, k) * scale * self.drive.value(m, u)
        if self.disturbed:
            rows[0] = rows[0] + w
        if self.relay is not None:
            hidden = m.choose(x[0] > self.relay.high, 1.0, m.choose(x[0] < self.relay.low, -1.0, x[-1]))
            rows = [rows[0] + self.relay.push * x[-1], *rows[1:], hidden]
        if np.isfinite(self.ceiling):
            rows[0] = m.fmin(m.fmax(rows[0], -self.ceiling), self.ceiling)
        return rows

    def slopes(self, x: Array, u: float, k: int) -> tuple[Array, Array]:
        """Return dx(k+1)/dx(k), (n, n), and dx(k+1)/du(k), (n,), at a point."""
        A = np.diag([*map(float, self.a), *([float(self._kept(x[0]))] if self.relay is not None else [])])
        for i, c in enumerate(self.c):
            A[i, i + 1] = c
        if self.relay is not None:
            A[0, -1] = self.relay.push
        A[self.row, self.row] += float(self.drift.slope(x[self.row]))
        B, gain = np.zeros(self.states), float(self.gain_at(Numbers, k))
        scale = 1.0
        if self.scale is not None:
            scale = 1 + float(self.scale.value(Numbers, x[0]))
            A[self.degree - 1, 0] += gain * float(self.scale.slope(x[0])) * float(self.drive.value(Numbers, u))
        B[self.degree - 1] = gain * scale * float(self.drive.slope(u))
        if np.isfinite(self.ceiling) and not abs(self.within(x, u, k)) < self.ceiling:
            A[0], B[0] = 0.0, 0.0
        return A, B

    def within(self, x: Array, u: float, k: int) -> float:
        """Return what the first state would be if nothing kept it, of a plant without disturbance."""
        return float(replace(self, ceiling=np.inf).step(Numbers, x, u, 0.0, k)[0])

    def _kept(self, output: float) -> bool:
        """Whether the hidden state stays as it is."""
        return self.relay is None or self.relay.low <= output <= self.relay.high

    def plant(self, name: str) -> Plant:
        """Return the plant as a user declares one."""
        chain = self

        def step(self: Any, x: Any, u: Any, w: Any, k: Any) -> Any:
            made = chain.step(Symbols, tuple(x), u.u, w.w if chain.disturbed else 0.0, k, self.b)
            return tuple(made)

        def output(self: Any, x: Any) -> Any:
            return (x.x0,)

        body = {
            "__annotations__": {"sampling_time": float, "b": float},
            "__doc__": "A small plant whose truth is known.",
            "source": "made for tests",
            "sampling_time": quantity(default=1.0, unit="s", doc="sampling time", above=0),
            "b": quantity(default=1.0, unit="1", doc="share of the gain", structural=not self.changes),
            "states": signals(**{f"x{i}": "1" for i in range(self.states)}),
            "inputs": signals(u="1"),
            "outputs": signals(x0="1"),
            "step": step,
            "output": output,
            **({"disturbances": signals(w="1")} if self.disturbed else {}),
        }
        return declared(type(name, (Plant,), body))()


@dataclass(frozen=True, kw_only=True)
class Region:
    """A box of states and inputs, and the samples in it: what is true of a plant there."""

    of: Chain
    x: Sequence[Ends]
    u: Ends
    k: tuple[int, int]

    @property
    def gains(self) -> list[float]:
        return [float(self.of.gain_at(Numbers, k)) for k in range(self.k[0], max(self.k[0], self.k[1]) + 1)]

    def _scale(self) -> Ends:
        if self.of.scale is None:
            return 1.0, 1.0
        low, high = self.x[0]
        at = [low, high, *(p for p in _flat(self.of.scale, low, high))]
        values = [1 + float(self.of.scale.value(Numbers, p)) for p in at]
        return min(values), max(values)

    @property
    def slope(self) -> Ends:
        """The least and the largest dy(k+d)/du(k)."""
        ahead = float(np.prod(self.of.c[: self.of.degree - 1]))
        ends = [ahead * g * s * e for g in self.gains for s in self._scale() for e in self.of.drive.slopes(*self.u)]
        low, high = self.free if np.isfinite(self.of.ceiling) else (0.0, 0.0)
        if low <= -self.of.ceiling or self.of.ceiling <= high:
            beyond = high <= -self.of.ceiling or self.of.ceiling <= low
            ends = [0.0] if beyond else [*ends, 0.0]
        return min(ends), max(ends)

    @property
    def free(self) -> Ends:
        """What the first state would be if nothing kept it: of a linear plant of relative degree 1."""
        of = self.of
        rows = [(of.a[0], self.x[0]), *((c, self.x[1]) for c in of.c[:1])]
        rows += [(g * float(of.drive.slope(0.0)), self.u) for g in self.gains[:1]]
        return sum(min(f * e for e in ends) for f, ends in rows), sum(max(f * e for e in ends) for f, ends in rows)

    @property
    def switches(self) -> bool:
        """Whether the output comes to where a hidden state turns."""
        return self.of.relay is not None and Curve.meets((self.of.relay.low, self.of.relay.high), *self.x[0])

    @property
    def unbroken(self) -> bool:
        """Whether the equations are continuous there, with slopes that have a bound."""
        of = self.of
        return (
            not self.switches
            and of.drive.unbroken(*self.u)
            and of.drift.unbroken(*self.x[of.row])
            and (of.scale is None or of.scale.unbroken(*self.x[0]))
        )

    @property
    def smooth_in_u(self) -> bool:
        """Whether the derivative by the input exists and is continuous there: states may jump besides."""
        scaled = self.of.scale is None or self.of.scale.unbroken(*self.x[0])
        return self.unbroken_in_u and scaled and not Curve.meets(self.of.drive.kinks, *self.u)

    @property
    def unbroken_in_u(self) -> bool:
        """Whether the equations are defined, and continuous in the input alone, with slopes by it that have a bound."""
        of = self.of
        low, high = self.x[of.row]
        valued = not Curve.meets(of.drift.poles, low, high) and low > of.drift.least
        scaled = of.scale is None or (not Curve.meets(of.scale.poles, *self.x[0]) and self.x[0][0] > of.scale.least)
        low, high = self.free if np.isfinite(of.ceiling) else (0.0, 0.0)
        kept = any(low <= end <= high for end in (-of.ceiling, of.ceiling))
        return of.drive.unbroken(*self.u) and valued and scaled and not kept

    def magnitudes(self) -> tuple[Array, Array]:
        """Return bounds of |dx(k+1)/dx(k)| and |dx(k+1)/du(k)| that are reached there, entry by entry."""
        of, n = self.of, self.of.states
        hidden = [] if of.relay is None else [1.0]
        A, B = np.abs(np.diag([*map(float, of.a), *hidden])), np.zeros(n)
        if of.relay is not None:
            A[0, -1] = abs(of.relay.push)
        for i, c in enumerate(of.c):
            A[i, i + 1] = abs(c)
        drift = of.drift.slopes(*self.x[of.row])
        A[of.row, of.row] = max(abs(of.a[of.row] + one) for one in drift)
        ahead = float(np.prod(of.c[: of.degree - 1]))
        B[of.degree - 1] = max(abs(one) for one in self.slope) / abs(ahead)
        return A, B


def _flat(curve: Curve, low: float, high: float) -> list[float]:
    """Return where a curve may be least or largest within a range, by a fine grid: it is only looked at roughly."""
    return list(np.linspace(low, high, 201)) + [
        p + s for p in (*curve.kinks, *curve.jumps) for s in (-1e-12, 1e-12) if low < p < high
    ]
