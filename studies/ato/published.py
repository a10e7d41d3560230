"""What the paper published, beside what was measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.ato.evidence import Evidence
from studies.ato.scores import FOUR, better_all_four, indices
from studies.ato.study import own
from workbench.contracts import settings
from workbench.contracts.examination import Table
from workbench.contracts.study import Study
from workbench.trials.campaign import run


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
