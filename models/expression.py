"""The static types of what equations are written in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias, cast

import casadi as ca

Expression: TypeAlias = ca.SX
"""What a type checker sees where equations are written; MX and DM pass through the same equations at run time."""
Number: TypeAlias = float | Expression
"""A number, or the symbol that stands for one."""
Column: TypeAlias = Expression | Sequence[Number]
"""What an equation may give for several signals: a column, or one value a signal in their order."""


def as_expression(value: ca.MX | ca.DM | ca.SX) -> Expression:
    """Return a CasADi value under the type that equations are written in: it stays what it is."""
    return cast(Expression, value)
