"""What a law learns from a trial: the plan of each sample moves by a gain between two ends times the error there.

The graph of what is learned takes the memory, the reference r, the output y, the error e and whether each sample was
``reached``; it gives the plan before (``plan``) and after (``plan_next``), and the next memory. A trial reaches every
sample before its last one. What it did not reach is missing, undefined here, and must be kept out by conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from verification.checker.graph import Graph
from verification.checker.identities import Fraction, arithmetic, times
from verification.checker.interval import ALL, EITHER, INF, NONE, Known, Span, hull
from verification.checker.reading import Unknown, exact, need, record, whole

LARGE = 2.0**80
"""How large the numbers may be that a law meets."""
Place = tuple[str, int, int]


class Column:
    """What a law computes for sample k; ``kept`` are fields of the memory that hold the last trial's y or reached."""

    def __init__(
        self, graph: Graph, k: int, kept: dict[str, str], others: list[int], *, increment: bool, varying: bool
    ) -> None:
        self.graph, self.k, self.kept, self.increment, self.varying = graph, k, kept, increment, varying
        self.plan, self.after = graph.outputs["plan", 0, k], graph.outputs["plan_next", 0, k]
        self.targets = [self.plan, self.after, *others]

    def content(self) -> object:
        """Return what is computed, with columns counted from k: two samples of one content are alike.

        The first column is told apart, for every trial reaches it.
        """
        graph, order, found, stack = self.graph, dict[int, int](), list[object](), self.targets[::-1]
        while stack:
            node = stack.pop()
            if node in order:
                continue
            op, *args = graph.nodes[node]
            todo = [] if op in ("input", "const") else [arg for arg in args if arg not in order]
            if todo:
                stack += [node, *todo[::-1]]
                continue
            order[node] = len(order)
            if op == "input":
                port, row, column = graph.places[args[0]]
                found.append((port, row, column - self.k if graph.wide[port] else "one", column == 0))
            else:
                found.append((op, *(args if op == "const" else (order[arg] for arg in args))))
        return *found, *(order[one] for one in self.targets)

    def boxes(self, *, reached: bool) -> Iterator[list[Known]]:
        """Give what the coordinates may be, however far the trial before came.

        Of a trial samples up to ``sure`` are there, those beyond ``limit`` are not.
        """
        k = self.k
        now = (k + 1, INF) if reached else (0, k)
        for before in ((k + 1, INF), (k, k), (0, k - 1), (-1, -1)) if self.varying else ((INF, INF), (-1, -1)):
            box: list[Known] = []
            for port, _, column in self.graph.places:
                what = self.kept.get(port, port)
                sure, limit = before if port in self.kept else now if self.varying else (INF, INF)
                if what == "reached":
                    box.append(ALL if column <= sure else NONE if column > limit else EITHER)
                else:
                    there = what not in ("y", "e") or column <= sure
                    box.append((-LARGE, LARGE) if there else None)
            yield box

    def spans(self, nodes: Sequence[int], *, reached: bool) -> list[Known]:
        """Return intervals around nodes, whatever may be."""
        plan = self.graph.plan(nodes)
        found = [self.graph.enclose(plan, box, {}) for box in self.boxes(reached=reached)]
        return [hull(*(one[node] for one in found)) for node in nodes]

    def change(self, *, reached: bool) -> tuple[Fraction, dict[str, int]]:
        """Return by what the plan changes, a fraction in ``s``, the error, and in nodes by their names."""
        order = self.graph.ancestors(self.targets[:2])
        at = {
            node: self.graph.places[args[0]]
            for node in order
            for op, *args in [self.graph.nodes[node]]
            if op == "input"
        }
        seen = {(port, *place) for port in "re" for _, *place in at.values()}
        names = {one: f"{one[0]}{i}" for i, one in enumerate(sorted(seen | set(at.values()) | {("e", 0, self.k)}))}
        context = fmpq_mpoly_ctx.get(["s", *names.values(), *(f"n{node}" for node in order)], "lex")
        variable = dict(zip(context.names(), context.gens(), strict=True))
        one = context.constant(1)

        def leaf(place: Place) -> fmpq_mpoly:
            port, row, column = place
            if port == "reached" and (not self.varying or (column <= self.k + 1 if reached else column > self.k)):
                return context.constant(int(reached))
            if port == "y":
                return leaf(("r", row, column)) - leaf(("e", row, column))
            if place == ("e", 0, self.k + 1) and reached:
                return variable["s"] + (variable[names["e", 0, self.k]] if self.increment else context.constant(0))
            return variable[names[place]]

        known: dict[int, Fraction] = {}
        for node in order:
            op, *args = self.graph.nodes[node]
            if op == "input":
                known[node] = leaf(at[node]), one
            elif op == "const":
                known[node] = context.constant(exact(args[0].hex())), one
            else:
                known[node] = _made(op, [known[arg] for arg in args], variable[f"n{node}"], one)
        (a, b), (c, d) = known[self.after], known[self.plan]
        return (times(a, d) - times(c, b), times(b, d)), {f"n{node}": node for node in order}


def _made(op: str, of: list[Fraction], opaque: fmpq_mpoly, one: fmpq_mpoly) -> Fraction:
    """Return an operation on fractions; what is no arithmetic is a variable of its own."""
    if (found := arithmetic(op, of)) is not None:
        return found
    (a, b), (c, _) = of[0], of[-1]
    if op == "not" and a.is_constant() and b.is_constant():
        return one - one if len(a) else one, one
    if op in ("and", "or"):
        told = [len(top) > 0 if top.is_constant() and below.is_constant() else None for top, below in of]
        stop = op == "or"
        if stop in told or None not in told:
            return (one if (stop if stop in told else not stop) else one - one), one
    if op == "ne" and not len(c) and a.is_constant() and b.is_constant():
        return one if len(a) else one - one, one
    if op in ("gate", "sel") and a.is_constant() and b.is_constant():
        return of[1] if len(a) else of[2] if op == "sel" else (one - one, one)
    return opaque, one


def between(top: fmpq_poly, below: fmpq_poly, span: Span, low: fmpq, high: fmpq) -> bool:
    """Tell whether low <= top/below <= high on a closed interval on which ``below`` has no zero."""
    ends = [fmpq(*one.as_integer_ratio()) for one in span]
    if _roots(below, *ends) or below(ends[0]) == 0:
        return False
    sign = 1 if below(ends[0]) > 0 else -1
    return all(_never_negative(sign * one, *ends) for one in (top - low * below, high * below - top))


def _never_negative(p: fmpq_poly, low: fmpq, high: fmpq) -> bool:
    """Tell whether a polynomial is 0 or more on an interval: no root of odd order lies inside, and it is so once."""
    if p.is_zero():
        return True
    odd = fmpq_poly([1])
    for factor, power in p.factor_squarefree()[1]:
        odd *= factor if power % 2 else 1
    for end in (low, high):
        while odd.degree() > 0 and odd(end) == 0:
            odd = divmod(odd, fmpq_poly([-end, 1]))[0]
    middle = [low + (high - low) * fmpq(i, 97) for i in range(98)]
    at = next((one for one in middle if p(one) != 0), None)
    return at is not None and p(at) > 0 and (low == high or not _roots(odd, low, high))


def _roots(p: fmpq_poly, low: fmpq, high: fmpq) -> int:
    """Return how many different roots lie in (low, high], by Sturm's theorem."""
    chain = [p, p.derivative()]
    while not chain[-1].is_zero():
        chain.append(-(chain[-2] % chain[-1]))
    signs = [[one(end) for one in chain[:-1] if one(end) != 0] for end in (low, high)]
    turns = [sum((a > 0) != (b > 0) for a, b in pairwise(one)) for one in signs]
    return turns[0] - turns[1]


def check(statement: object, graph: Graph) -> tuple[str, dict[str, fmpq]]:
    """Check in which form a law learns."""
    samples, varying, increment, least, most, begins = record(
        statement, "samples", "varying", "increment", "least", "most", "begins"
    )
    n, low, high = whole(samples, 1, 10**6), exact(least), exact(most)
    need(type(varying) is bool and type(increment) is bool and low <= high, "ends of a gain must be in order")
    kept = {}
    for port, what in _copies(graph).items():
        if what == "reached" and begins.get(port) != "0":
            continue  # it may say that a trial reached what it did not
        kept[port] = what
    seen, others = set[object](), dict[int, list[int]]()
    for (name, _, column), node in graph.outputs.items():
        if name.startswith("next_") and name[5:] not in kept:
            others.setdefault(column, []).append(node)
    need(max(others, default=0) < n, "the memory must be of a sample, or be kept as it is")
    for k in range(n):
        one = Column(graph, k, kept, others.get(k, []), increment=increment, varying=varying)
        content = one.content()
        if content in seen:
            continue
        seen.add(content)
        for reached in (True, False) if varying else (True,):
            need(None not in one.spans(one.targets, reached=reached), f"what is missing enters sample {k}")
            _moves(one, low, high, reached=reached)
    facts = {"increment": fmpq(int(increment)), "least": low, "most": high}
    said = f"times the {'increment of the ' if increment else ''}error at k + 1, whatever the memory"
    said += "".join(f" (of which {port} begins with 0)" for port, what in kept.items() if what == "reached")
    gain = f"[{_plainly(low)}, {_plainly(high)}] {said}"
    what = f"{'and is kept after one that did not' if varying else 'as all do'}, for all numbers up to {LARGE:g}."
    return (
        f"The plan of each of {n} samples k moves by a gain in {gain}, after a trial that reached k + 1, {what}",
        facts,
    )


def _plainly(number: fmpq) -> str:
    near = float(number)
    return repr(near) if fmpq(*near.as_integer_ratio()) == number else str(number)


def _copies(graph: Graph) -> dict[str, str]:
    """Return the fields of the memory that become what the trial left, sample for sample."""
    found: dict[str, set[str]] = {}
    for (name, row, column), node in graph.outputs.items():
        if name.startswith("next_"):
            op, *args = graph.nodes[node]
            place = graph.places[args[0]] if op == "input" else ("", 0, 0)
            found.setdefault(name[5:], set()).add(place[0] if place[1:] == (row, column) else "")
    left = ("y", "e", "reached")
    for name, row, column in graph.places:
        if name in left or (f"next_{name}", row, column) not in graph.outputs:
            found.pop(name, None)
    return {name: one for name, (one, *more) in found.items() if not more and one in left}


def _moves(column: Column, low: fmpq, high: fmpq, *, reached: bool) -> None:
    (top, below), nodes = column.change(reached=reached)
    k, s = column.k, top.context().gen(0)
    if not reached:
        need(not len(top), f"the plan of sample {k} must be kept where the trial did not come")
        return
    gain, rest = divmod(top, s)
    need(not len(rest), f"the plan of sample {k} must move by a multiple of the error")
    names = top.context().names()
    used = sorted({names[i] for p in (gain, below) for i, power in enumerate(p.degrees()) if power})
    if len(used) > 1 or any(name not in nodes for name in used):
        raise Unknown(f"the gain of sample {k} is not of one quantity alone")
    (span,) = column.spans([nodes[name] for name in used], reached=True) if used else [(0.0, 0.0)]
    place = names.index(used[0]) if used else 0
    good = span is not None and between(_single(gain, place), _single(below, place), span, low, high)
    need(good, f"the gain of sample {k} is not shown to lie between its ends")


def _single(p: fmpq_mpoly, place: int) -> fmpq_poly:
    """Return a polynomial in one variable as such."""
    coefficients = {powers[place]: coefficient for powers, coefficient in p.terms()}
    return fmpq_poly([coefficients.get(i, fmpq(0)) for i in range(max(coefficients, default=0) + 1)])
