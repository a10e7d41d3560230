"""A plant's set of states carried from sample to sample, rigorous and in machine code.

The C beside this module evaluates a graph in outward-rounded intervals with slopes, and carries boxes of states through
the samples of a trial while a law learns; :mod:`verification.checks.funnel` says what that proves. Operations that are
no arithmetic (sine, exponential) are asked of the balls of :mod:`verification.enclosure.outward`, one by one, unless
they depend on the sample alone: those are tabulated once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from verification.enclosure import outward
from verification.enclosure.carried import ENDS
from verification.enclosure.carried import Carried as Carried
from verification.enclosure.carried import Question as Question
from verification.enclosure.interval import PARTIAL, TOTAL, reason
from verification.enclosure.outward import Span
from verification.enclosure.rewriting import COVER, MEET, SELECT, Rewritten, rewritten
from verification.enclosure.slopes import partials
from verification.enclosure.whole import Read, readings_at
from workbench.fold.machine_code import library
from workbench.graph.operations import CONSTANT, INPUT

_NATIVE = (
    INPUT, CONSTANT, "add", "sub", "mul", "div", "neg", "inv", "twice", "sq", "sqrt", "fabs", "fmin", "fmax", "sign",
    "floor", "ceil", "lt", "le", "eq", "ne", "not", "and", "or", "if_else_zero", SELECT, COVER, MEET, "whole_power",
    "copysign", "asked",
)  # fmt: skip
"""Operations in the order in which the C counts them."""
_CODE = {name: code for code, name in enumerate(_NATIVE)}
MOST = 64
"""Coordinates that the C has room for."""
HIGHEST = 64  # powers up to this are made of products
PARTS = 24
"""Most parts that a box is split into where a bound of it is not exact."""

_Asking = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double))
_ints, _spans = ctypes.POINTER(ctypes.c_int), ctypes.c_void_p


class _Program(ctypes.Structure):
    _fields_ = (
        ("nodes", ctypes.c_int), ("coordinates", ctypes.c_int), ("readings", ctypes.c_int),
        ("op", ctypes.c_void_p), ("a", ctypes.c_void_p), ("b", ctypes.c_void_p), ("c", ctypes.c_void_p),
        ("number", _spans), ("depends", ctypes.c_void_p), ("ask", _Asking),
        ("value", _spans), ("slope", _spans), ("fault", ctypes.c_void_p),
    )  # fmt: skip


class _Goal(ctypes.Structure):
    _fields_ = (("node", ctypes.c_int), ("count", ctypes.c_int), ("list", ctypes.c_void_p))


class _Pass(ctypes.Structure):
    _fields_ = (
        ("samples", ctypes.c_int), ("states", ctypes.c_int), ("input", ctypes.c_int), ("given", ctypes.c_int),
        ("parts", ctypes.c_int), ("next", ctypes.POINTER(_Goal)), ("gained", _Goal), ("output", _Goal),
        ("most_gain", ctypes.c_double), ("readings", _spans), ("fixed", _spans), ("wanted", _spans), ("plan", _spans),
        ("moves", _spans), ("jolt", ctypes.c_void_p), ("start", _spans), ("x", _spans), ("y", _spans), ("u", _spans),
        ("target", _spans), ("slope", _spans), ("after", _spans), ("failed_at", _ints),
    )  # fmt: skip


class Recursion:
    """One plant with one input and one output, made ready to carry sets through N samples.

    ``parameters`` are symbols in the plant's equations. Raises InvalidValue where the plant is no graph, has an
    operation without a rule, another number of inputs or outputs, or too many signals. Threads take turns.
    """

    def __init__(self, plant: Plant, samples: int, parameters: Sequence[ca.SX] = ()) -> None:
        self.plant, self.samples = plant, samples
        if samples < 1:
            raise InvalidValue(f"samples must be at least 1, got {samples}")
        for what, names in (("input", plant.inputs), ("output", plant.outputs)):
            if len(names) != 1:
                raise InvalidValue(f"sets are carried for plants with one {what}, got {len(names)}")
        at = plant.symbols()
        x_next, y = plant.next_state(**at), plant.measured(at["x"])
        after = ca.substitute(plant.measured(at["x"]), at["x"], x_next)
        p = ca.vertcat(*parameters) if parameters else ca.SX(0, 1)
        function = ca.Function(
            "carried",
            [at["x"], at["w"], p, at["k"], at["u"]],
            [*ca.vertsplit(x_next), after - y, y],
            ["x", "w", "p", "k", "u"],
            [*(f"next_{i}" for i in range(x_next.shape[0])), "gained", "output"],
        )
        graph = rewritten(function)
        if isinstance(graph, str):
            raise InvalidValue(f"the plant must be a graph for its sets to be carried: {graph}")
        self.states = len(plant.states)
        self.disturbances, self.parameters = len(plant.disturbances), len(parameters)
        self.width = self.states + self.disturbances + self.parameters + 2
        if self.width > MOST:
            raise InvalidValue(f"states, disturbances and parameters must be at most {MOST - 2}, got {self.width - 2}")
        self._k = self.width - 2
        self._turn = Lock()
        self._trouble: BaseException | None = None
        self.read = self._tabulated(graph)
        self._make()

    def _tabulated(self, graph: Rewritten) -> Read:
        """Return the graph with what depends on the sample alone in a table, enclosed at every sample."""
        goals = []
        for entries in graph.outputs.values():
            if not entries:  # an output that is zero
                graph, zero = graph.with_constant(0.0)
                goals.append(zero)
            else:
                goals.append(entries[0].node)
        self.goals = goals
        whole = np.arange(self.width) == self._k
        numbers = np.arange(self.samples + 1, dtype=float)
        return readings_at(graph, tuple(goals), whole, numbers)

    def _make(self) -> None:
        """Lay the program out as the C reads it."""
        graph, coordinates = self.read.graph, self.width
        needed = graph.ancestors(tuple(self.goals))
        place = {k: i for i, k in enumerate(needed)}
        count = len(needed)
        op, a, b, c = (np.full(count, -1, dtype=np.int32) for _ in range(4))
        number, depends = np.zeros((count, 2)), np.zeros(count, dtype=np.uint64)
        self._asked: dict[int, tuple[str, int]] = {}
        for i, k in enumerate(needed):
            node = graph.nodes[k]
            name = node.op
            args = [place[arg] for arg in node.args]
            if name == CONSTANT:
                number[i] = node.value
            if name == "pow" and graph.nodes[node.args[1]].op == CONSTANT:
                power = graph.nodes[node.args[1]].value
                if float(power).is_integer() and 0 < power <= HIGHEST:
                    name, args, number[i] = "whole_power", args[:1], power
            if name not in _CODE:
                if name not in TOTAL and name not in PARTIAL:
                    raise InvalidValue(f"sets cannot be carried through this plant: {reason(graph, {}, k)}")
                self._asked[i] = name, len(args)
                name = "asked"
            op[i] = _CODE[name]
            if name == INPUT:
                a[i] = node.coordinate
                if node.coordinate < coordinates:
                    depends[i] = np.uint64(1) << np.uint64(node.coordinate)
            for target, arg in zip((a, b, c), args, strict=False):
                target[i] = arg
                depends[i] |= depends[arg]
        self._kept = [op, a, b, c, number, depends]
        self._value, self._slope = np.zeros((count, 2)), np.zeros((count, coordinates, 2))
        self._fault = np.zeros(count, dtype=np.int8)
        self._ask = _Asking(self._answer)
        pointers = [one.ctypes.data for one in (op, a, b, c, number, depends)]
        self._program = _Program(
            count, coordinates, len(self.read.lower), *pointers, self._ask,
            self._value.ctypes.data, self._slope.ctypes.data, self._fault.ctypes.data,
        )  # fmt: skip
        lists = [np.array([place[k] for k in graph.ancestors((goal,))], dtype=np.int32) for goal in self.goals]
        self._kept += lists
        self._goals = [
            _Goal(place[goal], len(one), one.ctypes.data) for goal, one in zip(self.goals, lists, strict=True)
        ]
        self._table = np.ascontiguousarray(np.stack([self.read.lower.T, self.read.upper.T], axis=-1))

    def _answer(self, node: int, told: ctypes.Array[ctypes.c_double], answer: ctypes.Array[ctypes.c_double]) -> None:
        """Enclose an operation that is no arithmetic, and its slopes; what goes wrong is raised when the C is done."""
        if self._trouble is not None:
            return
        try:
            self._enclosed(*self._asked[node], told, answer)
        except BaseException as error:
            self._trouble = error

    def _enclosed(
        self, name: str, count: int, told: ctypes.Array[ctypes.c_double], answer: ctypes.Array[ctypes.c_double]
    ) -> None:
        spans = [Span(np.array([told[2 * i]]), np.array([told[2 * i + 1]])) for i in range(count)]
        bad = False
        with np.errstate(all="ignore"):
            if name in PARTIAL:
                value, faults = PARTIAL[name][0](*spans)
                bad = bool(np.any(faults))
            else:
                value = TOTAL[name](*spans)
            by = partials(name, value, *spans)
        for i, one in enumerate((value, *by)):
            answer[2 * i], answer[2 * i + 1] = float(one.lo.ravel()[0]), float(one.hi.ravel()[0])
        answer[6] = float(not bad)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Let one thread at a time use what the C writes on, and raise what went wrong while it asked."""
        if not outward.arithmetic_is_ieee():
            raise InvalidValue("this process must round to nearest and keep subnormals for its sets to be rigorous")
        with self._turn:
            self._trouble = None
            yield
            if self._trouble is not None:
                raise self._trouble

    def _boxes(self, question: Question) -> Array:
        """Return the ranges of all coordinates but states and input, by sample, (N + 1, coordinates, 2)."""
        n, nx, nw = self.samples, self.states, self.disturbances
        fixed = np.zeros((n + 1, self.width, 2))
        fixed[:n, nx : nx + nw] = question.disturbance
        fixed[n, nx : nx + nw] = question.disturbance[-1]
        fixed[:, nx + nw : nx + nw + self.parameters] = question.parameters
        fixed[:, self._k] = np.arange(n + 1.0)[:, None]
        return fixed

    def carry(self, question: Question) -> Carried:
        """Carry the set of states through all samples."""
        n, nx = self.samples, self.states
        question.fits(n, nx, self.disturbances, self.parameters)
        x, y = np.full((n + 1, nx, 2), np.nan), np.full((n + 1, 2), np.nan)
        u, target, slope, after = (np.full((n, 2), np.nan) for _ in range(4))
        failed, given = ctypes.c_int(-1), question.moves is not None
        moves = question.moves if question.moves is not None else np.zeros((n, 2))
        jolt = question.jolt if question.jolt is not None else np.zeros(nx)
        arrays = [
            np.ascontiguousarray(one, dtype=np.float64)
            for one in (self._table, self._boxes(question), question.wanted, question.plan, moves, jolt, question.start)
        ]
        goals = (_Goal * nx)(*self._goals[:nx])
        asked = _Pass(
            n, nx, self.width - 1, int(given), PARTS, goals, self._goals[nx], self._goals[nx + 1], question.most_gain,
            *(one.ctypes.data for one in (*arrays, x, y, u, target, slope, after)), ctypes.pointer(failed),
        )  # fmt: skip
        with self._alone():
            ended = ENDS[_c().carry(ctypes.byref(self._program), ctypes.byref(asked))]
        return Carried(x, y, u, target, slope, after, ended, int(failed.value))

    def enclose(self, goal: int, boxes: Array, samples: NDArray[np.int64], parts: int = 1) -> tuple[Array, Array]:
        """Enclose a goal on boxes, (boxes, coordinates, 2) at samples: values (boxes, 2) and slopes by coordinate."""
        count = len(boxes)
        given = np.ascontiguousarray(boxes, dtype=np.float64)
        table = np.ascontiguousarray(self._table[samples])
        values, slopes = np.zeros((count, 2)), np.zeros((count, self.width, 2))
        with self._alone():
            _c().enclose(
                ctypes.byref(self._program), ctypes.byref(self._goals[goal]), count, given.ctypes.data,
                table.ctypes.data, parts, values.ctypes.data, slopes.ctypes.data,
            )  # fmt: skip
        return values, slopes


@cache
def _c() -> ctypes.CDLL:
    source = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
    found = library("recursion", source)
    if found is None:
        raise InvalidValue("sets are carried by machine code: a C compiler is needed (set CC to one)")
    loaded = ctypes.CDLL(str(found))
    loaded.enclose.argtypes = [
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_int,
        _spans,
        _spans,
        ctypes.c_int,
        _spans,
        _spans,
    ]
    loaded.enclose.restype = None
    loaded.carry.argtypes, loaded.carry.restype = [ctypes.c_void_p, ctypes.c_void_p], ctypes.c_int
    return loaded
