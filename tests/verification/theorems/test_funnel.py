"""Safe learning: the funnel, what is read off it, and the learning curve; what lies just beyond each premise.

Whatever is proved is held against campaigns made to leave it, and against a plain loop that owes the proof nothing.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest
from learning_laws import FeedsBack, Late, Planned, Started, Starting
from small_plants import small
from small_studies import gathered, in_plant_units

from models.actuator import Actuator
from models.array import Array
from models.plant import Plant, signal, signals
from models.quantity import declared, given, nested, quantity, rebuilt
from verification.checks.envelope import Bounds, held_inside
from verification.checks.funnel import Maker, Open, funnel, parts_of, wanted
from verification.decide.judge import Judge
from verification.theorems.dossier import Dossier
from verification.theorems.funnel import bands, claims_of
from verification.theorems.limits import limits
from workbench import Study, TrialLength, run
from workbench.contracts.claim import Range, Role
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.law import Channels, Law, LearningGain
from workbench.contracts.scenario import Between, ByTrial, From, NormalDisturbance, NormalNoise, Times, UniformNoise
from workbench.contracts.study import Inverse
from workbench.contracts.verdict import NotMade, Verdict
from workbench.contracts.verifying import Verification
from workbench.controllers import ICFDL, PD, Increment

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
N = 10
RAMP, STRAIGHT = np.sin(np.linspace(0, 2, N + 1)), np.linspace(0, 1, N + 1)
FIXED = TrialLength(law="fixed")


def law(kind: Any = Increment, **changes: Any) -> Any:
    """Return a law in the plants' own unit, on increments where no kind is named."""
    return in_plant_units(kind, **changes)


def fast(reach: float, **changes: Any) -> Any:
    """Return a law whose l_max is a number."""
    return law(rho=1.0, lam=1 / (4 * reach**2), **changes)


def gather(plant: Plant, controller: Any = None, **changes: Any) -> Dossier:
    """Return the dossier of a law on a plant, over six trials of uniform lengths where nothing else is said."""
    lengths = changes.pop("lengths", TrialLength(law="uniform", minimum=4))
    return gathered(plant, controller or law(), lengths=lengths, **{"trials": 6, "reference": RAMP, **changes})


@declared
class Valve(Plant):
    """A plant with quantities, and what disturbs it."""

    source: ClassVar[str] = "made for tests"
    states = outputs = signals(x="1")
    inputs = signals(u="1")
    disturbances = signals(rain="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
    keep: float = quantity(default=0.6, unit="1", doc="share of the level that stays")
    valve: float = quantity(default=0.5, unit="1", doc="share of the inflow", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (self.keep * x.x + self.valve * u.u + w.rain,)

    def output(self, x: Any) -> Any:
        return (x.x,)


@declared
class Offset(Valve):
    """A sum to which a quantity adds the same at every sample."""

    keep: float = quantity(default=0.0, unit="1", doc="what comes in besides")

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (x.x + u.u + self.keep,)


@declared
class Pair(Plant):
    """Two inputs and two outputs."""

    source: ClassVar[str] = "made for tests"
    states = outputs = signals(x="1", y="1")
    inputs = signals(u="1", v="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return 0.6 * x.x + 0.5 * u.u, 0.6 * x.y + 0.5 * u.v

    def output(self, x: Any) -> Any:
        return x.x, x.y


@declared
class Fed(FeedsBack, Increment):
    """It feeds back within the trial."""


@declared
class Moving(Starting):
    """It moves the start, and learns on increments otherwise."""

    learns_on: ClassVar[str] = "increment"

    @property
    def learning_gain(self) -> LearningGain:
        return LearningGain(0.1, 1.0)

    def learn(self, memory: Any, trial: Any) -> Any:
        e = ca.if_else(trial.reached, trial.e, 0)
        return Started(memory.u + self.gain * (e[1:] - e[:-1]), memory.moved + 0.6 * e[0])


@declared
class Boastful(Increment):
    """It says that its gain is smaller than it is."""

    @property
    def learning_gain(self) -> LearningGain:
        return LearningGain(0.01, 0.02)


@declared
class Silent(Increment):
    """It does not say between which ends its gain lies."""

    @property
    def learning_gain(self) -> None:
        return None


@declared
class Endless(Increment):
    """It says no more of its gain than that it is not negative."""

    @property
    def learning_gain(self) -> LearningGain:
        return LearningGain(0.0, super().learning_gain.high)


class Nothing(NamedTuple):
    u: Any


@declared
class Anything(Law):
    """A law of any number of inputs, so that a study may refuse the other."""

    source: ClassVar[str] = "made for tests, 2026"
    channels: ClassVar[Channels] = Channels(None, None)
    inputs: int = given(doc="number of inputs", default=1)

    def start(self, task: Any) -> Any:
        return Nothing(ca.DM.zeros(self.inputs, task.samples))

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        return memory_k.u, state


FIRST = small("First", lambda x, u, k: (0.6 * x[0] + 0.5 * u,))
UNIT = small("Unit", lambda x, u, k: (0.5 * x[0] + u,))
SUMMED = small("Summed", lambda x, u, k: (x[0] + u,))
KINKED = small("Kinked", lambda x, u, k: (0.3 * ca.fabs(x[0] - 0.2) + ca.fmax(x[0], 0.5) + 0.5 * u,))
BENT = small("Bent", lambda x, u, k: (x[0] + 0.4 * ca.sin(3 * x[0]) + 0.1 * x[0] ** 2 + 0.5 * u,))
SWITCHED = small("Switched", lambda x, u, k: (0.6 * x[0] + ca.if_else(ca.fmod(k, 4) < 2, 0.5, 0.7) * u,))
TIMED = small("Timed", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.2 * ca.sin(k)) * u,))
CUBIC = small("Cubic", lambda x, u, k: (0.8 * x[0] + 0.5 * u + 0.2 * u**3,))
JUMP_IN_X = small("JumpInX", lambda x, u, k: (0.6 * x[0] + ca.if_else(x[0] > 0.3, 0.2, 0.0) + 0.5 * u,))
JUMP_IN_U = small("JumpInU", lambda x, u, k: (0.6 * x[0] + ca.if_else(u > 0.6, 0.1, 0.0) + 0.5 * u,))
KINK_IN_U = small("KinkInU", lambda x, u, k: (0.6 * x[0] + 0.3 * u + 0.2 * ca.fmax(u, 0.6),))
FLAT_IN_U = small("FlatInU", lambda x, u, k: (0.6 * x[0] + 0.5 * ca.fmax(u, 0.6),))
ARCTAN = small("Arctan", lambda x, u, k: (x[0] + ca.atan(u),))
WILD = small("Wild", lambda x, u, k: (6 * x[0] + 0.5 * u,))
ROOTED = small("Rooted", lambda x, u, k: (0.6 * x[0] + ca.sqrt(x[0] + 0.5) + 0.5 * u,))
ENDING = small("Ending", lambda x, u, k: (0.6 * x[0] + 0.5 * u,), ended=lambda self, x: x.x0 > 0.5)
SPRING = small(
    "Spring",
    lambda x, u, k: (0.9 * x[0] + 0.1 * x[1] + 0.5 * u, 0.8 * x[1] - 0.1 * ca.sin(x[0])),
    states=2,
)


def within(low: float | None, high: float | None, of: str = "x0") -> Plant:
    """Return the first plant with a domain of its state, its input or its output."""
    kept = {of: signal("1", domain=(low, high))}
    named = {"x0": "states", "u": "inputs", "y": "outputs"}[of]
    return declared(type("Within", (type(FIRST),), {named: signals(**kept)}))()


WIDE_NOISE = UniformNoise(largest=0.02)
SCATTER = From(state=(0.1,), spread=(0.2,))
RAIN = np.linspace(-0.1, 0.1, N)[None, :]
VARIED = Between(low=0.8, high=1.2)
KEPT = {"plant.keep": (0.4, 0.8)}

CASES = [
    # what, plant, law, changes of the study, standing of funnel, limit and curve, words of any of them
    ("one slope", FIRST, law(), {}, (PROVED, PROVED, PROVED), "0.5 to 0.5 there"),
    ("two samples", FIRST, law(), {"reference": RAMP[:3], "lengths": FIXED}, (PROVED, PROVED, PROVED),
     "samples 1 to 2"),
    ("a first plan that is perfect", FIRST, law(), {"first_plan": Inverse()}, (PROVED, PROVED, UNDECIDED),
     "does not fall"),
    ("a slope by sample", TIMED, law(), {}, (PROVED, PROVED, PROVED), "the slope of the increment"),
    ("a plant of a period", SWITCHED, law(), {}, (PROVED, PROVED, PROVED), "0.5 to 0.7 there"),
    ("kinks in x", KINKED, law(), {"reference": RAMP[:7]}, (PROVED, PROVED, PROVED), ""),
    ("a kink in u", KINK_IN_U, law(), {}, (PROVED, PROVED, PROVED), "0.3 to 0.5 there"),
    ("flat below a kink in u", FLAT_IN_U, law(), {}, (UNDECIDED,) * 3, "at sample 0"),
    ("a jump in u", JUMP_IN_U, law(), {}, (UNDECIDED,) * 3, "something ends or jumps there"),
    ("a jump in x", JUMP_IN_X, law(), {}, (PROVED, UNDECIDED, PROVED), "jump"),
    ("a jump in u that no trial meets", small("Far", lambda x, u, k: (0.6 * x[0] + (u > 50) + 0.5 * u,)), law(), {},
     (PROVED, PROVED, PROVED), ""),
    ("curved", BENT, law(), {}, (PROVED, PROVED, PROVED), ""),
    ("slope by input", CUBIC, law(), {}, (PROVED, PROVED, PROVED), ""),
    ("two states", SPRING, law(), {}, (PROVED, PROVED, PROVED), "x1"),
    ("l_max b = 1", UNIT, fast(1.0), {}, (PROVED, PROVED, PROVED), "l_max B = 1"),
    ("l_max b = 1.3", UNIT, fast(1.3), {"reference": RAMP[:7]}, (PROVED, PROVED, PROVED), "l_max B = 1.3"),
    ("l_max b = 1.3, curved", small("Bowed", lambda x, u, k: (0.5 * x[0] + u + 0.05 * ca.sin(u),)), fast(1.2), {},
     (PROVED, PROVED, PROVED), "l_max B = 1.2"),
    ("l_max b = 1.3, starts scatter", UNIT, fast(1.3), {"initial": SCATTER, "reference": RAMP[:7]}, (PROVED,
     UNDECIDED, UNDECIDED), "begin in diff"),
    ("l_max b = 1.99", UNIT, fast(1.99), {"reference": RAMP[:3], "lengths": FIXED, "first_plan": Inverse(share=0.98)},
     (PROVED, PROVED, UNDECIDED), "l_max B = 1.99"),
    ("l_max b = 2", UNIT, fast(2.0), {}, (UNDECIDED,) * 3, "at sample 0 (x0 0 to 0) l_max B must stay below 2"),
    ("l_max b = 2.01", UNIT, fast(2.01), {}, (UNDECIDED,) * 3, "lower the learning gain"),
    ("l_max b = 2.02 at the last sample", small("Peaked", lambda x, u, k: (0.5 * x[0] + (0.5 + 0.52 * (k == 9)) * u,)),
     fast(1.98), {}, (UNDECIDED,) * 3, "at sample 9 "),
    ("late", Late(), law(), {}, (UNDECIDED,) * 3, "relative degree 1, got 2"),
    ("a dead time", FIRST, law(), {"actuator": Actuator(delay=1.0)}, (UNDECIDED,) * 3, "relative degree 1, got 2"),
    ("a lag", FIRST, law(), {"actuator": Actuator(lag=0.2)}, (PROVED, UNDECIDED, PROVED), "an actuator lies"),
    ("a filter", FIRST, law(q_cutoff_hz=0.1), {"reference": np.repeat(RAMP, 4), "lengths": FIXED}, (UNDECIDED,) * 3,
     "without its filter"),
    ("feedback", FIRST, law(Fed), {}, (UNDECIDED,) * 3, "acts within the trial"),
    ("a negative estimate", FIRST, law(phi0=-1.0), {"trials": 2}, (UNDECIDED,) * 3, "learning gains above 0"),
    ("another gain than it says", FIRST, law(Boastful), {}, (UNDECIDED,) * 3, "the theorem does not apply"),
    ("it moves the start", FIRST, Moving(), {}, (UNDECIDED,) * 3, "moves the state in which a trial begins"),
    ("falling", small("Falling", lambda x, u, k: (0.6 * x[0] - 0.5 * u,)), law(), {"trials": 2}, (UNDECIDED,) * 3,
     "was not shown to rise with the u"),
    ("dead at sample 3", small("Dead", lambda x, u, k: (0.6 * x[0] + 0.5 * (k != 3) * u,)), law(), {}, (UNDECIDED,) * 3,
     "at sample 3 "),
    ("arctan", ARCTAN, law(), {}, (PROVED, PROVED, PROVED), ""),
    ("arctan, and a reference that no input reaches", ARCTAN, law(), {"reference": 1.6 * np.arange(N + 1), "trials": 2},
     (UNDECIDED,) * 3, "no u was found that gives the x0 the reference's increment"),
    ("limits that are wide", FIRST, law(), {"actuator": Actuator(lower=-3.0, upper=3.0)}, (PROVED, UNDECIDED, PROVED),
     ""),
    ("limits that the target meets", FIRST, law(), {"actuator": Actuator(lower=-0.6, upper=0.6)}, (UNDECIDED,) * 3,
     "its limits, or a slope that vanishes, lie before"),
    ("a first plan beyond the limits", FIRST, law(initial_input=4.0), {"actuator": Actuator(lower=-3.0, upper=3.0)},
     (UNDECIDED,) * 3, "at sample 0"),
    ("a saturated input", small("Soft", lambda x, u, k: (0.6 * x[0] + 0.5 * ca.fmin(ca.fmax(u, -3), 3),)), law(), {},
     (PROVED, PROVED, PROVED), ""),
    ("a domain that holds the band", within(-1.5, 1.5), law(), {}, (PROVED, PROVED, PROVED), ""),
    ("a domain below the band", within(0.5, None), law(), {}, (UNDECIDED,) * 3,
     "at sample 0 the band of the x0, 0 to 0, leaves the domain"),
    ("a domain above the band", within(None, 0.5), law(), {}, (UNDECIDED,) * 3,
     "leaves the domain in which the equations"),
    ("a first plan outside the domain", within(None, 5.0, "u"), law(initial_input=5.1), {}, (UNDECIDED,) * 3,
     "at sample 0 the band of the u"),
    ("a target outside the domain", within(0.5, None, "u"), law(), {}, (UNDECIDED,) * 3, "the band of the u"),
    ("an output outside its domain", within(None, 0.5, "y"), law(), {}, (UNDECIDED,) * 3, "the band of the y"),
    ("a root that ends in the band", ROOTED, law(initial_input=-4.0), {}, (UNDECIDED,) * 3,
     "no bound: something ends or jumps"),
    ("an unstable plant", WILD, law(), {"trials": 2}, (UNDECIDED,) * 3,
     "more than 10 times the range of the reference"),
    ("an event", ENDING, law(), {"lengths": FIXED}, (PROVED, UNDECIDED, UNDECIDED), "by an event of the plant"),
    ("given lengths", FIRST, law(), {"lengths": [N, 5, 7, N, 1, 9]}, (PROVED, UNDECIDED, PROVED), "samples 1 to 1,"),
    ("starts elsewhere", FIRST, law(), {"initial": From(state=(0.3,))}, (PROVED, PROVED, PROVED), "x0 "),
    ("starts scatter", FIRST, law(), {"initial": SCATTER}, (PROVED, UNDECIDED, PROVED), "begin in different"),
    ("starts given, one a trial", FIRST, law(), {"initial": 0.02 * np.arange(6.0)[:, None]}, (PROVED,
     UNDECIDED, PROVED), ""),
    ("goes on", FIRST, law(), {"continues": True}, (UNDECIDED,) * 3, "has no bound"),
    ("a disturbance that is given", Valve(), law(), {"disturbance": RAIN}, (PROVED, PROVED, PROVED), ""),
    ("rain within a scope", Valve(), law(), {"scope": {"disturbance.rain": (-0.02, 0.01)}}, (PROVED, PROVED, PROVED),
     ""),
    ("rain that has no bound", Valve(), law(), {"disturbance": NormalDisturbance(sigmas=(0.01,))}, (UNDECIDED,) * 3,
     "what trials begin with, or are disturbed by, has no bound"),
    ("rain that leaves a scope", Valve(), law(),
     {"disturbance": NormalDisturbance(sigmas=(0.01,)), "scope": {"disturbance.rain": (-0.05, 0.05)}},
     (UNDECIDED,) * 3, "the scope holds disturbance.rain -0.05 to 0.05, and what the study meets has no bound"),
    ("noise, uniform", FIRST, law(), {"noise": WIDE_NOISE}, (PROVED, UNDECIDED, PROVED),
     "leaves measurement noise out"),
    ("noise, cut", FIRST, law(), {"noise": NormalNoise(sigma=0.01, limit=0.02)}, (PROVED, UNDECIDED, PROVED), ""),
    ("noise, not cut", FIRST, law(), {"noise": NormalNoise(sigma=0.01)}, (UNDECIDED,) * 3,
     "measurement noise has no bound"),
    ("noise, not cut, within a scope", FIRST, law(), {"noise": NormalNoise(sigma=0.01),
     "scope": {"noise.x0": (-0.02, 0.02)}},
     (UNDECIDED,) * 3, "4.55 % of its samples lie beyond"),
    ("a plant that changes", Valve(), law(), {"truth": {"keep": VARIED}}, (PROVED, UNDECIDED, PROVED),
     "the plant changes"),
    ("a plant that changes a little", Valve(), law(), {"truth": {"valve": Between(low=0.98, high=1.02)}},
     (PROVED, UNDECIDED, PROVED), "the plant changes"),
    ("a plant that changes as given", Valve(), law(), {"truth": {"valve": ByTrial(factors=(0.9, 1.1) * 3)}},
     (PROVED, UNDECIDED, PROVED), ""),
    ("a scope wider than that", Valve(), law(), {"truth": {"keep": Between(low=0.9, high=1.1)},
     "scope": {"plant.keep": (0.5, 0.7)}},
     (PROVED, UNDECIDED, PROVED), ""),
    ("a scope less than that", Valve(), law(), {"truth": {"keep": VARIED}, "scope": {"plant.keep": (0.5, 0.7)}},
     (UNDECIDED,) * 3, "the scope holds plant.keep 0.5 to 0.7, and the study meets 0.48 to 0.72"),
    ("a true plant beyond the scope", Valve(), law(), {"truth": {"keep": Times(factor=1.5)}, "scope": KEPT},
     (UNDECIDED,) * 3, "the scope holds plant.keep 0.4 to 0.8, and the study runs with 0.89"),
    ("a true plant that stays", Valve(), law(), {"truth": {"keep": Times(factor=1.2)}}, (PROVED, PROVED, PROVED), ""),
    ("a scope of two quantities", Valve(), law(), {"scope": {**KEPT, "plant.valve": (0.45, 0.55)}},
     (PROVED, PROVED, PROVED), ""),
    ("a scope of the gain", Valve(keep=1.0), fast(1.5),
     {"scope": {"plant.valve": (1.0, 1.4)}, "truth": {"valve": Times(factor=2.4)}, "reference": RAMP[:3],
     "lengths": FIXED, "first_plan": Inverse()}, (UNDECIDED,) * 3, "l_max B must stay below 2"),
    ("a quantity of which a split alone helps", Offset(), law(initial_input=0.0),
     {"reference": STRAIGHT, "scope": {"plant.keep": (-0.3, 0.3)}}, (PROVED, PROVED, PROVED),
     "for each value of keep that stays the same"),
    ("the same, if it changes", Offset(keep=0.1), law(initial_input=0.0),
     {"reference": STRAIGHT, "scope": {"plant.keep": (-0.3, 0.3)}, "truth": {"keep": Between(low=0, high=1)}},
     (UNDECIDED,) * 3,
     "more than 10 times the range"),
    ("parts that are narrow, and wide together", Offset(), law(initial_input=0.0),
     {"reference": STRAIGHT, "scope": {"plant.keep": (-0.55, 0.55)}}, (UNDECIDED,) * 3,
     "at sample 10 the band of the x is 11 wide"),
    ("rounding within the plant", small("Big", lambda x, u, k: ((x[0] + 1e8) + u - 1e8,)), fast(1.0),
     {"reference": STRAIGHT, "trials": 40}, (PROVED, PROVED, PROVED), ""),
    ("a reference that stays at zero", FIRST, law(), {"reference": np.zeros(N + 1), "trials": 2},
     (PROVED, PROVED, PROVED), ""),
    ("a reference that stays", FIRST, law(), {"reference": np.full(N + 1, 0.01), "trials": 2}, (UNDECIDED,) * 3,
     "of the reference (0.01)"),
]  # fmt: skip


def judged_all(d: Dossier) -> list[Verdict | NotMade]:
    """Return how funnel, limit and curve stand."""
    judge = Judge()
    return [judge.verdict(one) for one in claims_of(d)]


def said(found: Any) -> str:
    """Return all that a verdict and its premises say."""
    return "; ".join([found.method, *(one.method for one in found.premises)])


@pytest.mark.parametrize(
    ("plant", "controller", "changes", "stands", "words"), [one[1:] for one in CASES], ids=[one[0] for one in CASES]
)
def test_what_lies_just_within_and_just_beyond_each_premise(plant, controller, changes, stands, words):
    d = gather(plant, controller, **changes)
    of = [found for found in judged_all(d) if isinstance(found, Verdict)]
    told = "; ".join(said(one) for one in of)
    assert tuple(one.standing for one in of) == stands, told
    assert words in told, told
    for one in of:
        assert not {"nan", "inf", "None"} & set(one.method.replace(",", " ").split()), one.method
        assert not one.contradiction
    if of[0].standing is PROVED:
        holds(d, of[0])
    if of[2].standing is PROVED:
        lies_beneath(d)


# -- an independent loop -------------------------------------------------------------------------------------------


class Campaign(NamedTuple):
    """Trials in plain numbers."""

    x: list[Array]
    """(states, length + 1) by trial."""
    u: list[Array]
    """(length,) by trial."""
    y: list[Array]


def random_campaign(d: Dossier, rng: np.random.Generator, trials: int, least: int = 1) -> Campaign:
    """Run trials that learn with any gains between the declared ends, from anything that the study may meet."""
    study, gain = d.study, d.funnels.gain
    scope, n = d.funnels.scope, study.horizon
    r = study.reference_samples[0]
    changed = set(scope.parameters) - set(d.funnels.funnel.same)
    values = {name: rng.uniform(one.low, one.high) for name, one in scope.parameters.items()}
    u = d.funnels.plan.copy()
    habit = rng.integers(4)
    done = Campaign([], [], [])
    for trial in range(trials):
        if changed or not trial:
            anew = {name: drawn_from(rng, scope.parameters[name].low, scope.parameters[name].high) for name in changed}
            plant = rebuilt(study.plant_that_runs, nested({**values, **anew}))
            step, output = plant.step_function(), plant.output_function()
        low, high = scope.disturbance
        x, y = [np.array([drawn_from(rng, a, b) for a, b in scope.start])], []
        y.append(float(output(x[0])))
        length = n if habit == 0 else int(rng.integers(least, n + 1))
        for k in range(length):
            w = [drawn_from(rng, a[k], b[k]) for a, b in zip(low, high, strict=True)]
            x.append(np.asarray(step(x[k], u[k], w, k)).ravel())
            y.append(float(output(x[k + 1])))
        nu = float(scope.noise[0])
        seen = np.array(y) + [drawn_from(rng, -nu, nu) for _ in y]
        done.x.append(np.array(x).T)
        done.u.append(u[:length].copy())
        done.y.append(np.array(y))
        error = np.diff(r[: length + 1]) - np.diff(seen)
        learned = [gain.high if habit < 2 else drawn_from(rng, gain.low, gain.high) for _ in error]
        u[:length] = u[:length] + np.array(learned) * error
    return done


def drawn_from(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two ends, often one of them."""
    return float(rng.choice([low, high])) if rng.random() < 0.6 else float(rng.uniform(low, high))


def inside(values: Array, ends: Array) -> bool:
    return bool((values >= ends[: values.size, 0]).all() and (values <= ends[: values.size, 1]).all())


def holds(d: Dossier, found: Any) -> None:
    """Hold a funnel against adversaries, and against a plain loop; nothing is inside one that is a tenth too narrow."""
    assert found.grounds is Grounds.INDUCTION and 0 < found.margin < 1 and found.role is Role.REPAIRED
    sets = d.funnels.rounded
    assert sets is not None
    low, high = (Bounds(sets.x[..., i].T, sets.u[:, i]) for i in (0, 1))
    none = Bounds(np.zeros_like(low.states), np.zeros_like(low.inputs))
    assert held_inside(d.funnels.campaigns(200, 3, seed=7), low, high, none).margin >= 0  # 100 more in the judge's
    wide = float((sets.y[:, 1] - sets.y[:, 0]).max())
    assert wide >= found.bound  # rounding makes it no narrower
    rng = np.random.default_rng(1)
    for _ in range(6):
        done = random_campaign(d, rng, 10)
        for x, u, y in zip(*done, strict=True):
            assert inside(u, sets.u) and inside(y, sets.y)
            assert all(inside(row, sets.x[:, i]) for i, row in enumerate(x))


def lies_beneath(d: Dossier) -> None:
    """Hold a learning curve against a plain loop of random campaigns: no error lies above it."""
    curve, r = d.funnels.curve, d.study.reference_samples[0]
    assert not isinstance(curve, Open)
    rng = np.random.default_rng(2)
    for _ in range(4):
        done = random_campaign(d, rng, curve.common.size, least=curve.last)
        for y, bound in zip(done.y, curve.common, strict=True):
            assert float(np.mean((r - np.pad(y, (0, r.size - y.size)))[1 : curve.last + 1] ** 2)) <= bound


# -- what has no meaning, and what is read off a funnel ------------------------------------------------------------


def test_a_funnel_has_these_premises():
    found = judged_all(gather(FIRST))[0]
    assert isinstance(found, Verdict)
    assert {one.claim.removeprefix("small.premise.") for one in found.premises} == {
        "relative_degree_1",
        "no_filter",
        "plan_alone",
        "update_form",
        "positive_gain",
        "starts_given",
    }


NOT_MADE = [
    # plant, law, the property that is missing
    (Pair(), law(), "a task that the law is for"),
    (Pair(), Anything(inputs=2), "one input and one output"),
    (FIRST, law(ICFDL), "learning on the output's increments (learns_on)"),
    (FIRST, Planned(), "learning on the output's increments (learns_on)"),
    (FIRST, PD(kp=0.1, kd=0.1), "learning on the output's increments (learns_on)"),
    (FIRST, Silent(), "a learning gain between declared ends (learning_gain)"),
    (FIRST, Anything(), "learning between trials (learns_on)"),
]


@pytest.mark.parametrize(("plant", "controller", "lacks"), NOT_MADE)
def test_without_its_meaning_it_is_not_made(plant, controller, lacks):
    study = Study(
        plant=plant,
        reference=np.stack([RAMP] * len(plant.outputs)),
        controllers={"law": controller, "other": Anything(inputs=len(plant.inputs))},
        trials=2,
        name="small",
    )
    found = judged_all(Dossier(run(study, show_progress=False), "law"))
    assert all(isinstance(one, NotMade) and lacks in one.lacks for one in found), found


BETWEEN = 1.001 * float(RAMP.max())  # above the reference, below the band
LIMITS = [
    # what, plant, law, changes, signal, bounds, standing, grounds, words
    ("far", FIRST, law(), {}, "x0", (-1, 9), PROVED, Grounds.INDUCTION, "read off the funnel: at sample"),
    ("one side", FIRST, law(), {}, "x0", (-1, None), PROVED, Grounds.INDUCTION, "read off the funnel"),
    ("the start itself", FIRST, law(), {}, "x0", (0, None), PROVED, Grounds.INDUCTION, "at sample 0"),
    ("above the start", FIRST, law(), {}, "x0", (1e-6, None), REFUTED, Grounds.RUN, "with 0 at sample 0"),
    ("an input", FIRST, law(), {}, "u", (-5, 5), PROVED, Grounds.INDUCTION, "read off the funnel"),
    ("the first plan itself", FIRST, law(), {}, "u", (None, 0.3), REFUTED, Grounds.RUN, "of 6 recorded trials"),
    ("an output of another name", within(None, 50.0, "y"), law(), {}, "y", (-1, 9), PROVED, Grounds.INDUCTION, "y is"),
    ("an input that no trial comes to", FIRST, law(), {"lengths": [4] * 6, "first_plan": np.repeat([0.3, 5.0], [4, 6])},
     "u", (None, 1), UNDECIDED, None, "recorded trials stay within, and the band of all trials is"),
    ("within the band", FIRST, law(initial_input=0.5), {}, "x0", (None, BETWEEN), UNDECIDED, None,
     "workbench.safe_plan"),
    ("no band", WILD, law(), {"trials": 2}, "u", (-1e9, 1e9), UNDECIDED, None,
     "no band of all trials is known: at sample"),
    ("a filter", FIRST, law(q_cutoff_hz=0.1), {"lengths": FIXED, "reference": np.repeat(RAMP, 4)}, "x0", (-9, 9),
     UNDECIDED,
     None, "without its filter"),
    ("a scope that is too small", Valve(), law(), {"truth": {"keep": VARIED}, "scope": {"plant.keep": (0.5, 0.7)}},
     "x", (-9, 9),
     UNDECIDED, None, "the study may leave that"),
    ("no funnel", FIRST, law(ICFDL), {}, "x0", (-9, 9), SUPPORTED, Grounds.RUN, "of 6 recorded trials"),
    ("no funnel, and beyond", FIRST, law(ICFDL), {}, "x0", (None, 0.1), REFUTED, Grounds.RUN, "of 6 recorded trials"),
    ("two channels", Pair(), Anything(inputs=2), {"reference": np.stack([RAMP, RAMP])}, "v", (-1, 1),
     SUPPORTED, Grounds.RUN, ""),
    ("two channels, and beyond", Pair(), Anything(inputs=2), {"reference": np.stack([RAMP, RAMP])}, "y", (0.1, 1),
     REFUTED,
     Grounds.RUN, "with 0 at sample 0"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("plant", "controller", "changes", "signal", "bounds", "stands", "grounds", "words"),
    [one[1:] for one in LIMITS],
    ids=[one[0] for one in LIMITS],
)
def test_bounds_of_signals_in_every_trial(plant, controller, changes, signal, bounds, stands, grounds, words):
    d = gather(plant, controller, limits={signal: bounds}, **changes)
    (claim,) = limits(d.campaign)
    found = Judge().verdict(claim)
    assert isinstance(found, Verdict) and found.claim == f"small.limit.{signal}"
    assert found.standing is stands and words in said(found), said(found)
    assert grounds is None or found.grounds is grounds
    if stands is PROVED:
        sets = dict((one.name, ends) for one, ends in bands(d))[signal]
        low, high = (-np.inf if bounds[0] is None else bounds[0]), (np.inf if bounds[1] is None else bounds[1])
        assert found.margin == min(sets[:, 0].min() - low, high - sets[:, 1].max()) >= 0
        assert any(one.claim == "small.increment_funnel" and one.standing is PROVED for one in found.premises)
    if stands is REFUTED:
        assert found.margin < 0 and found.replayed is not None
        data, at = d.campaign.data.sel(controller="law"), (found.witness["trial"] - 1, found.witness["sample"])
        name = "input" if signal in ("u", "v") else f"state_{signal}"
        assert found.witness["value"] == float(data[name].values.reshape(data.sizes["trial"], -1)[at])


def test_a_law_that_is_refused_has_no_limit():
    study = Study(
        name="small",
        plant=Pair(),
        reference=np.stack([RAMP, RAMP]),
        controllers={"law": law(), "other": Anything(inputs=2)},
        trials=2,
        verify=Verification(limits={"x": (-1, 1)}),
    )
    found = {one.controller: Judge().verdict(one) for one in limits(run(study, show_progress=False))}
    assert isinstance(found["law"], NotMade) and isinstance(found["other"], Verdict)


# -- what is computed, against formulas and loops ------------------------------------------------------------------


def maker_of(plant: Plant, controller: Any = None, **changes: Any) -> Maker:
    return gather(plant, controller, trials=2, **changes).funnels.maker


def test_the_funnel_of_a_sum_is_known():
    """x+ = x + u: the target is the reference's increment dr, whatever x, so the band is [sum min, sum max]."""
    plan, nu, spread = 0.15, 0.01, 0.2
    noise, starts = UniformNoise(largest=nu), From(state=(0.1,), spread=(spread,))
    for maker, widened, off in (
        (maker_of(SUMMED, law(initial_input=plan)), 0.0, (0.0, 0.0)),
        (maker_of(SUMMED, law(initial_input=plan), noise=noise), 2 * nu, (0.0, 0.0)),
        (maker_of(SUMMED, law(initial_input=plan), initial=starts), 0.0, (0.1 - spread, 0.1 + spread)),
        (maker_of(SUMMED, law(initial_input=plan), initial=starts, noise=noise), 2 * nu, (0.1 - spread, 0.1 + spread)),
    ):
        found = funnel(maker)
        assert not isinstance(found, Open)
        dr = np.diff(RAMP)
        low, high = np.minimum(plan, dr - widened), np.maximum(plan, dr + widened)
        np.testing.assert_allclose(found.sets.u, np.stack([low, high], axis=-1), rtol=1e-9, atol=1e-12)
        sums = [off[i] + np.concatenate([[0.0], np.cumsum(one)]) for i, one in enumerate((low, high))]
        np.testing.assert_allclose(found.sets.y, np.stack(sums, axis=-1), rtol=1e-9, atol=1e-12)
        assert found.parts == 1 and found.same == () and found.slopes == pytest.approx((1.0, 1.0), rel=1e-9)


def test_beyond_one_the_funnel_is_as_wide_as_overshoot_makes_it():
    """x+ = x/2 + u with a = l_max b: U = m +- max(|u_1 - m|, w a/(2 - a)) of the targets m +- w at each sample."""
    reach = 1.4
    maker = maker_of(UNIT, fast(reach), initial=From(state=(0.0,), spread=(0.05,)), reference=RAMP[:7])
    found = funnel(maker)
    assert not isinstance(found, Open) and found.reach == pytest.approx(reach, rel=1e-9)
    x = np.array([-0.05, 0.05])
    for k in range(6):
        targets = RAMP[k + 1] - RAMP[k] + 0.5 * x
        m, w = targets.mean(), np.ptp(targets) / 2
        far = max(abs(0.3 - m), w * reach / (2 - reach))
        np.testing.assert_allclose(found.sets.u[k], [m - far, m + far], rtol=1e-9)
        x = 0.5 * x + [m - far, m + far]
        np.testing.assert_allclose(found.sets.x[k + 1, 0], x, rtol=1e-9)


def test_the_curve_of_a_sum_is_known():
    """x+ = x + u, l between two ends: the input's distance to its target falls by 1 - l_min at least, by trial."""
    d = gather(SUMMED, law(initial_input=0.0), reference=STRAIGHT, trials=5, lengths=[7, N, 3, N, N])
    curve, gain = d.funnels.curve, d.funnels.gain
    assert not isinstance(curve, Open) and curve.last == 3 and curve.rounded
    r = STRAIGHT
    target, u = 0.1, np.zeros(N)
    for i, length in enumerate([7, N, 3, N, N]):
        error = r - np.concatenate([[0.0], np.cumsum(u)])
        for found, end in ((curve.common[i], 3), (curve.own[i], length)):
            assert found == pytest.approx(float(np.mean(error[1 : end + 1] ** 2)), rel=1e-9)
        u[:length] += gain.low * (target - u[:length])
    assert 0 <= curve.final < 1e-25


def test_the_curve_ends_where_noise_leaves_it():
    """x+ = x + u with noise: in the end the input is off by 2 nu, so the output by 2 nu k."""
    nu = 0.01
    d = gather(SUMMED, law(), trials=60, noise=UniformNoise(largest=nu), lengths=FIXED)
    curve = d.funnels.curve
    assert not isinstance(curve, Open)
    final = float(np.mean((2 * nu * np.arange(1, N + 1)) ** 2))
    assert curve.final == pytest.approx(final, rel=1e-6)
    assert final <= curve.common[-1] <= 1.01 * final and (np.diff(curve.common) <= 0).all()


def test_a_wider_scope_has_a_higher_curve_and_a_wider_funnel():
    before = None
    for half in (0.0, 0.01, 0.03, 0.06):
        d = gather(Valve(), trials=6, truth={"keep": Between(low=1 - half, high=1 + half)}, lengths=[4, 9, N, 5, 6, 7])
        curve, sets = d.funnels.curve, d.funnels.funnel.sets
        assert not isinstance(curve, Open)
        assert (curve.own[[0, 3]] >= 0).all()
        if before is not None:
            assert (curve.common >= before[0]).all() and (curve.own >= before[1]).all() and curve.final >= before[2]
            assert (sets.y[:, 0] <= before[3][:, 0]).all() and (sets.y[2:, 1] > before[3][2:, 1]).all()
        before = curve.common, curve.own, curve.final, sets.y


def test_the_gain_of_a_curve_that_may_vanish_has_no_end():
    d = gather(FIRST, law(Endless), trials=6)
    curve = d.funnels.curve
    assert not isinstance(curve, Open) and curve.final is None
    _, limit, found = judged_all(d)
    assert limit.standing is UNDECIDED and "phi_range" in limit.method
    assert found.standing is UNDECIDED and "which does not fall" in found.method  # nothing makes it


def test_a_split_needs_what_stays_the_same():
    """Parts cover the whole of every range, once, and a quantity that changes is never split."""
    parameters = {"a": Range(-1.0, 2.0, "1"), "b": Range(0.1, 0.3, "1"), "c": Range(0.0, 1.0, "1")}
    assert parts_of(parameters, ()) == [parameters]
    parts = parts_of(parameters, ("a", "b"))
    assert len(parts) == 256 and all(one["c"] == parameters["c"] for one in parts)
    for name in ("a", "b"):
        ends = sorted({(one[name].low, one[name].high) for one in parts})
        assert (ends[0][0], ends[-1][1]) == (parameters[name].low, parameters[name].high)
        assert [high for _, high in ends[:-1]] == [low for low, _ in ends[1:]]
    assert len(parts_of(parameters, ("a", "b", "c"))) == 6**3


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_what_is_wanted_holds_every_increment_that_noise_may_make(noise):
    r = np.cumsum(np.random.default_rng(0).normal(size=200)) * 1e-3 + 1e3
    ends = wanted(r, noise)
    exact = [Fraction(b) - Fraction(a) for a, b in pairwise(r.tolist())]
    for (low, high), one in zip(ends.tolist(), exact, strict=True):
        assert Fraction(low) <= one - Fraction(noise) and one + Fraction(noise) <= Fraction(high)
    assert np.ptp(ends, axis=1).max() < 2 * noise + 1e-12


def test_doubles_stay_in_the_funnel_where_rounding_is_carried():
    """A plant that rounds much, run for long: inputs come to rest, and never leave the funnel by a bit."""
    big = small("Big", lambda x, u, k: ((x[0] + 1e6) + u / 3 - 1e6,))
    d = gather(big, fast(3.0, initial_input=0.5), reference=STRAIGHT, trials=300)
    found = judged_all(d)
    assert [one.standing for one in found] == [PROVED] * 3, [said(one) for one in found]
    rounded, exact = d.funnels.rounded, d.funnels.funnel.sets
    assert (rounded.y[1:, 0] < exact.y[1:, 0]).all() and (rounded.y[1:, 1] > exact.y[1:, 1]).all()


def test_nothing_is_held_where_a_jump_makes_rounding_unbounded():
    d = gather(small("Scaled", lambda x, u, k: (0.6 * x[0] + ca.if_else(1.1 * x[0] > 0.3, 0.2, 0.0) + 0.5 * u,)))
    assert d.funnels.rounded is None
    found = judged_all(d)
    assert found[0].standing is PROVED and found[0].held.tries == 0 and "something jumps" in str(found[0].held.witness)


@pytest.mark.parametrize("signal", ["x", "u"])
@pytest.mark.parametrize("end", [0, 1])
def test_a_funnel_that_is_too_tight_is_contradicted_by_runs(signal, end):
    """Where one end of a set is drawn in by 5 % of its width at every sample, campaigns or the record show it."""
    d = gather(FIRST)
    assert d.funnels.held(Finding(grounds=Grounds.INDUCTION, holds=True)).margin >= 0
    sets = d.funnels.rounded
    tight = np.array(getattr(sets, signal))
    tight[..., end] += (-1) ** end * 0.05 * (tight[..., 1] - tight[..., 0])
    vars(d.funnels)["rounded"] = sets._replace(**{signal: tight})
    held = d.funnels.held(Finding(grounds=Grounds.INDUCTION, holds=True))
    assert held.margin < 0, held


def test_a_curve_that_is_too_low_is_contradicted_by_runs():
    d = gather(FIRST, initial=SCATTER)
    curve = d.funnels.curve
    assert not isinstance(curve, Open)
    assert d.funnels.held_curve(Finding(grounds=Grounds.INDUCTION, holds=True)).margin >= 0
    vars(d.funnels)["curve"] = curve._replace(common=0.7 * curve.common)
    assert d.funnels.held_curve(Finding(grounds=Grounds.INDUCTION, holds=True)).margin < 0
    vars(d.funnels)["curve"] = curve._replace(own=0.001 * curve.own)
    assert d.funnels.held_curve(Finding(grounds=Grounds.INDUCTION, holds=True)).margin < 0
