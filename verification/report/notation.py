"""The signs of mathematics in two languages, LaTeX and MathML, and how names are set in them."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from html import escape
from typing import NamedTuple, Protocol

GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa mu nu xi pi rho sigma tau upsilon phi chi psi omega "
    "Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega"
).split()
LETTERS = dict(zip(GREEK, "αβγδεζηθικμνξπρστυφχψωΓΔΘΛΞΠΣΦΨΩ", strict=True)) | {"lam": "λ", "lambda": "λ", "lamda": "λ"}
IN_LATEX = {
    "<": r"\lt ",
    ">": r"\gt ",
    "≤": r"\le ",
    "≥": r"\ge ",
    "≠": r"\ne ",
    "·": r"\cdot ",
    "−": "-",
    "∧": r"\wedge ",
    "∨": r"\vee ",
    "¬": r"\neg ",
    "⌊": r"\lfloor ",
    "⌋": r"\rfloor ",
    "⌈": r"\lceil ",
    "⌉": r"\rceil ",
    "∞": r"\infty ",
} | {letter: f"\\{name if name not in ('lam', 'lamda') else 'lambda'} " for name, letter in LETTERS.items()}
SPECIAL = str.maketrans(
    {c: f"\\{c}" for c in "&%$#_{}"}
    | {"\\": r"\backslash ", "~": r"\sim ", "^": r"\hat{}", "<": r"\lt ", ">": r"\gt ", " ": r"\ ", "\n": " "}
)


KNOWN_TO_LATEX = frozenset("sin cos tan arcsin arccos arctan sinh cosh tanh exp ln min max".split())


class Symbol(NamedTuple):
    """A name as it is set: a letter or word, and what stands below it."""

    head: str
    below: tuple[str, ...]


def symbol(name: str) -> Symbol:
    """Return how a name is set: ``b0_mean`` is b with 0 and mean below; a word stays a word."""
    first, *rest = [part for part in name.split("_") if part] or [name]
    stem = first.rstrip("0123456789")
    digits = first[len(stem) :]
    if stem in LETTERS or len(stem) == 1:
        return Symbol(LETTERS.get(stem, stem), (*((digits,) if digits else ()), *(LETTERS.get(r, r) for r in rest)))
    if rest and (rest[-1].isdigit() or rest[-1] in ("state", "input", "disturbance", "output", "parameter")):
        return Symbol(" ".join([first, *rest[:-1]]), (rest[-1],))
    return Symbol(" ".join([first, *rest]), ())


class Pen(Protocol):
    """Writes the pieces of an equation in one language."""

    def number(self, digits: str, exponent: str) -> str:
        """Write digits, times ten to the exponent where there is one."""

    def identifier(self, name: str) -> str:
        """Write a name."""

    def sign(self, sign: str) -> str:
        """Write an operator."""

    def row(self, *pieces: str) -> str:
        """Write pieces side by side."""

    def gap(self) -> str:
        """Write a thin space."""

    def fenced(self, fences: str, inner: str) -> str:
        """Write pieces between two fences that grow."""

    def fraction(self, above: str, below: str) -> str:
        """Write a fraction."""

    def power(self, base: str, exponent: str) -> str:
        """Write a base with its exponent."""

    def root(self, inner: str) -> str:
        """Write a square root."""

    def function(self, name: str, args: Sequence[str]) -> str:
        """Write a named function of arguments."""

    def cases(self, condition: str, value: str, otherwise: str) -> str:
        """Write a value under a condition, and another otherwise."""

    def lines(self, lines: Sequence[str]) -> str:
        """Write the lines of a long right side."""


@dataclasses.dataclass(frozen=True)
class Latex:
    """Writes for MathJax."""

    def number(self, digits: str, exponent: str) -> str:
        """Write digits, times ten to the exponent where there is one."""
        digits = digits.replace("∞", r"\infty ").replace("undefined", r"\text{undefined}")
        return f"{digits} \\cdot 10^{{{exponent}}}" if exponent else digits

    def identifier(self, name: str) -> str:
        """Write a name."""
        head, below = symbol(name)
        return self._word(head) + (f"_{{{','.join(map(self._word, below))}}}" if below else "")

    def _word(self, word: str) -> str:
        if word in IN_LATEX:
            return IN_LATEX[word].strip()
        text = word.translate(SPECIAL)
        return text if len(word) == 1 or word.isdigit() else f"\\mathrm{{{text}}}"

    def sign(self, sign: str) -> str:
        """Write an operator."""
        return f" {IN_LATEX.get(sign, sign).strip()} "

    def gap(self) -> str:
        """Write a thin space."""
        return r"\,"

    def row(self, *pieces: str) -> str:
        """Write pieces side by side."""
        return "".join(pieces)

    def fenced(self, fences: str, inner: str) -> str:
        """Write pieces between two fences that grow."""
        left, right = (IN_LATEX.get(fence, fence) for fence in fences)
        return f"\\left{left}{inner}\\right{right}"

    def fraction(self, above: str, below: str) -> str:
        """Write a fraction."""
        return f"\\frac{{{above}}}{{{below}}}"

    def power(self, base: str, exponent: str) -> str:
        """Write a base with its exponent."""
        return f"{{{base}}}^{{{exponent}}}"

    def root(self, inner: str) -> str:
        """Write a square root."""
        return f"\\sqrt{{{inner}}}"

    def function(self, name: str, args: Sequence[str]) -> str:
        """Write a named function of arguments."""
        command = f"\\{name}" if name in KNOWN_TO_LATEX else f"\\operatorname{{{name}}}"
        return f"{command}\\left({', '.join(args)}\\right)"

    def cases(self, condition: str, value: str, otherwise: str) -> str:
        """Write a value under a condition, and another otherwise."""
        rows = f"{value} & \\text{{if }} {condition} \\\\ {otherwise} & \\text{{otherwise}}"
        return f"\\begin{{cases}} {rows} \\end{{cases}}"

    def lines(self, lines: Sequence[str]) -> str:
        """Write the lines of a long right side."""
        return " \\\\\n&\\qquad ".join(lines)


@dataclasses.dataclass(frozen=True)
class MathML:
    """Writes MathML that stands alone: text is escaped, nothing is fetched."""

    def number(self, digits: str, exponent: str) -> str:
        """Write digits, times ten to the exponent where there is one."""
        if not exponent:
            return f"<mn>{digits}</mn>"
        power = f"<mn>{exponent}</mn>".replace("<mn>-", "<mo>−</mo><mn>")
        return f"<mrow><mn>{digits}</mn><mo>·</mo><msup><mn>10</mn><mrow>{power}</mrow></msup></mrow>"

    def identifier(self, name: str) -> str:
        """Write a name."""
        head, below = symbol(name)
        if not below:
            return self._word(head)
        return f"<msub>{self._word(head)}<mrow>{'<mo>,</mo>'.join(map(self._word, below))}</mrow></msub>"

    def _word(self, word: str) -> str:
        text = escape(clean(word)).replace(" ", "\u00a0")
        return f"<mn>{text}</mn>" if word.isdigit() else f"<mi>{text}</mi>"

    def sign(self, sign: str) -> str:
        """Write an operator."""
        return f"<mo>{escape(sign)}</mo>"

    def gap(self) -> str:
        """Write a thin space."""
        return '<mspace width="0.15em"/>'

    def row(self, *pieces: str) -> str:
        """Write pieces side by side."""
        return f"<mrow>{''.join(pieces)}</mrow>"

    def fenced(self, fences: str, inner: str) -> str:
        """Write pieces between two fences that grow."""
        left, right = (f'<mo stretchy="true">{fence}</mo>' for fence in fences)
        return f"<mrow>{left}{inner}{right}</mrow>"

    def fraction(self, above: str, below: str) -> str:
        """Write a fraction."""
        return f"<mfrac>{above}{below}</mfrac>"

    def power(self, base: str, exponent: str) -> str:
        """Write a base with its exponent."""
        return f"<msup>{base}{exponent}</msup>"

    def root(self, inner: str) -> str:
        """Write a square root."""
        return f"<msqrt>{inner}</msqrt>"

    def function(self, name: str, args: Sequence[str]) -> str:
        """Write a named function of arguments."""
        inner = "<mo>,</mo>".join(args)
        return f"<mrow><mi>{name}</mi><mo>\u2061</mo><mrow><mo>(</mo>{inner}<mo>)</mo></mrow></mrow>"

    def cases(self, condition: str, value: str, otherwise: str) -> str:
        """Write a value under a condition, and another otherwise."""
        left = 'style="text-align:left;padding-right:0.8em"'
        return (
            f'<mrow><mo stretchy="true">{{</mo><mtable><mtr><mtd {left}>{value}</mtd>'
            f"<mtd {left}><mtext>if\u00a0</mtext>{condition}</mtd></mtr><mtr><mtd {left}>{otherwise}</mtd>"
            f"<mtd {left}><mtext>otherwise</mtext></mtd></mtr></mtable></mrow>"
        )

    def lines(self, lines: Sequence[str]) -> str:
        """Write the lines of a long right side."""
        if len(lines) == 1:
            return lines[0]
        spaced = [lines[0], *(line.replace("<mo>", '<mo form="infix">', 1) for line in lines[1:])]
        rows = "".join(f'<mtr><mtd style="text-align:left">{line}</mtd></mtr>' for line in spaced)
        return f'<mtable displaystyle="true">{rows}</mtable>'


def clean(text: str) -> str:
    """Return text without the characters that XML cannot hold."""
    return re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)
