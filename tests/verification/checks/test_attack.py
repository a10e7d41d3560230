"""Attacks on proved numbers: a number that is a little too strong is contradicted, a true one is not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from judging import over

from models.plant import Plant, signals
from models.quantity import declared, quantity
from verification.checks import attack
from verification.checks.row_sums import off_diagonal
from verification.checks.wanted import follows, wanted_input
from verification.enclosure.box import Box
from verification.theorems.dossier import Dossier
from workbench import Study, run
from workbench.contracts.finding import Standing
from workbench.controllers import Increment

RAMP = np.linspace(0.0, 1.0, 41) ** 2


@declared
class Tank(Plant):
    """A tank whose outflow grows with its level."""

    source = "made for tests, 2026"
    states = outputs = signals(level="1")
    inputs = signals(inflow="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.9 * x.level - 0.02 * x.level**2 + 0.5 * u.inflow,)

    def output(self, x):
        return (x.level,)


@declared
class Sum(Tank):
    """A tank without outflow: every increment is what was put in."""

    def step(self, x, u, w, k):
        return (x.level + 0.5 * u.inflow,)


def made_of(plant):
    law = Increment(force_unit=1.0, lam=1.0, rho=0.8, initial_input=0.1, mu=1.0)
    done = run(Study(plant=plant, reference=RAMP, controllers={"law": law}, trials=12), show_progress=False)
    wide = Box({"x": (-2.0, 3.0), "u": (-4.0, 4.0), "w": (np.zeros(0),) * 2, "k": (0.0, 39.0)}, whole=("k",))
    return over(Dossier(done, "law"), wide)


@pytest.fixture(scope="module")
def dossier():
    return made_of(Tank())


def test_plans_are_bang_bang_held_random_and_near(dossier):
    plans = dossier.tried.u
    low, high = -4.0, 4.0
    assert plans.shape == (attack.PLANS, 40) and plans.min() >= low and plans.max() <= high
    bang = [one for one in plans if set(np.unique(one)) == {low, high}]
    held = [one for one in plans if len(set(one)) == 1]
    near = [one for one in plans if 0 < np.abs(one - dossier.wanted.u).max() < 0.1]
    assert len(bang) >= 15 and len(held) >= 2 and len(near) >= 10


def test_trials_count_until_they_leave_the_set(dossier):
    tried = dossier.tried
    for i in (0, 1, 5, 50):
        outside = (tried.x[i, 0, :40] < -2) | (tried.x[i, 0, :40] > 3)
        assert tried.inside[i] == (int(np.argmax(outside)) if outside.any() else 40)


def test_trajectories_are_those_of_a_plain_loop(dossier):
    for i in (0, 3, 60):
        level = 0.0
        for k, inflow in enumerate(dossier.tried.u[i]):
            assert dossier.tried.x[i, 0, k] == level or not np.isfinite(level)
            level = 0.9 * level - 0.02 * level**2 + 0.5 * inflow
            assert dossier.tried.x[i, 0, k + 1] == pytest.approx(level, rel=1e-12, abs=1e-12)
            level = dossier.tried.x[i, 0, k + 1]
            if abs(level) > 1e6:
                break


def test_only_what_stayed_in_the_set_is_counted(dossier):
    nowhere = dossier.tried._replace(inside=np.zeros_like(dossier.tried.inside))
    plant, w = dossier.plant, dossier.begun.w
    assert attack.held_row_sums(0.0, dossier.slopes, dossier.box, nowhere, 1, True).tries == 0
    assert attack.held_slopes(9.0, 9.0, plant, nowhere, w, 1).tries == 0
    assert attack.held_slopes(0.5, 0.5, plant, dossier.tried, w, 1).tries == int((dossier.tried.inside > 0).sum())


def test_a_row_sum_that_is_too_small_is_contradicted(dossier):
    slopes, box = dossier.slopes, dossier.box
    proved = float(off_diagonal(slopes, 40).max()) + slopes.gain_high
    for p, holds in ((proved, True), (0.5 * (1 - 1e-6), False)):  # df/du is 0.5: no bound lies below
        found = attack.held_row_sums(p, slopes, box, dossier.tried, 1, True)
        assert (found.margin >= 0) == holds


def test_slopes_beyond_which_points_lie_are_contradicted(dossier):
    plant, w = dossier.plant, dossier.begun.w
    assert attack.held_slopes(0.5, 0.5, plant, dossier.tried, w, 1).margin >= 0
    for low, high in ((0.51, 0.6), (0.4, 0.49)):
        assert attack.held_slopes(low, high, plant, dossier.tried, w, 1).margin < 0


SLIPS = {
    "none": (lambda slopes: slopes, True),
    "twice the least gain": (
        lambda slopes: dataclasses.replace(slopes, gain_low=2 * slopes.gain_low, gain_high=slopes.gain_low),
        False,
    ),
    "no memory": (lambda slopes: dataclasses.replace(slopes, c=np.zeros_like(slopes.c)), False),
}


@pytest.mark.parametrize(("plant", "slip"), [(Tank(), "none"), (Tank(), "no memory"), *((Sum(), one) for one in SLIPS)])
def test_a_contraction_that_is_too_strong_is_contradicted(plant, slip):
    d = made_of(plant)
    made, holds = SLIPS[slip]
    estimates = d.evidence.trajectories.estimate
    found = attack.held_contraction(d.estimator, made(d.slopes), d.wanted, d.box, d.recorded, estimates, d.tried, 1.0)
    assert (found.margin >= 0) == (holds or (slip == "no memory" and isinstance(plant, Sum)))


def test_the_wanted_input_follows_exactly_where_it_is_shown_to(dossier):
    found = follows(dossier.wanted, dossier.box)
    assert found.standing is Standing.PROVED and found.bound < 1e-12
    level = 0.0
    for k, gained in enumerate(np.diff(RAMP)):
        exact = (gained + 0.1 * level + 0.02 * level**2) / 0.5
        assert dossier.wanted.u[k] == pytest.approx(exact, abs=1e-12)
        level += gained


def test_a_box_whose_wall_is_too_near_holds_no_wanted_input(dossier):
    top = float(dossier.wanted.u.max())
    for wall, standing in ((top + 1e-6, Standing.PROVED), (top - 1e-6, Standing.UNDECIDED)):
        box = Box({**dossier.box, "u": (-4.0, wall)}, whole=("k",))
        assert follows(dossier.wanted, box).standing is standing


def test_misses_are_counted(dossier):
    """An input that is 1e-6 off at a sample leaves an exact one within a few 1e-6 of it, and not within 1e-9."""
    off = dossier.wanted.u.copy()
    off[7] += 1e-6
    found = follows(dataclasses.replace(wanted_input(dossier.study), u=off), dossier.box)
    assert found.standing is Standing.PROVED and 1e-7 < found.bound < 1e-3
