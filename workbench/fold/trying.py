"""A built function called in a process of its own: what ends or hangs it there harms nobody.

Run as ``python -I -S trying.py LIBRARY NAME CASES INS OUTS``: INS and OUTS are the numbers of values of each input
and output. Cases come as doubles on standard input, one after the other; their outputs go to standard output. It
needs the standard library only, so it starts in some hundredths of a second.
"""

from __future__ import annotations

import ctypes
import os
import sys
from array import array


def main(library: str, name: str, cases: str, ins: str, outs: str) -> int:
    """Call the function on every case; return what it returned where that is not zero."""
    answers = os.dup(1)
    os.dup2(2, 1)  # what the function prints is no answer
    code = ctypes.CDLL(library, mode=os.RTLD_NOW)
    sizes = (ctypes.c_longlong * 4)()
    code[f"{name}_work"](*(ctypes.byref(sizes, 8 * i) for i in range(4)))
    code[f"{name}_incref"]()
    memory = code[f"{name}_checkout"]()
    takes, gives = ([int(count) for count in counts.split(",") if count] for counts in (ins, outs))
    given = array("d", sys.stdin.buffer.read())
    left = array("d", bytes(8 * sum(gives)))
    to_left = _pointers(left, gives, 0, sizes[1])
    whole, real = (ctypes.c_longlong * (sizes[2] + 1))(), (ctypes.c_double * (sizes[3] + 1))()
    with os.fdopen(answers, "wb") as file:
        for case in range(int(cases)):
            arguments = _pointers(given, takes, case * sum(takes), sizes[0])
            if failed := code[name](arguments, to_left, whole, real, memory):
                return int(failed)
            file.write(left)
    return 0


def _pointers(numbers: array[float], counts: list[int], start: int, size: int) -> ctypes.Array[ctypes.c_void_p]:
    """Return pointers to parts of some numbers that follow each other; what is empty is a null pointer."""
    pointers = (ctypes.c_void_p * (size + 1))()
    address, _ = numbers.buffer_info()
    for index, count in enumerate(counts):
        pointers[index] = address + 8 * start if count else None
        start += count
    return pointers


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
