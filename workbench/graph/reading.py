"""A CasADi Function read as a graph, instruction for instruction. Nothing else reads CasADi's instructions."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from itertools import pairwise, product

import casadi as ca

from workbench.graph.arithmetic import DOUBLES
from workbench.graph.graph import Entry, Graph, Node, Port, Result
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP, OPERATIONS
from workbench.graph.table import Lookup, Table

# CasADi keeps its operations as constants of the module, by name
_NAMES = {getattr(ca, name): name.removeprefix("OP_").lower() for name in dir(ca) if name.startswith("OP_")}
_SAME = {"lift": "assign", "printme": "assign"}
"""Operations that give their first argument back."""
_TRIED = (-1.75, -0.5, 0.0, 0.25, 0.5, 1.0, 1.5, 2.25)
"""Where a table that was read is held against CasADi's: on this line along all axes, between and beyond its points."""


class Unreadable(ValueError):
    """Why a Function is no graph, in one line that names the operation."""


def read(function: ca.Function) -> Graph:
    """Return a Function as a graph: a node for every scalar instruction, in the order in which CasADi runs them.

    A matrix-valued Function is expanded to scalars first; tables (``interpolant``, ``bspline``) become lookups.
    Raises Unreadable for an operation that has no scalar form, for a call of a Function that is no table, and for a
    free variable.
    """
    return _Reader(_scalar(function)).graph()


def _scalar(function: ca.Function) -> ca.Function:
    """Return a Function as scalar instructions."""
    if function.is_a("SXFunction"):
        return function
    failed = f"{function.name()} has no form of scalar instructions"
    if not function.is_a("MXFunction"):
        if _table_kind(function) is None:
            raise Unreadable(f"{failed}: it is a {function.class_name()}")
        if function.n_in() != 1:
            raise Unreadable(f"{failed}: a table whose values or points are inputs is not read")
        x = ca.MX.sym("x", function.sparsity_in(0))
        function = ca.Function(function.name(), [x], [function(x)], function.name_in(), function.name_out())
    try:
        return _splines_apart(function).expand()
    except (RuntimeError, NotImplementedError) as error:
        where = _inexpandable(function)
        raise Unreadable(f"{failed}: {where or ' '.join(str(error).split())}") from None


def _inexpandable(function: ca.Function) -> str:
    """Return the first operation of a matrix-valued Function that cannot be expanded to scalars, as text, or ''."""
    for index in range(function.n_instructions()):
        op = _NAMES[function.instruction_id(index)]
        if op in ("input", "output", "const"):
            continue
        node = function.instruction_MX(index)
        if op == "call":
            called = node.which_function()
            if called.is_a("MXFunction") and (inner := _inexpandable(called)):
                return inner
            if not called.is_a("MXFunction") and not called.is_a("SXFunction") and _table_kind(called) is None:
                return f"it calls {called.name()}, a {called.class_name()}"
            continue
        arguments = [ca.MX.sym(f"x{i}", node.dep(i).sparsity()) for i in range(node.n_dep())]
        alone = ca.graph_substitute(node, [node.dep(i) for i in range(node.n_dep())], arguments)
        try:
            ca.Function("alone", arguments, [alone]).expand()
        except (RuntimeError, NotImplementedError):
            return f"the operation {op} in {' '.join(str(node).split())[:60]}"
    return ""


def _has_splines(function: ca.Function) -> bool:
    """Tell whether a matrix-valued Function, or one that it calls, evaluates a spline."""
    for index in range(function.n_instructions()):
        op = _NAMES[function.instruction_id(index)]
        if op == "bspline":
            return True
        if op == "call":
            called = function.instruction_MX(index).which_function()
            if called.is_a("MXFunction") and _has_splines(called):
                return True
    return False


def _splines_apart(function: ca.Function, *, kept: bool = False) -> ca.Function:
    """Return a Function in which every spline is a call of its own, which scalar instructions may hold.

    Where it is ``kept``, calls of the Function are not replaced by its instructions either.
    """
    if not _has_splines(function):
        return function
    inputs = function.mx_in()
    outputs = [ca.MX(*function.size_out(i)) for i in range(function.n_out())]
    slots: dict[int, ca.MX] = {}
    for index in range(function.n_instructions()):
        op = _NAMES[function.instruction_id(index)]
        into, out = function.instruction_input(index), function.instruction_output(index)
        if op == "output":
            outputs[out[0]] = slots[into[0]]
        elif op == "input":
            slots[out[0]] = inputs[into[0]]
        else:
            made = _called_apart(function.instruction_MX(index), [slots[slot] for slot in into], f"spline{index}")
            slots.update(zip(out, made, strict=True))
    options = {"never_inline": kept}
    return ca.Function(function.name(), inputs, outputs, function.name_in(), function.name_out(), options)


def _kept(table: ca.Function) -> ca.Function:
    """Return a spline's Function whose calls are not replaced by its instructions."""
    try:
        table(ca.SX.sym("x", table.sparsity_in(0)))
    except (RuntimeError, NotImplementedError):
        x = ca.MX.sym("x", table.sparsity_in(0))
        return ca.Function(table.name(), [x], table.call([x], True, False), {"never_inline": True})
    return table


def _called_apart(node: ca.MX, args: Sequence[ca.MX], name: str) -> list[ca.MX]:
    """Return the outputs of an instruction on other arguments, a spline being called and not evaluated."""
    fresh = [ca.MX.sym("x", arg.sparsity()) for arg in args]
    if node.op() == ca.OP_CALL:
        called = node.which_function()
        if not called.is_a("MXFunction") or not _has_splines(called):
            return called.call(args)
        if _table_kind(called) is None:
            return _splines_apart(called, kept=True).call(args)
        return _kept(called).call(args)
    if not args:
        return [node]
    outputs = [node.get_output(i) for i in range(node.n_out())] if node.has_output() else [node]
    alone = ca.graph_substitute(outputs, [node.dep(i) for i in range(node.n_dep())], fresh)
    options = {"never_inline": True} if node.op() == ca.OP_BSPLINE else {}
    return ca.Function(name, fresh, alone, options).call(args, not options, bool(options))


class _Reader:
    """Walks the instructions once; slots of CasADi's work vector are used again and again."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.nodes: list[Node] = []
        self.tables: list[Table] = []
        self.lookups: list[Lookup] = []

    def graph(self) -> Graph:
        """Return the whole Function."""
        function = self.function
        ports = tuple(self.port(i) for i in range(function.n_in()))
        offsets = [0]
        for port in ports:
            offsets.append(offsets[-1] + len(port.places))
        results: list[dict[int, int]] = [{} for _ in range(function.n_out())]
        slots: dict[int, int] = {}
        symbols: ca.SX | None = None
        for index in range(function.n_instructions()):
            op = _NAMES[function.instruction_id(index)]
            into, out = function.instruction_input(index), function.instruction_output(index)
            if op == "output":
                results[out[0]][out[1]] = slots[into[0]]
            elif op == "input":
                slots[out[0]] = self.add(Node(INPUT, which=offsets[into[0]] + into[1]))
            elif op == "const":
                slots[out[0]] = self.add(Node(CONSTANT, value=float(function.instruction_constant(index))))
            elif op == "call":
                symbols = function.instructions_sx() if symbols is None else symbols
                read = self.called(symbols.nz[index].which_function(), [slots[slot] for slot in into])
                slots.update({slot: place for slot, place in zip(out, read, strict=True) if slot >= 0})
            elif op == "parameter":
                free = ", ".join(map(str, function.free_sx()))
                raise Unreadable(f"{function.name()} has free variables ({free}), which have no value")
            else:
                slots[out[0]] = self.operation(_SAME.get(op, op), [slots[slot] for slot in into])
        return Graph(
            name=function.name(),
            inputs=ports,
            outputs=tuple(self.result(i, results[i]) for i in range(function.n_out())),
            nodes=tuple(self.nodes),
            tables=tuple(self.tables),
            lookups=tuple(self.lookups),
        )

    def add(self, node: Node) -> int:
        """Return the place of a new node."""
        self.nodes.append(node)
        return len(self.nodes) - 1

    def operation(self, op: str, args: Sequence[int]) -> int:
        """Return the place of an operation; what CasADi hands over beyond its arguments is left out."""
        if op not in OPERATIONS:
            raise Unreadable(f"{self.function.name()} has the operation {op}, which is not known")
        return self.add(Node(op, tuple(args[: OPERATIONS[op].arity])))

    def port(self, index: int) -> Port:
        """Return an input."""
        function = self.function
        places = tuple(zip(*function.sparsity_in(index).get_triplet(), strict=True))
        labels = tuple(str(symbol) for symbol in function.sx_in(index).nz)
        return Port(function.name_in(index), _shape(function.size_in(index)), places, labels)

    def result(self, index: int, nodes: dict[int, int]) -> Result:
        """Return an output."""
        function = self.function
        places = zip(*function.sparsity_out(index).get_triplet(), strict=True)
        entries = tuple(Entry(row, column, nodes[k]) for k, (row, column) in enumerate(places))
        return Result(function.name_out(index), _shape(function.size_out(index)), entries)

    def called(self, function: ca.Function, args: Sequence[int]) -> list[int]:
        """Return the places of all outputs of a called Function: a table's, or those of its own instructions."""
        if _table_kind(function) is None:
            try:
                return self.inlined(read(function), args)
            except Unreadable as error:
                raise Unreadable(f"{self.function.name()} calls a Function that is no graph: {error}") from None
        table = _table(function)
        if table not in self.tables:
            self.tables.append(table)
        places = []
        for output in range(table.outputs):
            lookup = Lookup(self.tables.index(table), output, (0,) * table.dimensions)
            if lookup not in self.lookups:
                self.lookups.append(lookup)
            places.append(self.add(Node(LOOKUP, tuple(args), which=self.lookups.index(lookup))))
        return places

    def inlined(self, graph: Graph, args: Sequence[int]) -> list[int]:
        """Return the places of the outputs of another graph whose nodes are written here."""
        first_table, own_lookups = len(self.tables), len(self.lookups)
        self.tables += graph.tables
        self.lookups += [lookup._replace(table=lookup.table + first_table) for lookup in graph.lookups]
        places: list[int] = []
        for node in graph.nodes:
            if node.op == INPUT:
                places.append(args[node.which])
                continue
            which = node.which + own_lookups if node.op == LOOKUP else node.which
            places.append(self.add(node._replace(args=tuple(places[arg] for arg in node.args), which=which)))
        return [places[entry.node] for result in graph.outputs for entry in result.entries]


def _shape(size: Sequence[int]) -> tuple[int, int]:
    rows, columns = size
    return rows, columns


def _table_kind(function: ca.Function) -> str | None:
    """Return what kind of table a Function is, or None."""
    if function.class_name() == "LinearInterpolant":
        return "linear"
    if function.class_name() == "BSplineInterpolant":
        return "bspline"
    if function.is_a("MXFunction") and function.n_in() == function.n_out() == 1:
        ops = [_NAMES[function.instruction_id(index)] for index in range(function.n_instructions())]
        return "bspline" if ops == ["input", "bspline", "output"] else None
    return None


def _table(function: ca.Function) -> Table:
    """Return the numbers of a table, held against the Function itself at many points."""
    failed = f"the numbers of the table {function.name()} cannot be read with CasADi {ca.CasadiMeta.version()}"
    linear = function.class_name() == "LinearInterpolant"
    prefix = "Interpolant::" if linear else "BSplineCommon::"
    stored = _Stored(function)
    fields = [stored.rows(f"{prefix}{name}") for name in ("offset", "grid" if linear else "knots")]
    fields.append(stored.rows("LinearInterpolant::lookup_mode" if linear else "BSplineCommon::lookup_mode"))
    degrees = [[1.0] * len(search) for search in fields[2]] if linear else stored.rows("BSplineCommon::degree")
    values = stored.rows("Interpolant::values" if linear else "BSpline::coeffs")
    reason = "a field is missing"
    # derivatives that CasADi keeps with a spline are stored inside it, so a field may be there several times
    for (offsets, points, search, degree), numbers in product(zip(*fields, degrees, strict=False), values):
        try:
            table = Table(
                name=function.name(),
                kind="linear" if linear else "bspline",
                grid=tuple(tuple(points[int(a) : int(b)]) for a, b in pairwise(offsets)),
                values=tuple(numbers),
                outputs=function.numel_out(0),
                degrees=tuple(map(int, degree)),
                search=tuple(map(int, search)),
            )
        except ValueError as error:
            reason = str(error)
            continue
        reason = _differs(table, function)
        if not reason:
            return table
    raise Unreadable(f"{failed}: {reason}")


def _differs(table: Table, function: ca.Function) -> str:
    """Return where a table's doubles are not those of a Function, or ''."""
    lines = [[points[0] + share * (points[-1] - points[0]) for points in table.grid] for share in _TRIED]
    corners = [[points[min(i, len(points) - 1)] for points in table.grid] for i in range(max(map(len, table.grid)))]
    between = [[(a + 2 * b) / 3 for a, b in zip(*pair, strict=True)] for pair in pairwise(corners)]
    for at in (*lines, *corners, *between):
        for output, other in enumerate(float(entry) for entry in function(at).nz):
            own = DOUBLES.lookup(table, Lookup(0, output, (0,) * table.dimensions), at)
            if own != other and not (math.isnan(own) and math.isnan(other)):
                return f"at {at} they give {own!r} where CasADi gives {other!r}"
    return ""


class _Stored:
    """What CasADi writes of a Function where it is asked to name the parts: fields found by their names."""

    def __init__(self, function: ca.Function) -> None:
        text = function.serialize({"debug": True})
        self.data = bytes(ord(low) - 97 | ord(high) - 97 << 4 for low, high in zip(text[::2], text[1::2], strict=True))

    def rows(self, field: str) -> list[list[float]]:
        """Return the rows of numbers that stand under a name: a length, then a mark and a number for every entry."""
        found = []
        for match in re.finditer(re.escape(field.encode()) + rb"VJ", self.data):
            (count,) = struct.unpack_from("<q", self.data, match.end())
            at = match.end() + 8
            marks = self.data[at : at + 9 * count : 9]
            if set(marks) <= set(b"d") or set(marks) <= set(b"J"):
                form = "<d" if marks[:1] == b"d" else "<q"
                found.append([float(struct.unpack_from(form, self.data, at + 9 * i + 1)[0]) for i in range(count)])
        return found
