"""Judging claims: premises first, refutations replayed, what is proved held against runs.

Nobody gives a standing by hand: it follows from the finding's grounds and margin, and premises, replays and runs may
only weaken it.
"""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from models.quantity import InvalidValue
from models.users_code import InUsersCodeError
from verification.certificates.recheck import Recheck
from verification.report.words import shown_value
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Claim, Expectations, Held, NotCertified, expected_of
from workbench.contracts.finding import STRENGTH, Finding, Grounds, Standing, plain, undecided
from workbench.contracts.verdict import DEFAULT, NotMade, Premise, Verdict

log = logging.getLogger(__name__)
Again = Callable[[Claim], Finding]
"""Does the check of a claim once more, on another run of the campaign."""


EXACT = (Grounds.SETTINGS, Grounds.ALGEBRA, Grounds.ENUMERATION)
"""Grounds on which a check is done again as it is: another run changes nothing."""


class ContradictionWarning(UserWarning):
    """Runs contradict what was proved: the program is at fault."""


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """A finding, and how the claim stands in the end."""

    finding: Finding
    standing: Standing
    method: str
    premises: tuple[tuple[Claim, _Judged], ...] = ()
    held: Held | None = None
    replayed: float | None = None
    contradiction: str = ""
    certificate: Certificate | None = None
    sentence: str = ""
    unchecked: str = ""


class Judge:
    """Judges claims of one case of a study, each once however many claims have it as a premise.

    With ``recheck`` the checker is asked for what was proved, and the verdict says whether it accepted a certificate.
    Where that is ``demanded``, what it does not accept is SUPPORTED at most.
    """

    def __init__(
        self,
        case: str = DEFAULT,
        *,
        expectations: Expectations | None = None,
        again: Again | None = None,
        recheck: Recheck | None = None,
    ) -> None:
        self.case, self.expectations, self.again, self.recheck = case, expectations or {}, again, recheck
        self._known: dict[tuple[str, str, str | None], _Judged] = {}

    def verdict(self, claim: Claim) -> Verdict | NotMade:
        """Return how a claim stands, or that it has no meaning here."""
        if claim.lacks:
            return NotMade(
                claim=claim.name,
                controller=claim.controller,
                statement=claim.statement,
                source=claim.source,
                lacks=claim.lacks,
                case=self.case,
            )
        found = self._judged(claim)
        expected = expected_of(self.expectations, claim.name, claim.controller, self.case)
        return Verdict(
            claim=claim.name,
            controller=claim.controller,
            statement=claim.statement,
            source=claim.source,
            standing=found.standing,
            margin=found.finding.margin,
            unit=found.finding.unit,
            witness=found.finding.witness,
            method=found.method,
            case=self.case,
            role=claim.role if expected is None or expected.role is None else expected.role,
            bound=found.finding.bound,
            bound_unit=found.finding.bound_unit,
            grounds=found.finding.grounds,
            tries=found.finding.tries,
            premises=[
                Premise(claim=one.name, statement=one.statement, standing=its.standing, method=its.method)
                for one, its in found.premises
            ],
            scope=claim.scope() if found.standing is Standing.PROVED else {},
            held=found.held,
            replayed=found.replayed,
            expected=expected,
            contradiction=found.contradiction,
            certificate="" if found.certificate is None else found.certificate.name,
            sentence=found.sentence,
            unchecked=found.unchecked,
        )

    def _judged(self, claim: Claim) -> _Judged:
        key = claim.name, claim.statement, claim.controller
        if key not in self._known:
            self._known[key] = self._judge(claim)
        return self._known[key]

    def _judge(self, claim: Claim) -> _Judged:
        premises = tuple((one, self._judged(one)) for one in claim.premises)
        unmet = _unmet(premises)
        finding = undecided(unmet) if unmet else checked(claim.check)
        judged = _Judged(
            finding=finding,
            standing=finding.standing,
            method=finding.reason or finding.method,
            premises=premises,
        )
        if judged.standing is Standing.REFUTED:
            return self._replayed(claim, judged)
        if unmet or judged.standing is Standing.UNDECIDED:
            return judged
        judged = _weakened(self._rested(claim, judged))
        if judged.standing is Standing.PROVED:
            judged = _attacked(claim, judged)
        return self._certified(claim, judged) if judged.standing is Standing.PROVED else judged

    def _certified(self, claim: Claim, judged: _Judged) -> _Judged:
        """Let what was proved stand as PROVED only where the checker accepts a certificate of it."""
        if self.recheck is None:
            return judged
        try:
            if claim.certify is None:
                raise NotCertified("proofs of this kind have no certificate")
            shown = {one.name: its.certificate for one, its in judged.premises if its.certificate is not None}
            certificate = claim.certify(judged.finding, shown)
            return replace(judged, certificate=certificate, sentence=self.recheck.sentence(certificate))
        except NotCertified as error:
            why = str(error)
        except InUsersCodeError:
            raise
        except Exception as error:
            log.warning("a certificate could not be made: %s", error, exc_info=error)
            why = f"the program met {type(error).__name__}, see its log"
        if not self.recheck.demanded:
            return replace(judged, unchecked=why)
        return replace(
            judged,
            standing=Standing.SUPPORTED,
            method=f"{judged.method}; no more than SUPPORTED, because it is not re-checkable: {why}",
            unchecked=why,
        )

    def _rested(self, claim: Claim, judged: _Judged) -> _Judged:
        """Look at what a proof rests on besides its premises, now that it would hold."""
        if not claim.rests_on:
            return judged
        more = tuple((one, self._judged(one)) for one in claim.rests_on)
        open_one = _unmet(more)
        finding = undecided(open_one) if open_one else judged.finding
        return _Judged(
            finding=finding,
            standing=finding.standing,
            method=open_one or judged.method,
            premises=(*judged.premises, *more),
        )

    def _replayed(self, claim: Claim, judged: _Judged) -> _Judged:
        """Let a refutation stand only if its witness refutes the claim again."""
        found = judged.finding
        at = plain(found.witness)
        assert isinstance(at, dict)
        again = once_more(claim, at, weak=found.weak, again=None if found.grounds in EXACT else self.again)
        if again.standing is not Standing.REFUTED:
            why = f": {again.reason}" if again.reason else ""
            return _Judged(
                finding=undecided("the witness did not refute the claim when it was replayed"),
                standing=Standing.UNDECIDED,
                method=f"a witness was found, and did not refute the claim when it was replayed{why} ({found.method})",
                premises=judged.premises,
            )
        return _Judged(
            finding=found,
            standing=judged.standing,
            method=judged.method,
            premises=judged.premises,
            replayed=again.margin,
        )


def judge(claim: Claim, case: str = DEFAULT) -> Verdict:
    """Return how one claim stands by itself. Raises InvalidValue for a claim that has no meaning here."""
    found = Judge(case).verdict(claim)
    if isinstance(found, NotMade):
        raise InvalidValue(f"{claim.name} cannot be judged, it lacks {found.lacks}")
    return found


def once_more(claim: Claim, witness: Mapping[str, object], *, weak: bool, again: Again | None) -> Finding:
    """Return what is found of a refuted claim at its witness.

    Where the claim has a replay, that; else the check, on another run of the campaign where ``again`` makes one.
    """
    if claim.replay is not None:
        replay = claim.replay
        return checked(lambda: Finding(margin=replay(witness), weak=weak, witness=witness))
    return checked(claim.check if again is None else partial(again, claim))


def checked(check: Callable[[], Finding]) -> Finding:
    """Return what a check finds; one that ends in an error could not tell, and the error goes to the log."""
    try:
        return check()
    except InUsersCodeError:  # a slip of the user's, which no standing should hide
        raise
    except InvalidValue as error:
        return undecided(str(error))
    except Exception as error:
        log.warning("a check ended in an error, %s: %s", type(error).__name__, error)
        log.debug("where it ended", exc_info=error)
        return undecided(f"the check could not be completed: the program met {type(error).__name__}, see its log")


def _unmet(premises: tuple[tuple[Claim, _Judged], ...]) -> str:
    """Return why a theorem says nothing here, or an empty text."""
    for _, its in premises:
        if its.standing is Standing.REFUTED:
            return f"the theorem does not apply: {its.method}"
    for _, its in premises:
        if its.standing is Standing.UNDECIDED:
            return f"a premise is open: {its.method}"
    return ""


def _weakened(judged: _Judged) -> _Judged:
    """Return a conclusion that is at most as strong as its weakest premise."""
    order = STRENGTH.index
    if judged.standing not in STRENGTH[1:]:
        return judged
    for claim, its in judged.premises:
        if order(its.standing) < order(judged.standing):
            return _Judged(
                finding=judged.finding,
                standing=its.standing,
                method=f"{judged.method}; no more than {its.standing}, because a premise is ({claim.statement})",
                premises=judged.premises,
            )
    return judged


def _attacked(claim: Claim, judged: _Judged) -> _Judged:
    """Hold a proved number against runs. A contradiction is a fault of the program, and is said with a warning."""
    if claim.attack is None:
        return judged
    try:
        held = claim.attack(judged.finding)
    except InUsersCodeError:
        raise
    except Exception as error:
        log.warning("an attack ended in an error", exc_info=error)
        met = str(error) if isinstance(error, InvalidValue) else f"the program met {type(error).__name__}, see its log"
        open_ = f"what is proved could not be held against runs: {met}"
        return _Judged(finding=undecided(open_), standing=Standing.UNDECIDED, method=open_, premises=judged.premises)
    if held.margin >= 0:
        return _Judged(
            finding=judged.finding,
            standing=judged.standing,
            method=judged.method,
            premises=judged.premises,
            held=held,
        )
    said = (
        f"PROVED {claim.name} is contradicted by a run, by {-held.margin:.4g} {judged.finding.bound_unit}".rstrip()
        if math.isfinite(held.margin)
        else f"PROVED {claim.name} is contradicted by a run"
    )
    where = shown_value(plain(held.witness))
    warnings.warn(f"{said}: the program is at fault; {where}", ContradictionWarning, stacklevel=2)
    return _Judged(
        finding=judged.finding,
        standing=Standing.UNDECIDED,
        method=f"{said}, so the program is at fault and nothing is said of the claim",
        premises=judged.premises,
        held=held,
        contradiction=f"{said}: {where}",
    )
