"""A dead time that changes at known samples, as a wrapper round any plant."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, ClassVar

import casadi as ca

from models.actuator import Delayed, Wrapper
from models.plant import Plant
from models.quantity import InvalidValue, declared, given, part


@declared
class SwitchedDelay(Wrapper):
    """A plant whose inputs arrive late by a number of samples that depends on the sample.

    ``schedule`` holds pairs (first step k, samples of delay): from that step on, x(k+1) is driven by u(k - delay).
    Where the delay gets shorter a command is skipped, where it gets longer one is repeated. The states added are
    the commands under way, as many as the longest delay, the oldest first.
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the dead time")
    schedule: tuple[tuple[int, int], ...] = given(doc="pairs of first step and samples of delay")

    def check(self) -> None:
        """Raise InvalidValue unless the schedule begins at step 0, rises, and its delays are 1 or more."""
        steps = [first for first, _ in self.schedule]
        if not steps or steps[0] != 0 or any(a >= b for a, b in pairwise(steps)):
            raise InvalidValue(f"schedule must begin at step 0 with rising steps, got {steps}")
        if any(delay != int(delay) or delay < 1 for _, delay in self.schedule):
            raise InvalidValue(f"schedule must hold delays of 1, 2, ... samples, got {self.schedule}")

    @property
    def longest(self) -> int:
        """The longest delay of the schedule, in samples."""
        return max(delay for _, delay in self.schedule)

    @property
    def states(self) -> Any:  # type: ignore[override]  # those of the inner plant and its own
        """States of the inner plant, then the commands under way, the oldest first."""
        return Delayed(plant=self.plant, samples=self.longest).states

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return the next state: the command due at step k reaches the inner plant, the new one joins the queue."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        inner, queue = x.vector[:n], x.vector[n:]
        due = self._due(queue, k, m)
        return ca.vertcat(self.plant.next_state(inner, due, w.vector, k), ca.vertcat(queue, u.vector)[m:])

    def applied(self, x: Any, u: Any, k: Any) -> Any:
        """Return what acts inside for the command due at sample k."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        return self.plant.applied_input(x.vector[:n], self._due(x.vector[n:], k, m), k)

    def _due(self, queue: Any, k: Any, m: int) -> Any:
        due = None
        for first, delay in self.schedule:
            oldest = (self.longest - delay) * m
            command = queue[oldest : oldest + m]
            due = command if due is None else ca.if_else(k >= first, command, due)
        return due
