"""The families of plants, laws and scenarios, each drawn at random; every name says what is special about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from soundness import curves
from soundness.case import Case
from soundness.laws import Told
from soundness.plants import Chain, Relay
from workbench.contracts.trial_length import TrialLength

Rng = np.random.Generator
Family = Callable[[Rng], Case]
LAWS = ("icfdl", "cfdl", "increment", "pd", "simple", "simple-increment")


def law(rng: Rng, kind: str | None = None, *, b: float = 1.0, wild: float = 0.15) -> Told:
    """Return a law for a slope of about b: mostly one that learns, sometimes one whose gain is too large."""
    kind = kind or str(rng.choice(LAWS, p=(0.25, 0.1, 0.3, 0.1, 0.1, 0.15)))
    gain = rng.uniform(0.2, 1.2) / b if rng.random() > wild else rng.uniform(2.1, 3.0) / b
    lam = float(10 ** rng.uniform(-1, 1)) * b * b
    return Told(
        kind=kind,
        first=float(rng.uniform(-0.2, 0.4)),
        rho=float(rng.uniform(0.2, 1.0)),
        lam=lam,
        mu=float(10 ** rng.uniform(-2, 1)),
        eta=float(rng.uniform(0.1, 1.0)),
        phi0=float(b * rng.uniform(0.5, 2.0)),
        gain=float(gain),
        back=float(rng.choice([0.0, 0.1 / b])),
    )


def reference(rng: Rng, n: int, begins: float = 0.0) -> tuple[float, ...]:
    k = np.arange(n + 1)
    high = rng.uniform(0.5, 1.5) * rng.choice([-1, 1], p=(0.2, 0.8))
    rise = high * (1 - np.cos(np.pi * k / n)) / 2
    return tuple(float(one) for one in begins + rise + rng.uniform(-0.1, 0.1) * np.sin(2 * np.pi * k / n))


def lengths(rng: Rng, told: Told, n: int) -> TrialLength:
    if told.kind == "cfdl" or rng.random() < 0.6:
        return TrialLength(law="fixed")
    return TrialLength(law="uniform", minimum=max(2, n - int(rng.integers(2, 4))))


def case(rng: Rng, family: str, chain: Chain, told: Told | None = None, **changes: object) -> Case:
    n = int(rng.integers(6, 13))
    told = told or law(rng, b=abs(chain.gain))
    made = Case(
        family=family,
        chain=chain,
        law=told,
        reference=reference(rng, n),
        trials=int(rng.integers(5, 9)),
        lengths=lengths(rng, told, n),
        seed=int(rng.integers(2**31)),
    )
    return replace(made, **changes)  # type: ignore[arg-type]  # fields by name


def chain(rng: Rng, *, states: int | None = None, degree: int = 1, **changes: object) -> Chain:
    """Return a stable chain; about half of those with one state are near an integrator."""
    n = states or int(rng.integers(degree, 4))
    a = rng.uniform(-0.6, 0.8, n)
    if rng.random() < 0.5:
        a[0] = rng.uniform(0.85, 1.05)
    b = float(rng.uniform(0.4, 2.0))
    made = Chain(
        a=tuple(map(float, a)),
        c=tuple(float(one) for one in rng.uniform(0.2, 0.9, n - 1)),
        gain=b,
        degree=degree,
    )
    return replace(made, **changes)  # type: ignore[arg-type]  # fields by name


def inside(rng: Rng, far: float = 0.5) -> float:
    """Return a place that trials come to, or, in a share of the draws, one that they do not."""
    return float(rng.uniform(-0.1, 0.6)) if rng.random() > far else float(rng.choice([-1, 1]) * rng.uniform(6.0, 9.0))


def linear(rng: Rng) -> Case:
    return case(rng, "linear", chain(rng))


def integrator(rng: Rng) -> Case:
    """Nearly an integrator, so that learning on increments is monotone."""
    made = chain(rng, states=1, a=(float(rng.uniform(0.93, 1.0)),))
    told = law(rng, b=made.gain, kind=str(rng.choice(["increment", "simple-increment"], p=(0.7, 0.3))))
    lam = made.gain**2 * float(rng.uniform(0.15, 0.5))  # quick enough for trials to come to what the reference needs
    told = replace(told, rho=float(rng.uniform(0.8, 1.0)), lam=lam, phi0=float(np.sqrt(lam)))
    return replace(case(rng, "integrator", made, told), trials=9)


def memoryless(rng: Rng) -> Case:
    drive = curves.linear(1.0) if rng.random() < 0.5 else curves.wavy(1.0, 0.3, 2.0)
    return case(rng, "memoryless", chain(rng, states=1, a=(0.0,), drive=drive))


def memoryless_jump(rng: Rng) -> Case:
    drive = curves.stepped(1.0, float(rng.uniform(0.1, 0.3)), inside(rng))
    return case(rng, "memoryless, jump in u", chain(rng, states=1, a=(0.0,), drive=drive))


def bent_in_x(rng: Rng) -> Case:
    made = chain(rng)
    drift = curves.wavy(0.0, float(rng.uniform(-0.3, 0.3)), float(rng.uniform(0.5, 3.0)), float(rng.uniform(0, 3)))
    return case(rng, "smooth in x", replace(made, drift=drift, row=int(rng.integers(made.states))))


def gain_by_x(rng: Rng) -> Case:
    scale = curves.wavy(0.0, float(rng.uniform(0.1, 0.5)), float(rng.uniform(0.5, 2.0)))
    return case(rng, "gain smooth in x", chain(rng, scale=scale))


def cubic(rng: Rng) -> Case:
    return case(rng, "cubic in u", chain(rng, drive=curves.cubic(1.0, float(rng.uniform(0.05, 0.5)))))


def sine(rng: Rng) -> Case:
    w = float(rng.uniform(1.0, 6.0))
    return case(rng, "sine in u, rising", chain(rng, drive=curves.wavy(1.0, float(rng.uniform(0.1, 0.8)) / w, w)))


def turning(rng: Rng) -> Case:
    w = float(rng.uniform(4.0, 12.0))
    return case(rng, "sine in u, turning", chain(rng, drive=curves.wavy(1.0, float(rng.uniform(1.2, 2.5)) / w, w)))


def falling(rng: Rng) -> Case:
    made = chain(rng)
    made = replace(made, gain=-made.gain)
    told = law(rng, b=abs(made.gain))
    if rng.random() < 0.5:
        told = replace(told, phi0=-told.phi0)
    return case(rng, "falling in u", made, told)


def kink_in_x(rng: Rng) -> Case:
    made = chain(rng)
    drift = curves.bent(0.0, float(rng.uniform(-0.3, 0.3)), inside(rng), str(rng.choice(["fabs", "fmax"])))
    return case(rng, "kink in x", replace(made, drift=drift, row=int(rng.integers(made.states))))


def kink_in_u(rng: Rng) -> Case:
    drive = curves.bent(1.0, float(rng.uniform(-0.5, 0.5)), inside(rng), str(rng.choice(["fabs", "fmax"])))
    return case(rng, "kink in u", chain(rng, drive=drive))


def jump_in_x(rng: Rng) -> Case:
    made = chain(rng)
    drift = curves.stepped(0.0, float(rng.uniform(0.05, 0.3)), inside(rng))
    return case(rng, "jump in x", replace(made, drift=drift, row=int(rng.integers(made.states))))


def gain_jumps(rng: Rng) -> Case:
    return case(
        rng, "gain jumps in x", chain(rng, scale=curves.stepped(0.0, float(rng.uniform(0.1, 0.5)), inside(rng)))
    )


def jump_in_u(rng: Rng) -> Case:
    return case(rng, "jump in u", chain(rng, drive=curves.stepped(1.0, float(rng.uniform(0.05, 0.3)), inside(rng))))


def jump_in_k(rng: Rng) -> Case:
    made = chain(rng)
    return case(
        rng, "jump in k", replace(made, later=(int(rng.integers(2, 5)), made.gain * float(rng.uniform(0.5, 1.5))))
    )


def periodic(rng: Rng) -> Case:
    made = chain(rng, swing=float(rng.uniform(0.1, 0.6)), period=int(rng.integers(3, 9)))
    return case(rng, "periodic in k", made)


def changing_sign(rng: Rng) -> Case:
    return case(
        rng, "sign changes in k", chain(rng, swing=float(rng.uniform(1.5, 3.0)), period=int(rng.integers(3, 7)))
    )


def late_2(rng: Rng) -> Case:
    return case(rng, "delayed, degree 2", chain(rng, degree=2))


def late_3(rng: Rng) -> Case:
    return case(rng, "delayed, degree 3", chain(rng, degree=3))


def late_bent(rng: Rng) -> Case:
    return case(rng, "delayed, kink in u", chain(rng, degree=2, drive=curves.bent(1.0, 0.4, inside(rng))))


def disturbed_given(rng: Rng) -> Case:
    made = case(rng, "disturbed, given", chain(rng, disturbed=True))
    return replace(made, given=tuple(map(float, rng.uniform(-0.2, 0.2, made.horizon))))


def disturbed_drawn(rng: Rng) -> Case:
    return case(rng, "disturbed, bounded", chain(rng, disturbed=True), drawn=float(rng.uniform(0.01, 0.1)))


def disturbed_normal(rng: Rng) -> Case:
    return case(rng, "disturbed, normal", chain(rng, disturbed=True), drawn=0.05, unbounded=True)


def noisy(rng: Rng) -> Case:
    return case(rng, "noisy, bounded", chain(rng), noise=float(rng.uniform(0.005, 0.05)))


def noisy_normal(rng: Rng) -> Case:
    return case(rng, "noisy, normal", chain(rng), noise=float(rng.uniform(0.005, 0.05)), unbounded=True)


def guarded_root_in_x(rng: Rng) -> Case:
    return case(
        rng, "guarded root in x", chain(rng, drift=curves.gated(0.0, float(rng.uniform(0.05, 0.2)), inside(rng)))
    )


def guarded_root_in_u(rng: Rng) -> Case:
    return case(
        rng, "guarded root in u", chain(rng, drive=curves.gated(1.0, float(rng.uniform(0.05, 0.3)), inside(rng)))
    )


def guarded_division(rng: Rng) -> Case:
    gain, place, reach = float(rng.uniform(0.01, 0.05)), inside(rng), float(rng.uniform(0.2, 0.5))
    reach = round(64 * reach) / 64 if rng.random() < 0.7 else reach  # then both sides fit, else but for rounding
    drift = curves.shared(0.0, gain, place, reach)
    return case(rng, "guarded division in x", chain(rng, drift=drift))


def grid(rng: Rng, steep: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    at = np.concatenate([[-8.0], np.cumsum(rng.uniform(0.2, 0.6, 5)) - 0.5, [9.0]])
    rises = rng.uniform(-steep, steep, at.size - 1)
    return tuple(map(float, at)), tuple(map(float, np.concatenate([[0.0], np.cumsum(rises * np.diff(at))])))


def table_in_x(rng: Rng) -> Case:
    return case(rng, "table in x", chain(rng, drift=curves.tabled(0.0, *grid(rng, 0.3))))


def table_in_u(rng: Rng) -> Case:
    return case(rng, "table in u", chain(rng, drive=curves.tabled(1.0, *grid(rng, 0.5))))


def pole_away(rng: Rng) -> Case:
    drift = curves.pole(0.0, float(rng.uniform(0.05, 0.2)), float(rng.choice([-1, 1]) * rng.uniform(6.0, 9.0)))
    return case(rng, "pole out of reach", chain(rng, drift=drift))


def pole_met(rng: Rng) -> Case:
    drift = curves.pole(0.0, float(rng.uniform(0.002, 0.01)), float(rng.uniform(0.1, 0.4)))
    return case(rng, "pole in reach", chain(rng, drift=drift))


def root_away(rng: Rng) -> Case:
    drift = curves.rooted(0.0, float(rng.uniform(0.05, 0.2)), -float(rng.uniform(6.0, 9.0)))
    return case(rng, "end of domain out of reach", chain(rng, drift=drift))


def scattered(rng: Rng) -> Case:
    return case(rng, "starts scatter", chain(rng), spread=float(rng.uniform(0.01, 0.1)))


def elsewhere(rng: Rng) -> Case:
    made = chain(rng)
    start = tuple(map(float, rng.uniform(-0.3, 0.3, made.states)))
    return case(rng, "starts elsewhere", made, start=start)


def changing(rng: Rng) -> Case:
    return case(rng, "plant changes", chain(rng, changes=True), share=(float(rng.uniform(0.7, 0.95)), 1.1))


def clipped(rng: Rng) -> Case:
    high = float(rng.uniform(0.2, 1.0)) if rng.random() < 0.5 else float(rng.uniform(8.0, 9.0))
    return case(rng, "saturated actuator", chain(rng), clipped=(-high, high))


def two_channels(rng: Rng) -> Case:
    return replace(case(rng, "two channels", chain(rng, states=2), law(rng, "pd", wild=0.0)), channels=2)


def bounded(rng: Rng) -> Case:
    """A limit is asked of output and input, that trials leave, or that none can."""
    made = case(rng, "limits asked", chain(rng, states=int(rng.integers(1, 3))))
    high = float(rng.uniform(0.3, 2.5))
    return replace(made, limits={"x0": (-high, high), "u": (None, float(rng.uniform(0.2, 3.0)))})


def kept(rng: Rng) -> Case:
    """A limit is asked of an integrator, near to what trials come to or far from it."""
    made = integrator(rng)
    far = max(abs(one) for one in made.reference)
    steep = max(abs(b - a) for a, b in pairwise(made.reference)) / made.chain.gain
    high, most = far * float(rng.uniform(0.7, 2.0)), (steep + abs(made.law.first)) * float(rng.uniform(0.3, 2.0))
    return replace(made, family="limits kept", limits={"x0": (-high, high), "u": (-most, most)})


def clutch(rng: Rng) -> Case:
    """A clutch that bites beyond a dead zone, in which it drags or lets go, on a shaft with a kinked friction."""
    slip = float(rng.choice([0.0, 0.05, 0.4]))
    drive = curves.clutch(1.0, abs(inside(rng)), float(rng.uniform(0.2, 1.0)), slip)
    made = chain(rng, drive=drive)
    friction = curves.bent(0.0, float(rng.uniform(-0.2, 0.0)), inside(rng))
    return case(rng, "clutch", replace(made, drift=friction, row=made.states - 1))


def hysteresis(rng: Rng) -> Case:
    """A hidden relay pushes the output, and turns only after that has come to the other end of its play."""
    middle, play = inside(rng), float(rng.uniform(0.05, 0.3))
    relay = Relay(low=middle - play, high=middle + play, push=float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.3)))
    return case(rng, "hysteresis by a hidden state", chain(rng, relay=relay))


def saturating(rng: Rng) -> Case:
    """An integrator that stays at its ends when it comes to them."""
    high = float(rng.uniform(0.3, 1.2)) if rng.random() < 0.5 else float(rng.uniform(8.0, 12.0))
    made = chain(rng, states=int(rng.integers(1, 3)), ceiling=high)
    return case(rng, "saturating integrator", replace(made, a=(float(rng.uniform(0.97, 1.0)), *made.a[1:])))


FAMILIES: tuple[Family, ...] = (
    linear, integrator, memoryless, memoryless_jump, bent_in_x, gain_by_x, cubic, sine, turning, falling, kink_in_x,
    kink_in_u, jump_in_x, gain_jumps, jump_in_u, jump_in_k, periodic, changing_sign, late_2, late_3, late_bent,
    disturbed_given, disturbed_drawn, disturbed_normal, noisy, noisy_normal, guarded_root_in_x, guarded_root_in_u,
    guarded_division, table_in_x, table_in_u, pole_away, pole_met, root_away, scattered, elsewhere, changing, clipped,
    two_channels, bounded, kept, clutch,
)  # fmt: skip

FRESH: tuple[Family, ...] = (hysteresis, saturating)
"""Kinds of plants that came last: nothing in the program was looked at for their sake."""


def drawn(number: int, seed: int = 0) -> Case:
    """Return case ``number`` of a campaign: the families come in turn."""
    return FAMILIES[number % len(FAMILIES)](np.random.default_rng([seed, number]))
