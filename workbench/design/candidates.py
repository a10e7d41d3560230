"""The laws that can be compared on one plant, each with the settings that are tuned and their ranges.

Ranges follow from the plant: ``rate`` is the input that changes the output by one unit a second, ``step`` the input
that changes it by one unit a sample, both from the exact derivative dy(k+1)/du(k) of the plant without actuators.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from models.plant import Plant
from models.quantity import InvalidValue, declared, given, nested, part
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.odometry import Odometry
from workbench.controllers.palc import PALC
from workbench.controllers.pid import PID
from workbench.controllers.tracking_mpc import TrackingMPC
from workbench.controllers.variable_gain import VariableGain
from workbench.trials.settings import changed, rows

PAPER_SPEED = 26.0  # the speed that the fuzzy immune laws were made for


@declared
class Candidate:
    """A law and the ranges of the settings that are tuned."""

    law: Any = part(doc="the law, with the settings that tuning starts from")
    ranges: Mapping[str, tuple[float, float]] = given(doc="settings that are tuned, (low, high)")

    def check(self) -> None:
        """Raise InvalidValue for a range of a setting that the law does not have."""
        numbers = self._numbers()
        for name in self.ranges:
            if name not in numbers:
                raise InvalidValue(f"{type(self.law).__name__} has no number {name!r} to tune")

    @property
    def first(self) -> dict[str, float]:
        """The settings that tuning starts from, by path."""
        numbers = self._numbers()
        return {name: numbers[name] for name in self.ranges}

    def tuned(self, settings: Mapping[str, float]) -> Any:
        """Return the law with other settings, given by path (``law.alpha`` for a law within a law)."""
        return changed(self.law, nested(settings))

    def _numbers(self) -> dict[str, float]:
        return {row.path: row.value for row in rows(self.law) if isinstance(row.value, float)}


class Scale(NamedTuple):
    """What the plant and the task say about the size of things."""

    rate: float
    """Input that changes the output by one unit a second."""
    step: float
    """Input that changes the output by one unit a sample."""
    output: float
    """Output units that the fuzzy immune laws take as 1: their speeds reach 26."""
    decay: float
    """dy(k+1)/dy(k) at half the largest reference."""


def scale_of(plant: Plant, reference: Any) -> Scale:
    """Return the scales of a plant with one input; raise InvalidValue where the input does not reach the output."""
    if len(plant.inputs) != 1 or len(plant.outputs) != 1:
        raise InvalidValue(
            f"laws are compared on plants with one input and one output; {plant.name} has {len(plant.inputs)} "
            f"and {len(plant.outputs)}"
        )
    largest = float(np.abs(reference).max())
    slope = float(
        plant.derivative("u", of="y_next")([0.0] * len(plant.states), 0.0, [0.0] * len(plant.disturbances), 0)
    )
    if not slope:
        raise InvalidValue(
            f"the input of {plant.name} must reach the output within a sample: put dead time in actuator"
        )
    seen = [signal.name for signal in plant.states].index(plant.outputs[0].name) if _output_is_state(plant) else None
    decay = 1.0
    if seen is not None:
        x = [0.0] * len(plant.states)
        x[seen] = largest / 2
        decay = float(plant.derivative("x", of="y_next")(x, 0.0, [0.0] * len(plant.disturbances), 0)[seen])
    return Scale(float(plant.sampling_time) / slope, 1 / slope, max(largest, 1e-9) / PAPER_SPEED, decay)


def _output_is_state(plant: Plant) -> bool:
    return plant.outputs[0].name in [signal.name for signal in plant.states]


def _pid(s: Scale, plant: Plant) -> Candidate:
    law = PID(kp=1.0, ki=0.1, kd=0.01, input_unit=abs(s.rate))
    return Candidate(law=law, ranges={"kp": (0.01, 100.0), "ki": (1e-4, 10.0), "kd": (1e-4, 1.0)})


def _fipid(s: Scale, plant: Plant, f: str = "rules") -> Candidate:
    law = FIPID(f=f, input_unit=abs(s.rate) * s.output, output_unit=s.output)
    ranges = {"K": (0.01, 30.0), "eta": (0.01, 1.0), "ki": (1e-3, 1.0), "kd": (1e-3, 3.0)}
    return Candidate(law=law, ranges=ranges)


def _bp_fipid(s: Scale, plant: Plant) -> Candidate:
    unit = abs(s.rate) * s.output
    law = BPFIPID(input_unit=unit, output_unit=s.output)
    ranges = {"input_unit": (0.05 * unit, 50 * unit), "ki": (1e-3, 1.0), "kd": (1e-3, 3.0), "beta": (1e-5, 0.1)}
    return Candidate(law=law, ranges=ranges)


def _adaptive(law: Any, s: Scale, ts: float) -> Candidate:
    """Lambda and mu are relative to the slope b = Ts, which is what an input unit of ``rate`` makes of it."""
    ranges = {"rho": (0.01, 1.0), "lam": (0.01 * ts**2, 1e4 * ts**2), "mu": (1e-4, 10.0)}
    return Candidate(law=law(force_unit=abs(s.rate), lam=ts**2, initial_input=0.0), ranges=ranges)


def _cfdl(s: Scale, plant: Plant) -> Candidate:
    return _adaptive(CFDL, s, s.rate / s.step)


def _icfdl(s: Scale, plant: Plant) -> Candidate:
    return _adaptive(ICFDL, s, s.rate / s.step)


def _increment(s: Scale, plant: Plant) -> Candidate:
    return _adaptive(lambda **fields: Increment(q_cutoff_hz=1.0, **fields), s, s.rate / s.step)


def _pd_ilc(s: Scale, plant: Plant) -> Candidate:
    law = PD(kp=0.1, kd=0.01, force_unit=abs(s.step), initial_input=0.0)
    return Candidate(law=law, ranges={"kp": (1e-5, 1.0), "kd": (1e-6, 1.0)})


def _tracking_mpc(s: Scale, plant: Plant) -> Candidate:
    b = s.rate / s.step
    law = TrackingMPC(a=s.decay, b=b, input_unit=abs(s.rate), weight=b**2)
    return Candidate(law=law, ranges={"weight": (1e-3 * b**2, 1e4 * b**2), "smoothing": (0.01, 1.0)})


@dataclasses.dataclass(frozen=True)
class KnownPlant:
    """What a law may know of a plant that has a mass and a running resistance, in kg, N and m/s."""

    plant: Any
    speed_unit: float

    @property
    def mass(self) -> float:
        """The nominal mass in kg."""
        return float(self.plant.mass)

    @property
    def sampling_time(self) -> float:
        """The sampling time in s."""
        return float(self.plant.sampling_time)

    def running_resistance(self, v: Any) -> Any:
        """Return the resistance in N at v in m/s, at the trial's first sample."""
        return self.plant.running_resistance(v * self.speed_unit, 0)


def _known_plant(plant: Any) -> KnownPlant | None:
    if not isinstance(getattr(plant, "mass", None), float) or not hasattr(plant, "running_resistance"):
        return None
    return KnownPlant(plant, float(getattr(plant, "speed_factor", 1.0)))


def _palc(s: Scale, plant: Plant) -> Candidate:
    model = _known_plant(plant)
    law = Odometry(law=PALC(model=model), speed_unit=model.speed_unit if model else 1.0)
    ranges = {"law.alpha": (0.05, 20.0), "law.lam": (1e-3, 5.0), "law.gamma": (1e-3, 5.0)}
    return Candidate(law=law, ranges=ranges)


def _variable_gain(s: Scale, plant: Plant) -> Candidate:
    speed_unit = float(getattr(plant, "speed_factor", 1.0))
    unit = abs(s.rate) * speed_unit
    law = Odometry(law=VariableGain(initial_learning=False), speed_unit=speed_unit, input_unit=unit)
    ranges = {"law.lam_min": (0.01, 1.0), "law.steepness": (0.5, 50.0), "input_unit": (0.05 * unit, 2 * unit)}
    return Candidate(law=law, ranges=ranges)


MAKERS: dict[str, Callable[[Scale, Plant], Candidate]] = {
    "pid": _pid,
    "fipid": _fipid,
    "fipid-smooth": lambda s, plant: _fipid(s, plant, "smooth"),
    "bp-fipid": _bp_fipid,
    "tracking-mpc": _tracking_mpc,
    "cfdl": _cfdl,
    "icfdl": _icfdl,
    "pd-ilc": _pd_ilc,
    "increment": _increment,
    "palc": _palc,
    "variable-gain": _variable_gain,
}
"""How a candidate is made from the plant and its scales, by the name of its law."""


def candidates(plant: Plant, reference: Any, names: Sequence[str] | None = None) -> dict[str, Candidate]:
    """Return the candidates of some laws (all by default) on a plant, given the reference's samples.

    Raises InvalidValue for an unknown law, and for a plant that the comparison cannot take.
    """
    chosen = list(MAKERS) if names is None else list(names)
    if not chosen:
        raise InvalidValue("laws must name at least one law, got none")
    for name in chosen:
        if name not in MAKERS:
            near = difflib.get_close_matches(name, MAKERS, n=1)
            hint = f"did you mean {near[0]}?" if near else f"the laws are: {', '.join(MAKERS)}"
            raise InvalidValue(f"there is no law {name!r} to compare; {hint}")
    scale = scale_of(plant, reference)
    return {name: MAKERS[name](scale, plant) for name in chosen}
