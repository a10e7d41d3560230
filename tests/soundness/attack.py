"""Random campaigns in a plain loop that try to leave what was proved of every trial: bands, bounds, limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soundness.case import Case
from soundness.curves import Numbers
from soundness.laws import begun

Array = NDArray[np.float64]


class Reached:
    """What campaigns reached: the ends of states, (n, N + 1, 2), and inputs, (N, 2), and the worst error by trial."""

    def __init__(self, x: Array, u: Array, mse: Array) -> None:
        self.x, self.u, self.mse = x, u, mse


def campaigns(case: Case, *, count: int = 200, trials: int = 12, seed: int = 0, shortest: int = 1) -> Reached:
    """Run campaigns of the law's form: any gain between its ends, any length from the shortest on, all that may come.

    A third of the campaigns draw gains, lengths and starts from the ends alone.
    """
    rng, n, of = np.random.default_rng(seed), case.horizon, case.acting
    r = np.array(case.reference)
    low, high = case.law.ends
    x_low, x_high = np.full((of.states, n + 1), np.inf), np.full((of.states, n + 1), -np.inf)
    u_low, u_high, worst = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(trials)
    u = np.tile(begun(case.law, n).u, (count, 1))
    least = max(shortest, 1 if case.lengths.law == "fixed" else case.lengths.least(n))
    edge = np.arange(count) % 3 == 0
    start = np.array(case.start or (0.0,) * of.states)
    for i in range(trials):
        length = np.where(edge, rng.choice([least, n], count), rng.integers(least, n + 1, count))
        if case.lengths.law == "fixed":
            length = np.full(count, n)
        x = np.full((of.states, count, n + 1), np.nan)
        x[:, :, 0] = start[:, None] + case.spread * _between(rng, (of.states, count), edge[None, :])
        w = case.drawn * _between(rng, (count, n), edge[:, None])
        w = w + (0.0 if case.given is None else np.array(case.given)[None, :])
        share = (case.share[0] + case.share[1]) / 2 + (case.share[1] - case.share[0]) / 2 * _between(rng, count, edge)
        for k in range(n):
            on = k < length
            x[:, on, k + 1] = of.step(Numbers, x[:, on, k], u[on, k], w[on, k], k, share[on] if of.changes else 1.0)
            u_low[k], u_high[k] = (
                min(u_low[k], u[on, k].min(initial=np.inf)),
                max(u_high[k], u[on, k].max(initial=-np.inf)),
            )
        with np.errstate(all="ignore"):
            x_low = np.fmin(x_low, np.nanmin(x, axis=1, initial=np.inf))
            x_high = np.fmax(x_high, np.nanmax(x, axis=1, initial=-np.inf))
        worst[i] = np.nanmax(np.mean((r - x[0])[:, 1 : least + 1] ** 2, axis=1))
        seen = x[0] + case.noise * _between(rng, (count, n + 1), edge[:, None])
        missed = np.diff(r - seen, axis=1) if case.law.increment else (r - seen)[:, 1:]
        reached = np.arange(1, n + 1)[None, :] <= length[:, None]
        gain = low + (high - low) * (1 + _between(rng, (count, n), edge[:, None])) / 2
        u = u + np.where(reached, gain * np.nan_to_num(missed), 0.0)
    return Reached(np.stack([x_low, x_high], axis=-1), np.stack([u_low, u_high], axis=-1), worst)


def _between(rng: np.random.Generator, shape: int | tuple[int, ...], edge: NDArray[np.bool_]) -> Array:
    """Return numbers between -1 and 1, at the ends alone where ``edge``."""
    drawn = rng.uniform(-1, 1, shape)
    return np.where(edge, np.where(drawn < 0, -1.0, 1.0), drawn)
