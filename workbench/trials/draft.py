"""Writing a folder as a whole: into a draft beside it, which takes its place at the end.

Until then the folder keeps what it held. It is replaced only where everything in it was written by a run: the files
that its ``provenance.json`` names. A folder that cannot be renamed (a mount point, the working folder, one whose
parent cannot be written) gets its draft inside, and its entries are exchanged one by one.
"""

from __future__ import annotations

import ctypes
import errno
import glob
import json
import logging
import os
import secrets
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from models.errors import InvalidValue

RECORD = "run.nc"
PROVENANCE = "provenance.json"
FILES = "files"
"""What ``provenance.json`` calls the list of all files that were written with it."""
MARKS = (RECORD, "scores.json", PROVENANCE)
BEFORE = {*MARKS, "verdicts.json", "verdicts.xml", "report.html", "table.csv", "times.csv"}
"""What runs wrote, besides figures, before ``provenance.json`` named it."""
DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS}
DRAFTS = (".draft-", ".new-")
TRIES = 100
EXCHANGE, CURRENT = 2, -100  # RENAME_EXCHANGE and AT_FDCWD of Linux
log = logging.getLogger("workbench")


@contextmanager
def replacing(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a draft folder that takes the place of ``folder`` at the end, whatever that held before.

    Where something fails, ``folder`` stays as it was. A draft that holds a whole ``run.nc`` by then is kept, and the
    error names it; one that does not vanishes. Drafts that killed processes left are named in a warning. Of two
    processes that write the same folder, the later one replaces all that the earlier one wrote. Raises InvalidValue
    where the folder cannot be written, holds what no run wrote, or the disk is full.
    """
    given, made = Path(folder), list[Path]()
    try:
        target = given.resolve()
        made = [parent for parent in target.parents if not parent.exists()]
        inside = _stays(target)
        place = target if inside else target.parent
        place.mkdir(parents=True, exist_ok=True)
        name = ".draft-" if inside else f".{target.name.encode()[:200].decode(errors='ignore')}.draft-"
        _name_leftovers(place, name)
        with _locked(target if inside else None):
            foreign(target, given)
        draft, held = _begun(place, name)
    except (OSError, ValueError) as error:
        _unmake(made)
        if isinstance(error, InvalidValue):
            raise
        said = error.strerror if isinstance(error, OSError) else str(error)
        raise InvalidValue(
            f"the output folder {given} must be writable, got: {said}; give another with --out"
        ) from None
    try:
        yield draft
        _list_files(draft)
        with _uninterrupted():
            (_exchange_within if inside else _exchange)(draft, target, given)
    except OSError as error:
        kept = _left(draft, disk=error.errno in DISK)
        raise InvalidValue(
            f"writing to {given} failed: {error.strerror or error}; what it held is as it was{kept}: "
            "free some room, or give another folder with --out"
        ) from None
    except InvalidValue as error:
        kept = _left(draft)
        refused = InvalidValue(f"{error}{kept}")
        if kept:  # an interrupt may have become such an error, and is told by the note
            refused.add_note(kept.removeprefix("; "))
        raise refused from None
    except BaseException as error:
        if kept := _left(draft):
            error.add_note(kept.removeprefix("; "))
        raise
    finally:
        if held is not None:
            os.close(held)
        _unmake(made)


def _unmake(made: list[Path]) -> None:
    """Remove folders that were made, inner ones first, where they are empty."""
    for folder in made:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _begun(place: Path, name: str) -> tuple[Path, int | None]:
    """Make a draft that is locked from the moment on at which it bears its name; return it and the lock."""
    word = secrets.token_hex(4)
    unnamed, draft = place / f".new-{word}", place / f"{name}{word}"
    unnamed.mkdir()
    held = _lock(unnamed)
    os.rename(unnamed, draft)
    return draft, held


def foreign(target: Path, given: Path | None = None) -> None:
    """Raise InvalidValue, naming one file, where a folder holds what no run wrote."""
    named = given or target
    for _ in range(TRIES):
        if not target.exists():
            return
        if not target.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        before = _inode(target)
        said = _foreign(target)
        if said is None:
            return
        if _inode(target) == before:  # else another process replaced it while we looked
            raise InvalidValue(f"the output folder {named} must {said}, or give another folder with --out")


def _foreign(target: Path) -> str | None:
    """Return what a folder must be that holds what no run wrote, and what to do; None where it holds nothing else."""
    entries = [entry for entry in _entries(target) if not entry.startswith(DRAFTS) or not _stays(target)]
    written = _written(target)
    if entries and not any((target / mark).is_file() for mark in MARKS):
        return f"be empty or hold an earlier run, got one with {entries[0]}: move it away"
    for entry in entries:
        if entry not in written and not (PROVENANCE not in written and _is_figure(entry)):
            return f"hold nothing but a run, got {entry} beside it: move it away"
    return None


def _inode(folder: Path) -> int | None:
    try:
        return folder.stat().st_ino
    except FileNotFoundError:
        return None


def _written(target: Path) -> set[str]:
    """Return what the run in a folder says that it wrote; of a run that does not say it, what runs wrote then."""
    try:
        listed = json.loads((target / PROVENANCE).read_text(encoding="utf-8"))[FILES]
        return {PROVENANCE, *map(str, listed)}
    except (OSError, ValueError, KeyError, TypeError):
        return BEFORE - {PROVENANCE} if not (target / PROVENANCE).exists() else set(BEFORE)


def _is_figure(entry: str) -> bool:
    folder, _, name = entry.rpartition("/")
    return folder == "figures" and name.endswith((".svg", ".png"))


def _entries(folder: Path) -> list[str]:
    """Return the files below a folder, and folders that hold none, as paths within it."""
    found = []
    for at, folders, files in os.walk(folder):
        below = Path(at).relative_to(folder)
        found += [(below / name).as_posix() for name in files]
        found += [(below / name).as_posix() for name in folders if (Path(at) / name).is_symlink()]
        if below != Path() and not folders and not files:
            found.append(below.as_posix())
    return sorted(found)


def _stays(target: Path) -> bool:
    """Tell whether a folder cannot be renamed, or should not because somebody works in it."""
    if not target.is_dir():
        return False
    here = Path.cwd()
    return target in (here, *here.parents) or os.path.ismount(target) or not os.access(target.parent, os.W_OK)


def _list_files(draft: Path) -> None:
    """Name everything in a draft in its ``provenance.json``, and bring it to the disk."""
    source = draft / PROVENANCE
    if source.exists():
        listed = [entry for entry in _entries(draft) if entry != PROVENANCE]
        content = json.loads(source.read_text(encoding="utf-8")) | {FILES: listed}
        source.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    for file in draft.iterdir():
        if file.is_file():
            with file.open("rb") as opened:
                os.fsync(opened.fileno())


def _exchange(draft: Path, target: Path, given: Path) -> None:
    """Let a draft take the place of a folder, in one step where the system has one."""
    for _ in range(TRIES):  # another process may do the same in between
        if not target.exists():
            try:
                os.rename(draft, target)
                return
            except OSError as error:
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
                continue
        foreign(target, given)
        was = _lock(target)  # so that nobody takes it for a draft that was left
        old = target.with_name(f"{draft.name}.old")
        try:
            shutil.copymode(target, draft)
            if _swapped(draft, target):
                os.rename(draft, old)
            else:
                os.rename(target, old)
                _renamed_or_back(draft, target, old)
            _discard(old)
            return
        except FileNotFoundError:
            continue
        finally:
            if was is not None:
                os.close(was)
    raise InvalidValue(f"the output folder {given} is being written by another process: wait for it, or give another")


def _discard(old: Path) -> None:
    """Delete what a folder held, unless something else was put there in the meantime."""
    try:
        foreign(old)
    except InvalidValue as error:
        log.warning("what was there before is kept: %s", error)
    else:
        shutil.rmtree(old, ignore_errors=True)


def _renamed_or_back(draft: Path, target: Path, old: Path) -> None:
    try:
        os.rename(draft, target)
    except OSError:
        os.rename(old, target)
        raise


def _swapped(one: Path, other: Path) -> bool:
    """Exchange two folders in one step; False where the system cannot."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    if call(CURRENT, os.fsencode(one), CURRENT, os.fsencode(other), EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in (errno.ENOSYS, errno.EINVAL, errno.EPERM):
        return False
    raise OSError(code, os.strerror(code))


def _exchange_within(draft: Path, target: Path, given: Path) -> None:
    """Let what a draft inside a folder holds take the place of what the folder holds; back again if that fails."""
    moved: list[tuple[Path, Path]] = []
    old = draft.with_name(f"{draft.name}.old")
    with _locked(target):
        foreign(target, given)
        try:
            old.mkdir()
            steps = [(entry, old / entry.name) for entry in target.iterdir() if not entry.name.startswith(DRAFTS)]
            steps += [(entry, target / entry.name) for entry in draft.iterdir()]
            for source, goal in steps:
                os.rename(source, goal)
                moved.append((source, goal))
        except BaseException:
            for source, goal in reversed(moved):
                os.rename(goal, source)
            if old.is_dir():
                old.rmdir()
            raise
        _discard(old)
        draft.rmdir()


def _left(draft: Path, *, disk: bool = False) -> str:
    """Remove a draft that holds no whole run, or lies on a disk that fails; return words about one that is kept."""
    if not draft.is_dir():
        return ""
    if disk or not (draft / RECORD).is_file():
        shutil.rmtree(draft, ignore_errors=True)
        return ""
    return f"; the run is kept in {draft}"


def _name_leftovers(place: Path, name: str) -> None:
    """Warn of the drafts of processes that are no more."""
    for left in sorted(place.glob(f"{glob.escape(name)}*")):
        held = _lock(left)
        if held is not None:
            os.close(held)
            log.warning("a run that was stopped half-way left %s: keep what you need of it, then delete it", left)


def _lock(folder: Path, *, wait: bool = False) -> int | None:
    """Lock a folder for as long as the file that is returned stays open; None where another process holds it."""
    if sys.platform == "win32":
        return None
    import fcntl

    try:
        opened = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(opened)
        return None
    return opened


@contextmanager
def _locked(folder: Path | None) -> Iterator[None]:
    """Hold a folder's lock, waiting for it; of None nothing."""
    held = None if folder is None else _lock(folder, wait=True)
    try:
        yield
    finally:
        if held is not None:
            os.close(held)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Hold an interrupt back until the block is done."""
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[FrameType | None] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append(frame))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        try:
            before(signal.SIGINT, came[0])
        except KeyboardInterrupt as stop:
            stop.add_note("everything was written")
            raise
