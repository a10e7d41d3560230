"""A zero-phase low-pass filter on whole rows: second-order Butterworth, forward and backward, symbolic."""

from __future__ import annotations

import math

import casadi as ca

from models.expression import Expression, Number


def low_pass(row: Expression, cutoff_hz: Number, sampling_time: Number) -> Expression:
    """Return a (1, n) row without phase shift and with what lies above the cutoff removed.

    A second-order Butterworth filter (bilinear transform, prewarped) runs forward and then backward, each time
    starting in the steady state of the first value, so constants pass unchanged; the amplitude at the cutoff is
    halved. cutoff_hz must lie below half the sampling frequency.
    """
    warped = ca.tan(math.pi * cutoff_hz * sampling_time)
    scale = 1 + math.sqrt(2) * warped + warped**2
    b0 = warped**2 / scale
    a1 = 2 * (warped**2 - 1) / scale
    a2 = (1 - math.sqrt(2) * warped + warped**2) / scale
    return _backward(_forward(_backward(_forward(row, b0, a1, a2)), b0, a1, a2))


def _backward(row: Expression) -> Expression:
    return row[:, ::-1]


def _forward(row: Expression, b0: Number, a1: Number, a2: Number) -> Expression:
    state, value, coefficients = ca.SX.sym("state", 2), ca.SX.sym("value"), ca.SX.sym("coefficients", 3)
    c0, c1, c2 = ca.vertsplit(coefficients)
    out = c0 * value + state[0]
    following = ca.vertcat(2 * c0 * value - c1 * out + state[1], c0 * value - c2 * out)
    one = ca.Function("low_pass", [state, value, coefficients], [following, out])
    n = row.shape[1]
    fold = one.mapaccum("low_pass_row", n, 1, {"base": 20})
    first = row[0, 0]
    steady = ca.vertcat((1 - b0) * first, (b0 - a2) * first)
    return fold(steady, row, ca.repmat(ca.vertcat(b0, a1, a2), 1, n))[1]
