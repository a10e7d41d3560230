"""What the documentation shows as one file runs, and verify shows its claim."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("own")
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "studies.md").read_text(), re.DOTALL)
    (made / "my_study.py").write_text(code)
    return made


def workbench(folder, *arguments):
    command = [sys.executable, "-m", "workbench", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_the_study_of_the_documentation_runs(folder):
    done = workbench(folder, "run", "my_study.py", "--json", "--out", "run")
    assert done.returncode == 0 and not done.stderr, done.stderr
    (row,) = json.loads(done.stdout)["scores"].values()
    assert row["mse_last"] < 1e-4 * row["mse_trial_1"] and 0.05 < row["energy_kwh"] < 0.5
    assert (folder / "run" / "figures" / "warmth.png").is_file()


def test_verify_shows_its_claim_in_every_case(folder):
    done = workbench(folder, "verify", "my_study.py", "--json", "--out", "verified")
    assert done.returncode in (0, 1), done.stderr
    verdicts = json.loads((folder / "verified" / "verdicts.json").read_text())
    mine = [one for one in verdicts if one["claim"] == "oven.not_too_hot"]
    assert {one["standing"] for one in mine} == {"SUPPORTED"} and len(mine) == 3
    assert "The oven stays below 200 K." in (folder / "verified" / "report.html").read_text()


def test_show_lists_its_settings_and_cases(folder):
    done = workbench(folder, "show", "my_study.py")
    assert done.returncode == 0 and "plant.capacity" in done.stdout and "Case noisy: noise.sigma = 0.2" in done.stdout
    assert "Dimensions" not in done.stdout
