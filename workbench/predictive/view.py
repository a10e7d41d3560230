"""How a predictive law sees the plant that it acts on: what of it is the model's state, and where that should be."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from models.plant import signals
from workbench.contracts.law import Decision, Seen
from workbench.predictive.decision import Following, Move, start
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.sets.array import Array

TELLS = signals(
    hold=("samples", "planned hold M"),
    cost=("1", "cost J of the plan"),
    qps=("1", "quadratic programs solved"),
    infeasible=("1", "1 where no plan could be made and the last safe one is held"),
)
"""What predictive laws tell of themselves."""


class View(ABC):
    """What is seen of a plant, in terms of the linear model that a law plans with.

    The input is u(k) = feed(k) + v(k), and the law moves v; v(k-l-1) is a state of the model.
    """

    @abstractmethod
    def state(self, seen: Seen, acted: float) -> Array:
        """Return the model's state at the sample, shape (n,), given v(k-l-1)."""

    @abstractmethod
    def reference(self, k: int) -> Array:
        """Return x_s(k), where the model's state should be, shape (n,); also for k beyond the trial."""

    def feed(self, k: int) -> float:
        """Return the part of the input that is known beforehand."""
        return 0.0

    def limited(self, k: int, v: float) -> float:
        """Return v, cut where a larger one would do no more."""
        return v

    @property
    def before(self) -> float:
        """What v was before the trial."""
        return 0.0


class Riding(NamedTuple):
    """The acting state of a predictive law."""

    following: Following
    """The plan that it follows."""
    sent: tuple[float, ...]
    """v(k-l-1) ... v(k-1), the inputs on their way less what was fed forward."""
    error: Array | None = None
    """The error x - x_s at the sample before, None at first; for a law that estimates a disturbance by it."""
    acted: float = 0.0
    """The increment that acted since that sample."""


class Sight(NamedTuple):
    """What a predictive law sees at a sample, in terms of its model."""

    x: Array
    """The state x(k), (n,)."""
    pending: Array
    """The increments on their way, du(k-l) ... du(k-1), (l,)."""
    error: Array
    """x(k) - x_s(k), (n,)."""
    predicted: Array
    """e(k) = z(k) - x_s(k+l), z the prediction of x(k+l) without disturbance, (n,)."""


def begun(plant: DelayedPlant, view: View) -> Riding:
    """Return the acting state at the beginning of a trial."""
    return Riding(start(), (view.before,) * (plant.delay + 1))


def sight(plant: DelayedPlant, view: View, riding: Riding, seen: Seen) -> Sight:
    """Return what is seen in terms of the model. Raises InvalidValue where it is not finite."""
    x, pending = view.state(seen, riding.sent[0]), np.diff(riding.sent)
    return Sight(
        x, pending, x - view.reference(seen.k), plant.predict(x, pending) - view.reference(seen.k + plant.delay)
    )


def decided(view: View, riding: Riding, seen: Seen, move: Move, following: Following) -> tuple[Decision, Riding]:
    """Return the decision that a move of the input is, and the acting state for the next sample."""
    v = view.limited(seen.k, riding.sent[-1] + move.du)
    told = (float(move.M), move.J, float(move.qps), float(bool(move.infeasible)))
    decision = Decision(np.array([view.feed(seen.k) + v]), told, move.infeasible)
    return decision, riding._replace(following=following, sent=(*riding.sent[1:], v))
