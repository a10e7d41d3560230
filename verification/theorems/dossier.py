"""What several checks of one controller of a campaign need, each computed once."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from models.array import Array
from verification.checks import convergence
from verification.checks.domain import domain
from verification.enclosure.box import Box
from workbench.evidence import sweeps
from workbench.evidence.ppd import Evidence, evidence
from workbench.evidence.trajectory import rollout, trials_done
from workbench.trials.campaign import Campaign


class Dossier:
    """Everything that several checks need about one controller of a campaign, each computed once."""

    def __init__(self, campaign: Campaign, controller: str) -> None:
        self.campaign, self.controller = campaign, controller
        self.study, self.plant = campaign.study, campaign.study.plant_that_runs
        law = campaign.tuned_laws()[controller]
        self.law = law.ready_for(self.study.task(law))

    @cached_property
    def evidence(self) -> Evidence:
        """The three PPD quantities."""
        return evidence(self.campaign, self.controller)

    @cached_property
    def box(self) -> Box:
        """The box that proofs are stated for."""
        drawn = [one.w for one in self.study.inputs()] if self.plant.disturbances else []
        return domain(self.plant, self.evidence.trajectories, np.hstack(drawn) if drawn else None)

    @cached_property
    def error_map(self) -> convergence.Monotone | str:
        """I - G L at the last trial, or why there is none."""
        return convergence.error_map(self.campaign, self.evidence)

    @cached_property
    def adaptation(self) -> convergence.Adaptation:
        """What the estimator did."""
        return convergence.adaptation(self.evidence)

    @cached_property
    def mse(self) -> Array:
        """Mean square error of the trials that were run."""
        values: Array = self.campaign.data["mse"].sel(controller=self.controller).values
        return values[: trials_done(self.campaign, self.controller)]

    @cached_property
    def lengths(self) -> Array:
        """The last sample that every trial reached."""
        lengths = self.campaign.data["trial_length"]
        values: Array = (lengths.sel(controller=self.controller) if "controller" in lengths.dims else lengths).values
        return values

    @property
    def mse_unit(self) -> str:
        """The unit of the mean square error."""
        return str(self.campaign.data["mse"].attrs["units"])

    @cached_property
    def lambda_sweep(self) -> sweeps.Sweep:
        """The law run with other values of lambda."""
        return sweeps.sweep(self.campaign, self.controller, "lam", sweeps.around(self.evidence.estimator.lam))

    def grid(self, full: bool) -> sweeps.Grid:
        """The law run over lambda and force unit, coarsely, or finely where ``full``."""
        lam = sweeps.around(self.evidence.estimator.lam, 4.0, 25 if full else 9)
        unit = sweeps.around(self.evidence.estimator.force_unit, 2.0, 17 if full else 5)
        return sweeps.grid(self.campaign, self.controller, lam, unit)

    @cached_property
    def predicted_mse(self) -> Array:
        """The MSE by trial that the frozen map predicts, empty where there is no map."""
        found = self.error_map
        if isinstance(found, str):
            return np.zeros(0)
        taken, degree = self.evidence.trajectories, self.evidence.degree
        reference = self.study.reference_samples[0]
        _, y = rollout(self.plant, taken.x[0, :, 0], np.nan_to_num(taken.u[0]), taken.w[0])
        signal = (reference - y)[degree:]
        if self.evidence.increment:
            signal = np.diff(reference - y)[degree - 1 :]
        lengths = np.minimum(taken.lengths - degree + 1, signal.size)
        return convergence.predicted_mse(found, signal, lengths, self.evidence.increment)

    @cached_property
    def reach(self) -> Array:
        """Probability that a trial reaches k + d, by row of the lifted plant."""
        return self.study.scenario.trial_length.reach_probability(self.study.horizon)[self.evidence.degree :]
