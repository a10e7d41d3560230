"""Examining a campaign: the claims of its study, each checked."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cached_property, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import TypeVar

from models.quantity import InvalidValue
from models.users_code import asking
from verification.certificates.recheck import Recheck
from verification.decide.judge import Judge
from verification.report.gate import Gate
from verification.report.write import CASES, Report, write_into
from verification.theorems import learning
from verification.theorems.limits import limits
from verification.theorems.outcomes import outcomes
from workbench.contracts.claim import Claim, Held
from workbench.contracts.examination import Examination, Figure, Table
from workbench.contracts.finding import Finding
from workbench.contracts.settings import in_case
from workbench.contracts.study import Study
from workbench.contracts.survival import Survivals
from workbench.contracts.verdict import DEFAULT, NotMade, Verdict
from workbench.evidence.digits import Digits
from workbench.trials import progress
from workbench.trials.campaign import Campaign, run
from workbench.trials.replay import replayed

log = logging.getLogger(__name__)
T = TypeVar("T")
Scored = Mapping[str, Mapping[str, float | None]]
GROUP = "workbench.claims"
"""The entry points that name a study's claims: ``name = "package.module:examine"``."""


def examination_of(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination that belongs to a campaign's study.

    An installed study names its ``examine(campaign, full=...)`` by an entry point; every other study gets the claims
    of learning laws in general, :mod:`verification.theorems.learning`. What the study claims and expects itself comes
    after them. Raises InvalidValue in one line for claims that cannot be made.
    """
    study, digits = campaign.study, Digits(campaign)
    named = entry_points(group=GROUP, name=study.name)
    made: Examination = (next(iter(named)).load() if named else learning.examine)(campaign, full=full)
    return dataclasses.replace(
        made,
        claims=[*made.claims, *outcomes(campaign, digits), *limits(campaign), *_own(campaign)],
        expectations={
            name: [*made.expectations.get(name, ()), *study.expected.get(name, ())]
            for name in {**made.expectations, **study.expected}
        },
        digits=lambda: digits.table,
    )


def _own(campaign: Campaign) -> list[Claim]:
    """Return the claims that a study makes itself, whose slips are told with their place."""
    found: list[Claim] = []
    for claimer in campaign.study.claims:
        with asking("the claims of the study", claimer):
            made = claimer(campaign.study, campaign.data)
            if not isinstance(made, (list, tuple)):
                raise InvalidValue(f"claims must be a list of Claim objects, got {made!r}")
            for one in made:
                if not isinstance(one, Claim):
                    raise InvalidValue(f"claims must be Claim objects, got {one!r}")
                if not callable(one.check):
                    raise InvalidValue(f"the check of {one.name} must be a function, got {one.check!r}")
            found += [_told_with_its_place(one) for one in made]
    return found


def _told_with_its_place(claim: Claim) -> Claim:
    """Return a user's claim, in whose check, replay and attack a slip is told with its place."""
    replay, attack = claim.replay, claim.attack

    def again(witness: Mapping[str, object]) -> float:
        assert replay is not None
        with asking(f"the replay of {claim.name}", replay):
            return float(replay(witness))

    def held(finding: Finding) -> Held:
        assert attack is not None
        with asking(f"the attack of {claim.name}", attack):
            made = attack(finding)
            if not isinstance(made, Held):
                raise InvalidValue(f"an attack must give a Held, got {made!r}")
            return made

    return dataclasses.replace(
        claim,
        check=partial(_asked, claim),
        replay=None if replay is None else again,
        attack=None if attack is None else held,
    )


def _asked(claim: Claim) -> Finding:
    with asking(f"the check of {claim.name}", claim.check):
        finding = claim.check()
        if not isinstance(finding, Finding):
            raise InvalidValue(f"a check must give a Finding, got {finding!r}")
        return finding


class AnotherRun:
    """Does checks once more on a campaign that is run again from its settings, when the first is asked for."""

    def __init__(self, campaign: Campaign, full: bool) -> None:
        self.campaign, self.full = campaign, full

    @cached_property
    def claims(self) -> dict[tuple[str, str | None], Claim]:
        """The claims on the other run, with those that are premises of others alone."""
        other = run(self.campaign.study, show_progress=False)
        return {(one.name, one.controller): one for one in _with_premises(examination_of(other, full=self.full).claims)}

    def __call__(self, claim: Claim) -> Finding:
        """Do the check of the claim of the same name. Raises InvalidValue where the other run makes no such claim."""
        found = self.claims.get((claim.name, claim.controller))
        if found is None:
            raise InvalidValue(f"{claim.name} is no claim of another run of the campaign: give it a replay of its own")
        return found.check()


def _with_premises(claims: Sequence[Claim]) -> Iterator[Claim]:
    """Give what claims stand on, and then themselves."""
    for one in claims:
        yield from _with_premises((*one.premises, *one.rests_on))
        yield one


def verify(
    campaign: Campaign,
    claims: Examination | Sequence[Claim] | None = None,
    *,
    full: bool = False,
    show_progress: bool = True,
    recheck: Recheck | None = None,
) -> Report:
    """Check every claim on a campaign and return the report's content.

    ``claims`` are claims of one's own, or a whole examination; by default those of the campaign's study. ``full``
    adds the long sweeps. A campaign that was loaded is run again first, and held against its record: see
    :func:`workbench.trials.replay.replayed`, which raises InvalidValue where the two depart. Certificates go to
    ``recheck``, by default to one of the report's own.
    """
    recheck = recheck or Recheck()
    if not isinstance(campaign, Campaign):
        raise InvalidValue(f"verify takes a campaign, as in verify(run(study)); got {repr(campaign).splitlines()[0]}")
    replayed(campaign, show_progress=show_progress)
    if claims is None:
        chosen = examination_of(campaign, full=full)
    else:
        chosen = claims if isinstance(claims, Examination) else Examination(claims=claims, conclude=lambda _: [])
    shown = progress.bar if show_progress else progress.silent
    judge = Judge(
        campaign.study.case or DEFAULT,
        expectations=chosen.expectations,
        again=AnotherRun(campaign, full) if claims is None else None,
        recheck=recheck,
    )
    verdicts: list[Verdict] = []
    not_made: list[NotMade] = []
    with shown(len(chosen.claims), f"verify {campaign.study.name} {campaign.study.case}".strip()) as advance:
        for claim in chosen.claims:
            found = judge.verdict(claim)
            if isinstance(found, Verdict):
                verdicts.append(found)
            else:
                not_made.append(found)
            advance(1)
    _name_idle(campaign.study, chosen)
    failed: list[str] = []
    nothing: tuple[Mapping[str, Figure], Sequence[Table], Scored, Survivals] = ({}, [], {}, {})
    figures = _made("figures", chosen.figures, nothing[0], failed)
    tables = _made("tables", chosen.tables, nothing[1], failed)
    scores = _made("scores", chosen.scores, nothing[2], failed)
    digits = _made("digits", chosen.digits, nothing[3], failed)
    said: Sequence[str] = []
    conclusion = _made("conclusion", lambda: chosen.conclude(verdicts), said, failed)
    report = Report(
        campaign=campaign,
        verdicts=verdicts,
        not_made=not_made,
        conclusion=[],
        figures=figures,
        tables=tables,
        scores=scores,
        digits=digits,
        certificates=recheck,
    )
    fell = [f"{controller} did not come to its end: {reason}." for controller, reason in report.stopped]
    return dataclasses.replace(report, conclusion=[*fell, *conclusion, *failed])


def _name_idle(study: Study, examined: Examination) -> None:
    """Warn of what a study expects of claims that it does not make: a slip of a name would pass in silence."""
    case = study.case or DEFAULT
    made = {(one.name.split(".", 1)[-1], one.controller) for one in examined.claims}
    for claim, said in study.expected.items():
        for one in said:
            about = [controller for name, controller in made if name == claim]
            if (not one.cases or case in one.cases) and not any(one.speaks_of(law, case) for law in about):
                whom = f" about {', '.join(one.controllers)}" if one.controllers else ""
                near = get_close_matches(claim, [name for name, _ in made if name != claim], n=1) if not about else []
                hint = f"; did you mean {near[0]}?" if near else ""
                log.warning("the study expects something of %r, but no such claim%s is made%s", claim, whom, hint)


def verify_cases(
    study: Study,
    draft: Path,
    *,
    only: str | None = None,
    full: bool = False,
    show_progress: bool = True,
    gate: Gate | None = None,
) -> Report:
    """Run and check a study in every case, or in one, and write each into a folder as it comes; return one report.

    The default case, or the one that is asked for, lies at the top of ``draft``; every other in ``cases/NAME``, with
    files of the same names. Verdicts and report, which speak of all cases, are at the top alone. ``gate`` says what the
    verdicts are held against.
    """
    first = in_case(study, only or "")
    done = run(first, show_progress=show_progress)
    done.record(draft)
    recheck = Recheck()
    found = verify(done, full=full, show_progress=show_progress, recheck=recheck)
    others: dict[str, Report] = {}
    for name in () if only is not None or study.case else study.cases:  # a study in a case is that case alone
        campaign = run(in_case(study, name), show_progress=show_progress)
        folder = draft / CASES / name
        folder.mkdir(parents=True)
        campaign.record(folder)
        others[name] = verify(campaign, full=full, show_progress=show_progress, recheck=recheck)
    whole = dataclasses.replace(found, cases=others, gate=gate or Gate())
    write_into(whole, draft, show_progress=show_progress)
    return whole


def _made(what: str, make: Callable[[], T], nothing: T, failed: list[str]) -> T:
    """Return what is made, or nothing with a sentence: verdicts are not lost to what goes round them."""
    try:
        return make()
    except InvalidValue as error:
        failed.append(f"The {what} of this report could not be made: {error}")
    except Exception as error:
        log.warning("the %s of a report could not be made", what, exc_info=error)
        met = f"the program met {type(error).__name__}, see its log"
        failed.append(f"The {what} of this report could not be made: {met}.")
    return nothing
