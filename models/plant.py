"""The contract of a plant: its equations, written once, symbolically.

A plant names its states, inputs, outputs and disturbances with their units and gives ``step`` and ``output``.
Everything else (derivatives, the python-control system, compiled trials, the checks) comes from these two.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Literal, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.discretise import RK4, Integrator
from models.expression import Column, Expression, Number
from models.function_name import function_name
from models.limits import Limits
from models.named_signals import Signal as Signal
from models.named_signals import Values as Values
from models.named_signals import signal as signal
from models.named_signals import signals as signals
from models.named_signals import stacked as stacked
from models.quantity import Declaration, InvalidValue, symbolised
from models.relative_degree import FirstEffect as FirstEffect
from models.relative_degree import first_effect

if TYPE_CHECKING:
    from models.control_systems import NonlinearIOSystem, StateSpace, TransferFunction


class Plant(Declaration, ABC):
    """A plant ``x(k+1) = step(x(k), u(k), w(k), k)``, ``y(k) = output(x(k))``, sampled every ``sampling_time`` seconds.

    A subclass is a :func:`models.quantity.declared` dataclass whose fields are quantities with units. It names its
    signals and gives ``output`` and one of two: ``step``, or ``rhs`` in continuous time, which the ``integrator``
    makes a step of (a class attribute, or a field). All of these must work on SX, MX and DM alike, and return the
    values in the order of the signals. What else may be given has a neutral default: ``ended``, ``at_sample`` and,
    for an actuator's wrapper (:mod:`models.actuator`), ``applied`` and ``input_limits``.

    A class that gives neither or both of ``step`` and ``rhs`` is refused with a TypeError when it is made.
    """

    disturbances: tuple[Signal, ...] = ()
    if TYPE_CHECKING:  # read-only to whoever asks: a plant has them as fields or class attributes, or computes them

        @property
        def sampling_time(self) -> float:
            """The sampling time in s."""

        @property
        def states(self) -> tuple[Signal, ...]:
            """The states, in the order in which ``step`` returns them."""

        @property
        def inputs(self) -> tuple[Signal, ...]:
            """The inputs."""

        @property
        def outputs(self) -> tuple[Signal, ...]:
            """The outputs, in the order in which ``output`` returns them."""

    source: ClassVar[str] = ""
    integrator: Integrator = RK4()
    """What makes a step of ``rhs``; it means nothing for a plant that gives ``step``."""

    def __init_subclass__(cls, *, abstract: bool = False) -> None:
        """Raise TypeError for a class with neither or both of step and rhs, unless it is abstract: for others to be."""
        super().__init_subclass__()
        steps, flows = cls.step is not Plant.step, cls.rhs is not Plant.rhs
        if steps == flows and not abstract:
            raise TypeError(
                f"{cls.__name__} must give step(x, u, w, k) or rhs(x, u, w, t), got {'both' if steps else 'neither'}"
            )

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the next state (in the order of ``states``) from state, input, disturbance and sample index.

        Unless a plant gives it, ``rhs`` is integrated over the sample, inputs and disturbances held.
        """

        def slope(at: Expression, t: Number) -> Expression:
            return stacked(self.rhs(Values(self.states, at), u, w, t), self.states, f"{type(self).__name__}.rhs")

        after = self.integrator.advance(slope, x.vector, k * self.sampling_time, self.sampling_time)
        return self.at_sample(Values(self.states, after), x, u)

    def rhs(self, x: Values, u: Values, w: Values, t: Number) -> Column:
        """Return dx/dt (in the order of ``states``) from state, input, disturbance and time in seconds."""
        raise InvalidValue(
            f"{type(self).__name__} gives its step in discrete time, so it has no rhs: ask for next_state"
        )

    def at_sample(self, after: Values, x: Values, u: Values) -> Column:
        """Return the state at the next sample, given what ``rhs`` alone would lead to and state and input before.

        For states that stand still within a sample and change at its end, as those of a line of past commands do.
        """
        return after.vector

    @abstractmethod
    def output(self, x: Values) -> Column:
        """Return the outputs (in the order of ``outputs``) at a state."""

    def ended(self, x: Values) -> Expression | None:
        """Return what is not 0 in a state in which a trial is over; None for a plant whose trials only run out.

        ``return x.speed <= 0`` ends a trial where the vehicle stands.
        """
        return None

    def applied(self, x: Values, u: Values, k: Expression) -> Column:
        """Return the inputs that act over a sample, given those commanded; an actuator's wrapper gives others."""
        return u.vector

    @property
    def clock(self) -> Literal["samples", "seconds"]:
        """What the time counts on which the plant's own coefficients depend; references in that time ask for it."""
        return "samples"

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
    def _function(self, what: str, given: dict[str, Expression], gives: dict[str, Expression]) -> ca.Function:
        """Return a CasADi Function named after the plant and what it is, its ports by name."""
        name = f"{function_name(self.name)}_{what}"
        return ca.Function(name, [*given.values()], [*gives.values()], [*given], [*gives])

    @final
    def next_state(self, x: Expression, u: Expression, w: Expression, k: Expression) -> Expression:
        """Evaluate ``step`` on CasADi columns x (nx), u (nu), w (nw) and a scalar k; return a column (nx)."""
        values = self.step(Values(self.states, x), Values(self.inputs, u), Values(self.disturbances, w), k)
        return stacked(values, self.states, f"{type(self).__name__}.step")

    @final
    def slope(self, x: Expression, u: Expression, w: Expression, t: Number) -> Expression:
        """Evaluate ``rhs`` on CasADi columns x (nx), u (nu), w (nw) and a time t in seconds; return a column (nx).

        Raises InvalidValue for a plant that gives its step.
        """
        values = self.rhs(Values(self.states, x), Values(self.inputs, u), Values(self.disturbances, w), t)
        return stacked(values, self.states, f"{type(self).__name__}.rhs")

    @final
    def sampled(self, after: Expression, x: Expression, u: Expression) -> Expression:
        """Evaluate ``at_sample`` on CasADi columns after (nx), x (nx) and u (nu); return a column (nx)."""
        values = self.at_sample(Values(self.states, after), Values(self.states, x), Values(self.inputs, u))
        return stacked(values, self.states, f"{type(self).__name__}.at_sample")

    @final
    def measured(self, x: Expression) -> Expression:
        """Evaluate ``output`` on a CasADi column x (nx); return a column (ny)."""
        return stacked(self.output(Values(self.states, x)), self.outputs, f"{type(self).__name__}.output")

    @final
    @property
    def continuous(self) -> bool:
        """Whether the plant is given in continuous time: by its ``rhs`` and an integrator."""
        return type(self).rhs is not Plant.rhs

    @final
    @property
    def ends(self) -> bool:
        """Whether trials end by an event of the plant's own (:meth:`ended`)."""
        return self.ended(Values(self.states, _column("x", self.states))) is not None

    @final
    def ended_at(self, x: Expression) -> Expression:
        """Evaluate ``ended`` on a CasADi column x (nx); return a scalar, 0 where trials have no such event."""
        value = self.ended(Values(self.states, x))
        return stacked([0 if value is None else value], (Signal("ended", "1"),), f"{type(self).__name__}.ended")

    @final
    def applied_input(self, x: Expression, u: Expression, k: Expression) -> Expression:
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
    def relative_degrees(
        self, samples: int, limit: int = 200, *, output: str | None = None, input: str | None = None
    ) -> NDArray[np.int64]:
        """Return the smallest d for which y(k+d) depends on u(k), for each k = 0..samples-1; 0 where none does.

        It is what :meth:`relative_degree` says of each k, but found at once for all samples at which the equations
        look alike: the parts that depend on k alone (a gain, ``k >= 20``) are evaluated at all samples first. A part
        that takes many values is told apart by whether it is zero only; that it equals another part or a constant at
        some samples, so that u(k) cancels there, is not seen. ``output`` and ``input`` name signals (the first ones by
        default). Raises InvalidValue for an unknown signal and unless samples is a whole number above 0.
        """
        from models.relative_degrees import relative_degrees

        return relative_degrees(self, samples, limit, output, input)

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
        return first_effect(self, limit, k=k, output=output, input=input)

    @final
    def to_control(self) -> NonlinearIOSystem:
        """Return the plant as python-control's discrete-time ``NonlinearIOSystem`` with its signal names.

        Disturbances are appended to the inputs; the sample index is time / sampling_time.
        """
        from models.control_systems import nonlinear_system

        return nonlinear_system(self)

    @final
    @staticmethod
    def from_control(
        system: StateSpace | TransferFunction | NonlinearIOSystem,
        *,
        sampling_time: float | None = None,
        states: Sequence[str | Signal] | None = None,
        inputs: Sequence[str | Signal] | None = None,
        outputs: Sequence[str | Signal] | None = None,
        units: Mapping[str, str] | None = None,
        integrator: Integrator | None = None,
    ) -> Plant:
        """Return a plant of a python-control system, with any number of inputs and outputs.

        A ``StateSpace`` or ``TransferFunction`` in continuous time is sampled with a zero-order hold, exactly; one in
        discrete time is taken as it is. Of a ``NonlinearIOSystem`` the update and output functions are called with
        CasADi symbols; in continuous time the ``integrator`` (RK4 by default) makes a step of it.

        ``sampling_time`` in seconds is needed where the system has none. Signals are named by the system's labels
        unless names, or signals, are given; ``units`` are told by name, "1" where they are not. Raises InvalidValue
        for an output that the input reaches at once, and for functions that do not work on symbols.
        """
        from models.control_systems import plant_of

        names = {"states": states, "inputs": inputs, "outputs": outputs}
        return plant_of(system, sampling_time, names, units or {}, integrator)

    @final
    def linearised(self, x: Sequence[float], u: Sequence[float], w: Sequence[float] = (), k: int = 0) -> StateSpace:
        """Return python-control's discrete-time ``StateSpace`` of the exact linearisation at a point.

        x, u, w are the operating point (nx, nu, nw values; w defaults to zeros), k the sample index.
        """
        from models.control_systems import state_space

        return state_space(self, x, u, w, k)


def _column(name: str, named: Sequence[Signal]) -> ca.SX:
    return ca.vertcat(*(ca.SX.sym(f"{signal.name}") for signal in named)) if named else ca.SX.sym(name, 0, 1)
