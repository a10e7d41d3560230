"""What the paper published, beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence

from studies.maglev.evidence import Evidence
from studies.maglev.study import FLAT_LINE, LAGGING, LIMITED, NOISY, SHORT, WRONG
from workbench.contracts.claim import Expectations, Expected, Role
from workbench.contracts.examination import Table
from workbench.contracts.finding import Standing
from workbench.contracts.study import Scores

PUBLISHED_GAIN, PUBLISHED_STEP = 2e12, 1e-5
"""k_res as published, read in N per m/s, and the step of the published simulation in s."""

_WRONG = (*WRONG.values(), SHORT)
_BEHIND = "the argument knows no actuator: one with lag, dead time or limits in its equations would decide"
_NOISY = "the force is disturbed anew in every period: a bound of what noise adds would decide"
_OTHERWISE = "S and d_hat of different places are compared: an argument for a wrong period would decide"
_ALGEBRA = (
    Expected(standing=Standing.UNDECIDED, why=_BEHIND, cases=(LAGGING, LIMITED)),
    Expected(standing=Standing.UNDECIDED, why=_NOISY, cases=(NOISY,)),
    Expected(standing=Standing.UNDECIDED, why=_OTHERWISE, cases=_WRONG),
)
_RECURSION = (
    Expected(standing=Standing.UNDECIDED, why=_NOISY, cases=(NOISY,)),
    Expected(standing=Standing.UNDECIDED, why=_OTHERWISE, cases=_WRONG),
)
_PALC = ("palc",)

EXPECTED: Expectations = {
    "periodicity": (
        Expected(standing=Standing.SUPPORTED, why="positions repeat ever better, and with them the line resistance"),
        Expected(
            standing=Standing.REFUTED,
            why="behind lag and dead time palc diverges, so no position is passed twice",
            controllers=_PALC,
            cases=(LAGGING,),
        ),
    ),
    "positivity": (Expected(standing=Standing.PROVED, why="the gains are settings, and positive"),),
    "period_contraction": (
        Expected(standing=Standing.SUPPORTED, why="every harmonic's factor is at most 1.0009"),
        Expected(
            standing=Standing.REFUTED,
            why="with lag and dead time the loop's factor is 1.31",
            controllers=_PALC,
            cases=(LAGGING,),
        ),
        Expected(
            standing=Standing.REFUTED,
            why="without a line to learn the change at 5 Hz, some 1e-10 m/s, grows over the last periods before it "
            "falls again: other harmonics feed it through the resistance",
            controllers=_PALC,
            cases=(FLAT_LINE,),
        ),
        *_RECURSION,
    ),
    "period_contraction_lagging": (
        Expected(standing=Standing.REFUTED, why="the loop's factor is 1.31", controllers=_PALC, role=Role.OUTCOME),
        Expected(
            standing=Standing.SUPPORTED, why="filter and lead keep every factor below 1", controllers=("palc-filtered",)
        ),
        *_RECURSION,
    ),
    "saturation_windup": (
        Expected(standing=Standing.REFUTED, why="palc learns on where the force cannot follow", controllers=_PALC),
        Expected(
            standing=Standing.SUPPORTED,
            why="what it gathers while the force is limited is read 1 s elsewhere in the next period",
            controllers=_PALC,
            cases=(WRONG["1"],),
        ),
        Expected(
            standing=Standing.SUPPORTED,
            why="learning is frozen while the force is limited",
            controllers=("palc-filtered",),
        ),
    ),
    "error_dynamics": (
        Expected(standing=Standing.PROVED, why="the law compensates what it knows, which is the train itself"),
        *_ALGEBRA,
    ),
    "lyapunov_sampled": (
        Expected(standing=Standing.SUPPORTED, why="a sample of 10 ms is short beside the gains"),
        Expected(standing=Standing.REFUTED, why="the theorem knows no actuator", cases=(LAGGING, LIMITED)),
        Expected(standing=Standing.REFUTED, why="noise moves V besides", cases=(NOISY,)),
        Expected(standing=Standing.REFUTED, why="V compares d with what belongs elsewhere", cases=_WRONG),
        Expected(
            standing=Standing.REFUTED,
            why="without a line to learn V holds the newtons that holding the force costs, and no more",
            cases=(FLAT_LINE,),
        ),
    ),
    "lyapunov_identity": (
        Expected(
            standing=Standing.SUPPORTED,
            why="it is exact for a force that follows the errors at every instant and a periodic d; the run has both "
            "only nearly",
        ),
        *_ALGEBRA,
        Expected(
            standing=Standing.UNDECIDED,
            why="V is as small as what holding the force costs: an argument for held forces would decide",
            cases=(FLAT_LINE,),
        ),
    ),
    "lyapunov_printed": (
        Expected(
            standing=Standing.REFUTED,
            why="the learning within the period adds k/(2M) to alpha",
            published="dV/dt = -alpha S^2",
        ),
        *_ALGEBRA,
    ),
    "lyapunov_decrease": (
        Expected(standing=Standing.SUPPORTED, why="V falls by at least nine tenths of what the identity says"),
        Expected(
            standing=Standing.SUPPORTED, why="noise takes the most part of the fall, and not all of it", cases=(NOISY,)
        ),
        Expected(standing=Standing.REFUTED, why="palc diverges behind lag and dead time", cases=(LAGGING,)),
        Expected(standing=Standing.REFUTED, why="the learned resistance winds up at the limit", cases=(LIMITED,)),
        Expected(
            standing=Standing.REFUTED,
            why="what belongs elsewhere in the period is learned until V rises a little again",
            cases=_WRONG,
        ),
        Expected(
            standing=Standing.REFUTED,
            why="the few newtons that holding the force costs are learned, and V knows them not: d is zero",
            cases=(FLAT_LINE,),
        ),
    ),
    "gain_as_published": (
        Expected(standing=Standing.REFUTED, why="it needs a step below 1e-7 s", published="k = 2e12, step 1e-5 s"),
    ),
    "reversal": (
        Expected(standing=Standing.REFUTED, why="a grade pulls the same way whichever way the train goes"),
        Expected(standing=Standing.SUPPORTED, why="a flat line has no grade", cases=(FLAT_LINE,)),
    ),
    "noise_claim": (
        Expected(
            standing=Standing.REFUTED,
            why="noise is not periodic: what is stored of it disturbs the next period",
            published="0.03 m without, 0.01 m with noise",
        ),
        Expected(
            standing=Standing.SUPPORTED,
            why="the error is that of the limited force, tenths of a metre, and this one draw of noise lowers it",
            cases=(LIMITED,),
        ),
    ),
    "does_not_diverge": (Expected(standing=Standing.SUPPORTED, why="every law runs its periods, even where it grows"),),
    "conditioning": (
        Expected(
            standing=Standing.SUPPORTED,
            why="no law multiplies what is off by much more than 100; on a flat line, where errors are small, by 1e6",
        ),
    ),
    "error_falls": (
        Expected(standing=Standing.SUPPORTED, why="what is learned in a period is used in the next"),
        Expected(
            standing=Standing.REFUTED, why="a PID takes nothing from one period to the next", controllers=("pid",)
        ),
        Expected(
            standing=Standing.UNDECIDED,
            why="without a line there is nothing but rounding to fall: a line would decide",
            controllers=("pid",),
            cases=(FLAT_LINE,),
        ),
        Expected(
            standing=Standing.REFUTED,
            why="behind lag and dead time palc grows from period to period",
            controllers=_PALC,
            cases=(LAGGING,),
        ),
        Expected(
            standing=Standing.UNDECIDED,
            why="with a period that is wrong by a second the error soon stands still: more periods would decide",
            controllers=("palc", "palc-filtered"),
            cases=(WRONG["1"],),
        ),
        Expected(
            standing=Standing.UNDECIDED,
            why="it falls at once and then wanders: more periods would decide",
            controllers=("palc-filtered",),
            cases=(SHORT,),
        ),
    ),
}
"""How the claims stand in the cases as shipped."""


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
