"""How a law turns errors into input changes: L, by differentiating its own ``learn``.

L is the derivative of the next plan by the errors, the estimate and all else held: between trials the input
changes by L e, so with the lifted plant G the error goes as e_next = (I - G L) e.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from scipy import sparse

from models.array import Array
from models.expression import Expression, as_expression
from models.quantity import InvalidValue
from workbench.contracts.law import AnyLaw, Trial
from workbench.contracts.record import TrialRecord
from workbench.evidence.trajectory import trials_done
from workbench.trials.campaign import Campaign

BANDED = 20  # entries a row


def memories(campaign: Campaign, controller: str) -> Iterator[tuple[tuple[Array, ...], TrialRecord]]:
    """Run a controller's trials again; yield the memory each was run with, and its record."""
    inputs = campaign.study.inputs()[: trials_done(campaign, controller)]
    for left in campaign.runner(controller).trials(inputs, keep_memory=True):
        yield left.memory, left


def gain(
    campaign: Campaign,
    controller: str,
    memory: tuple[Array, ...],
    left: TrialRecord,
    length: int,
    *,
    output: str | None = None,
) -> sparse.csc_matrix[np.float64] | None:
    """Return L after a trial as a sparse (N, N + 1) matrix, the input by errors of samples 0..N.

    ``memory`` is that of the trial, ``left`` its record, ``length`` its last sample; of several outputs ``output``
    names the one whose errors are meant. None where the gain is not banded: a law that filters its whole plan does
    not change it by L e alone. Raises InvalidValue for a plant with several inputs, and for an unknown output.
    """
    row = _row(campaign, output)
    study = campaign.study
    runner, n = campaign.runner(controller), study.horizon
    law = runner.law
    r = study.reference_samples
    reached = (np.arange(n + 1) <= length).astype(float)[None, :]
    y = np.where(reached > 0, left.y, np.nan)
    e = as_expression(ca.MX.sym("e", *r.shape))
    task_memory = law.start(runner.task)
    kept = type(task_memory)(*(as_expression(ca.MX(ca.DM(value))) for value in memory))
    rows = [as_expression(one) for one in (ca.DM(r), ca.MX(ca.DM(y)), e, ca.MX(ca.DM(left.u)), ca.DM(reached))]
    trial = Trial(rows[0], rows[1], rows[2], rows[3], rows[4], ())
    plan = _plan(law, law.learn(kept, trial), r, n)
    if ca.jacobian_sparsity(plan, e).nnz() > BANDED * n:
        return None
    slope = ca.Function("learning_gain", [e], [ca.jacobian(plan, e)])
    value = slope(np.where(reached > 0, r - y, 0.0))
    pattern = value.sparsity()
    matrix = sparse.csc_matrix(
        (np.array(value.nonzeros()), np.array(pattern.row()), np.array(pattern.colind())), shape=value.shape
    )
    return sparse.csc_matrix(matrix[:, row :: r.shape[0]])


def _row(campaign: Campaign, output: str | None) -> int:
    """Return which of the outputs is meant."""
    plant = campaign.study.plant_that_runs
    names = [signal.name for signal in plant.outputs]
    if len(plant.inputs) > 1:
        raise InvalidValue(f"the learning gain is that of one input, {plant.name} has {len(plant.inputs)}")
    if output is None and len(names) == 1:
        return 0
    if output not in names:
        raise InvalidValue(f"output must be one of: {', '.join(names)}; got {output!r}")
    return names.index(output)


def _plan(law: AnyLaw, memory: tuple[Expression, ...], r: Array, n: int) -> Expression:
    """Return the input planned at every sample, (1, N), as an expression of the memory."""
    columns = [ca.SX.sym(f"m{i}", field.shape[0]) for i, field in enumerate(memory)]
    now, following = ca.SX.sym("r", r.shape[0]), ca.SX.sym("r_next", r.shape[0])
    u, _ = law.act(type(memory)(*columns), (), now, following, ca.SX.sym("y", r.shape[0]))
    one = ca.Function("plan", [*columns, now, following], [u[0]], {"allow_free": False})
    rows = [ca.repmat(field, 1, n) if field.shape[1] == 1 else field[:, :n] for field in memory]
    return one.map(n)(*rows, r[:, :n], r[:, 1:])
