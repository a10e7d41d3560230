"""The gain of the immune laws from what they tell, for whoever looks at their loop."""

from __future__ import annotations

from collections.abc import Mapping

from models.array import Array


def gain(told: Mapping[str, Array]) -> Array:
    """Return p1 - p2 f by sample from the rows p1, p2 and f, same shape."""
    p1, p2, f = told["p1"], told["p2"], told["f"]
    combined: Array = p1 - p2 * f
    return combined
