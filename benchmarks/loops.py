"""What a researcher would write instead: icfdl on the metro train, as plain loops over samples."""

from __future__ import annotations

import math
import types

import numpy as np

STARTS = np.array([600.0, 1100.0, 1700.0, 2300.0, 3000.0])
CHANGES = np.array([6.0, -10.0, 7.0, -11.0, 8.0])


def trial(u, v, s, length, starts, changes):
    """Run one trial of the train in place: v, s (N + 1,) are filled up to the trial's end."""
    mass, ts = 350_000.0, 0.1
    for k in range(length):
        swing = math.sin(0.0037 * k)
        b0 = 2977.0 + 275.0 * swing
        b1 = 25.17 + 2.5 * swing
        b2 = 0.2864 + 0.04 * swing
        grade = 0.0
        for j in range(starts.size):
            front, rear = s[k] - starts[j], s[k] - 140.0 - starts[j]
            grade += changes[j] * (max(0.0, front) - max(0.0, rear)) / 140.0
        slope = mass * 9.81 * grade / 1000.0
        v[k + 1] = v[k] + 3.6 * ts / mass * (u[k] - slope - b0 - b1 * v[k] - b2 * v[k] * v[k])
        s[k + 1] = s[k] + ts * v[k] / 3.6


def learn(u, u_before, v, v_before, phi, r, length, length_before, known_before, unit, phi0):
    """Learn in place, (13)-(15): u_before and v_before become this trial's, u and phi the next one's."""
    eta, rho, lam, mu, eps = 1.0, 0.245, 5e-5, 0.1, 1e-5
    for k in range(u.size):
        du = (u[k] - u_before[k]) / unit
        if known_before and k + 1 <= length and k + 1 <= length_before:
            phi[k] += eta * du / (mu + du * du) * (v[k + 1] - v_before[k + 1] - phi[k] * du)
        if abs(phi[k]) <= eps or abs(du) <= eps or phi[k] <= 0.0:
            phi[k] = phi0
        u_before[k] = u[k]
        if k + 1 <= length:
            u[k] += unit * rho * phi[k] / (lam + phi[k] * phi[k]) * (r[k + 1] - v[k + 1])
    for k in range(v.size):
        v_before[k] = v[k]


def campaign(r, lengths, speeds, positions, inputs, estimates, starts, changes, unit):
    """Run every trial, recording speed, position, input and estimate; return the mean square errors."""
    n = r.size - 1
    phi0 = math.sqrt(5e-5)
    u, u_before = np.full(n, 1500.0), np.full(n, 1500.0)
    phi = np.full(n, phi0)
    v, v_before, s = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    mse = np.zeros(lengths.size)
    for i in range(lengths.size):
        trial(u, v, s, lengths[i], starts, changes)
        total = 0.0
        for k in range(1, lengths[i] + 1):
            total += (r[k] - v[k]) ** 2
        mse[i] = total / lengths[i]
        for k in range(n + 1):
            speeds[i, k] = v[k] if k <= lengths[i] else np.nan
            positions[i, k] = s[k]
        for k in range(n):
            inputs[i, k] = u[k]
            estimates[i, k] = phi[k] / unit
        learn(u, u_before, v, v_before, phi, r, lengths[i], lengths[i - 1], i > 0, unit, phi0)
    return mse


def recorded(r, lengths, run, unit=100.0):
    """Return the mean square errors and what a campaign records, in arrays of its own."""
    trials, n = lengths.size, r.size - 1
    rows = [np.empty((trials, n + 1)), np.empty((trials, n + 1)), np.empty((trials, n)), np.empty((trials, n))]
    return run(r, lengths, *rows, STARTS, CHANGES, unit), *rows


def numba_campaign():
    """Return the same campaign compiled by numba."""
    import numba

    loops = {"trial": numba.njit(trial), "learn": numba.njit(learn), "np": np, "math": math}
    return numba.njit(types.FunctionType(campaign.__code__, loops, "campaign"))
