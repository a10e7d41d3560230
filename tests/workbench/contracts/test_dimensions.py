"""Dimensions of plants: the house's agree, a slip is told with its line and operands, bare numbers are free."""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca
import pytest

from models.brake import Brake
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import declared, quantity
from workbench.contracts.dimensions import mismatches
from workbench.graph.dimensions import parsed, words
from workbench.trials.find import find

USERS = sorted((Path(__file__).parents[2] / "users").glob("*.py"))


@pytest.mark.parametrize("plant", [PointMass(), PointMass(reading="seconds"), Maglev(), MetroLine(), Brake()])
def test_the_house_agrees(plant):
    assert mismatches(plant) == []


@pytest.mark.parametrize("file", USERS, ids=lambda file: file.stem)
def test_the_users_plants_agree(file):
    assert mismatches(find(str(file)).plant) == []


def test_the_literal_reading_does_not_agree_and_says_where():
    said = mismatches(PointMass(reading="printed"))
    assert any("point_mass.py, line" in one and "length/time^2 do not agree" in one for one in said)


@declared
class Cart(Plant):
    """A cart whose force a test chooses."""

    source = "ours"
    states = signals(speed="m/s", place="m")
    inputs = signals(force="N")
    outputs = signals(place="m")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    mass: float = quantity(default=2.0, unit="kg", doc="mass", above=0)
    drag: float = quantity(default=2.0, unit="N s/m", doc="drag", above=0)
    angle: float = quantity(default=0.1, unit="rad", doc="slope")
    odd: float = quantity(default=0.1, unit="output units", doc="of no unit")

    def pull(self, x, u, k):
        return u.force - self.drag * x.speed

    def step(self, x, u, w, k):
        pull = self.pull(x, u, k)
        speed = x.speed + self.sampling_time * pull / self.mass
        return speed, x.place + self.sampling_time * x.speed

    def output(self, x):
        return (x.place,)


def cart(**methods):
    return declared(type("Cart", (Cart,), methods))()


AGREE = {
    "as it is": {},
    "bare numbers": {"pull": lambda self, x, u, k: 3 * u.force + 9.81 * x.place + 2 - self.odd * x.speed},
    "a pure function of an angle": {"pull": lambda self, x, u, k: u.force * ca.sin(self.angle) + 0 * k},
    "a ratio": {"pull": lambda self, x, u, k: u.force * ca.exp(-x.place / (x.place + 1)) * ca.tanh(x.speed / x.speed)},
    "powers": {"pull": lambda self, x, u, k: u.force * (x.speed**2) ** 0.5 / x.speed + u.force * k},
    "a branch": {"pull": lambda self, x, u, k: ca.if_else(x.speed > 3, u.force, -u.force)},
}
DIFFER = {
    "a speed for a force": (
        {"pull": lambda self, x, u, k: u.force - x.speed},
        r"\(force-speed\): length\*mass/time\^2 and length/time do not agree",
    ),
    "a mass too many": ({"pull": lambda self, x, u, k: u.force * self.mass - self.drag * x.speed}, r"do not agree"),
    "a function of a force": (
        {"pull": lambda self, x, u, k: u.force * ca.sin(x.place)},
        r"sin\(place\): sin takes a pure number, got length",
    ),
    "a comparison": (
        {"pull": lambda self, x, u, k: ca.if_else(x.speed > x.place, u.force, 0)},
        r"length and length/time do not agree|length/time and length do not agree",
    ),
    "an exponent": ({"pull": lambda self, x, u, k: u.force * 2**x.place}, r"an exponent must be"),
    "the wrong output": ({"output": lambda self, x: (x.speed,)}, r"place must be length \(m\), got length/time"),
    "the wrong state": (
        {"step": lambda self, x, u, w, k: (x.place, x.place)},
        r"speed must be length/time \(m/s\), got length",
    ),
}


@pytest.mark.parametrize("name", AGREE)
def test_what_agrees(name):
    assert mismatches(cart(**AGREE[name])) == []


@pytest.mark.parametrize("name", DIFFER)
def test_what_differs_is_told_with_file_line_and_operands(name):
    methods, says = DIFFER[name]
    said = mismatches(cart(**methods))
    assert said and any(re.search(says, one) for one in said), said
    for one in said:
        assert re.search(r"test_dimensions\.py, line \d+: ", one) and "\n" not in one


def test_the_line_is_the_first_that_has_it():
    def pull(self, x, u, k):
        fine = u.force * 2
        wrong = u.force - x.speed  # the slip
        return fine + wrong

    (said,) = mismatches(cart(pull=pull))
    lines = Path(__file__).read_text().splitlines()
    (line,) = [number for number, text in enumerate(lines, 1) if text.endswith("# the slip")]
    assert f"line {line}: (force-speed)" in said


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("m/s", "length/time"),
        ("km/h", "length/time"),
        ("N s/m", "mass/time"),
        ("N/(km/h)^2", "mass/length"),
        ("rad", "1"),
        ("1", "1"),
        ("output units", "free"),
        ("", "free"),
        ("per mille", "free"),
        ("m^2.5/s", "length^5/2/time"),
    ],
)
def test_units(unit, said):
    assert words(parsed(unit)) == said
