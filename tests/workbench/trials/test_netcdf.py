"""What run.nc holds comes back as it was: nothing is encoded, nothing decoded."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, quantity
from workbench.contracts import settings
from workbench.contracts.study import Study
from workbench.controllers import PD
from workbench.trials.campaign import Campaign, load, run
from workbench.trials.find import find
from workbench.trials.netcdf import packed, unpacked

UNITS = ["days", "day", "h", "s", "s since 2000-01-01", "hours since 2000-01-01", "days since x", "", "°", "1"]
SMALL = {
    "ato": ["seeds=2", "tune=true", "grid=[0.5,1]"],
    "maglev": ["periods=2"],
    "metro": ["trials=3"],
    "same-plant": ["trials=2", "budget=2"],
    "stopping": ["horizons=[3]"],
    "variable-gain": ["trials=2"],
}


@cache
def small(name: str) -> Campaign:
    return run(settings.assigned(find(name), SMALL[name]), show_progress=False)


def same(one: xr.Dataset, other: xr.Dataset) -> None:
    """Identical, and in what xarray's identity does not look at: dtypes, NaN and signed zeros, order."""
    xr.testing.assert_identical(one, other)
    assert list(one.variables) == list(other.variables) and list(one.coords) == list(other.coords)
    for name, variable in one.variables.items():
        back = other.variables[name]
        assert back.dtype == variable.dtype and back.dims == variable.dims, name
        assert back.values.tobytes() == variable.values.tobytes(), name
        assert list(back.attrs) == list(variable.attrs), name


def back(data: xr.Dataset, folder: Path) -> xr.Dataset:
    """Write a Dataset and read it."""
    (folder / "run.nc").write_bytes(packed(data, {}))
    return unpacked(folder / "run.nc")


@pytest.mark.parametrize("name", sorted(SMALL))
def test_every_study_comes_back_as_it_was(name: str, tmp_path: Path) -> None:
    done = small(name)
    done.record(tmp_path)
    same(done.data, load(tmp_path).data)


@declared
class Clock(Plant):
    """A plant whose units a test chooses."""

    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    states = outputs = signals(late="s")
    inputs = signals(push="1")

    def step(self, x, u, w, k):
        return (0.5 * x.late + u.push,)

    def output(self, x):
        return (x.late,)


@pytest.mark.parametrize("unit", UNITS)
def test_any_unit_is_only_a_word(unit: str, tmp_path: Path) -> None:
    class Own(Clock):
        states = outputs = signals(late=unit)
        inputs = signals(push=unit)

    study = Study(plant=Own(), reference=np.ones(11), controllers={"pd": PD()}, trials=2)
    done = run(study, show_progress=False)
    done.record(tmp_path)
    again = load(tmp_path, study)
    same(done.data, again.data)
    assert again.data["output"].attrs["units"] == unit and again.scores() == done.scores()


@pytest.mark.parametrize(
    "attrs",
    [
        {"_FillValue": 1.0},
        {"missing_value": 2.0},
        {"scale_factor": 10.0, "add_offset": 3.0},
        {"valid_range": np.array([0.0, 1.0])},
        {"dtype": "bool"},
        {"coordinates": "a b"},
        {"_Unsigned": "true"},
        {"calendar": "noleap", "units": "days since 2000-01-01"},
    ],
    ids=str,
)
def test_attributes_change_no_number(attrs: dict[str, object], tmp_path: Path) -> None:
    numbers = np.array([1.0, 2.0, -0.0, np.nan, -np.inf, 5e-324])
    data = small("variable-gain").data.assign(extra=("more", numbers, {"units": "1", **attrs}))
    same(data, back(data, tmp_path))


@pytest.mark.parametrize(
    "values",
    [
        np.array([True, False]),
        np.array([1, 2], dtype="datetime64[ns]"),
        np.array([1, -2], dtype="timedelta64[ns]"),
        np.array(["", "a b", "ü°\n", "nan"]),
        np.array([], dtype="<U1"),
        np.array("one"),
        np.array(np.nan),
        np.array([1, 255], dtype=np.uint8),
        np.array([1.5], dtype=np.float32),
        np.arange(20_000.0).reshape(2, 100, 100),
    ],
    ids=lambda values: f"{values.dtype}{values.shape}",
)
def test_every_kind_of_value_comes_back(values: np.ndarray, tmp_path: Path) -> None:
    axes = tuple(f"axis_{i}" for i in range(values.ndim))
    data = small("variable-gain").data.assign(extra=(axes, values, {"units": "1"}))
    same(data, back(data, tmp_path))


@pytest.mark.parametrize(
    ("values", "attrs", "message"),
    [
        (np.array([1j]), {}, "extra must hold numbers, text, times or truths, got complex128"),
        (np.array([b"x"]), {}, "extra must hold numbers, text, times or truths"),
        (np.array(["a\0b"]), {}, "extra cannot be written to run.nc"),
        (np.array([1.0]), {"units": None}, "extra cannot be written to run.nc"),
        (np.array([object()], dtype=object), {}, "extra must hold numbers, text, times or truths, got object"),
    ],
    ids=["complex", "bytes", "nul", "attribute", "object"],
)
def test_what_cannot_be_written_is_one_line(values, attrs, message: str, tmp_path: Path) -> None:
    data = small("variable-gain").data.assign(extra=("more", values, attrs))
    with pytest.raises(InvalidValue, match=message) as caught:
        Campaign(small("variable-gain").study, data).save(tmp_path / "out")
    assert "\n" not in str(caught.value) and list(tmp_path.iterdir()) == []


def test_other_programs_read_it(tmp_path: Path) -> None:
    done = small("ato")
    done.record(tmp_path)
    with xr.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as opened:
        other = opened.load()
    assert set(other.coords) == set(done.data.coords)
    for name, variable in done.data.variables.items():
        np.testing.assert_array_equal(other.variables[name].values, variable.values)
        assert other.variables[name].attrs == variable.attrs
