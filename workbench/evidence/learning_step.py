"""From the plan of one trial to that of the next, by differentiating the law's own ``learn`` and ``act``.

Let v be what the law learns (the fields of its memory that reach its inputs, and those that they are learned from),
and e the error of the trial that is run with v. Along one trial

    dv_next = M dv + Me de,     de = -G dv,     so    dv_next = (M - Me G) dv,

with G the trial's own map from v to the outputs (closed loop, where the law feeds back). M holds the error and lets
the plan, the inputs and the acting states follow v; Me holds v and lets everything follow the error.

What of the memory passes on without the trial (a sampling time, a count of trials) is no part of v. An estimate of a
pseudo partial derivative is a gain that adapts; while it is *held* the law is a linear one, with the gain of this
trial. For a law with M = I the error itself then goes as e_next = (I - G Me) e, whatever the estimate was.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import casadi as ca
import numpy as np
from scipy import sparse

from models.array import Array
from models.expression import as_expression
from models.plant import Plant
from models.quantity import nested, rebuilt, symbolised
from workbench.contracts.law import AnyLaw, Trial
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.evidence.closed_loop import LARGEST, ActingLaw, Learned, Linear, Loop, Matrix, images, product
from workbench.evidence.trajectory import trials_done
from workbench.fold.answers import estimated, learned, made_ready
from workbench.fold.named import as_matrix, expressions, like, names, shapes_of
from workbench.trials.campaign import Campaign

BANDED = 20  # entries a row, up to which a derivative is kept sparse
DIRECTIONS = 16  # directional derivatives that are computed at once


Rows: TypeAlias = tuple[Array, Array, Array, Array]
"""What ``learn`` is told of a trial: y, e, u and the acting states after each sample."""


class Ran(NamedTuple):
    """A trial of a campaign: its number from 1, the memory and the inputs that it was run with, what it left."""

    trial: int
    memory: tuple[Array, ...]
    given: TrialInput
    left: TrialRecord


def memories(campaign: Campaign, controller: str) -> Iterator[Ran]:
    """Run a controller's trials again; yield each with the memory that it was run with and where it began."""
    inputs = campaign.study.inputs()[: trials_done(campaign, controller)]
    end: Array | None = None
    lefts = campaign.runner(controller).trials(inputs, keep_memory=True)
    for i, (one, left) in enumerate(zip(inputs, lefts, strict=True), 1):
        begun = one._replace(x0=end) if campaign.study.continues and end is not None else one
        end = np.array(left.x[:, left.length])
        yield Ran(i, left.memory, begun, left)


class LearningStep(NamedTuple):
    """The derivative of what is learned next, along one trial run to the horizon."""

    ran: Ran
    loop: Loop
    learned: Learned
    linear: Linear
    """G, by its products."""
    keeps: Matrix
    """M, (p, p)."""
    by_error: Matrix
    """Me, (p, ny (N + 1)), the errors of all outputs sample by sample."""
    law: Learning

    @property
    def v(self) -> Array:
        """What the trial was run with, (p,)."""
        return self.learned.stacked(self.ran.memory)

    @property
    def error(self) -> Array:
        """The error that the law saw, (ny, N + 1)."""
        return np.asarray(self.loop.r - self.loop.seen)

    def again(self, ran: Ran) -> tuple[Array, Array]:
        """Return what another trial was run with, (p,), and the error that it leaves at the horizon, (ny, N + 1)."""
        loop = Loop(self.loop.plant, self.loop.law, ran.memory, self.loop.r, ran.given)
        return self.learned.stacked(ran.memory), np.asarray(loop.r - loop.seen)

    @property
    def unchanged(self) -> bool:
        """Whether M = I: without an error nothing is changed."""
        rest = abs(self.keeps - sparse.eye_array(self.learned.size, format="csr"))
        return bool(rest.nnz == 0 or rest.max() <= 1e-9)

    def next(self, error: Array | None = None) -> Array:
        """Return what is learned from the trial, (p,), or from another error (ny, N + 1), the estimate held."""
        loop, memory = self.loop, self.ran.memory
        if error is None:
            return self.law.value(memory, self.law.rows(loop.r, loop.seen, loop.rows.u, loop.rows.s))
        return self.following_held(memory, loop.r - error)

    def following_held(self, memory: tuple[Array, ...], seen: Array) -> Array:
        """Return what is learned from another trial, (p,), with its memory and outputs, the estimate held."""
        loop = self.loop
        u, s = loop.law.alone(memory, loop.r, seen)
        met = self.law.rows(loop.r, loop.seen, loop.rows.u, loop.rows.s)
        return self.law.value(memory, self.law.rows(loop.r, seen, u, s), met, self.ran.memory)

    def following(self) -> Linear | None:
        """Return the linearisation of the next trial, run like this one; None where it leaves the finite numbers."""
        loop, memory = self.loop, self.ran.memory
        met = self.law.rows(loop.r, loop.seen, loop.rows.u, loop.rows.s)
        after = Loop(loop.plant, loop.law, self.law.memory(memory, met), loop.r, loop.given)
        finite = all(np.isfinite(one).all() for one in after.rows)
        return after.linear(self.learned) if finite else None

    def apply(self, dv: Array) -> Array:
        """Return dv_next for dv, (p,)."""
        return np.asarray(product(self.keeps, dv) - product(self.by_error, self.linear.apply(dv)))

    def adjoint(self, dv: Array) -> Array:
        """Return the transposed map's value, (p,)."""
        return np.asarray(self.keeps.T @ dv - self.linear.adjoint(np.asarray(self.by_error.T @ dv)))

    def dense(self) -> Array:
        """Return M - Me G, (p, p)."""
        return images(self.apply, np.eye(self.learned.size))


class Learning:
    """A law's ``learn`` as a Function of what it learns and of the trial's rows."""

    def __init__(self, plant: Plant, law: AnyLaw, acting: ActingLaw, memory: tuple[object, ...], r: Array) -> None:
        n, self.reference = r.shape[1] - 1, r
        fields = [ca.MX.sym(f"memory{i}", *shape) for i, shape in enumerate(shapes_of(memory))]
        known = like(memory, fields)
        ny, nu, ns = r.shape[0], len(plant.inputs), sum(acting.heights)
        y, e, u, s = (ca.MX.sym(name, rows, columns) for name, rows, columns in
                      (("y", ny, n + 1), ("e", ny, n + 1), ("u", nu, n), ("s", ns, n)))  # fmt: skip
        parts = ca.vertsplit(s, [0, *np.cumsum(acting.heights).tolist()]) if ns else []
        state = like(made_ready(law, known), parts)
        reached = as_expression(ca.DM.ones(1, n + 1))
        rows = [as_expression(one) for one in (ca.DM(r), y, e, u)]
        after = learned(law, known, Trial(rows[0], rows[1], rows[2], rows[3], reached, state))
        following = [as_matrix(one) for one in expressions(after)]
        estimate = estimated(law, known, plant, n)
        kept = [] if estimate is None else [i for i, f in enumerate(fields) if _uses(as_matrix(estimate), [f])]
        self._estimate = ca.Function("estimate", [*fields, y, e, u, s], [following[i] for i in kept])
        self._held = [ca.MX.sym(f"held{i}", *fields[i].shape) for i in kept]
        cut = [i for i in range(len(kept)) if not following[kept[i]].is_constant()]
        plain = following
        if cut:
            plain = ca.graph_substitute(following, [following[kept[i]] for i in cut], [self._held[i] for i in cut])
        trial = [y, e, u, s]
        passed = set(range(len(fields)))
        while more := {
            i for i in passed if _uses(plain[i], [*trial, *(fields[j] for j in range(len(fields)) if j not in passed)])
        }:
            passed -= more
        used = (acting.acts_with | acting.begins_with) - passed - set(kept)
        while more := {j for j in range(len(fields)) if j not in used | passed | set(kept)
                       and any(_uses(plain[i], [fields[j]]) for i in used)}:  # fmt: skip
            used |= more
        at = tuple(sorted(used))
        called = names(memory)
        self.learned = Learned(tuple(called[i] for i in at), at, tuple(fields[i].shape for i in at))
        self._fields, self._trial = fields, trial
        self._following = following
        self._held_next = [plain[i] for i in at]
        self._free_next = [following[i] for i in at]
        self.estimates = bool(kept)

    def rows(self, r: Array, seen: Array, u: Array, s: Array) -> Rows:
        """Return what ``learn`` is told of a trial: y, e, u and the states after each sample."""
        return seen, r - seen, u, s[:, 1:]

    def value(
        self,
        memory: tuple[Array, ...],
        trial: Rows,
        held_at: Rows | None = None,
        held_with: tuple[Array, ...] = (),
    ) -> Array:
        """Return what is learned next, (p,), with the estimate of the trial ``held_at``, if any, and its memory."""
        if held_at is None:
            function = ca.Function("learn", [*self._fields, *self._trial], [_column(self._free_next)])
            return np.asarray(function(*memory, *trial).full().ravel())
        function = ca.Function("learn", [*self._fields, *self._held, *self._trial], [_column(self._held_next)])
        return np.asarray(function(*memory, *self._estimates(held_with, held_at), *trial).full().ravel())

    def memory(self, memory: tuple[Array, ...], trial: Rows) -> tuple[Array, ...]:
        """Return the whole memory of the next trial."""
        found = ca.Function("learn", [*self._fields, *self._trial], [_column(self._following)])(*memory, *trial)
        ends = np.cumsum([one.numel() for one in self._following])[:-1]
        parts = np.split(found.full().ravel(), ends)
        return tuple(part.reshape(one.shape, order="F") for part, one in zip(parts, self._following, strict=True))

    def _estimates(self, memory: tuple[Array, ...], trial: Rows) -> list[ca.DM]:
        """Return the estimate with which the next plan is computed, field by field."""
        if not self._held:
            return []
        found: ca.DM | tuple[ca.DM, ...] = self._estimate(*memory, *trial)
        return list(found) if isinstance(found, tuple) else [found]

    def slopes(self, memory: tuple[Array, ...], trial: Rows, *, held: bool) -> list[Matrix] | str:
        """Return the derivatives of what is learned next by v, y, e, u and s; or why they cannot be had."""
        nexts = _column(self._held_next if held else self._free_next)
        given = [*self._fields, *self._held, *self._trial]
        values = [*map(ca.DM, memory), *self._estimates(memory, trial), *map(ca.DM, trial)]
        own = [_slope(nexts, given, values, self._fields[i]) for i in self.learned.at]
        others = [_slope(nexts, given, values, one) for one in self._trial]
        if any(one is None for one in (*own, *others)):
            return (
                f"a change of the plan or the error at one sample changes the next plan at all of them, and a full "
                f"matrix of {nexts.shape[0]} numbers learned is too large (at most {LARGEST})"
            )
        by_v = sparse.csr_array(sparse.hstack([one for one in own if one is not None], format="csr"))
        found = [by_v, *(one for one in others if one is not None)]
        if not all(np.isfinite(one.data).all() for one in found):
            return "the derivative of what the law learns is not finite along the last trial"
        return found


def _column(values: list[ca.MX]) -> ca.MX:
    """Return values below each other, each column by column."""
    return ca.vertcat(*(ca.vec(one) for one in values))


def _uses(value: ca.MX, symbols: list[ca.MX]) -> bool:
    """Tell whether an expression contains one of some symbols."""
    mine = [one for one in symbols if one.numel()]
    return bool(value.numel() and mine and ca.depends_on(value, ca.vertcat(*(ca.vec(one) for one in mine))))


def _slope(value: ca.MX, given: list[ca.MX], at: list[ca.DM], by: ca.MX) -> Matrix | None:
    """Return the derivative of a column by a symbol, sparse where each row has few entries; None: too large."""
    rows, columns = value.shape[0], by.numel()
    if not columns or not _uses(value, [by]):
        return sparse.csr_array((rows, columns))
    if ca.jacobian_sparsity(value, by).nnz() <= BANDED * max(rows, columns):
        found = ca.Function("slope", given, [ca.jacobian(value, by)])(*at)
        pattern = found.sparsity()
        where = (np.array(pattern.row(), dtype=int), np.array(pattern.get_col(), dtype=int))
        matrix = sparse.csr_array((np.array(found.nonzeros()), where), shape=(rows, columns))
        matrix.eliminate_zeros()
        return matrix
    if rows > LARGEST or columns > 2 * LARGEST:
        return None
    whole = ca.Function("value", given, [value])
    along = whole.forward(DIRECTIONS)
    which = next(i for i, one in enumerate(given) if one.name() == by.name())
    result = whole(*at)
    full = np.empty((rows, columns))
    for first in range(0, columns, DIRECTIONS):
        width = min(DIRECTIONS, columns - first)
        seeds = [ca.DM(one.shape[0], one.shape[1] * DIRECTIONS) for one in given]
        flat = np.zeros((columns, DIRECTIONS))
        flat[first + np.arange(width), np.arange(width)] = 1
        height, length = by.shape
        seeds[which] = ca.DM(flat.T.reshape(DIRECTIONS * length, height).T)
        full[:, first : first + width] = along(*at, result, *seeds).full()[:, :width]
    return sparse.csr_array(full)


def learning_step(campaign: Campaign, controller: str, ran: Ran, *, held: bool = True) -> LearningStep | str:
    """Return a law's learning step along a trial run to the horizon, or in one sentence why there is none.

    ``held`` holds the law's estimate of a pseudo partial derivative. Disturbances, noise, initial state and the true
    plant are those of the trial. The law may feed back within the trial, keep states there and move its start.
    """
    study = campaign.study
    runner = campaign.runner(controller)
    law = runner.law
    if law.learns_on is None:
        return "the law does not learn between trials"
    if law.stepped:
        return "the law decides in numbers, sample by sample, so what it learns and does has no derivative"
    plant, r = runner.plant, np.array(study.reference_samples)
    if ran.given.truth is not None:
        values = dict(zip(symbolised(plant).names, map(float, ran.given.truth), strict=True))
        plant = rebuilt(plant, nested(values))
    start = law.start(runner.task)
    acting = ActingLaw(plant, law, start, len(plant.states))
    loop = Loop(plant, acting, ran.memory, r, ran.given)
    learning = Learning(plant, law, acting, start, r)
    if not learning.learned.at:
        return "nothing that the law learns reaches its inputs"
    trial = learning.rows(r, loop.seen, loop.rows.u, loop.rows.s)
    if not all(np.isfinite(one).all() for one in trial):
        return f"trial {ran.trial}, run to the horizon, leaves the finite numbers"
    slopes = learning.slopes(ran.memory, trial, held=held)
    if isinstance(slopes, str):
        return slopes
    linear = loop.linear(learning.learned)
    by_v, by_y, by_e, by_u, by_s = slopes
    keeps, by_error = by_v, by_e - by_y
    if by_u.nnz or by_s.nnz:
        follows = linear.of_law()
        if follows is None:
            return f"the law learns from what it keeps within the trial, over too many samples (at most {LARGEST})"
        keeps = keeps + by_u @ follows.u_by_v + by_s @ follows.s_by_v
        by_error = by_error - by_u @ follows.u_by_y - by_s @ follows.s_by_y
    return LearningStep(
        ran, loop, learning.learned, linear, sparse.csr_array(keeps), sparse.csr_array(by_error), learning
    )
