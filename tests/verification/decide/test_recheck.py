"""What verify wrote is re-checked from its folder alone; what was changed in it is told, and what is no such folder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from models.quantity import InvalidValue
from verification.decide.recheck import recheck
from verification.decide.verify import verify_cases
from workbench.trials.find import find

OWN = """
import numpy as np
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench import Study
from workbench.controllers import ICFDL

@declared
class Tank(Plant):
    states = outputs = signals(level="m")
    inputs = signals(flow="l/s")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
    keep: float = quantity(default=0.6, unit="1", doc="share of the level that stays")

    def step(self, x, u, w, k):
        return (self.keep * x.level + 0.5 * u.flow,)

    def output(self, x):
        return (x.level,)

LAW = ICFDL(force_unit=1.0, rho=0.5, lam=1.0, mu=1.0, initial_input=0.3)
study = Study(name="own", plant=Tank(), reference=np.sin(np.linspace(0, 2, 9)), trials=4, controllers={"law": LAW},
              cases={"leaky": {"plant.keep": 0.3}}, drawings=lambda study, data: {})
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that verify wrote, with two cases."""
    place = tmp_path_factory.mktemp("recheck")
    (place / "own.py").write_text(OWN)
    draft = place / "out"
    draft.mkdir()
    verify_cases(find(str(place / "own.py")), draft, show_progress=False)
    return draft


@pytest.fixture
def copied(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "out"))


def read(place: Path) -> Any:
    return json.loads(place.read_text())


def write(place: Path, content: Any) -> None:
    place.write_text(json.dumps(content))


def test_a_folder_is_rechecked_as_it_was_written(written):
    found = recheck(written)
    assert found.stands and len(found.answers) >= 2 * 5  # both cases
    proved = [one for one in read(written / "verdicts.json") if one["standing"] == "PROVED"]
    assert len(found.answers) + len(found.alone) == len(proved)
    for one in proved:
        assert one["evidence"]["checked"] is bool(one["evidence"].get("certificate"))
    assert found.lines()[-1].startswith(f"{len(found.answers)} of {len(found.answers)} certificates accepted")
    alone = subprocess.run(
        [sys.executable, "-m", "verification.checker", str(written)], capture_output=True, text=True, check=True
    )
    assert alone.stdout.count("ACCEPTED") == len(found.answers)


def first(folder: Path) -> Path:
    """Return the file of the proof of a bound."""
    proofs = sorted((folder / "certificates" / "proofs").iterdir())
    return next(one for one in proofs if read(one)["kind"] == "bounds")


def loosened(folder: Path) -> None:
    content = read(first(folder))
    content["statement"]["set"][0]["high"] = (1e3).hex()
    write(first(folder), content)


def without_a_proof(folder: Path) -> None:
    first(folder).unlink()


def without_leaves(folder: Path) -> None:
    content = read(first(folder))
    content["proof"]["trees"][0] = []
    write(first(folder), content)


def of_another_graph(folder: Path) -> None:
    for one in (folder / "certificates" / "graphs").iterdir():
        content = read(one)
        content["nodes"] = [["const", (0.25).hex()] if node[0] == "const" else node for node in content["nodes"]]
        write(one, content)


def saying_more(folder: Path) -> None:
    index = read(folder / "certificates" / "index.json")
    index["claims"][0]["sentence"] = 64 * "0"
    write(folder / "certificates" / "index.json", index)


@pytest.mark.parametrize("change", [loosened, without_a_proof, without_leaves, of_another_graph, saying_more])
def test_what_was_changed_is_not_accepted(copied, change):
    change(copied)
    found = recheck(copied)
    assert not found.stands and any(line.startswith("REJECTED") for line in found.lines())


def of_another_run(folder: Path) -> None:
    verdicts = read(folder / "verdicts.json")
    write(folder / "verdicts.json", [one for one in verdicts if not one.get("evidence", {}).get("certificate")])


def without_an_index(folder: Path) -> None:
    (folder / "certificates" / "index.json").unlink()


def truncated(folder: Path) -> None:
    place = folder / "certificates" / "index.json"
    place.write_text(place.read_text()[:-20])


def of_another_version(folder: Path) -> None:
    index = read(folder / "certificates" / "index.json")
    write(folder / "certificates" / "index.json", {**index, "format": "workbench-certificate 0"})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (of_another_run, "in one alone"),
        (without_an_index, "index.json must be a file"),
        (truncated, "must hold JSON"),
        (of_another_version, "the format must be"),
        (shutil.rmtree, "a folder of certificates must be named"),
    ],
)
def test_what_is_no_folder_of_certificates_is_told_in_a_line(copied, change, words):
    change(copied)
    with pytest.raises(InvalidValue, match=words):
        recheck(copied)
    asked = subprocess.run(
        [sys.executable, "-m", "workbench", "recheck", str(copied)], capture_output=True, text=True, check=False
    )
    assert asked.returncode == 2 and len(asked.stderr.strip().splitlines()) == 1 and words in asked.stderr
