"""Whether a plant's equations agree in their dimensions, and where they do not: the line and the operands."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Sequence
from types import FrameType, MethodType
from typing import TYPE_CHECKING

import casadi as ca

from models.expression import Expression, Number
from models.plant import Plant, Signal, Values, stacked
from models.quantity import Quantity, is_declared, symbolised, walked
from models.users_code import place_of_code
from workbench.graph import Unreadable, read
from workbench.graph.dimensions import Powers, dimensions, parsed, words

if TYPE_CHECKING:
    from _typeshed import TraceFunction

Column = Sequence[Number] | Expression


def mismatches(plant: Plant) -> list[str]:
    """Return where dimensions do not agree in a plant's equations, a line each with file, line and operands.

    Quantities and signals have the dimension of their unit, ``k`` and bare numbers are free; a unit that is no unit
    (``output units``) is free too. The next state must have the dimensions of the states, ``output`` of the outputs.
    """
    symbolic = symbolised(plant)
    units = {path: spec.unit for path, spec, _ in walked(plant, _into)}
    at, thing = plant.symbols(), symbolic.thing
    given = {**at, **dict(zip(symbolic.names, symbolic.symbols, strict=True))}
    known = {name: _of(named) for name, named in _named(plant).items()}
    known |= {"k": (None,), **{name: (parsed(units[name]),) for name in symbolic.names}}
    moves = thing.rhs if plant.continuous else thing.step
    per_second = parsed("1/s") if plant.continuous else ()
    states = [None if one is None else _times(one, per_second) for one in _of(plant.states)]
    found: list[str] = []
    for method, wanted, named, arguments in (
        (moves, states, plant.states, (at["x"], at["u"], at["w"], at["k"])),
        (thing.output, list(_of(plant.outputs)), plant.outputs, (at["x"],)),
    ):
        kinds = (plant.states, plant.inputs, plant.disturbances)
        handed = [Values(kinds[i], one) if i < 3 else one for i, one in enumerate(arguments)]
        found += _of_method(method, handed, wanted, named, given, known)
    return found


def _into(spec: Quantity, value: object) -> bool:
    return is_declared(value)


def _named(plant: Plant) -> dict[str, Sequence[Signal]]:
    return {"x": plant.states, "u": plant.inputs, "w": plant.disturbances}


def _of(named: Sequence[Signal]) -> tuple[Powers | None, ...]:
    return tuple(parsed(signal.unit) for signal in named)


def _times(powers: Powers, other: Powers | None) -> Powers:
    merged = dict(powers)
    for name, power in other or ():
        merged[name] = merged.get(name, power - power) + power
    return tuple(sorted((name, power) for name, power in merged.items() if power))


# a method may be step, rhs or output, which take different arguments
def _of_method(
    method: Callable[..., Column],
    handed: Sequence[object],
    wanted: Sequence[Powers | None],
    named: Sequence[Signal],
    given: dict[str, Expression],
    known: dict[str, tuple[Powers | None, ...]],
) -> list[str]:
    """Return the mismatches of one method: those within, at the first line that has each, then those of its values."""
    lines: dict[str, str] = {}

    def look(value: object, frame: FrameType, line: int) -> None:
        if isinstance(value, ca.SX):
            for reason in _reasons(value, given, known):
                lines.setdefault(reason, f"{frame.f_code.co_filename}, line {line}: {reason}")

    column = stacked(_traced(method, handed, look), named, method.__qualname__)
    for reason in _reasons(column, given, known):
        lines.setdefault(reason, f"{place_of_code(method)}: {reason}")
    for row, (powers, signal) in enumerate(zip(wanted, named, strict=True)):
        got = _dimension(column[row], given, known)
        if None not in (powers, got) and powers != got:
            said = f"{signal.name} must be {words(powers)} ({signal.unit}), got {words(got)}"
            lines.setdefault(said, f"{place_of_code(method)}: {said}")
    return list(lines.values())


def _evaluated(
    value: Expression, given: dict[str, Expression], known: dict[str, tuple[Powers | None, ...]]
) -> tuple[list[Powers | None], list[str]]:
    function = ca.Function(
        "value", list(given.values()), [ca.densify(value)], [f"i{i}" for i in range(len(given))], ["v"]
    )
    try:
        graph = read(function)
    except Unreadable:
        return [], []
    coordinates = [powers for name in given for powers in known[name]]
    found, wrong = dimensions(graph, coordinates)
    return [found[entry.node].powers for entry in graph.outputs[0].entries], [one.reason for one in wrong]


def _reasons(value: Expression, given: dict[str, Expression], known: dict[str, tuple[Powers | None, ...]]) -> list[str]:
    return _evaluated(value, given, known)[1]


def _dimension(
    value: Expression, given: dict[str, Expression], known: dict[str, tuple[Powers | None, ...]]
) -> Powers | None:
    return next(iter(_evaluated(value, given, known)[0]), None)


# a method may be step, rhs or output, which take different arguments
def _traced(
    method: Callable[..., Column], handed: Sequence[object], look: Callable[[object, FrameType, int], None]
) -> Column:
    """Call a method and look at every value that a line of its file has made, at that line."""
    file = inspect.getsourcefile(method.__func__ if isinstance(method, MethodType) else method)
    last: dict[int, int] = {}
    seen: set[int] = set()

    def within(frame: FrameType, event: str, value: object) -> TraceFunction:
        line = last.get(id(frame), frame.f_lineno)
        made = [*frame.f_locals.values(), *([value] if event == "return" else [])]
        for one in made:
            for entry in one if isinstance(one, (tuple, list)) else (one,):
                if isinstance(entry, ca.SX) and id(entry) not in seen:
                    seen.add(id(entry))
                    kept.append(entry)
                    look(entry, frame, frame.f_lineno if event == "return" else line)
        last[id(frame)] = frame.f_lineno
        return within

    def trace(frame: FrameType, event: str, value: object) -> TraceFunction | None:
        return within if frame.f_code.co_filename == file else None

    kept: list[ca.SX] = []  # so that no other value gets an identity that was seen
    before = sys.gettrace()
    sys.settrace(trace)
    try:
        return method(*handed)
    finally:
        sys.settrace(before)
