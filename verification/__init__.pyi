from verification.decide.replay import Replay as Replay
from verification.decide.replay import replay as replay
from verification.decide.verify import verify as verify
from verification.report.typeset import latex as latex
from verification.report.write import Report as Report
from workbench.contracts.claim import Claim as Claim
from workbench.contracts.examination import Examination as Examination
from workbench.contracts.examination import Figure as Figure
from workbench.contracts.examination import Table as Table
from workbench.contracts.finding import Finding as Finding
from workbench.contracts.finding import Standing as Standing
from workbench.contracts.verdict import Verdict as Verdict

__all__ = [
    "Claim",
    "Examination",
    "Figure",
    "Finding",
    "Replay",
    "Report",
    "Standing",
    "Table",
    "Verdict",
    "latex",
    "replay",
    "verify",
]
