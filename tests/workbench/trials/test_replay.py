"""Recorded trials against an independent plain-Python replay of plant and law."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import CFDL, ICFDL, PD
from workbench.trials.campaign import run

M, TS, G, LENGTH = 350_000.0, 0.1, 9.81, 140.0
GRADES = {"flat": [], "hilly": [(600, 6), (1100, -4), (1700, 3), (2300, -8), (3000, 0)]}


def mean_grade(line: str, s: float) -> float:
    """Average the grades over the train by adding up the pieces that it lies on."""
    total, rear = 0.0, s - LENGTH
    pieces = GRADES[line]
    for index, (start, grade) in enumerate(pieces):
        end = pieces[index + 1][0] if index + 1 < len(pieces) else math.inf
        total += grade * max(0.0, min(s, end) - max(rear, start))
    return total / LENGTH


def plant_loop(reading: str, line: str, u: list[float], length: int) -> list[float]:
    """Run the train from rest, sample by sample, and return its speeds up to the trial's end."""
    v, s, speeds = 0.0, 0.0, [0.0]
    factor = 1.0 if reading == "printed" else 3.6
    for k in range(length):
        swing = math.sin(0.0037 * k * (TS if reading == "seconds" else 1))
        fb = 2977 + 275 * swing + (25.17 + 2.5 * swing) * v + (0.2864 + 0.04 * swing) * v * v
        fa = M * G * mean_grade(line, s) / 1000
        if reading == "printed":
            fb, fa = fb / M, G * math.sin(math.atan(mean_grade(line, s) / 1000))
        v, s = v + factor * TS / M * (u[k] - fa - fb), s + TS * v / factor
        speeds.append(v)
    return speeds


def mfailc_loop(reference, lengths, reading, line, unit, trials):
    """Run (11)-(15) with plain loops; yield input, speed and estimate of every trial."""
    n = len(reference) - 1
    eta, rho, lam, mu, eps = 1.0, 0.245, 5e-5, 0.1, 1e-5
    phi0 = math.sqrt(lam)
    u, phi = [1500.0 / unit] * n, [phi0] * n
    before = None
    for i in range(trials):
        v = plant_loop(reading, line, [unit * value for value in u], lengths[i])
        yield [unit * value for value in u], v, [value / unit for value in phi]
        next_phi, next_u = list(phi), list(u)
        for k in range(n):
            du = u[k] - before[0][k] if before else 0.0
            value = phi[k]
            if before and k + 1 <= min(lengths[i], lengths[i - 1]):
                value += eta * du / (mu + du * du) * (v[k + 1] - before[1][k + 1] - phi[k] * du)
            if abs(value) <= eps or abs(du) <= eps or value <= 0:
                value = phi0
            next_phi[k] = value
            if k + 1 <= lengths[i]:
                next_u[k] = u[k] + rho * value / (lam + value**2) * (reference[k + 1] - v[k + 1])
        before, u, phi = (u, v), next_u, next_phi


def pd_loop(reference, lengths, reading, line, unit, trials):
    """Run (18) with plain loops; yield input, speed and no estimate of every trial."""
    n = len(reference) - 1
    u = [1500.0 / unit] * n
    for i in range(trials):
        v = plant_loop(reading, line, [unit * value for value in u], lengths[i])
        yield [unit * value for value in u], v, None
        e = [reference[k] - v[k] if k <= lengths[i] else 0.0 for k in range(n + 1)]
        u = [u[k] + 4.46 * e[k + 1] + 1000 * e[k] for k in range(n)]


CASES = [
    ("icfdl", ICFDL(), mfailc_loop, 100.0, "metro", "hilly", "uniform"),
    ("icfdl", ICFDL(), mfailc_loop, 100.0, "metro", "flat", "fixed"),
    ("icfdl", ICFDL(force_unit=1000.0), mfailc_loop, 1000.0, "printed", "hilly", "uniform"),
    ("cfdl", CFDL(), mfailc_loop, 100.0, "metro", "hilly", "fixed"),
    ("pd", PD(), pd_loop, 1.0, "metro", "hilly", "uniform"),
    ("pd", PD(), pd_loop, 1.0, "printed", "flat", "uniform"),
]


@pytest.mark.parametrize(("name", "law", "oracle", "unit", "reading", "line", "lengths"), CASES)
def test_recorded_trials_replay(name, law, oracle, unit, reading, line, lengths):
    trials = 40
    study = Study(
        plant=PointMass(reading=reading, line=line),
        reference=MetroProfile(),
        controllers={name: law},
        trials=trials,
        trial_length=TrialLength(law=lengths),
    )
    data = run(study, show_progress=False).data.isel(controller=0)
    reference = data["reference"].values.tolist()
    ends = data["trial_length"].values.tolist()
    for i, (u, v, phi) in enumerate(oracle(reference, ends, reading, line, unit, trials)):
        np.testing.assert_allclose(data["input"][i, :-1], u, rtol=1e-9, atol=1e-9 * np.abs(u).max())
        np.testing.assert_allclose(data["output"][i, : ends[i] + 1], v, rtol=1e-9, atol=1e-9 * 72)
        assert data["output"][i, ends[i] + 1 :].isnull().all()
        if phi is not None:
            np.testing.assert_allclose(data["ppd_estimate"][i, :-1], phi, rtol=1e-7)
