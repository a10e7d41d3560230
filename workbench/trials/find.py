"""Studies by name, from the entry points of what is installed, and a study in a user's own file."""

from __future__ import annotations

import ast
import difflib
import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from models.errors import InvalidValue
from models.users_code import InUsersCodeError, place_of
from workbench.distribution import PACKAGES, unhidden

if TYPE_CHECKING:
    from workbench.contracts.study import Study

GROUP = "workbench.studies"
"""The entry points that name studies: ``name = "package.module:STUDY"``."""


def names() -> tuple[str, ...]:
    """Return the names of the studies that are installed, in alphabetical order."""
    return tuple(sorted(entry_points(group=GROUP).names))


def titles() -> Mapping[str, str]:
    """Return what every installed study is, in one line, by name in alphabetical order, without importing any."""
    unhidden("studies")
    found = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return {entry.name: _first_line(entry.module) for entry in found}


def _first_line(module: str) -> str:
    """Return the first line of a module's docstring, read from its source, without its full stop."""
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return ""
    document = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
    return document.partition("\n")[0].rstrip(".")


def find(name: str) -> Study:
    """Return a study: an installed one by name, or the ``study`` of a Python file by its path.

    Raises InvalidValue for an unknown name, and for a file that is missing, fails or declares no study.
    """
    if name.endswith(".py"):
        return _from_file(Path(name))
    entry = _entry(name)
    if entry.module.partition(".")[0] == "studies":
        unhidden("studies")
    study: Study = entry.load()
    return study


def _entry(name: str) -> EntryPoint:
    found = entry_points(group=GROUP, name=name)
    if found:
        return next(iter(found))
    known = names()
    near = difflib.get_close_matches(name, known, n=1)
    hint = (
        f"did you mean {near[0]}?" if near else f"the studies are: {', '.join(known) or 'none, as none is installed'}"
    )
    raise InvalidValue(f"there is no study {name!r}; {hint} (a study of your own is given as a .py file)")


def _from_file(file: Path) -> Study:
    if not file.is_file():
        raise InvalidValue(f"a study of your own is given as an existing .py file, got {file}")
    spec = importlib.util.spec_from_file_location(f"study_{abs(hash(file.resolve()))}", file)
    assert spec is not None and spec.loader is not None, "a .py file always has a loader"
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        with _importable(file.resolve().parent):
            spec.loader.exec_module(module)
    except InUsersCodeError:
        raise
    except InvalidValue as error:
        place = place_of(error)
        raise InvalidValue(str(error) if place is None else f"{place} failed: {error}") from error
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if Path(frame.filename).resolve() == file.resolve()]
        at = f"{file}, line {lines[-1]}," if lines else file
        message = (str(error).strip() or "no message").splitlines()[0]
        raise InvalidValue(f"{at} failed: {type(error).__name__}: {message}{_hint(error, file)}") from error
    from workbench.contracts.study import Study  # a name, a title and an error need no Dataset

    found = vars(module).get("study")
    if not isinstance(found, Study):
        raise InvalidValue(f"{file} must declare a variable named study, as in: study = Study(...)")
    return found


@contextmanager
def _importable(folder: Path) -> Iterator[None]:
    """Let what is imported within find the modules of a folder first, as a script finds those that lie beside it.

    A module of another study's folder that has the name of one here is forgotten, so that this study gets its own.
    """
    _FOLDERS.add(folder)
    for name, module in list(sys.modules.items()):
        file = vars(module).get("__file__")
        home = Path(file).resolve() if file else folder
        home = home.parents[1] if home.stem == "__init__" else home.parent
        if "." not in name and home != folder and home in _FOLDERS and _beside(folder, name):
            for one in [one for one in sys.modules if one.partition(".")[0] == name]:
                del sys.modules[one]
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()  # a module may have been written a moment ago
    try:
        yield
    finally:
        if str(folder) in sys.path:
            sys.path.remove(str(folder))


_FOLDERS: set[Path] = set()
"""Folders of the study files that this process has loaded."""


def _beside(folder: Path, name: str) -> Path | None:
    """Return the file or the folder that Python would import under a name from a folder, or None."""
    places = (folder / f"{name}.py", folder / name)
    return next((place for place in places if place.exists()), None)


def _hint(error: BaseException, file: Path) -> str:
    """Return what to do where a name was looked for in a package of ours that a file beside the study is named like."""
    package = (error.name or "").partition(".")[0] if isinstance(error, ImportError) else ""
    hidden = _beside(file.resolve().parent, package) if package in PACKAGES else None
    return f"; {hidden} has the name of a package of the workbench: rename it" if hidden else ""
