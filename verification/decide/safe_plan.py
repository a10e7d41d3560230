"""Choosing a first plan, and a learning gain, with which bounds of signals are proved for every trial."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from models.array import Array
from models.quantity import InvalidValue, nested
from verification.checks.funnel import Funnel, Maker, Open, funnel
from verification.checks.update import first_plan
from verification.decide.judge import Judge
from verification.theorems.limits import limits
from workbench.contracts.finding import Standing
from workbench.contracts.law import AnyLaw, LearningGain
from workbench.contracts.scope import scope_of
from workbench.contracts.settings import changed, rows
from workbench.contracts.study import Inverse, Study
from workbench.contracts.verdict import Verdict
from workbench.trials.campaign import run

Bound = tuple[float | None, float | None]
SHARES = (1.0, 0.98, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Shares of the nominal model's inverse that are tried as first plans, the most likely first."""
PROBE = 0.125
"""A first plan by which it is seen whether a law takes one."""
HALVINGS = 7
TAMED = 0.999
"""The largest l_max B that a learning gain is lowered to."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tried:
    """A first plan that was tried, with the bands of the signals that are bounded."""

    share: float
    bands: Mapping[str, tuple[float, float]]
    room: float
    """The least room that a band leaves to a bound, as a share of the largest number in either; negative: none."""
    reason: str
    """Why there is no band, empty where there is."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SafePlan:
    """What came of looking for a first plan with which bounds hold in every trial."""

    controller: str
    bounds: Mapping[str, Bound]
    share: float | None
    """The share of the nominal inverse that leaves most room; None where none is proved."""
    least_share: float | None
    """The least share that was found to do."""
    settings: Mapping[str, object]
    """What to change in the study, by path; empty where nothing was found."""
    study: Study | None
    """The study with the settings changed; None where nothing was found."""
    bands: Mapping[str, tuple[float, float]]
    """What the signals stay in, in every trial."""
    verdicts: Sequence[Verdict]
    """The bounds as claims, judged on a campaign of the changed study."""
    tried: Sequence[Tried]
    reason: str
    """Why nothing was found; empty where something was."""

    def __bool__(self) -> bool:
        """Tell whether a plan was found."""
        return self.share is not None

    def __str__(self) -> str:
        """Return what was found, in a few lines."""
        if self.share is None:
            return f"no first plan was proved for {self.controller}: {self.reason}"
        lines = [f"{self.controller}: {self.share:g} of the nominal inverse, at least {self.least_share:g}"]
        lines += [f"  {path} = {value}" for path, value in self.settings.items()]
        lines += [f"  {name} stays in {low:.5g} to {high:.5g}" for name, (low, high) in self.bands.items()]
        return "\n".join([*lines, *(f"  {one.claim}: {one.standing}" for one in self.verdicts)])


SET = frozenset({"controllers", "first_plan", "verify", "sweeps", "draws"})
"""The fields of a study that are changed while a plan is looked for."""


def safe_plan(study: Study, law: str | AnyLaw, bounds: Mapping[str, Bound]) -> SafePlan:
    """Return the share of the nominal model's inverse with which bounds of signals are PROVED for every trial.

    Parameters
    ----------
    study
        The study; proofs are for its scope (``verify.scope``).
    law
        The name of one of its controllers, or a law in their place.
    bounds
        Pairs (low, high) by the name of a state, input or output, in its unit; either end may be None.

    Where the law learns so fast that an input may overshoot what is needed, one of its tuned fields is changed until
    it does not. What is found is judged on a campaign of the changed study. Raises InvalidValue for an unknown
    controller or signal, for a law without a learning gain between declared ends, and for a study that makes what is to
    be changed of settings of its own.
    """
    name, alone = _alone(study, law, bounds)
    tried: list[Tried] = []
    if why := _unfit(alone, name):
        return _none(name, bounds, tried, why)
    settings: dict[str, object] = {}
    try:
        inverse = changed(alone, {"first_plan": Inverse()})
        alone = dataclasses.replace(inverse, first_plan=inverse.plan)  # once, in numbers
    except InvalidValue as error:
        return _none(name, bounds, tried, f"the nominal model has no inverse to take a share of: {error}")
    tamed = _tamed(alone, name)
    if isinstance(tamed, str):
        return _none(name, bounds, tried, tamed)
    if tamed:
        settings |= tamed
        alone = changed(alone, nested(tamed))
    for share in SHARES:
        tried.append(_try(alone, name, share))
        if tried[-1].room >= 0 and share < 1:
            break
    good = [one for one in tried if one.room >= 0]
    if not good:
        nearest = max(tried, key=lambda one: one.room)
        return _none(name, bounds, tried, nearest.reason or _short_of(nearest))
    best = max(good, key=lambda one: one.room)
    least = _least(alone, name, good, tried)
    settings = {"first_plan": Inverse(share=best.share), **settings}
    made = changed(alone, {"first_plan": Inverse(share=best.share)})
    campaign = run(made, show_progress=False)
    judge = Judge()
    verdicts = [one for one in map(judge.verdict, limits(campaign)) if isinstance(one, Verdict)]
    if open_ones := [one for one in verdicts if one.standing is not Standing.PROVED]:
        return _none(name, bounds, tried, f"{open_ones[0].claim} is {open_ones[0].standing}: {open_ones[0].method}")
    return SafePlan(
        controller=name,
        bounds=dict(bounds),
        share=best.share,
        least_share=least,
        settings=settings,
        study=made,
        bands=best.bands,
        verdicts=verdicts,
        tried=tried,
        reason="",
    )


def _alone(study: Study, law: str | AnyLaw, bounds: Mapping[str, Bound]) -> tuple[str, Study]:
    """Return the study with one controller, asked for bounds."""
    if isinstance(law, str) and law not in study.controllers:
        raise InvalidValue(f"law must be one of {', '.join(study.controllers)}, or a law; got {law!r}")
    if not isinstance(bounds, Mapping) or not bounds:
        raise InvalidValue(f"bounds must name at least one signal, as in {{'speed': (0, 80)}}; got {bounds!r}")
    if made_of_others := sorted(study.composed & SET):
        raise InvalidValue(
            f"what safe_plan sets must be fields of the study, and it makes {', '.join(made_of_others)} of settings of "
            "its own (compose): look for a plan with dataclasses.replace(study, compose=None)"
        )
    name = law if isinstance(law, str) else "law"
    controllers = {name: study.controllers[law] if isinstance(law, str) else law}
    made = dataclasses.replace(study, controllers=controllers, sweeps=(), draws=1)
    made = changed(made, {"verify": {"limits": dict(bounds)}})
    if (refused := made.refusals().get(name)) is not None:
        raise InvalidValue(f"the law must suit the study: {refused}")
    if made.controllers[name].learns_on != "increment" or made.law(name).learning_gain is None:
        raise InvalidValue(
            f"{name} must learn on increments with a gain between declared ends (learning_gain), as increment does"
        )
    return name, made


def _unfit(study: Study, name: str) -> str:
    """Return why no share of an inverse makes a law safe, or an empty text."""
    gain = _gain(study, name)
    if gain.low < 0:
        return f"the theorem is for learning gains above 0, they lie between {gain.low:.4g} and {gain.high:.4g}"
    if not _takes_plans(study, name):
        return "it begins with a plan of its own: its start must take task.first_plan, as the laws of the workbench do"
    return ""


def _takes_plans(study: Study, name: str) -> bool:
    """Tell whether a law begins with the first plan that it is told."""
    made = dataclasses.replace(study, first_plan=PROBE)
    law = made.law(name)
    return bool(np.allclose(first_plan(law, made.task(law)), PROBE, rtol=1e-9))


def _gain(study: Study, name: str) -> LearningGain:
    gain = study.law(name).learning_gain
    assert gain is not None, "it was looked at"
    return gain


def _tamed(study: Study, name: str) -> dict[str, object] | str:
    """Return what to change of a law so that no input overshoots, nothing where none does, or why it cannot be told."""
    found = _funnel(study, name, 1.0)
    if isinstance(found, Open):
        slopes = _slopes_at_first(study, name)
        if slopes is None:
            return found.reason
        steepest = slopes
    else:
        steepest = found.slopes[1]
    if _gain(study, name).high * steepest <= 1:
        return {}
    law = study.controllers[name]
    for field, ends in law.ranges(study.task(law)).items():
        for end in ends:
            value = _enough(study, name, field, end, steepest)
            if value is not None:
                return {f"controllers.{name}.{field}": value}
    return "its learning gain is too large, and none of its tuned fields lowers it enough"


def _slopes_at_first(study: Study, name: str) -> float | None:
    """Return the largest slope up to where a funnel ended because learning is too fast; None where it did not."""
    maker = _maker(study, name, 1.0)
    found = maker.recursion.carry(maker.question())
    return float(np.nanmax(found.slope[:, 1])) if found.ended == "gain" else None


def _enough(study: Study, name: str, field: str, end: float, steepest: float) -> float | None:
    """Return the value of a field nearest to its own, towards an end, at which no input overshoots; None: none is."""
    own = next((row.value for row in rows(study.controllers[name]) if row.path == field), None)
    if not isinstance(own, float):
        return None

    def reach(value: float) -> float:
        return _gain(changed(study, nested({f"controllers.{name}.{field}": value})), name).high * steepest

    try:
        if reach(end) > TAMED:
            return None
        near, far = own, end
        for _ in range(40):
            middle = (near + far) / 2
            near, far = (middle, far) if reach(middle) > TAMED else (near, middle)
    except InvalidValue:
        return None
    return float(f"{far:.6g}") if reach(float(f"{far:.6g}")) <= 1 else far


def _maker(study: Study, name: str, share: float) -> Maker:
    made = dataclasses.replace(study, first_plan=share * np.asarray(study.plan))
    law = made.law(name)
    plan: Array = first_plan(law, made.task(law))[0]
    return Maker(made, _gain(made, name), scope_of(made), plan)


def _funnel(study: Study, name: str, share: float) -> Funnel | Open:
    return funnel(_maker(study, name, share))


def _try(study: Study, name: str, share: float) -> Tried:
    """Return what the bands are with a share of the inverse as first plan."""
    maker = _maker(study, name, share)
    found = funnel(maker)
    if isinstance(found, Open):
        return Tried(share=share, bands={}, room=-np.inf, reason=found.reason)
    bands, room = {}, np.inf
    for signal, (low, high) in study.verify.limits.items():
        ends = next(sets for other, sets in _bands(maker, found) if other == signal)
        least, most = float(ends[:, 0].min()), float(ends[:, 1].max())
        bands[signal] = (least, most)
        scale = max(abs(one) for one in (least, most, *(end for end in (low, high) if end is not None))) or 1.0
        if low is not None:
            room = min(room, (least - low) / scale)
        if high is not None:
            room = min(room, (high - most) / scale)
    return Tried(share=share, bands=bands, room=float(room), reason="")


def _bands(maker: Maker, found: Funnel) -> Iterator[tuple[str, Array]]:
    for i, signal in enumerate(maker.plant.states):
        yield signal.name, found.sets.x[:, i]
    yield maker.plant.outputs[0].name, found.sets.y
    yield maker.plant.inputs[0].name, found.sets.u


def _least(study: Study, name: str, good: Sequence[Tried], tried: list[Tried]) -> float:
    """Return the least share that does, between the least good one and the next that was tried and is none."""
    does = min(one.share for one in good)
    fails = max((one.share for one in tried if one.share < does and one.room < 0), default=None)
    if fails is None:
        below = [share for share in SHARES if share < does]
        for share in below:
            tried.append(_try(study, name, share))
            if tried[-1].room < 0:
                fails = share
                break
            does = share
    if fails is None:
        return does
    for _ in range(HALVINGS):
        tried.append(_try(study, name, (does + fails) / 2))
        does, fails = (tried[-1].share, fails) if tried[-1].room >= 0 else (does, tried[-1].share)
    return does


def _short_of(tried: Tried) -> str:
    told = ", ".join(f"{name} {low:.5g} to {high:.5g}" for name, (low, high) in tried.bands.items())
    return (
        f"the nearest, {tried.share:g} of the nominal inverse, has bands of {told}: ask for less, or prove it for a "
        "narrower scope"
    )


def _none(name: str, bounds: Mapping[str, Bound], tried: Sequence[Tried], reason: str) -> SafePlan:
    return SafePlan(
        controller=name,
        bounds=dict(bounds),
        share=None,
        least_share=None,
        settings={},
        study=None,
        bands={},
        verdicts=[],
        tried=list(tried),
        reason=reason,
    )
