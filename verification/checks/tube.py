"""What must hold of a tube's design, checked on any :class:`workbench.predictive.Tube`, each check a finding."""

from __future__ import annotations

import numpy as np

from verification.enclosure.exact_schur import closed_loop, proved_schur
from workbench.contracts.verdict import Finding, Standing, undecided
from workbench.predictive import Tube
from workbench.predictive.regulator import decrease, lmi, relative
from workbench.sets import TOLERANCE, minimal_rpi, spectral_radius
from workbench.sets.array import Array
from workbench.sets.balance import state_units
from workbench.sets.linear_program import minimise

ROUNDING = 1e-9
"""Residual of a matrix equation that counts as rounding, relative to P, state by state."""

FAR = 1e3
"""How many times its width beyond a face a set without end in that direction is looked at."""

FLOAT = "floating point; nothing here rounds outward"


def schur(tube: Tube) -> Finding:
    """A + b K is Schur: its spectral radius is below 1."""
    values = np.linalg.eigvals(tube.A_cl)
    radius = spectral_radius(tube.A_cl)
    witness = {"eigenvalues": [str(np.round(value, 9)) for value in values], "spectral radius": radius}
    if radius >= 1:
        method = "eigenvalues in floating point"
        return Finding(standing=Standing.REFUTED, margin=1 - radius, unit="1", witness=witness, method=method)
    units = state_units(tube.A_cl)  # powers of two: the same loop, exactly
    A = tube.plant.A * units / units[:, None]
    if proved_schur(closed_loop(A.tolist(), (tube.plant.b / units).tolist(), (tube.K * units).tolist())):
        return Finding(
            standing=Standing.PROVED,
            margin=1 - radius,
            unit="1",
            witness=witness,
            method="P > 0 and P - A_cl'P A_cl > 0 in exact rational arithmetic, with A, b and K as stored",
        )
    method = "eigenvalues in floating point; no exact proof was found"
    return Finding(standing=Standing.SUPPORTED, margin=1 - radius, unit="1", witness=witness, method=method)


def hurwitz_as_printed(tube: Tube) -> Finding:
    """A + b K is Hurwitz, as printed: every eigenvalue has a negative real part."""
    values = np.linalg.eigvals(tube.A_cl)
    worst = values[int(np.argmax(values.real))]
    witness = {"eigenvalue": str(worst), "modulus": float(abs(worst)), "spectral radius": spectral_radius(tube.A_cl)}
    good = worst.real < 0
    return Finding(
        standing=Standing.SUPPORTED if good else Standing.REFUTED,
        margin=-float(worst.real),
        unit="1",
        witness=witness,
        method="eigenvalues; the printed test is that of continuous time, and a gain that is Schur fails it",
    )


def lyapunov(tube: Tube) -> Finding:
    """Equality in (19): the residual of P = A_cl'P A_cl + Q + R K'K is rounding."""
    residual = decrease(tube.A_cl, tube.K, tube.Q, tube.R, tube.P)
    shares = np.abs(relative(residual, tube.P, tube.Q))
    i, j = np.unravel_index(int(np.argmax(shares)), residual.shape)
    size = float(shares[i, j])
    return Finding(
        standing=Standing.SUPPORTED if size <= ROUNDING else Standing.REFUTED,
        margin=ROUNDING - size,
        unit="of P",
        witness={"row": int(i), "column": int(j), "residual": float(residual[i, j]), "P": tube.P},
        method=f"residual {size:.3g} of P, each state in the unit in which P has a one; {FLOAT}",
    )


def lmi20(tube: Tube) -> Finding:
    """The matrix of (20) is positive semidefinite."""
    matrix, n = lmi(tube.A_cl, tube.K, tube.Q, tube.R, tube.P), tube.plant.order
    # a congruence that gives P, and with it the stage cost, ones on the diagonal: signs of eigenvalues stay
    own = np.diag(relative(np.eye(n), tube.P, tube.Q)) ** 0.5
    scale = np.r_[own, np.ones(n + 1)]
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    least = float(values[0])
    return Finding(
        standing=Standing.SUPPORTED if least >= -ROUNDING else Standing.REFUTED,
        margin=least + ROUNDING,
        unit="of P",
        witness={"eigenvalue": least, "eigenvector": vectors[:, 0] * scale},
        method=f"smallest eigenvalue, each state in the unit in which P has a one: 0 but for rounding ({ROUNDING:g}) "
        f"where (19) is an equality; {FLOAT}",
    )


def tube_inside(tube: Tube) -> Finding:
    """Z, the tube in the end, lies inside Sigma; (16)."""
    minimal = minimal_rpi(tube.A_cl, tube.W_z)
    room = (tube.Sigma.h - minimal.support(tube.Sigma.H)) / tube.Sigma.sizes
    worst = int(np.argmin(room))
    return Finding(
        standing=Standing.SUPPORTED if room[worst] >= -TOLERANCE else Standing.REFUTED,
        margin=float(room[worst]),
        unit="of Sigma's width",
        witness={"face": tube.Sigma.labels[worst], "point": minimal.partial.extreme(tube.Sigma.H[worst])},
        method=f"support function of Z, its tail bounded, along each of {len(room)} faces; {FLOAT}",
    )


def rpi(tube: Tube) -> Finding:
    """Sigma is robust positively invariant: A_cl Sigma + A^l W lies inside Sigma."""
    Sigma = tube.Sigma
    worst, at = -np.inf, {}
    for row, offset, size, label in zip(Sigma.H, Sigma.h, Sigma.sizes, Sigma.labels, strict=True):
        ahead = row @ tube.A_cl
        answer = minimise(-ahead, Sigma.H, Sigma.h)
        if answer.status == "unbounded":  # a point far out says the same and can be replayed
            answer = minimise(-ahead, np.vstack([Sigma.H, ahead]), np.r_[Sigma.h, offset + FAR * size])
        if answer.status != "optimal":
            return undecided(f"the linear program along '{label}' came out {answer.status}")
        w = tube.W_z.extreme(row)
        excess = (Sigma.H @ (tube.A_cl @ answer.x + w) - Sigma.h) / Sigma.sizes
        face = int(np.argmax(excess))
        if excess[face] > worst:
            worst, at = float(excess[face]), {"face": Sigma.labels[face], "e": answer.x, "w": w}
    return Finding(
        standing=Standing.SUPPORTED if worst <= TOLERANCE else Standing.REFUTED,
        margin=TOLERANCE - worst,
        unit="of Sigma's width",
        witness={**at, "leaves by": worst},
        method=f"one linear program a face, {len(Sigma.h)} faces, residual allowed {TOLERANCE:g} of the width; {FLOAT}",
    )


def horizon27(tube: Tube, N: int) -> Finding:
    """R_{M+N}^M lies inside Sigma for every hold M = 1 ... N-1; (27)."""
    excess = {M: tube.held_excess(M, N) for M in range(1, N)}
    worst = max(excess, key=lambda M: excess[M].share)
    out = {M: found for M, found in excess.items() if found.share > TOLERANCE}
    first = min(out, default=worst)
    reach = tube.R_hold(first, first + N)
    face = tube.Sigma.labels.index(excess[first].label)
    witness: dict[str, object] = {
        "M": first,
        "face": excess[first].label,
        "point of the tube": reach.extreme(tube.Sigma.H[face]),
        "excess by M": {M: found.distance for M, found in excess.items()},
    }
    said = f"fails for M = {', '.join(map(str, out))}, which are never offered; " if out else ""
    return Finding(
        standing=Standing.REFUTED if out else Standing.SUPPORTED,
        margin=-excess[worst].share,
        unit="of Sigma's width",
        witness=witness,
        method=f"{said}support function of each tube along every face of Sigma; {FLOAT}",
    )


def tightening_sound(
    tube: Tube, stages: int, *, holds: tuple[int, ...] = (), sequences: int = 20, seed: int = 0
) -> Finding:
    """No disturbance moves the true error further from its plan than the bounds were tightened by.

    The error x(k+l) of the plant with its true delay is simulated from rest against W: the sequence that is extreme
    for each bound, and random ones of W's vertices. Stages run under feedback, or held for M first for M in ``holds``.
    """
    plant, bounds, random = tube.plant, tube.bounds, np.random.default_rng(seed)
    simulated, worst, witness = 0, np.inf, {}
    for M in (0, *holds):
        for i in range(stages + M):
            kept = tube.held_stage_bounds(M, i) if M else tube.stage_bounds(i)
            maps = _responses(tube, i, M)
            signs = random.choice([-1.0, 1.0], (sequences, len(maps), plant.W.generators.shape[1]))
            drawn = plant.W.center + signs @ plant.W.generators.T
            extreme = [np.array([plant.W.extreme(row @ m) for m in maps]) for row in bounds.H]
            for w in (*extreme, *drawn):
                moved = bounds.H @ _simulated(tube, w.reshape(len(maps), plant.order), i, M)
                slack = (bounds.h - kept.h - moved) / bounds.sizes
                simulated, row = simulated + 1, int(np.argmin(slack))
                if slack[row] < worst:
                    worst = float(slack[row])
                    allowed = float(bounds.h[row] - kept.h[row])
                    witness = {"M": M, "stage": i, "bound": bounds.labels[row], "tightened by": allowed, "w": w}
    return Finding(
        standing=Standing.SUPPORTED if worst >= -TOLERANCE else Standing.REFUTED,
        margin=worst + TOLERANCE,
        unit="of the bounds' width",
        witness=witness,
        method=f"{simulated} simulated disturbance sequences, the extreme one of every bound and stage among them",
    )


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
