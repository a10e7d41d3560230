"""``workbench verify`` as a command: what it writes and prints, and its exit status."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

FILES = {"run.nc", "provenance.json", "scores.json", "verdicts.json", "verdicts.xml", "report.html", "figures"}
OWN = """
import numpy as np
from typing import Any
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench.controllers import ICFDL
from workbench.contracts.study import Study

@declared
class Gain(Plant):
    states = signals(x="m")
    inputs = signals(u="N")
    outputs = signals(x="m")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (0.5 * u.u,)

    def output(self, x: Any) -> Any:
        return (x.x,)

study = Study(name="own", plant=Gain(), reference=np.ones(11), controllers={"icfdl": ICFDL()}, trials=3,
                   drawings=lambda study, data: {})
"""
EXAMINED = """
from verification.decide import verify as examination
from workbench.contracts.examination import Examination
from workbench.contracts.verdict import Claim, Finding, Standing, undecided
from workbench import cli

def finding(standing):
    return Finding(standing=standing, method="planted", witness={"k": 1})

def made(campaign, *, full=False):
    words = %r + (["SUPPORTED"] if full else [])
    claims = [Claim(name=f"own.{i}", statement="s", source="s", check=lambda w=w: finding(Standing(w)))
              for i, w in enumerate(words)]
    return Examination(claims=claims, conclude=lambda verdicts: ["done"])

examination.examination_of = made
cli.main()
"""


def command(tmp_path: Path, standings: list[str], *options: str) -> subprocess.CompletedProcess[str]:
    (tmp_path / "own.py").write_text(OWN)
    arguments = [sys.executable, "-c", EXAMINED % standings, "verify", *options]
    return subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize(
    ("standings", "options", "status"),
    [
        (["PROVED", "REFUTED"], ["own.py"], 0),
        (["PROVED", "REFUTED"], ["own.py", "--strict"], 3),
        (["PROVED", "UNDECIDED"], ["own.py", "--full", "--out", "there"], 1),
        ([], ["nowhere.py"], 2),
        ([], ["own.py", "--set", "trials=none"], 2),
        ([], ["own.py", "--no-such-option"], 2),
        ([], ["own.py", "--out", "own.py"], 2),
    ],
)
def test_command_line(tmp_path: Path, standings: list[str], options: list[str], status: int) -> None:
    done = command(tmp_path, standings, *options)
    assert done.returncode == status, done.stderr
    if status == 2:
        assert "Traceback" not in done.stderr and not (tmp_path / "out").exists()
        return
    target = tmp_path / ("there" if "--out" in options else "out/own")
    assert {entry.name for entry in target.iterdir()} == FILES
    assert "own.1" in done.stdout and "report.html" in done.stdout and "mse_last" in done.stdout
    assert done.stderr == ""
    assert len(json.loads((target / "verdicts.json").read_text())) == len(standings) + ("--full" in options)


def test_command_line_json(tmp_path: Path) -> None:
    done = command(tmp_path, ["PROVED"], "own.py", "--json")
    assert [one["standing"] for one in json.loads(done.stdout)] == ["PROVED"]


CLAIMING = """
from workbench.contracts.verdict import Claim, Finding, Standing

def gain(study, data):
    return [Claim(name="own.gain", statement="the last error is small", source="ours", check=lambda: look(data))]

def look(data):
    %s
"""
LOOKS = {
    "a finding": (
        'return Finding(standing=Standing.SUPPORTED, method="read", margin=float(data["mse"][0, -1]), unit="m^2")',
        0,
        "own.gain",
    ),
    "a slip": (
        'return data["no_such_thing"]',
        2,
        r"own.py, line \d+: return.*check of own.gain.*no_such_thing",
    ),
    "no finding": ("return 3", 2, "a check must give a Finding, got 3"),
}


@pytest.mark.parametrize("what", LOOKS)
def test_claims_of_a_study_of_ones_own(tmp_path: Path, what: str) -> None:
    look, status, said = LOOKS[what]
    declared = OWN.replace("drawings=", "claims=(gain,), drawings=")
    declared = declared.replace("study = Study(", f"{CLAIMING % look}\nstudy = Study(")
    declared = declared.replace("ICFDL()", "ICFDL(force_unit=1.0, lam=1.0, initial_input=0.1)")
    (tmp_path / "own.py").write_text(declared)
    arguments = [sys.executable, "-m", "workbench", "verify", "own.py"]
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode in ((0, 1) if status == 0 else (2,)), done.stderr
    assert re.search(said, done.stdout if status == 0 else done.stderr)
    if status:
        assert "Traceback" not in done.stderr and len(done.stderr.strip().splitlines()) == 1
        return
    verdicts = json.loads((tmp_path / "out" / "own" / "verdicts.json").read_text())
    assert verdicts[-1]["claim"] == "own.gain" and verdicts[-1]["standing"] == "SUPPORTED"
    assert len({one["claim"] for one in verdicts}) > 10, "the claims of learning laws in general come first"
