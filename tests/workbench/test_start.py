"""What starting imports, told without a clock: nothing that the question does not need."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.trials import find as studies

PACKAGES = ("models", "workbench", "verification", "studies")
HEAVY = ("casadi", "control", "h5netcdf", "matplotlib", "numpy", "scipy", "tqdm", "xarray")
LOADED = "\nimport sys; print('loaded', *sorted(sys.modules), file=sys.stderr)"
COMMAND = (
    "import sys; from workbench.cli import main\nsys.argv = ['workbench', *{}]\ntry: main()\nexcept SystemExit: pass"
)


def loaded(code: str) -> set[str]:
    """Return the modules that a new process holds after it ran some code."""
    done = subprocess.run([sys.executable, "-c", code + LOADED], capture_output=True, text=True, timeout=60, check=True)
    word, *names = done.stderr.splitlines()[-1].split()
    assert word == "loaded"
    return set(names)


def test_the_instrument_sees_what_is_loaded():
    assert {"numpy", "casadi", "models.plant"} <= loaded("import models.plant")


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], ["list"], ["run", "--help"]], ids=" ".join)
def test_a_command_that_computes_nothing_loads_nothing_to_compute_with(arguments):
    names = loaded(COMMAND.format(arguments))
    assert names.isdisjoint(HEAVY)
    assert not {name for name in names if name.startswith("studies.") and name.count(".") > 1}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_loads_nothing_beyond_itself(package):
    names = loaded(f"import {package}")
    assert names.isdisjoint(HEAVY)
    assert {name for name in names if name.split(".")[0] in PACKAGES} == {package}


@pytest.mark.parametrize("names", ["Plant, quantity", "quantity, Plant"])
def test_the_order_of_asking_changes_nothing(names):
    loaded(f"from models import {names}; from models.quantity import count; quantity(default=1.0, unit='1', doc='d')")


@pytest.mark.parametrize("name", studies.names())
def test_the_title_that_is_listed_is_the_study_s(name):
    assert studies.titles()[name] == studies.find(name).title != ""


@pytest.mark.parametrize("package", [name for name in PACKAGES if name != "studies"])
def test_the_stub_says_where_the_lazy_names_live(package):
    module = importlib.import_module(package)
    stub = ast.parse(Path(str(module.__file__)).with_suffix(".pyi").read_text())
    said = {alias.name: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert said == module._HOME
    assert set(said) - {"__version__"} == set(module.__all__)
    for name, home in said.items():  # also where a child module has the name and was imported first, as models.quantity
        assert getattr(module, name) is getattr(importlib.import_module(home), name)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        getattr(module, "nothing")  # noqa: B009  # the name is not there, mypy would say so
