"""Every general claim asked of a case, as ``verify`` asks them, and held against the truth."""

from __future__ import annotations

import os
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from soundness.attack import campaigns
from soundness.case import Case
from soundness.families import drawn
from soundness.truth import UNKNOWN, Known, truth
from verification.checks.funnel import Open
from verification.decide.judge import Judge
from verification.decide.verify import AnotherRun, examination_of
from verification.enclosure import recursion
from verification.theorems.dossier import Dossier
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import NotMade, Verdict
from workbench.trials.campaign import run

FUNNEL = "increment_funnel"
PROVABLE = frozenset(
    {
        "A1", "A2.printed", "A2.lifted", "A4.partial", "lemma1", "lambda_min.partial", "theorem1.conclusion",
        "increment_monotone", "increment_weighted", FUNNEL, "increment_limit", "learning_curve",
    }
)  # fmt: skip
"""Claims that can be proved; the others are about what was run, and SUPPORTED is all that they can be."""


class Answer(NamedTuple):
    """How a claim of a case stands beside what is true of it."""

    number: int
    family: str
    law: str
    claim: str
    standing: str
    """As the verdict says, or ``not made``."""
    holds: bool | None
    due: bool
    why: str
    said: str
    """What the verdict says."""

    @property
    def false(self) -> bool:
        """Whether the verdict says the opposite of the truth."""
        if self.holds is None:
            return False
        if self.holds:
            return self.standing == Standing.REFUTED
        return self.standing == Standing.PROVED or (
            self.standing == Standing.SUPPORTED and self.claim not in PROVABLE and not self.claim.startswith("limit.")
        )

    @property
    def decided(self) -> bool:
        """Whether the verdict says the truth, as firmly as it can be said."""
        if self.holds is None:
            return False
        if not self.holds:
            return self.standing == Standing.REFUTED
        return self.standing == Standing.PROVED or (self.standing == Standing.SUPPORTED and not self._proves)

    @property
    def _proves(self) -> bool:
        """Whether a true one has to be proved to be decided."""
        return (self.claim in PROVABLE and self.claim != "A2.printed") or self.claim.startswith("limit.")


@contextmanager
def without_a_compiler() -> Iterator[None]:
    """Run tiny plants on CasADi's virtual machine; the library that carries sets is built before."""
    before = os.environ.get("CC")
    recursion._c()
    os.environ["CC"] = "no-compiler"
    try:
        yield
    finally:
        if before is None:
            del os.environ["CC"]
        else:
            os.environ["CC"] = before


def asked(number: int, seed: int = 0) -> list[Answer]:
    """Return the answers to all claims on case ``number`` of a campaign of cases."""
    return answers(number, drawn(number, seed))


def answers(number: int, case: Case) -> list[Answer]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        made = _answers(number, case)
    contradicted = [str(one.message) for one in said if "contradicted" in str(one.message)]
    return made + [_answer(number, case, "the judge's own attack", "PROVED", False, one) for one in contradicted]


def _answers(number: int, case: Case) -> list[Answer]:
    campaign = run(case.study, show_progress=False)
    examined = examination_of(campaign)
    judge = Judge(expectations=examined.expectations, again=AnotherRun(campaign, False))
    dossier = Dossier(campaign, case.law.kind)
    seen = case.channels == 1 and len(case.run.u) > 0
    known = Known(case, dossier.box, dossier.hull) if seen else None
    made = []
    for claim in examined.claims:
        verdict, name = judge.verdict(claim), claim.name.split(".", 1)[1]
        if isinstance(verdict, NotMade):
            made.append(_answer(number, case, name, "not made", None, verdict.lacks))
            continue
        true = UNKNOWN if known is None else truth(known, name)
        refused = _contradicted(case, dossier, name, verdict) if verdict.standing is Standing.PROVED else ""
        if refused:
            true = true._replace(holds=False, why=refused)
        made.append(Answer(number, case.family, case.law.kind, name, str(verdict.standing), *true, verdict.method))
    return made


def _answer(number: int, case: Case, claim: str, standing: str, holds: bool | None, said: str) -> Answer:
    return Answer(number, case.family, case.law.kind, claim, standing, holds, False, "", said)


def _contradicted(case: Case, dossier: Dossier, name: str, verdict: Verdict) -> str:
    """Return what random campaigns say against a claim that was proved of all trials, or an empty text."""
    if name == FUNNEL:
        sets = dossier.funnels.funnel.sets
        met = campaigns(case, seed=case.seed)
        for what, ends, band in (("state", met.x, np.swapaxes(sets.x, 0, 1)), ("input", met.u, sets.u)):
            room = 1e-9 * (1 + np.abs(band).max())
            if (ends[..., 0] < band[..., 0] - room).any() or (ends[..., 1] > band[..., 1] + room).any():
                return f"a random campaign leaves the band of the {what}"
    if name == "learning_curve":
        bounds = dossier.funnels.curve
        assert not isinstance(bounds, Open)
        common = bounds.common
        met = campaigns(case, seed=case.seed, trials=common.size, shortest=bounds.last)
        if (met.mse > common * (1 + 1e-9) + 1e-15).any():
            return "the error of a random campaign lies above the curve"
    if name.startswith("limit."):
        low, high = (case.limits or {})[name.removeprefix("limit.")]
        met = campaigns(case, seed=case.seed)
        ends = met.x[0] if name.endswith("x0") else met.u
        if (low is not None and ends[..., 0].min() < low - 1e-9) or (
            high is not None and ends[..., 1].max() > high + 1e-9
        ):
            return "a random campaign leaves the bounds"
    return ""


def attempted(number: int, seed: int = 0) -> list[Answer]:
    """Return the answers, or, where the program broke down, that it did."""
    try:
        return asked(number, seed)
    except Exception as error:
        case, at = drawn(number, seed), traceback.extract_tb(error.__traceback__)[-1]
        where = f"{type(error).__name__} at {os.path.basename(at.filename)}:{at.lineno}: {error}"
        return [_answer(number, case, "broke down", "UNDECIDED", None, where)]
