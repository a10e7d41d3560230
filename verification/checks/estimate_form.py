"""That a law estimates and learns by (12) to (14), read off its own expressions.

A law may declare any estimator. What is said of the size of its estimate, and so of its gain, rests on how both are
computed, so the next estimate and the next plan are held against the formulas, expression by expression: they must be
the same trees, not only the same numbers at some points. A law that writes the same formulas in another form is not
recognised, and nothing is then said of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

import casadi as ca
import numpy as np

from models.expression import Expression, as_expression
from verification.certificates.bounds import plain
from verification.certificates.numbers import numbers
from verification.certificates.theorem import theorem
from workbench.contracts.certificate import Certificate, Json, hashed
from workbench.contracts.claim import NotCertified
from workbench.contracts.law import AnyLaw, Estimator, Task, Trial
from workbench.controllers.parts.rows import joined, known
from workbench.graph import read

DEPTH = 24
"""How deep two expressions are compared; the formulas are less than half as deep."""
Left: TypeAlias = Trial[tuple[()]]


class Seen(NamedTuple):
    """The next estimate and plan as a law computes them, and by the formulas, of all that they are made of."""

    given: Sequence[Expression]
    estimate: tuple[Expression, Expression]
    plan: tuple[Expression, Expression]


def estimate_form(law: AnyLaw, task: Task) -> str | None:
    """Return why the law is not shown to estimate and to learn by (12) to (14), from a positive estimate, or None."""
    found = seen(law, task)
    return found if isinstance(found, str) else None


def seen(law: AnyLaw, task: Task) -> Seen | str:
    """Return what is seen of a law's estimate and plan, or why they are not seen to be those of (12) to (14).

    The next estimate is phi + eta du/(mu + du^2) (dy(k+1) - phi du) with 0 < eta <= 1, du and dy what the plan and the
    output gained on those of the last trial, and phi(k,1) in its place where |phi| or |du| is at most eps or the sign
    turned. The plan, which acts, gains rho phi/(lambda + phi^2) e(k+1) with that next estimate.
    """
    estimator = law.estimator
    if estimator is None:
        return "the law estimates nothing"
    if law.stepped or law.keeps_state:
        return "the law also decides within the trial, so its plan is no formula of the last trial's"
    if wrong := _parameters(estimator):
        return wrong
    start = [as_expression(one) for one in law.start(task)]
    memory = type(law.start(task))(*(_named(f"m{i}", *one.shape) for i, one in enumerate(start)))
    n = task.samples
    left: Left = Trial(
        r=_named("r", 1, n + 1),
        y=_named("y", 1, n + 1),
        e=_named("e", 1, n + 1),
        u=_named("u", 1, n),
        reached=_named("reached", 1, n + 1),
        state=(),
    )
    told, after = law.ppd_estimate(memory), law.learn(memory, left)
    places = [i for i, one in enumerate(memory) if one.shape == (1, n)]
    estimates = [i for i in places if told is not None and ca.is_equal(told, memory[i] / estimator.force_unit, 2)]
    plans = [i for i in places if _acts(law, memory, i, estimator.force_unit)]
    if not estimates or not plans:
        return "no part of the law's memory is the estimate that it tells, or the plan that it acts by, in its unit"
    phi, u = estimates[0], plans[0]
    first = np.asarray(ca.evalf(ca.SX(start[phi])).full())
    if not (np.isfinite(first) & (first > 0)).all():
        return "the estimate of the first trial is not positive at every sample"
    moved = [one for one in _estimates(estimator, memory, after, left, phi, u) if ca.is_equal(after[phi], one, DEPTH)]
    if not moved:
        return (
            "the law's estimate is not seen to move by eta du/(mu + du^2) times the innovation, and to be reset where "
            "it or du is small"
        )
    plans_by = [
        one for one in _plans(estimator, memory, after, left, task, phi, u) if ca.is_equal(after[u], one, DEPTH)
    ]
    if not plans_by:
        return "the law's plan is not seen to move by rho phi/(lambda + phi^2) times the error of the next sample"
    given = [*memory, left.r, left.y, left.e, left.u, left.reached]
    return Seen(given, (after[phi], moved[0]), (after[u], plans_by[0]))


def certificate(law: AnyLaw, task: Task) -> Certificate:
    """Return the certificate that estimate and plan are those of (12) to (14). Raises NotCertified where none is."""
    found, estimator = seen(law, task), law.estimator
    if isinstance(found, str) or estimator is None:
        raise NotCertified(str(found))
    names = "estimate", "by_12_13", "plan", "by_14"
    given = [f"given{i}" for i in range(len(found.given))]
    both = [ca.densify(one) for one in (*found.estimate, *found.plan)]
    graph = plain(read(ca.Function("learns", list(found.given), both, given, list(names))))
    pairs: list[Json] = [
        [[one, 0, k], [other, 0, k]] for one, other in (names[:2], names[2:]) for k in range(task.samples)
    ]
    says = "The next estimate is that of (12) and (13), and the next plan that of (14) with it"
    form = Certificate(
        kind="identity",
        statement={"graph": hashed(graph), "says": says, "equal": pairs},
        graphs={hashed(graph): graph},
    )
    facts = {
        name: (float(value), "")
        for name, value in (
            ("eta", estimator.eta),
            ("mu", estimator.mu),
            ("eps", estimator.eps),
            ("rho", estimator.rho),
            ("lambda", estimator.lam),
            ("unit", estimator.force_unit),
        )
    }
    law_says = numbers("The settings of the estimate.", facts, ("<=", "eta", 1), *((">", name, 0) for name in facts))
    return theorem("estimate_form", form=form, law=law_says)


def _named(name: str, rows: int, columns: int) -> Expression:
    return as_expression(ca.SX.sym(name, rows, columns))


def _parameters(estimator: Estimator) -> str:
    """Return which parameter of the estimator lies outside of what is needed, or an empty text."""
    eta = estimator.eta
    if not 0 < eta <= 1:
        return f"eta must lie in (0, 1] for the estimate to be a mean of its last value and the data, got {eta:g}"
    for name, value in (
        ("mu", estimator.mu),
        ("eps", estimator.eps),
        ("rho", estimator.rho),
        ("lambda", estimator.lam),
        ("the force unit", estimator.force_unit),
    ):
        if not 0 < value < np.inf:
            return f"{name} must be positive, got {value:g}"
    return ""


def _acts(law: AnyLaw, memory: Sequence[Expression], place: int, unit: float) -> bool:
    """Tell whether a row of the memory is the plan that the law acts by, in its unit."""
    at_k = type(memory)(*(_named(f"m{i}", one.shape[0], 1) for i, one in enumerate(memory)))
    r, r_next, y = (_named(name, 1, 1) for name in ("r", "r_next", "y"))
    return bool(ca.is_equal(joined(law.act(at_k, (), r, r_next, y)[0]), at_k[place] * unit, 2))


def _estimates(
    estimator: Estimator, memory: Sequence[Expression], after: Sequence[Expression], left: Left, phi: int, u: int
) -> Iterator[Expression]:
    """Yield what the next estimate may be, for every part of the memory that may be what the formula needs."""
    rows = list(zip(memory, after, strict=True))
    plans = [old for old, new in rows if new.shape == memory[u].shape and ca.is_equal(new, memory[u], 0)]
    outputs = [old for old, new in rows if new.shape == left.y.shape and ca.is_equal(new, left.y, 0)]
    for plan in plans:
        for output in outputs:
            du, dy = memory[u] - plan, left.y[1:] - output[1:]
            for gate in _gates(memory, left):
                yield _moved(estimator, memory[phi], du, known(gate, dy - memory[phi] * du))


def _gates(memory: Sequence[Expression], left: Left) -> Iterator[Expression]:
    """Yield when the innovation may be known: it counts as 0 where it is not."""
    reached = left.reached[1:]
    yield reached
    for one in memory:
        if one.shape == left.reached.shape:
            yield ca.logic_and(reached, one[1:])
        if one.shape == (1, 1):
            yield one > 0


def _moved(estimator: Estimator, phi: Expression, du: Expression, xi: Expression) -> Expression:
    """Return the next estimate by the formula."""
    first = estimator.first_estimate()
    moved = phi + estimator.eta * du / (estimator.mu + du**2) * xi  # (12), (15)
    excited = ca.logic_and(ca.fabs(moved) > estimator.eps, ca.fabs(du) > estimator.eps)
    return ca.if_else(ca.logic_and(excited, ca.sign(moved) == ca.sign(first)), moved, first)  # (13)


def _plans(
    estimator: Estimator,
    memory: Sequence[Expression],
    after: Sequence[Expression],
    left: Left,
    task: Task,
    phi: int,
    u: int,
) -> Iterator[Expression]:
    """Yield what the next plan may be; an error that no trial may miss need not be asked whether it is known."""
    errors = [known(left.reached[1:], left.e[1:]), *([] if task.varying_lengths else [left.e[1:]])]
    for e_next in errors:
        yield memory[u] + estimator.rho * after[phi] / (estimator.lam + after[phi] ** 2) * e_next  # (11), (14)
