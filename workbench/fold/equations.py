"""What plant and law say over N samples, as expressions, and their content, by which they are told apart.

The declarations themselves do not tell what they compute: a method may read a global, a closure or a table that was
changed since. Their equations do. So the equations are asked for every time, which is cheap, and what is made of
them is kept by their content.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence

import casadi as ca

from models.expression import Expression, as_expression
from models.function_name import function_name
from models.plant import Plant
from models.quantity import symbolised
from workbench.contracts.law import AnyLaw, Task, Trial
from workbench.fold.answers import begun, estimated, learned, made_ready, placed, tellings
from workbench.fold.named import as_matrix, expressions, like, names
from workbench.fold.sample import Sample, one_sample

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
    law: AnyLaw = dataclasses.field(compare=False)
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
    memory: tuple[object, ...] = dataclasses.field(compare=False)
    """The same as the law's NamedTuple."""
    begin: Expression = dataclasses.field(compare=False)
    """The state in which the trial begins."""
    ready: tuple[object, ...] = dataclasses.field(compare=False)
    """The acting state with which it begins."""
    sample: Sample = dataclasses.field(compare=False)


def equations(plant: Plant, law: AnyLaw, samples: int, task: Task | None = None) -> Equations:
    """Ask plant and law for their equations over N samples.

    ``task`` is what the law is told besides reference, sampling time and limits; by default nothing.
    Raises InvalidValue where step, output or act give values of the wrong shape.
    """
    ny, nu, nx, nw = (len(named) for named in (plant.outputs, plant.inputs, plant.states, plant.disturbances))
    plant_sx, law_sx = symbolised(plant), symbolised(law)
    quantities = [f"plant.{name}" for name in plant_sx.names] + [f"law.{name}" for name in law_sx.names]
    symbols = dict(zip(quantities, [*plant_sx.symbols, *law_sx.symbols], strict=True))
    p = ca.MX.sym("p", len(quantities))
    pieces = iter(ca.vertsplit(p) if quantities else [])
    limits = symbolised(plant, lambda name: next(pieces)).thing.input_limits
    law_mx: AnyLaw = symbolised(law, lambda name: next(pieces)).thing
    given = {
        "x0": ca.MX.sym("x0", nx),
        "length": ca.MX.sym("length"),
        "r": ca.MX.sym("r", ny, samples + 1),
        "w": ca.MX.sym("w", nw, samples),
        "noise": ca.MX.sym("noise", ny, samples + 1),
        "p": p,
        "sampling_time": ca.MX.sym("sampling_time"),
    }
    if task is None:
        task = Task(as_expression(given["r"]), as_expression(given["sampling_time"]))
    if task.chance.numel():
        given["chance"] = ca.MX.sym("chance", task.chance.numel())
    if task.first_plan is not None:
        given["plan"] = ca.MX.sym("plan", nu, samples)
    before = begun(
        law_mx,
        task._replace(
            reference=as_expression(given["r"]),
            sampling_time=as_expression(given["sampling_time"]),
            limits=limits,
            first_plan=as_expression(given["plan"]) if "plan" in given else None,
            chance=as_expression(given["chance"]) if "chance" in given else task.chance,
        ),
    )
    fields = [MEMORY + function_name(name) for name in names(before)]
    first = tuple(ca.densify(as_matrix(value)) for value in expressions(before))
    kept = {name: ca.MX.sym(name, *value.shape) for name, value in zip(fields, first, strict=True)}
    memory = like(before, list(kept.values()))
    begin, ready = placed(law_mx, memory, as_expression(given["x0"])), made_ready(law_mx, memory)
    sample = one_sample(plant_sx.thing, law_sx.thing, memory, ready, samples)

    rows = {"y": (ny, samples + 1), "e": (ny, samples + 1), "u": (nu, samples), "reached": (1, samples + 1)}
    left = {name: ca.MX.sym(name, *shape) for name, shape in rows.items()}
    states = [ca.MX.sym(f"s{i}", field.shape[0], samples) for i, field in enumerate(sample.state)]
    state = like(ready, states)
    seen = {name: as_expression(value) for name, value in left.items()}
    trial = Trial(as_expression(given["r"]), seen["y"], seen["e"], seen["u"], seen["reached"], state)
    estimate = estimated(law_mx, memory, plant, samples)
    between: dict[str, Sequence[Expression]] = {
        "first": [as_expression(value) for value in first],
        "begin": (begin,),
        "ready": expressions(ready),
        "learned": expressions(learned(law_mx, memory, trial)),
        "told": tellings(law_mx, memory, trial, samples),
        "estimate": () if estimate is None else (estimate,),
    }
    asked = [given[name] for name in given if name not in ("length", "w", "noise")]
    within = [sample.x_next, *sample.state_next, *sample.over_next, sample.u, sample.y, sample.applied]
    about = (
        samples,
        plant.name,
        type(law).__name__,
        quantities,
        fields,
        [(name, len(values)) for name, values in between.items()],
    )
    content = _digest(
        json.dumps(about),
        ca.Function(
            "content",
            [*asked, *kept.values(), *left.values(), *states],
            [as_matrix(one) for all in between.values() for one in all],
        ).serialize(),
        ca.Function(
            "content",
            [sample.x, *sample.state, *sample.over, *sample.memory, *sample.rows.values(), *symbols.values()],
            within,
        ).serialize(),
    )
    return Equations(
        content, plant_sx.thing, law_mx, samples, symbols, given, first, kept, memory, begin, ready, sample
    )


def _digest(*texts: str) -> str:
    """Return what tells texts apart; serialised expressions are text to the last bit of every number."""
    whole = hashlib.sha256()
    for text in texts:
        whole.update(f"{len(text)} ".encode())
        whole.update(text.encode())
    return whole.hexdigest()
