"""A tube for any plant with one input and one output, from what a law is told of its task."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.expression import Number
from models.following import following
from models.plant import Plant
from models.quantity import InvalidValue, declared, quantity
from workbench.contracts.law import Seen, Task
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.tube import Tube
from workbench.predictive.view import View
from workbench.sets import Polytope, Zonotope


class Along(View):
    """The deviation of a plant from the states and inputs with which its nominal model follows the reference."""

    def __init__(self, states: Array, inputs: Array, delay: int, limits: tuple[float, float]) -> None:
        self.states, self.inputs, self.delay, self.limits = states, inputs, delay, limits

    def state(self, seen: Seen, acted: float) -> Array:
        """Return x(k) - x_s(k) and the input's deviation that acted last; states of an actuator are left aside."""
        return np.append(seen.x[: len(self.states)] - self.states[:, seen.k], acted)

    def reference(self, k: int) -> Array:
        """Return zeros: the model is one of deviations."""
        return np.zeros(len(self.states) + 1)

    def feed(self, k: int) -> float:
        """Return the nominal input that should act when this one does."""
        return float(self.inputs[min(k + self.delay, self.inputs.size - 1)])

    def limited(self, k: int, v: float) -> float:
        """Return v, cut at the limits of the input."""
        low, high = self.limits
        return min(max(v, low - self.feed(k)), high - self.feed(k))

    @property
    def before(self) -> float:
        """The deviation of no input: it matters only where inputs are on their way."""
        return -float(self.inputs[0]) if self.delay else 0.0


class _Nominal(NamedTuple):
    """How the nominal model follows the reference, and its linearisation in the middle of it."""

    states: Array
    inputs: Array
    A: Array
    B: Array
    c: Array


@declared
class Design:
    """Weights and bounds from which a tube is designed for a task, relative to its reference and limits.

    The nominal model is inverted along the reference and linearised in its middle; the tube is one of the deviations
    from there, its states those of the model and the last input. A dead time is what the plant behind its actuator
    needs more samples for than the model; a lag and a limited rate of the actuator are left to the bound on what the
    model does not foresee, as is what the linearisation misses.
    """

    unknown: float | None = quantity(
        default=None,
        unit="output units",
        doc="largest change of the output over a sample that the model does not foresee; null: 2 % of the reference's",
        above=0,
        optional=True,
        structural=True,
    )
    deviation: float = quantity(
        default=0.5, unit="1", doc="largest error of a state, a share of its largest value", above=0, structural=True
    )
    input_weight: float = quantity(
        default=1.0,
        unit="1",
        doc="R of an increment as large as half the input's range, beside 1 for a state as large as its largest",
        above=0,
        structural=True,
    )

    def designed(self, task: Task) -> tuple[Tube, View]:
        """Return a tube and how it sees the plant. Raises InvalidValue, in one line, where there is none."""
        model = task.model
        if model is None:
            raise InvalidValue("a tube needs a nominal model, the task names none: give the law a tube and a view")
        if (len(model.inputs), len(model.outputs)) != (1, 1):
            raise InvalidValue(
                f"a tube is designed for one input and one output, {model.name} has {len(model.inputs)} and "
                f"{len(model.outputs)}: give the law a tube and a view"
            )
        lower, upper = _number(task.limits.lower), _number(task.limits.upper)
        if not (math.isfinite(lower) and math.isfinite(upper)):
            raise InvalidValue(
                f"a tube needs limits of {model.inputs[0].name}, got [{lower:g}, {upper:g}]: "
                "set actuator.lower and actuator.upper"
            )
        reference = ca.DM(task.reference).full()
        degree = task.relative_degree or 1
        try:
            hash(model)
        except TypeError:  # a plant that holds arrays is designed for anew every time
            return self._designed(model, lower, upper, degree, tuple(reference[0].tolist()))
        return _designed_once(self, model, lower, upper, degree, tuple(reference[0].tolist()))

    def _designed(
        self, model: Plant, lower: float, upper: float, degree: int, samples: tuple[float, ...]
    ) -> tuple[Tube, View]:
        reference = np.array([samples])
        nominal = _nominal(model, reference)
        least, most = lower - nominal.inputs.min(), upper - nominal.inputs.max()
        if not least < 0 < most:
            unit = model.inputs[0].unit
            raise InvalidValue(
                f"a tube needs room round the inputs that follow the reference, {nominal.inputs.min():.4g} to "
                f"{nominal.inputs.max():.4g} {unit}, the limits are {lower:.4g} and {upper:.4g} {unit}: "
                "widen them, or ask for a slower reference"
            )
        delay = max(0, degree - (model.relative_degree() or 1))
        tube = self._tube(model, nominal, (least, most), reference, (upper - lower) / 2, delay)
        return tube, Along(nominal.states, nominal.inputs, delay, (lower, upper))

    def refusal(self, law: str, task: Task) -> str | None:
        """Return in one line why no tube can be designed for a law, or None."""
        try:
            self.designed(task)
        except InvalidValue as error:
            return f"{law}: {error}"
        return None

    def _tube(
        self, model: Plant, nominal: _Nominal, room: tuple[float, float], reference: Array, half: float, delay: int
    ) -> Tube:
        n = len(nominal.A)
        names = (*(signal.name for signal in model.states), model.inputs[0].name)
        A, b = np.eye(n + 1), np.append(nominal.B, 1.0)
        A[:n, :n], A[:n, n] = nominal.A, nominal.B
        gain = float(nominal.c @ nominal.B)
        unknown = self.unknown if self.unknown is not None else 0.02 * float(np.abs(np.diff(reference)).max())
        push = np.append(nominal.B / gain, 0.0)
        sizes = np.abs(nominal.states).max(axis=1)
        sizes[sizes == 0] = 1.0
        reach = self.deviation * sizes
        try:
            return Tube.from_lqr(
                plant=DelayedPlant(A=A, b=b, W=Zonotope.segment(push, -unknown, unknown), delay=delay, names=names),
                bounds=Polytope.box([*(-reach), room[0]], [*reach, room[1]], names=names),
                Q=np.diag([*(1 / sizes**2), 0.0]),
                R=self.input_weight / half**2,
            )
        except InvalidValue as error:
            unit = model.outputs[0].unit
            raise InvalidValue(
                f"no tube keeps {model.name} within its bounds where the model may miss {unknown:.3g} {unit} a sample: "
                f"{error}"
            ) from None


@lru_cache(maxsize=8)
def _designed_once(
    design: Design, model: Plant, lower: float, upper: float, degree: int, samples: tuple[float, ...]
) -> tuple[Tube, View]:
    return design._designed(model, lower, upper, degree, samples)


def _number(value: Number) -> float:
    return float(ca.DM(value))


def _nominal(model: Plant, reference: Array) -> _Nominal:
    """Return states (n, N + 1) and inputs (N,) that follow a reference (1, N + 1), and the model between them."""
    step, measure = model.step_function(), model.output_function()
    x, w = ca.SX.sym("x", len(model.states)), np.zeros(len(model.disturbances))
    slope = ca.Function("slope", [x], [ca.jacobian(measure(x), x)])
    begin = np.zeros(len(model.states))
    c = slope(begin).full().ravel()
    if c @ c > 0:  # the smallest state from which the output begins on the reference, where it is linear in it
        begin = c * float(reference[0, 0] - float(measure(begin))) / float(c @ c)
    inputs = following(model, reference, begin)[0]
    states = [begin]
    for k, u in enumerate(inputs):
        states.append(step(states[-1], u, w, k).full().ravel())
    middle = inputs.size // 2
    at = (states[middle], inputs[middle], w, middle)
    A, B = (model.derivative(by)(*at).full() for by in ("x", "u"))
    return _Nominal(np.array(states).T, inputs, A, B[:, 0], slope(states[middle]).full().ravel())


def made_ready(tube: Tube | None, view: View | None, design: Design, task: Task) -> tuple[Tube, View]:
    """Return tube and view of a law: its own, or where it has none those designed for a task.

    Raises InvalidValue where one is given without the other, or none can be designed.
    """
    if tube is None and view is None:
        return design.designed(task)
    return tubed(tube), seeing(view)


def tubed(tube: Tube | None) -> Tube:
    """Return a law's tube. Raises InvalidValue where it has none."""
    if tube is None:
        raise InvalidValue("tube must be given, got None: it is designed by ready_for(task), or given with a view")
    return tube


def seeing(view: View | None) -> View:
    """Return a law's view. Raises InvalidValue where it has none."""
    if view is None:
        raise InvalidValue("view must be given beside a tube that is given, got None: it says how the plant is seen")
    return view
