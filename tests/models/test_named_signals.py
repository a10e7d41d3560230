"""Signals by name, unit, domain and role; a plant's own end of a trial."""

from __future__ import annotations

import math
import pickle

import casadi as ca
import pytest

from models import Plant, Signal, by_role, declared, quantity, signal, signals
from models.actuator import Delayed, Saturated
from models.brake import Brake
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.point_mass import PointMass
from models.quantity import InvalidValue
from models.transfer import Transfer

SPEED = Signal("speed", "m/s", "how fast", True, (0.0, None), "speed")


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (signals(speed="m/s"), [Signal("speed", "m/s")]),
        (signals(speed=("m/s", "how fast")), [Signal("speed", "m/s", "how fast")]),
        (signals(speed=signal("m/s", "how fast", domain=(0, None), role="speed")), [SPEED]),
        (signals(SPEED, force="N"), [SPEED, Signal("force", "N")]),
        (signals(speed=SPEED), [SPEED]),
        (signals(level=signal("m", domain=(-math.inf, 2))), [Signal("level", "m", domain=(None, 2.0))]),
        (signals(), []),
    ],
)
def test_signals_are_named(made, expected):
    assert made == tuple(expected)
    assert pickle.loads(pickle.dumps(made)) == made


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: signal("m", role="colour"), r"role of '' must be one of acceleration, angle, .*volume; got 'colour'"),
        (lambda: Signal("a", "m", role="Speed"), "the role of 'a' must be one of acceleration, .*got 'Speed'"),
        (lambda: by_role((SPEED,), "fast"), "a role must be one of acceleration, .*got 'fast'"),
        (lambda: Signal("a", "m", domain=(2, 1)), r"the domain of 'a' must be \(low, high\) with low below high"),
        (lambda: Signal("a", "m", domain=(1, 1)), "low below high"),
        (lambda: Signal("a", "m", domain=(math.nan, 1)), "low below high"),
        (lambda: Signal("a", "m", domain=(0, 1, 2)), r"got \(0, 1, 2\)"),
        (lambda: Signal("a", "m", domain="ab"), "got 'ab'"),
        (lambda: Signal("a", "m", domain=5), "got 5"),
        (lambda: signals(force=SPEED), "a signal has one name, got 'force' for the signal 'speed'"),
        (lambda: signals(force=("N", "pull", "x")), "the signal 'force' must be a unit"),
        (lambda: signals(force=3), "the signal 'force' must be a unit"),
    ],
)
def test_what_describes_no_signal_is_refused_in_one_line(make, message):
    with pytest.raises(InvalidValue, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("plant", [PointMass(), PointMass(reading="printed"), Maglev(), MetroLine(), Brake()])
def test_the_plants_here_say_what_their_signals_are(plant):
    assert [one.name for one in by_role(plant.states, "speed")] == ["speed"]
    assert [one.name for one in by_role(plant.states, "position")] == ["position"]
    assert [one.name for one in by_role(plant.outputs, "speed")] == ["speed"]


def test_signals_of_a_role_keep_their_order():
    named = signals(a=signal("N", role="force"), b="N", c=signal("kN", role="force"))
    assert [one.name for one in by_role(named, "force")] == ["a", "c"]
    assert by_role(named, "power") == ()


@declared
class Ball(Plant):
    """A ball that falls; a trial ends where it meets the ground."""

    states = signals(height="m", rate="m/s")
    inputs = signals(push="m/s^2")
    outputs = signals(height="m")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return x.height + 0.1 * x.rate, x.rate - 0.981 + 0.1 * u.push

    def output(self, x):
        return (x.height,)

    def ended(self, x):
        return x.height <= 0


PLAIN = [Ball(), Saturated(plant=Ball(), upper=1.0), Delayed(plant=Ball(), dead_time=0.2)]


@pytest.mark.parametrize("plant", PLAIN)
@pytest.mark.parametrize("kind", [ca.SX, ca.MX, ca.DM])
def test_a_trial_ends_by_the_plants_own_event(plant, kind):
    assert plant.ends
    x = ca.MX.sym("x", len(plant.states))
    at = ca.Function("at", [x], [plant.ended_at(x)]) if kind is ca.MX else plant.ended_at
    for height, over in ((2.0, 0), (0.0, 1), (-1.0, 1)):
        state = [height, 1.0] + [0.0] * (len(plant.states) - 2)
        assert float(ca.DM(at(ca.DM(state) if kind is ca.MX else kind(state)))) == over


@pytest.mark.parametrize("plant", [Transfer(), Delayed(plant=Transfer(), dead_time=0.4)])
def test_most_trials_have_no_event(plant):
    assert not plant.ends
    assert float(ca.DM(plant.ended_at(ca.SX.ones(len(plant.states))))) == 0


def test_an_event_of_the_wrong_shape_is_refused():
    class Wrong(Ball):
        def ended(self, x):
            return x.vector

    with pytest.raises(InvalidValue, match=r"Wrong.ended must give 1 value\(s\) \(ended\), got shape \(2, 1\)"):
        Wrong().ended_at(ca.SX.zeros(2))
