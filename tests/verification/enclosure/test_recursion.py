"""Sets carried by machine code against what points do, and against the enclosures of the Python engine."""

import numpy as np
import pytest

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from verification.enclosure.recursion import Question, Recursion


def question(samples, wanted, plan, gain, **more):
    wide = np.stack([np.nextafter(wanted, -np.inf), np.nextafter(wanted, np.inf)], axis=-1)
    given = {
        "start": np.zeros((2, 2)),
        "disturbance": np.zeros((samples, 0, 2)),
        "parameters": np.zeros((0, 2)),
        "wanted": wide,
        "plan": np.full((samples, 2), plan),
        "most_gain": gain,
    }
    return Question(**(given | more))


@pytest.mark.parametrize(("line", "low", "high"), [("flat", -74.9, 72.0), ("hilly", -135.0, 120.0)])
def test_the_band_of_the_train_is_that_of_a_computation_by_hand(line, low, high):
    """The train's equations in intervals, written by hand with exact ranges of drag and grade, give these bands."""
    plant = PointMass(line=line)
    r = MetroProfile().samples(plant)[0]
    found = Recursion(plant, r.size - 1).carry(question(r.size - 1, np.diff(r), 1500.0, 173_241.2))
    assert (found.ended, found.sample) == ("fine", -1)
    assert found.y.min() == pytest.approx(low, rel=0.01) and found.y.max() == pytest.approx(high, rel=0.01)
    assert found.y.max() > r.max()
