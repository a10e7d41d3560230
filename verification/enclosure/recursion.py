"""A plant's set of states carried from sample to sample, rigorous and in machine code.

The C beside this module evaluates a graph in outward-rounded intervals with slopes, and carries boxes of states through
the samples of a trial while a law learns; :mod:`verification.checks.funnel` says what that proves. Operations that are
no arithmetic (sine, exponential) are asked of the balls of :mod:`verification.enclosure.outward`, one by one, unless
they depend on the sample alone: those are tabulated once. Where there is no C compiler no sets are carried.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from threading import Lock
from typing import NamedTuple

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
from verification.enclosure.rewriting import COVER, MEET, SELECT, Quantity, Rewritten, rewritten
from verification.enclosure.slopes import partials
from verification.enclosure.whole import readings_at
from workbench.fold.machine_code import library
from workbench.graph.operations import CONSTANT, INPUT

_NATIVE = (
    INPUT, CONSTANT, "add", "sub", "mul", "div", "neg", "inv", "twice", "sq", "sqrt", "fabs", "fmin", "fmax", "sign",
    "floor", "ceil", "lt", "le", "eq", "ne", "not", "and", "or", "if_else_zero", SELECT, COVER, MEET, "whole_power",
    "copysign", "asked",
)  # fmt: skip
"""Operations in the order in which the C counts them."""
_CODE = {name: code for code, name in enumerate(_NATIVE)}
LEARNING, GIVEN, SETTLED = range(3)
"""What becomes of the inputs of a pass, as the C counts it."""
MOST = 64
"""Coordinates that the C has room for."""
HIGHEST = 64  # powers up to this are made of products
PARTS = 16
"""Most parts that a box is split into where a bound of it is not exact."""

KEPT = 2**14
"""Answers that are kept: boxes are looked at for several ends, and their corners again and again."""
INNER = 10**6
"""Coordinates from here on stand for what depends on one other coordinate alone."""

_Asking = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double))
_ints, _spans = ctypes.POINTER(ctypes.c_int), ctypes.c_void_p


class _Goal(ctypes.Structure):
    _fields_ = (("node", ctypes.c_int), ("count", ctypes.c_int), ("list", ctypes.c_void_p))


class _Program(ctypes.Structure):
    _fields_ = (
        ("nodes", ctypes.c_int), ("coordinates", ctypes.c_int), ("readings", ctypes.c_int), ("inner", ctypes.c_int),
        ("within", ctypes.POINTER(_Goal)),
        ("op", ctypes.c_void_p), ("a", ctypes.c_void_p), ("b", ctypes.c_void_p), ("c", ctypes.c_void_p),
        ("number", _spans), ("depends", ctypes.c_void_p), ("ask", _Asking),
        ("value", _spans), ("slope", _spans), ("fault", ctypes.c_void_p),
    )  # fmt: skip


class _Pass(ctypes.Structure):
    _fields_ = (
        ("samples", ctypes.c_int), ("states", ctypes.c_int), ("input", ctypes.c_int), ("mode", ctypes.c_int),
        ("parts", ctypes.c_int), ("next", ctypes.POINTER(_Goal)), ("gained", _Goal), ("output", _Goal),
        ("most_gain", ctypes.c_double), ("readings", _spans), ("fixed", _spans), ("wanted", _spans), ("plan", _spans),
        ("moves", _spans), ("jolt", ctypes.c_void_p), ("start", _spans), ("x", _spans), ("y", _spans), ("u", _spans),
        ("target", _spans), ("slope", _spans), ("after", _spans), ("failed_at", _ints),
    )  # fmt: skip


def step_of(plant: Plant, parameters: Sequence[ca.SX] = ()) -> ca.Function:
    """Return one step as a Function of x, w, p, k and u: ``next_i``, the output's gain ``gained``, and ``output``."""
    at = plant.symbols()
    x_next, y = plant.next_state(**at), plant.measured(at["x"])
    after = ca.substitute(plant.measured(at["x"]), at["x"], x_next)
    p = ca.vertcat(*parameters) if parameters else ca.SX(0, 1)
    return ca.Function(
        "carried",
        [at["x"], at["w"], p, at["k"], at["u"]],
        [*ca.vertsplit(x_next), after - y, y],
        ["x", "w", "p", "k", "u"],
        [*(f"next_{i}" for i in range(x_next.shape[0])), "gained", "output"],
    )


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
        function = step_of(plant, parameters)
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
        graph, goals = _goals(graph)
        whole = np.arange(self.width) == self._k
        self.read = readings_at(graph, tuple(goals), whole, np.arange(samples + 1.0))
        self.plain = tuple(goals)
        self.graph, self.goals, self.within = apart(self.read.graph, goals, range(self._k))
        self.coordinates = self.width + len(self.within)
        if self.coordinates > MOST:
            raise InvalidValue(f"coordinates of a set must be at most {MOST}, got {self.coordinates}")
        self._make()

    def _make(self) -> None:
        """Lay the program out as the C reads it."""
        graph, coordinates = self.graph, self.coordinates
        needed = graph.ancestors((*self.goals, *self.within))
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
                at = node.coordinate
                real = at < self.width or at >= INNER
                a[i] = at if at < self.width else self.width + at - INNER if real else coordinates + at - self.width
                if real:
                    depends[i] = np.uint64(1) << np.uint64(a[i])
            for target, arg in zip((a, b, c), args, strict=False):
                target[i] = arg
                depends[i] |= depends[arg]
        self._kept = [op, a, b, c, number, depends]
        self._value, self._slope = np.zeros((count, 2)), np.zeros((count, coordinates, 2))
        self._fault = np.zeros(count, dtype=np.int8)
        self._ask = _Asking(self._answer)
        pointers = [one.ctypes.data for one in (op, a, b, c, number, depends)]
        wanted = (*self.goals, *self.within)
        lists = [np.array([place[k] for k in graph.ancestors((goal,))], dtype=np.int32) for goal in wanted]
        self._kept += lists
        goals = [_Goal(place[goal], len(one), one.ctypes.data) for goal, one in zip(wanted, lists, strict=True)]
        self._goals, within = goals[: len(self.goals)], goals[len(self.goals) :]
        self._inner = (_Goal * len(within))(*within)
        self._program = _Program(
            count, coordinates, len(self.read.lower), len(within), self._inner, *pointers, self._ask,
            self._value.ctypes.data, self._slope.ctypes.data, self._fault.ctypes.data,
        )  # fmt: skip
        self.table = np.ascontiguousarray(np.stack([self.read.lower.T, self.read.upper.T], axis=-1))

    def _answer(self, node: int, told: ctypes.Array[ctypes.c_double], answer: ctypes.Array[ctypes.c_double]) -> None:
        """Enclose an operation that is no arithmetic, and its slopes; what goes wrong is raised when the C is done."""
        if self._trouble is not None:
            return
        try:
            name, count = self._asked[node]
            for i, end in enumerate(_enclosed(name, *told[: 2 * count])):
                answer[i] = end
        except BaseException as error:
            self._trouble = error

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

    def fixed(self, question: Question) -> Array:
        """Return the ranges of all coordinates but states and input, by sample, (N + 1, coordinates, 2)."""
        n, nx, nw = self.samples, self.states, self.disturbances
        fixed = np.zeros((n + 1, self.coordinates, 2))
        fixed[:n, nx : nx + nw] = question.disturbance
        fixed[n, nx : nx + nw] = question.disturbance[-1]
        fixed[:, nx + nw : nx + nw + self.parameters] = question.parameters
        fixed[:, self._k] = np.arange(n + 1.0)[:, None]
        return fixed

    def carry(self, question: Question) -> Carried:
        """Carry the set of states through all samples."""
        n, nx = self.samples, self.states
        question.fits(n, nx, self.disturbances, self.parameters)
        c = _c()
        x, y = np.full((n + 1, nx, 2), np.nan), np.full((n + 1, 2), np.nan)
        u, target, slope, after = (np.full((n, 2), np.nan) for _ in range(4))
        failed = ctypes.c_int(-1)
        mode = GIVEN if question.moves is not None else SETTLED if question.settled else LEARNING
        moves = question.moves if question.moves is not None else np.zeros((n, 2))
        jolt = question.jolt if question.jolt is not None else np.zeros(nx)
        arrays = [
            np.ascontiguousarray(one, dtype=np.float64)
            for one in (self.table, self.fixed(question), question.wanted, question.plan, moves, jolt, question.start)
        ]
        goals = (_Goal * nx)(*self._goals[:nx])
        asked = _Pass(
            n, nx, self.width - 1, mode, PARTS, goals, self._goals[nx], self._goals[nx + 1], question.most_gain,
            *(one.ctypes.data for one in (*arrays, x, y, u, target, slope, after)), ctypes.pointer(failed),
        )  # fmt: skip
        with self._alone():
            ended = ENDS[c.carry(ctypes.byref(self._program), ctypes.byref(asked))]
        return Carried(x, y, u, target, slope, after, ended, int(failed.value))

    def enclose(self, goal: int, boxes: Array, samples: NDArray[np.int64], parts: int = 1) -> tuple[Array, Array]:
        """Enclose a goal on boxes, (boxes, coordinates, 2) at samples: values (boxes, 2) and slopes by coordinate."""
        count, c = len(boxes), _c()
        given = np.zeros((count, self.coordinates, 2))
        given[:, : self.width] = boxes
        table = np.ascontiguousarray(self.table[samples])
        values, slopes = np.zeros((count, 2)), np.zeros((count, self.coordinates, 2))
        with self._alone():
            c.enclose(
                ctypes.byref(self._program), ctypes.byref(self._goals[goal]), count, given.ctypes.data,
                table.ctypes.data, parts, values.ctypes.data, slopes.ctypes.data,
            )  # fmt: skip
        return values, slopes


@lru_cache(maxsize=KEPT)
def _enclosed(name: str, *told: float) -> tuple[float, ...]:
    """Enclose an operation on arguments between ends that are told, and its slopes, in the order of the C's answers."""
    spans = [Span(np.array([low]), np.array([high])) for low, high in zip(told[::2], told[1::2], strict=True)]
    bad = False
    with np.errstate(all="ignore"):
        if name in PARTIAL:
            value, faults = PARTIAL[name][0](*spans)
            bad = bool(np.any(faults))
        else:
            value = TOTAL[name](*spans)
        by = partials(name, value, *spans)
    ends = [float(end.ravel()[0]) for one in (value, *by) for end in one]
    return (*ends, *[np.nan] * (6 - len(ends)), float(not bad))


def _goals(graph: Rewritten) -> tuple[Rewritten, list[int]]:
    """Return the node of every output, with one that is zero where an output has none."""
    graph, zero = graph.with_constant(0.0)
    return graph, [entries[0].node if entries else zero for entries in graph.outputs.values()]


class Parted(NamedTuple):
    """A graph in which parts that depend on one coordinate alone are coordinates of their own."""

    graph: Rewritten
    goals: list[int]
    within: list[int]
    """The nodes of these parts; the coordinate of part j is INNER + j."""


def apart(graph: Rewritten, goals: Sequence[int], coordinates: range) -> Parted:
    """Let what a goal takes of a coordinate be a coordinate itself, where it is one thing and the goal takes no other.

    The range of a function of one coordinate is found once, and exactly as far as one pleases; the goal is then
    monotone in it where it was not in the coordinate: so is a slope force along a line.
    """
    on: dict[int, frozenset[int]] = {}
    for k in graph.ancestors(tuple(goals)):
        node = graph.nodes[k]
        own = frozenset({node.coordinate}) if node.op == INPUT and node.coordinate in coordinates else frozenset()
        if node.op == INPUT and node.coordinate not in coordinates and node.coordinate < coordinates.stop + 2:
            own = frozenset({node.coordinate})  # the input
        on[k] = own.union(*(on[arg] for arg in node.args))
    nodes, within, made = list(graph.nodes), list[int](), list[int]()
    for goal in goals:
        replaced: dict[int, int] = {}
        needed = graph.ancestors((goal,))
        for i in coordinates:
            taken = {arg for k in needed for arg in graph.nodes[k].args if on[arg] == {i} and on[k] != {i}}
            if len(taken) != 1 or graph.nodes[min(taken)].op == INPUT:
                continue
            (part,) = taken
            if part not in within:
                within.append(part)
            replaced[part] = len(nodes)
            nodes.append(Quantity(INPUT, coordinate=INNER + within.index(part)))
        for k in needed:
            node = graph.nodes[k]
            args = tuple(replaced.get(arg, arg) for arg in node.args)
            if k not in replaced and args != node.args:
                replaced[k] = len(nodes)
                nodes.append(node._replace(args=args))
        made.append(replaced.get(goal, goal))
    return Parted(replace(graph, nodes=tuple(nodes)), made, within)


@cache
def _c() -> ctypes.CDLL:
    source = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
    found = library("recursion", source)
    if found is None:
        raise InvalidValue("sets are carried through a trial by machine code: a C compiler is needed (set CC to one)")
    return declared(ctypes.CDLL(str(found)))


def declared(loaded: ctypes.CDLL) -> ctypes.CDLL:
    """Return a library of the C with what its functions take and return."""
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
