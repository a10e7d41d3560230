"""Oracles for sets that are carried: points in balls, campaigns in doubles, and endings that are known beforehand.

What does not depend on who carries the sets is computed once. Every check returns sentences that say what was missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from unittest import mock

import casadi as ca
import numpy as np
from balls import ball, holds
from flint import arb, ctx

from models.array import Array
from models.expression import Column
from models.plant import Plant, Values, signal, signals
from models.quantity import declared, quantity
from verification.enclosure import recursion
from verification.enclosure.carried import Carried, Ended, Question
from verification.enclosure.recursion import Parted, Recursion

Step = Callable[..., list[ca.SX]]
FEW = 7  # samples of a case
ROUNDING = 1e-9  # of a campaign in doubles


def small(step: Callable[[Values, Values, Values, ca.SX], Column], states: int = 1, disturbances: int = 0) -> Plant:
    """Return a plant of a function; its output is its first state."""

    @declared
    class Small(Plant):
        """Made for one test."""

        sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
        inputs = signals(u0=signal("1", "input"))
        outputs = signals(y=signal("1", "output"))

        def step(self, x, u, w, k):
            return tuple(step(x, u, w, k))

        def output(self, x):
            return (x.vector[0],)

    Small.states = signals(**{f"x{i}": signal("1", "state") for i in range(states)})
    Small.disturbances = signals(**{f"w{i}": signal("1", "disturbance") for i in range(disturbances)})
    return Small()


@dataclass(frozen=True, kw_only=True)
class Case:
    """A plant, what is asked about it, and how that ends."""

    name: str
    step: Step
    """(x, u, w, k, p) -> next states."""
    start: tuple[tuple[float, float], ...] = ((-0.1, 0.1),)
    disturbance: tuple[tuple[float, float], ...] = ()
    parameters: tuple[tuple[float, float], ...] = ()
    wanted: tuple[float, float] = (0.28, 0.31)
    plan: tuple[float, float] = (0.0, 0.05)
    most_gain: float = 0.5
    samples: int = FEW
    ended: Ended = "fine"
    sample: int = -1
    more: dict[str, object] = field(default_factory=dict)

    @property
    def symbols(self) -> list[ca.SX]:
        """Return one symbol for every parameter."""
        return [ca.SX.sym(f"p{i}") for i in range(len(self.parameters))]

    def question(self, **more: object) -> Question:
        """Return what is asked."""
        n = self.samples

        def rows(ends: tuple[tuple[float, float], ...]) -> Array:
            return np.array(ends, dtype=float).reshape(-1, 2)

        given = {
            "start": rows(self.start),
            "disturbance": np.repeat(rows(self.disturbance)[None], n, axis=0),
            "parameters": rows(self.parameters),
            "wanted": np.tile(self.wanted, (n, 1)),
            "plan": np.tile(self.plan, (n, 1)),
            "most_gain": self.most_gain,
        }
        return Question(**(given | self.more | more))

    @cache  # noqa: B019  # a case lives as long as the tests
    def recursion(self) -> Recursion:
        """Return the plant made ready."""
        p = self.symbols
        return Recursion(self._plant(p), self.samples, p)

    def _plant(self, p: list[ca.SX]) -> Plant:
        return small(
            lambda x, u, w, k: self.step([*x.vector.nz], u.u0, [*w.vector.nz] if self.disturbance else [], k, p),
            len(self.start),
            len(self.disturbance),
        )

    def function(self) -> Callable[..., Array]:
        """Return the step in doubles, (x, u, w, k, p) -> next state."""
        p = self.symbols
        at = self._plant(p).symbols()
        given = [at["x"], at["u"], at["w"], at["k"], ca.vertcat(*p) if p else ca.SX(0, 1)]
        made = ca.Function("step", given, [self._plant(p).next_state(**at)])
        return lambda *values: np.array(made(*values), dtype=float).ravel()

    def __hash__(self) -> int:
        return hash(self.name)


def _two(x, u, w, k, p):
    return [0.5 * x[0] + 0.1 * x[1] + u, 0.9 * x[1] - 0.1 * ca.tanh(x[0])]


CASES = [
    Case(name="linear", step=lambda x, u, w, k, p: [0.5 * x[0] + u]),
    Case(name="no start, no noise", step=lambda x, u, w, k, p: [0.9 * x[0] + u], start=((0, 0),), wanted=(0.3, 0.3)),
    Case(name="cubic input", step=lambda x, u, w, k, p: [0.5 * x[0] + u + u**3], most_gain=0.1),
    Case(name="arctan, in reach", step=lambda x, u, w, k, p: [0.9 * x[0] + ca.atan(u)], samples=3),
    Case(name="arctan, out of reach", step=lambda x, u, w, k, p: [0.5 * x[0] + ca.atan(u)], wanted=(2, 2),
         ended="unreached", sample=0),
    Case(name="saturated", step=lambda x, u, w, k, p: [0.5 * x[0] + ca.fmin(ca.fmax(u, -1), 1)], wanted=(2, 2),
         ended="unreached", sample=0),
    Case(name="saturated later", step=lambda x, u, w, k, p: [0.2 * x[0] + ca.fmin(ca.fmax(u, -1), 1)],
         wanted=(0.4, 0.4), ended="unreached", sample=2, start=((0, 0),)),
    Case(name="plan in saturation", step=lambda x, u, w, k, p: [0.5 * x[0] + ca.fmin(u, 1)], plan=(2, 2),
         ended="not rising", sample=0),
    Case(name="falling input", step=lambda x, u, w, k, p: [0.5 * x[0] - u], ended="not rising", sample=0),
    Case(name="input gain by state", step=lambda x, u, w, k, p: [0.5 * x[0] + u * (1 + 0.3 * ca.sin(x[0]))]),
    Case(name="input gain by side", step=lambda x, u, w, k, p: [0.5 * x[0] + u * ca.if_else(x[0] > 0.7, 1, 1.3)]),
    Case(name="kinked input", step=lambda x, u, w, k, p: [0.5 * x[0] + ca.fmin(u, 0.5 * u + 0.3)]),
    Case(name="kinked drag",
         step=lambda x, u, w, k, p: [x[0] - 0.2 * x[0] * ca.fabs(x[0]) - 0.1 * ca.fabs(x[0] - 0.4) + u]),
    Case(name="jump by state", step=lambda x, u, w, k, p: [0.5 * x[0] + ca.if_else(x[0] > 0.5, 0.1, 0) + u]),
    Case(name="jump by input", step=lambda x, u, w, k, p: [0.5 * x[0] + u + ca.if_else(u > 0.2, 0.5, 0)],
         ended="undefined", sample=0),
    Case(name="floor of the input", step=lambda x, u, w, k, p: [0.5 * x[0] + u + ca.floor(u + 0.5)], wanted=(2, 2),
         ended="undefined", sample=0),
    Case(name="end of a root", step=lambda x, u, w, k, p: [ca.sqrt(1 - 2 * x[0]) + u], start=((0, 0.45), ), samples=3,
         wanted=(-0.1, 0.1), ended="undefined", sample=1),
    Case(name="root beyond its end at once", step=lambda x, u, w, k, p: [ca.sqrt(x[0]) + u], ended="undefined",
         sample=0),
    Case(name="overshoot", step=lambda x, u, w, k, p: [0.5 * x[0] + u], most_gain=1.5, samples=4),
    Case(name="overshoot along a curve", step=lambda x, u, w, k, p: [0.5 * x[0] + u + 0.1 * ca.sin(u)], most_gain=1.3,
         samples=3),
    Case(name="a plan that reaches into saturation", step=lambda x, u, w, k, p: [0.5 * x[0] + ca.fmin(u, 1)],
         plan=(-0.2, 1.6), ended="not rising", sample=0),
    Case(name="pole behind a bounded function", step=lambda x, u, w, k, p: [0.5 * ca.tanh(1 / x[0]) + u],
         ended="undefined", sample=0),
    Case(name="gain of two", step=lambda x, u, w, k, p: [0.5 * x[0] + u], most_gain=2.0, ended="gain", sample=0),
    Case(name="gain by parameter", step=lambda x, u, w, k, p: [0.5 * x[0] + p[0] * u], most_gain=1.0,
         parameters=((1.0, 2.0),), ended="gain", sample=0),
    Case(name="two states", step=_two, start=((-0.1, 0.1), (0, 0.2))),
    Case(name="disturbance", step=lambda x, u, w, k, p: [0.5 * x[0] + u + w[0] * x[0] + w[1]],
         disturbance=((-0.1, 0.2), (0.01, 0.02)),
         more={"disturbance": np.array([[[-0.1, 0.1 + 0.02 * k], [0.1 * k, 0.1 * k + 0.02]] for k in range(FEW)])}),
    Case(name="parameter", step=lambda x, u, w, k, p: [0.5 * x[0] + u / p[0]], parameters=((0.8, 1.25),)),
    Case(name="periodic", step=lambda x, u, w, k, p: [(0.5 + 0.4 * ca.sin(0.7 * k)) * x[0] + u]),
    Case(name="pole between samples", step=lambda x, u, w, k, p: [0.2 * x[0] / (k - 2.5) + u]),
    Case(name="pole at a sample", step=lambda x, u, w, k, p: [0.2 * x[0] / (k - 3) + u], ended="undefined", sample=3),
    Case(name="coefficient with a pole", step=lambda x, u, w, k, p: [0.2 / (k - 3) * x[0] + u], ended="undefined",
         sample=3),
    Case(name="cubic input from above", step=lambda x, u, w, k, p: [0.5 * x[0] + u + u**3], most_gain=0.1,
         plan=(0.9, 1.0), wanted=(-1, -0.9), samples=1),
    Case(name="overshoot to and fro", step=lambda x, u, w, k, p: [0.5 * x[0] + u], start=((-1, 1),), most_gain=1.5,
         plan=(0.3, 0.3), samples=1),
    Case(name="one sample", step=lambda x, u, w, k, p: [0.5 * x[0] + u], samples=1),
    Case(name="powers", step=lambda x, u, w, k, p: [0.4 * x[0] - 0.05 * x[0] ** 3 + 0.01 * x[0] ** 4 + u]),
    Case(name="quotient", step=lambda x, u, w, k, p: [x[0] / (2 + x[0] ** 2) + u / (3 + ca.cos(x[0]))], most_gain=1.0),
    Case(name="exponential drag", step=lambda x, u, w, k, p: [0.5 * x[0] + u - 0.1 * ca.exp(-x[0])], samples=3),
    Case(name="jolted", step=lambda x, u, w, k, p: [0.5 * x[0] + u], 
         more={"jolt": np.array([0.03]), "wanted": np.tile([0.25, 0.34], (FEW, 1))}),
    Case(name="a wide plan", step=lambda x, u, w, k, p: [0.5 * x[0] + u], plan=(-2, 3), most_gain=1.0),
]  # fmt: skip


# ------------------------------------------------------------------ campaigns


@dataclass(frozen=True, kw_only=True)
class Runs:
    """Trials in doubles; NaN where a sample was not reached."""

    x: Array
    """(trials, N + 1, states)."""
    u: Array
    """(trials, N)."""
    next_u: Array
    """(trials, N)."""


def _draw(rng: np.random.Generator, ends: Array) -> Array:
    share = rng.choice([0.0, 1.0, rng.uniform()], ends.shape[:-1])
    return ends[..., 0] + share * (ends[..., 1] - ends[..., 0])


def learned(case: Case, rng: np.random.Generator, trials: int, fresh: bool, gains: Array) -> Runs:
    """Let a law learn, gains and lengths at random; ``fresh`` draws the inputs of every trial from the plan."""
    question, step, n = case.question(), case.function(), case.samples
    x = np.full((trials, n + 1, len(question.start)), np.nan)
    u, after = np.full((trials, n), np.nan), np.full((trials, n), np.nan)
    jolt = question.jolt if question.jolt is not None else np.zeros(len(question.start))
    plan = _draw(rng, question.plan)
    for i in range(trials):
        plan = _draw(rng, question.plan) if fresh else plan
        p, x[i, 0] = _draw(rng, question.parameters), _draw(rng, question.start)
        w, wanted, gain = _draw(rng, question.disturbance), _draw(rng, np.tile(case.wanted, (n, 1))), _draw(rng, gains)
        for k in range(int(rng.integers(1, n + 1)) if rng.uniform() < 0.3 else n):
            there = step(x[i, k], plan[k], w[k], k, p) + jolt * rng.choice([-1, 0, 1])
            if not np.isfinite(there).all():
                break
            x[i, k + 1], u[i, k] = there, plan[k]
            plan[k] += gain[k] * (wanted[k] - (there[0] - x[i, k, 0]))
            after[i, k] = plan[k]
    return Runs(x=x, u=u, next_u=after)


def _outside(name: str, values: Array, sets: Array) -> Iterator[str]:
    """Name the samples whose values lie outside of their set, where there is one; an empty set holds nothing."""
    low, high = sets[..., 0], sets[..., 1]
    room = ROUNDING * (1 + np.abs(values))
    if np.any(low > high):
        yield f"{name}: the lower end lies above the upper"
    out = (values < low - room) | (values > high + room)
    for place in np.argwhere(out)[:1]:
        yield f"{name} at {place.tolist()}: {values[tuple(place)]}"


@cache
def campaign(case: Case) -> Runs:
    """Return what a law does whose gains lie between none and the most."""
    rng = np.random.default_rng([ord(c) for c in case.name])
    return learned(case, rng, 30 if case.samples > 1 else 300, False, np.tile([0.0, case.most_gain], (case.samples, 1)))


def astray(case: Case, found: Carried) -> list[str]:
    """Say where a campaign leaves the sets."""
    runs = campaign(case)
    where = f"{case.name}: "
    missed = [*_outside(where + "x", runs.x, found.x), *_outside(where + "u", runs.u, found.u)]
    return [*missed, *_outside(where + "y", runs.x[..., 0], found.y)]


def ended_otherwise(case: Case, found: Carried) -> list[str]:
    """Say where a pass does not end as it must."""
    if (found.ended, found.sample) == (case.ended, case.sample):
        return []
    return [f"{case.name}: ended {found.ended} at {found.sample}"]


MOVED = [case for case in CASES if case.ended == "fine"]


@cache
def moving(case: Case) -> tuple[Question, Runs]:
    """Return a question about inputs that are given and move, and trials with such inputs."""
    moves = np.tile([0.2 * case.most_gain, case.most_gain], (case.samples, 1))
    runs = learned(case, np.random.default_rng(5), 30, True, moves)
    return case.question(moves=moves), runs


def moved_astray(case: Case, found: Carried) -> list[str]:
    """Say where an input that was given moves to other places."""
    runs = moving(case)[1]
    where = f"{case.name}, moved: "
    return [*_outside(where + "x", runs.x, found.x), *_outside(where + "u", runs.next_u, found.after)]


@cache
def settling(case: Case) -> Runs:
    """Return the last of many trials."""
    gains = np.tile([0.5 * case.most_gain, case.most_gain], (case.samples, 1))
    runs = learned(case, np.random.default_rng(6), 220, False, gains)
    return Runs(x=runs.x[-20:], u=runs.u[-20:], next_u=runs.next_u[-20:])


def carried_astray() -> Iterator[str]:
    """Hold all cases against campaigns."""
    for case in CASES:
        found = case.recursion().carry(case.question())
        yield from ended_otherwise(case, found)
        yield from astray(case, found)
    for case in MOVED:
        yield from moved_astray(case, case.recursion().carry(moving(case)[0]))


# ------------------------------------------------------------------ operations

UNARY: dict[str, Callable[[ca.SX], ca.SX]] = {
    "neg": lambda a: -a, "twice": lambda a: 2 * a, "inv": lambda a: 1 / a, "sq": lambda a: a * a,
    "cube": lambda a: a**3, "fourth": lambda a: a**4, "pow -2": lambda a: a**-2, "pow 2.5": lambda a: a**2.5,
    "sqrt": ca.sqrt, "fabs": ca.fabs, "sign": ca.sign, "floor": ca.floor, "ceil": ca.ceil, "not": ca.logic_not,
    "exp": ca.exp, "log": ca.log, "sin": ca.sin, "tanh": ca.tanh, "atan": ca.atan,
}  # fmt: skip
BINARY: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "div": lambda a, b: a / b,
    "fmin": ca.fmin, "fmax": ca.fmax, "lt": lambda a, b: a < b, "le": lambda a, b: a <= b, "eq": ca.eq, "ne": ca.ne,
    "and": ca.logic_and, "or": ca.logic_or, "copysign": ca.copysign, "atan2": ca.atan2, "fmod": ca.fmod,
    "hypot": ca.hypot, "pow": lambda a, b: a**b,
    "if": lambda a, b: ca.if_else(a, b, 0), "if else": lambda a, b: ca.if_else(a > 0, a, b),
    "if le": lambda a, b: ca.if_else(a <= b, a * b, a - b),
    "either": lambda a, b: (a <= b) + (b <= a),
    "side": lambda a, b: ca.if_else(a > 0, 2 * b, 3 * b),
}  # fmt: skip
CALM = ["add", "sub", "mul", "div", "fmin", "fmax", "neg", "twice", "sq", "cube", "fabs", "sqrt", "inv", "side"]
ENDS = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 3.0, 5e-324, -1e-310, 1e300, -1e300, 1e-200]
V, U, K = (ca.SX.sym(name) for name in ("v", "u", "k"))


@dataclass(frozen=True, kw_only=True)
class Formula:
    """An expression made ready, boxes, and its values in balls at points of every box."""

    name: str
    recursion: Recursion
    boxes: Array
    samples: Array
    points: list[Array]
    values: list[list[arb | None]]


def _formula(name: str, expression: ca.SX, rng: np.random.Generator, boxes: int, points: int, rough: float) -> Formula:
    function = ca.Function("f", [V, U, K], [expression])
    plant = small(lambda x, u, w, k: [ca.substitute(expression, ca.vertcat(V, U, K), ca.vertcat(x.x0, u.u0, k))])
    ends = np.zeros((boxes, 3, 2))
    samples = rng.integers(0, 3, boxes)
    for j in range(boxes):
        low = np.where(rng.uniform(size=2) < rough, rng.choice(ENDS, 2), rng.uniform(-3, 3, 2))
        high = low + rng.choice([0.0, 0.0, 1e-9, 0.1, 1.0, 2.5], 2)
        if rng.uniform() < 0.15:  # touching
            low[1], high[1] = high[0], high[0] + rng.choice([0.0, 1.0])
        ends[j, 0], ends[j, 2], ends[j, 1] = (low[0], high[0]), (low[1], high[1]), samples[j]
    where, values = [], []
    for box in ends:
        corners = [[a, box[1, 0], b] for a in box[0] for b in box[2]]
        inner = rng.uniform(0, 1, (points, 3)) * (box[:, 1] - box[:, 0]) + box[:, 0]
        at = np.clip(np.vstack([corners, inner]), box[:, 0], box[:, 1])
        where.append(at)
        values.append([ball(function, [float(v), float(u), float(k)]) for v, k, u in at])
    return Formula(name=name, recursion=Recursion(plant, 3), boxes=ends, samples=samples, points=where, values=values)


def _random(rng: np.random.Generator, depth: int, names: list[str]) -> ca.SX:
    if depth == 0 or rng.uniform() < 0.1:
        leaf = rng.integers(0, 8)
        if leaf < 6:
            return [V, U, V + 2, U - 1, V, U][leaf]
        return 0.3 * K + U if leaf == 6 else ca.SX(float(rng.choice([-2.0, -0.1, 0.5, 3.0])))
    name = names[rng.integers(0, len(names))]
    if name in UNARY:
        return UNARY[name](_random(rng, depth - 1, names))
    return BINARY[name](_random(rng, depth - 1, names), _random(rng, depth - 1, names))


@cache
def formulas() -> list[Formula]:
    """Return every operation by itself, and random formulas, in which parts may stand for coordinates."""
    rng = np.random.default_rng(1)
    made = [_formula(name, UNARY[name](V), rng, 24, 2, 0.4) for name in UNARY]
    made += [_formula(name, BINARY[name](V, U), rng, 24, 2, 0.4) for name in BINARY]
    for depth, names, count in ((2, [*UNARY, *BINARY], 60), (3, CALM, 40)):
        for i in range(count):
            expression = _random(rng, depth, names)
            made.append(_formula(f"{i}: {expression}", expression, rng, 10, 2, 0.1))
    return made


@cache
def sloped() -> list[Formula]:
    """Return formulas in the same way, without parts that stand for coordinates."""
    rng = np.random.default_rng(2)
    with mock.patch.object(recursion, "apart", lambda graph, goals, _: Parted(graph, list(goals), [])):
        made = [_formula(name, UNARY[name](V), rng, 10, 2, 0.2) for name in UNARY]
        made += [_formula(name, BINARY[name](V, U), rng, 10, 2, 0.2) for name in BINARY]
        for i in range(50):
            expression = _random(rng, 3 if i % 2 else 2, CALM if i % 2 else [*UNARY, *BINARY])
            made.append(_formula(f"{i}: {expression}", expression, rng, 8, 2, 0.0))
    return made


def values_missed(parts: int, decided: list[bool] | None = None) -> Iterator[str]:
    """Say which enclosures do not hold the value at a point."""
    for formula in formulas():
        found, _ = formula.recursion.enclose(0, formula.boxes, formula.samples, parts)
        for box, ends, points, values in zip(formula.boxes, found, formula.points, formula.values, strict=True):
            if decided is not None:
                decided.append(bool(np.isfinite(ends).all()))
            where = f"{formula.name} on {box.tolist()}"
            if not ends[0] <= ends[1]:
                yield f"{where}: no range, {ends.tolist()}"
            for point, value in zip(points, values, strict=True):
                if value is not None and value.is_finite() and not holds(*ends, value):
                    yield f"{where} at {point.tolist()}: {value} not in {ends.tolist()}"


def slopes_missed(usable: list[bool] | None = None) -> Iterator[str]:
    """Say which slopes do not hold the difference of two values."""
    for formula in sloped():
        found, slopes = formula.recursion.enclose(0, formula.boxes, formula.samples, 1)
        for j, (points, values) in enumerate(zip(formula.points, formula.values, strict=True)):
            if not np.isfinite(found[j]).any():
                continue
            if usable is not None:
                usable.append(bool(np.isfinite(slopes[j]).all()))
            for (p, one), (q, other) in combinations(zip(points, values, strict=True), 2):
                if one is not None and other is not None and not _chord(slopes[j], p, q, one - other):
                    yield (
                        f"{formula.name} on {formula.boxes[j].tolist()}: {slopes[j].tolist()} does not hold "
                        f"{p.tolist()} to {q.tolist()}"
                    )


def _chord(slopes: Array, p: Array, q: Array, difference: arb) -> bool:
    if not difference.is_finite():
        return True
    with ctx.workprec(200):
        low, high = arb(0), arb(0)
        for (least, most), step in zip(slopes, (arb(a) - arb(b) for a, b in zip(p, q, strict=True)), strict=True):
            if step == 0:
                continue
            if not np.isfinite([least, most]).all():
                return True
            ways = arb(least) * step, arb(most) * step
            low, high = low + ways[0].min(ways[1]), high + ways[0].max(ways[1])
        return not difference < low and not difference > high
