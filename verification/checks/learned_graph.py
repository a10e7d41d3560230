"""A law's learning as a graph: the plan of every sample before and after a trial, and what may be missing in it.

Samples that a trial did not reach are missing. What a law computes from them must be kept out of its plan by a
condition that says the sample was reached; here that is looked for in the graph.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.expression import Expression, as_expression
from models.quantity import InvalidValue
from workbench.contracts.law import AnyLaw, Task, Trial
from workbench.fold.answers import begun, learned
from workbench.fold.named import as_matrix, expressions, like, names, shapes_of
from workbench.graph import Graph, Unreadable, read
from workbench.graph.operations import CONSTANT, INPUT

PLAN, NEXT = "plan", "plan_next"
"""The outputs of the graph: the inputs planned for the trial, and for the next one, both in the plant's units."""
MEMORY = "memory_"
"""What names of the memory's fields begin with."""
TOLD = ("r", "y", "e", "reached")


class Place(NamedTuple):
    """A coordinate of the graph: an entry of an input."""

    port: str
    row: int
    column: int


class OtherForm(ValueError):
    """Why a law does not learn in the form that is looked for, in one line."""


class Content(NamedTuple):
    """All that a :class:`Learned` is made of, to be compared and kept."""

    function: str
    memory: tuple[tuple[str, tuple[int, int], bytes], ...]
    samples: int
    varying_lengths: bool
    increment: bool

    def learned(self) -> Learned:
        """Return what has this content."""
        return Learned(
            function=ca.Function.deserialize(self.function),
            memory={name: np.frombuffer(held).reshape(shape) for name, shape, held in self.memory},
            samples=self.samples,
            varying_lengths=self.varying_lengths,
            increment=self.increment,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Learned:
    """What a law of one input learns from a trial of a task, and what it begins with."""

    function: ca.Function
    """(memory fields, r, y, e, reached) -> plan, plan_next, and the next memory by ``next_NAME``."""
    memory: Mapping[str, Array]
    """The memory before the first trial."""
    samples: int
    """N."""
    varying_lengths: bool
    """Whether trials may end early."""
    increment: bool
    """Whether it learns on the increment of the output, else on the output."""

    @property
    def content(self) -> Content | None:
        """What it is made of; None where a function in it cannot be written down and read again, as one of Python's."""
        try:
            function = str(self.function.serialize())
            ca.Function.deserialize(function)
        except RuntimeError:
            return None
        held = [(name, (one.shape[0], one.shape[1]), one.tobytes()) for name, one in self.memory.items()]
        return Content(function, tuple(held), self.samples, self.varying_lengths, self.increment)

    @cached_property
    def graph(self) -> Graph:
        """The graph of the function. Raises OtherForm where there is none."""
        try:
            return read(self.function)
        except Unreadable as error:
            raise OtherForm(f"what the law learns cannot be read: {error}") from error

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """The coordinates."""
        return tuple(Place(port.name, *place) for port in self.graph.inputs for place in port.places)

    @cached_property
    def nodes(self) -> Mapping[str, Mapping[tuple[int, int], int]]:
        """The nodes of every output by row and column."""
        return {
            result.name: {(entry.row, entry.column): entry.node for entry in result.entries}
            for result in self.graph.outputs
        }

    @cached_property
    def copied(self) -> Mapping[str, Mapping[tuple[int, int], Place]]:
        """The entries of the memory that become a coordinate as it stands, by field."""
        nodes = self.graph.nodes
        return {
            name: {
                place: self.places[nodes[node].which]
                for place, node in self.nodes[f"next_{name}"].items()
                if nodes[node].op == INPUT
            }
            for name in self.memory
        }

    @cached_property
    def constants(self) -> Mapping[Place, float]:
        """The entries of the memory that never change, and their values."""
        found = {}
        for name, values in self.memory.items():
            for (row, column), source in self.copied[name].items():
                if source == Place(name, row, column) and np.isfinite(values[row, column]):
                    found[source] = float(values[row, column])
        return found

    @cached_property
    def ages(self) -> Mapping[str, tuple[str, int]]:
        """The fields that hold what trials left, sample for sample: ``y`` or ``reached``, of how many trials ago."""
        found: dict[str, tuple[str, int]] = {}
        for age in range(1, len(self.memory) + 1):
            for name, values in self.memory.items():
                sources = self.copied[name]
                one = {place.port for place in sources.values()}
                if name in found or len(one) != 1 or len(sources) != values.size:
                    continue
                if any((place.row, place.column) != at for at, place in sources.items()):
                    continue
                (port,) = one
                if age == 1 and port in TOLD[1:]:
                    found[name] = ("reached" if port == "reached" else "y", 1)
                elif port in found and found[port][1] == age - 1 and port != name:
                    found[name] = (found[port][0], age)
        return found

    def may_miss(self) -> str | None:
        """Return which number that a trial did not leave may enter a plan, or None.

        Memory that is no copy of what was missing must be free of it by itself, so what enters it is looked at too.
        """
        dirty = {
            name for name, values in self.memory.items() if name not in self.ages and not np.isfinite(values).all()
        }
        while True:
            reach = _Missing(self, dirty)
            more = {
                name
                for name in self.memory
                if name not in self.ages and name not in dirty and any(reach.enters(n) for n in self._next(name))
            }
            if not more:
                break
            dirty |= more
        for (_, k), node in sorted(self.nodes[NEXT].items()):
            source = next(iter(reach.enters(node)), None)
            if source is not None:
                return f"{source.port}({source.column}) may be missing, and enters the next plan of sample {k}"
        return None

    def _next(self, name: str) -> list[int]:
        constants = self.constants
        return [node for (row, column), node in self.nodes[f"next_{name}"].items()
                if Place(name, row, column) not in constants]  # fmt: skip


class _Missing:
    """What may be missing in every node of a graph."""

    def __init__(self, learned: Learned, dirty: set[str]) -> None:
        self.learned, self.graph = learned, learned.graph
        nodes = self.graph.nodes
        self._sources: list[frozenset[Place]] = []
        self._reached: list[tuple[Place, ...]] = []
        for node in nodes:
            if node.op == INPUT:
                place = learned.places[node.which]
                self._sources.append(frozenset([place]) if self._misses(place, dirty) else frozenset())
                self._reached.append((place,) if self._tells(place) else ())
                continue
            sources: frozenset[Place] = frozenset().union(*(self._sources[arg] for arg in node.args))
            if node.op == CONSTANT and math.isnan(node.value):
                sources = frozenset([Place("a number that is missing", 0, 0)])
            if node.op == "if_else_zero":
                told = self._reached[node.args[0]]
                if told:
                    kept = [one for one in self._sources[node.args[1]] if not self._present(one, told)]
                    sources = self._sources[node.args[0]] | frozenset(kept)
            self._sources.append(sources)
            self._reached.append(self._holds(node.op, node.args))

    def enters(self, node: int) -> frozenset[Place]:
        """Return what may be missing and enters a node."""
        return self._sources[node]

    def _misses(self, place: Place, dirty: set[str]) -> bool:
        if place.port in ("y", "e"):
            return self.learned.varying_lengths and place.column > 0
        if place.port in dirty:
            return place not in self.learned.constants
        if self.learned.ages.get(place.port, ("", 0))[0] != "y":
            return False
        begins = self.learned.memory[place.port][place.row, place.column]
        return bool(np.isnan(begins)) or (self.learned.varying_lengths and place.column > 0)

    def _tells(self, place: Place) -> bool:
        """Tell whether a coordinate is 1 only where a trial reached the sample."""
        if place.port == "reached":
            return True
        what, _ = self.learned.ages.get(place.port, ("", 0))
        return what == "reached" and not self.learned.memory[place.port].any()

    def _present(self, source: Place, told: tuple[Place, ...]) -> bool:
        """Tell whether a sample is there where others were reached: a trial reaches all before its last one."""
        age = 0 if source.port in ("y", "e") else self.learned.ages.get(source.port, ("", -1))[1]
        for one in told:
            its = 0 if one.port == "reached" else self.learned.ages[one.port][1]
            if its == age and one.column >= source.column:
                return True
        return False

    def _holds(self, op: str, args: Sequence[int]) -> tuple[Place, ...]:
        """Return what was reached where a node is not zero."""
        nodes = self.graph.nodes
        if op in ("and", "mul", "if_else_zero"):
            return self._reached[args[0]] + self._reached[args[1]]
        if op == "assign":
            return self._reached[args[0]]
        constants = [nodes[arg].value if nodes[arg].op == CONSTANT else None for arg in args]
        if len(args) == 2:
            for number, other in ((constants[0], args[1]), (constants[1], args[0])):
                if number is not None and ((op == "ne" and number == 0) or (op == "eq" and number != 0)):
                    return self._reached[other]
            if constants[0] is not None and (constants[0] >= 0 if op == "lt" else op == "le" and constants[0] > 0):
                return self._reached[args[1]]
        return ()


def plans_alone(law: AnyLaw, memory: tuple[object, ...], outputs: int) -> ca.Function:
    """Return the input of a sample by the columns of the memory at it. Raises OtherForm where it needs more."""
    if law.stepped or law.keeps_state:
        raise OtherForm("the law also acts within the trial, with a state or by decisions of its own")
    fields = [ca.SX.sym(name, rows) for name, (rows, _) in zip(names(memory), shapes_of(memory), strict=True)]
    r, r_next, y = (as_expression(ca.SX.sym(name, outputs)) for name in ("r", "r_next", "y"))
    given, _ = law.act(like(memory, fields), (), r, r_next, y)
    u = ca.SX(ca.vertcat(*(given if isinstance(given, (tuple, list)) else [given])))
    for name, symbol in (("output", y), ("reference", ca.vertcat(r, r_next))):
        if ca.depends_on(u, symbol):
            raise OtherForm(f"the law also acts within the trial, on the {name}")
    return ca.Function("planned", fields, [ca.densify(u)], [f"{MEMORY}{name}" for name in names(memory)], ["u_planned"])


def learned_graph(law: AnyLaw, task: Task) -> Learned:
    """Return what a law learns from a trial of a task. Raises OtherForm for a law that does not plan alone."""
    law = law.ready_for(task)
    n, outputs = task.samples, int(task.reference.shape[0])
    if outputs != 1:
        raise OtherForm(f"this is for one output, got {outputs}")
    memory = begun(law, task)
    named = [f"{MEMORY}{name}" for name in names(memory)]
    act = plans_alone(law, memory, outputs)
    if act.size_out(0) != (1, 1):
        raise OtherForm(f"this is for a law of one input, got {act.size1_out(0)}")
    fields = [ca.MX.sym(name, *shape) for name, shape in zip(named, shapes_of(memory), strict=True)]
    rows = [ca.MX.sym(name, 1, n + 1) for name in TOLD]
    r, y, e, reached = (as_expression(one) for one in rows)

    def planned(columns: Sequence[ca.MX]) -> ca.MX:
        columns = [ca.repmat(one, 1, n) if one.shape[1] == 1 else one[:, :n] for one in columns]
        return ca.MX(ca.densify(act.map(n)(*columns)))

    plan = planned(fields)
    after = [
        as_matrix(one)
        for one in expressions(learned(law, like(memory, fields), Trial(r, y, e, as_expression(plan), reached, ())))
    ]
    function = ca.Function(
        "learned",
        [*fields, *rows],
        [plan, planned(after), *(ca.densify(one) for one in after)],
        [*named, *TOLD],
        [PLAN, NEXT, *(f"next_{name}" for name in named)],
    )
    begins = dict(zip(named, [numbers(one) for one in expressions(memory)], strict=True))
    return Learned(
        function=function,
        memory=begins,
        samples=n,
        varying_lengths=task.varying_lengths,
        increment=law.learns_on == "increment",
    )


def numbers(value: Expression) -> Array:
    """Return the numbers that an expression without symbols stands for, same shape."""
    return np.asarray(ca.evalf(as_matrix(value)).full())


def first_plan(law: AnyLaw, task: Task) -> Array:
    """Return the inputs that a law plans for its first trial, (inputs, N), in the plant's units.

    Raises InvalidValue for a law that does not plan alone.
    """
    law = law.ready_for(task)
    memory = begun(law, task)
    try:
        act = plans_alone(law, memory, int(task.reference.shape[0]))
    except OtherForm as error:
        raise InvalidValue(f"a first plan needs a law that acts by its plan alone: {error}") from error
    n = task.samples
    handed = [
        np.tile(one, (1, n)) if one.shape[1] == 1 else one[:, :n]
        for one in [numbers(one) for one in expressions(memory)]
    ]
    plan: Array = np.asarray(act.map(n)(*handed).full())
    return plan
