"""Numbers, values and verdicts as short text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

import numpy as np
from markupsafe import Markup

from workbench.contracts.claim import Range, Role
from workbench.contracts.finding import Grounds, Standing
from workbench.contracts.survival import Survivals
from workbench.contracts.verdict import Verdict

STANDINGS = {
    Standing.PROVED: (
        "✓",
        "holds for all that is stated: by algebra, intervals, induction or enumeration",
    ),
    Standing.SUPPORTED: ("≈", "was tried or searched, and nothing against it was found"),
    Standing.REFUTED: ("✗", "fails: the witness was replayed, and can be again"),
    Standing.UNDECIDED: ("?", "could not be told: by this method, as a premise is not met, or as the check failed"),
}
"""The sign of every standing, and what it says of a claim."""
SURVIVED = (
    "how many survive when every setting changes by a part in 1e12, when it changes by a part in 1e6, and in single "
    "precision; exact where no bit changes, - where that was not looked at"
)
"""What the digits beside a score are."""
FEW = 5
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def shown(value: float | None) -> str:
    """Return a number in four digits, with a power of ten where it is far from one."""
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "not finite"
    digits, _, exponent = f"{value + 0.0:.4g}".partition("e")  # no zero has a sign
    digits = digits.replace("-", "−")
    return f"{digits}·10{str(int(exponent)).translate(SUPERSCRIPTS)}" if exponent else digits


def shown_value(value: object, number: Callable[[float], str] = shown) -> str:
    """Return any value of a witness or a setting as short text: of a long row, both ends."""
    if isinstance(value, str) or value is None:
        return "none" if value is None else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (np.ndarray, np.generic)):
        return shown_value(value.tolist(), number)
    if isinstance(value, Mapping):
        return f"({', '.join(f'{key} = {shown_value(inner, number)}' for key, inner in value.items())})"
    if isinstance(value, (list, tuple)):
        texts = [shown_value(one, number) for one in (value if len(value) <= FEW else [*value[:3], value[-1]])]
        if len(value) <= FEW:
            return f"[{', '.join(texts)}]"
        return f"[{', '.join(texts[:3])}, …, {texts[3]}] ({len(value)} values)"
    if isinstance(value, int):
        return str(value).replace("-", "−")
    return number(value) if isinstance(value, float) else str(value)


def survives(digits: Survivals, controller: str, metric: str) -> str:
    """Return how many digits of a score survive, as short text."""
    found = digits.get(controller, {}).get(metric)
    return "-" if found is None else found.shown


def setting(value: object) -> str:
    """Return a setting's value as text, its numbers in full."""
    return shown_value(value, lambda number: f"{number:.12g}")


def witness(verdict: Verdict) -> list[tuple[str, str]]:
    """Return a verdict's witness as pairs of text."""
    return [(str(key), shown_value(value)) for key, value in (verdict.witness or {}).items()]


def breakable(text: str) -> Markup:
    """Return a name or unit that a narrow column may break after its dots, underscores and slashes."""
    return Markup("<wbr>").join(re.findall(r"[^._/]*[._/]?", text))


def measure(value: float | None, unit: str) -> str:
    """Return a number with its unit, without one where it is of unit 1 or there is no number."""
    return f"{shown(value)} {unit}".rstrip() if value is not None and unit != "1" else shown(value)


def scope(verdict: Verdict) -> list[tuple[str, str]]:
    """Return the intervals that a proof speaks of as pairs of text."""
    return [(name, _interval(one)) for name, one in verdict.scope.items()]


def _interval(one: Range) -> str:
    unit = "" if one.unit in ("", "1") else f" {one.unit}"
    low, high = ("−∞" if one.low == -math.inf else shown(one.low)), ("∞" if one.high == math.inf else shown(one.high))
    return f"{'(' if one.low == -math.inf else '['}{low}, {high}{')' if one.high == math.inf else ']'}{unit}"


_GROUNDS = {
    Grounds.SETTINGS: "the study's own settings",
    Grounds.ALGEBRA: "exact algebra",
    Grounds.ENUMERATION: "every one of finitely many cases",
    Grounds.INDUCTION: "a step from each sample or trial to the next",
    Grounds.ENCLOSURE: "outward-rounded bounds over the whole scope",
    Grounds.RUN: "what was recorded",
    Grounds.TRIES: "draws or starts",
    Grounds.SEARCH: "the worst that a search came upon",
    Grounds.NUMERICS: "a floating-point computation without a bound of its error",
}


def evidence(verdict: Verdict) -> list[str]:
    """Return what a verdict rests on, and what it was held against, in sentences without their full stops."""
    said = []
    if verdict.standing is not Standing.UNDECIDED:
        said.append(_GROUNDS[verdict.grounds] + (f" ({verdict.tries} tries)" if verdict.tries > 1 else ""))
    if verdict.held is not None:
        said.append(
            f"held against {verdict.held.tries} trials and plans, least room "
            f"{measure(verdict.held.margin, verdict.bound_unit or verdict.unit)}"
        )
    if verdict.standing is Standing.PROVED:
        said.append("no second program has checked this proof")
    if verdict.replayed is not None:
        said.append(f"the witness was replayed, with the margin {measure(verdict.replayed, verdict.unit)}")
    return said


def meant(verdict: Verdict) -> tuple[str, str]:
    """Return how a verdict was expected to stand, and why."""
    if verdict.expected is not None:
        return str(verdict.expected.standing), verdict.expected.why
    if verdict.role is Role.CONTROL:
        return str(Standing.REFUTED), "a negative control must be refuted"
    return "that it is not REFUTED", "nothing is said of it"
