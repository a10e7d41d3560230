"""A plant under a law along one trial, linear: what a change of the memory does to inputs, outputs, acting states.

Per sample, with x the plant's state, s the law's acting state, m the memory's column and y the output that is seen,

    u = act_u(m, s, y),  s+ = act_s(m, s, y),  x+ = step(x, u),  y = output(x),

so differences obey one banded linear system over all samples, which is never inverted. A law that only plans is the
case without s and without y in act.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from models.array import Array
from models.expression import as_expression
from models.plant import Plant
from workbench.contracts.law import AnyLaw
from workbench.contracts.record import TrialInput
from workbench.fold.answers import acted, made_ready, placed
from workbench.fold.named import as_matrix, expressions, like, shapes_of

Matrix = sparse.csr_array[np.float64]
LARGEST = 4000  # rows of a matrix that is full
TOGETHER = 256  # columns to which a map is applied at once


def product(matrix: Matrix, v: Array) -> Array:
    """Return a sparse matrix times a vector, or times each column of a matrix."""
    return np.asarray(matrix @ v)


def images(apply: Callable[[Array], Array], columns: Array) -> Array:
    """Return what a linear map makes of columns, side by side: some at a time, for each alone costs as much as many."""
    together = range(0, columns.shape[1], TOGETHER)
    return np.hstack([apply(columns[:, first : first + TOGETHER]) for first in together])


class Rows(NamedTuple):
    """What a trial holds, one column a sample."""

    x: Array
    """(nx, N + 1)."""
    s: Array
    """The law's acting state before each sample, and after the last, (ns, N + 1)."""
    u: Array
    """(nu, N)."""
    y: Array
    """True outputs, (ny, N + 1)."""


class Learned(NamedTuple):
    """Which fields of the memory are learned, stacked one after the other, each column by column."""

    names: tuple[str, ...]
    at: tuple[int, ...]
    """Their places among all fields."""
    shapes: tuple[tuple[int, int], ...]

    @property
    def size(self) -> int:
        """How many numbers are learned."""
        return sum(rows * columns for rows, columns in self.shapes)

    def stacked(self, memory: tuple[Array, ...]) -> Array:
        """Return what is learned of a memory, (size,)."""
        return np.concatenate([np.asarray(memory[i], dtype=float).ravel(order="F") for i in self.at])

    def put(self, memory: tuple[Array, ...], v: Array) -> tuple[Array, ...]:
        """Return a memory with other values of what is learned."""
        ends = np.cumsum([rows * columns for rows, columns in self.shapes])[:-1]
        changed = [np.asarray(one, dtype=float) for one in memory]
        for i, part, shape in zip(self.at, np.split(v, ends), self.shapes, strict=True):
            changed[i] = part.reshape(shape, order="F")
        return tuple(changed)


class ActingLaw:
    """What a folded law does at every sample, as Functions of memory columns, acting state, references and output."""

    def __init__(self, plant: Plant, law: AnyLaw, memory: tuple[object, ...], x0: int) -> None:
        shapes = shapes_of(memory)
        fields = [ca.MX.sym(f"m{i}", *shape) for i, shape in enumerate(shapes)]
        known = like(memory, fields)
        start = as_expression(ca.MX.sym("x0", x0))
        begin, ready = as_matrix(placed(law, known, start)), made_ready(law, known)
        state = ca.vertcat(*(ca.vec(as_matrix(one)) for one in expressions(ready)))
        self.lines = [rows for rows, _ in shapes]
        self.heights = [rows * columns for rows, columns in shapes_of(ready)]
        whole = ca.vertcat(*(ca.vec(field) for field in fields)) if fields else ca.MX(0, 1)
        given: list[ca.MX] = [*fields, as_matrix(start)]
        self.begin = ca.Function("begin", given, [begin, state])
        self.begin_slopes = ca.Function(
            "begin_slopes",
            given,
            [ca.jacobian(one, field) for field in fields for one in (begin, state)],
        )
        self.begins_with = {
            i for i, f in enumerate(fields) if whole.numel() and ca.depends_on(ca.vertcat(begin, state), f)
        }
        m = [ca.SX.sym(f"m{i}", rows) for i, rows in enumerate(self.lines)]
        s = [ca.SX.sym(f"s{i}", *shape) for i, shape in enumerate(shapes_of(ready))]
        ny = len(plant.outputs)
        r, r_next, y = (ca.SX.sym(name, ny) for name in ("r", "r_next", "y"))
        u, after = acted(law, plant, like(memory, m), like(ready, s), *(as_expression(one) for one in (r, r_next, y)))
        column, acting = ca.vertcat(*m), ca.vertcat(*(ca.vec(one) for one in s))
        following = ca.vertcat(*(ca.vec(one) for one in expressions(after)))
        told = [column if m else ca.SX(0, 1), acting if s else ca.SX(0, 1), r, r_next, y]
        if not s:
            following = ca.SX(0, 1)
        self.act = ca.Function("act", told, [u, following])
        slopes = [ca.densify(ca.jacobian(of, by)) for of in (u, following) for by in (told[0], told[1], y)]
        self.slopes = ca.Function("act_slopes", told, slopes)
        together = ca.vertcat(u, following)
        self.acts_with = {i for i, one in enumerate(m) if ca.depends_on(together, one)}
        self.asks_reference = bool(ca.depends_on(together, ca.vertcat(r, r_next)))
        self.feeds_back = bool(s) or bool(ca.depends_on(together, y))

    def columns(self, memory: tuple[Array, ...], n: int) -> Array:
        """Return the memory's columns at samples 0..N-1, all fields below each other, (nm, N)."""
        fields = [np.asarray(one, dtype=float).reshape(rows, -1) for one, rows in zip(memory, self.lines, strict=True)]
        wide = [np.repeat(one, n, axis=1) if one.shape[1] == 1 else one[:, :n] for one in fields]
        return np.vstack(wide) if wide else np.zeros((0, n))

    def alone(self, memory: tuple[Array, ...], r: Array, seen: Array) -> tuple[Array, Array]:
        """Return inputs (nu, N) and acting states (ns, N + 1) on an output (ny, N + 1) that is given."""
        n = r.shape[1] - 1
        start = self.begin(*memory, np.zeros(self.begin.size_in(len(memory))))[1].full()
        m, s, u = self.columns(memory, n), [start.ravel()], []
        for k in range(n):
            now, after = self.act(m[:, k], s[k], r[:, k], r[:, k + 1], seen[:, k])
            u.append(now.full().ravel())
            s.append(after.full().ravel())
        return np.array(u).T, np.array(s).T


class Loop:
    """A plant under a law, run from a memory to the horizon, and linearised along that trial."""

    def __init__(self, plant: Plant, law: ActingLaw, memory: tuple[Array, ...], r: Array, one: TrialInput) -> None:
        self.plant, self.law, self.memory, self.r, self.given = plant, law, memory, r, one
        self.samples = r.shape[1] - 1
        at = plant.symbols()
        x_next, y = plant.next_state(**at), plant.measured(at["x"])
        slopes = [ca.jacobian(x_next, at["x"]), ca.jacobian(x_next, at["u"]), ca.jacobian(y, at["x"])]
        self._plant = ca.Function("plant", list(at.values()), [ca.densify(one) for one in slopes])
        self.rows = self._run(x_next, y, at)

    def _run(self, x_next: ca.SX, y: ca.SX, at: dict[str, ca.SX]) -> Rows:
        """Run to the horizon, whatever would end the trial before."""
        n, law = self.samples, self.law
        nm, ns = law.act.size1_in(0), law.act.size1_in(1)
        ny = len(self.plant.outputs)
        s, m = ca.SX.sym("s", ns), ca.SX.sym("m", nm)
        r, r_next, noise = (ca.SX.sym(name, ny) for name in ("r", "r_next", "noise"))
        u, after = law.act(m, s, r, r_next, y + noise)
        stepped = ca.Function("stepped", list(at.values()), [x_next])(at["x"], u, at["w"], at["k"])
        one = ca.Function("one", [ca.vertcat(at["x"], s), m, r, r_next, noise, at["w"], at["k"]],
                          [ca.vertcat(stepped, after), u])  # fmt: skip
        begin, ready = (value.full().ravel() for value in law.begin(*self.memory, self.given.x0))
        both, given = one.mapaccum("run", n)(
            np.concatenate([begin, ready]),
            law.columns(self.memory, n),
            self.r[:, :-1],
            self.r[:, 1:],
            self.given.noise[:, :-1],
            self.given.w,
            np.arange(n),
        )
        states = np.column_stack([np.concatenate([begin, ready]), both.full()])
        nx = begin.size
        x = states[:nx]
        output = ca.Function("output", [at["x"]], [y]).map(n + 1)(x).full()
        return Rows(x, states[nx:], given.full(), output)

    @property
    def seen(self) -> Array:
        """The outputs that the law sees, (ny, N + 1)."""
        return self.rows.y + self.given.noise

    def linear(self, learned: Learned) -> Linear:
        """Return the trial's linearisation by what is learned of the memory."""
        return Linear(self, learned)


class Follows(NamedTuple):
    """What a law does on an output that is held: inputs and acting states after each sample, by v and by the output."""

    u_by_v: Matrix
    u_by_y: Matrix
    s_by_v: Matrix
    s_by_y: Matrix


class Linear:
    """A trial's differences by those of what is learned, v: all stacked sample by sample."""

    def __init__(self, loop: Loop, learned: Learned) -> None:
        law, n, rows = loop.law, loop.samples, loop.rows
        nx, ns, nu = rows.x.shape[0], rows.s.shape[0], rows.u.shape[0]
        ny, nm = rows.y.shape[0], law.act.size1_in(0)
        self.samples, self.size, self.ny = n, learned.size, ny
        seen = loop.seen
        held = law.columns(loop.memory, n)
        parts = law.slopes.map(n)(held, rows.s[:, :n], loop.r[:, :-1], loop.r[:, 1:], seen[:, :n])
        shapes = [(height, width) for height in (nu, ns) for width in (nm, ns, ny)]
        um, us, uy, sm, ss, sy = (
            _by_sample(part.full(), n, *shape) for part, shape in zip(parts, shapes, strict=True)
        )  # each (N, rows, columns)
        padded = np.column_stack([rows.u, np.zeros(nu)])
        w = np.column_stack([loop.given.w, np.zeros(loop.given.w.shape[0])])
        slopes = loop._plant.map(n + 1)(rows.x, padded, w, np.arange(n + 1))
        a, b, c = (
            _by_sample(part.full(), n + 1, *shape)
            for part, shape in zip(slopes, [(nx, nx), (nx, nu), (ny, nx)], strict=True)
        )
        a, b, c_all, c = a[:n], b[:n], c, c[:n]
        k, both = np.arange(n), nx + ns
        X, S = both * k[:, None] + np.arange(nx), both * k[:, None] + nx + np.arange(ns)
        M, total = nm * k[:, None] + np.arange(nm), (n + 1) * both
        spread = _spread(law, learned, n)  # memory columns by v
        inward = np.concatenate([b @ um, sm], axis=1)
        inner = np.concatenate(
            [np.concatenate([a + b @ uy @ c, b @ us], axis=2), np.concatenate([sy @ c, ss], axis=2)], axis=1
        )
        self._blocks = (inner, inward, np.concatenate([c_all, np.zeros((n + 1, ny, ns))], axis=2))
        self._column = sum(law.lines[: learned.at[0]])
        begin = _begins(loop, learned)  # (nx, p) and (ns, p)
        Z = np.concatenate([X, S], axis=1)
        dynamics = sparse.eye_array(total, format="csr") - _put(inner, Z + both, Z, (total, total))
        driven = _put(inward, Z + both, M, (total, n * nm))
        first = sparse.vstack([*begin, sparse.csr_array((total - both, self.size))], format="csr")
        self.driven: Matrix = sparse.csr_array(driven @ spread + first)
        # its stub knows no transposed solution
        self._solver: Any = linalg.splu(
            sparse.csc_matrix(dynamics), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": False}
        )
        ends = both * np.arange(n + 1)[:, None] + np.arange(nx)
        outputs = ny * np.arange(n + 1)[:, None] + np.arange(ny)
        self.measured: Matrix = _put(c_all, outputs, ends, ((n + 1) * ny, total))
        self._law = (um, us, uy, sm, ss, sy, spread, begin[1])

    def apply(self, dv: Array) -> Array:
        """Return the outputs' differences, (ny (N + 1),), sample by sample, by those of what is learned, (p,).

        Columns side by side, (p, q), are answered side by side.
        """
        return np.asarray(self.measured @ self._solver.solve(self.driven @ dv))

    @property
    def moves_start(self) -> bool:
        """Whether what is learned moves the output with which the trial begins."""
        return bool((self.measured[: self.ny] @ self.driven).nnz)

    def of_law(self) -> Follows | None:
        """Return what the law alone does on an output that is held; None where that is a matrix too large to fill."""
        um, us, uy, sm, ss, sy, spread, first = self._law
        n, p, k = self.samples, self.size, np.arange(self.samples)[:, None]
        nu, ns, nm, ny = um.shape[1], sm.shape[1], um.shape[2], uy.shape[2]
        total, coupled = (n + 1) * ns, bool(ss.any())
        M, U, Y = nm * k + np.arange(nm), nu * k + np.arange(nu), ny * k + np.arange(ny)
        S = ns * k + np.arange(ns)
        chain = sparse.eye_array(total, format="csr") - _put(ss, S + ns, S, (total, total))
        below = sparse.vstack([first, sparse.csr_array((n * ns, p))], format="csr")
        by_v = sparse.csr_array(_put(sm, S + ns, M, (total, n * nm)) @ spread + below)
        by_y = _put(sy, S + ns, Y, (total, (n + 1) * ny))
        if coupled and n > LARGEST and by_v.nnz + by_y.nnz:
            return None
        s_v, s_y = (_solved(chain, one, coupled) for one in (by_v, by_y))
        mix = _put(us, U, S, (n * nu, total))
        return Follows(
            sparse.csr_array(_put(um, U, M, (n * nu, n * nm)) @ spread + mix @ s_v),
            sparse.csr_array(_put(uy, U, Y, (n * nu, (n + 1) * ny)) + mix @ s_y),
            sparse.csr_array(s_v[ns:]),
            sparse.csr_array(s_y[ns:]),
        )

    def diagonal(self, degree: int) -> Array:
        """Return dy(k + degree)/dv(k), (N - degree + 1,), of the first output, where v is one row."""
        inner, inward, outward = self._blocks
        last = self.samples - degree + 1
        row = outward[degree:, 0]
        for step in range(degree - 1, 0, -1):
            row = np.einsum("ki,kij->kj", row, inner[step : step + last])
        return np.asarray(np.einsum("ki,ki->k", row, inward[:last, :, self._column]))

    def adjoint(self, dy: Array) -> Array:
        """Return the transposed map's value, (p,), for (ny (N + 1),)."""
        return np.asarray(self.driven.T @ self._solver.solve(self.measured.T @ dy, trans="T"))


def _solved(chain: Matrix, by: Matrix, coupled: bool) -> Matrix:
    """Return the acting states that a right side brings about; without memory in them they are that side itself."""
    if not coupled or by.nnz == 0:
        return by
    return sparse.csr_array(linalg.splu(sparse.csc_matrix(chain)).solve(by.toarray()))


def _by_sample(flat: Array, samples: int, rows: int, columns: int) -> Array:
    """Return matrices by sample, (samples, rows, columns), from those that a mapped Function leaves side by side."""
    return flat.reshape(rows, samples, columns).transpose(1, 0, 2)


def _put(blocks: Array, rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> Matrix:
    """Return a sparse matrix of blocks (n, p, q) at rows (n, p) and columns (n, q)."""
    full = np.broadcast_to(rows[:, :, None], blocks.shape).ravel()
    across = np.broadcast_to(columns[:, None, :], blocks.shape).ravel()
    values = blocks.ravel()
    some = values != 0
    return sparse.csr_array((values[some], (full[some], across[some])), shape=shape)


def _spread(law: ActingLaw, learned: Learned, n: int) -> Matrix:
    """Return the memory's columns, sample by sample, by what is learned, (N nm, p): zeros and ones."""
    nm, k = sum(law.lines), np.arange(n)
    tops = np.concatenate([[0], np.cumsum(law.lines)])
    rows, columns, before = [], [], 0
    for i, (height, width) in zip(learned.at, learned.shapes, strict=True):
        for j in range(height):
            rows.append(nm * k + tops[i] + j)
            columns.append(before + j + (height * k if width > 1 else 0 * k))
        before += height * width
    where = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array((np.ones(where[0].size), where), shape=(n * nm, learned.size))


def _begins(loop: Loop, learned: Learned) -> tuple[Matrix, Matrix]:
    """Return the derivatives of the first state and of the first acting state by what is learned."""
    slopes = loop.law.begin_slopes(*loop.memory, loop.given.x0)
    found = []
    for which in (0, 1):
        parts = [sparse.csr_array(ca.DM(slopes[2 * i + which]).full()) for i in learned.at]
        found.append(sparse.csr_array(sparse.hstack(parts, format="csr")))
    return found[0], found[1]
