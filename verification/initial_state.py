"""Initial-state learning: by what factor a law changes the initial error, from its own equations."""

from __future__ import annotations

from typing import Any

import casadi as ca

from workbench.controller import Task, Trial


def initial_factor(law: Any, outputs: int = 2) -> float | None:
    """Return d e_{k+1}(0) / d e_k(0) of the first output, exactly; None where it is not a constant.

    The law keeps what it moved the start by in the memory field ``moved`` (outputs, 1); every trial would begin in
    the same state without learning, and all states are measured without noise.
    """
    n = 3
    memory = law.start(Task(ca.SX.zeros(outputs, n + 1), 0.1))
    moved, x0 = ca.SX.sym("moved", outputs), ca.SX.sym("x0", outputs)
    r, later = ca.SX.sym("r", outputs, n + 1), ca.SX.sym("later", outputs, n)
    before = memory._replace(moved=moved)
    e = ca.horzcat(r[:, 0] - law.place(before, x0), later)
    after = law.learn(before, Trial(r, r - e, e, memory[0], ca.SX.ones(1, n + 1), ()))
    next_e = r[:, 0] - law.place(after, x0)
    factor = -ca.simplify(ca.jacobian(next_e, moved))[0, 0]  # e = r - x0 - moved, so de = -d(moved)
    return None if ca.symvar(factor) else float(ca.evalf(ca.SX(factor)))
