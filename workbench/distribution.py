"""The installed distribution: its name, its version, which pyproject.toml alone says, and where its packages lie."""

from __future__ import annotations

import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

DISTRIBUTION = "learning-control-workbench"
PACKAGES = ("models", "workbench", "verification", "studies")
"""The packages that it holds; they are everybody's words, so other files have these names too."""
__version__ = version(DISTRIBUTION)


class HiddenPackageError(ImportError):
    """A package of the workbench is hidden by another file of its name; one line that says which, meant for the user.

    It is no InvalidValue because that may be what is hidden.
    """


def unhidden(*names: str) -> None:
    """Raise HiddenPackageError unless the packages named are those that lie beside this one."""
    floor = Path(__file__).resolve().parents[1]
    for name in names:
        try:
            spec = find_spec(name)
        except ValueError:  # a module that somebody put there himself
            spec = None
        found = list(spec.submodule_search_locations or ()) if spec else []
        if floor / name in [Path(place).resolve() for place in found]:
            continue
        place = (spec.origin if spec else None) or (found[0] if found else _file(name))
        raise HiddenPackageError(
            f"{name} must be the package in {floor}, but {place or 'another'} has its name and is found first: "
            "rename that, or start from another folder"
        )


def _file(name: str) -> str:
    """Return the file of a module that is loaded, or nothing."""
    module = sys.modules.get(name)
    return "" if module is None else str(vars(module).get("__file__", ""))
