"""Which laws learn in the form that they declare: shown for those that do, never for those that are a little off."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest
from learning_laws import Second

from models.expression import as_expression
from models.quantity import InvalidValue, declared, given, quantity
from verification.checks import learned_gain, univariate
from verification.checks.update import first_plan, held_update, learns_as_declared, replay
from verification.decide.judge import Judge
from verification.theorems.dossier import Dossier
from workbench import Study, run
from workbench.contracts.finding import Standing
from workbench.contracts.law import Law, LearningGain, Task
from workbench.contracts.scenario import NormalNoise
from workbench.contracts.trial_length import TrialLength
from workbench.contracts.verdict import Verdict
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.parts.rows import known

N = 6
PROVED, REFUTED, UNDECIDED = Standing.PROVED, Standing.REFUTED, Standing.UNDECIDED


def task(samples: int = N, *, varying: bool = True, **changes: Any) -> Task:
    reference = np.linspace(0.0, 1.0, samples + 1)[None] ** 2
    return Task(as_expression(ca.DM(reference)), as_expression(ca.DM(0.5)), varying_lengths=varying, **changes)


class Kept(NamedTuple):
    """A plan, and something beside it."""

    u: Any
    more: Any


class Before(NamedTuple):
    """A plan, and what the last trial left."""

    u: Any
    y: Any
    reached: Any


@declared
class Made(Law):
    """u <- u + 0.3 e_s(k+1), declared with ends that a case may move; what the others are variations of."""

    source: ClassVar[str] = "made for tests, 2026"
    learns_on: ClassVar[str] = "output"
    low: float = quantity(default=0.3, unit="1", doc="declared low end")
    high: float = quantity(default=0.3, unit="1", doc="declared high end")
    more: Any = given(default=None, doc="what begins beside the plan")

    @property
    def learning_gain(self) -> LearningGain:
        return LearningGain(self.low, self.high)

    def start(self, task: Any) -> Any:
        n = task.samples
        more = ca.DM.zeros(1, n) if self.more is None else ca.DM(np.asarray(self.more, dtype=float))
        return Kept(0.1 * ca.DM.ones(1, n), more)

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        return memory_k.u, state

    def learn(self, memory: Any, trial: Any) -> Any:
        return Kept(memory.u + self.step(memory, trial), self.beside(memory, trial))

    def step(self, memory: Any, trial: Any) -> Any:
        return 0.3 * known(trial.reached[1:], trial.e[1:])

    def beside(self, memory: Any, trial: Any) -> Any:
        return memory.more


def law(name: str, step: Any = None, **members: Any) -> type[Law]:
    """A law with another step, or with other methods."""
    body = {"__doc__": f"A law with {name}.", "__module__": __name__, **members}
    return declared(type(name.title().replace(" ", ""), (Made,), body | ({"step": step} if step else {})))


def e(trial: Any, ahead: int = 1) -> Any:
    """The error at k + ahead, zero where it is not known."""
    row = known(trial.reached, trial.e)
    n = row.shape[1] - 1
    return ca.horzcat(row, ca.DM.zeros(1, ahead))[:, ahead : ahead + n]


def rise(row: Any) -> Any:
    return row[:, 1:] - row[:, :-1]


def scaled_act(self: Any, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
    return memory_k.u * 3.7, state


def estimate(memory: Any, trial: Any) -> Any:
    """An estimate that the output moves, held between two ends."""
    return ca.fmin(ca.fmax(memory.more + 0.1 * known(trial.reached[1:], trial.y[1:]), 0.5), 2.0)


def adapted(phi: Any, trial: Any) -> Any:
    return phi / (1 + phi**2) * e(trial)


TABLE = np.linspace(0.1, 0.6, N)
ROWS = given(default=TABLE, doc="gain by sample")
HALF = 0.3 * 3.7
"""The gain in the plant's unit where the law acts in units of 3.7."""


def bent(row: Any) -> Any:
    """A gain that a row moves a little."""
    return 0.3 + 0.1 * ca.tanh(row)


BEFORE = {
    "start": lambda self, task: Before(0.1 * ca.DM.ones(1, task.samples), *(ca.DM(one) for one in self.more)),
    "learn": lambda self, m, t: Before(m.u + self.step(m, t), t.y, t.reached),
}
"""A memory of what the last trial left: the output, and where it was reached."""
UNKNOWN = np.full((1, N + 1), np.nan), np.zeros((1, N + 1))
"""No trial is known yet."""


def told(memory: Any, masked: bool, shift: int = 1) -> Any:
    """The output of the trial before, known by the mask of its own sample or of one that is not as late."""
    mask = memory.reached[:, shift : shift + N]
    return known(mask if masked else ca.DM.ones(1, N), memory.y[1:])


SHOWN = {
    "plain": Made(),
    "wider ends": Made(low=0.1, high=0.5),
    "ends of one side": Made(low=0.0, high=0.3),
    "of increments": law(
        "increments", lambda self, m, t: 0.3 * known(t.reached[1:], rise(t.e)), learns_on="increment"
    )(),
    "its own error": law("own error", lambda self, m, t: known(t.reached[1:], 0.3 * (t.r - t.y)[:, 1:]))(),
    "its own increment": law(
        "own increment",
        lambda self, m, t: known(t.reached[1:], 0.3 * (rise(t.r) - rise(t.y))),
        learns_on="increment",
    )(),
    "a condition around the whole": law(
        "branch", learn=lambda self, m, t: Kept(ca.if_else(t.reached[1:], m.u + 0.3 * t.e[1:], m.u), m.more)
    )(),
    "a dead zone": law("dead zone", lambda self, m, t: ca.if_else(ca.fabs(e(t)) > 0.1, 0.3 * e(t), 0))(
        low=0.0, high=0.3
    ),
    "the input that ran": law(
        "ran", learn=lambda self, m, t: Kept((t.u + 0.3 * e(t) + 2.7 * m.u - 2.7 * t.u), m.more)
    )(),
    "units of its own": law("units", act=scaled_act)(low=HALF * (1 - 1e-12), high=HALF * (1 + 1e-12)),
    "a gain by sample": law("table", lambda self, m, t: ca.DM(TABLE).T * e(t))(low=0.1, high=0.6),
    "a gain by sample in memory": law("kept table", lambda self, m, t: m.more * e(t))(
        low=0.1, high=0.6, more=TABLE[None]
    ),
    "a gain of the output": law(
        "curved", lambda self, m, t: (0.3 + 0.2 * ca.tanh(known(t.reached[1:], t.y[1:]))) * e(t)
    )(low=0.09, high=0.51),
    "a truth of a number": law(
        "truth",
        lambda self, m, t: 0.3 * ca.logic_and(t.reached[1:], m.more) * e(t),
        beside=lambda self, m, t: m.more + 1,
    )(low=0.0, high=0.3),
    "a fourth power": law("fourth", lambda self, m, t: e(t) / (2 + (m.more + m.u) ** 4))(low=0.0, high=0.5),
    "a new estimate": law(
        "new", lambda self, m, t: adapted(estimate(m, t), t), beside=lambda self, m, t: estimate(m, t)
    )(low=0.4 - 1e-12, high=0.5, more=np.ones((1, N))),
    "the estimate before": law("old", lambda self, m, t: adapted(m.more, t), beside=lambda self, m, t: estimate(m, t))(
        low=0.39, high=0.51, more=np.ones((1, N))
    ),
    "a divisor below zero": law("below", lambda self, m, t: -0.3 * e(t) / (-1 - known(t.reached[1:], t.y[1:]) ** 2))(
        low=0.0
    ),
    "what the trial before left": law("before", lambda self, m, t: bent(told(m, True)) * e(t), **BEFORE)(
        low=0.19, high=0.41, more=UNKNOWN
    ),
    "increment": Increment(),
    "increment, wide": Increment(phi_range=(1e-4, 0.5)),
    "increment, negative": Increment(phi0=-0.01),
    "icfdl": ICFDL(),
    "icfdl, negative": ICFDL(phi0=-0.02),
    "icfdl, small": ICFDL(phi0=1e-6),
}


@pytest.mark.parametrize("name", SHOWN)
def test_a_law_that_learns_as_it_declares_is_shown_to(name):
    found = learns_as_declared(SHOWN[name], task())
    assert found.standing is PROVED, found.method


@pytest.mark.parametrize("samples", [N, 400])
def test_a_law_for_whole_trials_needs_no_masks_but_fixed_lengths(samples):
    assert learns_as_declared(CFDL(), task(samples, varying=False)).standing is PROVED
    unmasked = law("unmasked", lambda self, m, t: 0.3 * t.e[1:])()
    assert learns_as_declared(unmasked, task(samples, varying=False)).standing is PROVED
    assert learns_as_declared(unmasked, task(samples)).standing is REFUTED


def forgetting(self: Any, memory: Any, trial: Any) -> Any:
    kept = ca.if_else(trial.reached[1:], memory.u, 0.9 * memory.u)
    return Kept(kept + 0.3 * e(trial), memory.more)


def fed(self: Any, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
    return memory_k.u + 0.1 * (r - y), state


def looked_up(row: Any) -> Any:
    """A gain that a table gives."""
    table = ca.interpolant("gains", "linear", [[-1.0, 0.0, 1.0]], [0.2, 0.5, 0.2])
    return ca.horzcat(*(table(ca.fmin(ca.fmax(one, -1), 1)) for one in ca.horzsplit(row)))


LATE = 1500


def late(self: Any, memory: Any, trial: Any) -> Any:
    gains = np.full(trial.u.shape[1], 0.3)
    gains[LATE] = 0.31
    return ca.DM(gains).T * e(trial)


def chosen(memory: Any, trial: Any) -> Any:
    """An estimate that is another one where the output is above zero."""
    return ca.if_else(known(trial.reached[1:], trial.y[1:]) > 0, estimate(memory, trial), 5)


def half_forgetting(self: Any, memory: Any, trial: Any) -> Any:
    last = ca.logic_and(trial.reached[:, :-1], ca.logic_not(trial.reached[1:]))
    return Kept(ca.if_else(last, 0.9 * memory.u, memory.u) + 0.3 * e(trial), memory.more)


OFF = {
    "a smaller end than it uses": (Made(high=0.29, low=0.0), REFUTED),
    "an end a millionth too small": (Made(low=0.0, high=0.3 - 3e-7), REFUTED),
    "an end too large": (Made(low=0.31, high=0.4), REFUTED),
    "an end that rounding cannot tell": (Made(low=0.0, high=float(np.nextafter(0.3, 0.0))), UNDECIDED),
    "a sample forgotten": (law("forgetting", learn=forgetting)(), REFUTED),
    "always forgetting": (
        law("leaking", learn=lambda self, m, t: Kept(0.99 * m.u + 0.3 * e(t), m.more))(),
        REFUTED,
    ),
    "the error now": (law("now", lambda self, m, t: 0.3 * e(t, 0))(), REFUTED),
    "a cross term": (law("crossed", lambda self, m, t: 0.3 * e(t) + 0.01 * e(t, 2))(), REFUTED),
    "a constant": (law("drifting", lambda self, m, t: 0.3 * e(t) + 1e-3)(low=0.0, high=1.0), REFUTED),
    "increments called outputs": (
        law("rising", lambda self, m, t: 0.3 * known(t.reached[1:], rise(t.e)))(),
        REFUTED,
    ),
    "outputs called increments": (law("mixed", learns_on="increment")(), REFUTED),
    "a gain that may be negative": (
        law("signed", lambda self, m, t: 0.3 * ca.tanh(known(t.reached[1:], t.y[1:])) * e(t))(low=0.0, high=0.31),
        REFUTED,
    ),
    "a gain without an upper end": (
        law("squared", lambda self, m, t: 0.3 * e(t) ** 3)(low=0.0, high=100.0),
        REFUTED,
    ),
    "a step that is cut": (
        law("cut", lambda self, m, t: ca.fmin(ca.fmax(0.3 * e(t), -0.1), 0.1))(low=0.0, high=0.3),
        UNDECIDED,
    ),
    "a mask that multiplies": (
        law("multiplied", lambda self, m, t: 0.3 * t.reached[1:] * t.e[1:])(),
        REFUTED,
    ),
    "a mask of another sample": (
        law("early", lambda self, m, t: 0.3 * known(t.reached[:, :-1], t.e[1:]))(),
        REFUTED,
    ),
    "missing numbers by way of memory": (
        law("carried", lambda self, m, t: (0.3 + 0.1 * ca.tanh(m.more)) * e(t), beside=lambda self, m, t: 2 * t.y[1:])(
            low=0.19, high=0.41
        ),
        REFUTED,
    ),
    "a gain of a table": (
        law("looked up", lambda self, m, t: looked_up(known(t.reached[1:], t.y[1:])) * e(t))(low=0.0, high=1.0),
        UNDECIDED,
    ),
    "missing numbers of the trial before": (
        law("unmasked before", lambda self, m, t: bent(told(m, False)) * e(t), **BEFORE)(
            low=0.19, high=0.41, more=UNKNOWN
        ),
        REFUTED,
    ),
    "the trial before, by a mask of an earlier sample": (
        law("shifted before", lambda self, m, t: bent(told(m, True, 0)) * e(t), **BEFORE)(
            low=0.19, high=0.41, more=UNKNOWN
        ),
        REFUTED,
    ),
    "the trial before, by the mask of this one": (
        law("wrong mask", lambda self, m, t: bent(known(t.reached[1:], m.y[1:])) * e(t), **BEFORE)(
            low=0.19, high=0.41, more=UNKNOWN
        ),
        REFUTED,
    ),
    "a trial before that there was not": (
        law("no trial", lambda self, m, t: bent(told(m, True)) * e(t), **BEFORE)(
            low=0.19, high=0.41, more=(UNKNOWN[0], np.ones((1, N + 1)))
        ),
        REFUTED,
    ),
    "the last sample forgotten": (law("half forgetting", learn=half_forgetting)(), REFUTED),
    "the error of the first sample for all": (
        law("first", lambda self, m, t: 0.3 * known(t.reached[1:], ca.repmat(t.e[1], 1, N)))(),
        REFUTED,
    ),
    "a gain in memory that is too large at one sample": (
        law("kept table", lambda self, m, t: m.more * e(t))(low=0.1, high=0.59, more=TABLE[None]),
        REFUTED,
    ),
    "one of two estimates without an end": (
        law("chosen", lambda self, m, t: adapted(chosen(m, t), t), beside=lambda self, m, t: estimate(m, t))(
            low=0.39, high=0.51, more=np.ones((1, N))
        ),
        REFUTED,
    ),
    "a gain that has a pole": (
        law("pole", lambda self, m, t: 0.3 * e(t) * m.more / m.more, beside=lambda self, m, t: m.more - 1)(
            more=np.ones((1, N))
        ),
        REFUTED,
    ),
    "an estimate that no end holds": (
        law("free", lambda self, m, t: adapted(m.more, t), beside=lambda self, m, t: m.more - e(t))(
            low=0.0, high=0.6, more=np.ones((1, N))
        ),
        REFUTED,
    ),
    "an estimate that begins outside": (
        law("begun", lambda self, m, t: adapted(m.more, t), beside=lambda self, m, t: estimate(m, t))(
            low=0.39, high=0.51, more=5 * np.ones((1, N))
        ),
        REFUTED,
    ),
    "feedback within the trial": (law("fed", act=fed)(), UNDECIDED),
    "a filter on the plan": (Increment(q_cutoff_hz=0.3), UNDECIDED),
    "another form": (PD(), UNDECIDED),
}


@pytest.mark.parametrize("name", OFF)
def test_a_law_that_is_off_is_not_shown_to_learn_as_it_declares(name):
    one, standing = OFF[name]
    asked = task()
    found = learns_as_declared(one, asked)
    assert found.standing is standing, found.method
    assert found.reason == "" or found.reason == found.method
    if standing is REFUTED:
        assert replay(one, asked, found.witness) == found.margin < 0


@pytest.mark.parametrize("name", ["a constant", "a cross term", "the error now", "always forgetting"])
def test_trials_of_one_length_excuse_nothing(name):
    assert learns_as_declared(OFF[name][0], task(varying=False)).standing is REFUTED


def test_one_sample_in_two_thousand_is_not_overlooked():
    one = law("late", late)
    found = learns_as_declared(one(), task(2000))
    assert found.standing is REFUTED and found.witness["sample"] == LATE
    assert learns_as_declared(one(high=0.31), task(2000)).standing is PROVED


@pytest.mark.parametrize("declared_by", [Increment(), ICFDL(), Increment(phi0=-0.01), CFDL(phi0=0.03)])
def test_declared_ends_of_an_estimate_are_tight_and_no_narrower_ones_are_shown(declared_by, monkeypatch):
    """The ends are those of rho phi/(lam + phi^2): a thousandth further in, each must fail."""
    gain = declared_by.learning_gain
    asked = task(varying=not isinstance(declared_by, CFDL))
    width = gain.high - gain.low
    for narrower in (
        LearningGain(gain.low + 1e-3 * width, gain.high),
        LearningGain(gain.low, gain.high - 1e-3 * width),
    ):
        monkeypatch.setattr(type(declared_by), "learning_gain", property(lambda self, ends=narrower: ends))
        assert learns_as_declared(declared_by, asked).standing is not PROVED
    monkeypatch.undo()
    assert learns_as_declared(declared_by, asked).standing is PROVED


KEPT = law("kept", lambda self, m, t: m.more * e(t))(low=0.2, high=0.4, more=np.full((1, N), 0.3))
OTHERS = {
    "itself": (KEPT, {}, PROVED),
    "a wider end": (law("kept", lambda self, m, t: m.more * e(t))(low=0.2, high=0.5, more=KEPT.more), {}, PROVED),
    "a narrower end": (law("kept", lambda self, m, t: m.more * e(t))(low=0.2, high=0.29, more=KEPT.more), {}, REFUTED),
    "another memory": (
        law("kept", lambda self, m, t: m.more * e(t))(low=0.2, high=0.4, more=2 * KEPT.more),
        {},
        REFUTED,
    ),
    "another expression": (
        law("kept", lambda self, m, t: 2 * m.more * e(t))(low=0.2, high=0.4, more=KEPT.more),
        {},
        REFUTED,
    ),
    "another signal": (
        law("kept", lambda self, m, t: m.more * e(t), learns_on="increment")(low=0.2, high=0.4, more=KEPT.more),
        {},
        REFUTED,
    ),
    "whole trials": (KEPT, {"varying": False}, PROVED),
    "bare": (law("bare", lambda self, m, t: m.more * t.e[1:])(low=0.2, high=0.4, more=KEPT.more), {}, REFUTED),
    "bare, whole trials": (
        law("bare", lambda self, m, t: m.more * t.e[1:])(low=0.2, high=0.4, more=KEPT.more),
        {"varying": False},
        PROVED,
    ),
    "more samples": (law("kept", lambda self, m, t: 0.3 * e(t))(low=0.2, high=0.4), {"samples": N + 3}, PROVED),
}


@pytest.mark.parametrize("asked_first", OTHERS)
def test_an_answer_that_is_kept_is_that_of_what_was_asked(asked_first):
    """Whatever was asked before, each law gets its own answer, once."""
    learned_gain._known.cache_clear()
    for name in [asked_first, *OTHERS, *OTHERS]:
        one, changes, standing = OTHERS[name]
        assert learns_as_declared(one, task(**changes)).standing is standing, name
    assert learned_gain._known.cache_info().misses == len(OTHERS)


def test_a_function_of_python_is_asked_each_time():
    class Halved(ca.Callback):
        def __init__(self):
            ca.Callback.__init__(self)
            self.construct("halved", {})

        def get_sparsity_in(self, i):
            return ca.Sparsity.dense(1, N)

        def get_sparsity_out(self, i):
            return ca.Sparsity.dense(1, N)

        def eval(self, arg):
            return [arg[0] / 2]

    halved = Halved()
    found = learns_as_declared(law("halved", lambda self, m, t: 0.3 * e(t) + (halved(m.u) - m.u / 2))(), task())
    assert found.standing is UNDECIDED and "cannot be read" in found.method, found.method


def test_a_first_plan_is_what_the_law_would_run_first():
    plan = np.linspace(-1.0, 2.0, N)[None]
    asked = task(first_plan=as_expression(ca.DM(plan)))
    for one in (Increment(), ICFDL()):
        np.testing.assert_allclose(first_plan(one, asked), plan, rtol=1e-15)
        np.testing.assert_allclose(first_plan(one, task()), np.full((1, N), one.initial_input), rtol=1e-15)
    with pytest.raises(InvalidValue, match="a first plan needs a law that acts by its plan alone"):
        first_plan(law("fed", act=fed)(), asked)


ROOTS = {
    "a parabola above": ([1, 0, 1], None, None),
    "a parabola below": ([-1, 0, -1], None, None),
    "a root inside": ([-1, 2], 0, 1),
    "a root at the low end": ([0, 1], 0, 1),
    "a root at the high end": ([1, -1], 0, 1),
    "roots outside": ([6, -5, 1], 4, None),
    "two roots inside": ([6, -5, 1], 0, None),
    "a double root inside": ([1, -2, 1], 0, 2),
    "a double root and a change of sign": ([-1, 3, -3, 1], 0, 2),
    "a double root and a root outside": ([-4, 8, -5, 1], Fraction(3, 2), Fraction(5, 2)),
    "a fourth power": ([1, -4, 6, -4, 1], 0, None),
    "a double root at the end": ([1, -2, 1], 1, 2),
    "a cubic": ([0, 2, -3, 1], 0, Fraction(1, 2)),
    "a point": ([-1, 1], 2, 2),
    "nothing": ([], 0, 1),
}


@pytest.mark.parametrize("name", ROOTS)
def test_signs_of_polynomials_are_those_on_a_fine_grid(name):
    numbers, low, high = ROOTS[name]
    p = [Fraction(one) for one in numbers]
    low, high = (None if end is None else Fraction(end) for end in (low, high))
    left, right = (-1e3 if low is None else float(low)), (1e3 if high is None else float(high))
    grid = np.unique(np.concatenate([np.linspace(left, right, 4001), np.linspace(left, min(right, left + 4), 4001)]))
    least = np.polynomial.polynomial.polyval(grid, numbers or [0]).min()
    assert univariate.positive(p, low, high) == (least > 0)
    if univariate.never_negative(p, low, high):
        assert least >= 0
    else:
        assert least < 0


def dossier(one: Law, **changes: Any) -> Dossier:
    fields = {"plant": Second(), "reference": np.linspace(0.0, 1.0, N + 1), "trials": 8, **changes}
    return Dossier(run(Study(controllers={"law": one}, **fields), show_progress=False), "law")


VARYING = TrialLength(law="uniform", minimum=2)


SMALL = {"force_unit": 1.0, "lam": 1.0, "rho": 0.5, "initial_input": 0.1, "mu": 1.0}
RUNS = {
    "plain": Made(),
    "of increments": SHOWN["of increments"],
    "a gain by sample": SHOWN["a gain by sample"],
    "icfdl": ICFDL(**SMALL),
    "icfdl, excited": ICFDL(**{**SMALL, "mu": 1e-3, "eps": 1e-7}),
    "increment": Increment(**SMALL),
    "increment, excited": Increment(**{**SMALL, "mu": 1e-3, "eps": 1e-7}),
}


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("name", RUNS)
def test_the_premise_is_proved_and_held_against_a_run(name, noise):
    d = dossier(RUNS[name], trial_length=VARYING, noise=NormalNoise(sigma=noise))
    claim = d.premises.update_form
    assert claim is d.premises.update_form
    found = Judge().verdict(claim)
    assert isinstance(found, Verdict)
    assert found.standing is PROVED and not found.contradiction, found.method
    assert found.held.tries == 7 and found.held.margin >= 0


@pytest.mark.parametrize("name", ["a cross term", "always forgetting", "a smaller end than it uses"])
def test_the_premise_of_a_law_that_is_off_is_refuted_by_a_witness_that_replays(name):
    found = Judge().verdict(dossier(OFF[name][0], trial_length=VARYING).premises.update_form)
    assert isinstance(found, Verdict)
    assert found.standing is REFUTED and found.replayed == found.margin < 0


def test_the_premise_of_a_law_with_feedback_is_open():
    found = Judge().verdict(dossier(OFF["feedback within the trial"][0]).premises.update_form)
    assert isinstance(found, Verdict) and found.standing is UNDECIDED


@declared
class Ending(Second):
    """A trial ends where the output passes 1/2, though none is declared to vary."""

    def ended(self, x: Any) -> Any:
        return x.x > 0.5


def test_a_plant_that_ends_its_trials_leaves_samples_missing():
    unmasked = law("bare", lambda self, m, t: 0.3 * t.e[1:])()
    for plant, standing in ((Second(), PROVED), (Ending(), REFUTED)):
        found = Judge().verdict(dossier(unmasked, plant=plant).premises.update_form)
        assert isinstance(found, Verdict) and found.standing is standing, found.method


SLIPS = {
    "a plan moved where the trial did not reach": (2, -1, 1e-15, True),
    "a plan moved a little too far": (2, 0, 1e-9, True),
    "a plan moved within rounding": (2, 0, 1e-17, False),
}


@pytest.mark.parametrize("name", SLIPS)
def test_a_run_that_departs_from_the_form_is_noticed(name):
    trial, sample, by, noticed = SLIPS[name]
    rng = np.random.default_rng(0)
    r, lengths = np.linspace(0.0, 1.0, N + 1), np.full(5, N - 1)
    seen, u = r + rng.normal(size=(5, N + 1)), np.zeros((5, N))
    seen[:, N:] = np.nan
    for i in range(4):
        u[i + 1] = u[i] + 0.3 * np.nan_to_num(r - seen[i])[1:]
    assert held_update(Made(), r, u, seen, lengths).margin >= 0
    u[trial:, sample] += by
    found = held_update(Made(), r, u, seen, lengths)
    assert (found.margin < 0) == noticed and found.tries == 4
    if noticed:
        assert found.witness["trial"] == trial and found.witness["sample"] == sample % N
