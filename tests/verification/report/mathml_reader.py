"""An independent reader of presentation MathML: it evaluates what a person would read."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from verification.report.notation import symbol

M = "{http://www.w3.org/1998/Math/MathML}"
PAIRS = {"(": ")", "|": "|", "⌊": "⌋", "⌈": "⌉", "[": "]"}
CALLS: dict[str, Any] = {
    **{name: getattr(math, name) for name in ("exp", "sin", "cos", "tan", "sinh", "cosh", "tanh", "erf")},
    **{name: getattr(math, name) for name in ("atan2", "copysign", "fmod", "remainder", "log1p", "expm1", "hypot")},
    **{f"arc{name}": getattr(math, f"a{name}") for name in ("sin", "cos", "tan")},
    **{f"ar{name}": getattr(math, f"a{name}") for name in ("sinh", "cosh", "tanh")},
    "ln": math.log,
    "sqrt": math.sqrt,
    "floor": math.floor,
    "ceil": math.ceil,
    "abs": abs,
    "max": max,
    "min": min,
    "sign": lambda x: float(np.sign(x)),
    "erfinv": lambda x: float(ca.erfinv(x)),
}


class Reader:
    """Reads by signs and parentheses only; rows without parentheses do not group."""

    def __init__(self, known: dict[str, float]) -> None:
        self.known = {self.spelt(name): value for name, value in known.items()}
        self.left: list[Any] = []

    @staticmethod
    def spelt(name: str) -> str:
        head, below = symbol(name)
        return head.replace(" ", "\u00a0") + ("_" + ",".join(below) if below else "")

    def value(self, element: Any) -> float:
        return self.expression(self.tokens(element))

    def tokens(self, element: Any) -> list[Any]:
        tag, children = element.tag.removeprefix(M), list(element)
        if tag == "mn":
            return [("value", float(element.text))]
        if tag == "mo":
            return [element.text]
        if tag == "mi":
            return [("name", element.text)]
        if tag == "msub":
            below = "".join(part.text for part in children[1])
            return [("name", f"{children[0].text}_{below}")]
        if tag == "mfrac":
            return [("value", self.value(children[0]) / self.value(children[1]))]
        if tag == "msqrt":
            return [("value", math.sqrt(self.expression(self.spliced(children))))]
        if tag == "msup":
            return [*self.tokens(children[0]), "^", ("value", self.value(children[1]))]
        if tag == "mtable":
            return [token for row in children for token in self.spliced(list(row[0]))]
        assert tag == "mrow", tag
        signs = [child.text if child.tag == f"{M}mo" else "" for child in children]
        if signs and signs[0] == "{":
            (value, condition), (otherwise, _) = ([list(cell) for cell in row] for row in children[1])
            holds = self.expression(self.spliced(condition[1:]))
            return [("cases", self.expression(self.spliced(value if holds else otherwise)))]
        if signs and signs[0] in PAIRS and signs[-1] == PAIRS[signs[0]]:
            return [(signs[0], self.spliced(children[1:-1]))]
        return self.spliced(children)

    def spliced(self, children: list[Any]) -> list[Any]:
        return [token for child in children for token in self.tokens(child)]

    def expression(self, tokens: list[Any]) -> float:
        if len(tokens) == 1 and tokens[0][0] == "cases":
            return tokens[0][1]
        outer, self.left = self.left, list(tokens)
        value = self.alternatives()
        assert not self.left, f"left over: {self.left}"
        self.left = outer
        return value

    def ahead(self, *signs: str) -> bool:
        return bool(self.left) and isinstance(self.left[0], str) and self.left[0] in signs

    def alternatives(self) -> float:
        value = self.conjunction()
        while self.ahead("∨"):
            self.left.pop(0)
            value = float(bool(self.conjunction()) or bool(value))
        return value

    def conjunction(self) -> float:
        value = self.relation()
        while self.ahead("∧"):
            self.left.pop(0)
            value = float(bool(self.relation()) and bool(value))
        return value

    def relation(self) -> float:
        if self.ahead("¬"):
            self.left.pop(0)
            return float(not self.relation())
        value = self.sum()
        if self.ahead("<", ">", "≤", "≥", "=", "≠"):
            sign = self.left.pop(0)
            other = self.sum()
            truths = {"<": value < other, ">": value > other, "≤": value <= other, "≥": value >= other}
            return float((truths | {"=": value == other, "≠": value != other})[sign])
        return value

    def sum(self) -> float:
        sign = 1.0
        if self.ahead("−"):
            self.left.pop(0)
            sign = -1.0
        value = sign * self.product()
        while self.ahead("+", "−"):
            sign = 1.0 if self.left.pop(0) == "+" else -1.0
            value += sign * self.product()
        return value

    def product(self) -> float:
        value = self.power()
        while self.ahead("·"):
            self.left.pop(0)
            value *= self.power()
        return value

    def power(self) -> float:
        value = self.atom()
        if self.ahead("^"):
            self.left.pop(0)
            value **= self.atom()
        return value

    def atom(self) -> float:
        kind, content = self.left.pop(0)
        if kind == "value":
            return content
        if kind == "name" and self.ahead("\u2061"):
            self.left.pop(0)
            fence, inside = self.left.pop(0)
            assert fence == "("
            args: list[list[Any]] = [[]]
            for token in inside:
                if token == ",":
                    args.append([])
                else:
                    args[-1].append(token)
            return float(CALLS[content](*(self.expression(arg) for arg in args)))
        if kind == "name":
            return self.known[content]
        inside = self.expression(content)
        return {"(": inside, "[": inside, "|": abs(inside), "⌊": math.floor(inside), "⌈": math.ceil(inside)}[kind]
