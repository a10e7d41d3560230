"""Certificates of sets that hold every trial of a law that learns on increments."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.array import Array
from verification.certificates.bounds import plain
from verification.checker.graph import Graph as Checked
from verification.checker.interval import Span
from verification.checker.reading import Rejected
from verification.checker.recursion import Sets
from workbench.contracts.certificate import Certificate, Json, hashed
from workbench.contracts.claim import NotCertified
from workbench.graph import Graph
from workbench.graph.operations import CONSTANT, INPUT

PIECES = 128
"""Equal pieces in which the range of what depends on one coordinate alone is sought, between its kinks."""
TRIES = 20
"""How often an end of a target is moved outwards before it is given up."""
SPARE = 2.0**-30
"""By what share of their magnitudes targets are moved outwards first."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a funnel is asked of; rows are samples, the last axis holds the lower and the upper end."""

    start: Array
    """States with which trials begin, (states, 2)."""
    others: Mapping[str, Array]
    """Ranges of what else acts, disturbances and parameters, (N, 2) or (1, 2) by name."""
    plan: Array
    """First plan, (N,)."""
    reference: Array
    """(N + 1,)."""
    noise: float
    gain: float
    """The largest learning gain."""
    targets: Array
    """Where the targets are thought to lie, (N, 2)."""
    bands: Array | None = None
    """Ranges that must hold states and input, (states + 1, 2); None: those that are found."""


def funnel(graph: Graph, asked: Asked) -> Certificate:
    """Return the certificate of a funnel, ``graph`` being one step: ``next_i``, ``gained``, of x, w, p, k and u.

    Raises NotCertified where none was found: the checker's sets are a little wider than those of the enclosure.
    """
    content = plain(graph)
    ports = {port.name: list(port.labels) for port in graph.inputs}
    part = _apart(graph)
    statement: dict[str, Json] = {
        "states": ports["x"],
        "start": _ends(asked.start),
        "input": ports["u"][0],
        "sample": ports["k"][0],
        "others": {name: _ends(one) for name, one in asked.others.items()},
        "plan": [float(one).hex() for one in asked.plan],
        "reference": [float(one).hex() for one in asked.reference],
        "noise": float(asked.noise).hex(),
        "gain": float(asked.gain).hex(),
        "bands": [],
    }
    cuts = _cuts(graph, part, asked)
    try:
        sets = Sets(_plainly(statement), dict(cuts), Checked(content, part))
        x, used, targets = [sets.x], list[Span](), list[Span]()
        for k in range(sets.n):
            t, slope = _target(sets, k, asked.targets[k])
            u = _around(sets, k, t, slope[1])
            sets.step(k, u, t)
            x.append(sets.x)
            used.append(u)
            targets.append(t)
    except Rejected as error:
        raise NotCertified(f"no sets were found: {error}") from None
    if asked.bands is None:
        held = [[min(s[i][0] for s in x), max(s[i][1] for s in x)] for i in range(len(ports["x"]))]
        bands = [*held, [min(one[0] for one in used), max(one[1] for one in used)]]
    else:
        bands = asked.bands.tolist()
    statement["bands"] = [[float(low).hex(), float(high).hex()] for low, high in bands]
    name = hashed(content)
    return Certificate(
        kind="funnel",
        statement={"graph": name, **statement},
        proof={"inputs": _spans(used), "targets": _spans(targets), "apart": part, "cuts": cuts},
        graphs={name: content},
    )


def _plainly(statement: Json) -> object:
    """Return plain data as it would be read from a file."""
    content: object = json.loads(json.dumps(statement))
    return content


def _ends(ranges: Array) -> list[Json]:
    return [[float(low).hex(), float(high).hex()] for low, high in ranges]


def _spans(spans: Sequence[Span]) -> list[Json]:
    return [[low.hex(), high.hex()] for low, high in spans]


def _target(sets: Sets, k: int, near: Array) -> tuple[Span, Span]:
    """Return ends between which the target lies from every state that is held at a sample, and the slope there.

    What is missing at an end is made good by the least slope, and a little more each time.
    """
    ends = [float(near[0]), float(near[1])]
    box = sets.box(k, (ends[0], ends[1]))
    slope = sets.slope.tight(box, low=True), sets.slope.tight(box, low=False)
    if slope[0] is None or slope[1] is None or not slope[0][0] > 0:
        raise NotCertified(f"the increment was not shown to rise with the input at sample {k}")
    wanted = float(sets.rise[k]), float(sets.spread)
    for side, upper in ((0, False), (1, True)):
        more = max(abs(ends[side]), 1.0) * SPARE
        for _ in range(TRIES):
            if sets.beyond(box, k, ends[side], upper=upper):
                break
            box[sets.by] = (ends[side], ends[side])
            span = sets.gained.tight(box, low=upper)
            if span is None:
                raise NotCertified(f"the increment is not known at sample {k}")
            missing = wanted[0] + wanted[1] - span[0] if upper else span[1] - wanted[0] + wanted[1]
            off = max(missing, 0.0) / slope[0][0] * (1 + SPARE) + more
            ends[side] += off if upper else -off
            more *= 4
        else:
            raise NotCertified(f"no input was found that follows at sample {k}")
    return (ends[0], ends[1]), (slope[0][0], slope[1][1])


def _around(sets: Sets, k: int, t: Span, steepest: float) -> Span:
    """Return the inputs that hold the first plan and the targets, and are not left by those that are moved."""
    low, high = min(sets.plan[k], t[0]), max(sets.plan[k], t[1])
    share = sets.l_max * steepest
    if share <= 1 - 1e-9:
        return low, high
    if not share < 2:
        raise NotCertified(f"l_max B must stay below 2 at sample {k}, it is {share:.4g}")
    middle, half = t[0] / 2 + t[1] / 2, (t[1] - t[0]) / 2
    far = max(high - middle, middle - low, half * max(1.0, share / (2 - share)))
    far += 1e-9 * max(far, abs(middle))
    return middle - far, middle + far


def _apart(graph: Graph) -> list[int]:
    """Return the nodes that stand for all that an output takes of a coordinate, where they are no coordinate.

    The input is left as it is, for slopes are asked along it, and so is the sample, which is one number.
    """
    ports = [port.name for port in graph.inputs for _ in port.places]
    on: list[frozenset[int]] = []
    for node in graph.nodes:
        own = frozenset({node.which}) if node.op == INPUT else frozenset[int]()
        on.append(own.union(*(on[arg] for arg in node.args)))
    found: dict[int, None] = {}
    for result in graph.outputs:
        for entry in result.entries:
            needed = graph.ancestors((entry.node,))
            for i in (i for i in on[entry.node] if ports[i] not in ("u", "k")):
                taken = {arg for k in needed for arg in graph.nodes[k].args if on[arg] == {i} and on[k] != {i}}
                if len(taken) == 1 and graph.nodes[min(taken)].op not in (INPUT, CONSTANT):
                    found[min(taken)] = None
    return list(found)


def _cuts(graph: Graph, part: Sequence[int], asked: Asked) -> dict[str, Json]:
    """Return where ranges are cut, by coordinate: at equal parts of where trials may be, and at the kinks."""
    labels = graph.labels()
    constants = [node.value for node in graph.nodes if node.op == CONSTANT]
    found: dict[str, Json] = {}
    for k in part:
        (i,) = {graph.nodes[one].which for one in graph.ancestors((k,)) if graph.nodes[one].op == INPUT}
        reach = float(np.max(np.abs(constants), initial=1.0))
        places = {one for one in constants if abs(one) <= reach}
        places |= {float(one) for one in np.linspace(min(places), max(places), PIECES)} if places else set()
        found[labels[i]] = [one.hex() for one in sorted(places)]
    return found
