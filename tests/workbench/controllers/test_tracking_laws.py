"""PID, tracking MPC and laws on odometry against plain loops and another solver."""

from __future__ import annotations

import dataclasses
import re

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from models.actuator import Actuator, Lagged, RateLimited, Saturated, delayed
from models.limits import Limits
from models.line import Line
from models.maglev import Maglev
from models.metro_profile import MetroProfile
from models.plant import Plant, signal, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, quantity
from models.transfer import Transfer
from workbench.contracts import settings
from workbench.contracts.law import Law, Task
from workbench.contracts.study import Study
from workbench.controllers.odometry import Odometry
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.pid import PID
from workbench.controllers.shuttle_pid import ShuttlePID
from workbench.controllers.tracking_mpc import Acting, TrackingMPC
from workbench.controllers.variable_gain import VariableGain
from workbench.fold.fold import build
from workbench.graph.dimensions import how_many
from workbench.trials.campaign import run


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("horizon", "blocks"), [(12, 1), (12, 4), (6, 6)])
def test_plans_are_those_of_another_solver(seed, horizon, blocks):
    rng = np.random.default_rng(seed)
    law = TrackingMPC(a=0.95, b=0.3, weight=0.05, smoothing=0.4, horizon=horizon, blocks=blocks,
                      lower=-1.0, upper=1.5)  # fmt: skip
    ahead, y, before = rng.normal(size=horizon) * 3, rng.normal(), rng.normal(size=3)
    state = Acting(before[0], before[1], before[2], ca.DM.zeros(blocks), 0)
    memory = law.start(Task(ca.DM.ones(1, 4), 0.1))._replace(ahead=ca.DM(ahead), sampling_time=0.1)
    u, after = law.act(memory, state, ca.DM(0), ca.DM(0), ca.DM(y))
    d = before[2] + 0.4 * (y - 0.95 * before[1] - 0.3 * before[0] - before[2])

    def outputs(plan):
        at, seen = y, []
        for j in range(horizon):
            at = 0.95 * at + 0.3 * plan[j * blocks // horizon] + d
            seen.append(at)
        return np.array(seen)

    free = outputs(np.zeros(blocks))
    gains = np.stack([outputs(one) - free for one in np.eye(blocks)], axis=1)
    change = np.eye(blocks) - np.eye(blocks, k=-1)
    A = np.vstack([gains, np.sqrt(0.05) * change])
    b = np.concatenate([ahead - free, np.sqrt(0.05) * before[0] * np.eye(blocks)[0]])
    best = lsq_linear(A, b, bounds=(-1.0, 1.5), tol=1e-14).x
    np.testing.assert_allclose(np.asarray(after.plan).ravel(), best, atol=1e-5)
    assert float(u) == pytest.approx(best[0], abs=1e-5) and float(after.residual) < 1e-13


def test_references_ahead_are_held_at_the_end():
    law = TrackingMPC(horizon=3, blocks=1)
    ahead = law.start(Task(ca.DM([[1, 2, 3, 4, 5]]), 0.1)).ahead.full()
    np.testing.assert_array_equal(ahead, [[2, 3, 4, 5], [3, 4, 5, 5], [4, 5, 5, 5]])


def test_mpc_tracks_without_offset_and_keeps_its_limits():
    plant = Transfer(numerator=(0.5,), gain=1.3)
    law = TrackingMPC(a=np.exp(-0.2), b=0.5 * (1 - np.exp(-0.2)), weight=1e-3, lower=-1.0, upper=2.0, rate=4.0)
    data = run(
        Study(plant=plant, reference=np.full(80, 0.9), controllers={"mpc": law}, trials=1), show_progress=False
    ).data
    u = data["input"].values[0, 0, :-1]
    assert abs(float(data["error"][0, 0, -1])) < 1e-3
    assert u.max() <= 2.0 + 1e-12 and np.abs(np.diff(u, prepend=0)).max() <= 4.0 * 0.2 + 1e-9


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"horizon": 3, "blocks": 4}, "blocks must not exceed"),
        ({"lower": 1.0, "upper": 0.0}, "lower must lie below"),
        ({"weight": 0.0}, "weight must lie in"),
    ],
)
def test_bad_mpcs_are_refused(fields, message):
    with pytest.raises(InvalidValue, match=message):
        TrackingMPC(**fields)


SHAKEN = {  # a plant whose input is limited in one way or another, and settings of the law that say the same
    "the plant alone": ({"lower": -0.5, "upper": 0.7, "rate": 2.0}, {}),
    "the law alone": ({}, {"lower": -0.5, "upper": 0.7, "rate": 2.0}),
    "both": ({"lower": -0.5, "upper": 0.9, "rate": 2.0}, {"lower": -3.0, "upper": 0.7, "rate": 9.0}),
}


def test_mpc_knows_limits_however_they_were_given():
    reference = np.concatenate([np.ones(40), -np.ones(40)])

    def inputs(actuator, fields):
        law = TrackingMPC(a=np.exp(-0.2), b=0.5 * (1 - np.exp(-0.2)), weight=1e-3, input_unit=0.1, **fields)
        plant = Actuator(**actuator).wrapped(Transfer(numerator=(0.5,)))
        study = Study(plant=plant, reference=reference, controllers={"mpc": law}, trials=1)
        return run(study, show_progress=False).data["input"].values[0, 0, :-1]

    first, *others = [inputs(*one) for one in SHAKEN.values()]
    assert first.max() == pytest.approx(0.7, rel=1e-15) and first.min() == pytest.approx(-0.5, rel=1e-15)
    assert np.abs(np.diff(first, prepend=0)).max() == pytest.approx(0.4, rel=1e-12)
    for other in others:
        np.testing.assert_allclose(other, first, rtol=0, atol=1e-14)
    assert not np.allclose(inputs({}, {}), first)


@pytest.mark.parametrize(
    ("wrap", "limits"),
    [
        (lambda plant: plant, (-np.inf, np.inf, np.inf)),
        (lambda plant: Saturated(plant=plant, lower=-1.0, upper=2.0), (-1.0, 2.0, np.inf)),
        (lambda plant: Saturated(plant=Saturated(plant=plant, upper=1.0), lower=-3.0, upper=2.0), (-3.0, 1.0, np.inf)),
        (lambda plant: delayed(RateLimited(plant=plant, rate=4.0), 2 * plant.sampling_time), (-np.inf, np.inf, 4.0)),
        (lambda plant: Actuator(lag=1.0, delay=0.4, lower=-1.0, rate=3.0).wrapped(plant), (-1.0, np.inf, 3.0)),
        (lambda plant: Lagged(plant=RateLimited(plant=Actuator(rate=2.0).wrapped(plant), rate=5.0), time_constant=1.0),
         (-np.inf, np.inf, 2.0)),
    ],
)  # fmt: skip
def test_a_plant_says_its_limits(wrap, limits):
    plant = wrap(Transfer())
    assert plant.input_limits == limits
    told = []

    @declared
    class Asking(Law):
        source = "ours"

        def start(self, task):
            told.append(task.limits)
            return ()

        def act(self, memory_k, state, r, r_next, y):
            return (r_next - y,), state

    fold = build(plant, Asking(), 4)
    row = ca.MX(ca.vertcat(*told[0]))
    value = ca.Function("told", ca.symvar(row), [row], ["p"][: len(ca.symvar(row))], ["row"])
    assert value(**{name: fold.values for name in value.name_in()})["row"].full().ravel().tolist() == list(limits)
    Odometry(law=Asking(), speed_unit=1.0, input_unit=4.0).start(Task(ca.DM.zeros(1, 4), 0.1, Limits(*limits)))
    assert told[-1] == tuple(limit / 4 for limit in limits)


def train_loop(plant_mass, reference, trials, force):
    """Run the train on a flat line, trial by trial; force(i, k, x, v, x_r, v_r, v_next) in N, m and m/s."""
    ts, n = 0.1, len(reference) - 1
    for i in range(trials):
        v = x = x_r = 0.0
        speeds = [0.0]
        for k in range(n):
            u = force(i, k, x, v / 3.6, x_r, reference[k] / 3.6, reference[k + 1] / 3.6)
            swing = np.sin(0.0037 * k)
            fb = 2977 + 275 * swing + (25.17 + 2.5 * swing) * v + (0.2864 + 0.04 * swing) * v * v
            x, x_r = x + ts * v / 3.6, x_r + ts * reference[k] / 3.6
            v = v + 3.6 * ts / plant_mass * (u - fb)
            speeds.append(v)
        yield speeds


def trained(law, trials=4):
    study = Study(
        plant=PointMass(line="flat"), reference=MetroProfile(horizon=150), controllers={"law": law}, trials=trials
    )
    data = run(study, show_progress=False).data
    return data["reference"].values, data["output"].values[0]


def test_palc_on_odometry_is_a_plain_loop():
    reference, found = trained(Odometry(law=PALC()))
    learned = {}

    def force(i, k, x, v, x_r, v_r, v_next):
        e_x, e_v = x - x_r, v - v_r
        d_hat = 0.0 if i == 0 else learned[i - 1, k] - 0.2 * 350e3 * (e_v + 0.22 * e_x)
        learned[i, k] = d_hat
        resistance = 2977 + 25.17 * 3.6 * v + 0.2864 * (3.6 * v) ** 2
        return 350e3 * ((v_next - v_r) / 0.1 - (0.4 + 0.22) * e_v - 0.4 * 0.22 * e_x) + resistance + d_hat

    for i, speeds in enumerate(train_loop(350e3, reference, 4, force)):
        np.testing.assert_allclose(found[i], speeds, rtol=1e-9, atol=1e-9)


def test_variable_gain_on_odometry_is_a_plain_loop():
    law = Odometry(law=VariableGain(initial_learning=False), input_unit=350e3)
    reference, found = trained(law)
    plans = [np.diff(reference / 3.6) / 0.1]
    for i, speeds in enumerate(train_loop(350e3, reference, 4, lambda i, k, *_: 350e3 * plans[i][k])):
        np.testing.assert_allclose(found[i], speeds, rtol=1e-9, atol=1e-9)
        e = (reference - np.array(speeds)) / 3.6
        gain = 0.3 + 0.7 / (1 + np.exp(-5 * (np.abs(e) / np.abs(e).mean() - 1)))
        plans.append(plans[i] + gain[:-1] * np.diff(e) / 0.1)


def told(plant, law):
    """Return what a study on a plant tells a law."""
    reference = np.ones((len(plant.outputs), 300))
    return Study(plant=plant, reference=reference, controllers={"law": law}, trials=1).task(law)


@declared
class Notches(PointMass):
    """The train with its speed in a unit that nobody looked up."""

    @property
    def outputs(self):
        return signals(speed=signal("notches", role="speed"))


REFUSED = {
    "no speed": (PALC(), Transfer(), {}, "PALC on odometry needs a plant that measures a speed, nothing else"),
    "two outputs": (PALC(), Maglev(), {}, "PALC on odometry needs a plant that measures a speed, nothing else"),
    "one output": (
        TrackingMPC(),
        PointMass(),
        {},
        "TrackingMPC must be a law of one input for two outputs, .*",
    ),
    "as many": (PID(), PointMass(), {}, r"PID works channel by channel, .* there are 1 input\(s\) and 2 output\(s\)"),
    "unit": (PALC(), Notches(), {}, "speed_unit must be given, .* its unit 'notches' is unknown"),
    "unit given": (PALC(), Notches(), {"speed_unit": 1.94}, None),
    "its own": (PALC(late=300), PointMass(), {}, "late must be fewer samples than the 299 of a period, got 300"),
    "good": (PALC(), PointMass(), {}, None),
}


@pytest.mark.parametrize("case", REFUSED)
def test_odometry_refuses_what_it_cannot_serve(case):
    within, plant, fields, says = REFUSED[case]
    law = Odometry(law=within, **fields)
    said = law.refusal(told(plant, law))
    assert said is None if says is None else re.match(says, said)


@pytest.mark.parametrize(("reading", "unit"), [("metro", 3.6), ("printed", 1.0)])
def test_odometry_knows_the_unit_of_the_speed(reading, unit):
    plant, law = PointMass(reading=reading), Odometry(law=PALC())
    ready = law.ready_for(told(plant, law))
    assert ready.speed_unit == unit and ready.law.model == plant
    assert (law.learns_on, law.told, law.tells, law.keeps_state) == ("output", PALC.told, PALC.tells, True)


@pytest.mark.parametrize(
    ("unit", "of", "many"),
    [
        ("km/h", "m/s", 3.6),
        ("m/s", "m/s", 1.0),
        ("mm/s", "m/s", 1000.0),
        ("1/min", "1/s", 60.0),
        ("N s^2/m", "kg s", None),
        ("N s^2/m", "kg", 1.0),
        ("N", "m/s", None),
        ("notches", "m/s", None),
        ("", "m/s", None),
    ],
)
def test_units_are_converted_exactly_where_they_are_decimals(unit, of, many):
    assert how_many(unit, of) == many


@declared
class Both(PointMass):
    """The train that measures position and speed in m and m/s."""

    @property
    def outputs(self):
        return signals(position=signal("m", role="position"), speed=signal("m/s", role="speed"))

    def output(self, x):
        return x.position, x.speed / 3.6


def test_a_law_on_odometry_gives_and_tells_as_on_a_plant_that_measures_both():
    v = MetroProfile(horizon=150).samples(PointMass())[0] / 3.6
    both = np.vstack([np.append(0, np.cumsum(v[:-1]) * 0.1), v])
    data = [
        run(Study(plant=plant, reference=reference, controllers={"law": law}, trials=3), show_progress=False).data
        for law, plant, reference in (
            (Odometry(law=PALC()), PointMass(line="flat"), 3.6 * v),
            (PALC(), Both(line="flat"), both),
        )
    ]
    for name in ("input", "law_line_resistance"):
        one, other = (one[name].values.squeeze() for one in data)
        assert np.nanmax(np.abs(other)) > 100
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-5)


SHUTTLE = [PALC(), FilteredPALC(), ShuttlePID()]


@declared
class Plain(Plant):
    """Position and speed of what has neither a mass nor a resistance."""

    states = outputs = signals(position="m", speed="m/s")
    inputs = signals(force="N")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return x.position + 0.1 * x.speed, x.speed + 0.1 * u.force

    def output(self, x):
        return x.position, x.speed


@pytest.mark.parametrize("law", SHUTTLE, ids=lambda law: type(law).__name__)
def test_a_law_without_a_model_says_so(law):
    study = Study(plant=Plain(), reference=np.ones((2, 300)), controllers={"law": law}, trials=1)
    said = f"{type(law).__name__} needs a model: the mass and running resistance of what it moves"
    assert law.refusal(study.task(law)) == said and study.refusals() == {"law": said}
    with pytest.raises(InvalidValue, match=said):
        build(Plain(), law, 299)
    assert dataclasses.replace(law, model=Maglev()).refusal(study.task(law)) is None


@pytest.mark.parametrize("law", SHUTTLE, ids=lambda law: type(law).__name__)
def test_the_model_is_the_plant_as_it_is_believed_to_be(law):
    """A study gives its nominal plant; a law's own model is preferred to it."""
    plant, own = Maglev(), Maglev(mass=1e5)
    study = Study(plant=plant, reference=np.ones((2, 300)), controllers={"law": law}, trials=1, truth={"mass": 1.2})
    assert study.law("law").model == plant
    assert dataclasses.replace(law, model=own).ready_for(study.task(law)).model == own


@pytest.mark.parametrize(
    ("plant", "factor"), [(PointMass(), 3.6), (PointMass(reading="printed"), 1.0), (Maglev(sampling_time=0.001), 1.0)]
)
def test_a_vehicles_resistance_is_that_of_its_equations(plant, factor):
    """F = M dv/dt on a flat line without a force; the printed reading divides twice, and by the mass at last."""
    flat = dataclasses.replace(plant, line=Line(length=1e6))
    known = {"speed": 20.0 * factor, "position": 1000.0}
    names = [signal.name for signal in flat.states]
    after = flat.next_state(ca.DM([known[name] for name in names]), ca.DM(0), ca.DM.zeros(len(flat.disturbances)), 0)
    lost = (20.0 - float(after[names.index("speed")]) / factor) / float(flat.sampling_time) * float(flat.mass)
    assert lost > 0 and float(ca.DM(flat.resistance_at(ca.DM(20.0)))) == pytest.approx(lost, rel=1e-4)


@pytest.mark.parametrize("late", [3, -2])
@pytest.mark.parametrize(
    "law", [PALC(), FilteredPALC(lead_s=0.0, q_cutoff_hz=None)], ids=lambda law: type(law).__name__
)
def test_the_assumed_period_is_a_setting(law, late):
    reference = np.vstack([np.arange(41) * 0.1, np.ones(41)])
    study = Study(plant=Maglev(sampling_time=0.1), reference=reference, controllers={"law": law}, trials=3)
    changed = settings.assigned(study, [f"controllers.law.late={late}"])
    assert changed.controllers["law"].late == late
    one, other = (run(one, show_progress=False).data["law_line_resistance"].values[0] for one in (study, changed))
    assert np.array_equal(one[0], other[0], equal_nan=True) and not np.allclose(one[2, :-1], other[2, :-1])
    with pytest.raises(InvalidValue, match=r"late must be a whole number"):
        settings.assigned(study, ["controllers.law.late=0.5"])
    beyond = settings.assigned(study, ["controllers.law.late=-40"])
    assert beyond.refusals() == {"law": "late must be fewer samples than the 40 of a period, got -40"}
