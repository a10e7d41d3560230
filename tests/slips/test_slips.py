"""Slips planted in the program, one at a time: for each a check must turn red, and none is red without a slip."""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path

import pytest

from slips import certifying, checking, deciding, enclosing, identifying, running, studying, tabling
from slips.planting import Slip, planted

ROOMS = (enclosing, tabling, checking, certifying, identifying, deciding, running, studying)
SLIPS: tuple[Slip, ...] = tuple(slip for room in ROOMS for slip in room.SLIPS)
CHECKS = list(dict.fromkeys(slip.check for slip in SLIPS))


def test_no_two_slips_are_in_one_function():
    assert [where for where, count in Counter(slip.where for slip in SLIPS).items() if count > 1] == []
    assert all(slip.causes and slip.stands != slip.slipped for slip in SLIPS)
    assert len(SLIPS) >= 60


def test_a_slip_whose_text_is_gone_says_so():
    gone = dataclasses.replace(SLIPS[0], stands="a text that is nowhere")
    with pytest.raises(AssertionError, match=r"has changed.* plant it anew"), planted(gone):
        pass


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_without_a_slip_no_check_is_red(check):
    check()


@pytest.mark.parametrize("slip", SLIPS, ids=lambda slip: slip.where)
def test_no_slip_survives(slip):
    with planted(slip), pytest.raises(AssertionError) as caught:
        slip.check()
    assert Path(str(caught.traceback[-1].path)).parent == Path(__file__).parent, "the program fell, no check turned red"
