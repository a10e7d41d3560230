"""The folded trial in single precision: the same operations in the same order, every number of them a float32.

CasADi writes the C of a Function for any kind of number, and keeps every constant and every result in one. Here it is
built for ``float`` and called through a Function that takes and gives doubles: what runs trials need not know. A
function of C's library (a sine, a power) is taken in double precision and rounded, as nearly right as a float32 can be.
"""

from __future__ import annotations

import ctypes
import dataclasses
import os
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.quantity import InvalidValue
from workbench.fold.fold import Fold
from workbench.fold.machine_code import library

Floats = NDArray[np.float32]


def in_single(fold: Fold) -> Fold:
    """Return the fold whose Functions compute in single precision; what they are given is rounded to it first.

    Raises InvalidValue where CasADi writes no C of it, or there is no compiler.
    """
    generator = ca.CodeGenerator(f"{fold.trial.name()}.c", {"with_header": False, "casadi_real": "float"})
    try:
        generator.add(fold.start)
        generator.add(fold.trial)
        text = generator.dump()
    except RuntimeError as error:
        said = str(error).strip().splitlines()
        raise InvalidValue(
            f"CasADi writes no C of {fold.trial.name()} ({said[-1] if said else 'no message'})"
        ) from None
    built = library(f"{fold.trial.name()[:64]}-single", text)
    if built is None:
        raise InvalidValue(f"no C of {fold.trial.name()} could be built: a C compiler is needed (set CC to one)")
    code = ctypes.CDLL(str(built), mode=os.RTLD_NOW)
    return dataclasses.replace(fold, start=_Single(fold.start, code), trial=_Single(fold.trial, code))


class _Single(ca.Callback):
    """A library of single precision as a Function of doubles."""

    def __init__(self, function: ca.Function, code: ctypes.CDLL) -> None:
        ca.Callback.__init__(self)
        self._function, self._code = function, code
        name, sizes = function.name(), (ctypes.c_longlong * 4)()
        self._code[f"{name}_work"](*(ctypes.byref(sizes, 8 * i) for i in range(4)))
        self._takes = [np.zeros(function.nnz_in(i), dtype=np.float32) for i in range(function.n_in())]
        self._gives = [np.zeros(function.nnz_out(i), dtype=np.float32) for i in range(function.n_out())]
        self._arguments, self._results = _pointers(self._takes, sizes[0]), _pointers(self._gives, sizes[1])
        self._whole, self._real = (ctypes.c_longlong * (sizes[2] + 1))(), (ctypes.c_float * (sizes[3] + 1))()
        self._code[f"{name}_incref"]()
        self._call, self._memory = self._code[name], self._code[f"{name}_checkout"]()
        self.construct(f"{name}_single")

    def get_n_in(self) -> int:
        return self._function.n_in()

    def get_n_out(self) -> int:
        return self._function.n_out()

    def get_name_in(self, i: int) -> str:
        return str(self._function.name_in(i))

    def get_name_out(self, i: int) -> str:
        return str(self._function.name_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._function.sparsity_in(i)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._function.sparsity_out(i)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, given: Sequence[memoryview | None], left: Sequence[memoryview | None]) -> int:
        """Round what is given, call, and write what is left; CasADi hands the nonzeros of each as bytes."""
        with np.errstate(over="ignore"):
            for floats, doubles in zip(self._takes, given, strict=True):
                floats[:] = 0.0 if doubles is None or not floats.size else np.frombuffer(doubles, dtype=np.float64)
        if self._call(self._arguments, self._results, self._whole, self._real, self._memory):
            return 1
        for floats, doubles in zip(self._gives, left, strict=True):
            if doubles is not None and floats.size:
                np.frombuffer(doubles, dtype=np.float64)[:] = floats
        return 0


def _pointers(rows: Sequence[Floats], size: int) -> ctypes.Array[ctypes.c_void_p]:
    """Return pointers to rows of numbers; what is empty is a null pointer."""
    pointers = (ctypes.c_void_p * (max(size, len(rows)) + 1))()
    for index, row in enumerate(rows):
        pointers[index] = row.ctypes.data if row.size else None
    return pointers
