"""How a law turns errors into input changes: L, by differentiating its own ``learn``.

L is the derivative of the next plan by the errors, the estimate and all else held: between trials the input
changes by L e, so with the lifted plant G the error goes as e_next = (I - G L) e.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

from workbench.contracts.law import Task, Trial
from workbench.evidence.trajectory import trials_done
from workbench.fold.fold import stream
from workbench.trials.campaign import Campaign

BANDED = 20  # entries a row


def memories(campaign: Campaign, controller: str) -> Iterator[tuple[Any, Any, int]]:
    """Run a controller's trials again; yield the memory each was run with, its record and its length."""
    study = campaign.study
    fold = study.fold(controller)
    done = trials_done(campaign, controller)
    inputs = study.inputs()[:done]
    for one, left in zip(
        inputs,
        stream(fold, study.reference_samples, inputs, carry_state=study.continues, keep_memory=True),
        strict=True,
    ):
        yield left.memory, left, one.length


def gain(campaign: Campaign, controller: str, memory: Any, left: Any, length: int) -> Any:
    """Return L after a trial as a sparse (N, N + 1) matrix, inputs by errors of samples 0..N.

    ``memory`` is that of the trial, ``left`` its record, ``length`` its last sample. The first input and output
    are meant. None where the gain is not banded: a law that filters its whole plan does not change it by L e alone.
    """
    study = campaign.study
    law, n = study.controllers[controller], study.horizon
    r = study.reference_samples
    reached = (np.arange(n + 1) <= length).astype(float)[None, :]
    y = np.where(reached > 0, left.y, np.nan)
    e = ca.MX.sym("e", *r.shape)
    task_memory = law.start(Task(ca.DM(r), study.plant.sampling_time, study.plant.input_limits))
    kept = type(task_memory)(*(ca.MX(ca.DM(value)) for value in memory))
    trial = Trial(ca.DM(r), ca.MX(ca.DM(y)), e, ca.MX(ca.DM(left.u)), ca.DM(reached), ())
    plan = _plan(law, law.learn(kept, trial), r, n)
    if ca.jacobian_sparsity(plan, e).nnz() > BANDED * n:
        return None
    slope = ca.Function("learning_gain", [e], [ca.jacobian(plan, e)])
    value = slope(np.where(reached > 0, r - y, 0.0))
    pattern = value.sparsity()
    matrix = sparse.csc_matrix(
        (np.array(value.nonzeros()), np.array(pattern.row()), np.array(pattern.colind())), shape=value.shape
    )
    return matrix[:, :: r.shape[0]]


def _plan(law: Any, memory: Any, r: Any, n: int) -> Any:
    """Return the first input planned at every sample, (1, N), as an expression of the memory."""
    columns = [ca.SX.sym(f"m{i}", field.shape[0]) for i, field in enumerate(memory)]
    now, following = ca.SX.sym("r", r.shape[0]), ca.SX.sym("r_next", r.shape[0])
    u, _ = law.act(type(memory)(*columns), (), now, following, ca.SX.sym("y", r.shape[0]))
    first = u[0] if isinstance(u, (tuple, list)) else ca.SX(u)[0]
    one = ca.Function("plan", [*columns, now, following], [first], {"allow_free": False})
    rows = [ca.repmat(field, 1, n) if field.shape[1] == 1 else field[:, :n] for field in memory]
    return one.map(n)(*rows, r[:, :n], r[:, 1:])
