"""Exit status, departures and JUnit, of every standing beside every expectation."""

from __future__ import annotations

import itertools
import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from models.quantity import InvalidValue
from verification.report.gate import Gate, baseline_of
from verification.report.junit import junit
from workbench.contracts.claim import Expected, Role
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import NotMade, Verdict

STANDINGS = {str(one)[0]: one for one in Standing}
LETTERS = ("P", "S", "R", "U")
BOTH = list(itertools.product(LETTERS, ("", *LETTERS)))
"""How a claim stands, and how it was expected to; empty: nothing is expected."""


def verdict(stands: str, expected: str = "", name: str = "a.x", **further: Any) -> Verdict:
    meant = Expected(standing=STANDINGS[expected], why="by hand") if expected else None
    given: dict[str, Any] = {"controller": None, "statement": "s", "source": "ours", "margin": None, "unit": ""}
    given |= {"witness": None, "method": "looked"} | further
    return Verdict(claim=name, standing=STANDINGS[stands], expected=meant, **given)


def plainly(stands: str, expected: str) -> tuple[int, int]:
    """Return the exit status without and with --strict, told from the words of the contract."""
    departs = stands == "R" if not expected else stands != expected
    opened = stands == "U" and expected != "U"
    return (1 if opened else 0), (3 if departs else 1 if opened else 0)


@pytest.mark.parametrize(("stands", "expected"), BOTH)
@pytest.mark.parametrize("role", Role)
def test_one_verdict(stands: str, expected: str, role: Role) -> None:
    one = verdict(stands, expected, role=role)
    loose, strict = plainly(stands, expected or ("R" if role is Role.CONTROL else ""))
    assert Gate().status([one]) == loose and Gate(strict=True).status([one]) == strict
    changed = Gate(strict=True, changed=True).status([one])
    assert changed == (strict if role is Role.REQUIREMENT else 0)


@pytest.mark.parametrize(("stands", "expected"), BOTH)
@pytest.mark.parametrize("gate", [Gate(), Gate(strict=True), Gate(changed=True), Gate(baseline={})])
def test_a_contradiction_comes_first(stands: str, expected: str, gate: Gate) -> None:
    assert gate.status([verdict(stands, expected), verdict("U", contradiction="a run", role=Role.PRINTED)]) == 70


@pytest.mark.parametrize(("first", "second", "status"), [("R", "U", 3), ("U", "R", 3), ("U", "P", 1), ("P", "S", 0)])
def test_what_departs_comes_before_what_is_open(first: str, second: str, status: int) -> None:
    assert Gate(strict=True).status([verdict(first), verdict(second, name="a.y")]) == status


@pytest.mark.parametrize(("stands", "former"), list(itertools.product(LETTERS, LETTERS)))
@pytest.mark.parametrize("changed", [False, True])
def test_a_baseline_is_held_without_strict(stands: str, former: str, changed: bool) -> None:
    gate = Gate(baseline={("a.x", "default", None): STANDINGS[former]}, changed=changed)
    for role in (Role.REQUIREMENT, Role.OUTCOME):
        assert gate.status([verdict(stands, role=role)]) == (3 if stands != former else 0)


@pytest.mark.parametrize("changed", [False, True])
def test_verdicts_that_a_baseline_does_not_know(changed: bool) -> None:
    gate = Gate(baseline={}, changed=changed)
    assert [gate.status([verdict(letter)]) for letter in LETTERS] == [0, 0, 0, 0 if changed else 1]


@pytest.mark.parametrize(
    ("asked", "status"), [("", 3), ("default", 3), ("other", 0)], ids=["all", "its case", "another case"]
)
def test_a_verdict_that_is_no_longer_there(asked: str, status: int) -> None:
    former = {("a.gone", "default", "pd"): Standing.PROVED}
    gate = Gate(baseline=former, case=asked)
    assert gate.status([verdict("P")]) == status
    if status:
        lacking = NotMade(claim="a.gone", controller="pd", statement="s", source="s", lacks="a horizon")
        [plain], [named] = gate.departures([]), gate.departures([], [lacking])
        assert plain.line == "a.gone, pd, case default: expected PROVED because the baseline has it so, found none"
        assert named.found == "none, as it lacks a horizon"


def test_strict_and_a_baseline_both_count() -> None:
    gate = Gate(strict=True, baseline={("a.x", "default", None): Standing.REFUTED})
    assert gate.status([verdict("R", "P")]) == 3, "it departs from what the study expects"
    assert gate.status([verdict("R", "R")]) == 0
    assert gate.status([verdict("P", "P")]) == 3, "it departs from the baseline"


@pytest.mark.parametrize(("stands", "expected"), BOTH)
def test_a_departure_says_what_was_expected_and_why(stands: str, expected: str) -> None:
    departure = Gate().departure(verdict(stands, expected, controller="pd", case="slow"))
    if plainly(stands, expected)[1] != 3:
        assert departure is None
        return
    assert departure is not None
    meant = f"{STANDINGS[expected]} because by hand" if expected else "that it is not REFUTED because nothing is said"
    assert departure.line.startswith(f"a.x, pd, case slow: expected {meant}")
    assert departure.line.endswith(f"found {STANDINGS[stands]}")


@pytest.mark.parametrize(("stands", "expected"), BOTH)
def test_junit_says_the_same(stands: str, expected: str) -> None:
    one = verdict(stands, expected)
    root = ET.fromstring(junit("a", "1", [one], [], Gate()))
    [suite] = root
    case = suite.find("testcase")
    assert case is not None
    tags = [inner.tag for inner in case]
    loose, strict = plainly(stands, expected)
    wanted = "error" if loose == 1 else "failure" if strict == 3 else "skipped" if stands == "U" else None
    assert {"error", "failure", "skipped"} & set(tags) == ({wanted} if wanted else set())
    counted = {"error": "errors", "failure": "failures", "skipped": "skipped"}
    for tag, name in counted.items():
        assert suite.get(name) == str(int(tag == wanted))
    properties = {one.get("name"): one.get("value") for one in case.iter("property")}
    passed_refuted = stands == expected == "R"
    assert properties == ({"expected": "REFUTED", "because": "by hand"} if passed_refuted else {})
    if wanted == "skipped":
        assert case.find("skipped").get("message") == "by hand"  # type: ignore[union-attr]


def test_junit_of_contradictions_claims_not_made_and_what_is_gone() -> None:
    lacking = NotMade(claim="a.z", controller=None, statement="s", source="s", lacks="a horizon")
    gate = Gate(baseline={("a.gone", "slow", "pd"): Standing.PROVED})
    verdicts = [verdict("P", name="a.fine"), verdict("U", "U", contradiction="by 3 m")]
    root = ET.fromstring(junit("a", "1", verdicts, [lacking, lacking], gate))
    [suite] = root
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors"), suite.get("skipped")) == (
        "3",
        "1",
        "1",
        "0",
    )
    error, failure = suite.find(".//error"), suite.find(".//failure")
    assert error is not None and (error.get("type"), error.get("message")) == ("CONTRADICTION", "by 3 m")
    assert failure is not None and "expected PROVED" in str(failure.get("message"))
    assert [one.get("name") for one in suite.findall("testcase")] == ["a.x", "a.fine", "a.gone[pd]"]
    assert {one.get("name"): one.get("value") for one in suite[0]} == {"version": "1", "claims not made": "2"}


def test_what_a_changed_study_leaves_open_is_skipped_with_the_reason() -> None:
    """Expected PROVED as shipped, but no requirement: what was expected is no reason why it is open."""
    one = verdict("U", "P", role=Role.PRINTED)
    skipped = ET.fromstring(junit("a", "1", [one], [], Gate(changed=True))).find(".//skipped")
    assert skipped is not None and skipped.get("message") == one.method


def test_a_baseline_is_what_verify_wrote(tmp_path: Path) -> None:
    file = tmp_path / "verdicts.json"
    lacking = NotMade(claim="a.z", controller=None, statement="s", source="s", lacks="a horizon")
    written = [verdict("P").as_json(), verdict("R", controller="pd", case="slow").as_json(), lacking.as_json()]
    file.write_text(json.dumps(written))
    assert (
        baseline_of(file, "a")
        == baseline_of(file, "a", "slow")
        == {
            ("a.x", "default", None): Standing.PROVED,
            ("a.x", "slow", "pd"): Standing.REFUTED,
        }
    )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "which cannot be read: No such file"),
        ("", "which is no JSON"),
        ("\xff", "which is no JSON"),
        ("{}", "which holds no list of verdicts"),
        ("[3]", "whose entry 1 is no verdict"),
        ('[{"claim": "a.x", "case": "default", "controller": null}]', "whose entry 1 is no verdict"),
        ('[{"claim": "a.x", "case": "d", "controller": null, "standing": "GOOD"}]', "has the standing 'GOOD'"),
        ('[{"claim": "a.x", "case": "d", "controller": null, "standing": []}]', r"has the standing \[\]"),
        ('[{"claim": "a.x", "case": "d", "controller": 1, "standing": "PROVED"}]', "is no verdict"),
        ("[]", "which holds no verdict to compare with"),
        ('[{"claim": "a.x", "case": "slow", "controller": null, "standing": null}]', "no verdict to compare with"),
        (
            '[{"claim": "ab.x", "case": "slow", "controller": null, "standing": "PROVED"}]',
            "which speaks of ab, not of a: give one of this study",
        ),
        (
            '[{"claim": "a.x", "case": "d", "controller": null, "standing": "PROVED"}]',
            "which holds no verdict of case 'slow'; its cases are: d",
        ),
    ],
)
def test_a_bad_baseline_is_told_in_one_line(content: str | None, said: str, tmp_path: Path) -> None:
    file = tmp_path / "former.json"
    if content is not None:
        file.write_text(content, encoding="latin-1")
    with pytest.raises(InvalidValue, match=rf"a baseline is a verdicts.json .*former.json, .*{said}") as caught:
        baseline_of(file, "a", "slow")
    assert "\n" not in str(caught.value)


def test_a_folder_is_no_baseline(tmp_path: Path) -> None:
    with pytest.raises(InvalidValue, match="which cannot be read"):
        baseline_of(tmp_path, "a")
