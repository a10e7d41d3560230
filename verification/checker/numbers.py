"""Statements about numbers alone, in rational arithmetic: settings, gains, limits, and theorems about what is shown."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import NamedTuple

from flint import fmpq

from verification.checker.reading import Rejected, exact, need, record, rows, text, word

Facts = Mapping[str, fmpq]
_MADE: Mapping[str, Callable[[fmpq, fmpq], fmpq]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "min": min, "max": max
}  # fmt: skip
_COMPARED: Mapping[str, Callable[[fmpq, fmpq], bool]] = {
    "<": operator.lt, "<=": operator.le, "=": operator.eq, ">": operator.gt, ">=": operator.ge
}  # fmt: skip


def value(given: object, facts: Facts, depth: int = 0) -> tuple[fmpq, str]:
    """Return the value of a formula, and how it is written: a fact's name, a number, or ``[operation, a, b]``."""
    need(depth < 60, "a formula is nested too deep")
    if isinstance(given, str):
        return (facts[given], given) if given in facts else (exact(given), given)
    op, a, b = rows(given, 3)
    need(op in _MADE, f"a formula must be made of {', '.join(_MADE)}, got {op!r:.20}")
    (left, of_left), (right, of_right) = value(a, facts, depth + 1), value(b, facts, depth + 1)
    need(op != "/" or right != 0, "a formula divides by 0")
    return _MADE[op](left, right), f"({of_left} {op} {of_right})"


def related(relations: object, facts: Facts) -> str:
    """Check relations ``[sign, left, right]``, of which there is one at least, and return how they are written."""
    said = []
    for relation in rows(relations):
        sign, left, right = rows(relation, 3)
        need(sign in _COMPARED, f"a relation must be one of {', '.join(_COMPARED)}, got {sign!r:.20}")
        (a, of_a), (b, of_b) = value(left, facts), value(right, facts)
        need(_COMPARED[sign](a, b), f"{of_a} {sign} {of_b} is false: {a} and {b}"[:200])
        said.append(f"{of_a} {sign} {of_b}")
    need(said, "there must be a relation")
    return "; ".join(said)


def check(statement: object) -> tuple[str, Facts]:
    """Check what settings say: relations between numbers that have names and units; return them too."""
    says, given, relations = record(statement, "says", "facts", "holds")
    need(isinstance(given, dict), "facts must be a record of numbers with their units")
    pairs = {word(name): rows(one, 2) for name, one in sorted(given.items())}
    need(not any(name[:1] in "+-.0123456789" for name in pairs), "a fact must have a name that is no number")
    facts = {name: exact(number) for name, (number, _) in pairs.items()}
    named = ", ".join(f"{name} = {number} {word(unit)}".rstrip() for name, (number, unit) in pairs.items())
    return f"{text(says)} For {related(relations, facts)}, with {named}.", facts


class Theorem(NamedTuple):
    """What a theorem says, the kinds of its premises by name, and relations between numbers that are shown of them."""

    says: str
    premises: Mapping[str, str]
    relations: list[object]


def _of(kinds: str) -> Mapping[str, str]:
    """Return the kinds of premises by name, written ``name: kind``; what has none is a statement about numbers."""
    pairs = [one.split(":") for one in kinds.split()]
    return {name: kind[0] if kind else "numbers" for name, *kind in pairs}


_SIZE = ["max", "slopes: high", ["-", "0", "slopes: low"]]
_REACH = ["*", ["*", "law: rho", "law: unit"], _SIZE]
_ALIKE = "same_but_for_the_input no_noise no_actuator plan_alone no_filter relative_degree_1"
_EFFECT = "slopes: d effect[0,0] / d u"
_LIMIT = "update_form:learned every_sample_reached continuous_everywhere:bounds first_plan"
SETTINGS: Mapping[str, tuple[str, str, str]] = {
    "relative_degree_1": ("relative degree", "=", "1"),
    "no_filter": ("the law filters its plan", "=", "0"),
    "plan_alone": ("the law's input depends on the measured output", "=", "0"),
    "same_but_for_the_input": ("starts are drawn anew", "=", "0"),
    "no_noise": ("bound of the noise of", "=", "0"),
    "no_actuator": ("states that an actuator adds", "=", "0"),
    "first_plan": ("samples at which the first plan is no finite number", "=", "0"),
    "every_sample_reached": ("least probability that a sample is reached", ">", "0"),
    "positive_estimate": ("phi(k,1)", ">", "0"),
    "positive_gain": ("least learning gain", ">=", "0"),
    "starts_given": ("the law places where trials begin", "=", "0"),
}
"""What premises about settings must say: of a fact whose name begins so, and of every other where it is ``=``."""
THEOREMS: Mapping[str, Theorem] = {
    "effect": Theorem("The input reaches the effect.", _of("slopes:identity"), [[">", ["*", _EFFECT, _EFFECT], "0"]]),
    "contraction": Theorem(
        "For every gain from low to high, 1 - gain b lies between -1 and 1, b the effect's slope along the input.",
        _of("slopes:identity gain:range|numbers"),
        [
            [sign, ["*", _EFFECT, f"gain: {end}"], edge]
            for end in ("low", "high")
            for sign, edge in ((">", "0"), ("<", "2"))
        ],
    ),
    "shrinking": Theorem(
        "For every gain from low to high, 1 - gain lies between -1 and 1.",
        _of("identity:identity gain:range|numbers"),
        [[">", "gain: low", "0"], ["<", "gain: high", "2"]],
    ),
    "lambda_min": Theorem(
        "Lambda exceeds (rho b)^2/4, b the largest slope.",
        _of("slopes:bounds law"),
        [[">", "law: lambda", ["/", ["*", _REACH, _REACH], "4"]]],
    ),
    "estimate_form": Theorem(
        "The estimate moves by its formula, and the plan by that estimate.",
        _of("form:identity law"),
        [["<=", "law: eta", "1"], [">", "law: eta", "0"], [">", "law: mu", "0"], [">", "law: eps", "0"]],
    ),
    "increment_funnel": Theorem(
        "In every trial each signal stays in its band, whatever the trial lengths and whatever the law estimates.",
        _of("sets:funnel relative_degree_1 no_filter plan_alone update_form:learned positive_gain starts_given"),
        [
            ["=", "update_form: increment", "1"],
            [">=", "sets: l_max", "update_form: most"],
            [">=", "update_form: least", "0"],
        ],
    ),
    "increment_limit": Theorem(
        "With probability 1 u(k) goes to the input that gives the reference's increment, as trials go on, for every k.",
        _of(f"increment_funnel:increment_funnel {_ALIKE} {_LIMIT}"),
        [
            ["=", "update_form: increment", "1"],
            [">=", "increment_funnel: l_max", "update_form: most"],
            [">", "update_form: least", "0"],
            ["=", "continuous_everywhere: continuous", "1"],
            ["<", ["*", "update_form: most", "increment_funnel: b_high"], "2"],
        ],
    ),
    "theorem1.conclusion": Theorem(
        "With probability 1 the error of every sample goes to 0 as trials go on.",
        _of(f"slopes:bounds {_ALIKE} {_LIMIT} positive_estimate estimate_form:estimate_form"),
        [
            ["=", "update_form: increment", "0"],
            [">=", "update_form: least", "0"],
            ["=", "slopes: everywhere", "1"],
            ["=", "slopes: graph", "continuous_everywhere: graph"],
            ["=", "continuous_everywhere: continuous", "1"],
            [">", "slopes: low", "0"],
            ["<", ["*", "update_form: most", "slopes: high"], "2"],
        ],
    ),
    "increments": Theorem(
        "For every positive estimate max |u* - u| weight^k falls from trial to trial.",
        _of(f"rows:rows law {_ALIKE} positive_estimate scope_holds_disturbances follows:funnel"),
        [
            ["<", "rows: r", "rows: low"],
            ["<", ["*", "law: l_max", ["+", "rows: high", "rows: r"]], "2"],
        ],
    ),
}


def check_theorem(statement: object, shown: Mapping[str, tuple[str, str, Facts]]) -> tuple[str, Facts]:
    """Check that a theorem has its premises, each accepted, and that its relations hold between their numbers."""
    name, _ = record(statement, "theorem", "premises")
    if name not in THEOREMS:
        raise Rejected(f"a theorem must be one of {', '.join(THEOREMS)}, got {name!r:.40}")
    theorem = THEOREMS[name]
    found = {of: kind for of, (kind, _, _) in shown.items()}
    good = set(found) == set(theorem.premises) and all(
        kind in theorem.premises[of].split("|") for of, kind in found.items()
    )
    need(good, f"{name} has the premises {theorem.premises}, got {found}"[:400])
    facts = {f"{of}: {key}": number for of, (_, _, numbers) in shown.items() for key, number in numbers.items()}
    for of, (begins, sign, edge) in SETTINGS.items():
        _, _, numbers = shown.get(of, ("", "", None))
        if numbers is not None:
            about = [key for key in numbers if key.startswith(begins)]
            need(about, f"{of} must say something of {begins!r}")
            related([[sign, key, edge] for key in (numbers if sign == "=" else about)], numbers)
    own = {key.removeprefix("sets: "): number for key, number in facts.items() if key.startswith("sets: ")}
    said = related(theorem.relations, facts)
    rests = " ".join(f"({of}) {sentence}" for of, (_, sentence, _) in shown.items())
    return f"{theorem.says} For {said}. It rests on: {rests}", own
