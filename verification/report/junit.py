"""Verdicts as JUnit XML, which build servers read: one test case a verdict."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence

from verification.report.gate import Departure, Gate
from verification.report.notation import clean
from verification.report.words import evidence
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import DEFAULT, NotMade, Verdict

CONTRADICTION = "CONTRADICTION"
COUNTED = {"failure": "failures", "error": "errors", "skipped": "skipped"}
"""The attribute of a suite that counts an element of its test cases."""


def junit(study: str, version: str, verdicts: Sequence[Verdict], not_made: Sequence[NotMade], gate: Gate) -> str:
    """Return ``verdicts.xml``: a test fails where a verdict departs from what is expected.

    A proof that runs contradict and an UNDECIDED that was not expected are errors, any other departure is a failure,
    an UNDECIDED that was expected is skipped, and anything else passes: what is REFUTED as expected with properties
    that say so. Contradictions come first. A verdict of the baseline that is no longer there is a failure too. Claims
    that were not made are counted in a property of the suite. The class of every test case is the study, then its
    case where that is not the default; its name is the claim, with the controller in brackets.
    """
    root = ET.Element("testsuites", {"name": "workbench"})
    suite = ET.SubElement(root, "testsuite", {"name": clean(study)})
    properties = ET.SubElement(suite, "properties")
    _property(properties, "version", version)
    _property(properties, "claims not made", str(len(not_made)))
    for one in sorted(verdicts, key=lambda one: not one.contradiction):
        case = _test_case(suite, study, one.key)
        departure = gate.departure(one)
        if departure is None and one.standing is Standing.REFUTED and one.expected is not None:
            told = ET.SubElement(case, "properties")
            _property(told, "expected", str(one.expected.standing))
            _property(told, "because", one.expected.why)
        _outcome(case, one, gate, departure)
    for gone in gate.gone(verdicts, not_made):
        described = {"message": clean(gone.what), "type": "GONE"}
        ET.SubElement(_test_case(suite, study, gone.key), "failure", described).text = clean(gone.line)
    counts = Counter(COUNTED[inner.tag] for inner in suite.iter() if inner.tag in COUNTED)
    tests = {"tests": str(len(suite.findall("testcase")))}
    whole = {**tests, "failures": str(counts["failures"]), "errors": str(counts["errors"])}
    root.attrib |= {**whole, "time": "0"}
    suite.attrib |= {**whole, "skipped": str(counts["skipped"]), "time": "0"}
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _test_case(suite: ET.Element, study: str, key: tuple[str, str, str | None]) -> ET.Element:
    claim, case, controller = key
    described = {
        "classname": clean(study if case == DEFAULT else f"{study}.{case}"),
        "name": clean(f"{claim}[{controller}]" if controller else claim),
        "time": "0",
    }
    return ET.SubElement(suite, "testcase", described)


def _outcome(case: ET.Element, one: Verdict, gate: Gate, departure: Departure | None) -> None:
    """Add how a verdict came out to its test case."""
    text = clean(_text(one))
    if one.contradiction:
        described = {"message": clean(one.contradiction), "type": CONTRADICTION}
        ET.SubElement(case, "error", described).text = text
    elif gate.leaves_open(one):
        said = one.method if departure is None else f"{departure.what}: {one.method}"
        described = {"message": clean(f"{one.standing}: {said}"), "type": str(one.standing)}
        ET.SubElement(case, "error", described).text = text
    elif departure is not None:
        described = {"message": clean(f"{departure.what}: {one.statement}"), "type": str(one.standing)}
        ET.SubElement(case, "failure", described).text = text
    else:
        if one.standing is Standing.UNDECIDED:
            awaited = one.expected is not None and one.expected.standing is Standing.UNDECIDED
            why = one.expected.why if one.expected is not None and awaited else one.method
            ET.SubElement(case, "skipped", {"message": clean(why)})
        ET.SubElement(case, "system-out").text = text


def _property(above: ET.Element, name: str, value: str) -> None:
    ET.SubElement(above, "property", {"name": name, "value": clean(value)})


def _text(one: Verdict) -> str:
    said = one.as_json()
    margin = [] if said["margin"] is None else [f"margin: {said['margin']:.6g} {one.unit}".rstrip()]
    witness = [f"witness: {json.dumps(said['witness'])}"] if said["witness"] else []
    rests = [f"evidence: {'; '.join(evidence(one))}"] if evidence(one) else []
    return "\n".join(
        [
            f"{one.standing}: {one.statement}",
            f"role: {one.role}",
            f"source: {one.source}",
            f"method: {one.method}",
            *margin,
            *rests,
            *witness,
        ]
    )
