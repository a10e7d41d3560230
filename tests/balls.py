"""One point of a Function in balls of 200 bits: an oracle for enclosures."""

from collections.abc import Callable

import casadi as ca
from flint import arb, ctx


class UnclearError(Exception):
    """A comparison that 200 bits do not settle."""


def _settle(yes: bool, no: bool) -> arb:
    if yes == no:
        raise UnclearError
    return arb(1 if yes else 0)


def _true(a: arb) -> bool:
    if a == 0:
        return False
    if a > 0 or a < 0:
        return True
    raise UnclearError


def _floor(a: arb) -> arb:
    low = a.floor().unique_fmpz()
    if low is None:
        raise UnclearError
    return arb(low)


def _sign(a: arb) -> arb:
    return arb(0) if a == 0 else arb(1 if _settle(a > 0, a < 0) == 1 else -1)


def _copysign(a: arb, b: arb) -> arb:
    return abs(a) * (1 if _settle(b > 0, b < 0) == 1 else -1)


def _power(a: arb, b: arb) -> arb:
    whole = b.unique_fmpz() if b.is_exact() else None
    if whole is not None:
        return a**whole
    return arb(0) if a == 0 and b > 0 else a**b


def _trunc(a: arb) -> arb:
    return _floor(a) if a >= 0 else -_floor(-a)


ORACLE: dict[int, Callable[..., arb]] = {
    ca.OP_ADD: lambda a, b: a + b, ca.OP_SUB: lambda a, b: a - b, ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b, ca.OP_NEG: lambda a: -a, ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_SQ: lambda a: a * a, ca.OP_INV: lambda a: 1 / a, ca.OP_SQRT: arb.sqrt, ca.OP_EXP: arb.exp,
    ca.OP_LOG: arb.log, ca.OP_POW: _power, ca.OP_CONSTPOW: _power, ca.OP_SIN: arb.sin, ca.OP_COS: arb.cos,
    ca.OP_TAN: arb.tan, ca.OP_ASIN: arb.asin, ca.OP_ACOS: arb.acos, ca.OP_ATAN: arb.atan,
    ca.OP_ATAN2: lambda a, b: arb.atan2(a, b), ca.OP_SINH: arb.sinh, ca.OP_COSH: arb.cosh, ca.OP_TANH: arb.tanh,
    ca.OP_ASINH: arb.asinh, ca.OP_ACOSH: arb.acosh, ca.OP_ATANH: arb.atanh, ca.OP_ERF: arb.erf,
    ca.OP_ERFINV: arb.erfinv, ca.OP_EXPM1: arb.expm1, ca.OP_LOG1P: arb.log1p,
    ca.OP_HYPOT: lambda a, b: (a * a + b * b).sqrt(), ca.OP_FABS: abs, ca.OP_SIGN: _sign, ca.OP_FLOOR: _floor,
    ca.OP_CEIL: lambda a: -_floor(-a), ca.OP_FMIN: lambda a, b: a.min(b), ca.OP_FMAX: lambda a, b: a.max(b),
    ca.OP_COPYSIGN: _copysign, ca.OP_FMOD: lambda a, b: a - b * _trunc(a / b),
    ca.OP_REMAINDER: lambda a, b: a - b * _floor(a / b + 0.5),
    ca.OP_LT: lambda a, b: _settle(a < b, a >= b), ca.OP_LE: lambda a, b: _settle(a <= b, a > b),
    ca.OP_EQ: lambda a, b: _settle(a == b, a != b), ca.OP_NE: lambda a, b: _settle(a != b, a == b),
    ca.OP_NOT: lambda a: arb(0 if _true(a) else 1), ca.OP_AND: lambda a, b: arb(int(_true(a) and _true(b))),
    ca.OP_OR: lambda a, b: arb(int(_true(a) or _true(b))),
    ca.OP_IF_ELSE_ZERO: lambda c, a: a if _true(c) else arb(0),
}  # fmt: skip


def ball(function: ca.Function, point: list[float]) -> arb | None:
    """Evaluate the single output of a Function of scalars; None where a comparison cannot be settled.

    200 bits are enough for nearly all; sums of numbers of very different size may need some thousand.
    """
    for bits in (200, 2400):
        try:
            value = ball_of(function, point, bits)
        except UnclearError:
            continue
        if value.is_finite() or bits == 2400:
            return value
    return None


def ball_of(function: ca.Function, point: list[float], bits: int) -> arb:
    slots: dict[int, arb] = {}
    result = arb(0)
    with ctx.workprec(bits):
        for k in range(function.n_instructions()):
            op, out, into = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
            if op == ca.OP_OUTPUT:
                result = slots[into[0]]
            elif op == ca.OP_INPUT:
                slots[out[0]] = arb(point[into[0]])
            elif op == ca.OP_CONST:
                slots[out[0]] = arb(function.instruction_constant(k))
            else:
                slots[out[0]] = ORACLE[op](*(slots[i] for i in into))
    return result


def holds(low: float, high: float, value: arb) -> bool:
    """Say whether a ball of 200 bits may lie between two doubles: a slip of one last place is seen."""
    return bool(value.is_finite() and not value < arb(low) and not value > arb(high))
