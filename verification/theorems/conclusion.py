"""What verdicts on learning laws mean, in the plain words of a report: judging is done elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import SupportsFloat

import numpy as np

from verification.theorems import safe_words
from verification.theorems.dossier import Dossier
from workbench.contracts.examination import Table
from workbench.contracts.finding import Standing
from workbench.contracts.number import after_number
from workbench.contracts.verdict import Verdict

BROKEN = {
    "A2.printed": "A2.printed (one bound for all ratios)",
    "A4.printed": "A4.printed (all ratios positive)",
    "lemma1": "lemma1 (a bounded PPD)",
}
IDLE = 0.01  # median excitation share below which the estimate is said not to learn
USELESS = 1e6  # a transient bound above that is called of no use


def paragraphs(files: Sequence[Dossier], verdicts: Sequence[Verdict]) -> Sequence[str]:
    """Return what the verdicts mean, a paragraph a controller and one on the boxes.

    ``files`` are the controllers' dossiers (:class:`verification.theorems.learning.Dossier`).
    """
    mine = safe_words.by_controller(files, verdicts)
    repaired = [
        name
        for name, own in mine.items()
        if _stands(own, "increment_monotone", Standing.PROVED) or _stands(own, "increment_weighted", Standing.PROVED)
    ]
    said = _shared(mine)
    said += [" ".join(_sentences(d, mine[d.controller], repaired)) for d in files]
    if files:
        said.append(_scope(files, mine))
    return said


def _scope(files: Sequence[Dossier], mine: Mapping[str, Mapping[str, Verdict]]) -> str:
    """Return what proofs speak of, and what they do not."""
    held = [d for d in files if _stands(mine[d.controller], "increment_funnel", Standing.PROVED)]
    read_off = dict.fromkeys(name for d in held for name in safe_words.of_every_trial(mine[d.controller]))
    but = []
    if any(_stands(own, "theorem1.conclusion", Standing.PROVED) for own in mine.values()):
        but.append("theorem1.conclusion alone speaks of all states and inputs")
    if held:
        verb = "speaks" if len(read_off) == 1 else "speak"
        but.append(f"{_listed(list(read_off))} {verb} of every trial of {_listed([d.controller for d in held])}")
    others = [d.controller for d in files if d not in held]
    leaves = [safe_words.beyond_the_box(d) for d in held]
    if others:
        of = f" of {_listed(others)}" if held else ""
        leaves.append(f"that no later trial{of} leaves it is not shown")
    inner = f" ({'; '.join(but)})" if but else ""
    return (
        f"PROVED speaks of the boxes below only{inner}: what each controller's run met, "
        "a little wider. A trial that leaves its box, another plant or measurement noise is not covered there, and "
        f"{'; '.join(leaves)}. SUPPORTED speaks of this run."
    )


def boxes(files: Sequence[Dossier]) -> Sequence[Table]:
    """Return the boxes that proofs are stated for as a table, a row a controller."""
    if not files:
        return []
    plant = files[0].plant
    kinds = (("x", plant.states), ("u", plant.inputs), ("w", plant.disturbances))
    header = ["controller", *(f"{s.name} ({s.unit})" for _, named in kinds for s in named), "sample k"]
    rows = []
    for d in files:
        cells = [
            f"{low:.4g} to {high:.4g}"
            for key in ("x", "u", "w", "k")
            for low, high in zip(d.box[key][0].ravel(), d.box[key][1].ravel(), strict=True)
        ]
        rows.append([d.controller, *cells])
    return [Table(title="The boxes that proofs are stated for", header=header, rows=rows)]


def _stands(own: Mapping[str, Verdict], name: str, standing: Standing) -> bool:
    return name in own and own[name].standing is standing


def _broken(own: Mapping[str, Verdict]) -> tuple[str, ...]:
    return tuple(words for name, words in BROKEN.items() if _stands(own, name, Standing.REFUTED))


def _shared(mine: Mapping[str, Mapping[str, Verdict]]) -> list[str]:
    """Return what is said once of all controllers for which the same assumptions fail, or the same repairs hold."""
    said = []
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, own in mine.items():
        groups.setdefault(_broken(own), []).append(name)
    for broken, names in groups.items():
        if broken:
            said.append(
                f"For {_listed(names)} {_listed(broken)} {'do' if len(broken) > 1 else 'does'} not hold on this plant: "
                "the ratio of output to input differences between trials also carries what earlier inputs of the same "
                "trial did, so it is not the partial derivative. A proof that rests on it does not cover "
                f"{'these controllers' if len(names) > 1 else 'this controller'}, whatever the run looks like."
            )
    holds = [
        name
        for name, own in mine.items()
        if _stands(own, "A4.partial", Standing.PROVED) and _stands(own, "A2.lifted", Standing.PROVED)
    ]
    if holds:
        said.append(
            f"What does hold for {_listed(holds)}: the partial derivative is positive (A4.partial), and a difference "
            "of the output is at most p times the largest input difference so far (A2.lifted, the repaired A2)."
        )
    return said


def _sentences(d: Dossier, own: Mapping[str, Verdict], repaired: Sequence[str]) -> list[str]:
    e, unit, broken = d.evidence, after_number(d.mse_unit.replace("^2", "²")), _broken(own)
    text = [f"{d.controller}: the MSE went from {d.mse[0]:.4g} to {d.mse[-1]:.4g}{unit} in {d.mse.size} trials."]
    ratio = e.relative_ratio()
    ratio = ratio[np.isfinite(ratio)]
    if broken and ratio.size:
        text.append(
            f"Of the realised ratios {100 * float((ratio <= 0).mean()):.3g} % are not positive, and the largest is "
            f"{float(np.abs(ratio).max()):.2g} times the partial derivative."
        )
    if _stands(own, "theorem1", Standing.REFUTED):
        factor = d.adaptation.factor[np.isfinite(d.adaptation.factor)]
        text.append(
            f"The premises of Theorem 1 are not met at {100 * float((np.abs(factor) >= 1).mean()):.3g} % of trials and "
            "samples: its proof does not apply."
        )
    text += _limit(own)
    text += _increment(own) or _lifted(own)
    text += _estimate(d, own)
    if broken and d.law.learns_on != "increment" and e.degree == 1:
        covered = f" ({_listed(repaired)} is covered here)" if repaired else ""
        text.append(
            f"A theorem of another kind speaks of laws that learn on the increment of the output{covered}. It says "
            "nothing of noise, of other masses or of other starts, so try such a law on these before it is used."
        )
    return text


def _limit(own: Mapping[str, Verdict]) -> list[str]:
    if not _stands(own, "theorem1.conclusion", Standing.PROVED):
        return []
    risen = own["theorem1.transient"] if _stands(own, "theorem1.transient", Standing.REFUTED) else None
    way = f"; on the way the MSE rose by {100 * -(risen.margin or 0.0):.3g} % in this run" if risen else ""
    return [
        "What Theorem 1 concludes is true all the same, as a limit and for another reason than its proof's: the error "
        f"of every sample goes to zero as trials go on, which says nothing of how fast{way}."
    ]


def _increment(own: Mapping[str, Verdict]) -> list[str]:
    covered = "A theorem of its own covers this law:"
    if _stands(own, "increment_monotone", Standing.PROVED):
        factor = _number(own["increment_monotone"], "factor_at_phi0", 1.0)
        return [
            f"{covered} while trials stay in the box the largest input error provably never grows from a trial to the "
            f"next, for every phi > 0, and while phi stays at phi(k,1) it shrinks to {100 * factor:.3g} % wherever the "
            "trial reaches: monotone convergence."
        ]
    if _stands(own, "increment_weighted", Standing.PROVED):
        rise = _number(own["increment_weighted"], "transient", 0.0)
        if not 0 < rise <= USELESS:
            return [
                "A theorem of its own says that a weighted input error never grows, but leaves room for so large a "
                "transient that it is of no use here."
            ]
        return [
            f"{covered} while trials stay in the box a weighted input error provably never grows and, while the "
            "estimate stays bounded, shrinks wherever trials reach. The largest input error itself may rise on the "
            "way, because what earlier inputs do to a sample can outweigh what its own input does there, but at most "
            f"{rise:.3g} times, a pessimistic bound."
        ]
    return []


def _number(verdict: Verdict, name: str, otherwise: float) -> float:
    """Return a number of a verdict's witness, or another where it has none of that name."""
    value = (verdict.witness or {}).get(name)
    return float(value) if isinstance(value, SupportsFloat) else otherwise


def _lifted(own: Mapping[str, Verdict]) -> list[str]:
    if not _stands(own, "asymptotic", Standing.SUPPORTED):
        return []
    kept = 100 * (1 - (own["asymptotic"].margin or 0.0))
    peak = (own["monotone"].witness or {}).get("singular_value") if "monotone" in own else None
    rises = _stands(own, "monotone", Standing.REFUTED) and isinstance(peak, SupportsFloat)
    how = f", but one trial may raise it {peak:.3g} times" if rises else ""
    return [
        f"Linearised along the last trial the error vanishes in the end{how}; what falls slowest keeps {kept:.6g} % "
        "from trial to trial. That is no proof for the plant itself."
    ]


def _estimate(d: Dossier, own: Mapping[str, Verdict]) -> list[str]:
    witness = (own["estimator"].witness or {}) if "estimator" in own else {}
    if "excitation_share_median" not in witness:
        return []
    share = _number(own["estimator"], "excitation_share_median", 0.0)
    median = float(np.nanmedian(d.evidence.relative_error()))
    error = f"its median relative error against the partial derivative is {median:.3g}"
    if share < IDLE:
        return [
            f"The estimate hardly learns ({error}): mu is large beside the squared input differences, so that in the "
            f"median the data of a trial could move it by a share of {share:.2g} only, and it stays near phi(k,1)."
        ]
    return [f"The estimate follows the realised ratio rather than the partial derivative: {error}."]


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
