"""How long a trial lasts (assumption A3 of varying trial lengths), from an explicit random generator."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.array import Array
from models.quantity import InvalidValue, choice, count, declared, given, table

Lengths = NDArray[np.int64]


@declared
class TrialLength:
    """The distribution of the trial length T_i = T_min + l, l = 1, 2, ...; the horizon N is T_d.

    A trial that would last longer than the horizon is recorded, and counts, up to the horizon.
    """

    law: str = choice(
        default="uniform", options=("uniform", "fixed", "table", "given"), doc="distribution of the trial length"
    )
    length: int | None = count(
        default=None,
        unit="samples",
        doc="length of every trial (law fixed); null takes the horizon",
        least=1,
        optional=True,
    )
    minimum: int | None = count(
        default=None, unit="samples", doc="T_min; null takes 95 % of the horizon", least=1, optional=True
    )
    maximum: int | None = count(
        default=None, unit="samples", doc="longest trial (law uniform); null takes the horizon", least=2, optional=True
    )
    probabilities: tuple[float, ...] | None = table(
        default=None, unit="1", doc="p_l for l = 1, 2, ... (law table), their sum is 1", optional=True
    )
    lengths: tuple[int, ...] = given(default=(), doc="the lengths themselves, one a trial (law given)")

    def check(self) -> None:
        """Raise InvalidValue unless the table is a distribution, and there exactly for law table."""
        if self.law == "table" and self.probabilities is None:
            raise InvalidValue("probabilities must be given for law table, as in [0.2, 0.3, 0.5]; got null")
        if self.law != "table" and self.probabilities is not None:
            raise InvalidValue(f"probabilities belong to law table, got law {self.law}: set law=table too")
        if self.law != "fixed" and self.length is not None:
            raise InvalidValue(f"length belongs to law fixed, got law {self.law}: set law=fixed too")
        if self.law != "uniform" and self.maximum is not None:
            raise InvalidValue(f"maximum belongs to law uniform, got law {self.law}: set law=uniform too")
        if (self.law == "given") != bool(self.lengths):
            raise InvalidValue("lengths must be given for law given, and for no other: write trial_length=[...]")
        if any(length < 1 for length in self.lengths):
            raise InvalidValue(f"lengths must be 1 sample or more, got {min(self.lengths)}")
        if self.probabilities is not None:
            if not self.probabilities or min(self.probabilities) < 0:
                raise InvalidValue("probabilities must be at least one number, none negative")
            if abs(sum(self.probabilities) - 1) > 1e-9:
                raise InvalidValue(f"probabilities must add up to 1, got {sum(self.probabilities)!r}")

    @property
    def varies(self) -> bool:
        """Whether trials may be of different lengths, or shorter than the horizon."""
        return self.law != "fixed" or self.length is not None

    def least(self, horizon: int) -> int:
        """Return T_min for a horizon of N samples: all trials last longer, but for those whose length is given.

        Raises InvalidValue where T_min is not below the horizon.
        """
        if self.law == "fixed":
            return horizon if self.length is None else min(self.length, horizon)
        if self.law == "given":
            return min(min(self.lengths), horizon)
        if self.minimum is not None:
            least = self.minimum
        elif self.probabilities is not None:
            least = max(horizon - len(self.probabilities), 0)
        else:
            least = horizon - max(1, horizon // 20)
        if not 1 <= least < horizon:
            raise InvalidValue(
                f"trial_length.minimum must lie in [1, {horizon - 1}], below the horizon of {horizon} samples, "
                f"got {least}"
            )
        if self.maximum is not None and self.maximum <= least:
            raise InvalidValue(f"trial_length.maximum must lie above the minimum of {least}, got {self.maximum}")
        return least

    def distribution(self, horizon: int) -> tuple[Lengths, Array]:
        """Return the lengths that count and their probabilities, two arrays of one shape.

        What lasts longer than the horizon counts as the horizon. For law given these are the shares of the trials.
        """
        least = self.least(horizon)
        if self.law == "fixed":
            return np.array([least]), np.array([1.0])
        if self.law == "given":
            values, times = np.unique(np.minimum(self.lengths, horizon), return_counts=True)
            return values.astype(np.int64), times / len(self.lengths)
        if self.probabilities is not None:
            lengths, mass = least + 1 + np.arange(len(self.probabilities)), np.array(self.probabilities)
        else:
            lengths = np.arange(least + 1, (self.maximum or horizon) + 1)
            mass = np.full(lengths.size, 1 / lengths.size)
        within = lengths < horizon
        if lengths[-1] <= horizon:
            return lengths, mass
        return np.append(lengths[within], horizon), np.append(mass[within], mass[~within].sum())

    def reach_probability(self, horizon: int) -> Array:
        """Return p(k), the probability that a trial reaches sample k, for k = 0..N, shape (N + 1,)."""
        lengths, probabilities = self.distribution(horizon)
        mass = np.zeros(horizon + 1)
        mass[lengths] = probabilities
        return np.minimum(np.cumsum(mass[::-1])[::-1], 1.0)

    def draw(self, horizon: int, trials: int, rng: np.random.Generator) -> Lengths:
        """Return the length of every trial as it counts, int64, shape (trials,)."""
        if self.law == "given":
            if len(self.lengths) != trials:
                raise InvalidValue(f"trial_length must be one a trial, {trials}, got {len(self.lengths)}")
            return np.minimum(np.array(self.lengths, dtype=np.int64), horizon)
        lengths, probabilities = self.distribution(horizon)
        return rng.choice(lengths, size=trials, p=probabilities / probabilities.sum()).astype(np.int64)


def as_trial_length(value: TrialLength | ArrayLike, trials: int) -> TrialLength:
    """Return trial lengths given plainly: a whole number of samples for all trials, or one for each."""
    if isinstance(value, TrialLength):
        return value
    allowed = f"a TrialLength, a whole number of samples, or {trials} of them, one a trial"
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidValue(
            f"trial_length must be {allowed}, got {value!r}: a law is named in TrialLength(law=...)"
        ) from None
    if array.shape not in ((), (trials,)) or (array != np.round(array)).any() or (array < 1).any():
        raise InvalidValue(f"trial_length must be {allowed}, got {value!r}")
    if array.ndim == 0:
        return TrialLength(law="fixed", length=int(array))
    return TrialLength(law="given", lengths=tuple(int(one) for one in array))
