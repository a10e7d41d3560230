"""Whether the digits of a law's last error are true: how many survive a change of every setting by a part in 1e12."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from workbench.contracts.claim import Claim, Role
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.survival import digits
from workbench.evidence.digits import LARGE, SMALL, Digits

LEAST = 2.7
"""Digits that the last mean square error should keep: with fewer it is not known to two parts in a thousand.

How a program is compiled changes what rounding leaves by a tenth of a digit or so, and what stands nearer to this than
that may stand otherwise elsewhere; the studies as shipped keep further away.
"""


def conditioning(of: Digits, controller: str) -> Claim:
    """Return the claim on the digits of a law's last mean square error."""
    refused = of.campaign.study.refusals().get(controller)
    wrong = "" if refused is None else f"a task that the law is for: {refused}"
    return Claim(
        name=f"{of.campaign.study.name}.conditioning",
        statement=f"The last mean square error keeps at least {LEAST} digits when every setting changes by a part in "
        "1e12.",
        source="ours",
        role=Role.OUTCOME,
        controller=controller,
        check=lambda: well_conditioned(of, controller),
        lacks=wrong or ("" if of.varied else "a setting that is a number and not zero (quantity)"),
        replay=lambda witness: _margin(of, controller, witness),
    )


def well_conditioned(of: Digits, controller: str) -> Finding:
    """Count the digits of the last mean square error that survive the worst of some draws.

    Of several outputs the worst decides; of a law that fell the last trial that has an error.
    """
    trial = of.last_trial(controller)
    if trial is None:
        return undecided("no trial left a mean square error that is a number: a law that runs would decide")
    small, large = of.last(controller, SMALL), of.last(controller, LARGE)
    if not small.moved:
        return undecided(
            "no setting could be changed by a part in 1e12: one that lies inside its range would decide",
            settings_left=list(small.kept),
        )
    single, why = of.in_single(controller)
    left = digits(small.change)
    one_draw = "" if of.campaign.study.draws == 1 else f", the first of {of.campaign.study.draws} campaigns"
    return Finding(
        grounds=Grounds.TRIES,
        tries=of.draws,
        margin=left - LEAST,
        unit="digits",
        weak=True,
        bound=left,
        bound_unit="digits",
        witness={
            "draw": small.draw,
            "settings_changed": small.moved,
            "settings_left": list(small.kept),
            "trial": trial + 1,
            "relative_change": small.change,
            "amplification": small.change / SMALL,
            "digits_at_1e-6": digits(large.change),
            "amplification_at_1e-6": large.change / LARGE,
            "digits_in_single_precision": f"not looked at: {why}" if single is None else digits(single),
        },
        method=f"{small.moved} settings changed by a part in 1e12 each, up or down, in {of.draws} "
        f"{'draw' if of.draws == 1 else 'draws'}{one_draw}: {left:.3g} digits of the mean square error of trial "
        f"{trial + 1} survive the worst, {digits(large.change):.3g} a part in 1e6, "
        + (
            f"single precision was not looked at: {why}" if single is None else f"{digits(single):.3g} single precision"
        ),
    )


def _margin(of: Digits, controller: str, witness: Mapping[str, object]) -> float:
    """Return the margin in the draw of a witness, run again for this law alone."""
    draw, kept = witness["draw"], witness["settings_left"]
    assert isinstance(draw, int) and isinstance(kept, Sequence)
    return digits(of.again(controller, SMALL, draw, tuple(map(str, kept)))) - LEAST
