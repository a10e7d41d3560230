"""The campaign finds nothing on sound tubes, and does find what negative controls break."""

from __future__ import annotations

import numpy as np
import pytest
from brake_tubes import TUBES, brake_tube

from models.quantity import InvalidValue
from verification.checks.feasibility import campaign, simulate
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC


@pytest.mark.parametrize("name", sorted(TUBES))
@pytest.mark.parametrize("law", [RMPC, RSMPC])
def test_sound_tubes_stay_feasible(name, law):
    tube = TUBES[name]()
    controller = law(tube=tube, N=3)
    problem = controller.problem if law is RMPC else controller.problem(1)
    found = campaign(controller, problem, tube.plant, tube.bounds, runs=12, seed=1)
    assert (found.infeasible, found.violated, found.failed, found.witness) == (0, 0, 0, None)
    assert found.worst_violation <= 1e-9


@pytest.mark.parametrize("control", ["index_off_by_one", "ignore_delay"])
def test_negative_controls_fail_and_their_witness_can_be_replayed(control):
    tube = brake_tube(**{control: True})
    law = RMPC(tube=tube, N=15)
    found = campaign(law, law.problem, tube.plant, tube.bounds, until_first=True)
    assert found.witness is not None and found.runs == found.witness.number + 1 < 200
    again = simulate(law, tube.plant, tube.bounds, found.witness.e, disturb=found.witness.w)
    assert again.infeasible_at == found.witness.infeasible_at and bool(again.lost) == (again.infeasible_at is not None)
    assert found.failed == 1
    assert np.isclose(again.violation, found.witness.violation)
    assert again.infeasible_at is not None or again.violation > 1e-7


def test_runs_end_where_they_should(brake_a):
    law = RMPC(tube=brake_a, N=3)
    w = brake_a.plant.W.sample(20 + brake_a.plant.delay, seed=0)
    run = simulate(law, brake_a.plant, brake_a.bounds, np.zeros(4), disturb=w)
    assert run.e.shape == run.x.shape == (21, 4)
    x = run.x[0]  # from the true error at k+l on, the plant's own equation must hold
    for k in range(20):
        du = (run.e[k + 1] - brake_a.plant.A @ run.e[k] - brake_a.plant.A_delay @ w[k])[1]
        x = brake_a.plant.A @ x + brake_a.plant.b * du + w[k + brake_a.plant.delay]
        assert np.allclose(x, run.x[k + 1], atol=1e-9)
    with pytest.raises(InvalidValue, match="runs must be at least 1, got 0"):
        campaign(law, law.problem, brake_a.plant, brake_a.bounds, runs=0)
