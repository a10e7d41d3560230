"""What the README shows works, and its numbers are those of a fresh computation."""

from __future__ import annotations

import dataclasses
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from studies.metro.ledger import ledger, markdown, supported
from studies.metro.study import STUDY
from verification.decide.judge import Judge
from verification.theorems.limits import limits
from workbench import load, run
from workbench.contracts import settings
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import Verdict

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
STUDY_FILE, SESSION = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_the_example_runs_from_the_command_line_and_from_python(tmp_path):
    (tmp_path / "my_study.py").write_text(STUDY_FILE)
    command = re.search(r"workbench (run my_study\.py[^`]*)`", README)
    assert command is not None
    done = subprocess.run(
        [sys.executable, "-m", "workbench", *command[1].split(), "--out", "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    space: dict[str, object] = {}
    exec(compile(STUDY_FILE, "my_study.py", "exec"), space)
    loaded = load(tmp_path / "out", space["study"])  # type: ignore[arg-type]
    assert loaded.settings["plant"]["mass"] == 1000.0
    for row in loaded.scores().values():
        assert row["mse_last"] < 0.05 * row["mse_trial_1"]
    session = "import matplotlib; matplotlib.use('Agg')\n" + SESSION
    done = subprocess.run([sys.executable, "-c", session], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_declaration_is_about_ten_lines():
    body = STUDY_FILE[STUDY_FILE.index("@declared") : STUDY_FILE.index("study =")]
    assert len([line for line in body.splitlines() if line.strip()]) <= 12


def test_the_ledger_agrees_with_a_fresh_computation():
    shown = re.search(r"<!-- ledger.*?-->\n(.*?)\n<!-- end", README, re.DOTALL)
    assert shown is not None
    assert shown[1] == markdown(ledger(STUDY)), "write the output of python -m studies.metro.ledger into the README"


def test_the_ledger_says_what_the_numbers_say():
    entries = ledger(STUDY, readings=("metro",))
    words = {(entry.law, entry.force_unit): supported(entry, entries) for entry in entries}
    assert words["icfdl", 1.0] == "the error falls, but ends above pd's, against Fig. 7"
    assert words["icfdl", 100.0].startswith("both: the error falls") and "Fig. 7" in words["icfdl", 100.0]
    assert words["icfdl", 1000.0].startswith("neither: diverges, stopped at trial")
    assert words["pd", 1.0] == "the error falls"
    by_law = {(entry.law, entry.force_unit): entry for entry in entries}
    assert by_law["icfdl", 100.0].last == pytest.approx(10, abs=1)
    assert by_law["pd", 10.0].last is None


def test_the_bound_of_the_speed_is_proved_of_every_trial_and_nearly_reached():
    (command,) = re.findall(r"workbench verify metro (.*verify\.limits.*)", README)
    words = shlex.split(command)
    study = settings.assigned(STUDY, [value for flag, value in pairwise(words) if flag == "--set"])
    judged = [
        Judge().verdict(claim) for claim in limits(run(dataclasses.replace(study, sweeps=()), show_progress=False))
    ]
    made = {one.controller: one for one in judged if isinstance(one, Verdict)}
    assert {name for name, one in made.items() if one.standing is Standing.REFUTED} == {"icfdl", "pd"}
    found = made["increment"]
    assert found.claim == "metro.limit.speed" and found.standing is Standing.PROVED
    assert found.margin is not None and 0 <= found.margin < 0.2 and "`limit.speed`" in README
    above = f"never above {study.verify.limits['speed'][1]:g} km/h on the flat line"
    assert above in " ".join(README.split()) and "plant.line=flat" in words
    assert f"its peak at {study.reference_samples[0].max():g}" in " ".join(README.split())


@pytest.mark.parametrize("name", re.findall(r"\]\(([\w/.]+)\)", README))
def test_linked_files_exist(name):
    assert (ROOT / name).is_file()


def test_commands_shown_exist():
    for command in re.findall(r"^make (\w+)", README, re.MULTILINE):
        assert f"\n{command}:" in (ROOT / "Makefile").read_text()
