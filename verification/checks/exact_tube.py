"""What holds of a tube in exact arithmetic: its matrices and sets as stored, in rationals, and their certificates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigvalsh, solve_discrete_lyapunov

from verification.certificates.loops import contracting, definite
from verification.certificates.matrices import Formula, Matrix
from verification.certificates.numbers import Number
from verification.certificates.sets import Inclusion, Need, Space, Term, drawn_in
from verification.enclosure.exact_schur import closed_loop, contraction
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import NotCertified
from workbench.predictive import Tube
from workbench.predictive.regulator import decrease
from workbench.sets import TOLERANCE, Polytope
from workbench.sets.array import Array
from workbench.sets.balance import state_units

LOOP: Formula = ("+", "A", ("*", "b", "K"))
ONE: Formula = ("^", "A", 0)
ROUNDING = 1e-9
"""What counts as rounding of a weight, as a share of it."""
MOST_HALVED = 16
"""How often that is halved to see how little a weight needs to be raised."""


class Shown(NamedTuple):
    """What was shown: how far it is from failing, exactly and then rounded, and the certificate."""

    margin: float
    certificate: Certificate


@lru_cache(maxsize=16)
def schur(tube: Tube) -> Shown:
    """Return that every eigenvalue of A + b K is smaller in modulus than a number below 1. Raises NotCertified.

    It is found in units that are powers of two, in which the matrices are near one: the same loop, exactly.
    """
    plant, units = tube.plant, state_units(tube.A_cl)
    A = plant.A * units / units[:, None]
    found = contraction(closed_loop(A.tolist(), (plant.b / units).tolist(), (tube.K * units).tolist()))
    if found is None:
        raise NotCertified("no norm was found in which A + b K contracts")
    own = [Fraction(one) for one in units.tolist()]
    lines = zip(found.norm, own, strict=True)
    norm = [[entry / (a * b) for entry, b in zip(line, own, strict=True)] for line, a in lines]
    says = f"Every eigenvalue of A + b K is smaller than {found.radius} in modulus; r is that times I."
    certificate = contracting(says, _matrices(tube), LOOP, found.radius, norm)
    return Shown(float(1 - found.radius), certificate)


@lru_cache(maxsize=16)
def equality(tube: Tube) -> Shown:
    """Return that P satisfies (19) with equality but for 1e-9 of P. Raises NotCertified where that is not seen."""
    says = "(19) holds with equality but for a residual between -e P and e P, e being 1e-9 times I."
    low, high = ("+", ("*", "e", "P"), _falls("P")), ("-", ("*", "e", "P"), _falls("P"))
    certificate = definite(says, {**_costs(tube), "e": _share(tube)}, ["P", low, high])
    residual = decrease(tube.A_cl, tube.K, tube.Q, tube.R, tube.P)
    return Shown(ROUNDING - float(np.abs(eigvalsh(residual, tube.P)).max()), certificate)


@lru_cache(maxsize=16)
def raised(tube: Tube) -> Shown:
    """Return that (20) is met once P is raised a little; the margin is what is left of 1e-9. Raises NotCertified."""
    units = state_units(tube.A_cl)
    both = np.outer(units, units)
    loop = tube.A_cl * units / units[:, None]
    try:
        up = np.asarray(solve_discrete_lyapunov(loop.T, tube.P * both)) / both
        up = (up + up.T) / 2
        up *= ROUNDING / float(eigvalsh(up, tube.P)[-1])
    except (ValueError, ArithmeticError) as error:
        raise NotCertified("no weight was found by which to raise P") from error
    says = (
        "P_raised, which is P raised by less than e P, e being 1e-9 times I, meets (19), strictly: by a Schur "
        "complement the matrix of (20) is positive definite, whatever root of Q stands in it."
    )
    positive: list[Formula] = [
        ("-", "P_raised", "P"),
        ("-", ("*", "e", "P"), ("-", "P_raised", "P")),
        _falls("P_raised"),
    ]
    for halved in range(MOST_HALVED, 0, -1):
        higher = (tube.P + up / 2**halved).tolist()
        try:
            certificate = definite(says, {**_costs(tube), "P_raised": higher, "e": _share(tube)}, positive)
        except NotCertified:
            continue
        return Shown(ROUNDING * (1 - 2.0**-halved), certificate)
    raise NotCertified("(20) is not seen to hold for P raised by 1e-9 of itself")


def _costs(tube: Tube) -> dict[str, Matrix]:
    return {**_matrices(tube), "Q": tube.Q.tolist(), "R": [[tube.R]], "P": tube.P.tolist()}


def _falls(name: str) -> Formula:
    """Return P - M'P M - Q - K'R K for a P of a name, M being A + b K."""
    fallen: Formula = ("-", name, ("'", LOOP, ("*", name, LOOP)))
    return ("-", ("-", fallen, "Q"), ("'", "K", ("*", "R", "K")))


def _share(tube: Tube) -> Matrix:
    return [[Fraction(1, 10**9) if i == j else 0 for j in range(tube.plant.order)] for i in range(tube.plant.order)]


@lru_cache(maxsize=16)
def invariant(tube: Tube) -> Shown:
    """Return that Sigma, drawn in by rounding, is robust positively invariant; the margin is what is left of 1e-9.

    Raises NotCertified where it is not seen.
    """
    Sigma, X_z = tube.Sigma, tube.X_z
    kept = [
        Need(row, float(h), None, float(size)) for row, h, size in zip(X_z.H, X_z.h, tube.bounds.sizes, strict=True)
    ]
    ins = drawn_in(Sigma, [*_steps(tube), *kept], most=TOLERANCE)
    if ins is None:
        raise NotCertified("Sigma is not seen to be invariant when it is drawn in by 1e-9 of its width")
    within = Polytope(H=Sigma.H, h=Sigma.h - ins)
    least = Polytope(H=Sigma.H, h=Sigma.h - TOLERANCE * Sigma.sizes)
    space = _space(tube, {"Sigma": Sigma, "S": within, "Sigma drawn in": least, "X": tube.bounds})
    says = "S, which lies between Sigma and Sigma drawn in by 1e-9 of its width, is robust positively invariant."
    claims = [
        Inclusion("S", (_step(tube),), "S", LOOP),
        Inclusion("Sigma", (), "S", ONE),
        Inclusion("S", (), "Sigma drawn in", ONE),
        Inclusion("X", (_dead_time(_delay(tube)),), "S", ONE),
    ]
    if np.all(within.h >= 0):  # it is not empty
        claims.append(Inclusion("S"))
    return Shown(TOLERANCE - float(((Sigma.h - within.h) / Sigma.sizes).max()), space.certificate(says, claims))


@lru_cache(maxsize=16)
def limit_inside(tube: Tube) -> Shown:
    """Return that the tube in the end lies inside Sigma: between them is an invariant set with 0 in it.

    The margin is by what share of its width Sigma was drawn in to be that set, at least. Raises NotCertified.
    """
    Sigma = tube.Sigma
    ins = drawn_in(Sigma, _steps(tube)) if np.all(Sigma.h > 0) else None
    if ins is None:
        raise NotCertified("no invariant set that holds 0 is seen within Sigma")
    within = Polytope(H=Sigma.H, h=np.maximum(Sigma.h - ins, 0.0))
    space = _space(tube, {"Sigma": Sigma, "S": within})
    says = (
        f"Z, the closure of the sums of (A + b K)^j A^{_delay(tube)} w_j over j < i for all i, lies in Sigma: no step "
        "from 0, which is in S, leaves S."
    )
    claims = [
        Inclusion("S"),
        Inclusion("S", (_step(tube),), "S", LOOP),
        Inclusion("Sigma", (), "S", ONE),
    ]
    return Shown(float(((Sigma.h - within.h) / Sigma.sizes).min()), space.certificate(says, claims))


def _steps(tube: Tube) -> list[Need]:
    Sigma = tube.Sigma
    later = Sigma.h - tube.W_z.support(Sigma.H)
    return [
        Need(row @ tube.A_cl, float(bound), i, float(size))
        for i, (row, bound, size) in enumerate(zip(Sigma.H, later, Sigma.sizes, strict=True))
    ]


@lru_cache(maxsize=64)
def horizon27(tube: Tube, N: int) -> Shown:
    """Return that R_(M+N)^M lies inside Sigma for every hold M = 1 ... N-1. Raises NotCertified where one does not."""
    space = _space(tube, {"Sigma": tube.Sigma})
    claims = [Inclusion("Sigma", held(tube, M, M + N)) for M in range(1, N)]
    says = f"R_(M+{N})^M lies inside Sigma for every hold M = 1 ... {N - 1}."
    return Shown(_least(space, claims, tube.Sigma.sizes), space.certificate(says, claims))


@lru_cache(maxsize=16)
def tightening(tube: Tube, stages: int, holds: tuple[int, ...]) -> Shown:
    """Return that bounds are tightened by no less than disturbances move the true error. Raises NotCertified.

    With z(k+1) = A z(k) + b du(k) + A^l w(k) and x(k+l) = z(k) + A^(l-1) w(k) + ... + w(k+l-1), the disturbances
    before stage i move z(i) from its plan by a sum of (A + b K)^j A^l w, and by powers of A while the input is held.
    """
    sets, claims = dict[str, tuple[Matrix, list[Number]]](), list[Inclusion]()
    bounds, delay = tube.bounds, tube.plant.delay
    for M in (0, *holds):
        for i in range(stages + M):
            kept = tube.held_stage_bounds(M, i) if M else tube.stage_bounds(i)
            name = f"what stage {i} was tightened by" + (f", held for {M}" if M else "")
            sets[name] = (
                bounds.H.tolist(),
                [
                    Fraction(h) - Fraction(less) + Fraction(TOLERANCE) * Fraction(size)
                    for h, less, size in zip(bounds.h.tolist(), kept.h.tolist(), bounds.sizes.tolist(), strict=True)
                ],
            )
            claims.append(Inclusion(name, (_dead_time(delay), *_moved(M, i, delay, 0))))
    space = Space(matrices=_matrices(tube), polytopes=sets, disturbances={"W": tube.plant.W})
    says = (
        f"No disturbance of W moves the true error further from a plan of {stages} stages, held for "
        f"{', '.join(map(str, (0, *holds)))} samples, than the bounds were tightened by and 1e-9 of their width."
    )
    return Shown(_least(space, claims, bounds.sizes), space.certificate(says, claims))


def held(tube: Tube, M: int, i: int) -> tuple[Term, ...]:
    """Return the sums that are R_i^M of a tube, M samples without feedback, and F_i for M = 0."""
    return _moved(M, i, _delay(tube), int(tube.index_off_by_one))


def _moved(M: int, i: int, delay: int, slip: int) -> tuple[Term, ...]:
    acts: Formula = ("^", "A", delay)
    free = Term(("^", LOOP, max(i - M, 0)), "A", min(M, i) + slip, acts, "W")
    closed = Term(ONE, LOOP, max(i - M, 0) + slip, acts, "W")
    return (closed,) if M == 0 else (free,) if i <= M else (free, closed)


def _step(tube: Tube) -> Term:
    return Term(ONE, LOOP, 1, ("^", "A", _delay(tube)), "W")


def _dead_time(delay: int) -> Term:
    return Term(ONE, "A", delay, ONE, "W")


def _delay(tube: Tube) -> int:
    return 0 if tube.ignore_delay else tube.plant.delay


def _least(space: Space, claims: Sequence[Inclusion], sizes: Array) -> float:
    """Return the least room that sums without an inner set leave, as a share of sizes."""
    return min(
        int(room.p) / int(room.q) / float(size)
        for one in claims
        for room, size in zip(space.rooms(one)[1], sizes, strict=True)
    )


def _matrices(tube: Tube) -> Mapping[str, Matrix]:
    plant = tube.plant
    return {"A": plant.A.tolist(), "b": plant.b[:, None].tolist(), "K": tube.K[None, :].tolist()}


def _space(tube: Tube, sets: Mapping[str, Polytope]) -> Space:
    polytopes = {name: (one.H.tolist(), one.h.tolist()) for name, one in sets.items()}
    return Space(matrices=_matrices(tube), polytopes=polytopes, disturbances={"W": tube.plant.W})
