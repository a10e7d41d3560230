"""The contract of a controller: a law within the trial, and a learning between trials.

A controller is a :func:`models.quantity.declared` dataclass with ``source``, ``start`` and ``act``. What else it
can do it says by having the method: ``learn`` (:class:`Learning`), ``ready`` (:class:`Stateful`), ``place``
(:class:`Placing`), ``ppd_estimate`` (:class:`Estimating`), ``tell`` (:class:`Telling`), ``refusal``
(:class:`Choosy`). All of them are pure functions that work on CasADi values; the fold turns them into one compiled
function a trial.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

import casadi as ca

from models.limits import Limits
from models.plant import Signal


class Task(NamedTuple):
    """What a controller is told before the first trial."""

    reference: Any
    """The reference, shape (outputs, N + 1)."""
    sampling_time: Any
    """The sampling time in seconds."""
    limits: Limits = Limits()
    """What limits the plant's inputs, in its units, however it was given; infinite by default."""

    @property
    def samples(self) -> int:
        """N: a trial has the samples 0..N, and inputs at 0..N-1."""
        return int(self.reference.shape[1]) - 1


class Trial(NamedTuple):
    """What a trial left to learn from. Rows are signals, columns samples.

    Samples after the trial's end are missing: y and e are NaN there and ``reached`` is 0, so whatever a law
    computes from them must go through :func:`known`.
    """

    r: Any
    """Reference, (outputs, N + 1)."""
    y: Any
    """Measured output, (outputs, N + 1)."""
    e: Any
    """Error r - y, (outputs, N + 1)."""
    u: Any
    """Input, (inputs, N)."""
    reached: Any
    """gamma of the papers: 1 where the trial reached the sample, else 0; (1, N + 1)."""
    state: Any
    """The law's acting state after each sample, a NamedTuple of rows with N columns, or ()."""


@runtime_checkable
class Controller(Protocol):
    """Every controller: where it comes from, its memory before the first trial, and its input at a sample."""

    source: str

    def start(self, task: Task) -> Any:
        """Return the memory before the first trial: a NamedTuple of CasADi values.

        A field with N or N + 1 columns holds one column a sample; a field with one column is the same for all.
        """

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the input (in the order of the plant's inputs) and the law's next acting state.

        memory_k is the memory at the sample, r and r_next the reference now and next, y the measured output.
        """


@runtime_checkable
class Learning(Protocol):
    """A controller that learns between trials."""

    def learn(self, memory: Any, trial: Trial) -> Any:
        """Return the memory for the next trial."""


@runtime_checkable
class Stateful(Protocol):
    """A controller whose law has a state of its own within the trial (an integral, a filter, weights)."""

    def ready(self, memory: Any) -> Any:
        """Return the acting state at the beginning of a trial, a NamedTuple of columns."""


@runtime_checkable
class Placing(Protocol):
    """A controller that also sets where the next trial begins (initial-state learning)."""

    def place(self, memory: Any, x0: Any) -> Any:
        """Return the initial state, a column, given the one that the study would start from."""


@runtime_checkable
class Estimating(Protocol):
    """A controller that estimates the pseudo partial derivative."""

    def ppd_estimate(self, memory: Any) -> Any:
        """Return the estimate that the trial's input is computed with, (1, N), output units per input unit."""


@runtime_checkable
class Telling(Protocol):
    """A controller that tells more of itself than its input: what it learned, a gain by sample."""

    tells: tuple[Signal, ...]

    def tell(self, memory: Any, trial: Trial) -> Any:
        """Return one row (1, N) a signal of ``tells``, given the memory that the trial ran with."""


@runtime_checkable
class Choosy(Protocol):
    """A controller that does not suit every study."""

    def refusal(self, study: Any) -> str | None:
        """Return why it cannot be used in the study, or None."""


def learns_increment(law: Any) -> bool:
    """Tell whether a law learns on y(k+1) - y(k) instead of y(k+1): its estimate is of that signal's PPD.

    A law says so with a class attribute ``learns_increment = True``.
    """
    return bool(getattr(law, "learns_increment", False))


def known(reached: Any, value: Any) -> Any:
    """Return value where ``reached`` is 1 and 0 elsewhere, never touching what is missing (NaN) there."""
    return ca.if_else(reached, value, 0)


def constant_row(value: Any, columns: int) -> Any:
    """Return a row with the same value in every column, for a number or a symbol."""
    return value * ca.DM.ones(1, columns)
