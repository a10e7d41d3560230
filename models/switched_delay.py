"""A dead time that changes at known samples, as a wrapper round any plant."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar, Self

import casadi as ca

from models.actuator import Wrapper, under_way, whole_samples
from models.expression import Column, Expression
from models.plant import Plant, Signal, Values
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

    @classmethod
    def in_seconds(cls, plant: Plant, schedule: Sequence[tuple[float, float]]) -> Self:
        """Return the plant behind dead times given by pairs (from which second on, dead time in seconds).

        Raises InvalidValue unless all are multiples of the sampling time.
        """
        step = float(plant.sampling_time)
        pairs = (
            (whole_samples("schedule's instants", first, step), whole_samples("schedule's dead times", late, step))
            for first, late in schedule
        )
        return cls(plant=plant, schedule=tuple(pairs))

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
    def states(self) -> tuple[Signal, ...]:
        """States of the inner plant, then the commands under way, the oldest first."""
        return (*self.plant.states, *under_way(self.plant, self.longest))

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the next state: the command due at step k reaches the inner plant, the new one joins the queue."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        inner, queue = x.vector[:n], x.vector[n:]
        due = self._due(queue, k, m)
        return ca.vertcat(self.plant.next_state(inner, due, w.vector, k), ca.vertcat(queue, u.vector)[m:])

    def applied(self, x: Values, u: Values, k: Expression) -> Column:
        """Return what acts inside for the command due at sample k."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        return self.plant.applied_input(x.vector[:n], self._due(x.vector[n:], k, m), k)

    def _due(self, queue: Expression, k: Expression, m: int) -> Expression:
        commands = [queue[(self.longest - delay) * m :][:m] for _, delay in self.schedule]
        due = commands[0]
        for (first, _), command in zip(self.schedule[1:], commands[1:], strict=True):
            due = ca.if_else(k >= first, command, due)
        return due
