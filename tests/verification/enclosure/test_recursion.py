"""Sets carried by machine code against points in balls, campaigns in doubles, a second implementation, and by hand."""

import threading
from dataclasses import replace
from functools import partial

import carried_sets as sets
import casadi as ca
import numpy as np
import pytest
from carried_in_python import slowly

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue
from verification.enclosure import recursion
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box
from verification.enclosure.carried import Question
from verification.enclosure.recursion import Recursion

BY_NAME = {case.name: case for case in sets.CASES}
each_case = pytest.mark.parametrize("case", sets.CASES, ids=lambda case: case.name)


def train(line: str) -> tuple[Recursion, Question]:
    plant = PointMass(line=line)
    r = MetroProfile().samples(plant)[0]
    n, wanted = r.size - 1, np.diff(r)
    return Recursion(plant, n), Question(
        start=np.zeros((2, 2)),
        disturbance=np.zeros((n, 0, 2)),
        parameters=np.zeros((0, 2)),
        wanted=np.stack([np.nextafter(wanted, -np.inf), np.nextafter(wanted, np.inf)], axis=-1),
        plan=np.full((n, 2), 1500.0),
        most_gain=173_241.2,
    )


@pytest.mark.parametrize(("line", "low", "high"), [("flat", -74.9, 72.0), ("hilly", -135.0, 120.0)])
def test_the_band_of_the_train_is_that_of_a_computation_by_hand(line, low, high):
    """The train's equations in intervals, written by hand with exact ranges of drag and grade, give these bands."""
    carrier, question = train(line)
    found = carrier.carry(question)
    assert (found.ended, found.sample) == ("fine", -1)
    assert found.y.min() == pytest.approx(low, rel=0.01) and found.y.max() == pytest.approx(high, rel=0.01)
    assert found.y.max() > MetroProfile().samples(PointMass(line=line))[0].max()


# ------------------------------------------------------------------ operations


@pytest.mark.parametrize("parts", [1, 6])
def test_ranges_hold_the_value_at_every_point(parts):
    decided: list[bool] = []
    assert list(sets.values_missed(parts, decided)) == []
    assert np.mean(decided) > 0.8  # or else it might pass by giving up


def test_slopes_hold_every_difference():
    usable: list[bool] = []
    assert list(sets.slopes_missed(usable)) == []
    assert np.mean(usable) > 0.8


def slopes_of(step, boxes) -> np.ndarray:
    """Return the slopes of a next state by state and input."""
    carrier = Recursion(sets.small(step), 1)
    box = np.zeros((1, 3, 2))
    box[0, 0], box[0, 2] = boxes
    return carrier.enclose(0, box, np.zeros(1, dtype=np.int64))[1][0, [0, 2]]


JUMPS = [
    ("sign", lambda x, u, w, k: (ca.sign(u.u0) + x.x0,)),
    ("floor", lambda x, u, w, k: (ca.floor(u.u0) + x.x0,)),
    ("ceil", lambda x, u, w, k: (ca.ceil(u.u0) + x.x0,)),
    ("<", lambda x, u, w, k: ((u.u0 < 0) + x.x0,)),
    ("<=", lambda x, u, w, k: ((u.u0 <= 0) + x.x0,)),
    ("==", lambda x, u, w, k: (ca.eq(u.u0, 0) + x.x0,)),
    ("not", lambda x, u, w, k: (ca.logic_not(u.u0) + x.x0,)),
    ("copysign", lambda x, u, w, k: (ca.copysign(1, u.u0) + x.x0,)),
    ("if", lambda x, u, w, k: (ca.if_else(u.u0 > 0, 1, 0) * 3 + x.x0,)),
]


@pytest.mark.parametrize("step", [step for _, step in JUMPS], ids=[name for name, _ in JUMPS])
@pytest.mark.parametrize("reach", [(-0.5, 0.5), (0.0, 0.5), (-0.5, 0.0), (0.05, 0.1)], ids=str)
def test_no_slope_across_a_jump_but_along_what_does_not_reach_it(step, reach):
    along, across = slopes_of(step, [(-1, 1), reach])
    run = sets.small(step).step_function()
    zeros = [-0.0, 0.0] if reach[0] <= 0 <= reach[1] else []
    taken = {float(run(0, at, ca.DM(0, 1), 0)) for at in (*np.linspace(*reach, 9), *zeros)}
    assert along.tolist() == [1, 1]
    assert np.isfinite(across).all() == (len(taken) == 1)


RANGES = [
    ("product", lambda x, u: x * u, (-1, 2), (-3, 1)),
    ("wave", lambda x, u: x - x**3 + 0.3 * u * x, (-1, 1.5), (-1, 1)),
    ("kinks", lambda x, u: ca.fabs(x - 0.3) - 2 * ca.fmax(0, x - 0.7) + 0.1 * u * u, (-1, 2), (-1, 2)),
    ("drag", lambda x, u: x - 0.01 * x * ca.fabs(x) + 0.1 * u, (-30, 50), (-1, 1)),
    ("quotient", lambda x, u: (x - u) / (2 + x * u), (-1, 1), (-1, 1)),
    ("root", lambda x, u: ca.sqrt(1 + x * u) - x, (-0.9, 1), (-1, 0.9)),
    ("sine", lambda x, u: ca.sin(x) * ca.cos(u), (-1, 2), (0, 2)),
    ("choice", lambda x, u: ca.if_else(x > 0, x * u, -x * u), (-1, 1), (1, 2)),
    ("range of its own", lambda x, u: ca.sin(3 * x) * (2 + x) + u * x, (-1, 1), (0, 1)),
]


@pytest.mark.parametrize(("expression", "x", "u"), [row[1:] for row in RANGES], ids=[row[0] for row in RANGES])
def test_ranges_of_many_parts_come_near_those_of_branch_and_bound(expression, x, u):
    plant = sets.small(lambda at, inputs, w, k: (expression(at.x0, inputs.u0),))
    box = np.zeros((1, 3, 2))
    box[0, 0], box[0, 2] = x, u
    plain, near = (Recursion(plant, 1).enclose(0, box, np.zeros(1, dtype=np.int64), n)[0][0] for n in (1, 24))
    exact = bound(plant.step_function(), Box({"x": x, "u": u, "w": np.zeros((0, 1)), "k": 0}))
    least, most = exact.attained_min.upper, exact.attained_max.lower
    for low, high in (plain, near):
        assert low <= least and high >= most
    assert plain[0] <= near[0] and near[1] <= plain[1]
    assert near[1] - near[0] <= 1.1 * (most - least)


PARTED = [
    ("each by itself", lambda x, u, k: ca.sin(x[0]) + x[1] * u + ca.fmax(x[1], 0.2)),
    ("a coordinate beside its part", lambda x, u, k: x[0] + ca.sin(x[0]) * u - x[1] ** 2),
    ("two parts of a coordinate", lambda x, u, k: ca.sin(x[0]) * u + ca.cos(x[0]) * x[1]),
    ("a part within a part", lambda x, u, k: ca.sin(x[0] ** 2) * x[1] + x[0] ** 2),
    ("a part by the sample", lambda x, u, k: ca.sin(x[0] * k) + ca.cos(k) * x[1] * u),
    ("a part that may not exist", lambda x, u, k: ca.if_else(x[1] > 0.5, ca.sqrt(x[0]), u) + ca.fabs(x[0])),
    ("a part in both branches", lambda x, u, k: ca.if_else(x[0] ** 2 > 0.3, x[0] ** 2 * u, x[1] * ca.sin(x[0] ** 2))),
    ("nothing but a part", lambda x, u, k: ca.exp(-(x[0] ** 2)) * ca.fmin(x[0], 0.3)),
]


@pytest.mark.parametrize("expression", [row[1] for row in PARTED], ids=[row[0] for row in PARTED])
def test_parts_that_stand_for_coordinates_change_no_value(expression):
    plant = sets.small(lambda x, u, w, k: (expression(ca.vertsplit(x.vector), u.u0, k), x.x1), states=2)
    carrier, rng = Recursion(plant, 3), np.random.default_rng(3)
    run, boxes, samples = plant.step_function(), np.zeros((40, 4, 2)), rng.integers(0, 4, 40)
    ends = np.sort(rng.uniform(-1.5, 1.5, (40, 3, 2)), axis=-1)
    boxes[:, [0, 1, 3]], boxes[:, 2] = ends, samples[:, None]
    found = carrier.enclose(0, boxes, samples, 6)[0]
    for box, (low, high), k in zip(ends, found, samples, strict=True):
        for point in [box[:, 0], box[:, 1], *rng.uniform(box[:, 0], box[:, 1], (10, 3))]:
            value = float(run(point[:2], point[2], ca.DM(0, 1), k)[0])
            assert np.isnan(value) or low - 1e-12 <= value <= high + 1e-12
    assert np.isfinite(found).mean() > 0.5


# ------------------------------------------------------------------ passes


@each_case
def test_a_pass_ends_as_it_must_and_campaigns_stay_inside(case):
    found = case.recursion().carry(case.question())
    assert sets.ended_otherwise(case, found) == []
    assert sets.astray(case, found) == []
    assert case.ended != "fine" or np.isfinite(found.x).all()


@pytest.mark.parametrize("case", sets.MOVED, ids=lambda case: case.name)
def test_inputs_that_are_given_move_to_where_they_are_said_to(case):
    question, _ = sets.moving(case)
    assert sets.moved_astray(case, case.recursion().carry(question)) == []


SETTLED = [BY_NAME[name] for name in ("linear", "kinked input", "disturbance", "overshoot", "a wide plan")]


@pytest.mark.parametrize("case", SETTLED, ids=lambda case: case.name)
def test_trials_end_up_where_they_are_said_to(case):
    found, runs = case.recursion().carry(case.question(settled=True)), sets.settling(case)
    assert [*sets._outside("u", runs.u, found.u), *sets._outside("x", runs.x, found.x)] == []


@each_case
def test_both_implementations_end_alike_and_neither_is_much_wider(case):
    first, second = case.recursion().carry(case.question()), slowly(case.recursion(), case.question())
    assert sets.astray(case, second) == []
    if case.name == "kinked input":  # slopes of the second do not hold together what is under one kink
        assert second.ended == "unreached"
        return
    assert (first.ended, first.sample) == (second.ended, second.sample)
    for one, other in zip(first[:5], second[:5], strict=True):
        assert (np.isnan(one) == np.isnan(other)).all()
        known = np.isfinite(one[..., 0])
        overlap = np.minimum(one, other)[known][..., 1] >= np.maximum(one, other)[known][..., 0]
        assert overlap.all()
        assert np.all(np.diff(one[known])[-1:] <= 1.2 * np.diff(other[known])[-1:] + 1e-6)


@pytest.mark.parametrize("case", [sets.MOVED[0], sets.MOVED[2]], ids=lambda case: case.name)
def test_the_second_implementation_moves_and_settles_too(case):
    assert sets.moved_astray(case, slowly(case.recursion(), sets.moving(case)[0])) == []
    first, second = (carry(case.recursion(), case.question(settled=True)) for carry in (Recursion.carry, slowly))
    np.testing.assert_allclose(first.u, second.u, atol=0.05)


def test_the_train_in_python():
    carrier, question = train("hilly")
    cut, few = (
        Recursion(carrier.plant, 4),
        replace(question, disturbance=question.disturbance[:4], wanted=question.wanted[:4], plan=question.plan[:4]),
    )
    first, second = cut.carry(few), slowly(cut, few)
    np.testing.assert_allclose(first.u, second.u, rtol=1e-3)
    np.testing.assert_allclose(first.y, second.y, rtol=1e-3, atol=1e-9)


def test_without_a_compiler_no_sets_are_carried_and_one_line_says_so(monkeypatch):
    monkeypatch.setattr(recursion, "library", lambda *_: None)
    recursion._c.cache_clear()
    try:
        with pytest.raises(InvalidValue, match="a C compiler is needed"):
            BY_NAME["linear"].recursion().carry(BY_NAME["linear"].question())
    finally:
        recursion._c.cache_clear()


# ------------------------------------------------------------------ what is refused, and what may interrupt

REFUSED = [
    (
        "wanted upside down",
        {"wanted": np.tile([2.0, 1.0], (sets.FEW, 1))},
        "wanted must hold ranges, the lower end first",
    ),
    ("wanted no number", {"wanted": np.full((sets.FEW, 2), np.nan)}, "wanted must hold ranges, the lower end first"),
    ("a short plan", {"plan": np.zeros((3, 2))}, r"plan must have shape \(7, 2\), got \(3, 2\)"),
    ("too many states", {"start": np.zeros((2, 2))}, "start must have shape"),
    ("a disturbance that there is not", {"disturbance": np.zeros((sets.FEW, 1, 2))}, "disturbance must have shape"),
    ("a negative gain", {"most_gain": -1.0}, "most_gain must be at least 0, got -1"),
    ("a gain that is no number", {"most_gain": np.nan}, "most_gain must be at least 0"),
    ("negative moves", {"moves": np.full((sets.FEW, 2), -0.5)}, "moves must be at least 0, got -0.5"),
    ("a negative jolt", {"jolt": np.array([-1.0])}, "jolt must be at least 0"),
]


@pytest.mark.parametrize(("more", "sentence"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED])
def test_bad_questions_are_refused_in_a_line(more, sentence):
    case = BY_NAME["linear"]
    with pytest.raises(InvalidValue, match=sentence):
        case.recursion().carry(case.question(**more))


OPEN = [
    ("start", {"start": np.array([[-np.inf, np.inf]])}, "unbounded", 0),
    ("disturbance", {"disturbance": np.tile([-np.inf, np.inf], (sets.FEW, 2, 1))}, "undefined", 0),
    ("wanted", {"wanted": np.tile([0.0, np.inf], (sets.FEW, 1))}, "unbounded", 0),
    ("plan", {"plan": np.tile([-np.inf, 0.0], (sets.FEW, 1))}, "undefined", 0),
    ("gain", {"most_gain": np.inf}, "gain", 0),
    ("moves", {"moves": np.tile([0.0, np.inf], (sets.FEW, 1))}, "gain", 0),
    ("jolt", {"jolt": np.array([np.inf])}, "unbounded", 1),
]


@pytest.mark.parametrize(("more", "ended", "sample"), [row[1:] for row in OPEN], ids=[row[0] for row in OPEN])
def test_what_has_no_bound_proves_nothing(more, ended, sample):
    case = BY_NAME["disturbance"]
    for carry in (partial(Recursion.carry, case.recursion()), partial(slowly, case.recursion())):
        found = carry(case.question(**more))
        assert (found.ended, found.sample) == (ended, sample)


def test_bad_plants_are_refused_in_a_line():
    linear = sets.small(lambda x, u, w, k: (x.x0 + u.u0,))
    with pytest.raises(InvalidValue, match="samples must be at least 1, got 0"):
        Recursion(linear, 0)
    many = sets.small(lambda x, u, w, k: [u.u0, *ca.vertsplit(x.vector)[1:]], states=64)
    with pytest.raises(InvalidValue, match="at most 62, got 64"):
        Recursion(many, 1)
    table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, 1.0, 3.0])
    unknown = sets.small(lambda x, u, w, k: (table(x.x0) + u.u0,))
    with pytest.raises(InvalidValue, match="lookup is not supported"):
        Recursion(unknown, 1)


def test_as_many_states_as_there_is_room_for():
    states = 62
    plant = sets.small(lambda x, u, w, k: [x.x61 + u.u0, *ca.vertsplit(x.vector)[:-1]], states=states)
    n = 70
    question = Question(
        start=np.tile([-1.0, 1.0], (states, 1)), disturbance=np.zeros((n, 0, 2)), parameters=np.zeros((0, 2)),
        wanted=np.zeros((n, 2)), plan=np.zeros((n, 2)), most_gain=0.5,
    )  # fmt: skip
    found = Recursion(plant, n).carry(question)
    assert found.ended == "fine"
    np.testing.assert_allclose(found.x[1:, 1:], found.x[:-1, :-1])


def test_an_interrupt_while_the_c_asks_is_raised_and_leaves_no_trace(monkeypatch):
    case = BY_NAME["arctan, in reach"]
    before = case.recursion().carry(case.question())

    def interrupted(*_):
        raise KeyboardInterrupt

    recursion._enclosed.cache_clear()
    with monkeypatch.context() as context:
        context.setattr(recursion, "partials", interrupted)
        with pytest.raises(KeyboardInterrupt):
            case.recursion().carry(case.question())
    np.testing.assert_array_equal(case.recursion().carry(case.question()).x, before.x)


def test_threads_take_turns():
    carrier, question = train("hilly")
    alone, found = carrier.carry(question), []
    threads = [threading.Thread(target=lambda: found.append(carrier.carry(question))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one in found:
        np.testing.assert_array_equal(one.x, alone.x)


def test_a_process_that_rounds_otherwise_carries_nothing(monkeypatch):
    case = BY_NAME["linear"]
    monkeypatch.setattr(recursion.outward, "arithmetic_is_ieee", lambda: False)
    with pytest.raises(InvalidValue, match="must round to nearest"):
        case.recursion().carry(case.question())
