"""One sample of plant and law: its symbols, its results, and what of it depends on time alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from models.plant import Plant, stacked
from models.quantity import InvalidValue
from workbench.fold.timetable import timetable


class Sample(NamedTuple):
    """One sample of plant and law in SX: symbols by name and results."""

    x: ca.SX
    state: Any
    memory: Any
    rows: dict[str, ca.SX]
    x_next: ca.SX
    state_next: Any
    u: ca.SX
    y: ca.SX
    applied: ca.SX
    feeds_back: bool


def without_time(sample: Sample, symbols: dict[str, ca.SX], p: Any, samples: int) -> tuple[Sample, Any]:
    """Take what depends on time alone out of a sample; return it with its rows (m, N) as an MX of p, or None."""
    results = [sample.x_next, *sample.state_next, sample.u, sample.y, sample.applied]
    parameters = ca.vertcat(*symbols.values())
    found = timetable(results, sample.rows["k"], parameters)
    if not found.symbols.numel():
        return sample, None
    x_next, *state_next, u, y, applied = found.results
    one = ca.Function("timetable", [sample.rows["k"], parameters], [found.values])
    table = one.map(samples)(ca.DM(range(samples)).T, ca.repmat(p, 1, samples))
    return sample._replace(
        rows={**sample.rows, "timed": found.symbols},
        x_next=x_next,
        state_next=like(sample.state_next, state_next),
        u=u,
        y=y,
        applied=applied,
    ), ca.densify(table)


def like(pattern: Any, values: Sequence[Any]) -> Any:
    """Return values in the NamedTuple type of pattern, or () where that is empty."""
    return type(pattern)(*values) if values else ()


def one_sample(plant: Plant, law: Any, memory: Any, ready: Any, samples: int) -> Sample:
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
    memory_k = like(memory, [ca.SX.sym(f"m{i}", field.shape[0]) for i, field in enumerate(memory)])
    for name, field in zip(getattr(memory, "_fields", ()), memory, strict=True):
        if field.shape[1] not in (1, samples, samples + 1):
            raise InvalidValue(
                f"{type(law).__name__}: memory {name} must have 1, N = {samples} or N + 1 columns, got {field.shape[1]}"
            )
    state = like(ready, [ca.SX.sym(f"s{i}", *ca.MX(field).shape) for i, field in enumerate(ready)])
    y = plant.measured(at["x"])
    u, state_next = law.act(memory_k, state, rows["r"], rows["r_next"], y + rows["noise"])
    u = stacked(u, plant.inputs, f"{type(law).__name__}.act")
    x_next = plant.next_state(at["x"], u, at["w"], at["k"])
    going = rows["reached_next"]
    fed = ca.vertcat(at["x"], rows["noise"], *(ca.vec(field) for field in state))
    return Sample(
        at["x"],
        state,
        memory_k,
        rows,
        ca.if_else(going, x_next, at["x"]),
        like(ready, [ca.if_else(going, new, old) for new, old in zip(state_next, state, strict=True)]),
        u,
        y,
        plant.applied_input(at["x"], u, at["k"]) if type(plant).applied is not Plant.applied else ca.SX(0, 1),
        ca.depends_on(u, fed),
    )
