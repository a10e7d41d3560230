"""The claims about the metro study are those of learning laws in general."""

from verification.theorems.learning import examine

__all__ = ["examine"]
