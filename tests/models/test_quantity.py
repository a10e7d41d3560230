"""Declarations within declarations: walked, rebuilt and made symbolic, against what is written out by hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import pytest

from models.quantity import InvalidValue, count, declared, given, nested, part, quantity, rebuilt, symbolised, walked


@declared
class Leaf:
    low: float = quantity(default=1.0, unit="m", doc="low")
    high: float = quantity(default=2.0, unit="m", doc="high")
    cells: int = count(default=3, doc="cells")

    def check(self) -> None:
        """Raise InvalidValue where low is above high."""
        if isinstance(self.low, float) and isinstance(self.high, float) and self.low > self.high:
            raise InvalidValue(f"low must lie below high, got {self.low} and {self.high}")


@declared
class Tree:
    first: Leaf = part(default=Leaf(), doc="a part")
    label: str = given(default="tree", doc="a name")
    others: Mapping[str, Any] = part(default={"a": Leaf(), "b": Leaf(low=0.5)}, doc="parts by name")
    weight: float = quantity(default=4.0, unit="kg", doc="weight")


def under(path):
    return [f"{path}.{name}" for name in ("low", "high", "cells")]


@pytest.mark.parametrize(
    ("into", "paths"),
    [
        (lambda spec, value: False, ("first", "label", "others", "weight")),
        (
            lambda spec, value: True,
            ("first", *under("first"), "label", "others", *under("others.a"), *under("others.b"), "weight"),
        ),
        (
            lambda spec, value: not isinstance(value, Mapping),
            ("first", *under("first"), "label", "others", "weight"),
        ),
    ],
)
def test_fields_are_walked_outer_ones_first(into, paths):
    assert tuple(path for path, _, _ in walked(Tree(), into)) == paths


def test_changes_are_made_from_the_inside_out_and_together():
    changes = nested({"first.low": 5.0, "first.high": 6.0, "others.b.high": 9.0})
    assert changes == {"first": {"low": 5.0, "high": 6.0}, "others": {"b": {"high": 9.0}}}
    tree = rebuilt(Tree(), changes)
    assert tree == Tree(first=Leaf(low=5.0, high=6.0), others={"a": Leaf(), "b": Leaf(low=0.5, high=9.0)})
    assert list(tree.others) == ["a", "b"] and Tree().first == Leaf()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"first.low": 5.0}, "^first.low must lie below high, got 5.0 and 2.0"),
        ({"others.a.cells": 0.5}, "^others.a.cells must be a whole number"),
        ({"weight": 1.0, "weight.low": 2.0}, "^weight.low lies within weight, which is given a value too"),
    ],
)
def test_a_bad_change_names_its_whole_path(values, message):
    with pytest.raises(InvalidValue, match=message):
        rebuilt(Tree(), nested(values))


def test_floats_become_symbols_counts_and_mappings_stay():
    found = symbolised(Tree())
    assert found.names == ("first.low", "first.high", "weight") and found.values == (1.0, 2.0, 4.0)
    assert [symbol.name() for symbol in found.symbols] == ["first_low", "first_high", "weight"]
    assert ca.is_equal(found.thing.first.high, found.symbols[1]) and found.thing.others == Tree().others
    only = symbolised(Tree(), only=frozenset({"first.high"}))
    assert only.names == ("first.high",) and only.thing.first.low == 1.0 and only.thing.weight == 4.0
