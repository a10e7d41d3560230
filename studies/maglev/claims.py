"""The maglev study's claims: periodicity, the Lyapunov argument, contraction behind lag, windup, printed values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial

from matplotlib.figure import Figure as Drawn

from studies.maglev import lyapunov
from studies.maglev.equations import decrease, error_dynamics
from studies.maglev.evidence import Evidence, within_the_period
from studies.maglev.figures import error_by_period, figures
from studies.maglev.outcomes import (
    POSITIVE,
    SAMPLED,
    SLACK,
    contraction,
    fall_of_V,
    gain_as_published,
    noise_claim,
    periodicity,
    positive,
    positivity,
    replayed_gain,
    saturation_windup,
)
from studies.maglev.premises import PAPER, Premises
from studies.maglev.published import EXPECTED, tables
from studies.maglev.reversal import turned, turns
from studies.maglev.study import LAGGING, NOISY
from workbench.contracts.claim import Claim, Role
from workbench.contracts.examination import Examination, Figure
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import Verdict
from workbench.trials.campaign import Campaign

DYNAMICS = "de_v/dt = -(alpha + lambda + k/M) e_v - lambda (alpha + k/M) e_x + (d_hat(t - P) - d)/M."


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims on a campaign of the maglev study, with tables, figures and conclusion."""
    evidence = Evidence(campaign)
    periodic = {
        name: Claim(
            name="maglev.periodicity",
            statement="The line resistance is periodic along the run: in the end |d(t + P) - d(t)| is at most 1 % of "
            "max |d|.",
            source=f"{PAPER}, assumption 1 and property 1",
            check=partial(periodicity, evidence, name),
            controller=name,
            role=Role.PRINTED,
        )
        for name in evidence.study.controllers
    }
    claims = [*periodic.values()]
    given = Premises(evidence)
    for name in evidence.learners:
        claims += _of_learner(evidence, name, given, periodic[name])
    unlearned = "" if evidence.learners else "a law that learns the line resistance"
    claims += [
        Claim(
            name="maglev.gain_as_published",
            statement="With k = 2e12 and a step of 1e-5 s the sampled learning loop is stable.",
            source=f"{PAPER}, parameters of the simulation",
            check=partial(gain_as_published, evidence),
            role=Role.PRINTED,
            lacks=unlearned,
            replay=replayed_gain,
        ),
        Claim(
            name="maglev.reversal",
            statement="The line resistance is f_res(x) sgn(v) with f_res a function of position alone.",
            source=f"{PAPER}, (7)",
            check=lambda: turns(evidence.train, evidence.run.distance, evidence.run.speed),
            role=Role.PRINTED,
            replay=partial(turned, evidence.train),
        ),
        Claim(
            name="maglev.noise_claim",
            statement="Noise on the force (1e6 N^2/Hz) does not raise PALC's largest error of the last period.",
            source=f"{PAPER}, noise simulation: 0.01 m with noise, 0.03 m without",
            check=partial(noise_claim, evidence),
            role=Role.OUTCOME,
            lacks=unlearned,
        ),
    ]
    return Examination(
        claims=claims,
        conclude=conclude,
        figures=partial(_figures, evidence),
        tables=partial(tables, evidence),
        expectations=EXPECTED,
    )


def _of_learner(evidence: Evidence, name: str, given: Premises, periodic: Claim) -> list[Claim]:
    law = evidence.study.controllers[name]
    claims = [
        Claim(
            name="maglev.positivity",
            statement=POSITIVE,
            source=f"{PAPER}, (10), (12), (13)",
            check=partial(positivity, evidence, name),
            controller=name,
            role=Role.PRINTED,
            certify=lambda found, premises: positive(evidence, name),
        ),
        Claim(
            name="maglev.period_contraction",
            statement=f"No harmonic of S grows by more than {100 * SLACK:g} % from one period to the next, predicted "
            "and observed, with the study's actuator.",
            source=f"ours, after {PAPER}, (13)",
            check=partial(contraction, evidence, name, ""),
            controller=name,
            role=Role.OUTCOME,
            premises=given.of_the_recursion(name),
        ),
        Claim(
            name="maglev.period_contraction_lagging",
            statement="The same behind an actuator with a lag of 0.4 s and a dead time of 0.6 s.",
            source="ours: what the paper leaves out",
            check=partial(contraction, evidence, name, LAGGING),
            controller=name,
            role=Role.OUTCOME,
            premises=given.of_the_recursion(name),
        ),
        Claim(
            name="maglev.saturation_windup",
            statement="With the force limited to 90 % of what the line needs, the learned resistance stays bounded: "
            "over the last ten periods its largest value grows by less than 1 % of the limit a period.",
            source="ours: what the paper leaves out",
            check=partial(saturation_windup, evidence, name),
            controller=name,
            role=Role.OUTCOME,
        ),
    ]
    lacks = "" if within_the_period(law) else "learning with the S of the same instant"
    algebra = [] if lacks else given.of_the_theorem(name)
    ready = cache(partial(evidence.study.law, name))
    dynamics = Claim(
        name="maglev.error_dynamics",
        statement=DYNAMICS,
        source=f"{PAPER}, (6), (8)-(13)",
        check=lambda: error_dynamics(ready(), evidence.train).finding(),
        controller=name,
        role=Role.PRINTED,
        lacks=lacks,
        premises=algebra,
        replay=lambda witness: error_dynamics(ready(), evidence.train).replay(witness),
        attack=lambda _: error_dynamics(ready(), evidence.train).held(),
        certify=lambda found, premises: error_dynamics(ready(), evidence.train).certificate(DYNAMICS),
    )
    sampled = Claim(
        name="maglev.lyapunov_sampled",
        statement=f"Under a force held over a sample V changes from period to period as for one that follows the "
        f"errors at every instant, within {100 * SAMPLED:g} %.",
        source="ours: what the proof leaves out",
        check=lambda: lyapunov.follows(fall_of_V(evidence, name), SAMPLED),
        controller=name,
        role=Role.OUTCOME,
        lacks=lacks,
    )

    def identity(name_: str, statement: str, source: str, role: Role, share: float, *further: Claim) -> Claim:
        return Claim(
            name=f"maglev.{name_}",
            statement=statement,
            source=source,
            check=lambda: decrease(ready(), evidence.train, share).finding(),
            controller=name,
            role=role,
            lacks=lacks,
            premises=[*algebra, *further],
            replay=lambda witness: decrease(ready(), evidence.train, share).replay(witness),
            attack=lambda _: decrease(ready(), evidence.train, share).held(),
        )

    return [
        *claims,
        dynamics,
        sampled,
        identity(
            "lyapunov_identity",
            "dV/dt = -(alpha + k/(2M)) S^2, exactly, for a periodic line resistance.",
            f"ours, in place of {PAPER}, (23)",
            Role.REPAIRED,
            0.5,
            periodic,
            sampled,
        ),
        identity(
            "lyapunov_printed",
            "dV/dt = -alpha S^2, as the text's cancellation has it.",
            f"{PAPER}, (22)-(23) read as an equality",
            Role.PRINTED,
            0.0,
        ),
        Claim(
            name="maglev.lyapunov_decrease",
            statement="V falls from every period to the next (the inequality).",
            source=f"{PAPER}, (14), (23)",
            check=lambda: lyapunov.falls(fall_of_V(evidence, name)),
            controller=name,
            role=Role.PRINTED,
            lacks=lacks,
        ),
    ]


def conclude(verdicts: Sequence[Verdict]) -> Sequence[str]:
    """Return what the verdicts mean, in plain words."""
    standing = {(one.claim.removeprefix("maglev."), one.controller): one.standing for one in verdicts}
    stable = [one.bound for one in verdicts if one.claim.endswith("gain_as_published") and one.bound is not None]
    laws = list(dict.fromkeys(one.controller for one in verdicts if one.controller))

    def those(claim: str, wanted: Standing) -> str:
        return " and ".join(law for law in laws if standing.get((claim, law)) is wanted)

    said = []
    falling = those("lyapunov_decrease", Standing.SUPPORTED)
    if falling:
        said.append(f"V falls in every period for {falling}.")
    argued = those("lyapunov_identity", Standing.SUPPORTED)
    if argued:
        said.append(
            f"It falls faster than the paper's equation says for {argued}, because the learning within the period "
            "adds k/(2M) to alpha."
        )
    lagging, safe = (those("period_contraction_lagging", wanted) for wanted in (Standing.REFUTED, Standing.SUPPORTED))
    if lagging:
        said.append(
            f"Behind a lag of 0.4 s and a dead time of 0.6 s {lagging} diverges: some harmonics grow from period to "
            "period, at the rate that the loop's transfer function predicts. The first periods, "
            "which improve, do not show it."
            + (f" With a low-pass filter and a lead, {safe} keeps converging." if safe else "")
        )
    winding = those("saturation_windup", Standing.REFUTED)
    if winding:
        said.append(
            f"Where the force is limited below what the line needs, {winding} goes on learning without bound: freeze "
            "the learning while the force is saturated."
        )
    if stable and standing.get(("gain_as_published", None)) is Standing.REFUTED:
        said.append(f"The published gain cannot have been used as printed: it needs a step below {stable[0]:.1g} s.")
    if standing.get(("reversal", None)) is Standing.REFUTED:
        said.append("On grades the resistance does not turn with the direction of travel, as f_res(x) sgn(v) would.")
    return said


def _figures(evidence: Evidence) -> Mapping[str, Figure]:
    def noisy(name: str) -> Drawn:
        campaign = evidence.variant(case=NOISY)
        return figures(campaign.study, campaign.data)[name]()

    return {
        "error_by_period_lagging": Figure(
            caption="Largest position error by period behind a lag of 0.4 s and a dead time of 0.6 s.",
            draw=lambda: error_by_period(evidence.variant(case=LAGGING).data),
        ),
        **{
            f"{name}_noise": Figure(caption=f"{caption} under noise of 1e6 N²/Hz.", draw=partial(noisy, name))
            for name, caption in (
                ("position_error", "Position error of the last period"),
                ("speed_error", "Speed error of the last period"),
                ("force", "Force of the last period"),
                ("line_resistance", "Learned and true line resistance of the last period"),
            )
        },
    }
