"""Ask every claim of COUNT random cases, print the table of shares and write it where it is asked to.

``python -m soundness --count 10000 --processes 2 --seed 0 --into ../docs/soundness.md``; ``--kept FOLDER`` keeps the
answers as they come, so that a campaign goes on where it was stopped. Ends with 1 after a false verdict.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from soundness.ask import Answer
from soundness.many import answered
from soundness.page import page
from soundness.table import tally


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m soundness", description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kept", type=Path, default=None, help="file that keeps answers as they come")
    parser.add_argument("--into", type=Path, default=None, help="file that the page is written into")
    told = parser.parse_args()
    answers: list[Answer] = []
    for i, found in enumerate(answered(told.count, told.processes, told.seed, told.kept), 1):
        answers += found
        for one in found:
            if one.false or one.claim == "broke down":
                print(f"case {one.number} ({one.family}, {one.law}): {one.claim} {one.standing}; {one.why}: {one.said}")
        if i % 200 == 0:
            print(f"{i} of {told.count} cases", file=sys.stderr, flush=True)
    made = tally(answers)
    text = page(made, told.seed)
    print(text)
    if told.into is not None:
        told.into.write_text(text)
    if told.kept is not None:
        told.kept.unlink(missing_ok=True)
    return 1 if made.false_proved or made.false_refuted or made.broke else 0


if __name__ == "__main__":
    sys.exit(main())
