"""Certificates of loops against eigenvalues, and what is just not positive definite."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from verification.certificates.loops import contracting, definite
from verification.certificates.recheck import Recheck
from verification.checker.matrices import check_definite
from verification.checker.reading import Rejected
from verification.enclosure.exact_schur import contraction
from workbench.contracts.claim import NotCertified

TINY = Fraction(1, 10**30)
ONE = Fraction(1)
I2 = [[ONE, Fraction(0)], [Fraction(0), ONE]]


@pytest.mark.parametrize("seed", range(12))
def test_a_radius_is_certified_between_the_true_one_and_1(seed):
    random = np.random.default_rng(seed)
    M = random.normal(size=(2 + seed % 4,) * 2)
    M *= (0.2 + 0.07 * seed - 1e-6 * (seed == 11)) / np.abs(np.linalg.eigvals(M)).max()
    rows = [[Fraction(entry) for entry in row] for row in M.tolist()]
    found = contraction(rows)
    assert found is not None
    made = contracting("It contracts.", {"M": rows}, "M", found.radius, found.norm)
    assert "Positive definite: P" in Recheck().sentence(made)
    true = np.abs(np.linalg.eigvals(M)).max()
    assert true < found.radius < 1
    with pytest.raises(NotCertified):
        contracting("It contracts.", {"M": rows}, "M", Fraction(true) * (1 - Fraction(1, 10**6)), found.norm)


@pytest.mark.parametrize(
    ("loop", "radius", "holds"),
    [
        ([[ONE, 0], [0, ONE]], ONE, False),
        ([[ONE - TINY, 0], [0, ONE - TINY]], ONE, True),
        ([[0, ONE], [-ONE, 0]], ONE, False),
        ([[0, ONE], [-ONE, 0]], ONE + TINY, True),
        ([[Fraction(1, 2), 0], [0, ONE + TINY]], ONE, False),
    ],
)
def test_the_unit_circle_is_not_inside(loop, radius, holds):
    if holds:
        Recheck().sentence(contracting("It does.", {"M": loop}, "M", radius, I2))
    else:
        with pytest.raises(NotCertified):
            contracting("It does.", {"M": loop}, "M", radius, I2)


FORMULAS = [
    ("+", lambda a, b: a + b),
    ("-", lambda a, b: a - b),
    ("*", lambda a, b: a @ b),
    ("'", lambda a, b: a.T @ b),
]


@pytest.mark.parametrize(("sign", "made"), FORMULAS)
@pytest.mark.parametrize("seed", range(8))
def test_formulas_say_what_numpy_says(sign, made, seed):
    a, b = np.random.default_rng(seed).integers(-3, 4, (2, 2, 2))
    value = made(a, b) + np.linalg.matrix_power(a, 2)
    holds = (value == value.T).all() and (np.linalg.eigvalsh(value) > 1e-9).all()
    matrices = {"a": a.tolist(), "b": b.tolist()}
    formula = ("+", (sign, "a", "b"), ("^", "a", 2))
    if holds:
        Recheck().sentence(definite("So it is.", matrices, [formula]))
    else:
        with pytest.raises(NotCertified, match="is not positive definite"):
            definite("So it is.", matrices, [formula])


BAD = {
    "not symmetric": {"says": "", "matrices": {"P": [["2", "1"], ["0", "2"]]}, "positive": ["P"]},
    "singular": {"says": "", "matrices": {"P": [["1", "1"], ["1", "1"]]}, "positive": ["P"]},
    "just indefinite": {
        "says": "",
        "matrices": {"P": [["1", "1"], ["1", f"{10**30 - 1}/{10**30}"]]},
        "positive": ["P"],
    },
    "not square": {"says": "", "matrices": {"P": [["1", "0"]]}, "positive": ["P"]},
    "nothing": {"says": "", "matrices": {"P": [["1"]]}, "positive": []},
    "no matrix": {"says": "", "matrices": {"P": []}, "positive": ["P"]},
    "another name": {"says": "", "matrices": {"P": [["1"]]}, "positive": ["Q"]},
    "another operation": {"says": "", "matrices": {"P": [["1"]]}, "positive": [["/", "P", "P"]]},
    "nested without end": {"says": "", "matrices": {"P": [["1"]]}, "positive": [["^", "P", 10**9]]},
    "too long": {"says": "", "matrices": {"P": [["1/3"]]}, "positive": [["^", ["^", ["^", "P", 999], 999], 999]]},
    "a formula as a name": {"says": "", "matrices": {"Q - P": [["1"]]}, "positive": ["Q - P"]},
    "what I stands for": {"says": "", "matrices": {"I": [["2"]]}, "positive": ["I"]},
    "ragged": {"says": "", "matrices": {"P": [["1", "0"], ["0"]]}, "positive": ["P"]},
    "nan": {"says": "", "matrices": {"P": [["nan"]]}, "positive": ["P"]},
    "a number": {"says": "", "matrices": {"P": [[1]]}, "positive": ["P"]},
    "one entry more": {"says": "", "matrices": {"P": [["1"]]}, "positive": ["P"], "more": 1},
}


@pytest.mark.parametrize("name", BAD)
def test_what_proves_nothing_is_rejected(name):
    with pytest.raises(Rejected):
        check_definite(BAD[name])
