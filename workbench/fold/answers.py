"""What a law answers, held against what it was asked: a slip is one line that names the class and the method."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar, cast

import casadi as ca
import numpy as np

from models.expression import Expression
from models.plant import Plant, stacked
from models.quantity import InvalidValue
from workbench.contracts.law import Decision, Law, Seen, Task, Trial
from workbench.fold.named import fields_of, flat, like, names

P = ParamSpec("P")
T = TypeVar("T")
M = TypeVar("M", bound=tuple[object, ...])
S = TypeVar("S", bound=tuple[object, ...])

KINDS = (ca.SX, ca.MX, ca.DM, int, float, np.ndarray, np.generic)
"""What stands for an expression."""


def asked(law: Law[M, S], what: str, method: Callable[P, T], *args: P.args, **named: P.kwargs) -> T:
    """Call a law's method ``what``; raise InvalidValue where it takes other arguments than it is given."""
    try:
        return method(*args, **named)
    except TypeError as error:
        if error.__traceback__ is not None and error.__traceback__.tb_next is not None:  # it failed within
            raise
        takes = ", ".join(list(inspect.signature(vars(Law)[what]).parameters)[1:])
        raise InvalidValue(f"{_named(law)}.{what} must take ({takes}): {error}") from error


def begun(law: Law[M, S], task: Task) -> M:
    """Return the memory before the first trial."""
    memory = asked(law, "start", law.start, task)
    return _kept(law, "start", memory)


def made_ready(law: Law[M, S], memory: M) -> S:
    """Return the acting state at the beginning of a trial."""
    return _kept(law, "ready", asked(law, "ready", law.ready, memory))


def placed(law: Law[M, S], memory: M, x0: Expression) -> Expression:
    """Return the state in which a trial begins, a column (nx, 1)."""
    x = asked(law, "place", law.place, memory, x0)
    return cast(Expression, _shaped(law, "place", "the initial state", x, (x0.shape[0], 1)))


def acted(
    law: Law[M, S], plant: Plant, memory_k: M, state: S, r: Expression, r_next: Expression, y: Expression
) -> tuple[Expression, S]:
    """Return the inputs, a column (nu, 1), and the next acting state."""
    answer = asked(law, "act", law.act, memory_k, state, r, r_next, y)
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise InvalidValue(
            f"{_named(law)}.act must give (u, state), the input and the next acting state; got {_shown(answer)}"
        )
    u, following = answer
    return stacked(u, plant.inputs, f"{_named(law)}.act"), _alike(law, "act", "the acting state", state, following)


def learned(law: Law[M, S], memory: M, trial: Trial[S]) -> M:
    """Return the memory for the next trial, in the shapes of the one before."""
    return _alike(law, "learn", "the memory", memory, asked(law, "learn", law.learn, memory, trial))


def tellings(law: Law[M, S], memory: M, trial: Trial[S], samples: int) -> list[Expression]:
    """Return what a law tells, one row (1, N) a signal."""
    if not law.tells:
        return []
    told = asked(law, "tell", law.tell, memory, trial)
    signals = ", ".join(signal.name for signal in law.tells)
    if not isinstance(told, (tuple, list)) or len(told) != len(law.tells):
        raise InvalidValue(f"{_named(law)}.tell must give {len(law.tells)} row(s) ({signals}), got {_shown(told)}")
    for signal, row in zip(law.tells, told, strict=True):
        _shaped(law, "tell", signal.name, row, (1, samples))
    return list(told)


def estimated(law: Law[M, S], memory: M, plant: Plant, samples: int) -> Expression | None:
    """Return the estimate of the pseudo partial derivative, (outputs x inputs, N), or None."""
    estimate = asked(law, "ppd_estimate", law.ppd_estimate, memory)
    if estimate is None:
        return None
    rows = len(plant.outputs) * len(plant.inputs)
    return cast(Expression, _shaped(law, "ppd_estimate", "the estimate", estimate, (rows, samples)))


def decided(law: Law[M, S], memory: M, state: S, seen: Seen) -> tuple[Decision, S]:
    """Return what a stepped law decides at a sample, and its next acting state."""
    answer = asked(law, "decide", law.decide, memory, state, seen)
    if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[0], Decision):
        raise InvalidValue(
            f"{_named(law)}.decide must give (Decision(u=...), state), the decision and the next acting state; "
            f"got {_shown(answer)} at sample {seen.k}"
        )
    return answer


def kept(law: object, what: str, given: T) -> T:
    """Return what a law keeps; raise InvalidValue unless it is a NamedTuple, or ()."""
    if not isinstance(given, tuple) or fields_of(given) is None:
        raise InvalidValue(f"{_named(law)}.{what} must give a NamedTuple, or () for nothing; got {_shown(given)}")
    return given


def _named(law: object) -> str:
    return type(law).__name__


def _shown(value: object) -> str:
    """Return what came, in a word or two."""
    if isinstance(value, (ca.SX, ca.MX, ca.DM, np.ndarray)):
        return f"one {type(value).__name__} of shape {tuple(value.shape)}"
    if isinstance(value, (tuple, list)):
        return f"{len(value)} value(s)"
    return " ".join(repr(value).split())


def _shape(value: object) -> tuple[int, ...] | None:
    """Return the shape of what stands for an expression as CasADi takes it, or None for what does not."""
    if isinstance(value, (ca.SX, ca.MX, ca.DM)):
        return tuple(value.shape)
    if isinstance(value, KINDS):
        shape = np.shape(value)
        return (1, 1) if not shape else (shape[0], 1) if len(shape) == 1 else tuple(shape)
    return None


def _shaped(law: object, what: str, part: str, value: object, shape: tuple[int, int]) -> object:
    """Return a value of a shape; raise InvalidValue for another."""
    if _shape(value) != shape:
        raise InvalidValue(f"{_named(law)}.{what} must give {part} in the shape {shape}, got {_shown(value)}")
    return value


def _kept(law: object, what: str, given: T) -> T:
    """Return what a law keeps; raise InvalidValue unless it is a NamedTuple of what stands for expressions, or ()."""
    kept(law, what, given)
    assert isinstance(given, tuple)
    for name, value in zip(fields_of(given) or (), given, strict=True):
        if isinstance(value, tuple):
            _kept(law, what, value)
        elif _shape(value) is None:
            raise InvalidValue(f"{_named(law)}.{what} must give {name} as an expression or a number, got {value!r}")
    return given


def _alike(law: object, what: str, part: str, before: T, after: T) -> T:
    """Return what a law keeps next, in the types of what it kept before; raise InvalidValue for other shapes."""
    assert isinstance(before, tuple)
    fields: Sequence[str] = names(before)
    expected = f"a {type(before).__name__} of {', '.join(fields)}" if fields else "()"
    if not isinstance(after, tuple) or fields_of(after) is None or names(_kept(law, what, after)) != fields:
        raise InvalidValue(f"{_named(law)}.{what} must give {part} as {expected}, got {_shown(after)}")
    for name, old, new in zip(fields, flat(before), flat(after), strict=True):
        if _shape(new) != _shape(old):
            raise InvalidValue(
                f"{_named(law)}.{what} must keep the shape of {name}, {_shape(old)}; got {_shape(new) or repr(new)}"
            )
    return cast(T, like(before, flat(after)))
