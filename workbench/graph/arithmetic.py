"""One graph, many arithmetics: the values of its nodes in doubles, in rationals, or in whatever has the operations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from types import MappingProxyType
from typing import Generic, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.graph.graph import Graph
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP
from workbench.graph.table import Lookup, Table, value

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Arithmetic(Generic[T]):
    """What a graph's operations mean.

    Parameters
    ----------
    operations
        What every operation does, by name.
    constant
        Makes a number from a double.
    lookup
        Reads a table at a point.
    """

    operations: Mapping[str, Callable[..., T]]  # each of as many arguments as the operation has
    constant: Callable[[float], T]
    lookup: Callable[[Table, Lookup, Sequence[T]], T]


def evaluate(
    graph: Graph, coordinates: Sequence[T], arithmetic: Arithmetic[T], targets: Sequence[int] | None = None
) -> dict[int, T]:
    """Return the values of nodes at a point, by node: of the targets and what they depend on, by default of all.

    Raises ValueError where the point has another number of coordinates, or the arithmetic lacks an operation.
    """
    if len(coordinates) != graph.coordinates:
        raise ValueError(f"{graph.name} takes {graph.coordinates} numbers, got {len(coordinates)}")
    places = range(len(graph.nodes)) if targets is None else graph.ancestors(targets)
    values: dict[int, T] = {}
    for place in places:
        node = graph.nodes[place]
        arguments = [values[arg] for arg in node.args]
        if node.op == INPUT:
            values[place] = coordinates[node.which]
        elif node.op == CONSTANT:
            values[place] = arithmetic.constant(node.value)
        elif node.op == LOOKUP:
            values[place] = arithmetic.lookup(graph.table_of(node), graph.lookups[node.which], arguments)
        elif node.op in arithmetic.operations:
            values[place] = arithmetic.operations[node.op](*arguments)
        else:
            raise ValueError(f"{graph.name}: this arithmetic has no {node.op} (in {graph.describe(place)})")
    return values


def call(graph: Graph, inputs: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
    """Return all outputs in doubles, as CasADi's virtual machine computes them: bit for bit, but for bits in a NaN
    (which ``copysign`` can tell apart).

    ``inputs`` has a value of the input's shape for every input. Raises ValueError where they do not fit.
    """
    names = [port.name for port in graph.inputs]
    if set(names) != set(inputs):
        raise ValueError(f"{graph.name} has inputs {names}, got {list(inputs)}")
    coordinates: list[float] = []
    for port in graph.inputs:
        given = np.asarray(inputs[port.name], dtype=float)
        if given.size != port.shape[0] * port.shape[1]:
            raise ValueError(f"{port.name} of {graph.name} must have shape {port.shape}, got {given.shape}")
        matrix = given.reshape(port.shape)
        coordinates += [float(matrix[place]) for place in port.places]
    values = evaluate(graph, coordinates, DOUBLES)
    results = {}
    for result in graph.outputs:
        matrix = np.zeros(result.shape)
        for entry in result.entries:
            matrix[entry.row, entry.column] = values[entry.node]
        results[result.name] = matrix
    return results


def _total(function: Callable[..., float], otherwise: Callable[..., float]) -> Callable[..., float]:
    """Return a function of Python that gives infinity or NaN, as C does, where Python's raises."""

    def total(*arguments: float) -> float:
        try:
            return function(*arguments)
        except (ValueError, OverflowError, ZeroDivisionError):
            with np.errstate(all="ignore"):
                return float(otherwise(*map(np.float64, arguments)))

    return total


def _quotient(x: float, y: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(x) / np.float64(y))


def _sign(x: float) -> float:
    return -1.0 if x < 0 else 1.0 if x > 0 else x


@cache
def _inverse_error_function() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("erfinv", [x], [ca.erfinv(x)])


def _logical(holds: bool) -> float:
    return 1.0 if holds else 0.0


_POWER = _total(math.pow, np.power)

DOUBLES: Arithmetic[float] = Arithmetic(
    operations=MappingProxyType(
        {
            "assign": lambda x: x,
            "add": lambda x, y: x + y,
            "sub": lambda x, y: x - y,
            "mul": lambda x, y: x * y,
            "div": _quotient,
            "neg": lambda x: -x,
            "inv": lambda x: _quotient(1.0, x),
            "twice": lambda x: 2.0 * x,
            "sq": lambda x: x * x,
            "sqrt": _total(math.sqrt, np.sqrt),
            "pow": _POWER,
            "constpow": _POWER,
            "exp": _total(math.exp, np.exp),
            "expm1": _total(math.expm1, np.expm1),
            "log": _total(math.log, np.log),
            "log1p": _total(math.log1p, np.log1p),
            "sin": _total(math.sin, np.sin),
            "cos": _total(math.cos, np.cos),
            "tan": _total(math.tan, np.tan),
            "asin": _total(math.asin, np.arcsin),
            "acos": _total(math.acos, np.arccos),
            "atan": math.atan,
            "atan2": math.atan2,
            "sinh": _total(math.sinh, np.sinh),
            "cosh": _total(math.cosh, np.cosh),
            "tanh": math.tanh,
            "asinh": math.asinh,
            "acosh": _total(math.acosh, np.arccosh),
            "atanh": _total(math.atanh, np.arctanh),
            "erf": math.erf,
            "erfinv": lambda x: float(_inverse_error_function()(x)),
            "hypot": lambda x, y: float(np.hypot(x, y)),
            "fabs": math.fabs,
            "sign": _sign,
            "floor": lambda x: float(np.floor(x)),
            "ceil": lambda x: float(np.ceil(x)),
            "fmod": _total(math.fmod, np.fmod),
            "remainder": _total(math.remainder, lambda x, y: math.nan),
            "copysign": math.copysign,
            "fmin": lambda x, y: x if x <= y or y != y else y,
            "fmax": lambda x, y: x if x >= y or y != y else y,
            "lt": lambda x, y: _logical(x < y),
            "le": lambda x, y: _logical(x <= y),
            "eq": lambda x, y: _logical(x == y),
            "ne": lambda x, y: _logical(x != y),
            "not": lambda x: _logical(x == 0),
            "and": lambda x, y: _logical(x != 0 and y != 0),
            "or": lambda x, y: _logical(x != 0 or y != 0),
            "if_else_zero": lambda x, y: y if x != 0 else 0.0,
        }
    ),
    constant=float,
    lookup=lambda table, lookup, point: _read(table, lookup, point),
)
"""The doubles of CasADi's virtual machine."""


def _read(table: Table, lookup: Lookup, point: Sequence[float]) -> float:
    with np.errstate(all="ignore"):
        return float(value(table, lookup, [np.float64(x) for x in point], float))


def _whole(function: Callable[[Fraction], int]) -> Callable[[Fraction], Fraction]:
    return lambda x: Fraction(function(x))


def _truth(holds: bool) -> Fraction:
    return Fraction(1 if holds else 0)


def _rational_power(x: Fraction, y: Fraction) -> Fraction:
    if y.denominator != 1:
        raise ValueError(f"a power of rationals needs a whole exponent, got {y}")
    return Fraction(x**y.numerator)


RATIONALS: Arithmetic[Fraction] = Arithmetic(
    operations=MappingProxyType(
        {
            "assign": lambda x: x,
            "add": lambda x, y: x + y,
            "sub": lambda x, y: x - y,
            "mul": lambda x, y: x * y,
            "div": lambda x, y: x / y,
            "neg": lambda x: -x,
            "inv": lambda x: 1 / x,
            "twice": lambda x: 2 * x,
            "sq": lambda x: x * x,
            "pow": _rational_power,
            "constpow": _rational_power,
            "fabs": abs,
            "sign": lambda x: Fraction((x > 0) - (x < 0)),
            "floor": _whole(math.floor),
            "ceil": _whole(math.ceil),
            "fmod": lambda x, y: x - y * math.trunc(x / y),
            "remainder": lambda x, y: x - y * round(x / y),
            "copysign": lambda x, y: abs(x) if y >= 0 else -abs(x),
            "fmin": min,
            "fmax": max,
            "lt": lambda x, y: _truth(x < y),
            "le": lambda x, y: _truth(x <= y),
            "eq": lambda x, y: _truth(x == y),
            "ne": lambda x, y: _truth(x != y),
            "not": lambda x: _truth(x == 0),
            "and": lambda x, y: _truth(x != 0 and y != 0),
            "or": lambda x, y: _truth(x != 0 or y != 0),
            "if_else_zero": lambda x, y: y if x != 0 else Fraction(0),
        }
    ),
    constant=Fraction,
    lookup=lambda table, lookup, point: value(table, lookup, point, Fraction),
)
"""Exact rational numbers, for the operations that have them."""
