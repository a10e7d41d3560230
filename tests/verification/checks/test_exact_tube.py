"""What is shown of tubes in exact arithmetic: against their own sums and bounds, and where it must not be shown."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from verification.certificates.recheck import Recheck
from verification.certificates.sets import Inclusion, Space
from verification.checks import exact_tube
from workbench.contracts.claim import NotCertified
from workbench.sets import Polytope

SHOWN = {
    "schur": exact_tube.schur,
    "equality": exact_tube.equality,
    "raised": exact_tube.raised,
    "invariant": exact_tube.invariant,
    "limit_inside": exact_tube.limit_inside,
    "horizon27": lambda tube: exact_tube.horizon27(tube, 3),
    "tightening": lambda tube: exact_tube.tightening(tube, 3, (1, 2)),
}


def twisted(tube, **values):
    """A tube with parts replaced after it was checked: what a wrong design would be."""
    wrong = dataclasses.replace(tube)
    wrong.__dict__.update(values)
    return wrong


@pytest.mark.parametrize("name", SHOWN)
def test_a_sound_tube_has_certificates_that_hold_what_is_stored(tube, name):
    margin, certificate = SHOWN[name](tube)
    assert margin > 0 and Recheck().sentence(certificate)
    stored = {"A": tube.plant.A, "b": tube.plant.b[:, None], "K": tube.K[None, :], "Q": tube.Q, "P": tube.P}
    if name != "schur":  # its P is a norm that was found
        written = certificate.statement["matrices"]
        for one in stored.keys() & written.keys():
            assert [[float.fromhex(x) for x in line] for line in written[one]] == stored[one].tolist()
    for one, H in certificate.statement.get("polytopes", {}).items():
        rows = [[float.fromhex(x) for x in line] for line, _ in H]
        assert rows == (tube.Sigma.H if one in ("S", "Sigma", "Sigma drawn in") else tube.bounds.H).tolist()


@pytest.mark.parametrize("slip", [False, True])
@pytest.mark.parametrize(("M", "i"), [(0, 0), (0, 4), (1, 3), (2, 2), (3, 1), (4, 9)])
def test_sums_are_those_of_the_tube(tube, M, i, slip):
    wrong = twisted(tube)
    object.__setattr__(wrong, "index_off_by_one", slip)
    H = tube.bounds.H
    reach = (wrong.R_hold(M, i) if M else wrong.F(i)).support(H)
    space = Space(
        matrices={"A": tube.plant.A.tolist(), "b": tube.plant.b[:, None].tolist(), "K": tube.K[None, :].tolist()},
        polytopes={"X": (H.tolist(), [0] * len(H))},
        disturbances={"W": tube.plant.W},
    )
    rooms = space.rooms(Inclusion("X", exact_tube.held(wrong, M, i)))[1]
    assert [float(Fraction(str(one))) for one in rooms] == pytest.approx((-reach).tolist(), rel=1e-9, abs=1e-12)


def test_a_set_between_is_within_1e_9_of_sigma(tube):
    statement = exact_tube.invariant(tube).certificate.statement
    bounds = {name: [float.fromhex(c) for _, c in rows] for name, rows in statement["polytopes"].items()}
    assert bounds["Sigma"] == tube.Sigma.h.tolist()
    within = (tube.Sigma.h - bounds["S"]) / tube.Sigma.sizes
    assert (within > 0).all() and (within < 1e-9).all()
    assert np.allclose((tube.Sigma.h - bounds["Sigma drawn in"]) / tube.Sigma.sizes, 1e-9, rtol=1e-5)


WRONG = {
    "schur": lambda tube: twisted(tube, K=tube.K * 0),
    "equality": lambda tube: twisted(tube, P=(1 + 1e-6) * tube.P),
    "raised": lambda tube: twisted(tube, P=(1 - 1e-6) * tube.P),
    "invariant": lambda tube: twisted(tube, Sigma=tube.X_z),
    "limit_inside": lambda tube: twisted(tube, Sigma=Polytope(H=tube.Sigma.H, h=0.3 * tube.Sigma.h)),
    "horizon27": lambda tube: twisted(tube, Sigma=Polytope(H=tube.Sigma.H, h=0.3 * tube.Sigma.h)),
    "tightening": lambda tube: dataclasses.replace(tube, ignore_delay=True),
}


@pytest.mark.parametrize("name", sorted(WRONG))
def test_nothing_is_shown_of_a_wrong_tube(brake_a, name):
    with pytest.raises(NotCertified):
        SHOWN[name](WRONG[name](brake_a))


@pytest.mark.parametrize(("off", "holds"), [(0, True), (2.0**-40, True), (2e-9, False), (-2e-9, False), (1e-3, False)])
def test_a_weight_may_be_off_by_1e_9(brake_a, off, holds):
    wrong = twisted(brake_a, P=brake_a.P + off * np.diag(np.diag(brake_a.P)))
    if holds:
        assert exact_tube.equality(wrong).margin > 0
    else:
        with pytest.raises(NotCertified, match="not positive definite"):
            exact_tube.equality(wrong)


def test_a_row_that_is_too_narrow_by_more_than_rounding_is_not_mended(brake_a):
    Sigma = brake_a.Sigma
    last = next(i for i, label in enumerate(Sigma.labels) if "10 steps on" in label)
    for share, holds in ((1e-12, True), (1e-7, False)):
        h = Sigma.h.copy()
        h[last] += share * Sigma.sizes[last]
        wider = twisted(brake_a, Sigma=Polytope(H=Sigma.H, h=h, labels=Sigma.labels, scale=Sigma.sizes))
        if holds:
            assert exact_tube.invariant(wider).margin > 0
        else:
            with pytest.raises(NotCertified):
                exact_tube.invariant(wider)
