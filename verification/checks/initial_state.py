"""Initial-state learning: by what factor a law changes the initial error, from its own equations."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from models.array import Array
from workbench.contracts.law import AnyLaw, Task, Trial
from workbench.contracts.study import Study
from workbench.contracts.verdict import Finding, Standing
from workbench.trials.simulation import runner_of


def initial_factor(law: AnyLaw, outputs: int = 2) -> float | None:
    """Return d e_{k+1}(0) / d e_k(0) of the first output, exactly; None where it is not a constant.

    The law keeps what it moved the start by in the memory field ``moved`` (outputs, 1); every trial would begin in
    the same state without learning, and all states are measured without noise.
    """
    n = 3
    memory = law.start(Task(ca.SX.zeros(outputs, n + 1), ca.SX(0.1)))
    moved, x0 = ca.SX.sym("moved", outputs), ca.SX.sym("x0", outputs)
    r, later = ca.SX.sym("r", outputs, n + 1), ca.SX.sym("later", outputs, n)
    before = memory._replace(moved=moved)
    e = ca.horzcat(r[:, 0] - law.place(before, x0), later)
    after = law.learn(before, Trial(r, r - e, e, memory[0], ca.SX.ones(1, n + 1), ()))
    next_e = r[:, 0] - law.place(after, x0)
    factor = -ca.simplify(ca.jacobian(next_e, moved))[0, 0]  # e = r - x0 - moved, so de = -d(moved)
    return None if ca.symvar(factor) else float(ca.evalf(ca.SX(factor)))


def converges_from(study: Study, controller: str, starts: Array, tolerances: Sequence[float]) -> Finding:
    """Run all trials of a study from every start, shape (starts, states), and look at the last trial's errors.

    ``tolerances`` are the largest errors allowed, one an output; the start that comes nearest to them is the witness.
    """
    runner, r, inputs = runner_of(study, controller), study.reference_samples, study.inputs()
    worst, witness = -np.inf, {}
    for start in starts:
        *_, left = runner.trials([one._replace(x0=start) for one in inputs])
        last = np.abs(r - left.y).max(axis=1)
        share = float((last / np.asarray(tolerances)).max()) if np.isfinite(last).all() else np.inf
        if share >= worst:
            worst, witness = share, {"start": start, "largest_errors_of_the_last_trial": last}
    return Finding(
        standing=Standing.SUPPORTED if worst < 1 else Standing.REFUTED,
        method=f"{len(inputs)} trials from each of {len(starts)} starts drawn from the study's seed; the tightest is "
        "the witness",
        margin=1 - worst,
        unit="share of the tolerance",
        witness=witness,
    )
