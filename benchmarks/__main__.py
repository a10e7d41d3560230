"""Print the table of every module of this folder that has ``rows()``.

``rows()`` gives (what, measured, target) as text, one a line of the table. Names of modules on the command line
restrict it to them: ``python -m benchmarks metro``.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from pathlib import Path


def main() -> None:
    found = sorted(info.name for info in pkgutil.iter_modules([str(Path(__file__).parent)]))
    for name in [name for name in found if name in sys.argv[1:] or not sys.argv[1:]]:
        module = importlib.import_module(f"benchmarks.{name}") if name != "__main__" else None
        if not hasattr(module, "rows"):
            continue
        print(f"\n{(module.__doc__ or name).strip().splitlines()[0]}")
        print(f"  {'what':<74}{'measured':>16}   target")
        for what, measured, target in module.rows():
            print(f"  {what:<74}{measured:>16}   {target}", flush=True)


if __name__ == "__main__":
    main()
