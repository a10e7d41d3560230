"""Every name that Python takes becomes one that CasADi takes, and no two become one."""

from __future__ import annotations

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.function_name import function_name

ODD = ["小车", "_cart", "cart_", "__cart__", "ca__rt", "_", "__", "_1", "Ü", "null", "jac", "hess", "a" * 300, "Ω_2"]


@pytest.mark.parametrize("name", [*ODD, "cart", "metro_2", "A1_b2_C3"])
def test_casadi_takes_it_with_something_round_it(name):
    made = function_name(name)
    x = ca.SX.sym("x")
    for whole in (made, f"trial_{made}", f"{made}_next", f"a_{made}_b"):
        assert ca.Function(whole, [x], [x], [whole], [f"y_{whole}"]).name() == whole
    assert len(made) <= 80


@pytest.mark.parametrize("name", ["cart", "metro_2", "A1_b2_C3", "x"])
def test_what_casadi_takes_stays(name):
    assert function_name(name) == name


def test_no_two_become_one():
    made = {function_name(name) for name in ODD}
    assert len(made) == len(ODD)
    assert {function_name(name) for name in made}.isdisjoint(made)  # not even one that is spelt like what was made


@given(st.from_regex(r"\A[^\W\d]\w{0,40}\Z"), st.from_regex(r"\A[^\W\d]\w{0,40}\Z"))
def test_identifiers(one, other):
    assert ca.Function(function_name(one), [], []).name() == function_name(one)
    assert (function_name(one) == function_name(other)) == (one == other)
