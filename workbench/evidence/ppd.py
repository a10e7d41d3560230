"""The pseudo partial derivative, three quantities side by side: partial derivative, realised ratio, estimate.

For trial i and sample k, with d the plant's relative degree and s the signal that the law learns on (the output,
or its increment): the exact partial ds(k+d)/du(k) along the trajectory, the ratio of differences between trials i
and i-1, and the estimate that the law computed u(k) of trial i with.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from workbench.contracts.law import AnyLaw, Estimator
from workbench.contracts.study import Study
from workbench.evidence.trajectory import Linearisation, Lineariser, Trajectories, partial, recorded
from workbench.trials.campaign import Campaign


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a campaign shows of one controller's PPD. Arrays are (trials, m) with m = N - d + 1, or as said.

    Row i is trial i + 1, column k sample k. NaN marks what a trial (or the one before) did not reach, and the
    first trial's differences. Derivatives and estimates are in output units per input unit.
    """

    controller: str
    study: Study
    """The study that ran: what trials began with, and what disturbed them."""
    law: AnyLaw
    degree: int
    increment: bool
    trajectories: Trajectories
    partial: Array
    ratio: Array
    estimate: Array
    du: Array
    """Input difference to the trial before."""
    ds: Array
    """Difference of the learned signal at k + d to the trial before."""
    carried: Array
    """The part of ``ds`` that earlier input differences and the initial state brought about."""
    remainder: Array
    """``ds`` minus ``partial_midway * du`` minus ``carried``: what no linearisation explains."""
    partial_midway: Array
    """The partial derivative along the mean of this trajectory and the one before."""
    units: tuple[str, str]
    """Units of the output and of the input."""

    @property
    def unit(self) -> str:
        """The unit of derivatives, ratios and estimates."""
        return gain_unit(*self.units)

    @property
    def estimator(self) -> Estimator:
        """The parameters of the law's estimate. Raises InvalidValue for a law without."""
        if self.law.estimator is None:
            raise InvalidValue(f"{self.controller} must estimate a pseudo partial derivative, and has no estimator")
        return self.law.estimator

    def witness(self, trial: int, sample: int) -> dict[str, object]:
        """Return the numbers of one place (array indices), enough to replay it from ``run.nc``."""
        return {
            "controller": self.controller,
            "trial": trial + 1,
            "sample": sample,
            "du": float(self.du[trial, sample]),
            "ds": float(self.ds[trial, sample]),
            "ratio": float(self.ratio[trial, sample]),
            "partial": float(self.partial[trial, sample]),
            "signal": f"{'increment of the output' if self.increment else 'output'} at sample {sample + self.degree}",
        }

    def relative_ratio(self) -> Array:
        """Return ratio / partial, NaN where there is no ratio, and where the partial derivative is 0."""
        usable = np.isfinite(self.ratio) & (self.partial != 0)
        relative = np.full(self.ratio.shape, np.nan)
        relative[usable] = self.ratio[usable] / self.partial[usable]
        return relative

    def relative_error(self) -> Array:
        """Return |estimate - partial| / |partial|, NaN where a trial did not reach the sample."""
        with np.errstate(divide="ignore", invalid="ignore"):
            error: Array = np.abs(self.estimate - self.partial) / np.abs(self.partial)
            return error


def gain_unit(output: str, given: str) -> str:
    """Return the unit of an output per input, ``(m/s)/N``; ``1`` where both are pure numbers."""
    if output == given == "1":
        return "1"
    return "/".join(f"({unit})" if "/" in unit or " " in unit else unit for unit in (output, given))


def units_of(plant: Plant) -> tuple[str, str]:
    """Return the units of a plant's output and input, of which it has one each."""
    return plant.outputs[0].unit, plant.inputs[0].unit


def learned_signal(y: Array, increment: bool) -> Array:
    """Return the signal that a law learns on, same shape as y (..., N + 1); NaN at 0 for the increment."""
    if not increment:
        return y
    before = np.full_like(y, np.nan)
    before[..., 1:] = y[..., :-1]
    return y - before


def evidence(campaign: Campaign, controller: str) -> Evidence:
    """Gather the three quantities for every trial and sample that was reached.

    Raises InvalidValue for a plant with several channels, and where no sample of the output depends on an input.
    """
    study = campaign.study
    plant = study.plant_that_runs
    taken = recorded(campaign, controller)
    degree = study.relative_degree
    if degree is None:
        raise InvalidValue(
            f"the output of {plant.name} does not depend on its input within {min(200, study.horizon)} samples: "
            "give it an input that acts, or a longer reference"
        )
    law = campaign.tuned_laws()[controller]
    law = law.ready_for(study.task(law))
    increment = law.learns_on == "increment"
    trials, n = taken.u.shape
    m = n - degree + 1
    along = Lineariser(plant, n)
    signal = learned_signal(taken.y, increment)
    du = np.full((trials, m), np.nan)
    ds, carried, midway, slope = (np.full((trials, m), np.nan) for _ in range(4))
    for i in range(trials):
        slope[i] = partial(along.at(taken.x[i], taken.u[i], taken.w[i]), degree)
        if i == 0:
            continue
        du[i] = (taken.u[i] - taken.u[i - 1])[:m]
        ds[i] = (signal[i] - signal[i - 1])[degree:]
        line = along.at(*((now[i] + now[i - 1]) / 2 for now in (taken.x, taken.u, taken.w)))
        midway[i] = partial(line, degree)
        linear = _linear_difference(line, taken.x[i, :, 0] - taken.x[i - 1, :, 0], taken.u[i] - taken.u[i - 1])
        carried[i] = learned_signal(linear, increment)[degree:] - midway[i] * du[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(du != 0, ds / du, np.nan)
    return Evidence(
        controller=controller,
        study=study,
        law=law,
        degree=degree,
        increment=increment,
        trajectories=taken,
        partial=slope,
        ratio=ratio,
        estimate=taken.estimate[:, :m],
        du=du,
        ds=ds,
        carried=carried,
        remainder=ds - midway * du - carried,
        partial_midway=midway,
        units=units_of(plant),
    )


def _linear_difference(line: Linearisation, dx0: Array, du: Array) -> Array:
    """Return the output difference (N + 1,) that the linearisation gives for an initial and input difference."""
    n = line.b.shape[0]
    known = int(np.isfinite(line.a).all(axis=(1, 2)).sum())
    result = np.full(n + 1, np.nan)
    dx = dx0
    result[0] = line.c[0] @ dx
    for k in range(min(n, known)):
        dx = line.a[k] @ dx + line.b[k] * du[k]
        result[k + 1] = line.c[k + 1] @ dx
    return result


def quantiles(values: Array, axis: int, levels: tuple[float, ...] = (0.1, 0.5, 0.9)) -> Array:
    """Return quantiles of what is finite along an axis, (levels, other axis); NaN where nothing is."""
    finite = np.where(np.isfinite(values), values, np.nan)
    some = np.isfinite(finite).any(axis=axis)
    result = np.full((len(levels), some.size), np.nan)
    if some.any():
        picked = np.compress(some, finite, axis=1 - axis)
        result[:, some] = np.nanquantile(picked, levels, axis=axis)
    return result
