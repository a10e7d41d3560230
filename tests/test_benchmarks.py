"""What the benchmarks compare is the same work."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

import benchmarks
from benchmarks import loops
from studies.metro.study import STUDY
from workbench.trials.simulation import Runner


def test_the_hand_written_loop_is_the_same_law():
    study = dataclasses.replace(STUDY, trials=8)
    inputs, r = study.inputs(), study.reference_samples
    lengths = np.array([one.length for one in inputs])
    mse, speeds, positions, forces, estimates = loops.recorded(r[0], lengths, loops.campaign)
    for i, left in enumerate(Runner(study, "icfdl").trials(inputs)):
        end = lengths[i] + 1
        assert left.mse[0] == pytest.approx(mse[i], rel=1e-9)
        np.testing.assert_allclose(left.y[0], speeds[i], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(left.x[1, :end], positions[i, :end], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(left.u[0], forces[i], rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(left.estimate[0], estimates[i], rtol=1e-7)


def test_every_module_with_rows_is_found():
    names = [info.name for info in pkgutil.iter_modules(benchmarks.__path__)]
    found = [
        name for name in names if name != "__main__" and hasattr(importlib.import_module(f"benchmarks.{name}"), "rows")
    ]
    assert "metro" in found
