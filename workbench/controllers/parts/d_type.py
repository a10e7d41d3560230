"""What D-type laws with initial-state learning share: memory, first plan, slope of the error, learned start.

Outputs are position and speed, the one input a force per mass (nominal input gain 1). Patent application, Nanjing
Institute of Technology, 2017, (3), (5).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from workbench.contracts.law import Task, Trial
from workbench.controllers.parts.rows import known


class Memory(NamedTuple):
    """The plan of the trial to come, (1, N), what the start was moved by, (outputs, 1), and the sampling time."""

    F: Any
    moved: Any
    sampling_time: Any


def first(task: Task) -> Memory:
    """Return the reference's acceleration, mean over every sample, and a start that was not moved."""
    v = task.reference[1, :]
    return Memory((v[1:] - v[:-1]) / task.sampling_time, ca.DM.zeros(2, 1), task.sampling_time)


def rise(trial: Trial, output: int) -> Any:
    """Return how much an output's error grows over every sample, (1, N), 0 where the trial did not reach its end."""
    e = known(trial.reached, trial.e[output, :])
    return known(trial.reached[1:], e[1:] - e[:-1])


def moved(memory: Memory, trial: Trial, lam0: Any, learning: bool) -> Any:
    """Return what the next start is moved by, (outputs, 1)."""
    return memory.moved + lam0 * trial.e[:, 0] if learning else memory.moved  # (5)
