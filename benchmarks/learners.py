"""Periods and trials of the maglev and variable-gain studies: time a sample beside the metro study's."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchmarks.measure import least_times
from studies.maglev.study import STUDY as MAGLEV
from studies.metro.study import STUDY as METRO
from studies.variable_gain.study import STUDY as VARIABLE_GAIN
from workbench.contracts.study import Study
from workbench.trials.simulation import runner_of

CASES = (
    ("metro: icfdl, a trial of 2000 samples", METRO, "icfdl", 50),
    ("metro: pd, a trial of 2000 samples", METRO, "pd", 50),
    ("maglev: pid, a period of 17800 samples (four stages of Runge-Kutta)", MAGLEV, "pid", 6),
    ("maglev: palc, the same", MAGLEV, "palc", 6),
    ("maglev: palc-filtered, the same and a zero-phase filter", MAGLEV, "palc-filtered", 6),
    ("variable-gain: variable, a trial of 1040 samples (eight stages)", VARIABLE_GAIN, "variable", 50),
    ("variable-gain: fixed, the same", VARIABLE_GAIN, "fixed", 50),
)


def work(study: Study, name: str, trials: int) -> Callable[[], None]:
    runner, inputs = runner_of(study, name), study.inputs()[:1] * trials

    def run() -> None:
        for _ in runner.trials(inputs):
            pass

    return run


def rows() -> Iterator[tuple[str, str, str]]:
    works = {what: work(study, name, trials) for what, study, name, trials in CASES}
    least = least_times(works, 9)
    nanoseconds = {what: 1e9 * least[what] / trials / study.horizon for what, study, _, trials in CASES}
    first = nanoseconds[CASES[0][0]]
    for what, value in nanoseconds.items():
        yield f"{what}, time a sample", f"{value:.0f} ns", ""
        if what != CASES[0][0]:
            yield "   over the metro study's icfdl", f"{value / first:.1f} x", "the same order"
