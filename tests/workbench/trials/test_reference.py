"""The reference of a study: computed once, and the same for everybody who asks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.point_mass import PointMass
from models.reference import Reference
from workbench.contracts.study import Study
from workbench.controllers import ICFDL, PD
from workbench.trials.campaign import run

ROW = 70 * np.sin(np.linspace(0, np.pi, 41))


class Counted(Reference):
    """A reference that counts how often it is asked."""

    def __init__(self, row):
        self.row, self.asked = row, 0

    def samples(self, plant):
        self.asked += 1
        return self.row[None, :]


def study(reference):
    return Study(plant=PointMass(), reference=reference, controllers={"icfdl": ICFDL(), "pd": PD()}, trials=7)


def test_a_run_computes_the_reference_once():
    counted = Counted(ROW)
    done = run(study(counted), show_progress=False)
    done.scores()
    assert counted.asked == 1
    assert np.array_equal(done.data["reference"].values, ROW)


def test_another_study_computes_its_own():
    counted = Counted(ROW)
    first = study(counted)
    counted.row = 2 * ROW
    second = dataclasses.replace(first, trials=3)
    assert np.array_equal(first.reference_samples[0], ROW)
    assert np.array_equal(second.reference_samples[0], 2 * ROW)
    assert counted.asked == 2


def test_nobody_changes_it_behind_the_study_s_back():
    row = ROW.copy()
    one = study(row)
    row[:] = 0
    assert np.array_equal(one.reference_samples[0], ROW)
    with pytest.raises(ValueError, match="read-only"):
        one.reference_samples[0, 3] = 1.0
    kept = run(one, show_progress=False).data["reference"]
    kept[3] = 1.0
    assert np.array_equal(one.reference_samples[0], ROW)
