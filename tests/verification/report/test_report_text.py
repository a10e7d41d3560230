"""No text of a report speaks the words of a program."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from report_text import faults, reasons, texts

from verification import Claim, Examination, Report, Table, verify
from workbench.contracts.finding import Finding, undecided


@pytest.fixture
def plain_report(lag_report: Any) -> Report:
    """The hand-made report without its study's figures."""
    assert isinstance(lag_report, Report)
    return lag_report


def test_the_hand_made_report_has_no_fault(plain_report: Report) -> None:
    assert faults(plain_report) == [] and reasons(plain_report) == ["lag.A4"]
    assert {at for at, _ in texts(plain_report)} >= {"conclusion", "terminal", "lag.A5, not made"}


@pytest.mark.parametrize(
    "text",
    [
        "it grows by nan", "inf times", "NaN of 3", "Traceback (most recent call last)", "Factor is exactly singular",
        "LinAlgError: Singular matrix", "got array([1.0])", "np.float64(3.0)", "<function f at 0x7f3a1c2b>",
        "casadi/core/function.cpp:123", "RuntimeError: no", "takes 2 positional arguments", "-Infinity",
    ],
)  # fmt: skip
@pytest.mark.parametrize("where", ["method", "conclusion", "table", "lacks", "why"])
def test_a_planted_fault_is_seen(plain_report: Report, text: str, where: str) -> None:
    one = plain_report.verdicts[1]
    assert one.expected is not None
    changes: dict[str, dict[str, Any]] = {
        "method": {"verdicts": [dataclasses.replace(one, method=text)]},
        "conclusion": {"conclusion": [text]},
        "table": {"tables": [Table(title="t", header=["a"], rows=[["b"], [text]])]},
        "lacks": {"not_made": [dataclasses.replace(plain_report.not_made[0], lacks=text)]},
        "why": {"verdicts": [dataclasses.replace(one, expected=dataclasses.replace(one.expected, why=text))]},
    }
    assert faults(dataclasses.replace(plain_report, **changes[where]))


@pytest.mark.parametrize(
    "text", ["nano", "the infimum", "infinite", "error: 3 m", "the program met KeyError, see its log", "information"]
)
def test_plain_words_are_no_fault(plain_report: Report, text: str) -> None:
    assert faults(dataclasses.replace(plain_report, conclusion=[text])) == []


def broken() -> Any:
    raise np.linalg.LinAlgError("Singular matrix")


def test_what_a_library_says_reaches_no_text(plain_report: Report) -> None:
    """Figures, tables, scores and conclusion that end in an error, and numbers that are none."""
    numbers = [
        Finding(margin=-np.inf, bound=np.nan, unit="m", bound_unit="m", witness={"k": np.nan}),
        Finding(margin=np.inf, bound=np.inf, unit="m"),
        undecided("budget", margin=np.nan, unit="m", k=np.inf),
    ]
    claims = [
        Claim(name=f"lag.{i}", statement="s", source="s", check=lambda one=one: one, lacks="")
        for i, one in enumerate(numbers)
    ]
    claims.append(Claim(name="lag.broken", statement="s", source="s", check=broken))
    made = verify(
        plain_report.campaign,
        Examination(claims=claims, conclude=lambda _: broken(), figures=broken, tables=broken, scores=broken),
        show_progress=False,
    )
    assert faults(made) == []
    assert len([one for one in made.conclusion if "the program met LinAlgError, see its log" in one]) == 4
