"""Every law against every other on one plant: the study in which all are tuned alike and run alike."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from models.array import Array
from models.quantity import InvalidValue
from workbench.contracts import settings
from workbench.contracts.law import AnyLaw
from workbench.contracts.number import finite
from workbench.contracts.study import Draw, Scores, Study
from workbench.design.library import LIBRARY
from workbench.design.one_error import weighed
from workbench.design.search import Search

NAME = "same-plant"
"""What every comparison is called: its verdicts are named for it, and its claims are installed under it."""
TITLE = "Every controller against every other on the same plant"
NEAR_FINAL = 1.1
Compose = Callable[[object, int], Mapping[str, object]]
"""compose(own, seed) gives fields of a study."""


def comparison(study: Study, laws: Sequence[str] | None = None) -> Study:
    """Return the study that compares laws on the plant of a study, in all that it meets there, each tuned alike.

    Plant, reference, scenario and trials are the study's own. ``laws`` name controllers of the study, which begin with
    their own settings, and laws of the library (:data:`workbench.design.library.LIBRARY`), which are scaled for the
    plant; the study's own come first where both have a name. By default they are the library's that suit the study
    (but for those that are asked sample by sample, which take long: they are named) and all of the study's, or those
    of a comparison as they are.

    Raises InvalidValue for an unknown law, for several outputs without weights, and for what is no Study.
    """
    if not isinstance(study, Study):
        first = repr(study).splitlines()[0]
        raise InvalidValue(f"compare takes a Study, as in compare(Study(plant=..., ...)); got {first}")
    weighed(study)
    chosen = _by_default(study) if laws is None else _named(study, laws)
    if isinstance(study.tuning, Search):
        return dataclasses.replace(study, controllers=chosen, renamed={**study.renamed, **_old_paths(chosen)})
    return dataclasses.replace(
        study,
        name=NAME,
        title=TITLE,
        source="ours",
        controllers=chosen,
        tuning=Search(),
        scorers=(compared_scores,),
        drawings=_drawings,
        sweeps=(),
        claims=(),
        expected={},
        cases={},
        summary=None,
        derived=None,
        documents=None,
        renamed={**study.renamed, **_old_paths(chosen), **_old_budget(study)},
        compose=_less(study.compose),
    )


SET_HERE = frozenset(
    [
        "name",
        "title",
        "source",
        "controllers",
        "tuning",
        "scorers",
        "drawings",
        "sweeps",
        "claims",
        "expected",
        "cases",
        "summary",
    ]
) | {"derived", "documents", "renamed"}
"""The fields that a comparison sets, whatever the study's own settings make of them."""


def _less(compose: Compose | None) -> Compose | None:
    """Return what makes a study's parts of its own settings, but for what a comparison sets."""
    if compose is None:
        return None

    def others(own: object, seed: int) -> dict[str, object]:
        return {name: value for name, value in compose(own, seed).items() if name not in SET_HERE}

    return others


def _by_default(study: Study) -> dict[str, AnyLaw]:
    own = study.controllers
    if isinstance(study.tuning, Search):
        return dict(own)
    made = {name: own[name] if name in own else LIBRARY[name]() for name in LIBRARY}
    quick = [name for name in made if name in own or not made[name].stepped]
    suited = [name for name in quick if name in own or _refusal(study, name, made[name]) is None]
    return {**_named(study, suited), **own} if suited else dict(own)


def _named(study: Study, names: Sequence[str]) -> dict[str, AnyLaw]:
    known = [*dict.fromkeys([*LIBRARY, *study.controllers])]
    if not names:
        raise InvalidValue(f"laws must name at least one law, got none; the laws are: {', '.join(known)}")
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"the laws are: {', '.join(known)}"
            raise InvalidValue(f"there is no law {name!r} to compare; {hint}")
    return {name: study.controllers[name] if name in study.controllers else _scaled(study, name) for name in names}


def _scaled(study: Study, name: str) -> AnyLaw:
    """Return a law of the library in the plant's scale, or as it is where it does not suit the study."""
    law = LIBRARY[name]()
    return law if _refusal(study, name, law) else law.scaled_for(study.task(law))


def _refusal(study: Study, name: str, law: AnyLaw) -> str | None:
    """Return why a law of the library does not suit a study, or None."""
    misfit = law.channels.refusal(name, study.plant)
    if misfit:
        return misfit
    task = study.task(law)
    try:
        return law.scaled_for(task).refusal(task)
    except InvalidValue as error:
        return law.refusal(task) or str(error)


def _old_paths(laws: Mapping[str, AnyLaw]) -> dict[str, str]:
    """Return where the settings of laws are that were once settings of candidates, by their old paths."""
    return {
        f"laws.{name}.law.{row.path}": f"controllers.{name}.{row.path}"
        for name, law in laws.items()
        for row in settings.rows(law)
    }


def _old_budget(study: Study) -> dict[str, str]:
    taken = any(row.path == "budget" for row in settings.rows(study))
    return {} if taken else {"budget": "tuning.budget"}


def compared_scores(study: Study, data: xr.Dataset) -> Scores:
    """Return the metrics of every law; None where it diverged or does not suit the plant.

    mse is the mean over the trials, mse_last that of the last, both weighed where there are several outputs;
    trials_needed the first trial from which on the MSE stays within 10 % above the final one (1 for a law that does
    not learn). solves counts optimisations. What the study measures besides stands between.
    """
    assert study.tuning is not None
    laws = study.tuning.laws(study, data)
    refused = set(map(str, data["refused_law"].values))
    ran = [name for name in map(str, data["controller"].values) if name not in refused]
    besides = [one.scores(study, data.sel(controller=ran)) for one in study.compared]
    found: Scores = {}
    for name in ran:
        mse = error_by_trial(study, data, name)
        learned = _learned(mse, laws[name].learns_on is not None)
        measured = {metric: value for one in besides for metric, value in one.get(name, {}).items()}
        solves = float(laws[name].solves_per_sample * (data.sizes["sample"] - 1) * mse.size)
        found[name] = {**learned, **measured, "solves": solves, "evaluations": float(data.sizes["evaluation"])}
    nothing = dict.fromkeys(next(iter(found.values())))
    return found | {name: dict(nothing) for name in map(str, data["controller"].values) if name in refused}


def error_by_trial(study: Study, data: xr.Dataset, controller: str) -> Array:
    """Return the one error that laws are compared by, of every trial of a law, (trials,)."""
    mse = data["mse"].sel(controller=controller).values.reshape(data.sizes["trial"], -1)
    errors: Array = mse @ weighed(study).weights
    return errors


def _learned(mse: Array, learns: bool) -> dict[str, float | None]:
    whole = bool(np.isfinite(mse).all())
    near = np.flatnonzero(mse > NEAR_FINAL * mse[-1]) if whole and learns else np.zeros(0)
    return {
        "mse": finite(mse.mean()),
        "mse_last": finite(mse[-1]),
        "trials_needed": (float(near[-1] + 2) if near.size else 1.0) if whole else None,
    }


def _drawings(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures by name, as functions that draw."""
    from workbench.design.figures import comparison_figures

    return comparison_figures(study, data)
