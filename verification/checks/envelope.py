"""What campaigns reached, sample by sample, and by whom; held against bounds that were proved."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.errors import InvalidValue
from verification.checks.adversary import Choices
from workbench.contracts.claim import Held

LARGEST = sys.float_info.max


class Ends(NamedTuple):
    """The least and the largest value of some rows by sample, (rows, samples), and who reached them.

    What no trial reached is from inf to -inf; a value that is no number counts as both infinities.
    """

    low: Array
    high: Array
    low_by: NDArray[np.int64]
    """Campaign and trial, counted from 0, (rows, samples, 2); -1 where nobody came."""
    high_by: NDArray[np.int64]

    @classmethod
    def none(cls, rows: int, samples: int) -> Ends:
        """Return the ends of nothing."""
        nobody = np.full((rows, samples, 2), -1, dtype=np.int64)
        return cls(np.full((rows, samples), np.inf), np.full((rows, samples), -np.inf), nobody, nobody.copy())

    def take(self, values: Array, campaign: int, trial: int) -> None:
        """Widen the ends, in place, by a trial's values of the samples that it reached, (rows, reached)."""
        reached = values.shape[1]
        low, high = self.low[:, :reached], self.high[:, :reached]
        below, above = ~(values >= low), ~(values <= high)
        if below.any():
            low[below] = np.where(np.isnan(values), -np.inf, values)[below]
            self.low_by[:, :reached][below] = campaign, trial
        if above.any():
            high[above] = np.where(np.isnan(values), np.inf, values)[above]
            self.high_by[:, :reached][above] = campaign, trial

    def holders(self) -> set[int]:
        """Return the campaigns that reached an end."""
        return {int(one) for by in (self.low_by, self.high_by) for one in np.unique(by[..., 0])} - {-1}


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Envelope:
    """What campaigns reached. Trials and campaigns are counted from 0."""

    states: Ends
    """(nx, N + 1)."""
    inputs: Ends
    """(1, N): the inputs u(k) at the samples that were run."""
    increments: Ends
    """(1, N): y(k+1) - y(k) of the output itself, without noise."""
    mse: Array
    """The worst mean square error over the scored samples, by trial (trials,); 0 where no trial reached so far."""
    mse_by: NDArray[np.int64]
    """The campaign with that error, (trials,); -1 where no trial reached so far."""
    count: int
    trials: int
    seed: int
    choices: Mapping[int, tuple[Choices, ...]]
    """What was chosen in the campaigns that reached an end, by campaign: for ``replay``."""


class Bounds(NamedTuple):
    """One side of what was proved by sample, or what rounding may add there."""

    states: Array
    """(nx, N + 1)."""
    inputs: Array
    """(N,)."""


def held_inside(envelope: Envelope, low: Bounds, high: Bounds, spare: Bounds) -> Held:
    """Hold bounds of states and inputs by sample against what campaigns reached; ``spare``: what rounding may add.

    The margin is the least room as a share of the widest that the bounds of that signal are over the run, of 1 in its
    own unit where they have no width. The witness tells the room in its unit, and all that a replay needs. Raises
    InvalidValue for bounds of another shape, for those that are no finite numbers, and for a spare below 0.
    """
    worst, place = np.inf, dict[str, object]()
    parts = (
        ("state", envelope.states, low.states, high.states, spare.states),
        ("input", envelope.inputs, low.inputs[None, :], high.inputs[None, :], spare.inputs[None, :]),
    )
    for name, ends, least, most, add in parts:
        _fitting(name, ends.low.shape, (least, most, add))
        half = np.max(most / 2 - least / 2, axis=1)  # halves: no overflow
        scale = np.where(half > 0, half, 0.5)[:, None]
        for side, reached, bound, by, room in (
            ("low", ends.low, least, ends.low_by, ends.low - least + add),
            ("high", ends.high, most, ends.high_by, most - ends.high + add),
        ):
            row, k = np.unravel_index(np.argmin(room / 2 / scale), room.shape)
            share = float(room[row, k] / 2 / scale[row, 0])
            if share < worst:
                campaign, trial = (int(one) for one in by[row, k])
                worst = share
                place = {
                    "signal": name,
                    "row": int(row),
                    "sample": int(k),
                    "side": side,
                    "reached": _finite(float(reached[row, k])),
                    "bound": float(bound[row, k]),
                    "room": _finite(float(room[row, k])),
                    "campaign": campaign,
                    "trial": trial,
                    "seed": envelope.seed,
                    "choices": [one._asdict() for one in envelope.choices[campaign]],
                }
    return Held(envelope.count * envelope.trials, _finite(worst), place)


def chosen_of(witness: Mapping[str, object]) -> tuple[Choices, ...]:
    """Return the choices that a witness tells, which may come from a file; raises InvalidValue where it tells none."""
    told = witness.get("choices")
    try:
        if not isinstance(told, list) or not told:
            raise TypeError
        return tuple(
            Choices(**{**one, "start": tuple(one["start"]), "parameters": tuple(one["parameters"])}) for one in told
        )
    except (KeyError, TypeError):
        raise InvalidValue(
            f"a witness of campaigns must tell by trial {', '.join(Choices._fields)}; got {list(witness)}"
        ) from None


def _fitting(name: str, shape: tuple[int, ...], given: Sequence[Array]) -> None:
    """Raise InvalidValue unless bounds can be compared."""
    for side, values in zip(("low", "high", "spare"), given, strict=True):
        if values.shape != shape:
            raise InvalidValue(f"the bounds ({side}) of the {name} must have shape {shape}, got {values.shape}")
        if not np.isfinite(values).all():
            raise InvalidValue(f"the bounds ({side}) of the {name} must be finite numbers, got one that is not")
    if (given[2] < 0).any():
        raise InvalidValue(f"the spare of the {name} must be at least 0, got {given[2].min():g}")


def _finite(value: float) -> float:
    """Return the value, the largest double for what is beyond it: a file has no infinities."""
    return float(np.clip(value, -LARGEST, LARGEST))
