"""Taking times and memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping


def least_times(works: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the least time of each work in seconds, taken turn by turn so that all meet the same machine."""
    least = dict.fromkeys(works, float("inf"))
    for _ in range(rounds):
        for name, work in works.items():
            begin = time.perf_counter()
            work()
            least[name] = min(least[name], time.perf_counter() - begin)
    return least


MEASURED = """
import sys, time
begin = time.perf_counter()
{code}
seconds = time.perf_counter() - begin
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(seconds, int(peak.split()[1]) / 1024, file=sys.stderr)
"""


def in_a_new_process(code: str, **environment: str) -> tuple[float, float]:
    """Return seconds (its start not included) and peak memory in MB of code run in a Python of its own."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED.format(code=code)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    seconds, megabytes = done.stderr.split()[-2:]
    return float(seconds), float(megabytes)


def command_time(*arguments: str, **environment: str) -> float:
    """Return the seconds that a command of the workbench takes, its start included."""
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "workbench", *arguments], env=os.environ | environment, capture_output=True, check=True
    )
    return time.perf_counter() - begin
