"""The case by hand in docs/funnel.md, number by number, from the program; and that what the page shows works."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench
from studies.metro.study import STUDY
from verification.decide.judge import judge
from verification.decide.safe_plan import SafePlan
from verification.theorems.dossier import Dossier
from verification.theorems.funnel import claims_of
from workbench.contracts import settings
from workbench.contracts.finding import Standing

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "funnel.md").read_text()
BY_HAND, SAFE = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def table(name: str) -> list[list[list[float]]]:
    """Return the rows of a table of the page: cells are numbers, or two with ``to`` between them."""
    found = re.search(rf"<!-- by hand: {name} -->\n(.*?)\n<!-- end -->", PAGE, re.DOTALL)
    assert found is not None
    rows = [line.strip("|").split("|") for line in found[1].splitlines()[2:]]
    return [[[float(one) for one in cell.split(" to ")] if cell.strip() else [] for cell in row] for row in rows]


@pytest.fixture(scope="module")
def by_hand() -> Dossier:
    space: dict[str, Any] = {}
    exec(compile(BY_HAND, "by_hand.py", "exec"), space)
    return Dossier(space["campaign"], "increment")


def test_the_funnel_by_hand_is_the_computed_one(by_hand):
    sets, reference = by_hand.funnels.funnel.sets, by_hand.study.reference_samples[0]
    rows = table("funnel")
    assert [row[0] for row in rows] == [[0.0], [1.0], [2.0], [3.0]]
    for k, (_, state, wanted, target, inputs) in enumerate(rows):
        assert sets.x[k, 0] == pytest.approx(state, abs=1e-12)
        if k < 3:
            assert reference[k + 1] - reference[k] == pytest.approx(wanted[0])
            assert sets.target[k] == pytest.approx(target, abs=1e-12)
            assert sets.u[k] == pytest.approx(inputs, abs=1e-12)
    gain = by_hand.funnels.gain
    assert (gain.low, gain.high) == pytest.approx((0.4, 0.5)) and by_hand.funnels.funnel.slopes == pytest.approx((1, 1))


def test_the_curve_by_hand_is_the_computed_one(by_hand):
    rows, reference = table("curve"), by_hand.study.reference_samples[0][1:]
    curve = by_hand.funnels.curve
    assert [row[0] for row in rows] == [[1.0], [2.0], [3.0]] and curve.last == 3
    for (_, *outputs, (bound,)), computed in zip(rows, curve.common, strict=True):
        assert bound == pytest.approx(computed, abs=5e-5)
        ends = np.array(outputs)
        assert np.mean(np.max(np.abs(reference[:, None] - ends), axis=1) ** 2) == pytest.approx(bound, abs=5e-5)
    for trial, (_, *outputs, _) in zip(by_hand.funnels.taken.y, rows, strict=True):
        assert all(low - 1e-12 <= y <= high + 1e-12 for y, (low, high) in zip(trial[1:], outputs, strict=True))


def test_its_claims_are_proved(by_hand):
    found = {one.name.split(".")[1]: judge(one).standing for one in claims_of(by_hand)}
    assert found["increment_funnel"] is found["learning_curve"] is Standing.PROVED


@pytest.mark.parametrize("sets", re.findall(r"workbench verify metro --case default (--set .*)", PAGE))
def test_settings_of_the_commands_are_taken(sets):
    given = [one.replace("'", "") for one in re.findall(r"--set (\S+=(?:'[^']*'|\S+))", sets)]
    verify = settings.assigned(STUDY, given).verify
    assert verify.scope or verify.limits


def test_names_of_the_session_exist():
    assert "wb.safe_plan(" in SAFE and callable(workbench.safe_plan)
    assert set(re.findall(r"\bplan\.(\w+)", SAFE)) <= {one.name for one in dataclasses.fields(SafePlan)}


@pytest.mark.parametrize("name", re.findall(r"\]\(([\w/.-]+)\)", PAGE))
def test_linked_files_exist(name):
    assert (ROOT / "docs" / name).is_file()
