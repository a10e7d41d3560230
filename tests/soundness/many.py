"""A campaign of cases: asked one after the other, or in several processes at once."""

from __future__ import annotations

import json
import logging
import multiprocessing
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from soundness.ask import Answer, attempted, without_a_compiler


def answered(count: int, processes: int, seed: int, kept: Path | None) -> Iterator[list[Answer]]:
    """Yield the answers of case after case, those that are kept first."""
    done: set[int] = set()
    if kept is not None and kept.is_file():
        for line in kept.read_text().splitlines():
            number, rows = json.loads(line)
            if number < count:
                done.add(number)
                yield [Answer(*row) for row in rows]
    left = [number for number in range(count) if number not in done]
    with multiprocessing.get_context("spawn").Pool(processes, initializer=_quiet) as pool:
        for found in pool.imap_unordered(partial(_attempted, seed=seed), left, chunksize=4):
            if kept is not None:
                with kept.open("a") as file:
                    file.write(json.dumps([found[0].number, found]) + "\n")
            yield found


def _attempted(number: int, seed: int) -> list[Answer]:
    with without_a_compiler():
        return attempted(number, seed)


def _quiet() -> None:
    logging.disable(logging.WARNING)
