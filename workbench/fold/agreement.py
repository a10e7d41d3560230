"""Whether a built library computes what its function does, found out where a crash harms nobody."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import casadi as ca
import numpy as np
import numpy.typing as npt

Numbers: TypeAlias = npt.NDArray[np.float64]  # in one row
_TRYING = Path(__file__).with_name("trying.py")


def doubt(function: ca.Function, library: Path, patience: float) -> str | None:
    """Return why a new library is not to be used, or None where it computes what its function does.

    It is called in a process of its own, which may take ``patience`` seconds, and compared with the virtual machine.
    """
    cases = [(case, answer) for case in _cases(function) if (answer := _answer(function, case)) is not None]
    if not cases:
        return "cannot be compared: the virtual machine itself fails"
    ins = ",".join(str(function.nnz_in(i)) for i in range(function.n_in()))
    outs = ",".join(str(function.nnz_out(i)) for i in range(function.n_out()))
    call = [sys.executable, "-I", "-S", str(_TRYING), str(library), function.name(), str(len(cases)), ins, outs]
    given = np.concatenate([number for case, _ in cases for number in case] or [np.empty(0)]).tobytes()
    try:
        ran = subprocess.run(call, input=given, capture_output=True, timeout=patience, check=False)
    except subprocess.TimeoutExpired:
        return f"did not end within {patience:g} seconds"
    if ran.returncode < 0:
        return how_ended(ran.returncode)
    wanted = np.concatenate([answer for _, answer in cases])
    if ran.returncode > 0 or len(ran.stdout) != wanted.nbytes:
        lines = ran.stderr.decode(errors="replace").strip().splitlines()
        return f"cannot be run ({lines[-1] if lines else 'no message'})"
    got = np.frombuffer(ran.stdout).reshape(len(cases), -1)
    same = all(agree(function, answer, other) for (_, answer), other in zip(cases, got, strict=True))
    return None if same else "differs from the virtual machine"


def _cases(function: ca.Function) -> list[list[Numbers]]:
    """Return what a function is tried on, the nonzeros of each input.

    A trial multiplies what it is fed, so numbers of many magnitudes come in short trials, whose rounding stays small.
    """
    rng = np.random.default_rng(0)
    special = np.array([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, np.nan, 1e-310, 1e300])
    last = max((function.size_out(i)[1] for i in range(function.n_out())), default=1) - 1
    cases = []
    for length, spread, share in ((0.9 * last, None, 0.0), (5, 1, 0.0), (5, 6, 0.0), (3, 2, 0.05), (4, 6, 0.1)):
        case = []
        for i, name in enumerate(function.name_in()):
            count = function.nnz_in(i)
            numbers = rng.uniform(0.0, 1.0, count)
            if spread is not None:  # of both signs, from thousandths upward
                numbers = rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-3, spread, count)
                numbers = np.where(rng.uniform(size=count) < share, rng.choice(special, count), numbers)
            case.append(np.full(count, float(round(min(length, last)))) if name == "length" else numbers)
        cases.append(case)
    return cases


def _answer(function: ca.Function, case: Sequence[Numbers]) -> Numbers | None:
    """Return the nonzeros of all outputs, one after the other, or None where the function fails."""
    given = [ca.DM(function.sparsity_in(i), numbers) for i, numbers in enumerate(case)]
    try:
        return np.concatenate([np.empty(0), *(np.array(output.nonzeros()) for output in function.call(given))])
    except RuntimeError:
        return None


def agree(function: ca.Function, one: Numbers, other: Numbers, *, tolerance: float = 1e-9) -> bool:
    """Tell whether two answers of a function are the same but for rounding, NaN and infinities included.

    An answer holds the nonzeros of all outputs, one after the other. The tolerance is a part of the largest number in
    the same row of the same output.
    """
    start = 0
    for i in range(function.n_out()):
        rows = np.array(function.sparsity_out(i).row(), dtype=int)
        a, b = (answer[start : start + rows.size] for answer in (one, other))
        start += rows.size
        finite = np.isfinite(a)
        if not np.array_equal(a[~finite], b[~finite], equal_nan=True) or not np.isfinite(b[finite]).all():
            return False
        largest = np.zeros(function.size1_out(i))
        np.maximum.at(largest, rows[finite], np.abs(a[finite]))
        if (np.abs(a[finite] / 2 - b[finite] / 2) > tolerance / 2 * largest[rows[finite]]).any():  # halves: no overflow
            return False
    return True


def how_ended(status: int) -> str:
    """Return how a process ended that a signal has ended."""
    try:
        return f"ended by {signal.Signals(-status).name}"
    except ValueError:
        return f"ended by signal {-status}"
