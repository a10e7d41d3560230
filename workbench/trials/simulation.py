"""Running a study: every controller through every trial, folded laws in machine code and stepped ones in numbers."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import xarray as xr

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue, rebuilt
from models.users_code import asking
from workbench.contracts.law import AnyLaw, Task
from workbench.contracts.prepared import prepared
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.contracts.study import Progress, Study
from workbench.fold.fold import Fold, build, stream
from workbench.fold.machine_code import all_compiled, compiled
from workbench.fold.single import in_single
from workbench.fold.stepping import Stepped
from workbench.trials.record import Recorder

Outcome = tuple[TrialRecord, str | None]
"""What a trial left, and why the law has diverged in it, or None."""


class Runner:
    """One controller of a study, ready to run its trials."""

    def __init__(self, study: Study, controller: str, law: AnyLaw | None = None) -> None:
        self.study = study
        chosen = study.controllers[controller] if law is None else law
        self.task: Task = study.task(chosen)
        self.law: AnyLaw = prepared(chosen, self.task)
        self.plant, self.samples = study.plant_that_runs, study.horizon
        tops = np.abs(study.reference_samples).max(axis=1)
        self.largest = {signal.name: float(top) for signal, top in zip(self.plant.outputs, tops, strict=True)}
        kind = type(self.law)
        self._codes = (kind.start, kind.act, kind.decide, kind.ready, kind.place, kind.learn, kind.tell)
        with asking(f"the law {controller}", *self._codes):
            self._make()

    def _make(self) -> None:
        self._stepped = Stepped(self.plant, self.law, self.samples, self.task) if self.law.stepped else None
        self._fold = None if self._stepped else build(self.plant, self.law, self.samples, self.task)
        self._machine = None if self._fold is None else self._fold.trial

    @property
    def fold(self) -> Fold:
        """The fold of a folded law; raises InvalidValue for a stepped one."""
        if self._fold is None:
            raise InvalidValue(f"{type(self.law).__name__} decides in numbers, sample by sample: it has no fold")
        return self._fold

    def trials(
        self,
        inputs: Sequence[TrialInput],
        *,
        values: Sequence[float] | None = None,
        memory: tuple[Array, ...] | None = None,
        keep_memory: bool = False,
    ) -> Iterator[TrialRecord]:
        """Yield what every trial left; ``values`` replace the parameters', ``memory`` the first one."""
        carry = self.study.continues
        if self._stepped is not None:
            return self._stepped.trials(inputs, carry_state=carry, keep_memory=keep_memory, memory=memory)
        return stream(
            self.fold,
            self.study.reference_samples,
            inputs,
            trial=self._machine,
            values=values,
            carry_state=carry,
            keep_memory=keep_memory,
            memory=memory,
        )

    def judged(self, lefts: Iterator[TrialRecord]) -> Iterator[Outcome]:
        """Yield every trial with the reason why the law has diverged in it, or None, and stop there."""
        study = self.study
        watch, limits = study.watch() if study.watch else None, self.largest
        while True:
            with asking("a law of the study", *self._codes):
                left = next(lefts, None)
            if left is None:
                return
            reason = diverged(limits, study.divergence_factor, left.mse) or (
                watch(left, study.reference_samples) if watch else None
            )
            yield left, reason
            if reason:
                return


def ready(study: Study, laws: Mapping[str, AnyLaw]) -> dict[str, Runner]:
    """Return runners of some controllers by name, their folds compiled, each different one once."""
    runners = {name: Runner(study, name, law) for name, law in laws.items()}
    folded = [one for one in runners.values() if one._fold is not None]
    for one, machine in zip(folded, all_compiled([one.fold.trial for one in folded]), strict=True):
        one._machine = machine
    return runners


def ready_in_single(study: Study, laws: Mapping[str, AnyLaw]) -> dict[str, Runner]:
    """Return runners that compute in single precision, by name: of those laws that can be had in it."""
    runners: dict[str, Runner] = {}
    for name, law in laws.items():
        if not law.stepped:
            with contextlib.suppress(InvalidValue):
                runners[name] = runner_in_single(study, name, law)
    return runners


def runner_in_single(study: Study, controller: str, law: AnyLaw | None = None) -> Runner:
    """Return a runner of one controller that computes in single precision; raises InvalidValue where there is none."""
    runner = Runner(study, controller, law)
    runner._fold = in_single(runner.fold)
    runner._machine = runner._fold.trial
    return runner


def simulate(
    study: Study,
    progress: Progress,
    start: Mapping[str, tuple[Array, ...]] | None = None,
    made: Callable[[Study, Mapping[str, AnyLaw]], Mapping[str, Runner]] = ready,
) -> xr.Dataset:
    """Run every controller that suits the study and return what it did, with units.

    ``start`` holds memories to begin with, by controller. ``made`` makes the runners; a law of which it makes none does
    not run. Raises InvalidValue where no controller suits the study.
    """
    refused = study.refusals()
    suited = {name: law for name, law in study.controllers.items() if name not in refused}
    if not suited:
        raise InvalidValue("no controller suits this study: " + "; ".join(refused.values()))
    before = xr.Dataset()
    if study.tuning is not None:
        tuned = study.tuning.tuned(study, progress)
        refused, before = {**refused, **tuned.refused}, tuned.record
        suited = {name: tuned.laws[name] for name in suited if name not in refused}
    runners = made(study, suited)
    refused = {**refused, **{name: "no runner was made of it" for name in suited if name not in runners}}
    suited = {name: law for name, law in suited.items() if name in runners}
    inputs = study.inputs()
    sweeps = [(sweep, name, value) for sweep in study.sweeps for name in sweep.controllers for value in sweep.values]
    sweeps = [one for one in sweeps if one[1] in suited]
    recorder = Recorder(study, suited, inputs)
    last: dict[tuple[str, str, float], float] = {}
    with progress((len(suited) + len(sweeps)) * study.trials, study.name) as advance:
        for name, runner in runners.items():
            done = 0
            lefts = runner.trials(inputs, memory=(start or {}).get(name))
            for trial, (left, reason) in enumerate(runner.judged(lefts)):
                recorder.take(name, trial, left, explained(runner, left, reason))
                advance(1)
                done = trial + 1
            advance(study.trials - done)
        for sweep, name, value in sweeps:
            mse, reason = swept(runners[name], inputs, {sweep.field: value})
            last[sweep.field, name, value] = math.nan if reason else mse[-1]
            advance(study.trials)
    recorder.refuse(refused)
    data = _with_sweeps(study, recorder.dataset(), last)
    data = data.merge(before) if before.variables else data
    return data if study.derived is None else study.derived(study, data)


def swept(runner: Runner, inputs: Sequence[TrialInput], fields: Mapping[str, float]) -> tuple[list[float], str | None]:
    """Run a controller with other values of its law's fields, recording nothing but the MSE (the outputs' sum).

    Returns it for every trial that ran, and why it stopped there if it diverged.
    """
    return _swept(runner, inputs, rebuilt(runner.law, fields))


def _swept(runner: Runner, inputs: Sequence[TrialInput], law: AnyLaw) -> tuple[list[float], str | None]:
    values = runner.fold.values_of(law)
    ran = list(runner.judged(runner.trials(inputs, values=values)))
    return [float(left.mse.sum()) for left, _ in ran], ran[-1][1]


def mse_by_trial(study: Study, controller: str, laws: Sequence[AnyLaw]) -> list[tuple[list[float], str | None]]:
    """Run a controller with each of some laws of its class in place of its own, recording no signals.

    Returns for every law the mean square error of every trial that ran, and why it stopped there if it diverged.
    """
    runner, inputs = ready(study, {controller: study.controllers[controller]})[controller], study.inputs()
    found = []
    for law in laws:
        found.append(_swept(runner, inputs, law.ready_for(runner.task)))
    return found


def diverged(largest: Mapping[str, float], factor: float, mse: Array) -> str | None:
    """Return why a trial with these mean square errors, (outputs,), counts as diverged, or None.

    ``largest`` is the largest reference by output; the RMS error may be ``factor`` times that.
    """
    for (name, reference), error in zip(largest.items(), mse, strict=True):
        which = f" of {name}" if len(mse) > 1 else ""
        if not math.isfinite(error):
            return f"the error{which} is no longer finite"
        limit = factor * reference
        if reference and math.sqrt(error) > limit:
            return f"the RMS error{which} {math.sqrt(error):.3g} exceeds {limit:.3g} ({factor:g} x the reference)"
    return None


def explained(runner: Runner, left: TrialRecord, reason: str | None) -> str | None:
    """Return why a law diverged, with what left its domain first, and what of the plant the law was not made for."""
    if reason is None:
        return None
    said = [reason, *outside(runner.plant, left)]
    degree = runner.study.relative_degree
    if runner.law.learns_on is not None and "delay" not in runner.law.told and degree not in (1, None):
        said.append(
            f"u(k) first reaches y(k+{degree}), the plant's relative degree is {degree}, "
            f"and {type(runner.law).__name__} learns from the error at k+1"
        )
    return "; ".join(said)


def outside(plant: Plant, left: TrialRecord) -> list[str]:
    """Return which signal of a trial was first outside its domain, or no number any more, in one sentence or none."""
    named = [*zip(plant.states, left.x, strict=True), *zip(plant.outputs, left.y, strict=True)]
    named += zip(plant.inputs, left.u, strict=True)
    found: list[tuple[int, str]] = []
    for signal, row in named:
        low, high = signal.domain or (None, None)
        within = row[: left.length + 1]
        lost = ~np.isfinite(within)
        if low is not None:
            lost |= within < low
        if high is not None:
            lost |= within > high
        if lost.any():
            k = int(np.argmax(lost))
            ends = f"({'-∞' if low is None else f'{low:g}'} to {'∞' if high is None else f'{high:g}'} {signal.unit})"
            if np.isfinite(within[k]):
                told = f"left its domain {ends} at sample {k}: {within[k]:.4g} {signal.unit}"
            else:
                told = f"was no number any more at sample {k}"
            found.append((k, f"{signal.name} {told}"))
    return [min(found)[1]] if found else []


def _with_sweeps(study: Study, data: xr.Dataset, last: Mapping[tuple[str, str, float], float]) -> xr.Dataset:
    """Return a record with the last MSE of what was varied besides."""
    for sweep in study.sweeps:
        at, names = f"sweep_{sweep.field}", f"sweep_{sweep.field}_controller"
        values = [[last.get((sweep.field, name, one), math.nan) for one in sweep.values] for name in sweep.controllers]
        about = {**data["mse"].attrs, "long_name": f"last MSE against {sweep.field}, NaN where it diverged"}
        data[f"{at}_mse_last"] = ((names, at), np.array(values), about)
        data = data.assign_coords(
            {
                at: (at, list(sweep.values), {"units": sweep.unit, "long_name": sweep.field}),
                names: (names, list(sweep.controllers), {"units": "", "long_name": "controller"}),
            }
        )
    return data


def runner_of(study: Study, controller: str, law: AnyLaw | None = None) -> Runner:
    """Return a compiled runner of one controller, with another law in place of its own where one is given."""
    runner = Runner(study, controller, law)
    if not runner.law.stepped:
        runner._machine = compiled(runner.fold.trial)
    return runner
