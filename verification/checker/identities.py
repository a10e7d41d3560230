"""Identities of rational functions: two results of a graph are one, as fractions of polynomials in its coordinates."""

from __future__ import annotations

from flint import fmpq_mpoly, fmpq_mpoly_ctx

from verification.checker.graph import Graph, Node
from verification.checker.reading import Rejected, exact, need, record, rows, text, whole

Fraction = tuple[fmpq_mpoly, fmpq_mpoly]
MOST = 20_000
"""Terms that a polynomial may have."""


def check(statement: object, graph: Graph) -> str:
    """Check that pairs of results of a graph are equal wherever both exist.

    What is no arithmetic (a sine, the larger of two) is taken as a quantity of its own, the same for the same argument.
    """
    says, pairs = record(statement, "says", "equal")
    wanted = []
    for pair in rows(pairs):
        wanted.append([_place(one, graph) for one in rows(pair, 2)])
    need(wanted, "there must be a pair")
    wanted = [pair for pair in wanted if pair[0] != pair[1]]
    plan = graph.ancestors({one for pair in wanted for one in pair})
    loose = [k for k in plan if graph.nodes[k][0] not in ("const", "add", "sub", "mul", "div", "neg", "sq", "pow")]
    context = fmpq_mpoly_ctx.get([f"a{k}" for k in loose] or ["a"], "lex")
    atoms = dict(zip(loose, context.gens(), strict=False))
    one = context.constant(1)
    known: dict[int, Fraction] = {}
    for k in plan:
        op, *args = graph.nodes[k]
        known[k] = (
            (atoms[k], one)
            if k in atoms
            else (context.constant(exact(args[0].hex())), one)
            if op == "const"
            else _fraction(op, [known[a] for a in args], graph.nodes[args[-1]], one)
        )
        need(all(len(part) <= MOST for part in known[k]), "a polynomial has too many terms")
    for left, right in wanted:
        (a, b), (c, d) = known[left], known[right]
        need(times(a, d) == times(c, b), f"the two sides of {text(says)!r} differ")
    return f"{text(says)} (as rational functions of the coordinates, wherever both sides exist)."


def _place(given: object, graph: Graph) -> int:
    name, row, column = rows(given, 3)
    place = (text(name), whole(row, 0, 10**6), whole(column, 0, 10**6))
    need(place in graph.outputs, f"the graph must have what is spoken of, got {place}")
    return graph.outputs[place]


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
    if (found := arithmetic(op, of)) is not None:
        return found
    if last[0] == "const" and float(last[1]).is_integer() and 0 <= last[1] <= 32:
        power = one, one
        for _ in range(int(last[1])):
            power = times(power[0], of[0][0]), times(power[1], of[0][1])
        return power
    raise Rejected("a power must have a whole exponent from 0 to 32")
