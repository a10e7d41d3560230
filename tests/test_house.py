"""The house itself: units, docstrings, sources, imports."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import pkgutil
import re
import sys
from pathlib import Path

import pytest

from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench.trials import find as studies

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("models", "workbench", "verification", "studies")
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))


def dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules():
    return [importlib.import_module(dotted(path)) for path in SOURCES if path.stem != "__main__"]


def classes():
    return {
        thing
        for module in modules()
        for _, thing in inspect.getmembers(module, inspect.isclass)
        if thing.__module__ == module.__name__
    }


def without_unit(cls) -> list[str]:
    """Return the fields of a declared class that have no unit or no description."""
    bad = []
    for field in dataclasses.fields(cls):
        spec = field.metadata.get("quantity")
        if spec is None or not spec.doc or (spec.kind in ("number", "count", "table") and not spec.unit):
            bad.append(f"{cls.__name__}.{field.name}")
    return bad


def is_declared_class(cls) -> bool:
    return dataclasses.is_dataclass(cls) and any("quantity" in f.metadata for f in dataclasses.fields(cls))


def test_every_declared_field_has_unit_and_description():
    found = [cls for cls in classes() if is_declared_class(cls)]
    assert len(found) > 8
    assert [name for cls in found for name in without_unit(cls)] == []


def test_a_field_without_unit_is_seen():
    @declared
    class Bad:
        size: float = quantity(default=1.0, unit="", doc="a number without a unit")

    assert without_unit(Bad) == ["Bad.size"]
    with pytest.raises(TypeError, match=r"Worse\.size has no unit"):

        @declared
        class Worse:
            size: float = 1.0

        Worse()


def test_every_plant_is_declared_and_its_signals_have_units():
    plants = [cls for cls in classes() if issubclass(cls, Plant) and not inspect.isabstract(cls)]
    assert plants
    for cls in plants:
        assert is_declared_class(cls), cls
        assert cls.source, f"{cls.__name__} names no source"
        try:
            plant = cls()
        except TypeError:  # a wrapper needs the plant that it wraps
            continue
        for named in (plant.states, plant.inputs, plant.outputs, plant.disturbances):
            assert all(signal.unit for signal in named), cls
    assert not signals(speed="")[0].unit


def test_every_controller_has_a_source_and_is_in_a_study():
    folder = ROOT / "workbench" / "controllers"
    laws = {cls for cls in classes() if cls.__module__.startswith("workbench.controllers.") and hasattr(cls, "act")}
    assert len(laws) >= len(list(folder.glob("*.py"))) - 1
    used = {
        type(law)
        for name in studies.names()
        for law in dict(getattr(studies.find(name), "controllers", None) or {}).values()
    }
    for law in laws:
        assert law.source, law
        assert any(char.isdigit() for char in law.source), f"{law.__name__}: a source names its year"
        assert law in used, f"{law.__name__} is in no study"


def public_names():
    for module in modules():
        yield module.__name__, module
        for name, thing in vars(module).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
                continue
            if inspect.isclass(thing):
                yield f"{module.__name__}.{name}", thing
                for inner, member in vars(thing).items():
                    plain = inspect.isfunction(member) or isinstance(member, (property, classmethod, staticmethod))
                    if plain and not inner.startswith("_"):
                        yield f"{module.__name__}.{name}.{inner}", member
            elif inspect.isfunction(thing):
                yield f"{module.__name__}.{name}", thing


def test_every_public_name_has_a_docstring():
    missing = [name for name, thing in public_names() if not (inspect.getdoc(thing) or "").strip()]
    assert missing == []


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("path", SOURCES, ids=dotted)
def test_folders_import_one_way(path):
    above = {
        "models": {"workbench", "verification", "studies"},
        "workbench": {"verification", "studies"},
        "verification": {"studies"},
        "studies": set(),
    }
    allowed = {"verification"} if path.name == "cli.py" else set()
    folder = path.relative_to(ROOT).parts[0]
    forbidden = (above[folder] - allowed) | {"tests", "benchmarks", "notebooks"}
    assert not imported(path) & forbidden


def test_models_stand_on_casadi_and_numpy_only():
    allowed = set(sys.stdlib_module_names) | {"models", "casadi", "numpy"}
    for path in (ROOT / "models").glob("*.py"):
        extra = {"control"} if path.stem == "control_systems" else set()
        assert imported(path) <= allowed | extra, path


def test_one_room_reads_casadis_instructions():
    readers = {
        dotted(path)
        for path in SOURCES
        if re.search(r"\binstructions?_(id|input|output|constant|sx|MX)\b", path.read_text())
    }
    assert readers == {"workbench.graph.reading"}


def test_the_graph_stands_alone():
    for path in (ROOT / "workbench" / "graph").glob("*.py"):
        assert (
            re.findall(
                r"^\s*(?:from|import) (?:models|verification|studies|workbench(?!\.graph))", path.read_text(), re.M
            )
            == []
        )


def test_modules_are_short():
    long = {dotted(path): count for path in SOURCES if (count := len(path.read_text().splitlines())) > 400}
    assert long == {}


def test_packages_are_complete():
    for folder in FOLDERS:
        package = importlib.import_module(folder)
        for info in pkgutil.iter_modules(package.__path__):
            assert (ROOT / folder / f"{info.name}.py").exists() or (ROOT / folder / info.name / "__init__.py").exists()
