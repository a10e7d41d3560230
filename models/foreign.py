"""Plants made of what was written elsewhere: matrices, and functions of another library's systems."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, TypeAlias, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.discretise import RK4, Integrator
from models.expression import Column, Expression, Number
from models.plant import Plant, Signal, Values
from models.quantity import InvalidValue, declared, given, part, quantity

Rows: TypeAlias = tuple[tuple[float, ...], ...]
"""A matrix, row by row."""
Written: TypeAlias = Sequence[Number] | Expression | Array | NDArray[np.object_]
"""What a function of another library may give for several signals."""
Update: TypeAlias = Callable[[Number, object, object, Mapping[str, object]], Written]
"""f(t, x, u, params) as python-control has it: dx/dt, the next state or the outputs."""


@declared
class LinearSystem(Plant):
    """x(k+1) = A x(k) + B u(k), y(k) = C x(k), with any number of inputs and outputs."""

    source: ClassVar[str] = "the matrices that it is given"

    A: Rows = given(doc="states by states")
    B: Rows = given(doc="states by inputs")
    C: Rows = given(doc="outputs by states")
    sampling_time: float = given(doc="sampling time in seconds, to which the matrices belong")
    states: tuple[Signal, ...] = given(doc="the states' names and units")
    inputs: tuple[Signal, ...] = given(doc="the inputs' names and units")
    outputs: tuple[Signal, ...] = given(doc="the outputs' names and units")

    def check(self) -> None:
        """Raise InvalidValue unless the matrices are finite and fit the signals."""
        x, u, y = len(self.states), len(self.inputs), len(self.outputs)
        for name, rows, shape in (("A", self.A, (x, x)), ("B", self.B, (x, u)), ("C", self.C, (y, x))):
            matrix = np.array(rows, dtype=float).reshape(len(rows), -1)
            if matrix.shape != shape:
                raise InvalidValue(f"{name} must have shape {shape} by the signals that are named, got {matrix.shape}")
            if not np.isfinite(matrix).all():
                raise InvalidValue(f"{name} must hold finite numbers only, got one that is not")

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return A x + B u."""
        return _sparse(self.A) @ x.vector + _sparse(self.B) @ u.vector

    def output(self, x: Values) -> Column:
        """Return C x."""
        return ca.densify(_sparse(self.C) @ x.vector)


def _sparse(rows: Rows) -> ca.DM:
    return ca.sparsify(ca.DM(np.array(rows, dtype=float)))


@declared
class UpdatedSystem(Plant):
    """x(k+1) = update(t, x, u, params), y = observe(t, x, u, params), from functions that take CasADi symbols."""

    source: ClassVar[str] = "the functions that it is given"

    update: Update = given(doc="the next state")
    observe: Update | None = given(default=None, doc="the outputs; None: the states")
    params: Mapping[str, object] = given(default={}, doc="what both are told besides")
    sampling_time: float = given(doc="sampling time in seconds, which the update is for")
    states: tuple[Signal, ...] = given(doc="the states' names and units")
    inputs: tuple[Signal, ...] = given(doc="the inputs' names and units")
    outputs: tuple[Signal, ...] = given(doc="the outputs' names and units")

    def check(self) -> None:
        """Raise InvalidValue where the functions do not work on symbols, or the outputs need more than the state."""
        _check(self, self.update, self.observe, self.params)

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the next state."""
        return called(self.update, k * self.sampling_time, x.vector, u.vector, self.params)

    def output(self, x: Values) -> Column:
        """Return the outputs."""
        return _observed(self, self.observe, x.vector, self.params)


@declared
class FlowingSystem(Plant):
    """dx/dt = update(t, x, u, params), y = observe(t, x, u, params), from functions that take CasADi symbols."""

    source: ClassVar[str] = "the functions that it is given"

    update: Update = given(doc="dx/dt")
    observe: Update | None = given(default=None, doc="the outputs; None: the states")
    params: Mapping[str, object] = given(default={}, doc="what both are told besides")
    integrator: Integrator = part(default=RK4(), doc="how dx/dt is integrated")
    sampling_time: float = quantity(unit="s", doc="sampling time", above=0)
    states: tuple[Signal, ...] = given(doc="the states' names and units")
    inputs: tuple[Signal, ...] = given(doc="the inputs' names and units")
    outputs: tuple[Signal, ...] = given(doc="the outputs' names and units")

    def check(self) -> None:
        """Raise InvalidValue where the functions do not work on symbols, or the outputs need more than the state."""
        _check(self, self.update, self.observe, self.params)

    def rhs(self, x: Values, u: Values, w: Values, t: Number) -> Column:
        """Return dx/dt."""
        return called(self.update, t, x.vector, u.vector, self.params)

    def output(self, x: Values) -> Column:
        """Return the outputs."""
        return _observed(self, self.observe, x.vector, self.params)


def called(f: Update, t: Number, x: Expression, u: Expression, params: Mapping[str, object]) -> Expression:
    """Return what a function gives for CasADi columns, as a column.

    It is told rows of entries, as arrays of numbers would be, or the columns where it does not take those.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"\s*casadi: a numpy function", FutureWarning)  # np.sin of a symbol is meant
        try:
            return _column(f(t, _entries(x), _entries(u), params))
        except Exception:  # whatever a function of somebody else raises for what it does not take
            return _column(f(t, x, u, params))


def _entries(column: Expression) -> NDArray[np.object_]:
    row = np.empty(column.numel(), dtype=object)
    for index in range(column.numel()):
        row[index] = column[index]
    return row


def _column(written: Written) -> Expression:
    rows = written.ravel().tolist() if isinstance(written, np.ndarray) else written
    if not isinstance(rows, (list, tuple)):
        return cast(Expression, rows)
    pieces: Sequence[Expression] = rows
    return ca.vertcat(*pieces)


def _observed(plant: Plant, observe: Update | None, x: Expression, params: Mapping[str, object]) -> Expression:
    return x if observe is None else called(observe, 0.0, x, ca.SX.zeros(len(plant.inputs)), params)


def _check(plant: Plant, update: Update, observe: Update | None, params: Mapping[str, object]) -> None:
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", len(plant.inputs))
    ends = ((0.4, 0.9), (-0.8, -0.3), (0.7, -0.6), (0.0, 0.0), (1e-3, 30.0))
    points = [
        (0.3 * i, np.linspace(*ends[i], x.numel()), np.linspace(*ends[i - 1], u.numel())) for i in range(len(ends))
    ]
    for what, f, named in (("update", update, plant.states), ("output", observe, plant.outputs)):
        if f is None:
            continue
        try:
            value = called(f, t, x, u, params)
            numeric = ca.Function(what, [t, x, u], [value])
            seen = np.array([numeric(*point).full().ravel() for point in points])
            plain = np.array(
                [np.ravel(np.array(f(at, z.copy(), v.copy(), params), dtype=float)) for at, z, v in points]
            )
        except Exception as error:  # whatever a function of somebody else raises for symbols
            reason = " ".join(str(error).split())[:120]
            raise InvalidValue(
                f"the {what} function must work on CasADi symbols, got {type(error).__name__}: {reason}; "
                "write it with casadi.sin, casadi.if_else and so on"
            ) from None
        if value.shape != (len(named), 1):
            raise InvalidValue(f"the {what} function must give {len(named)} value(s), got shape {value.shape}")
        alike = np.isclose(seen, plain, rtol=1e-9, atol=1e-12, equal_nan=True).all(axis=1)
        if not alike.all() or np.isnan(seen).all():
            bad = int(np.argmin(alike))
            raise InvalidValue(
                f"the {what} function must give the same for CasADi symbols and for numbers, got {seen[bad].tolist()} "
                f"and {plain[bad].tolist()}: write it with casadi.sin, casadi.if_else and so on"
            )
        if f is observe and ca.depends_on(value, u):
            raise InvalidValue(
                "an output must depend on the state alone, got one that the input reaches at once "
                "(direct feed-through): let it act a sample later, or put a lag behind it"
            )
        if f is observe and ca.depends_on(value, t):
            raise InvalidValue("an output must depend on the state alone, got one that depends on time")
