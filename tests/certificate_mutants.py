"""True certificates, random changes of them, and oracles that look whether what is still accepted is true."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from falsehoods import curves, rows, rows_of, sought, theorems
from forging import Forged, bounds, claim, hashed, numbers, theorem, values
from learned_by_hand import law
from small_funnels import funnel, number

from verification.checker.interval import RULES

CLASSES = ("numbers", "operations", "splits", "methods", "quantifiers", "hashes")
OPS = [*(op for op in RULES if op != "flat"), "inv", "twice", "assign", "tan", "hypot", "if_else_zero", "constpow"]
WORDS = ["above", "at least", "below", "at most", "continuous", "at least everywhere", "continuous everywhere"]
SIGNS = ["<", "<=", "=", ">", ">="]


def seeds(rng: np.random.Generator) -> Iterator[Forged]:
    """Give true certificates of every kind that speaks of graphs and numbers."""
    for graph, box, along, best, side in curves(rng):
        if side == "gone":
            continue
        off = 1e-4 * max(1.0, abs(float(best)))
        bound, word = (float(best) - off, "at least") if side == "low" else (float(best) + off, "at most")
        yield bounds(graph, box, [claim(word, bound, along)], [sought(graph, box, along, bound, side)[0]])
    base, at = rows_of(rng)
    yield rows(base, at["samples"], at["weight"], *(float(at[name]) * (1 + 1e-12) for name in "rp"))
    yield funnel(rng)
    yield funnel(rng)
    yield law(4, "", 0.5)
    yield law(4, "", 0.25, increment=True)
    yield numbers({"a": "1/3", "b": "2/7", "c": "0x1.8000000000000p+0"}, ["<", ["*", "a", "b"], ["/", "c", "5"]],
                  [">=", ["max", "a", "b"], "1/3"], ["=", ["+", "a", "b"], "13/21"])  # fmt: skip
    for name, premises in theorems(rng):
        if name in TRUE or name == "increment_funnel":
            yield theorem(name, **premises)
            yield from (one for one in premises.values() if one.kind == "identity")
    graph = next(curves(rng))[0] | {"nodes": [["input", 0], ["sin", 0], ["const", (3.0).hex()], ["mul", 1, 2]]}
    graph["outputs"][0]["entries"][0][2] = 3
    said = {"graph": hashed(graph), "says": "It does.", "of": "y", "low": (-3.5).hex(), "high": (3.5).hex()}
    yield Forged("range", said, {}, [graph])


TRUE: dict[str, Callable[[dict[str, Fraction]], bool]] = {
    "contraction": lambda f: all(0 < f["slopes"] * f[f"gain: {end}"] < 2 for end in ("low", "high")),
    "shrinking": lambda f: f["gain: low"] > 0 and f["gain: high"] < 2,
    "estimate_form": lambda f: 0 < f["law: eta"] <= 1 and f["law: mu"] > 0 and f["law: eps"] > 0,
}
"""Theorems of which the numbers are looked at here, by a rule of its own."""


def slots(content: Any) -> Iterator[tuple[Any, Any]]:
    """Go through places of data at which something stands that is no list and no record."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, one in list(pairs):
        if isinstance(one, (dict, list)):
            yield from slots(one)
        else:
            yield content, key


def is_number(text: object) -> bool:
    return isinstance(text, str) and bool(re.fullmatch(r"-?(0x.*|\d+(/\d+)?)", text))


def other_number(rng: np.random.Generator, text: str, all_: list[str]) -> str:
    """Return another number, near or far."""
    way = int(rng.integers(8))
    if "0x" not in text:
        value = Fraction(text)
        if way == 6:
            return str(all_[rng.integers(len(all_))])
        return str(
            [
                value + 1,
                -value,
                value * 2,
                value / 2,
                value + Fraction(1, 10**30),
                value - Fraction(1, 10**30),
                value,
                0 * value,
            ][way]
        )
    value = number(text)
    if way == 6:
        return str(all_[rng.integers(len(all_))])
    return float([np.nextafter(value, 9e9), np.nextafter(value, -9e9), value * (1 + 1e-9), value * (1 - 1e-9), -value,
                  value + 1, value, value * 1.5 + 0.1][way]).hex()  # fmt: skip


def mutate(rng: np.random.Generator, one: Forged, kind: str) -> Forged | None:
    """Return a certificate with one random change of a class, None where it has nothing of that class."""
    other = one.copy()
    part = other if not other.rests_on or rng.random() < 0.4 else other.rests_on[rng.integers(len(other.rests_on))]
    told = globals()[f"_{kind}"](rng, part)
    if told is None:
        return None
    if kind != "hashes":
        relink(other, one)
    return None if other.files() == one.files() else other


def relink(other: Forged, one: Forged) -> None:
    """Put hashes right again after a change."""
    for after, before in zip(other.rests_on, one.rests_on, strict=True):
        relink(after, before)
    names = {hashed(before): hashed(after) for after, before in zip(other.graphs, one.graphs, strict=True)}
    names |= {before.name: after.name for after, before in zip(other.rests_on, one.rests_on, strict=True)}
    for container, key in slots(other.statement):
        if isinstance(container[key], str) and container[key] in names:
            container[key] = names[container[key]]


def _numbers(rng: np.random.Generator, part: Forged) -> bool | None:
    of = [part.statement, part.proof, *(graph["nodes"] for graph in part.graphs)]
    places = [(at, key) for one in of for at, key in slots(one) if is_number(at[key])]
    if not places:
        return None
    at, key = places[rng.integers(len(places))]
    at[key] = other_number(rng, at[key], [at[key] for at, key in places])
    return True


def _operations(rng: np.random.Generator, part: Forged) -> bool | None:
    if part.kind == "numbers":
        formulas = [at for one in part.statement["holds"] for at in _lists(one)]
        at = formulas[rng.integers(len(formulas))]
        at[0] = str(rng.choice([*"+-*/", "min", "max", *SIGNS]))
        return True
    nodes = [row for graph in part.graphs for row in graph["nodes"] if row[0] not in ("const",)]
    if not nodes:
        return None
    row = nodes[rng.integers(len(nodes))]
    if row[0] == "input" or rng.random() < 0.4:
        row[1 + int(rng.integers(len(row) - 1))] = int(rng.integers(12))
    else:
        row[0] = str(rng.choice(OPS))
    return True


def _lists(given: Any) -> Iterator[list[Any]]:
    if isinstance(given, list):
        yield given
        for one in given:
            yield from _lists(one)


def _splits(rng: np.random.Generator, part: Forged) -> bool | None:
    if part.kind == "funnel":
        rows_ = part.proof[str(rng.choice(["inputs", "targets"]))]
        if rng.random() < 0.3:
            part.proof["apart"] = [int(one) for one in rng.integers(0, 12, 2)]
            return True
    elif part.kind == "bounds":
        rows_ = part.proof["trees"][rng.integers(len(part.proof["trees"]))]
    elif part.kind == "learned":
        found = part.graphs[0]["outputs"][rng.integers(len(part.graphs[0]["outputs"]))]
        rows_ = found["entries"]
    else:
        return None
    if not rows_:
        return None
    i, j = rng.integers(len(rows_), size=2)
    match int(rng.integers(5)):
        case 0:
            del rows_[i]
        case 1:
            rows_.insert(i, rows_[j])
        case 2:
            rows_[i], rows_[j] = rows_[j], rows_[i]
        case 3:
            rows_[i] = [int(rng.integers(2)), float(rng.integers(-3, 4)).hex()]
        case 4 if isinstance(rows_[i], list):
            rows_[i] = rows_[i][::-1]
    return True


def _methods(rng: np.random.Generator, part: Forged) -> bool | None:
    if part.kind != "bounds":
        if rng.random() < 0.3:
            part.kind = str(rng.choice(["bounds", "funnel", "identity", "range", "learned", "rows", "numbers", "sets"]))
            return True
        return None
    rows_ = part.proof["trees"][rng.integers(len(part.proof["trees"]))]
    leaves = [i for i, one in enumerate(rows_) if isinstance(one, str)]
    if not leaves:
        return None
    rows_[leaves[rng.integers(len(leaves))]] = str(rng.choice(["p", "m", "v", "x", ""]))
    return True


def _quantifiers(rng: np.random.Generator, part: Forged) -> bool | None:
    s = part.statement
    match part.kind:
        case "bounds":
            one, axis = s["claims"][rng.integers(len(s["claims"]))], s["set"][rng.integers(len(s["set"]))]
            match int(rng.integers(6)):
                case 0:
                    one["is"] = str(rng.choice(WORDS))
                case 1:
                    one["by"] = [None, *(axis_["name"] for axis_ in s["set"])][rng.integers(len(s["set"]) + 1)]
                case 2:
                    axis["whole"] = not axis["whole"]
                case 3:
                    end = str(rng.choice(["low", "high"]))
                    axis[end] = (number(axis[end]) + float(rng.normal()) * 0.5).hex()
                case 4:
                    axis["low"], axis["high"] = axis["high"], axis["low"]
                case 5:
                    end = str(rng.choice(["low", "high"]))
                    axis[end] = (number(axis[end]) * 0.9).hex()
        case "numbers":
            one = s["holds"][rng.integers(len(s["holds"]))]
            one[0] = str(rng.choice(SIGNS))
        case "rows":
            s["samples"] += int(rng.integers(-2, 3))
        case "learned":
            key = str(rng.choice(["samples", "varying", "increment", "begins"]))
            s[key] = {
                "samples": s["samples"] - 1,
                "varying": not s["varying"],
                "increment": not s["increment"],
                "begins": {},
            }[key]
        case "funnel":
            key = str(rng.choice(["start", "bands", "others", "noise", "gain"]))
            for at, place in slots({key: s[key]}):
                if rng.random() < 0.5 and is_number(at[place]):
                    changed = (number(at[place]) * float(rng.choice([0.9, 1.1, 0.99, 1.01]))).hex()
                    if isinstance(s[key], str):
                        s[key] = changed
                    else:
                        at[place] = changed
        case "range":
            s["low"], s["high"] = (number(s[end]) * float(rng.choice([0.5, 0.9, 1.1])) for end in ("low", "high"))
            s["low"], s["high"] = s["low"].hex(), s["high"].hex()
        case "identity":
            pair = s["equal"][rng.integers(len(s["equal"]))]
            pair[rng.integers(2)] = [["y", 0, 0], ["y", 0, 0, "u"], ["effect", 0, 0, "x"], "2", "3"][rng.integers(5)]
        case "theorem":
            names = list(s["premises"])
            i, j = rng.integers(len(names), size=2)
            s["premises"][names[i]], s["premises"][names[j]] = s["premises"][names[j]], s["premises"][names[i]]
    return True


def _hashes(rng: np.random.Generator, part: Forged) -> bool | None:
    places = [(at, key) for at, key in slots(part.statement) if isinstance(at[key], str) and len(at[key]) == 64]
    if not places:
        part.statement = {**part.statement, "says": "Another."} if "says" in part.statement else part.statement
        part.statement["graph"] = hashed(1)
        return True
    at, key = places[rng.integers(len(places))]
    text, i = at[key], int(rng.integers(64))
    digit = str(rng.choice(list("0123456789abcdef")))
    at[key] = [
        text[:i] + digit + text[i + 1 :],
        hashed(i),
        text[::-1],
        text.upper(),
        text[:i],
        text + digit,
        "../" + text,
        "index",
    ][rng.integers(8)]
    return True


def true(rng: np.random.Generator, one: Forged) -> bool:
    """Tell whether what a certificate states is seen to be true, by values and matrices alone."""
    if one.kind == "theorem":
        name, facts = one.statement["theorem"], dict[str, Fraction]()
        of = {premise.name: premise for premise in one.rests_on}
        for key, hash_ in one.statement["premises"].items():
            premise = of[hash_]
            if premise.kind == "numbers":
                facts |= {f"{key}: {fact}": exact(given) for fact, (given, _) in premise.statement["facts"].items()}
            if premise.kind == "identity" and isinstance(premise.statement["equal"][0][1], str):
                facts[key] = exact(premise.statement["equal"][0][1])
        return all(true(rng, premise) for premise in of.values()) and (name not in TRUE or TRUE[name](facts))
    return bool(globals()[f"_true_{one.kind}"](rng, one))


def exact(text: str) -> Fraction:
    return Fraction(number(text)) if "0x" in text else Fraction(text)


def _points(rng: np.random.Generator, set_: list[dict], count: int = 80) -> Iterator[np.ndarray]:
    low, high = (np.array([number(one[end]) for one in set_]) for end in ("low", "high"))
    whole = np.array([one["whole"] for one in set_])
    for i in range(count):
        share = rng.random(len(set_)) if i % 4 else rng.integers(0, 2, len(set_)).astype(float)
        yield np.where(whole, np.rint(low + share * (high - low)), low + share * (high - low))


def _true_bounds(rng: np.random.Generator, one: Forged) -> bool:
    graph, set_ = one.graphs[0], one.statement["set"]
    names = [axis["name"] for axis in set_]
    for said in one.statement["claims"]:
        for point in _points(rng, set_):
            if said["is"].endswith("everywhere"):
                point = np.where([axis["whole"] for axis in set_], point, point * 10 + rng.normal(size=len(point)))
            value = values(graph, point.tolist())[tuple(said["of"])]
            if value is None:
                return False
            if said["is"].startswith("continuous"):
                continue
            if said["by"] is not None:
                i = names.index(said["by"])
                other = point.copy()
                other[i] = rng.uniform(number(set_[i]["low"]), number(set_[i]["high"]))
                if abs(other[i] - point[i]) < 1e-6:
                    continue
                after = values(graph, other.tolist())[tuple(said["of"])]
                value = (after - value) / (other[i] - point[i])
            bound, room = number(said["bound"]), 1e-8 * max(1.0, abs(value))
            if not (value >= bound - room if said["is"].startswith(("above", "at least")) else value <= bound + room):
                return False
    return True


def _true_numbers(rng: np.random.Generator, one: Forged) -> bool:
    facts = {name: exact(given) for name, (given, _) in one.statement["facts"].items()}

    def of(given: Any) -> Fraction:
        if isinstance(given, str):
            return facts[given] if given in facts else exact(given)
        a, b = of(given[1]), of(given[2])
        ops = {"+": a + b, "-": a - b, "*": a * b, "min": min(a, b), "max": max(a, b)}
        return a / b if given[0] == "/" else ops[given[0]]

    held = []
    for sign, left, right in one.statement["holds"]:
        a, b = of(left), of(right)
        held.append({"<": a < b, "<=": a <= b, "=": a == b, ">": a > b, ">=": a >= b}[sign])
    return all(held)


def _true_identity(rng: np.random.Generator, one: Forged) -> bool:
    graph = one.graphs[0]
    for _ in range(10):
        point = [Fraction(int(a), 7) for a in rng.integers(-20, 20, 8)]

        def side(given: Any, point: list = point) -> float | None:
            if isinstance(given, str):
                return float(exact(given))
            near = [float(v) for v in point]
            if len(given) == 3:
                return values(graph, near)[tuple(given)]
            label = [name for port in graph["inputs"] for name in port["labels"]].index(given[3])
            step = [[v + way * 1e-5 * (i == label) for i, v in enumerate(near)] for way in (-1, 1)]
            before, after = (values(graph, at)[tuple(given[:3])] for at in step)
            return None if before is None or after is None else (after - before) / 2e-5

        for left, right in one.statement["equal"]:
            a, b = side(left), side(right)
            if a is not None and b is not None and abs(a - b) > 1e-5 * max(1.0, abs(a)):
                return False
    return True


def _true_range(rng: np.random.Generator, one: Forged) -> bool:
    low, high = number(one.statement["low"]), number(one.statement["high"])
    for x in [*np.linspace(-30, 30, 400), 1e9, -1e9, 0.0]:
        found = [
            v for key, v in values(one.graphs[0], [float(x)]).items() if key[0] == one.statement["of"] and v is not None
        ]
        if any(not low - 1e-9 <= v <= high + 1e-9 for v in found):
            return False
    return True


def _true_rows(rng: np.random.Generator, one: Forged) -> bool:
    """Look at row sums along random trajectories of slopes that are met in the set."""
    base, s = one.rests_on[0], one.statement
    graph, set_ = base.graphs[0], base.statement["set"]
    names = [axis["name"] for axis in set_]
    states = [i for i, name in enumerate(names) if name.startswith("x")]
    u, weight = names.index("u"), number(s["weight"])
    results = [*(("x_next", i, 0) for i in range(len(states))), ("y", 0, 0)]

    def slope_at() -> np.ndarray:
        point = next(iter(_points(rng, set_, 2)))
        found = np.empty((len(results), len(states) + 1))
        for j, i in enumerate([*states, u]):
            pair = [point.copy(), point.copy()]
            pair[0][i], pair[1][i] = number(set_[i]["low"]) * 0.9, number(set_[i]["high"]) * 0.9
            pair[1][i] += 1e-3 * (pair[0][i] == pair[1][i])
            before, after = (values(graph, at.tolist()) for at in pair)
            found[:, j] = [(after[of] - before[of]) / (pair[1][i] - pair[0][i]) for of in results]
        return found

    for _ in range(3):
        columns: list[np.ndarray] = []
        for _k in range(s["samples"]):
            at = slope_at()
            less = sum(abs(float(at[-1, :-1] @ one_)) for one_ in columns)
            if (
                less > number(s["r"]) * (1 + 1e-9) + 1e-12
                or less + abs(at[-1, -1]) > number(s["p"]) * (1 + 1e-9) + 1e-12
            ):
                return False
            columns = [weight * at[:-1, :-1] @ one_ for one_ in columns] + [weight * at[:-1, -1]]
    return _true_bounds(rng, base)


def _true_learned(rng: np.random.Generator, one: Forged) -> bool:
    graph, s = one.graphs[0], one.statement
    least, most, n = float(exact(s["least"])), float(exact(s["most"])), s["samples"]
    for _ in range(30):
        last, far = (int(a) for a in rng.integers(0, n + 1, 2))
        if not s["varying"]:
            last = far = n
        given: list[Any] = []
        r, e = rng.normal(size=(2, n + 9))
        old_r, old_e = rng.normal(size=(2, n + 9))
        begun = rng.random() < 0.8
        for port in graph["inputs"]:
            for _row, k in port["places"]:
                name = port["name"]
                given.append({
                    "memory_u": float(rng.normal()), "memory_m": float(rng.normal()), "r": r[k],
                    "y": r[k] - e[k] if k <= last else None, "e": e[k] if k <= last else None,
                    "reached": float(k <= last),
                    "memory_old": old_r[k] - old_e[k] if k <= far and begun else None,
                    "memory_was": float(k <= far and begun),
                }[name])  # fmt: skip
        found = values(graph, given)
        if any(v is None for (name, _, _), v in found.items() if name not in ("next_memory_old", "next_memory_was")):
            return False
        for k in range(n):
            move = found["plan_next", 0, k] - found["plan", 0, k]
            if k + 1 > last:
                if move != 0:
                    return False
                continue
            error = e[k + 1] - (e[k] if s["increment"] else 0.0)
            ends = sorted((least * error, most * error))
            if not ends[0] - 1e-9 <= move <= ends[1] + 1e-9:
                return False
    return True


def _true_funnel(rng: np.random.Generator, one: Forged) -> bool:
    """Look whether campaigns of vertices on the graph itself stay in the bands."""
    graph, s = one.graphs[0], one.statement
    plan, reference = ([number(v) for v in s[name]] for name in ("plan", "reference"))
    n, noise, gain = len(plan), number(s["noise"]), number(s["gain"])
    start, others = [number(v) for v in s["start"][0]], s["others"]["w"]
    bands = [[number(v) for v in band] for band in s["bands"]]
    for campaign in range(8):
        u = list(plan)
        for _ in range(12):
            x = start[rng.integers(2)] if campaign % 2 else start[campaign // 4]
            moved = list(u)
            ends = rng.integers(0, 2, n + 1) if campaign % 4 > 1 else np.arange(n + 1) % 2
            for k in range(n):
                if not (
                    bands[0][0] - 1e-9 <= x <= bands[0][1] + 1e-9 and bands[1][0] - 1e-9 <= u[k] <= bands[1][1] + 1e-9
                ):
                    return False
                w = number(others[min(k, len(others) - 1)][campaign % 2 if campaign > 3 else rng.integers(2)])
                found = values(graph, [x, w, float(k), u[k]])
                error = reference[k + 1] - reference[k] - found["gained", 0, 0] - 2 * noise * (2 * int(ends[k]) - 1)
                moved[k] = u[k] + gain * error * (1 if campaign % 3 else rng.random())
                x = found["next_0", 0, 0]
            if not bands[0][0] - 1e-9 <= x <= bands[0][1] + 1e-9:
                return False
            u = moved
    return True
