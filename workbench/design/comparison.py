"""Every law against every other on one plant: the study that tunes them alike and runs them alike."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from models.actuator import Actuator
from models.plant import Plant
from models.quantity import InvalidValue, count, declared, given, part, quantity
from workbench.contracts.law import Law
from workbench.contracts.number import finite
from workbench.contracts.study import Folded, Measures, Progress, Scores, Study
from workbench.design.candidates import Candidate, candidates
from workbench.design.tuning import Tuned, tune
from workbench.fold.fold import build, stream
from workbench.fold.machine_code import compiled
from workbench.trials.drawn import SpeedNoise
from workbench.trials.study import TrialStudy

TUNING_STREAM = 1
JUDGED = 5  # last trials whose mean MSE tuning minimises: one alone may be lucky with its noise
NEAR_FINAL = 1.1


@declared
class Comparison(Study):
    """Laws on one plant, each tuned on the plant as it is believed to be and run on the plant as it is.

    Tuning minimises the mean MSE of the last 5 of ``trials`` trials (of 5 trials for a law that does not learn), with
    ``budget`` evaluations a law (see :data:`workbench.design.tuning.PROCEDURE`), on the nominal mass and with noise of
    its own. The run then has the true mass and other noise. A law that does not suit the plant is refused with its
    reason.
    """

    name: str = given(default="same-plant", doc="name, used for folders and reports")
    title: str = given(default="Every controller against every other on the same plant", doc="in one line")
    source: str = given(default="ours", doc="where it comes from")
    plant: Plant = part(doc="the plant as it is believed to be, without actuators")
    reference: Any = given(doc="what the output should follow")
    measures: tuple[Measures, ...] = given(default=(), doc="what is measured beyond the common metrics")
    laws: Mapping[str, Candidate] = part(doc="the laws by name")
    actuator: Actuator = part(
        default=Actuator(lower=-450e3, upper=450e3, rate=500e3), doc="limits, rate limit, lag and dead time"
    )
    noise: SpeedNoise = part(default=SpeedNoise(speed_sigma=0.05), doc="measurement noise")
    mass_off_percent: float = quantity(
        default=10.0, unit="%", doc="by how much the true mass exceeds the nominal one", above=-100, structural=True
    )
    trials: int = count(default=30, doc="trials of every law", least=1, most=10_000)
    budget: int = count(default=60, doc="evaluations that tuning a law may take", least=1, most=100_000)
    seed: int = count(default=0, doc="seed of everything random", most=2**31)

    def check(self) -> None:
        """Raise InvalidValue where plant, actuator and laws do not fit together."""
        if not self.laws:
            raise InvalidValue("laws must name at least one law, got none")
        if self.mass_off_percent and not isinstance(getattr(self.plant, "mass", None), float):
            raise InvalidValue(f"mass_off_percent must be 0 for {self.plant.name}, which has no mass")
        self.actuator.wrapped(self.plant)

    @property
    def controllers(self) -> dict[str, Any]:
        """The laws by name, with the settings that tuning starts from."""
        return {name: one.law for name, one in self.laws.items()}

    def study(self, laws: Mapping[str, Any], *, true: bool, seed: int) -> TrialStudy:
        """Return the study made of trials with some laws, on the true or on the nominal plant."""
        plant: Any = self.plant
        if true and self.mass_off_percent:
            plant = dataclasses.replace(plant, mass=plant.mass * (1 + self.mass_off_percent / 100))
        return TrialStudy(
            name=self.name,
            title=self.title,
            source=self.source,
            plant=self.actuator.wrapped(plant),
            reference=self.reference,
            controllers=laws,
            trials=self.trials,
            noise=self.noise,
            seed=seed,
        )

    def folded(self) -> dict[str, Folded]:
        """Return what every law is folded from on the true plant, by name."""
        return self.study(self.controllers, true=True, seed=self.seed).folded()

    def refusals(self) -> dict[str, str]:
        """Return why laws cannot run on the plant, by name."""
        study = self.study(self.controllers, true=True, seed=self.seed)
        found = {}
        for name, law in study.controllers.items():
            reason = law.refusal(study)
            if reason is None:
                try:
                    build(study.plant, law, study.horizon)
                except InvalidValue as error:
                    reason = str(error)
            if reason:
                found[name] = reason
        return found

    def simulate(self, progress: Progress) -> xr.Dataset:
        """Tune every law, then run all of them; see :class:`workbench.contracts.study.Study`."""
        refused = self.refusals()
        suited = {name: one for name, one in self.laws.items() if name not in refused}
        if not suited:
            raise InvalidValue("no law suits this plant: " + "; ".join(f"{n}: {why}" for n, why in refused.items()))
        tuned: dict[str, Tuned] = {}
        with progress(len(suited) * self.budget, f"tune {self.name}") as advance:
            for name, one in suited.items():
                tuned[name] = self._tuned(one, advance)
        laws = {name: one.tuned(tuned[name].settings) for name, one in suited.items()}
        data = self.study(laws, true=True, seed=self.seed).simulate(progress)
        return self._told(data, refused, tuned)

    def _tuned(self, one: Candidate, advance: Callable[[int], object]) -> Tuned:
        nominal = self.study({"law": one.law}, true=False, seed=_tuning_seed(self.seed))
        fold = nominal.fold("law")
        machine = compiled(fold.trial)
        inputs = nominal.inputs() if learns(one.law) else nominal.inputs()[:JUDGED]
        reference = nominal.reference_samples

        def cost(settings: Mapping[str, float]) -> float:
            values = fold.values_of(one.tuned(settings))
            mse = []
            for left in stream(fold, reference, inputs, trial=machine, values=values):
                mse.append(left.mse)
                if not np.isfinite(left.mse):
                    break
            advance(1)
            return float(np.mean(mse[-JUDGED:]))

        return tune(cost, one.ranges, one.first, self.budget, _tuning_seed(self.seed))

    def _told(self, data: xr.Dataset, refused: Mapping[str, str], tuned: Mapping[str, Tuned]) -> xr.Dataset:
        """Return the record with what tuning found, and with refused laws by name and reason."""
        names = [str(name) for name in data["controller"].values]
        spent = np.array([tuned[name].costs for name in names])
        data["tuned"] = (
            ("controller",),
            np.array([json.dumps(tuned[name].settings) for name in names]),
            {"units": "", "long_name": "settings found by tuning"},
        )
        data["tuning_mse"] = (
            ("controller", "evaluation"),
            spent,
            {**data["mse"].attrs, "long_name": "mean MSE of the last trials of every evaluation on the nominal plant"},
        )
        data["refused"] = (
            ("refused_law",),
            np.array(list(refused.values()), dtype=str),
            {"units": "", "long_name": "why a law does not suit the plant"},
        )
        return data.assign_coords(
            evaluation=("evaluation", np.arange(1, self.budget + 1), {"units": "1", "long_name": "evaluation"}),
            refused_law=("refused_law", np.array(list(refused), dtype=str), {"units": "", "long_name": "refused law"}),
        )

    def tuned_laws(self, data: xr.Dataset) -> dict[str, Any]:
        """Return the laws with the settings that tuning found, from the record."""
        return {
            str(name): self.laws[str(name)].tuned(json.loads(str(data["tuned"].sel(controller=name).values)))
            for name in data["controller"].values
        }

    def scores(self, data: xr.Dataset) -> Scores:
        """Return the metrics of every law; None where it diverged or does not suit the plant.

        mse is the mean over the trials, mse_last that of the last; trials_needed the first trial from which on the
        MSE stays within 10 % above the final one (1 for a law that does not learn). solves counts optimisations.
        What the study measures besides stands between.
        """
        besides = [one.scores(self, data) for one in self.measures]
        found: Scores = {}
        for name, law in self.tuned_laws(data).items():
            learned, spent = self._scored(data.sel(controller=name), law)
            found[name] = learned
            for one in besides:
                found[name] |= one.get(name, {})
            found[name] |= spent
        nothing = dict.fromkeys(next(iter(found.values())))
        return found | {str(name): dict(nothing) for name in data["refused_law"].values}

    def _scored(self, one: xr.Dataset, law: Law) -> tuple[dict[str, float | None], dict[str, float | None]]:
        """Return the metrics of what was learned, and of what it took."""
        mse = one["mse"].values
        whole = bool(np.isfinite(mse).all())
        near = np.flatnonzero(mse > NEAR_FINAL * mse[-1]) if whole and learns(law) else np.zeros(0)
        learned = {
            "mse": finite(mse.mean()),
            "mse_last": finite(mse[-1]),
            "trials_needed": (float(near[-1] + 2) if near.size else 1.0) if whole else None,
        }
        spent: dict[str, float | None] = {
            "solves": float(law.solves_per_sample * (one.sizes["sample"] - 1) * mse.size),
            "evaluations": float(one.sizes["evaluation"]),
        }
        return learned, spent

    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, as functions that draw."""
        from workbench.design.figures import comparison_figures

        return comparison_figures(self, data)


def learns(law: Law) -> bool:
    """Tell whether a law learns between trials."""
    return law.learns_on is not None


def _tuning_seed(seed: int) -> int:
    """Return a seed for tuning that differs from the seed of the run."""
    return int(np.random.SeedSequence([seed, TUNING_STREAM]).generate_state(1)[0])


def comparison(study: Any, laws: Sequence[str] | None = None) -> Comparison:
    """Return the comparison of some laws (all by default) on the plant and reference of a study made of trials.

    Raises InvalidValue for a study of another kind, an unknown law, and a plant that no comparison can take.
    """
    if isinstance(study, Comparison):
        chosen = list(study.laws) if laws is None else list(laws)
        missing = [name for name in chosen if name not in study.laws]
        made = candidates(study.plant, study.reference.samples(study.plant), missing) if missing else {}
        return dataclasses.replace(study, laws={name: {**study.laws, **made}[name] for name in chosen})
    if not isinstance(study, TrialStudy):
        raise InvalidValue(f"compare takes a study made of trials, a TrialStudy; {study.name} is of another kind")
    return Comparison(
        plant=study.plant,
        reference=study.reference,
        measures=study.compared,
        laws=candidates(study.plant, study.reference_samples, laws),
        mass_off_percent=10.0 if isinstance(getattr(study.plant, "mass", None), float) else 0.0,
    )
