"""Bands of linear plants by plain intervals: of every trial, or of trials whose plans lie between given ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soundness.case import Case
from soundness.curves import Numbers

Array = NDArray[np.float64]


def bands(case: Case, plans: Array | None) -> tuple[Array, Array, Array]:
    """Return bands of the output (N + 1, 2), of inputs and of their targets (N, 2).

    Inputs lie between the ends of plans (N, 2), or, where these are None, as in all trials: between the first plan and
    the targets.
    """
    of = case.acting
    start = np.array(case.start or (0.0,) * of.states)
    x = np.stack([start - case.spread, start + case.spread], axis=-1)
    output, inputs, targets = [x[0]], [], []
    for k in range(case.horizon):
        b = float(of.gain_at(Numbers, k)) * float(of.drive.slope(0.0))
        w = np.array([-case.drawn, case.drawn]) + (0.0 if case.given is None else case.given[k])
        free = _between(np.array([of.a[0] - 1.0, *of.c[:1]]), x[:2]) + w
        rise = case.reference[k + 1] - case.reference[k] + 2 * case.noise * np.array([-1.0, 1.0])
        target = np.sort((rise - free[::-1]) / b)
        every = np.array([min(case.law.first, target[0]), max(case.law.first, target[1])])
        u = every if plans is None else plans[k]
        rows = []
        for i in range(of.states):
            rows.append(_between(np.array([of.a[i], *of.c[i : i + 1]]), x[i : i + 2]))
        rows[0] = rows[0] + np.sort(b * u) + w
        x = np.array(rows)
        output.append(x[0])
        inputs.append(u)
        targets.append(target)
    return np.array(output), np.array(inputs), np.array(targets)


def _between(factors: Array, ends: Array) -> Array:
    """Return the ends of a sum of factors times what lies between ends, (n, 2)."""
    return np.sort(factors[: len(ends), None] * ends, axis=1).sum(axis=0)
