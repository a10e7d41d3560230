"""The metro study: a campaign of icfdl (150 trials x 2000 samples) against loops and python-control."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Iterator
from functools import partial

import control
import numpy as np

from benchmarks import loops
from benchmarks.measure import command_time, in_a_new_process, least_times
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.metro.study import STUDY
from workbench.contracts.record import TrialInput
from workbench.controllers import ICFDL
from workbench.fold.fold import build, stream
from workbench.fold.machine_code import compiled
from workbench.trials.campaign import run
from workbench.trials.simulation import Runner

RUN = (
    "from studies.metro.study import STUDY; from workbench.contracts import settings; "
    "from workbench.trials.campaign import run\n"
)


def rows() -> Iterator[tuple[str, str, str]]:
    yield from against_loops()
    yield from whole_run()
    yield from growth()
    yield from memory()
    yield from starts()


def against_loops() -> Iterator[tuple[str, str, str]]:
    inputs, r = STUDY.inputs(), STUDY.reference_samples
    lengths = np.array([one.length for one in inputs])
    fold = Runner(STUDY, "icfdl").fold
    machine = compiled(fold.trial)
    by_numba = loops.numba_campaign()
    mse = loops.recorded(r[0], lengths, by_numba)[0]
    ours = np.array([left.mse[0] for left in stream(fold, r, inputs, trial=machine)])
    few = 2
    system, time = STUDY.plant.to_control(), np.arange(r.shape[1]) * STUDY.plant.sampling_time
    works = {
        "campaign": partial(_streamed, fold, r, inputs, machine),
        "numba": lambda: loops.recorded(r[0], lengths, by_numba),
    }
    least = least_times(works, 40)
    slow = {
        "python": lambda: loops.recorded(r[0], lengths[:few], loops.campaign),
        "machine": partial(_streamed, fold, r, inputs[:10], None),
        "control": lambda: control.input_output_response(system, time, np.full(time.size, 1500.0), [0.0, 0.0]),
    }
    least |= least_times(slow, 3)
    each = least["campaign"] / lengths.size
    agree = float(np.abs(ours / mse - 1).max())
    yield "time of one trial, learning and recording included", f"{1e6 * each:.0f} us", ""
    yield "time over a hand-written loop compiled by numba", f"{least['campaign'] / least['numba']:.2f} x", "<= 1.5 x"
    yield "largest relative difference of an MSE to that loop's", f"{agree:.1e}", ""
    yield "speed-up over the plain Python/NumPy loop", f"{least['python'] / few / each:.0f} x", ">= 100 x"
    yield "speed-up over CasADi's virtual machine", f"{least['machine'] / 10 / each:.1f} x", ""
    yield "speed-up over python-control, one trial without learning", f"{least['control'] / each:.0f} x", ""


def whole_run() -> Iterator[tuple[str, str, str]]:
    """Give what a run of one law takes over its trials alone, which it streams through the same machine code."""
    study = dataclasses.replace(STUDY, controllers={"icfdl": STUDY.controllers["icfdl"]}, sweeps=())
    fold, inputs, r = Runner(study, "icfdl").fold, study.inputs(), study.reference_samples
    machine = compiled(fold.trial)

    def trials() -> None:
        for _ in stream(fold, r, inputs, trial=machine):
            pass

    least = least_times({"run": partial(run, study, show_progress=False), "trials": trials}, 40)
    yield "time of run() of one law", f"{1e3 * least['run']:.0f} ms", ""
    yield "time of run() over that of its trials alone", f"{least['run'] / least['trials']:.2f} x", "<= 2.5 x"


def _streamed(fold, r, inputs, machine):
    """Run a campaign and record what the hand-written loop records, in arrays of its own."""
    trials, n = len(inputs), fold.samples
    speed, position = np.empty((trials, n + 1)), np.empty((trials, n + 1))
    force, estimate, mse = np.empty((trials, n)), np.empty((trials, n)), np.empty(trials)
    for i, left in enumerate(stream(fold, r, inputs, trial=machine)):
        speed[i], position[i], force[i], estimate[i] = left.y[0], left.x[1], left.u[0], left.estimate[0]
        mse[i] = left.mse[0]
    return mse, speed, position, force, estimate


def growth() -> Iterator[tuple[str, str, str]]:
    trials, per_sample = 20, {}
    plant = PointMass(reading="seconds")
    for horizon in (50, 200, 2000):  # seconds, ten samples each
        r = MetroProfile(horizon=horizon).samples(plant)
        n = r.shape[1] - 1
        fold = build(plant, ICFDL(), n)
        machine = compiled(fold.trial)
        inputs = [TrialInput(n, [0, 0], np.zeros((0, n)), np.zeros((1, n + 1)))] * trials
        (least,) = least_times(
            {"": lambda f=fold, r=r, i=inputs, m=machine: list(stream(f, r, i, trial=m))}, 9
        ).values()
        per_sample[n] = least / trials / n
    for n, value in per_sample.items():
        yield f"time a sample at N = {n}", f"{1e9 * value:.0f} ns", ""
    ratio = per_sample[20_000] / per_sample[500]
    yield "time a sample, N = 20000 over N = 500", f"{ratio:.2f} x", "about 1 (linear)"


def memory() -> Iterator[tuple[str, str, str]]:
    quiet = "run(settings.assigned(STUDY, {changes}), show_progress=False)"
    for label, code in {
        "peak memory of the packages alone": RUN,
        "peak memory of a run with its sweep, 2000 samples": RUN + quiet.format(changes=[]),
        "peak memory of a run with its sweep, 20000 samples (reading seconds)": RUN
        + quiet.format(changes=["plant.reading=seconds"]),
    }.items():
        yield label, f"{in_a_new_process(code)[1]:.0f} MB", ""


def starts() -> Iterator[tuple[str, str, str]]:
    with tempfile.TemporaryDirectory() as folder:
        cold = command_time("run", "metro", "--out", f"{folder}/out", WORKBENCH_CACHE=f"{folder}/cache")
        warm = command_time("run", "metro", "--out", f"{folder}/out", WORKBENCH_CACHE=f"{folder}/cache")
    yield "workbench run metro, figures included, nothing built yet", f"{cold:.1f} s", "a few seconds"
    yield "workbench run metro, figures included, built before", f"{warm:.1f} s", "a few seconds"
    for package in ("casadi", "models.point_mass", "workbench", "verification"):
        seconds = min(in_a_new_process(f"import {package}")[0] for _ in range(3))
        yield f"import {package}", f"{seconds:.2f} s", "" if package in ("casadi", "models.point_mass") else "< 0.1 s"
    for command in ("--help", "list"):
        yield f"workbench {command}", f"{min(command_time(command) for _ in range(5)):.2f} s", "< 0.3 s"
