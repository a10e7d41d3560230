"""The project's papers: licence, citation, version, types."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import workbench
from workbench.distribution import DISTRIBUTION

ROOT = Path(__file__).resolve().parents[1]
AUTHORS = "the learning-control-workbench authors"
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = SETTINGS["project"]


def cited() -> dict[str, str]:
    """Return the citation's values; it is YAML of one level, but for the list of authors."""
    pairs = re.findall(r"^(?:  - )?([a-z-]+):(?: (.+))?$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert len(pairs) == len((ROOT / "CITATION.cff").read_text().splitlines())
    return {key: value.strip('"') for key, value in pairs}


def test_the_licence_is_the_one_that_is_declared():
    assert PROJECT["license"] == "BSD-3-Clause" and PROJECT["license-files"] == ["LICENSE"]
    assert PROJECT["authors"] == [{"name": AUTHORS}]
    text = (ROOT / "LICENSE").read_text()
    assert text.startswith("BSD 3-Clause License\n") and f"Copyright (c) 2026 {AUTHORS}" in text
    assert re.findall(r"^(\d)\. ", text, re.MULTILINE) == ["1", "2", "3"]
    assert not [name for name in PROJECT["classifiers"] if name.startswith("License ::")]  # the expression says it


def test_the_citation_is_of_this_package():
    found = cited()
    assert found.pop("authors") == ""
    assert found.pop("message") and found.pop("title").lower().replace(" ", "-") == DISTRIBUTION
    assert found == {
        "cff-version": "1.2.0",
        "type": "software",
        "name": AUTHORS,
        "version": PROJECT["version"],
        "license": PROJECT["license"],
    }


def test_every_package_says_that_it_is_typed():
    packages = [pattern.rstrip("*") for pattern in SETTINGS["tool"]["setuptools"]["packages"]["find"]["include"]]
    assert len(packages) == 4
    for package in packages:
        assert (ROOT / package / "py.typed").read_text() == ""
    assert {"*.pyi", "py.typed"} <= set(SETTINGS["tool"]["setuptools"]["package-data"]["*"])


def test_there_is_one_version_and_everybody_says_it():
    assert PROJECT["name"] == DISTRIBUTION
    assert workbench.__version__ == version(DISTRIBUTION) == PROJECT["version"]
    said = subprocess.run([sys.executable, "-m", "workbench", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout == f"workbench {PROJECT['version']}\n"
    written = [
        path for folder in ("models", "workbench", "verification", "studies") for path in (ROOT / folder).rglob("*.py*")
    ]
    assert not [path for path in written if path.suffix != ".pyc" and PROJECT["version"] in path.read_text()]
