"""What the paper's proof is about, made of the study's own symbols: the train's equations and those of the law.

The law acts continuously here: its force follows the errors at every instant, where the run holds it over a sample.
Masses, gains and resistances stay symbols.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import casadi as ca
import numpy as np

from models.expression import Expression, as_expression
from models.maglev import Maglev
from models.quantity import rebuilt, symbolised
from models.vehicle import Vehicle
from verification.checks.polynomial import Identity
from workbench.contracts.law import AnyLaw, Task, Trial
from workbench.controllers.parts.rows import column, joined
from workbench.controllers.parts.shuttle_force import errors

AT = 1
"""The sample that is looked at, of three."""


@dataclass(frozen=True, kw_only=True)
class Equations:
    """S, its rate, and the line resistance with what was learned of it, now and one period ago."""

    e_x: Expression
    e_v: Expression
    S: Expression
    S_rate: Expression
    e_v_rate: Expression
    d: Expression
    """The line resistance: what the train's equations hold beside force, mass and running resistance."""
    d_hat: Expression
    d_hat_before: Expression
    alpha: Expression
    lam: Expression
    gamma: Expression
    mass: Expression
    at: dict[str, tuple[Expression, float | list[float]]]
    """Every symbol by name, with a number to compare two sides at: on the upgrade, slow and behind."""


def equations(law: AnyLaw, train: Maglev) -> Equations:
    """Return the equations of a law that learns within the period, of a train that it knows.

    ``law`` is ready for its task. It is taken after a period in which it has learned, so the line resistance that it
    reads is that of the last period; what it holds now and held then is what it tells.
    """
    own = symbolised(train)
    known = cast(Vehicle, own.thing)
    gains = symbolised(rebuilt(law, {"model": known}), only=frozenset({"alpha", "lam", "gamma"}))
    law = gains.thing
    at: dict[str, tuple[Expression, float | list[float]]] = {}

    def symbol(name: str, value: float | list[float]) -> Expression:
        made = as_expression(ca.SX.sym(name, np.size(value)))
        at[name] = (made, value)
        return made

    at |= {f"plant.{name}": (one, value) for name, one, value in zip(*own[1:], strict=True)}
    at |= {f"law.{name}": (one, value) for name, one, value in zip(*gains[1:], strict=True)}
    x, r = symbol("x", [900.0, 20.0]), symbol("r", [900.3, 20.2])
    r_rate, step = symbol("dv_d/dt", 0.1), symbol("step", float(train.sampling_time))
    F, w = symbol("F", 3e4), symbol("w", [0.0] * len(train.disturbances))
    # the law one period on
    n = 2 * AT + 1
    unknown = as_expression(ca.SX.sym("unknown", 2, n + 1))
    begun = law.start(Task(unknown, step, model=train))
    state = law.ready(begun)
    stored = type(state)(*(as_expression(ca.SX.sym(f"state{i}", one.shape[0], n)) for i, one in enumerate(state)))
    rows = as_expression(ca.SX.sym("u", 1, n))
    past = Trial(unknown, unknown, unknown, rows, as_expression(ca.SX.ones(1, n + 1)), stored)
    memory = law.learn(begun, past)
    now = type(memory)(*(one[:, AT] if as_expression(one).shape[1] == n else one for one in memory))
    before = law.tell(begun, past)[0][AT]
    z = symbol("d_hat_before", 5e3)
    now = type(memory)(*(ca.substitute(as_expression(one), before, z) for one in now))
    r_next = r + step * ca.vertcat(r[1], r_rate)
    y = train.measured(x)
    u, after = law.act(now, law.ready(memory), r, r_next, y)
    d_hat = law.tell(now, past._replace(state=after))[0]
    # the train under that force, and what its equations hold beside it
    x_rate = known.slope(x, joined(u), w, 0)
    e = errors(r, y, gains.symbols[gains.names.index("lam")])

    def rate(of: Expression) -> Expression:
        return ca.jtimes(of, x, x_rate) + ca.jtimes(of, r, ca.vertcat(r[1], r_rate))

    v_rate = ca.jtimes(y[1], x, known.slope(x, F, w, 0))
    named = dict(zip(gains.names, gains.symbols, strict=True))
    mass = column(known.mass)
    return Equations(
        e_x=e.x,
        e_v=e.v,
        S=e.s,
        S_rate=rate(e.s),
        e_v_rate=rate(e.v),
        d=F - known.resistance_at(y[1]) - mass * v_rate,
        d_hat=d_hat,
        d_hat_before=z,
        alpha=named["alpha"],
        lam=named["lam"],
        gamma=named["gamma"],
        mass=mass,
        at=at,
    )


def error_dynamics(law: AnyLaw, train: Maglev) -> Identity:
    """Return the equation of the speed error that the gains give."""
    q = equations(law, train)
    within = -(q.alpha + q.lam + q.gamma) * q.e_v - q.lam * (q.alpha + q.gamma) * q.e_x
    return Identity(
        left=q.e_v_rate,
        right=within + (q.d_hat_before - q.d) / q.mass,
        at=q.at,
        method="the train's equations under the law's own force, with masses, gains and resistances as symbols",
    )


def decrease(law: AnyLaw, train: Maglev, share: float) -> Identity:
    """Return dV/dt against -(alpha + share k/M) S^2: of the integral over a period its ends remain, d being periodic.

    V = S^2/2 + integral over one period of (d - d_hat)^2 / (2 k M), k = gamma M.
    """
    q = equations(law, train)
    k = q.gamma * q.mass
    stored = ((q.d - q.d_hat) ** 2 - (q.d - q.d_hat_before) ** 2) / (2 * k * q.mass)
    return Identity(
        left=q.S * q.S_rate + stored,
        right=-(q.alpha + share * q.gamma) * q.S**2,
        at=q.at,
        method="V's rate from the train's equations and the law's own force and memory, with masses, gains and "
        "resistances as symbols, for a force that follows the errors at every instant",
    )
