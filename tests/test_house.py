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
    laws = {
        cls
        for cls in classes()
        if cls.__module__.startswith("workbench.controllers.") and hasattr(cls, "act") and not inspect.isabstract(cls)
    }
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
    allowed = {"verification"} if dotted(path) == "workbench.cli" else set()
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


def copied(texts: dict[str, str], least: int = 40) -> list[tuple[str, ...]]:
    """Return the functions and classes of modules that stand word for word in more than one of them.

    ``least`` is how many nodes a body has: shorter ones may be alike.
    """
    places: dict[tuple[str, str], list[str]] = {}
    for module, text in texts.items():
        for node in ast.parse(text).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and sum(1 for _ in ast.walk(node)) >= least:
                places.setdefault((node.name, ast.dump(node)), []).append(module)
    return sorted((name, *sorted(modules)) for (name, _), modules in places.items() if len(modules) > 1)


def left_behind(texts: dict[str, str], besides: str = "") -> list[str]:
    """Return the modules that nobody names: no other one, nor ``besides``, imports them or tells their file.

    Packages and what is run by itself are no such modules.
    """
    named: set[str] = set()
    for module, text in texts.items():
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.ImportFrom(module=str(origin)):
                    named |= {origin, *(f"{origin}.{alias.name}" for alias in node.names)} - {module}
                case ast.Import():
                    named |= {alias.name for alias in node.names} - {module}
                case ast.Constant(value=str(said)):
                    named |= {one for one in texts if one != module and said in (one, one.rpartition(".")[2] + ".py")}
    alone = {module for module, text in texts.items() if "__main__" in module or 'if __name__ == "__main__"' in text}
    folders = {module.rpartition(".")[0] for module in texts}
    return sorted(one for one in set(texts) - named - alone - folders if f'"{one}:' not in besides)


def texts_of_all() -> dict[str, str]:
    return {dotted(path): path.read_text(encoding="utf-8") for path in SOURCES}


def test_nothing_is_copied_or_left_behind():
    texts = texts_of_all()
    assert copied(texts) == []
    assert left_behind(texts, (ROOT / "pyproject.toml").read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(("module", "old"), [("verification.checks.jump", "verification.jump"),
                                             ("workbench.trials.metrics", "workbench.metrics")])  # fmt: skip
def test_a_module_left_at_its_old_place_is_seen(module, old):
    texts = texts_of_all()
    texts[old] = texts[module]
    assert old in left_behind(texts)
    assert all({module, old} <= set(one) for one in copied(texts)) and copied(texts)


def test_modules_are_short():
    long = {dotted(path): count for path in SOURCES if (count := len(path.read_text().splitlines())) > 400}
    assert long == {}


def test_packages_are_complete():
    for folder in FOLDERS:
        package = importlib.import_module(folder)
        for info in pkgutil.iter_modules(package.__path__):
            assert (ROOT / folder / f"{info.name}.py").exists() or (ROOT / folder / info.name / "__init__.py").exists()


@pytest.mark.parametrize("front", ["workbench", "verification"])
def test_no_name_of_a_front_door_is_that_of_a_child(front):
    package = importlib.import_module(front)
    children = {info.name for info in pkgutil.iter_modules(package.__path__)}
    assert children and package.__all__
    assert not children & set(package.__all__)


TRAINS = r"trains?|metros?|maglevs?|brak(?:e|es|ed|ing)|rails?|railways?|jerks?|jerky|adhesion|kwh|kmh|km/h"
AUTHORS = r"jiao|hou|liu|xun|gao|yin|zhang|cao|chu|yuan|jiang|wang|njit"
ALIKE = r"Nan|Yu|Lin|Bu"
"""Authors who are spelt like a number that is missing, or a linear thing: only where they stand alone."""
WHOLE = r"(?<![A-Za-z])(?:{})(?![A-Za-z])"
FORBIDDEN = re.compile(WHOLE.format(rf"(?i:{TRAINS}|{AUTHORS})"))
FORBIDDEN_ALONE = re.compile(WHOLE.format(rf"(?i:{TRAINS}|{AUTHORS})|{ALIKE}"))
HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
"""Where a word of an identifier in camel case begins: ``KnownTrain`` holds the word train, ``Training`` does not."""

NAMED_FOR_A_PLANT = {"brake", "braking_curve", "maglev", "metro_line", "metro_profile", "point_mass"}
"""The files of models that are about one paper's plant or its reference, and may say so."""
NAMES_ITS_PAPER = ("workbench/controllers/", "verification/theorems/")
"""Where a docstring and a source may name papers and what they are about."""
TEXTS = {".py", ".pyi", ".j2", ".md", ".c", ".h", ".toml", ".json"}


def general_files() -> list[Path]:
    files = [path for room in ("models", "workbench", "verification") for path in (ROOT / room).rglob("*")]
    return sorted(
        path
        for path in files
        if path.suffix in TEXTS and not (path.parent == ROOT / "models" and path.stem in NAMED_FOR_A_PLANT)
    )


def papers_named(tree: ast.Module):
    """Yield the constants that are a docstring, or what a name ``source`` or ``PAPER`` is given."""
    for node in ast.walk(tree):
        match node:
            case ast.Module() | ast.ClassDef() | ast.FunctionDef():
                texts = [
                    one.value for one in node.body if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant)
                ]
            case ast.Assign(targets=[ast.Name(id="source" | "PAPER")], value=value):
                texts = [value]
            case ast.AnnAssign(target=ast.Name(id="source" | "PAPER"), value=value):
                texts = [value]
            case ast.keyword(arg="source", value=value):
                texts = [value]
            case _:
                texts = []
        for text in texts:
            yield from (part for part in ast.walk(text) if isinstance(part, ast.Constant)) if text else ()


def without_papers(text: str) -> str:
    """Return a module's text with its docstrings and sources blanked, its lines where they were."""
    lines = [line.encode() for line in text.split("\n")]
    for part in papers_named(ast.parse(text)):
        if isinstance(part.value, str):
            for row in range(part.lineno - 1, part.end_lineno):
                begin = part.col_offset if row == part.lineno - 1 else 0
                end = part.end_col_offset if row == part.end_lineno - 1 else len(lines[row])
                lines[row] = lines[row][:begin] + b" " * (end - begin) + lines[row][end:]
    return b"\n".join(lines).decode()


def special_words(name: str, text: str) -> list[str]:
    """Return what a general file says of trains and authors, each as ``name:line: word``; its name counts too."""
    if name.startswith(NAMES_ITS_PAPER) and name.endswith(".py"):
        text = without_papers(text)
    found = {}
    for number, line in enumerate([name, *text.split("\n")]):
        for words, said in ((FORBIDDEN_ALONE, line), (FORBIDDEN, HUMP.sub("_", line))):
            for match in words.finditer(said):
                found.setdefault((number, match[0].lower()), match[0])
    return [f"{name}:{number}: {word}" for (number, _), word in sorted(found.items())]


def test_general_rooms_know_nothing_special():
    files = general_files()
    assert len(files) > 100
    found = [word for path in files for word in special_words(path.relative_to(ROOT).as_posix(), path.read_text())]
    assert found == []


def test_the_files_named_for_a_plant_exist():
    assert {path.stem for path in (ROOT / "models").glob("*.py")} >= NAMED_FOR_A_PLANT


LAW = '''"""The law of Jiao & Hou for a metro train."""

class Law:
    """Brakes a train."""

    source: ClassVar[str] = "Jiao & Hou 2025, (1)"

    {line}
'''
PAPER = ("Hou", "Jiao")


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("workbench/trials/metrics.py", "def train_scores(): ...", ["train"]),
        ("workbench/trials/metrics.py", "class KnownTrain: ...", ["Train"]),
        ("workbench/trials/metrics.py", "class HTTPTrain: ...", ["Train"]),
        ("workbench/trials/metrics.py", "JOULES_PER_KWH = energy_kwh = 1", ["KWH"]),
        ("workbench/trials/table.py", 'heading = "energy (kWh)"', ["kWh"]),
        ("workbench/trials/table.py", "# (km/h)/N", ["km/h"]),
        ("workbench/trials/table.py", '"""Jerk: the train\'s, as Metro\'s."""', ["Jerk", "Metro", "train"]),
        ("workbench/trials/table.py", "MetroProfile", ["Metro"]),
        ("workbench/trials/table.py", "brake_model", ["brake"]),
        ("workbench/metro.py", "", ["metro"]),
        ("verification/checks/any.py", "x = 1  # after Liu et al.", ["Liu"]),
        ("verification/checks/any.py", "class Any: source = 'Chu & Yu'", ["Chu", "Yu"]),
        ("verification/checks/any.py", "class LiuTube(LinAlgError): hou_2025 = np.nan", ["hou", "Liu"]),
        ("verification/report/report.html.j2", "<p>adhesion on rails</p>", ["adhesion", "rails"]),
        ("workbench/trials/network.py", "training = constrained(trainable, np.nan, NaN, np.linspace, 'lin')", []),
        ("workbench/trials/network.py", "guardrail, brakeman, railing, you, bus, linear, Linear, Yule", []),
        ("workbench/controllers/law.py", LAW.format(line="x = 1"), []),
        ("verification/theorems/law.py", LAW.format(line='Claim(source=f"{PAPER}, Hou 2025")'), []),
        ("workbench/trials/law.py", LAW.format(line="x = 1"), [*PAPER, "metro", "train", "Brakes", "train", *PAPER]),
        ("workbench/controllers/law.py", LAW.format(line="x = 1  # of the train"), ["train"]),
        ("workbench/controllers/law.py", LAW.format(line='mass = quantity(doc="of the train")'), ["train"]),
        ("workbench/controllers/law.py", LAW.format(line='sources = "Hou"'), ["Hou"]),
        ("workbench/controllers/law.py", LAW.format(line='told("the train")'), ["train"]),
    ],
)
def test_special_words_are_seen(name, text, found):
    said = [word.rpartition(" ")[2] for word in special_words(name, text)]
    assert said == found


def left_open(tree: ast.AST) -> int:
    """Return how often types are left open: Any, and callables that take whatever they are given."""
    named = sum(isinstance(node, ast.Name) and node.id == "Any" for node in ast.walk(tree))
    called = [
        node.slice for node in ast.walk(tree) if isinstance(node, ast.Subscript) and "Callable" in ast.dump(node.value)
    ]
    first = [one.elts[0] for one in called if isinstance(one, ast.Tuple)]
    return named + sum(isinstance(one, ast.Constant) and one.value is Ellipsis for one in first)


def test_few_types_are_left_open():
    assert left_open(ast.parse("a: Any\nb: Callable[..., int]\nc: Callable[[], int]")) == 2
    ignored = sum(path.read_text().count("# type: ignore") for path in SOURCES)
    assert sum(left_open(ast.parse(path.read_text())) for path in SOURCES) + ignored < 60
