"""The built-in studies, and finding one by name or in a user's own file."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import sys
import traceback
from pathlib import Path
from typing import Any

from models.quantity import InvalidValue
from workbench.study import Study

NAMES = ("metro", "maglev", "variable-gain", "ato", "stopping", "same-plant")
"""Names of the built-in studies, in the order of the list."""


def find(name: str) -> Any:
    """Return a study: a built-in one by name, or the ``study`` of a Python file by its path.

    Raises InvalidValue for an unknown name, and for a file that is missing, fails or declares no study.
    """
    if name.endswith(".py"):
        return _from_file(Path(name))
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, n=1)
        hint = f"did you mean {near[0]}?" if near else f"the studies are: {', '.join(NAMES)}"
        raise InvalidValue(f"there is no study {name!r}; {hint} (a study of your own is given as a .py file)")
    return importlib.import_module(f"workbench.studies.{name.replace('-', '_')}").STUDY


def _from_file(file: Path) -> Any:
    if not file.is_file():
        raise InvalidValue(f"a study of your own is given as an existing .py file, got {file}")
    spec = importlib.util.spec_from_file_location(f"study_{abs(hash(file.resolve()))}", file)
    assert spec is not None and spec.loader is not None, "a .py file always has a loader"
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except InvalidValue:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if Path(frame.filename).resolve() == file.resolve()]
        at = f"{file}, line {lines[-1]}," if lines else file
        message = (str(error).strip() or "no message").splitlines()[0]
        raise InvalidValue(f"{at} failed: {type(error).__name__}: {message}") from error
    found = getattr(module, "study", None)
    if not isinstance(found, Study):
        raise InvalidValue(f"{file} must declare a variable named study, as in: study = TrialStudy(...)")
    return found
