"""What must hold of a tube's design, checked on any :class:`workbench.predictive.Tube`, each check a finding."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from fractions import Fraction

import numpy as np

from models.quantity import InvalidValue
from verification.checks import exact_tube
from verification.checks.exact_tube import ROUNDING
from workbench.contracts.claim import Held, NotCertified
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.predictive import Tube
from workbench.predictive.regulator import decrease, lmi, relative
from workbench.sets import TOLERANCE, minimal_rpi, spectral_radius
from workbench.sets.array import Array
from workbench.sets.linear_program import minimise

POWERS = 100
"""Powers of a loop that a bound of its radius is held against."""

INSIDE = 1e-7
"""By how much rounding may leave a witness outside the set that it is from, a share of the set's width."""

FAR = 1e3
"""How many times its width beyond a face a set without end in that direction is looked at."""

FLOAT = "floating point; nothing here rounds outward"


def schur(tube: Tube) -> Finding:
    """A + b K is Schur: its spectral radius is below 1."""
    values = np.linalg.eigvals(tube.A_cl)
    radius = spectral_radius(tube.A_cl)
    witness = {"eigenvalues": [str(np.round(value, 9)) for value in values], "spectral radius": radius}
    finding = Finding(
        grounds=Grounds.NUMERICS, margin=1 - radius, unit="1", witness=witness, method="eigenvalues in floating point"
    )
    exact = _exactly(
        finding,
        lambda: exact_tube.schur(tube),
        "P > 0 and r^2 P - (A + b K)'P (A + b K) > 0 in exact rational arithmetic, with A, b and K as stored",
    )
    if exact.grounds is not Grounds.ALGEBRA or exact.margin is None:
        return exact
    return dataclasses.replace(exact, bound=1 - exact.margin, bound_unit="1, the largest modulus of an eigenvalue")


def held_by_powers(tube: Tube, finding: Finding) -> Held:
    """Hold a proved bound of the radius against powers of A + b K: n times its k-th power is no less than |tr M^k|."""
    bound = 1.0 if finding.bound is None else finding.bound
    powers = [np.linalg.matrix_power(tube.A_cl, k) for k in range(1, POWERS + 1)]
    rates = [float(abs(np.trace(power)) / len(power)) ** (1 / k) for k, power in enumerate(powers, 1)]
    worst = int(np.argmax(rates))
    return Held(POWERS, bound + ROUNDING - rates[worst], {"power": worst + 1, "radius at least": rates[worst]})


def hurwitz_as_printed(tube: Tube) -> Finding:
    """A + b K is Hurwitz, as printed: every eigenvalue has a negative real part.

    The trace is the sum of the eigenvalues: where it is not negative, exactly, one of them has no negative real part.
    """
    values = np.linalg.eigvals(tube.A_cl)
    worst = values[int(np.argmax(values.real))]
    mean = sum((Fraction(entry) for entry in np.diag(tube.A_cl).tolist()), Fraction(0)) / len(tube.A_cl)
    witness = {
        "eigenvalue": str(np.round(worst, 9)),
        "modulus": float(abs(worst)),
        "spectral radius": spectral_radius(tube.A_cl),
        "mean of the eigenvalues": float(mean),
    }
    said = "the printed test is that of continuous time, and a gain that is Schur fails it"
    if mean >= 0:
        return Finding(
            grounds=Grounds.ALGEBRA,
            margin=-float(mean),
            unit="1, the mean real part",
            witness=witness,
            method=f"the trace of A + b K, the sum of its eigenvalues, exactly in rationals; {said}",
        )
    return Finding(
        grounds=Grounds.NUMERICS,
        margin=-float(worst.real),
        unit="1",
        witness=witness,
        method=f"eigenvalues in floating point; {said}",
    )


def lyapunov(tube: Tube) -> Finding:
    """Equality in (19) but for rounding: the residual of P = A_cl'P A_cl + Q + R K'K is at most 1e-9 of P."""
    residual = decrease(tube.A_cl, tube.K, tube.Q, tube.R, tube.P)
    shares = np.abs(relative(residual, tube.P, tube.Q))
    i, j = np.unravel_index(int(np.argmax(shares)), residual.shape)
    size = float(shares[i, j])
    finding = Finding(
        grounds=Grounds.NUMERICS,
        margin=ROUNDING - size,
        unit="of P",
        weak=True,
        bound=size,
        bound_unit="of P",
        witness={"row": int(i), "column": int(j), "residual": float(residual[i, j]), "P": tube.P},
        method=f"residual {size:.3g} of P, each state in the unit in which P has a one; "
        f"{ROUNDING:g} counts as rounding",
    )
    said = "that it lies between -1e-9 P and 1e-9 P is shown in exact rational arithmetic, with all as stored"
    return _exactly(finding, lambda: exact_tube.equality(tube), said)


def lmi20(tube: Tube) -> Finding:
    """The matrix of (20) is positive semidefinite, P raised by no more than 1e-9 of itself.

    Raised so, the matrix is no larger than with 1e-9 P added to its first block, for what is raised and then falls.
    """
    matrix, n = lmi(tube.A_cl, tube.K, tube.Q, tube.R, tube.P), tube.plant.order
    # a congruence that gives P, and with it the stage cost, ones on the diagonal: signs of eigenvalues stay
    own = np.diag(relative(np.eye(n), tube.P, tube.Q)) ** 0.5
    scale = np.r_[own, np.ones(n + 1)]
    least = float(np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0])
    matrix[:n, :n] += ROUNDING * tube.P
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    finding = Finding(
        grounds=Grounds.NUMERICS,
        margin=float(values[0]),
        unit="of P",
        weak=True,
        bound=least,
        bound_unit="of P, the least eigenvalue",
        witness={"eigenvalue": least, "eigenvector": vectors[:, 0] * scale},
        method=f"smallest eigenvalue {least:.3g}, each state in the unit in which P has a one: 0 but for rounding "
        f"where (19) is an equality; with {ROUNDING:g} P added {values[0]:.3g}",
    )
    said = "with P raised by less, (19) holds strictly in exact rational arithmetic, with all as stored"
    return _exactly(finding, lambda: exact_tube.raised(tube), said)


def tube_inside(tube: Tube) -> Finding:
    """Z, the tube in the end, lies inside Sigma; (16)."""
    minimal = minimal_rpi(tube.A_cl, tube.W_z)
    room = (tube.Sigma.h - minimal.support(tube.Sigma.H)) / tube.Sigma.sizes
    worst = int(np.argmin(room))
    finding = Finding(
        grounds=Grounds.NUMERICS,
        margin=float(room[worst]) + TOLERANCE,
        unit="of Sigma's width",
        weak=True,
        bound=float(room[worst]),
        bound_unit="of Sigma's width, the least room",
        witness={"face": tube.Sigma.labels[worst], "point": minimal.partial.extreme(tube.Sigma.H[worst])},
        method=f"support function of Z, its tail bounded, along each of {len(room)} faces, {TOLERANCE:g} of the width "
        "counts as rounding",
    )
    said = "between Z and Sigma lies an invariant set that holds 0, shown row by row in exact rational arithmetic"
    return _exactly(finding, lambda: exact_tube.limit_inside(tube), said)


def rpi(tube: Tube) -> Finding:
    """Sigma drawn in by rounding, 1e-9 of its width at most, is robust positively invariant under A_cl e + A^l w.

    Where a point of Sigma drawn in by so much is carried out of Sigma, no set in between is invariant.
    """
    Sigma = tube.Sigma
    inner = Sigma.h - TOLERANCE * Sigma.sizes
    worst, at = -np.inf, {}
    for row, offset, size, label in zip(Sigma.H, Sigma.h, Sigma.sizes, Sigma.labels, strict=True):
        ahead = row @ tube.A_cl
        answer = minimise(-ahead, Sigma.H, inner)
        if answer.status == "unbounded":  # a point far out says the same and can be replayed
            answer = minimise(-ahead, np.vstack([Sigma.H, ahead]), np.r_[inner, offset + FAR * size])
        if answer.status != "optimal":
            return undecided(f"how far Sigma reaches along '{label}' could not be found; a larger room would tell")
        w = tube.W_z.extreme(row)
        excess = (Sigma.H @ (tube.A_cl @ answer.x + w) - Sigma.h) / Sigma.sizes
        face = int(np.argmax(excess))
        if excess[face] > worst:
            worst, at = float(excess[face]), {"face": Sigma.labels[face], "e": answer.x, "w": w}
    finding = Finding(
        grounds=Grounds.NUMERICS,
        margin=-worst,
        unit="of Sigma's width",
        weak=True,
        bound=worst,
        bound_unit="of Sigma's width, the farthest outside",
        witness={**at, "leaves by": worst},
        method=f"one linear program a face, {len(Sigma.h)} faces, from Sigma drawn in by {TOLERANCE:g} of the width",
    )
    said = "a set between Sigma and Sigma so drawn in is invariant, shown row by row in exact rational arithmetic"
    return _exactly(finding, lambda: exact_tube.invariant(tube), said)


def rpi_margin(tube: Tube, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`rpi` at a witness: its e in Sigma and w in A^l W, taken one sample on.

    Raises InvalidValue for a witness that lies in neither.
    """
    Sigma, e, w = tube.Sigma, vector(witness, "e"), vector(witness, "w")
    if Sigma.violation(e) > INSIDE or not tube.W_z.contains(w, tolerance=INSIDE):
        raise InvalidValue("the witness must lie in Sigma and in A^l W, and does not")
    return -float(((Sigma.H @ (tube.A_cl @ e + w) - Sigma.h) / Sigma.sizes).max())


def horizon27(tube: Tube, N: int) -> Finding:
    """R_{M+N}^M lies inside Sigma for every hold M = 1 ... N-1; (27)."""
    excess = {M: tube.held_excess(M, N) for M in range(1, N)}
    worst = max(excess, key=lambda M: excess[M].share)
    out = {M: found for M, found in excess.items() if found.share > TOLERANCE}
    reach = tube.R_hold(worst, worst + N)
    face = tube.Sigma.labels.index(excess[worst].label)
    witness: dict[str, object] = {
        "M": worst,
        "face": excess[worst].label,
        "point of the tube": reach.extreme(tube.Sigma.H[face]),
        "excess by M": {M: found.distance for M, found in excess.items()},
    }
    fails = f"fails for M = {', '.join(map(str, out))}, which are never offered; " if out else ""
    finding = Finding(
        grounds=Grounds.NUMERICS,
        margin=TOLERANCE - excess[worst].share,
        unit="of Sigma's width",
        weak=True,
        bound=excess[worst].share,
        bound_unit="of Sigma's width, the farthest outside",
        witness=witness,
        method=f"{fails}support function of each tube along every face of Sigma",
    )
    said = "so in exact rational arithmetic, with A, b, K, W and Sigma as stored"
    return _exactly(finding, lambda: exact_tube.horizon27(tube, N), said)


def horizon27_margin(tube: Tube, N: int, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`horizon27` at a witness: how far its point, which the tube reaches, is outside.

    Raises InvalidValue for a point that the tube does not reach.
    """
    point, M, Sigma = vector(witness, "point of the tube"), int(str(witness["M"])), tube.Sigma
    if not tube.R_hold(M, M + N).contains(point, tolerance=INSIDE):
        raise InvalidValue("the witness must be a point that the tube reaches, and is not")
    return TOLERANCE - float(((Sigma.H @ point - Sigma.h) / Sigma.sizes).max())


def tightening_sound(
    tube: Tube, stages: int, *, holds: tuple[int, ...] = (), sequences: int = 20, seed: int = 0
) -> Finding:
    """No disturbance moves the true error further from its plan than the bounds were tightened by.

    The error x(k+l) of the plant with its true delay is simulated from rest against W: the sequence that is extreme
    for each bound, and random ones of W's vertices. Stages run under feedback, or held for M first for M in ``holds``.
    The plant is linear, so that the extreme sequence of a bound is the worst of all but for rounding.
    """
    plant, bounds, random = tube.plant, tube.bounds, np.random.default_rng(seed)
    simulated, worst, witness = 0, np.inf, {}
    for M in (0, *holds):
        for i in range(stages + M):
            maps = _responses(tube, i, M)
            signs = random.choice([-1.0, 1.0], (sequences, len(maps), plant.W.generators.shape[1]))
            drawn = plant.W.center + signs @ plant.W.generators.T
            extreme = [np.array([plant.W.extreme(row @ m) for m in maps]) for row in bounds.H]
            for w in (*extreme, *drawn):
                slack = _slack(tube, w.reshape(len(maps), plant.order), i, M)
                simulated, row = simulated + 1, int(np.argmin(slack))
                if slack[row] < worst:
                    worst = float(slack[row])
                    witness = {"M": M, "stage": i, "bound": bounds.labels[row], "short by": -worst, "w": w}
    finding = Finding(
        grounds=Grounds.NUMERICS,
        margin=worst + TOLERANCE,
        unit="of the bounds' width",
        weak=True,
        tries=simulated,
        bound=worst,
        bound_unit="of the bounds' width, the least room",
        witness=witness,
        method=f"{simulated} simulated disturbance sequences, the extreme one of every bound and stage among them, "
        f"which is the worst of all because the plant is linear, {TOLERANCE:g} of the width counts as rounding",
    )
    said = "the sums that they are reach no further, in exact rational arithmetic, with A, b, K and W as stored"
    return _exactly(finding, lambda: exact_tube.tightening(tube, stages, holds), said)


def tightening_margin(tube: Tube, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`tightening_sound` under the disturbances of a witness alone."""
    M, stage = int(str(witness["M"])), int(str(witness["stage"]))
    w = np.asarray(witness["w"], dtype=float).reshape(-1, tube.plant.order)
    return float(_slack(tube, w, stage, M).min()) + TOLERANCE


def _exactly(finding: Finding, prove: Callable[[], exact_tube.Shown], said: str) -> Finding:
    """Return what floating point found, on grounds of algebra and with the exact margin where it is shown exactly."""
    if finding.fails:
        return dataclasses.replace(finding, method=f"{finding.method}; {FLOAT}")
    try:
        margin = prove().margin
    except NotCertified as error:
        return dataclasses.replace(finding, method=f"{finding.method}; {FLOAT}: {error}")
    return dataclasses.replace(finding, grounds=Grounds.ALGEBRA, margin=margin, method=f"{finding.method}; {said}")


def vector(witness: Mapping[str, object], name: str) -> Array:
    """Return a row of numbers of a witness."""
    return np.asarray(witness[name], dtype=float)


def _slack(tube: Tube, w: Array, stage: int, M: int) -> Array:
    """Return by how much each bound was tightened more than w, (stage + l, n), moves the true error, as shares."""
    bounds = tube.bounds
    kept = tube.held_stage_bounds(M, stage) if M else tube.stage_bounds(stage)
    slack: Array = (bounds.h - kept.h - bounds.H @ _simulated(tube, w, stage, M)) / bounds.sizes
    return slack


def _responses(tube: Tube, stage: int, M: int) -> list[Array]:
    """Return how each disturbance w(0), w(1), ... moves x(stage + l), one matrix (n, n) a sample."""
    plant = tube.plant
    found = []
    for k in range(stage + plant.delay):
        w = np.zeros((stage + plant.delay, plant.order, plant.order))
        w[k] = np.eye(plant.order)
        found.append(np.stack([_simulated(tube, w[:, :, j], stage, M) for j in range(plant.order)], axis=1))
    return found


def _simulated(tube: Tube, w: Array, stage: int, M: int) -> Array:
    """Return x(stage + l) from rest under w, the plant stepped with its delay and the input K (z - plan), plan = 0."""
    plant = tube.plant
    x, line = np.zeros(plant.order), [0.0] * plant.delay
    for k in range(stage + plant.delay):
        z = plant.predict(x, line)
        du = float(tube.K @ z) if M <= k < stage else 0.0
        line = [*line, du]
        x = plant.A @ x + plant.b * line[0] + w[k]
        line = line[1:]
    return x
