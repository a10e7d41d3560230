"""What draws say of all that could be drawn: how large the share that fails may still be."""

from __future__ import annotations

import math

from scipy.special import betaincinv

from models.quantity import InvalidValue
from workbench.contracts.finding import Finding, Standing, undecided

MOST = 0.01
"""The largest share of failures with which a claim about all draws still counts as supported."""
CONFIDENCE = 0.95


def most_that_fail(failed: int, tries: int, confidence: float = CONFIDENCE) -> float:
    """Return the largest share of failures that so many of so many independent draws are still likely to come from.

    The one-sided bound of Clopper and Pearson. Raises InvalidValue unless 0 <= failed <= tries and tries > 0.
    """
    if not 0 <= failed <= tries or tries < 1:
        raise InvalidValue(f"failed must lie in [0, tries] with one try at least, got {failed} of {tries}")
    return 1.0 if failed == tries else float(betaincinv(failed + 1, tries - failed, confidence))


def tries_needed(most: float = MOST, confidence: float = CONFIDENCE) -> int:
    """Return how many draws without a failure are needed to say that at most a share of all fails."""
    return math.ceil(math.log(1 - confidence) / math.log(1 - most))


def in_words(failed: int, tries: int, what: str) -> str:
    """Return e.g. "0 of 50 draws: at most 5.82 % at 95 % confidence"."""
    share = 100 * most_that_fail(failed, tries)
    return f"{failed} of {tries} {what}: at most {share:.3g} % at {100 * CONFIDENCE:g} % confidence"


def about_all(finding: Finding) -> Finding:
    """Return the finding of a claim about all draws: what holds in too few of them is UNDECIDED, with the number."""
    needed = tries_needed()
    if finding.standing is not Standing.SUPPORTED or finding.tries >= needed:
        return finding
    return undecided(
        f"{finding.method}; it takes {needed} independent draws without a failure to say that at most "
        f"{100 * MOST:g} % of all fail",
        margin=finding.margin,
        unit=finding.unit,
        tries=finding.tries,
        beside={name: value for name, value in (finding.witness or {}).items() if name != "tries"},
    )
