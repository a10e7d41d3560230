"""A record that was edited is refused, with its run id or without; one that was not is verified."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from models.plant import Plant, signals
from models.quantity import InvalidValue, declared, quantity
from verification import verify
from workbench.contracts import settings
from workbench.contracts.examination import Examination
from workbench.contracts.scenario import NormalNoise
from workbench.contracts.study import Study, Sweep
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import ICFDL, PD
from workbench.trials.campaign import Campaign, load, run
from workbench.trials.find import find
from workbench.trials.netcdf import packed, unpacked
from workbench.trials.provenance import run_id
from workbench.trials.replay import departure

NOTHING = Examination(claims=[], conclude=lambda verdicts: [])
SMALL = {
    "ato": ["draws=2", "grid=[0.5,1]"],
    "maglev": ["trials=2"],
    "metro": ["trials=3"],
    "stopping": ["draws=1"],
    "variable-gain": ["trials=2"],
}
Edit = Callable[[xr.Dataset, dict[str, Any]], xr.Dataset | None]


@declared
class Cart(Plant):
    """A cart whose speed decays."""

    inputs = signals(force="N")
    states = outputs = signals(speed="m/s")
    mass: float = quantity(default=2.0, unit="kg", doc="mass", above=0)
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (0.9 * x.speed + self.sampling_time / self.mass * u.force,)

    def output(self, x: Any) -> Any:
        return (x.speed,)


class Heavier(Cart):
    """The same settings, other equations."""

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (0.8 * x.speed + self.sampling_time / self.mass * u.force,)


class Louder(PD):
    """The same settings, another law."""

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> Any:
        u, state = super().act(memory_k, state, r, r_next, y)
        return 2 * u, state


def study(**fields: Any) -> Study:
    given: dict[str, Any] = {
        "name": "cart",
        "plant": Cart(),
        "reference": np.sin(np.linspace(0, 3, 41)),
        "controllers": {"pd": PD(kp=0.5, kd=0.0), "icfdl": ICFDL(force_unit=1.0, initial_input=0.0)},
        "trials": 6,
        "trial_length": TrialLength(law="uniform", minimum=30),
        "noise": NormalNoise(sigma=0.01),
        "sweeps": (Sweep(field="kp", values=(0.1, 0.2), controllers=("pd",)),),
        "drawings": lambda study, data: {},
    }
    return Study(**(given | fields))


@cache
def ran() -> Campaign:
    return run(study(), show_progress=False)


def changed_settings(data: xr.Dataset, path: str, value: Any) -> None:
    content = json.loads(data.attrs["settings"])
    *above, last = path.split(".")
    at = content
    for name in above:
        at = at[name]
    assert at[last] != value
    at[last] = value
    data.attrs["settings"] = json.dumps(content)


def scaled(name: str, factor: float) -> Edit:
    def edit(data: xr.Dataset, source: dict[str, Any]) -> None:
        data[name].values[...] *= factor

    return edit


def one_bit(name: str, at: tuple[int, ...]) -> Edit:
    def edit(data: xr.Dataset, source: dict[str, Any]) -> None:
        data[name].values.view(np.uint64)[at] ^= np.uint64(1)

    return edit


def both(data: xr.Dataset, source: dict[str, Any]) -> None:
    """Inputs and what follows from them, so that they fit together."""
    data["input"].values[...] = 0.0
    data["output"].values[...] = np.where(np.isnan(data["output"].values), np.nan, 0.0)
    data["error"].values[...] = data["reference"].values - data["output"].values


def put(name: str, value: Any) -> Edit:
    def edit(data: xr.Dataset, source: dict[str, Any]) -> None:
        data[name].values[tuple(0 for _ in data[name].dims)] = value

    return edit


def attribute(name: str, key: str, value: str) -> Edit:
    def edit(data: xr.Dataset, source: dict[str, Any]) -> None:
        data[name].attrs[key] = value

    return edit


def longer(data: xr.Dataset, source: dict[str, Any]) -> None:
    data["trial_length"].values[2] += 1


def version(data: xr.Dataset, source: dict[str, Any]) -> None:
    data.attrs["version"] = "9.9"


def source_seed(data: xr.Dataset, source: dict[str, Any]) -> None:
    source["seed"] = 3


def law_hash(data: xr.Dataset, source: dict[str, Any]) -> None:
    source["laws"]["pd"] = "0" * 64


EDITS: dict[str, tuple[Edit, str]] = {
    "outputs doubled": (scaled("output", 2.0), "but output at controller pd, trial 1, sample"),
    "inputs edited": (scaled("input", 1.01), "but input at"),
    "inputs and outputs together": (both, "but (output|error|input) at"),
    "errors scaled": (scaled("error", 0.5), "but error at"),
    "one bit, in a middle trial": (one_bit("output", (1, 3, 17)), "output at controller icfdl, trial 4, sample 17"),
    "one bit of what is missing": (one_bit("input", (0, 0, 40)), "input at controller pd, trial 1, sample 40 is nan"),
    "mse": (put("mse", 0.0), "but mse at controller pd, trial 1 is 0.0 in the record"),
    "a sweep": (scaled("sweep_kp_mse_last", 2.0), "but sweep_kp_mse_last at"),
    "a reason": (put("stopped", "a"), "but stopped at controller pd is a"),
    "trial lengths": (longer, "but trial_length at trial 3"),
    "trials cut": (lambda data, source: data.isel(trial=slice(0, 3)), "trial 3.* in the record and .*trial 6"),
    "a variable dropped": (lambda data, source: data.drop_vars("mse"), "mse is in the replay alone"),
    "a variable added": (lambda data, source: data.assign(good=1.0), "good is in the record alone"),
    "a unit": (attribute("output", "units", "km/h"), "the attributes of output"),
    "mass": (lambda data, source: changed_settings(data, "plant.mass", 1.5), "but .* at "),
    "seed in the settings": (lambda data, source: changed_settings(data, "seed", 1), "its seed, 0 in the record and 1"),
    "seed everywhere": (
        lambda data, source: (changed_settings(data, "seed", 1), source.update(seed=1)) and None,
        "but .* at ",
    ),
    "noise": (lambda data, source: changed_settings(data, "noise.sigma", 0.02), "but .* at "),
    "number of trials": (lambda data, source: changed_settings(data, "trials", 3), "in the record and"),
    "a law's gain": (lambda data, source: changed_settings(data, "controllers.pd.kp", 0.4), "but .* at "),
    "version": (version, "verified by the version that made it, 9.9, got"),
    "seed of the provenance": (source_seed, "its seed, 3 in the record and 0"),
    "digest of a law": (law_hash, "the equations of the law pd changed since"),
}


def edited(folder: Path, edit: Edit, *, with_id: bool) -> Path:
    """Write a record and edit it, its run id too or not."""
    ran().record(folder)
    file = folder / "run.nc"
    data = unpacked(file)
    told, source = data.attrs.pop("run_id"), json.loads(data.attrs.pop("provenance"))
    again = edit(data, source)
    data = data if again is None else again
    told = run_id(data.attrs, source, data) if with_id else told
    file.write_bytes(packed(data, {"run_id": told, "provenance": json.dumps(source)}))
    if with_id:
        (folder / "provenance.json").write_text(json.dumps({"run_id": told, **source}))
    return file


@pytest.mark.parametrize("what", EDITS)
def test_an_edited_record_does_not_load(what: str, tmp_path: Path) -> None:
    file = edited(tmp_path, EDITS[what][0], with_id=False)
    with pytest.raises(InvalidValue, match=r"run.nc must hold what its run id .* was edited or damaged") as caught:
        load(file, study())
    assert "\n" not in str(caught.value) and str(caught.value).endswith("run the study again")


@pytest.mark.parametrize("what", EDITS)
def test_one_edited_with_its_id_is_not_verified(what: str, tmp_path: Path) -> None:
    edit, message = EDITS[what]
    loaded = load(edited(tmp_path, edit, with_id=True), study())
    with pytest.raises(InvalidValue, match=message) as caught:
        verify(loaded, NOTHING, show_progress=False)
    assert "\n" not in str(caught.value) and "run the study again" in str(caught.value)


def test_a_record_that_nobody_edited_is_verified(tmp_path: Path) -> None:
    loaded = load(edited(tmp_path, lambda data, source: None, with_id=False), study())
    assert loaded.recorded is not None
    assert verify(loaded, NOTHING, show_progress=False).verdicts == []
    loaded.data["output"].values[...] *= 2
    with pytest.raises(InvalidValue, match="but output at"):
        verify(loaded, NOTHING, show_progress=False)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"plant": Heavier()}, "but the equations of plant changed since"),
        (
            {"controllers": {"pd": Louder(kp=0.5, kd=0.0), "icfdl": ICFDL(force_unit=1.0)}},
            "of the law pd changed since",
        ),
        ({"reference": np.sin(np.linspace(0, 3.1, 41))}, "but reference at sample 1 is"),
        ({"continues": True}, "code that the study calls changed since"),
        ({"controllers": {"pd": PD(), "icfdl": ICFDL(), "more": PD()}}, "its list of settings changed since"),
    ],
    ids=["plant", "law", "reference", "scenario", "settings"],
)
def test_a_study_that_changed_since_says_so(fields: dict[str, Any], message: str, tmp_path: Path) -> None:
    ran().record(tmp_path)
    with pytest.raises(InvalidValue, match=message):
        verify(load(tmp_path, study(**fields)), NOTHING, show_progress=False)


@pytest.mark.parametrize("name", sorted(SMALL))
def test_every_kind_of_study_is_replayed(name: str, tmp_path: Path) -> None:
    chosen = find(name)
    done = run(settings.assigned(chosen, SMALL[name]), show_progress=False)
    done.record(tmp_path)
    loaded = load(tmp_path, chosen)
    verify(loaded, NOTHING, show_progress=False)
    numbers = [key for key, one in loaded.data.data_vars.items() if one.dtype == float and one.size]
    assert len(numbers) > 3
    for key in numbers:
        data = loaded.data.copy(deep=True)
        flat = data[key].values.reshape(-1).view(np.uint64)
        flat[flat.size // 2] ^= np.uint64(1)
        said = departure(data, loaded.data)
        assert said.startswith(str(key)) and "(1 of " in said, said
    loaded.data[numbers[0]].values.reshape(-1).view(np.uint64)[-1] ^= np.uint64(1)
    with pytest.raises(InvalidValue, match=rf"but {numbers[0]}"):
        verify(loaded, NOTHING, show_progress=False)


def test_provenance_is_the_same_on_every_day_and_names_everything(tmp_path: Path) -> None:
    contents = []
    for folder in ("a", "b"):
        done = run(study(), show_progress=False)
        done.save(tmp_path / folder)
        contents.append((tmp_path / folder / "provenance.json").read_text())
        assert (tmp_path / folder / "run.nc").read_bytes() == (tmp_path / "a" / "run.nc").read_bytes()
    assert contents[0] == contents[1]
    content = json.loads(contents[0])
    names = {"study", "run_id", "version", "python", "casadi", "numpy", "machine", "compiler", "seed", "plants", "laws"}
    assert set(content) == names | {"files"} and content["seed"] == 0
    assert set(content["plants"]) == {"plant"} and set(content["laws"]) == {"pd", "icfdl"}
    assert content["files"] == ["figures", "run.nc", "scores.json"]
    for other in (study(seed=1), study(plant=Heavier())):
        assert run(other, show_progress=False).provenance() != run(study(), show_progress=False).provenance()


@pytest.mark.parametrize("text", ["", "{}", '{"run_id": "0"}', "[]"])
def test_another_provenance_beside_a_record_is_refused(text: str, tmp_path: Path) -> None:
    ran().record(tmp_path)
    (tmp_path / "provenance.json").write_text(text)
    with pytest.raises(InvalidValue, match=r"provenance.json must name the run id .* of run.nc beside it"):
        load(tmp_path, study())
    (tmp_path / "provenance.json").unlink()
    assert load(tmp_path, study()).settings == ran().settings
