"""Every case of a study is verified, with the claims that the study makes itself; their slips are told in one line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from models.quantity import InvalidValue
from verification import Report, verify
from verification.decide.verify import verify_cases
from workbench.contracts.settings import in_case
from workbench.contracts.study import Study
from workbench.trials.campaign import load, run
from workbench.trials.find import find

VERDICTS = {"verdicts.json", "verdicts.xml", "certificates"}
WHOLE = {"run.nc", "provenance.json", "scores.json", "report.html", "figures"} | VERDICTS
PART = {"run.nc", "provenance.json", "scores.json", "figures"}
OWN = """
import numpy as np
from models.plant import Plant, signals
from models.quantity import declared, quantity
from verification import Claim, Finding
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

def low(study, data):
    def check():
        last = float(data["mse"].values[0, -1])
        return Finding(method="looked at", margin=0.9 - last, witness={"gain": study.plant.gain})

    return [Claim(name="own.low", statement="The last MSE is low.", source="ours", check=check)]

study = Study(name="own", plant=Gain(), reference=np.ones(11), trials=3,
              controllers={"pd": PD(kp=0.2, kd=0.0, initial_input=1.0)},
              cases={"strong": {"plant.gain": 2.0}, "noisy": {"noise.sigma": 0.01, "trials": 4}},
              drawings=lambda study, data: {}, claims=(low,))
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Study:
    file = tmp_path_factory.mktemp("own") / "own.py"
    file.write_text(OWN)
    return find(str(file))


@pytest.fixture(scope="module")
def verified(own: Study, tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Path]:
    folder = tmp_path_factory.mktemp("verified")
    return verify_cases(own, folder, show_progress=False), folder


def names(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


def test_every_case_has_its_files(own: Study, verified: tuple[Report, Path]) -> None:
    report, folder = verified
    assert names(folder) == WHOLE | {"cases"} and names(folder / "cases") == set(own.cases) == set(report.cases)
    for case in ("", *own.cases):
        at = folder / "cases" / case if case else folder
        assert not case or names(at) == PART
        loaded, again = load(at, own), run(in_case(own, case), show_progress=False)
        assert loaded.study.case == case and loaded.settings == again.settings
        assert loaded.data.identical(again.data)
        written = json.loads((at / "scores.json").read_text())
        assert written["settings"] == again.settings
        assert again.scores()["pd"].items() <= written["scores"]["pd"].items()
    gains = [load(folder / "cases" / "strong", own).study.plant.gain, load(folder, own).study.plant.gain]
    assert gains == [2.0, 0.5]


def test_one_file_of_verdicts_speaks_of_all_cases(own: Study, verified: tuple[Report, Path]) -> None:
    report, folder = verified
    told = json.loads((folder / "verdicts.json").read_text())
    assert list(dict.fromkeys(one["case"] for one in told)) == ["default", *own.cases]
    assert len(told) == len(report.all_verdicts) + len(report.all_not_made)
    for case in own.cases:
        alone = verify(run(in_case(own, case), show_progress=False), show_progress=False)
        assert [one for one in told if one["case"] == case] == json.loads(
            json.dumps([one.as_json() for one in (*alone.verdicts, *alone.not_made)])
        )
    page = (folder / "report.html").read_text()
    assert all(case in page for case in own.cases)


def test_claims_of_the_study_stand_beside_those_of_learning_laws(verified: tuple[Report, Path]) -> None:
    report, _ = verified
    found = {one.case: one for one in report.all_verdicts if one.claim == "own.low"}
    assert list(found) == ["default", "strong", "noisy"]
    assert [one.witness for one in found.values()] == [{"gain": 0.5}, {"gain": 2.0}, {"gain": 0.5}]
    assert all(one.margin is not None and one.method == "looked at" for one in found.values())
    assert "own.A1" in {one.claim for one in report.verdicts} and report.verdicts[-1].claim == "own.low"


@pytest.mark.parametrize("case", ["default", "strong"])
def test_one_case_alone(own: Study, tmp_path: Path, case: str) -> None:
    report = verify_cases(own, tmp_path, only=case, show_progress=False)
    assert names(tmp_path) == WHOLE and not report.cases
    assert {one["case"] for one in json.loads((tmp_path / "verdicts.json").read_text())} == {case}
    assert load(tmp_path, own).study.plant.gain == {"default": 0.5, "strong": 2.0}[case]


def test_a_case_that_there_is_not(own: Study, tmp_path: Path) -> None:
    with pytest.raises(InvalidValue, match=r"no case 'weak' of own; its cases are: default, strong, noisy$"):
        verify_cases(own, tmp_path, only="weak", show_progress=False)
    assert not names(tmp_path)


@pytest.mark.parametrize("thing", ["study", "data", "name", "none"])
def test_what_is_no_campaign_is_refused_in_one_line(own: Study, thing: str) -> None:
    given = {"study": own, "data": run(own, show_progress=False).data, "name": "out/own", "none": None}[thing]
    with pytest.raises(InvalidValue, match=r"verify takes a campaign, as in verify\(run\(study\)\); got ") as caught:
        verify(given, show_progress=False)
    assert "\n" not in str(caught.value)


ONE = 'Claim(name="own.x", statement="s", source="ours", check={})'
PASSED = 'Finding(method="m", holds=True)'
SLIPS = {
    # what stands in the file, and what is said
    "a claimer that raises": ("raise KeyError('speed')", r"\(the claims of the study\) KeyError: 'speed'"),
    "an input that is no such": ("data['speed']", r"\(the claims of the study\) KeyError"),
    "no Claim": ("return ['low']", r"\(the claims of the study\) claims must be Claim objects, got 'low'"),
    "nothing": ("pass", r"\(the claims of the study\) .*got None"),
    "one that is no row": (f"return {ONE.format('lambda: None')}", r"\(the claims of the study\) .*got Claim"),
    "a claim without its source": ("return [Claim(name='own.x')]", r"\(the claims of the study\) TypeError: .*source"),
    "a check that raises": (f"return [{ONE.format('lambda: 1 / 0')}]", r"\(the check of own.x\) ZeroDivisionError"),
    "no Finding": (f"return [{ONE.format('lambda: True')}]", r"\(the check of own.x\) a check must give a Finding"),
    "no check": (f"return [{ONE.format('None')}]", r"the check of own.x must be a function, got None"),
    "a check that wants more": (f"return [{ONE.format('lambda data: ' + PASSED)}]", r"\(the check of own.x\) TypeErr"),
    "no witness": (
        f"return [{ONE.format('lambda: Finding(holds=False, method=str(1))')}]",
        r"\(the check of own.x\) ValueError: a claim is refuted with a witness",
    ),
}


def with_slip(body: str) -> str:
    """The study's file with a claimer whose only line is ``body``."""
    before, study = OWN.split("def low")
    return f"{before}def slip(study, data):\n    {body}\n\n{study[study.index('study = Study') :]}".replace(
        "low,", "slip,"
    )


@pytest.mark.parametrize("what", SLIPS)
def test_a_slip_in_claims_is_told_with_its_place(what: str, tmp_path: Path) -> None:
    body, said = SLIPS[what]
    file = tmp_path / "own.py"
    file.write_text(with_slip(body))
    (tmp_path / "out").mkdir()
    with pytest.raises(InvalidValue, match=said) as caught:
        verify_cases(find(str(file)), tmp_path / "out", show_progress=False)
    line = next(i for i, text in enumerate(file.read_text().splitlines(), 1) if text.startswith("def slip"))
    assert re.match(rf"\S*own\.py, line ({line}|{line + 1})\b", str(caught.value)), caught.value
    assert "\n" not in str(caught.value)


def command(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    arguments = [sys.executable, "-m", "workbench", "verify", "own.py", *options]
    return subprocess.run(arguments, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


def test_the_command_names_the_case_of_every_verdict(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    done = command(tmp_path)
    assert done.returncode in (0, 1) and not done.stderr, done.stderr
    rows = {tuple(line.split()[:2]) for line in done.stdout.splitlines()}
    assert {(case, "own.low") for case in ("default", "strong", "noisy")} | {("strong", "own.A1")} <= rows
    assert names(tmp_path / "out" / "own") == WHOLE | {"cases"}
    again = command(tmp_path, "--case", "strong", "--json")
    assert {one["case"] for one in json.loads(again.stdout)} == {"strong"}
    assert names(tmp_path / "out" / "own") == WHOLE, "what an earlier run wrote has gone"


def test_the_command_tells_a_slip_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(with_slip("raise KeyError('speed')"))
    done = command(tmp_path, "--case", "default")
    assert done.returncode == 2 and not done.stdout
    [line] = [one for one in done.stderr.splitlines() if one]
    assert "own.py, line" in line and "KeyError: 'speed'" in line
