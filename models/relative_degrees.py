"""The relative degree of a plant at every sample: samples at which the equations look alike are followed once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.errors import InvalidValue
from models.expression import Expression
from models.relative_degree import first_effect, position

if TYPE_CHECKING:
    from models.plant import Plant

FEW = 32
"""A part of the equations that depends on k alone and takes at most so many values is followed value by value."""


def relative_degrees(
    plant: Plant, samples: int, limit: int, output: str | None, input: str | None
) -> NDArray[np.int64]:
    """Return what :meth:`models.plant.Plant.relative_degrees` says."""
    row, column = position(plant.outputs, output, "output"), position(plant.inputs, input, "input")
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 1:
        raise InvalidValue(f"samples must be a whole number, 1 or more, got {samples!r}")
    parted = _parted(plant, samples + limit)
    found = np.zeros(samples, dtype=np.int64)
    if parted is None:  # an operation that cannot be taken apart
        for k in range(samples):
            effect = first_effect(plant, limit, k=k, output=output, input=input)
            found[k] = effect.degree if effect else 0
        return found
    at = plant.symbols()
    waiting = [(np.arange(samples), at["x"], at["u"], 0)]
    while waiting:
        members, x, u, before = waiting.pop()
        if before == limit:
            continue
        patterns, which = np.unique(parted.patterns[:, members + before], axis=1, return_inverse=True)
        for index, pattern in enumerate(patterns.T):
            alike = members[which.ravel() == index]
            after = parted.step(x, u, ca.SX.sym("w", len(plant.disturbances)), parted.told(pattern))
            if ca.depends_on(plant.measured(after)[row], at["u"][column]):
                found[alike] = before + 1
            elif ca.depends_on(after, at["u"][column]):  # else no later output can depend on it
                waiting.append((alike, after, ca.SX.sym("u", len(plant.inputs)), before + 1))
    return found


class _Parted(NamedTuple):
    """A plant's step, the parts of it that depend on k alone being parameters."""

    step: ca.Function
    """(x, u, w, parts) -> (x_next)."""
    patterns: Array
    """What the parts look like, (parts, samples): their values where they are few, else 1 for what is not zero."""
    few: NDArray[np.bool_]
    """Whether the pattern of a part is its value, (parts,)."""

    def told(self, pattern: Array) -> Expression:
        """Return the parts of a pattern: a value where it is one, or zero, else a symbol."""
        pairs = zip(pattern, self.few, strict=True)
        parts = [ca.SX(float(one)) if few or one == 0 else ca.SX.sym("part") for one, few in pairs]
        return ca.vertcat(*parts) if parts else ca.SX(0, 1)


def _parted(plant: Plant, samples: int) -> _Parted | None:
    """Take a plant's step apart and evaluate its parts at the samples; None where an operation cannot be rebuilt."""
    at = plant.symbols()
    after = plant.next_state(**at)
    roots = [after[i].element_hash() for i in range(after.numel())]
    nodes, clock = _nodes(after), at["k"].element_hash()
    made: dict[int, Expression] = {}
    timed, free, parts = set[int](), set[int](), dict[int, tuple[Expression, Expression]]()

    def rebuilt(key: int) -> Expression:
        """Return a node with the parts below it replaced by their symbols."""
        if key in timed and key not in free:
            return parts.setdefault(key, (nodes[key], ca.SX.sym("part")))[1]
        return made[key]

    for key, node in nodes.items():
        below = [node.dep(i).element_hash() for i in range(node.n_dep())]
        if key == clock or any(one in timed for one in below):
            timed.add(key)
        if any(one in free for one in below) or (node.is_symbolic() and key != clock):
            free.add(key)
        if key not in free or not below:
            made[key] = node
        elif len(below) == 1:
            made[key] = ca.SX.unary(node.op(), rebuilt(below[0]))
        elif len(below) == 2:
            made[key] = ca.SX.binary(node.op(), rebuilt(below[0]), rebuilt(below[1]))
        else:
            return None
    step = ca.vertcat(*(rebuilt(root) for root in roots))
    values = np.zeros((len(parts), samples))
    if parts:
        evaluated = ca.Function("parts", [at["k"]], [ca.vertcat(*(part for part, _ in parts.values()))])
        values = evaluated(np.arange(samples, dtype=float)[None, :]).full()
    few = np.array(
        [key in roots or np.unique(one).size <= FEW for key, one in zip(parts, values, strict=True)], dtype=bool
    )
    symbols = [symbol for _, symbol in parts.values()]
    given = [at["x"], at["u"], at["w"], ca.vertcat(*symbols) if symbols else ca.SX(0, 1)]
    return _Parted(ca.Function("step", given, [step]), np.where(few[:, None], values, values != 0.0), few)


def _nodes(column: Expression) -> dict[int, Expression]:
    """Return the nodes of a column's graph by their identity, each after those that it is made of."""
    found: dict[int, Expression] = {}
    for i in range(column.numel()):
        waiting = [(column[i], False)]
        while waiting:
            node, seen = waiting.pop()
            key = node.element_hash()
            if seen:
                found.setdefault(key, node)
            elif key not in found:
                waiting.append((node, True))
                waiting += [(node.dep(j), False) for j in range(node.n_dep())]
    return found
