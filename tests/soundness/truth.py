"""What is true of a case, claim by claim, from its parameters and a plain run: nothing here asks the program.

A truth says whether the claim holds (None: not known), and whether it has to be decided: all that the claim asks is
met by construction, and nothing lies so near an edge that rounding decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from soundness.bands import bands
from soundness.case import Case, trial
from soundness.curves import Curve, Numbers
from soundness.laws import Memory, gains, learned
from soundness.plants import Chain, Region

Array = NDArray[np.float64]
Ends = Mapping[str, tuple[Array, Array]]
CLEAR = 1e-6
"""How far, relatively, a number must lie from an edge for its side to be known."""


class Truth(NamedTuple):
    """Whether a claim holds, and whether it has to be decided."""

    holds: bool | None
    due: bool
    why: str


UNKNOWN = Truth(None, False, "not known by construction")


class Known:
    """What is known of a case: ``box`` is what claims speak of, ``hull`` what trials met."""

    def __init__(self, case: Case, box: Ends, hull: Ends) -> None:
        self.case, self.chain, self.law, self.run = case, case.acting, case.law, case.run
        self.box, self.hull = _region(case.acting, box), _region(case.acting, hull)
        self.w = tuple(float(end.ravel()[0]) for end in box["w"]) if case.chain.disturbed else (0.0, 0.0)

    # premises, by construction

    @property
    def same_plant(self) -> bool:
        return not self.chain.changes

    @property
    def alike(self) -> bool:
        return self.same_plant and not self.case.spread and not self.case.drawn

    @property
    def scope(self) -> bool:
        """Whether what disturbs the plant stays in the box."""
        case = self.case
        return not case.drawn or (not case.unbounded and self.w[0] <= -case.drawn and case.drawn <= self.w[1])

    @property
    def quiet(self) -> bool:
        return self.case.noise == 0

    @property
    def memoryless(self) -> bool:
        of = self.chain
        plain = of.degree == 1 and of.states == 1 and of.scale is None and of.drift.slopes(-1.0, 1.0) == (0.0, 0.0)
        plain = plain and of.relay is None and np.isinf(of.ceiling)
        return plain and of.a[0] == (1.0 if self.law.increment else 0.0)

    @property
    def straight(self) -> bool:
        """Whether the plant is linear."""
        of = self.chain
        if of.relay is not None or np.isfinite(of.ceiling):
            return False
        flat = [of.drive.slopes(-50.0, 50.0), of.drift.slopes(-50.0, 50.0)]
        return of.scale is None and all(low == high for low, high in flat) and not of.drive.jumps and not of.drift.jumps

    # claims

    def A1(self) -> Truth:
        if not self.hull.smooth_in_u and _well_inside(self.hull):
            return Truth(False, self.same_plant and self.scope, "the slope or the value breaks where trials were")
        if self.box.smooth_in_u and self.chain.degree == 1:
            return Truth(True, self.same_plant and self.scope, "no break of the slope by u lies in the box")
        if self.chain.degree > 1 and self.box.smooth_in_u:
            return Truth(True, self.same_plant and self.scope, "no break of the slope by u lies in the box")
        return UNKNOWN

    def A2_printed(self) -> Truth:
        due = self.alike and self.scope
        if self.memoryless:
            if self.box.unbroken:
                return Truth(True, due, "no earlier input matters, and the slope is bounded")
            if Curve.meets(self.chain.drive.jumps, *_inner(self.hull.u)):
                return Truth(False, due, "no earlier input matters, and the output jumps with the input")
            return UNKNOWN
        if not self.alike or not self._remembered():
            return UNKNOWN
        full = any(length == self.case.horizon for length in self.run.lengths)
        return Truth(False, due and full, "an earlier input moves the output, so the ratio has no bound")

    lemma1 = A2_printed

    def _remembered(self) -> bool:
        """Whether an earlier input surely moves the output: the paths by the diagonal do not cancel."""
        of = self.chain
        if not self.straight or (of.later is not None and of.later[1] == 0):
            return False
        total = sum(of.a[: of.degree]) - (1.0 if self.law.increment else 0.0)
        return abs(total) > 0.02 and min(abs(g) for g in self.box.gains) > 1e-3

    def A2_lifted(self) -> Truth:
        of = self.chain
        if self.box.unbroken:
            return Truth(True, self.alike, "the equations are continuous with bounded slopes on the box")
        jumps = [*(of.drift.jumps if of.row == 0 else ()), *(of.scale.jumps if of.scale is not None else ())]
        jumping = Curve.meets(of.drive.jumps, *_inner(self.hull.u)) or any(self._comes_to(place) for place in jumps)
        if of.degree == 1 and jumping:
            return Truth(False, self.alike, "the output jumps with an input that trials come to, or with the output")
        if of.degree == 1 and self._turned():
            return Truth(False, self.alike, "an input that trials come to turns a hidden state, which moves the output")
        return UNKNOWN

    def _comes_to(self, place: float) -> bool:
        """Whether a trial comes to an output, an input follows, and the one before it could be moved to meet it."""
        ends = zip(self.run.x, self.run.u, self.run.lengths, strict=True)
        return any(self._moved(x, u, k, place) and abs(u[k]) > 1e-3 for x, u, end in ends for k in range(1, end))

    def _moved(self, x: Array, u: Array, k: int, place: float) -> bool:
        """Whether the input of the sample before, moved within what trials met, brings the output of k to a place."""
        low, high = _inner(self.hull.u)
        rise = float(self.chain.slopes(x[:, k - 1], u[k - 1], k - 1)[1][0])
        return bool(rise) and low < u[k - 1] + (place - x[0, k]) / rise < high

    def _turned(self) -> bool:
        """Whether a hidden state turned in the plain run, and an input of the sample before could have held it."""
        relay = self.chain.relay
        if relay is None:
            return False
        for x, u, end in zip(self.run.x, self.run.u, self.run.lengths, strict=True):
            for k in range(1, end - 1):
                turns = x[-1, k + 1] - x[-1, k]
                if turns and self._moved(x, u, k, relay.high if turns > 0 else relay.low):
                    return True
        return False

    def A3(self) -> Truth:
        return Truth(True, True, "lengths are drawn from their distribution")

    def A4_partial(self) -> Truth:
        due = self.same_plant and self.scope
        box, hull = self.box.slope, self.hull.slope
        if self.box.unbroken_in_u and box[0] > CLEAR * abs(box[1]):
            return Truth(True, due, "the least slope on the box is positive")
        met = hull[0] < -1e-4 * abs(hull[1]) or hull[1] < 0
        if self.hull.unbroken and met:
            return Truth(False, due, "the slope is negative where trials were")
        flat = self.case.clipped is not None and any(
            not lo < e < hi for lo, hi in [self.case.clipped] for e in self.hull.u
        )
        if np.isfinite(self.chain.ceiling) and hull[0] == 0:
            ends = self.hull.free
            well = ends[0] < -self.chain.ceiling * (1 + 1e-3) or self.chain.ceiling * (1 + 1e-3) < ends[1]
            return Truth(False, due and well, "the slope is 0 where the first state is kept at its end")
        if flat and hull[0] == 0:
            return Truth(False, due and hull[1] == 0, "the slope is 0 beyond the actuator's end")
        return UNKNOWN

    def A4_printed(self) -> Truth:
        if self.memoryless:
            return self.A4_partial()
        ratio, sure = self.ratios
        if not ratio.size:
            return UNKNOWN
        due = self.alike and self.scope
        if (ratio[sure] <= 0).any():
            return Truth(False, due, "a ratio of the plain run is negative")
        if sure.all():
            return Truth(True, due, "all ratios of the plain run are positive")
        return UNKNOWN

    def estimator(self) -> Truth:
        return Truth(True, len(self.run.u) >= 2, "the reset keeps the sign")

    def lambda_partial(self) -> Truth:
        due = self.same_plant and self.scope
        least = [(self.law.rho * max(abs(e) for e in one.slope)) ** 2 / 4 for one in (self.box, self.hull)]
        if not self.box.unbroken_in_u:
            return UNKNOWN
        if self.law.lam > least[0] * (1 + 1e-3):
            return Truth(True, due, "lambda lies above the bound by the largest slope on the box")
        if self.law.lam < least[1] * (1 - 1e-3):
            return Truth(False, due, "lambda lies below the bound where trials were")
        return UNKNOWN

    def lambda_realised(self) -> Truth:
        ratio, sure = self.ratios
        if not sure.any():
            return UNKNOWN
        least = (self.law.rho * np.abs(ratio[sure]).max()) ** 2 / 4
        if self.law.lam < least * (1 - CLEAR):
            return Truth(False, self.alike, "a ratio of the plain run is too large")
        if sure.all() and self.law.lam > least * (1 + CLEAR):
            return Truth(True, self.alike, "the largest ratio of the plain run is small enough")
        return UNKNOWN

    def theorem1(self) -> Truth:
        ratio, sure = self.ratios
        if not sure.any():
            return UNKNOWN
        phi = self._estimates[self._usable]
        factor = np.abs(1 - self.law.rho * phi / (self.law.lam + phi**2) * ratio)
        if (factor[sure] > 1 + CLEAR).any():
            return Truth(False, self.alike, "a factor of the plain run is above 1")
        if sure.all() and (factor < 1 - CLEAR).all():
            return Truth(True, self.alike, "all factors of the plain run are below 1")
        return UNKNOWN

    def conclusion(self) -> Truth:
        low, high = self._slope_of_all
        first = self.chain.degree == 1 and self.case.clipped is None
        plain = first and self.alike and self.quiet and self._continuous_everywhere and not self.run.fell
        if plain and self._gain_fits(low, high):
            return Truth(True, self.case.lengths.law != "given", "slopes lie between two ends above 0, and l b below 2")
        known = first and self.alike and self.quiet and self._continuous_everywhere
        if known and self._never_nearer(low, high) and self.case.lengths.law != "given":
            return Truth(False, self.law.phi0 > 0, "the error of the first sample never falls")
        return UNKNOWN

    def transient(self) -> Truth:
        common = min(self.run.lengths)
        r = np.array(self.case.reference)
        mse = np.array([np.mean((r - x[0])[1 : common + 1] ** 2) for x in self.run.x])
        if len(mse) < 2:
            return UNKNOWN
        return _sided(mse[1:].max(), mse[0], "the error of the plain run over common samples")

    def asymptotic(self) -> Truth:
        due = self.same_plant and self.quiet and not self.run.fell
        found = self._map
        if found is None or self.run.fell:
            return UNKNOWN
        radius = float(np.abs(found[0]).max())
        if radius > 1 + CLEAR or (self.chain.degree > 1 and self._learns_one_ahead and radius == 1):
            return Truth(False, due, "a diagonal entry of the plain map is 1 or above")
        if radius < 1 - CLEAR and self.run.mse[-1] < self.run.mse[0] * (1 - CLEAR) and self.law.kind != "pd":
            return Truth(True, due, "all diagonal entries of the plain map are below 1, and its limit has no error")
        return UNKNOWN

    @property
    def _learns_one_ahead(self) -> bool:
        return self.law.kind != "pd"

    def monotone(self) -> Truth:
        found = self._map
        if found is None or self.run.fell:
            return UNKNOWN
        norm = float(np.linalg.norm(found[1], 2))
        if norm > 1 + 1e-5:
            return Truth(False, self.same_plant, "the plain map has a singular value above 1")
        if norm < 1 - 1e-3 and self.straight and self.alike and self.quiet and not self._rose:
            return Truth(True, True, "all singular values of the plain map are below 1")
        return UNKNOWN

    def peak(self) -> Truth:
        fixed = not self.law.estimates and self.law.kind != "pd"
        if self.straight and fixed and self.alike and self.quiet and not self.run.fell:
            return Truth(True, True, "plant and law are linear, so that the frozen map is the map of every trial")
        return UNKNOWN

    def increment_monotone(self) -> Truth:
        if not self._increments_known or self.chain.scale is not None:
            return UNKNOWN
        r, (low, high) = float(self._row_sums(1.0).max()), self.box.slope
        largest = self.law.rho / (2 * np.sqrt(self.law.lam))
        if low > r * (1 + 1e-4) + 1e-9 and largest * (high + r) < 2 - 1e-4:
            return Truth(True, self._followed, "row sums in closed form are below the least slope")
        off = self._off_along_the_wanted
        if off is not None and off > 1e-3 and self.straight:
            return Truth(False, True, "along the reference a row sum is above the slope")
        return UNKNOWN

    def increment_weighted(self) -> Truth:
        if not self._increments_known or self.chain.scale is not None:
            return UNKNOWN
        low, high = self.box.slope
        largest = self.law.rho / (2 * np.sqrt(self.law.lam))
        if low > 0 and largest * (high + low / 2) < 2 - 1e-3:
            return Truth(True, self._followed, "weights make the row sums as small as one likes")
        return UNKNOWN

    def increment_limit(self) -> Truth:
        low, high = self._slope_of_all
        plain = self.chain.degree == 1 and self.case.clipped is None and self.alike and self.quiet
        if plain and self._continuous_everywhere and self._gain_fits(low, high) and not self.run.fell:
            due = self.law.ends[0] > 0 and self.increment_funnel().due
            return Truth(True, due, "as for the conclusion of Theorem 1, within a funnel")
        if plain and low == high and self._never_nearer(low, high):
            return Truth(False, False, "the error of the first sample never falls, and there is no funnel to rest on")
        return UNKNOWN

    def increment_funnel(self) -> Truth:
        """A band there is of a plant that is linear; it is due where plain intervals make one that is narrow."""
        low, high = self._slope_of_all
        law = self.law
        if not (self.straight and self.chain.degree == 1 and self.case.clipped is None and low > CLEAR):
            return UNKNOWN
        if self.case.unbounded and (self.case.noise or self.case.drawn):
            return UNKNOWN
        if law.ends[0] < 0 or law.ends[1] * high > 1 - CLEAR or self.chain.changes:
            return UNKNOWN
        due = self._plain_width < 5 * np.ptp(self.case.reference)
        return Truth(
            True, bool(due), "the plant is linear, its slope positive, l b below 1, and plain bands are narrow"
        )

    @property
    def _plain_width(self) -> float:
        """The widest band of the output by intervals, of a linear plant whose inputs lie between plan and target."""
        output, _, _ = bands(self.case, None)
        return float(np.diff(output[1:]).max())

    def learning_curve(self) -> Truth:
        """There is a curve that falls where plain intervals, trial by trial, make one."""
        found = self.increment_funnel()
        if not found.holds:
            return UNKNOWN
        case, last = self.case, self.case.lengths.least(self.case.horizon)
        gain = np.array([float(self.chain.gain_at(Numbers, k)) for k in range(case.horizon)])
        shares = np.array(self.law.ends)[:, None, None] * (gain * float(self.chain.drive.slope(0.0)))[None, :, None]
        plans, curve = np.full((case.horizon, 2), self.law.first), []
        for _ in range(case.trials):
            output, _, targets = bands(self.case, plans)
            off = np.abs(np.array(case.reference)[:, None] - output).max(axis=1)[1 : last + 1]
            curve.append(float(np.mean(off**2)))
            moved = plans[None] + shares * (targets - plans)[None]
            plans = np.stack([moved[..., 0].min(axis=0), moved[..., 1].max(axis=0)], axis=-1)
        if curve[-1] < curve[0] * (1 - 1e-3):
            return Truth(True, found.due, "bounds by plain intervals fall from the first trial to the last")
        return UNKNOWN

    def does_not_diverge(self) -> Truth:
        return Truth(not self.run.fell, True, "so went the plain run")

    def error_falls(self) -> Truth:
        if self.run.fell:
            return Truth(False, True, "the plain run fell")
        common = min(self.run.lengths)
        r = np.array(self.case.reference)
        mse = np.array([np.mean((r - x[0])[1 : common + 1] ** 2) for x in self.run.x])
        if mse[-1] > mse[0] * (1 + CLEAR):
            return Truth(False, True, "the last error of the plain run is above the first")
        if mse[-1] < mse[0] * (1 - CLEAR):
            steps = np.diff(mse) < -CLEAR * mse[:-1]
            chance = stats.kendalltau(np.arange(mse.size), mse, alternative="less").pvalue
            clear = bool(steps.all() or mse[-1] > 1e-20) and 2 * chance < 0.04
            return Truth(True, clear, "the errors of the plain run fall, beyond chance")
        return UNKNOWN

    def estimate_useful(self) -> Truth:
        if len(self.run.u) < 2 or (self.run.fell and len(self.run.u) < 2):
            return UNKNOWN
        degree, n, half = self.chain.degree, self.case.horizon, len(self.run.u) // 2
        true = self._partials[half:]
        estimate = self._estimates[half:]
        with np.errstate(all="ignore"):
            off = np.abs(estimate - true) / np.abs(true)
            held = np.abs(self.law.phi0 - true) / np.abs(true)
        usable = np.isfinite(off) & np.isfinite(true) & (np.abs(true) > 1e-12)
        if not usable.any() or degree > n:
            return UNKNOWN
        return _sided(
            float(np.median(off[usable])), float(np.median(held[usable])), "the estimate's error", strict=True
        )

    def limit(self, name: str) -> Truth:
        low, high = (self.case.limits or {})[name]
        rows = [x[0] if name == "x0" else np.where(np.arange(u.size) < end, u, np.nan)
                for x, u, end in zip(self.run.x, self.run.u, self.run.lengths, strict=True)]  # fmt: skip
        least, most = np.nanmin(rows[0]), np.nanmax(rows[0])
        for row in rows:
            least, most = min(least, np.nanmin(row)), max(most, np.nanmax(row))
        room = min(np.inf if high is None else high - most, np.inf if low is None else least - low)
        if room < -CLEAR:
            return Truth(False, True, "a trial of the plain run leaves the bounds")
        found = self.increment_funnel() if self.law.increment else UNKNOWN
        if not found.holds:
            return UNKNOWN
        output, inputs, _ = bands(self.case, None)
        band = output if name == "x0" else inputs
        room = min(np.inf if high is None else high - band.max(), np.inf if low is None else band.min() - low)
        if room > CLEAR:
            return Truth(True, found.due, "the band by plain intervals lies within the bounds")
        return UNKNOWN

    # what several claims need

    @cached_property
    def _differences(self) -> tuple[Array, Array, Array]:
        """Return du and ds between consecutive trials, and the signal's size, (trials - 1, m)."""
        d, run = self.chain.degree, self.run
        signals = [np.concatenate([[np.nan], np.diff(x[0])]) if self.law.increment else x[0] for x in run.x]
        m = self.case.horizon - d + 1
        du, ds = np.full((len(run.u), m), np.nan), np.full((len(run.u), m), np.nan)
        for i in range(1, len(run.u)):
            du[i] = (run.u[i] - run.u[i - 1])[:m]
            ds[i] = (signals[i] - signals[i - 1])[d:]
        return du, ds, np.array([np.nanmax(np.abs(x)) for x in run.x])

    @cached_property
    def _usable(self) -> NDArray[np.bool_]:
        du, ds, _ = self._differences
        return np.isfinite(ds) & np.isfinite(du) & (du != 0)

    @property
    def ratios(self) -> tuple[Array, NDArray[np.bool_]]:
        """Return ds/du wherever there is one, and which of them rounding cannot turn."""
        du, ds, size = self._differences
        use = self._usable
        scale = max(1e-3, float(np.nanmax(size))) if size.size else 1.0
        clear = (np.abs(ds[use]) > 1e-7 * scale) & (np.abs(du[use]) > 1e-7 * scale)
        return ds[use] / du[use], clear

    @cached_property
    def _estimates(self) -> Array:
        m = self.case.horizon - self.chain.degree + 1
        return np.array([one.phi[:m] for one in self.run.memory[: len(self.run.u)]])

    @cached_property
    def _partials(self) -> Array:
        """dy(k+d)/du(k) along every trial, NaN where it was not reached."""
        d, n = self.chain.degree, self.case.horizon
        ahead = float(np.prod(self.chain.c[: d - 1]))
        rows = np.full((len(self.run.u), n - d + 1), np.nan)
        for i, (x, u, end) in enumerate(zip(self.run.x, self.run.u, self.run.lengths, strict=True)):
            for k in range(end - d + 1):
                rows[i, k] = ahead * self.chain.slopes(x[:, k], u[k], k)[1][d - 1]
        return rows

    @cached_property
    def _slope_of_all(self) -> tuple[float, float]:
        """The ends of dy(k+1)/du(k) over all states and inputs, as far as a thousand on either side shows."""
        region = Region(
            of=self.chain, x=((-1e3, 1e3),) * self.chain.states, u=(-1e3, 1e3), k=(0, self.case.horizon - 1)
        )
        return region.slope

    @property
    def _continuous_everywhere(self) -> bool:
        of = self.chain
        parts = [of.drive, of.drift, *([of.scale] if of.scale is not None else [])]
        good = all(not one.jumps and not one.misses and not one.poles and one.least == -np.inf for one in parts)
        return of.relay is None and good

    def _gain_fits(self, low: float, high: float) -> bool:
        least, most = self.law.ends
        return bool(np.isfinite(high)) and low > 1e-6 and least >= 0 and most > 0 and most * high < 2 - 1e-6

    def _never_nearer(self, low: float, high: float) -> bool:
        """Whether no trial brings the first sample nearer, for slopes between two ends."""
        first = self.run.x[0][0, 1] - self.case.reference[1] if self.run.x else 0.0
        least, most = self.law.ends
        if not np.isfinite([low, high]).all():
            return False
        beyond = (high < -CLEAR and most > 0 and least >= 0) or least * low > 2 + CLEAR
        return beyond and abs(first) > CLEAR

    @cached_property
    def _map(self) -> tuple[Array, Array] | None:
        """Return the diagonal of the map between trials along the last one, and the map of the learned signal's error.

        The last trial and the one after it are run to the horizon, with the gains that the last one leads to.
        """
        run, case, n, d = self.run, self.case, self.case.horizon, self.chain.degree
        if not run.u or case.chain.changes:
            return None
        x0, w, r = run.x[-1][:, 0], run.w[-1], np.array(case.reference)
        memory = run.memory[len(run.u) - 1]
        noise = np.nan_to_num(run.seen[-1] - run.x[-1][0])
        if case.noise:
            return None
        states = trial(case, memory.u, x0, w, n, 1.0)
        if not np.isfinite(states).all():
            return None
        after: Memory = learned(self.law, memory, states[0] + noise, r, n)
        following = trial(case, after.u, x0, w, n, 1.0)
        if not np.isfinite(following).all():
            return None
        G = _lifted(self.chain, following, after.u, self.law.increment)[d - 1 :, :]
        L = np.zeros((n, n))
        L[np.arange(n), np.arange(n)] = gains(self.law, after)
        if self.law.kind == "pd":
            L[np.arange(1, n), np.arange(n - 1)] = self.law.back
        made = np.eye(n - d + 1) - G @ L[:, d - 1 :]
        return np.diag(made), made

    @property
    def _rose(self) -> bool:
        """Whether the norm of what is learned on grew between two full trials of the plain run."""
        r, n, run = np.array(self.case.reference), self.case.horizon, self.run
        errors = [np.diff(r - x[0]) if self.law.increment else (r - x[0])[1:] for x in run.x]
        norms = [float(np.linalg.norm(one)) for one in errors]
        both = [
            (a, b) for a, b, i, j in zip(norms, norms[1:], run.lengths, run.lengths[1:], strict=False) if i == j == n
        ]
        return any(b > a * (1 + 1e-7) for a, b in both)

    @property
    def _increments_known(self) -> bool:
        """Whether the theorems on increments speak of the case, whose equations are well behaved on the box."""
        first = self.chain.degree == 1 and self.case.clipped is None and self.law.phi0 > 0
        kept = np.isfinite(self.chain.ceiling)
        return first and self.alike and self.quiet and self.box.unbroken and not kept

    def _row_sums(self, weight: float) -> Array:
        A, B = self.box.magnitudes()
        of = self.chain
        drift = of.drift.slopes(*self.box.x[0]) if of.row == 0 else (0.0, 0.0)
        c = A[0].copy()
        c[0] = max(abs(of.a[0] - 1 + one) for one in drift)
        rows, reach = np.zeros(self.case.horizon), np.zeros(of.states)
        for k in range(self.case.horizon):
            rows[k] = c @ reach
            reach = weight * (A @ reach + B)
        return rows

    @cached_property
    def _wanted(self) -> tuple[Array, Array] | None:
        """The inputs that follow the reference's increments, with their states, where the plant is linear."""
        if not self.straight:
            return None
        case, n = self.case, self.case.horizon
        x = np.zeros((self.chain.states, n + 1))
        x[:, 0], u, w = self.run.x[0][:, 0], np.zeros(n), self.run.w[0]
        for k in range(n):
            free = self.chain.step(Numbers, x[:, k], 0.0, w[k], k)
            b = float(self.chain.slopes(x[:, k], 0.0, k)[1][0])
            if b == 0:
                return None
            u[k] = (case.reference[k + 1] - case.reference[k] + x[0, k] - free[0]) / b
            x[:, k + 1] = self.chain.step(Numbers, x[:, k], u[k], w[k], k)
        return x, u

    @property
    def _followed(self) -> bool:
        """Whether the wanted inputs and their states lie well inside the box."""
        found = self._wanted
        if found is None:
            return False
        rows, ends = (*found[0], found[1]), (*self.box.x, self.box.u)
        room = [1e-4 * (high - low) for low, high in ends]
        return all(
            low + spare < row.min() and row.max() < high - spare
            for row, (low, high), spare in zip(rows, ends, room, strict=True)
        )

    @property
    def _off_along_the_wanted(self) -> float | None:
        """By how much the row sum off the diagonal exceeds the slope, along the wanted inputs, over the slope."""
        found = self._wanted
        if found is None:
            return None
        G = _lifted(self.chain, found[0], found[1], True)
        own = np.diag(G)
        off = np.abs(G).sum(axis=1) - np.abs(own)
        return float(((off - own) / own).max()) if (own > 0).all() else None


def _lifted(of: Chain, x: Array, u: Array, increment: bool) -> Array:
    """Return ds(k+1)/du(j) along a trial, (N, N)."""
    n = u.size
    G, reach = np.zeros((n, n)), np.zeros((of.states, n))
    before = np.zeros(n)
    for k in range(n):
        A, B = of.slopes(x[:, k], float(u[k]), k)
        reach = A @ reach
        reach[:, k] += B
        G[k] = reach[0] - before if increment else reach[0]
        before = reach[0].copy()
    return G


def _region(of: Chain, box: Ends) -> Region:
    low, high = (end.ravel() for end in box["x"])
    first, last = (int(end.ravel()[0]) for end in box["k"])
    u = tuple(float(end.ravel()[0]) for end in box["u"])
    return Region(
        of=of,
        x=tuple((float(a), float(b)) for a, b in zip(low, high, strict=True))[: of.states],
        u=(u[0], u[1]),
        k=(first, last - (of.degree - 1)),
    )


def _inner(ends: tuple[float, float]) -> tuple[float, float]:
    room = 1e-3 * (ends[1] - ends[0])
    return ends[0] + room, ends[1] - room


def _well_inside(hull: Region) -> bool:
    """Whether what breaks the slope by the input lies well inside of what trials met, or breaks it anywhere."""
    smaller = Region(of=hull.of, x=tuple(_inner(one) for one in hull.x), u=_inner(hull.u), k=hull.k)
    return not smaller.smooth_in_u


def _sided(value: float, edge: float, what: str, *, strict: bool = False) -> Truth:
    """Return whether a value lies below an edge, where rounding cannot turn that."""
    room = CLEAR * max(abs(edge), abs(value), 1e-12)
    if value < edge - room:
        return Truth(True, True, f"{what} is smaller")
    if value > edge + room:
        return Truth(False, True, f"{what} is larger")
    return UNKNOWN


CLAIMS = {
    "A1": Known.A1,
    "A2.printed": Known.A2_printed,
    "A2.lifted": Known.A2_lifted,
    "A3": Known.A3,
    "A4.printed": Known.A4_printed,
    "A4.partial": Known.A4_partial,
    "lemma1": Known.A2_printed,
    "estimator": Known.estimator,
    "lambda_min.partial": Known.lambda_partial,
    "lambda_min.realised": Known.lambda_realised,
    "theorem1": Known.theorem1,
    "theorem1.conclusion": Known.conclusion,
    "theorem1.transient": Known.transient,
    "asymptotic": Known.asymptotic,
    "monotone": Known.monotone,
    "peak": Known.peak,
    "increment_monotone": Known.increment_monotone,
    "increment_weighted": Known.increment_weighted,
    "increment_funnel": Known.increment_funnel,
    "increment_limit": Known.increment_limit,
    "learning_curve": Known.learning_curve,
    "does_not_diverge": Known.does_not_diverge,
    "error_falls": Known.error_falls,
    "estimate_useful": Known.estimate_useful,
}
"""Of which the truth is known from a case's parameters."""


def truth(known: Known, claim: str) -> Truth:
    """Return what is true of a claim (its name without the study's)."""
    if claim.startswith("limit."):
        return known.limit(claim.removeprefix("limit."))
    if claim not in CLAIMS:
        return UNKNOWN
    holds, due, why = CLAIMS[claim](known)
    ran = len(known.run.u) > 1 or claim in ("does_not_diverge", "error_falls")
    return Truth(None if holds is None else bool(holds), bool(due) and ran, why)


__all__: Sequence[str] = ("CLAIMS", "Known", "Truth", "truth")
