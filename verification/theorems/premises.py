"""The premises of what is claimed of learning laws, each a claim that several theorems share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from verification.certificates.numbers import Facts, Relation
from verification.checks import premises, update, wanted
from verification.checks.learned_certificate import learned
from verification.checks.settled import settled
from workbench.contracts.claim import Claim, Role
from workbench.contracts.finding import Finding, Grounds

if TYPE_CHECKING:
    from verification.theorems.dossier import Dossier

OURS = "ours"


class Premises:
    """The premises about one controller of a campaign, each made once."""

    def __init__(self, dossier: Dossier) -> None:
        self.of = dossier

    def _settled(
        self,
        name: str,
        statement: str,
        why: Callable[[], str | None],
        facts: Callable[[], Facts],
        holds: Sequence[Relation] = (),
    ) -> Claim:
        study, law = self.of.study.name, self.of.controller
        return settled(f"{study}.premise.{name}", statement, OURS, why, facts=facts, holds=holds, controller=law)

    @cached_property
    def same_but_for_the_input(self) -> Claim:
        """Trials differ by their inputs alone."""
        return self._settled(
            "same_but_for_the_input",
            "Trials begin alike, meet the same disturbance and run on the same plant.",
            partial(premises.same_but_for_the_input, self.of.study, self.of.law),
            partial(premises.alike, self.of.study, self.of.law),
        )

    @cached_property
    def same_plant(self) -> Claim:
        """There is one plant to speak of."""
        return self._settled(
            "same_plant",
            "The plant is the same in every trial.",
            partial(premises.same_plant, self.of.study),
            lambda: {"quantities of the plant that change between trials": (len(premises.moving(self.of.study)), "")},
        )

    @cached_property
    def no_noise(self) -> Claim:
        """Outputs are measured without noise."""
        return self._settled(
            "no_noise",
            "Outputs are measured without noise.",
            partial(premises.no_noise, self.of.study),
            partial(premises.noise, self.of.study),
        )

    @cached_property
    def nothing_between(self) -> Claim:
        """No actuator lies between plan and plant."""
        return self._settled(
            "no_actuator",
            "No lag, dead time or limit lies between plan and plant.",
            partial(premises.nothing_between, self.of.study),
            partial(premises.between, self.of.study),
        )

    @cached_property
    def plan_alone(self) -> Claim:
        """Inputs are those that were planned before the trial."""
        return self._settled(
            "plan_alone",
            "The law acts by its plan alone, and feeds nothing back within the trial.",
            partial(premises.plan_alone, self.of.law, self.of.study),
            lambda: {
                "the law keeps a state within the trial": (int(self.of.law.keeps_state), ""),
                "the law decides in steps": (int(self.of.law.stepped), ""),
                "the law's input depends on the measured output": (
                    int(premises.plan_alone(self.of.law, self.of.study) is not None),
                    "",
                ),
            },
        )

    @cached_property
    def update_form(self) -> Claim:
        """The plan of a sample moves by a gain between two ends times the error, and is kept elsewhere."""
        of = self.of
        task = of.study.task(of.law)
        if of.plant.ends:
            task = task._replace(varying_lengths=True)
        return Claim(
            name=f"{of.study.name}.premise.update_form",
            statement="The plan of a sample changes by a gain between two ends times the error of what is learned, and "
            "is kept where the trial did not reach.",
            source=OURS,
            check=lambda: update.learns_as_declared(of.law, task),
            controller=of.controller,
            role=Role.REPAIRED,
            premises=(self.plan_alone,),
            replay=lambda witness: update.replay(of.law, task, witness),
            attack=of.attack_update,
            certify=lambda found, premises: learned(of.law.ready_for(task), task),
        )

    @cached_property
    def first_degree(self) -> Claim:
        """The input reaches the output after one sample."""
        return self._settled(
            "relative_degree_1", "The relative degree is 1.", self._degree, self._degrees, [("=", "relative degree", 1)]
        )

    def _degrees(self) -> Facts:
        degree = self.of.study.relative_degree
        return {"relative degree": (0 if degree is None else degree, "samples")}

    def _degree(self) -> str | None:
        degree = self.of.study.relative_degree
        return None if degree == 1 else f"the theorem is for relative degree 1, got {degree}"

    @cached_property
    def unfiltered(self) -> Claim:
        """The law does not filter its plan."""
        return self._settled(
            "no_filter",
            "The law does not filter its plan.",
            self._filter,
            lambda: {"the law filters its plan": (int(self.of.law.filters_plan), "")},
        )

    def _filter(self) -> str | None:
        if not self.of.law.filters_plan:
            return None
        return "the theorem is for the law without its filter (q_cutoff_hz null)"

    @cached_property
    def positive_estimate(self) -> Claim:
        """The estimate begins positive."""
        return self._settled(
            "positive_estimate",
            "The estimate begins positive.",
            self._first,
            lambda: {"phi(k,1)": (self.of.estimator.first_estimate(), "")},
            [(">", "phi(k,1)", 0)],
        )

    def _first(self) -> str | None:
        first = self.of.estimator.first_estimate()
        return None if first > 0 else f"the theorem is for a positive phi(k,1), got {first:g}"

    @cached_property
    def scope_holds_disturbances(self) -> Claim:
        """What may disturb the plant lies in the scope."""
        return self._settled(
            "scope_holds_disturbances",
            "Whatever disturbance the study may draw lies inside the scope.",
            self._disturbances,
            lambda: {name: fact for name, fact in self._ends().items() if np.isfinite(float(fact[0]))},
            [
                relation
                for one in self.of.study.plant.disturbances
                for relation in (
                    (">=", f"least {one.name}", f"lower end of {one.name} in the scope"),
                    ("<=", f"largest {one.name}", f"upper end of {one.name} in the scope"),
                )
            ],
        )

    def _ends(self) -> Facts:
        plant = self.of.study.plant
        if not plant.disturbances:
            return {"disturbances": (0, "")}
        low, high = (end.ravel() for end in self.of.box["w"])
        bound = self.of.study.scenario.disturbance.bound(plant)
        return {
            name: (float(value), signal.unit)
            for signal, (least, most), a, b in zip(plant.disturbances, bound, low, high, strict=False)
            for name, value in (
                (f"least {signal.name}", least),
                (f"largest {signal.name}", most),
                (f"lower end of {signal.name} in the scope", a),
                (f"upper end of {signal.name} in the scope", b),
            )
        }

    def _disturbances(self) -> str | None:
        if not self.of.study.plant.disturbances:
            return None
        low, high = (end.ravel() for end in self.of.box["w"])
        bound = self.of.study.scenario.disturbance.bound(self.of.study.plant)
        for signal, (least, most), a, b in zip(self.of.study.plant.disturbances, bound, low, high, strict=False):
            if not np.isfinite([least, most]).all():
                return (
                    f"the disturbance {signal.name} has no bound: what is shown holds for {a:.4g} to {b:.4g} "
                    f"{signal.unit}, and the study may draw more; cut it to decide"
                )
            if least < a or most > b:
                return (
                    f"the disturbance {signal.name} may be {least:.4g} to {most:.4g}, and the scope holds "
                    f"{a:.4g} to {b:.4g}"
                )
        return None

    @cached_property
    def ran(self) -> Claim:
        """The law ran all trials: what fell says nothing of an end."""
        of = self.of

        def check() -> Finding:
            missing = of.study.trials - of.done
            return Finding(
                grounds=Grounds.RUN,
                holds=missing == 0,
                tries=max(of.done, 1),
                method=f"{of.done} of {of.study.trials} trials ran"
                + (f": {of.stopped}" if missing and of.stopped else ""),
                witness={"trials_run": of.done, "trials": of.study.trials},
            )

        return Claim(
            name=f"{of.study.name}.premise.ran_to_the_end",
            statement="The law ran every trial of the study.",
            source=OURS,
            check=check,
            controller=of.controller,
            role=Role.OUTCOME,
        )

    @cached_property
    def follows(self) -> Claim:
        """An input that follows the reference's increments exists, inside the scope."""
        of = self.of
        return Claim(
            name=f"{of.study.name}.premise.follows",
            statement="An input follows the reference's increments from where trials begin, and stays in the scope "
            "with its trajectory.",
            source=OURS,
            check=lambda: wanted.follows(of.wanted, of.box),
            controller=of.controller,
            role=Role.REPAIRED,
            certify=of.certified.follows,
        )
