"""What Jiao & Hou (2025) say of the metro train, and how it is expected to stand in the cases as shipped."""

from __future__ import annotations

from workbench.contracts.claim import Expectations, Expected
from workbench.contracts.finding import Standing

STARTS, TRIPS, LIMITED, LAGGING = "starts-differ", "trips-differ", "limited", "lagging"
PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED

_ONE_PLANT = Expected(
    standing=UNDECIDED,
    why="masses and resistances change from trip to trip: bounds over all of them would decide",
    cases=(TRIPS,),
)
_ALIKE = Expected(
    standing=UNDECIDED,
    why="trials begin in different states, so their ratios are no answers to inputs: a statement with a term for "
    "the starts would decide",
    cases=(STARTS,),
)

_UNMET = Expected(
    standing=UNDECIDED,
    why="no trial of this law comes to the limit, which lies in the scope's margin: a narrower scope would decide",
    controllers=("increment",),
    cases=(LIMITED,),
)

EXPECTED: Expectations = {
    "A1": (
        Expected(standing=PROVED, why="the train's equation is linear in the force"),
        Expected(standing=REFUTED, why="at a limit of the force df/du breaks off to zero", cases=(LIMITED,)),
        _UNMET,
        _ONE_PLANT,
    ),
    "A2.printed": (
        Expected(standing=REFUTED, why="speed remembers earlier forces: the ratio has no bound where du(k) goes to 0"),
        _ALIKE,
        _ONE_PLANT,
    ),
    "A2.lifted": (
        Expected(standing=PROVED, why="the speed is an integral of forces over a finite run: row sums are finite"),
        _ALIKE,
        _ONE_PLANT,
    ),
    "A3": (Expected(standing=SUPPORTED, why="lengths are drawn from the distribution that is declared"),),
    "A4.printed": (
        Expected(standing=REFUTED, why="what earlier forces did often outweighs this one, with the other sign"),
        _ALIKE,
        _ONE_PLANT,
    ),
    "A4.partial": (
        Expected(standing=PROVED, why="df/du is 3.6 Ts/M, a positive number"),
        Expected(standing=REFUTED, why="at a limit of the force df/du is zero", cases=(LIMITED,)),
        _UNMET,
        _ONE_PLANT,
    ),
    "lemma1": (
        Expected(standing=REFUTED, why="it needs the bound of A2 as printed"),
        _ALIKE,
        _ONE_PLANT,
    ),
    "estimator": (Expected(standing=SUPPORTED, why="the reset (13) keeps the estimate's sign"),),
    "lambda_min.partial": (
        Expected(standing=PROVED, why="with the partial derivative as b, lambda is far above (rho b)^2/4"),
        _ONE_PLANT,
    ),
    "lambda_min.realised": (
        Expected(standing=REFUTED, why="with the realised ratio as b, which the proof means, lambda is too small"),
        _ALIKE,
        _ONE_PLANT,
    ),
    "theorem1": (
        Expected(standing=REFUTED, why="its factors need A2 and A4 as printed"),
        _ALIKE,
        _ONE_PLANT,
    ),
    "theorem1.conclusion": (
        Expected(
            standing=PROVED,
            why="the speed's slope by the force is one positive number, far below 2/l_max: an induction over samples",
            published="the error converges to zero (Theorem 1)",
        ),
        Expected(
            standing=UNDECIDED,
            why="the induction is for a plan that acts as it is, from one start, on one plant: one with these in it "
            "would decide",
            cases=(STARTS, LIMITED, LAGGING, TRIPS),
            published="the error converges to zero (Theorem 1)",
        ),
    ),
    "theorem1.transient": (
        Expected(
            standing=REFUTED,
            why="what each sample adds for the samples after it makes the error rise at first",
            published="the MSE falls by trial (Fig. 7)",
        ),
    ),
    "asymptotic": (
        Expected(standing=SUPPORTED, why="the map's diagonal is 1 - l df/du, between 0 and 1"),
        Expected(
            standing=UNDECIDED,
            why="so little is lost a trial that the limit's error is not resolved: many more trials would decide",
            controllers=("pd",),
            cases=(STARTS,),
        ),
        Expected(
            standing=REFUTED,
            why="a force that is cut at its limit is not corrected by any error",
            controllers=("icfdl", "pd"),
            cases=(LIMITED,),
        ),
        Expected(
            standing=REFUTED,
            why="behind a dead time e(k+1) never shows what u(k) does",
            cases=(LAGGING,),
        ),
        _ONE_PLANT,
    ),
    "monotone": (
        Expected(standing=REFUTED, why="errors of one sign add up along the run: some error grows in the 2-norm"),
        _ONE_PLANT,
    ),
    "peak": (
        Expected(standing=SUPPORTED, why="along the last trial the plant is nearly linear"),
        _ONE_PLANT,
    ),
    "increment_monotone": (
        Expected(
            standing=REFUTED,
            why="where grades begin, what earlier forces do through the position outweighs df/du",
        ),
        Expected(
            standing=UNDECIDED,
            why="the theorem is for a plan that acts as it is, from one start: one with these in it would decide",
            cases=(STARTS, LIMITED, LAGGING, TRIPS),
        ),
    ),
    "increment_weighted": (
        Expected(standing=PROVED, why="with weights small enough the diagonal outweighs every row"),
        Expected(
            standing=UNDECIDED,
            why="the theorem is for a plan that acts as it is, from one start: one with these in it would decide",
            cases=(STARTS, LIMITED, LAGGING, TRIPS),
        ),
    ),
    "increment_funnel": (
        Expected(
            standing=PROVED, why="an input goes towards what the state that is there needs, by less than all of it"
        ),
        Expected(
            standing=UNDECIDED,
            why="behind a dead time what an input does is seen later: a law for that relative degree would decide",
            cases=(LAGGING,),
        ),
    ),
    "increment_limit": (
        Expected(standing=PROVED, why="each sample's input goes to its target once the samples before it have"),
        Expected(
            standing=UNDECIDED,
            why="the induction is for a plan that acts as it is, from one start, on one plant: one with these in it "
            "would decide",
            cases=(STARTS, LIMITED, LAGGING, TRIPS),
        ),
    ),
    "learning_curve": (
        Expected(standing=PROVED, why="in each trial every input goes to its target by a least share"),
        Expected(
            standing=UNDECIDED, why="there is no funnel behind a dead time: a law for it would decide", cases=(LAGGING,)
        ),
    ),
    "does_not_diverge": (Expected(standing=SUPPORTED, why="all three laws run all trials"),),
    "conditioning": (
        Expected(
            standing=SUPPORTED,
            why="icfdl multiplies what is off by up to 1e9 in its 150 trials, which leaves it three digits of twelve, "
            "half a digit more than is asked for; pd by five, and increment by 1e6 at most, where its error is down to "
            "rounding",
        ),
    ),
    "error_falls": (
        Expected(standing=SUPPORTED, why="all three laws learn", published="the error falls by trial (Fig. 7)"),
    ),
    "estimate_useful": (
        Expected(
            standing=REFUTED,
            why="with the published mu the data hardly move the estimate, or move it to the realised ratio",
        ),
        Expected(
            standing=SUPPORTED,
            why="differences of starts, or of what lags, excite the estimate where inputs alone do not",
            controllers=("increment",),
            cases=(STARTS, LAGGING),
        ),
    ),
}
"""By the claim's name; roles are the claims' own."""
