"""Funnels of a plant of one state, and campaigns on its plain recursion that leave what is claimed too tightly."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from forging import Drawn, Forged, h

from verification.certificates.funnel import Asked
from verification.certificates.funnel import funnel as made
from workbench.graph import from_json

CAMPAIGNS, TRIALS = 12, 25


def stepped(a: float, b: float, curve: float) -> Drawn:
    """Return the graph of one step: x+ = a x + curve sin(x) + b u + w, with what is gained."""
    g = Drawn({"x": ["x"], "w": ["w"], "p": [], "k": ["k"], "u": ["u"]})
    x, u = g.at["x"], g.at["u"]
    after = g.sum(g.scaled(a, x), g.scaled(curve, g.put("sin", x)), g.scaled(b, u), g.at["w"])
    return g.gives("next_0", after).gives("gained", g.put("sub", after, x))


def funnel(rng: np.random.Generator) -> Forged:
    """Return the certificate of a random funnel; ``truth`` holds the plant's numbers."""
    a, b, curve = float(rng.uniform(0.6, 0.95)), float(rng.uniform(0.4, 0.9)), float(rng.uniform(0, 0.05))
    n = int(rng.integers(2, 6))
    reference = np.cumsum(np.r_[0.0, rng.uniform(0.05, 0.2, n)])
    noise, off = float(rng.uniform(0.001, 0.02)), float(rng.uniform(0.001, 0.02))
    x, inputs = 0.0, []
    for k in range(n):
        inputs.append((reference[k + 1] - reference[k] - (a - 1) * x - curve * math.sin(x)) / b)
        x = reference[k + 1]
    u = np.array(inputs)
    content = stepped(a, b, curve).content
    certificate = made(from_json(json.dumps(content)), Asked(
        start=np.array([[-0.01, 0.01]]), others={"w": np.array([[-off, off]])}, plan=u - 0.02, reference=reference,
        noise=noise, gain=float(rng.uniform(0.5, 1.0)), targets=np.repeat(u[:, None], 2, axis=1),
    ))  # fmt: skip
    plain = json.loads(json.dumps({"statement": certificate.statement, "proof": certificate.proof}))
    return Forged("funnel", plain["statement"], plain["proof"], [content], truth=(a, b, curve))


def number(text: str) -> float:
    return float.fromhex(text)


def reached(rng: np.random.Generator, one: Forged) -> np.ndarray:
    """Return the least and the largest state and input that campaigns of vertices reach, (2, 2)."""
    (a, b, curve), s = one.truth, one.statement
    plan, reference = (np.array([number(v) for v in s[name]]) for name in ("plan", "reference"))
    n, noise, gain = len(plan), number(s["noise"]), number(s["gain"])
    (start,), others = ([number(v) for v in s["start"][0]],), [[number(v) for v in ends] for ends in s["others"]["w"]]
    ends = np.array([[np.inf, -np.inf], [np.inf, -np.inf]])
    for campaign in range(CAMPAIGNS):
        u = plan.copy()
        constant = rng.integers(0, 2, 4)
        for _ in range(TRIALS):

            def pick(
                which: int, count: int, constant: np.ndarray = constant, same: bool = campaign % 3 > 0
            ) -> np.ndarray:
                return np.full(count, constant[which]) if same else rng.integers(0, 2, count)

            x = np.empty(n + 1)
            x[0] = start[int(pick(0, 1)[0])]
            w = [others[min(k, len(others) - 1)][int(one_)] for k, one_ in enumerate(pick(1, n))]
            for k in range(n):
                x[k + 1] = a * x[k] + curve * math.sin(x[k]) + b * u[k] + w[k]
            ends[0] = min(ends[0, 0], x.min()), max(ends[0, 1], x.max())
            ends[1] = min(ends[1, 0], u.min()), max(ends[1, 1], u.max())
            flips = np.arange(n + 1) % 2 if campaign % 2 else pick(2, n + 1)
            y = x + noise * (2 * flips - 1)
            error = np.diff(reference - y)
            share = gain * (rng.integers(0, 2, n) if campaign % 4 == 3 else np.ones(n))
            u = u + share * error
    return ends


def leaves(one: Forged, ends: np.ndarray) -> bool:
    """Tell whether what was reached lies outside of the bands that are claimed, by more than rounding."""
    bands = np.array([[number(v) for v in band] for band in one.statement["bands"]])
    return bool((ends[:, 0] < bands[:, 0] - 1e-12).any() or (ends[:, 1] > bands[:, 1] + 1e-12).any())


def changed(one: Forged, **statement: Any) -> Forged:
    other = one.copy()
    other.statement |= statement
    return other


def others_of(s: Mapping[str, Any], factor: float) -> dict[str, Any]:
    return {"w": [[h(number(v) * factor) for v in ends] for ends in s["others"]["w"]]}


def left(rng: np.random.Generator, one: Forged) -> Iterator[Forged]:
    """Give certificates that a campaign leaves."""
    ends, s = reached(rng, one), one.statement
    bands = [[number(v) for v in band] for band in s["bands"]]
    for row in range(2):
        for side in range(2):
            for by in (1e-9, 0.01 * (bands[row][1] - bands[row][0])):
                tight = [list(band) for band in s["bands"]]
                tight[row][side] = h(float(ends[row, side]) + (by if side == 0 else -by))
                yield changed(one, bands=tight)
    shifted = [h(number(v) + 0.5) for v in s["plan"]]
    steeper = [h(2 * number(v)) for v in s["reference"]]
    wide = [[h(10 * number(v)) for v in s["start"][0]]]
    for other in (
        changed(one, plan=shifted), changed(one, reference=steeper), changed(one, noise=h(8 * number(s["noise"]))),
        changed(one, gain=h(4 * number(s["gain"]))), changed(one, start=wide), changed(one, others=others_of(s, 20.0)),
    ):  # fmt: skip
        if leaves(other, reached(rng, other)):
            yield other
    more = one.copy()
    more.statement["plan"], more.statement["reference"] = (
        [*s["plan"], s["plan"][-1]],
        [*s["reference"], h(number(s["reference"][-1]) + 5)],
    )
    if leaves(more, reached(rng, more)):
        yield more
