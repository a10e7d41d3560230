"""Every operation that a graph may hold: what it takes, where it is not smooth, and how it is written.

What an operation does to doubles, intervals or symbols stands with those arithmetics; here stands what is true of
it in all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple, Protocol

Kind = Literal["kink", "jump", "pole"]
Rule = Literal["zero", "nonpositive", "negative", "integer", "breakpoint"]
INPUT, CONSTANT, LOOKUP = "input", "const", "lookup"
"""A coordinate of the inputs, a number, and the value of a lookup table: nodes that carry more than arguments."""


class Maker(Protocol):
    """What makes nodes: operations on nodes that exist, and constants."""

    def operation(self, op: str, *args: int) -> int:
        """Return the node of an operation on nodes."""

    def constant(self, value: float) -> int:
        """Return the node of a number."""


class Critical(NamedTuple):
    """Where an operation is not smooth: where its level, made from its arguments, meets the set that the rule names.

    A kink keeps the value continuous, at a jump it breaks off, at a pole it does not exist. At an ``edge`` the domain
    ends at a finite value.
    """

    kind: Kind
    rule: Rule
    level: Callable[..., int]  # as many arguments as the operation has
    """(make, *arguments) -> the node of the level."""
    edge: bool = False


class Operation(NamedTuple):
    """One operation."""

    arity: int
    form: str
    """How it is written, its arguments in braces."""
    critical: Critical | None = None
    """Where it is not smooth, whatever its arguments are; :func:`workbench.graph.smooth.critical` knows more."""
    dear: bool = False
    """Whether it costs more than a number read from memory."""


def first(make: Maker, *args: int) -> int:
    """Return the first argument, which decides by itself."""
    return args[0]


def _second(make: Maker, *args: int) -> int:
    return args[1]


def _difference(make: Maker, x: int, y: int) -> int:
    return make.operation("sub", x, y)


def _room(make: Maker, x: int) -> int:
    """Return how far a magnitude stays below one."""
    return make.operation("sub", make.constant(1.0), make.operation("fabs", x))


def _above_one(make: Maker, x: int) -> int:
    return make.operation("sub", x, make.constant(1.0))


def _above_minus_one(make: Maker, x: int) -> int:
    return make.operation("add", x, make.constant(1.0))


def _off_cut(make: Maker, y: int, x: int) -> int:
    return make.operation("fmax", make.operation("fabs", y), x)


def _off_origin(make: Maker, x: int, y: int) -> int:
    return make.operation("fmax", make.operation("fabs", x), make.operation("fabs", y))


def _turns(make: Maker, x: int, y: int) -> int:
    """Return the size of the quotient whose integer part is taken, raised to 1/2: zero turns are no jump."""
    return make.operation("fmax", make.operation("fabs", make.operation("div", x, y)), make.constant(0.5))


def _half_turns(make: Maker, x: int, y: int) -> int:
    """Return the quotient that is rounded to the nearest whole number, moved so that it jumps at whole numbers."""
    return make.operation("add", make.operation("div", x, y), make.constant(0.5))


def _cosine(make: Maker, x: int) -> int:
    return make.operation("cos", x)


_JUMP = Critical("jump", "zero", _difference)
_KINK = Critical("kink", "zero", _difference)
_ENDS = Critical("pole", "nonpositive", _room)

OPERATIONS: Mapping[str, Operation] = MappingProxyType(
    {
        "assign": Operation(1, "{0}"),
        "add": Operation(2, "({0}+{1})"),
        "sub": Operation(2, "({0}-{1})"),
        "mul": Operation(2, "({0}*{1})"),
        "div": Operation(2, "({0}/{1})", Critical("pole", "zero", _second)),
        "neg": Operation(1, "(-{0})"),
        "inv": Operation(1, "(1/{0})", Critical("pole", "zero", first)),
        "twice": Operation(1, "(2*{0})"),
        "sq": Operation(1, "sq({0})"),
        "sqrt": Operation(1, "sqrt({0})", Critical("kink", "nonpositive", first, edge=True)),
        "pow": Operation(2, "pow({0},{1})", dear=True),
        "constpow": Operation(2, "pow({0},{1})", dear=True),
        "exp": Operation(1, "exp({0})", dear=True),
        "expm1": Operation(1, "expm1({0})", dear=True),
        "log": Operation(1, "log({0})", Critical("pole", "nonpositive", first), dear=True),
        "log1p": Operation(1, "log1p({0})", Critical("pole", "nonpositive", _above_minus_one), dear=True),
        "sin": Operation(1, "sin({0})", dear=True),
        "cos": Operation(1, "cos({0})", dear=True),
        "tan": Operation(1, "tan({0})", Critical("pole", "zero", _cosine), dear=True),
        "asin": Operation(1, "asin({0})", Critical("kink", "nonpositive", _room, edge=True), dear=True),
        "acos": Operation(1, "acos({0})", Critical("kink", "nonpositive", _room, edge=True), dear=True),
        "atan": Operation(1, "atan({0})", dear=True),
        "atan2": Operation(2, "atan2({0},{1})", Critical("jump", "nonpositive", _off_cut), dear=True),
        "sinh": Operation(1, "sinh({0})", dear=True),
        "cosh": Operation(1, "cosh({0})", dear=True),
        "tanh": Operation(1, "tanh({0})", dear=True),
        "asinh": Operation(1, "asinh({0})", dear=True),
        "acosh": Operation(1, "acosh({0})", Critical("kink", "nonpositive", _above_one, edge=True), dear=True),
        "atanh": Operation(1, "atanh({0})", _ENDS, dear=True),
        "erf": Operation(1, "erf({0})", dear=True),
        "erfinv": Operation(1, "erfinv({0})", _ENDS, dear=True),
        "hypot": Operation(2, "hypot({0},{1})", Critical("kink", "nonpositive", _off_origin)),
        "fabs": Operation(1, "fabs({0})", Critical("kink", "zero", first)),
        "sign": Operation(1, "sign({0})", Critical("jump", "zero", first)),
        "floor": Operation(1, "floor({0})", Critical("jump", "integer", first)),
        "ceil": Operation(1, "ceil({0})", Critical("jump", "integer", first)),
        "fmod": Operation(2, "fmod({0},{1})", Critical("jump", "integer", _turns)),
        "remainder": Operation(2, "remainder({0},{1})", Critical("jump", "integer", _half_turns)),
        "copysign": Operation(2, "copysign({0},{1})", Critical("jump", "zero", _second)),
        "fmin": Operation(2, "fmin({0},{1})", _KINK),
        "fmax": Operation(2, "fmax({0},{1})", _KINK),
        "lt": Operation(2, "({0}<{1})", _JUMP),
        "le": Operation(2, "({0}<={1})", _JUMP),
        "eq": Operation(2, "({0}=={1})", _JUMP),
        "ne": Operation(2, "({0}!={1})", _JUMP),
        "not": Operation(1, "(!{0})", Critical("jump", "zero", first)),
        "and": Operation(2, "({0}&&{1})"),
        "or": Operation(2, "({0}||{1})"),
        "if_else_zero": Operation(2, "({0}?{1}:0)", Critical("jump", "zero", first)),
    }
)
"""Every operation by name."""

COMPARISONS = frozenset({"lt", "le", "eq", "ne"})
BOOLEAN = COMPARISONS | {"not", "and", "or"}
"""Operations whose value is 0 or 1."""
