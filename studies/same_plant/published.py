"""How the claims on the laws of the common plant are expected to stand in the study as shipped."""

from __future__ import annotations

from workbench.contracts.claim import Expectations, Expected
from workbench.contracts.finding import Standing

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED

EXPECTED: Expectations = {
    "A1": (Expected(standing=REFUTED, why="force and rate are limited: at a limit df/du breaks off"),),
    "A2.printed": (Expected(standing=REFUTED, why="speed remembers earlier forces, so ratios have no bound"),),
    "A2.lifted": (Expected(standing=PROVED, why="speed is an integral of forces over a finite run"),),
    "A3": (Expected(standing=SUPPORTED, why="lengths are drawn from the distribution that is declared"),),
    "A4.printed": (Expected(standing=REFUTED, why="what earlier forces did often outweighs this one"),),
    "A4.partial": (Expected(standing=REFUTED, why="where a limit is reached df/du is zero"),),
    "lemma1": (Expected(standing=REFUTED, why="it needs the bound of A2 as printed"),),
    "estimator": (Expected(standing=SUPPORTED, why="the reset (13) keeps the estimate's sign"),),
    "lambda_min.partial": (Expected(standing=PROVED, why="lambda is far above (rho b)^2/4, b the partial derivative"),),
    "lambda_min.realised": (Expected(standing=REFUTED, why="b the realised ratio is far larger"),),
    "theorem1": (Expected(standing=REFUTED, why="its factors need A2 and A4 as printed"),),
    "theorem1.conclusion": (
        Expected(
            standing=UNDECIDED,
            why="the speed is measured with noise and the force is limited: an induction with these in it would decide",
            published="the error converges to zero (Theorem 1)",
        ),
    ),
    "theorem1.transient": (
        Expected(standing=REFUTED, why="what each sample adds for those after it makes the error rise at first"),
    ),
    "asymptotic": (
        Expected(standing=UNDECIDED, why="the speed is measured with noise: a bound of what noise leaves would decide"),
    ),
    "monotone": (
        Expected(standing=REFUTED, why="errors of one sign add up along the run: some error grows in the 2-norm"),
        Expected(
            standing=UNDECIDED,
            why="the vector that grows is no error that a plan brings about: a map on such errors alone would decide",
            controllers=("variable-gain",),
        ),
    ),
    "peak": (Expected(standing=SUPPORTED, why="along the last trial the plant is nearly linear"),),
    "increment_monotone": (
        Expected(standing=UNDECIDED, why="the law is filtered, and meets noise and limits: a theorem with these in it"),
    ),
    "increment_weighted": (
        Expected(standing=UNDECIDED, why="the law is filtered, and meets noise and limits: a theorem with these in it"),
    ),
    "increment_funnel": (
        Expected(standing=UNDECIDED, why="the law filters its plan as a whole: a theorem with the filter in it"),
    ),
    "increment_limit": (
        Expected(standing=UNDECIDED, why="the law filters its plan as a whole: a theorem with the filter in it"),
    ),
    "learning_curve": (
        Expected(standing=UNDECIDED, why="the law filters its plan as a whole: a theorem with the filter in it"),
    ),
    "unsaturated": (
        Expected(standing=REFUTED, why="laws that know nothing of the limits ask for more than they give"),
        Expected(standing=SUPPORTED, why="its programs know the limits", controllers=("tracking-mpc",)),
    ),
    "stable_loop": (
        Expected(standing=SUPPORTED, why="tuning finds gains below the critical one"),
        Expected(
            standing=REFUTED, why="the network raises the gain beyond the critical one", controllers=("bp-fipid",)
        ),
    ),
    "f_continuous": (
        Expected(standing=REFUTED, why="the mean of maxima jumps where another rule wins"),
        Expected(standing=PROVED, why="sums, products and tanh", controllers=("fipid-smooth",)),
    ),
    "qp_solved": (Expected(standing=SUPPORTED, why="the sweeps suffice for these small programs"),),
    "known_model": (Expected(standing=REFUTED, why="the train that runs is heavier than the model says"),),
    "contraction": (Expected(standing=SUPPORTED, why="the gains were chosen for the believed mass, which is near"),),
    "does_not_diverge": (Expected(standing=SUPPORTED, why="tuned laws run all trials"),),
    "conditioning": (Expected(standing=SUPPORTED, why="30 trials with noise: increment multiplies most, by 1e3"),),
    "error_falls": (Expected(standing=SUPPORTED, why="tuned laws learn"),),
    "estimate_useful": (
        Expected(standing=REFUTED, why="the estimate follows the realised ratio, which noise and memory make large"),
    ),
}
"""By the claim's name; roles are the claims' own."""
