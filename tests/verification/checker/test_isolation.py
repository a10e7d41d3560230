"""The checker needs nothing but the standard library and python-flint, and loads nothing else."""

from __future__ import annotations

import json
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import flint
import pytest
from forging import numbers, shown

import verification.checker

HOUSE = Path(verification.checker.__file__).parents[1]
PROGRAM = """
import runpy, sys
sys.path.append(sys.argv[1])
sys.argv[1:] = sys.argv[2:]
try:
    runpy.run_module("verification.checker", run_name="__main__", alter_sys=True)
except SystemExit as ended:
    code = ended.code
import json
print(json.dumps([code, sorted(sys.modules)]))
"""


def alone(tmp_path: Path, *given: str) -> tuple[int, list[str]]:
    """Run the checker where there is nothing else; return its exit code and all modules that it loaded."""
    place = tmp_path / "alone"
    (place / "verification").mkdir(parents=True)
    (place / "verification" / "__init__.py").write_bytes((HOUSE / "__init__.py").read_bytes())
    (place / "verification" / "checker").symlink_to(HOUSE / "checker")
    home = Path(flint.__file__).parent
    for one in (home, *home.parent.glob("python_flint*")):
        (place / one.name).symlink_to(one)
    answer = subprocess.run(
        [sys.executable, "-I", "-S", "-c", PROGRAM, str(place), *given], capture_output=True, text=True, check=True
    )
    code, modules = json.loads(answer.stdout.splitlines()[-1])
    return code, modules


@pytest.mark.parametrize("whole", [False, True])
def test_the_checker_runs_where_nothing_else_is_installed(tmp_path, whole):
    folder = tmp_path / "given"
    folder.mkdir()

    one = numbers({"a": "1"}, ["<", "a", "2" if whole else "1"])
    for (kind, name), content in one.files().items():
        (folder / kind).mkdir(exist_ok=True)
        (folder / kind / f"{name}.json").write_text(json.dumps(content))
    sentence = sha256(shown(one).sentence.encode()).hexdigest() if whole else ""
    entry = {"claim": "a", "case": "b", "controller": None, "certificate": one.name, "sentence": sentence}
    (folder / "index.json").write_text(json.dumps({"format": "workbench-certificate 1", "claims": [entry]}))
    code, modules = alone(tmp_path, str(folder))
    assert code == (0 if whole else 2)
    foreign = {name for name in modules if name.partition(".")[0] not in {*sys.stdlib_module_names, "flint"}}
    own = {f"verification.checker.{one.stem}" for one in (HOUSE / "checker").glob("*.py") if one.stem[:2] != "__"}
    made_by_flint = {name for name in foreign if "cython" in name}
    assert foreign - made_by_flint == {"__main__", "verification", "verification.checker", *own}
