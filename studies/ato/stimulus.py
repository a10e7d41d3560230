"""Is the stimulus f(u, du) continuous? By its own expression, and by the jumps that it is found to make."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial

import casadi as ca
import numpy as np
import xarray as xr

from verification.certificates.bounds import Ask, bounds
from verification.checks.jump import find_jump
from verification.enclosure.box import Box
from verification.enclosure.smoothness import continuous_everywhere
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Claim, Held, Range, Role
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.controllers.parts import immune
from workbench.graph import read

FAR = 1e6
"""How far from zero inputs are spoken of: no law commands as much, in the units that it computes in."""
NEAR = 12
"""Decimals to which the point of a jump is given: rounding of the memberships moves it by 1e-16."""
LEAST = 1e-3
"""A difference above it that stays while the distance shrinks is a jump."""
SIDES = (1e-9, 1e-10, 1e-11)
"""How far on both sides of the point a jump is looked at."""
SAME = 1e-12
"""By how much a recorded f may depart from the expression by rounding."""


@cache
def compiled(kind: str) -> ca.Function:
    """Return the stimulus of a kind, the expression that the laws run, as a Function (u, du) -> f."""
    u, du = ca.SX.sym("u"), ca.SX.sym("du")
    return ca.Function("stimulus", [u, du], [immune.stimulus(kind, u, du)], ["u", "du"], ["f"])


def continuity(study: str, kind: str, unit: float, data: xr.Dataset, name: str) -> Claim:
    """Return the claim of a study that the stimulus of a controller's law is continuous.

    ``unit`` is the unit of the input that the law computes in, ``data`` the record that it is held against.
    """
    return Claim(
        name=f"{study}.f_continuous",
        statement=f"the stimulus f(u, du) is continuous wherever |u| and |du| are at most {FAR:g} of the law's units",
        source="Chu, Yu, Lin, Yuan & Jiang, fuzzy rules with the mean of maxima; smooth form: ours",
        check=partial(f_continuous, kind),
        controller=name,
        role=Role.PRINTED if kind == "rules" else Role.REPAIRED,
        scope=lambda: {"u": Range(-FAR, FAR, "1"), "du": Range(-FAR, FAR, "1")},
        replay=partial(jump_margin, kind),
        attack=lambda _: held_by(kind, unit, data, name),
        certify=lambda found, premises: _certified(kind),
    )


def _certified(kind: str) -> Certificate:
    far = Box({"u": (-FAR, FAR), "du": (-FAR, FAR)})
    return bounds(read(compiled(kind)), far, {}, [Ask(("f", 0, 0), None, "continuous")])


def f_continuous(kind: str) -> Finding:
    """Check whether a stimulus is continuous everywhere; a jump of it is looked for on [0.1, 0.9] x [-0.3, 0.3]."""
    f = compiled(kind)
    smooth = continuous_everywhere(f)
    if smooth:
        return Finding(
            grounds=Grounds.ALGEBRA,
            holds=smooth,
            method="composed of operations that are continuous everywhere, as it stands in the law",
        )
    jump = find_jump(lambda a, b: float(f(a, b)), (0.1, -0.3), (0.9, 0.3), cells=4, least=LEAST)
    if jump is None:
        return undecided("f has operations that may jump, but no jump was found on [0.1, 0.9] x [-0.3, 0.3]")
    at = tuple(round(value, NEAR) + 0.0 for value in jump.after)
    along = int(np.argmax([a != b for a, b in zip(*jump[:2], strict=True)]))
    sides = _sides(at, along, SIDES[0])
    witness = {"point (u, du)": at, "along": ("u", "du")[along], "on both sides": sides}
    margin = _margin(kind, at, along)
    return Finding(
        grounds=Grounds.NUMERICS,
        margin=margin,
        unit="1",
        weak=True,
        bound=LEAST - margin,
        bound_unit="1, the size of the jump",
        witness={**witness, "f there": [float(f(*side)) for side in sides]},
        method="bisection along u and du to neighbouring floating-point numbers; the largest jump found, which stays "
        f"while the distance shrinks from {2 * SIDES[0]:g} to {2 * SIDES[-1]:g}",
    )


def jump_margin(kind: str, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`f_continuous` at the point of a witness, on the compiled stimulus."""
    at = np.asarray(witness["point (u, du)"], dtype=float)
    return _margin(kind, (float(at[0]), float(at[1])), ("u", "du").index(str(witness["along"])))


def _margin(kind: str, at: tuple[float, ...], along: int) -> float:
    """Return by how much less than a jump f changes at a point, however near to it one looks."""
    f = compiled(kind)
    pairs = [[float(f(*side)) for side in _sides(at, along, near)] for near in SIDES]
    return LEAST - min(abs(b - a) for a, b in pairs)


def _sides(at: tuple[float, ...], along: int, near: float) -> list[tuple[float, ...]]:
    return [tuple(p + side * (i == along) for i, p in enumerate(at)) for side in (-near, near)]


def held_by(kind: str, unit: float, data: xr.Dataset, name: str) -> Held:
    """Hold the expression against the f that a law told at every sample of a run: it must be the one that ran.

    ``unit`` is the unit of the input that the law computes in.
    """
    one = data.sel(controller=name)
    row = "f" if "f" in one else "law_f"
    if row not in one:
        return Held(0, 0.0, {})
    u = np.r_[0.0, 0.0, np.ravel(one["input"].values[-1])[:-1]] / unit
    told = one[row].values[-1, : u.size - 2]
    before, change = u[1:-1], u[1:-1] - u[:-2]
    known = np.isfinite(before) & np.isfinite(change) & np.isfinite(told)
    expected = compiled(kind).map(u.size - 2)(before[None, :], change[None, :]).full().ravel()
    apart = np.where(known, np.abs(told - expected), 0.0)
    k = int(np.argmax(apart))
    return Held(int(known.sum()), SAME - float(apart[k]), {"sample": k, "f told": told[k], "f": expected[k]})
