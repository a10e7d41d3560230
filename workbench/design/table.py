"""Comparing laws in one call: tune, run, the table, the time that a sample takes."""

from __future__ import annotations

import csv
import dataclasses
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from workbench.contracts.law import AnyLaw
from workbench.contracts.settings import assigned
from workbench.contracts.study import Study
from workbench.design.comparison import comparison
from workbench.design.one_error import weighed
from workbench.trials.campaign import Campaign, run
from workbench.trials.draft import replacing
from workbench.trials.simulation import ready


def compare(
    study: Study, laws: Sequence[str] | None = None, settings: Sequence[str] = (), *, show_progress: bool = True
) -> Campaign:
    """Tune and run laws on a study's plant, with settings as ``--set`` takes them; return the campaign."""
    return run(assigned(comparison(study, laws), settings), show_progress=show_progress)


def headings(study: Study) -> dict[str, str]:
    """Return what the table calls every metric, those that the study measures besides included."""
    measured = {metric: heading for one in study.compared for metric, heading in one.headings.items()}
    unit = weighed(study).unit
    return {
        "mse": f"MSE, mean over trials ({unit})",
        "mse_last": f"final MSE ({unit})",
        "trials_needed": "trials needed",
        **measured,
        "solves": "solves",
    }


def table(campaign: Campaign, times: Mapping[str, float] | None = None) -> list[tuple[str, ...]]:
    """Return the table of a comparison, its header first; with ``times`` also the time a sample (microseconds).

    Without times it is the same for the same settings and seed, to the last digit. ``told`` is what a law uses of what
    it could be told, ``learns on`` the signal whose error it learns on between trials.
    """
    study, data = campaign.study, campaign.data
    columns = headings(study)
    timed = [] if times is None else ["time per sample (us)"]
    rows: list[tuple[str, ...]] = [("law", *columns.values(), "told", "learns on", *timed, "note")]
    refused = dict(zip(data["refused_law"].values.tolist(), data["refused"].values.tolist(), strict=True))
    for name, metrics in campaign.scores().items():
        law = study.controllers[name]
        cells = [_shown(metrics.get(metric)) for metric in columns]
        took = [] if times is None else [f"{times[name]:.3f}" if name in times else "-"]
        if name in refused:
            note = f"does not suit: {refused[name]}"
        else:
            note = str(data["stopped"].sel(controller=name).values) or _dead_time(study, law)
        rows.append((name, *cells, ", ".join(law.told), law.learns_on or "-", *took, note))
    return rows


def _dead_time(study: Study, law: AnyLaw) -> str:
    """Return what is to be noted of a law that learns from the next sample, on a plant that answers later."""
    degree = study.relative_degree
    if law.learns_on is None or "delay" in law.told or degree in (1, None):
        return ""
    return f"learns from the error at k+1, u(k) first reaches y(k+{degree})"


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"


def settled(campaign: Campaign) -> Campaign:
    """Return a comparison as a campaign of the laws that tuning found, those that ran, which is not tuned again."""
    refused = set(map(str, campaign.data["refused_law"].values))
    laws = {name: law for name, law in campaign.tuned_laws().items() if name not in refused}
    study = dataclasses.replace(campaign.study, controllers=laws, tuning=None, scorers=(), drawings=None)
    return Campaign(study, campaign.data.sel(controller=list(laws)))


def times(campaign: Campaign, repeats: int = 5) -> dict[str, float]:
    """Measure the time that a sample of plant and law takes, in microseconds, learning included; by law."""
    study = settled(campaign).study
    inputs = study.inputs()[:1] * repeats
    found = {}
    for name, runner in ready(study, study.controllers).items():
        running, taken = runner.trials(inputs), []
        for _ in inputs:
            begin = time.perf_counter()
            next(running)
            taken.append(time.perf_counter() - begin)
        found[name] = 1e6 * min(taken) / study.horizon
    return found


def save(campaign: Campaign, folder: str | os.PathLike[str], measured: Mapping[str, float]) -> None:
    """Replace a folder by what every run writes, with table.csv, and times.csv, which no two runs share."""
    with replacing(folder) as draft:
        campaign.record(draft)
        campaign.write(draft)
        write_tables(campaign, draft, measured)


def write_tables(campaign: Campaign, folder: Path, measured: Mapping[str, float]) -> None:
    """Write table.csv, and the measured times as times.csv, into a folder."""
    with (folder / "table.csv").open("w", newline="") as file:
        csv.writer(file).writerows(table(campaign))
    with (folder / "times.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("law", "time per sample (us)"), *measured.items()])
