"""What a sample computes from time and parameters alone: found in its graph, and computed once a campaign.

A sine of the sample index is the same in every trial. Such expressions are taken out of the sample and become rows
of numbers that it is handed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

_NAMES = "SIN COS TAN ASIN ACOS ATAN ATAN2 SINH COSH TANH EXP LOG POW ERF"
DEAR = frozenset(getattr(ca, f"OP_{name}") for name in _NAMES.split())
"""Operations that cost more than being read from memory."""


class Timetable(NamedTuple):
    """Results with symbols in place of what depends on time alone, those symbols, and what they stand for."""

    results: list[ca.SX]
    symbols: ca.SX
    """(m, 1)."""
    values: ca.SX
    """(m, 1), expressions of k and the parameters only."""


def timetable(results: Sequence[ca.SX], k: ca.SX, parameters: ca.SX) -> Timetable:
    """Take out of SX expressions the largest parts that depend on k, on parameters and on nothing else.

    Only parts with an operation of :data:`DEAR` are taken; the other operations stay, in their order.
    """
    free = ca.symvar(ca.vertcat(*(ca.vec(result) for result in results)))
    timed = {symbol.element_hash() for symbol in ca.symvar(ca.vertcat(k, parameters))}
    moving = k.element_hash()
    graph = ca.Function("graph", free, [ca.densify(result) for result in results], {"cse": True})
    slots: dict[int, tuple[ca.SX, bool, bool, bool]] = {}  # value, of time alone, of k, dear
    symbols: list[ca.SX] = []
    values: list[ca.SX] = []
    taken: dict[int, ca.SX] = {}
    made = [ca.SX.zeros(*graph.size_out(i)) for i in range(graph.n_out())]

    def handed(slot: int) -> ca.SX:
        """Return a slot's value for an operation that does more than tell the time."""
        value, alone, of_k, dear = slots[slot]
        if not (alone and of_k and dear):
            return value
        if value.element_hash() not in taken:
            symbols.append(ca.SX.sym(f"timed{len(symbols)}"))
            values.append(value)
            taken[value.element_hash()] = symbols[-1]
        return taken[value.element_hash()]

    for index in range(graph.n_instructions()):
        operation = graph.instruction_id(index)
        inputs, outputs = graph.instruction_input(index), graph.instruction_output(index)
        if operation == ca.OP_CONST:
            slots[outputs[0]] = (ca.SX(graph.instruction_constant(index)), True, False, False)
        elif operation == ca.OP_INPUT:
            symbol = free[inputs[0]]
            slots[outputs[0]] = (symbol, symbol.element_hash() in timed, symbol.element_hash() == moving, False)
        elif operation == ca.OP_OUTPUT:
            made[outputs[0]].nz[outputs[1]] = handed(inputs[0])
        else:
            alone = all(slots[slot][1] for slot in inputs)
            arguments = [slots[slot][0] if alone else handed(slot) for slot in inputs]
            value = ca.SX.unary(operation, *arguments) if len(inputs) == 1 else ca.SX.binary(operation, *arguments)
            dear = operation in DEAR or any(slots[slot][3] for slot in inputs)
            slots[outputs[0]] = (value, alone, any(slots[slot][2] for slot in inputs), dear)
    return Timetable(made, ca.vertcat(*symbols), ca.vertcat(*values))
