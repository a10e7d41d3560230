"""A certificate: a statement and its proof as plain data, which another program re-checks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

FORMAT = "workbench-certificate 1"
Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"


def hashed(content: Json) -> str:
    """Return the hash of plain data, which does not depend on how its records are ordered."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A statement and its proof. Numbers in them are text: doubles in hexadecimal, rationals as ``p/q``."""

    kind: str
    """What kind of statement it is: the checker has one rule for each."""
    statement: Mapping[str, Json]
    proof: Mapping[str, Json] = field(default_factory=dict)
    graphs: Mapping[str, Json] = field(default_factory=dict)
    """The graphs that it speaks of, by their hash."""
    rests_on: Sequence[Certificate] = ()
    """The certificates whose hashes stand in its statement."""

    @cached_property
    def name(self) -> str:
        """The hash of what it states: two proofs of one statement have one name."""
        return hashed([self.kind, dict(self.statement)])

    def as_json(self) -> Mapping[str, Json]:
        """Return it as its file holds it."""
        return {"format": FORMAT, "kind": self.kind, "statement": self.statement, "proof": self.proof}

    def all(self) -> Iterator[Certificate]:
        """Go through it and all that it rests on."""
        yield self
        for one in self.rests_on:
            yield from one.all()
