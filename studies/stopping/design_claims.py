"""The claims about a design of the stopping study: its gain, weights and sets, and the cost of its plans."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from studies.stopping.settings import Stopping, own
from verification.checks import exact_tube
from verification.checks import predictive as predictive_checks
from verification.checks import tube as tube_checks
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Claim, Held, Role
from workbench.contracts.finding import Finding
from workbench.contracts.study import Study
from workbench.predictive import Tube

PAPER = "Liu, Xun, Gao & Yin 2022"
Margin = Callable[[Tube, Mapping[str, object]], float]
"""The margin of a claim about a tube at a witness."""
Make = Callable[[Tube], exact_tube.Shown]
"""Shows a claim about a tube in exact arithmetic, with its certificate."""
Replay = Callable[[Mapping[str, object]], float]


def design_claims(study: Study, horizons: Sequence[int]) -> list[Claim]:
    """Return what must hold of the gain, the weights and the sets, the tightening up to the longest horizon."""
    settings = own(study)
    checks: list[tuple[str, str, str, Role, Callable[[Tube], Finding], Make | None]] = [
        (
            "schur",
            "A + b K is Schur",
            "(15), repaired: the paper prints Hurwitz",
            Role.REPAIRED,
            tube_checks.schur,
            exact_tube.schur,
        ),
        (
            "hurwitz_as_printed",
            "A + b K is Hurwitz: every eigenvalue has a negative real part",
            "step 1 of the algorithm, as printed",
            Role.PRINTED,
            tube_checks.hurwitz_as_printed,
            None,
        ),
        (
            "lyapunov",
            "P satisfies (19) with equality, but for a residual between -1e-9 P and 1e-9 P",
            "(19), repaired: P is stored in doubles, with which no equality holds",
            Role.REPAIRED,
            tube_checks.lyapunov,
            exact_tube.equality,
        ),
        (
            "lmi20",
            "the matrix of (20) is positive semidefinite, P raised by no more than 1e-9 of itself",
            "(20), repaired: with P as stored, it is singular but for rounding to either side",
            Role.REPAIRED,
            tube_checks.lmi20,
            exact_tube.raised,
        ),
        (
            "tube_inside",
            "Z, the tube in the end, lies inside Sigma",
            "(16)",
            Role.PRINTED,
            tube_checks.tube_inside,
            exact_tube.limit_inside,
        ),
        (
            "rpi",
            "Sigma, drawn in by no more than 1e-9 of its width, is robust positively invariant",
            "(16), repaired: Z in Sigma in Sigma_0 is not enough, and rows in doubles exceed by rounding",
            Role.REPAIRED,
            tube_checks.rpi,
            exact_tube.invariant,
        ),
    ]
    claims = [
        Claim(
            name=f"stopping.{name}",
            statement=statement,
            source=f"{PAPER}, {source}",
            check=partial(_on_tube, settings, check),
            role=role,
            replay=partial(_replayed, settings, tube_checks.rpi_margin if name == "rpi" else _computed_again(check)),
            attack=partial(_held, settings) if name == "schur" else None,
            certify=None if make is None else partial(_certified, settings, make),
        )
        for name, statement, source, role, check, make in checks
    ]
    claims += [
        Claim(
            name="stopping.horizon27",
            statement=f"R_(M+N)^M lies inside Sigma for every hold M = 1 ... {N - 1}",
            source=f"{PAPER}, (27)",
            check=partial(_on_tube, settings, partial(tube_checks.horizon27, N=N)),
            controller=f"rsmpc-n{N}",
            role=Role.PRINTED,
            replay=partial(_replayed, settings, partial(_horizon27_margin, N)),
            certify=partial(_certified, settings, partial(_horizon27_shown, N)),
        )
        for N in own(study).lengths
    ]
    longest = max(horizons)
    holds = tuple(sorted({1, 2, longest - 1} & set(range(1, longest))))
    claims.append(
        Claim(
            name="stopping.tightening_sound",
            statement="no disturbance of W moves the true error further from a plan than the bounds were tightened by, "
            "but for 1e-9 of their width",
            source=f"{PAPER}, (14), (26), repaired: A^l W and the prediction error over the dead time",
            check=partial(
                _on_tube,
                settings,
                partial(tube_checks.tightening_sound, stages=longest, holds=holds, seed=study.seed),
            ),
            role=Role.REPAIRED,
            replay=partial(_replayed, settings, tube_checks.tightening_margin),
            certify=partial(_certified, settings, partial(_tightening_shown, longest, holds)),
        )
    )
    return claims


def _on_tube(settings: Stopping, check: Callable[[Tube], Finding]) -> Finding:
    return check(settings.design)


def _certified(settings: Stopping, make: Make, _: Finding, __: Mapping[str, Certificate]) -> Certificate:
    return make(settings.design).certificate


def _horizon27_shown(N: int, tube: Tube) -> exact_tube.Shown:
    return exact_tube.horizon27(tube, N)


def _tightening_shown(stages: int, holds: tuple[int, ...], tube: Tube) -> exact_tube.Shown:
    return exact_tube.tightening(tube, stages, holds)


def _held(settings: Stopping, finding: Finding) -> Held:
    return tube_checks.held_by_powers(settings.design, finding)


def _replayed(settings: Stopping, margin: Margin, witness: Mapping[str, object]) -> float:
    return margin(settings.design, witness)


def _computed_again(check: Callable[[Tube], Finding]) -> Margin:
    """Return the margin of a claim about matrices alone: it is computed again from them."""

    def margin(tube: Tube, _: Mapping[str, object]) -> float:
        found = check(tube).margin
        return np.nan if found is None else found

    return margin


def _horizon27_margin(N: int, tube: Tube, witness: Mapping[str, object]) -> float:
    return tube_checks.horizon27_margin(tube, N, witness)


def cost_claims(study: Study, horizons: Sequence[int]) -> list[Claim]:
    """Return what is said of the cost at some horizons: its decrease and the price of self-triggering."""
    claims = []
    for N in horizons:
        short, long = own(study).rmpc(N), own(study).rsmpc(N)
        falls = partial(predictive_checks.decrease_margin, short)
        costs = partial(predictive_checks.suboptimality_margin, long)
        rows: list[tuple[str, str, str, Role, str, Callable[[], Finding], Replay]] = [
            (
                "nominal_decrease",
                "without disturbance J falls by at least the stage cost at each sample, from wherever it is feasible",
                "(18), repaired: only without disturbance",
                Role.REPAIRED,
                f"rmpc-n{N}",
                partial(predictive_checks.nominal_decrease, short, seed=study.seed),
                falls,
            ),
            (
                "nominal_decrease.printed",
                "J falls by at least the stage cost at each sample, under any disturbance of W",
                "(18), (21)",
                Role.PRINTED,
                f"rmpc-n{N}",
                partial(predictive_checks.disturbed_decrease, short),
                falls,
            ),
            (
                "suboptimality32",
                "without disturbance the cost of the whole run stays below beta J(t0), from wherever it is feasible",
                "(32), repaired: only without disturbance, J being J^1",
                Role.REPAIRED,
                f"rsmpc-n{N}",
                partial(predictive_checks.suboptimality, long, seed=study.seed),
                costs,
            ),
            (
                "suboptimality32.printed",
                "the cost of the whole run stays below beta J(t0), under any disturbance of W",
                "(30)-(32)",
                Role.PRINTED,
                f"rsmpc-n{N}",
                partial(predictive_checks.disturbed_suboptimality, long),
                costs,
            ),
        ]
        claims += [
            Claim(
                name=f"stopping.{name}",
                statement=statement,
                source=f"{PAPER}, {source}",
                check=check,
                controller=controller,
                role=role,
                replay=replay,
            )
            for name, statement, source, role, controller, check, replay in rows
        ]
    return claims
