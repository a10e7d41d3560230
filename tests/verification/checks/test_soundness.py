"""Plants and settings just beyond the premises of what is proved: none may be called PROVED, or REFUTED by a bound."""

from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest
from judging import judged, over, standings, verdict

from models.actuator import Actuator
from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, given, quantity
from verification.checks import assumptions, convergence
from verification.checks.premises import (
    no_noise,
    nothing_between,
    one_channel,
    same_but_for_the_input,
)
from verification.checks.row_sums import slope_bounds
from verification.decide.judge import Judge
from verification.enclosure.box import Box
from verification.theorems.learning import Dossier, examine
from workbench import Study, run
from workbench.contracts.finding import Standing
from workbench.contracts.law import Channels, Law
from workbench.contracts.scenario import (
    Between,
    From,
    GivenDisturbance,
    NormalDisturbance,
    NormalNoise,
    UniformNoise,
)
from workbench.contracts.trial_length import TrialLength
from workbench.contracts.verdict import NotMade, Verdict
from workbench.controllers import ICFDL, Increment
from workbench.controllers.parts.rows import known
from workbench.evidence.learning_step import learning_step, memories
from workbench.evidence.ppd import evidence
from workbench.evidence.trajectory import Lineariser, recorded, rollout

N = 20
RAMP = np.linspace(0.0, 1.0, N + 1) ** 2
PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
INCREMENTS = ("increment_monotone", "increment_weighted")
LEARNING = {"force_unit": 1.0, "lam": 1.0, "rho": 0.5, "initial_input": 0.1, "mu": 1.0}


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
    study = Study(plant=plant, reference=RAMP, **{"controllers": {"law": law}, "trials": 6, **changes})
    return Dossier(run(study, show_progress=False), "law")


def adaptive(**changes):
    return ICFDL(**{"force_unit": 1.0, "lam": 1.0, "initial_input": 0.1, "phi0": 0.5, "mu": 1.0, **changes})


def learning(**changes):
    return Increment(**{**LEARNING, **changes})


JUMPS = {
    "sign": lambda x, u, w, k: 0.5 * x + 0.2 * ca.sign(x - 0.05) + u,
    "if_else": lambda x, u, w, k: ca.if_else(x > 0.05, 0.5 * x + 0.1, 0.5 * x) + u,
    "floor of the input": lambda x, u, w, k: 0.5 * x + u + 0.1 * ca.floor(10 * u),
    "truth of a number": lambda x, u, w, k: 0.5 * x + 0.1 * ca.logic_and(x, u) + u,
}

JUMPS_WITH_U = ("floor of the input", "truth of a number")


@pytest.mark.parametrize("name", JUMPS)
def test_slopes_bound_no_difference_across_a_jump(name):
    plant = plant_of(JUMPS[name])
    d = dossier(plant, adaptive())
    assert judged(d, "A2.lifted").standing is not PROVED
    found = slope_bounds(plant, box(plant))
    assert found.reason is not None and "not shown to be continuous" in found.reason
    for one in ("A4.partial", "lambda_min.partial"):  # of the slope by u, which asks for continuity along u alone
        assert (judged(over(d, box(plant)), one).standing is PROVED) == (name not in JUMPS_WITH_U)
    e = over(dossier(plant, learning()), box(plant, (-9, 9), (-9, 9)))
    for name in INCREMENTS:
        assert judged(e, name).standing is not PROVED


def _tabled(at):
    return ca.pw_lin(at, ca.DM([-8, -0.3, 0.1, 0.45, 9]), ca.DM([0, 0.2, 0.1, 0.4, -0.3]))


OF_U = ("A4.partial", "lambda_min.partial")
SWITCHED = {
    # equation, which claims are PROVED over x and u in [-1, 1]
    "a table of x": (lambda x, u, w, k: 0.5 * x + _tabled(x) + u, ("A2.lifted", *OF_U)),
    "a table of u": (lambda x, u, w, k: 0.5 * x + _tabled(u) + u, ("A2.lifted", *OF_U)),
    "a falling table of u": (lambda x, u, w, k: 0.5 * x + _tabled(u), ("A2.lifted", "lambda_min.partial")),
    "a table as gain": (lambda x, u, w, k: 0.5 * x + u * (1 + _tabled(x)), ("A2.lifted", *OF_U)),
    "a table and a jump of x": (lambda x, u, w, k: 0.5 * x + _tabled(x) + 1e-12 * (x > 0.2) + u, OF_U),
    "a table and a jump of u": (lambda x, u, w, k: 0.5 * x + _tabled(u) + 1e-12 * (u > 0.2) + u, ()),
    "a table that jumps": (lambda x, u, w, k: 0.5 * x + _tabled(u) + ca.if_else(u > 0.1, u + 1e-9, u), ()),
    "a guarded root of x": (lambda x, u, w, k: 0.5 * x + ca.if_else(x > 0.3, ca.sqrt(x - 0.3), 0) + u, OF_U),
    "a guarded root that jumps": (lambda x, u, w, k: 0.5 * x + ca.if_else(x > 0.3, ca.sqrt(x), 0) + u, OF_U),
    "a guarded quotient": (
        lambda x, u, w, k: 0.5 * x + ca.if_else(ca.fabs(x) > 0.25, 1 / x, 16 * x) + u, ("A2.lifted", *OF_U)),
    "sides that miss by a rounding": (
        lambda x, u, w, k: 0.5 * x + ca.if_else(ca.fabs(x) > 0.3, 0.09 / x, x) + u, OF_U),
    "a mean slope beside 1": (
        lambda x, u, w, k: 0.5 * x + ca.if_else(ca.fabs(x) > 1e-8, ca.sin(x) / x, 1) * u, OF_U),
    "a guard of u": (lambda x, u, w, k: 0.5 * x + ca.if_else(u > 0.3, 2 * u, u), ()),
    "a guard of u and x": (lambda x, u, w, k: 0.5 * x + ca.if_else(u > x, 2 * u, u + 1e-9), ()),
    "a branch without a value": (lambda x, u, w, k: 0.5 * x + ca.if_else(x > 0.3, ca.sqrt(x - 0.4), 0) + u, ()),
    "a guard that lets a pole in": (lambda x, u, w, k: 0.5 * x + ca.if_else(x > -0.3, 1 / (x + 0.3), 0) + u, ()),
}  # fmt: skip


@pytest.mark.parametrize("name", SWITCHED)
def test_what_is_proved_behind_guards_and_of_tables(name):
    equation, proved = SWITCHED[name]
    plant = plant_of(equation)
    d = over(dossier(plant, adaptive(lam=9.0)), box(plant))
    found = {one: judged(d, one) for one in ("A2.lifted", *OF_U)}
    assert {one for one, verdict in found.items() if verdict.standing is PROVED} == set(proved)
    for one in proved:
        table = "continuous function through its points" in found[one].method
        assert table == ("table" in name and (name != "a table and a jump of x" or one == "A2.lifted"))


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
    for name in ("A2.printed", "lemma1", "A4.partial"):
        assert judged(d, name).standing is not PROVED, name


def test_kinks_are_no_jumps():
    plant = plant_of(lambda x, u, w, k: 0.5 * x + ca.fmax(u, 2 * u))
    d = dossier(plant, adaptive())
    found = judged(d, "A2.lifted")
    assert found.standing is PROVED and found.bound >= 2 and found.held.tries >= 100


def test_constants_are_not_computed_before_they_are_enclosed():
    """x+ = x + ((1e16 u - u) - 1e16 u) + u/2 has the slope -1/2, and +1/2 where 1e16 - 1 is rounded first."""
    plant = plant_of(lambda x, u, w, k: x + ((1e16 * u - u) - 1e16 * u) + 0.5 * u)
    evidence = SimpleNamespace(degree=1, increment=False)
    assert assumptions.sign_partial(plant, evidence, box(plant)).standing is not PROVED
    found = slope_bounds(plant, box(plant))
    assert found.gain_low <= -0.5 <= found.gain_high


def test_no_refutation_by_a_bound_that_no_point_attains():
    """The slope is 1 everywhere; on so wide a box its enclosure is far wider, and lambda lies between."""
    plant = plant_of(lambda x, u, w, k: u * (1 + x**2) - u * x * x + ca.sin(1e3 * x) * u - ca.sin(1e3 * x) * u)
    wide = box(plant, x=(-1e4, 1e4))
    found = slope_bounds(plant, wide)
    evidence = SimpleNamespace(degree=1, estimator=adaptive(lam=1.0, rho=1.0), units=("1", "1"), unit="1")
    finding = convergence.lambda_partial(plant, evidence, found, wide)
    assert max(abs(found.gain_low), abs(found.gain_high)) > 2.5, "the enclosure must be loose for this to be a test"
    assert finding.standing is UNDECIDED and "lies between" in finding.method
    small = SimpleNamespace(degree=1, estimator=adaptive(lam=0.2, rho=1.0), units=("1", "1"), unit="1")
    refuted = convergence.lambda_partial(plant, small, found, wide)
    assert refuted.standing is REFUTED and refuted.witness["b"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("gain", [0.3, 0.9, 1.5, 1.9])
def test_the_proved_contraction_holds_on_both_sides_of_one(gain):
    """For x+ = x + u every error is multiplied by 1 - l in a trial: |1 - l|, and not 1 - l, is the factor."""
    plant = plant_of(lambda x, u, w, k: x + u)
    law = learning(rho=1.0, lam=1 / (2 * gain) ** 2, eta=1e-12, eps=1e-14)  # phi stays where l = rho/(2 sqrt(lam))
    d = dossier(plant, law)
    finding = judged(over(d, box(plant, (-9, 9), (-9, 9))), "increment_monotone")
    assert finding.standing is PROVED and finding.held.margin >= 0
    errors = np.abs(np.diff(RAMP) - d.evidence.trajectories.u).max(axis=1)
    recorded = errors[1:] / errors[:-1]
    assert finding.witness["factor_at_phi0"] == pytest.approx(abs(1 - gain), rel=1e-9)
    assert (recorded <= finding.witness["factor_at_phi0"] * (1 + 1e-9)).all()


FIRST_ORDER = plant_of(lambda x, u, w, k: 0.9 * x + u)
DISTURBED = plant_of(lambda x, u, w, k: 0.9 * x + u + 0.5 * w.w, ("w",))
STEADY = GivenDisturbance(values=((0.1,) * N,))


@declared
class Massive(Plant):
    """A cart whose mass a study may believe wrongly."""

    source: ClassVar[str] = "made for tests, 2026"
    states = outputs = signals(x="1")
    inputs = signals(u="1")
    mass: float = quantity(default=1.0, unit="kg", doc="mass", above=0)
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.9 * x.x + u.u / self.mass,)

    def output(self, x):
        return (x.x,)


@declared
class Placing(Increment):
    """The law on increments, which moves the start too."""

    def place(self, memory, x0):
        return x0 + 0.01


@declared
class Leaning(Increment):
    """The law on increments, which feeds back too."""

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u * self.force_unit + 0.1 * (r - y), state


UNMET = {
    # plant, what the study changes, what the theorems say, whether the lifted bound says so too
    "noise without a bound": (FIRST_ORDER, {"noise": 0.01}, "adds noise of no bound", False),
    "noise within a bound": (FIRST_ORDER, {"noise": UniformNoise(largest=0.01)}, "adds noise of up to 0.01", False),
    "noise that is cut": (FIRST_ORDER, {"noise": NormalNoise(sigma=1e-3, limit=0.01)}, "noise of up to 0.01", False),
    "noise that repeats": (FIRST_ORDER, {"noise": np.full((1, N + 1), 0.01)}, "noise of up to 0.01", False),
    "scattered starts": (FIRST_ORDER, {"initial": From(state=(0.0,), spread=(0.01,))}, "in different states", True),
    "given starts": (FIRST_ORDER, {"initial": np.linspace(0, 0.1, 6)[:, None]}, "in different states", True),
    "carried on": (FIRST_ORDER, {"continues": True}, "begins where the last one ended", True),
    "a law that places": (FIRST_ORDER, {"controllers": {"law": Placing(**LEARNING)}}, "the law moves the state", True),
    "a law that feeds back": (FIRST_ORDER, {"controllers": {"law": Leaning(**LEARNING)}}, "acts within", False),
    "disturbed": (DISTURBED, {"disturbance": NormalDisturbance(sigmas=(0.1,))}, "disturbance differs", True),
    "a mass that changes": (Massive(), {"truth": {"mass": Between(low=0.9, high=1.1)}}, "mass (0.9 to 1.1", True),
    "masses that are given": (Massive(), {"truth": {"mass": np.linspace(1, 1.2, 6)}}, "mass (1 to 1.2", True),
    "a dead time": (FIRST_ORDER, {"actuator": Actuator(delay=2.0)}, "relative degree 1, got 3", False),
    "a lag": (FIRST_ORDER, {"actuator": Actuator(lag=0.5)}, "an actuator lies between plan and plant", False),
    "limits": (
        FIRST_ORDER,
        {"actuator": Actuator(lower=-5.0, upper=5.0)},
        "an actuator lies between plan and plant",
        False,
    ),
}


@pytest.mark.parametrize("name", UNMET)
def test_an_unmet_premise_leaves_a_theorem_undecided(name):
    plant, changes, said, lifted_too = UNMET[name]
    d = dossier(plant, learning(), **changes)
    roomy = box(d.plant, (-9, 9), (-9, 9), (-1, 1))
    for one in INCREMENTS:
        finding = judged(over(d, roomy), one)
        assert finding.standing is UNDECIDED and said in finding.method, finding
    lifted = judged(d, "A2.lifted")
    assert (lifted.standing is UNDECIDED and said in lifted.method) == lifted_too, lifted


MET = {
    "nothing special": (FIRST_ORDER, {}),
    "the same disturbance": (DISTURBED, {"disturbance": STEADY}),
    "random disturbances of a plant that has none": (FIRST_ORDER, {"disturbance": NormalDisturbance(sigmas=())}),
    "another start in all trials": (FIRST_ORDER, {"initial": (0.1,)}),
    "no spread": (FIRST_ORDER, {"initial": From(state=(0.0,), spread=(0.0,))}),
    "noise of zero": (FIRST_ORDER, {"noise": UniformNoise(largest=0.0)}),
    "a mass that is wrong, and stays so": (Massive(), {"truth": {"mass": 1.25}}),
    "lengths that are drawn": (FIRST_ORDER, {"trial_length": TrialLength(law="uniform", minimum=15)}),
    "lengths that are given": (FIRST_ORDER, {"trial_length": [20, 15, 18, 20, 16, 20]}),
}


@pytest.mark.parametrize("name", MET)
def test_what_trials_share_is_no_premise_unmet(name):
    plant, changes = MET[name]
    d = dossier(plant, learning(), **changes)
    assert one_channel(d.plant) is no_noise(d.study) is nothing_between(d.study) is None
    assert same_but_for_the_input(d.study, d.law) is None
    w = (0.1, 0.1) if "disturbance" in name else (0.0, 0.0)
    roomy = box(d.plant, (-9, 9), (-9, 9), w)
    assert judged(over(d, roomy), "increment_monotone").standing is PROVED
    assert judged(d, "A2.lifted").standing is PROVED


def test_the_true_plant_is_the_one_that_is_proved_of():
    """With 1.25 times the believed mass the slope is 0.8, and the proofs say so."""
    d = dossier(Massive(), learning(), truth={"mass": 1.25})
    assert judged(d, "A4.partial").margin == pytest.approx(0.8, rel=1e-9)
    np.testing.assert_allclose(d.evidence.partial, 0.8, rtol=1e-12)


def test_a_disturbance_bends_the_linearisation():
    """What the plant met belongs to the trajectory: with w = 1 the slope of u (1 + w) is 2, not 1."""
    plant = plant_of(lambda x, u, w, k: 0.5 * x + u * (1 + w.w), ("w",))
    d = dossier(plant, adaptive(), disturbance=GivenDisturbance(values=((1.0,) * N,)))
    np.testing.assert_allclose(d.evidence.partial, 2.0, rtol=1e-12)
    np.testing.assert_allclose(assumptions.lifted_along(plant, d.evidence).diagonal(), 2.0, rtol=1e-12)


def test_a_plant_that_changes_from_trial_to_trial_leaves_all_open_but_the_lengths():
    study = Study(
        plant=Massive(),
        reference=RAMP,
        controllers={"law": learning()},
        trials=6,
        truth={"mass": Between(low=0.9, high=1.1)},
    )
    examined = examine(run(study, show_progress=False))
    judge = Judge()
    found = [one for one in map(judge.verdict, examined.claims) if isinstance(one, Verdict)]
    stand = {one.claim.partition(".")[2]: one for one in found}
    told = {name for name, one in stand.items() if one.standing is not UNDECIDED}
    # what speaks of lengths, of this run alone, or of a plant that may change
    assert told <= {"A3", "estimator", "monotone", "increment_funnel", "learning_curve"} and "A3" in told
    for name in ("A1", "A2.printed", "A2.lifted", "A4.printed", "A4.partial", "lemma1", "theorem1", *INCREMENTS):
        assert "plant changes from trial to trial: mass" in stand[name].method
    assert set(examined.figures()) <= {"funnel_law", "learning_curve_law"}


LENGTHS = {
    "fixed": (TrialLength(law="fixed"), SUPPORTED, "algebra"),
    "drawn": (TrialLength(law="uniform", minimum=15), SUPPORTED, "algebra"),
}


@pytest.mark.parametrize("name", LENGTHS)
def test_lengths_are_a_sample_only_where_they_are_drawn(name):
    lengths, standing, said = LENGTHS[name]
    d = dossier(FIRST_ORDER, learning(), trial_length=lengths)
    finding = judged(d, "A3")
    assert finding.standing is standing and said in finding.method


def test_given_lengths_have_no_distribution():
    found = verdict(dossier(FIRST_ORDER, learning(), trial_length=[20, 15, 18, 20, 16, 20]), "A3")
    assert isinstance(found, NotMade) and "the lengths are given" in found.lacks


def test_the_box_holds_the_disturbances_that_were_drawn():
    d = dossier(DISTURBED, learning(), disturbance=NormalDisturbance(sigmas=(0.1,)))
    drawn = np.hstack([one.w for one in d.study.inputs()])
    low, high = (float(end[0, 0]) for end in d.box["w"])
    assert low <= drawn.min() < drawn.max() <= high


def test_a_box_that_does_not_hold_the_reference_proves_nothing():
    d = dossier(FIRST_ORDER, learning(), trials=2)
    for name in INCREMENTS:
        finding = judged(d, name)
        assert finding.standing is UNDECIDED and "leaves the box at sample" in finding.method


def test_a_reference_that_no_input_reaches():
    plant = plant_of(lambda x, u, w, k: 0.9 * x + 0.001 * ca.tanh(u))
    d = dossier(plant, learning())
    found = judged(over(d, box(plant, (-9, 9), (-9, 9))), "increment_monotone")
    assert found.standing is UNDECIDED and "no input was found" in found.method


def test_what_no_trial_came_to_refutes_nothing():
    """The slope breaks off just above the largest input that was used: in the scope, which is wider, but unmet."""
    used = float(np.nanmax(dossier(plant_of(lambda x, u, w, k: 0.5 * x + u), adaptive()).evidence.trajectories.u))
    for at, standing in ((used * 1.01, UNDECIDED), (used * 0.9, REFUTED)):
        plant = plant_of(lambda x, u, w, k, at=at: 0.5 * x + u - 2 * ca.fmax(u - at, 0))
        d = dossier(plant, adaptive())
        limit = float(d.box["u"][1][0, 0])
        assert at < limit
        for name in ("A1", "A4.partial"):
            found = judged(d, name)
            assert found.standing is standing, found
            assert standing is REFUTED or "no trial came" in found.method


@declared
class Pair(Plant):
    """Two inputs move one state."""

    source: ClassVar[str] = "made for tests, 2026"
    states = outputs = signals(x="1")
    inputs = signals(u="1", v="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.5 * x.x + u.u + 3 * u.v,)

    def output(self, x):
        return (x.x,)


@declared
class Seen(Plant):
    """One input, two outputs."""

    source: ClassVar[str] = "made for tests, 2026"
    states = outputs = signals(x="1", y="m")
    inputs = signals(u="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.5 * x.x + u.u, x.x)

    def output(self, x):
        return tuple(x)


@declared
class Both(Law):
    """A law of any number of channels that learns on the errors, those of a later output with more weight."""

    source: ClassVar[str] = "made for tests, 2026"
    channels: ClassVar[Channels] = Channels(None, None)
    learns_on: ClassVar[str] = "output"
    inputs: int = given(doc="number of inputs")

    def start(self, task):
        return Plan(ca.DM.zeros(self.inputs, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        e = known(trial.reached[1:], trial.e[:, 1:])
        weighed = ca.DM([0.1 * (i + 1) for i in range(e.shape[0])]).T @ e
        return Plan(memory.u + ca.repmat(weighed, self.inputs, 1))


class Plan(NamedTuple):
    u: object


CHANNELS = {
    "a second input": (Pair(), RAMP, 2, "2 input(s) (u, v) and 1 output(s) (x)"),
    "a second output": (Seen(), np.vstack([RAMP, RAMP]), 1, "1 input(s) (u) and 2 output(s) (x, y)"),
}


@pytest.mark.parametrize("name", CHANNELS)
def test_a_second_channel_is_not_passed_over(name):
    plant, reference, inputs, said = CHANNELS[name]
    assert said in one_channel(plant)
    campaign = run(
        Study(plant=plant, reference=reference, controllers={"law": Both(inputs=inputs)}, trials=3),
        show_progress=False,
    )
    for made in (
        lambda: evidence(campaign, "law"),
        lambda: recorded(campaign, "law"),
        lambda: Lineariser(plant, N),
        lambda: rollout(plant, np.zeros(len(plant.states)), np.zeros(N)),
    ):
        with pytest.raises(InvalidValue) as caught:
            made()
        assert said in str(caught.value) and "\n" not in str(caught.value)
    examined = examine(campaign)
    found = [Judge().verdict(claim) for claim in examined.claims]
    assert found and all(isinstance(one, NotMade) and one.lacks == "one input and one output" for one in found)
    assert set(examined.figures()) <= {"funnel_law", "learning_curve_law"}


def test_the_learning_gain_of_several_outputs_has_the_columns_of_each():
    campaign = run(
        Study(plant=Seen(), reference=np.vstack([RAMP, 2 * RAMP]), controllers={"law": Both(inputs=1)}, trials=3),
        show_progress=False,
    )
    *_, last = memories(campaign, "law")
    step = learning_step(campaign, "law", last)
    for output, weight in enumerate((0.1, 0.2)):
        found = step.by_error.toarray()[:, output::2]
        np.testing.assert_allclose(found, weight * np.eye(N, N + 1, 1), atol=1e-15)


HELD = {
    # every PROVED about a run, beside what the run shows
    "first order": (FIRST_ORDER, {}),
    "kinked": (plant_of(lambda x, u, w, k: 0.5 * x + ca.fmax(u, 2 * u)), {}),
    "by state and time": (plant_of(lambda x, u, w, k: 0.5 * x + (1 + 0.2 * ca.sin(k) + 0.1 * x**2) * u), {}),
    "disturbed alike": (DISTURBED, {"disturbance": STEADY}),
    "heavier than believed": (Massive(), {"truth": {"mass": 1.25}}),
    "lengths that vary": (FIRST_ORDER, {"trial_length": TrialLength(law="uniform", minimum=15)}),
}


@pytest.mark.parametrize("law", ["adaptive", "learning"])
@pytest.mark.parametrize("name", HELD)
def test_what_is_proved_is_seen_in_the_run(name, law):
    plant, changes = HELD[name]
    d = dossier(plant, adaptive() if law == "adaptive" else learning(), trials=8, **changes)
    e, found = d.evidence, standings(d)
    assert found["A2.lifted"].standing is PROVED
    sofar = np.fmax.accumulate(np.abs(np.nan_to_num(e.du[1:])), axis=1)
    ds = np.abs(np.nan_to_num(e.ds[1:]))
    assert (ds <= found["A2.lifted"].bound * sofar * (1 + 1e-9) + 1e-12).all()
    assert ds.max() > 0.01 * found["A2.lifted"].bound * sofar.max(), "a bound that nothing comes near is no test"
    assert (found["A4.partial"].standing is PROVED) == (name != "kinked")
    if name != "kinked":
        assert np.nanmin(e.partial) >= found["A4.partial"].margin * (1 - 1e-12)
    if found["lambda_min.partial"].standing is PROVED:
        b = np.nanmax(np.abs(e.partial)) * d.law.force_unit
        assert d.law.lam > (d.law.rho * b) ** 2 / 4


@pytest.mark.parametrize("name", [name for name in HELD if name != "kinked"])
def test_a_proved_contraction_is_seen_in_the_input_errors(name):
    """The input that follows the reference is found by bisection on the plant itself, sample after sample."""
    plant, changes = HELD[name]
    d = dossier(plant, learning(), trials=10, **changes)
    roomy = box(d.plant, (-3, 3), (-4, 4), (0.1, 0.1) if "disturbance" in changes else (0.0, 0.0))
    finding = judged(over(d, roomy), "increment_weighted")
    assert finding.standing is PROVED, finding
    taken = d.evidence.trajectories
    wanted = followed(d.plant, taken.x[0, :, 0], taken.w[0])
    weights = finding.witness["a"] ** np.arange(N)
    left = (np.abs(wanted - taken.u) * weights).max(axis=1)
    assert left[0] > 1e-3 and (left[1:] <= left[:-1] * (1 + 1e-9)).all()
    assert left[-1] < left[0]


def test_the_proved_factor_counts_what_earlier_inputs_do():
    """Errors of one sign add up in x+ = 0.9 x + u: the last sample keeps 1 - l 0.9^(N-1) of its, and not 1 - l."""
    wanted = followed(FIRST_ORDER, [0.0], np.zeros((0, N)))
    d = dossier(FIRST_ORDER, learning(eta=1e-12, eps=1e-14), first_plan=wanted - 1.0, trials=2)
    finding = judged(over(d, box(d.plant, (-30, 30), (-9, 9))), "increment_monotone")
    left = np.abs(wanted - d.evidence.trajectories.u).max(axis=1)
    factor = finding.witness["factor_at_phi0"]
    assert left[0] == pytest.approx(1.0, abs=1e-9) and finding.standing is PROVED
    assert left[1] / left[0] == pytest.approx(1 - 0.25 * 0.9 ** (N - 1), rel=1e-9)
    assert left[1] / left[0] == pytest.approx(factor, rel=1e-9)
    assert left[1] / left[0] <= factor * (1 + 1e-12)


def followed(plant, x0, w):
    """The input whose output gains what the reference gains at every sample."""
    step, x, found = plant.step_function(), np.asarray(x0, dtype=float), []
    for k, gained in enumerate(np.diff(RAMP)):
        low, high = -50.0, 50.0
        for _ in range(100):
            middle = (low + high) / 2
            after = float(step(x, middle, w[:, k], k))
            low, high = (middle, high) if after - x[0] < gained else (low, middle)
        found.append(middle)
        x = np.array([after])
    return np.array(found)
