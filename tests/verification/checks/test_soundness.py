"""Plants and settings just beyond the premises of what is proved: none may be called PROVED, or REFUTED by a bound."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from models.plant import Plant, signals
from models.quantity import declared, quantity
from verification.checks import assumptions, convergence, increment
from verification.checks.premises import no_noise, one_channel, reference_within, same_but_for_the_input
from verification.checks.row_sums import slope_bounds
from verification.enclosure.box import Box
from verification.theorems.learning import Dossier
from workbench import TrialStudy, run
from workbench.contracts.verdict import Standing
from workbench.controllers import ICFDL, Increment
from workbench.evidence.trajectory import rollout
from workbench.trials.drawn import SpeedNoise

N = 20
RAMP = np.linspace(0.0, 1.0, N + 1) ** 2
PROVED, REFUTED, UNDECIDED = Standing.PROVED, Standing.REFUTED, Standing.UNDECIDED


def plant_of(equation, disturbances=()):
    """A plant of one state, x+ = equation(x, u, w, k)."""
    members = {
        "__annotations__": {"sampling_time": float},
        "__doc__": "A small plant.",
        "source": "made for tests, 2026",
        "sampling_time": quantity(default=1.0, unit="s", doc="sampling time", above=0),
        "states": signals(x="1"),
        "inputs": signals(u="1"),
        "outputs": signals(x="1"),
        "disturbances": signals(**dict.fromkeys(disturbances, "1")),
        "step": lambda self, x, u, w, k: (equation(x.x, u.u, w, k),),
        "output": lambda self, x: (x.x,),
    }
    return declared(type("Small", (Plant,), members))()


def box(plant, x=(-1.0, 1.0), u=(-1.0, 1.0), w=(0.0, 0.0)):
    ends = [np.full(len(plant.disturbances), end) for end in w]
    return Box({"x": x, "u": u, "w": tuple(ends), "k": (0.0, float(N))})


def dossier(plant, law, **changes):
    study = TrialStudy(plant=plant, reference=RAMP, controllers={"law": law}, **{"trials": 6, **changes})
    return Dossier(run(study, show_progress=False), "law")


def adaptive(**changes):
    return ICFDL(**{"force_unit": 1.0, "lam": 1.0, "initial_input": 0.1, "phi0": 0.5, "mu": 1.0, **changes})


def learning(**changes):
    return Increment(**{"force_unit": 1.0, "lam": 1.0, "rho": 0.5, "initial_input": 0.1, "mu": 1.0, **changes})


JUMPS = {
    "sign": lambda x, u, w, k: 0.5 * x + 0.2 * ca.sign(x - 0.05) + u,
    "if_else": lambda x, u, w, k: ca.if_else(x > 0.05, 0.5 * x + 0.1, 0.5 * x) + u,
    "floor of the input": lambda x, u, w, k: 0.5 * x + u + 0.1 * ca.floor(10 * u),
    "truth of a number": lambda x, u, w, k: 0.5 * x + 0.1 * ca.logic_and(x, u) + u,
}


@pytest.mark.parametrize("name", JUMPS)
def test_slopes_bound_no_difference_across_a_jump(name):
    plant = plant_of(JUMPS[name])
    d = dossier(plant, adaptive())
    assert assumptions.lipschitz_lifted(plant, d.evidence, d.box).standing is not PROVED
    found = slope_bounds(plant, box(plant))
    assert found.reason is not None and "not shown to be continuous" in found.reason
    assert convergence.lambda_partial(plant, d.evidence, box(plant)).standing is not PROVED
    for check in (increment.monotone, increment.weighted):
        e = dossier(plant, learning()).evidence
        assert check(plant, e, box(plant, (-9, 9), (-9, 9))).standing is not PROVED


def test_a_bound_by_slopes_would_be_broken_across_a_jump():
    """What the test above guards against, on numbers: two plans differ by 1e-9, their outputs by 0.2."""
    plant = plant_of(JUMPS["sign"])
    base = np.zeros(N)
    base[0] = 0.25  # leads to x = 0.05, where the sign jumps
    outputs = [rollout(plant, [0.0], base + shift)[1] for shift in (-1e-9, 1e-9)]
    assert np.abs(outputs[1] - outputs[0]).max() > 0.2


def test_a_jump_of_a_plant_without_memory():
    plant = plant_of(lambda x, u, w, k: u + ca.floor(4 * u))
    d = dossier(plant, adaptive())
    for check in (assumptions.lipschitz_printed, assumptions.data_model, assumptions.sign_partial):
        assert check(plant, d.evidence, d.box).standing is not PROVED, check


def test_kinks_are_no_jumps():
    plant = plant_of(lambda x, u, w, k: 0.5 * x + ca.fmax(u, 2 * u))
    d = dossier(plant, adaptive())
    finding = assumptions.lipschitz_lifted(plant, d.evidence, d.box)
    assert finding.standing is PROVED and finding.margin >= 2


def test_constants_are_not_computed_before_they_are_enclosed():
    """x+ = x + ((1e16 u - u) - 1e16 u) + u/2 has the slope -1/2, and +1/2 where 1e16 - 1 is rounded first."""
    plant = plant_of(lambda x, u, w, k: x + ((1e16 * u - u) - 1e16 * u) + 0.5 * u)
    evidence = SimpleNamespace(degree=1)
    assert assumptions.sign_partial(plant, evidence, box(plant)).standing is not PROVED
    found = slope_bounds(plant, box(plant))
    assert found.gain_low <= -0.5 <= found.gain_high


def test_no_refutation_by_a_bound_that_no_point_attains():
    """The slope is 1 everywhere; on so wide a box its enclosure is far wider, and lambda lies between."""
    plant = plant_of(lambda x, u, w, k: u * (1 + x**2) - u * x * x + ca.sin(1e3 * x) * u - ca.sin(1e3 * x) * u)
    wide = box(plant, x=(-1e4, 1e4))
    found = slope_bounds(plant, wide)
    evidence = SimpleNamespace(degree=1, increment=False, law=adaptive(lam=1.0, rho=1.0), units=("1", "1"))
    finding = convergence.lambda_partial(plant, evidence, wide)
    assert max(abs(found.gain_low), abs(found.gain_high)) > 2.5, "the enclosure must be loose for this to be a test"
    assert finding.standing is UNDECIDED and "lies between" in finding.method
    small = SimpleNamespace(degree=1, increment=False, law=adaptive(lam=0.2, rho=1.0), units=("1", "1"))
    refuted = convergence.lambda_partial(plant, small, wide)
    assert refuted.standing is REFUTED and refuted.witness["b"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("gain", [0.3, 0.9, 1.5, 1.9])
def test_the_proved_contraction_holds_on_both_sides_of_one(gain):
    """For x+ = x + u every error is multiplied by 1 - l in a trial: |1 - l|, and not 1 - l, is the factor."""
    plant = plant_of(lambda x, u, w, k: x + u)
    law = learning(rho=1.0, lam=1 / (2 * gain) ** 2, eta=1e-12, eps=1e-14)  # phi stays where l = rho/(2 sqrt(lam))
    d = dossier(plant, law)
    finding = increment.monotone(plant, d.evidence, box(plant, (-9, 9), (-9, 9)))
    assert finding.standing is PROVED
    errors = np.abs(np.diff(RAMP) - d.evidence.trajectories.u).max(axis=1)
    recorded = errors[1:] / errors[:-1]
    assert finding.witness["factor_at_phi0"] == pytest.approx(abs(1 - gain), rel=1e-9)
    assert (recorded <= finding.witness["factor_at_phi0"] * (1 + 1e-9)).all()


class Scattered:
    """Trials begin in different states."""

    def draw(self, plant, trials, rng):
        return rng.normal(0, 0.01, (trials, len(plant.states)))


class Shaken:
    """A disturbance of its own in every trial."""

    def draw(self, plant, samples, rng):
        return rng.normal(0, 0.1, (len(plant.disturbances), samples))


class Steady:
    """The same disturbance in every trial."""

    def draw(self, plant, samples, rng):
        return np.full((len(plant.disturbances), samples), 0.1)


FIRST_ORDER = plant_of(lambda x, u, w, k: 0.9 * x + u)
DISTURBED = plant_of(lambda x, u, w, k: 0.9 * x + u + 0.5 * w.w, ("w",))
UNMET = {
    "noise": (FIRST_ORDER, {"noise": SpeedNoise(speed_sigma=0.01)}, "measurement noise", False),
    "scattered starts": (FIRST_ORDER, {"initial": Scattered()}, "begin in different states", True),
    "carried on": (FIRST_ORDER, {"continues": True}, "begins where the last one ended", True),
    "disturbed": (DISTURBED, {"disturbance": Shaken()}, "disturbance differs between trials", True),
}


@pytest.mark.parametrize("name", UNMET)
def test_an_unmet_premise_leaves_a_theorem_undecided(name):
    plant, changes, said, lifted_too = UNMET[name]
    d = dossier(plant, learning(), **changes)
    roomy = box(plant, (-9, 9), (-9, 9), (-1, 1))
    for check in (increment.monotone, increment.weighted):
        finding = check(plant, d.evidence, roomy)
        assert finding.standing is UNDECIDED and said in finding.method
    lifted = assumptions.lipschitz_lifted(plant, d.evidence, d.box)
    assert (lifted.standing is UNDECIDED and said in lifted.method) == lifted_too


def test_what_trials_share_is_no_premise_unmet():
    d = dossier(DISTURBED, learning(), disturbance=Steady())
    roomy = box(DISTURBED, (-9, 9), (-9, 9), (0.1, 0.1))
    assert increment.monotone(DISTURBED, d.evidence, roomy).standing is PROVED
    assert assumptions.lipschitz_lifted(DISTURBED, d.evidence, d.box).standing is PROVED
    assert d.box["w"][0][0, 0] == d.box["w"][1][0, 0] == 0.1


def test_the_box_holds_the_disturbances_that_were_drawn():
    d = dossier(DISTURBED, learning(), disturbance=Shaken())
    drawn = np.hstack([one.w for one in d.study.inputs()])
    low, high = (float(end[0, 0]) for end in d.box["w"])
    assert low <= drawn.min() < drawn.max() <= high


def test_a_box_that_does_not_hold_the_reference_proves_nothing():
    d = dossier(FIRST_ORDER, learning(), trials=2)
    for check in (increment.monotone, increment.weighted):
        finding = check(FIRST_ORDER, d.evidence, d.box)
        assert finding.standing is UNDECIDED and "leaves the box at sample" in finding.method


def test_a_reference_that_no_input_reaches():
    plant = plant_of(lambda x, u, w, k: 0.9 * x + 0.001 * ca.tanh(u))
    d = dossier(plant, learning())
    assert "no input was found" in reference_within(d.study, box(plant, (-9, 9), (-9, 9)))


def test_premises_that_are_met_say_nothing():
    study = dossier(FIRST_ORDER, learning()).study
    assert one_channel(FIRST_ORDER) is same_but_for_the_input(study) is no_noise(study) is None
    assert reference_within(study, box(FIRST_ORDER, (-9, 9), (-9, 9))) is None


def test_a_second_input_is_not_passed_over():
    @declared
    class Pair(Plant):
        """Two inputs move one state."""

        source = "made for tests, 2026"
        states = outputs = signals(x="1")
        inputs = signals(u="1", v="1")
        sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

        def step(self, x, u, w, k):
            return (0.5 * x.x + u.u + 3 * u.v,)

        def output(self, x):
            return (x.x,)

    plant = Pair()
    assert "has 2 and 1" in one_channel(plant)
    taken = dossier(FIRST_ORDER, learning())
    roomy = Box({"x": (-9, 9), "u": (np.full(2, -9), np.full(2, 9)), "w": (np.zeros(0), np.zeros(0)), "k": (0.0, 9.0)})
    for check in (increment.monotone, increment.weighted):
        finding = check(plant, taken.evidence, roomy)
        assert finding.standing is UNDECIDED and "one input and one output" in finding.method
