"""Typeset equations against the CasADi Function: the trees and the MathML are evaluated."""

from __future__ import annotations

import importlib.util
import math
import random
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest

from models.actuator import Delayed, Lagged, RateLimited, Saturated
from models.brake import Brake
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, part, quantity
from verification.report.expression import FUNCTIONS, Term
from verification.report.notation import symbol
from verification.report.typeset import equations_of, latex, mathml, typeset
from workbench.graph import read

_spec = importlib.util.spec_from_file_location("mathml_reader", Path(__file__).with_name("mathml_reader.py"))
mathml_reader = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(mathml_reader)
Reader, M, CALLS = mathml_reader.Reader, mathml_reader.M, mathml_reader.CALLS

ARITHMETIC: dict[str, Any] = {
    "sum": lambda *z: sum(z),
    "negative": lambda a: -a,
    "product": lambda *z: math.prod(z),
    "quotient": lambda a, b: a / b,
    "power": lambda a, b: a**b,
    "lt": lambda a, b: float(a < b),
    "le": lambda a, b: float(a <= b),
    "eq": lambda a, b: float(a == b),
    "ne": lambda a, b: float(a != b),
    "and": lambda a, b: float(bool(a) and bool(b)),
    "or": lambda a, b: float(bool(a) or bool(b)),
    "not": lambda a: float(not a),
}


def tree_value(term: Term, known: dict[str, float]) -> float:
    """Evaluate a tree by recursion."""
    if term.op == "number":
        return term.value
    if term.op == "name":
        return known[term.name]
    if term.op == "cases":  # a branch that is not taken may be undefined
        return tree_value(term.args[1 if tree_value(term.args[0], known) else 2], known)
    return float((ARITHMETIC | CALLS)[term.op](*(tree_value(arg, known) for arg in term.args)))


def sides(written: str) -> tuple[str, Any]:
    """Return the spelt left side and the element of the right side of one equation."""
    row = ET.fromstring(written)[0][0]
    left = row[0][0]
    name = left[0][2] if left.tag == f"{M}mfrac" else left[0] if left.tag == f"{M}mrow" else left
    [(_, spelt)] = Reader({}).tokens(name)
    return spelt, row[2][0]


def read_back(thing: Any, known: dict[str, float]) -> tuple[list[float], list[float]]:
    """Evaluate what is typeset at a point: the trees, and the MathML as read; of the outputs only."""
    values, spelt = dict(known), dict(known)
    trees, read = [], []
    for equation, written in zip(equations_of(thing), mathml(thing), strict=True):
        left, element = sides(written)
        tree, text = tree_value(equation.right, values), Reader(spelt).value(element)
        assert left == Reader.spelt(equation.left.partition("(")[0])
        if re.fullmatch(r"[tqhz]_\d+", equation.left):
            values[equation.left], spelt[equation.left] = tree, text
        else:
            trees.append(tree)
            read.append(text)
    return trees, read


def agree(function: ca.Function, points: int = 12) -> int:
    """Compare a scalar-input Function with what is typeset of it at random points; return how many were compared."""
    draw, compared = np.random.default_rng(1), 0
    for _ in range(points):
        known = {function.name_in(i): float(draw.normal(scale=2)) for i in range(function.n_in())}
        expected = np.array(function(*known.values())).ravel(order="F")
        if not np.isfinite(expected).all() or np.abs(expected).max() > 1e9:
            continue
        try:
            trees, read = read_back(function, known)
        except (ValueError, OverflowError, ZeroDivisionError):
            continue  # Python raises where CasADi goes through infinity
        np.testing.assert_allclose(trees, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(read, expected, rtol=1e-6, atol=1e-6)
        compared += 1
    return compared


a, b, c, d = (ca.SX.sym(name) for name in "abcd")
EXPRESSIONS = {
    "minus of a sum": a - (b + c),
    "minus of a minus": a - (b - c) - d,
    "sum times sum": (a + b) * (c - d),
    "negated sum": -(a + b) * c,
    "negative numbers": a * -3 + b / -4 - -5 * c + -0.25,
    "quotient in product": a / b * c / d,
    "power of sum": (a + b) ** 3 + (a * b) ** 2 + (-a) ** 2,
    "power of power": ca.power(ca.power(ca.fabs(a) + 0.1, b), c),
    "power of quotient": (a / b) ** 2,
    "power of function": ca.sin(a) ** 2 + ca.sin(a**2) + ca.sqrt(ca.fabs(a)) ** 3,
    "power of negative": ca.power(ca.SX(2), -a) + ca.power(ca.fabs(a), ca.SX(-1.5)),
    "scientific": 1.5e-7 * a + ca.power(ca.SX(1e-9), ca.tanh(b) / 10) + a * 2e8 - 3e-12 + (1e-7 + a * 0) ** 2,
    "if else": ca.if_else(a > b, a + 1, b * 2) * c - ca.if_else(a >= 0, c, 0),
    "nested if": ca.if_else(a > 0, ca.if_else(b > 0, 1, 2), ca.if_else(ca.logic_not(c < d), 3, a)),
    "conditions": ca.if_else(ca.logic_or(ca.logic_and(a > 0, b < c), ca.logic_not(ca.logic_or(a < 1, d > 0))), a, b),
    "or in and": ca.if_else(ca.logic_and(ca.logic_or(a > 0, b < c), ca.logic_or(a < 1, d > 0)), a, b),
    "conditions as numbers": (a > b) * c + (ca.logic_and(a > 0, b > 0) + 1) ** 2 + ca.if_else(ca.floor(a), b, c),
    "equal": ca.if_else(ca.floor(a) == ca.floor(b), a, b) + ca.if_else(ca.sign(a) != 1, 2, 3),
    "clipped": ca.fmin(ca.fmax(a, -1), ca.fmin(1, ca.fmin(b, c))) - ca.fabs(a - b) * ca.fabs(-c),
    "abs of abs": ca.fabs(ca.fabs(a) - ca.fabs(b)) ** 2,
    "rounding": ca.floor(a + b) + ca.ceil(a * b) * 2 + ca.fmod(a, b) + ca.remainder(a, b),
    "inverse": 1 / a + 1 / (a + b) + 2 * a + a * a * a * b * b,
    "rest": ca.copysign(a, b) + ca.hypot(a, b) + ca.log1p(a**2) + ca.expm1(a) + ca.erf(a) + ca.atan2(a, b),
    "trigonometry": ca.sin(a) * ca.cos(b) - ca.tan(c) + ca.asin(ca.tanh(a)) + ca.acos(ca.tanh(b)) + ca.atan(d),
    "hyperbolic": ca.sinh(a) + ca.cosh(b) + ca.asinh(c) + ca.acosh(1 + d**2) + ca.atanh(ca.tanh(a)) + ca.exp(-a),
    "shared": ca.sin(a + 2 * b + 3 * c) ** 2 + ca.cos(a + 2 * b + 3 * c) * ca.sin(a + 2 * b + 3 * c),
    "wide": sum(((a + i) * (b - i) * ca.sin(c * i + 0.5) for i in range(30)), ca.SX(0)) * (a + b),
    "deep": ca.sin(ca.cos(ca.exp(-ca.fabs(a / (1 + ca.sqrt(ca.fabs(b + ca.log(1 + c**2 / (3 + d**2))))))))),
    "error function": ca.erfinv(ca.tanh(a) / 2),
    "constant": ca.SX(3.5),
    "zero": a * 0,
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expression_read_back(name: str) -> None:
    assert agree(ca.Function("f", [a, b, c, d], [EXPRESSIONS[name]], list("abcd"), ["z"])) >= 6


def test_random_expressions_read_back() -> None:
    draw = random.Random(3)
    two = [ca.plus, ca.minus, ca.times, ca.rdivide, ca.fmin, ca.fmax, lambda p, q: ca.if_else(p < q, p, q)]
    one = [ca.sin, ca.fabs, lambda p: p**2, lambda p: -p, ca.tanh, lambda p: p**3, lambda p: p > 0.5, lambda p: 1 / p]

    def expression(depth: int) -> ca.SX:
        if depth == 0:
            return draw.choice([a, b, c, d, ca.SX(draw.choice([-2.0, 0.5, 3.0, 1e-7]))])
        if draw.random() < 0.3:
            return draw.choice(one)(expression(depth - 1))
        return draw.choice(two)(expression(depth - 1), expression(depth - 1))

    compared = 0
    for _ in range(150):
        function = ca.Function("f", [a, b, c, d], [expression(draw.randint(1, 5))], list("abcd"), ["z"])
        compared += agree(function, points=2)
    assert compared > 150


def test_every_operation_of_the_table_is_tried() -> None:
    tried = set()
    for value in EXPRESSIONS.values():
        f = ca.Function("f", [a, b, c, d], [value])
        tried |= {node.op for node in read(f).nodes}
    assert set(FUNCTIONS) <= tried


def test_reader_sees_a_lost_parenthesis() -> None:
    f = ca.Function("f", [a, b, c], [a * (b + c)], list("abc"), ["z"])
    [written] = mathml(f)
    lost = written.replace('<mo stretchy="true">(</mo>', "").replace('<mo stretchy="true">)</mo>', "")
    known = {"a": 2.0, "b": 3.0, "c": 5.0}
    assert Reader(known).value(sides(written)[1]) == 16
    assert Reader(known).value(sides(lost)[1]) == 11


@declared
class Inner(Plant):
    """A lag with a disturbance."""

    source: ClassVar[str] = "test"
    states = signals(x=("m", "place"))
    inputs = signals(u="N")
    outputs = signals(y_1="m")
    disturbances = signals(w="N")
    sampling_time: float = quantity(default=0.5, unit="s", doc="sampling time", above=0)
    gain: float = quantity(default=2.0, unit="m/N", doc="gain", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (self.gain * (u.u + w.w) - x.x / (1 + self.sampling_time) + ca.fmod(k, 7),)

    def output(self, x: Any) -> Any:
        return (x.x**2,)


@declared
class Outer(Plant):
    """A plant round a plant, with a quantity inside."""

    source: ClassVar[str] = "test"
    inner: Inner = part(default=Inner(), doc="what is inside")
    states = signals(v="m/s")
    inputs = signals(u="N")
    outputs = signals(v="m/s")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (x.v + u.u / self.inner.gain,)

    def output(self, x: Any) -> Any:
        return (x.v,)


@declared
class Looking(Plant):
    """A plant that looks at its numbers in Python."""

    source: ClassVar[str] = "test"
    states = signals(v="m/s")
    inputs = signals(u="N")
    outputs = signals(v="m/s")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
    tau: float = quantity(default=0.5, unit="s", doc="lag", least=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (self.tau * x.v + u.u if self.tau > 0 else u.u,)

    def output(self, x: Any) -> Any:
        return (x.v,)


PLANTS: dict[str, Plant] = {
    f"{reading} {line}": PointMass(reading=reading, line=line)
    for reading in ("metro", "seconds", "printed")
    for line in ("hilly", "flat")
} | {
    "disturbed": Inner(),
    "nested": Outer(),
    "looks at its numbers": Looking(),
    "behind actuators": Saturated(
        plant=Lagged(plant=Delayed(plant=PointMass(), dead_time=0.2), time_constant=0.5), lower=-400.0, upper=1000.0
    ),
    "integrated": Maglev(),
    "integrated twice": MetroLine(),
    "integrated, with a line of commands": Brake(),
    "rate": RateLimited(plant=PointMass(line="flat"), rate=1e4),
}


def point(plant: Plant, draw: np.random.Generator, spread: float) -> tuple[dict[str, float], list[list[float]]]:
    """Return a random point by name, parameters included, and as the arguments of the step."""
    rows = typeset(plant)
    values = [[float(draw.uniform(0, spread)) for _ in named] for named in (plant.states, plant.inputs)]
    values += [[float(draw.normal()) for _ in plant.disturbances], [float(draw.integers(0, 2000))]]
    names = [row.name for row in rows.signals if row.kind in ("state", "input", "disturbance")] + ["k"]
    known = dict(zip(names, [one for group in values for one in group], strict=True))
    for row in rows.parameters:
        last = row.field.rpartition(".")[2]
        known |= {row.field.replace(".", "_"): row.value, {"sampling_time": "T_s"}.get(last, last): row.value}
    return known, values


def slope_and_jumps(plant: Plant, x: Any, u: Any, w: Any) -> Any:
    """Return dx/dt, but for the states that are no more than shifted: of these what is shifted in."""
    after = ca.DM(plant.slope(x, u, w, 0))
    if isinstance(plant, Brake):
        after[3:] = ca.vertcat(u, x[3:-1])
    return after


@pytest.mark.parametrize("name", PLANTS)
def test_plant_read_back(name: str) -> None:
    plant, draw = PLANTS[name], np.random.default_rng(2)
    for spread in (1.0, 100.0, 1500.0, 5000.0):
        known, values = point(plant, draw, spread)
        after, seen = plant.step_function()(*values), plant.output_function()(values[0])
        if plant.continuous:
            after = slope_and_jumps(plant, *map(ca.DM, values[:3]))
        trees, read = read_back(plant, known)
        np.testing.assert_allclose(trees, [*np.array(after).ravel(), *np.array(seen).ravel()], rtol=1e-9)
        np.testing.assert_allclose(read, trees, rtol=1e-6)


@pytest.mark.parametrize(("plant", "steps"), [(Maglev(), 1), (MetroLine(), 2)])
def test_slope_is_what_the_step_integrates(plant: Any, steps: int) -> None:
    draw = np.random.default_rng(4)
    for _ in range(5):
        x, u, w = (ca.DM(draw.uniform(0, 30, len(one))) for one in (plant.states, plant.inputs, plant.disturbances))
        after, h = x, plant.sampling_time / steps
        for _ in range(steps):
            k1 = plant.slope(after, u, w, 0)
            k2 = plant.slope(after + h / 2 * k1, u, w, 0)
            k3 = plant.slope(after + h / 2 * k2, u, w, 0)
            after += h / 6 * (k1 + 2 * k2 + 2 * k3 + plant.slope(after + h * k3, u, w, 0))
        np.testing.assert_allclose(after, plant.next_state(x, u, w, 0), rtol=1e-14)
    assert {1: "one step", 2: "two steps"}[steps] in typeset(plant).integrator
    assert len(latex(plant).splitlines()) < 24 and "\\frac{d\\,\\mathrm{speed}}{dt}" in latex(plant)


def test_hilly_train_stays_readable() -> None:
    lines = latex(PointMass()).splitlines()
    assert len(lines) <= 16
    assert sum("t_{" in line.split("&=")[0] for line in lines if "&=" in line) <= 6


def test_parameters_are_symbols_with_values_and_units() -> None:
    rows = {row.field: row for row in typeset(PointMass()).parameters}
    assert (rows["mass"].value, rows["mass"].unit) == (350_000.0, "kg")
    assert "<msub><mi>b</mi><mrow><mn>0</mn><mo>,</mo><mi>mean</mi></mrow></msub>" in rows["b0_mean"].symbol
    assert "b_{0,\\mathrm{mean}}" in latex(PointMass())
    assert [row.field for row in typeset(Outer()).parameters] == ["inner.gain"]
    assert not typeset(Looking()).parameters


@pytest.mark.parametrize(
    ("name", "head", "below"),
    [
        ("b0_mean", "b", ("0", "mean")),
        ("x_1", "x", ("1",)),
        ("phi", "φ", ()),
        ("lam_0", "λ", ("0",)),
        ("speed", "speed", ()),
        ("trial_length", "trial length", ()),
        ("pressure_2", "pressure", ("2",)),
        ("T_s", "T", ("s",)),
        ("_", "_", ()),
    ],
)
def test_how_names_are_set(name: str, head: str, below: tuple[str, ...]) -> None:
    assert symbol(name) == (head, below)


def test_hostile_and_clashing_names() -> None:
    @declared
    class Hostile(Plant):
        states = signals(**{"<script>alert(1)</script>": "m", "k": "1", "a&b": "m"})
        inputs = signals(**{"]]>": "N", "%$#{}\\^~\x00": "N"})
        outputs = signals(k="1")
        sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time")
        k: float = quantity(default=2.0, unit="1", doc="same name as the sample")

        def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
            return x[0] * self.k + k, x[1] * u[0] + u[1], x[2] + 1

        def output(self, x: Any) -> Any:
            return (x[1],)

    for one in mathml(Hostile()):
        ET.fromstring(one)
        assert "<script" not in one
    text = latex(Hostile())
    assert "<" not in text and ">" not in text and "a\\&b" in text
    rows = typeset(Hostile())
    symbols = [row.symbol for row in (*rows.signals, *rows.parameters)]
    assert len(set(symbols)) == len(symbols)


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_latex_is_balanced(name: str) -> None:
    text = latex(ca.Function("f", [a, b, c, d], [EXPRESSIONS[name]], list("abcd"), ["z"]))
    assert len(re.findall(r"\\left(?![a-z])", text)) == len(re.findall(r"\\right(?![a-z])", text))
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    assert text.count("\\begin") == text.count("\\end")


def test_matrices_and_sparse_entries() -> None:
    x = ca.SX.sym("x", 2)
    z = ca.SX(2, 2)
    z[1, 0] = x[0] * x[1]
    f = ca.Function("f", [x], [z], ["x"], ["z"])
    assert [tree_value(e.right, {"x_1": 2.0, "x_2": 3.0}) for e in equations_of(f)] == [0, 6, 0, 0]


def test_what_cannot_be_typeset_says_so() -> None:
    x = ca.MX.sym("x")
    with pytest.raises(InvalidValue, match="SX Function"):
        latex(ca.Function("f", [x], [x], ["x"], ["z"]))
    z = a
    for _ in range(3100):
        z = ca.sin(z) + b
    with pytest.raises(InvalidValue, match="at most 3000 operations"):
        latex(ca.Function("f", [a, b], [z], ["a", "b"], ["z"]))
    z = a
    for i in range(200):
        z = (z + ca.sin(z + b + i)) * (c + ca.cos(z + b + i))
    with pytest.raises(InvalidValue, match="at most 80 named parts"):
        latex(ca.Function("f", [a, b, c], [z], ["a", "b", "c"], ["z"]))
