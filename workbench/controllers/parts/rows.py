"""Rows of samples, as laws compute with them."""

from __future__ import annotations

from typing import Any

import casadi as ca


def known(reached: Any, value: Any) -> Any:
    """Return value where ``reached`` is 1 and 0 elsewhere, never touching what is missing (NaN) there."""
    return ca.if_else(reached, value, 0)


def constant_row(value: Any, columns: int) -> Any:
    """Return a row with the same value in every column, for a number or a symbol."""
    return value * ca.DM.ones(1, columns)
