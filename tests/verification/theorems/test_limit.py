"""The conclusion of Theorem 1 and the limit of increments: what is proved, and what lies just beyond each premise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest
from judging import judged
from learning_laws import FeedsBack, Late
from small_plants import small
from small_studies import gathered, in_plant_units

from models.actuator import Actuator
from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, given, quantity
from verification.checks import limit
from verification.decide.judge import Judge
from verification.enclosure.box import Box
from verification.theorems import conclusion
from verification.theorems.dossier import Dossier
from verification.theorems.limit import claims_of, increment_limit
from workbench import Study, TrialLength, run
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding, Grounds, Standing, undecided
from workbench.contracts.law import Channels, Law, LearningGain
from workbench.contracts.scenario import Between, From
from workbench.contracts.verdict import NotMade, Verdict
from workbench.controllers import CFDL, ICFDL, PD, Increment

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
N = 12
VARIED, SHORT = Between(low=0.9, high=1.1), TrialLength(minimum=4, maximum=N - 1)
RAMP = np.sin(np.linspace(0, 2, N + 1))
FIRST_ORDER = small("FirstOrder", lambda x, u, k: (0.6 * x[0] + 0.5 * u,))
TIMED = small("Timed", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.2 * ca.sin(k)) * u,))
KINKED = small("Kinked", lambda x, u, k: (0.3 * ca.fabs(x[0] - 0.2) + ca.fmax(x[0], 0.5) + 0.5 * u,))
BENT = small("Bent", lambda x, u, k: (x[0] + 0.4 * ca.sin(3 * x[0]) + 0.1 * x[0] ** 2 + 0.5 * u,))
SWITCHED = small("Switched", lambda x, u, k: (0.6 * x[0] + ca.if_else(k < 4, 0.5, 0.7) * u + ca.floor(k / 3),))
RISING = small("Rising", lambda x, u, k: (1.8 * x[0] + 0.5 * u,))
UNIT = small("Unit", lambda x, u, k: (0.5 * x[0] + u,))


def law(kind: Any = ICFDL, **changes: Any) -> Any:
    """Return a law in the plants' own unit, the paper's where no kind is named."""
    return in_plant_units(kind, **changes)


def gather(plant: Plant, controller: Any = None, **changes: Any) -> Dossier:
    """Return the dossier of a law on a plant, over twelve trials of uniform lengths where nothing else is said."""
    lengths = changes.pop("lengths", TrialLength(law="uniform", minimum=N // 2))
    return gathered(plant, controller or law(), lengths=lengths, **{"trials": 12, "reference": RAMP, **changes})


def at_edge(share: float) -> Any:
    """Return a law whose l_max b is twice a share, b = 1."""
    return law(rho=1.0, lam=1 / (16 * share**2))


def switched(x: Any) -> Any:
    return ca.if_else(x > 0.1, 0.2, 0.0)


@declared
class Hasty(ICFDL):
    """An estimator that goes beyond the data."""

    eta: float = quantity(default=1.5, unit="1", doc="step of the estimator", above=0)


@declared
class Drifting(ICFDL):
    """It tells an estimate that doubles from trial to trial, so that its gain dies out."""

    def update(self, phi: Any, du: Any, xi: Any) -> Any:
        return 2 * phi


@declared
class Tiring(ICFDL):
    """Its estimate is the formula's, its gain is not: it dies out with the trials."""

    def learn(self, memory: Any, trial: Any) -> Any:
        return super().learn(memory, trial)._replace(u=memory.u + (super().learn(memory, trial).u - memory.u) / 2)


@declared
class Fed(FeedsBack, ICFDL):
    """It feeds back within the trial."""


@declared
class Filtered(ICFDL):
    """It says that it filters its plan."""

    filters_plan: ClassVar[bool] = True  # type: ignore[assignment]


@declared
class TwoInputs(Plant):
    """Two inputs."""

    source: ClassVar[str] = "made for tests"
    states = outputs = signals(x="1")
    inputs = signals(u="1", v="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (0.5 * x.x + u.u + u.v,)

    def output(self, x: Any) -> Any:
        return (x.x,)


class Nothing(NamedTuple):
    u: Any


@declared
class Both(Law):
    """A law of any number of inputs, so that a study may refuse the other."""

    source: ClassVar[str] = "made for tests, 2026"
    channels: ClassVar[Channels] = Channels(None, None)
    inputs: int = given(doc="number of inputs", default=1)

    def start(self, task: Any) -> Any:
        return Nothing(ca.DM.zeros(self.inputs, task.samples))

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        return memory_k.u, state


CASES = [
    # what, plant, law, changes of the study, standing, words of the method
    ("one slope", FIRST_ORDER, law(), {}, PROVED, "by induction over samples"),
    ("fixed lengths", FIRST_ORDER, law(CFDL), {"lengths": TrialLength(law="fixed")}, PROVED, "another reason"),
    ("a slope by sample", TIMED, law(), {}, PROVED, "slopes B of 0.3"),
    ("kinks do no harm", KINKED, law(), {}, PROVED, "by induction"),
    ("a curved plant", BENT, law(), {}, PROVED, "by induction"),
    ("l_max b = 1.99", UNIT, at_edge(0.995), {}, PROVED, "1.99"),
    ("l_max b = 2.01", UNIT, at_edge(1.005), {}, UNDECIDED, "l_max b_high is 2.01 and must lie below 2"),
    ("l_max b = 2", UNIT, at_edge(1.0), {}, UNDECIDED, "must lie below 2"),
    (
        "largest slope at one sample",
        small("Peaked", lambda x, u, k: (0.5 * x[0] + ca.if_else(k == N - 1, 1.02, 0.5) * u,)),
        at_edge(0.99),
        {},
        UNDECIDED,
        "l_max b_high is 2.02",
    ),
    ("a switch by sample", SWITCHED, law(), {}, PROVED, "slopes B of 0.5 to 0.7"),
    ("a divisor by sample", small("By", lambda x, u, k: (x[0] / (k - 5.5) + 0.5 * u,)), law(), {}, PROVED, "induction"),
    (
        "slope by state",
        small("ByState", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.1 * ca.sin(x[0])) * u,)),
        law(),
        {},
        PROVED,
        "slopes B of 0.4 to 0.6",
    ),
    (
        "slope by state, without end",
        small("ByStateOn", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.1 * x[0] ** 2) * u,)),
        law(),
        {},
        UNDECIDED,
        "depends on x0",
    ),
    (
        "slope by state, too large where few trials come",
        small("ByState", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.45 * ca.sin(x[0])) * u,)),
        at_edge(1.01 / 0.95),
        {},
        UNDECIDED,
        "l_max b_high is 2.02",
    ),
    (
        "slope by state, just small enough",
        small("ByState", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.45 * ca.sin(x[0])) * u,)),
        at_edge(0.99 / 0.95),
        {},
        PROVED,
        "slopes B of 0.05 to 0.95",
    ),
    (
        "slope by state that turns",
        small("Turns", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.51 * ca.sin(x[0])) * u,)),
        law(),
        {},
        UNDECIDED,
        "not shown to be positive",
    ),
    (
        "slope that grows",
        small("Cubic", lambda x, u, k: (0.6 * x[0] + 0.5 * u + 0.1 * u**3,)),
        law(),
        {},
        UNDECIDED,
        "depends on u, and no ends of it are known for all of them: a set that is shown to hold every trial",
    ),
    (
        "a kink",
        small("Bent", lambda x, u, k: (0.6 * x[0] + u + 0.5 * ca.fabs(u - 0.2),)),
        law(),
        {},
        PROVED,
        "0.5 to 1.5",
    ),
    (
        "a dead zone",
        small("Zone", lambda x, u, k: (0.6 * x[0] + ca.fmax(u - 1, 0) + ca.fmin(u + 1, 0),)),
        law(),
        {},
        UNDECIDED,
        "not shown to be positive",
    ),
    (
        "slope by input",
        small("ByInput", lambda x, u, k: (0.6 * x[0] + 0.5 * u + 0.1 * ca.fabs(u - 0.2),)),
        law(),
        {},
        PROVED,
        "slopes B of 0.4 to 0.6",
    ),
    (
        "slope by a table of the input",
        small("ByTable", lambda x, u, k: (0.6 * x[0] + ca.pw_lin(u, ca.DM([-1, 0.3, 1]), ca.DM([-0.6, 0.1, 0.6])),)),
        law(),
        {},
        PROVED,
        "slopes B of 0.5385 to 0.7143",
    ),
    (
        "a guarded root of the state",
        small("Guarded", lambda x, u, k: (0.6 * x[0] + 0.5 * u + ca.if_else(x[0] > 0.3, ca.sqrt(x[0] - 0.3), 0),)),
        law(),
        {},
        PROVED,
        "slopes B of 0.5 to 0.5",
    ),
    (
        "not onto",
        small("Bounded", lambda x, u, k: (0.6 * x[0] + ca.atan(u),)),
        law(),
        {},
        UNDECIDED,
        "not shown to be positive and bounded, 0 at the least",
    ),
    (
        "falling, by state",
        small("Falling", lambda x, u, k: (0.6 * x[0] - (0.5 + 0.4 * ca.cos(x[0])) * u,)),
        law(),
        {"trials": 3},
        REFUTED,
        "never falls",
    ),
    (
        "falling",
        small("Falling", lambda x, u, k: (0.6 * x[0] - 0.5 * u,)),
        law(),
        {"trials": 3},
        REFUTED,
        "never falls",
    ),
    (
        "dead at the first sample",
        small("Dead", lambda x, u, k: (0.6 * x[0] + 0.1 * k * u,)),
        law(),
        {},
        UNDECIDED,
        "not shown to be positive",
    ),
    ("a jump", small("Jump", lambda x, u, k: (0.6 * x[0] + switched(x[0]) + 0.5 * u,)), law(), {}, UNDECIDED, "jump"),
    (
        "a domain",
        small("Rooted", lambda x, u, k: (0.1 * ca.sqrt(x[0] + 50) + 0.5 * u,)),
        law(),
        {},
        UNDECIDED,
        "the end of a domain of sqrt",
    ),
    ("a pole", small("Pole", lambda x, u, k: (1 / (x[0] + 50) + 0.5 * u,)), law(), {}, UNDECIDED, "a pole"),
    ("noise", FIRST_ORDER, law(), {"noise": 0.01}, UNDECIDED, "noise"),
    (
        "starts differ",
        FIRST_ORDER,
        law(),
        {"initial": From(state=(0.0,), spread=(0.1,))},
        UNDECIDED,
        "begin in differe",
    ),
    ("starts elsewhere, always", FIRST_ORDER, law(), {"initial": From(state=(0.3,))}, PROVED, "by induction"),
    ("goes on", FIRST_ORDER, law(), {"continues": True}, UNDECIDED, "where the last one ended"),
    ("limits", FIRST_ORDER, law(), {"actuator": Actuator(lower=-9.0, upper=9.0)}, UNDECIDED, "an actuator lies"),
    ("trips differ", FIRST_ORDER, law(), {"truth": {"sampling_time": VARIED}}, UNDECIDED, "the plant changes"),
    ("never to the end", FIRST_ORDER, law(), {"lengths": SHORT}, UNDECIDED, "sample 12 is reached most"),
    ("always short", FIRST_ORDER, law(), {"lengths": TrialLength(law="fixed", length=N - 1)}, UNDECIDED, "sample 12"),
    (
        "seldom to the end",
        FIRST_ORDER,
        law(),
        {"lengths": TrialLength(law="table", probabilities=(0.999, 0.001))},
        PROVED,
        "by induction",
    ),
    (
        "never but in the table",
        FIRST_ORDER,
        law(),
        {"lengths": TrialLength(law="table", probabilities=(1.0, 0.0))},
        UNDECIDED,
        "sample 12",
    ),
    ("given lengths", FIRST_ORDER, law(), {"lengths": [N] * 12}, UNDECIDED, "the lengths of the trials are given"),
    (
        "an event",
        small("Ending", lambda x, u, k: (0.6 * x[0] + 0.5 * u,), ended=lambda self, x: x.x0 > 50),
        law(),
        {},
        UNDECIDED,
        "by an event of the plant",
    ),
    ("late", Late(), law(), {}, UNDECIDED, "relative degree 1, got 2"),
    ("eta above 1", FIRST_ORDER, law(Hasty), {}, UNDECIDED, "eta must lie in (0, 1]"),
    ("phi(k,1) below 0", FIRST_ORDER, law(phi0=-0.5), {"trials": 3}, UNDECIDED, "a positive phi(k,1)"),
    ("another estimate", FIRST_ORDER, law(Drifting), {}, UNDECIDED, "a premise is open"),
    ("another gain", FIRST_ORDER, law(Tiring), {}, UNDECIDED, "plan is not seen to move"),
    ("feedback", FIRST_ORDER, law(Fed), {}, UNDECIDED, "acts within the trial"),
    ("a filter", FIRST_ORDER, law(Filtered), {}, UNDECIDED, "filter"),
    ("rises, and is kept", RISING, law(initial_input=0.0), {}, PROVED, "by induction"),
    (
        "fell",
        RISING,
        law(initial_input=0.0),
        {"divergence_factor": 23.0},
        UNDECIDED,
        "true of real numbers; this run fell at trial 3 (",
    ),
    ("fell at once", RISING, law(initial_input=0.0), {"divergence_factor": 2.0}, UNDECIDED, "nothing to look at"),
]


@pytest.mark.parametrize(
    ("name", "plant", "controller", "changes", "standing", "words"), CASES, ids=[one[0] for one in CASES]
)
def test_conclusion_just_beyond_each_premise(name, plant, controller, changes, standing, words):
    changes = {"lengths": TrialLength(law="fixed"), **changes} if plant is RISING else changes
    found = judged(gather(plant, controller, **changes), "theorem1.conclusion")
    said = "; ".join([found.method, *(one.method for one in found.premises)])
    assert found.standing is standing and words in said, said
    assert not {"nan", "inf", "None"} & set(found.method.split())
    if standing is PROVED:
        assert found.grounds is Grounds.INDUCTION and 0 < found.margin < 2 and found.held.tries == 11
        assert found.margin == pytest.approx(2 - found.bound, abs=1e-12)


EVERYWHERE = [
    # next state, the true least and largest slope by u over all x, u and k = 0..N-1; None where there is none
    (lambda x, u, k: 0.6 * x + (0.5 + 0.1 * ca.sin(x)) * u, (0.4, 0.6)),
    (lambda x, u, k: u + 0.3 * ca.fabs(u - 0.2), (0.7, 1.3)),
    (lambda x, u, k: u + 0.2 * ca.sin(3 * u + x), (0.4, 1.6)),
    (lambda x, u, k: u + ca.tanh(u), (1.0, 2.0)),
    (lambda x, u, k: ca.atan(u), (0.0, 1.0)),
    (lambda x, u, k: u * ca.exp(-(x**2)), (0.0, 1.0)),
    (lambda x, u, k: (x - x + 2) * u, (2.0, 2.0)),
    (lambda x, u, k: ca.if_else(k < 4, 1 + 0.1 * ca.cos(x), 2 + 0.1 * ca.cos(x)) * u, (0.9, 2.1)),
    (lambda x, u, k: u + ca.erf(x) * u / 2 + ca.sqrt(1 + x**2) * 0, (0.5, 1.5)),
    (lambda x, u, k: (2 + ca.sign(x)) * u, (1.0, 3.0)),
    (lambda x, u, k: ca.if_else(x > 1, 2.0, 0.5) * u, (0.5, 2.0)),
    (lambda x, u, k: u + 0.1 * u**3, (1.0, None)),
    (lambda x, u, k: x * u, (None, None)),
    (lambda x, u, k: (ca.fabs(x) - x) * u, (0.0, None)),
    (lambda x, u, k: (ca.exp(x) - ca.exp(2 * x)) * u, (None, 0.25)),
    (lambda x, u, k: u * ca.cosh(x), (1.0, None)),
    (lambda x, u, k: u * ca.log(1 + x**2), (0.0, None)),
    (lambda x, u, k: ca.fmod(x, 2.0) * u, (-2.0, 2.0)),
]


@pytest.mark.parametrize(("equation", "ends"), EVERYWHERE)
def test_slopes_over_all_states_and_inputs(equation, ends):
    """Between their ends lies every slope, however far out; they are as near as a rounding, or there are none."""
    found = limit.slope_everywhere(small("Any", lambda x, u, k: (equation(x[0], u, k),)), N)
    x, u, k = (ca.SX.sym(name) for name in "xuk")
    exact = ca.Function("slope", [x, u, k], [ca.gradient(equation(x, u, k), u)])
    rng = np.random.default_rng(0)
    far = 10.0 ** rng.uniform(-3, 2.5, (2, 4000)) * rng.choice([-1, 1], (2, 4000))
    seen = exact(far[0][None, :], far[1][None, :], rng.integers(0, N, 4000)[None, :]).full().ravel()
    if None in ends:
        assert isinstance(found, str) and "no ends of it are known for all of them" in found
        return
    assert not isinstance(found, str), found
    assert found[0] <= np.nanmin(seen) and np.nanmax(seen) <= found[1]
    assert found == pytest.approx(ends, abs=1e-12)
    assert found[0] <= ends[0] + 1e-15 and ends[1] - 1e-15 <= found[1]


def test_slopes_of_a_table_over_all_inputs():
    """Its outer pieces go on for ever; what it is multiplied by has no end there."""
    grid, values = np.array([-1.0, 0.0, 1.0, 2.0]), np.array([0.0, 0.3, 0.1, 0.5])
    table = ca.interpolant("table", "linear", [grid.tolist()], values.tolist())
    low, high = limit.slope_everywhere(small("Tabled", lambda x, u, k: (u + table(u),)), N)
    rises = 1 + np.diff(values) / np.diff(grid)
    assert low <= rises.min() and rises.max() <= high and (low, high) == pytest.approx((rises.min(), rises.max()))
    found = limit.slope_everywhere(small("Tabled", lambda x, u, k: ((2 + table(x[0])) * u,)), N)
    assert isinstance(found, str) and "no ends of it are known" in found


NOWHERE = [
    # next state, words
    (lambda x, u, k: u / x, "has no value for some x0"),
    (lambda x, u, k: u * ca.log(x), "has no value for some x0"),
    (lambda x, u, k: u * ca.tan(x), "has no value for some x0"),
    (lambda x, u, k: u + ca.if_else(u > 0, ca.sqrt(u), 0), "has no value for some u"),
    (lambda x, u, k: u / (k - 3), "at sample 3 the slope of y(k+1) by u(k) has no value"),
]


@pytest.mark.parametrize(("equation", "words"), NOWHERE)
def test_slopes_that_are_nowhere_known(equation, words):
    found = limit.slope_everywhere(small("Any", lambda x, u, k: (equation(x[0], u, k),)), N)
    assert isinstance(found, str) and words in found, found


CONTINUOUS = [
    # next state, words; empty where it is defined and continuous for all x and u, at k = 0..N-1
    (lambda x, u, k: x[0] / (k - 5), "a pole of div"),
    (lambda x, u, k: x[0] / (k - 5.5) + u, ""),
    (lambda x, u, k: u / (k - N), ""),
    (lambda x, u, k: u / (k - (N - 1)), "a pole of div"),
    (lambda x, u, k: u * ca.sqrt(k) + ca.log(k + 1), ""),
    (lambda x, u, k: u + ca.log(k), "not every whole number gives a finite value"),
    (lambda x, u, k: u + ca.floor(k / 3) + ca.fmod(k, 4), ""),
    (lambda x, u, k: u + ca.floor(k / 3 + x[0]), "a jump of floor"),
    (lambda x, u, k: ca.if_else(k < 3, x[0], 2 * u), ""),
    (lambda x, u, k: ca.if_else(k < 3, x[0], ca.if_else(u > 0, 1, 0)), "a jump"),
    (lambda x, u, k: ca.if_else(k < x[0], u, 0), "a jump"),
    (lambda x, u, k: ca.if_else(k < 3, ca.sqrt(x[0]), u), "the end of a domain of sqrt"),
    (lambda x, u, k: ca.fmax(x[0], u) * ca.fabs(u) + ca.tanh(x[0]) + ca.exp(u), ""),
    (lambda x, u, k: u / (1 + x[0] ** 2), ""),
    (lambda x, u, k: u / (1 - x[0] ** 2), "a pole of div"),
    (lambda x, u, k: u + ca.fabs(x[0]) ** 1.5, ""),
    (lambda x, u, k: u + x[0] ** 1.5, "the end of a domain of"),
    (lambda x, u, k: u + x[0] ** 3, ""),
    (lambda x, u, k: ca.atan2(u, x[0]), "a jump of atan2"),
    (lambda x, u, k: ca.sign(u) * u, ""),
    (lambda x, u, k: ca.sign(u) * (u + 1e-9), "a jump of sign"),
    (lambda x, u, k: ca.sign(u) * u * ca.sign(k - x[0]), "a jump of sign"),
]


@pytest.mark.parametrize(("equation", "words"), CONTINUOUS)
def test_continuous_for_all_states_and_inputs(equation, words):
    found = limit.not_continuous(small("Any", lambda x, u, k: (equation(x, u, k),)), N)
    assert found is None if not words else words in found, found


NOT_MADE = [
    # plant, law, the property that is missing
    (TwoInputs(), law(), "a task that the law is for"),
    (FIRST_ORDER, law(Increment), "learning on the output (learns_on)"),
    (FIRST_ORDER, PD(kp=0.1, kd=0.1), "a learning gain between declared ends (learning_gain)"),
]


@pytest.mark.parametrize(("plant", "controller", "lacks"), NOT_MADE)
def test_without_its_meaning_it_is_not_made(plant, controller, lacks):
    study = Study(
        plant=plant,
        reference=RAMP,
        controllers={"law": controller, "other": Both(inputs=len(plant.inputs))},
        trials=2,
        name="small",
    )
    assert [lacks in one.lacks for one in claims_of(Dossier(run(study, show_progress=False), "law"))] == [True, True]


GAINED = small("Gained", lambda x, u, k: (0.8 * x[0] + (1 + 0.8 * ca.sin(3 * x[0])) * u + 0.15 * ca.fabs(u - 0.3),))
CONVERGES = [
    # plant, law: phi moves with the data in all of them
    (GAINED, law()),
    (GAINED, law(rho=1.0, lam=1 / (16 * (0.97 / 1.95) ** 2), mu=0.01)),  # l_max b = 1.94 at the most
    (BENT, law()),
    (BENT, law(rho=1.0, lam=1 / (16 * (2 * 0.95) ** 2), mu=0.01)),  # l_max b = 1.9
    (KINKED, law(mu=1e-3)),
    (TIMED, law(phi0=5.0)),
    (SWITCHED, law()),
]


@pytest.mark.parametrize(("plant", "controller"), CONVERGES)
def test_every_sample_converges_in_two_thousand_trials(plant, controller):
    """What is proved, against 2000 trials of random length: every sample's error goes, however rarely it is reached."""
    n = 5
    lengths = TrialLength(law="table", minimum=1, probabilities=(0.1, 0.2, 0.3, 0.4))
    d = gather(plant, controller, trials=2000, reference=RAMP[: n + 1], lengths=lengths, seed=3)
    found = judged(d, "theorem1.conclusion")
    assert found.standing is PROVED
    error = np.abs(d.campaign.data["error"].sel(controller="law").values)
    first, late = error[0, 1:], error[-200:, 1:]
    assert (np.isfinite(late).any(axis=0)).all() and np.isnan(error[:, n]).any()
    assert np.nanmax(late) < 1e-8 * max(1.0, np.nanmax(first))
    estimate = d.campaign.data["ppd_estimate"].sel(controller="law").values
    y = d.campaign.data["output"].sel(controller="law").values[:, 1:]
    start, eps = controller.first_estimate(), controller.eps
    widest = np.nanmax(y, axis=0) - np.nanmin(y, axis=0)
    estimate = estimate[:, :n]
    assert (estimate >= min(float(start), eps)).all() and np.ptp(estimate) > 0
    assert (estimate <= np.maximum(float(start), widest / eps) * (1 + 1e-9)).all()


def test_beyond_the_largest_gain_an_error_stays():
    """Why l_max b < 2 is asked: a held estimate beyond it never converges, with it always."""
    for share, ends in ((0.97, True), (1.03, False)):
        edge = law(rho=1.0, lam=1 / (16 * share**2), eta=1e-12, eps=1e-300)
        found = gather(UNIT, edge, trials=300, reference=RAMP[:4], lengths=TrialLength(law="fixed"))
        error = np.abs(found.campaign.data["error"].values[0, :, 1:])
        assert bool(error[-1].max() < 1e-2 * error[0].max()) is ends


def test_inputs_stay_bounded_whatever_the_gain_does():
    """Step 2 of the proof: targets and gains drawn against it never drive the input out of m +- R."""
    rng = np.random.default_rng(0)
    for largest, worst_of_all in ((0.3, 0.8), (1.0, 0.8), (1.6, 0.8), (1.95, 0.8), (1.6, 1.0), (1.95, 1.0)):
        m, w, u = 0.5, 0.4, 1.2
        bound = max(abs(u - m), w * max(1.0, largest / (2 - largest)))
        reached = 0.0
        for _ in range(3000):
            worst = m - np.sign(u - m) * w
            target = worst if rng.uniform() < worst_of_all else m + w * rng.uniform(-1, 1)
            u += (largest if rng.uniform() < worst_of_all else largest * rng.uniform()) * (target - u)
            reached = max(reached, abs(u - m))
            assert abs(u - m) <= bound * (1 + 1e-12)
        assert worst_of_all < 1 or reached > 0.999 * bound  # no smaller one would do


NUMBERS = [
    # learning gain, b_low, b_high, standing, words
    (LearningGain(0.1, 1.0), 0.5, 1.9, PROVED, "keeps the offset"),
    (LearningGain(0.1, 1.0), 0.5, 2.0, UNDECIDED, "must lie below 2"),
    (LearningGain(0.1, 1.0), 0.5, np.nextafter(2.0, 0.0), UNDECIDED, "must lie below 2"),  # rounded away from it
    (LearningGain(0.0, 1.0), 0.5, 1.0, UNDECIDED, "phi_range"),
    (LearningGain(-0.1, 1.0), 0.5, 1.0, UNDECIDED, "must be positive"),
    (LearningGain(-1.0, -0.1), 0.5, 1.0, UNDECIDED, "must be positive"),
    (LearningGain(0.1, 1.0), 0.0, 1.0, UNDECIDED, "not shown to be positive"),
    (LearningGain(0.1, 1.0), -0.5, 1.0, UNDECIDED, "not shown to be positive"),
    (LearningGain(0.1, 1.0), 0.5, np.inf, UNDECIDED, "bounded"),
    (LearningGain(0.1, 1.0), -np.inf, np.inf, UNDECIDED, "bounded"),
    (None, 0.5, 1.0, UNDECIDED, "does not say between which ends"),
]


@pytest.mark.parametrize(("gain", "low", "high", "standing", "words"), NUMBERS)
def test_increments_by_numbers(gain, low, high, standing, words):
    study = Study(plant=FIRST_ORDER, reference=RAMP, controllers={"law": law(Increment)}, trials=2, name="small")
    found = limit.increment_limit(study, SimpleNamespace(learning_gain=gain), low, high)
    assert found.standing is standing and words in found.method
    assert not {"nan", "inf"} & set(found.method.split())
    fallen = limit.increment_limit(study, SimpleNamespace(learning_gain=gain), low, high, fell="this run fell")
    assert fallen.standing is UNDECIDED


def holding(stands: bool) -> Claim:
    def check() -> Finding:
        return Finding(grounds=Grounds.ENCLOSURE, holds=stands) if stands else undecided("the band leaves the domain")

    return Claim(name="small.funnel", statement="A set holds every trial.", source="ours", check=check)


JUMPING = small("Jumping", lambda x, u, k: (0.6 * x[0] + ca.if_else(x[0] > 50, 1.0, 0.0) + 0.5 * u,))
INCREMENTS = [
    # plant, law, the set stands, slopes, box, changes of the study, standing
    (FIRST_ORDER, law(Increment), True, (0.5, 0.5), None, {}, PROVED),
    (FIRST_ORDER, law(Increment), False, (0.5, 0.5), None, {}, UNDECIDED),
    (FIRST_ORDER, law(Increment), True, None, None, {}, UNDECIDED),
    (FIRST_ORDER, law(Increment, q_cutoff_hz=0.1), True, (0.5, 0.5), None, {"reference": np.tile(RAMP, 4)}, UNDECIDED),
    (FIRST_ORDER, law(Increment), True, (0.5, 0.5), None, {"noise": 0.01}, UNDECIDED),
    (FIRST_ORDER, law(Increment), True, (0.5, 0.5), None, {"lengths": SHORT}, UNDECIDED),
    (FIRST_ORDER, law(Increment), True, (0.5, 0.5), None, {"initial": From(state=(0.7,))}, PROVED),
    (JUMPING, law(Increment), True, (0.5, 0.5), None, {}, UNDECIDED),
    (JUMPING, law(Increment), True, (0.5, 0.5), 9.0, {}, PROVED),
    (JUMPING, law(Increment), True, (0.5, 0.5), 90.0, {}, UNDECIDED),
]


@pytest.mark.parametrize(("plant", "controller", "stands", "slopes", "room", "changes", "standing"), INCREMENTS)
def test_increments_as_a_claim(plant, controller, stands, slopes, room, changes, standing):
    d = gather(plant, controller, **{"trials": 150, **changes})

    def known() -> limit.Slope:
        if slopes is None:
            raise InvalidValue("the slope is not known on the set")
        return slopes

    none = np.zeros(0)
    over = (
        None if room is None else lambda: Box({"x": (-room, room), "u": (-room, room), "w": (none, none), "k": (0, N)})
    )
    found = Judge().verdict(increment_limit(d, holding(stands), known, over))
    assert isinstance(found, Verdict) and found.standing is standing, found
    if standing is PROVED:
        assert found.held.tries == 149 and found.held.margin >= 0
        error = np.diff(d.campaign.data["error"].values[0], axis=1)
        assert np.nanmax(np.abs(error[-1])) < 0.1 * np.nanmax(np.abs(error[0]))


def test_increments_are_not_claimed_of_laws_that_learn_on_the_output():
    d = gather(FIRST_ORDER, law(), trials=2)
    found = Judge().verdict(increment_limit(d, holding(True), lambda: (0.5, 0.5)))
    assert isinstance(found, NotMade) and found.lacks == "learning on the output's increments (learns_on)"


@pytest.mark.parametrize(
    ("mse", "standing", "trial"),
    [
        ([4.0, 3.0, 1.0], SUPPORTED, 2),
        ([4.0, 4.0, 1.0], SUPPORTED, 2),
        ([4.0, 3.0, 4.1], REFUTED, 3),
        ([4.0, 9.0, 8.0], REFUTED, 2),
        ([0.0, 0.0], SUPPORTED, 2),
        ([0.0, 1e-9], REFUTED, 2),
        ([4.0], UNDECIDED, None),
        ([4.0, np.nan], UNDECIDED, None),
        ([4.0, np.inf], UNDECIDED, None),
    ],
)
def test_transient(mse, standing, trial):
    found = limit.transient(np.array(mse), 12, "1")
    assert found.standing is standing
    assert trial is None or found.witness["trial"] == trial
    assert standing is UNDECIDED or found.tries == len(mse) - 1


def test_the_transient_is_that_of_the_samples_that_every_trial_reached():
    d = gather(RISING, law(initial_input=0.0))
    found = judged(d, "theorem1.transient")
    last = int(d.lengths.min())
    errors = np.mean(d.campaign.data["error"].values[0][:, 1 : last + 1] ** 2, axis=1)
    assert last < N and found.standing is REFUTED
    assert found.bound == pytest.approx(errors[1:].max()) and found.witness["first_mse"] == pytest.approx(errors[0])
    said = " ".join(conclusion.paragraphs([d], [found, judged(d, "theorem1.conclusion")]))
    assert "is true all the same, as a limit" in said and f"the MSE rose by {100 * -found.margin:.3g} %" in said
    assert "theorem1.conclusion alone speaks of all states" in said


def test_a_step_that_the_proof_excludes_is_seen_at_the_first_sample():
    gain, bounds = LearningGain(0.2, 1.0), (0.5, 1.5)  # factors between -0.5 and 0.9
    for factor, held in ((0.89, True), (0.91, False), (-0.49, True), (-0.51, False), (1.0, False)):
        for start in (0.3, -0.3):
            found = limit.held_at_first_sample(start * factor ** np.arange(4.0), gain, bounds, 1.0)
            assert (found.margin >= 0) is held and found.tries == 3
    assert limit.held_at_first_sample(np.array([1e-17, 2e-17]), gain, bounds, 1.0).margin >= 0  # rounding, no more
    assert limit.held_at_first_sample(np.array([1.0]), gain, bounds, 1.0).tries == 0


@pytest.mark.parametrize(
    ("gain", "bounds", "errors", "refuted"),
    [
        (LearningGain(2.1, 2.1), (1.0, 1.0), [0.3], True),
        (LearningGain(1.9, 2.1), (1.0, 1.0), [0.3], False),  # some l brings it nearer
        (LearningGain(2.1, 2.5), (0.5, 1.0), [0.3], False),  # some slope does
        (LearningGain(0.0, 1.0), (-2.0, -0.5), [0.3], True),
        (LearningGain(0.0, 1.0), (-2.0, 0.0), [0.3], True),
        (LearningGain(0.0, 1.0), (-2.0, 0.1), [0.3], False),
        (LearningGain(-1.0, 1.0), (-2.0, -0.5), [0.3], False),
        (LearningGain(2.1, 2.1), (1.0, 1.0), [0.0], False),  # there was no error to begin with
        (LearningGain(2.1, 2.1), (1.0, np.inf), [0.3], False),
        (LearningGain(2.1, 2.1), (1.0, 1.0), [], False),
    ],
)
def test_an_error_that_never_falls_refutes_the_limit(gain, bounds, errors, refuted):
    found = limit.never_nearer(gain, bounds, np.array(errors))
    assert (found is not None) is refuted
    if found is not None:  # plain steps with the ends of gain and slope
        assert found.standing is REFUTED
        assert all(abs(1 - step * b) >= 1 for step in gain for b in bounds)
