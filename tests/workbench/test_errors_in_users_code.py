"""Slips in a user's own file: one line with the file, the line and what came, and status 2."""

from __future__ import annotations

import re
import sys

import pytest

from workbench import cli

PLANT = """
import math

import casadi as ca
import numpy as np

from models import Plant, count, declared, quantity, signals
from workbench import Law, Study, TrialLength, run
from workbench.contracts.claim import Claim
from workbench.controllers import PD

TABLE = np.arange(50.0)


{declared}
class Cart(Plant):
    states = signals(speed="m/s")
    inputs = signals({inputs})
    outputs = signals(speed="m/s")
    disturbances = signals(gust="N")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    mass: float = quantity(default=20.0, unit="kg", doc="mass", above=0)
    shift: float = quantity(default=2.0, unit="1", doc="a number that should be whole")

    def step(self, {step}):
        return ({next},)

    def output(self, {output}):
        return ({out},)


@declared
class Mine(Law):
    source = "ours"
    learns_on = "output"

    def start(self, task):
        return {start}

    def act(self, {act}):
        return {acted}

    def learn(self, memory, trial):
        return {learned}


def scorer(study, data):
    return {scores}


def figures(study, data):
    return {figures}


study = {study}
"""
DEFAULTS = {
    "declared": "@declared",
    "inputs": 'force="N"',
    "step": "x, u, w, k",
    "next": "x.speed + self.sampling_time / self.mass * (u.force + w.gust)",
    "output": "x",
    "out": "x.speed",
    "start": "()",
    "act": "memory, state, r, r_next, y",
    "acted": "5.0 * (r - y), state",
    "learned": "memory",
    "scores": "{}",
    "figures": "{}",
    "study": "Study(plant=Cart(), reference=np.ones(21), controllers={'mine': Mine()}, trials=3, "
    "scorers=(scorer,), drawings=figures)",
}


def study(**fields):
    said = ", ".join(f"{name}={value}" for name, value in fields.items())
    return f"Study(**{{**dict(plant=Cart(), reference=np.ones(21), controllers={{'mine': Mine()}}), **dict({said})}})"


SLIPS = {
    "undeclared": ({"declared": ""}, "study =", r"Cart is not declared: put @declared above its class"),
    "math": ({"next": "x.speed + math.sin(x.speed) + u.force"}, "math.sin", r"write ca\.sin for math\.sin"),
    "if": ({"next": "u.force if x.speed > 0 else x.speed"}, "x.speed > 0", r"write ca\.if_else\(condition, a, b\)"),
    "table": ({"next": "x.speed + TABLE[k] + u.force"}, "TABLE[k]", r"a table cannot be indexed by a symbol"),
    "int": ({"next": "x.speed + u.force * int(self.shift)"}, "int(self.shift)", r"declare it with count\(\.\.\.\)"),
    "unknown signal": ({"next": "x.sped + u.force"}, "x.sped", r"no signal 'sped' here; the signals are: speed"),
    "reaches nothing": ({"next": "x.speed + w.gust"}, "def step", r"the input 'force' of Cart reaches no output"),
    "second input reaches nothing": ({"inputs": 'force="N", pull="N"'}, "def step", r"the input 'pull' of Cart"),
    "step's arity": ({"step": "x, u"}, "def step", r"step\(\) takes 3 positional arguments but 5 were given"),
    "output's arity": ({"output": ""}, "def output", r"output\(\) takes 1 positional argument but 2 were given"),
    "step's shape": ({"next": "x.speed, u.force"}, "def step", r"must give 1 value\(s\) \(speed\), got shape \(2, 1\)"),
    "step's kind": ({"next": "'fast'"}, "def step", r"must give 1 value\(s\) \(speed\), got \('fast',\)"),
    "output fails": ({"out": "x.speed * (1 / 0)"}, "(1 / 0)", r"ZeroDivisionError|division"),
    "act's arity": ({"act": "memory, state, r"}, "def act", r"act\(\) takes 4 positional arguments but 6 were given"),
    "act fails": ({"acted": "[1][r]"}, "[1][r]", r"a list cannot be indexed by a symbol"),
    "act looks": ({"acted": "(r if y > 0 else y), state"}, "if y > 0", r"write ca\.if_else"),
    "start fails": ({"start": "task.nothing"}, "task.nothing", r"AttributeError: .*nothing"),
    "learn fails": ({"learned": "memory.plan"}, "memory.plan", r"AttributeError: .*plan"),
    "scorer fails": ({"scores": "{'mine': {'n': 1 / 0}}"}, "1 / 0", r"ZeroDivisionError: division by zero"),
    "scorer's names": ({"scores": "{'other': {'n': 1}}"}, "def scorer", r"by controller, one of: mine; got 'other'"),
    "figures fail": ({"figures": "data['nothing']"}, "data['nothing']", r"KeyError|nothing"),
    "a figure fails": ({"figures": "{'a': lambda: 1 / 0}"}, "1 / 0", r"ZeroDivisionError: division by zero"),
    "noise": ({"study": study(noise="[0.1, 0.2]")}, "study =", r"noise must be .*1 output\(s\).*got shape \(2,\)"),
    "noise's kind": ({"study": study(noise="'loud'")}, "study =", r"noise must be .* got 'loud'"),
    "disturbance": ({"study": study(disturbance="[1.0, 2.0]")}, "study =", r"disturbance must be .* got shape \(2,\)"),
    "initial": ({"study": study(initial="[1.0, 2.0]")}, "study =", r"initial must be .* got shape \(2,\)"),
    "first plan": ({"study": study(first_plan="[1.0, 2.0]")}, "study =", r"first_plan must be .* got shape \(2,\)"),
    "truth": (
        {"study": study(truth="{'mas': 1.1}")},
        "study =",
        r"truth\.mas must be a quantity of cart, .*mass",
    ),
    "controllers": (
        {"study": study(controllers="[Mine()]")},
        "study =",
        r"must be laws by name.* got list",
    ),
    "a controller": ({"study": study(controllers="{'mine': Mine}")}, "study =", r"controllers\.mine must be a Law"),
    "trial length": ({"study": study(trial_length="'fixed'")}, "study =", r"trial_length must be .* got 'fixed'"),
    "lengths": ({"study": study(trial_length="[3, 4]")}, "study =", r"trial_length must be .* got \[3, 4\]"),
    "a plant's class": ({"study": study(plant="Cart")}, "study =", r"plant must be a Plant, made with its settings"),
    "no study": ({"study": "Cart()"}, "", r"must declare a variable named study"),
    "nothing to run": ({"study": "run(None)"}, "study =", r"run takes a Study.* got None"),
    "a plant to run": ({"study": "run(Cart())"}, "study =", r"run takes a Study.* got Cart\("),
    "a setting": ({"study": "Study(plant=Cart(mass=-3))"}, "study =", r"mass must lie in \(0, ∞\) kg, got -3"),
    "an old name": (
        {"study": "__import__('workbench').TrialStudy()"},
        "study =",
        r"TrialStudy is now workbench\.Study",
    ),
    "a figure's name": (
        {"study": f"{DEFAULTS['study']}; run(study, show_progress=False).figures()['mses']"},
        "study =",
        r"there is no figure 'mses'",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_one_line(slip, tmp_path, monkeypatch, capfd):
    changed, stands, says = SLIPS[slip]
    file = tmp_path / "mine.py"
    file.write_text(PLANT.format(**{**DEFAULTS, **changed}))
    monkeypatch.setattr(sys, "argv", ["workbench", "run", str(file), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    said = capfd.readouterr().err.strip().splitlines()
    assert ended.value.code == 2, said
    last = said[-1]
    assert last.startswith("workbench: ") and "Traceback" not in "".join(said), said
    assert re.search(says, last), last
    assert file.name in last, last
    if stands:
        lines = [number for number, line in enumerate(file.read_text().splitlines(), 1) if stands in line]
        assert any(re.search(rf"line {number}\b", last) for number in lines), (last, lines)


def test_what_is_right_runs(tmp_path, monkeypatch, capfd):
    file = tmp_path / "mine.py"
    file.write_text(PLANT.format(**DEFAULTS))
    monkeypatch.setattr(sys, "argv", ["workbench", "run", str(file), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code and (tmp_path / "out" / "run.nc").is_file()
