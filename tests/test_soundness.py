"""Verdicts on random small plants whose truth is known: none is false, and none is lost that is given today."""

from __future__ import annotations

import dataclasses
import logging

import casadi as ca
import numpy as np
import pytest
from soundness.ask import Answer, answers, asked, without_a_compiler
from soundness.case import Case
from soundness.curves import Numbers, Symbols
from soundness.families import FAMILIES, FRESH, drawn
from soundness.page import PAGE, left_open, page, shares
from soundness.table import percent, tally

from verification.checks import assumptions, continuity, convergence
from verification.checks import funnel as funnels
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Grounds
from workbench.trials.campaign import run

SLICE, LARGE = 50, 600


def all_asked(count: int) -> list[Answer]:
    with without_a_compiler():
        return [one for number in range(count) for one in asked(number)]


@pytest.fixture(scope="module")
def slice_of_cases() -> list[Answer]:
    return all_asked(SLICE)


def right(found: list[Answer]) -> None:
    assert not [one for one in found if one.false]
    known = left_open()
    assert not [one for one in found if one.due and not one.decided and (one.claim, one.family) not in known]


def test_no_verdict_is_false_and_none_falls_silent(slice_of_cases):
    right(slice_of_cases)
    assert {one.family for one in slice_of_cases} == {drawn(i).family for i in range(len(FAMILIES))}


def test_a_fresh_kind_of_plant_gets_no_false_verdict():
    with without_a_compiler():
        found = [one for n in range(5) for make in FRESH for one in answers(n, make(np.random.default_rng([5, n + 5])))]
    assert not [one for one in found if one.false or one.claim == "broke down"]
    assert not [one for one in found if "see its log" in one.said]


@pytest.mark.slow
def test_many_verdicts_are_neither_false_nor_silent():
    found = all_asked(LARGE)
    right(found)
    made = tally(found)
    said = shares()
    for name, one in {**made.by_claim(), **made.by_family()}.items():
        for decided, of, share in ((one.true_decided, one.true, 0), (one.false_decided, one.false, 1)):
            least = said[name][share]
            spare = 3 * np.sqrt(max(least * (1 - least), 0.01) / max(of, 1)) + 0.01  # of a share among so few
            assert decided >= (least - spare) * of, (name, percent(decided, of), least)


def test_most_that_can_be_told_is_told(slice_of_cases):
    due = [one for one in slice_of_cases if one.due]
    assert len(due) > 10 * SLICE and sum(one.decided for one in due) > 0.9 * len(due)
    assert sum(not one.holds for one in due) > 2 * SLICE


def test_two_channels_have_no_claims_of_one(slice_of_cases):
    made = {one.claim for one in slice_of_cases if one.family == "two channels" and one.standing != "not made"}
    assert made == {"does_not_diverge", "error_falls", "conditioning"}


def test_the_page_says_that_nothing_was_false():
    text = PAGE.read_text(encoding="utf-8")
    assert "False PROVED: 0. False REFUTED: 0. Broke down: 0." in text and "make soundness" in text


def test_the_page_is_read_as_it_is_written(slice_of_cases, tmp_path, monkeypatch):
    made = tally(slice_of_cases)
    there = tmp_path / "soundness.md"
    there.write_text(page(made, 0))
    monkeypatch.setattr("soundness.page.PAGE", there)
    open_ones = {(one.claim, one.family) for one in slice_of_cases if one.due and not one.decided}
    assert left_open() == open_ones and open_ones
    assert set(shares()) == {*made.by_claim(), *made.by_family()}


@pytest.mark.parametrize(
    ("claim", "standing", "holds", "false", "decided"),
    [
        ("A1", "PROVED", False, True, False),
        ("A1", "REFUTED", True, True, False),
        ("A1", "PROVED", True, False, True),
        ("A1", "SUPPORTED", True, False, False),
        ("A1", "REFUTED", False, False, True),
        ("A1", "UNDECIDED", False, False, False),
        ("A1", "PROVED", None, False, False),
        ("limit.x0", "SUPPORTED", True, False, False),
        ("limit.x0", "SUPPORTED", False, False, False),
        ("limit.x0", "PROVED", True, False, True),
        ("theorem1", "SUPPORTED", False, True, False),
        ("theorem1", "SUPPORTED", True, False, True),
    ],
)
def test_what_is_false_and_what_is_decided(claim, standing, holds, false, decided):
    one = Answer(0, "f", "icfdl", claim, standing, holds, True, "", "")
    assert (one.false, one.decided) == (false, decided)


def always(*given: object) -> Finding:
    return Finding(grounds=Grounds.ENCLOSURE, holds=given is not None)


SLIPS = {
    "continuity is never looked at": (continuity, "continuous_slope", always, "kink in u", "A1"),
    "the slope is never looked at": (assumptions, "sign_partial", always, "sign changes in k", "A4.partial"),
    "lambda is halved twice": (
        convergence, "lambda_min", lambda law, b, one_sided=True: float((law.rho * b) ** 2 / 64), "linear",
        "lambda_min.realised",
    ),
}  # fmt: skip


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_found(slip, monkeypatch):
    module, name, wrong, family, claim = SLIPS[slip]
    monkeypatch.setattr(module, name, wrong)
    start = next(i for i in range(len(FAMILIES)) if drawn(i).family == family)
    with without_a_compiler():
        turns = (asked(start + turn * len(FAMILIES)) for turn in range(8))
        assert any(one.false and one.claim == claim for found in turns for one in found)


@pytest.mark.parametrize("number", range(len(FAMILIES) + len(FRESH)))
def test_the_plain_loop_gives_the_record(number):
    fresh = FRESH[number - len(FAMILIES) :]
    case = fresh[0](np.random.default_rng(number)) if number >= len(FAMILIES) else drawn(number)
    if case.channels > 1:
        return
    logging.disable(logging.WARNING)
    try:
        with without_a_compiler():
            data = run(case.study, show_progress=False).data.sel(controller=case.law.kind)
    finally:
        logging.disable(logging.NOTSET)
    done = len(case.run.u)
    np.testing.assert_allclose(data["mse"].values[:done], case.run.mse, rtol=1e-6, atol=1e-18)
    assert np.isfinite(float(data["diverged_at_trial"])) == case.run.fell


@pytest.mark.parametrize("number", range(len(FAMILIES)))
def test_curves_are_the_same_in_both_arithmetics_and_their_slopes_are_right(number):
    chain = drawn(number).chain
    v = ca.SX.sym("v")
    for curve in (chain.drive, chain.drift, *([chain.scale] if chain.scale else [])):
        breaks = [*curve.kinks, *curve.jumps, *curve.steep, *curve.poles]
        at = [p for p in np.linspace(-5, 5, 41) if p > curve.least and all(abs(p - q) > 1e-3 for q in breaks)]
        f = ca.Function("f", [v], [curve.value(Symbols, v)])
        h = 1e-6
        for p in at:
            value = float(curve.value(Numbers, p))
            assert float(f(p)) == pytest.approx(value, rel=1e-12, abs=1e-12)
            quotient = float(curve.value(Numbers, p + h) - curve.value(Numbers, p - h)) / (2 * h)
            assert quotient == pytest.approx(float(curve.slope(p)), rel=1e-4, abs=1e-5)
            low, high = curve.slopes(at[0], at[-1])
            assert low - 1e-9 <= float(curve.slope(p)) <= high + 1e-9


def learns_slowly(case: Case) -> bool:
    """Whether a case of a law that estimates nothing has a band by construction."""
    return case.law.kind == "simple-increment" and case.law.gain * case.chain.gain < 0.9


def test_a_band_that_is_too_narrow_is_left_by_a_random_campaign(monkeypatch):
    """Bands that are cut are no longer what trials stay in: the campaign says so."""
    number = next(i for i in range(1, 2000, len(FAMILIES)) if learns_slowly(drawn(i)))
    made = funnels.funnel

    def narrow(maker: funnels.Maker) -> object:
        found = made(maker)
        assert isinstance(found, funnels.Funnel)
        middle = found.sets.x.mean(axis=-1, keepdims=True)
        return dataclasses.replace(found, sets=found.sets._replace(x=middle + 0.5 * (found.sets.x - middle)))

    monkeypatch.setattr("verification.theorems.funnels.funnel", narrow)
    monkeypatch.setattr("verification.theorems.funnels.Funnels.held", lambda self, found: Held(1, 0.0, {}))
    with without_a_compiler():
        found = answers(number, drawn(number))
    assert [one for one in found if one.claim == "increment_funnel" and one.false]
