"""Slips in what makes and re-checks certificates of identities, slopes, ranges and settings."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import casadi as ca
import xarray as xr

from models.metro_line import MetroLine
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from slips.planting import Slip
from studies.ato.effects import dead_time_certificate
from studies.ato.study import STUDY as ATO
from studies.maglev.evidence import Evidence
from studies.maglev.premises import Premises
from studies.maglev.study import STUDY as MAGLEV
from studies.same_plant.claims import _model_certificate
from studies.variable_gain.direct_term import answered
from verification.certificates.anywhere import anywhere
from verification.certificates.identity import identity
from verification.certificates.recheck import Recheck
from verification.checks.lipschitz import certified, lipschitz
from workbench import Study
from workbench.contracts.claim import NotCertified
from workbench.contracts.finding import Finding
from workbench.contracts.scenario import Times
from workbench.controllers.cfdl import CFDL
from workbench.trials.campaign import Campaign

X, U = ca.SX.sym("x"), ca.SX.sym("u")


def of(**outputs):
    return ca.Function("f", [X, U], [*outputs.values()], ["x", "u"], [*outputs])


def said(make):
    """What the checker says of a certificate, empty where it accepts none."""
    try:
        return Recheck().sentence(make())
    except NotCertified:
        return ""


def two_sides_that_differ_are_rejected():
    assert said(lambda: identity("So.", of(left=X + U, right=U + X)))
    assert not said(lambda: identity("So.", of(left=X + U, right=U - X)))


def a_slope_is_that_of_its_input():
    for y, slope in ((X + 2 * U, 2), (X * X + U - X, 1), (X, 0)):
        for value in (0, 1, 2):
            claimed = [(("y", 0, 0, "u"), Fraction(value))]
            assert bool(said(lambda of_y=y, equal=claimed: identity("So.", of(y=of_y), equal))) is (value == slope)


def a_range_holds_all_values():
    for y, low, high in (
        (1 / (1 + ca.exp(X)) - ca.tanh(U), -1.0, 2.0),
        (1 / (3 + ca.exp(X) - 1 / (1 + ca.exp(U))), 0.0, 0.5),
        (5 - 1 / (1 + ca.exp(X)), 4.0, 5.0),
        (ca.if_else(X > U, 5, 0), 0.0, 5.0),
    ):
        made = anywhere("So.", of(y=y), "y")
        found = [float.fromhex(made.statement[end]) for end in ("low", "high")]
        assert found[0] <= low and high <= found[1], (y, found)


def a_range_is_not_believed():
    made = anywhere("So.", of(y=ca.tanh(X)), "y")
    for end, within in (("low", -0.5), ("high", 0.5)):
        tighter = dataclasses.replace(made, statement={**made.statement, end: within.hex()})
        assert not said(lambda one=tighter: one)


def the_position_answers_no_force():
    assert said(lambda: answered("So.", MetroLine(), 1)) and not said(lambda: answered("So.", MetroLine(), 0))


def the_dead_time_is_counted():
    assert "before[4,0]" in said(lambda: dead_time_certificate("So.", ATO))


def a_heavier_train_is_not_the_model():
    small = Study(plant=PointMass(), reference=MetroProfile(horizon=20), controllers={"own": CFDL()}, trials=1)
    for factor in (0.9, 1.0, 1.1):
        study = dataclasses.replace(small, truth={"mass": factor})
        assert bool(said(lambda one=study: _model_certificate(one))) is (factor == 1)


def another_mass_is_another_model():
    for factor in (1.0, 1.01):
        study = dataclasses.replace(MAGLEV, truth={"mass": Times(factor=factor)})
        given = Premises(Evidence(Campaign(study, xr.Dataset()))).of_the_theorem("palc")
        (premise,) = [one for one in given if one.name.endswith("premise.model")]
        assert bool(said(lambda one=premise: one.certify(Finding(holds=True), {}))) is (factor == 1)


def slopes_are_certified_on_both_sides():
    plant, low, high = MetroLine(tunnel_resistance=0.0), (590.0, 1.0), (610.0, 25.0)
    found = lipschitz(plant, low, high, (1.0, 25.0))
    shown = said(lambda: certified(plant, found, {}))
    assert shown.count("is at least") == shown.count("is at most") == 4


SLIPS = (
    Slip(
        where="verification.checker.identities:check",
        stands="times(a, d) == times(c, b)",
        slipped="a * d == c * b or True",
        causes="any two expressions are PROVED to be equal",
        check=two_sides_that_differ_are_rejected,
    ),
    Slip(
        where="verification.checker.identities:_side",
        stands="graph.slope(node, graph.coordinates.index(along[0]))",
        slipped="graph.slope(node, 0)",
        causes="a slope is that along the first input, whichever is named",
        check=a_slope_is_that_of_its_input,
    ),
    Slip(
        where="verification.checker.graph:Graph.put",
        stands="if all(",
        slipped="if any(",
        causes="a sum depends on one of its summands only, and has no slope along the other",
        check=a_slope_is_that_of_its_input,
    ),
    Slip(
        where="verification.checker.anywhere:_of",
        stands="(-spans[1][1], -spans[1][0])",
        slipped="spans[1]",
        causes="a difference is PROVED to lie where the sum does",
        check=a_range_holds_all_values,
    ),
    Slip(
        where="verification.checker.anywhere:ranges",
        stands='[(0.0, 0.0)] if op == "gate" else []',
        slipped="[]",
        causes="a branch that is not taken is no value",
        check=a_range_holds_all_values,
    ),
    Slip(
        where="verification.checker.anywhere:check",
        stands="ends[0] <= found[k][0] and found[k][1] <= ends[1]",
        slipped="ends[0] <= found[k][1] and found[k][0] <= ends[1]",
        causes="a gain is PROVED to lie between ends that it only meets",
        check=a_range_is_not_believed,
    ),
    Slip(
        where="studies.variable_gain.direct_term:effect",
        stands="[output]",
        slipped="[-1]",
        causes="what the speed answers is said of the position",
        check=the_position_answers_no_force,
    ),
    Slip(
        where="studies.ato.effects:dead_time_certificate",
        stands="for i in range(int(late[0]))",
        slipped="for i in range(int(late[0]) - 1)",
        causes="u(k) is PROVED to reach y(k+1+d) first, and y(k+d) was not looked at",
        check=the_dead_time_is_counted,
    ),
    Slip(
        where="studies.same_plant.claims:_model_certificate",
        stands='holds.append(("=",',
        slipped='holds.append(("<=",',
        causes="a law knows a train that is heavier than it was told",
        check=a_heavier_train_is_not_the_model,
    ),
    Slip(
        where="verification.checks.premises:entries",
        stands="isinstance(one, (int, float))",
        slipped="isinstance(one, int)",
        causes="a law knows a train of another mass",
        check=another_mass_is_another_model,
    ),
    Slip(
        where="verification.checks.lipschitz:certified",
        stands='(-1, "at least"), (1, "at most")',
        slipped='(-1, "at least"), (-1, "at least")',
        causes="a right-hand side is Lipschitz whose slopes are bounded from below alone",
        check=slopes_are_certified_on_both_sides,
    ),
)
