"""The design of the stopping study: what shapes its tubes, and the tubes made of it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from models.array import Array
from models.brake import Brake
from models.braking_curve import BrakingCurve
from models.quantity import InvalidValue, count, declared, quantity, switch
from studies.stopping.brake_model import STATES, BrakeModel, Method, brake_model
from workbench.predictive import DelayedPlant, DisturbanceModel, Tube
from workbench.sets import Polytope, Zonotope, spectral_radius


@declared
class Config:
    """Range of the command, weights of the cost, bounds of the error, and the weights that the tube's gain is for."""

    low: float = quantity(default=0.0, unit="1", doc="least command", structural=True)
    high: float = quantity(default=1.0, unit="1", doc="largest command", structural=True)
    speed_weight: float = quantity(default=1.0, unit="s^2/m^2", doc="Q of the speed error", least=0, structural=True)
    position_weight: float = quantity(
        default=3.0, unit="1/m^2", doc="Q of the position error", least=0, structural=True
    )
    input_weight: float = quantity(default=10.0, unit="1", doc="R of the increment", above=0, structural=True)
    gain_speed_weight: float | None = quantity(
        default=None, unit="s^2/m^2", doc="the same for the tube's gain; null: of the cost", optional=True, least=0
    )
    gain_position_weight: float | None = quantity(
        default=None, unit="1/m^2", doc="the same for the tube's gain; null: of the cost", optional=True, least=0
    )
    gain_input_weight: float | None = quantity(
        default=None, unit="1", doc="the same for the tube's gain; null: of the cost", optional=True, above=0
    )
    speed_bound: float = quantity(default=2.0, unit="m/s", doc="largest speed error", above=0, structural=True)
    position_bound: float = quantity(default=12.0, unit="m", doc="largest position error", above=0, structural=True)

    def check(self) -> None:
        """Raise InvalidValue unless the range of the command is in order."""
        if not self.low < self.high:
            raise InvalidValue(f"low must be below high, got low {self.low:g} and high {self.high:g}")

    @property
    def Q(self) -> Array:
        """Weight of the error, shape (4, 4)."""
        return np.diag([0.0, 0.0, self.speed_weight, self.position_weight])

    @property
    def gain_Q(self) -> Array:
        """Weight of the error that the tube's gain is for, shape (4, 4)."""
        own = (self.gain_speed_weight, self.gain_position_weight)
        speed, position = (
            cost if value is None else value
            for value, cost in zip(own, (self.speed_weight, self.position_weight), strict=True)
        )
        return np.diag([0.0, 0.0, speed, position])

    @property
    def gain_R(self) -> float:
        """Weight of the increment that the tube's gain is for."""
        return self.input_weight if self.gain_input_weight is None else self.gain_input_weight


CONFIGS = {
    "A": Config(gain_speed_weight=1.0, gain_position_weight=0.01, gain_input_weight=100.0),
    "B": Config(low=-1.0),
}
"""A: a slow gain for the tube beside the cost's; B: the command may also drive, one gain for both."""


@declared
class Range:
    """The resistances that the sets allow for: W = E [low, high]."""

    low: float = quantity(default=-0.06, unit="m/s^2", doc="least resistance", structural=True)
    high: float = quantity(default=0.30, unit="m/s^2", doc="largest resistance", structural=True)

    def check(self) -> None:
        """Raise InvalidValue unless the range is in order."""
        if self.low > self.high:
            raise InvalidValue(f"low must be at most high, got low {self.low:g} and high {self.high:g}")


@declared
class Control:
    """Negative controls: two ways of making the tube wrong, to see the checks fail."""

    index_off_by_one: bool = switch(default=False, doc="sum the tube to the upper index that the paper prints")
    ignore_delay: bool = switch(default=False, doc="use W and X where A^l W and X_z belong")


@declared
class Resistance:
    """A random resistance in place of the line's."""

    seed: int | None = count(
        default=None, doc="seed of a random resistance inside W, by blocks of 10 m; null: the line's", optional=True
    )


@declared
class Grade:
    """What may be changed of the line."""

    last: float = quantity(
        default=-6.0, unit="per mille", doc="grade from 300 m to the stop", least=-100, most=100, structural=True
    )


@lru_cache(maxsize=16)
def make_tube(
    *,
    brake: Brake,
    curve: BrakingCurve,
    config: Config,
    model: Method,
    disturbance: Range,
    control: Control,
) -> Tube:
    """Return the tube of a stopping study; the same settings have the same one.

    Raises InvalidValue where the disturbance leaves no room: it says which bound and by how much.
    """
    linear = brake_model(brake, model)
    held = -curve.deceleration / brake.full_brake
    if not config.low < held < config.high:
        raise InvalidValue(
            f"the command that holds the reference, {held:.4g}, must lie inside ({config.low:g}, {config.high:g}); "
            "lower the deceleration"
        )
    plant = DelayedPlant(
        A=linear.A,
        b=linear.b,
        W=Zonotope.segment(linear.E, disturbance.low, disturbance.high),
        delay=brake.delay,
        names=STATES,
    )
    most = [np.inf, config.high - held, config.speed_bound, config.position_bound]
    least = [-np.inf, config.low - held, -config.speed_bound, -config.position_bound]
    return Tube.from_lqr(
        plant=plant,
        bounds=Polytope.box(least, most, names=STATES),
        Q=config.Q,
        R=config.input_weight,
        gain_Q=config.gain_Q,
        gain_R=config.gain_R,
        index_off_by_one=control.index_off_by_one,
        ignore_delay=control.ignore_delay,
    )


def direction(tube: Tube, linear: BrakeModel) -> DisturbanceModel:
    """Return what the compensating laws know of the resistance: its direction."""
    return DisturbanceModel(plant=tube.plant, E=linear.E, Q=tube.Q)


def design_document(tube: Tube, linear: BrakeModel, horizon: int) -> dict[str, object]:
    """Return the content of ``design.json``.

    Bounds are the offsets h of H e <= h on the error e = x - x_s, in the order [u+, u-, v+, v-, s+, s-]: a lower bound
    is the negative of its offset. ``rmpc`` has one list a stage i < N, ``rsmpc`` one list of i < M + N by M, with N the
    longest horizon; an M that (27) refuses is in ``refused``.
    """
    return {
        "states": list(STATES),
        "A": tube.plant.A.tolist(),
        "b": tube.plant.b.tolist(),
        "E": linear.E.tolist(),
        "delay": tube.plant.delay,
        "K": tube.K.tolist(),
        "P": tube.P.tolist(),
        "spectral_radius": spectral_radius(tube.A_cl),
        "bounds_order": ["u+", "u-", "v+", "v-", "s+", "s-"],
        "H": tube.bounds.H.tolist(),
        "x": tube.bounds.h.tolist(),
        "x_z": tube.X_z.h.tolist(),
        "rmpc": [tube.stage_bounds(i).h.tolist() for i in range(horizon)],
        "rsmpc": {
            str(M): [tube.held_stage_bounds(M, i).h.tolist() for i in range(M + horizon)] for M in range(1, horizon)
        },
        "refused": {str(M): reason for M, reason in tube.held_conflicts(horizon).items()},
    }
