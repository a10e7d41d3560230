"""Comparing laws in one call: tune, run, the table, the time that a sample takes."""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.design.comparison import Comparison, comparison
from workbench.fold.fold import Fold, stream
from workbench.fold.machine_code import compiled
from workbench.trials.campaign import Campaign, run
from workbench.trials.draft import replacing
from workbench.trials.settings import assigned


def compare(
    study: Any, laws: Sequence[str] | None = None, settings: Sequence[str] = (), *, show_progress: bool = True
) -> Campaign:
    """Tune and run laws on a study's plant, with settings as ``--set`` takes them; return the campaign."""
    return run(assigned(comparison(study, laws), settings), show_progress=show_progress)


def headings(study: Comparison) -> dict[str, str]:
    """Return what the table calls every metric, those that the study measures besides included."""
    measured = {metric: heading for one in study.measures for metric, heading in one.headings.items()}
    return {
        "mse": "MSE, mean over trials",
        "mse_last": "final MSE",
        "trials_needed": "trials needed",
        **measured,
        "solves": "solves",
    }


def table(campaign: Campaign, times: Mapping[str, float] | None = None) -> list[tuple[str, ...]]:
    """Return the table of a comparison, its header first; with ``times`` also the time a sample (microseconds).

    Without times it is the same for the same settings and seed, to the last digit.
    """
    columns = headings(campaign.study)
    header = ["law", *columns.values(), *(["time per sample (us)"] if times is not None else []), "note"]
    rows = [tuple(header)]
    refused = dict(
        zip(campaign.data["refused_law"].values.tolist(), campaign.data["refused"].values.tolist(), strict=True)
    )
    stopped = {
        str(name): str(why)
        for name, why in zip(campaign.data["controller"].values, campaign.data["stopped"].values, strict=True)
    }
    for name, metrics in campaign.scores().items():
        cells = [_shown(metrics.get(metric)) for metric in columns]
        timed = [] if times is None else [f"{times[name]:.3f}" if name in times else "-"]
        note = f"does not suit: {refused[name]}" if name in refused else stopped.get(name, "")
        rows.append((name, *cells, *timed, note))
    return rows


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"


def times(campaign: Campaign, repeats: int = 5) -> dict[str, float]:
    """Measure the time that a sample of plant and law takes, in microseconds, learning included; by law."""
    study: Comparison = campaign.study
    laws = study.tuned_laws(campaign.data)
    ready = study.study(laws, true=True, seed=study.seed)
    one = ready.inputs()[:1] * repeats
    found = {}
    for name in laws:
        fold: Fold = ready.fold(name)
        running = stream(fold, ready.reference_samples, one, trial=compiled(fold.trial))
        taken = []
        for _ in range(repeats):
            begin = time.perf_counter()
            next(running)
            taken.append(time.perf_counter() - begin)
        found[name] = 1e6 * min(taken) / fold.samples
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
