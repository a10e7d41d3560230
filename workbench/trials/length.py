"""How long a trial lasts (assumption A3 of varying trial lengths), from an explicit random generator."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.quantity import InvalidValue, choice, count, declared, table


@declared
class TrialLength:
    """The distribution of the trial length T_i = T_min + l, l = 1..T_d - T_min, T_d being the horizon N."""

    law: str = choice(default="uniform", options=("uniform", "fixed", "table"), doc="distribution of the trial length")
    minimum: int | None = count(
        default=None, unit="samples", doc="T_min; null takes 95 % of the horizon", least=1, optional=True
    )
    probabilities: tuple[float, ...] | None = table(
        default=None, unit="1", doc="p_l for l = 1, 2, ... (law table), their sum is 1", optional=True
    )

    def check(self) -> None:
        """Raise InvalidValue unless the table is a distribution, and there exactly for law table."""
        if self.law == "table" and self.probabilities is None:
            raise InvalidValue("probabilities must be given for law table, as in [0.2, 0.3, 0.5]; got null")
        if self.law != "table" and self.probabilities is not None:
            raise InvalidValue(f"probabilities belong to law table, got law {self.law}: set law=table too")
        if self.probabilities is not None:
            if not self.probabilities or min(self.probabilities) < 0:
                raise InvalidValue("probabilities must be at least one number, none negative")
            if abs(sum(self.probabilities) - 1) > 1e-9:
                raise InvalidValue(f"probabilities must add up to 1, got {sum(self.probabilities)!r}")

    def least(self, horizon: int) -> int:
        """Return T_min for a horizon of N samples; raise InvalidValue where lengths would exceed the horizon."""
        if self.law == "fixed":
            return horizon
        lengths = len(self.probabilities) if self.probabilities is not None else None
        if self.minimum is not None:
            least = self.minimum
        else:
            least = horizon - lengths if lengths else horizon - max(1, horizon // 20)
        if not 1 <= least < horizon:
            raise InvalidValue(
                f"trial_length.minimum must lie in [1, {horizon - 1}], below the horizon of {horizon} samples, "
                f"got {least}"
            )
        if lengths and least + lengths > horizon:
            raise InvalidValue(
                f"the longest trial of the table, {least} + {lengths} samples, exceeds the horizon of {horizon}: "
                "lower trial_length.minimum or shorten the table"
            )
        return least

    def distribution(self, horizon: int) -> tuple[Any, Any]:
        """Return the possible lengths and their probabilities, two arrays of one shape."""
        least = self.least(horizon)
        if self.law == "fixed":
            return np.array([horizon]), np.array([1.0])
        if self.probabilities is not None:
            return least + 1 + np.arange(len(self.probabilities)), np.array(self.probabilities)
        lengths = np.arange(least + 1, horizon + 1)
        return lengths, np.full(lengths.size, 1 / lengths.size)

    def reach_probability(self, horizon: int) -> Any:
        """Return p(k), the probability that a trial reaches sample k, for k = 0..N, shape (N + 1,)."""
        lengths, probabilities = self.distribution(horizon)
        mass = np.zeros(horizon + 1)
        mass[lengths] = probabilities
        return np.minimum(np.cumsum(mass[::-1])[::-1], 1.0)

    def draw(self, horizon: int, trials: int, rng: np.random.Generator) -> Any:
        """Return the length of every trial, int64, shape (trials,)."""
        lengths, probabilities = self.distribution(horizon)
        return rng.choice(lengths, size=trials, p=probabilities / probabilities.sum()).astype(np.int64)
