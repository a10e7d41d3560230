"""Rows and columns as laws compute with them, in expressions."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from models.expression import Expression, Number, as_expression
from workbench.contracts.law import Task


def known(reached: Expression, value: Expression) -> Expression:
    """Return value where ``reached`` is 1 and 0 elsewhere, never touching what is missing (NaN) there."""
    several = ca.repmat(reached, value.shape[0], 1) if value.shape[0] > 1 else reached
    return ca.if_else(several, value, 0)


def zeros(rows: int = 1, columns: int = 1) -> Expression:
    """Return zeros."""
    return as_expression(ca.DM.zeros(rows, columns))


def ones(rows: int = 1, columns: int = 1) -> Expression:
    """Return ones."""
    return as_expression(ca.DM.ones(rows, columns))


def missing(rows: int, columns: int) -> Expression:
    """Return what no trial has left yet: NaN everywhere."""
    return as_expression(ca.DM.nan(rows, columns))


def column(value: Number) -> Expression:
    """Return a number or a symbol as an expression, (1, 1)."""
    return as_expression(value) if isinstance(value, (ca.SX, ca.MX, ca.DM)) else as_expression(ca.DM(value))


def joined(u: Expression | Sequence[Expression]) -> Expression:
    """Return what a law acts with, given as a column or one by one, as a column."""
    return as_expression(u) if isinstance(u, (ca.SX, ca.MX, ca.DM)) else ca.vertcat(*u)


def constant_row(value: Number, columns: int, rows: int = 1) -> Expression:
    """Return a row with the same value in every column, for a number or a symbol; the same for several rows."""
    return value * ones(rows, columns)


def first_plan(task: Task, own: Number, unit: Number, inputs: int = 1) -> Expression:
    """Return the inputs to try first in a law's unit, (inputs, N): those of the task, else its own at every sample."""
    if task.first_plan is None:
        return constant_row(own / unit, task.samples, inputs)
    return task.first_plan / unit
