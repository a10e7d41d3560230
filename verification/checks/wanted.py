"""The input that follows a reference's increments: computed, and shown to exist near what was computed.

Newton's method finds inputs sample after sample, in doubles. That an exact input lies near them is shown by
contraction: the map u -> u + l (wanted - gained(u)) shrinks the (weighted) largest distance of two inputs by
1 - l (b_low - r) for a small l > 0, as long as their trajectories stay in a tube in which the slopes have these bounds.
So where every gained increment misses the wanted one by at most q, an input that gains exactly what is wanted lies
within q/(b_low - r), if the trajectories of all inputs within that distance stay in the tube.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from verification.checks.delayed import delayed_graph, delayed_step
from verification.checks.slope import slope
from verification.enclosure.box import Box
from verification.enclosure.interval import evaluate
from verification.enclosure.rewriting import rewritten
from verification.enclosure.smoothness import continuous_on
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.study import Study
from workbench.graph import Graph, read

STEPS = 60  # of Newton's method, a sample
CLOSE = 1e-9  # of the wanted increment's size: what counts as found
TUBE = 1e-3  # of the box's widths: how far from the trajectory slopes are bounded
LEAST = 1e-200  # of a weight: norms that count an input less are not looked at
WEIGHTS = (1.0, 0.9999, 0.999, 0.99, 0.97, 0.9, 0.7, 0.5, 0.2, 0.05, 0.01)  # norms in which an input is looked for


@dataclasses.dataclass(frozen=True, kw_only=True)
class Wanted:
    """Inputs that follow a reference's increments, in doubles, from where trials begin."""

    study: Study
    u: Array
    """(N,), up to the sample at which none was found."""
    x: Array
    """Their trajectory, (nx, N + 1)."""
    w: Array
    """What disturbs the plant, (nw, N)."""
    missing: int | None
    """The sample at which no input was found, None where there is one for each."""

    @cached_property
    def defects(self) -> tuple[Array, Array]:
        """By how much the trajectory misses the plant's equations, (nx, N), and the wanted increments, (N,).

        Enclosed with outward rounding at every sample, so that the true misses are no larger.
        """
        plant, n = self.study.plant_that_runs, self.u.size
        graph = rewritten(read(delayed_step(plant, 1, increment=True)))
        if isinstance(graph, str):
            return np.full((self.x.shape[0], n), np.inf), np.full(n, np.inf)
        points = np.vstack([self.x[:, :n], self.u[None], self.w[:, :n], np.arange(n, dtype=float)[None]])
        entries = {name: {entry.row: entry.node for entry in rows} for name, rows in graph.outputs.items()}
        found = evaluate(graph, points, points, [node for rows in entries.values() for node in rows.values()])
        targets = {"x_next": self.x[:, 1 : n + 1], "y": np.diff(self.study.reference_samples)[:1, :n]}
        misses = {}
        for name, target in targets.items():
            rows = []
            for i, wanted in enumerate(target):
                span = found[entries[name][i]].span if i in entries[name] else None
                low, high = (np.broadcast_to(end, n) for end in (span or (np.zeros(n), np.zeros(n))))
                rows.append(np.nextafter(np.maximum(np.abs(high - wanted), np.abs(low - wanted)), np.inf))
            misses[name] = np.array(rows)
        return misses["x_next"], misses["y"][0]


def wanted_input(study: Study) -> Wanted:
    """Return the inputs that follow the reference's increments, for a plant of one channel and relative degree 1."""
    plant = study.plant_that_runs
    begun = study.inputs()[0]
    at = plant.symbols()
    x_next = plant.next_state(**at)
    gained = plant.measured(x_next)[0] - plant.measured(at["x"])[0]
    step = ca.Function("step", list(at.values()), [x_next, gained, ca.jacobian(gained, at["u"][0])])
    targets = np.diff(study.reference_samples[0])
    x = np.full((len(plant.states), targets.size + 1), np.nan)
    inputs: list[float] = []
    x[:, 0], u = begun.x0, 0.0
    for k, target in enumerate(targets):
        best, left = u, np.inf
        for _ in range(STEPS):
            _, got, slope = (value.full().ravel() for value in step(x[:, k], u, begun.w[:, k], k))
            miss = float(target - got[0])
            if not np.isfinite(miss) or abs(miss) >= left:
                break
            best, left = u, abs(miss)
            if miss == 0 or slope[0] == 0:
                break
            u += miss / float(slope[0])
        if not left <= CLOSE * max(1.0, abs(float(target))):
            return Wanted(study=study, u=np.array(inputs), x=x[:, : k + 1], w=begun.w, missing=k)
        u = best
        inputs.append(u)
        x[:, k + 1] = step(x[:, k], u, begun.w[:, k], k)[0].full().ravel()
    return Wanted(study=study, u=np.array(inputs), x=x, w=begun.w, missing=None)


class Near(NamedTuple):
    """Bounds of the slopes within a tube about the trajectory, sample by sample; magnitudes rounded up."""

    a: Array
    """|dx(k+1)/dx(k)|, (N, nx, nx)."""
    b: Array
    """|dx(k+1)/du(k)|, (N, nx)."""
    c: Array
    """|dz(k+1)/dx(k)| of the increment z, (N, nx)."""
    gain_low: Array
    """The least dz(k+1)/du(k), (N,)."""


def near(wanted: Wanted, room: tuple[Array, float]) -> Near | str:
    """Bound the slopes at the trajectory, give or take ``room`` in state (nx,) and input, or say why not."""
    plant, n = wanted.study.plant_that_runs, wanted.u.size
    graph = delayed_graph(plant, 1, increment=True)
    nx = len(plant.states)
    middle = np.vstack([wanted.x[:, :n], wanted.u[None], wanted.w[:, :n], np.arange(n, dtype=float)[None]])
    around = np.zeros_like(middle)
    around[:nx], around[nx] = room[0][:, None], room[1]
    low, high = np.nextafter(middle - around, -np.inf), np.nextafter(middle + around, np.inf)
    low[nx + 1 :], high[nx + 1 :] = middle[nx + 1 :], middle[nx + 1 :]
    if not _continuous(graph, low, high):
        return "the plant is not shown to be continuous about the trajectory that follows the reference"

    def ends(of: str, by: str, row: int, column: int) -> tuple[Array, Array]:
        found = rewritten(slope(graph, of, by, row, column))
        if isinstance(found, str):
            return np.full(n, -np.inf), np.full(n, np.inf)
        (entries,) = found.outputs.values()
        span, fault = evaluate(found, low, high, [entries[0].node])[entries[0].node]
        failed = np.zeros(n, dtype=bool) if fault is None else np.broadcast_to(fault >= 0, n)
        return np.where(failed, -np.inf, span.lo), np.where(failed, np.inf, span.hi)

    def size(of: str, by: str, row: int, column: int) -> Array:
        return np.maximum(*(np.abs(one) for one in ends(of, by, row, column)))

    a = np.array([[size("x_next", "x", i, j) for j in range(nx)] for i in range(nx)]).transpose(2, 0, 1)
    b = np.array([size("x_next", "u", i, 0) for i in range(nx)]).T
    c = np.array([size("y", "x", 0, j) for j in range(nx)]).T
    found = Near(a, b, c, ends("y", "u", 0, 0)[0])
    if not all(np.isfinite(one).all() for one in found):
        return "the slopes could not be bounded about the trajectory that follows the reference"
    return found


def _continuous(graph: Graph, low: Array, high: Array) -> bool:
    """Tell whether nothing jumps or ends in the hull of some boxes, one a sample."""
    at, ranges = 0, {}
    for name, (rows, columns) in ((one.name, one.shape) for one in graph.inputs):
        count = rows * columns
        ends = (low[at : at + count].min(axis=1, initial=np.inf), high[at : at + count].max(axis=1, initial=-np.inf))
        ranges[name] = tuple(end.reshape(rows, columns) for end in ends) if count else (np.zeros((rows, columns)),) * 2
        at += count
    return continuous_on(graph, Box(ranges, whole=("k",))).proved


def _up(value: Array) -> Array:
    return np.nextafter(value * (1 + 2.0**-48), np.inf)


def _reach(slopes: Near, moved: Array) -> Array:
    """Bound differences of the state, (nx, N + 1), where each step is moved besides by ``moved`` (nx, N)."""
    n, nx = slopes.b.shape
    rows = np.zeros((nx, n + 1))
    for k in range(n):
        rows[:, k + 1] = _up(slopes.a[k] @ rows[:, k] + moved[:, k])
    return rows


def _row_sums(slopes: Near, weight: float) -> Array:
    """Bound sum over j < k of |dz(k+1)/du(j)| weight^(k-j), (N,)."""
    n, nx = slopes.b.shape
    reach, rows = np.zeros(nx), np.zeros(n)
    for k in range(n):
        rows[k] = _up(slopes.c[k] @ reach)
        reach = _up(weight * (slopes.a[k] @ reach + slopes.b[k]))
    return rows


def follows(wanted: Wanted, box: Box) -> Finding:
    """Show that an input follows the reference's increments inside a box, with all inputs as near as it may lie.

    The slopes are bounded in a tube about the trajectory, and the inputs that may lie near stay in it. The margin is
    the least room to the box's walls, as a share of the box's width.
    """
    n = wanted.u.size
    if wanted.missing is not None:
        return undecided(
            f"no input was found that follows the reference at sample {wanted.missing}: ask for less, or give the "
            "input more room"
        )
    widths = {name: (box[name][1] - box[name][0]).ravel() for name in ("x", "u")}
    room = (TUBE * widths["x"], TUBE * float(widths["u"][0]))
    slopes = near(wanted, room)
    if isinstance(slopes, str):
        return undecided(slopes)
    by_state, by_signal = wanted.defects
    drift = _reach(slopes, by_state)
    miss = _up(by_signal + np.einsum("kj,jk->k", slopes.c, drift[:, :n]))
    best: tuple[float, Array, Array] | None = None
    for weight in WEIGHTS:
        kept = float((slopes.gain_low - _row_sums(slopes, weight)).min())
        scale = np.exp(np.arange(n) * np.log(weight))
        if not kept > 0 or scale[-1] < LEAST:
            continue
        by_input = np.asarray(float((miss * scale).max()) / kept * (1 + 1e-9) / scale, dtype=np.float64)
        moved = _reach(slopes, slopes.b.T * by_input) + drift
        share = float(np.maximum(by_input.max() / room[1], (moved / room[0][:, None]).max()))
        if best is None or share < best[0]:
            best = share, by_input, moved
    if best is None or not best[0] <= 1:
        return undecided(
            "what earlier inputs do at a sample outweighs what its own does too far, so no input was shown to follow"
        )
    return _inside(wanted, box, best[1], best[2])


def _inside(wanted: Wanted, box: Box, by_input: Array, moved: Array) -> Finding:
    """Tell how far the trajectory, give or take what is not exact, stays from the walls of a box."""
    plant = wanted.study.plant_that_runs
    worst, words = np.inf, ""
    place: dict[str, object] = {}
    for name, values, room, named in (
        ("x", wanted.x, moved, plant.states),
        ("u", wanted.u[None], by_input[None], plant.inputs[:1]),
    ):
        low, high = (end.reshape(-1, 1)[: len(named)] for end in box[name])
        share = np.minimum(values - room - low, high - values - room) / np.maximum(high - low, np.finfo(float).tiny)
        i, k = (int(one) for one in np.unravel_index(int(share.argmin()), share.shape))
        if share[i, k] < worst:
            worst = float(share[i, k])
            place = {"signal": named[i].name, "sample": k, "value": float(values[i, k]), "near": float(room[i, k])}
            words = (
                f"the trajectory that follows the reference leaves the box at sample {k}: {named[i].name} is "
                f"{values[i, k]:.4g}, give or take {room[i, k]:.2g}, and the box holds {low[i, 0]:.4g} to "
                f"{high[i, 0]:.4g}"
            )
    if worst < 0:
        return undecided(words)
    return Finding(
        grounds=Grounds.ENCLOSURE,
        margin=worst,
        weak=True,
        unit="share of the box",
        bound=float(by_input.max()),
        bound_unit=plant.inputs[0].unit,
        witness=place,
        method="inputs found by Newton's method, whose misses are enclosed at every sample; an exact one lies within "
        f"{float(by_input.max()):.3g} {plant.inputs[0].unit} of them, by contraction, and stays in the box with its "
        "trajectory; the margin is the least room to a wall",
    )
