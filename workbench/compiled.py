"""CasADi Functions as machine code: generated C, built once, kept by content in the user's cache folder."""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca
from platformdirs import user_cache_path

from models.quantity import InvalidValue
from workbench.generated import tightened

# No flag changes a result: sums keep their order, and nothing is assumed of NaN or infinity.
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fno-semantic-interposition")
SHARED = ("-shared", "-fPIC")
CACHE_VARIABLE = "WORKBENCH_CACHE"
log = logging.getLogger("workbench")


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

    The library is built in a folder of its own and moved into place, so two processes may build at once.
    Raises InvalidValue where the cache folder cannot be written.
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
        source.write_text(tightened(source.read_text()))
        recipe = "\n".join([source.read_text(), command, *FLAGS, *SHARED, platform.machine(), ca.CasadiMeta.version()])
        library = folder / f"{function.name()}-{hashlib.sha256(recipe.encode()).hexdigest()[:32]}.so"
        if not library.exists():
            built = Path(build) / library.name
            call = [command, *FLAGS, *SHARED, "-o", str(built), str(source), "-lm"]
            made = subprocess.run(call, capture_output=True, text=True, check=False)
            if made.returncode != 0:
                first = (made.stderr.strip() or "no message").splitlines()[0]
                _say_once(f"the C compiler {command} failed ({first}): running on CasADi's virtual machine")
                return function
            os.replace(built, library)
    return ca.external(function.name(), str(library))


@functools.cache
def _say_once(message: str) -> None:
    log.warning(message)
