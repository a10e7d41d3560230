"""A short trip of the metro train, of which every claim is proved, and one thing at a time that leaves it open."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from judging import standings

from models.plant import signals
from models.point_mass import PointMass
from models.quantity import declared
from studies.metro.study import STUDY as METRO
from verification.theorems.dossier import Dossier
from workbench import run
from workbench.contracts import settings
from workbench.contracts.finding import Standing
from workbench.contracts.scenario import Between, From, NormalDisturbance, UniformNoise
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import Increment

PROVED, UNDECIDED = Standing.PROVED, Standing.UNDECIDED


@declared
class Pushed(PointMass):
    """The train, on which a wind pushes."""

    disturbances = signals(wind="N")

    def step(self, x, u, w, k):
        v, s = super().step(x, u, w, k)
        return v + self.speed_factor * self.sampling_time / self.mass * w.wind, s


@declared
class Leaning(Increment):
    """It leans on what it measures too."""

    def act(self, memory_k, state, r, r_next, y):
        u, state = super().act(memory_k, state, r, r_next, y)
        return u + 1e3 * (r - y), state


CLAIMS = ("A2.lifted", "A4.partial", "increment_monotone", "increment_weighted")
GIVEN = {"controllers": {"law": Increment()}, "sweeps": (), "trials": 40, "cases": {}}


def trip(*assignments, **fields):
    """A short flat run of the metro train, whose learning converges: every claim of CLAIMS holds."""
    base = dataclasses.replace(METRO, **(GIVEN | fields))
    flat = ["plant.line=flat", "reference.horizon=200", *assignments]
    return run(settings.assigned(base, flat), show_progress=False)


def findings(campaign):
    """Return the verdicts on the law by claim."""
    return standings(Dossier(campaign, "law"))


@pytest.fixture(scope="module")
def plain():
    """The run itself, and what was found of it."""
    campaign = trip()
    return campaign, findings(campaign)


def test_a_trip_is_proved_as_it_is(plain):
    _, found = plain
    assert {name: found[name].standing for name in CLAIMS} == dict.fromkeys(CLAIMS, PROVED)
    assert found["A3"].standing is Standing.SUPPORTED


MOVING, ADDED, BETWEEN = "the plant changes from trial to trial: mass", "adds noise", "an actuator lies between"
BEYOND = [
    # what, settings, fields, the sentence, which claims it leaves open
    ("a mass that changes", [], {"truth": {"mass": Between(low=0.9, high=1.1)}}, MOVING, CLAIMS),
    ("noise without bounds", ["noise.sigma=0.01"], {}, f"{ADDED} of no bound", CLAIMS[2:]),
    ("bounded noise", [], {"noise": UniformNoise(largest=0.01)}, f"{ADDED} of up to 0.01", CLAIMS[2:]),
    ("noise that is cut", ["noise.sigma=0.01", "noise.limit=0.02"], {}, f"{ADDED} of up to 0.02", CLAIMS[2:]),
    (
        "a wind that differs",
        [],
        {"plant": Pushed(), "disturbance": NormalDisturbance(sigmas=(500.0,))},
        "the disturbance differs between trials",
        ("A2.lifted", *CLAIMS[2:]),
    ),
    (
        "scattered starts",
        [],
        {"initial": From(state=(0.0, 0.0), spread=(0.1, 1.0))},
        "begin in different states",
        ("A2.lifted", *CLAIMS[2:]),
    ),
    (
        "trials that continue",
        ["trials=3"],
        {"continues": True, "trial_length": TrialLength(law="fixed")},
        "begins where the last one ended",
        ("A2.lifted", *CLAIMS[2:]),
    ),
    ("a lag", ["actuator.lag=0.2"], {}, BETWEEN, CLAIMS[2:]),
    ("limits", ["actuator.lower=-450e3", "actuator.upper=450e3"], {}, BETWEEN, CLAIMS[2:]),
    ("a limited rate", ["actuator.rate=5e6"], {}, BETWEEN, CLAIMS[2:]),
    ("a dead time", ["actuator.delay=0.2", "trials=5"], {}, "for relative degree 1, got 3", CLAIMS[2:]),
    ("a filter", [], {"controllers": {"law": Increment(q_cutoff_hz=1.0)}}, "without its filter", CLAIMS[2:]),
    ("feedback", [], {"controllers": {"law": Leaning()}}, "the law also acts within the trial", CLAIMS[2:]),
]


@pytest.mark.parametrize(("what", "assignments", "fields", "said", "left"), BEYOND, ids=[row[0] for row in BEYOND])
def test_one_thing_beyond_the_premises_leaves_a_trip_open(plain, what, assignments, fields, said, left):
    found = findings(trip(*assignments, **fields))
    for name in left:
        assert found[name].standing is UNDECIDED and said in found[name].method, (name, found[name])
        assert "\n" not in found[name].method


def test_lengths_that_are_given_leave_all_but_their_distribution():
    found = findings(trip(trial_length=[200] * 20 + [190] * 20))
    assert {name: found[name].standing for name in CLAIMS} == dict.fromkeys(CLAIMS, PROVED)
    assert "A3" not in found  # it is not made


def test_a_plant_that_is_wrong_but_stays_is_proved_as_it_is(plain):
    """Bounds are those of the plant that runs: 1.1 times the mass, 1/1.1 of the slope."""
    campaign = trip(truth={"mass": 1.1})
    found = findings(campaign)
    assert {name: found[name].standing for name in CLAIMS} == dict.fromkeys(CLAIMS, PROVED)
    assert found["A4.partial"].margin == pytest.approx(plain[1]["A4.partial"].margin / 1.1, rel=1e-6)


@pytest.mark.parametrize("truth", [{}, {"mass": 1.1}], ids=["as believed", "heavier"])
def test_what_is_proved_of_a_trip_holds_in_its_record(truth):
    """Every number is computed anew from run.nc and the true plant's own equation, sample by sample."""
    campaign = trip(truth=truth)
    found, data = findings(campaign), campaign.data.sel(controller="law")
    plant = campaign.study.plant_that_runs
    step = plant.step_function()
    u, y = data["input"].values[:, :-1], data["output"].values
    z = np.diff(y, axis=1)
    # A2: differences of increments against the largest difference of inputs so far
    du, dz = np.abs(np.diff(u, axis=0)), np.abs(np.diff(z, axis=0))
    reached = np.isfinite(dz)
    so_far = np.maximum.accumulate(np.where(reached, du, 0.0), axis=1)
    assert reached.sum() > 5000
    assert (dz <= found["A2.lifted"].bound * so_far + 1e-12)[reached].all()
    # A4: one newton more at a sample
    least = found["A4.partial"].margin
    for trial, k in ((0, 0), (7, 40), (39, 150)):
        x = [data[f"state_{one.name}"].values[trial, k] for one in plant.states]
        more, less = (float(step(x, u[trial, k] + shift, [], k)[0]) for shift in (0.5, -0.5))
        assert more - less >= least * (1 - 1e-6)
    # the theorem: the wanted input, and how far every trial is from it
    reference = campaign.study.reference_samples[0]
    wanted, x = np.zeros(200), np.zeros(2)
    for k in range(200):
        idle, one = (float(step(x, force, [], k)[0] - x[0]) for force in (0.0, 1.0))
        wanted[k] = (reference[k + 1] - reference[k] - idle) / (one - idle)
        x = step(x, wanted[k], [], k).full().ravel()
    # inputs after a trial's end are recorded as missing: they stay what they were
    error = np.abs(np.where(np.isfinite(u), wanted - u, 0.0))[:, :190].max(axis=1)
    assert (error[1:] <= error[:-1] * (1 + 1e-9)).all() and error[-1] < 0.01 * error[0]
    weight = found["increment_weighted"].bound ** np.arange(190)
    heavy = (np.abs(wanted - u)[:, :190] * weight).max(axis=1)
    assert (heavy[1:] <= heavy[:-1] * (1 + 1e-9)).all()
    first = found["increment_monotone"].witness["factor_at_phi0"]
    assert error[1] <= error[0] * first * (1 + 1e-9)  # trial 2 is planned with phi(k, 1)


RATIOS = ("A4.printed", "lemma1", "lambda_min.realised", "theorem1")
"""Claims that look at ratios of differences between recorded trials."""


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"initial": From(state=(0.0, 0.0), spread=(0.2, 1.0))}, "trials begin in different states"),
        ({"continues": True, "trial_length": TrialLength(law="fixed")}, "a trial begins where the last one ended"),
    ],
)
def test_ratios_say_nothing_where_trials_differ_by_more_than_their_inputs(fields, says):
    found = findings(trip("trials=4", **fields))
    for name in RATIOS:
        assert found[name].standing is UNDECIDED and says in found[name].method, (name, found[name])


def test_ratios_say_something_where_they_do_not():
    found = findings(trip("trials=4"))
    standings = {found[name].standing for name in RATIOS}
    assert UNDECIDED not in standings and Standing.REFUTED in standings


def test_a_derivative_of_zero_is_left_out_of_shares_of_it():
    from workbench.evidence.ppd import evidence

    one = evidence(trip("trials=3"), "law")
    whole = one.relative_ratio()
    partial = one.partial.copy()
    partial[1, 5] = 0.0
    left = dataclasses.replace(one, partial=partial).relative_ratio()
    assert np.isfinite(whole[1, 5]) and np.isnan(left[1, 5])
    left[1, 5] = whole[1, 5]
    np.testing.assert_array_equal(left, whole)
    usable = np.isfinite(one.ratio)
    np.testing.assert_array_equal(whole[usable], (one.ratio / one.partial)[usable])
