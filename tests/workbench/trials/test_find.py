"""A study in a file of one's own, among others of one's own."""

from __future__ import annotations

import sys

import pytest

from models.quantity import InvalidValue
from workbench.trials import find as studies

STUDY = """
from __future__ import annotations
import numpy as np
from {module} import GAIN
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench.controllers import PD
from workbench.contracts.study import Study

@declared
class Cart(Plant):
    inputs = signals(force="N")
    states = outputs = signals(speed="m/s")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (x.speed + GAIN * u.force,)

    def output(self, x):
        return (x.speed,)

study = Study(name="own", plant=Cart(), reference=np.arange(5.0), controllers={{"pd": PD()}}, trials=2)
"""


def gain(file) -> float:
    plant = studies.find(str(file)).plant
    return float(plant.next_output_function()(0.0, 1.0, [], 0))


def test_a_module_beside_a_study_is_found_and_is_its_own(tmp_path):
    before = list(sys.path)
    for folder in ("one", "two", "three"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "own.py").write_text(STUDY.format(module="beside_a_study"))
    (tmp_path / "one" / "beside_a_study.py").write_text("GAIN = 2.0\n")
    (tmp_path / "two" / "beside_a_study.py").write_text("GAIN = 3.0\n")
    (tmp_path / "three" / "beside_a_study").mkdir()
    (tmp_path / "three" / "beside_a_study" / "__init__.py").write_text("from beside_a_study.deep import GAIN\n")
    (tmp_path / "three" / "beside_a_study" / "deep.py").write_text("GAIN = 4.0\n")
    assert [gain(tmp_path / folder / "own.py") for folder in ("one", "two", "three", "one")] == [2.0, 3.0, 4.0, 2.0]
    assert sys.path == before


def test_a_module_beside_a_study_that_has_a_name_of_ours_is_named(tmp_path):
    (tmp_path / "models.py").write_text("GAIN = 2.0\n")
    (tmp_path / "own.py").write_text(STUDY.format(module="models"))
    with pytest.raises(InvalidValue) as raised:
        studies.find(str(tmp_path / "own.py"))
    said = str(raised.value)
    assert f"; {tmp_path / 'models.py'} has the name of a package of the workbench: rename it" in said
    assert "own.py, line 4, failed: ImportError: cannot import name 'GAIN'" in said and len(said.splitlines()) == 1
