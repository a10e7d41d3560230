"""Claims, evidence and reports."""

from verification.examination import Examination, Figure, Report, Table, verify
from verification.typeset import latex
from verification.verdict import Claim, Finding, Standing, Verdict

__all__ = ["Claim", "Examination", "Figure", "Finding", "Report", "Standing", "Table", "Verdict", "latex", "verify"]
