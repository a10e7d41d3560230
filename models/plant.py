"""The contract of a plant: its equations, written once, symbolically.

A plant names its states, inputs, outputs and disturbances with their units and gives ``step`` and ``output``.
Everything else (derivatives, the python-control system, compiled trials, the checks) comes from these two.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple, final

import casadi as ca

from models.quantity import InvalidValue, symbolised


class Signal(NamedTuple):
    """A named signal with its unit, what it is, and whether a run records it (as a state)."""

    name: str
    unit: str
    doc: str = ""
    recorded: bool = True


def signals(**units: str | tuple[str, str]) -> tuple[Signal, ...]:
    """Name signals with their units: ``signals(speed="m/s", position=("m", "front of the vehicle"))``."""
    return tuple(Signal(name, unit) if isinstance(unit, str) else Signal(name, *unit) for name, unit in units.items())


class Values:
    """The values of some signals at one sample: by name, by position, or unpacked.

    ``x.speed``, ``x[0]`` and ``speed, position = x`` read the same CasADi vector, which is ``x.vector``.
    """

    __slots__ = ("_names", "vector")

    def __init__(self, named: Sequence[Signal], vector: Any) -> None:
        self._names = tuple(signal.name for signal in named)
        self.vector = vector

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self.vector[self._names.index(name)]
        except ValueError:
            known = ", ".join(self._names) or "none"
            raise InvalidValue(f"there is no signal {name!r} here; the signals are: {known}") from None

    def __getitem__(self, index: int) -> Any:
        return self.vector[range(len(self._names))[index]]

    def __iter__(self) -> Iterator[Any]:
        return (self.vector[index] for index in range(len(self._names)))

    def __len__(self) -> int:
        return len(self._names)


def stacked(values: Any, named: Sequence[Signal], what: str) -> Any:
    """Return what an equation gave as one column, or raise when it has the wrong size."""
    if isinstance(values, Values):
        values = values.vector
    column: Any
    try:
        if isinstance(values, (tuple, list)):
            column = ca.vertcat(*values)
        else:
            column = values if isinstance(values, (ca.SX, ca.MX, ca.DM)) else ca.DM(values)
    except (NotImplementedError, TypeError, ValueError):
        names = ", ".join(signal.name for signal in named)
        raise InvalidValue(f"{what} must give {len(named)} value(s) ({names}), got {values!r}") from None
    if tuple(column.shape) != (len(named), 1):
        names = ", ".join(signal.name for signal in named)
        raise InvalidValue(f"{what} must give {len(named)} value(s) ({names}), got shape {tuple(column.shape)}")
    return column


class Plant(ABC):
    """A discrete-time plant ``x(k+1) = step(x(k), u(k), w(k), k)``, ``y(k) = output(x(k))``.

    A subclass is a :func:`models.quantity.declared` dataclass whose fields are quantities with units. It names
    its signals and gives ``step`` and ``output``; both must work on SX, MX and DM alike, and return the values
    in the order of the signals. Nothing else is meant to be overridden, but for ``applied`` by
    an actuator's wrapper (:mod:`models.actuator`).
    """

    sampling_time: float
    states: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    disturbances: tuple[Signal, ...] = ()
    source: ClassVar[str] = ""

    @abstractmethod
    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return the next state (in the order of ``states``) from state, input, disturbance and sample index."""

    @abstractmethod
    def output(self, x: Any) -> Any:
        """Return the outputs (in the order of ``outputs``) at a state."""

    def applied(self, x: Any, u: Any, k: Any) -> Any:
        """Return the inputs that act over a sample, given those commanded; an actuator's wrapper gives others."""
        return u

    @final
    @property
    def name(self) -> str:
        """The plant's name: that of its class, in lower case."""
        return type(self).__name__.lower()

    @final
    def next_state(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Evaluate ``step`` on CasADi columns x (nx), u (nu), w (nw) and a scalar k; return a column (nx)."""
        values = self.step(Values(self.states, x), Values(self.inputs, u), Values(self.disturbances, w), k)
        return stacked(values, self.states, f"{type(self).__name__}.step")

    @final
    def measured(self, x: Any) -> Any:
        """Evaluate ``output`` on a CasADi column x (nx); return a column (ny)."""
        return stacked(self.output(Values(self.states, x)), self.outputs, f"{type(self).__name__}.output")

    @final
    def applied_input(self, x: Any, u: Any, k: Any) -> Any:
        """Evaluate ``applied`` on CasADi columns x (nx), u (nu) and a scalar k; return a column (nu)."""
        values = self.applied(Values(self.states, x), Values(self.inputs, u), k)
        return stacked(values, self.inputs, f"{type(self).__name__}.applied")

    @final
    def symbols(self) -> dict[str, ca.SX]:
        """Return SX symbols x (nx), u (nu), w (nw) and k (1) for writing expressions on this plant."""
        return {
            "x": _column("x", self.states),
            "u": _column("u", self.inputs),
            "w": _column("w", self.disturbances),
            "k": ca.SX.sym("k"),
        }

    @final
    def step_function(self) -> ca.Function:
        """Return ``step`` as a CasADi Function (x, u, w, k) -> (x_next)."""
        at = self.symbols()
        return ca.Function(f"{self.name}_step", list(at.values()), [self.next_state(**at)], list(at), ["x_next"])

    @final
    def output_function(self) -> ca.Function:
        """Return ``output`` as a CasADi Function (x) -> (y)."""
        x = _column("x", self.states)
        return ca.Function(f"{self.name}_output", [x], [self.measured(x)], ["x"], ["y"])

    @final
    def next_output_function(self) -> ca.Function:
        """Return y(k+1) as a CasADi Function (x, u, w, k) -> (y_next) of the sample k."""
        at = self.symbols()
        y_next = self.measured(self.next_state(**at))
        return ca.Function(f"{self.name}_next_output", list(at.values()), [y_next], list(at), ["y_next"])

    @final
    def derivative(self, by: str, of: str = "x_next") -> ca.Function:
        """Return the exact derivative of ``x_next`` or ``y_next`` by x, u, w or a named parameter.

        The Function maps (x, u, w, k) to an output named e.g. ``dx_next_du``, of shape (rows of ``of``,
        rows of ``by``). Parameters are named by their field, nested ones by their path (``line.length``).
        Raises InvalidValue for an unknown name.
        """
        at = self.symbols()
        plant: Plant = self
        values: tuple[float, ...] = ()
        if by in ("x", "u", "w"):
            variable = at[by]
        else:
            replaced = symbolised(self, only=frozenset({by}))
            if not replaced.names:
                known = ", ".join(symbolised(self).names)
                raise InvalidValue(f"derivative by x, u, w or one of: {known}; got {by!r}")
            plant, variable, values = replaced.thing, replaced.symbols[0], replaced.values
        if of not in ("x_next", "y_next"):
            raise InvalidValue(f"derivative of 'x_next' or 'y_next', got {of!r}")
        value = plant.next_state(**at)
        if of == "y_next":
            value = plant.measured(value)
        slope = ca.jacobian(value, variable)
        if values:
            slope = ca.substitute(slope, variable, ca.SX(values[0]))
        label = by.replace(".", "_")
        name = f"{self.name}_d{of}_d{label}"
        return ca.Function(name, list(at.values()), [slope], list(at), [f"d{of}_d{label}"])

    @final
    def relative_degree(self, limit: int = 200) -> int | None:
        """Return the smallest d for which y(k+d) of the first output depends on u(k) of the first input.

        It is read off the equations (1 without dead time); None where no d up to ``limit`` does.
        """
        at = self.symbols()
        x, u, w = at["x"], at["u"], at["w"]
        for degree in range(1, limit + 1):
            x = self.next_state(x, u, w, at["k"] + degree - 1)
            if ca.depends_on(self.measured(x)[0], at["u"][0]):
                return degree
            u, w = ca.SX.sym("later", *at["u"].shape), ca.SX.sym("later_w", *at["w"].shape)
        return None

    @final
    def to_control(self) -> Any:
        """Return the plant as python-control's discrete-time ``NonlinearIOSystem`` with its signal names.

        Disturbances are appended to the inputs; the sample index is time / sampling_time.
        """
        from models.control_systems import nonlinear_system

        return nonlinear_system(self)

    @final
    def linearised(self, x: Sequence[float], u: Sequence[float], w: Sequence[float] = (), k: int = 0) -> Any:
        """Return python-control's discrete-time ``StateSpace`` of the exact linearisation at a point.

        x, u, w are the operating point (nx, nu, nw values; w defaults to zeros), k the sample index.
        """
        from models.control_systems import state_space

        return state_space(self, x, u, w, k)


def _column(name: str, named: Sequence[Signal]) -> ca.SX:
    return ca.vertcat(*(ca.SX.sym(f"{signal.name}") for signal in named)) if named else ca.SX.sym(name, 0, 1)
