"""Relative degrees of all samples at once against the search from each sample on."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models import Plant, choice, declared, quantity, signals
from models.actuator import Actuator, Delayed
from models.brake import Brake
from models.maglev import Maglev
from models.point_mass import PointMass
from models.quantity import InvalidValue
from models.switched_delay import SwitchedDelay
from models.transfer import Transfer

GAINS = {
    "never": lambda k: 0 * k,
    "always": lambda k: 2 + 0 * k,
    "from 5 on": lambda k: k >= 5,
    "zero at 7": lambda k: k - 7,
    "zero at 3 and 9": lambda k: (k - 3) * (k - 9),
    "varies": lambda k: ca.sin(0.3 * k) + 2,
    "every third": lambda k: ca.fmod(k, 3) == 0,
    "a window": lambda k: ca.logic_and(k >= 4, k < 11),
    "by table": lambda k: ca.if_else(k < 6, 1.5, ca.if_else(k < 13, 0, -2)),
}


@declared
class Timed(Plant):
    """A chain of two states whose inputs come in with gains that depend on the sample."""

    states = signals(a="1", b="1", clock="1")
    inputs = signals(u="1", v="1")
    outputs = signals(b="1", a="1")
    disturbances = signals(d="1")
    first: str = choice(default="always", options=tuple(GAINS), doc="gain of u on a")
    direct: str = choice(default="never", options=tuple(GAINS), doc="gain of u on b")
    link: str = choice(default="always", options=tuple(GAINS), doc="gain of a on b")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        a = 0.5 * x.a + GAINS[self.first](k) * u.u + w.d
        b = ca.sin(x.b) + GAINS[self.link](k) * x.a**2 + GAINS[self.direct](k) * u.u + ca.if_else(x.clock > 6, u.v, 0)
        return a, b, k

    def output(self, x):
        return x.b, x.a


@declared
class Clocked(Plant):
    """A chain whose link opens by a clock that is a state of its own."""

    states = signals(a="1", b="1", clock="1")
    inputs = signals(u="1")
    outputs = signals(b="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return x.a + u.u, x.b + ca.if_else(x.clock > 40, x.a, 0), k

    def output(self, x):
        return (x.b,)


@declared
class Fading(Plant):
    """A tank in continuous time whose valve is closed for some seconds."""

    states = signals(first="m", second="m")
    inputs = signals(inflow="m/s")
    outputs = signals(second="m")
    sampling_time: float = quantity(default=0.5, unit="s", doc="sampling time", above=0)

    def rhs(self, x, u, w, t):
        through = ca.if_else(ca.logic_and(t >= 2, t < 6), 0, x.first)
        return u.inflow - through, through - x.second

    def output(self, x):
        return (x.second,)


SCHEDULES = [
    ((0, 3), (10, 1), (20, 2)),
    ((0, 5), (7, 4), (20, 5)),
    ((0, 1), (7, 3)),
    ((0, 2), (3, 5), (4, 1), (30, 4)),
    ((0, 6), (5, 1), (6, 6), (12, 2)),
]
CASES = [
    *((SwitchedDelay(plant=Transfer(), schedule=schedule), {}, 40) for schedule in SCHEDULES),
    (SwitchedDelay(plant=PointMass(), schedule=SCHEDULES[0]), {}, 30),
    (SwitchedDelay(plant=Delayed(plant=Timed(first="zero at 7"), dead_time=2.0), schedule=SCHEDULES[0]), {}, 30),
    *((Timed(first=gain), {}, 20) for gain in GAINS),
    *((Timed(direct=gain), {}, 20) for gain in GAINS),
    *((Timed(link=gain, direct="zero at 7"), {"limit": 12}, 20) for gain in GAINS),
    (Timed(link="every third", first="a window"), {"limit": 12}, 20),
    (Timed(), {"output": "a"}, 10),
    (Timed(), {"input": "v", "limit": 12}, 12),
    (Timed(), {"input": "v", "output": "a", "limit": 12}, 12),
    (Fading(), {"limit": 12}, 20),
    (Clocked(), {"limit": 12}, 50),
    (PointMass(), {}, 50),
    (PointMass(reading="seconds"), {}, 50),
    (Maglev(), {}, 20),
    (Maglev(), {"output": "speed"}, 20),
    (Brake(), {}, 5),
    (Actuator(lag=0.4, delay=0.3, lower=-4, upper=2, rate=7).wrapped(PointMass()), {}, 20),
    (Delayed(plant=Transfer(), dead_time=4.0), {"limit": 10}, 5),
]


@pytest.mark.parametrize(("plant", "asked", "samples"), CASES)
def test_each_sample_has_the_degree_that_is_found_from_it_on(plant, asked, samples):
    found = plant.relative_degrees(samples, **asked)
    assert found.tolist() == [plant.relative_degree(k=k, **asked) or 0 for k in range(samples)]


def test_the_cases_are_not_all_alike():
    seen = {tuple(sorted(set(plant.relative_degrees(samples, **asked).tolist()))) for plant, asked, samples in CASES}
    assert len(seen) > 8 and any(0 in degrees and len(degrees) > 2 for degrees in seen)


def test_a_schedule_by_hand():
    found = SwitchedDelay(plant=Transfer(), schedule=((0, 3), (10, 1))).relative_degrees(14)
    # u(k) is due at k + 3 before step 10, at k + 1 from there on; what is sent at 7 and 8 is skipped
    assert found.tolist() == [4] * 7 + [0, 0] + [2] * 5


def test_thousands_of_samples_are_few_patterns():
    calls = []

    class Counting(PointMass):
        def output(self, x):
            calls.append(0)
            return super().output(x)

    schedule = ((0, 5), (400, 3), (900, 6), (1500, 2))
    found = SwitchedDelay(plant=Counting(), schedule=schedule).relative_degrees(2000)
    assert found.shape == (2000,) and set(np.unique(found)) >= {3, 4, 6, 7}
    assert len(calls) < 200


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"samples": 0}, "samples must be a whole number, 1 or more, got 0"),
        ({"samples": 2.5}, "samples must be a whole number"),
        ({"samples": True}, "samples must be a whole number"),
        ({"samples": 5, "output": "y"}, "output must be one of: output; got 'y'"),
        ({"samples": 5, "input": "u"}, "input must be one of: command; got 'u'"),
    ],
)
def test_what_cannot_be_asked_is_refused(asked, message):
    with pytest.raises(InvalidValue, match=message):
        Transfer().relative_degrees(**asked)
