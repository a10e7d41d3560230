"""Premises that the settings meet, and each just beyond it; a conclusion that rests on one that fails."""

from __future__ import annotations

import dataclasses

import pytest

from studies.maglev.study import STUDY as MAGLEV
from studies.maglev.study import ForceNoise
from studies.variable_gain.study import STUDY
from verification.checks import settled
from verification.decide.judge import judge
from workbench.contracts import settings
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.scenario import Between, From, NormalNoise, UniformNoise


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
