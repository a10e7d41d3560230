"""One sample of plant and law: its symbols, its results, and what of it depends on time alone."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from models.plant import Plant
from models.quantity import InvalidValue
from workbench.contracts.law import AnyLaw
from workbench.fold.answers import acted
from workbench.fold.named import expressions, like, names, shapes_of
from workbench.fold.timetable import timetable


class Sample(NamedTuple):
    """One sample of plant and law in SX: symbols by name and results."""

    x: ca.SX
    state: tuple[ca.SX, ...]
    """The law's acting state, all that it holds in one row."""
    memory: tuple[ca.SX, ...]
    rows: dict[str, ca.SX]
    x_next: ca.SX
    state_next: tuple[ca.SX, ...]
    over: tuple[ca.SX, ...]
    """Whether the trial is over by an event of the plant's own: one symbol, or none where it has no such event."""
    over_next: tuple[ca.SX, ...]
    u: ca.SX
    y: ca.SX
    applied: ca.SX
    feeds_back: bool


def without_time(sample: Sample, symbols: dict[str, ca.SX], p: ca.MX, samples: int) -> tuple[Sample, ca.MX | None]:
    """Take what depends on time alone out of a sample; return it with its rows (m, N) as an MX of p, or None."""
    results = [sample.x_next, *sample.state_next, *sample.over_next, sample.u, sample.y, sample.applied]
    parameters = ca.vertcat(*symbols.values())
    found = timetable(results, sample.rows["k"], parameters)
    if not found.symbols.numel():
        return sample, None
    x_next, *between, u, y, applied = found.results
    state_next, over_next = between[: len(sample.state)], between[len(sample.state) :]
    one = ca.Function("timetable", [sample.rows["k"], parameters], [found.values])
    table = one.map(samples)(ca.DM(range(samples)).T, ca.repmat(p, 1, samples))
    return sample._replace(
        rows={**sample.rows, "timed": found.symbols},
        x_next=x_next,
        state_next=tuple(state_next),
        over_next=tuple(over_next),
        u=u,
        y=y,
        applied=applied,
    ), ca.densify(table)


def one_sample(
    plant: Plant, law: AnyLaw, memory: tuple[object, ...], ready: tuple[object, ...], samples: int
) -> Sample:
    """Return one sample of a plant under a law, the state frozen once the trial has ended.

    ``memory`` and ``ready`` are the law's memory and acting state as the fold has them, for their shapes.
    Raises InvalidValue where an equation gives values of the wrong shape.
    """
    at = plant.symbols()
    ny = len(plant.outputs)
    rows = {
        "r": ca.SX.sym("r", ny),
        "r_next": ca.SX.sym("r_next", ny),
        "w": at["w"],
        "noise": ca.SX.sym("noise", ny),
        "k": at["k"],
        "reached_next": ca.SX.sym("reached_next"),
    }
    shapes = shapes_of(memory)
    for name, (_, columns) in zip(names(memory), shapes, strict=True):
        if columns not in (1, samples, samples + 1):
            raise InvalidValue(
                f"{type(law).__name__}.start must give {name} with 1, N = {samples} or N + 1 columns, got {columns}"
            )
    memory_k = tuple(ca.SX.sym(f"m{i}", lines) for i, (lines, _) in enumerate(shapes))
    state = tuple(ca.SX.sym(f"s{i}", *shape) for i, shape in enumerate(shapes_of(ready)))
    y = plant.measured(at["x"])
    seen = y + rows["noise"]
    u, following = acted(law, plant, like(memory, memory_k), like(ready, state), rows["r"], rows["r_next"], seen)
    x_next = plant.next_state(at["x"], u, at["w"], at["k"])
    going = rows["reached_next"]
    over = (ca.SX.sym("over"),) if plant.ends else ()
    for one in over:
        going = ca.logic_and(going, ca.logic_not(one))
    x_next = ca.if_else(going, x_next, at["x"])
    fed = ca.vertcat(at["x"], rows["noise"], *(ca.vec(one) for one in state))
    return Sample(
        at["x"],
        state,
        memory_k,
        rows,
        x_next,
        tuple(ca.if_else(going, new, old) for new, old in zip(expressions(following), state, strict=True)),
        over,
        tuple(ca.logic_or(one, plant.ended_at(x_next) != 0) for one in over),
        u,
        y,
        plant.applied_input(at["x"], u, at["k"]) if type(plant).applied is not Plant.applied else ca.SX(0, 1),
        ca.depends_on(u, fed),
    )
