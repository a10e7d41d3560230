"""Where a record comes from: versions, digests of what was simulated, and the run id that binds them to the numbers."""

from __future__ import annotations

import hashlib
import inspect
import json
import platform
import subprocess
from collections.abc import Hashable, Mapping
from typing import TypedDict

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from models.expression import Expression
from models.plant import Plant
from models.quantity import Quantity, is_declared, symbolised, walked
from workbench import graph
from workbench.contracts.law import AnyLaw, Task
from workbench.contracts.study import Study
from workbench.distribution import __version__
from workbench.fold.equations import equations
from workbench.fold.machine_code import compiler


class Provenance(TypedDict):
    """What ``provenance.json`` holds, but for the run id and the files: see :func:`provenance`."""

    version: str
    python: str
    casadi: str
    numpy: str
    machine: str
    compiler: str | None
    seed: int
    plants: dict[str, str]
    laws: dict[str, str]


def provenance(study: Study) -> Provenance:
    """Return what a run of a study comes from: nothing in it depends on the day.

    ``version``, ``python``, ``casadi``, ``numpy``, ``machine``, ``compiler`` (the first line that it says of itself,
    None without one), ``seed``, ``plants`` (SHA-256 of the graph of every plant that the study declares, by path)
    and ``laws`` (SHA-256 of what every controller computes, by name).
    """
    return {
        "version": __version__,
        "python": platform.python_version(),
        "casadi": ca.CasadiMeta.version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
        "compiler": _compiler(),
        "seed": study.seed,
        "plants": {path: _of_plant(plant) for path, plant in plants_of(study)},
        "laws": _of_laws(study),
    }


def run_id(attributes: Mapping[Hashable, object], source: Provenance, data: xr.Dataset) -> str:
    """Return the digest that names a run: of study, settings and version, plants, laws, and all that was recorded.

    Of every variable its name, axes, type, shape, attributes and bytes count, so NaN and signed zeros do. Python's,
    NumPy's and the compiler's versions do not: a run that gives the same numbers elsewhere has the same id.
    """
    whole = hashlib.sha256()
    about = [attributes["study"], attributes["settings"], attributes["version"]]
    _add(whole, [*about, source["seed"], source["plants"], source["laws"]])
    for name in sorted(map(str, data.variables)):
        variable = data.variables[name]
        values = variable.values
        text = values.dtype.kind in "UO"
        kind = "text" if text else values.dtype.str
        described = [[str(key), _plain(value)] for key, value in sorted(variable.attrs.items())]
        _add(whole, [name, list(map(str, variable.dims)), kind, list(values.shape), described, name in data.coords])
        if text:
            _add(whole, values.tolist())
        else:
            whole.update(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
    return whole.hexdigest()


def plants_of(study: Study) -> list[tuple[str, Plant]]:
    """Return the plants that a study declares, by path."""
    return [(path, value) for path, _, value in walked(study, _may_hold_plants) if isinstance(value, Plant)]


def _may_hold_plants(spec: Quantity, value: object) -> bool:
    """Tell whether to look into a field: not into a plant, whose own plant is told with it."""
    return spec.kind == "part" and is_declared(value) and not isinstance(value, Plant)


def _of_plant(plant: Plant) -> str:
    """Return the digest of a plant's graph, its quantities being inputs: their values are settings."""
    symbolic = symbolised(plant)
    try:
        function = _of_one_sample(symbolic.thing, symbolic.symbols)
    except Exception:  # one that works with numbers alone still has a graph, its quantities numbers in it
        try:
            function = _of_one_sample(plant, ())
        except Exception:  # it was not the equations that were run
            return _digest(_source(type(plant)))
    try:
        text = graph.to_json(graph.read(function))
    except graph.Unreadable:
        text = function.serialize()
    return _digest(f"{symbolic.names} {text}")


def _of_one_sample(plant: Plant, quantities: tuple[Expression, ...]) -> ca.Function:
    at = plant.symbols()
    results = [plant.next_state(**at), plant.measured(at["x"])]
    names = [*at, *(f"quantity_{i}" for i, _ in enumerate(quantities))]
    return ca.Function(plant.name, [*at.values(), *quantities], results, names, ["x_next", "y"])


def _of_laws(study: Study) -> dict[str, str]:
    """Return a digest of every controller: of its equations where it is folded, of its source where it is stepped."""
    return {
        name: _digest(_source(type(made.law))) if made.law.stepped else _of_equations(*made)
        for name, made in study.folded().items()
    }


def _of_equations(plant: Plant, law: AnyLaw, samples: int, task: Task) -> str:
    try:
        return equations(plant, law, samples, task).content
    except Exception as error:  # a law that does not suit the plant was not run
        return _digest(f"{_source(type(law))}\n{type(error).__name__}")


def _source(kind: type) -> str:
    module = inspect.getmodule(kind)
    try:
        text = inspect.getsource(module) if module is not None else ""
    except (OSError, TypeError):  # written in a notebook or a terminal
        text = ""
    return f"{kind.__qualname__}\n{text}"


def _compiler() -> str | None:
    command = compiler()
    if command is None:
        return None
    said = subprocess.run([command, "--version"], capture_output=True, text=True, check=False)
    return (said.stdout.splitlines() or [command])[0].strip()


def _plain(value: ArrayLike) -> list[object]:
    """Return an attribute as JSON has it: text as it is, numbers with their type, one alone or many."""
    values = np.asarray(value)
    return ["U" if values.dtype.kind == "O" else values.dtype.kind, values.ravel().tolist()]


def _add(whole: hashlib._Hash, content: object) -> None:
    text = json.dumps(content, separators=(",", ":"), sort_keys=True, default=str).encode()
    whole.update(f"{len(text)} ".encode())
    whole.update(text)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
