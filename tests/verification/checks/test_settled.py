"""Premises that the settings meet, and each just beyond it; a conclusion that rests on one that fails."""

from __future__ import annotations

import dataclasses

import pytest
import xarray as xr

from models.actuator import Actuator
from studies.maglev.evidence import Evidence
from studies.maglev.premises import Premises
from studies.maglev.study import STUDY as MAGLEV
from studies.maglev.study import ForceNoise
from studies.variable_gain.study import STUDY
from verification.certificates.recheck import Recheck
from verification.checks import settled
from verification.decide.judge import judge
from workbench.contracts import settings
from workbench.contracts.claim import Claim, NotCertified
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.scenario import Between, From, NormalNoise, Times, UniformNoise
from workbench.controllers.palc import PALC
from workbench.trials.campaign import Campaign


def study(*assignments, **fields):
    return settings.assigned(dataclasses.replace(STUDY, **fields), list(assignments))


BEYOND = [
    ("nothing_between", study("actuator.lag=0.1"), "actuator lies between"),
    ("nothing_between", study("actuator.upper=2"), "actuator lies between"),
    ("no_noise", study("noise.sigma=1e-6"), "without a bound is added to the measured speed"),
    ("no_noise", study(noise=UniformNoise(largest=1e-3)), "of up to 0.001 is added to the measured position and"),
    ("same_plant", study(truth={"input_gain": Between(low=0.9, high=1.1)}), "changes from trial to trial: input_gain"),
    ("same_start", study("initial.trial_sigma=0.1"), "drawn anew"),
    ("same_start", study(initial=From(state=(0.0, 0.0), spread=(0.1, 0.0))), "drawn anew"),
    ("same_start", study(continues=True), "begins where the last one ended"),
    ("whole_trials", study(trial_length=[900] * 30), "may end early"),
    ("whole_trials", study(trial_length=900), "may end early"),
    ("same_disturbance", dataclasses.replace(MAGLEV, disturbance=ForceNoise(force_psd=1.0)), "drawn anew"),
]


@pytest.mark.parametrize(("name", "beyond", "says"), BEYOND, ids=[f"{row[0]}: {row[2][:24]}" for row in BEYOND])
def test_one_step_beyond_a_premise_it_is_not_met(name, beyond, says):
    premise = getattr(settled, name)
    assert judge(premise(STUDY, "ours")).standing is Standing.PROVED
    found = judge(premise(beyond, "ours"))
    assert found.standing is Standing.REFUTED and says in found.method and found.witness


def certified(premise):
    """Return what the checker says of a premise's certificate, made whether or not the premise is met."""
    made = premise.certify(Finding(grounds=Grounds.SETTINGS, holds=True), {})
    return Recheck().sentence(made)


@pytest.mark.parametrize(("name", "beyond", "says"), BEYOND, ids=[f"{row[0]}: {row[2][:24]}" for row in BEYOND])
def test_the_numbers_of_a_premise_say_whether_it_is_met(name, beyond, says):
    premise = getattr(settled, name)
    met = premise(STUDY, "ours")
    assert certified(met).startswith(met.statement)
    with pytest.raises(NotCertified, match=r"is false|hexadecimal"):  # an unbounded noise is no number
        certified(premise(beyond, "ours"))


def shuttles_premises(**fields):
    """Return what the Lyapunov argument rests on, by name, of a shuttle that is otherwise as declared."""
    campaign = Campaign(dataclasses.replace(MAGLEV, **fields), xr.Dataset())
    return {one.name.split("premise.")[1]: one for one in Premises(Evidence(campaign)).of_the_theorem("palc")}


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("model", {"truth": {"mass": Times(factor=1.0000001)}}),
        ("model", {"truth": {"air_car": Times(factor=0.9)}}),
        ("model", {"truth": {"smooth_speed": Times(factor=2.0)}}),
        ("period", {"controllers": {"palc": PALC(late=1)}}),
        ("continues", {"continues": False}),
        ("whole_trials", {"trial_length": 900}),
        ("no_actuator", {"actuator": Actuator(rate=1e9)}),
    ],
)
def test_the_numbers_of_the_shuttle_s_premises_say_whether_they_are_met(name, fields):
    met = shuttles_premises()
    assert all(certified(one).startswith(one.statement) for one in met.values()) and name in met
    beyond = shuttles_premises(**fields)
    assert judge(beyond[name]).standing is Standing.REFUTED
    with pytest.raises(NotCertified, match="is false"):
        certified(beyond[name])


def test_noise_on_one_output_leaves_the_others():
    noisy = study(noise=NormalNoise(sigma=0.02, output="speed"))
    assert judge(settled.no_noise(noisy, "ours", "position")).standing is Standing.PROVED
    assert judge(settled.no_noise(noisy, "ours", "speed")).standing is Standing.REFUTED


@pytest.mark.parametrize("grounds", [Grounds.ALGEBRA, Grounds.RUN])
def test_a_conclusion_says_nothing_where_a_premise_fails(grounds):
    theorem = Claim(
        name="study.theorem",
        statement="It converges.",
        source="ours",
        check=lambda: Finding(grounds=grounds, margin=1.0),
        premises=[settled.nothing_between(study("actuator.lag=0.1"), "ours")],
    )
    verdict = judge(theorem)
    assert verdict.standing is Standing.UNDECIDED and verdict.method.startswith("the theorem does not apply: an act")
