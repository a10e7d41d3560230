"""What a law uses of its task: first plans, random numbers, additions, and whether it says so."""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import plain_loop
import pytest

from models.actuator import Actuator
from models.metro_line import MetroLine
from models.plant import Plant, signal, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, quantity
from models.transfer import Transfer
from workbench.contracts.study import Study
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.fixed_gain import FixedGain
from workbench.controllers.odometry import Odometry
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.pid import PID
from workbench.controllers.shuttle_pid import ShuttlePID
from workbench.controllers.tracking_mpc import TrackingMPC
from workbench.controllers.variable_gain import VariableGain
from workbench.trials.campaign import run
from workbench.trials.simulation import Runner

N = 40
SPEEDS = 12 * np.sin(np.linspace(0, np.pi, N + 1)) ** 2
PLAN = 5e3 * np.cos(np.linspace(0, 3, N))


@declared
class Both(PointMass):
    """The train that measures position and speed, in m and m/s."""

    @property
    def outputs(self):
        return signals(position=signal("m", role="position"), speed=signal("m/s", role="speed"))

    def output(self, x):
        return x.position, x.speed / 3.6


@declared
class Two(Plant):
    """Two tanks that leak into each other, filled by two pumps."""

    states = outputs = signals(first="m", second="m")
    inputs = signals(left="V", right="V")
    disturbances = signals(rain="m")
    sampling_time: float = quantity(default=0.5, unit="s", doc="sampling time", above=0)
    leak: float = quantity(default=0.1, unit="1", doc="what goes over in a sample")

    def step(self, x, u, w, k):
        over = self.leak * (x.first - x.second)
        return x.first - over + 0.5 * u.left + 0.1 * u.right, x.second + over - 0.2 * u.left + 0.4 * u.right + w.rain

    def output(self, x):
        return x.first, x.second


def study(law, plant=None, reference=SPEEDS, **fields):
    return Study(plant=plant or PointMass(), reference=reference, controllers={"law": law}, **{"trials": 4, **fields})


def agrees(made, rtol=1e-9):
    """Hold a study's run against a plain loop over trials and samples; return the inputs, (trials, inputs, N)."""
    data = run(made, show_progress=False).data
    whole = np.array([u for u, *_ in plain_loop.campaign(made, "law")])
    found = data["input"].values[0][..., :-1].reshape(whole.shape)
    np.testing.assert_allclose(found, whole, rtol=rtol, atol=rtol * np.nanmax(np.abs(whole)))
    return found


PLANNED = {
    "cfdl": (CFDL(phi0=0.02), PointMass(), SPEEDS, 1500.0),
    "icfdl": (ICFDL(phi0=0.02), PointMass(), SPEEDS, 1500.0),
    "increment": (Increment(), PointMass(), SPEEDS, 1500.0),
    "increment-filtered": (Increment(q_cutoff_hz=1.0), PointMass(), SPEEDS, 1500.0),
    "pd": (PD(), PointMass(), SPEEDS, 1500.0),
    "pd-in-kilonewtons": (PD(force_unit=1000.0, kd=1.0), PointMass(), SPEEDS, 1500.0),
    "fixed-gain": (FixedGain(), MetroLine(), np.vstack([SPEEDS, SPEEDS]), None),
    "variable-gain": (VariableGain(), MetroLine(), np.vstack([SPEEDS, SPEEDS]), None),
    "odometry": (Odometry(law=VariableGain(initial_learning=False), input_unit=350e3), PointMass(), SPEEDS, None),
}


@pytest.mark.parametrize("name", PLANNED)
def test_a_law_that_plans_begins_with_the_tasks_first_plan(name):
    law, plant, reference, own = PLANNED[name]
    plan = PLAN if plant.inputs[0].unit == "N" else PLAN / 350e3
    assert "plan" in law.told
    given = agrees(study(law, plant, reference, first_plan=plan))
    np.testing.assert_allclose(given[0, 0], plan, rtol=1e-14)
    assert not np.allclose(given[1, 0], plan)
    left_to_it = agrees(study(law, plant, reference))[0, 0]
    assert not np.allclose(left_to_it, plan) and (own is None or np.allclose(left_to_it, own))


@pytest.mark.parametrize("plan", [0.0, 2500.0])
def test_a_first_plan_of_one_number_stands_for_all_samples(plan):
    assert (agrees(study(ICFDL(phi0=0.02), first_plan=plan))[0] == pytest.approx(plan)) is True


@pytest.mark.parametrize("law", [PD(kp=0.3, kd=0.2, force_unit=2.0, initial_input=1.0), PID(kp=0.4, ki=0.1, kd=0.05)])
def test_laws_that_work_channel_by_channel(law):
    reference = np.vstack([np.linspace(0, 1, N + 1), np.sin(np.linspace(0, 2, N + 1))])
    plan = np.vstack([PLAN, -PLAN]) / 1e4
    for fields in ({}, {"first_plan": plan}):
        made = study(law, Two(), reference, noise=0.01, **fields)
        assert made.refusals() == {} and law.channels.admits(2, 2)
        u = agrees(made)
        np.testing.assert_allclose(u, by_hand(law, made, fields.get("first_plan")), rtol=1e-9, atol=1e-9)
        assert u.shape == (4, 2, N) and not np.allclose(u[:, 0], u[:, 1])
        if fields and law.learns_on:
            np.testing.assert_allclose(u[0], plan, rtol=1e-14)


def by_hand(law, made, plan):
    """Two loops side by side, in NumPy: the first pump looks at the first tank only, the second at the second."""
    given, r, trials = made.inputs(), made.reference_samples, []
    for index, one in enumerate(given):
        x, u, seen, total, before = np.zeros(2), np.zeros((2, N)), np.zeros((2, N + 1)), np.zeros(2), np.zeros(2)
        if isinstance(law, PD):
            u = trials[-1][0] + law.force_unit * corrections(law, r - trials[-1][1]) if index else first(law, plan)
        for k in range(N):
            seen[:, k] = x + one.noise[:, k]
            if isinstance(law, PID):
                for i in range(2):
                    e = r[i, k] - seen[i, k]
                    total[i] += 0.5 * e
                    u[i, k] = law.input_unit * (law.kp * e + law.ki * total[i] + law.kd * (e - before[i]) / 0.5)
                    before[i] = e
            over = 0.1 * (x[0] - x[1])
            x = np.array([x[0] - over + 0.5 * u[0, k] + 0.1 * u[1, k], x[1] + over - 0.2 * u[0, k] + 0.4 * u[1, k]])
        seen[:, N] = x + one.noise[:, N]
        trials.append((u, seen))
    return np.array([u for u, _ in trials])


def first(law, plan):
    return np.full((2, N), law.initial_input) if plan is None else plan


def corrections(law, e):
    return np.array([[law.kp * row[k + 1] + law.kd * row[k] for k in range(N)] for row in e])


@pytest.mark.parametrize("law", [PD(), PID()])
def test_as_many_inputs_as_outputs(law):
    both = study(law, Both(), np.vstack([SPEEDS, SPEEDS]))
    said = "works channel by channel, so it needs as many inputs as outputs; there are 1 input(s) and 2 output(s)"
    assert both.refusals() == {"law": f"{type(law).__name__} {said}"}


@pytest.mark.parametrize("law", [CFDL(), FIPID(), TrackingMPC(), PALC(), FixedGain()])
def test_laws_of_other_numbers_of_channels_are_refused(law):
    refused = study(law, Two(), np.ones((2, N + 1))).refusals()
    assert "2 (first, second) and 2 (left, right)" in refused["law"]


# --- additions and random numbers ---


def fipids(**fields):
    return [FIPID(**fields), FIPID(f="smooth", **fields), BPFIPID(**fields)]


@pytest.mark.parametrize("law", fipids(input_unit=2.0), ids=["fipid", "smooth", "bp"])
def test_what_an_operator_adds_stays_in_the_input(law):
    """An oracle that integrates it: each later input is higher by what was added, on a plant that moves nothing."""
    added = np.zeros(N)
    added[[10, 20]] = 0.5, -0.2
    still = Transfer(numerator=(1e-12,))
    without, with_it = (
        inputs(study(one, still, np.zeros(N + 1), trials=1))[0, 0]
        for one in (law, dataclasses.replace(law, added=tuple(added)))
    )
    np.testing.assert_allclose(with_it - without, np.cumsum(added), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("law", fipids(added=(0.1,) * (N - 1)), ids=["fipid", "smooth", "bp"])
def test_additions_are_one_a_sample(law):
    assert study(law, Transfer(), np.zeros(N + 1)).refusals() == {
        "law": f"added must hold N = {N} numbers, one a sample, or none; got {N - 1}"
    }


def drawn(seed, hidden=5, spread=0.5):
    """The weights as they have always been drawn from a seed: W2 first."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-spread, spread, (hidden, 4)), rng.uniform(-spread, spread, (2, hidden))


@pytest.mark.parametrize(("weight_seed", "seed"), [(0, 0), (0, 7), (7, 0), (3, 4)])
def test_weights_come_from_the_studys_seed(weight_seed, seed):
    law = BPFIPID(weight_seed=weight_seed)
    made = study(law, Transfer(), np.ones(N + 1), seed=seed, trials=1)
    W2, W3 = drawn(weight_seed + seed)
    memory = law.start(made.task(law))
    assert np.array_equal(memory.W2.full().ravel(), W2.ravel()) and np.array_equal(memory.W3.full().ravel(), W3.ravel())
    frozen = BPFIPID(W2=tuple(W2.ravel()), W3=tuple(W3.ravel()))
    assert frozen.chance(seed) == () and len(law.chance(seed)) == 30
    one, other = (run(dataclasses.replace(made, controllers={"law": each}), show_progress=False).data
                  for each in (law, frozen))  # fmt: skip
    assert np.array_equal(one["output"], other["output"])


def test_weights_that_are_given_stay_and_the_others_are_drawn():
    W3 = tuple(np.linspace(-0.1, 0.1, 10))
    law = BPFIPID(W3=W3)
    memory = law.start(study(law, Transfer(), np.ones(N + 1), seed=2).task(law))
    assert np.array_equal(memory.W3.full().ravel(), W3) and np.array_equal(
        memory.W2.full().ravel(), drawn(2)[0].ravel()
    )
    with pytest.raises(InvalidValue, match=r"W3 must hold 2 x 5 = 10 weights, row by row; got 3"):
        BPFIPID(W3=(1.0, 2.0, 3.0))


# --- whether a law says what it uses ---

LAWS = {
    "cfdl": (CFDL(), PointMass()),
    "icfdl": (ICFDL(), PointMass()),
    "increment": (Increment(), PointMass()),
    "pd": (PD(), PointMass()),
    "pid": (PID(), PointMass()),
    "fipid": (FIPID(), PointMass()),
    "bp-fipid": (BPFIPID(), PointMass()),
    "tracking-mpc": (TrackingMPC(), PointMass()),
    "palc": (PALC(), Both()),
    "palc-filtered": (FilteredPALC(lead_s=0.2), Both()),
    "shuttle-pid": (ShuttlePID(), Both()),
    "fixed-gain": (FixedGain(), Both()),
    "variable-gain": (VariableGain(), Both()),
    "odometry-palc": (Odometry(law=PALC()), PointMass()),
    "odometry-variable-gain": (Odometry(law=VariableGain(initial_learning=False)), PointMass()),
}
DIFFERENT = {
    "reference": lambda made: dataclasses.replace(made, reference=1.1 * made.reference_samples),
    "limits": lambda made: dataclasses.replace(made, actuator=Actuator(lower=-3e2, upper=1e3)),
    "model": lambda made: dataclasses.replace(
        made, plant=dataclasses.replace(made.plant, mass=2 * made.plant.mass), truth={"mass": 0.5}
    ),
    "plan": lambda made: dataclasses.replace(made, first_plan=PLAN),
}


@pytest.mark.parametrize("name", LAWS)
def test_laws_say_what_they_use(name):
    """Change one thing that a law is told, the plant staying the same: its inputs change where it says so, only.

    Limits are a plant's own too, so what a law commands is held against the same law that does not know them.
    """
    law, plant = LAWS[name]
    reference = SPEEDS if len(plant.outputs) == 1 else np.vstack([np.cumsum(SPEEDS) / 36, SPEEDS / 3.6])
    made = study(law, plant, reference, trials=2)
    for what, changed in DIFFERENT.items():
        if what == "limits":
            uses = used_limits(changed(made))
        else:
            uses = not np.allclose(*(inputs(one) for one in (made, changed(made))), rtol=1e-6)
        assert uses == (what in law.told), what


def inputs(made):
    """Return the inputs of a study's trials, (trials, inputs, N)."""
    return np.array([left.u for left in Runner(made, "law").trials(made.inputs())])


def used_limits(made):
    law = made.law("law")
    starts = [ca.vertcat(*(ca.vec(ca.DM(one)) for one in plain_loop.flat(law.start(task))))
              for task in (made.task(law), made.task(law)._replace(limits=made.plant.input_limits))]  # fmt: skip
    return not np.array_equal(*(one.full() for one in starts), equal_nan=True)
