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
from pathlib import Path

import casadi as ca
import numpy as np
from platformdirs import user_cache_path

from models.quantity import InvalidValue
from workbench.fold.tightened import tightened

# No flag changes a result: sums keep their order, and nothing is assumed of NaN or infinity.
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fno-semantic-interposition")
SHARED = ("-shared", "-fPIC")
CACHE_VARIABLE = "WORKBENCH_CACHE"
log = logging.getLogger("workbench")
_saying = threading.Lock()  # trials are compiled by several threads at once
_said: set[str] = set()


def cache_folder() -> Path:
    """Return the folder of built functions: $WORKBENCH_CACHE, else the user's cache folder.

    Raises InvalidValue where it cannot be written.
    """
    named = os.environ.get(CACHE_VARIABLE)
    folder = Path(named) if named else user_cache_path("learning-control-workbench")
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


def compiler() -> str | None:
    """Return the C compiler: $CC if set, else ``cc``; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc")


def compiled(function: ca.Function) -> ca.Function:
    """Return the same function as machine code, or itself where there is no C compiler (said once).

    A new library is checked once against the virtual machine on random numbers; where CasADi's C, tightened, should
    differ, it is built as CasADi wrote it. The library is built in a folder of its own and moved into place, so two
    processes may build at once. Raises InvalidValue where the cache folder cannot be written.
    """
    command = compiler()
    if command is None:
        _say_once("no C compiler found (set CC to one): running on CasADi's virtual machine, several times slower")
        return function
    folder = cache_folder()
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as build:
        source = Path(build) / f"{function.name()}.c"
        generator = ca.CodeGenerator(source.name, {"with_header": False})
        generator.add(function)
        generator.generate(f"{build}{os.sep}")
        plain = source.read_text()
        wanted = {text: folder / _library_name(function, text, command) for text in (tightened(plain), plain)}
        for library in wanted.values():
            if library.exists():
                return ca.external(function.name(), str(library))
        for text, library in wanted.items():
            source.write_text(text)
            built = Path(build) / library.name
            call = [command, *FLAGS, *SHARED, "-o", str(built), str(source), "-lm"]
            made = subprocess.run(call, capture_output=True, text=True, check=False)
            if made.returncode != 0:
                first = (made.stderr.strip() or "no message").splitlines()[0]
                _say_once(f"the C compiler {command} failed ({first}): running on CasADi's virtual machine")
                return function
            if text is plain or agrees(function, ca.external(function.name(), str(built))):
                os.replace(built, library)
                break
            log.warning("the tightened C of %s differs from the virtual machine: built as generated", function.name())
    return ca.external(function.name(), str(library))


def _library_name(function: ca.Function, text: str, command: str) -> str:
    recipe = "\n".join([text, command, *FLAGS, *SHARED, platform.machine(), ca.CasadiMeta.version()])
    return f"{function.name()}-{hashlib.sha256(recipe.encode()).hexdigest()[:32]}.so"


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
