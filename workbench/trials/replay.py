"""Running a recorded campaign again, and where it departs from its record."""

from __future__ import annotations

import json
from collections.abc import Hashable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from models.errors import InvalidValue
from workbench.contracts import settings
from workbench.distribution import __version__
from workbench.trials import progress
from workbench.trials.campaign import Campaign
from workbench.trials.provenance import Provenance, provenance
from workbench.trials.simulation import simulate

MADE_WITH = ("python", "casadi", "numpy", "machine", "compiler")
DO = "run the study again"


def replayed(campaign: Campaign, *, show_progress: bool = False) -> None:
    """Hold a campaign that was loaded against its study as it is now; one that was run here is believed.

    First the version, the settings and the digests of plants and laws; then the study is run again, whole, whatever
    its kind: every trial of every controller, tuning and sweeps with it, and every variable must agree to the last
    bit, NaN and signed zeros too. A law that learns can only be replayed from its first trial on, so fewer trials
    would be hardly cheaper, and this way nothing that a record holds is taken on trust. Raises InvalidValue in one
    line that says where the two depart.
    """
    recorded = campaign.recorded
    if recorded is None:
        return
    data, study = campaign.data, campaign.study
    unchanged(campaign)
    now = provenance(study)
    shown = progress.bar if show_progress else progress.silent
    if departed := departure(data, simulate(study, shown)):
        then, here = dict(recorded), dict(now)
        others = [
            f"{name} {then.get(name)} then, {here[name]} now" for name in MADE_WITH if then.get(name) != here[name]
        ]
        besides = f" ({'; '.join(others)})" if others else ""
        raise InvalidValue(
            f"the record must be what the study gives, but {departed}: it was edited, or code that the study calls "
            f"changed since{besides}; {DO}"
        )


def unchanged(campaign: Campaign) -> None:
    """Raise InvalidValue in one line where a campaign that was loaded is of another version or study than is here."""
    recorded, version = campaign.recorded, campaign.data.attrs["version"]
    if recorded is None:
        return
    if version != __version__:
        raise InvalidValue(f"a record is verified by the version that made it, {version}, got {__version__}: {DO}")
    if changed := _changed(campaign, recorded, provenance(campaign.study)):
        raise InvalidValue(f"the study must be the one that was run, but {changed} changed since: {DO}")


def _changed(campaign: Campaign, recorded: Provenance, now: Provenance) -> str:
    """Return what of a study is not as it was recorded, in words, or nothing."""
    if json.loads(campaign.data.attrs["settings"]) != json.loads(json.dumps(settings.as_json(campaign.study))):
        return "its list of settings"
    if recorded["seed"] != now["seed"]:
        return f"its seed, {recorded['seed']} in the record and {now['seed']} in its settings,"
    for then, here, word in (
        (recorded["plants"], now["plants"], "the equations of"),
        (recorded["laws"], now["laws"], "the equations of the law"),
    ):
        for name in {**then, **here}:
            if then.get(name) != here.get(name):
                return f"{word} {name}"
    return ""


def departure(recorded: xr.Dataset, again: xr.Dataset) -> str:
    """Return where a Dataset first departs from another one, in words, or nothing where all bits are the same."""
    for name in {**recorded.variables, **again.variables}:
        if name not in again.variables or name not in recorded.variables:
            return f"{name} is in {'the record' if name in recorded.variables else 'the replay'} alone"
        then, now = recorded.variables[name], again.variables[name]
        if then.dims != now.dims or then.shape != now.shape:
            return f"{name} has the shape {_sized(then)} in the record and {_sized(now)} in the replay"
        if not _same_kind(then.dtype, now.dtype):
            return f"{name} holds {then.dtype} in the record and {now.dtype} in the replay"
        if not xr.core.utils.dict_equiv(then.attrs, now.attrs):
            return f"the attributes of {name} are {then.attrs} in the record and {now.attrs} in the replay"
        different = _different(then.values, now.values)
        if different.any():
            at = tuple(int(i) for i in np.argwhere(different)[0])
            return (
                f"{name}{_place(again, now.dims, at)} is {then.values[at]!s} in the record and {now.values[at]!s} "
                f"in the replay ({int(different.sum())} of {different.size} differ)"
            )
    return ""


def _different(then: NDArray[np.generic], now: NDArray[np.generic]) -> NDArray[np.bool_]:
    """Tell where two arrays differ in any bit."""
    if then.dtype.kind in "UO":
        return np.asarray(then != now)
    bits = np.dtype(f"u{then.dtype.itemsize}")
    different = np.ascontiguousarray(then).view(bits) != np.ascontiguousarray(now).view(bits)
    return np.asarray(different).reshape(np.shape(then))  # a scalar became a row of one on the way


def _same_kind(then: np.dtype[np.generic], now: np.dtype[np.generic]) -> bool:
    return bool(then == now or (then.kind in "UO" and now.kind in "UO"))


def _sized(variable: xr.Variable) -> str:
    return "(" + ", ".join(f"{name} {size}" for name, size in variable.sizes.items()) + ")"


def _place(data: xr.Dataset, dims: tuple[Hashable, ...], at: tuple[int, ...]) -> str:
    """Return where an entry stands, in the words of the axes."""
    named = [f"{dim} {data[dim].values[i] if dim in data.coords else i}" for dim, i in zip(dims, at, strict=True)]
    return f" at {', '.join(named)}" if named else ""
