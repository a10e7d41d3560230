"""What fails in code that somebody else wrote is told in one line: where, what stands there, and what to do."""

from __future__ import annotations

import inspect
import linecache
import re
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from models.errors import InvalidValue

FLOOR = Path(__file__).resolve().parents[1]
HOUSE = tuple(str(FLOOR / name) for name in ("models", "workbench", "verification", "studies"))
LIBRARIES = tuple(
    str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
HINTS = (
    ("to_double", "a function of math takes numbers: write ca.sin for math.sin, and so on, with import casadi as ca"),
    ("truth value", "an if, and, or, min or max cannot look at a symbol: write ca.if_else(condition, a, b), ca.fmin"),
    ("valid indices", "a table cannot be indexed by a symbol: write ca.pw_const or ca.pw_lin, or ca.interpolant"),
    ("indices must be integers", "a list cannot be indexed by a symbol: write ca.pw_const or ca.pw_lin"),
    ("interpreted as an integer", "a number that counts cannot be a symbol: declare it with count(...)"),
    ("__trunc__", "what shapes the equations cannot be a symbol: declare it with count(...), or structural=True"),
    ("to_int", "what shapes the equations cannot be a symbol: declare it with count(...), or structural=True"),
)
"""What to do, by words of the exception that CasADi, NumPy or Python raises for a symbol."""


# a user's function takes whatever its kind takes
Code = Callable[..., object]
"""What is called of a user's: it may take whatever its kind takes."""


class InUsersCodeError(InvalidValue):
    """What failed in a user's code, with its place: told once, whoever else it passes."""


def _theirs(file: str) -> bool:
    """Tell whether a file is neither of the house nor of a library."""
    if file.startswith("<") and not file.startswith("<ipython"):
        return False
    whole = str(Path(file).resolve())
    return not whole.startswith((*HOUSE, *LIBRARIES))


def _file_of(code: Code) -> str:
    try:
        return inspect.getsourcefile(code) or "<nowhere>"
    except TypeError:
        return "<nowhere>"


def place_of(error: BaseException) -> str | None:
    """Return where in a user's code an exception came up, as ``FILE, line N: what stands there``, or None."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if _theirs(frame.filename)]
    if not frames:
        return None
    frame = frames[-1]
    said = (frame.line or linecache.getline(frame.filename, frame.lineno or 0)).strip()
    return f"{Path(frame.filename)}, line {frame.lineno}" + (f": {said}" if said else "")


def place_of_code(code: Code) -> str:
    """Return where a function or a method stands, as ``FILE, line N``, or its name where no file is known."""
    try:
        file, (_, line) = inspect.getsourcefile(code), inspect.getsourcelines(code)
    except (OSError, TypeError):
        return code.__qualname__
    return f"{file}, line {line}"


def told(error: BaseException, what: str, code: Code | None = None) -> InUsersCodeError:
    """Return an exception out of a user's code as one line; ``code`` is what was called, for one that did not begin."""
    place = place_of(error) or (place_of_code(code) if code is not None else "")
    said = re.sub(r"^\.\.\./\S+:\d+: ", "", (str(error).strip() or "no message").splitlines()[-1])
    kind = "" if isinstance(error, InvalidValue) else f"{type(error).__name__}: "
    hint = next((f"; {words}" for key, words in HINTS if key in str(error)), "")
    return InUsersCodeError(f"{place}{' ' if place else ''}({what}) {kind}{said}{hint}")


@contextmanager
def asking(what: str, *codes: Code) -> Iterator[None]:
    """Run a user's code: what fails there becomes one line with its place. What fails in the house stays as it is.

    ``what`` says what was asked, e.g. ``Cart.step``; ``codes`` are what is called, whose place is told where its
    arguments or its values are not as they should be.
    """
    try:
        yield
    except InUsersCodeError:
        raise
    except Exception as error:
        their = [one for one in codes if _theirs(_file_of(one))]
        said = str(error)
        code = next((one for one in their if f"{one.__qualname__}()" in said or f".{one.__name__} must " in said), None)
        if code is None and isinstance(error, InvalidValue):
            code = next(iter(their), None)
        if place_of(error) is None and (code is None or not isinstance(error, (InvalidValue, TypeError))):
            raise
        raise told(error, what, code) from error
