"""What the paper published, beside what was measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from studies.ato.scores import FOUR, better_all_four, indices
from workbench.contracts.examination import Table
from workbench.trials.campaign import Campaign, run


def constant_delay_jerk(study: Any) -> float:
    """Return the largest jerk of FIPID on the curve when the dead time does not switch."""
    alone = dataclasses.replace(
        study, braking_delay=study.traction_delay, controllers={"fipid": study.controllers["fipid"]}
    )
    data = run(alone, show_progress=False).data
    return float(data["max_jerk"].values.max())


def tables(campaign: Campaign) -> list[Table]:
    """Return what the paper published beside what was measured, and the error integrals of every controller."""
    study, data = campaign.study, campaign.data
    if study.test != "curve" or not {"fipid", "bp-fipid"} <= set(data["controller"].values):
        return [_indices_table(data)]
    r = data["reference"].values[:-1]
    target = indices(r, r, float(study.plant.sampling_time))

    def middle(name: str, metric: str) -> str:
        return f"{float(np.median(data[metric].sel(controller=name))):.4f}"

    constant = constant_delay_jerk(study)
    curve = "the paper's curve is a lost figure; ours is made of raised cosines"
    rows = [
        ("largest jerk, FIPID (m/s^3)", "0.0656", middle("fipid", "max_jerk"),
         f"the switch of the dead time skips or repeats a command: without it {constant:.4f}"),
        ("largest jerk, target curve (m/s^3)", "0.0918", f"{target['max_jerk']:.4f}", curve),
        ("largest jerk, BP-FIPID (m/s^3)", "not given", middle("bp-fipid", "max_jerk"), "median over the seeds"),
        ("energy index, FIPID (m/s^2)", "0.0690", middle("fipid", "energy_index"),
         "the definition is lost: integral of |v a| over the distance is ours, and so is the curve"),
        ("energy index, target curve (m/s^2)", "0.0747", f"{target['energy_index']:.4f}", curve),
        ("energy index, BP-FIPID (m/s^2)", "0.0780", middle("bp-fipid", "energy_index"),
         "as above; the order FIPID, target, BP-FIPID is " + _order(data, target)),
        ("better on all four indices", "yes (one start)",
         f"{100 * better_all_four(data, 'bp-fipid', 'fipid'):.0f} % of seeds", "the start of the weights matters"),
    ]  # fmt: skip
    return [
        Table(title="Published and measured", header=("quantity", "published", "measured", "why"), rows=rows),
        _indices_table(data),
    ]


def _order(data: Any, target: Mapping[str, float]) -> str:
    fipid, bp = (float(np.median(data["energy_index"].sel(controller=name))) for name in ("fipid", "bp-fipid"))
    return "reproduced" if fipid < target["energy_index"] < bp else "not reproduced"


def _indices_table(data: Any) -> Table:
    rows = []
    for name in data["controller"].values:
        cells = [str(name)]
        for index in FOUR:
            low, middle, high = np.quantile(data[index].sel(controller=name).values, [0.1, 0.5, 0.9])
            cells.append(f"{middle:.4g}" if low == high else f"{middle:.4g} ({low:.4g} to {high:.4g})")
        rows.append(tuple(cells))
    return Table(
        title=f"Error integrals: median and 10-90 % range over {data.sizes['seed']} seed(s)",
        header=("controller", *(index.upper() for index in FOUR)),
        rows=rows,
    )
