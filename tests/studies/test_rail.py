"""What a ride costs and how it feels, against closed forms of uniformly accelerated motion."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from models.point_mass import PointMass
from studies.rail.scores import RIDE, ride_scores, train_scores
from workbench.contracts.law import Law
from workbench.design.comparison import comparison
from workbench.design.table import headings
from workbench.trials import find
from workbench.trials.study import TrialStudy

N, TS = 20, 0.1


def study(reading="metro"):
    plant = PointMass(reading=reading)
    return TrialStudy(plant=plant, reference=np.ones(N + 1), controllers={"law": Idle()}, trials=2)


class Idle(Law):
    source = "ours, 2026"

    def start(self, task):
        return ()

    def act(self, memory_k, state, r, r_next, y):
        return 0.0, state


def ride(output, force, **more):
    """Return the record of a law whose first trial stood still and whose last one had this output and force."""
    axes = ("controller", "trial", "sample")
    force = np.append(force, np.nan)
    rows = {"output": output, "input": force, **{name: np.append(row, np.nan) for name, row in more.items()}}
    return xr.Dataset(
        {name: (axes, np.stack([np.zeros(N + 1), row])[None]) for name, row in rows.items()}
        | {"trial_length": (("trial",), [N, N])},
        {"controller": ["law"], "trial": [1, 2], "sample": np.arange(N + 1)},
    )


@pytest.mark.parametrize(("reading", "factor"), [("metro", 3.6), ("printed", 1.0)])
def test_a_uniform_acceleration(reading, factor):
    """From rest at a = 0.8 m/s^2 under 5 kN: the work is F a T^2 / 2, and there is no jerk."""
    a, force, end = 0.8, 5e3, N * TS
    data = ride(factor * a * TS * np.arange(N + 1), np.full(N, force))
    found = ride_scores(study(reading), data)["law"]
    assert list(found) == list(RIDE.headings)
    assert found["energy_kwh"] == pytest.approx(force * a * end**2 / 2 / 3.6e6)
    assert found["max_jerk"] == pytest.approx(0, abs=1e-9)
    assert found["force_peak"] == force
    about = train_scores(study(reading), data)["law"]
    assert about == {"max_abs_input_n": force, "max_abs_accel_mps2": pytest.approx(a)}


def test_a_change_of_acceleration_is_a_jerk_and_braking_draws_nothing():
    speed = np.minimum(np.arange(N + 1), N - np.arange(N + 1)) * TS
    force = np.where(np.arange(N) < N // 2, 7e3, -9e3)
    found = ride_scores(study(), ride(3.6 * speed, force))["law"]
    assert found["max_jerk"] == pytest.approx(2 / TS)  # from 1 to -1 m/s^2 within a sample
    assert found["energy_kwh"] == pytest.approx(7e3 * (N // 2 * TS) ** 2 / 2 / 3.6e6)
    assert found["force_peak"] == 9e3


def test_what_acts_behind_the_actuator_counts():
    data = ride(np.ones(N + 1), np.full(N, 9e3), applied_force=np.full(N, -4e3))
    assert ride_scores(study(), data)["law"]["force_peak"] == 4e3
    assert train_scores(study(), data)["law"]["max_abs_input_n"] == 9e3


def test_a_law_that_diverged_has_no_ride():
    gone = np.where(np.arange(N + 1) < 5, 1.0, np.nan)
    found = ride_scores(study(), ride(gone, np.where(np.arange(N) < 5, 1.0, np.nan)))["law"]
    assert set(found.values()) == {None}


@pytest.mark.parametrize("name", ["metro", "same-plant"])
def test_a_comparison_of_laws_on_the_train_shows_the_ride(name):
    shown = list(headings(comparison(find.find(name))).values())
    ride = ["jerk (m/s^3)", "energy (kWh)", "force peak (N)"]
    assert shown == ["MSE, mean over trials", "final MSE", "trials needed", *ride, "solves"]
