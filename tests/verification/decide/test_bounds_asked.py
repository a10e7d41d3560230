"""Bounds of signals and scopes as a user meets them on the command line: asked, refuted, replayed, refused."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import pytest

import verification.decide.replay as replaying
import verification.decide.verify as verifying
from models.quantity import InvalidValue
from verification import replay
from verification.decide.verify import verify_cases
from verification.theorems.limits import limits
from workbench.contracts.examination import Examination
from workbench.contracts.settings import assigned
from workbench.trials.find import find

OWN = """
import numpy as np
from typing import Any
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench import Study, TrialLength, Verification
from workbench.controllers import ICFDL, Increment

@declared
class Tank(Plant):
    states = outputs = signals(level="m")
    inputs = signals(flow="m^3/s")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    keep: float = quantity(default=0.6, unit="1", doc="share that stays")

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (self.keep * x.level + 0.5 * u.flow,)

    def output(self, x: Any) -> Any:
        return (x.level,)

mine = dict(force_unit=1.0, rho=0.5, lam=1.0, mu=1.0, initial_input=0.3)
study = Study(name="own", plant=Tank(), reference=np.sin(np.linspace(0, 2, 11)), trials=4,
              controllers={"increment": Increment(**mine), "icfdl": ICFDL(**mine)},
              trial_length=TrialLength(minimum=5), drawings=lambda study, data: {},
              verify=Verification(limits={"level": (0.0, 1.3), "flow": (None, 0.2)}))
"""


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    (folder / "own.py").write_text(OWN)
    line = [sys.executable, "-m", "workbench", *arguments]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


def test_a_bound_that_is_refuted_is_replayed(tmp_path, monkeypatch):
    """The bounds alone are written, and replayed on the run and on another one."""
    for module in (replaying, verifying):
        monkeypatch.setattr(
            module,
            "examination_of",
            lambda campaign, full=False: Examination(claims=limits(campaign), conclude=lambda _: []),
        )
    (tmp_path / "own.py").write_text(OWN)
    study = find(str(tmp_path / "own.py"))
    (tmp_path / "out").mkdir()
    verify_cases(study, tmp_path / "out", show_progress=False)
    found = {(one["claim"], one["controller"]): one for one in json.loads((tmp_path / "out/verdicts.json").read_text())}
    assert found["own.limit.level", "increment"]["standing"] == "PROVED"
    assert found["own.limit.level", "icfdl"]["standing"] == "SUPPORTED"
    for law in ("increment", "icfdl"):
        refuted = found["own.limit.flow", law]
        assert refuted["standing"] == "REFUTED" and refuted["role"] == "requirement"
        assert (
            refuted["margin"] == pytest.approx(0.2 - refuted["witness"]["value"]) == pytest.approx(refuted["replayed"])
        )
        again = replay(tmp_path / "out", "limit.flow", law, study=study)
        assert again.stands and again.reason == "the claim fails at its witness again, by the same margin"
    with pytest.raises(InvalidValue, match="only a claim that is REFUTED can be replayed"):
        replay(tmp_path / "out", "limit.level", "increment", study=study)


def refused(done: subprocess.CompletedProcess[str], said: str) -> None:
    """Status 2, one line, no traceback."""
    assert done.returncode == 2 and done.stdout == "" and "Traceback" not in done.stderr, done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("workbench: ") and said in line, line


BAD = [
    ("verify.scope=abc", "verify.scope must give a pair [low, high] by name"),
    ("verify.scope=3", "verify.scope must give a pair [low, high] by name"),
    ("verify.scope=[1, 2]", "verify.scope must give a pair [low, high] by name"),
    ('verify.scope={"plant.keep": 3}', "a pair [low, high] of finite numbers"),
    ('verify.scope={"plant.keep": [0.5, null]}', "finite numbers"),
    ('verify.scope={"plant.sampling_time": [-1, 1]}', "verify.scope holds plant.sampling_time at -1, but"),
    ('verify.scope={"keep": [0.5, 0.7]}', "verify.scope names 'keep', which there is not; did you mean plant.keep"),
    ('verify.scope={"noise.level": [-0.1, 0.2]}', "verify.scope must be -nu to nu for noise.level, got [-0.1, 0.2]"),
    ('verify.limits={"speed": [0, 1]}', "verify.limits names 'speed', which there is not; there are: level, flow"),
    ('verify.limits={"level": [2, 1]}', "low at most high for 'level'"),
    ('verify.limits={"level": [null, null]}', "one of which may be null, for 'level'"),
]


@pytest.mark.parametrize(("assignment", "said"), BAD[:2])
def test_what_is_no_scope_is_one_line_on_the_command_line(assignment, said, tmp_path):
    refused(command(tmp_path, "verify", "own.py", "--set", assignment), said)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("assignment", "said"), BAD)
def test_what_is_no_scope_or_limit_is_told_in_one_line(assignment, said, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    with pytest.raises(InvalidValue) as raised:
        assigned(find(str(tmp_path / "own.py")), [assignment])
    assert said in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("reference", [[0.0, 0.4], [0.4]])
def test_a_trial_of_one_sample_is_refused(reference, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    study = find(str(tmp_path / "own.py"))
    with pytest.raises(InvalidValue, match="N at least 2") as raised:
        dataclasses.replace(study, reference=reference)
    assert "\n" not in str(raised.value)
