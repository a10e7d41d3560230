"""Premises of theorems about differences between trials, looked at in the study's own settings.

Each returns why a premise is not met, in one sentence, or None.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from models.actuator import Actuator
from models.expression import as_expression
from models.plant import Plant
from models.quantity import is_declared, walked
from verification.certificates.numbers import Facts
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import Study
from workbench.evidence import trajectory


def one_channel(plant: Plant) -> str | None:
    """Return why a theorem for one input and one output does not speak of a plant."""
    several = trajectory.one_channel(plant)
    return several and f"of the theorem: {several}"


def same_but_for_the_input(study: Study, law: AnyLaw) -> str | None:
    """Return how a law's trials may differ besides their inputs: where they begin, what disturbs them, the plant.

    It is read off what the study declares, not off what happened to be drawn.
    """
    if study.continues:
        return "a trial begins where the last one ended, so trials differ by more than their inputs"
    if not study.scenario.initial.repeats:
        return "trials begin in different states, so they differ by more than their inputs"
    if law.places:
        return "the law moves the state in which a trial begins, so trials differ by more than their inputs"
    if study.plant_that_runs.disturbances and not study.scenario.disturbance.repeats:
        return "the disturbance differs between trials, so they differ by more than their inputs"
    return same_plant(study)


def alike(study: Study, law: AnyLaw) -> Facts:
    """Return the settings in which trials may differ besides their inputs: each is 0 where they do not."""
    return {
        "trials go on where the last one ended": (int(study.continues), ""),
        "starts are drawn anew": (int(not study.scenario.initial.repeats), ""),
        "the law places where trials begin": (int(law.places), ""),
        "disturbances that differ between trials": (moving_disturbances(study), ""),
        "quantities of the plant that change between trials": (len(moving(study)), ""),
    }


def moving_disturbances(study: Study) -> int:
    """Return how many disturbances differ between trials."""
    return 0 if study.scenario.disturbance.repeats else len(study.plant_that_runs.disturbances)


def moving(study: Study) -> list[str]:
    """Return the names of the plant's quantities that change from trial to trial."""
    return [name for name, one in study.scenario.truth.items() if not one.repeats]


def factors(study: Study) -> Facts:
    """Return the least and the largest of every quantity in which the true plant may differ, by the declared one."""
    return {
        f"{end} true {name}": (factor, f"of the declared {name}")
        for name, one in study.scenario.truth.items()
        for end, factor in zip(("least", "largest"), one.range, strict=True)
    }


def entries(thing: object, whose: str) -> Facts:
    """Return the numbers that a declared thing is made of, tables entry by entry, as facts that name whose they are."""
    found: dict[str, tuple[float, str]] = {}
    for path, spec, value in walked(thing, lambda _, inner: is_declared(inner)):
        rows = value if isinstance(value, tuple) else (value,)
        for place, one in enumerate(rows):
            if isinstance(one, (int, float)):
                found[f"{path}{f'[{place}]' if isinstance(value, tuple) else ''} of {whose}"] = (one, spec.unit)
    return found


def same_plant(study: Study) -> str | None:
    """Return which quantities of the plant change from trial to trial, so that there is no one plant to speak of."""
    moving = [
        f"{name} ({low:g} to {high:g} times the declared one)"
        for name, one in study.scenario.truth.items()
        if not one.repeats
        for low, high in (one.range,)
    ]
    return f"the plant changes from trial to trial: {', '.join(moving)}" if moving else None


def no_noise(study: Study) -> str | None:
    """Return how much measurement noise the study may add, which the theorem leaves out."""
    bound = study.scenario.noise.bound(study.plant)
    if not bound.any():
        return None
    size = "of no bound" if np.isinf(bound).any() else f"of up to {bound.max():g}"
    return f"the theorem leaves measurement noise out, and this study adds noise {size}"


def noise(study: Study) -> Facts:
    """Return by how much noise may change each measured output."""
    bound = study.scenario.noise.bound(study.plant)
    return {
        f"bound of the noise of {one.name}": (float(most), one.unit)
        for one, most in zip(study.plant.outputs, bound, strict=True)
    }


def nothing_between(study: Study) -> str | None:
    """Return what lies between plan and plant: a theorem about what a plan does is not about what an actuator does."""
    if study.plant_that_runs.states == study.plant.states and study.actuator == Actuator():
        return None
    return "an actuator lies between plan and plant, of which the theorem does not speak"


def between(study: Study) -> Facts:
    """Return what the settings say of an actuator: each is 0 where none lies between plan and plant."""
    one = study.actuator
    return {
        "states that an actuator adds": (len(study.plant_that_runs.states) - len(study.plant.states), ""),
        "lag of the actuator": (one.lag, "s"),
        "dead time of the actuator": (one.delay, "s"),
        "limits of the actuator": (sum(limit is not None for limit in (one.lower, one.upper, one.rate)), ""),
    }


def plan_alone(law: AnyLaw, study: Study) -> str | None:
    """Return why a law's inputs are not those that it planned before the trial."""
    acts = "the law also acts within the trial"
    if law.keeps_state or law.stepped:
        return acts
    task = study.task(law)
    law = law.ready_for(task)
    memory = law.start(task)
    columns = [as_expression(ca.SX.sym(f"m{i}", as_expression(one).shape[0])) for i, one in enumerate(memory)]
    r, y = (as_expression(ca.SX.sym(name, len(study.plant.outputs))) for name in ("r", "y"))
    u, _ = law.act(type(memory)(*columns), (), r, r, y)
    return acts if ca.depends_on(ca.vertcat(*(u if isinstance(u, (tuple, list)) else [u])), y) else None
