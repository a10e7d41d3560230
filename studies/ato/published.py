"""What the paper published, beside what was measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.ato.evidence import Evidence
from studies.ato.scores import FOUR, better_all_four, indices
from studies.ato.study import own
from workbench.contracts import settings
from workbench.contracts.claim import Expectations, Expected
from workbench.contracts.examination import Table
from workbench.contracts.finding import Standing
from workbench.contracts.study import Study
from workbench.trials.campaign import run

P, S, R = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED
EXPECTED: Expectations = {
    "relative_degree": (Expected(standing=P, why="a dead time of 4 or 5 samples lies between u(k) and y"),),
    "relative_degree.dead_time": (
        Expected(standing=P, why="the dead time of the step does not switch"),
        Expected(
            standing=R,
            why="where the dead time gets shorter a command is skipped, where it gets longer one comes late",
            cases=("curve",),
        ),
    ),
    "relative_degree.printed": (
        Expected(standing=R, why="the dead time makes the derivative of the next output zero"),
    ),
    "f_continuous": (
        Expected(standing=R, why="the mean of maxima jumps at du = 0"),
        Expected(standing=P, why="the smooth form is made of tanh", controllers=("fipid-smooth",)),
    ),
    "critical_gain": (
        Expected(standing=S, why="p1 - p2 f is at most 2 and seldom near it; the critical gain is above 2.1"),
        Expected(
            standing=R,
            why="the best gain of the grid for the ISE of the curve uses up the margin of stability",
            controllers=("fixed-best",),
            cases=("curve",),
        ),
    ),
    "jerk_limit": (
        Expected(standing=S, why="the curve is gentle, and the switch of the dead time adds about 0.3 m/s^3"),
        Expected(
            standing=S,
            why="the curve is gentle, and the switch of the dead time adds about 0.3 m/s^3",
            controllers=("fipid",),
            published="0.0656 m/s^3, below 0.75 m/s^3",
        ),
    ),
    "sign_of_slope": (
        Expected(standing=R, why="the output follows an input of 5 or 6 samples ago, not the one that just changed"),
    ),
    "network_learns": (
        Expected(standing=R, why="200 samples of a unit step are too few to move the weights"),
        Expected(standing=S, why="2175 samples with errors up to meters per second move them", cases=("curve",)),
    ),
    "better_than_fixed_gain": (
        Expected(standing=R, why="the network's gain ends where a fixed one may begin, and is less than the best"),
    ),
    "better_than_fipid": (
        Expected(
            standing=R,
            why="about one start in five gives a gain no larger than FIPID's",
            published="better on all four (one start)",
        ),
        Expected(
            standing=S,
            why="FIPID's gain is small for the curve, and every start learns a larger one",
            cases=("curve",),
            published="better on all four (one start)",
        ),
    ),
    "does_not_diverge": (Expected(standing=Standing.SUPPORTED, why="every gain is far from one that diverges"),),
    "conditioning": (
        Expected(standing=S, why="one run with feedback that forgets"),
        Expected(
            standing=R,
            why="the mean of maxima jumps at du = 0, where the step begins: any change takes the other side",
            controllers=("fipid", "bp-fipid", "bp-frozen", "fixed-best"),
            cases=("default",),
        ),
    ),
}
"""How the claims are expected to stand in the step test, the study as declared, and in the case curve."""


def constant_delay_jerk(study: Study) -> float:
    """Return the largest jerk of FIPID on the curve when the dead time does not switch."""
    fipid = {"fipid": own(study).controllers["fipid"]}
    changes = {"braking_delay": own(study).traction_delay, "controllers": fipid, "draws": 1}
    data = run(settings.changed(study, changes), show_progress=False).data
    return float(data["max_jerk"].values.max())


def tables(evidence: Evidence) -> list[Table]:
    """Return what the paper published beside what was measured, and the error integrals of every controller."""
    study = evidence.study
    if not own(study).curve or not {"fipid", "bp-fipid"} <= set(study.controllers):
        return [_indices_table(evidence)]
    r = study.reference_samples[0, :-1]
    target = indices(r, r, float(study.plant.sampling_time))

    def middle(name: str, metric: str) -> str:
        return f"{float(np.median(evidence.metric(name, metric))):.4f}"

    constant = constant_delay_jerk(study)
    curve = "the paper's curve is a lost figure; ours is made of raised cosines"
    rows = [
        ("largest jerk, FIPID (m/s^3)", "0.0656", middle("fipid", "max_jerk"),
         f"the switch of the dead time skips or repeats a command: without it {constant:.4f}"),
        ("largest jerk, target curve (m/s^3)", "0.0918", f"{target['max_jerk']:.4f}", curve),
        ("largest jerk, BP-FIPID (m/s^3)", "not given", middle("bp-fipid", "max_jerk"), "median over the draws"),
        ("energy index, FIPID (m/s^2)", "0.0690", middle("fipid", "energy_index"),
         "the definition is lost: integral of |v a| over the distance is ours, and so is the curve"),
        ("energy index, target curve (m/s^2)", "0.0747", f"{target['energy_index']:.4f}", curve),
        ("energy index, BP-FIPID (m/s^2)", "0.0780", middle("bp-fipid", "energy_index"),
         "as above; the order FIPID, target, BP-FIPID is " + _order(evidence, target)),
        ("better on all four indices", "yes (one start)",
         f"{100 * better_all_four(evidence.drawn, 'bp-fipid', 'fipid'):.0f} % of draws",
         "the start of the weights matters"),
    ]  # fmt: skip
    return [
        Table(title="Published and measured", header=("quantity", "published", "measured", "why"), rows=rows),
        _indices_table(evidence),
    ]


def _order(evidence: Evidence, target: Mapping[str, float]) -> str:
    fipid, bp = (float(np.median(evidence.metric(name, "energy_index"))) for name in ("fipid", "bp-fipid"))
    return "reproduced" if fipid < target["energy_index"] < bp else "not reproduced"


def _indices_table(evidence: Evidence) -> Table:
    rows = []
    for name in evidence.study.controllers:
        cells = [name]
        for index in FOUR:
            low, middle, high = np.quantile(evidence.metric(name, index), [0.1, 0.5, 0.9])
            cells.append(f"{middle:.4g}" if low == high else f"{middle:.4g} ({low:.4g} to {high:.4g})")
        rows.append(tuple(cells))
    return Table(
        title=f"Error integrals: median and 10-90 % range over {evidence.drawn.sizes['draw']} draw(s)",
        header=("controller", *(index.upper() for index in FOUR)),
        rows=rows,
    )
