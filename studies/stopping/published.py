"""The published outcomes of Liu, Xun, Gao & Yin (2022) beside what a stopping campaign measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from studies.stopping import outcomes
from studies.stopping.settings import Stopping, own
from workbench.contracts.examination import Table
from workbench.trials.campaign import Campaign

GAINS = ((0.3, 0.1, 0.1), (0.5, 0.05, 0.0), (1.0, 0.3, 0.3))
BETAS = (1.0, 1.5, 3.0)


def published(campaign: Campaign, *, seeds: int) -> list[Table]:
    """Return the table of published outcomes and the table of holds that (27) allows."""
    return [_outcomes(campaign, seeds), _holds(own(campaign.study))]


def _outcomes(campaign: Campaign, seeds: int) -> Table:
    study, settings = campaign.study, own(campaign.study)
    scores = campaign.scores()
    short, long = min(settings.lengths), max(settings.lengths)

    def cm(value: float | None) -> str:
        return "never" if value is None or value != value else f"{value:.3g} cm"

    def by_horizon(kind: str, metric: str, shown: Callable[[float | None], str]) -> str:
        return ", ".join(f"N={N}: {shown(scores[f'{kind}-n{N}'][metric])}" for N in settings.lengths)

    def ratios(metric: str) -> str:
        pairs = ((N, scores[f"rsmpc-n{N}"][metric], scores[f"rmpc-n{N}"][metric]) for N in settings.lengths)
        return ", ".join(f"N={N}: {_ratio(a, b)}" for N, a, b in pairs)

    gains = [outcomes.pid_with(study, *gain).error_cm for gain in GAINS]
    name = f"rmpc-n{short}"
    held = outcomes.share_within(study, name, outcomes.held_brakes(settings, seeds))
    drawn = outcomes.share_within(study, name, (outcomes.random_brake(settings, seed) for seed in range(seeds)))
    loose = outcomes.rsmpc_with(study, long, contained=False)
    spread = {beta: [outcomes.rsmpc_with(study, N, beta=beta) for N in dict.fromkeys((short, long))] for beta in BETAS}
    rows = [
        (
            "PID (ours: with feed-forward) stops 28.98 cm off",
            f"{cm(scores['pid']['stop_error_cm'])} with (0.7, 0.2, 0.2); "
            + "; ".join(f"{gain}: {cm(error)}" for gain, error in zip(GAINS, gains, strict=True)),
            "the paper prints no gains: the number is that of its tuning",
        ),
        (
            "ideal MPC, resistance known, stops 5.95 cm off",
            f"exact model {cm(outcomes.ideal_with(study, 'zoh').error_cm)}, Euler model "
            f"{cm(outcomes.ideal_with(study, 'euler').error_cm)}",
            "an artefact of the paper's Euler model, about T^2/2 times 0.5 m/s^2 over each sample of the dead time",
        ),
        (
            "RMPC's error falls with N, then levels",
            by_horizon("rmpc", "stop_error_cm", cm),
            "it depends on the tube's gain K: in configuration B, one gain for both, it is the same for every N",
        ),
        (
            "RMPC and RSMPC stop within 50 cm for 3 <= N <= 15",
            "RSMPC: " + by_horizon("rsmpc", "stop_error_cm", cm),
            f"on this line; without (27), which refuses the longest holds, N={long}: {cm(loose.error_cm)}",
        ),
        (
            "RSMPC switches far less often",
            "updates over those of RMPC: " + ratios("updates"),
            "holds: it is what RSMPC is for",
        ),
        (
            "longer N: fewer switches, larger error",
            "; ".join(
                f"beta {beta:g}: " + ", ".join(f"{cm(one.error_cm)} and {one.updates} updates" for one in spread[beta])
                for beta in BETAS
            )
            + f" (N = {', '.join(str(N) for N in dict.fromkeys((short, long)))})",
            "holds where beta lets much be given up; at beta = 1 it is the other way round",
        ),
        (
            "RSMPC is more comfortable",
            "largest jerk over that of RMPC: " + ratios("max_jerk"),
            "fails: it corrects rarely and then at once",
        ),
        (
            "RSMPC solves fewer problems",
            "problems solved over those of RMPC: " + ratios("qps_solved"),
            "with holds scanned from the longest down and stopping at the first hit, at this beta",
        ),
        (
            "robustly within 50 cm",
            f"{name}: {100 * held.share:.0f} % of {seeds} resistances held over the run, spread over W, worst "
            f"{cm(held.worst_cm)}; {100 * drawn.share:.0f} % of {seeds} random by position, worst {cm(drawn.worst_cm)}",
            "impossible for laws without an estimate: the tube alone allows metres",
        ),
        (
            "not in the paper: the resistance estimated from the last sample",
            by_horizon("offset-free", "stop_error_cm", cm)
            + "; largest jerk "
            + by_horizon("offset-free", "max_jerk", lambda value: f"{value:.3g} m/s^3"),
            "ours: the cost is taken about the shifted rest, the bounds and their guarantees stay",
        ),
    ]
    return Table(title="Published and measured", header=("published", "measured", "why they differ"), rows=rows)


def _ratio(a: float | None, b: float | None) -> str:
    return f"{a / b:.3g}" if a is not None and b else "-"


def _holds(settings: Stopping) -> Table:
    rows: list[Sequence[str]] = []
    for N in settings.lengths:
        refused = settings.design.held_conflicts(N)
        offered = [str(M) for M in range(1, N) if M not in refused]
        reasons = "; ".join(f"M = {M}: {reason}" for M, reason in refused.items())
        rows.append((f"rsmpc-n{N}", ", ".join(offered), reasons or "none"))
    return Table(title="Holds that (27) allows", header=("law", "M offered", "M refused"), rows=rows)
