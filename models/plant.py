"""The contract of a plant: its equations, written once, symbolically.

A plant names its states, inputs, outputs and disturbances with their units and gives ``step`` and ``output``.
Everything else (derivatives, the python-control system, compiled trials, the checks) comes from these two.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple, final

import casadi as ca

from models.function_name import function_name
from models.limits import Limits
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
        taken = [name for name in self._names if name in self.__slots__]
        if taken:
            raise InvalidValue(f"a signal may have any name but vector and _names, got {taken[0]!r}: choose another")

    def __getattr__(self, name: str) -> Any:
        if name == "_names":  # not there yet, as in a copy that is being made
            raise AttributeError(name)
        if name in self._names:
            return self.vector[self._names.index(name)]
        for index, own in enumerate(self._names):
            if own.startswith("__") and name.endswith(own) and name[0] == "_":  # what a class makes of x.__name
                return self.vector[index]
        if name.startswith("__"):
            raise AttributeError(name)
        known = ", ".join(self._names) or "none"
        raise InvalidValue(f"there is no signal {name!r} here; the signals are: {known}")

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


class FirstEffect(NamedTuple):
    """Where an input first reaches an output of a plant."""

    degree: int
    """y(k + degree) is the first output whose expression contains u(k)."""
    slope: ca.Function
    """(x, u, w) -> (dy_du), dy(k + degree)/du(k); it takes k too where none was chosen.

    The columns of u (nu, degree) and w (nw, degree) are the samples k, ..., k + degree - 1.
    """
    shown: bool
    """Whether two values of u(k) were found between which y(k + degree) differs by more than rounding.

    Where it is False, u(k) may cancel in the expression, or act only far from the points that were tried.
    """

    @property
    def slope_at_rest(self) -> float:
        """The slope where states, inputs and disturbances (and k, where none was chosen) are zero."""
        return float(self.slope()["dy_du"])


class Plant(ABC):
    """A discrete-time plant ``x(k+1) = step(x(k), u(k), w(k), k)``, ``y(k) = output(x(k))``.

    A subclass is a :func:`models.quantity.declared` dataclass whose fields are quantities with units. It names
    its signals and gives ``step`` and ``output``; both must work on SX, MX and DM alike, and return the values
    in the order of the signals. Nothing else is meant to be overridden, but for ``applied`` and ``input_limits`` by
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

    @property
    def input_limits(self) -> Limits:
        """What limits the inputs, however it was given: nothing, unless an actuator's wrapper says so."""
        return Limits()

    @final
    @property
    def name(self) -> str:
        """The plant's name: that of its class, in lower case."""
        return type(self).__name__.lower()

    @final
    def _function(self, what: str, given: dict[str, Any], gives: dict[str, Any]) -> ca.Function:
        """Return a CasADi Function named after the plant and what it is, its ports by name."""
        name = f"{function_name(self.name)}_{what}"
        return ca.Function(name, [*given.values()], [*gives.values()], [*given], [*gives])

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
        return self._function("step", at, {"x_next": self.next_state(**at)})

    @final
    def output_function(self) -> ca.Function:
        """Return ``output`` as a CasADi Function (x) -> (y)."""
        x = _column("x", self.states)
        return self._function("output", {"x": x}, {"y": self.measured(x)})

    @final
    def next_output_function(self) -> ca.Function:
        """Return y(k+1) as a CasADi Function (x, u, w, k) -> (y_next) of the sample k."""
        at = self.symbols()
        return self._function("next_output", at, {"y_next": self.measured(self.next_state(**at))})

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
        label = f"d{of}_d{function_name(by.replace('.', '_'))}"
        return self._function(label, at, {label: slope})

    @final
    def relative_degree(
        self, limit: int = 200, *, k: int | None = None, output: str | None = None, input: str | None = None
    ) -> int | None:
        """Return the smallest d for which y(k+d) depends on u(k); None where no d up to ``limit`` does.

        It is read off the equations (1 without dead time) as :meth:`first_effect` does, where the arguments are
        told, and what a structural answer leaves open.
        """
        found = self.first_effect(limit, k=k, output=output, input=input)
        return found.degree if found else None

    @final
    def first_effect(
        self, limit: int = 200, *, k: int | None = None, output: str | None = None, input: str | None = None
    ) -> FirstEffect | None:
        """Return where an input first reaches an output and with which slope; None where no d up to ``limit`` does.

        ``output`` and ``input`` name signals (the first ones by default); ``k`` is the sample from which on the
        equations are followed, a whole number. Without it the answer is the smallest degree over all samples, which
        a plant that varies with time may have at some of them only.

        The answer is structural: y(k+d) is composed from ``step`` and searched for u(k). What does not contain u(k)
        does not depend on it, at any state, so the true degree is never smaller. It may be larger where u(k) stands
        in the expression but cancels, as in ``(x + u)**2 - x**2 - 2*x*u - u**2`` (CasADi folds only what is plain,
        such as ``u - u``): see :attr:`FirstEffect.shown`. Raises InvalidValue for an unknown signal and for a k
        that is not whole.
        """
        row = _position(self.outputs, output, "output")
        column = _position(self.inputs, input, "input")
        if k is not None and (isinstance(k, bool) or not isinstance(k, int)):
            raise InvalidValue(f"k must be a whole number, or left out for every sample, got {k!r}")
        at = self.symbols()
        x, first, inputs, disturbances = at["x"], at["u"], [at["u"]], [at["w"]]
        sample = at["k"] if k is None else ca.SX(k)
        for degree in range(1, limit + 1):
            x = self.next_state(x, inputs[-1], disturbances[-1], sample + degree - 1)
            y = self.measured(x)[row]
            if ca.depends_on(y, first[column]):
                given = {"x": at["x"], "u": ca.horzcat(*inputs), "w": ca.horzcat(*disturbances)}
                given |= {"k": at["k"]} if k is None else {}
                slope = self._function("slope", given, {"dy_du": ca.jacobian(y, first[column])})
                reached = ca.Function("reached", [*given.values()], [y], list(given), ["y"])
                return FirstEffect(degree, slope, _differs(reached, column))
            inputs.append(ca.SX.sym("later_u", len(self.inputs)))
            disturbances.append(ca.SX.sym("later_w", len(self.disturbances)))
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


def _position(named: Sequence[Signal], name: str | None, what: str) -> int:
    """Return where a signal stands among its like, the first where no name was given."""
    names = [signal.name for signal in named]
    if not names or (name is not None and name not in names):
        raise InvalidValue(f"{what} must be one of: {', '.join(names) or 'none, the plant has none'}; got {name!r}")
    return 0 if name is None else names.index(name)


def _differs(reached: ca.Function, column: int) -> bool:
    """Tell whether y = reached(x, u, w[, k]) was seen to change with u[column, 0].

    States, inputs and disturbances are small whole numbers, whose sums and products are exact: what cancels does.
    """
    for whole in (0, 1):
        point = {
            name: whole * ca.reshape(ca.DM(range(1, rows * columns + 1)), rows, columns)
            for name, (rows, columns) in zip(
                reached.name_in(), map(reached.size_in, range(reached.n_in())), strict=True
            )
        }
        point["u"][column, 0] = 0
        without = float(reached(**point)["y"])
        for size in (1, -1, 1000, -1000):
            point["u"][column, 0] = size
            change = abs(float(reached(**point)["y"]) - without)
            if 1e-12 * max(size**2, without**2) < change < math.inf:
                return True
    return False
