"""The metro train in its funnel: what is proved of it, and ten thousand campaigns that stay inside."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from models.array import Array
from models.point_mass import PointMass
from studies.metro.study import STUDY
from verification.checks.envelope import Bounds, Envelope, held_inside
from verification.checks.funnel import Open
from verification.decide.judge import Judge
from verification.enclosure.recursion import Carried
from verification.theorems.dossier import Dossier
from verification.theorems.learning import claims_of
from verification.theorems.limits import limits
from workbench import Verification, run
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.scenario import Between
from workbench.contracts.verdict import Verdict

PROVED = Standing.PROVED
CHANGES = {"mass": Between(low=0.8, high=1.2)}
LEAST = 1900


@cache
def ran(line: str, changes: bool, named: bool = False) -> Dossier:
    """Return the dossier of learning on increments; the mass changes from trip to trip, or is named in the scope."""
    study = dataclasses.replace(
        STUDY,
        plant=PointMass(line=line),
        controllers={"increment": STUDY.controllers["increment"]},
        truth=CHANGES if changes else {},
        verify=Verification(limits={"speed": (None, 72.1)}, scope={"plant.mass": (280e3, 420e3)} if named else {}),
        sweeps=(),
        cases={},
    )
    return Dossier(run(study, show_progress=False), "increment")


def verdict(d: Dossier, name: str) -> Verdict:
    """Return how a claim stands by its name without the study's."""
    (claim,) = [one for one in (*claims_of(d), *limits(d.campaign)) if one.name == f"metro.{name}"]
    found = Judge().verdict(claim)
    assert isinstance(found, Verdict)
    return found


def bounds(
    sets: Carried, share: float = 1.0, of: str = "both", ends: tuple[int, ...] = (0, 1)
) -> tuple[Bounds, Bounds, Bounds]:
    """Return a funnel as bounds, ends of its states or inputs or both drawn in to the middle; rounding is in it."""

    def drawn_in(whole: Array, name: str) -> Array:
        found, middle = whole.copy(), whole.mean(axis=-1)
        for end in ends if share != 1 and of in ("both", name) else ():
            found[..., end] = middle + share * (whole[..., end] - middle)
        return found

    x, u = drawn_in(sets.x, "states"), drawn_in(sets.u, "inputs")
    low, high = (Bounds(x[..., i].T, u[:, i]) for i in (0, 1))
    return low, high, Bounds(np.zeros_like(low.states), np.zeros_like(low.inputs))


@cache
def campaigns(line: str, changes: bool, count: int) -> Envelope:
    return ran(line, changes).funnels.campaigns(count, 8, seed=1)


CASES = [("flat", False), ("flat", True), ("hilly", False), ("hilly", True)]


@pytest.mark.parametrize(
    ("line", "changes"),
    [one if one in (("flat", False), ("hilly", True)) else pytest.param(*one, marks=pytest.mark.slow) for one in CASES],
)
def test_the_funnel_is_proved_with_every_premise(line, changes):
    found = verdict(ran(line, changes), "increment_funnel")
    assert found.standing is PROVED and found.grounds is Grounds.INDUCTION, found.method
    assert len(found.premises) == 6 and all(one.standing is PROVED for one in found.premises)
    assert found.held is not None and found.held.tries >= 3150
    assert changes == ("plant mass" in found.scope)
    if changes:
        held = found.scope["plant mass"]
        assert (held.low, held.high) == pytest.approx((280e3, 420e3))


def test_two_hundred_campaigns_stay_inside_and_reach_its_ends():
    sets = ran("flat", False).funnels.rounded
    assert sets is not None
    found = campaigns("flat", False, 200)
    assert held_inside(found, *bounds(sets)).margin >= 0
    assert held_inside(found, *bounds(sets, 0.9)).margin < 0


def test_the_largest_speed_on_the_flat_line_is_the_references():
    found = verdict(ran("flat", False), "limit.speed")
    assert found.standing is PROVED and found.bound == pytest.approx(72.0, abs=1e-6)
    assert float(ran("flat", False).campaign.data["state_speed"].max()) == pytest.approx(72.0, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("line", "changes"), CASES)
def test_ten_thousand_campaigns_stay_inside(line, changes):
    sets = ran(line, changes).funnels.rounded
    assert sets is not None
    assert held_inside(campaigns(line, changes, 10_000), *bounds(sets)).margin >= 0


@pytest.mark.slow
@pytest.mark.parametrize("ends", [(0, 1), (0,), (1,)])
@pytest.mark.parametrize("of", ["states", "inputs", "both"])
def test_a_funnel_that_is_a_hundredth_too_tight_is_caught_on_the_flat_line(of, ends):
    d = ran("flat", False)
    sets = d.funnels.rounded
    assert sets is not None
    low, high, none = bounds(sets, 0.99, of, ends)
    by_campaigns = held_inside(campaigns("flat", False, 10_000), low, high, none)
    x = np.stack([low.states.T, high.states.T], axis=-1)
    u = np.stack([low.inputs, high.inputs], axis=-1)
    by_record = d.funnels._recorded(sets._replace(x=x, u=u))
    assert by_record.margin < 0, by_record  # the first plan is one end of it, what is learned in the end the other
    far = (of, ends) == ("states", (1,))  # to which campaigns of eight trials do not come
    assert far or by_campaigns.margin < 0, by_campaigns


@pytest.mark.slow
def test_increments_are_monotone_on_the_flat_line():
    assert verdict(ran("flat", False), "increment_monotone").standing is PROVED


@pytest.mark.slow
def test_the_learning_curve_of_the_hilly_line():
    d = ran("hilly", False)
    found, curve = verdict(d, "learning_curve"), d.funnels.curve
    assert found.standing is PROVED and not isinstance(curve, Open)
    assert curve.last == LEAST and curve.common[40] < 50 and curve.common[80] < 0.1
    error = d.campaign.data["error"].values[0]
    assert (np.mean(error[:, 1 : LEAST + 1] ** 2, axis=1) < curve.common).all()
    own = [np.mean(row[1 : int(end) + 1] ** 2) for row, end in zip(error, d.lengths, strict=True)]
    assert (np.array(own) < curve.own).all()
    assert d.funnels.held_curve(Finding(grounds=Grounds.INDUCTION, holds=True)).margin >= 0


@pytest.mark.slow
@pytest.mark.parametrize("line", ["flat", "hilly"])
def test_a_mass_in_an_interval(line):
    """One that is not known and stays the same, too: the scope is wider than the study."""
    found = verdict(ran(line, False, True), "increment_funnel")
    assert found.standing is PROVED and all(one.standing is PROVED for one in found.premises), found.method
    assert verdict(ran(line, False, True), "increment_limit").standing is PROVED
