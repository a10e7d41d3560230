"""``python -m workbench``, and what the installed command runs: Ctrl-C ends it with one line at any time."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType


def main() -> None:
    """Run the command line; with exit status 130 where it was interrupted, while it was still importing too."""
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    def swallowed(told: sys.UnraisableHookArgs) -> None:
        """Interrupt again, at a place that can end, where an interrupt came in a callback that cannot raise."""
        if told.exc_type is KeyboardInterrupt:
            later = threading.Timer(0.05, _thread.interrupt_main)
            later.daemon = True
            later.start()
        else:
            sys.__unraisablehook__(told)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else whoever started it ignores Ctrl-C
        signal.signal(signal.SIGINT, interrupt)
        sys.unraisablehook = swallowed
    try:
        from workbench.distribution import HiddenPackageError, unhidden

        try:
            unhidden("models")
        except HiddenPackageError as error:
            print(f"workbench: {error}", file=sys.stderr)
            sys.exit(2)
        from workbench.cli import main as command

        command()
    except BaseException as error:
        if not interrupted or (isinstance(error, SystemExit) and not error.code):
            raise
        print(f"workbench: interrupted, {next(_notes(error), 'nothing was written')}", file=sys.stderr)
        sys.exit(130)


def _notes(error: BaseException | None) -> Iterator[str]:
    """Yield what was noted on an error and on those that it came from: what was kept of the work."""
    while error is not None:
        yield from vars(error).get("__notes__", ())
        error = error.__cause__ or error.__context__


if __name__ == "__main__":
    main()
