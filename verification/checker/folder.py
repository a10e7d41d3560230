"""A folder of certificates: what it claims, and what of it is shown."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from flint import fmpq

from verification.checker import anywhere, bounds, identities, learned, matrices, numbers, recursion
from verification.checker.graph import Graph
from verification.checker.reading import (
    FORMAT,
    Json,
    Rejected,
    Unknown,
    Unusable,
    hashed,
    loaded,
    need,
    record,
    rows,
    text,
    whole,
)


class Shown(NamedTuple):
    """A certificate that was accepted: its sentence, the numbers that it shows, and the bounds."""

    sentence: str
    facts: Mapping[str, fmpq] = {}
    bounds: Sequence[bounds.Shown | None] = ()
    graph: Graph | None = None
    kind: str = ""


class Answer(NamedTuple):
    """How a claim came out: ``accepted``, ``rejected`` or ``not re-checkable``, and its sentence or why."""

    claim: str
    outcome: str
    words: str


class Store:
    """Certificates, each looked at once. ``read(kind, name)`` gives the data of a graph or a proof by its hash."""

    def __init__(self, read: Callable[[str, str], object]) -> None:
        self._read, self._known = read, dict[str, Shown | Rejected]()

    def shown(self, name: str) -> Shown:
        """Return what a certificate shows. Raises Rejected where that is nothing, Unknown where no rule tells."""
        if name not in self._known:
            self._known[name] = Rejected("a certificate must not rest on itself")
            try:
                self._known[name] = self._check(*self._opened(name))
            except Rejected as error:
                self._known[name] = error
            except (
                ArithmeticError,
                LookupError,
                TypeError,
                ValueError,
                AttributeError,
                RecursionError,
                MemoryError,
            ) as error:
                self._known[name] = Rejected(f"it is malformed ({type(error).__name__}: {str(error)[:80]})")
        found = self._known[name]
        if isinstance(found, Rejected):
            raise found
        return found

    def _graph(self, name: str, apart: Sequence[int] = ()) -> Graph:
        content = self._read("graphs", name)
        need(hashed(content) == name, "a graph must have the hash by which it is named")
        return Graph(content, apart)

    def _opened(self, name: str) -> tuple[str, Json, Json]:
        form, kind, statement, proof = record(self._read("proofs", name), "format", "kind", "statement", "proof")
        need(form == FORMAT, f"the format must be {FORMAT!r}, got {form!r:.40}")
        need(hashed([kind, statement]) == name, "a certificate must have the hash by which it is named")
        need(isinstance(statement, dict) and isinstance(proof, dict), "a statement and a proof must be records")
        return text(kind), statement, proof

    def _check(self, kind: str, statement: Json, proof: Json) -> Shown:
        return self._shown(kind, statement, proof)._replace(kind=statement["theorem"] if kind == "theorem" else kind)

    def _shown(self, kind: str, statement: Json, proof: Json) -> Shown:
        if kind in ("bounds", "funnel", "identity", "range", "learned"):
            graph, rest = text(statement["graph"]), {key: one for key, one in statement.items() if key != "graph"}
            of = f"Of the graph {graph[:16]}: "
            if kind == "funnel":
                apart = [whole(one, 0, 10**7) for one in rows(proof["apart"])]
                sentence, facts = recursion.check_funnel(rest, proof, self._graph(graph, apart))
                return Shown(of + sentence, facts)
            rule = {"identity": identities.check, "range": anywhere.check, "learned": learned.check}.get(kind)
            if rule is not None:
                sentence, facts = rule(rest, self._graph(graph))
                return Shown(of + sentence, facts)
            checked = self._graph(graph)
            sentence, found = bounds.check(rest, proof, checked)
            facts = bounds.ends(found, ("y", 0, 0), (*checked.ports.get("u", ()), "")[0])
            everywhere = all(one["is"].endswith(" everywhere") for one in statement["claims"])
            facts |= {"continuous": fmpq(not any(found)), "everywhere": fmpq(everywhere), "graph": fmpq(int(graph, 16))}
            return Shown(of + sentence, facts, found, checked)
        if kind == "rows":
            slopes = self.shown(text(statement["bounds"]))
            if slopes.graph is None:
                raise Rejected("row sums must rest on bounds")
            sentence, facts = recursion.check_rows(statement, slopes.bounds, slopes.graph)
            return Shown(f"{sentence} Its set and slopes: {slopes.sentence}", facts)
        if kind == "theorem":
            shown = {text(key): self.shown(text(one)) for key, one in statement["premises"].items()}
            premises = {key: (one.kind, one.sentence, one.facts) for key, one in shown.items()}
            return Shown(*numbers.check_theorem(statement, premises))
        if kind == "numbers":
            return Shown(*numbers.check(statement))
        if kind == "definite":
            return Shown(matrices.check_definite(statement))
        need(kind == "sets", f"a certificate must be of a known kind, got {kind!r:.40}")
        return Shown(matrices.check_sets(statement, proof))


def answers(place: Path) -> list[Answer]:
    """Return what comes of every claim of a folder's index. Raises Unusable for what is no such folder."""
    place = place / "certificates" if (place / "certificates").is_dir() else place
    if not place.is_dir():
        raise Unusable(f"a folder of certificates must be named, got {place}")

    def read(kind: str, name: str) -> object:
        need(name.isalnum(), f"a hash must be made of letters and digits, got {name!r:.40}")
        try:
            return loaded(place / kind / f"{name}.json")
        except Unusable as error:
            raise Rejected(str(error)) from None

    store, found = Store(read), []
    try:
        form, entries = record(loaded(place / "index.json"), "format", "claims")
        need(form == FORMAT, f"the format must be {FORMAT!r}, got {form!r:.40}")
        for entry in rows(entries):
            claim, case, controller, certificate, sentence = record(
                entry, "claim", "case", "controller", "certificate", "sentence"
            )
            name = f"{text(claim)} [{text(case)}{'' if controller is None else ', ' + text(controller)}]"
            try:
                said = store.shown(text(certificate)).sentence
                need(sentence == sha256(said.encode()).hexdigest(), "the verdict must say what its certificate shows")
                found.append(Answer(name, "accepted", said))
            except Rejected as error:
                found.append(Answer(name, "not re-checkable" if isinstance(error, Unknown) else "rejected", str(error)))
        need(found, "there is no claim")
    except Rejected as error:
        raise Unusable(f"index.json: {error}") from None
    return found


def main(given: Sequence[str]) -> int:
    """Check folders and print what comes of each claim; return 2 where one is not accepted, or for bad input."""
    try:
        found = [one for place in given for one in answers(Path(place))]
    except Unusable as error:
        print(error, file=sys.stderr)
        return 2
    if not found:
        print("usage: python -m verification.checker DIR ...", file=sys.stderr)
        return 2
    for claim, outcome, words in found:
        print(f"{outcome.upper()} {claim}: {words}")
    accepted = sum(one.outcome == "accepted" for one in found)
    print(f"{accepted} of {len(found)} claims accepted")
    return 0 if accepted == len(found) else 2
