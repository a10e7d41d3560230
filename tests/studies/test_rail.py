"""What a ride costs and how it feels, against closed forms of uniformly accelerated motion."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from models.maglev import Maglev
from models.plant import Signal
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared
from models.transfer import Transfer
from studies.rail.scores import RIDE, ride_scores, train_scores
from workbench.contracts.law import Law
from workbench.contracts.study import Study
from workbench.design.comparison import comparison
from workbench.design.table import headings
from workbench.trials import find

N, TS = 20, 0.1


def study(reading="metro"):
    plant = PointMass(reading=reading)
    return Study(plant=plant, reference=np.ones(N + 1), controllers={"law": Idle()}, trials=2)


@declared
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
    rows = {
        "output": output,
        "input": force,
        "applied": force,
        **{name: np.append(row, np.nan) for name, row in more.items()},
    }
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
    data = ride(np.ones(N + 1), np.full(N, 9e3), applied=np.full(N, -4e3))
    assert ride_scores(study(), data)["law"]["force_peak"] == 4e3
    assert train_scores(study(), data)["law"]["max_abs_input_n"] == 9e3


def rows_of(names, axis, values):
    """Return rows of several channels, of which one counts and the others are 99."""
    shape = (1, 2, len(names), N + 1)
    rows = np.full(shape, 99.0)
    rows[:, :, names.index(values[0])] = values[1]
    return ("controller", "trial", axis, "sample"), rows


def test_the_speed_and_the_force_of_a_train_with_several_signals_are_found_by_their_roles():
    """Maglev has its speed in m/s as the second output; the record has a second input whose rows are no force."""
    train = Study(plant=Maglev(), reference=np.zeros((2, N + 1)), controllers={"law": Idle()}, trials=2)
    speed, force = 0.8 * TS * np.arange(N + 1), np.append(np.full(N, 5e3), np.nan)
    data = xr.Dataset(
        {
            "output": rows_of(["position", "speed"], "output_name", ("speed", speed)),
            "input": (("controller", "trial", "sample"), np.tile(force, (1, 2, 1))),
            "applied": (("controller", "trial", "sample"), np.tile(force, (1, 2, 1))),
            "trial_length": (("trial",), [N, N]),
        },
        {"controller": ["law"], "trial": [1, 2], "sample": np.arange(N + 1), "output_name": ["position", "speed"]},
    )
    step = float(train.plant.sampling_time)
    assert train_scores(train, data)["law"] == {
        "max_abs_input_n": 5e3,
        "max_abs_accel_mps2": pytest.approx(0.8 * TS / step),
    }
    assert ride_scores(train, data)["law"]["energy_kwh"] == pytest.approx(5e3 * 0.8 * TS * N * N / 2 * step / 3.6e6)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"output_signal": Signal("y", "m/s", "speed")}, "an output with the role speed in m/s or km/h, .* y .no role"),
        ({"output_signal": Signal("y", "mph", "speed", role="speed")}, "an output with the role speed in m/s or km/h"),
        (
            {"output_signal": Signal("y", "m/s", "speed", role="speed")},
            "an input with the role force in N or kN, .* command .no role, 1",
        ),
    ],
)
def test_a_plant_without_a_speed_or_a_force_is_told_what_is_missing(fields, message):
    plant = Transfer(sampling_time=TS, **fields)
    other = Study(plant=plant, reference=np.ones(N + 1), controllers={"law": Idle()}, trials=2)
    for scores in (train_scores, ride_scores):
        with pytest.raises(InvalidValue, match=message) as caught:
            scores(other, ride(np.ones(N + 1), np.ones(N)))
        assert "\n" not in str(caught.value)


def test_a_law_that_diverged_has_no_ride():
    gone = np.where(np.arange(N + 1) < 5, 1.0, np.nan)
    found = ride_scores(study(), ride(gone, np.where(np.arange(N) < 5, 1.0, np.nan)))["law"]
    assert set(found.values()) == {None}


@pytest.mark.parametrize("name", ["metro", "same-plant"])
def test_a_comparison_of_laws_on_the_train_shows_the_ride(name):
    shown = list(headings(comparison(find.find(name))).values())
    at = shown.index("jerk (m/s^3)")
    assert shown[at : at + 3] == ["jerk (m/s^3)", "energy (kWh)", "force peak (N)"]
