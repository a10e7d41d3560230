"""Typeset equations from the symbolic source: LaTeX for notebooks, MathML for the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from models.expression import Expression
from models.plant import Plant, Signal
from models.quantity import is_declared, symbolised, walked
from verification.report.expression import CONDITIONS, LINE, Equation, Term, equations, width
from verification.report.notation import Latex, MathML, Pen, symbol

CONDITION, ALTERNATIVE, RELATION, SUM, PRODUCT, POWER, ATOM = range(7)
"""How tightly a piece binds, from loose to tight."""
RELATIONS = {"lt": "<", "le": "≤", "eq": "=", "ne": "≠"}
TURNED = {"<": ">", "≤": "≥", "=": "=", "≠": "≠"}
FENCES = {"abs": "||", "floor": "⌊⌋", "ceil": "⌈⌉"}


class Parameter(NamedTuple):
    """A parameter that the equations hold as a symbol: its MathML, field, value, unit and description."""

    symbol: str
    field: str
    value: float
    unit: str
    doc: str


class SignalRow(NamedTuple):
    """A signal of the plant: its MathML, what kind it is, its name, unit and description."""

    symbol: str
    kind: str
    name: str
    unit: str
    doc: str


class Typeset(NamedTuple):
    """A plant's equations as MathML, one string an equation, with the tables of what their symbols mean."""

    equations: tuple[str, ...]
    signals: tuple[SignalRow, ...]
    parameters: tuple[Parameter, ...]
    integrator: str
    """How a right-hand side is integrated, in words; empty for a plant that is given in discrete time."""


def latex(thing: Plant | ca.Function) -> str:
    """Return the equations of a plant or of an SX Function as one aligned LaTeX block, for MathJax.

    Raises InvalidValue where they have an operation without a mathematical sign, or are too long to be read.
    """
    written = [f"{left} &= {lines}" for left, lines in _written(equations_of(thing), Latex())]
    return "\\begin{aligned}\n" + " \\\\\n".join(written) + "\n\\end{aligned}"


def mathml(thing: Plant | ca.Function) -> tuple[str, ...]:
    """Return the equations of a plant or of an SX Function as MathML, one ``<math>`` element an equation.

    Raises InvalidValue as :func:`latex` does.
    """
    return tuple(
        f'<math xmlns="http://www.w3.org/1998/Math/MathML" display="block"><mtable displaystyle="true"><mtr>'
        f'<mtd style="text-align:right">{left}</mtd><mtd style="padding:0.1em 0.3em"><mo>=</mo></mtd>'
        f'<mtd style="text-align:left">{right}</mtd></mtr></mtable></math>'
        for left, right in _written(equations_of(thing), MathML())
    )


def typeset(plant: Plant) -> Typeset:
    """Return what a report shows of a plant's equations. Raises InvalidValue as :func:`latex` does."""
    named = _named(plant)
    used = _names_in(equations_of(plant))
    pen = MathML()
    meaning = {path: spec for path, spec, _ in walked(plant, lambda _, value: is_declared(value))}
    parameters = tuple(
        Parameter(_whole(pen.identifier(name)), path, value, meaning[path].unit, meaning[path].doc)
        for name, path, value in zip(named.parameters, named.paths, named.values, strict=True)
        if name in used
    )
    rows = [
        SignalRow(_whole(pen.identifier(name)), kind, signal.name, signal.unit, signal.doc)
        for kind, names, signals in (
            ("state", named.x, plant.states),
            ("input", named.u, plant.inputs),
            ("disturbance", named.w, plant.disturbances),
            ("output", named.y, plant.outputs),
        )
        for name, signal in zip(names, signals, strict=True)
    ]
    if named.k in used:
        rows.append(SignalRow(_whole(pen.identifier(named.k)), "index", named.k, "1", "sample"))
    integrator = plant.integrator.phrase if plant.continuous else ""
    return Typeset(mathml(plant), tuple(rows), parameters, integrator)


class _Named(NamedTuple):
    """A plant whose quantities are symbols where they can be, with a name for every symbol."""

    plant: Plant
    x: list[str]
    u: list[str]
    w: list[str]
    k: str
    y: list[str]
    parameters: list[str]
    symbols: tuple[Expression, ...]
    paths: tuple[str, ...]
    values: tuple[float, ...]


def _named(plant: Plant) -> _Named:
    try:
        free = symbolised(plant)
        free.thing.next_state(**plant.symbols())
    except Exception:
        # A plant may look at its numbers in Python (``if self.tau > 0``): then they are shown as numbers.
        free = symbolised(plant, only=frozenset())
    taken = {"k"}

    def unique(name: str, kind: str) -> str:
        while symbol(name) in map(symbol, taken):
            name = f"{name}_{kind}"
        taken.add(name)
        return name

    def names(signals: Sequence[Signal], kind: str) -> list[str]:
        return [unique(signal.name, kind) for signal in signals]

    x, u, w = names(plant.states, "state"), names(plant.inputs, "input"), names(plant.disturbances, "disturbance")
    y = [unique(f"y_{signal.name}", "output") for signal in plant.outputs]
    last = [path.rpartition(".")[2] for path in free.names]
    short = [
        {"sampling_time": "T_s"}.get(name, name) if last.count(name) == 1 else path.replace(".", "_")
        for name, path in zip(last, free.names, strict=True)
    ]
    parameters = [unique(name, "parameter") for name in short]
    return _Named(free.thing, x, u, w, "k", y, parameters, free.symbols, free.names, free.values)


def equations_of(thing: Plant | ca.Function) -> list[Equation]:
    """Return equations as (left side, tree), definitions of shared parts first.

    The left side is a name, followed by ``(k+1)`` or ``(k)`` for the states and outputs of a plant; ``(dt)`` stands
    for the derivative by time, for a plant that is given in continuous time.
    """
    if isinstance(thing, ca.Function):
        inputs = [_entries(thing.name_in(i), thing.numel_in(i)) for i in range(thing.n_in())]
        found = equations(_dense(thing, inputs), inputs)
        lefts = [_entries(thing.name_out(i), thing.numel_out(i)) for i in range(thing.n_out())]
    else:
        named = _named(thing)
        at = thing.symbols()
        after, marks = _motion(named.plant, at)
        outputs = [after, named.plant.measured(at["x"])]
        columns = [*at.values(), *named.symbols]
        names = [named.x, named.u, named.w, [named.k], *([name] for name in named.parameters)]
        found = equations(ca.Function("plant", columns, [ca.SX(value) for value in outputs]), names)
        moved = [f"{name}{mark}" for name, mark in zip(named.x, marks, strict=True)]
        lefts = [moved, [f"{name}(k)" for name in named.y]]
    pairs = [
        Equation(left, right)
        for column, rights in zip(lefts, found.outputs, strict=True)
        for left, right in zip(column, rights, strict=True)
    ]
    return [*found.definitions, *pairs]


def _motion(plant: Plant, at: dict[str, ca.SX]) -> tuple[ca.SX, list[str]]:
    """Return what the states become and how each left side is marked.

    That is the next state; of a plant in continuous time the slope, but for states that change at samples only.
    """
    if not plant.continuous:
        return plant.next_state(**at), ["(k+1)"] * len(plant.states)
    slope = plant.slope(at["x"], at["u"], at["w"], at["k"] * plant.sampling_time)
    flown = ca.SX.sym("flown", len(plant.states))
    after = plant.sampled(flown, at["x"], at["u"])
    flows = [ca.is_equal(after[i], flown[i]) for i in range(flown.numel())]
    jumped = ca.substitute(after, flown, at["x"])
    rows = [slope[i] if flow else jumped[i] for i, flow in enumerate(flows)]
    return ca.vertcat(*rows), ["(dt)" if flow else "(k+1)" for flow in flows]


def _dense(function: ca.Function, inputs: list[list[str]]) -> ca.Function:
    """Return a Function on scalars, so that sparse inputs have a name for every entry too."""
    if all(function.sparsity_in(i).is_dense() for i in range(function.n_in())):
        return function
    given = [ca.SX.sym("z", *function.size_in(i)) for i in range(function.n_in())]
    return ca.Function(function.name(), given, function.call(given))


def _entries(name: str, number: int) -> list[str]:
    return [name] if number == 1 else [f"{name}_{i + 1}" for i in range(number)]


def _names_in(found: Sequence[Equation]) -> set[str]:
    waiting, names = [equation.right for equation in found], set[str]()
    while waiting:
        term = waiting.pop()
        names.add(term.name)
        waiting += term.args
    return names


def _whole(inner: str) -> str:
    return f'<math xmlns="http://www.w3.org/1998/Math/MathML">{inner}</math>'


def _written(found: Sequence[Equation], pen: Pen) -> list[tuple[str, str]]:
    written: list[tuple[str, str]] = []
    for left, right in found:
        mark = next((mark for mark in ("(k+1)", "(k)", "(dt)") if left.endswith(mark)), "")
        side = pen.identifier(left.removesuffix(mark))
        if mark == "(dt)":
            side = pen.fraction(pen.row(pen.identifier("d"), pen.gap(), side), pen.row(*map(pen.identifier, "dt")))
        elif mark:
            plus = (pen.sign("+"), pen.number("1", "")) if mark == "(k+1)" else ()
            side = pen.row(side, pen.fenced("()", pen.row(pen.identifier("k"), *plus)))
        written.append((side, pen.lines([pen.row(*line) for line in _broken(right, pen)])))
    return written


def _broken(term: Term, pen: Pen) -> list[list[str]]:
    """Return the lines of a right side: a long sum is broken before its signs."""
    if term.op != "sum" or width(term) <= LINE:
        return [[_set(term, pen, CONDITION)]]
    lines: list[list[str]] = [[]]
    used = 0.0
    for index, arg in enumerate(term.args):
        if used and used + width(arg) > LINE:
            lines.append([])
            used = 0.0
        lines[-1] += _summand(arg, pen, first=index == 0)
        used += width(arg) + 3
    return lines


def _summand(term: Term, pen: Pen, *, first: bool) -> list[str]:
    if term.op == "number" and term.value < 0:
        return [pen.sign("−"), _number(-term.value, pen)]
    if term.op == "negative":
        return [pen.sign("−"), _set(term.args[0], pen, PRODUCT)]
    # A sum's later terms may not begin with a sign of their own.
    return ([] if first else [pen.sign("+")]) + [_set(term, pen, SUM)]


def _number(value: float, pen: Pen) -> str:
    if math.isnan(value):
        return pen.number("undefined", "")
    if math.isinf(value):
        return pen.number("∞", "")
    text = f"{value:.8g}"
    digits, _, exponent = text.partition("e")
    return pen.number(digits, str(int(exponent)) if exponent else "")


def _set(term: Term, pen: Pen, least: int) -> str:
    """Return a term in the pen's language, in parentheses where it binds looser than ``least``."""
    text, binds = _piece(term, pen)
    return text if binds >= least else pen.fenced("()", text)


def _piece(term: Term, pen: Pen) -> tuple[str, int]:
    op, args = term.op, term.args
    if op == "name":
        return pen.identifier(term.name), ATOM
    if op == "number":
        if term.value < 0:
            return pen.row(*_summand(term, pen, first=True)), SUM
        return _number(term.value, pen), PRODUCT if "e" in f"{term.value:.8g}" else ATOM
    if op in ("sum", "negative"):
        parts = args if op == "sum" else (term,)
        return pen.row(*(piece for i, arg in enumerate(parts) for piece in _summand(arg, pen, first=i == 0))), SUM
    if op == "product":
        pieces = [_set(arg, pen, PRODUCT) for arg in args]
        return pen.row(pieces[0], *(part for piece in pieces[1:] for part in (pen.sign("·"), piece))), PRODUCT
    if op == "quotient":
        return pen.fraction(_set(args[0], pen, CONDITION), _set(args[1], pen, CONDITION)), PRODUCT
    if op == "power":
        return pen.power(_set(args[0], pen, ATOM), _set(args[1], pen, CONDITION)), POWER
    if op == "sqrt":
        return pen.root(_set(args[0], pen, CONDITION)), POWER
    if op in FENCES:
        return pen.fenced(FENCES[op], _set(args[0], pen, CONDITION)), ATOM
    if op == "cases":
        inner = [_set(arg, pen, CONDITION) for arg in args[1:]]
        return pen.cases(_condition(args[0], pen)[0], *inner), CONDITION
    if op in CONDITIONS:
        return pen.fenced("[]", _condition(term, pen)[0]), ATOM
    return pen.function(op, [_set(arg, pen, CONDITION) for arg in args]), POWER


def _condition(term: Term, pen: Pen) -> tuple[str, int]:
    """Return a condition with how tightly it binds; a number is a condition where it is not zero."""
    if term.op in RELATIONS:
        left, right = term.args
        sign = RELATIONS[term.op]
        if left.op == "number" and right.op != "number":
            left, right, sign = right, left, TURNED[sign]
        return pen.row(_set(left, pen, SUM), pen.sign(sign), _set(right, pen, SUM)), RELATION
    if term.op == "not":
        return pen.row(pen.sign("¬"), pen.fenced("()", _condition(term.args[0], pen)[0])), RELATION
    if term.op in ("and", "or"):
        level = ALTERNATIVE if term.op == "or" else RELATION
        sides = [
            text if binds >= level else pen.fenced("()", text)
            for text, binds in (_condition(arg, pen) for arg in term.args)
        ]
        return pen.row(sides[0], pen.sign("∧" if term.op == "and" else "∨"), sides[1]), level
    return pen.row(_set(term, pen, SUM), pen.sign("≠"), pen.number("0", "")), RELATION
