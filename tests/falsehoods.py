"""Certificates of what is false by construction, each with the best proof that is found for what is true beside it."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from forging import Drawn, Forged, bounds, claim, coordinate, h, hashed, numbers, theorem, values
from learned_by_hand import LAWS, law
from random_graphs import exact, random_graph
from small_funnels import funnel, left

from verification.certificates.trees import bounded, continuous, tree
from verification.checker.bounds import Coordinate, Quantity
from verification.checker.graph import Graph
from verification.checker.reading import Unknown
from workbench.graph import to_json

PIECES = 40
"""Pieces through which a proof of what is true is sought."""
GRID = [Fraction(i, 8) for i in range(-12, 13)]


def up(number: float) -> float:
    return math.nextafter(number, math.inf)


def down(number: float) -> float:
    return math.nextafter(number, -math.inf)


def stronger(bound: Fraction | float, side: str) -> list[tuple[str, float]]:
    """Return claims that are false where a quantity comes to ``bound``: by the last digit, by 1e-9, and strictly."""
    near = float(bound)
    more = near if Fraction(near) > bound else up(near)
    less = near if Fraction(near) < bound else down(near)
    if side == "low":
        strict = [("above", near)] if Fraction(near) == bound else []
        return [*strict, ("at least", more), ("at least", near + 1e-9 * max(abs(near), 1e-9))]
    strict = [("below", near)] if Fraction(near) == bound else []
    return [*strict, ("at most", less), ("at most", near - 1e-9 * max(abs(near), 1e-9))]


def sought(graph: dict, box: list[dict], along: str | None, bound: float | None, side: str) -> list:
    """Return trees that might show a bound: the best that is found for one a little weaker, and plain ones."""
    plain: list = [["p"], ["m"], ["v"]]
    plain += [[[0, h((float.fromhex(box[0]["low"]) + float.fromhex(box[0]["high"])) / 2)], "v", "m"]]
    ends = [(float.fromhex(one["low"]), float.fromhex(one["high"])) for one in box]
    set_ = [Coordinate(one["name"], "", span, one["whole"]) for one, span in zip(box, ends, strict=True)]
    wholes = [i for i, one in enumerate(box) if one["whole"]]
    checked = Graph(json.loads(json.dumps(graph)))
    try:
        quantity = Quantity(checked, checked.outputs["y", 0, 0], None if along is None else checked.coordinates.index(along), wholes)  # fmt: skip # noqa: E501
        if bound is None:
            found = tree(quantity, set_, continuous(quantity), PIECES)
        else:
            weaker = bound - 1e-3 * max(1.0, abs(bound)) if side == "low" else bound + 1e-3 * max(1.0, abs(bound))
            found = tree(quantity, set_, bounded(quantity, "at least" if side == "low" else "at most", weaker), PIECES)
    except Unknown:
        return plain
    return plain if found is None else [found, *plain]


def of_random_graphs(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Values, slopes and jumps of graphs with guards, kinks and poles, whose values are rationals."""
    while count > 0:
        graph = random_graph(rng, int(rng.integers(10, 22)))
        content = json.loads(to_json(graph))
        for one in content["outputs"]:
            one["name"] = "y"
        points = [(x, y) for x in GRID for y in (Fraction(-1), Fraction(0), Fraction(1, 2), Fraction(5, 4))]
        found = {point: exact(graph, point) for point in points}
        box = [coordinate("x", -1.5, 1.5), coordinate("y", -1, 1.25)]
        known = {point: value for point, value in found.items() if value is not None}
        claims: list[tuple[str, float | None, str | None, str]] = []
        if len(known) < len(found):  # somewhere there is no value: nothing may be said
            claims += [
                ("at least", -1e300, None, "low"),
                ("continuous", None, None, ""),
                ("at most", 1e300, "x", "high"),
            ]
        else:
            claims += [(*one, None, side) for side, pick in (("low", min), ("high", max)) for one in
                       stronger(pick(known.values()), side)[:2]]  # fmt: skip
            slopes = [(known[b, y] - known[a, y]) / (b - a) for a, b in itertools.pairwise(GRID) for _, y in points[:4]]
            claims += [(*one, "x", side) for side, pick in (("low", min), ("high", max)) for one in
                       stronger(pick(slopes), side)[-1:]]  # fmt: skip
            tiny = Fraction(1, 2**60)
            for x, y in points[4:-4:7]:
                near = [exact(graph, (x + side * tiny, y)) for side in (-1, 1)]
                if None not in near and abs(near[1] - near[0]) > Fraction(1, 100):
                    claims += [("continuous", None, None, ""), ("at least", -1e200, "x", "low")]
                    break
        for side, bound, along, way in claims:
            for proof in sought(content, box, along, bound, way)[:2]:
                yield bounds(content, box, [claim(side, bound, along)], [proof])
                count -= 1


def curves(rng: np.random.Generator) -> Iterator[tuple[dict, list[dict], str | None, Fraction | float, str]]:
    """Give curves of which a least or largest value or slope is known, as far as it is a double."""
    a, t = (float(one) / 8 for one in rng.integers(1, 30, 2))
    x = {"x": ["x"]}

    def drawn(*rows: tuple, labels: tuple[str, ...] = ("x",)) -> dict:
        g = Drawn({"x": labels})
        for op, *args in rows:
            g.put(op, *args)
        return g.gives("y", len(g.nodes) - 1).content

    over = [coordinate("x", t - a, t + 2 * a)]
    number = ("const", h(t))
    square = (number, ("sub", 0, 1), ("sq", 2), ("const", h(a)), ("mul", 3, 4))
    yield drawn(*square), over, None, Fraction(0), "low"
    yield drawn(*square, ("neg", 5)), over, None, Fraction(0), "high"
    yield drawn(*square), over, "x", Fraction(-2 * a * a), "low"
    yield drawn(number, ("sub", 0, 1), ("fabs", 2)), over, None, Fraction(0), "low"
    yield drawn(number, ("sub", 0, 1), ("fabs", 2)), over, "x", Fraction(-1), "low"
    yield drawn(number, ("fmax", 0, 1)), over, "x", Fraction(1), "high"
    yield drawn(number, ("fmin", 0, 1)), over, "x", Fraction(0), "low"
    wide = [coordinate("x", -1 - a, 2 + a)]
    yield drawn(("sin", 0)), wide, None, Fraction(1), "high"
    yield drawn(("cos", 0)), wide, None, Fraction(1), "high"
    yield drawn(("sin", 0)), wide, "x", Fraction(1), "high"
    yield drawn(("tanh", 0)), wide, "x", Fraction(1), "high"
    yield drawn(("atan", 0)), wide, "x", Fraction(1), "high"
    yield drawn(("cosh", 0)), wide, None, Fraction(1), "low"
    yield drawn(("expm1", 0)), [coordinate("x", 0, a)], None, Fraction(0), "low"
    yield drawn(("exp", 0)), [coordinate("x", 0, a)], "x", Fraction(1), "low"
    yield drawn(("log1p", 0)), [coordinate("x", 0, a)], "x", Fraction(1), "high"
    yield drawn(("asinh", 0)), wide, "x", Fraction(1), "high"
    yield drawn(("sqrt", 0)), [coordinate("x", 0.25, 4)], "x", Fraction(1), "high"
    yield drawn(("inv", 0)), [coordinate("x", 0.5, 4)], "x", Fraction(-4), "low"
    yield drawn(("const", h(3)), ("constpow", 0, 1)), [coordinate("x", -2, 1)], None, Fraction(-8), "low"
    yield drawn(("const", h(1.5)), ("constpow", 0, 1)), [coordinate("x", 0.25, 4)], "x", Fraction(3), "high"
    yield drawn(("sign", 0)), wide, None, Fraction(-1), "low"
    yield drawn(("floor", 0)), [coordinate("x", 0.5, 3)], None, Fraction(3), "high"
    yield drawn(("ceil", 0)), [coordinate("x", 0, 2.5)], None, Fraction(0), "low"
    yield drawn(("const", h(0)), ("lt", 1, 0), ("if_else_zero", 2, 0)), wide, None, Fraction(2 + a), "high"
    yield drawn(("const", h(0)), ("lt", 0, 1), ("not", 2), ("const", h(5)), ("if_else_zero", 2, 0),
                ("if_else_zero", 3, 4), ("add", 5, 6)), wide, None, Fraction(5), "high"  # fmt: skip
    k = int(rng.integers(1, 9))
    off = (("const", h(k)), ("const", h(k + 1)), ("sub", 0, 1), ("sub", 0, 2), ("mul", 3, 4))
    yield drawn(*off, labels=("k",)), [coordinate("k", 0, 12, True)], None, Fraction(0), "low"
    top = max(k * (k + 1), (12 - k) * (11 - k))
    yield drawn(*off, labels=("k",)), [coordinate("k", 0, 12, True)], None, Fraction(top), "high"
    g = Drawn({"x": ["x"], "k": ["k"]})
    node = g.put("mul", g.at["x"], g.put("sub", g.at["k"], g.number(k)))
    both = [coordinate("x", -1, 1), coordinate("k", 0, 9, True)]
    yield g.gives("y", node).content, both, "x", Fraction(-k), "low"
    for op in ("sqrt", "log", "inv", "tan"):
        yield drawn((op, 0)), [coordinate("x", 0 if op != "tan" else -2, 2)], "x", math.inf, "gone"
        yield drawn((op, 0)), [coordinate("x", -1, 2)], None, math.inf, "gone"
    del x


def of_curves(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Bounds stronger than the best, by the last digit, by 1e-9, or strictly where it is reached."""
    while True:
        for graph, box, along, best, side in curves(rng):
            said = [("at least", -1e308), ("at most", 1e308), ("continuous", None)]
            for word, bound in said if side == "gone" else stronger(best, side):
                for proof in sought(graph, box, along, bound, "low" if side == "gone" else side)[:3]:
                    yield bounds(graph, box, [claim(word, bound, along)], [proof])
                    count -= 1
                    if count <= 0:
                        return


def plant(a: list[list[float]], b: list[float], c: list[float], d: float, more: str = "") -> Drawn:
    """Return the graph of a linear plant; ``more`` names another input that moves its output."""
    states = [f"x{i}" for i in range(len(a))]
    g = Drawn({"x": states, "u": ["u"], "k": ["k"], "w": ["w"], "p": ["p"]} if more else {"x": states, "u": ["u"], "k": ["k"], "w": ["w"]})  # fmt: skip # noqa: E501
    x, u = [g.at[one] for one in states], g.at["u"]

    def line(weights: list[float], by: float) -> int:
        return g.sum(*(g.scaled(one, node) for one, node in zip(weights, x, strict=True)), g.scaled(by, u))

    rows = [line(weights, by) for weights, by in zip(a, b, strict=True)]
    y = line(c, d)
    if more:
        y = g.put("add", y, g.at["p"])
    g.gives("y", y)
    g.results.append({"name": "x_next", "shape": [len(a), 1], "entries": [[i, 0, node] for i, node in enumerate(rows)]})
    return g


def slopes(g: Drawn, a: list, b: list, c: list, d: float) -> Forged:
    """Return the certificate of a linear plant's slopes, a little wider than they are."""
    states = [f"x{i}" for i in range(len(a))]
    sizes = [("x_next", i, one, a[i][j]) for i in range(len(a)) for j, one in enumerate(states)]
    sizes += [("x_next", i, "u", b[i]) for i in range(len(a))]
    sizes += [("y", 0, one, c[j]) for j, one in enumerate(states)] + [("y", 0, "u", d)]
    claims = [
        claim(side, bound * (1 + way * 1e-15), by, of, row)
        for of, row, by, bound in sizes
        for side, way in (("at least", -1), ("at most", 1))
    ]
    box = [coordinate(one, -1, 1) for one in (*states, "u")] + [coordinate("k", 0, 9, True), coordinate("w", 0, 0)]
    box += [coordinate("p", 0, 1)] if "p" in g.at else []
    return bounds(g.content, box, claims, [["p"]] * len(claims))


def lifted(a: list, b: list, c: list, d: float, samples: int, weight: float) -> tuple[Fraction, Fraction]:
    """Return the largest row sums of a linear plant's lifted matrix, by that matrix in rationals."""
    size = len(a)
    exact_a = [[Fraction(one) for one in line] for line in a]
    column, far = [Fraction(one) for one in b], list[Fraction]()
    for _ in range(samples):
        far.append(abs(sum((Fraction(c[i]) * column[i] for i in range(size)), Fraction(0))))
        column = [sum((exact_a[i][j] * column[j] for j in range(size)), Fraction(0)) for i in range(size)]
    less = [sum((far[k - j - 1] * Fraction(weight) ** (k - j) for j in range(k)), Fraction(0)) for k in range(samples)]
    return max(less), max(less) + abs(Fraction(d))


def rows_of(rng: np.random.Generator) -> tuple[Forged, dict]:
    """Return row sums of a plant of positive numbers, for which the recursion is exact, and what is changed of it."""
    size, samples, weight = int(rng.integers(1, 4)), int(rng.integers(2, 9)), float(rng.choice([0.5, 1.0, 1.25]))
    a, b, c = (rng.integers(1, 9, shape) / 16 for shape in ((size, size), size, size))
    d = float(rng.integers(1, 9) / 4)
    made = (a.tolist(), b.tolist(), c.tolist(), d)
    base = slopes(plant(*made), *made)
    less, most = lifted(*made, samples, weight)
    return base, {"samples": samples, "weight": weight, "r": less, "p": most, "made": made}


def rows(base: Forged, samples: int, weight: float, r: float, p: float) -> Forged:
    """Return a certificate of row sums."""
    statement = {"bounds": base.name, "samples": samples, "weight": h(weight), "r": h(r), "p": h(p)}
    return Forged("rows", statement, rests_on=[base])


def of_rows(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Row sums that are larger, of a plant with more states or inputs than were looked at."""
    while count > 0:
        base, at = rows_of(rng)
        n, weight, made = at["samples"], at["weight"], at["made"]
        r, p = (float(at[name]) * (1 + 1e-12) for name in "rp")
        yield rows(base, n, weight, float(at["r"]) * (1 - 1e-9), p)
        yield rows(base, n, weight, r, float(at["p"]) * (1 - 1e-9))
        yield rows(base, n + 1, weight, *(float(one) * (1 - 1e-9) for one in lifted(*made, n + 1, weight)))
        yield rows(base, n, -weight, r, p)
        fewer = base.copy()
        fewer.statement["claims"] = [one for one in fewer.statement["claims"] if one["by"] != "x0"]
        fewer.proof["trees"] = fewer.proof["trees"][: len(fewer.statement["claims"])]
        yield rows(fewer, n, weight, r / 1e3, p)
        one_side = base.copy()
        one_side.statement["claims"] = [one for one in one_side.statement["claims"] if one["is"] == "at least"]
        one_side.proof["trees"] = one_side.proof["trees"][: len(one_side.statement["claims"])]
        yield rows(one_side, n, weight, 0.0, 0.0)
        other = plant(*made, more="p")
        yield rows(slopes(other, *made), n, weight, r, p)
        count -= 7


def of_funnels(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Funnels that a campaign leaves: bands too tight, and other plans, references, noise, gains and starts."""
    while count > 0:
        for one in left(rng, funnel(rng)):
            yield one
            count -= 1


def of_laws(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Laws that learn otherwise than is said."""
    while count > 0:
        for wrong in LAWS:
            n = int(rng.integers(3, 7))
            yield law(n, wrong, float(rng.integers(1, 16) / 16))
            count -= 1


def of_identities(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Sides that differ in one number by its last digit."""
    for turn in range(count):
        a, b = (float(one) / 4 for one in rng.integers(1, 20, 2))
        g = Drawn({"x": ["x", "u"]})
        x, u = g.at["x"], g.at["u"]
        left = g.put("mul", g.put("add", x, g.scaled(a, u)), g.put("add", x, g.scaled(b, u)))
        if turn % 3 == 1:  # (x^2 - u^2)/(x - u)
            left = g.put("div", g.put("sub", g.put("sq", x), g.put("sq", u)), g.put("sub", x, u))
        if turn % 3 == 2:
            left = g.put("mul", g.put("sin", x), left)
        terms = [(1.0, g.put("sq", x)), (a + b, g.put("mul", x, u)), (a * b, g.put("sq", u))]
        if turn % 3 == 1:
            terms = [(1.0, x), (1.0, u)]
        which = int(rng.integers(len(terms)))
        scaled = [g.scaled(up(weight) if i == which else weight, node) for i, (weight, node) in enumerate(terms)]
        right = g.sum(*scaled)
        if turn % 3 == 2:
            right = g.put("mul", g.put("sin", x), right)
        graph = g.gives("left", left).gives("right", right).content
        point = [Fraction(3), Fraction(2)]
        if turn % 3 != 2:
            at = values(graph, point)
            assert at["left", 0, 0] != at["right", 0, 0]
        pairs = [[["left", 0, 0], ["right", 0, 0]]]
        if turn % 5 == 4 and turn % 3 != 2:
            pairs = [[["left", 0, 0, "x"], ["right", 0, 0, "x"]], [["left", 0, 0, "u"], ["right", 0, 0, "u"]]]
        yield Forged("identity", {"graph": hashed(graph), "says": "They are.", "equal": pairs}, {}, [graph])


def of_numbers(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Relations that are false by 1e-30."""
    tiny = Fraction(1, 10**30)
    for turn in range(count):
        a, b = (Fraction(int(p), int(q)) for p, q in rng.integers(1, 99, (2, 2)))
        op = "+-*/"[turn % 4]
        value = {"+": a + b, "-": a - b, "*": a * b, "/": a / b}[op]
        sign, off = [("=", tiny), ("<", 0), ("<=", -tiny), (">", 0), (">=", tiny), ("=", -tiny)][turn % 6]
        yield numbers({"a": str(a), "b": str(b)}, [sign, [op, "a", "b"], str(value + off)])


SAYS = {
    "relative_degree_1": ("relative degree", "1"), "no_filter": ("the law filters its plan", "0"),
    "plan_alone": ("the law's input depends on the measured output", "0"),
    "same_but_for_the_input": ("starts are drawn anew", "0"), "no_noise": ("bound of the noise of x", "0"),
    "no_actuator": ("states that an actuator adds", "0"),
    "first_plan": ("samples at which the first plan is no finite number", "0"),
    "every_sample_reached": ("least probability that a sample is reached", "1/2"),
    "positive_estimate": ("phi(k,1)", "1/3"), "positive_gain": ("least learning gain", "1/4"),
    "starts_given": ("the law places where trials begin", "0"), "scope_holds_disturbances": ("disturbances", "0"),
}  # fmt: skip


def setting(name: str, value: str | None = None) -> Forged:
    """Return the certificate of a premise about settings."""
    fact, usual = SAYS[name]
    return numbers({fact: value or usual}, ["=", fact, value or usual])


def settings(*names: str) -> dict[str, Forged]:
    return {name: setting(name) for name in names}


ALIKE = ("same_but_for_the_input", "no_noise", "no_actuator", "plan_alone", "no_filter", "relative_degree_1")


def theorems(rng: np.random.Generator) -> Iterator[tuple[str, dict[str, Forged]]]:
    """Give theorems with true premises, near the edge of their relations."""
    g = Drawn({"x": ["x"], "u": ["u"]})
    node = g.put("add", g.put("sin", g.at["x"]), g.scaled(2.0, g.at["u"]))
    graph = g.gives("y", node).gives("effect", node).content
    box = [coordinate("x", -1, 1), coordinate("u", -1, 1)]
    ends = [claim(f"{side} everywhere", 2.0, "u") for side in ("at least", "at most")]
    slope = bounds(graph, box, ends, [["p"], ["p"]])
    smooth = bounds(graph, box, [claim("continuous everywhere", None)], [[]])
    pair = [[["y", 0, 0], ["y", 0, 0]]]
    form = Forged("identity", {"graph": hashed(graph), "says": "It is.", "equal": pair}, {}, [graph])
    step = Forged(
        "identity", {"graph": hashed(graph), "says": "It is.", "equal": [[["effect", 0, 0, "u"], "2"]]}, {}, [graph]
    )
    law_ = numbers({"lambda": "5", "rho": "2", "unit": "1", "eta": "1", "mu": "1", "eps": "1", "l_max": "1/8"}, ["=", "1", "1"])  # fmt: skip # noqa: E501
    yield "effect", {"slopes": step}
    yield "contraction", {"slopes": step, "gain": numbers({"low": "1/4", "high": "3/4"}, ["<", "low", "high"])}
    yield "shrinking", {"identity": form, "gain": numbers({"low": "1/4", "high": "3/2"}, ["<", "low", "high"])}
    yield "lambda_min", {"slopes": slope, "law": law_}
    yield "estimate_form", {"form": form, "law": law_}
    estimate = theorem("estimate_form", form=form, law=law_)
    learns = law(4, "", 0.75)
    rest = {"update_form": learns, "continuous_everywhere": smooth}
    rest |= settings(*ALIKE, "first_plan", "every_sample_reached", "positive_estimate")
    yield "theorem1.conclusion", {"slopes": slope, **rest, "estimate_form": estimate}
    sets, increments = funnel(rng), law(4, "", 0.25, increment=True)
    held = {"sets": sets, "update_form": increments}
    held |= settings("relative_degree_1", "no_filter", "plan_alone", "positive_gain", "starts_given")
    yield "increment_funnel", held
    whole = theorem("increment_funnel", **held)
    ends_ = {"increment_funnel": whole, "update_form": increments, "continuous_everywhere": smooth}
    yield "increment_limit", ends_ | settings(*ALIKE, "first_plan", "every_sample_reached")
    base, at = rows_of(rng)
    while not at["r"] * 2 < at["made"][3]:
        base, at = rows_of(rng)
    sums = rows(base, at["samples"], at["weight"], *(float(at[name]) * (1 + 1e-12) for name in "rp"))
    yield "increments", {"rows": sums, "law": law_, "follows": sets, **settings(*ALIKE, "positive_estimate", "scope_holds_disturbances")}  # fmt: skip # noqa: E501


def of_theorems(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Theorems with premises that are swapped, missing, of others, or say something else."""
    found = list(theorems(rng))
    everything = {of: one for _, premises in found for of, one in premises.items()}
    for name, premises in found:
        for of, one in premises.items():
            yield theorem(name, **{key: it for key, it in premises.items() if key != of})
            yield theorem(name, **premises, **{f"{of}2": one})
            for other, another in everything.items():
                if another.kind != one.kind or (other in SAYS and of in SAYS and other != of):
                    if of == "gain" and another.kind in ("numbers", "range"):
                        continue
                    if of != "scope_holds_disturbances":
                        yield theorem(name, **(premises | {of: another}))
        for of, value in [("relative_degree_1", "2"), *((one, "1") for one in SAYS if SAYS[one][1] == "0"),
                          ("positive_estimate", "-1/9"), ("every_sample_reached", "0"), ("positive_gain", "-1")]:  # fmt: skip # noqa: E501
            if of in premises and of != "scope_holds_disturbances":
                yield theorem(name, **(premises | {of: setting(of, value)}))


EDGES = [
    ("contraction", "gain", {"low": "1/4", "high": "1"}), ("contraction", "gain", {"low": "0", "high": "1/2"}),
    ("shrinking", "gain", {"low": "1/4", "high": "2"}), ("shrinking", "gain", {"low": "-1", "high": "1"}),
    ("lambda_min", "law", {"lambda": "4", "rho": "2", "unit": "1"}),
    ("estimate_form", "law", {"eta": "1001/1000", "mu": "1", "eps": "1"}),
    ("estimate_form", "law", {"eta": "1", "mu": "0", "eps": "1"}),
    ("estimate_form", "law", {"eta": "0", "mu": "1", "eps": "1"}),
    ("estimate_form", "law", {"eta": "1", "mu": "1"}), ("lambda_min", "law", {"lambda": "9", "rho": "2"}),
]  # fmt: skip


def at_the_edge(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Theorems whose numbers just fail."""
    found = dict(theorems(rng))
    for name, of, facts in EDGES:
        yield theorem(name, **(found[name] | {of: numbers(facts, ["=", "1", "1"])}))
    kink = Drawn({"x": ["x"], "u": ["u"]})
    other = kink.gives("y", kink.put("fabs", kink.at["u"])).content
    box = [coordinate("x", -1, 1), coordinate("u", -1, 1)]
    smooth = bounds(other, box, [claim("continuous everywhere", None)], [[]])
    yield theorem("theorem1.conclusion", **(found["theorem1.conclusion"] | {"continuous_everywhere": smooth}))
    for gain, name in ((1.0, "theorem1.conclusion"), (0.0, "increment_limit")):
        yield theorem(
            name, **(found[name] | {"update_form": law(4, "", gain, increment=name != "theorem1.conclusion")})
        )
        yield theorem(
            name, **(found[name] | {"update_form": law(4, "", 0.25, increment=name == "theorem1.conclusion")})
        )


def of_ranges(rng: np.random.Generator, count: int) -> Iterator[Forged]:
    """Ranges that are left somewhere."""
    rows = {"sin": (-1, 1), "cos": (-1, 1), "tanh": (-1, 1), "sign": (-1, 1), "erf": (-1, 1)}
    for turn in range(count):
        op = sorted(rows)[turn % len(rows)]
        a = float(rng.integers(1, 9))
        g = Drawn({"x": ["x"]})
        node = g.put("add", g.scaled(a, g.put(op, g.at["x"])), g.number(a))
        if turn % 3 == 1:
            node = g.put("if_else_zero", g.put("lt", g.number(0.0), g.at["x"]), g.put("add", node, g.number(1.0)))
        graph = g.gives("y", node).content
        reached = values(graph, [1.5707963267948966 if op == "sin" else 40.0 if op != "cos" else 6.283185307179586])
        top = float(reached["y", 0, 0])
        low, high = (-1.0, top * (1 - 1e-9)) if turn % 2 else (1e-9, top + 3)
        statement = {"graph": hashed(graph), "says": "It does.", "of": "y", "low": h(low), "high": h(high)}
        yield Forged("range", statement, {}, [graph])


FAMILIES = {
    one.__name__: (one, count)
    for one, count in (
        (of_random_graphs, 400), (of_curves, 400), (of_rows, 105), (of_funnels, 100), (of_laws, 100),
        (of_identities, 100), (of_numbers, 100), (of_theorems, 100), (at_the_edge, 14), (of_ranges, 50),
    )
}  # fmt: skip
