"""Plants as python-control systems, so that its users are at home.

The only module of ``models`` that touches python-control, and only when it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from models.quantity import InvalidValue

if TYPE_CHECKING:
    from models.plant import Plant, Signal


def _names(named: Sequence[Signal], taken: Sequence[str] = ()) -> list[str]:
    return [f"{signal.name}_dist" if signal.name in taken else signal.name for signal in named]


def nonlinear_system(plant: Plant) -> Any:
    """Return ``control.nlsys`` of a plant: discrete time, named signals, disturbances after the inputs."""
    import control

    step, output = plant.step_function(), plant.output_function()
    inputs = _names(plant.inputs)
    split = len(inputs)

    def update(t: float, x: Any, u: Any, params: Any) -> Any:
        forced = np.atleast_1d(u)
        return step(x, forced[:split], forced[split:], round(t / plant.sampling_time)).full().ravel()

    def observe(t: float, x: Any, u: Any, params: Any) -> Any:
        return output(x).full().ravel()

    return control.nlsys(
        update,
        observe,
        states=_names(plant.states),
        inputs=inputs + _names(plant.disturbances, inputs),
        outputs=_names(plant.outputs),
        dt=plant.sampling_time,
        name=plant.name,
    )


def state_space(plant: Plant, x: Sequence[float], u: Sequence[float], w: Sequence[float], k: int) -> Any:
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


def zero_order_hold(numerator: Sequence[float], denominator: Sequence[float], sampling_time: float) -> Any:
    """Return ``control.StateSpace`` of a continuous transfer function under a zero-order hold: exact, discrete time.

    Coefficients are in falling powers of s.
    """
    import control

    continuous = control.ss(control.TransferFunction(list(numerator), list(denominator)))
    return control.c2d(continuous, sampling_time, method="zoh")
