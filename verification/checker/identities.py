"""Identities of rational functions: two sides are one, as fractions of polynomials in a graph's coordinates."""

from __future__ import annotations

from collections.abc import Sequence

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from verification.checker.graph import Graph, Node
from verification.checker.reading import exact, need, record, rows, text, whole

Fraction = tuple[fmpq_mpoly, fmpq_mpoly]
MOST = 20_000
"""Terms that a polynomial may have."""


def check(statement: object, graph: Graph) -> tuple[str, dict[str, fmpq]]:
    """Check that pairs of sides are equal wherever both exist; return the sentence, and the sides that are numbers.

    A side is a result of the graph (``[name, row, column]``), its slope along a coordinate (a fourth entry), or a
    number. What is no arithmetic (a sine, the larger of two, the slope of what may jump) is taken as a quantity of its
    own, the same for the same argument.
    """
    says, pairs = record(statement, "says", "equal")
    given = [[_side(one, graph) for one in rows(pair, 2)] for pair in rows(pairs)]
    need(given, "there must be a pair")
    apart = [(a, b) for (_, a), (_, b) in given if type(a) is not type(b) or a != b]  # one node is equal to itself
    sides = fractions(graph, [one for pair in apart for one in pair])
    for (a, b), (c, d) in zip(sides[::2], sides[1::2], strict=True):
        need(times(a, d) == times(c, b), f"the two sides of {text(says)!r} differ")
    facts = {left: number for (left, _), (_, number) in given if isinstance(number, fmpq)}
    same = "; ".join(f"{left} = {right}" for (left, _), (right, _) in given)
    return f"{text(says)} ({same}, as fractions of polynomials, whatever the coordinates, where both exist.)", facts


def fractions(graph: Graph, sides: Sequence[int | fmpq]) -> list[Fraction]:
    """Return nodes and numbers as fractions of polynomials in the coordinates and in what is no arithmetic."""
    plan, stack = set[int](), [one for one in sides if isinstance(one, int)]
    while stack:  # what an atom is made of is not looked at
        k = stack.pop()
        if k not in plan:
            plan.add(k)
            stack += graph.nodes[k][1:] if _is_arithmetic(k, graph) and graph.nodes[k][0] != "const" else ()
    loose = sorted(k for k in plan if not _is_arithmetic(k, graph))
    context = fmpq_mpoly_ctx.get([f"a{k}" for k in loose] or ["a"], "lex")
    atoms = dict(zip(loose, context.gens(), strict=False))
    one = context.constant(1)
    known: dict[int, Fraction] = {}
    for k in sorted(plan):
        op, *args = graph.nodes[k]
        known[k] = (
            (atoms[k], one)
            if k in atoms
            else (context.constant(exact(args[0].hex())), one)
            if op == "const"
            else _fraction(op, [known[a] for a in args], graph.nodes[args[-1]], one)
        )
        need(all(len(part) <= MOST for part in known[k]), "a polynomial has too many terms")
    return [known[side] if isinstance(side, int) else (context.constant(side), one) for side in sides]


def _is_arithmetic(k: int, graph: Graph) -> bool:
    op, *args = graph.nodes[k]
    kind, *exponent = graph.nodes[args[-1]] if op == "pow" else (op,)
    if op == "pow":
        return kind == "const" and float(exponent[0]).is_integer() and 0 <= exponent[0] <= 32
    return op in ("const", "add", "sub", "mul", "div", "neg", "sq")


def _side(given: object, graph: Graph) -> tuple[str, int | fmpq]:
    if isinstance(given, str):
        return given, exact(given)
    name, row, column, *along = rows(given)
    place = (text(name), whole(row, 0, 10**6), whole(column, 0, 10**6))
    need(place in graph.outputs, f"the graph must have what is spoken of, got {place}")
    said, node = f"{name}[{row},{column}]", graph.outputs[place]
    if not along:
        return said, node
    need(len(along) == 1 and along[0] in graph.coordinates, f"slopes must be along a coordinate, got {along!r:.40}")
    return f"d {said} / d {along[0]}", graph.slope(node, graph.coordinates.index(along[0]))


def times(a: fmpq_mpoly, b: fmpq_mpoly) -> fmpq_mpoly:
    """Return a product, unless it would be too large."""
    digits = sum(max((one.p.bit_length() + one.q.bit_length() for one in p.coeffs()), default=0) for p in (a, b))
    need(len(a) * len(b) <= 10 * MOST and digits <= MOST, "a polynomial has too many terms or digits")
    need(a.total_degree() + b.total_degree() <= MOST, "a polynomial has too high a degree")
    return a * b


def arithmetic(op: str, of: list[Fraction]) -> Fraction | None:
    """Return an operation on fractions, None where it is no arithmetic."""
    (a, b), (c, d) = of[0], of[-1]
    if op == "neg":
        return -a, b
    if op in ("add", "sub"):
        c = c if op == "add" else -c
        return (a + c, b) if b == d else (times(a, d) + times(c, b), times(b, d))
    if op in ("mul", "sq"):
        return times(a, c), times(b, d)
    if op == "div":
        need(len(c), "a zero must not divide")
        return times(a, d), times(b, c)
    return None


def _fraction(op: str, of: list[Fraction], last: Node, one: fmpq_mpoly) -> Fraction:
    found = arithmetic(op, of)
    if found is None:
        found = one, one
        for _ in range(int(last[1])):
            found = times(found[0], of[0][0]), times(found[1], of[0][1])
    return found
