"""CasADi Functions as machine code: generated C, built once, kept by content in the user's cache folder.

What is loaded runs with the user's rights. A library is loaded from a folder that belongs to the user or to root
and that nobody else may write, and only with the bytes that its digest file tells, so that a library cut short by a
crash or a full disk is built again. Trusted are those two owners, and whoever may rename the folders above: between
the check and the load the file is not held. A new library is first called in a process of its own.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import hashlib
import logging
import os
import platform
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import casadi as ca
from platformdirs import user_cache_path

from models.errors import InvalidValue
from workbench.distribution import DISTRIBUTION
from workbench.fold.agreement import doubt, how_ended
from workbench.fold.tightened import tightened
from workbench.fold.trust import fault_of, foreign

# No flag changes a result: sums keep their order, and nothing is assumed of NaN or infinity.
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fno-semantic-interposition")
# What is missing is missed when a library is made, or else when it is loaded: found later it ends the process.
RESOLVED = ("-Wl,-undefined,error",) if sys.platform == "darwin" else ("-Wl,-z,defs", "-Wl,-z,now")
SHARED = ("-shared", "-fPIC", "-Werror=implicit-function-declaration", *RESOLVED)
KEPT = 32  # built functions that a process keeps at hand
KEPT_BYTES = 256 * 2**20  # libraries in the cache folder, those not used for longest go first
PATIENCE = 600.0  # seconds until a compiler, or a new library, counts as hanging
ABANDONED = 86_400.0  # seconds after which what a killed build left is removed
CACHE_VARIABLE = "WORKBENCH_CACHE"
DIGEST = ".sha256"
_BUILD = f".{DISTRIBUTION}-build-"
_LIBRARY = re.compile(r".+-[0-9a-f]{32}\.so")
log = logging.getLogger("workbench")
_saying = threading.Lock()  # trials are compiled by several threads at once
_said: set[str] = set()
_compiling: set[subprocess.Popen[bytes]] = set()
_interrupted = threading.Event()


def cache_folder() -> Path:
    """Return the folder that new libraries are put into, made if need be: $WORKBENCH_CACHE, else the user's.

    A folder that others may write or own is not used (said once): a private one lasts as long as the process.
    Raises InvalidValue where the folder cannot be made, OSError where the disk is full.
    """
    folder = _folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InvalidValue(
            f"the cache folder {folder} must be writable, got: {error.strerror}; "
            f"set {CACHE_VARIABLE} to a folder that is"
        ) from None
    return _private(folder)


def _folder() -> Path:
    named = os.environ.get(CACHE_VARIABLE)
    return Path(os.path.abspath(named)) if named else user_cache_path(DISTRIBUTION)


def _private(folder: Path) -> Path:
    """Return a folder if what lies in it is the user's own doing, else the temporary one."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):  # nothing lies in it
        if fault := foreign(folder.stat()):
            _say_once(
                f"the cache folder {folder} {fault} and is not used: libraries are built in a temporary one; "
                f"set {CACHE_VARIABLE} to a folder of yours with mode 700"
            )
            return _temporary(os.getpid())
    return folder


@cache
def _temporary(process: int) -> Path:
    """Return a private folder that is removed at the end of a process; a process that it forks has another."""
    folder = Path(tempfile.mkdtemp(prefix=f"{DISTRIBUTION}-"))
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == process else None)
    return folder


def compiler() -> str | None:
    """Return the C compiler: $CC if set, else ``cc``; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc")


def compiled(function: ca.Function) -> ca.Function:
    """Return the same function as machine code, or itself where there is none to be had (said once, and why).

    A library is looked up by what determines it: the function's serialised form, the compiler, flags, machine and
    versions; C is generated only where there is none. The digest of what is found is checked before it is loaded.
    A new library is first run in a process of its own, and compared with the virtual machine on numbers of both
    signs and many magnitudes, on zeros, infinities and NaN; where CasADi's C, tightened, should differ or fail there,
    it is built as CasADi wrote it, and where that does too, the virtual machine runs. It is built in a folder of its
    own and moved into place, so several processes may build at once. Where the cache folder is foreign, damaged,
    full or only to be read, a temporary one takes its place. A process that asks again for the same object gets the
    same answer. Raises InvalidValue where the cache folder cannot be made.
    """
    command = compiler()
    if command is None:
        _say_once("no C compiler found (set CC to one): running on CasADi's virtual machine, several times slower")
        return function
    try:
        return _loaded(function, _recipe(command), _folder())
    except _NotBuiltError as error:
        _say_once(f"{error}: running on CasADi's virtual machine")
    except OSError as error:
        _say_once(f"no library can be built ({error.strerror}): running on CasADi's virtual machine")
    return function


def all_compiled(functions: Sequence[ca.Function]) -> list[ca.Function]:
    """Return several functions as :func:`compiled` gives them, built side by side."""
    if len(functions) < 2:  # a thread costs more than finding what is there
        return [compiled(function) for function in functions]
    try:
        with ThreadPoolExecutor() as pool:
            try:
                return list(pool.map(compiled, functions))
            except KeyboardInterrupt:  # a compiler leads a session of its own, which no terminal interrupts
                _interrupted.set()
                pool.shutdown(wait=False, cancel_futures=True)
                for process in list(_compiling):
                    _end(process)
                raise
    finally:
        _interrupted.clear()


def library(name: str, text: str) -> Path | None:
    """Return the library of C of our own, built once and kept as :func:`compiled` keeps functions.

    None where there is none to be had (said once, and why). Raises InvalidValue where the cache folder cannot be made.
    """
    command = compiler()
    if command is None:
        _say_once("no C compiler found (set CC to one)")
        return None
    file = f"{name}-{_digest(text, *_recipe(command))}.so"
    try:
        found = _private(_folder()) / file
        if _lies(found):
            return found
        try:
            return _kept(text, command, cache_folder() / file)
        except OSError:
            return _kept(text, command, _temporary(os.getpid()) / file)
    except _NotBuiltError as error:
        _say_once(str(error))
    except OSError as error:
        _say_once(f"no library can be built ({error.strerror})")
    return None


def _lies(library: Path) -> bool:
    """Tell whether a library lies there as it was built; one that is damaged is said, once."""
    told = _digest_file(library)
    try:
        if not told.exists():  # written after the library: without it nothing was finished
            return False
        fault = fault_of(library) or fault_of(told)
        if fault is None and hashlib.sha256(library.read_bytes()).hexdigest().encode() != told.read_bytes():
            fault = "is not what was built"
    except FileNotFoundError:
        return False
    except OSError as error:
        fault = f"cannot be read ({error.strerror})"
    if fault is not None:
        _say_once(f"the library {library} {fault}: it is built again")
        return False
    with contextlib.suppress(OSError):  # the last use, where it may be written
        os.utime(told)
    return True


def _kept(text: str, command: str, library: Path) -> Path:
    """Build a library of C and put it in its place, its digest last."""
    with tempfile.TemporaryDirectory(dir=library.parent, prefix=_BUILD, ignore_cleanup_errors=True) as build:
        _placed(_made(command, text, Path(build)), Path(build), library)
    _bounded(library.parent)
    return library


def _placed(built: Path, build: Path, library: Path) -> None:
    """Move what was built into its place, its digest last."""
    built.chmod(0o644)
    digest = build / "digest"
    digest.write_bytes(hashlib.sha256(built.read_bytes()).hexdigest().encode())
    os.replace(built, library)
    os.replace(digest, _digest_file(library))


class _NotBuiltError(Exception):
    """Why there is no machine code of a function."""


@lru_cache(maxsize=KEPT)
def _loaded(function: ca.Function, recipe: tuple[str, ...], folder: Path) -> ca.Function:
    """Return a function's library, built if there is none yet; an answer is kept, a failure is tried again."""
    command, *_ = recipe
    name = f"{function.name()[:64]}-{_digest(_determined(function), *recipe)}.so"
    found = _found(function, _private(folder) / name)
    if found is not None:
        return found
    try:
        return _built(function, command, cache_folder() / name)
    except OSError as error:
        _say_once(f"the cache folder {folder} takes no library ({error.strerror}): it is built in a temporary one")
        return _built(function, command, _temporary(os.getpid()) / name)


def _found(function: ca.Function, library: Path) -> ca.Function | None:
    """Return the function of a library that lies there as it was built, or None (said, where one is damaged)."""
    if not _lies(library):
        return None
    try:
        return ca.external(function.name(), str(library))
    except RuntimeError as error:
        fault = f"cannot be loaded ({_reason(str(error))})"
    _say_once(f"the library {library} {fault}: it is built again")
    return None


def _digest_file(library: Path) -> Path:
    return library.with_name(library.name + DIGEST)


def _built(function: ca.Function, command: str, library: Path) -> ca.Function:
    """Build a function's library and return it loaded; raises OSError where its folder takes no files."""
    with tempfile.TemporaryDirectory(dir=library.parent, prefix=_BUILD, ignore_cleanup_errors=True) as build:
        plain = _c(function)
        for text in (tightened(plain), plain):
            built = _made(command, text, Path(build))
            fault = doubt(function, built, PATIENCE)
            if fault is None:
                break
            if text is not plain:
                log.warning("the tightened C of %s %s: built as generated", function.name(), fault)
        else:
            raise _NotBuiltError(f"the machine code of {function.name()} {fault}")
        _placed(built, Path(build), library)
    try:
        loaded = ca.external(function.name(), str(library))
    except RuntimeError as error:
        raise _NotBuiltError(f"the library {library} cannot be loaded ({_reason(str(error))})") from None
    _bounded(library.parent)
    return loaded


def _made(command: str, text: str, build: Path) -> Path:
    """Compile C in a folder and return the library."""
    (build / "function.c").write_text(text)
    built, said = build / "function.so", build / "said"
    built.unlink(missing_ok=True)
    call = [os.path.abspath(command), *FLAGS, *SHARED, "-o", built.name, "function.c", "-lm"]
    with said.open("wb") as messages:
        compiling = subprocess.Popen(
            call,
            cwd=build,  # so that no message names a folder of its own
            env=os.environ | {"LC_ALL": "C"},
            stdin=subprocess.DEVNULL,
            stdout=messages,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        _compiling.add(compiling)
        try:
            status = compiling.wait(0.0 if _interrupted.is_set() else PATIENCE)
        except subprocess.TimeoutExpired:
            raise _NotBuiltError(
                f"the C compiler {command} failed (it did not end within {PATIENCE:g} seconds)"
            ) from None
        finally:
            _compiling.discard(compiling)
            if compiling.returncode is None:
                _end(compiling)
    if status != 0 or not built.is_file():
        why = how_ended(status) if status < 0 else _reason(said.read_text(errors="replace"))
        raise _NotBuiltError(f"the C compiler {command} failed ({why})")
    return built


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process that leads a session, with all that it has started."""
    if sys.platform == "win32":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _reason(message: str) -> str:
    """Return the line of a message that tells what is wrong."""
    wrong = r"\b(?:error: (?!ld returned)|undefined |Undefined |failed: ).*"
    found = re.search(wrong, message) or re.search(r"\S.*", message)
    return found[0].strip() if found else "no message"


def _c(function: ca.Function) -> str:
    """Return the C that CasADi generates."""
    generator = ca.CodeGenerator(f"{function.name()}.c", {"with_header": False})
    try:
        generator.add(function)
        text: str = generator.dump()
    except RuntimeError as error:
        raise _NotBuiltError(f"CasADi writes no C of {function.name()} ({_reason(str(error))})") from None
    return text


def _determined(function: ca.Function) -> str:
    """Return text that determines what a function computes: serialised, or as C where CasADi cannot serialise it."""
    try:
        text: str = function.serialize()
    except RuntimeError:
        return _c(function)
    return text


def _recipe(command: str) -> tuple[str, ...]:
    """Return what else determines a library, the compiler first: its file, flags, machine, versions, our own source.

    No flag asks for more of the processor than every one of its kind has, so its features are not told. Nor is the
    compiler's --version, which costs a process: its file changes with it, and where a wrapper's does not, the library
    that lies there has agreed with the virtual machine all the same.
    """
    file = os.stat(command)
    made = f"{os.path.realpath(command)} {file.st_size} {file.st_mtime_ns}"
    machine = (platform.machine(), EXTENSION_SUFFIXES[0])  # the latter tells the system, its C library and word size
    return (command, made, *FLAGS, *SHARED, *machine, ca.CasadiMeta.version(), _own_source())


@cache
def _own_source() -> str:
    """Return a digest of the modules that make C: another text from the same function is another library."""
    here = Path(__file__)
    return _digest(*(file.read_text(encoding="utf-8") for file in (here, here.with_name("tightened.py"))))


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:32]


def _bounded(folder: Path) -> None:
    """Remove the libraries not used for longest beyond KEPT_BYTES, and what killed builds have left.

    A library that a process has loaded stays with it; one that is removed before it is loaded is built again.
    """
    libraries = []
    with contextlib.suppress(OSError):
        for file in list(folder.iterdir()):
            with contextlib.suppress(FileNotFoundError):  # another process does the same
                status, told = file.lstat(), _digest_file(file)
                if _LIBRARY.fullmatch(file.name) and stat.S_ISREG(status.st_mode):
                    used = max(status.st_mtime, told.lstat().st_mtime if told.exists() else 0.0)
                    libraries.append((used, status.st_size, file, told))
                elif file.name.startswith(_BUILD) and time.time() - status.st_mtime > ABANDONED:
                    shutil.rmtree(file, ignore_errors=True)
        total = 0
        for _, size, *files in sorted(libraries, reverse=True):
            total += size
            if total > KEPT_BYTES:
                for file in files:
                    file.unlink(missing_ok=True)


def _say_once(message: str) -> None:
    with _saying:
        if message not in _said:
            _said.add(message)
            log.warning(message)
