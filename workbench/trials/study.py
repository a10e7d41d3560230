"""Studies made of trials: one plant, one reference, several controllers, the same random trials for all."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from models.plain_text import check_plain
from models.plant import Plant, Signal
from models.quantity import InvalidValue, count, declared, given, part, quantity, rebuilt
from models.reference import Given, Reference
from workbench.contracts.law import Law
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.contracts.study import Folded, Measures, Progress, Scores, Study
from workbench.fold.fold import Fold, build, stream
from workbench.fold.machine_code import all_compiled, compiled
from workbench.trials.drawn import AtRest, Disturbance, Initial, Noise, SpeedNoise, Undisturbed
from workbench.trials.length import TrialLength
from workbench.trials.metrics import trial_scores

NAME = r"\w[\w-]*"  # of studies and controllers: they become names of files and of settings
MOST_RECORDED = 10**8  # samples of every signal kept in memory, about 4 GB in all


@declared
class Sweep:
    """One field of some controllers varied, everything else as in the study: its last MSE is recorded."""

    field: str = given(doc="the field of the controllers")
    values: tuple[float, ...] = given(doc="its values")
    controllers: tuple[str, ...] = given(doc="names of the controllers")
    unit: str = given(default="1", doc="unit of the field")


@declared
class TrialStudy(Study):
    """Plant x reference x controllers x settings, run trial after trial.

    ``reference`` is an array of shape (N + 1,) or (outputs, N + 1), or an object with ``samples(plant)``. Every
    controller meets the same trial lengths, initial states and noise, all drawn from ``seed``. A controller
    stops early when it diverges: when a trial leaves the finite numbers, or its root mean square error exceeds
    ``divergence_factor`` times the largest reference.
    """

    name: str = given(default="study", doc="name, used for folders and reports")
    title: str = given(default="", doc="what the study is, in one line")
    source: str = given(default="", doc="paper or report that it follows")
    plant: Plant = part(doc="the plant")
    reference: Any = given(doc="what the outputs should follow")
    controllers: Mapping[str, Law] = part(doc="the controllers by name")
    trials: int = count(default=150, doc="number of trials, the first included", least=1, most=100_000)
    trial_length: TrialLength = part(default=TrialLength(law="fixed"), doc="how long trials last")
    noise: Noise = part(default=SpeedNoise(), doc="measurement noise")
    disturbance: Disturbance = part(default=Undisturbed(), doc="what disturbs the plant")
    initial: Initial = part(default=AtRest(), doc="where trials begin")
    seed: int = count(default=0, doc="seed of everything random", most=2**53)
    divergence_factor: float = quantity(
        default=1000.0,
        unit="1",
        doc="RMS error over largest reference at which a law has diverged",
        above=0,
        structural=True,
    )
    continues: bool = given(default=False, doc="whether a trial begins in the state that the last one ended in")
    sweeps: tuple[Sweep, ...] = given(default=(), doc="fields varied besides")
    scorers: tuple[Callable[[Any, xr.Dataset], Scores], ...] = given(default=(), doc="metrics beyond the common ones")
    compared: tuple[Measures, ...] = given(default=(), doc="what a comparison of laws on this plant measures besides")
    watch: Callable[[], Callable[[TrialRecord, Any], str | None]] | None = given(
        default=None, doc="makes a further watch: given a trial and the reference, why the law has diverged, or None"
    )
    drawings: Callable[[Any, xr.Dataset], Mapping[str, Callable[[], Any]]] | None = given(default=None, doc="figures")

    def check(self) -> None:
        """Raise InvalidValue where plant, reference, trial lengths and controllers do not fit together."""
        if not isinstance(self.reference, Reference):
            object.__setattr__(self, "reference", Given(values=self.reference))
        if not re.fullmatch(NAME, self.name):
            raise InvalidValue(f"name must be letters, digits, _ and -, got {self.name!r}")
        check_plain("title", self.title)
        check_plain("source", self.source, lines=True)
        if not isinstance(self.plant, Plant):
            raise InvalidValue(f"plant must be a Plant, made with its settings as in Cart(mass=80); got {self.plant!r}")
        plant = self.plant
        for signal in (*plant.states, *plant.inputs, *plant.outputs, *plant.disturbances):
            _check_signal(signal)
        plant.next_output_function()
        self.trial_length.least(self.horizon)
        recorded = len(self.controllers) * self.trials * (self.horizon + 1)
        if recorded > MOST_RECORDED:
            raise InvalidValue(
                f"trials must be fewer: {len(self.controllers)} controller(s) x {self.trials} trials x "
                f"{self.horizon + 1} samples exceed the {MOST_RECORDED:.0e} samples that a run may record"
            )
        if not self.controllers:
            raise InvalidValue("controllers must name at least one controller, got none")
        for name, law in self.controllers.items():
            if not re.fullmatch(NAME, str(name)):
                raise InvalidValue(f"controllers must have names of letters, digits, _ and -, got {name!r}")
            if not isinstance(law, Law):
                raise InvalidValue(
                    f"controllers.{name} must be a Law, made with its settings as in PD(kp=2.0); got {law!r}"
                )
            check_plain(f"controllers.{name}.source", law.source, lines=True)
            for signal in law.tells:
                _check_signal(signal)

    @cached_property
    def reference_samples(self) -> Any:
        """The reference, shape (outputs, N + 1): computed once, and nobody may write into it."""
        samples = Given(values=np.array(self.reference.samples(self.plant), dtype=float)).samples(self.plant)
        samples.flags.writeable = False
        return samples

    @property
    def horizon(self) -> int:
        """N, the last sample (T_d of the papers)."""
        return int(self.reference_samples.shape[1]) - 1

    def refusals(self) -> dict[str, str]:
        """Return why controllers do not suit this study, by name."""
        asked = {name: law.refusal(self) for name, law in self.controllers.items()}
        return {name: reason for name, reason in asked.items() if reason}

    def inputs(self) -> list[TrialInput]:
        """Return what every trial is run with, drawn from the seed: lengths, starts, disturbances, noise.

        Each of the four has its own stream, so switching one on does not change the others.
        """
        streams = [np.random.default_rng(s) for s in np.random.SeedSequence(self.seed).spawn(4)]
        n = self.horizon
        lengths = self.trial_length.draw(n, self.trials, streams[0])
        starts = self.initial.draw(self.plant, self.trials, streams[2])
        outputs = len(self.plant.outputs)
        nothing: dict[Any, Any] = {}
        return [
            TrialInput(
                int(length),
                start,
                _shared_zeros(self.disturbance.draw(self.plant, n, streams[3]), nothing),
                _shared_zeros(self.noise.draw(outputs, n + 1, streams[1]), nothing),
            )
            for length, start in zip(lengths, starts, strict=True)
        ]

    def folded(self) -> dict[str, Folded]:
        """Return what every controller is folded from, by name."""
        return {name: Folded(self.plant, law, self.horizon) for name, law in self.controllers.items()}

    def fold(self, controller: str) -> Fold:
        """Return the fold of the plant under a controller, by name."""
        return build(self.plant, self.controllers[controller], self.horizon)

    def simulate(self, progress: Progress) -> xr.Dataset:
        """Run every controller; see :class:`workbench.contracts.study.Study`.

        Raises InvalidValue where no controller suits the study.
        """
        refused = self.refusals()
        if len(refused) == len(self.controllers):
            raise InvalidValue("no controller suits this study: " + "; ".join(refused.values()))
        suited = [name for name in self.controllers if name not in refused]
        folds = {name: self.fold(name) for name in suited}
        machine = dict(zip(suited, all_compiled([folds[name].trial for name in suited]), strict=True))
        inputs = self.inputs()
        sweeps = [(sweep, name, value) for sweep in self.sweeps for name in sweep.controllers for value in sweep.values]
        record = _Record(self, inputs)
        last: dict[tuple[str, str, float], float] = {}
        with progress((len(suited) + len(sweeps)) * self.trials, self.name) as advance:
            for name in suited:
                record.fill(name, self._run(folds[name], machine[name], inputs, advance))
            for sweep, name, value in sweeps:
                law = rebuilt(self.controllers[name], {sweep.field: value})
                values = folds[name].values_of(law)
                *_, (left, reason) = self._run(folds[name], machine[name], inputs, advance, values)
                last[sweep.field, name, value] = np.nan if reason else left.mse
        record.refuse(refused)
        return record.dataset(last)

    def mse_by_trial(self, controller: str, laws: Sequence[Any]) -> list[tuple[list[float], str | None]]:
        """Run a controller with each of some laws of its class in place of its own, recording no signals.

        Returns for every law the mean square error of every trial that ran, and why it stopped there if it diverged.
        """
        fold, inputs = self.fold(controller), self.inputs()
        machine = compiled(fold.trial)
        found = []
        for law in laws:
            ran = list(self._run(fold, machine, inputs, lambda steps: None, fold.values_of(law)))
            found.append(([left.mse for left, _ in ran], ran[-1][1]))
        return found

    def _run(self, fold: Fold, machine: Any, inputs: Any, advance: Any, values: Any = None) -> Any:
        """Yield every trial's record with the reason why the law has diverged in it, or None, and stop there."""
        r, watch = self.reference_samples, self.watch() if self.watch else None
        largest = float(np.abs(r).max())
        for done, left in enumerate(
            stream(fold, r, inputs, trial=machine, values=values, carry_state=self.continues), 1
        ):
            reason = self._diverged(left.mse, largest) or (watch(left, r) if watch else None)
            yield left, reason
            if reason:
                advance(self.trials - done + 1)
                return
            advance(1)

    def _diverged(self, mse: float, largest: float) -> str | None:
        """Return why a trial with this mean square error counts as diverged, or None; ``largest``: reference."""
        if not math.isfinite(mse):
            return "the error is no longer finite"
        limit = self.divergence_factor * largest
        if math.sqrt(mse) > limit:
            return (
                f"the RMS error {math.sqrt(mse):.3g} exceeds {limit:.3g} ({self.divergence_factor:g} x the reference)"
            )
        return None

    def scores(self, data: xr.Dataset) -> Scores:
        """Return the metrics of every controller."""
        merged = trial_scores(self, data)
        for scorer in self.scorers:
            for name, metrics in scorer(self, data).items():
                merged[name].update(metrics)
        return merged

    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, as functions that draw."""
        from workbench.trials.figures import trial_figures

        return (self.drawings or trial_figures)(self, data)


def _shared_zeros(drawn: Any, shared: dict[Any, Any]) -> Any:
    """Return what was drawn, or where it is all zero one read-only array for all trials."""
    if np.asarray(drawn).any():
        return drawn
    zeros = shared.setdefault(np.shape(drawn), np.zeros(np.shape(drawn)))
    zeros.flags.writeable = False
    return zeros


class _Record:
    """The arrays of ``run.nc`` while a campaign runs."""

    def __init__(self, study: TrialStudy, inputs: list[TrialInput]) -> None:
        self.study, self.inputs = study, inputs
        self.names = list(study.controllers)
        plant, n = study.plant, study.horizon
        shape = (len(self.names), study.trials, n + 1)
        shown = {signal.name for signal in plant.outputs}
        kept = [(i, signal) for i, signal in enumerate(plant.states) if signal.recorded]
        self.hidden = [(i, signal) for i, signal in kept if signal.name not in shown]
        self.told = tuple(dict.fromkeys(signal for law in study.controllers.values() for signal in law.tells))
        self.acts = type(plant).applied is not Plant.applied
        named = self._row_names()  # in one block: large memory is handed out in large pages
        self.rows: dict[str, Any] = dict(zip(named, np.full((len(named), *shape), np.nan), strict=True))
        self.mse = np.full(shape[:2], np.nan)
        self.diverged = np.full(len(self.names), np.nan)
        self.stopped = np.full(len(self.names), "", dtype=object)

    def _row_names(self) -> list[str]:
        plant = self.study.plant
        names = ["ppd_estimate", *(f"state_{signal.name}" for _, signal in self.hidden)]
        names += [f"law_{signal.name}" for signal in self.told]
        names += [f"applied_{signal.name}" for signal in plant.inputs] if self.acts else []
        for kind, named in (("output", plant.outputs), ("error", plant.outputs), ("input", plant.inputs)):
            names += [kind if i == 0 else f"{kind}_{signal.name}" for i, signal in enumerate(named)]
        return names

    def fill(self, name: str, lefts: Any) -> None:
        """Take one controller's trials as they come."""
        at, plant, r = self.names.index(name), self.study.plant, self.study.reference_samples
        for trial, (left, reason) in enumerate(lefts):
            end = self.inputs[trial].length + 1
            for i, signal in enumerate(plant.outputs):
                suffix = "" if i == 0 else f"_{signal.name}"
                self.rows[f"output{suffix}"][at, trial] = left.y[i]
                np.subtract(r[i], left.y[i], out=self.rows[f"error{suffix}"][at, trial])
            for i, signal in enumerate(plant.inputs):
                self.rows["input" if i == 0 else f"input_{signal.name}"][at, trial, :-1] = left.u[i]
            for i, signal in self.hidden:
                self.rows[f"state_{signal.name}"][at, trial, :end] = left.x[i, :end]
            for signal, row in zip(self.study.controllers[name].tells, left.told, strict=True):
                self.rows[f"law_{signal.name}"][at, trial, :-1] = row
            for signal, row in zip(plant.inputs if self.acts else (), left.applied, strict=True):
                self.rows[f"applied_{signal.name}"][at, trial, : end - 1] = row[: end - 1]
            if left.estimate.size:
                self.rows["ppd_estimate"][at, trial, :-1] = left.estimate[0]
            self.mse[at, trial] = left.mse
            if reason:
                self.diverged[at] = trial + 1
                self.stopped[at] = f"diverged at trial {trial + 1}: {reason}"

    def refuse(self, refused: Mapping[str, str]) -> None:
        """Note the controllers that did not run, and why."""
        for name, reason in refused.items():
            self.stopped[self.names.index(name)] = f"refused: {reason}"

    def dataset(self, swept: Mapping[tuple[str, str, float], float]) -> xr.Dataset:
        """Return what was taken as a Dataset with units."""
        study = self.study
        plant, r = study.plant, study.reference_samples.copy()
        axes = ("controller", "trial", "sample")
        variables: dict[str, Any] = {}
        for i, signal in enumerate(plant.outputs):
            suffix = "" if i == 0 else f"_{signal.name}"
            variables[f"reference{suffix}"] = (("sample",), r[i], _about(signal, "reference "))
            variables[f"output{suffix}"] = (axes, self.rows[f"output{suffix}"], _about(signal, ""))
            variables[f"error{suffix}"] = (axes, self.rows[f"error{suffix}"], _about(signal, "reference minus "))
        for i, signal in enumerate(plant.inputs):
            name = "input" if i == 0 else f"input_{signal.name}"
            variables[name] = (axes, self.rows[name], _about(signal, ""))
        for _, signal in self.hidden:
            name = f"state_{signal.name}"
            variables[name] = (axes, self.rows[name], _about(signal, ""))
        for signal in self.told:
            variables[f"law_{signal.name}"] = (axes, self.rows[f"law_{signal.name}"], _about(signal, ""))
        for signal in plant.inputs if self.acts else ():
            name = f"applied_{signal.name}"
            variables[name] = (axes, self.rows[name], _about(signal, "behind the actuator: "))
        gain = f"({plant.outputs[0].unit})/({plant.inputs[0].unit})"
        lengths = np.array([one.length for one in self.inputs])
        variables |= {
            "trial_length": (("trial",), lengths, {"units": "samples", "long_name": "last sample that was reached"}),
            "ppd_estimate": (
                axes,
                self.rows["ppd_estimate"],
                {"units": gain, "long_name": "estimate of the pseudo partial derivative used for the input"},
            ),
            "mse": (
                axes[:2],
                self.mse,
                {
                    "units": " + ".join(dict.fromkeys(f"({signal.unit})^2" for signal in plant.outputs)),
                    "long_name": "mean square error over samples 1..trial_length"
                    + (", summed over outputs" if len(plant.outputs) > 1 else ""),
                },
            ),
            "diverged_at_trial": (
                axes[:1],
                self.diverged,
                {"units": "1", "long_name": "trial at which the controller diverged, NaN where it did not"},
            ),
            "stopped": (
                axes[:1],
                self.stopped.astype(str),
                {"units": "", "long_name": "why a controller was refused or stopped, empty where it ran to the end"},
            ),
        }
        for sweep in study.sweeps:
            at = f"sweep_{sweep.field}"
            last = [[swept[sweep.field, name, value] for value in sweep.values] for name in sweep.controllers]
            variables[f"{at}_mse_last"] = (
                (f"{at}_controller", at),
                np.array(last),
                {**variables["mse"][2], "long_name": f"last MSE against {sweep.field}, NaN where it diverged"},
            )
        coordinates: dict[str, Any] = {
            "controller": ("controller", self.names, {"units": "", "long_name": "controller"}),
            "trial": ("trial", np.arange(1, study.trials + 1), {"units": "1", "long_name": "trial"}),
            "sample": ("sample", np.arange(study.horizon + 1), {"units": "1", "long_name": "sample"}),
        }
        for sweep in study.sweeps:
            at = f"sweep_{sweep.field}"
            coordinates[at] = (at, list(sweep.values), {"units": sweep.unit, "long_name": sweep.field})
            coordinates[f"{at}_controller"] = (
                f"{at}_controller",
                list(sweep.controllers),
                {"units": "", "long_name": "controller"},
            )
        return xr.Dataset(variables, coordinates)


def _check_signal(signal: Signal) -> None:
    """Raise InvalidValue for a signal whose unit or description cannot be printed."""
    check_plain(f"the unit of {signal.name!r}", signal.unit)
    check_plain(f"the description of {signal.name!r}", signal.doc, lines=True)


def _about(signal: Signal, prefix: str) -> dict[str, str]:
    return {"units": signal.unit, "long_name": f"{prefix}{signal.doc or signal.name}"}
