"""Plants as python-control systems and the other way round, so that its users are at home.

The only module of ``models`` that touches python-control, and only when it is asked for.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from models.array import Array
from models.quantity import InvalidValue

if TYPE_CHECKING:
    from control import NonlinearIOSystem as NonlinearIOSystem
    from control import StateSpace as StateSpace
    from control import TransferFunction as TransferFunction

    from models.discretise import Integrator
    from models.plant import Plant, Signal


def _names(named: Sequence[Signal], taken: Sequence[str] = ()) -> list[str]:
    return [f"{signal.name}_dist" if signal.name in taken else signal.name for signal in named]


def nonlinear_system(plant: Plant) -> NonlinearIOSystem:
    """Return ``control.nlsys`` of a plant: discrete time, named signals, disturbances after the inputs."""
    import control

    step, output = plant.step_function(), plant.output_function()
    inputs = _names(plant.inputs)
    split = len(inputs)

    def update(t: float, x: Array, u: Array, params: object) -> Array:
        forced = np.atleast_1d(u)
        after: Array = step(x, forced[:split], forced[split:], round(t / plant.sampling_time)).full().ravel()
        return after

    def observe(t: float, x: Array, u: Array, params: object) -> Array:
        seen: Array = output(x).full().ravel()
        return seen

    return control.nlsys(
        update,
        observe,
        states=_names(plant.states),
        inputs=inputs + _names(plant.disturbances, inputs),
        outputs=_names(plant.outputs),
        dt=plant.sampling_time,
        name=plant.name,
    )


def state_space(plant: Plant, x: Sequence[float], u: Sequence[float], w: Sequence[float], k: int) -> StateSpace:
    """Return ``control.StateSpace`` of the exact linearisation of a plant at x, u, w, k."""
    import control

    w = w if len(w) else [0.0] * len(plant.disturbances)
    for label, values, named in (("x", x, plant.states), ("u", u, plant.inputs), ("w", w, plant.disturbances)):
        if len(values) != len(named):
            raise InvalidValue(f"{label} must have {len(named)} value(s), got {len(values)}")
    inputs = _names(plant.inputs)
    state = _column("x", plant)
    c = ca.Function("dy_dx", [state], [ca.jacobian(plant.measured(state), state)])(x).full()
    a = plant.derivative("x")(x, u, w, k).full()
    b = np.hstack([plant.derivative("u")(x, u, w, k).full(), plant.derivative("w")(x, u, w, k).full()])
    return control.StateSpace(
        a,
        b,
        c,
        np.zeros((c.shape[0], b.shape[1])),
        plant.sampling_time,
        states=_names(plant.states),
        inputs=inputs + _names(plant.disturbances, inputs),
        outputs=_names(plant.outputs),
        name=f"{plant.name}_linearised",
    )


def _column(name: str, plant: Plant) -> ca.SX:
    return ca.SX.sym(name, len(plant.states))


def zero_order_hold(numerator: Sequence[float], denominator: Sequence[float], sampling_time: float) -> StateSpace:
    """Return ``control.StateSpace`` of a continuous transfer function under a zero-order hold: exact, discrete time.

    Coefficients are in falling powers of s.
    """
    import control

    continuous = control.ss(control.TransferFunction(list(numerator), list(denominator)))
    return control.c2d(continuous, sampling_time, method="zoh")


def plant_of(
    system: StateSpace | TransferFunction | NonlinearIOSystem,
    sampling_time: float | None,
    names: Mapping[str, Sequence[str | Signal] | None],
    units: Mapping[str, str],
    integrator: Integrator | None,
) -> Plant:
    """Return what :meth:`models.plant.Plant.from_control` says; ``names`` of states, inputs and outputs."""
    import control

    from models.discretise import RK4
    from models.foreign import FlowingSystem, LinearSystem, UpdatedSystem

    if not isinstance(system, (control.TransferFunction, control.NonlinearIOSystem)):
        raise InvalidValue(
            "a system must be python-control's StateSpace, TransferFunction or NonlinearIOSystem, got "
            f"{type(system).__name__}"
        )
    period = _period(system.dt, sampling_time)
    if isinstance(system, control.TransferFunction):
        system = _realised(system)
    x = _signals("states", names["states"], system.state_labels, units)
    u = _signals("inputs", names["inputs"], system.input_labels, units)
    y = _signals("outputs", names["outputs"], system.output_labels, units)
    unknown = set(units) - {one.name for one in (*x, *u, *y)}
    if unknown:
        raise InvalidValue(f"units must name signals of the system, got {', '.join(sorted(unknown))}")
    if isinstance(system, control.StateSpace):
        if np.any(system.D):
            raise InvalidValue(
                "an output must depend on the state alone, got a matrix D that is not 0 (direct feed-through): "
                "let the input act a sample later, or put a lag behind it"
            )
        sampled = control.c2d(system, period, method="zoh") if system.dt == 0 else system
        a, b, c = (tuple(map(tuple, matrix.tolist())) for matrix in (sampled.A, sampled.B, sampled.C))
        return LinearSystem(A=a, B=b, C=c, sampling_time=period, states=x, inputs=u, outputs=y)
    update, observe, params = system.updfcn, system.outfcn, dict(system.params)
    if system.dt != 0:
        return UpdatedSystem(
            update=update, observe=observe, params=params, sampling_time=period, states=x, inputs=u, outputs=y
        )
    return FlowingSystem(
        update=update,
        observe=observe,
        params=params,
        integrator=integrator or RK4(),
        sampling_time=period,
        states=x,
        inputs=u,
        outputs=y,
    )


def _period(dt: float | bool | None, sampling_time: float | None) -> float:
    """Return the sampling time of the plant of a system with the time base ``dt``."""
    if dt is None:
        raise InvalidValue("a system must have a time base: give dt=0 for continuous time or the sampling time")
    fixed = None if dt is True or dt == 0 else float(dt)
    if fixed is not None and sampling_time is not None and not math.isclose(fixed, sampling_time, rel_tol=1e-9):
        raise InvalidValue(
            f"sampling_time must be that of the system, {fixed:g} s, got {sampling_time:g}: leave it out"
        )
    period = sampling_time if fixed is None else fixed
    if period is None:
        raise InvalidValue("sampling_time must be given for a system in continuous time or without a sampling time")
    if not (isinstance(period, (int, float)) and 0 < period < math.inf):
        raise InvalidValue(f"sampling_time must lie in (0, ∞) s, got {period!r}")
    return float(period)


def _realised(system: TransferFunction) -> StateSpace:
    """Return a state space of a transfer function, that of one entry after the other."""
    import control

    a, b, c = np.zeros((0, 0)), np.zeros((0, system.ninputs)), np.zeros((system.noutputs, 0))
    for row in range(system.noutputs):
        for column in range(system.ninputs):
            numerator, denominator = (np.trim_zeros(one[row][column], "f") for one in (system.num, system.den))
            if numerator.size == 0:
                continue
            if numerator.size >= denominator.size:
                raise InvalidValue(
                    f"a transfer function must be strictly proper, got degree {numerator.size - 1} over "
                    f"{denominator.size - 1} from {system.input_labels[column]} to {system.output_labels[row]} "
                    "(direct feed-through): let the input act a sample later, or put a lag behind it"
                )
            one = control.ss(control.TransferFunction(numerator, denominator, system.dt))
            n, old = one.nstates, a.shape[0]
            a = np.block([[a, np.zeros((old, n))], [np.zeros((n, old)), one.A]])
            b, c = np.vstack([b, np.zeros((n, b.shape[1]))]), np.hstack([c, np.zeros((c.shape[0], n))])
            b[old:, column], c[row, old:] = one.B[:, 0], one.C[0]
    return control.StateSpace(
        a, b, c, np.zeros((c.shape[0], b.shape[1])), system.dt, inputs=system.input_labels, outputs=system.output_labels
    )


def _signals(
    what: str, named: Sequence[str | Signal] | None, labels: Sequence[str], units: Mapping[str, str]
) -> tuple[Signal, ...]:
    from models.named_signals import Signal as Named

    if named is None:
        named = [re.sub(r"\W+", "_", label).strip("_") for label in labels]
    if isinstance(named, str) or len(named) != len(labels):
        raise InvalidValue(f"{what} must be {len(labels)} name(s), got {named!r}")
    return tuple(Named(one, units.get(one, "1")) if isinstance(one, str) else one for one in named)
