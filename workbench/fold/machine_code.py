"""CasADi Functions as machine code: generated C, built once, kept by content in the user's cache folder."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
from platformdirs import user_cache_path

from models.errors import InvalidValue
from workbench.distribution import DISTRIBUTION
from workbench.fold.tightened import tightened

# No flag changes a result: sums keep their order, and nothing is assumed of NaN or infinity.
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fno-semantic-interposition")
SHARED = ("-shared", "-fPIC")
KEPT = 32  # built functions that a process keeps at hand
CACHE_VARIABLE = "WORKBENCH_CACHE"
log = logging.getLogger("workbench")
_saying = threading.Lock()  # trials are compiled by several threads at once
_said: set[str] = set()


def cache_folder() -> Path:
    """Return the folder of built functions: $WORKBENCH_CACHE, else the user's cache folder.

    Raises InvalidValue where it cannot be written.
    """
    folder = _folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InvalidValue(
            f"the cache folder {folder} must be writable, got: {error.strerror}; "
            f"set {CACHE_VARIABLE} to a folder that is"
        ) from None
    return folder


def _folder() -> Path:
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named) if named else user_cache_path(DISTRIBUTION)


def compiler() -> str | None:
    """Return the C compiler: $CC if set, else ``cc``; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc")


def compiled(function: ca.Function) -> ca.Function:
    """Return the same function as machine code, or itself where there is no C compiler (said once).

    A library is looked up by what determines it: the function's serialised form, the compiler, flags, machine and
    versions; C is generated only where there is none. A new library is checked once against the virtual machine on
    random numbers; where CasADi's C, tightened, should differ, it is built as CasADi wrote it. It is built in a
    folder of its own and moved into place, so two processes may build at once. A process that asks again for the
    same object gets the same answer. Raises InvalidValue where the cache folder must be written and cannot be.
    """
    command = compiler()
    if command is None:
        _say_once("no C compiler found (set CC to one): running on CasADi's virtual machine, several times slower")
        return function
    try:
        return _loaded(function, _recipe(command), _folder())
    except _NotBuiltError as error:
        _say_once(f"the C compiler {command} failed ({error}): running on CasADi's virtual machine")
        return function


def all_compiled(functions: Sequence[ca.Function]) -> list[ca.Function]:
    """Return several functions as :func:`compiled` gives them, built side by side."""
    if len(functions) < 2:  # a thread costs more than finding what is there
        return [compiled(function) for function in functions]
    with ThreadPoolExecutor() as pool:
        return list(pool.map(compiled, functions))


class _NotBuiltError(Exception):
    """The compiler's first line."""


@lru_cache(maxsize=KEPT)
def _loaded(function: ca.Function, recipe: tuple[str, ...], folder: Path) -> ca.Function:
    """Return a function's library, built if there is none yet; an answer is kept, a failure is tried again."""
    command, *_ = recipe
    library = folder / f"{function.name()}-{_digest(_determined(function), *recipe)}.so"
    if not library.exists():
        _build(function, command, cache_folder() / library.name)
    return ca.external(function.name(), str(library))


def _build(function: ca.Function, command: str, library: Path) -> None:
    with tempfile.TemporaryDirectory(dir=library.parent, prefix="build-") as build:
        source = Path(build) / f"{function.name()}.c"
        plain = _c(function, Path(build))
        for name, text in (("tightened.so", tightened(plain)), ("plain.so", plain)):
            source.write_text(text)
            built = Path(build) / name
            call = [command, *FLAGS, *SHARED, "-o", str(built), str(source), "-lm"]
            made = subprocess.run(call, capture_output=True, text=True, check=False)
            if made.returncode != 0:
                raise _NotBuiltError((made.stderr.strip() or "no message").splitlines()[0])
            if text is plain or agrees(function, ca.external(function.name(), str(built))):
                os.replace(built, library)
                return
            log.warning("the tightened C of %s differs from the virtual machine: built as generated", function.name())


def _c(function: ca.Function, folder: Path) -> str:
    """Return the C that CasADi generates, by way of a file in a folder."""
    generator = ca.CodeGenerator(f"{function.name()}.c", {"with_header": False})
    generator.add(function)
    generator.generate(f"{folder}{os.sep}")
    return (folder / f"{function.name()}.c").read_text()


def _determined(function: ca.Function) -> str:
    """Return text that determines what a function computes: serialised, or as C where CasADi cannot serialise it."""
    try:
        text: str = function.serialize()
    except RuntimeError:
        with tempfile.TemporaryDirectory() as folder:
            return _c(function, Path(folder))
    return text


def _recipe(command: str) -> tuple[str, ...]:
    """Return what else determines a library, the compiler first: its file, flags, machine, versions, our own source."""
    file = os.stat(command)
    made = f"{os.path.realpath(command)} {file.st_size} {file.st_mtime_ns}"
    return (command, made, *FLAGS, *SHARED, platform.machine(), ca.CasadiMeta.version(), _own_source())


@cache
def _own_source() -> str:
    """Return a digest of the modules that make C: another text from the same function is another library."""
    here = Path(__file__)
    return _digest(*(file.read_text(encoding="utf-8") for file in (here, here.with_name("tightened.py"))))


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:32]


def agrees(function: ca.Function, other: ca.Function, *, seed: int = 0, tolerance: float = 1e-9) -> bool:
    """Tell whether two Functions give the same on random numbers in (0, 1), NaN and infinity included."""
    rng = np.random.default_rng(seed)
    inputs = [rng.uniform(0.0, 1.0, function.size_in(i)) for i in range(function.n_in())]
    if "length" in function.name_in():
        last = max(function.size_out(i)[1] for i in range(function.n_out())) - 1
        inputs[function.index_in("length")] = np.array([[float(round(0.9 * last))]])
    return all(
        np.allclose(a.full(), b.full(), rtol=tolerance, atol=tolerance, equal_nan=True)
        for a, b in zip(function.call(inputs), other.call(inputs), strict=True)
    )


def _say_once(message: str) -> None:
    with _saying:
        if message not in _said:
            _said.add(message)
            log.warning(message)
