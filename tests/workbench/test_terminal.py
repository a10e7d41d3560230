"""The command line where the terminal is poor: encodings, pipes, full disks, Ctrl-C, names of ours that are taken."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
POOR = {"LC_ALL": "C", "PYTHONUTF8": "0"}
OWN = """
import numpy as np
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench.controllers import PD
from workbench.contracts.study import Study

@declared
class 小车(Plant):
    inputs = signals(力="N")
    states = outputs = signals(速度=("m²/s", "速度"))
    质量: float = quantity(default=1000.0, unit="kg²", doc="质量", above=0)
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (x.速度 + self.sampling_time / self.质量 * (u.力 - 50 * x.速度),)

    def output(self, x):
        return (x.速度,)

study = Study(
    name="研究", title="一个研究", plant=小车(), reference=10 * np.sin(np.linspace(0, np.pi, 31)),
    controllers={"控制": PD(kp=500.0, kd=0.0)}, trials=6,
)
"""


def command(*arguments):
    return [sys.executable, "-m", "workbench", *arguments]


def environment(**changes):
    return os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)} | changes


def workbench(*arguments, cwd, stdout=subprocess.PIPE, **changes):
    return subprocess.run(
        command(*arguments),
        cwd=cwd,
        env=environment(**changes),
        stdout=stdout,
        stderr=subprocess.PIPE,
        timeout=120,
        check=False,
    )


def only_line(done):
    (line,) = done.stderr.decode().splitlines()
    return line


@pytest.mark.parametrize("arguments", [["show"], ["run"], ["run", "--json"], ["verify"]], ids=" ".join)
def test_an_encoding_that_lacks_characters_gets_escapes(arguments, tmp_path):
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    verb, *options = arguments
    done = workbench(verb, "own.py", *options, *(() if verb == "show" else ("--out", "here")), cwd=tmp_path, **POOR)
    assert done.returncode == 0 and b"Traceback" not in done.stderr
    text = done.stdout.decode("ascii")
    assert r"\u63a7\u5236" in text  # the controller's name
    if verb == "show":
        assert r"\u4e00\u4e2a" in text and r"kg\xb2" in text
    if verb == "verify":
        assert "小车" not in text and "质量" in (tmp_path / "here" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("buffered", ["", "1"])
@pytest.mark.parametrize("arguments", [["list"], ["--help"], ["--version"], ["show", "metro"]], ids=" ".join)
def test_a_full_disk_is_one_line(arguments, buffered, tmp_path):
    with open("/dev/full", "wb") as full:
        done = workbench(*arguments, cwd=tmp_path, stdout=full, PYTHONUNBUFFERED=buffered)
    assert done.returncode == 2
    assert only_line(done) == "workbench: standard output cannot be used: No space left on device"


@pytest.mark.parametrize("buffered", ["", "1"])
@pytest.mark.parametrize("arguments", [["list"], ["--help"], ["show", "metro"]], ids=" ".join)
def test_a_pipe_that_nobody_reads_ends_it_quietly(arguments, buffered, tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    done = workbench(*arguments, cwd=tmp_path, stdout=writing, PYTHONUNBUFFERED=buffered)
    os.close(writing)
    assert done.returncode == -signal.SIGPIPE and done.stderr == b""


def test_a_run_is_whole_though_nobody_reads(tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    printing = 'print("from the file", flush=True)\n' + OWN
    (tmp_path / "own.py").write_text(printing, encoding="utf-8")
    subprocess.run(
        command("run", "own.py", "--out", "here"),
        cwd=tmp_path,
        env=environment(),
        stdout=writing,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    os.close(writing)
    assert {"run.nc", "scores.json", "figures"} <= {path.name for path in (tmp_path / "here").iterdir()}


@pytest.mark.parametrize("module", ["typer", "casadi", "xarray", "matplotlib", "h5netcdf"])
def test_ctrl_c_while_importing_is_one_line(module, tmp_path):
    (tmp_path / "hook").mkdir()
    (tmp_path / "hook" / "sitecustomize.py").write_text(f"""
import os, signal, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
""")
    done = workbench(
        "run", "metro", "--set", "trials=2", cwd=tmp_path, PYTHONPATH=f"{tmp_path / 'hook'}{os.pathsep}{ROOT}"
    )
    assert done.returncode == 130
    left = [path for path in tmp_path.iterdir() if path.name != "hook"]
    if module == "matplotlib":  # figures are drawn when the record is whole
        (draft,) = (tmp_path / "out").iterdir()
        assert only_line(done) == f"workbench: interrupted, the run is kept in {draft}"
        assert (draft / "run.nc").is_file()
    else:
        assert only_line(done) == "workbench: interrupted, nothing was written" and left == []


SWALLOWED = """
import os, signal, time, weakref
class Thing: pass
thing = Thing()
gone = weakref.ref(thing, lambda one: os.kill(os.getpid(), signal.SIGINT) or time.sleep(0.1))
del thing
while True: time.sleep(0.01)
"""


@pytest.mark.parametrize(
    "text",
    [SWALLOWED, "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(9)\n"],
    ids=["in a callback that cannot raise", "in the open"],
)
def test_ctrl_c_in_a_study_file_is_one_line(text, tmp_path):
    (tmp_path / "own.py").write_text(text)
    begun = time.monotonic()
    done = workbench("run", "own.py", cwd=tmp_path)
    assert done.returncode == 130 and time.monotonic() - begun < 8
    assert only_line(done) == "workbench: interrupted, nothing was written"


def test_what_a_study_file_prints_goes_to_stderr(tmp_path):
    printing = """
import os
print("loaded")
os.write(1, b"below Python\\n")
os.system("echo from a child")
"""
    own = printing + OWN.replace("        return (x.速度 + ", '        print("stepped")\n        return (x.速度 + ')
    (tmp_path / "own.py").write_text(own, encoding="utf-8")
    for verb in ("run", "verify"):
        done = workbench(verb, "own.py", "--json", "--out", verb, cwd=tmp_path)
        written = {"run": "scores.json", "verify": "verdicts.json"}[verb]
        assert json.loads(done.stdout) == json.loads((tmp_path / verb / written).read_text(encoding="utf-8"))
        for said in (b"loaded", b"below Python", b"from a child", b"stepped"):
            assert said in done.stderr


def test_an_error_of_many_lines_is_one(tmp_path):
    done = workbench("run", "a\nb\x1b[31m.py", cwd=tmp_path)
    assert done.returncode == 2 and only_line(done).endswith(r"existing .py file, got a\nb\x1b[31m.py")


HIDING = {
    "a file": lambda folder, name: (folder / f"{name}.py").write_text("x = 1\n"),
    "a package": lambda folder, name: ((folder / name).mkdir(), (folder / name / "__init__.py").write_text("x = 1\n")),
}


@pytest.mark.parametrize("hiding", HIDING)
@pytest.mark.parametrize(
    ("hidden", "arguments"),
    [
        ("models", ["list"]),
        ("models", ["run", "metro"]),
        ("studies", ["list"]),
        ("studies", ["run", "metro"]),
        ("verification", ["verify", "metro"]),
        ("models", None),
    ],
)
def test_a_hidden_package_is_named(hidden, arguments, hiding, tmp_path):
    HIDING[hiding](tmp_path, hidden)
    (tmp_path / "script.py").write_text("from workbench import run\n")
    call = [sys.executable, "script.py"] if arguments is None else command(*arguments)
    done = subprocess.run(
        call, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=60, check=False
    )
    last = done.stderr.splitlines()[-1]
    assert f"{hidden} must be the package in {ROOT}, but {tmp_path / hidden}" in last
    assert last.endswith("has its name and is found first: rename that, or start from another folder")
    assert done.stdout == ""
    if arguments is not None:
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("hidden", "script"),
    [
        ("studies", "from workbench import run"),
        ("verification", "from workbench import run"),
        ("studies", "import workbench"),
    ],
)
def test_a_name_that_is_not_needed_may_be_taken(hidden, script, tmp_path):
    (tmp_path / f"{hidden}.py").write_text("x = 1\n")
    (tmp_path / "script.py").write_text(script)
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, env=environment(), check=True, timeout=60)


@pytest.mark.parametrize("hiding", HIDING)
def test_verification_names_what_hides_workbench(hiding, tmp_path):
    HIDING[hiding](tmp_path, "workbench")
    call = [sys.executable, "-c", "from verification import verify"]
    done = subprocess.run(
        call, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=60, check=False
    )
    assert f"workbench must be the package in {ROOT}, but {tmp_path / 'workbench'}" in done.stderr
