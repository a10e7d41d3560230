"""Slips in certificates of loops and sets, in what makes them and in what checks them."""

from __future__ import annotations

import copy
import dataclasses
from fractions import Fraction

import numpy as np
from brake_tubes import integrator_tube

from slips.planting import Slip
from verification.certificates.loops import contracting, definite
from verification.certificates.sets import Inclusion, Space, Term, multipliers
from verification.checker import matrices
from verification.checker.reading import Rejected
from verification.checks import exact_tube
from workbench.contracts.claim import NotCertified
from workbench.sets import Zonotope

HALF = [[Fraction(1, 2), 0], [0, Fraction(1, 2)]]
BOX = ([[1, 0], [-1, 0], [0, 1], [0, -1]], [1, 1, 1, 1])
ONE = ("^", "M", 0)


def inclusion(map_, reach, times=1):
    """Return the certificate that half a box, and a box more, lies in it; the reach is how large that is."""
    space = Space(
        matrices={"M": HALF}, polytopes={"S": BOX}, disturbances={"W": Zonotope.box([-reach, -reach], [reach, reach])}
    )
    return space.certificate("It does.", [Inclusion("S", (Term(ONE, "M", times, ONE, "W"),), "S", map_)])


def is_shown(make, *given):
    try:
        return bool(make(*given))
    except NotCertified:
        return False


def accepted(statement, proof):
    try:
        return bool(matrices.check_sets(statement, proof))
    except Rejected:
        return False


def a_row_is_not_taken_less_than_0_times():
    made = inclusion("M", 0.25)
    proof = copy.deepcopy(made.proof)
    proof["multipliers"][0][0] = [[1, "-1/2"]]
    assert accepted(made.statement, made.proof) and not accepted(made.statement, proof)


def a_disturbance_pushes_both_ways():
    made = inclusion("M", 0.5)
    wider = copy.deepcopy(made.statement)
    wider["disturbances"]["W"][1][0] = "3/4"
    assert accepted(made.statement, made.proof) and not accepted(wider, made.proof)


def a_sum_has_all_of_its_terms():
    assert is_shown(inclusion, ("*", "M", "M"), 0.5, 2)
    assert not is_shown(inclusion, ("*", "M", "M"), 0.625, 2)


def a_power_is_taken():
    assert is_shown(inclusion, ("^", "M", 2), 0.75)
    assert not is_shown(inclusion, ("^", "M", 1), 0.75)


def what_is_singular_is_not_definite():
    assert not is_shown(definite, "It is.", {"P": [[1, 1], [1, 1]]}, ["P"])


def the_identity_does_not_contract():
    unit = [[1, 0], [0, 1]]
    assert not is_shown(contracting, "It does.", {"M": unit}, "M", Fraction(1), unit)


def what_follows_is_found():
    for angle in np.arange(12) * np.pi / 6 + 0.1:
        by = [([_exact(np.cos(one)), _exact(np.sin(one))], _exact(1.0)) for one in np.arange(7)]
        normal = [_exact(np.cos(angle)), _exact(np.sin(angle))]
        found = multipliers((normal, _exact(2.0)), by)
        assert found is not None and all(share >= 0 for share in found.values())
        assert multipliers((normal, _exact(0.5)), by) is None


def _exact(value):
    return matrices.exact(float(value).hex())


def sums_are_those_of_the_tube():
    tube = integrator_tube()
    space = Space(
        matrices={"A": tube.plant.A.tolist(), "b": tube.plant.b[:, None].tolist(), "K": tube.K[None, :].tolist()},
        polytopes={"X": (tube.bounds.H.tolist(), [0] * len(tube.bounds.h))},
        disturbances={"W": tube.plant.W},
    )
    for M, i in ((0, 3), (2, 5), (3, 2)):
        reach = (tube.R_hold(M, i) if M else tube.F(i)).support(tube.bounds.H)
        rooms = space.rooms(Inclusion("X", exact_tube.held(tube, M, i)))[1]
        assert np.allclose([-int(one.p) / int(one.q) for one in rooms], reach)


def a_delay_that_is_ignored_is_not_sound():
    blind = dataclasses.replace(integrator_tube(), ignore_delay=True)
    assert is_shown(exact_tube.tightening, integrator_tube(), 1, ())
    assert not is_shown(exact_tube.tightening, blind, 1, ())


def an_invariant_set_is_one_under_disturbances():
    first, *_ = exact_tube.invariant(integrator_tube()).certificate.statement["claims"]
    assert (first["inner"], first["outer"]) == ("S", "S") and [one["of"] for one in first["plus"]] == ["W"]


def a_tube_begins_in_the_set_that_holds_it():
    claims = exact_tube.limit_inside(integrator_tube()).certificate.statement["claims"]
    assert any(one["inner"] is None and one["outer"] == "S" for one in claims)


def a_weight_is_off_by_little():
    wrong = dataclasses.replace(integrator_tube())
    wrong.__dict__["P"] = wrong.P * (1 + 1e-6)
    assert is_shown(exact_tube.equality, integrator_tube())
    assert not is_shown(exact_tube.equality, wrong)


def a_raised_weight_falls():
    wrong = dataclasses.replace(integrator_tube())
    wrong.__dict__["P"] = wrong.P * (1 - 1e-6)
    assert is_shown(exact_tube.raised, integrator_tube())
    assert not is_shown(exact_tube.raised, wrong)


SLIPS = (
    Slip(
        where="verification.checker.matrices:_follows",
        stands="share >= 0",
        slipped="share >= -1",
        causes="a set lies in any other",
        check=a_row_is_not_taken_less_than_0_times,
    ),
    Slip(
        where="verification.checker.matrices:_inclusion",
        stands="[a - b for a, b in zip(room",
        slipped="[a + b for a, b in zip(room",
        causes="a set is invariant the more it is disturbed",
        check=a_disturbance_pushes_both_ways,
    ),
    Slip(
        where="verification.checker.matrices:pushed",
        stands="for _ in range(number):",
        slipped="for _ in range(min(number, 1)):",
        causes="a tube is as wide as what one sample adds",
        check=a_sum_has_all_of_its_terms,
    ),
    Slip(
        where="verification.checker.matrices:formula",
        stands="left ** whole(b, 0, 2000)",
        slipped="left ** min(whole(b, 0, 2000) * 2, 2)",
        causes="a loop is taken for its square",
        check=a_power_is_taken,
    ),
    Slip(
        where="verification.checker.matrices:is_positive",
        stands="line[i] > 0",
        slipped="line[i] >= 0",
        causes="what is singular is positive definite, and an integrator contracts",
        check=what_is_singular_is_not_definite,
    ),
    Slip(
        where="verification.certificates.loops:contracting",
        stands='["P", falls]',
        slipped='["P"]',
        causes="every loop is PROVED Schur",
        check=the_identity_does_not_contract,
    ),
    Slip(
        where="verification.certificates.sets:multipliers",
        stands="if share < 0]",
        slipped="if share > 0]",
        causes="no inclusion is shown, and none is PROVED",
        check=what_follows_is_found,
    ),
    Slip(
        where="verification.checks.exact_tube:_moved",
        stands='("^", LOOP, max(i - M, 0))',
        slipped='("^", LOOP, 0)',
        causes="(27) PROVED for another tube",
        check=sums_are_those_of_the_tube,
    ),
    Slip(
        where="verification.checks.exact_tube:_dead_time",
        stands='"A", delay',
        slipped='"A", 0',
        causes="bounds that forget the dead time are PROVED sound",
        check=a_delay_that_is_ignored_is_not_sound,
    ),
    Slip(
        where="verification.checks.exact_tube:invariant",
        stands='"S", (_step(tube),)',
        slipped='"S", ()',
        causes="a set that is invariant undisturbed is PROVED to be robustly so",
        check=an_invariant_set_is_one_under_disturbances,
    ),
    Slip(
        where="verification.checks.exact_tube:limit_inside",
        stands='Inclusion("S"),',
        slipped="",
        causes="a tube is PROVED to lie in a set in which it does not begin",
        check=a_tube_begins_in_the_set_that_holds_it,
    ),
    Slip(
        where="verification.checks.exact_tube:_share",
        stands="10**9",
        slipped="10**3",
        causes="(19) PROVED for a P that misses it",
        check=a_weight_is_off_by_little,
    ),
    Slip(
        where="verification.checks.exact_tube:raised",
        stands='_falls("P_raised"),',
        slipped="",
        causes="(20) PROVED of any P",
        check=a_raised_weight_falls,
    ),
)
