"""The error that users can cause."""

from __future__ import annotations


class InvalidValue(ValueError):
    """What was expected, what came and what to do, in one line meant for the user."""
