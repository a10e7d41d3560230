"""The maglev study's claims: periodicity, the Lyapunov argument, contraction behind lag, windup, printed values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import cast

import casadi as ca
import numpy as np
from matplotlib.figure import Figure as Drawn

from models.array import Array
from models.expression import as_expression
from studies.maglev import lyapunov, period_contraction
from studies.maglev.evidence import Evidence, Shuttling, within_the_period
from studies.maglev.figures import error_by_period, figures
from studies.maglev.published import PUBLISHED_GAIN, PUBLISHED_STEP, tables
from studies.maglev.reversal import turns
from studies.maglev.study import LAGGING, NOISY
from workbench.contracts.examination import Examination, Figure
from workbench.contracts.verdict import Claim, Finding, Standing, Verdict, undecided
from workbench.controllers.parts.shuttle_force import errors
from workbench.trials.campaign import Campaign

PAPER = "Zhang, Nan, Cao et al., PALC of a maglev train"
SLACK = 0.01
"""Growth a period that ``period_contraction`` lets pass: holding the force over a sample costs some 0.1 %."""


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims on a campaign of the maglev study, with tables, figures and conclusion."""
    evidence = Evidence(campaign)
    claims = [
        Claim(
            name="maglev.periodicity",
            statement="The line resistance is periodic along the run: |d(t + P) - d(t)| falls below 1 % of max |d|.",
            source=f"{PAPER}, assumption 1 and property 1",
            check=partial(periodicity, evidence, name),
            controller=name,
        )
        for name in evidence.study.controllers
    ]
    for name in evidence.learners:
        claims += _of_learner(evidence, name)
    claims += [
        Claim(
            name="maglev.gain_as_published",
            statement="With k = 2e12 and a step of 1e-5 s the sampled learning loop is stable.",
            source=f"{PAPER}, parameters of the simulation",
            check=partial(gain_as_published, evidence),
        ),
        Claim(
            name="maglev.reversal",
            statement="The line resistance is f_res(x) sgn(v) with f_res a function of position alone.",
            source=f"{PAPER}, (7)",
            check=partial(turns, evidence.train, evidence.run.distance, evidence.run.speed),
        ),
        Claim(
            name="maglev.noise_claim",
            statement="Noise on the force (1e6 N^2/Hz) does not raise PALC's largest error of the last period.",
            source=f"{PAPER}, noise simulation: 0.01 m with noise, 0.03 m without",
            check=partial(noise_claim, evidence),
        ),
    ]
    return Examination(
        claims=claims,
        conclude=conclude,
        figures=partial(_figures, evidence),
        tables=partial(tables, evidence),
    )


def _of_learner(evidence: Evidence, name: str) -> list[Claim]:
    law = evidence.learner(name)
    claims = [
        Claim(
            name="maglev.positivity",
            statement="alpha, lambda and k are positive.",
            source=f"{PAPER}, (10), (12), (13)",
            check=partial(positivity, evidence, name),
            controller=name,
        ),
        Claim(
            name="maglev.period_contraction",
            statement=f"No harmonic of S grows by more than {100 * SLACK:g} % from one period to the next, predicted "
            "and observed, with the study's actuator.",
            source=f"ours, after {PAPER}, (13)",
            check=partial(contraction, evidence, name, ""),
            controller=name,
        ),
        Claim(
            name="maglev.period_contraction_lagging",
            statement="The same behind an actuator with a lag of 0.4 s and a dead time of 0.6 s.",
            source="ours: what the paper leaves out",
            check=partial(contraction, evidence, name, LAGGING),
            controller=name,
        ),
        Claim(
            name="maglev.saturation_windup",
            statement="With the force limited to 90 % of what the line needs, the learned resistance stays bounded.",
            source="ours: what the paper leaves out",
            check=partial(saturation_windup, evidence, name),
            controller=name,
        ),
    ]
    if not within_the_period(evidence.study.controllers[name]):
        return claims
    return [
        *claims,
        Claim(
            name="maglev.lyapunov_identity",
            statement="dV/dt = -(alpha + k/(2M)) S^2, exactly, for a periodic line resistance.",
            source=f"ours, in place of {PAPER}, (23)",
            check=partial(lyapunov.identity, float(law.alpha), float(law.gamma)),
            controller=name,
        ),
        Claim(
            name="maglev.lyapunov_printed",
            statement="dV/dt = -alpha S^2, as the text's cancellation has it.",
            source=f"{PAPER}, (22)-(23) read as an equality",
            check=partial(lyapunov.identity, float(law.alpha), float(law.gamma), 0.0),
            controller=name,
        ),
        Claim(
            name="maglev.lyapunov_decrease",
            statement="V falls from every period to the next (the inequality).",
            source=f"{PAPER}, (14), (23)",
            check=partial(lyapunov_decrease, evidence, name),
            controller=name,
        ),
    ]


def sliding(campaign: Campaign, name: str) -> Array:
    """Return S of every whole period that a controller ran, shape (periods, N + 1), m/s."""
    data = campaign.data.sel(controller=name)
    lam = cast(Shuttling, campaign.study.controllers[name]).lam
    r = as_expression(ca.DM(data["reference"].values))
    rows = []
    for y in data["output"].values:
        if np.isfinite(y).all():
            s = errors(r, as_expression(ca.DM(y)), as_expression(ca.DM(lam))).s
            rows.append(ca.DM(s).full()[0])
    return np.array(rows)


def periodicity(evidence: Evidence, name: str) -> Finding:
    """Compare the true line resistance of every period with the one before."""
    d = evidence.campaign.data["line_resistance"].sel(controller=name).values
    d = d[np.isfinite(d).all(axis=1)]
    if d.shape[0] < 2:
        return undecided("fewer than two whole periods were run")
    changes = np.abs(np.diff(d, axis=0)).max(axis=1)
    limit = 0.01 * float(np.abs(d).max())
    ends = bool(changes[-1] <= limit) and d.shape[0] == evidence.study.trials
    at = int(np.argmax(np.abs(d[-1] - d[-2])))
    return Finding(
        standing=Standing.SUPPORTED if ends else Standing.REFUTED,
        method="largest |d(t + P) - d(t)| along the run, by period; a whole position is never repeated exactly",
        margin=limit - float(changes[-1]),
        unit="N",
        witness={"first": changes[0], "last": changes[-1], "limit": limit, "periods": d.shape[0], "at_sample": at},
    )


def lyapunov_decrease(evidence: Evidence, name: str) -> Finding:
    """Measure V at the end of every period."""
    law = evidence.learner(name)
    data = evidence.campaign.data.sel(controller=name)
    S = sliding(evidence.campaign, name)
    d, d_hat = (data[key].values[: S.shape[0], :-1] for key in ("line_resistance", "law_line_resistance"))
    step, mass = float(evidence.train.sampling_time), float(evidence.train.mass)
    return lyapunov.measured(*lyapunov.decrease(S, d, d_hat, step, law.alpha, law.gamma, mass))


def positivity(evidence: Evidence, name: str) -> Finding:
    """Compare the gains with zero."""
    law = evidence.learner(name)
    gains = {"alpha": law.alpha, "lambda": law.lam, "k": law.gamma * evidence.train.mass}
    least = min(gains, key=lambda gain: gains[gain])
    return Finding(
        standing=Standing.PROVED if gains[least] > 0 else Standing.REFUTED,
        method="comparison of the numbers; sufficient only without lag, dead time and sampling",
        margin=gains[least],
        witness=gains,
    )


def contraction(evidence: Evidence, name: str, case: str) -> Finding:
    """Predict the factor of every harmonic, and compare the largest with its growth in the run."""
    loop, period = evidence.loop(name, case), evidence.run.period
    w, factor = period_contraction.worst(period, loop)
    S = sliding(evidence.variant(case=case), name)[:, :-1]
    grown = period_contraction.observed(S, period, w)
    if not np.isfinite(grown):
        return undecided("fewer than three whole periods were run: no growth to observe")
    larger = max(factor, grown)
    return Finding(
        standing=Standing.SUPPORTED if larger <= 1 + SLACK else Standing.REFUTED,
        method="factor of S from one period to the next at the harmonics up to 5 Hz, from the loop's transfer function "
        "with the force held over a sample; observed: mean growth around the worst one over the last five periods",
        margin=1 + SLACK - larger,
        unit="1",
        witness={"frequency_rad_per_s": w, "predicted": factor, "observed": grown},
    )


def saturation_windup(evidence: Evidence, name: str) -> Finding:
    """Limit the force below what is needed and watch the learned resistance."""
    needed = float(np.nanmax(np.abs(evidence.campaign.data["input"].sel(controller=name).values[0])))
    limit = 0.9 * needed
    campaign = evidence.variant(
        f"actuator.lower={-limit!r}", f"actuator.upper={limit!r}", f"trials={max(25, evidence.study.trials)}"
    )
    sizes = np.abs(campaign.data["law_line_resistance"].sel(controller=name).values[:, :-1]).max(axis=1)
    steps = np.diff(sizes)[-10:]
    scale = float(np.abs(evidence.campaign.data["line_resistance"].sel(controller=name).values).max())
    winds = not np.isfinite(steps).all() or bool((steps > 0).all() and steps.mean() > 0.01 * scale)
    return Finding(
        standing=Standing.REFUTED if winds else Standing.SUPPORTED,
        method=f"{sizes.size} periods with the force limited to {limit:.0f} N either way, 90 % of the largest force of "
        "period 1; it winds up where the largest learned resistance grows in each of the last ten periods, on average "
        "by more than 1 % of max |d|",
        margin=0.01 * scale - float(steps.mean()),
        unit="N a period",
        witness={"force_limit": limit, "largest_learned": sizes[-1], "largest_true": scale, "growth": steps.mean()},
    )


def gain_as_published(evidence: Evidence) -> Finding:
    """Look at the published gain and step with the study's alpha and mass."""
    alpha = evidence.learner(evidence.learners[0]).alpha
    return period_contraction.sampled_gain(alpha, PUBLISHED_GAIN, evidence.train.mass, PUBLISHED_STEP)


def noise_claim(evidence: Evidence) -> Finding:
    """Compare PALC's last period with and without noise on the force."""
    name = evidence.learners[0]
    key = "max_position_error_last"
    silent = () if evidence.force_psd == 0 else ("disturbance.force_psd=0",)
    quiet = evidence.variant(*silent).scores()[name][key]
    noisy = evidence.variant(case=NOISY).scores()[name][key]
    if quiet is None or noisy is None:
        return undecided("a run diverged")
    return Finding(
        standing=Standing.SUPPORTED if noisy <= quiet else Standing.REFUTED,
        method="the study run with and without noise; noise is not periodic, so learning stores it for the next period",
        margin=quiet - noisy,
        unit="m",
        witness={"controller": name, "without_noise": quiet, "with_noise": noisy},
    )


def conclude(verdicts: Sequence[Verdict]) -> Sequence[str]:
    """Return what the verdicts mean, in plain words."""
    standing = {(one.claim.removeprefix("maglev."), one.controller): one.standing for one in verdicts}
    laws = list(dict.fromkeys(one.controller for one in verdicts if one.controller))

    def those(claim: str, wanted: Standing) -> str:
        return " and ".join(law for law in laws if standing.get((claim, law)) is wanted)

    said = []
    holds = those("lyapunov_decrease", Standing.SUPPORTED)
    if holds:
        said.append(
            f"The Lyapunov argument holds for {holds} on this line: V falls in every period, and faster than the "
            "paper's equation says, because the learning within the period adds k/(2M) to alpha."
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
    if standing.get(("gain_as_published", None)) is Standing.REFUTED:
        said.append("The published gain cannot have been used as printed: it needs a step below 1e-7 s.")
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
