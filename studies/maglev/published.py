"""What the paper published, beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence

from studies.maglev.evidence import Evidence
from studies.maglev.study import LAGGING, NOISY, WRONG
from workbench.contracts.examination import Table
from workbench.contracts.study import Scores

PUBLISHED_GAIN, PUBLISHED_STEP = 2e12, 1e-5
"""k_res as published, read in N per m/s, and the step of the published simulation in s."""


def tables(evidence: Evidence) -> Sequence[Table]:
    """Return what the paper published beside what was measured."""
    scores = evidence.campaign.scores()
    noisy = evidence.variant(case=NOISY).scores()
    lagging = evidence.variant(case=LAGGING).scores()

    def shown(table: Scores, name: str, metric: str, unit: str) -> str:
        value = table.get(name, {}).get(metric)
        return f"{name}: -" if value is None else f"{name}: {value:.3g} {unit}"

    def all_of(table: Scores, metric: str, unit: str, names: Sequence[str]) -> str:
        return "; ".join(shown(table, name, metric, unit) for name in names if name in table)

    error, names = "max_position_error_last", list(scores)
    ratio = "-"
    pid, palc = (scores.get(name, {}).get("itae_last") for name in ("pid", "palc"))
    if pid and palc:
        ratio = f"{pid / palc:.0f}"
    rows = [
        ("max position error, PID", "3.12 m", all_of(scores, error, "m", ["pid"]), "the line is ours, chosen near it"),
        (
            "max position error, PALC, last period",
            "0.03 m",
            all_of(scores, error, "m", evidence.learners),
            "sixteen periods of learning from lost gains: ours",
        ),
        ("ITAE, PID over PALC", "plotted only", ratio, ""),
        (
            "energy against PID",
            "-0.2 %",
            all_of(scores, "energy_change_percent", "%", evidence.learners),
            "the sign is robust; the size depends on the line",
        ),
        (
            "max position error under noise",
            "3.22 m, 0.01 m",
            all_of(noisy, error, "m", names),
            "published as better with noise than without; noise cannot be learned",
        ),
        ("lag 0.4 s, dead time 0.6 s", "not considered", all_of(lagging, error, "m", names), "a loop gain above 1"),
    ]
    for wrong, case in WRONG.items():
        table = evidence.variant(case=case).scores()
        rows.append((f"period wrong by {wrong} s", "not considered", all_of(table, error, "m", evidence.learners), ""))
    header = ("quantity", "published", "measured", "why they differ")
    return [Table(title="Published and measured", header=header, rows=rows)]
