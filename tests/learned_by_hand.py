"""Graphs of what laws learn, written by hand: one that learns as is said, and others that do not."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

from forging import Drawn, Forged, hashed

LAWS = (
    "other_sample", "more_by_a_digit", "less_by_a_digit", "moves_unreached", "forgets", "unguarded", "guarded_before",
    "two_gains", "own_gain", "adds", "says_increment", "squares", "older", "missing_in_memory", "missing_at_first",
    "was_begins", "was_narrow", "narrow_shape", "named_e", "gain_by_error", "first_error", "last_by_a_digit", "sign",
    "reference", "one_said_all", "memory_beyond", "no_trial_reached", "another_row", "one_place_twice",
)  # fmt: skip
"""Ways to learn otherwise than by ``gain`` times the next error."""


def law(n: int, wrong: str, gain: float, *, increment: bool = False) -> Forged:
    """Return the certificate that a law of n samples moves its plan by a gain times the next error; it may be wrong."""
    fields = {"memory_u": n, "memory_m": n, "memory_old": n + 1, "memory_was": n + 1}
    told = {"r": n + 1, "y": n + 1, "e": n + 1, "reached": n + 1}
    g = Drawn(fields | told)

    def at(port: str, column: int) -> int:
        return g.at[f"{port}[{column}]"]

    def known(column: int, by: int | None = None, of: str = "e") -> int:
        return g.put("if_else_zero", at("reached", column if by is None else by), at(of, column))

    said = {"samples": n, "varying": True, "increment": increment, "begins": {"memory_was": "0"}}
    ends = [gain, gain]
    after, memory = [], []
    for k in range(n):
        u, error = at("memory_u", k), known(k + 1)
        if increment:
            change = g.put("sub", at("e", k + 1), at("e", k))
            error = g.put("if_else_zero", at("reached", k + 1), change)
        move = g.scaled(gain, error)
        own = g.scaled(0.5, at("memory_m", k))
        match wrong:
            case "other_sample":
                move = g.scaled(gain, known(min(k + 2, n)) if k < n - 1 else known(k))
            case "more_by_a_digit":
                move = g.scaled(math.nextafter(gain, 9), error)
            case "less_by_a_digit":
                ends = [math.nextafter(gain, 9), 2.0]
            case "moves_unreached":
                no = g.put("not", at("reached", k + 1))
                move = g.put("add", move, g.put("if_else_zero", no, g.number(0.125)))
            case "forgets":
                u = g.scaled(1 - 2.0**-40, u)
            case "unguarded":
                move = g.scaled(gain, at("e", k + 1))
            case "guarded_before":
                move = g.scaled(gain, known(k + 1, by=k))
            case "two_gains":
                waves = [g.put("sin", at("memory_m", i)) for i in (k, (k + 1) % n)]
                move = g.put("mul", g.scaled(gain / 2, g.put("add", *waves)), error)
                ends = [-gain, gain * (1 - 1e-9)]
            case "own_gain":
                move, ends = g.put("mul", at("memory_m", k), error), [0.0, 1e9]
            case "adds":
                move = g.put("add", move, g.put("if_else_zero", at("reached", k + 1), g.number(2.0**-1000)))
            case "says_increment":
                said["increment"] = True
            case "squares":
                move = g.scaled(gain, g.put("sq", error))
            case "older":
                move = g.put("add", move, g.scaled(2.0**-30, at("memory_m", k)))
            case "missing_in_memory":
                own = at("y", k + 1)
            case "missing_at_first":
                own = g.scaled(2.0, at("y", k))
            case "was_begins" | "was_narrow" | "no_trial_reached":
                own = g.put("if_else_zero", at("memory_was", k + 1), g.scaled(0.5, at("memory_old", k + 1)))
            case "named_e":
                share = g.put("fabs", at("e", k + 1))
                move = g.put("if_else_zero", at("reached", k + 1), g.put("mul", share, at("e", k + 1)))
                ends = [0.0, 1.0]
            case "gain_by_error":
                share = g.put("fmin", g.number(1.0), g.put("fabs", at("e", k + 1)))
                move = g.put("if_else_zero", at("reached", k + 1), g.scaled(gain, g.put("mul", share, at("e", k + 1))))
            case "first_error":
                move = g.scaled(gain, known(1 if k else n))
            case "last_by_a_digit":
                move = g.scaled(math.nextafter(gain, 9) if k == n - 1 else gain, error)
            case "sign":
                move = g.put("neg", move)
            case "reference":
                move = g.scaled(gain, known(k + 1, of="r"))
            case "one_said_all":
                move = move if k != n - 1 else g.number(0.0)
            case "another_row":
                move = g.scaled(
                    gain, g.put("if_else_zero", at("reached", k + 1), g.put("add", at("e", k + 1), at("e", k)))
                )
        after.append(g.put("add", u, move))
        memory.append(own)
    g.gives("plan", *(at("memory_u", k) for k in range(n))).gives("plan_next", *after)
    g.gives("next_memory_u", *after).gives("next_memory_old", *(at("y", k) for k in range(n + 1)))
    was = [at("reached", k) for k in range(n + 1)]
    g.gives("next_memory_was", *(was[:1] if wrong == "was_narrow" else was))
    if wrong == "memory_beyond":
        memory.append(g.scaled(2.0, at("y", n)))
    g.gives("next_memory_m", *memory)
    if wrong == "was_begins":
        said["begins"] = {}
    if wrong == "no_trial_reached":  # it is kept, and never 0 again
        g.results[-2]["entries"][-1][2] = at("memory_was", n)
    if wrong == "named_e":
        g.gives("next_e", *was)
        said["begins"] = {"memory_was": "0", "e": "0"}
    graph: Any = g.content
    if wrong == "narrow_shape":
        for port in graph["inputs"]:
            if port["name"] in ("e", "reached"):
                port["shape"] = [1, 1]
        graph["outputs"][1]["entries"][n - 1][2] = g.put("add", at("memory_u", n - 1), g.scaled(gain, known(1)))
    if wrong == "one_place_twice":  # another number stands where it is told that a sample was reached
        port = graph["inputs"][-1]
        port["places"].append([0, 1])
        port["labels"].append("other")
        guarded = g.put("if_else_zero", g.put("input", len(g.at)), at("e", 1))
        graph["outputs"][1]["entries"][0][2] = g.put("add", at("memory_u", 0), g.scaled(gain, guarded))
        graph["outputs"][2]["entries"][0][2] = graph["outputs"][1]["entries"][0][2]
    statement = {"graph": hashed(graph), **said, "least": str(Fraction(ends[0])), "most": str(Fraction(ends[1]))}
    return Forged("learned", statement, {}, [graph])
