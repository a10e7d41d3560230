"""The scope of a proof: it contains whatever a campaign draws, or says in words where it does not."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from models.actuator import Actuator, Lagged
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, nested, quantity, rebuilt
from workbench import Study, Verification
from workbench.contracts.claim import Range
from workbench.contracts.scenario import (
    Between,
    Departure,
    Disturbance,
    From,
    Initial,
    Noise,
    NormalDisturbance,
    NormalNoise,
    UniformNoise,
)
from workbench.contracts.scope import scope_of, symbolic_plant
from workbench.controllers import PD

N = 30


def study(**fields):
    plant = fields.get("plant", PointMass())
    reference = np.zeros((len(plant.outputs), N + 1))
    made = dict(plant=plant, reference=reference, controllers={"pd": PD()}, trials=6, seed=2)
    return Study(**(made | fields))


def maglev(**fields):
    return study(plant=Maglev(), **fields)


@declared
class Gusts(Disturbance):
    """Uniform disturbances, drawn anew for every trial."""

    def draw(self, plant, samples, rng):
        return rng.uniform(-1, 2, (len(plant.disturbances), samples))

    @property
    def repeats(self):
        return False

    def bound(self, plant):
        return np.tile([-1.0, 2.0], (len(plant.disturbances), 1))


SINE = np.sin(np.arange(N))[None]
BEHIND = Actuator(lag=0.3, delay=0.2, lower=-3e4, upper=5e4)
CASES = {
    "nothing": study(),
    "another mass": study(truth={"mass": 1.2}),
    "masses": study(truth={"mass": Between(low=0.8, high=1.2), "b0_mean": Between(low=0.5, high=2.0)}),
    "masses by trial": study(truth={"mass": [1.0, 1.1, 0.9, 1.0, 1.3, 1.0]}),
    "a swing below zero": study(plant=PointMass(b0_swing=-275.0), truth={"b0_swing": Between(low=-0.5, high=2.0)}),
    "an actuator": study(actuator=BEHIND, initial=(3.0, 40.0), truth={"mass": Between(low=0.8, high=1.2)}),
    "starts": study(initial=From(state=(0.3, 40.0), spread=(-0.2, 10.0))),
    "starts by trial": study(initial=np.arange(12.0).reshape(6, 2)),
    "a disturbance that repeats": maglev(disturbance=SINE),
    "gusts": maglev(disturbance=Gusts()),
    "noise that has a limit": study(noise=NormalNoise(sigma=0.2, limit=0.5)),
    "noise on one output": study(plant=MetroLine(), noise=UniformNoise(largest=0.2, output="speed")),
    "a lag of its own behind another": study(
        plant=Lagged(plant=PointMass(), time_constant=0.5),
        actuator=Actuator(lag=0.3),
        truth={"time_constant": Between(low=0.5, high=2.0), "plant.mass": Between(low=0.8, high=1.2)},
    ),
}


SHOWN = {
    "masses": {"plant mass", "plant b0_mean"},
    "masses by trial": {"plant mass"},
    "a swing below zero": {"plant b0_swing"},
    "an actuator": {"plant mass"},
    "starts": {"initial speed", "initial position"},
    "starts by trial": {"initial speed", "initial position"},
    "gusts": {f"disturbance {Maglev().disturbances[0].name}"},
    "noise that has a limit": {"noise speed"},
    "noise on one output": {"noise speed"},
    "a lag of its own behind another": {"plant time_constant", "plant plant.mass"},
}


def inside(scope, made):
    """Tell whether all that a study draws lies in a scope, quantities by the plant that runs in every trial."""
    (low, high), found = scope.disturbance, []
    for one in made.inputs():
        found += [(scope.start[:, 0] <= one.x0).all() and (one.x0 <= scope.start[:, 1]).all()]
        found += [(low <= one.w).all() and (one.w <= high).all()]
        found += [(np.abs(one.noise).max(axis=1) <= scope.noise).all()]
    factors = made.factors()
    assert set(factors) == scope.moving
    plain = dict(zip(*symbolised_values(made.plant), strict=True))
    for name, row in factors.items():
        values = plain[name] * row
        found += [scope.parameters[name].low <= values.min() and values.max() <= scope.parameters[name].high]
    return all(found)


def symbolised_values(plant):
    from models.quantity import symbolised

    return symbolised(plant)[1::2]


@pytest.mark.parametrize("case", CASES)
def test_by_default_it_contains_all_that_is_drawn_and_is_no_wider_than_that(case):
    made = CASES[case]
    scope = scope_of(made)
    runs = made.plant_that_runs
    assert scope.open == () and inside(scope, made)
    assert scope.start.shape == (len(runs.states), 2) and scope.noise.shape == (len(runs.outputs),)
    assert [end.shape for end in scope.disturbance] == [(len(runs.disturbances), N)] * 2
    repeats = made.scenario.disturbance.repeats
    assert (scope.disturbance[0] == scope.disturbance[1]).all() == (repeats or not runs.disturbances)
    behind = scope.start[len(made.plant.states) :]
    assert not behind.any()
    assert set(scope.parameters) == scope.moving == set(made.factors())
    assert all(one.low < one.high for one in scope.shown().values())
    assert set(scope.shown()) == SHOWN.get(case, set())


NARROW = {
    "masses": {"plant.mass": (290e3, 400e3)},
    "masses by trial": {"plant.mass": (300e3, 400e3)},
    "another mass": {"plant.mass": (300e3, 400e3)},
    "nothing": {"plant.mass": (280e3, 300e3)},
    "starts": {"initial.position": (35.0, 45.0)},
    "an actuator": {"initial.speed": (0.0, 1.0)},
    "starts by trial": {"initial.speed": (0.0, 9.0)},
    "a disturbance that repeats": {"disturbance.force": (-0.5, 0.5)},
    "gusts": {"disturbance.force": (-0.5, 3.0)},
    "noise that has a limit": {"noise.speed": (-0.4, 0.4)},
    "noise on one output": {"noise.speed": (-0.1, 0.1)},
}


def named(case, scope):
    fields = {name: getattr(CASES[case], name) for name in ("truth", "initial", "disturbance", "noise", "actuator")}
    return study(plant=CASES[case].plant, **fields, verify=Verification(scope=scope))


@pytest.mark.parametrize("case", NARROW)
def test_a_scope_that_is_too_narrow_says_so_and_a_wide_one_does_not(case):
    ((name, (low, high)),) = NARROW[case].items()
    if name.startswith("disturbance"):
        name = f"disturbance.{CASES[case].plant.disturbances[0].name}"
    made = named(case, {name: (low, high)})
    scope = scope_of(made)
    (said,) = scope.open
    assert f"the scope holds {name} " in said and ", and the study " in said and "\n" not in said
    assert scope.shown()[name.replace(".", " ", 1)][:2] == (low, high)
    wide = scope_of(named(case, {name: (-1e9, 1e9) if not name.startswith("plant") else (1.0, 1e9)}))
    assert wide.open == () and wide.moving == scope.moving
    if name != "plant.mass":
        assert not inside(scope, made)
    one = scope.shown()[name.replace(".", " ", 1)]
    assert one.unit == {"plant.mass": "kg", "initial.position": "m", "initial.speed": "km/h"}.get(name, one.unit)


@pytest.mark.parametrize(
    ("fields", "scope", "says"),
    [
        (
            {},
            {"plant.mass": (280e3, 300e3)},
            "the scope holds plant.mass 280000 to 300000 kg, and the study runs with 350000",
        ),
        (
            {"truth": {"mass": Between(low=0.5, high=1.5)}},
            {"plant.mass": (280e3, 300e3)},
            "the scope holds plant.mass 280000 to 300000 kg, and the study meets 175000 to 525000",
        ),
        ({"noise": 0.1}, {}, "what the study meets of noise.speed has no bound: name a range for it in verify.scope"),
    ],
)  # fmt: skip
def test_what_is_said(fields, scope, says):
    assert scope_of(study(**fields, verify=Verification(scope=scope))).open == (says,)


def test_a_quantity_that_was_named_does_not_move_unless_the_study_moves_it():
    still = scope_of(study(verify=Verification(scope={"plant.mass": (280e3, 420e3), "noise.speed": (0, 0)})))
    assert not still.moving and still.open == ()
    assert still.parameters == {"mass": Range(280e3, 420e3, "kg")}
    assert still.shown() == {"plant mass": Range(280e3, 420e3, "kg"), "noise speed": Range(0.0, 0.0, "km/h")}
    moved = study(truth={"mass": Between(low=0.9, high=1.1)}, verify=Verification(scope={"plant.mass": (280e3, 420e3)}))
    assert scope_of(moved).moving == {"mass"} and scope_of(moved).parameters == still.parameters


@pytest.mark.parametrize("factor", [1.1, 0.7, 1 / 3, 2.3])
def test_an_end_that_misses_what_is_met_by_rounding_alone_is_moved_there(factor):
    met = 350e3 * factor
    for near, apart in ((math.nextafter(met, 0), False), (met * (1 - 1e-12), True)):
        made = study(
            truth={"mass": Between(low=0.1, high=factor)}, verify=Verification(scope={"plant.mass": (1.0, near)})
        )
        scope = scope_of(made)
        assert bool(scope.open) == apart and (scope.parameters["mass"].high == met) == (not apart)


@pytest.mark.parametrize("nu", [0.0, 0.05, 0.1, 0.25, 0.4])
@pytest.mark.parametrize(
    "noise",
    [
        NormalNoise(sigma=0.1),
        NormalNoise(sigma=0.1, limit=0.3),
        UniformNoise(largest=0.3),
        [0.1],
        np.linspace(-0.3, 0.3, N + 1)[None],
    ],
    ids=str,
)
def test_the_share_of_noise_beyond_what_was_named_is_that_of_a_long_draw(noise, nu):
    made = study(noise=noise, verify=Verification(scope={"noise.speed": (-nu, nu)}))
    kind, samples = made.scenario.noise, 200_000
    drawn = kind.draw(made.plant, samples, np.random.default_rng(1))
    share = float((np.abs(drawn) > nu).mean())
    (told,) = kind.beyond(made.plant, np.array([nu]))
    assert told == pytest.approx(share, abs=5 * math.sqrt(max(share, 1e-5) / samples))
    said = scope_of(made).open
    inside = kind.bound(made.plant)[0] <= nu
    assert (said == ()) == inside and scope_of(made).noise.tolist() == [nu]
    if not inside:
        assert said[0].endswith(f"{100 * told:.3g} % of its samples lie beyond")
        assert ("has no bound" in said[0]) == (not np.isfinite(kind.bound(made.plant)[0]))


@declared
class Loud(Noise):
    """Noise of a user's own, without a word of its tails."""

    def draw(self, plant, samples, rng):
        return rng.uniform(-1, 1, (len(plant.outputs), samples))

    def bound(self, plant):
        return np.ones(len(plant.outputs))


def test_tails_that_are_not_known_or_hardly_there_are_said_to_be():
    (said,) = scope_of(study(noise=Loud(), verify=Verification(scope={"noise.speed": (-0.5, 0.5)}))).open
    assert said.endswith("an unknown share of its samples lie beyond")
    (said,) = scope_of(study(noise=0.1, verify=Verification(scope={"noise.speed": (-5.0, 5.0)}))).open
    assert said.endswith("less than 1e-10 % of its samples lie beyond")


@pytest.mark.parametrize("actuator", [Actuator(), Actuator(lag=0.3)])
def test_trials_that_go_on_from_one_another_have_starts_without_bound(actuator):
    scope = scope_of(study(continues=True, actuator=actuator))
    assert np.isinf(scope.start).all() and scope.open == (
        "a trial begins where the last one ended, so nothing bounds where trials begin",
    )
    held = scope_of(study(continues=True, verify=Verification(scope={"initial.speed": (0, 1)})))
    assert held.start.tolist() == [[0, 1], [-np.inf, np.inf]] and len(held.open) == 1
    assert not scope_of(study(continues=True, trials=1)).start.any()


def test_disturbances_without_bound_and_their_samples():
    name = Maglev().disturbances[0].name
    endless = scope_of(maglev(disturbance=NormalDisturbance(sigmas=(1.0,))))
    assert np.isinf(endless.disturbance).all() and f"disturbance.{name} has no bound" in endless.open[0]
    again = scope_of(maglev(disturbance=SINE))
    assert np.array_equal(again.disturbance[0], SINE) and again.shown() == {}
    held = scope_of(maglev(disturbance=SINE, verify=Verification(scope={f"disturbance.{name}": (-1, 1)})))
    assert [np.unique(end).tolist() for end in held.disturbance] == [[-1], [1]] and held.open == ()
    assert held.shown()[f"disturbance {name}"][:2] == (-1, 1)


@declared
class Odd(Initial):
    """Starts whose bounds are those that it is made with."""

    low: float = quantity(default=0.0, unit="1", doc="least")
    rows: int = quantity(default=2, unit="1", doc="rows", structural=True)

    def draw(self, plant, trials, rng):
        return np.zeros((trials, len(plant.states)))

    @property
    def repeats(self):
        return False

    def bound(self, plant):
        return np.tile([self.low, 0.0], (int(self.rows), 1))


@pytest.mark.parametrize("odd", [Odd(low=1.0), Odd(rows=3), Odd(rows=1)])
def test_bounds_that_are_none_are_refused_in_one_line(odd):
    with pytest.raises(
        InvalidValue, match=r"Odd.bound must give numbers of shape \(2, 2\), low at most high; got"
    ) as caught:
        scope_of(study(initial=odd))
    assert "\n" not in str(caught.value)


@declared
class Once(Initial):
    """A start that is drawn once, from what has no bound."""

    def draw(self, plant, trials, rng):
        return np.tile(rng.normal(size=len(plant.states)), (trials, 1))

    @property
    def repeats(self):
        return True

    def bound(self, plant):
        return np.tile([-math.inf, math.inf], (len(plant.states), 1))


def test_a_start_that_repeats_is_the_one_that_is_drawn():
    made = study(initial=Once(), noise=UniformNoise(largest=0.1))
    scope = scope_of(made)
    assert scope.open == () and np.array_equal(scope.start.T, [made.inputs()[0].x0] * 2) and scope.start.any()


@declared
class Endless(Departure):
    """A factor that may be anything."""

    def draw(self, trials, rng):
        return rng.normal(1, 0.01, trials)

    @property
    def range(self):
        return -math.inf, math.inf


def test_a_departure_without_bound_is_said_to_have_none():
    made = study(truth={"mass": Endless(), "b0_swing": Endless()}, plant=PointMass(b0_swing=0.0))
    scope = scope_of(made)
    assert scope.parameters["mass"][:2] == (-math.inf, math.inf) and scope.parameters["b0_swing"][:2] == (0.0, 0.0)
    assert scope.open == ("what the study meets of plant.mass has no bound: name a range for it in verify.scope",)


@pytest.mark.parametrize(
    ("case", "values"),
    [
        ("nothing", {"mass": 3e5}),
        ("an actuator", {"b2_mean": 0.3, "mass": 4e5}),
        ("an actuator", {"sampling_time": 0.1}),
        ("another mass", {"length": 100.0}),
        ("a lag of its own behind another", {"time_constant": 0.7, "plant.mass": 3e5}),
    ],
)
def test_a_symbol_stands_for_the_quantity_wherever_it_counts(case, values):
    made = CASES[case]
    plant, symbols = symbolic_plant(made, list(values))
    assert list(symbols) == list(values)
    at = plant.symbols()
    step = ca.Function("step", [*at.values(), *symbols.values()], [plant.next_state(**at), plant.measured(at["x"])])
    numeric = made.actuator.wrapped(rebuilt(made.true_plant, nested(values)))
    rng = np.random.default_rng(0)
    for _ in range(5):
        x, u, w = (rng.uniform(0, 9, len(one)) for one in (plant.states, plant.inputs, plant.disturbances))
        x_next, y = step(x, 1e4 * u, w, 3, *values.values())
        np.testing.assert_allclose(x_next, numeric.step_function()(x, 1e4 * u, w, 3), rtol=1e-13)
        np.testing.assert_allclose(y, numeric.output_function()(x), rtol=1e-13)
    assert all(ca.depends_on(plant.next_state(**at), symbol) for symbol in symbols.values())


@pytest.mark.parametrize("path", ["mas", "reading", "plant.mass"])
def test_a_symbol_for_what_is_no_quantity_is_refused(path):
    with pytest.raises(InvalidValue, match=f"a symbol may stand for one of: mass, .*; got {path!r}"):
        symbolic_plant(CASES["an actuator"], [path])
