"""The recorder: signals declared once, and turned into a Dataset in one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from models.array import Array
from models.plant import Signal
from workbench.contracts.law import AnyLaw
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.contracts.study import Study

CONTROLLER, TRIAL, SAMPLE, OUTPUT, INPUT = "controller", "trial", "sample", "output_name", "input_name"


class _Channels(NamedTuple):
    """Some signals that are recorded together: with an axis of their names where there are several."""

    axis: str
    signals: Sequence[Signal]

    @property
    def axes(self) -> tuple[str, ...]:
        return (self.axis,) if len(self.signals) > 1 else ()

    @property
    def unit(self) -> str:
        """The unit of all, or where to find the unit of each."""
        units = list(dict.fromkeys(signal.unit for signal in self.signals))
        return units[0] if len(units) == 1 else f"see {self.axis.removesuffix('_name')}_unit"

    def about(self, what: str, alone: str | None = None) -> dict[str, str]:
        """Return units and description; ``alone`` describes a single signal, with its own words in braces."""
        if len(self.signals) == 1:
            (one,) = self.signals
            return {"units": self.unit, "long_name": (alone or what + "{}").format(one.doc or one.name)}
        return {"units": self.unit, "long_name": what.strip(" :") or self.axis.removesuffix("_name")}

    def shaped(self, rows: Array) -> Array:
        """Return rows (..., channels, samples) without the axis of the channels where there is one channel."""
        return rows if len(self.signals) > 1 else rows[..., 0, :]


class Recorder:
    """The arrays of ``run.nc`` while a campaign runs."""

    def __init__(self, study: Study, laws: Mapping[str, AnyLaw], inputs: Sequence[TrialInput]) -> None:
        self.study, self.laws, self.inputs = study, laws, inputs
        self.plant, self.names = study.plant_that_runs, list(study.controllers)
        self.outputs = _Channels(OUTPUT, self.plant.outputs)
        self.ins = _Channels(INPUT, self.plant.inputs)
        self.kept = [(i, signal) for i, signal in enumerate(self.plant.states) if signal.recorded]
        self.told = tuple(dict.fromkeys(signal for law in laws.values() for signal in law.tells))
        n, ny, nu = study.horizon, len(self.plant.outputs), len(self.plant.inputs)
        sizes = {"output": ny, "error": ny, "input": nu, "applied": nu, "ppd_estimate": ny * nu}
        sizes |= {f"state_{signal.name}": 1 for _, signal in self.kept}
        sizes |= {f"law_{signal.name}": 1 for signal in self.told}
        lead = (len(self.names), study.trials)
        # in one block: large memory is handed out in large pages
        block = np.empty((sum(sizes.values()), *lead, n + 1))  # written once: by a trial, or as missing at the end
        ends = np.cumsum([0, *sizes.values()])
        self.rows: dict[str, Array] = {
            name: np.moveaxis(block[ends[i] : ends[i + 1]], 0, 2) for i, name in enumerate(sizes)
        }
        self.taken = np.zeros(lead, dtype=bool)
        self.mse = np.full((*lead, ny), np.nan)
        self.lengths = np.full(lead, -1)
        self.diverged = np.full(len(self.names), np.nan)
        self.stopped = np.full(len(self.names), "", dtype=object)

    def take(self, name: str, trial: int, left: TrialRecord, reason: str | None) -> None:
        """Take one trial of a controller."""
        at, plant, r = (self.names.index(name), trial), self.plant, self.study.reference_samples
        end = left.length + 1
        rows = self.rows
        rows["output"][at] = left.y
        np.subtract(r, left.y, out=rows["error"][at])
        applied = left.applied if left.applied.shape[0] else left.u
        self.taken[at] = True
        _write(rows["input"][at], left.u)
        _write(rows["applied"][at], applied[:, : end - 1])
        for i, signal in self.kept:
            _write(rows[f"state_{signal.name}"][at], left.x[i : i + 1, :end])
        tells = dict(zip(self.laws[name].tells, left.told, strict=True))
        for signal in self.told:
            _write(rows[f"law_{signal.name}"][at], tells[signal][None, :] if signal in tells else _NOTHING)
        _write(rows["ppd_estimate"][at], left.estimate if left.estimate.size else _NOTHING)
        self.mse[at] = left.mse
        self.lengths[at] = left.length
        if left.note and not self.stopped[at[0]]:
            self.stopped[at[0]] = f"trial {trial + 1}, {left.note}" if plant.ends is False else left.note
        if reason:
            self.diverged[at[0]] = trial + 1
            said = f"; {left.note}" if left.note else ""
            self.stopped[at[0]] = f"diverged at trial {trial + 1}: {reason}{said}"

    def refuse(self, refused: Mapping[str, str]) -> None:
        """Note the controllers that did not run, and why."""
        for name, reason in refused.items():
            self.stopped[self.names.index(name)] = f"refused: {reason}"

    def dataset(self) -> xr.Dataset:
        """Return what was taken as a Dataset with units."""
        for rows in self.rows.values():
            rows[~self.taken] = np.nan
        variables = {**self._tracking(), **self._within(), **self._met(), **self._ends()}
        return xr.Dataset(variables, self._coordinates())

    def _tracking(self) -> dict[str, xr.Variable]:
        axes, outs, ins = (CONTROLLER, TRIAL), self.outputs, self.ins
        r = self.study.reference_samples.copy()
        return {
            "reference": _variable((*outs.axes, SAMPLE), outs.shaped(r), outs.about("reference ")),
            "output": _variable((*axes, *outs.axes, SAMPLE), outs.shaped(self.rows["output"]), outs.about("")),
            "error": _variable(
                (*axes, *outs.axes, SAMPLE), outs.shaped(self.rows["error"]), outs.about("reference minus ")
            ),
            "input": _variable((*axes, *ins.axes, SAMPLE), ins.shaped(self.rows["input"]), ins.about("")),
            "applied": _variable(
                (*axes, *ins.axes, SAMPLE), ins.shaped(self.rows["applied"]), ins.about("behind the actuator: ")
            ),
        }

    def _within(self) -> dict[str, xr.Variable]:
        axes = (CONTROLLER, TRIAL, SAMPLE)
        found = {
            f"{kind}_{signal.name}": _variable(axes, self.rows[f"{kind}_{signal.name}"][:, :, 0], _about(signal))
            for kind, named in (("state", [signal for _, signal in self.kept]), ("law", self.told))
            for signal in named
        }
        estimate, outs, ins = self.rows["ppd_estimate"], self.outputs, self.ins
        units = [f"({y.unit})/({u.unit})" for y in outs.signals for u in ins.signals]
        shape = (*estimate.shape[:2], *(len(one.signals) for one in (outs, ins) if one.axes), estimate.shape[-1])
        about = "estimate of the pseudo partial derivative used for the input"
        unit = units[0] if len(set(units)) == 1 else "output_unit/input_unit"
        found["ppd_estimate"] = _variable(
            (CONTROLLER, TRIAL, *outs.axes, *ins.axes, SAMPLE),
            np.reshape(estimate, shape),
            {"units": unit, "long_name": about},
        )
        return found

    def _met(self) -> dict[str, xr.Variable]:
        """Return what the trials met: noise and disturbances, one zero where there are none, and the true plant."""
        noisy = self.study.scenario.noise.bound(self.study.plant).any()
        noise = np.stack([one.noise for one in self.inputs]) if noisy else None
        found = {"noise": _met(noise, self.outputs, "noise on the measured outputs: ")}
        bounds = self.study.scenario.disturbance.bound(self.study.plant)
        for i, signal in enumerate(self.plant.disturbances):
            drawn = [one.w[i] for one in self.inputs]
            name, about = f"disturbance_{signal.name}", _about(signal)
            if bounds[i].any():
                rows = np.full((len(drawn), self.study.horizon + 1), np.nan)
                rows[:, :-1] = drawn
                found[name] = _variable((TRIAL, SAMPLE), rows, about)
            else:
                found[name] = _variable((), np.array(0.0), about)
        for name, factors in self.study.factors().items():
            about = {"units": "1", "long_name": f"true {name} over the declared one"}
            found[f"truth_{name}"] = _variable((TRIAL,), factors, about)
        return found

    def _ends(self) -> dict[str, xr.Variable]:
        about = {"units": "samples", "long_name": "last sample that was reached"}
        if self.plant.ends:
            lengths = _variable((CONTROLLER, TRIAL), self.lengths, about)
        else:
            lengths = _variable((TRIAL,), np.array([one.length for one in self.inputs]), about)
        units = list(
            dict.fromkeys("1" if signal.unit == "1" else f"({signal.unit})^2" for signal in self.plant.outputs)
        )
        several = len(self.plant.outputs) > 1
        return {
            "trial_length": lengths,
            "mse": _variable(
                (CONTROLLER, TRIAL, *self.outputs.axes),
                self.mse if several else self.mse[:, :, 0],
                {
                    "units": units[0] if len(units) == 1 else "output_unit^2",
                    "long_name": "mean square error over samples 1..trial_length",
                },
            ),
            "diverged_at_trial": _variable(
                (CONTROLLER,),
                self.diverged,
                {"units": "1", "long_name": "trial at which the controller diverged, NaN where it did not"},
            ),
            "stopped": _variable(
                (CONTROLLER,),
                self.stopped.astype(str),
                {"units": "", "long_name": "why a controller was refused or stopped, empty where it ran to the end"},
            ),
        }

    def _coordinates(self) -> dict[str, xr.Variable]:
        study, n = self.study, self.study.horizon
        step = float(self.plant.sampling_time)
        coordinates = {
            CONTROLLER: _variable((CONTROLLER,), np.array(self.names), {"units": "", "long_name": "controller"}),
            TRIAL: _variable((TRIAL,), np.arange(1, study.trials + 1), {"units": "1", "long_name": "trial"}),
            SAMPLE: _variable((SAMPLE,), np.arange(n + 1), {"units": "1", "long_name": "sample"}),
            "time": _variable((SAMPLE,), np.arange(n + 1) * step, {"units": "s", "long_name": "time in the trial"}),
        }
        for one in (self.outputs, self.ins):
            if one.axes:
                what = one.axis.removesuffix("_name")
                about = {"units": "", "long_name": f"name of the {what}"}
                coordinates[one.axis] = _variable((one.axis,), np.array([s.name for s in one.signals]), about)
                about = {"units": "", "long_name": f"unit of the {what}"}
                coordinates[f"{what}_unit"] = _variable((one.axis,), np.array([s.unit for s in one.signals]), about)
        return coordinates


_NOTHING: Array = np.zeros((1, 0))


def _write(row: Array, values: Array) -> None:
    """Write values (channels, n) into a row (channels, N + 1); what they do not reach is missing."""
    reached = values.shape[-1]
    row[:, :reached] = values
    row[:, reached:] = np.nan


def _variable(axes: tuple[str, ...], values: NDArray[np.generic], attributes: Mapping[str, str]) -> xr.Variable:
    return xr.Variable(axes, values, dict(attributes))


def _met(drawn: Array | None, channels: _Channels, what: str) -> xr.Variable:
    if drawn is None:
        return _variable((), np.array(0.0), channels.about(what))
    return _variable((TRIAL, *channels.axes, SAMPLE), channels.shaped(drawn), channels.about(what))


def _about(signal: Signal) -> dict[str, str]:
    return {"units": signal.unit, "long_name": signal.doc or signal.name}
