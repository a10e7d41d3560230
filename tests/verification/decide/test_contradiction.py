"""A proof that runs contradict is a fault of the program: an error in tests, 70 for the command, and never PROVED."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import pytest

from verification.decide.judge import ContradictionWarning, judge
from verification.report.gate import Gate
from workbench.contracts.claim import Claim, Held
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.verdict import Verdict


def proved(attack: Callable[[Finding], Held]) -> Claim:
    finding = Finding(grounds=Grounds.ALGEBRA, margin=0.5, bound=0.5, bound_unit="m")
    return Claim(name="a.x", statement="s", source="s", check=lambda: finding, attack=attack)


def quietly(claim: Claim) -> Verdict:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ContradictionWarning)
        return judge(claim)


@pytest.mark.parametrize("margin", [-1e-300, -0.5, float("-inf")])
def test_a_contradicted_proof_is_an_error_in_tests(margin: float) -> None:
    claim = proved(lambda _: Held(7, margin, {"trial": 2}))
    with pytest.raises(ContradictionWarning, match=r"a\.x is contradicted by a run"):
        judge(claim)
    found = quietly(claim)
    assert found.standing is Standing.UNDECIDED and found.contradiction and Gate().status([found]) == 70


@pytest.mark.parametrize("margin", [0.0, 1e-300, 0.5])
def test_room_to_the_last_bit_contradicts_nothing(margin: float) -> None:
    found = judge(proved(lambda _: Held(7, margin, {"trial": 2})))
    assert found.standing is Standing.PROVED and not found.contradiction and Gate().status([found]) == 0


def test_a_margin_that_is_no_number_is_no_room() -> None:
    found = quietly(proved(lambda _: Held(7, float("nan"), {"trial": 2})))
    assert found.standing is not Standing.PROVED


def fails(_: Any) -> Held:
    raise RuntimeError("inside a library")


def test_an_attack_that_ends_in_an_error_leaves_the_claim_open() -> None:
    found = judge(proved(fails))
    assert found.standing is Standing.UNDECIDED and not found.contradiction
    assert "could not be held against runs" in found.method and "inside a library" not in found.method
