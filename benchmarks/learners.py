"""Periods and trials of the maglev and variable-gain studies: time a sample beside the metro study's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.measure import least_times
from studies.maglev.study import STUDY as MAGLEV
from studies.metro.study import STUDY as METRO
from studies.variable_gain.study import STUDY as VARIABLE_GAIN
from workbench.fold.fold import stream
from workbench.fold.machine_code import compiled

CASES = (
    ("metro: icfdl, a trial of 2000 samples", METRO, "icfdl", 50),
    ("metro: pd, a trial of 2000 samples", METRO, "pd", 50),
    ("maglev: pid, a period of 17800 samples (four stages of Runge-Kutta)", MAGLEV.trial_study, "pid", 6),
    ("maglev: palc, the same", MAGLEV.trial_study, "palc", 6),
    ("maglev: palc-filtered, the same and a zero-phase filter", MAGLEV.trial_study, "palc-filtered", 6),
    ("variable-gain: variable, a trial of 1040 samples (eight stages)", VARIABLE_GAIN.trial_study, "variable", 50),
    ("variable-gain: fixed, the same", VARIABLE_GAIN.trial_study, "fixed", 50),
)


def work(study: Any, name: str, trials: int) -> Any:
    fold, r = study.fold(name), study.reference_samples
    inputs, machine = study.inputs()[:1] * trials, compiled(fold.trial)
    return lambda: [None for _ in stream(fold, r, inputs, trial=machine, carry_state=study.continues)]


def rows() -> Iterator[tuple[str, str, str]]:
    works = {what: work(study, name, trials) for what, study, name, trials in CASES}
    least = least_times(works, 9)
    nanoseconds = {what: 1e9 * least[what] / trials / study.horizon for what, study, _, trials in CASES}
    first = nanoseconds[CASES[0][0]]
    for what, value in nanoseconds.items():
        yield f"{what}, time a sample", f"{value:.0f} ns", ""
        if what != CASES[0][0]:
            yield "   over the metro study's icfdl", f"{value / first:.1f} x", "the same order"
