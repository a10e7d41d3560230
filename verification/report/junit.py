"""Verdicts as JUnit XML, which build servers read: one test case a verdict."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from verification.report.notation import clean
from workbench.contracts.verdict import DEFAULT, Standing, Verdict


def junit(study: str, version: str, verdicts: Sequence[Verdict]) -> str:
    """Return ``verdicts.xml``: REFUTED is a failure, UNDECIDED an error, anything else passes.

    The class of every test case is the study, then its case where that is not the default; its name is the claim,
    with the controller in brackets.
    """
    counts = {
        "tests": len(verdicts),
        "failures": sum(one.standing is Standing.REFUTED for one in verdicts),
        "errors": sum(one.standing is Standing.UNDECIDED for one in verdicts),
    }
    attributes = {name: str(number) for name, number in counts.items()}
    root = ET.Element("testsuites", {"name": "workbench", **attributes, "time": "0"})
    suite = ET.SubElement(root, "testsuite", {"name": clean(study), **attributes, "skipped": "0", "time": "0"})
    properties = ET.SubElement(suite, "properties")
    ET.SubElement(properties, "property", {"name": "version", "value": clean(version)})
    for one in verdicts:
        name = f"{one.claim}[{one.controller}]" if one.controller else one.claim
        case = ET.SubElement(
            suite,
            "testcase",
            {
                "classname": clean(study if one.case == DEFAULT else f"{study}.{one.case}"),
                "name": clean(name),
                "time": "0",
            },
        )
        text = clean(_text(one))
        if one.standing in (Standing.REFUTED, Standing.UNDECIDED):
            kind = "failure" if one.standing is Standing.REFUTED else "error"
            message = one.statement if one.standing is Standing.REFUTED else one.method
            described = {"message": clean(f"{one.standing}: {message}"), "type": str(one.standing)}
            ET.SubElement(case, kind, described).text = text
        else:
            ET.SubElement(case, "system-out").text = text
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _text(one: Verdict) -> str:
    said = one.as_json()
    margin = [] if said["margin"] is None else [f"margin: {said['margin']:.6g} {one.unit}".rstrip()]
    witness = [f"witness: {json.dumps(said['witness'])}"] if said["witness"] else []
    return "\n".join(
        [
            f"{one.standing}: {one.statement}",
            f"source: {one.source}",
            f"method: {one.method}",
            *margin,
            *witness,
        ]
    )
