"""Campaigns made to leave a bound: they run as a plain loop does, they keep to what is possible, and they push."""

from __future__ import annotations

import dataclasses
import json

import casadi as ca
import numpy as np
import pytest

from models.errors import InvalidValue
from models.metro_profile import metro_speed
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import declared, quantity
from verification.checks.adversary import COURSES, GAINS, Possible, after, fresh
from verification.checks.campaigns import campaigns, plant_equations, reached_again, replay
from verification.checks.envelope import Bounds, chosen_of, held_inside
from workbench.controllers import Increment

N = 30
RAMP = np.linspace(0.0, 1.0, N + 1) ** 2
NONE = np.zeros(0)


@declared
class Tank(Plant):
    """A tank whose outflow grows with its level, and into which it rains."""

    source = "made for tests, 2026"
    states = outputs = signals(level="1")
    inputs = signals(inflow="1")
    disturbances = signals(rain="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
    valve: float = quantity(default=0.5, unit="1", doc="share of the inflow that comes in", above=0)

    def step(self, x, u, w, k):
        return (0.9 * x.level - 0.02 * x.level**2 + self.valve * u.inflow + w.rain,)

    def output(self, x):
        return (x.level,)


@declared
class Dry(Tank):
    """A tank without rain."""

    disturbances = signals()

    def step(self, x, u, w, k):
        return (0.9 * x.level + self.valve * u.inflow,)


@declared
class Slide(Tank):
    """A speed and a position, with a kink where the ground begins to rise, and a wind that changes with time."""

    states = signals(position="1", speed="1")
    outputs = signals(speed="1")
    disturbances = signals()

    def step(self, x, u, w, k):
        rise = ca.fmax(0, x.position - 0.3)
        return x.position + 0.1 * x.speed, x.speed + self.valve * u.inflow - 0.2 * rise - 0.01 * ca.sin(0.3 * k)

    def output(self, x):
        return (x.speed,)


@declared
class Lost(Dry):
    """A plant whose equations mean nothing below 0."""

    def step(self, x, u, w, k):
        return (ca.sqrt(x.level) + self.valve * u.inflow,)


def possible(**changed):
    plain = {"reference": RAMP, "first_plan": np.full(N, 0.05), "gain": (0.0, 1.5), "start": (np.zeros(1),) * 2}
    return Possible(**{**plain, **changed})


RAIN = (np.linspace(-0.03, 0.0, N)[None, :], np.full((1, N), 0.02))
CASES = {
    "rain": (Tank(), (), possible(disturbance=RAIN, start=(np.array([-0.1]), np.array([0.2])), scored=20)),
    "rain fixed": (Tank(), (), possible(disturbance=RAIN, fixed=("disturbance",), shortest=12)),
    "valve": (Dry(), ("valve",), possible(parameters=(np.array([0.3]), np.array([0.6])), noise=0.01)),
    "valve fixed": (
        Dry(),
        ("valve",),
        possible(parameters=(np.array([0.3]), np.array([0.6])), fixed=("parameters",), learns_on="output"),
    ),
    "kink": (Slide(), (), possible(start=(np.array([0.2, 0.0]),) * 2, gain=(np.full(N, 0.1), np.linspace(1, 2, N)))),
    "starts": (
        Slide(),
        ("valve",),
        possible(
            start=(np.zeros(2), np.array([0.4, 0.1])),
            parameters=(np.array([0.4]), np.array([0.5])),
            fixed=("start",),
            noise=0.02,
        ),
    ),
}


def given(case):
    plant, names, allowed = CASES[case]
    return plant, names, allowed, plant_equations(plant, names)


def plain_gain(allowed, one, error, k):
    """Return l at a sample where nothing about it is random, else None."""
    low, high = (float(np.broadcast_to(end, N)[k]) for end in allowed.gain)
    if not one.first <= k < one.last:
        return low
    turned = {"rising, falling": k >= one.turn, "falling, rising": k < one.turn, "falling": True}.get(one.gain, False)
    if one.gain in ("full", "least"):
        return high if one.gain == "full" else low
    return None if one.gain in ("random", "blocks") else high if (-error if turned else error) > 0 else low


@pytest.mark.parametrize("case", CASES)
def test_a_campaign_runs_as_a_plain_loop_does(case):
    plant, names, allowed, equations = given(case)
    rng = np.random.default_rng(3)
    seen_gains = set()
    for gain in (*GAINS, *[None] * 6):
        chosen = fresh(allowed, 5, rng, gain)
        u = list(allowed.first_plan)
        for one, ran in zip(chosen, replay(equations, allowed, chosen), strict=True):
            same = dataclasses.replace(plant, **dict(zip(names, one.parameters, strict=True)))
            step, output = same.step_function(), same.output_function()
            x = [ca.DM(one.start)]
            for k in range(one.length):
                x.append(step(x[k], u[k], ca.DM(ran.w[:, k]), k))
            y = [float(output(at)) for at in x]
            np.testing.assert_allclose(ran.x, ca.horzcat(*x).full(), rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(ran.y, y, rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(ran.u, u[: one.length], rtol=1e-12, atol=1e-14)
            u = [*ran.u, *u[one.length :]]
            following = step_after(allowed, chosen, ran, one)
            for k in range(one.length):
                r = allowed.reference
                error = r[k + 1] - ran.seen[k + 1]
                if allowed.learns_on == "increment":
                    error -= r[k] - ran.seen[k]
                gain = plain_gain(allowed, one, error, k) if abs(error) > 1e-12 else None
                if gain is None:  # any gain there is
                    ends = [u[k] + float(np.broadcast_to(end, N)[k]) * error for end in allowed.gain]
                    assert min(ends) - 1e-12 <= following[k] <= max(ends) + 1e-12
                else:
                    assert following[k] == pytest.approx(u[k] + gain * error, rel=1e-12, abs=1e-14)
                    seen_gains.add(one.gain)
            assert list(following[one.length :]) == u[one.length :]
            u = list(following)
    assert seen_gains >= set(GAINS) - {"random", "blocks"}


def step_after(allowed, chosen, ran, one):
    """Return the whole plan that follows a trial: that of a trial more, which is not cut short."""
    index = chosen.index(one)
    case = next(name for name, (_, _, what) in CASES.items() if what is allowed)
    more = (*chosen[: index + 1], chosen[index]._replace(length=N))
    return replay(given(case)[3], allowed, more)[-1].u


@pytest.mark.parametrize("case", CASES)
def test_choices_keep_to_what_is_possible_and_reach_its_ends(case):
    _, _, allowed, equations = given(case)
    rng = np.random.default_rng(1)
    made = [fresh(allowed, 6, rng) for _ in range(200)]
    made += [after(allowed, made[int(rng.integers(200))], rng) for _ in range(200)]
    lengths = {one.length for chosen in made for one in chosen}
    assert min(lengths) == allowed.shortest and max(lengths) == N
    for name, (low, high) in (("start", allowed.start), ("parameters", allowed.parameters)):
        if not low.size:
            continue
        values = np.array([[one._asdict()[name] for one in chosen] for chosen in made])  # (campaigns, trials, size)
        np.testing.assert_array_equal(values.min(axis=(0, 1)), low)
        np.testing.assert_array_equal(values.max(axis=(0, 1)), high)
        changes = (np.ptp(values, axis=1) > 0).any()
        assert changes == (name not in allowed.fixed and bool((high > low).any()))
    runs = [replay(equations, allowed, chosen) for chosen in made[::8]]
    noise = np.concatenate([ran.seen - ran.y for trials in runs for ran in trials])
    assert np.abs(noise).max() == pytest.approx(allowed.noise, abs=1e-15)
    for trials in runs:
        for ran in trials:
            n = ran.u.size
            low, high = (
                (
                    np.broadcast_to(np.reshape(end, (ran.w.shape[0], -1)), (ran.w.shape[0], N))[:, :n]
                    for end in allowed.disturbance
                )
                if ran.w.size
                else (ran.w, ran.w)
            )
            assert (ran.w >= low).all() and (ran.w <= high).all()
        if "disturbance" in allowed.fixed:
            whole = min(ran.u.size for ran in trials)
            assert all(np.array_equal(ran.w[:, :whole], trials[0].w[:, :whole]) for ran in trials)
    assert {one.gain for chosen in made for one in chosen} == set(GAINS)
    assert {one.noise for chosen in made for one in chosen} == set(COURSES)


@pytest.mark.parametrize("case", CASES)
def test_the_envelope_is_that_of_every_trial(case):
    _, _, allowed, equations = given(case)
    count, trials = 15, 4  # so few that none takes after another
    found = campaigns(equations, allowed, count=count, trials=trials, seed=5)
    rng = np.random.default_rng(5)
    made = [fresh(allowed, trials, rng, gain) for gain in (*GAINS, *[None] * (count - len(GAINS)))]
    runs = [replay(equations, allowed, chosen) for chosen in made]
    for ends, rows in (
        (found.states, [ran.x for one in runs for ran in one]),
        (found.inputs, [ran.u[None, :] for one in runs for ran in one]),
        (found.increments, [np.diff(ran.y)[None, :] for one in runs for ran in one]),
    ):
        low, high = np.full_like(ends.low, np.inf), np.full_like(ends.high, -np.inf)
        for row in rows:
            reached = row.shape[1]
            low[:, :reached] = np.minimum(low[:, :reached], row)
            high[:, :reached] = np.maximum(high[:, :reached], row)
        np.testing.assert_array_equal(ends.low, low)
        np.testing.assert_array_equal(ends.high, high)
    least = allowed.scored_samples
    for trial in range(trials):
        scored = [one[trial].y for one in runs if one[trial].u.size >= least]
        errors = [np.mean((allowed.reference[1 : least + 1] - y[1 : least + 1]) ** 2) for y in scored]
        assert found.mse[trial] == pytest.approx(max(errors, default=0.0), rel=1e-12)
        assert (found.mse_by[trial] >= 0) == bool(errors)


@pytest.mark.parametrize("case", CASES)
def test_whoever_reached_an_end_reaches_it_again(case):
    _, _, allowed, equations = given(case)
    found = campaigns(equations, allowed, count=150, trials=4, seed=2)
    again = {one: replay(equations, allowed, chosen) for one, chosen in found.choices.items()}
    for ends, row_of in ((found.states, lambda ran: ran.x), (found.inputs, lambda ran: ran.u[None, :])):
        for values, by in ((ends.low, ends.low_by), (ends.high, ends.high_by)):
            for (row, k), value in np.ndenumerate(values):
                campaign, trial = by[row, k]
                assert row_of(again[campaign][trial])[row, k] == value


def test_the_same_seed_gives_the_same_campaigns_and_another_does_not():
    _, _, allowed, equations = given("kink")
    one, same, other = (campaigns(equations, allowed, count=40, trials=3, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.states.low, same.states.low)
    np.testing.assert_array_equal(one.mse, same.mse)
    assert (one.states.low != other.states.low).any()


@pytest.mark.parametrize("learns_on", ["increment", "output"])
def test_one_sample_is_a_run_too(learns_on):
    allowed = Possible(
        reference=np.array([0.0, 1.0]),
        first_plan=np.zeros(1),
        gain=(0.0, 2.0),
        start=(np.zeros(1),) * 2,
        learns_on=learns_on,
    )
    found = campaigns(plant_equations(Dry()), allowed, count=60, trials=5)
    assert (found.inputs.low[0, 0], found.inputs.high[0, 0]) == (0.0, 2.0)  # l b = 1: at once there, and never past


def bounds(found, shrink=0.0):
    """Return the envelope as bounds that it just keeps, drawn in by a share of each signal's width; unreached at 0."""
    ends = []
    for one in (found.states, found.inputs):
        width = np.ptp(np.concatenate([one.low, one.high], axis=1), axis=1)[:, None]
        ends.append((one.low + shrink * width, one.high - shrink * width))
    (x_low, x_high), (u_low, u_high) = ends
    return Bounds(x_low, u_low[0]), Bounds(x_high, u_high[0]), Bounds(np.zeros_like(x_low), np.zeros_like(u_low[0]))


@pytest.mark.parametrize("case", CASES)
def test_bounds_that_are_a_little_too_tight_are_contradicted(case):
    _, _, allowed, equations = given(case)
    found = campaigns(equations, allowed, count=120, trials=4)
    low, high, spare = bounds(found)
    just = held_inside(found, low, high, spare)
    assert just.margin == 0 and just.tries == 480
    assert held_inside(found, *bounds(found, -0.01)).margin > 0
    for name in Bounds._fields:
        for side in ("low", "high"):
            ends = {"low": low._asdict(), "high": high._asdict()}
            tight = np.array(ends[side][name])
            k = tight.shape[-1] // 2
            tight[..., k] += 0.01 if side == "low" else -0.01
            ends[side][name] = tight
            held = held_inside(found, Bounds(**ends["low"]), Bounds(**ends["high"]), spare)
            assert held.margin < 0
            told = json.loads(json.dumps(held.witness))
            assert (told["sample"], told["side"], told["signal"] + "s") == (k, side, name)
            assert told["room"] == pytest.approx(-0.01)
            assert reached_again(equations, allowed, told) == told["reached"]
            for add, kept in ((0.009, False), (0.011, True)):
                rounding = Bounds(spare.states + add, spare.inputs + add)
                assert (held_inside(found, Bounds(**ends["low"]), Bounds(**ends["high"]), rounding).margin > 0) == kept


def test_a_plant_that_leaves_the_numbers_is_inside_nothing():
    allowed = possible(start=(np.ones(1), np.ones(1)), first_plan=np.full(N, -3.0))
    found = campaigns(plant_equations(Lost()), allowed, count=20, trials=3)
    wide = Bounds(np.full((1, N + 1), 1e308), np.full(N, 1e308))
    held = held_inside(found, Bounds(-wide.states, -wide.inputs), wide, Bounds(np.zeros((1, N + 1)), np.zeros(N)))
    assert held.margin < 0 and np.isfinite(held.margin)
    json.dumps(held.witness, allow_nan=False)
    assert np.isinf(found.mse).all()


def broken(**changed):
    return lambda: possible(**changed)


def ran(case="rain", **changed):
    _, _, allowed, equations = given(case)
    return lambda: campaigns(equations, dataclasses.replace(allowed, **changed), **{"count": 2, "trials": 2})


def held(change):
    _, _, allowed, equations = given("kink")
    found = campaigns(equations, allowed, count=30, trials=2)
    return lambda: held_inside(found, *change(*bounds(found)))


def again(case="rain fixed", **changed):
    _, _, allowed, equations = given(case)
    chosen = fresh(allowed, 3, np.random.default_rng(0))
    return lambda: replay(equations, allowed, (*chosen[:-1], chosen[-1]._replace(**changed)))


def witness(**changed):
    _, _, allowed, equations = given("rain")
    told = {"signal": "state", "row": 0, "sample": 1, "trial": 0}
    choices = [one._asdict() for one in fresh(allowed, 3, np.random.default_rng(0))]
    return lambda: reached_again(equations, allowed, {**told, "choices": choices, **changed})


def with_nan(low, high, spare):
    return low, Bounds(np.full_like(high.states, np.nan), high.inputs), spare


@pytest.mark.parametrize(
    ("done", "said"),
    [
        (broken(reference=RAMP[:-1]), "one value more than the first plan (31), got 30"),
        (broken(first_plan=np.full(N, np.nan)), "must be finite"),
        (broken(gain=(-0.1, 1.0)), "the gain must be at least 0"),
        (broken(gain=(np.zeros(3), np.ones(3))), "a number or 30 of them"),
        (broken(gain=(2.0, 1.0)), "gain must lie between two ends"),
        (broken(start=(np.zeros(1), np.full(1, np.inf))), "start must lie between two ends"),
        (broken(parameters=(np.ones(1), np.zeros(1))), "parameters must lie between two ends"),
        (broken(disturbance=(np.zeros(1), np.ones(2))), "disturbance must lie between two ends"),
        (broken(noise=-1.0), "the bound of the noise"),
        (broken(noise=np.nan), "the bound of the noise"),
        (broken(shortest=0), "shortest must be a number of samples from 1 to 30, got 0"),
        (broken(shortest=31), "shortest must be a number of samples from 1 to 30, got 31"),
        (broken(scored=31), "scored must be a number of samples from 1 to 30, got 31"),
        (broken(learns_on="speed"), "learns on the increment or the output, got 'speed'"),
        (broken(fixed=("mass",)), "fixed may name parameters, start, disturbance; got mass"),
        (ran(start=(np.zeros(2), np.zeros(2))), "start: 1 value(s) must be told, got 2"),
        (ran(parameters=(np.zeros(2), np.zeros(2))), "parameters: 0 value(s) must be told, got 2"),
        (ran(disturbance=(NONE, NONE)), "disturbance: 1 value(s) must be told, got 0"),
        (lambda: campaigns(given("kink")[3], CASES["kink"][2], count=0, trials=1), "must be at least 1, got 0 and 1"),
        (lambda: plant_equations(Tank(), ("depth",)), "parameters must be among sampling_time, valve; got depth"),
        (held(with_nan), "the bounds (high) of the state must be finite numbers"),
        (held(lambda low, high, spare: (Bounds(low.states[:1], low.inputs), high, spare)), "must have shape (2, 31)"),
        (held(lambda low, high, spare: (low, high, Bounds(spare.states - 1, spare.inputs))), "at least 0, got -1"),
        (lambda: chosen_of({"sample": 3}), "must tell by trial length, gain"),
        (lambda: chosen_of({"choices": [{"length": 3}]}), "must tell by trial length, gain"),
        (witness(trial=3), "of a value that was reached; got state, 0, 1, 3"),
        (witness(sample=40), "of a value that was reached; got state, 0, 40, 0"),
        (witness(row=-1), "of a value that was reached; got state, -1, 1, 0"),
        (witness(signal="speed"), "of a value that was reached; got speed, 0, 1, 0"),
        (again(length=11), "12 to 30 samples, got 11"),
        (again(length=31), "12 to 30 samples, got 31"),
        (again(start=(0.1,)), "start must lie between"),
        (again(parameters=(0.1,)), "parameters must lie between"),
        (again(disturbance="none"), "stay what they are"),
        (again(gain="most"), "a gain is chosen as one of 'full', "),
        (again(noise="white", case="starts"), "a course is chosen as one of 'low', "),
    ],
)
def test_what_cannot_be_run_is_told_in_one_line(done, said):
    with pytest.raises(InvalidValue) as raised:
        done()
    assert said in str(raised.value) and "\n" not in str(raised.value)


# -- a line, and the set that is known to hold every trial ---------------------------------------------------------

LINE = 2000
GAIN = Increment().rho / (2 * np.sqrt(Increment().lam)) * Increment().force_unit


def on_the_line(**changed):
    plain = {
        "reference": metro_speed(np.arange(LINE + 1)),
        "first_plan": np.full(LINE, 1500.0),
        "gain": (0.0, GAIN),
        "start": (np.zeros(2), np.zeros(2)),
    }
    return Possible(**{**plain, **changed})


def reachable(plant, allowed, masses):
    """Return bounds of speed, position and force that every trial keeps, in plain floating point.

    The input lies between the first plan and the inputs that give the wanted increment at a state that can be there:
    M (dr/h + g i) + fb, h = 3.6 Ts, with anything that noise may do to the wanted increment.
    """
    h, grade = plant.speed_factor * float(plant.sampling_time), plant.gravity / 1000
    s = ca.SX.sym("s")
    mean = ca.Function("mean", [s], [plant.line.mean_grade(s, plant.length)])
    breaks = np.array([at + add for at in plant.line.grade_starts_m for add in (0.0, plant.length)])
    (v_low, s_low), (v_high, s_high) = allowed.start
    x, u = [[(v_low, s_low), (v_high, s_high)]], []
    for k in range(allowed.samples):
        v = np.linspace(v_low, v_high, 200)
        resistance = np.array(plant.running_resistance(v, k), dtype=float)
        curve = (plant.b0_mean, plant.b1_mean, plant.b2_mean)
        spare = np.ptp(v) ** 2 / 200**2 * curve[2]  # the parabola between two points
        inside = breaks[(breaks > s_low) & (breaks < s_high)]
        i = np.array(mean(np.concatenate([[s_low, s_high], inside])[None, :])).ravel() * grade
        z = allowed.reference[k + 1] - allowed.reference[k]
        needs = [
            mass * ((z + side * 2 * allowed.noise) / h + slope)
            for mass in masses
            for slope in (i.min(), i.max())
            for side in (-1, 1)
        ]
        first = allowed.first_plan[k]
        least = min(first, min(needs) + resistance.min() - spare)
        most = max(first, max(needs) + resistance.max() + spare)
        u.append((least, most))
        pulls = [
            (v + h * ((force - resistance) / mass - slope), force)
            for mass in masses
            for slope in (i.min(), i.max())
            for force in (least, most)
        ]
        meters = float(plant.sampling_time) / plant.speed_factor
        s_low, s_high = s_low + meters * v_low, s_high + meters * v_high
        v_low, v_high = min(one.min() for one, _ in pulls), max(one.max() for one, _ in pulls)
        x.append([(v_low, s_low), (v_high, s_high)])
    x, u = np.array(x), np.array(u)
    low, high = Bounds(x[:, 0].T, u[:, 0]), Bounds(x[:, 1].T, u[:, 1])
    spare = Bounds(*(1e-9 * (1 + np.maximum(abs(a), abs(b))) for a, b in zip(low, high, strict=True)))
    return low, high, spare


LINES = {
    "flat": ("flat", (350e3,), {}),
    "hilly": ("hilly", (350e3,), {}),
    "masses": ("hilly", (280e3, 420e3), {"parameters": (np.array([280e3]), np.array([420e3]))}),
    "noise": ("hilly", (350e3,), {"noise": 0.025}),
    "starts": ("flat", (350e3,), {"start": (np.zeros(2), np.array([0.5, 5.0])), "shortest": 1900}),
    "noise and starts": ("flat", (350e3,), {"start": (np.zeros(2), np.array([0.5, 5.0])), "noise": 0.01}),
}


def line_case(case):
    line, masses, changed = LINES[case]
    plant, allowed = PointMass(line=line), on_the_line(**changed)
    names = ("mass",) if len(masses) > 1 else ()
    return plant_equations(plant, names), allowed, reachable(plant, allowed, masses)


def test_adversaries_come_to_the_ends_of_what_is_reachable():
    equations, allowed, (low, high, spare) = line_case("flat")
    found = campaigns(equations, allowed, count=60, trials=40)
    assert held_inside(found, low, high, spare).margin >= 0
    ends, reached = (low.states[0].min(), high.states[0].max()), (found.states.low[0].min(), found.states.high[0].max())
    assert np.abs(np.subtract(ends, reached)).max() < 0.01 * (ends[1] - ends[0])
    width = high.states[0] - low.states[0]
    assert (found.states.high[0] - found.states.low[0] >= 0.98 * width)[1:].all()  # at every sample, not at the widest


@pytest.mark.parametrize("case", LINES)
def test_campaigns_stay_in_what_is_reachable_and_leave_half_of_it(case):
    equations, allowed, (low, high, spare) = line_case(case)
    found = campaigns(equations, allowed, count=40, trials=30)
    assert held_inside(found, low, high, spare).margin >= 0
    middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    half = [Bounds(*(m + 0.5 * (e - m) for m, e in zip(middle, end, strict=True))) for end in (low, high)]
    assert held_inside(found, *half, spare).margin < 0


@pytest.mark.slow
@pytest.mark.parametrize("case", LINES)
def test_very_many_campaigns_stay_in_what_is_reachable(case):
    equations, allowed, proved = line_case(case)
    found = campaigns(equations, allowed, count=10_000, trials=8)
    assert held_inside(found, *proved).margin >= 0
