"""The map between trials, taken from the law itself.

With v what a law learns, G the trial from v to the errors' signal (the output, or its increment), L the derivative of
the next v by that signal and M by v at a held error (:mod:`workbench.evidence.learning_step`):

* (a) M = I: the error itself goes as e_next = (I - G L) e, with G that of the next trial. What is said is said of the
  error's 2-norm, and where the map contracts the error goes to the one at which the law changes nothing: to zero,
  where a zero error changes nothing.
* (b) M != I (a filter on the plan, a forgetting factor, memory of older trials): the error does not map to itself.
  What contracts or grows is the distance of the plan to its limit, d_next = (M - L G) d, and what is said is said of
  the 2-norm of d. The plan then goes to a limit that need not have zero error: with e the error there and u its plan
  (I - M) u = L e, so e is 0 only if u is passed on unchanged. The limit's own error is computed.

For a law that estimates a pseudo partial derivative L and M are taken with the estimate that the last trial led to: in
the limit, where inputs no longer change, an estimate stands still. Measurement noise is left aside. All of it is
taken along the last trial, run to the horizon: nothing here is a proof for the plant itself.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from models.array import Array
from verification.checks.premises import no_noise, same_but_for_the_input
from verification.checks.spectral_radius import Radius, spectral_radius
from workbench.evidence.closed_loop import LARGEST, Linear, Matrix, images, product
from workbench.evidence.error_signal import Signal
from workbench.evidence.learning_step import LearningStep, Ran, learning_step, memories
from workbench.evidence.lifted import SingularValue, largest_singular_value
from workbench.evidence.ppd import Evidence, learned_signal
from workbench.trials.campaign import Campaign

ROUNDING = 1e-20  # of the squared reference: a mean square error below this is rounding


class Reached:
    """G: the signal's answer to what is learned, with the sign of the output."""

    def __init__(self, linear: Linear, signal: Signal) -> None:
        self._linear, self._of = linear, signal.of

    def apply(self, dv: Array) -> Array:
        """Return the signal's difference, (m,), for dv, (p,)."""
        return product(self._of, self._linear.apply(dv))

    def adjoint(self, ds: Array) -> Array:
        """Return the transposed map's value, (p,)."""
        return np.asarray(self._linear.adjoint(np.asarray(self._of.T @ ds)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorMap:
    """The map between trials along the last trial, and what the record says against it."""

    step: LearningStep
    first: Array
    """The error of the first trial run to the horizon, (N + 1,)."""
    first_v: Array
    """What that trial was run with, (p,)."""
    signal: Signal
    lifted: Reached
    """G."""
    gain: Matrix
    """L, (p, m)."""
    unchanged: bool
    """Whether M = I, and the map is that of the error."""
    live: NDArray[np.int64]
    """Which of what is learned reaches the signal, or all where others reach it through the next trial."""
    triangular: bool
    diagonal: Array
    """The map's diagonal, (m,), where it is lower triangular: its eigenvalues. Else empty."""
    singular: SingularValue
    """The largest singular value of the map: of I - G L where M = I, of M - L G else."""
    mse: Array
    """The mean square errors of the run."""
    fell: int | None
    """The trial at which the law diverged, None where it did not."""
    rose: tuple[int, float] | None
    """The trial after which the signal's error grew most in the record, by which factor; None where none did."""

    @property
    def of_error(self) -> bool:
        """Whether the spectrum is that of the error's map: where it is M = I, and enough is learned for every error."""
        return self.unchanged and self.live.size >= self.signal.size

    @property
    def size(self) -> int:
        """Rows of the map whose spectrum is looked at."""
        return self.signal.size if self.of_error else self.live.size

    @cached_property
    def never_changed(self) -> int | None:
        """A number that no error changes, so that an error stands still: the map has the eigenvalue 1, exactly."""
        rows = np.flatnonzero(np.diff(self.gain[self.live].indptr) == 0)
        return int(self.live[rows[0]]) if self.of_error and self.live.size == self.signal.size and rows.size else None

    @cached_property
    def dense(self) -> Array:
        """I - G L, (m, m), or M - L G on what is live, (p, p): whichever has no direction in which nothing happens."""
        if self.of_error:
            return images(lambda one: np.asarray(one - self.lifted.apply(product(self.gain, one))), np.eye(self.size))
        whole = np.zeros((self.step.learned.size, self.size))
        whole[self.live, np.arange(self.size)] = 1
        return images(self.step.apply, whole)[self.live]

    @cached_property
    def radius(self) -> Radius | None:
        """Between which numbers the map's spectral radius lies; None where the map is too large for its matrix."""
        if self.triangular:
            largest = float(np.abs(self.diagonal).max())
            return Radius(largest, largest)
        return spectral_radius(self.dense) if self.size <= LARGEST else None

    @cached_property
    def limit(self) -> Limit | None:
        """The error at which a map that contracts stands still; None where it cannot be computed."""
        return self._limit_of_error() if self.of_error else self._limit_of_plan()

    def _limit_of_error(self) -> Limit | None:
        """With M = I the error stands still where nothing is changed: at zero, if a zero error changes nothing."""
        step, m = self.step, self.signal.size
        still = self.signal.error(np.zeros(m), (step.loop.r - step.loop.rows.y)[0])
        following = step.next(still[None, :])
        change = following - step.v
        if np.abs(change[self.live]).max() <= 1e-9 * float(np.abs([step.v, following]).max()):
            return Limit(np.zeros(m), 0.0)
        if self.triangular:
            found = _solved(self.gain[self.live], -change[self.live])
        elif m <= LARGEST:
            found = _solved(sparse.csr_array(np.eye(m) - self.dense), -self.lifted.apply(change))
        else:
            found = None
        return None if found is None else Limit(found, 0.0)

    def _limit_of_plan(self) -> Limit | None:
        """From the last trial on the plan moves by the sum of a geometric series, and the error with it."""
        if self.size > LARGEST:
            return None
        change = (self.step.next() - self.step.v)[self.live]
        found = _solved(sparse.csr_array(np.eye(self.size) - self.dense), change)
        if found is None:
            return None
        move = np.zeros(self.step.learned.size)
        move[self.live] = found
        moved = self.lifted.apply(move)
        return Limit(product(self.signal.of, self.step.error[0]) - moved, rms(moved))


class Limit:
    """The signal's error at the limit, and how far it still is from the last trial's, as a root mean square."""

    def __init__(self, error: Array, away: float) -> None:
        self.error, self.away = error, away


def rms(values: Array) -> float:
    """Return the root mean square of some values."""
    return float(np.sqrt(np.mean(np.square(values))))


def _solved(matrix: Matrix, right: Array) -> Array | None:
    """Return the solution of a square system, or None where there is none."""
    try:
        found = np.asarray(linalg.splu(sparse.csc_matrix(matrix)).solve(right))
    except RuntimeError:  # exactly singular
        return None
    return found if np.isfinite(found).all() else None


def error_map(campaign: Campaign, evidence: Evidence) -> ErrorMap | str:
    """Return the map between trials, or in one sentence why there is none."""
    kept: deque[Ran] = deque(maxlen=1)
    first: Ran | None = None
    if evidence.law.learns_on is None:
        return "the law does not learn between trials"
    if evidence.law.stepped:
        return "the law decides in numbers, sample by sample, so what it learns and does has no derivative"
    for ran in memories(campaign, evidence.controller):
        first = first or ran
        kept.append(ran)
    if first is None:
        return "the law fell in its first trial"
    step = learning_step(campaign, evidence.controller, kept[0])
    if isinstance(step, str):
        return step
    return _mapped(campaign, evidence, step, first)


def _mapped(campaign: Campaign, evidence: Evidence, step: LearningStep, first: Ran) -> ErrorMap | str:
    n, p = campaign.study.horizon, step.learned.size
    begins = step.linear.moves_start
    reach = step.linear.adjoint(np.random.default_rng(0).standard_normal(n + 1))
    signal = Signal(n, 0 if begins else evidence.degree, increment=evidence.increment)
    rows = step.learned.shapes
    one_row = len(rows) == 1 and rows[0][0] == 1 and rows[0][1] >= n and not begins
    live = np.arange(n + 1 - evidence.degree) if one_row else np.flatnonzero(reach)
    if step.keeps[live][:, np.setdiff1d(np.arange(p), live)].nnz:
        live = np.arange(p)
    unchanged = step.unchanged
    linear = (step.following() if unchanged else None) or step.linear
    lifted, gain = Reached(linear, signal), signal.slope(step.by_error)
    triangular = one_row and live.size == signal.size and _lower(gain[live]) and _lower(step.keeps[live][:, live])
    diagonal = np.zeros(0)
    if triangular:
        diagonal = step.keeps.diagonal()[live] - gain[live].diagonal() * linear.diagonal(evidence.degree)

    def apply(e: Array) -> Array:
        return np.asarray(e - lifted.apply(product(gain, e)))

    def adjoint(e: Array) -> Array:
        return np.asarray(e - gain.T @ lifted.adjoint(e))

    try:
        if unchanged:
            singular = largest_singular_value(apply, adjoint, signal.size, np.inf)
        else:
            singular = largest_singular_value(step.apply, step.adjoint, p, np.inf)
    except linalg.ArpackError:
        return "the largest singular value of the map between trials was not found"
    data = campaign.data.sel(controller=evidence.controller)
    v, error = step.again(first)
    fell = float(data["diverged_at_trial"])
    mse = np.asarray(data["mse"].values, dtype=float)[: len(evidence.trajectories.lengths)]
    return ErrorMap(
        step=step,
        first=error[0],
        first_v=v,
        signal=signal,
        lifted=lifted,
        gain=gain,
        unchanged=unchanged,
        live=live,
        triangular=triangular,
        diagonal=diagonal,
        singular=singular,
        mse=mse,
        fell=None if np.isnan(fell) else int(fell),
        rose=_rose(campaign, evidence, signal),
    )


def _lower(matrix: Matrix) -> bool:
    """Tell whether a matrix has nothing above its diagonal, rounding aside."""
    above = sparse.csr_array(sparse.triu(matrix, 1))
    return bool(above.nnz == 0 or np.abs(above.data).max() <= 1e-12 * np.abs(matrix.data).max())


def _rose(campaign: Campaign, evidence: Evidence, signal: Signal) -> tuple[int, float] | None:
    """Return after which full trial the norm of the signal's error grew most to the next one, rounding aside."""
    study, taken = campaign.study, evidence.trajectories
    if same_but_for_the_input(study, evidence.law) is not None or no_noise(study) is not None:
        return None
    reference = study.reference_samples[0]
    errors = reference - learned_signal(taken.y, False)
    norms = np.array([np.linalg.norm(product(signal.of, one)) for one in errors])
    least = np.sqrt(ROUNDING * signal.size) * float(np.abs(reference).max())
    full = taken.lengths == study.horizon
    both = full[1:] & full[:-1] & (norms[1:] > least)
    if not both.any():
        return None
    with np.errstate(divide="ignore"):
        factor = np.where(both, norms[1:] / norms[:-1], 0.0)
    worst = int(factor.argmax())
    return (worst + 1, float(factor[worst])) if factor[worst] > 1 + 1e-6 else None
