"""Every setting a little off: which are, by how much, and which stay."""

from __future__ import annotations

import numpy as np
import pytest
from learning_laws import Planned, Second

from models.quantity import count, declared, quantity, table
from models.reference import Reference
from studies.maglev.study import STUDY as MAGLEV
from studies.metro.study import STUDY as METRO
from workbench.contracts import settings
from workbench.contracts.nudge import nudged, varied
from workbench.contracts.scenario import From, NormalNoise, Times
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength


@declared
class Ended(Planned):
    """A law with numbers at the ends of their ranges, and with some that shape its equations."""

    low: float = quantity(default=1.0, unit="1", doc="at its lower end", least=1.0)
    high: float = quantity(default=1.0, unit="1", doc="at its upper end", most=1.0)
    fixed: float = quantity(default=1.0, unit="1", doc="at both ends", least=1.0, most=1.0)
    none: float = quantity(default=0.0, unit="1", doc="zero")
    often: int = count(default=3, doc="a count")
    shape: float = quantity(default=2.0, unit="1", doc="shapes the equations", structural=True)
    row: tuple[float, ...] = table(default=(1.0, 2.0), unit="1", doc="a table of the equations")


def study(**changes):
    fields = {
        "plant": Second(),
        "reference": np.linspace(0.0, 1.0, 21),
        "controllers": {"law": Ended()},
        "trials": 3,
        "noise": NormalNoise(sigma=0.1),
        "initial": From(state=(0.5, -2.0), spread=(0.0, 0.1)),
        "truth": {"sampling_time": Times(factor=1.1)},
    }
    return Study(**{**fields, **changes})


ALL = {
    "plant.sampling_time",
    "controllers.law.gain",
    "controllers.law.low",
    "controllers.law.high",
    "controllers.law.fixed",
    "noise.sigma",
    "initial.state",
    "initial.spread",
    "truth.sampling_time.factor",
}


def test_which_settings_there_are():
    assert set(varied(study())) == ALL


@pytest.mark.parametrize("relative", [1e-12, 1e-6])
@pytest.mark.parametrize("draw", range(4))
def test_each_is_off_by_the_factor_and_what_is_refused_stays(draw, relative):
    made = nudged(study(), relative, draw)
    before, after = varied(study()), varied(made.study)
    for path in made.moved:
        off = np.ravel(after[path]) / np.where(np.ravel(before[path]) == 0, 1, np.ravel(before[path]))
        wanted = np.ravel(before[path]) != 0
        assert np.allclose(np.abs(off - 1)[wanted], relative, rtol=1e-3, atol=0), path
    assert set(made.moved) | set(made.kept) == ALL
    assert set(made.moved).isdisjoint(made.kept)
    assert set(made.kept) <= {f"controllers.law.{name}" for name in ("low", "high", "fixed")}
    assert "controllers.law.fixed" in made.kept
    for path in made.kept:
        assert after[path] == before[path]
    same = {row.path: row.value for row in settings.rows(study()) if row.path not in made.moved}
    assert {row.path: row.value for row in settings.rows(made.study) if row.path in same} == same


def test_signs_come_of_the_draw_alone():
    def signs(draw, **changes):
        before, after = varied(study(**changes)), varied(nudged(study(**changes), 1e-6, draw).study)
        return [float(np.ravel(after[path])[0] > np.ravel(before[path])[0]) for path in before]

    assert signs(0) == signs(0) == signs(0, noise=NormalNoise(sigma=7.0), seed=5)
    assert len({tuple(signs(draw)) for draw in range(8)}) > 4
    mean = np.mean([signs(draw)[1] for draw in range(200)])  # the gain is never refused
    assert 0.35 < mean < 0.65


def test_what_is_set_aside_stays():
    made = nudged(study(), 1e-6, 0, aside=["controllers.law.gain", "initial.state"])
    assert made.study.controllers["law"].gain == Ended().gain and made.study.initial.state == (0.5, -2.0)
    assert {"controllers.law.gain", "initial.state"}.isdisjoint({*made.moved, *made.kept})


def test_what_is_drawn_stays_drawn():
    before, after = study().inputs(), nudged(study(), 1e-9, 1).study.inputs()
    for one, other in zip(before, after, strict=True):
        assert np.allclose(one.noise, other.noise, rtol=2e-9, atol=0) and not np.array_equal(one.noise, other.noise)
    varying = study(trial_length=TrialLength(law="uniform", minimum=10, maximum=20))
    lengths = [one.length for one in varying.inputs()]
    assert [one.length for one in nudged(varying, 1e-9, 1).study.inputs()] == lengths


def test_a_run_of_another_shape_is_not_made():
    assert MAGLEV.horizon == nudged(MAGLEV, 1e-6, 0).study.horizon
    assert all(path.startswith("reference.") for path in nudged(MAGLEV, 1e-6, 0).kept)
    assert not nudged(MAGLEV, 1e-12, 0).kept


@declared
class Lasting(Reference):
    """A ramp that lasts a time which is a multiple of the sampling time: longer by anything, it has a sample more."""

    seconds: float = quantity(default=20.0, unit="s", doc="how long it lasts", above=0)
    height: float = quantity(default=2.0, unit="1", doc="where it ends")

    def samples(self, plant):
        last = int(np.ceil(self.seconds / float(plant.sampling_time)))
        return self.height * np.linspace(0.0, 1.0, last + 1)[None, :]


@pytest.mark.parametrize("draw", range(6))
def test_a_run_with_a_sample_more_is_not_made(draw):
    made = nudged(study(reference=Lasting()), 1e-6, draw)
    assert made.study.horizon == 20 and "reference.height" in made.moved
    longer = varied(made.study)["reference.seconds"] > varied(made.study)["plant.sampling_time"] * 20
    assert not longer


def test_a_law_that_would_refuse_the_task_is_left_as_it_is():
    @declared
    class Choosy(Planned):
        def refusal(self, task):
            return None if self.gain == 0.8 else "only with a gain of 0.8"

    made = nudged(study(controllers={"law": Choosy()}), 1e-6, 0)
    assert "controllers.law.gain" in made.kept and made.study.refusals() == {}


def test_all_that_can_be_changed_is_changed_whatever_is_refused():
    """Every subset of numbers at both ends of their range leaves exactly the others to be changed."""
    for pattern in range(32):
        fields = {
            f"q{i}": quantity(
                default=1.0,
                unit="1",
                doc="a number",
                **({"least": 1.0, "most": 1.0} if pattern >> i & 1 else {}),
            )
            for i in range(5)
        }
        made = declared(
            type("Some", (Planned,), {"__annotations__": dict.fromkeys(fields, float), "__doc__": "A law.", **fields})
        )()
        found = nudged(study(controllers={"law": made}), 1e-6, pattern)
        assert set(found.kept) == {f"controllers.law.q{i}" for i in range(5) if pattern >> i & 1}


def test_the_metro_study_has_its_numbers_and_no_others():
    paths = set(varied(METRO))
    assert {"plant.mass", "controllers.icfdl.lam", "controllers.pd.kp"} <= paths
    assert not [path for path in paths if path.startswith(("verify", "tuning", "trials", "seed", "divergence"))]
