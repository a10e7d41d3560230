"""A run of BP-FIPID over 2175 samples: the compiled fold against the plain NumPy loop of a researcher."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from models.array import Array
from studies.ato.study import STUDY
from workbench.contracts import settings
from workbench.controllers.bp_fipid import BPFIPID
from workbench.fold.fold import stream
from workbench.trials.simulation import runner_of

PUBLISHED_SECONDS = 36.017

AXIS = np.linspace(-1, 1, 101)
FALL = np.where(AXIS <= -0.5, 1 - 2 * (AXIS + 1) ** 2, 2 * np.minimum(AXIS, 0) ** 2)
HAT, RISE = 1 - np.abs(AXIS), FALL[::-1]


def positive(x: float) -> float:
    if abs(x) >= 1:
        return float(x > 0)
    return 2 * ((x + 1) / 2) ** 2 if x <= 0 else 1 - 2 * ((x - 1) / 2) ** 2


def stimulus(u: float, du: float) -> float:
    pu, pd = positive(u), positive(du)
    zero = max(min(pu, 1 - pd), min(1 - pu, pd))
    degrees = np.maximum(np.minimum(min(pu, pd), FALL), np.minimum(zero, HAT))
    degrees = np.maximum(degrees, np.minimum(min(1 - pu, 1 - pd), RISE))
    return float(AXIS[degrees == degrees.max()].mean())


def plain_loop(reference: Array, weights: tuple[Array, Array]) -> Array:
    """Run plant and law as the paper lists them, sample by sample."""
    n, (w2, w3) = len(reference), weights
    d2, d3 = np.zeros_like(w2), np.zeros_like(w3)
    a = np.exp(-0.2)
    y, u, e = np.zeros(n + 2), np.zeros(n + 7), np.zeros(n + 2)
    for k in range(n):
        paper = k + 1
        delay = 4 if 1470 <= paper <= 1560 or paper >= 1810 else 5
        y[k + 2] = a * y[k + 1] + 0.5 * (1 - a) * u[k + 6 - delay]
        e[k + 2] = reference[k] - y[k + 2]
        bracket = e[k + 2] - e[k + 1] + 0.3 * e[k + 2] + 0.3 * (e[k + 2] - 2 * e[k + 1] + e[k])
        x = np.array([reference[k], y[k + 2], e[k + 2], 1.0])
        o = np.tanh(w2 @ x)
        p = (1 + np.tanh(w3 @ o)) / 2
        f = stimulus(u[k + 6], u[k + 6] - u[k + 5])
        u_next = u[k + 6] + (p[0] - p[1] * f) * bracket
        s = np.sign((y[k + 2] - y[k + 1]) * (u_next - u[k + 6]))
        delta3 = e[k + 2] * s * np.array([bracket, -f * bracket]) * 2 * p * (1 - p)
        delta2 = (1 - o**2) * (w3.T @ delta3)
        d3 = 0.001 * d3 + 0.001 * np.outer(delta3, o)
        d2 = 0.001 * d2 + 0.001 * np.outer(delta2, x)
        w3, w2 = w3 + d3, w2 + d2
        if k + 7 < len(u):
            u[k + 7] = u_next
    return y[2:]


def seconds(run: Callable[[], object], repeats: int) -> float:
    """Return the shortest time of some runs."""
    taken = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        taken.append(time.perf_counter() - begin)
    return min(taken)


def rows() -> list[tuple[str, str, str]]:
    """Return (what, measured, target) for the benchmark table."""
    law = BPFIPID()
    study = settings.changed(STUDY, {"curve": True, "draws": 1, "tune": False, "controllers": {"bp-fipid": law}})
    runner, inputs, reference = runner_of(study, "bp-fipid"), study.inputs(), study.reference_samples

    def built() -> Array:
        return next(runner.trials(inputs)).y[0, :-1]

    def interpreted() -> Array:
        return next(stream(runner.fold, reference, inputs)).y[0, :-1]

    weights = law.weights(study.seed)
    theirs = plain_loop(reference[0, :-1], weights)
    np.testing.assert_allclose(built(), theirs, rtol=1e-9, atol=1e-9)
    compiled_time, machine_time = seconds(built, 20), seconds(interpreted, 5)
    loop_time = seconds(lambda: plain_loop(reference[0, :-1], weights), 3)
    built_ms, loop, machine = 1e3 * compiled_time, 1e3 * loop_time, 1e3 * machine_time
    return [
        (
            "bp-fipid, 2175 samples in the compiled fold",
            f"{built_ms:.2f} ms",
            f"milliseconds (published: {PUBLISHED_SECONDS:.0f} s in MATLAB, another machine)",
        ),
        (f"the same: faster than the plain NumPy loop ({loop:.0f} ms) by", f"{loop / built_ms:.0f}x", "-"),
        (
            f"the same: faster than the virtual machine ({machine:.1f} ms) by",
            f"{machine_time / compiled_time:.1f}x",
            "-",
        ),
    ]


if __name__ == "__main__":
    for row in rows():
        print("  ".join(row))
