"""The command line as a user meets it: in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from models.point_mass import PointMass
from workbench.contracts import settings
from workbench.trials import find as studies
from workbench.trials.campaign import load

OWN = """
import numpy as np
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench.controllers import PD
from workbench.contracts.study import Study

@declared
class Cart(Plant):
    inputs = signals(force="N")
    states = outputs = signals(speed="m/s")
    mass: float = quantity(default=1000.0, unit="kg", doc="mass", above=0)
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (x.speed + self.sampling_time / self.mass * (u.force - 50 * x.speed),)

    def output(self, x):
        return (x.speed,)

study = Study(
    plant=Cart(), reference=10 * np.sin(np.linspace(0, np.pi, 201)), controllers={"pd": PD(kp=500.0, kd=0.0)}, trials=9
)
"""


def workbench(*arguments, cwd, **environment):
    return subprocess.run(
        [sys.executable, "-m", "workbench", *arguments],
        cwd=cwd,
        env=os.environ | {"MPLBACKEND": "Agg"} | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def refused(done, *said):
    """A refusal: status 2, one line, no traceback, and what it said."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr and done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("workbench: ")
    for part in said:
        assert part in line


def test_run_writes_everything(tmp_path):
    done = workbench("run", "metro", "--set", "trials=3", "--seed", "5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "mse_last" in done.stdout and "icfdl" in done.stdout and "figures" in done.stdout
    assert "\r" not in done.stderr and "%" not in done.stderr  # no progress bar in a pipe
    folder = tmp_path / "out" / "metro"
    assert sorted(path.name for path in folder.iterdir()) == ["figures", "provenance.json", "run.nc", "scores.json"]
    loaded = load(folder)
    assert loaded.settings["trials"] == 3 and loaded.settings["seed"] == 5
    assert json.loads((folder / "scores.json").read_text())["scores"] == loaded.scores()


def test_json_is_scores_json(tmp_path):
    done = workbench("run", "metro", "--set", "trials=2", "--out", "here", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((tmp_path / "here" / "scores.json").read_text())


def test_list_and_show(tmp_path):
    listed = workbench("list", cwd=tmp_path)
    assert listed.returncode == 0 and [line.split()[0] for line in listed.stdout.splitlines()] == list(studies.names())
    shown = workbench("show", "metro", cwd=tmp_path)
    assert shown.returncode == 0
    keys = {line.split()[0] for line in shown.stdout.splitlines() if line}
    wanted = {"plant.reading", "plant.line", "plant.mass", "plant.sampling_time", "trials"}
    wanted |= {"trial_length.law", "trial_length.minimum"}
    for law in ("cfdl", "icfdl"):
        fields = ("eta", "rho", "lam", "mu", "eps", "phi0", "force_unit", "initial_input")
        wanted |= {f"controllers.{law}.{field}" for field in fields}
    wanted |= {f"controllers.pd.{field}" for field in ("kp", "kd", "force_unit", "initial_input")}
    assert wanted <= keys
    mass = next(line for line in shown.stdout.splitlines() if line.startswith("plant.mass"))
    assert "350000" in mass and "kg" in mass and "(0, ∞)" in mass
    assert {"verify.scope", "verify.limits"} <= keys


def test_what_proofs_are_stated_for_is_set_in_json_and_recorded(tmp_path):
    scope, limits = {"plant.mass": [280e3, 420e3]}, {"speed": [None, 72.1]}
    settings = ["--set", f"verify.scope={json.dumps(scope)}", "--set", f"verify.limits={json.dumps(limits)}"]
    done = workbench("run", "metro", "--set", "trials=2", *settings, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    loaded = load(tmp_path / "out" / "metro")
    assert loaded.settings["verify"] == {"scope": scope, "limits": limits}
    assert dict(loaded.study.verify.scope) == {"plant.mass": (280e3, 420e3)}


def test_a_users_own_file(tmp_path):
    (tmp_path / "my_study.py").write_text(OWN)
    done = workbench("run", "my_study.py", "--set", "plant.mass=900", "--out", "own", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    scores = json.loads((tmp_path / "own" / "scores.json").read_text())
    assert scores["settings"]["plant"]["mass"] == 900.0
    assert scores["scores"]["pd"]["mse_last"] < 0.5 * scores["scores"]["pd"]["mse_trial_1"]
    assert workbench("show", "my_study.py", cwd=tmp_path).returncode == 0


def test_without_a_compiler_it_runs_and_says_so_once(tmp_path):
    done = workbench("run", "metro", "--set", "trials=4", "--out", "slow", cwd=tmp_path, CC="nonexistent")
    assert done.returncode == 0
    assert done.stderr.count("no C compiler found") == 1 and len(done.stderr.strip().splitlines()) == 1
    workbench("run", "metro", "--set", "trials=4", "--out", "fast", cwd=tmp_path)
    slow, fast = (json.loads((tmp_path / name / "scores.json").read_text()) for name in ("slow", "fast"))
    for law in ("icfdl", "pd"):
        assert slow["scores"][law]["mse_last"] == pytest.approx(fast["scores"][law]["mse_last"], rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nope"], ["there is no study 'nope'", "the studies are: ato, maglev, metro"]),
        (["metr"], ["did you mean metro?"]),
        (["metro", "--set", "plant.mss=3"], ["there is no setting 'plant.mss'; did you mean plant.mass"]),
        (["metro", "--set", "plant.mass=-1"], ["plant.mass must lie in (0, ∞) kg, got -1"]),
        (["metro", "--set", "controllers.icfdl.rho=1.4"], ["controllers.icfdl.rho must lie in (0, 1], got 1.4"]),
        (["metro", "--set", "trials=abc"], ["trials must be a number in [1, 100000], got 'abc'"]),
        (
            ["metro", "--set", 'verify.scope={"plant.mas": [280e3, 420e3]}'],
            ["which there is not; did you mean plant.mass"],
        ),
        (["metro", "--set", 'verify.scope={"plant.mass": [420e3, 280e3]}'], ["low at most high for 'plant.mass'"]),
        (["metro", "--set", 'verify.limits={"speed": [null, null]}'], ["one of which may be null, for 'speed'"]),
        (["metro", "--set", f"seed={10**400}"], ["seed must be a number in [0"]),
        (["metro", "--set", "trials=1e30"], ["trials must lie in [1, 100000]"]),
        (["metro", "--set", "trial_length.minimum=3000"], ["below the horizon of 2000 samples, got 3000"]),
        (["metro", "--seed", "-1"], ["seed must lie in"]),
        (["missing.py"], ["existing .py file, got missing.py"]),
        (["empty.py"], ["empty.py must declare a variable named study"]),
        (["broken.py"], ["broken.py, line 2, failed: ZeroDivisionError: division by zero"]),
        (["syntax.py"], ["syntax.py failed: SyntaxError"]),
        (["nan.py"], ["reference must be finite at every sample, got nan at sample 0"]),
        (["rows.py"], ["reference must have 1 row(s), one an output of cart, got 2"]),
        (["shape.py"], ["Cart.step must give 1 value(s) (speed), got shape (2, 1)"]),
        (
            ["metro", "--out", "file/below"],
            ["the output folder file/below must be writable", "give another with --out"],
        ),
        (["metro", "--out", "file"], ["the output folder file must be writable"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) and len(value) < 4 else None,
)
def test_bad_input_is_one_line_and_status_2(arguments, said, tmp_path):
    files = {
        "file": "",
        "empty.py": "x = 1\n",
        "broken.py": "x = 1\nx / 0\n",
        "syntax.py": "study = \n",
        "nan.py": OWN.replace("10 * np.sin", "np.nan * np.sin"),
        "rows.py": OWN.replace("10 * np.sin(np.linspace(0, np.pi, 201))", "np.ones((2, 30))"),
        "shape.py": OWN.replace("return (x.speed + ", "return (1, x.speed + "),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    refused(workbench("run", *arguments, cwd=tmp_path), *said)
    assert {path.name for path in tmp_path.iterdir()} - {"__pycache__"} == set(files)


def test_an_unwritable_cache_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    done = workbench("run", "metro", cwd=tmp_path, WORKBENCH_CACHE=str(tmp_path / "file" / "cache"))
    refused(done, "the cache folder", "must be writable", "set WORKBENCH_CACHE to a folder that is")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    "arguments",
    [["run"], ["run", "metro", "--bogus"], ["frobnicate"], ["run", "metro", "--seed", "x"], ["run", "--out"]],
)
def test_usage_errors_are_status_2(arguments, tmp_path):
    done = workbench(*arguments, cwd=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr and "Error" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("=", "--set takes key=value, got '='"),
        ("trials", "--set takes key=value, got 'trials'"),
        ("plant=3", "plant is a group of settings: set one of its fields, as in plant.FIELD=value"),
        ("controllers.icfdl=1", "controllers.icfdl is a group of settings"),
        ("controllers.ppd.kp=1", "there is no setting 'controllers.ppd'; did you mean controllers.pd"),
        ("plant.line=[1]", r"plant.line must be one of hilly | flat, got \[1\]"),
        ("plant.mass=true", "plant.mass must be a number"),
        ("plant.mass=NaN", "plant.mass must be a finite number"),
        ("trials=2.5", "trials must be a whole number"),
        ("controllers.icfdl.phi0=0", "controllers.icfdl.phi0 must not be 0"),
        ("trial_length.law=table", "trial_length.probabilities must be given for law table"),
        ("name=x", "there is no setting 'name'"),
        ('plant={"reading":"seconds","sampling_time":1e-9}', "sampling_time must be at least 0.002 s"),
    ],
)
def test_assignments(assignment, message):
    with pytest.raises(settings.InvalidValue, match=message.replace("|", r"\|")):
        settings.assigned(studies.find("metro"), [assignment])


def test_assignments_are_made_together():
    study = settings.assigned(
        studies.find("metro"),
        ["trial_length.probabilities=[0.5,0.5]", "trial_length.law=table", "plant.reading=printed", "trials=2"],
    )
    assert study.trial_length.probabilities == (0.5, 0.5)
    assert study.plant == PointMass(reading="printed")
    study = settings.assigned(studies.find("metro"), ['plant={"mass":3e5}', "plant.line=flat", "plant.mass=4e5"])
    assert study.plant == PointMass(mass=4e5, line="flat")
    with pytest.raises(settings.InvalidValue, match=r"plant\.mass lies within plant, which is given a value too"):
        settings.assigned(studies.find("metro"), ["plant=3", "plant.mass=4e5"])
