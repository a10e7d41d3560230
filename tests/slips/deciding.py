"""Slips in judging and in what is told: premises, replays, attacks, exit status, expectations, limits read off."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import numpy as np

from models.plant import Signal
from slips.planting import Slip
from verification.decide.judge import Judge, judge
from verification.decide.replay import _compared
from verification.decide.verify import _with_premises
from verification.report.gate import CONTRADICTED, DEPARTED, FINE, OPEN, Gate
from verification.theorems import funnel, limits
from workbench.contracts.claim import Claim, Expected, Held, Role, expected_of
from workbench.contracts.finding import Finding, Grounds, Standing, undecided

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
GOOD = Finding(grounds=Grounds.SETTINGS, margin=1.0, method="good")
SEEN = Finding(grounds=Grounds.RUN, margin=1.0, method="seen")
BAD = Finding(grounds=Grounds.SETTINGS, margin=-1.0, method="bad", witness={"a": 1})
OPENED = undecided("open")


def claim(finding, name="s.c", **more):
    return Claim(name=name, statement=name, source="ours", check=lambda: finding, **more)


def verdict(finding=GOOD, **more):
    found = Judge(expectations=more.pop("expectations", None)).verdict(claim(finding, **more))
    assert found.standing in Standing
    return found


def standing_on(premise):
    return judge(claim(GOOD, premises=[claim(premise, "s.p")])).standing


def nothing_is_refuted_on_an_open_premise():
    assert judge(claim(BAD, premises=[claim(OPENED, "s.p")])).standing is UNDECIDED


def an_open_premise_leaves_it_open():
    assert standing_on(OPENED) is UNDECIDED and standing_on(BAD) is UNDECIDED


def a_premise_that_was_seen_weakens():
    assert standing_on(SEEN) is SUPPORTED


def what_a_proof_rests_on_counts():
    assert judge(claim(GOOD, rests_on=[claim(OPENED, "s.p")])).standing is UNDECIDED
    assert judge(claim(GOOD, rests_on=[claim(SEEN, "s.p")])).standing is SUPPORTED


def premises_are_looked_at_once_more():
    lowest = claim(BAD, "s.lowest")
    top = claim(GOOD, "s.top", premises=[claim(GOOD, "s.premise", rests_on=[lowest])])
    assert [one.name for one in _with_premises([top])] == ["s.lowest", "s.premise", "s.top"]


def a_contradicted_proof_is_none():
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        found = judge(claim(GOOD, attack=lambda finding: Held(3, -1.0, {"trial": 2})))
    assert found.standing is UNDECIDED and found.contradiction


def a_witness_that_refutes_nothing_does_not_stand():
    assert judge(claim(BAD, replay=lambda witness: 1.0)).standing is UNDECIDED


def a_replay_uses_the_replay():
    looked = []
    judge(claim(BAD, replay=lambda witness: looked.append(witness) or -1.0))
    assert looked == [{"a": 1}]


def zero_is_enough_for_at_most_only():
    for weak, standing in ((True, PROVED), (False, REFUTED)):
        assert Finding(grounds=Grounds.ALGEBRA, margin=0.0, weak=weak, witness={"a": 1}).standing is standing


def the_last_word_counts():
    table = {"c": (Expected(standing=PROVED, why="in all"), Expected(standing=REFUTED, why="here", cases=("here",)))}
    assert expected_of(table, "s.c", None, "here").standing is REFUTED
    assert expected_of(table, "s.c", None, "there").standing is PROVED


def it_speaks_of_its_cases():
    assert not Expected(standing=PROVED, why="w", cases=("here",)).speaks_of(None, "there")
    assert not Expected(standing=PROVED, why="w", controllers=("a",)).speaks_of("b", "there")


def departing():
    return verdict(expectations={"c": (Expected(standing=REFUTED, why="printed"),)})


def the_exit_status_tells():
    assert Gate(strict=True).status([departing()]) == DEPARTED
    assert Gate().status([verdict(OPENED)]) == OPEN
    assert Gate().status([verdict()]) == FINE
    contradicted = SimpleNamespace(contradiction="by a run")
    assert Gate().status([contradicted]) == CONTRADICTED


def a_control_must_be_refuted():
    assert verdict(GOOD, role=Role.CONTROL).departs and verdict(BAD).departs and not verdict().departs


def what_was_open_is_left_open():
    assert verdict(OPENED).left_open


def a_baseline_is_held():
    gate = Gate(baseline={("s.c", "default", None): REFUTED})
    assert gate.departure(verdict()) is not None


def a_verdict_that_is_gone_departs():
    gate = Gate(baseline={("s.gone", "default", None): PROVED})
    assert [one.key[0] for one in gate.departures([verdict()])] == ["s.gone"]


def another_margin_is_another_refutation():
    found = Finding(grounds=Grounds.RUN, margin=-0.5, witness={"a": 1})
    assert _compared(-1.0, found)[0] is False and _compared(-0.5, found)[0] is True


LEVEL = Signal("level", "1")


def a_band_that_leaves_its_limits_proves_nothing():
    band = np.array([[0.0, 1.0], [0.0, 3.0]])
    left = np.minimum(band[:, 0] + 1, 2 - band[:, 1])
    assert limits._read(LEVEL, band, left, 2.0, {}).standing is UNDECIDED


def record(*rows):
    """A file in which a level was recorded."""
    values = np.array(rows, dtype=float)
    plant = SimpleNamespace(states=(LEVEL,), outputs=(), inputs=())
    data = SimpleNamespace(sel=lambda controller: {"state_level": SimpleNamespace(values=values)})
    return SimpleNamespace(campaign=SimpleNamespace(data=data), study=SimpleNamespace(plant=plant), controller="law")


def a_trial_beyond_a_limit_refutes_it():
    assert limits._within(record([0.0, 3.0]), LEVEL, (-1.0, 2.0), True).standing is REFUTED


def a_negative_gain_has_no_funnel():
    gain = SimpleNamespace(low=-0.1, high=0.5)
    d = SimpleNamespace(funnels=SimpleNamespace(gain=gain), study=SimpleNamespace(name="s"), controller="law")
    assert funnel._positive_gain(d).check().standing is REFUTED


SLIPS = (
    Slip(
        where="verification.decide.judge:_unmet",
        stands="its.standing is Standing.UNDECIDED",
        slipped="its.standing is Standing.REFUTED",
        causes="a theorem is REFUTED whose premise is open",
        check=nothing_is_refuted_on_an_open_premise,
    ),
    Slip(
        where="verification.decide.judge:Judge._judge",
        stands="undecided(unmet) if unmet else checked(claim.check)",
        slipped="checked(claim.check)",
        causes="a theorem whose premise is open is PROVED",
        check=an_open_premise_leaves_it_open,
    ),
    Slip(
        where="verification.decide.judge:_weakened",
        stands="order(its.standing) < order(judged.standing)",
        slipped="order(its.standing) > order(judged.standing)",
        causes="a theorem is PROVED whose premise was only seen in a run",
        check=a_premise_that_was_seen_weakens,
    ),
    Slip(
        where="verification.decide.judge:Judge._rested",
        stands="(*judged.premises, *more)",
        slipped="judged.premises",
        causes="PROVED where what it rests on was only seen in a run",
        check=what_a_proof_rests_on_counts,
    ),
    Slip(
        where="verification.decide.judge:_attacked",
        stands="if held.margin >= 0:",
        slipped="if held is not None:",
        causes="what runs contradict is PROVED",
        check=a_contradicted_proof_is_none,
    ),
    Slip(
        where="verification.decide.judge:Judge._replayed",
        stands="if again.standing is not Standing.REFUTED:",
        slipped="if again.standing is Standing.UNDECIDED:",
        causes="REFUTED by a witness that refutes nothing",
        check=a_witness_that_refutes_nothing_does_not_stand,
    ),
    Slip(
        where="verification.decide.verify:_with_premises",
        stands="(*one.premises, *one.rests_on)",
        slipped="(*one.premises,)",
        causes="what refutes a premise is never looked at once more, and a theorem that does not apply is left open",
        check=premises_are_looked_at_once_more,
    ),
    Slip(
        where="verification.decide.judge:once_more",
        stands="if claim.replay is not None:",
        slipped="if claim.replay is None:",
        causes="REFUTED by the check that was wrong the first time, its replay is never asked",
        check=a_replay_uses_the_replay,
    ),
    Slip(
        where="workbench.contracts.finding:Finding.standing",
        stands="self.margin > 0 or (self.weak and self.margin == 0)",
        slipped="self.margin >= 0",
        causes="'below' is PROVED by a margin of 0",
        check=zero_is_enough_for_at_most_only,
    ),
    Slip(
        where="workbench.contracts.claim:expected_of",
        stands="meant[-1]",
        slipped="meant[0]",
        causes="a verdict departs from what is expected of another case, or does not from its own",
        check=the_last_word_counts,
    ),
    Slip(
        where="workbench.contracts.claim:Expected.speaks_of",
        stands="(not self.cases or case in self.cases)",
        slipped="(self.cases is not None)",
        causes="what is expected of one case is expected of all",
        check=it_speaks_of_its_cases,
    ),
    Slip(
        where="verification.report.gate:Gate.status",
        stands="return OPEN if any(self.leaves_open(one) for one in verdicts) else FINE",
        slipped="return FINE",
        causes="exit status 0 for claims that are open",
        check=the_exit_status_tells,
    ),
    Slip(
        where="workbench.contracts.verdict:Verdict.departs",
        stands="is not (self.role is Role.CONTROL)",
        slipped="is not False",
        causes="a negative control that was not caught passes",
        check=a_control_must_be_refuted,
    ),
    Slip(
        where="workbench.contracts.verdict:Verdict.left_open",
        stands="and not meant",
        slipped="and meant",
        causes="an UNDECIDED that nobody expected is not told",
        check=what_was_open_is_left_open,
    ),
    Slip(
        where="verification.report.gate:Gate.departure",
        stands="if former is not None and one.standing is not former:",
        slipped="if former is None and one.standing is not former:",
        causes="what stood otherwise in the baseline passes",
        check=a_baseline_is_held,
    ),
    Slip(
        where="verification.report.gate:Gate.gone",
        stands="if key not in there and",
        slipped="if key in there and",
        causes="a claim that is no longer made passes",
        check=a_verdict_that_is_gone_departs,
    ),
    Slip(
        where="verification.decide.replay:_compared",
        stands="rel_tol=AGREES",
        slipped="rel_tol=1.0",
        causes="a refutation stands that fails by half of what was printed",
        check=another_margin_is_another_refutation,
    ),
    Slip(
        where="verification.theorems.limits:_read",
        stands="int(np.argmin(left))",
        slipped="int(np.argmax(left))",
        causes="a limit is PROVED where the band comes nearest to leaving it",
        check=a_band_that_leaves_its_limits_proves_nothing,
    ),
    Slip(
        where="verification.theorems.limits:_within",
        stands="np.minimum(seen - low, high - seen)",
        slipped="seen - low",
        causes="a limit from above is kept by every run",
        check=a_trial_beyond_a_limit_refutes_it,
    ),
    Slip(
        where="verification.theorems.funnel:_positive_gain",
        stands="if gain.low >= 0 and gain.high > 0:",
        slipped="if gain.high > 0:",
        causes="a funnel is PROVED for a gain that may be negative",
        check=a_negative_gain_has_no_funnel,
    ),
)
