"""Settings for what proofs are stated for: set, read, listed and written like others, refused in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from models.actuator import Actuator
from models.metro_line import MetroLine
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, part, quantity, ranges
from workbench import Study, Verification, load, run
from workbench.contracts import settings
from workbench.contracts.study import composed
from workbench.controllers import PD
from workbench.trials.provenance import provenance

SCOPE = {"plant.mass": (280e3, 420e3), "initial.position": (-5.0, 5.0), "noise.speed": (-0.3, 0.3)}
LIMITS = {"speed": (None, 72.1), "force": (-4e5, None)}


def study(**fields):
    made = dict(plant=PointMass(), reference=np.linspace(0, 5, 21), controllers={"pd": PD()}, trials=2)
    return Study(**(made | fields))


MADE = study(
    verify=Verification(scope=SCOPE, limits=LIMITS), cases={"narrow": {"verify.scope": {"plant.b0_mean": [2e3, 3e3]}}}
)
WAYS = {
    "a declaration": lambda: MADE,
    "by path": lambda: settings.changed(study(), {"verify.scope": SCOPE, "verify.limits": LIMITS}),
    "nested": lambda: settings.changed(study(), {"verify": {"scope": SCOPE, "limits": LIMITS}}),
    "another declaration": lambda: settings.changed(study(), {"verify": MADE.verify}),
    "by assignment": lambda: settings.assigned(
        study(), [f"verify.scope={json.dumps(SCOPE)}", f"verify.limits={json.dumps(LIMITS)}"]
    ),
    "as JSON": lambda: settings.changed(study(), json.loads(json.dumps(settings.as_json(MADE)))),
    "in place of another": lambda: settings.changed(
        settings.changed(MADE, {"verify.scope": {"plant.length": (1, 2)}}), {"verify.scope": SCOPE}
    ),
    "of a study that is composed": lambda: settings.assigned(
        composed(
            PD(), lambda own, seed: {"plant": PointMass()}, reference=np.linspace(0, 5, 21), controllers={"a": PD()}
        ),
        [f"verify.scope={json.dumps(SCOPE)}", f"verify.limits={json.dumps(LIMITS)}"],
    ),
    "arrays": lambda: study(
        verify=Verification(scope={name: np.array(ends) for name, ends in SCOPE.items()}, limits=LIMITS)
    ),
    "under a former name": lambda: settings.changed(
        study(renamed={"holds": "verify.scope"}), {"holds": SCOPE, "verify.limits": LIMITS}
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_it_is_set_like_other_settings(way):
    verify = WAYS[way]().verify
    assert dict(verify.scope) == SCOPE and dict(verify.limits) == LIMITS


def test_it_is_listed_replaced_as_a_whole_and_empty_by_default():
    rows = {row.path: row for row in settings.rows(MADE)}
    assert rows["verify.scope"].value == {name: list(ends) for name, ends in SCOPE.items()}
    assert rows["verify.limits"].value == {"speed": [None, 72.1], "force": [-4e5, None]}
    assert "null" in rows["verify.limits"].range and "null" not in rows["verify.scope"].range
    assert dict(settings.in_case(MADE, "narrow").verify.scope) == {"plant.b0_mean": (2e3, 3e3)}
    assert dict(settings.in_case(MADE, "narrow").verify.limits) == LIMITS
    assert dict(settings.changed(MADE, {"verify.scope": {}}).verify.scope) == {}
    assert settings.as_json(study())["verify"] == {"scope": {}, "limits": {}}
    assert dict(settings.assigned(MADE, ["plant.mass=3e5"]).verify.scope) == SCOPE


def test_it_is_written_and_read_back_and_changes_nothing_that_is_run(tmp_path):
    done, plain = run(MADE, show_progress=False), run(study(), show_progress=False)
    assert done.data.drop_attrs().equals(plain.data.drop_attrs())
    assert provenance(MADE) == provenance(study())
    done.save(tmp_path / "out")
    again = load(tmp_path / "out", study())
    assert again.study.verify == MADE.verify and again.settings == done.settings


@declared
class Pair(Plant):
    """A plant of which one quantity bounds another, with a part and a disturbance."""

    source = "ours"
    inputs = signals(push="N")
    states = outputs = signals(place="m")
    disturbances = signals(wind="N")
    least: float = quantity(default=1.0, unit="m", doc="least")
    most: float = quantity(default=2.0, unit="m", doc="most")
    none: float | None = quantity(default=None, unit="m", doc="nothing", optional=True)
    many: float | tuple[float, ...] = quantity(default=(1.0, 2.0), unit="m", doc="one for each", rows=True)
    within: PD = part(default=PD(), doc="a part with quantities of its own")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def check(self) -> None:
        """Raise InvalidValue unless least lies below most, and both together below 20."""
        if isinstance(self.least, float) and isinstance(self.most, float) and self.least >= self.most:
            raise InvalidValue(f"least must lie below most, got {self.least:g} and {self.most:g}")
        if isinstance(self.least, float) and isinstance(self.most, float) and self.least + self.most > 20:
            raise InvalidValue(f"most must be at most 20 with least, got {self.least:g} and {self.most:g}")

    def step(self, x, u, w, k):
        return (x.place + self.sampling_time * (u.push + w.wind) * self.most,)

    def output(self, x):
        return (x.place,)


PAIR = dict(plant=Pair(), reference=np.linspace(0, 1, 11))


@pytest.mark.parametrize(
    "scope",
    [
        {"plant.least": (5.0, 6.0), "plant.most": (7.0, 8.0)},
        {"plant.least": (-1.0, 1.999)},
        {"plant.within.kp": (1.0, 2.0)},
        {"disturbance.wind": (-1, 2), "noise.place": (0, 0), "initial.place": (1, 1)},
    ],
)
def test_what_a_plant_can_have_is_taken(scope):
    assert dict(study(**PAIR, verify=Verification(scope=scope)).verify.scope) == scope


@pytest.mark.parametrize(
    ("scope", "says"),
    [
        ({"plant.leest": (0, 1)}, r"verify.scope names 'plant.leest', which there is not; did you mean plant.least"),
        ({"mass": (0, 1)}, r"verify.scope names 'mass', which there is not; (did you mean|there are:)"),
        ({"noise.push": (-1, 1)}, r"names 'noise.push', which there is not"),
        ({"disturbance.place": (-1, 1)}, r"names 'disturbance.place', which there is not"),
        ({"initial.wind": (-1, 1)}, r"names 'initial.wind', which there is not"),
        ({"plant.least": (1.5, 1.0)}, r"scope must give low at most high for 'plant.least', got \(1.5, 1.0\)"),
        ({"plant.least": (0, np.inf)}, r"finite numbers for 'plant.least', got \(0, inf\)"),
        ({"plant.least": (np.nan, 1)}, r"finite numbers for 'plant.least', got \(nan, 1\)"),
        ({"plant.least": (0, 10**400)}, r"finite numbers for 'plant.least'"),
        ({"plant.least": (0, None)}, r"scope must give a pair .* for 'plant.least', got \(0, None\)"),
        ({"plant.least": (1.0,)}, r"scope must give a pair .* got \(1.0,\)"),
        ({"plant.least": 1.0}, r"scope must give a pair .* got 1.0"),
        ({"plant.least": "12"}, r"scope must give a pair .* got '12'"),
        ({"plant.least": ("1", "2")}, r"scope must give a pair .* got \('1', '2'\)"),
        ({"plant.least": (False, True)}, r"scope must give a pair .* got \(False, True\)"),
        ({"plant.least": {1.0, 2.0}}, r"scope must give a pair"),
        ({"plant.least": [[1, 2], [3, 4]]}, r"scope must give a pair"),
        ({3: (0, 1)}, r"scope must give a pair .* by name, .* got the name 3"),
        ([("plant.least", (0, 1))], r"scope must give a pair \[low, high\] by name, as in"),
        (None, r"scope must give a pair \[low, high\] by name, as in .* got None"),
        ({"plant.sampling_time": (0, 1)}, r"holds plant.sampling_time at 0, but plant.sampling_time must lie in \(0"),
        ({"plant.least": (0.0, 2.0)}, r"holds plant.least at 2, but plant.least must lie below most, got 2 and 2"),
        ({"plant.least": (1, 6), "plant.most": (5, 8)}, r"holds plant.(least|most) at [56], but plant.least must lie"),
        ({"plant.least": (1, 8), "plant.most": (9, 13)}, r"but plant.most must be at most 20 with least, got 8 and 13"),
        ({"noise.place": (-1, 2)}, r"verify.scope must be -nu to nu for noise.place, got \[-1, 2\]"),
        ({"noise.place": (1, 2)}, r"verify.scope must be -nu to nu"),
        ({"plant.none": (0, 1)}, r"names plant.none, which is None here: it has no number"),
        ({"plant.many": (0, 1)}, r"names plant.many, which is \(1.0, 2.0\) here: it has no number"),
        ({"plant.within": (0, 1)}, r"names plant.within, which shapes the equations: it has no number"),
    ],
)  # fmt: skip
def test_a_scope_that_cannot_be_meant_is_refused(scope, says):
    with pytest.raises(InvalidValue, match=says) as caught:
        study(**PAIR, verify=Verification(scope=scope))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"plaec": (0, 1)}, r"verify.limits names 'plaec', which there is not; did you mean place\?"),
        ({"wind": (0, 1)}, r"verify.limits names 'wind', which there is not; there are: place, push"),
        (
            {"place": (None, None)},
            r"limits must give a pair .* one of which may be null, for 'place', got \(None, None\)",
        ),
        ({"place": (1, 0)}, r"limits must give low at most high for 'place'"),
        ({"place": (None, np.inf)}, r"limits must give a pair .* of finite numbers"),
    ],
)
def test_limits_that_cannot_be_meant_are_refused(limits, says):
    with pytest.raises(InvalidValue, match=says):
        study(**PAIR, verify=Verification(limits=limits))


@pytest.mark.parametrize(
    ("assignment", "says"),
    [
        ("verify=3", "verify is a group of settings"),
        ("verify.scope=3", r"verify.scope must give a pair \[low, high\] by name"),
        ("verify.scope.plant.mass=[1, 2]", r"verify.scope must give a pair .* for 'plant', got {'mass': \[1, 2\]}"),
        ('verify.scope={"plant.mas": [1, 2]}', "did you mean plant.mass"),
        ('verify.scope={"plant.line.length": [1, 2]}', "plant.line.length, which shapes the equations"),
        ('verify.scope={"plant.mass": [1, NaN]}', "verify.scope must give a pair .* of finite numbers"),
        ("verify.scop={}", "did you mean verify.scope"),
    ],
)
def test_slips_in_assignments_are_answered(assignment, says):
    with pytest.raises(InvalidValue, match=says):
        settings.assigned(study(), [assignment])


def test_what_is_no_verification_is_refused():
    with pytest.raises(InvalidValue, match=r"verify must be a Verification, .* got .*{'scope': {}}"):
        study(verify={"scope": {}})


def test_a_signal_that_is_state_and_output_has_one_limit_and_nested_quantities_a_range():
    made = study(
        plant=MetroLine(),
        reference=np.zeros((2, 21)),
        actuator=Actuator(lag=0.3),
        verify=Verification(limits={"position": (0, None), "speed": (0, 20), "force": (-1, 1)}),
    )
    assert set(made.verify.limits) == {"position", "speed", "force"}


def test_ranges_are_a_kind_of_field_that_any_declaration_may_have():
    @declared
    class Box:
        sides: dict[str, tuple[float, float]] = ranges(default={"a": (0.0, 1.0)}, doc="sides")

    assert dict(Box().sides) == {"a": (0.0, 1.0)} and dict(Box(sides={"b": [1, 2]}).sides) == {"b": (1.0, 2.0)}
    assert dict(settings.changed(Box(), {"sides": {"c.d": (3, 4)}}).sides) == {"c.d": (3.0, 4.0)}
    assert settings.as_json(Box()) == {"sides": {"a": [0.0, 1.0]}}
    with pytest.raises(TypeError):
        Box().sides["a"] = (0.0, 2.0)
