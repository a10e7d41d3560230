"""Refutations that were written are replayed: what still fails stands, what was changed does not."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import verification.decide.replay as replaying
import verification.decide.verify as verifying
from models.quantity import InvalidValue
from verification import Replay, replay
from verification.decide.verify import verify_cases
from workbench.contracts.claim import Claim
from workbench.contracts.examination import Examination
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.study import Study
from workbench.trials.campaign import Campaign
from workbench.trials.find import find

OWN = """
import numpy as np
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench import Study
from workbench.controllers import PD

@declared
class Gain(Plant):
    states = outputs = signals(x="m")
    inputs = signals(u="N")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    gain: float = quantity(default=0.5, unit="m/N", doc="gain", above=0)

    def step(self, x, u, w, k):
        return (self.gain * u.u,)

    def output(self, x):
        return (x.x,)

study = Study(name="own", plant=Gain(), reference=np.ones(11), trials=3,
              controllers={"pd": PD(kp=0.2, kd=0.0, initial_input=1.0), "soft": PD(kp=0.1, kd=0.0, initial_input=1.0)},
              cases={"strong": {"plant.gain": 2.0}}, drawings=lambda study, data: {})
"""
SLIPS: dict[str, float] = {}
"""What departs on purpose, by the claim's last word."""


def examined(campaign: Campaign, *, full: bool = False) -> Examination:
    """Claims of every kind of replay; those with a size say that the gain is at most 0.3 or the last error below it."""
    gain, mse = campaign.study.plant.gain, campaign.data["mse"]

    def shifted(name: str, margin: float) -> float:
        return margin + SLIPS.get(name, 0.0)

    def at_witness(witness: Any) -> float:
        return shifted("own", 0.3 - witness["gain"])

    def error(law: str) -> Finding:
        last = float(mse.sel(controller=law).values[-1])
        return Finding(margin=shifted("again", -last), unit="m^2", witness={"last": last + SLIPS.get("witness", 0.0)})

    def made(name: str, check: Callable[[], Finding], law: str | None = None, **further: Any) -> Claim:
        return Claim(
            name=f"own.{name}", statement=f"{name} is small", source="s", check=check, controller=law, **further
        )

    claims = [
        made("own", lambda: Finding(margin=0.3 - gain, witness={"gain": gain}), replay=at_witness),
        made("again", lambda: error("pd"), "pd"),
        made("again", lambda: error("soft"), "soft"),
        made("settings", lambda: Finding(grounds=Grounds.SETTINGS, holds=gain > 9, witness={"gain": gain})),
        made("zero", lambda: Finding(margin=shifted("zero", 0.0), witness={"at": 1})),
        made("endless", lambda: Finding(margin=-np.inf, witness={"at": 1}), replay=lambda _: -np.inf),
        made("level", lambda: Finding(margin=0.0, witness={"at": 1}), replay=lambda _: 0.0),
        made("fresh", lambda: Finding(margin=-1.0 if campaign.recorded is None else 1.0, witness={"at": 1})),
        made("holds", lambda: Finding(holds=True), "pd"),
        made("open", lambda: undecided("budget")),
        made("strong", lambda: Finding(holds=gain < 1, witness={"gain": gain})),
        made("none", lambda: undecided("never looked at"), lacks="a horizon"),
        *([made("long", lambda: Finding(holds=False, witness={"at": 1}))] if full else []),
    ]
    return Examination(claims=claims, conclude=lambda _: [])


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Study:
    file = tmp_path_factory.mktemp("own") / "own.py"
    file.write_text(OWN)
    return find(str(file))


@pytest.fixture(autouse=True)
def _examined(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (replaying, verifying):
        monkeypatch.setattr(module, "examination_of", examined)
    SLIPS.clear()


@pytest.fixture(scope="module")
def folder(own: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("verified")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verifying, "examination_of", examined)
        verify_cases(own, made, full=True, show_progress=False)
    return made


MEANT: list[tuple[str, str | None, str | None]] = [
    ("own.own", None, None),
    ("own", None, "strong"),
    ("again", "pd", None),
    ("again", "soft", "strong"),
    ("own.settings", None, None),
    ("zero", None, None),
    ("endless", None, None),
    ("level", None, None),
    ("fresh", None, "strong"),
    ("strong", None, "strong"),
    ("long", None, None),
]


@pytest.mark.parametrize(("claim", "controller", "case"), MEANT)
def test_a_refutation_stands(own: Study, folder: Path, claim: str, controller: str | None, case: str | None) -> None:
    found = replay(folder, claim, controller, case, study=own)
    assert isinstance(found, Replay) and found.stands, found.reason
    [entry] = [
        one
        for one in json.loads((folder / "verdicts.json").read_text())
        if one["claim"] == found.claim and (one["case"], one["controller"]) == (case or "default", controller)
    ]
    assert found.witness == entry["witness"] and found.now == found.then == entry["replayed"]
    lines = "\n".join(found.lines())
    assert found.statement in lines and "stands" in lines and not re.search(r"\b(nan|inf)\b", lines)


@pytest.mark.parametrize(
    ("claim", "controller", "slip", "said"),
    [
        ("own", None, {"own": 1.0}, "does not fail at its witness"),
        ("own", None, {"own": 1e-5}, "by another margin: they differ by 1e-05"),
        ("own", None, {"own": float("nan")}, "the margin at the witness is no number"),
        ("again", "pd", {"again": 1e9}, "does not fail at its witness"),
        ("again", "pd", {"again": -1e-3}, "by another margin"),
        ("again", "pd", {"witness": 1e-3}, "at another place than its witness"),
        ("zero", None, {"zero": 1e-300}, "does not fail at its witness"),
        ("zero", None, {"zero": -1e-300}, "by another margin"),
    ],
)
def test_what_was_changed_does_not_stand(
    own: Study, folder: Path, claim: str, controller: str | None, slip: dict[str, float], said: str
) -> None:
    SLIPS.update(slip)
    found = replay(folder, claim, controller, study=own)
    assert not found.stands and said in found.reason, found.reason
    assert list(found.lines())[-1].startswith("The refutation does not stand: ")


def test_what_another_run_cannot_change_is_not_run(own: Study, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any, **__: Any) -> Campaign:
        raise RuntimeError("run")

    monkeypatch.setattr(verifying, "run", never)
    assert replay(folder, "settings", study=own).stands and replay(folder, "own", study=own).stands
    assert "RuntimeError" in replay(folder, "fresh", study=own).reason


def test_a_margin_that_agrees_to_the_last_digits_stands(own: Study, folder: Path) -> None:
    SLIPS["own"] = 1e-8
    assert replay(folder, "own", study=own).stands


def edited(folder: Path, at: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """Copy a folder, with every entry of its verdicts changed."""
    shutil.copytree(folder, at)
    entries = json.loads((at / "verdicts.json").read_text())
    for one in entries:
        change(one)
    (at / "verdicts.json").write_text(json.dumps(entries))
    return at


def test_an_edited_witness_does_not_stand(own: Study, folder: Path, tmp_path: Path) -> None:
    at = edited(folder, tmp_path / "out", lambda one: one.update(witness={"gain": 0.4}))
    assert not replay(at, "own", study=own).stands
    assert not replay(at, "again", "pd", study=own).stands
    at = edited(folder, tmp_path / "less", lambda one: one.update(witness={"gains": 0.5}))
    assert "the program met KeyError" in replay(at, "own", study=own).reason


def test_no_witness_is_bad_input(own: Study, folder: Path, tmp_path: Path) -> None:
    at = edited(folder, tmp_path / "out", lambda one: one.update(witness=None))
    with pytest.raises(InvalidValue, match="must have a witness to be replayed"):
        replay(at, "own", study=own)


@pytest.mark.parametrize(
    ("claim", "controller", "case", "said"),
    [
        ("owns", None, None, r"there is no claim 'owns' in this folder; did you mean own\.own"),
        ("qqqqqq", None, None, r"its claims are: own\.own, own\.again, "),
        ("again", None, None, "is REFUTED for several controllers: give --controller, of pd, soft"),
        ("again", "hard", None, "is a claim about pd, soft, got 'hard'"),
        ("settings", "pd", None, "is a claim about no controller, got 'pd'"),
        (
            "holds",
            None,
            None,
            "only a claim that is REFUTED can be replayed, got own.holds, pd, case default, SUPPORTED",
        ),
        ("open", None, None, "got own.open, case default, UNDECIDED"),
        ("none", None, None, "got own.none, case default, not made, as it lacks a horizon"),
        ("strong", None, None, r"SUPPORTED \(it is for own.strong, case strong\)"),
        ("own", None, "weak", "there is no claim own.own in case 'weak'; it is there in: default, strong"),
    ],
)
def test_what_cannot_be_replayed_is_told(
    own: Study, folder: Path, claim: str, controller: str | None, case: str | None, said: str
) -> None:
    with pytest.raises(InvalidValue, match=said) as caught:
        replay(folder, claim, controller, case, study=own)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("written", "said"),
    [
        (None, "in which there is no verdicts.json"),
        ("", "whose verdicts.json is no JSON"),
        ("{}", "holds no list of verdicts"),
        ("[1]", "holds no list of verdicts"),
        ("[]", "a run is loaded from an existing run.nc"),
    ],
)
def test_a_folder_of_something_else(own: Study, tmp_path: Path, written: str | None, said: str) -> None:
    if written is not None:
        (tmp_path / "verdicts.json").write_text(written)
    with pytest.raises(InvalidValue, match=said) as caught:
        replay(tmp_path, "own", study=own)
    assert "\n" not in str(caught.value)


def test_a_study_that_changed_since(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "own.py"
    file.write_text(OWN.replace("self.gain * u.u", "self.gain * u.u * u.u"))
    with pytest.raises(InvalidValue, match="the study must be the one that was run, but the equations of plant"):
        replay(folder, "own", study=find(str(file)))


@pytest.mark.parametrize("name", ["metro", "same-plant"])
def test_another_study_is_named(folder: Path, name: str) -> None:
    with pytest.raises(InvalidValue, match=f"is a run of the study 'own', got the study '{name}': give the one that"):
        replay(folder, "own", study=find(name))


def test_a_claim_that_is_no_longer_made(own: Study, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = Examination(claims=[], conclude=lambda _: [])
    monkeypatch.setattr(replaying, "examination_of", lambda campaign, full: nothing)
    with pytest.raises(InvalidValue, match="must be a claim that the study makes, but it makes none such any more"):
        replay(folder, "own", study=own)


COMMAND = """
from test_replay import examined
import verification.decide.replay, verification.decide.verify
verification.decide.replay.examination_of = verification.decide.verify.examination_of = examined
from workbench import cli
cli.main()
"""


@pytest.mark.parametrize(
    ("options", "status", "said"),
    [
        (["own", "--case", "strong"], 0, "The refutation stands"),
        (["again"], 2, "give --controller, of pd, soft"),
        (["again", "--controller", "soft"], 0, "margin now"),
        ([], 2, "Missing argument"),
        (["own"], 2, "not built in: give it, as in load(path, study), or with --study FILE"),
    ],
)
def test_the_command(folder: Path, tmp_path: Path, options: list[str], status: int, said: str) -> None:
    (tmp_path / "own.py").write_text(OWN)
    of_a_file = ["--study", "own.py"] if options != ["own"] else []
    arguments = [sys.executable, "-c", COMMAND, "replay", str(folder), *options, *of_a_file]
    environment = {"PYTHONPATH": ":".join([str(Path(__file__).parent), *sys.path])}
    done = subprocess.run(
        arguments, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False, env=environment
    )
    assert done.returncode == status, done.stderr
    assert said in (done.stdout if status == 0 else done.stderr) and "Traceback" not in done.stderr
