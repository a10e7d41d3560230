"""Whether a file or folder is the user's own doing, so that what lies in it may be run with the user's rights."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path


def foreign(status: os.stat_result) -> str | None:
    """Return how somebody else but root could have written a file or folder, or None."""
    if sys.platform == "win32":
        return None
    if status.st_uid not in (0, os.geteuid()):
        return "belongs to another user"
    return "can be written by other users" if status.st_mode & 0o022 else None


def fault_of(file: Path) -> str | None:
    """Return why a file is no file that a build has left, or None."""
    status = file.lstat()
    return foreign(status) if stat.S_ISREG(status.st_mode) else "is no regular file"
