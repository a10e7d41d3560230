"""The funnel of the metro train: sets of states carried through a trial, rigorous."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.measure import least_times
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.metro.study import STUDY
from verification.enclosure.carried import Question
from verification.enclosure.recursion import Recursion
from workbench.trials.simulation import Runner

SAMPLES = 20_000
GAIN = 173_241.2  # N per km/h: rho/(2 sqrt(lambda)) of the increment law as shipped


def question(reference: np.ndarray, plan: float) -> Question:
    n = reference.size - 1
    by = np.diff(reference)
    return Question(
        start=np.zeros((2, 2)),
        disturbance=np.zeros((n, 0, 2)),
        parameters=np.zeros((0, 2)),
        wanted=np.stack([np.nextafter(by, -np.inf), np.nextafter(by, np.inf)], axis=-1),
        plan=np.full((n, 2), plan),
        most_gain=GAIN,
    )


def carrying(line: str, samples: int) -> Callable[[], object]:
    plant = PointMass(line=line, sampling_time=0.1 * 2000 / samples)
    whole = MetroProfile().samples(PointMass(line=line))[0]
    reference = np.interp(np.linspace(0, whole.size - 1, samples + 1), np.arange(whole.size), whole)
    recursion, asked = Recursion(plant, samples), question(reference, 1500.0)
    found = recursion.carry(asked)
    assert found.ended == "fine", found.ended
    return lambda: recursion.carry(asked)


def trials() -> Callable[[], object]:
    study = dataclasses.replace(STUDY, controllers={"increment": STUDY.controllers["increment"]}, sweeps=())
    inputs, runner = study.inputs(), Runner(study, "increment")
    return lambda: sum(1 for _ in runner.trials(inputs))


def rows() -> Iterator[tuple[str, str, str]]:
    works: dict[str, Callable[[], object]] = {
        "flat": carrying("flat", 2000),
        "hilly": carrying("hilly", 2000),
        "flat, long": carrying("flat", SAMPLES),
        "hilly, long": carrying("hilly", SAMPLES),
        "trials": trials(),
    }
    took = least_times(works, 5)
    yield (
        "funnel over N = 20 000, flat / hilly",
        f"{took['flat, long']:.2f} / {took['hilly, long']:.2f} s",
        "< 1 s",
    )
    yield (
        "time a sample at N = 20 000 over N = 2000",
        f"{took['flat, long'] / took['flat'] / 10:.2f} x",
        "about 1 (linear)",
    )
    yield "funnel of 2000 samples over a campaign of 150 trials of them", f"{took['flat'] / took['trials']:.2f} x", ""
    yield "hilly line over flat line", f"{took['hilly'] / took['flat']:.1f} x", ""
