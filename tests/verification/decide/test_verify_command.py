"""``workbench verify`` as a command: what it writes and prints, and its exit status."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
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
import verification.decide.replay as replaying
from verification.decide import verify as examination
from workbench.contracts.examination import Examination
from workbench.contracts.claim import Claim, Expected, Held, Role
from workbench.contracts.finding import Finding, Grounds, Standing, undecided
from workbench import cli

def finding(word):
    if word == "UNDECIDED":
        return undecided("the budget was spent")
    grounds = Grounds.SETTINGS if word in ("PROVED", "CONTRADICTED") else Grounds.RUN
    return Finding(grounds=grounds, method="planted", holds=word != "REFUTED", witness={"k": 1})

def claim(i, word, role):
    attack = (lambda _: Held(3, -0.5, {"trial": 2})) if word == "CONTRADICTED" else None
    return Claim(name=f"own.{i}", statement="s", source="s", check=lambda: finding(word), role=role, attack=attack)

def made(campaign, *, full=False):
    planted = %r + (["SUPPORTED"] if full else [])
    claims, expectations = [], {}
    for i, one in enumerate(planted):
        word, _, rest = one.partition(" ")
        expected, _, role = rest.partition(" ")
        claims.append(claim(i, word, Role.OUTCOME if role else Role.REQUIREMENT))
        if expected and expected != "-":
            expectations[str(i)] = (Expected(standing=Standing(expected), why="by hand"),)
    claims.append(Claim(name="own.none", statement="s", source="s", check=lambda: None, lacks="a horizon"))
    return Examination(claims=claims, conclude=lambda verdicts: ["done"], expectations=expectations)

examination.examination_of = replaying.examination_of = made
cli.main()
"""
"""Each planted claim is a word how it stands, how it is expected to, and whether it is no requirement."""


def command(
    tmp_path: Path, standings: list[str], *options: str, verb: str = "verify"
) -> subprocess.CompletedProcess[str]:
    (tmp_path / "own.py").write_text(OWN)
    arguments = [sys.executable, "-c", EXAMINED % standings, verb, *options]
    return subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)


SHIPPED = ["own.py"]
STRICT = ["own.py", "--strict"]


@pytest.mark.parametrize(
    ("standings", "options", "status"),
    [
        (["PROVED", "REFUTED"], SHIPPED, 0),
        (["PROVED", "REFUTED"], STRICT, 3),
        (["PROVED", "REFUTED REFUTED"], STRICT, 0),
        (["PROVED", "UNDECIDED UNDECIDED"], STRICT, 0),
        (["PROVED SUPPORTED"], STRICT, 3),
        (["UNDECIDED", "REFUTED"], STRICT, 3),
        (["UNDECIDED", "REFUTED"], SHIPPED, 1),
        (["PROVED", "UNDECIDED"], [*SHIPPED, "--full", "--out", "there"], 1),
        (["REFUTED - outcome", "UNDECIDED - outcome"], [*STRICT, "--set", "trials=4"], 0),
        (["REFUTED REFUTED", "UNDECIDED - outcome"], [*STRICT, "--seed", "7"], 0),
        (["REFUTED"], [*STRICT, "--seed", "7"], 3),
        (["UNDECIDED"], [*STRICT, "--seed", "7"], 1),
        (["CONTRADICTED", "REFUTED", "UNDECIDED"], STRICT, 70),
        (["CONTRADICTED - outcome"], [*SHIPPED, "--seed", "7"], 70),
        ([], ["nowhere.py"], 2),
        ([], ["own.py", "--set", "trials=none"], 2),
        ([], ["own.py", "--no-such-option"], 2),
        ([], ["own.py", "--out", "own.py"], 2),
        (["CONTRADICTED"], ["own.py", "--baseline", "nowhere.json"], 2),
        (["CONTRADICTED"], ["own.py", "--baseline", "own.py"], 2),
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
    assert "own.0" in done.stdout and "report.html" in done.stdout and "mse_last" in done.stdout
    assert done.stderr == ""
    verdicts = json.loads((target / "verdicts.json").read_text())
    assert len(verdicts) == len(standings) + ("--full" in options) + 1
    [suite] = ET.parse(target / "verdicts.xml").getroot()
    if status == 0 and "--strict" in options:
        assert (suite.get("failures"), suite.get("errors")) == ("0", "0")
    if status in (1, 70):
        assert suite.get("errors") != "0"


def test_what_departs_is_named_contradictions_first(tmp_path: Path) -> None:
    done = command(tmp_path, ["UNDECIDED", "REFUTED PROVED", "CONTRADICTED"], "own.py")
    lines = [line for line in done.stdout.splitlines() if line.startswith(("CONTRA", "departs", "left open"))]
    assert lines[0].startswith("CONTRADICTION: own.2, case default: PROVED own.2 is contradicted by a run")
    assert lines[1:] == [
        "departs: own.1, case default: expected PROVED because by hand, found REFUTED",
        "left open: own.0, case default: the budget was spent",
    ]
    as_json = command(tmp_path, ["UNDECIDED", "REFUTED PROVED", "CONTRADICTED"], "own.py", "--json")
    fell, *said = as_json.stderr.splitlines()
    assert said == [f"workbench: {line}" for line in lines] and json.loads(as_json.stdout)
    assert fell.startswith("workbench: icfdl: diverged")


def test_a_baseline_by_the_command(tmp_path: Path) -> None:
    former = ["PROVED", "REFUTED", "UNDECIDED"]
    assert command(tmp_path, former, "own.py", "--out", "former").returncode == 1
    held = ["own.py", "--baseline", "former/verdicts.json"]
    assert command(tmp_path, former, *held).returncode == 0
    assert command(tmp_path, [*former, "REFUTED"], *held).returncode == 0, "a new verdict does not depart"
    assert command(tmp_path, former, *held, "--strict").returncode == 3, "REFUTED is not what is expected"
    for now, said in (
        (["SUPPORTED", "REFUTED", "UNDECIDED"], "own.0, case default: expected PROVED because the baseline has it so"),
        (["PROVED", "REFUTED"], "own.2, case default: expected UNDECIDED because the baseline has it so, found none"),
    ):
        done = command(tmp_path, now, *held, "--seed", "3")
        assert done.returncode == 3 and f"departs: {said}" in done.stdout


def test_a_law_that_fell_is_named_first(tmp_path: Path) -> None:
    done = command(tmp_path, ["PROVED"], "own.py", "--out", "there")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("icfdl: diverged at trial 2"), "1 N of input is far too much for this law"
    page = (tmp_path / "there" / "report.html").read_text()
    summary = page[page.index('id="h-summary"') :]
    assert summary.index("icfdl did not come to its end: diverged at trial 2") < summary.index("<p>done</p>")
    assert summary.index("icfdl: diverged") < summary.index('class="tally"')


def test_command_line_json(tmp_path: Path) -> None:
    done = command(tmp_path, ["PROVED"], "own.py", "--json")
    assert [one["standing"] for one in json.loads(done.stdout)] == ["PROVED", None]


CLAIMING = """
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding

def gain(study, data):
    return [Claim(name="own.gain", statement="the last error is small", source="ours", check=lambda: look(data))]

def look(data):
    %s
"""
EXPECTING = {
    # what is expected of own.gain, which is REFUTED, in the study's file; exit status with --strict; what is said
    "nothing": ("{}", 3, "departs: own.gain, case default: expected that it is not REFUTED"),
    "what is found": ('{"gain": [Expected(standing="REFUTED", why="the law is slow")]}', 0, ""),
    "of one case only": (
        '{"gain": [Expected(standing="REFUTED", why="the law is slow", cases=["long"])]}',
        3,
        "departs: own.gain, case default",
    ),
    "other than what is found": (
        '{"gain": [Expected(standing="SUPPORTED", why="it learns")]}',
        3,
        "departs: own.gain, case default: expected SUPPORTED because it learns, found REFUTED",
    ),
    "of no claim": (
        '{"gian": [Expected(standing="REFUTED", why="the law is slow")]}',
        3,
        "the study expects something of 'gian', but no such claim is made; did you mean gain?",
    ),
    "no list": (
        '{"gain": Expected(standing="REFUTED", why="slow")}',
        2,
        r"expected\['gain'\] must be a list of Expected",
    ),
    "a word": ('{"gain": ["REFUTED"]}', 2, r"expected\['gain'\] must be a list of Expected"),
    "no standing": ('{"gain": [Expected(standing="GOOD", why="slow")]}', 2, "must be one of PROVED, .*, got 'GOOD'"),
    "no reason": ('{"gain": [Expected(standing="REFUTED", why=" ")]}', 2, "must say why, got ' '"),
    "of no case": (
        '{"gain": [Expected(standing="REFUTED", why="slow", cases=["lng"])]}',
        2,
        "speaks of 'lng', which is no case of own",
    ),
}


@pytest.mark.parametrize("what", EXPECTING)
def test_what_a_study_of_ones_own_expects(tmp_path: Path, what: str) -> None:
    expected, status, said = EXPECTING[what]
    look = 'return Finding(margin=-float(data["mse"][0, -1]) - 1, unit="m^2", witness={"trial": 3})'
    own = OWN.replace("drawings=", f'claims=(gain,), expected={expected}, cases={{"long": {{"trials": 4}}}}, drawings=')
    own = own.replace("ICFDL()", "ICFDL(force_unit=1.0, lam=1.0, initial_input=0.1)")
    claiming = CLAIMING.replace("import Claim", "import Claim, Expected") % look
    (tmp_path / "own.py").write_text(own.replace("study = Study(", f"{claiming}\nstudy = Study("))
    # of the claims of learning laws only this study's own is looked at here
    bare = "from verification.theorems import learning; from verification.decide import verify as v; "
    bare += "from workbench.contracts.examination import Examination as E; v.outcomes = lambda *told: []; "
    bare += "learning.examine = lambda campaign, full: E(claims=[], conclude=lambda _: []); "
    arguments = [sys.executable, "-c", f"{bare}from workbench import cli; cli.main()"]
    arguments += ["verify", "own.py", "--strict", "--case", "default"]
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == status, done.stderr
    assert re.search(said, done.stdout + done.stderr) and "Traceback" not in done.stderr
    if status == 2:
        assert len(done.stderr.strip().splitlines()) == 1
    if status == 0:
        assert done.stderr == "" and "departs" not in done.stdout


LOOKS = {
    "a finding": (
        'return Finding(method="read", margin=float(data["mse"][0, -1]), unit="m^2")',
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
    made = [one for one in verdicts if one["standing"]]
    assert made[-1]["claim"] == "own.gain" and made[-1]["standing"] == "SUPPORTED"
    assert len({one["claim"] for one in verdicts}) > 10, "the claims of learning laws in general come first"
