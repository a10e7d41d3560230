"""What holds of a tube in exact arithmetic: its matrices and sets as stored, in rationals, and their certificates."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from flint import fmpq
from scipy.linalg import solve_discrete_lyapunov

from verification.certificates.bounds import NotShown
from verification.certificates.loops import contracting, definite
from verification.certificates.matrices import Formula, Matrix
from verification.certificates.sets import Inclusion, Need, Space, Term, drawn_in
from verification.enclosure.exact_schur import closed_loop, contraction
from workbench.contracts.certificate import Certificate
from workbench.predictive import Tube
from workbench.sets import TOLERANCE, Polytope
from workbench.sets.array import Array
from workbench.sets.balance import state_units

LOOP: Formula = ("+", "A", ("*", "b", "K"))
ONE: Formula = ("^", "A", 0)
ROUNDING = 1e-9
"""What counts as rounding of a weight, as a share of it, state by state."""


class Shown(NamedTuple):
    """What was shown: how far it is from failing, exactly and then rounded, and the certificate."""

    margin: float
    certificate: Certificate


@lru_cache(maxsize=16)
def schur(tube: Tube) -> tuple[Fraction, Certificate]:
    """Return a number below 1 that every eigenvalue of A + b K is smaller than. Raises NotShown where none was found.

    States are taken in units that are powers of two, in which the matrices are near one: the same loop, exactly.
    """
    plant, units = tube.plant, state_units(tube.A_cl)
    A = plant.A * units / units[:, None]
    found = contraction(closed_loop(A.tolist(), (plant.b / units).tolist(), (tube.K * units).tolist()))
    if found is None:
        raise NotShown("no norm was found in which A + b K contracts")
    own = [Fraction(one) for one in units.tolist()]
    norm = [[entry / (a * b) for entry, b in zip(line, own, strict=True)] for line, a in zip(found.norm, own, strict=True)]
    says = f"Every eigenvalue of A + b K is smaller than {found.radius} in modulus, as r = {found.radius} shows."
    return found.radius, contracting(says, _matrices(tube), LOOP, found.radius, norm)


@lru_cache(maxsize=16)
def equality(tube: Tube) -> Certificate:
    """Return the certificate that P satisfies (19) with equality but for rounding. Raises NotShown where it does not."""
    says = "The residual of P = (A + b K)'P (A + b K) + Q + K'R K lies between -D and D, D being 1e-9 of P or Q."
    matrices = {**_costs(tube), "P": tube.P.tolist(), "D": _small(tube)}
    return definite(says, matrices, [("+", "D", _falls("P")), ("-", "D", _falls("P"))])


@lru_cache(maxsize=16)
def raised(tube: Tube) -> Certificate:
    """Return the certificate that (20) is met once P is raised by rounding. Raises NotShown where it is not."""
    says = (
        "P+, which is P raised by less than D, 1e-9 of P or Q, meets P+ > (A + b K)'P+ (A + b K) + Q + K'R K: by a "
        "Schur complement the matrix of (20) is positive definite, whatever root of Q stands in it."
    )
    weights = np.diag([float(line[i]) for i, line in enumerate(_small(tube))])
    units = state_units(tube.A_cl)
    scaled = tube.A_cl * units / units[:, None]
    up = np.asarray(solve_discrete_lyapunov(scaled.T, weights * np.outer(units, units))) / np.outer(units, units)
    if not np.isfinite(up).all():
        raise NotShown("P could not be raised")
    up = (up + up.T) / 2
    own = np.sqrt(np.diag(weights))
    share = 0.5 / float(np.linalg.eigvalsh(up / np.outer(own, own))[-1]) if (own > 0).all() else 0.0
    up = tube.P + share * up
    matrices = {**_costs(tube), "P": tube.P.tolist(), "P+": up.tolist(), "D": _small(tube)}
    return definite(says, matrices, [("-", "P+", "P"), ("-", "D", ("-", "P+", "P")), _falls("P+")])


def _costs(tube: Tube) -> dict[str, Matrix]:
    return {**_matrices(tube), "Q": tube.Q.tolist(), "R": [[tube.R]]}


def _falls(name: str) -> Formula:
    """Return P - M'P M - Q - K'R K for a P of a name, M being A + b K."""
    fallen: Formula = ("-", name, ("'", LOOP, ("*", name, LOOP)))
    return ("-", ("-", fallen, "Q"), ("'", "K", ("*", "R", "K")))


def _small(tube: Tube) -> Matrix:
    """Return what counts as rounding of P: a share of the larger of its diagonal and Q's."""
    own = np.maximum(np.diag(tube.P), np.diag(tube.Q))
    return [[ROUNDING * float(one) if i == j else 0.0 for j in range(len(own))] for i, one in enumerate(own)]


@lru_cache(maxsize=16)
def invariant(tube: Tube) -> tuple[Shown, Polytope]:
    """Return Sigma drawn in by rounding, which is robust positively invariant exactly. Raises NotShown."""
    Sigma, loop, push = tube.Sigma, tube.A_cl, tube.W_z
    later = push.support(Sigma.H)
    kept = tube.bounds.h - tube.plant.W.mapped(np.eye(tube.plant.order)).support(tube.bounds.H) * 0
    apart = tube.bounds.h - tube.X_z.h
    needs = [
        Need(row @ loop, float(h - far), i, float(size))
        for i, (row, h, far, size) in enumerate(zip(Sigma.H, Sigma.h, later, Sigma.sizes, strict=True))
    ]
    needs += [
        Need(row, float(h - far), None, float(size))
        for row, h, far, size in zip(tube.bounds.H, kept, apart, tube.bounds.sizes, strict=True)
    ]
    ins = drawn_in(Sigma, needs, TOLERANCE)
    if ins is None:
        raise NotShown("Sigma is not seen to be invariant when it is drawn in by rounding")
    within = Polytope(H=Sigma.H, h=Sigma.h - ins, labels=Sigma.labels, scale=Sigma.sizes)
    margin = TOLERANCE - float(((Sigma.h - within.h) / Sigma.sizes).max())
    least = Polytope(H=Sigma.H, h=Sigma.h - TOLERANCE * Sigma.sizes)
    says = (
        "S, which lies between Sigma and Sigma drawn in by 1e-9 of its width, is robust positively invariant, and keeps "
        "the true error within the bounds X over the dead time."
    )
    space = _space(tube, {"Sigma": tube.Sigma, "S": within, "drawn in": least, "X": tube.bounds})
    claims = [
        Inclusion("S", [_step(tube)], "S", LOOP),
        Inclusion("Sigma", (), "S", ONE),
        Inclusion("S", (), "drawn in", ONE),
        Inclusion("X", [_dead_time(tube, _delay(tube))], "S", ONE),
    ]
    return Shown(margin, space.certificate(says, claims)), within


@lru_cache(maxsize=16)
def limit_inside(tube: Tube) -> Shown:
    """Return that the tube in the end lies inside Sigma: S, invariant and with 0 in it, lies between. Raises NotShown."""
    _, within = invariant(tube)
    says = (
        "Z, the closure of the sums of (A + b K)^j A^l w_j over j < i for all i, lies in Sigma: from 0, which is in S, "
        "no step leaves S."
    )
    space = _space(tube, {"Sigma": tube.Sigma, "S": within})
    claims = [
        Inclusion("S"),
        Inclusion("S", [_step(tube)], "S", LOOP),
        Inclusion("Sigma", (), "S", ONE),
    ]
    room = float(((tube.Sigma.h - within.h) / tube.Sigma.sizes).min())
    return Shown(room, space.certificate(says, claims))


@lru_cache(maxsize=64)
def held_inside(tube: Tube, N: int) -> tuple[dict[int, float], list[Inclusion], Space]:
    """Return by how much R_(M+N)^M leaves Sigma for each hold M, as a share of its width, from exact arithmetic."""
    space = _space(tube, {"Sigma": tube.Sigma})
    asked = {M: Inclusion("Sigma", held(tube, M, M + N)) for M in range(1, N)}
    excess = {M: -_least(space.rooms(one)[1], tube.Sigma.sizes) for M, one in asked.items()}
    return excess, list(asked.values()), space


def horizon27(tube: Tube, N: int) -> Certificate:
    """Return the certificate that R_(M+N)^M lies inside Sigma for every hold. Raises NotShown where one does not."""
    _, claims, space = held_inside(tube, N)
    return space.certificate(f"R_(M+{N})^M lies inside Sigma for every hold M = 1 ... {N - 1}.", claims)


@lru_cache(maxsize=16)
def tightening(tube: Tube, stages: int, holds: tuple[int, ...]) -> Shown:
    """Return that bounds are tightened by no less than disturbances move the true error. Raises NotShown.

    With z(k+1) = A z(k) + b du(k) + A^l w(k) and x(k+l) = z(k) + A^(l-1) w(k) + ... + w(k+l-1), the disturbances
    before stage i move z(i) from its plan by a sum of (A + b K)^j A^l w, and by powers of A while the input is held.
    """
    sets, claims, rooms = {}, [], []
    bounds, delay = tube.bounds, tube.plant.delay
    for M in (0, *holds):
        for i in range(stages + M):
            kept = tube.held_stage_bounds(M, i) if M else tube.stage_bounds(i)
            name = f"tightened at stage {i}" + (f", held for {M}" if M else "")
            sets[name] = [
                Fraction(h) - Fraction(less) + Fraction(TOLERANCE) * Fraction(size)
                for h, less, size in zip(bounds.h.tolist(), kept.h.tolist(), bounds.sizes.tolist(), strict=True)
            ]
            moved = _moved(M, i, delay, 0)
            claims.append(Inclusion(name, [_dead_time(tube, delay), *moved]))
    space = Space(
        matrices=_matrices(tube),
        polytopes={name: (bounds.H.tolist(), h) for name, h in sets.items()},
        disturbances={"W": tube.plant.W},
    )
    rooms = [_least(space.rooms(one)[1], bounds.sizes) for one in claims]
    says = (
        f"No disturbance of W moves the true error further from a plan of {stages} stages, held for {list(holds)} "
        "samples or none, than the bounds were tightened by and 1e-9 of their width."
    )
    return Shown(min(rooms), space.certificate(says, claims))


def held(tube: Tube, M: int, i: int) -> list[Term]:
    """Return the sums that are R_i^M of a tube, M samples without feedback, and F_i for M = 0."""
    return _moved(M, i, _delay(tube), int(tube.index_off_by_one))


def _moved(M: int, i: int, delay: int, slip: int) -> list[Term]:
    free, closed = min(M, i), max(i - M, 0)
    found = [Term(("^", LOOP, closed), "A", free + slip, ("^", "A", delay), "W")] if M else []
    return found if M and i <= M else [*found, Term(ONE, LOOP, closed + slip, ("^", "A", delay), "W")]


def _step(tube: Tube) -> Term:
    return Term(ONE, "A", 1, ("^", "A", _delay(tube)), "W")


def _dead_time(tube: Tube, delay: int) -> Term:
    return Term(ONE, "A", delay, ONE, "W")


def _delay(tube: Tube) -> int:
    return 0 if tube.ignore_delay else tube.plant.delay


def _least(rooms: list[fmpq], sizes: Array) -> float:
    return min(int(room.p) / int(room.q) / float(size) for room, size in zip(rooms, sizes, strict=True))


def _matrices(tube: Tube) -> Mapping[str, Matrix]:
    plant = tube.plant
    return {"A": plant.A.tolist(), "b": plant.b[:, None].tolist(), "K": tube.K[None, :].tolist()}


def _space(tube: Tube, sets: Mapping[str, Polytope]) -> Space:
    polytopes = {name: (one.H.tolist(), one.h.tolist()) for name, one in sets.items()}
    return Space(matrices=_matrices(tube), polytopes=polytopes, disturbances={"W": tube.plant.W})
