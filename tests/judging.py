"""How the claims of one controller stand, over its own scope or over one that a test gives."""

from __future__ import annotations

from verification.decide.judge import Judge
from verification.enclosure.box import Box
from verification.theorems.dossier import Dossier
from verification.theorems.learning import claims_of
from workbench.contracts.verdict import NotMade, Verdict


def over(d: Dossier, box: Box) -> Dossier:
    """Return a dossier of the same controller whose proofs are stated for another box."""
    other = Dossier(d.campaign, d.controller)
    vars(other)["box"] = box
    return other


def verdict(d: Dossier, name: str) -> Verdict | NotMade:
    """Return how the claim of a name (without its study's) stands."""
    (claim,) = [one for one in claims_of(d) if one.name.split(".", 1)[1] == name]
    return Judge().verdict(claim)


def judged(d: Dossier, name: str) -> Verdict:
    """Return the verdict of a claim that has a meaning."""
    found = verdict(d, name)
    assert isinstance(found, Verdict), found
    return found


def standings(d: Dossier) -> dict[str, Verdict]:
    """Return the verdicts on a controller by the claim's name without its study's; claims not made are left out."""
    judge = Judge()
    found = [judge.verdict(one) for one in claims_of(d)]
    return {one.claim.split(".", 1)[1]: one for one in found if isinstance(one, Verdict)}
