"""What plant and law say over N samples, as expressions, and their content, by which they are told apart.

The declarations themselves do not tell what they compute: a method may read a global, a closure or a table that was
changed since. Their equations do. So the equations are asked for every time, which is cheap, and what is made of
them is kept by their content.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import casadi as ca

from models.function_name import function_name
from models.plant import Plant
from models.quantity import symbolised
from workbench.contracts.law import Law, Task, Trial
from workbench.fold.sample import Sample, like, one_sample

MEMORY = "memory_"


@dataclasses.dataclass(frozen=True)
class Equations:
    """One sample of a plant under a law, and the law between trials; two are equal when they compute the same.

    The expressions share the symbols ``given`` and ``kept``; quantities are entries of ``given["p"]``.
    """

    content: str
    """A digest of all that a Function made of these equations depends on: serialised expressions, names, sizes."""
    plant: Plant = dataclasses.field(compare=False)
    """The plant, its quantities SX symbols."""
    law: Law = dataclasses.field(compare=False)
    """The law, its quantities entries of p."""
    samples: int = dataclasses.field(compare=False)
    symbols: dict[str, ca.SX] = dataclasses.field(compare=False)
    """The quantities' symbols in ``sample``, by name, in the order of p."""
    given: dict[str, ca.MX] = dataclasses.field(compare=False)
    """sampling_time, and what a trial is given: x0, length, r, w, noise, p."""
    first: tuple[ca.MX, ...] = dataclasses.field(compare=False)
    """The memory before the first trial."""
    kept: dict[str, ca.MX] = dataclasses.field(compare=False)
    """The memory of a trial, by name."""
    memory: Any = dataclasses.field(compare=False)
    """The same as the law's NamedTuple."""
    begin: Any = dataclasses.field(compare=False)
    """The state in which the trial begins."""
    ready: Any = dataclasses.field(compare=False)
    """The acting state with which it begins."""
    sample: Sample = dataclasses.field(compare=False)


def equations(plant: Plant, law: Law, samples: int) -> Equations:
    """Ask plant and law for their equations over N samples.

    Raises InvalidValue where step, output or act give values of the wrong shape.
    """
    ny, nu, nx, nw = (len(named) for named in (plant.outputs, plant.inputs, plant.states, plant.disturbances))
    plant_sx, law_sx = symbolised(plant), symbolised(law)
    names = [f"plant.{name}" for name in plant_sx.names] + [f"law.{name}" for name in law_sx.names]
    symbols = dict(zip(names, [*plant_sx.symbols, *law_sx.symbols], strict=True))
    p = ca.MX.sym("p", len(names))
    pieces = iter(ca.vertsplit(p) if names else [])
    limits = symbolised(plant, lambda name: next(pieces)).thing.input_limits
    law_mx: Law = symbolised(law, lambda name: next(pieces)).thing
    given = {
        "x0": ca.MX.sym("x0", nx),
        "length": ca.MX.sym("length"),
        "r": ca.MX.sym("r", ny, samples + 1),
        "w": ca.MX.sym("w", nw, samples),
        "noise": ca.MX.sym("noise", ny, samples + 1),
        "p": p,
        "sampling_time": ca.MX.sym("sampling_time"),
    }
    begun = law_mx.start(Task(given["r"], given["sampling_time"], limits))
    fields = [MEMORY + function_name(name) for name in getattr(begun, "_fields", ())]
    first = tuple(ca.densify(ca.MX(value)) for value in begun)
    kept = {name: ca.MX.sym(name, *value.shape) for name, value in zip(fields, first, strict=True)}
    memory = like(begun, list(kept.values()))
    begin, ready = law_mx.place(memory, given["x0"]), law_mx.ready(memory)
    sample = one_sample(plant_sx.thing, law_sx.thing, memory, ready, samples)

    rows = {"y": (ny, samples + 1), "e": (ny, samples + 1), "u": (nu, samples), "reached": (1, samples + 1)}
    left = {name: ca.MX.sym(name, *shape) for name, shape in rows.items()}
    state = like(ready, [ca.MX.sym(f"s{i}", field.shape[0], samples) for i, field in enumerate(sample.state)])
    trial = Trial(given["r"], left["y"], left["e"], left["u"], left["reached"], state)
    estimate = law_mx.ppd_estimate(memory)
    between = {
        "first": first,
        "begin": (begin,),
        "ready": ready,
        "learned": law_mx.learn(memory, trial),
        "told": law_mx.tell(memory, trial) if law_mx.tells else (),
        "estimate": () if estimate is None else (estimate,),
    }
    asked = [given[name] for name in ("x0", "r", "p", "sampling_time")]
    within = [sample.x_next, *sample.state_next, sample.u, sample.y, sample.applied]
    about = (
        samples,
        plant.name,
        type(law).__name__,
        names,
        fields,
        [(name, len(values)) for name, values in between.items()],
    )
    content = _digest(
        json.dumps(about),
        _serialised(
            [*asked, *kept.values(), *left.values(), *state], [ca.MX(one) for all in between.values() for one in all]
        ),
        _serialised([sample.x, *sample.state, *sample.memory, *sample.rows.values(), *symbols.values()], within),
    )
    return Equations(
        content, plant_sx.thing, law_mx, samples, symbols, given, first, kept, memory, begin, ready, sample
    )


def _serialised(symbols: list[Any], values: list[Any]) -> str:
    """Return expressions as text that tells them apart to the last bit of every number."""
    text: str = ca.Function("content", symbols, values).serialize()
    return text


def _digest(*texts: str) -> str:
    whole = hashlib.sha256()
    for text in texts:
        whole.update(f"{len(text)} ".encode())
        whole.update(text.encode())
    return whole.hexdigest()
