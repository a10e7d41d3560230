"""Slips in studies and in plants: margins of outcomes, scores, actuators, lines, reference curves."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import casadi as ca
import numpy as np
import xarray as xr
from learning_laws import Planned
from small_plants import small

from models.actuator import Delayed, Lagged
from models.braking_curve import BrakingCurve
from models.limits import Limits
from models.line import HILLY, Line
from models.maglev import Maglev
from models.point_mass import PointMass
from models.switched_delay import SwitchedDelay
from slips.planting import Slip
from studies.ato.evidence import Drawn
from studies.ato.outcomes import better_in_most, small_jerk
from studies.ato.scores import FOUR, better_all_four, jerks
from studies.maglev import lyapunov
from studies.maglev.period_contraction import Loop, factor, least_excess, low_pass_gain
from studies.maglev.reversal import turns
from studies.metro.ledger import Entry, supported
from studies.rail.scores import ride_scores
from studies.same_plant.claims import _contraction
from studies.stopping.claims import _kept, _lower
from studies.stopping.outcomes import room_cm
from studies.variable_gain.direct_term import contraction, spectral_radius
from studies.variable_gain.outcomes import initial_learning_needed
from studies.variable_gain.scores import scores as speeds_of
from studies.variable_gain.study import STUDY as VARIABLE_GAIN
from workbench import Study
from workbench.contracts.finding import Standing
from workbench.contracts.law import SlopeLearning

N = 8
REFUTED, SUPPORTED, PROVED = Standing.REFUTED, Standing.SUPPORTED, Standing.PROVED
SUM = small("Sum", lambda x, u, k: (x[0] + u,))


def stepped(plant, inputs):
    """The states of a plant from zero under inputs."""
    x, found = np.zeros(len(plant.states)), []
    for k, u in enumerate(inputs):
        x = np.array(ca.DM(plant.next_state(ca.DM(x), ca.DM(u), ca.DM(0, 1), ca.DM(k)))).ravel()
        found.append(x)
    return np.array(found)


# ------------------------------------------------------------------ plants


def a_command_arrives_after_its_dead_time():
    pulse = [1.0] + [0.0] * 5
    assert stepped(Delayed(plant=SUM, dead_time=3.0), pulse)[:, 0].tolist() == [0, 0, 0, 1, 1, 1]


def a_command_arrives_when_it_is_due():
    late = SwitchedDelay(plant=SUM, schedule=((0, 3), (4, 1)))
    assert stepped(late, [1.0, 0.0, 0.0, 7.0, 5.0, 0.0])[:, 0].tolist() == [0, 0, 0, 1, 8, 13]


def a_lag_passes_its_mean():
    one = stepped(Lagged(plant=SUM, time_constant=2.0), [1.0])[0, 0]
    t = np.linspace(0, 1, 100001)
    assert np.isclose(one, np.mean(1 - np.exp(-t / 2)), atol=1e-5)


def a_grade_is_a_mean_over_the_length():
    for front in (650.0, 1150.0, 2400.0):
        at = np.linspace(front - 200, front, 40001)
        points = [float(ca.DM(HILLY.grade(ca.DM(s)))) for s in at[::100]]
        assert np.isclose(float(ca.DM(HILLY.mean_grade(ca.DM(front), 200.0))), np.mean(points), atol=0.1)


def a_point_has_its_own_grade():
    line = Line(grade_starts_m=(10.0,), grade_permille=(1.0, 5.0))
    assert [float(ca.DM(line.grade(ca.DM(s)))) for s in (9.0, 10.0)] == [1, 5]


def a_curve_stops_where_it_says():
    curve = BrakingCurve()
    assert np.isclose(curve.at(curve.stop_time)[1], curve.stop_position) and abs(curve.at(curve.stop_time)[0]) < 1e-12


def the_tighter_limit_counts():
    assert Limits(-1.0, 1.0, 2.0).tightened(-3.0, 0.5, 1.0) == Limits(-1.0, 0.5, 1.0)


# ------------------------------------------------------------------ scores


def braking_costs_nothing():
    ride, axes = np.linspace(1.0, 0.0, N + 1), ("controller", "trial", "sample")
    data = xr.Dataset({"output": (axes, ride[None, None]), "applied": (axes, np.full((1, 1, N + 1), -5e3))},
                      {"controller": ["law"]})  # fmt: skip
    study = Study(name="ride", plant=PointMass(), reference=ride, controllers={"law": Planned()}, trials=1)
    assert ride_scores(study, data)["law"]["energy_kwh"] == 0


def a_jerk_is_a_second_derivative():
    t = 0.1 * np.arange(10)
    assert np.allclose(jerks(t**2, 0.1), 2.0)


def drawn(jerk):
    """Evidence of one draw whose speed has this jerk."""
    y = jerk * (0.1 * np.arange(N + 1)) ** 2 / 2
    data = xr.Dataset({"output": (("controller", "trial", "sample"), y[None, None])}, {"controller": ["law"]})
    return SimpleNamespace(
        metric=lambda name, metric: np.array([jerk]), drawn=SimpleNamespace(sizes={"draw": 1}),
        worst=lambda values: Drawn(0, {"draw": 1, "seed": 0}), signals=lambda at: data,
        study=SimpleNamespace(plant=SimpleNamespace(sampling_time=0.1)),
    )  # fmt: skip


def a_large_jerk_is_refuted():
    assert small_jerk(drawn(1.0), "law").standing is REFUTED and small_jerk(drawn(0.5), "law").standing is SUPPORTED


def integrals(**values):
    """Draws of the four integrals of two laws: ``values`` by law, (draws, 4)."""
    table = np.array([values["one"], values["other"]])
    return xr.Dataset({"scores": (("controller", "draw", "score"), table)},
                      {"controller": ["bp-fipid", "other"], "score": list(FOUR)})  # fmt: skip


def better_in_one_is_not_better_in_all():
    data = integrals(one=[[0.5, 2, 2, 2], [0.5, 0.5, 0.5, 0.5]], other=[[1, 1, 1, 1], [1, 1, 1, 1]])
    assert better_all_four(data, "bp-fipid", "other") == 0.5


def half_of_the_draws_are_not_most():
    data = integrals(one=[[2, 2, 2, 2], [0.5, 0.5, 0.5, 0.5]], other=[[1, 1, 1, 1], [1, 1, 1, 1]])

    def metric(name, metric):
        return np.ones(2) if metric == "finite" else data["scores"].sel(controller=name, score=metric).values

    evidence = SimpleNamespace(metric=metric, drawn=data, worst=lambda values: Drawn(0, {"draw": 1, "seed": 0}))
    assert better_in_most(evidence, "other").standing is REFUTED


def errors_by_trial(position, speed):
    rows = np.array([position, speed], dtype=float)[None, :, :, None] * np.ones((1, 2, len(position), 2))
    return xr.Dataset(
        {"error": (("controller", "output_name", "trial", "sample"), rows)},
        {"controller": ["law"], "output_name": ["position", "speed"]},
    )


def both_errors_are_within_the_tolerance():
    found = speeds_of(None, errors_by_trial([1.0, 0.01, 0.01], [1.0, 1.0, 0.001]))["law"]
    assert found["trials_to_tolerance"] == 3


def a_speed_that_is_off_is_not_learned():
    data = errors_by_trial([1.0, 1e-4], [1.0, 1.0])
    start = SimpleNamespace(draw=lambda plant, trials, rng: np.zeros((trials, 2)))
    study = SimpleNamespace(controllers={"law": None}, plant=None, seed=0,
                            scenario=SimpleNamespace(initial=start))  # fmt: skip
    evidence = SimpleNamespace(study=study, variant=lambda *a, **b: SimpleNamespace(data=data))
    assert initial_learning_needed(evidence).standing is REFUTED


# ------------------------------------------------------------------ claims

DOUBLE = small("Double", lambda x, u, k: (x[0] + 2 * u,), slope=lambda self, x, u, w, t: 2 * u)


def the_larger_end_decides_contraction():
    gains = SimpleNamespace(low=Fraction(1, 10), high=Fraction(6, 5), fixed=True, tried=[0.1, 1.2])
    law = SimpleNamespace(gains=gains, attained=lambda row: float(row))
    assert contraction(DOUBLE, 0, law).standing is not PROVED


def eigenvalues_stand_on_the_diagonal():
    assert spectral_radius(VARIABLE_GAIN.true_plant, 0.1).bound == 1


def a_slope_that_swings_is_no_contraction():
    study = Study(name="small", plant=DOUBLE, reference=np.linspace(0, 1, N + 1), controllers={"law": Planned()})
    assert _contraction(study, SlopeLearning(0.1, 5.0, 1.0)).standing is REFUTED


def an_error_of_a_metre_is_outside():
    assert room_cm(100.0) < 0 < room_cm(-40.0)


def a_bound_that_was_left_is_refuted():
    one = xr.Dataset(
        {"bound_excess": (("controller", "sample"), [[0.0, 0.1]]), "infeasible": (("controller", "sample"), [[0, 0]]),
         "stop_position": (("controller",), [400.0])},
        {"controller": ["law"]},
    )  # fmt: skip
    assert _kept(one, "law").standing is REFUTED


def the_worse_metric_decides():
    scores = {"a": {"stop_error_cm": 1.0, "updates": 9.0, "switches": 1.0},
              "b": {"stop_error_cm": 1.0, "updates": 3.0, "switches": 2.0}}  # fmt: skip
    assert _lower(scores, "a", "b", ("updates", "switches"), "samples").standing is REFUTED


def a_rise_of_the_function_is_refuted():
    fall = lyapunov.Fall(changes=np.array([-1.0, 0.5]), predicted=np.array([-1.0, -1.0]), whole=3, planned=3)
    assert lyapunov.falls(fall).standing is REFUTED


def a_departure_from_the_identity_is_refuted():
    fall = lyapunov.Fall(changes=np.array([-1.0, -1.5]), predicted=np.array([-1.0, -1.0]), whole=3, planned=3)
    assert lyapunov.follows(fall, 0.1).standing is REFUTED


def stored_errors_are_those_of_the_equation():
    S, d, d_hat = np.zeros((2, 3)), np.array([[1.0, 2.0], [3.0, 4.0]]), np.zeros((2, 2))
    S[1, -1] = 0.5
    change, predicted = lyapunov.decrease(S, d, d_hat, 0.1, 0.4, 0.2, 2.0)
    assert np.isclose(change[0], 0.125 + (25 - 5) * 0.1 / (2 * 0.2 * 4)) and predicted[0] == 0


def roots_leave_the_circle_where_they_do():
    alpha, lam, gain = 0.4, 0.22, 0.3
    for step in (0.5, 2.0, 3.0):
        by_speed, by_position = alpha + lam + gain, lam * (alpha + gain)
        matrix = np.array([[1 - step * by_speed, -step * by_position], [step, 1.0]])
        stable = np.abs(np.linalg.eigvals(matrix)).max() < 1
        assert stable == (least_excess(alpha, lam, gain, 1.0, step) < 0)


def a_filter_has_its_predicted_gain():
    w = 2 * np.pi * np.array([0.5, 1.0, 2.0])
    warped = np.tan(w * 0.05) / np.tan(np.pi * 1.0 * 0.1)
    assert np.allclose(low_pass_gain(w, 1.0, 0.1), 1 / np.sqrt(1 + warped**4) ** 2)


def a_late_loop_learns_what_comes_late():
    loop = Loop(alpha=0.4, lam=0.22, gamma=0.2, lag=0.0, delay=0.0, step=1e-9, filtered=True, cutoff_hz=None, lead=1.0)
    w = np.array([0.3, 1.0])
    assert np.allclose(factor(w, loop), np.abs(1 - 0.2 * np.exp(1j * w) / (1j * w + 0.4)), rtol=1e-6)


def a_grade_does_not_turn_with_the_train():
    assert turns(Maglev(), 1000.0, 10.0).standing is REFUTED


def an_order_is_told_as_it_is():
    pd, law = (Entry("metro", 1.0, name, 1.0, last, 1.0, 5) for name, last in (("pd", 0.1), ("icfdl", 0.5)))
    assert not supported(law, [pd, law]).startswith("both")


SLIPS = (
    Slip(
        where="models.actuator:Delayed.step",
        stands="queue[:m], w.vector",
        slipped="ca.vertcat(queue, u.vector)[m : 2 * m], w.vector",
        causes="a dead time that is a sample short",
        check=a_command_arrives_after_its_dead_time,
    ),
    Slip(
        where="models.switched_delay:SwitchedDelay._due",
        stands="k >= first",
        slipped="k > first",
        causes="a dead time that changes a sample late",
        check=a_command_arrives_when_it_is_due,
    ),
    Slip(
        where="models.actuator:Lagged._mean",
        stands="(1 - ca.exp(-ratio)) / ratio",
        slipped="ca.exp(-ratio)",
        causes="a lag that passes the value at the end of a sample for its mean",
        check=a_lag_passes_its_mean,
    ),
    Slip(
        where="models.line:Line.mean_grade",
        stands="averaged_steps(self.grade_starts_m, self.grade_permille, front, length)",
        slipped="stepped(self.grade_starts_m, self.grade_permille, front)",
        causes="a train of no length: grades that jump",
        check=a_grade_is_a_mean_over_the_length,
    ),
    Slip(
        where="models.line:stepped",
        stands="front >= at",
        slipped="front > at",
        causes="a grade that begins behind its place",
        check=a_point_has_its_own_grade,
    ),
    Slip(
        where="models.braking_curve:BrakingCurve.stop_position",
        stands="(2 * self.deceleration)",
        slipped="self.deceleration",
        causes="stops that are held against a mark twice as far",
        check=a_curve_stops_where_it_says,
    ),
    Slip(
        where="models.limits:Limits.tightened",
        stands="_extreme(min, ca.fmin, self.upper,",
        slipped="_extreme(max, ca.fmax, self.upper,",
        causes="the wider of two limits counts",
        check=the_tighter_limit_counts,
    ),
    Slip(
        where="studies.rail.scores:ride_scores",
        stands="np.maximum(force * (speed[:-1] + speed[1:]) / 2, 0.0)",
        slipped="np.abs(force * (speed[:-1] + speed[1:]) / 2)",
        causes="braking counts as energy drawn in traction",
        check=braking_costs_nothing,
    ),
    Slip(
        where="studies.ato.scores:jerks",
        stands="sampling_time**2",
        slipped="sampling_time",
        causes="a jerk that is a tenth of what it is: SUPPORTED below its limit",
        check=a_jerk_is_a_second_derivative,
    ),
    Slip(
        where="studies.ato.outcomes:small_jerk",
        stands="margin=JERK_LIMIT - largest",
        slipped="margin=JERK_LIMIT",
        causes="any jerk is SUPPORTED to be small",
        check=a_large_jerk_is_refuted,
    ),
    Slip(
        where="studies.ato.scores:better_all_four",
        stands="np.all(below, axis=0)",
        slipped="np.any(below, axis=0)",
        causes="a law that is better in one index is better in all four",
        check=better_in_one_is_not_better_in_all,
    ),
    Slip(
        where="studies.ato.outcomes:better_in_most",
        stands="margin=share - 0.5",
        slipped="margin=share",
        causes="better in a few draws is better in most",
        check=half_of_the_draws_are_not_most,
    ),
    Slip(
        where="studies.variable_gain.scores:scores",
        stands=" & (speed < SPEED_TOLERANCE)",
        slipped="",
        causes="faster than a fixed gain SUPPORTED by positions alone",
        check=both_errors_are_within_the_tolerance,
    ),
    Slip(
        where="studies.variable_gain.outcomes:initial_learning_needed",
        stands="max(position / POSITION, speed / SPEED)",
        slipped="position / POSITION",
        causes="converged in position is converged: the speed is dropped",
        check=a_speed_that_is_off_is_not_learned,
    ),
    Slip(
        where="studies.variable_gain.direct_term:contraction",
        stands="max(abs(1 - b * gains.low), abs(1 - b * gains.high))",
        slipped="abs(1 - b * gains.low)",
        causes="contraction PROVED for the least gain alone",
        check=the_larger_end_decides_contraction,
    ),
    Slip(
        where="studies.variable_gain.direct_term:spectral_radius",
        stands="max(abs(one) for one in eigenvalues)",
        slipped="min(abs(one) for one in eigenvalues)",
        causes="the smaller eigenvalue for the spectral radius: PROVED below 1",
        check=eigenvalues_stand_on_the_diagonal,
    ),
    Slip(
        where="studies.same_plant.claims:_contraction",
        stands="worst = max(factors",
        slipped="worst = min(factors",
        causes="contraction SUPPORTED for the gain that suits best",
        check=a_slope_that_swings_is_no_contraction,
    ),
    Slip(
        where="studies.stopping.outcomes:room_cm",
        stands="LIMIT_CM - abs(error_cm)",
        slipped="LIMIT_CM",
        causes="every stop is within 50 cm",
        check=an_error_of_a_metre_is_outside,
    ),
    Slip(
        where="studies.stopping.claims:_kept",
        stands="margin=ROUNDING - worst",
        slipped="margin=ROUNDING",
        causes="bounds that were left are kept",
        check=a_bound_that_was_left_is_refuted,
    ),
    Slip(
        where="studies.stopping.claims:_lower",
        stands="margin=min(gains)",
        slipped="margin=max(gains)",
        causes="fewer updates SUPPORT fewer switches",
        check=the_worse_metric_decides,
    ),
    Slip(
        where="studies.maglev.lyapunov:falls",
        stands="np.argmax(fall.changes / np.abs(fall.predicted))",
        slipped="np.argmin(fall.changes / np.abs(fall.predicted))",
        causes="V falls from every period to the next, if it does from one",
        check=a_rise_of_the_function_is_refuted,
    ),
    Slip(
        where="studies.maglev.lyapunov:follows",
        stands="np.abs(fall.changes / fall.predicted - 1)",
        slipped="(1 - fall.changes / fall.predicted)",
        causes="V may fall as fast as it likes and follows the identity",
        check=a_departure_from_the_identity_is_refuted,
    ),
    Slip(
        where="studies.maglev.lyapunov:decrease",
        stands="(2 * gamma * mass**2)",
        slipped="(2 * gamma * mass)",
        causes="a V that is not that of the paper",
        check=stored_errors_are_those_of_the_equation,
    ),
    Slip(
        where="studies.maglev.period_contraction:least_excess",
        stands="min(2 / by_speed, 2 * by_speed / by_position)",
        slipped="max(2 / by_speed, 2 * by_speed / by_position)",
        causes="a step PROVED stable that is not",
        check=roots_leave_the_circle_where_they_do,
    ),
    Slip(
        where="studies.maglev.period_contraction:low_pass_gain",
        stands="warped**4",
        slipped="warped**2",
        causes="a filter that is predicted to pass what it does not",
        check=a_filter_has_its_predicted_gain,
    ),
    Slip(
        where="studies.maglev.period_contraction:factor",
        stands="np.exp(1j * w * loop.lead)",
        slipped="np.exp(-1j * w * loop.lead)",
        causes="a lead that is predicted as a lag: contraction REFUTED",
        check=a_late_loop_learns_what_comes_late,
    ),
    Slip(
        where="studies.maglev.reversal:turns",
        stands="gap = np.abs(there + back)",
        slipped="gap = np.abs(there) - np.abs(there)",
        causes="the resistance of a grade turns with the train",
        check=a_grade_does_not_turn_with_the_train,
    ),
    Slip(
        where="studies.metro.ledger:supported",
        stands="entry.last < pd.last",
        slipped="entry.last > pd.last",
        causes="an order of two laws that is the other way round",
        check=an_order_is_told_as_it_is,
    ),
)
