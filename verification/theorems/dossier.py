"""What several checks of one controller of a campaign need, each computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from weakref import WeakValueDictionary

import numpy as np

from models.array import Array
from models.quantity import InvalidValue
from verification.checks import attack, convergence, learning_curve, trial_map, update
from verification.checks.domain import domain
from verification.checks.row_sums import GainBounds, SlopeBounds, gain_bounds, slope_bounds
from verification.checks.wanted import Wanted, wanted_input
from verification.enclosure.box import Box
from verification.theorems.certified import Certified
from verification.theorems.funnels import Funnels
from verification.theorems.premises import Premises
from workbench.contracts.claim import Held, Range
from workbench.contracts.finding import Finding, undecided
from workbench.contracts.law import AnyLaw, Estimator
from workbench.contracts.record import TrialInput
from workbench.evidence import sweeps
from workbench.evidence.ppd import Evidence, evidence
from workbench.evidence.trajectory import one_channel, trials_done
from workbench.trials.campaign import Campaign


class Dossier:
    """Everything that several checks need about one controller of a campaign, each computed once."""

    def __init__(self, campaign: Campaign, controller: str) -> None:
        self.campaign, self.controller = campaign, controller
        self.study, self.plant = campaign.study, campaign.study.plant_that_runs

    @cached_property
    def law(self) -> AnyLaw:
        """The law as it ran. It is not asked for where the law was refused."""
        law = self.campaign.tuned_laws()[self.controller]
        return law.ready_for(self.study.task(law))

    @cached_property
    def lacks(self) -> str:
        """The declared property without which claims of learning laws have no meaning here, or an empty text."""
        if (refused := self.study.refusals().get(self.controller)) is not None:
            return f"a task that the law is for: {refused}"
        if one_channel(self.plant) is not None:
            return "one input and one output"
        if self.law.learns_on is None:
            return "learning between trials (learns_on)"
        if self.study.trials < 2:
            return "more than one trial (trials)"
        if self.study.relative_degree is None:
            return "an output that the input reaches (relative degree)"
        return ""

    def scope(self) -> Mapping[str, Range]:
        """Return the intervals that proofs are stated for."""
        found: dict[str, Range] = {}
        for key, named in (("x", self.plant.states), ("u", self.plant.inputs), ("w", self.plant.disturbances)):
            ends = zip(*(end.ravel().tolist() for end in self.box[key]), strict=True)
            found |= {
                signal.name: Range(low, high, signal.unit) for signal, (low, high) in zip(named, ends, strict=True)
            }
        low, high = (float(end.ravel()[0]) for end in self.box["k"])
        return {**found, "sample k": Range(low, high, "")}

    @cached_property
    def begun(self) -> TrialInput:
        """What the first trial was run with."""
        return self.study.inputs()[0]

    @cached_property
    def recorded(self) -> attack.Tried:
        """The recorded trials, up to where each left the scope or ended."""
        return attack.recorded(self.evidence.trajectories, self.box)

    @cached_property
    def tried(self) -> attack.Tried:
        """Plans made to break what is proved."""
        taken = self.evidence.trajectories
        base = [one for one in taken.u if np.isfinite(one).all()]
        if self.law.learns_on == "increment" and self.wanted.missing is None:
            base.append(self.wanted.u)
        return attack.tried(self.plant, self.box, self.begun.x0, self.begun.w, base)

    def attack_row_sums(self, found: Finding) -> Held:
        """Hold the lifted bound against recorded trials and plans."""
        p, e = found.bound or 0.0, self.evidence
        return _worse(
            *(
                attack.held_row_sums(p, self.slopes, self.box, trials, e.degree, e.increment)
                for trials in (self.recorded, self.tried)
            )
        )

    def attack_continuity(self, found: Finding) -> Held:
        """Look for a point of recorded trials and plans at which there is no slope."""
        return _worse(
            *(
                attack.held_finite(self.plant, trials, self.begun.w, self.evidence.degree)
                for trials in (self.recorded, self.tried)
            )
        )

    def attack_ratio(self, found: Finding) -> Held:
        """Hold a bound of every realised ratio against recorded trials and plans, of a plant without memory."""
        p, e = found.bound or 0.0, self.evidence
        return _worse(
            *(
                attack.held_ratios(p, self.slopes, self.box, trials, e.degree, e.increment)
                for trials in (self.recorded, self.tried)
            )
        )

    def attack_slopes(self, found: Finding) -> Held:
        """Hold the bounds of the slope against the exact derivative along recorded trials and plans."""
        return self._held_slopes

    @cached_property
    def _held_slopes(self) -> Held:
        """What several claims rest on alike: the bounds are the same, whatever was found of them."""
        e, slopes = self.evidence, self.gains
        return _worse(
            *(
                attack.held_slopes(slopes.gain_low, slopes.gain_high, self.plant, trials, self.begun.w, e.degree)
                for trials in (self.recorded, self.tried)
            )
        )

    def attack_contraction(self, weight: float) -> Held:
        """Hold the contraction of the (weighted) input error against recorded trials and plans."""
        estimates = self.evidence.trajectories.estimate
        return attack.held_contraction(
            self.estimator, self.slopes, self.wanted, self.box, self.recorded, estimates, self.tried, weight
        )

    def attack_update(self, found: Finding) -> Held:
        """Hold the form in which the law learns against the recorded trials, noise and all."""
        taken = self.evidence.trajectories
        noise = np.array([one.noise[0] for one in self.study.inputs()[: taken.u.shape[0]]]).reshape(taken.y.shape)
        reference = self.study.reference_samples[0]
        return update.held_update(self.law, reference, taken.u, taken.y + noise, taken.lengths)

    @cached_property
    def evidence(self) -> Evidence:
        """The three PPD quantities."""
        return evidence(self.campaign, self.controller)

    @cached_property
    def box(self) -> Box:
        """The box that proofs are stated for."""
        return domain(self.plant, self.evidence.trajectories, self._drawn())

    @cached_property
    def hull(self) -> Box:
        """The box of what the trials met, not widened: what is refuted is refuted at a point of it."""
        return domain(self.plant, self.evidence.trajectories, self._drawn(), margin=0.0)

    def _drawn(self) -> Array | None:
        drawn = [one.w for one in self.study.inputs()] if self.plant.disturbances else []
        return np.hstack(drawn) if drawn else None

    def refuted_in_the_hull(self, check: Callable[[Box], Finding]) -> Finding:
        """Return what a check finds over the scope; where it fails, only a point among those that were met counts."""
        found = check(self.box)
        if not found.fails:
            return found
        met = check(self.hull)
        if met.fails:
            return met
        return undecided(
            f"it fails in the margin of the scope, to which no trial came ({found.method}); where trials were it was "
            "not refuted",
            beside=found.witness,
        )

    @cached_property
    def premises(self) -> Premises:
        """What theorems about the controller ask of it."""
        return Premises(self)

    @cached_property
    def certified(self) -> Certified:
        """What makes the certificates of what is proved."""
        return Certified(self)

    @cached_property
    def funnels(self) -> Funnels:
        """The sets that hold every trial, and what is read off them."""
        return Funnels(self)

    @cached_property
    def gains(self) -> GainBounds:
        """Bounds of the slope by the input of what is learned on, over the box: far fewer than all slopes."""
        return self._gains(self.box)

    def gains_over(self, box: Box) -> GainBounds:
        """Return the bounds over the scope, or over another box."""
        return self.gains if box is self.box else self._gains(box)

    def _gains(self, box: Box) -> GainBounds:
        return gain_bounds(self.plant, box, degree=self._degree, increment=self.law.learns_on == "increment")

    @cached_property
    def slopes(self) -> SlopeBounds:
        """Bounds of the slopes of what is learned on, over the box."""
        increment = self.law.learns_on == "increment"
        return slope_bounds(self.plant, self.box, degree=self._degree, increment=increment, gain=self.gains)

    @property
    def _degree(self) -> int:
        return self.study.relative_degree or 1

    @cached_property
    def wanted(self) -> Wanted:
        """The inputs that follow the reference's increments."""
        return wanted_input(self.study)

    @property
    def estimator(self) -> Estimator:
        """The parameters of the law's estimate. Raises InvalidValue for a law without."""
        if self.law.estimator is None:
            raise InvalidValue(f"{self.controller} must estimate a pseudo partial derivative, and has no estimator")
        return self.law.estimator

    @property
    def done(self) -> int:
        """How many trials ran before the law ended or diverged."""
        return trials_done(self.campaign, self.controller)

    @property
    def stopped(self) -> str:
        """Why it was stopped, as the run noted it."""
        data = self.campaign.data
        return str(data["stopped"].sel(controller=self.controller).values) if "stopped" in data else ""

    @cached_property
    def error_map(self) -> trial_map.ErrorMap | str:
        """The map between trials along the last one, or why there is none."""
        return trial_map.error_map(self.campaign, self.evidence)

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
        return learning_curve.predicted_mse(found, self.evidence.trajectories.lengths)

    @cached_property
    def reach(self) -> Array:
        """Probability that a trial reaches k + d, by row of the lifted plant."""
        return self.study.scenario.trial_length.reach_probability(self.study.horizon)[self.evidence.degree :]


_at_hand: WeakValueDictionary[tuple[int, str], Dossier] = WeakValueDictionary()


def dossier_of(campaign: Campaign, controller: str) -> Dossier:
    """Return the dossier of a controller: the one that somebody has already, so that nothing is computed twice."""
    place = id(campaign), controller  # a dossier keeps its campaign, so while there is one the id is of no other
    found = _at_hand.get(place)
    if found is None:
        found = _at_hand[place] = Dossier(campaign, controller)
    return found


def dossiers_of(campaign: Campaign) -> list[Dossier]:
    """Return the dossiers of all controllers of a campaign."""
    return [dossier_of(campaign, str(name)) for name in campaign.data["controller"].values]


def _worse(*held: Held) -> Held:
    """Return what left the least room, with all tries."""
    least = min(held, key=lambda one: one.margin)
    return least._replace(tries=sum(one.tries for one in held))
