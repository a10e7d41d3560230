"""The studies without a test of their own for it stand in every case as is written down."""

from __future__ import annotations

import pytest
from report_text import faults, reasons

from studies.metro.study import STUDY as METRO
from studies.same_plant.study import STUDY as SAME_PLANT
from verification.decide.verify import verify
from workbench.contracts.settings import in_case
from workbench.trials.campaign import run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("study", "case"),
    [*((METRO, case) for case in ("", *METRO.cases)), (SAME_PLANT, "")],
    ids=["metro", *METRO.cases, "same-plant"],
)
def test_every_claim_stands_as_is_expected(study, case):
    report = verify(run(in_case(study, case), show_progress=False), show_progress=False)
    assert [(one.label, one.controller) for one in report.verdicts if one.expected is None] == []
    assert [(one.label, one.controller, one.standing) for one in report.verdicts if one.departs] == []
    assert [(one.label, one.controller) for one in report.verdicts if one.left_open] == []
    assert not faults(report) and not reasons(report)
