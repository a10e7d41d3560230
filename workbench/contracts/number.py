"""What a number of a record, a score or a verdict may be: finite, or None where there is none (JSON knows no other)."""

from __future__ import annotations

import math
from typing import SupportsFloat


def finite(value: SupportsFloat | None) -> float | None:
    """Return a number as a finite float, or None for what does not exist or is not finite."""
    number = math.nan if value is None else float(value)
    return number if math.isfinite(number) else None


def after_number(unit: str) -> str:
    """Return a unit as it stands behind a number, with a space in front; nothing for a pure one."""
    return "" if unit in ("", "1") else f" {unit}"
