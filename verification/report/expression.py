"""Equations as trees fit to be read: from the graph of a CasADi SX Function.

Sums and products are flattened, ``if_else`` is found again, and what is shared or too wide gets a name of its
own. A tree means the same numbers as the Function it came from, up to rounding.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import casadi as ca

from models.quantity import InvalidValue
from workbench.graph import Graph, Unreadable, read
from workbench.graph.operations import CONSTANT, INPUT

MOST_OPERATIONS = 3000
MOST_DEFINITIONS = 80
"""Named parts up to which equations are still read by anybody."""
LINE = 84
"""About how many characters fit on a printed line."""

FUNCTIONS = {
    "log": "ln",
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "asinh": "arsinh",
    "acosh": "arcosh",
    "atanh": "artanh",
    "fabs": "abs",
    "fmin": "min",
    "fmax": "max",
    **{
        name: name
        for name in (
            *("exp", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "atan2", "floor", "ceil", "sign", "copysign"),
            *("fmod", "remainder", "erf", "erfinv", "log1p", "expm1", "hypot"),
            *("lt", "le", "eq", "ne", "and", "or", "not"),
        )
    },
}
"""The sign of a graph's operation where it is a function or a condition."""
CONDITIONS = ("lt", "le", "eq", "ne", "and", "or", "not")
"""Operations whose value is 1 where they hold and 0 elsewhere."""


@dataclasses.dataclass(frozen=True, eq=False)
class Term:
    """A node of an expression tree. Equal terms of one :func:`equations` are the same object.

    ``op`` is "number" (its ``value``), "name" (its ``name``), "sum", "negative", "product", "quotient", "power",
    "cases" (condition, value, value otherwise), or one of the names in ``FUNCTIONS``.
    """

    op: str
    args: tuple[Term, ...] = ()
    value: float = 0.0
    name: str = ""


class Equation(NamedTuple):
    """A name or label on the left, a tree on the right."""

    left: str
    right: Term


class Equations(NamedTuple):
    """Definitions of t1, t2, ..., each of names already known, and one tree for every output entry."""

    definitions: tuple[Equation, ...]
    outputs: tuple[tuple[Term, ...], ...]


def equations(
    function: ca.Function, names: Sequence[Sequence[str]], fresh: Callable[[], Iterator[str]] | None = None
) -> Equations:
    """Return the equations of an SX Function as trees.

    ``names`` has one name for every entry of every input; ``fresh`` yields names for shared parts (t1, t2, ...).
    Raises InvalidValue for an operation that has no mathematical sign, and for a function that is too long.
    """
    if not function.is_a("SXFunction"):
        raise InvalidValue(f"equations are typeset from an SX Function, got {function.class_name()}")
    raw, roots, uses = _walked(_graph(function), names)
    writer = _Writer(fresh() if fresh else numbered(set().union(*map(set, names))), uses)
    shown: dict[int, Term] = {}
    for node in raw:
        shown[id(node)] = writer.shown(node, [shown[id(arg)] for arg in node.args])
    if len(writer.definitions) > MOST_DEFINITIONS:
        raise InvalidValue(
            f"equations of at most {MOST_DEFINITIONS} named parts are typeset, got {len(writer.definitions)}: a plant "
            "that integrates a right-hand side is shown by that one where it gives rhs in place of step"
        )
    outputs = tuple(tuple(shown[id(root)] for root in column) for column in roots)
    return Equations(tuple(writer.definitions), outputs)


def _graph(function: ca.Function) -> Graph:
    """Return the graph of a Function, or raise InvalidValue where it has none that anybody would read."""
    try:
        graph = read(function)
    except Unreadable as error:
        raise InvalidValue(f"equations are typeset from a graph: {error}") from None
    if len(graph.nodes) > MOST_OPERATIONS:
        raise InvalidValue(f"equations of at most {MOST_OPERATIONS} operations are typeset, got {len(graph.nodes)}")
    return graph


def numbered(taken: set[str]) -> Iterator[str]:
    """Yield t_1, t_2, ... in a letter that no taken name begins with."""
    letter = next((c for c in "tqhz" if not any(name == c or name.startswith(f"{c}_") for name in taken)), "aux")
    index = 0
    while True:
        index += 1
        yield f"{letter}_{index}"


def is_leaf(term: Term) -> bool:
    """Tell whether a term is a number or a name."""
    return term.op in ("number", "name")


def width(term: Term) -> float:
    """Return about how many characters wide a term is when it is typeset."""
    inner = [width(arg) for arg in term.args]
    if term.op == "number":
        return len(f"{term.value:.6g}")
    if term.op == "name":
        return max(2.0, 0.85 * len(term.name))
    if term.op == "quotient":
        return max(inner) + 1
    if term.op == "power":
        return inner[0] + 0.7 * inner[1] + 1
    if term.op == "cases":
        return 12 + inner[0] + max(inner[1:])
    if term.op == "product":
        return sum(inner) + 2 * (len(inner) - 1) + 2 * sum(arg.op == "sum" for arg in term.args)
    if term.op in ("sum", "negative"):
        return sum(inner) + 3 * (len(inner) - 1) + 2 * (term.op == "negative")
    return len(term.op) + 2 + sum(inner) + 2 * (len(inner) - 1)


def _walked(graph: Graph, names: Sequence[Sequence[str]]) -> tuple[list[Term], list[list[Term]], dict[int, int]]:
    """Return every distinct operation in order of evaluation, the outputs, and how often each is used."""
    known: dict[object, Term] = {}

    def node(op: str, args: tuple[Term, ...] = (), value: float = 0.0, name: str = "") -> Term:
        key = (op, tuple(map(id, args)), value, name)
        return known.setdefault(key, Term(op, args, value, name))

    zero = node("number")
    labels = [name for column in names for name in column]
    terms: list[Term] = []
    for one in graph.nodes:
        if one.op == INPUT:
            terms.append(node("name", name=labels[one.which]))
        elif one.op == CONSTANT:
            terms.append(node("number", value=one.value))
        else:
            terms.append(_operation(one.op, tuple(terms[arg] for arg in one.args), node))
    roots = []
    for result in graph.outputs:
        rows, columns = result.shape
        roots.append([zero] * (rows * columns))
        for entry in result.entries:
            roots[-1][entry.column * rows + entry.row] = terms[entry.node]
    uses: dict[int, int] = {}
    for used in ([root for column in roots for root in column], *(one.args for one in known.values())):
        for arg in used:
            uses[id(arg)] = uses.get(id(arg), 0) + 1
    return list(known.values()), roots, uses


# operations take different numbers of arguments
def _operation(op: str, args: tuple[Term, ...], node: Callable[..., Term]) -> Term:
    if op == "assign":
        return args[0]
    if op == "add" and all(arg.op == "cases" for arg in args):
        (one, value, _), (other, otherwise, _) = args[0].args, args[1].args
        if other.op == "not" and other.args[0] is one:
            return node("cases", (one, value, otherwise))
        if one.op == "not" and one.args[0] is other:
            return node("cases", (other, otherwise, value))
    if op == "sq":
        return node("product", (args[0], args[0]))
    if op == "twice":
        return node("product", (node("number", value=2.0), args[0]))
    if op == "inv":
        return node("quotient", (node("number", value=1.0), args[0]))
    if op == "if_else_zero":
        return node("cases", (*args, node("number")))
    plain = {
        "add": "sum",
        "sub": "difference",
        "neg": "negative",
        "mul": "product",
        "div": "quotient",
        "pow": "power",
        "constpow": "power",
    }
    name = plain.get(op) or FUNCTIONS.get(op)
    if name is None:
        raise InvalidValue(f"equations are typeset from arithmetic and elementary functions, got {op}")
    return node(name, args)


class _Writer:
    """Turns operations into terms fit to be read, and names those that are shared or too wide."""

    def __init__(self, fresh: Iterator[str], uses: dict[int, int]) -> None:
        self.fresh, self.uses = fresh, uses
        self.definitions: list[Equation] = []
        self.known: dict[object, Term] = {}
        self.named: dict[int, Term] = {}

    def term(self, op: str, args: Sequence[Term] = (), value: float = 0.0, name: str = "") -> Term:
        key = (op, tuple(map(id, args)), value, name)
        return self.known.setdefault(key, Term(op, tuple(args), value, name))

    def number(self, value: float) -> Term:
        return self.term("number", value=value)

    def shown(self, node: Term, args: Sequence[Term]) -> Term:
        """Return the term shown for an operation, given those shown for its operands."""
        if is_leaf(node):
            return self.term(node.op, value=node.value, name=node.name)
        if node.op == "sum":
            made = self.sum(args)
        elif node.op == "difference":
            made = self.sum([args[0], self.negative(args[1])])
        elif node.op == "negative":
            made = self.negative(args[0])
        else:
            made = self.narrow(node.op, [self.compact(arg) for arg in args])
        shared = self.uses.get(id(node), 0) > 1 and width(made) >= 10
        return self.called(made) if shared else made

    def narrow(self, op: str, args: list[Term]) -> Term:
        """Make a term, naming its widest operands until it fits on a line."""
        while True:
            made = self.made(op, args)
            widest = max(args, key=lambda arg: 0 if is_leaf(arg) else width(arg))
            if width(made) <= LINE or is_leaf(widest):
                return made
            args = [self.called(arg) if arg is widest else arg for arg in args]

    def compact(self, term: Term) -> Term:
        """Return a sum short enough to stand inside another term, naming its wide parts or all of it."""
        while term.op == "sum" and width(term) > 0.66 * LINE:
            widest = max(term.args, key=width)
            inner = widest.args[0] if widest.op == "negative" else widest
            if is_leaf(inner) or width(inner) < 0.45 * LINE:
                return self.called(term)
            name = self.called(inner)
            new = self.negative(name) if widest.op == "negative" else name
            term = self.term("sum", [new if arg is widest else arg for arg in term.args])
        return term

    def called(self, term: Term) -> Term:
        """Return the name of a term, defining it where it has none."""
        if is_leaf(term):
            return term
        if term.op == "negative":
            return self.negative(self.called(term.args[0]))
        if id(term) not in self.named:
            name = next(self.fresh)
            self.definitions.append(Equation(name, term))
            self.named[id(term)] = self.term("name", name=name)
        return self.named[id(term)]

    def made(self, op: str, args: Sequence[Term]) -> Term:
        if op == "product":
            return self.product(args)
        if op == "quotient":
            return self.quotient(*args)
        if op == "not" and args[0].op in ("lt", "le", "eq", "ne"):
            left, right = args[0].args
            return {
                "lt": lambda: self.term("le", (right, left)),
                "le": lambda: self.term("lt", (right, left)),
                "eq": lambda: self.term("ne", (left, right)),
                "ne": lambda: self.term("eq", (left, right)),
            }[args[0].op]()
        if op in ("min", "max"):
            args = [inner for arg in args for inner in (arg.args if arg.op == op else (arg,))]
        return self.term(op, args)

    def negative(self, term: Term) -> Term:
        if term.op == "number":
            return self.number(-term.value)
        return term.args[0] if term.op == "negative" else self.term("negative", (term,))

    def sum(self, args: Sequence[Term]) -> Term:
        flat = [inner for arg in args for inner in (arg.args if arg.op == "sum" else (arg,))]
        return self.term("sum", flat)

    def product(self, args: Sequence[Term]) -> Term:
        """Multiply: signs come to the front, one number comes first, equal neighbours become powers."""
        flat = [inner for arg in args for inner in _factors(arg)]
        sign = 1.0
        for i, factor in enumerate(flat):
            if factor.op == "negative" or (factor.op == "number" and factor.value < 0):
                flat[i], sign = self.negative(factor), -sign
        flat = [factor for factor in flat if not (factor.op == "number" and factor.value == 1)]
        flat.sort(key=lambda factor: factor.op != "number")
        powers: list[tuple[Term, float]] = []
        for factor in flat:
            base, exponent = factor, 1.0
            if factor.op == "power" and factor.args[1].op == "number" and factor.args[1].value in range(2, 9):
                base, exponent = factor.args[0], factor.args[1].value
            if powers and powers[-1][0] is base and base.op != "number":
                exponent += powers.pop()[1]
            powers.append((base, exponent))
        flat = [base if n == 1 else self.term("power", (base, self.number(n))) for base, n in powers]
        made = self.term("product", flat) if len(flat) > 1 else (flat[0] if flat else self.number(1.0))
        return made if sign > 0 else self.negative(made)

    def quotient(self, above: Term, below: Term) -> Term:
        if above.op == "negative":
            return self.negative(self.quotient(above.args[0], below))
        if above.op == "quotient":
            return self.quotient(above.args[0], self.product((above.args[1], below)))
        return self.term("quotient", (above, below))


def _factors(term: Term) -> Sequence[Term]:
    if term.op == "negative" and term.args[0].op == "product":
        first, *rest = term.args[0].args
        return (Term("negative", (first,)), *rest)
    return term.args if term.op == "product" else (term,)
