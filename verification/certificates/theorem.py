"""Certificates of theorems: which one it is, and the certificates of its premises."""

from __future__ import annotations

from workbench.contracts.certificate import Certificate


def theorem(name: str, **premises: Certificate) -> Certificate:
    """Return the certificate of a theorem of :data:`verification.checker.numbers.THEOREMS` by its premises' names."""
    return Certificate(
        kind="theorem",
        statement={"theorem": name, "premises": {of: one.name for of, one in premises.items()}},
        rests_on=tuple(premises.values()),
    )
