"""Progress of long work: a bar on a terminal and in a notebook, nothing in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm


def _watched() -> bool:
    """Tell whether somebody sees the bar: a terminal, or the kernel of a notebook."""
    if sys.stderr.isatty():
        return True
    kernel = sys.modules.get("IPython")
    shell = kernel.get_ipython() if kernel is not None else None
    return type(shell).__name__ == "ZMQInteractiveShell"


@contextmanager
def bar(total: int, label: str) -> Iterator[Callable[[int], object]]:
    """Show a bar of ``total`` steps; the value is called with the steps done."""
    with tqdm(total=total, desc=label, disable=not _watched(), leave=False, mininterval=0.2) as shown:
        yield shown.update


@contextmanager
def silent(total: int, label: str) -> Iterator[Callable[[int], object]]:
    """Show nothing."""
    yield lambda steps: None
