"""What the funnel of one controller of a campaign is made of, each part once, and how runs are held against it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from models.array import Array
from models.quantity import InvalidValue
from verification.certificates.funnel import Asked
from verification.certificates.funnel import funnel as funnel_certificate
from verification.certificates.theorem import theorem
from verification.checks.adversary import Possible
from verification.checks.campaigns import PlantEquations, campaigns
from verification.checks.envelope import Bounds, Envelope, held_inside
from verification.checks.funnel import Funnel, Maker, Open, funnel, with_rounding
from verification.checks.funnel_curve import Curve, below, curve
from verification.checks.update import first_plan
from verification.enclosure.box import Box
from verification.enclosure.recursion import Carried, step_of
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Held, NotCertified
from workbench.contracts.finding import Finding
from workbench.contracts.law import LearningGain
from workbench.contracts.scope import Scope, scope_of
from workbench.evidence.trajectory import Trajectories, recorded
from workbench.graph import read

if TYPE_CHECKING:
    from verification.theorems.dossier import Dossier

CAMPAIGNS, TRIALS = 100, 30
"""Campaigns that are made to leave a funnel, and their trials."""
FOLLOWED = 24
"""Campaigns that are made to lie above a learning curve."""
LONGEST = 1000
"""Trials for which a learning curve is made at most."""


UNROUNDED = "what doubles round has no bound, as something jumps: there is nothing to hold runs against"


class Funnels:
    """The funnel of one controller, and what is read off it."""

    def __init__(self, dossier: Dossier) -> None:
        self.of = dossier

    @cached_property
    def gain(self) -> LearningGain:
        """The ends of the learning gain. Raises InvalidValue for a law that declares none."""
        gain = self.of.law.learning_gain
        if gain is None:
            raise InvalidValue("the law declares no ends of its learning gain (learning_gain)")
        return gain

    @cached_property
    def scope(self) -> Scope:
        """What trials may meet."""
        return scope_of(self.of.study)

    @cached_property
    def plan(self) -> Array:
        """The first plan, (N,)."""
        plan: Array = first_plan(self.of.law, self.of.study.task(self.of.law))[0]
        return plan

    @cached_property
    def maker(self) -> Maker:
        """What makes sets of the study's plant within the scope."""
        return Maker(self.of.study, self.gain, self.scope, self.plan)

    @cached_property
    def found(self) -> Funnel | Open:
        """The funnel, or why there is none."""
        return funnel(self.maker)

    @property
    def funnel(self) -> Funnel:
        """The funnel. Raises InvalidValue with the reason where there is none."""
        if isinstance(self.found, Open):
            raise InvalidValue(self.found.reason)
        return self.found

    @cached_property
    def rounded(self) -> Carried | None:
        """The funnel with what doubles round in it; None where that has no bound."""
        return with_rounding(self.maker, self.funnel)

    @cached_property
    def taken(self) -> Trajectories:
        """What was recorded."""
        return recorded(self.of.campaign, self.of.controller)

    @cached_property
    def curve(self) -> Curve | Open:
        """The learning curve over the trials of the study, or why there is none."""
        study = self.of.study
        if study.plant_that_runs.ends:
            return Open(reason="trials end by an event of the plant, so no sample is known to be reached by all")
        last = study.scenario.trial_length.least(study.horizon)
        return curve(self.maker, self.funnel, self.of.lengths[:LONGEST].astype(np.int64), last)

    @property
    def slopes(self) -> tuple[float, float]:
        """The ends of the slope of the increment by the input. Raises InvalidValue where there is no funnel."""
        return self.funnel.slopes

    def box(self) -> Box:
        """Return a box around the funnel. Raises InvalidValue where there is none."""
        sets, study = self.funnel.sets, self.of.study
        low, high = self.scope.disturbance
        inputs = np.concatenate([sets.u, sets.target])
        return Box(
            {
                "x": (sets.x[..., 0].min(axis=0), sets.x[..., 1].max(axis=0)),
                "u": (float(inputs[:, 0].min()), float(inputs[:, 1].max())),
                "w": (low.min(axis=1), high.max(axis=1)),
                "k": (0.0, float(study.horizon - 1)),
            },
            whole=("k",),
        )

    def certify(self, found: Finding, premises: Mapping[str, Certificate]) -> Certificate:
        """Return the certificate of the funnel, and of the theorem that every trial stays in it."""
        maker, scope, made = self.maker, self.scope, self.funnel
        if made.same:
            raise NotCertified(f"sets are certified for quantities that may change, and {', '.join(made.same)} may not")
        graph = read(step_of(maker.plant, maker.symbols))
        ports = {port.name: port.labels for port in graph.inputs}
        low, high = scope.disturbance
        n = maker.samples
        others = {name: np.stack([low[i, :n], high[i, :n]], axis=-1) for i, name in enumerate(ports["w"])}
        ends = [[one.low, one.high] for one in scope.parameters.values()]
        others |= {name: np.array([one]) for name, one in zip(ports["p"], ends, strict=True)}
        sets = funnel_certificate(
            graph,
            Asked(
                start=scope.start,
                others=others,
                plan=maker.plan[:n],
                reference=maker.reference,
                noise=float(scope.noise[0]),
                gain=maker.gain.high,
                targets=made.sets.target,
            ),
        )
        named = {name.rsplit("premise.", 1)[-1]: one for name, one in premises.items()}
        return theorem("increment_funnel", sets=sets, **named)

    def held(self, found: Finding) -> Held:
        """Hold the funnel against recorded trials, and against campaigns made to leave it."""
        sets = self.rounded
        if sets is None:
            return Held(0, 0.0, {"because": UNROUNDED})
        record = self._recorded(sets)
        made = self._made(sets)
        least = min(record, made, key=lambda one: one.margin)
        return least._replace(tries=record.tries + made.tries)

    def _recorded(self, sets: Carried) -> Held:
        """Return the least room of the recorded trials in the funnel, as a share of the widest that it is."""
        taken, worst, place = self.taken, np.inf, dict[str, object]()
        names = [signal.name for signal in self.of.plant.states]
        for i in range(taken.u.shape[0]):
            end = int(taken.lengths[i])
            rows = [(name, taken.x[i, row, : end + 1], sets.x[: end + 1, row]) for row, name in enumerate(names)]
            rows.append((self.of.plant.inputs[0].name, taken.u[i, :end], sets.u[:end]))
            rows.append((self.of.plant.outputs[0].name, taken.y[i, : end + 1], sets.y[: end + 1]))
            for name, values, ends in rows:
                scale = float(np.max(ends[:, 1] - ends[:, 0])) or 1.0
                room = np.minimum(values - ends[:, 0], ends[:, 1] - values) / scale
                k = int(np.argmin(room))
                if not room[k] >= worst:
                    worst = float(room[k])
                    place = {"trial": i + 1, "signal": name, "sample": k, "value": float(values[k]),
                             "low": float(ends[k, 0]), "high": float(ends[k, 1])}  # fmt: skip
        return Held(taken.u.shape[0], worst if np.isfinite(worst) else 0.0, place)

    def _made(self, sets: Carried) -> Held:
        low, high = (Bounds(sets.x[..., i].T, sets.u[:, i]) for i in (0, 1))
        none = Bounds(np.zeros_like(low.states), np.zeros_like(low.inputs))
        return held_inside(self.campaigns(CAMPAIGNS, TRIALS), low, high, none)

    def possible(self) -> Possible:
        """Return what may come in a campaign within the scope."""
        scope, study = self.scope, self.of.study
        ends = [[one.low, one.high] for one in scope.parameters.values()]
        low, high = np.array(ends).reshape(-1, 2).T
        return Possible(
            reference=study.reference_samples[0],
            first_plan=self.plan,
            gain=(max(self.gain.low, 0.0), self.gain.high),
            start=(scope.start[:, 0], scope.start[:, 1]),
            parameters=(low, high),
            disturbance=scope.disturbance,
            noise=float(scope.noise[0]),
            fixed=("parameters",) if self.funnel.same else (),
        )

    def campaigns(self, count: int, trials: int, *, seed: int = 0, **changes: object) -> Envelope:
        """Run campaigns that are made to go as far as they can; ``changes`` are fields of what may come in them."""
        maker = self.maker
        at = maker.plant.symbols()
        p = ca.vertcat(*maker.symbols) if maker.symbols else ca.SX(0, 1)
        plant = PlantEquations(
            at["x"], at["u"], at["w"], at["k"], p, maker.plant.next_state(**at), maker.plant.measured(at["x"])
        )
        possible = dataclasses.replace(self.possible(), **changes)  # type: ignore[arg-type]  # fields by name
        return campaigns(plant, possible, count=count, trials=trials, seed=seed)

    def held_curve(self, found: Finding) -> Held:
        """Hold the learning curve against recorded errors, and against campaigns made to lie above it."""
        bounds = self.curve
        if isinstance(bounds, Open):
            raise InvalidValue(bounds.reason)
        if not bounds.rounded:
            return Held(0, 0.0, {"because": UNROUNDED})
        taken, reference = self.taken, self.of.study.reference_samples[0]
        errors = [np.square(reference - row) for row in taken.y]
        common = [np.mean(one[1 : bounds.last + 1]) for one in errors]
        own = [np.mean(one[1 : end + 1]) for one, end in zip(errors, taken.lengths, strict=True)]
        made = self.campaigns(FOLLOWED, min(bounds.common.size, FOLLOWED), shortest=bounds.last, scored=bounds.last)
        worst, place = np.inf, dict[str, object]()
        for what, curve_, seen in (
            ("recorded trials", bounds.common, np.array(common)),
            ("recorded trials, to their ends", bounds.own, np.array(own)),
            ("campaigns", bounds.common, made.mse),
        ):
            one = below(curve_, seen)
            if one is not None and one.room < worst:
                worst = one.room
                place = {"of": what, "trial": one.trial, "mse": one.seen, "bound": one.bound}
        return Held(taken.u.shape[0] + made.count, worst if np.isfinite(worst) else 0.0, place)
