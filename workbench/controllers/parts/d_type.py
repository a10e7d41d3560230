"""What D-type laws with initial-state learning share: memory, first plan, slope of the error, learned start.

Outputs are position and speed, the one input a force per mass (nominal input gain 1). Patent application, Nanjing
Institute of Technology, 2017, (3), (5).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from models.expression import Expression
from workbench.contracts.law import Task, Trial
from workbench.controllers.parts.rows import known, zeros


class Memory(NamedTuple):
    """The plan of the trial to come, (1, N), what the start was moved by, (outputs, 1), and the sampling time."""

    F: Expression
    moved: Expression
    sampling_time: Expression


def first(task: Task) -> Memory:
    """Return the task's first plan, else the reference's acceleration, mean over every sample; no start was moved."""
    v = task.reference[1, :]
    acceleration = (v[1:] - v[:-1]) / task.sampling_time
    F = acceleration if task.first_plan is None else task.first_plan
    return Memory(F, zeros(2), task.sampling_time)


def rise(trial: Trial[tuple[()]], output: int) -> Expression:
    """Return how much an output's error grows over every sample, (1, N), 0 where the trial did not reach its end."""
    e = known(trial.reached, trial.e[output, :])
    return known(trial.reached[1:], e[1:] - e[:-1])


def placed(memory: Memory, x0: Expression) -> Expression:
    """Return the initial state: position and speed as learned, what an actuator holds as it is."""
    own = memory.moved.shape[0]
    return ca.vertcat(x0[:own] + memory.moved, x0[own:])


def moved(memory: Memory, trial: Trial[tuple[()]], lam0: float, learning: bool) -> Expression:
    """Return what the next start is moved by, (outputs, 1)."""
    return memory.moved + lam0 * trial.e[:, 0] if learning else memory.moved  # (5)
