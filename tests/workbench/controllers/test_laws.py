"""The learning laws: against each other, at their bounds, and where samples are missing."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared
from studies.metro.study import STUDY
from workbench.contracts.law import Law, LearnedSignal, Task, Trial
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.parts.rows import constant_row
from workbench.fold.fold import build
from workbench.trials.campaign import run

RHO, LAM = 0.245, 5e-5


def metro(controllers, trials=60, lengths="uniform", seed=0, **plant):
    return Study(
        plant=PointMass(**plant),
        reference=MetroProfile(),
        controllers=controllers,
        trials=trials,
        trial_length=TrialLength(law=lengths),
        seed=seed,
    )


def campaign(*args, **kwargs):
    return run(metro(*args, **kwargs), show_progress=False).data


@pytest.mark.parametrize("unit", [1.0, 100.0])
@pytest.mark.parametrize("line", ["hilly", "flat"])
def test_icfdl_equals_cfdl_at_fixed_lengths(line, unit):
    laws = {"cfdl": CFDL(force_unit=unit), "icfdl": ICFDL(force_unit=unit)}
    data = campaign(laws, lengths="fixed", line=line)
    for name in ("input", "output", "mse", "ppd_estimate"):
        one, other = (data[name].sel(controller=law) for law in laws)
        assert float(abs(one - other).max()) <= 1e-12 * float(abs(other).max())


def test_cfdl_refuses_varying_lengths():
    with pytest.raises(InvalidValue, match=r"cfdl needs fixed trial lengths, and these vary: .* use icfdl"):
        campaign({"cfdl": CFDL()}, trials=2)
    data = campaign({"cfdl": CFDL(), "pd": PD()}, trials=2)
    assert str(data["stopped"].sel(controller="cfdl").item()).startswith("refused: cfdl needs fixed trial lengths")
    assert data["mse"].sel(controller="cfdl").isnull().all()


@pytest.mark.parametrize("law", [CFDL, ICFDL, Increment])
@given(phi=st.floats(1e-12, 1e12), rho=st.floats(1e-3, 1.0), lam=st.floats(1e-8, 1e3))
def test_gain_is_bounded_whatever_the_estimate(law, phi, rho, lam):
    """What a law adds to the plan never exceeds rho/(2 sqrt(lam)) per unit of error, and does at phi = sqrt(lam)."""
    bound = rho / (2 * math.sqrt(lam))

    def gain(**fields):
        made = law(rho=rho, lam=lam, force_unit=1.0, **fields)
        memory = made.start(Task(ca.DM.zeros(1, 2), 1.0))
        rows = {name: ca.DM([[0.0, 1.0]]) for name in ("r", "y", "e")}
        after = made.learn(memory, Trial(**rows, u=memory.u, reached=ca.DM.ones(1, 2), state=()))
        return float(ca.DM(after.u - memory.u))

    assert gain(phi0=phi, initial_input=0.0) <= bound * (1 + 1e-12)
    assert gain(initial_input=0.0) == pytest.approx(bound)


def gains(data, law):
    """Return |input change| per km/h of error that caused it, over all trials."""
    one = data.sel(controller=law)
    du = np.abs(np.diff(one["input"].values[:, :-1], axis=0))
    e = np.abs(one["error"].values[:-1, 1:])
    return du[e > 1e-6] / e[e > 1e-6]


def test_in_newtons_icfdl_cannot_reach_pd():
    """With phi0 at its best the gain in newtons stays below 17.4 N per km/h, pd's is about 1004."""
    bound = 17.32  # N per km/h, as the readings ledger has it
    data = campaign({"icfdl": ICFDL(force_unit=1.0), "pd": PD()}, trials=150)
    largest = gains(data, "icfdl").max()
    assert 0.5 * bound < largest <= bound + 0.01
    last = data["mse"][:, -1]
    assert float(last.sel(controller="icfdl")) > 20 * float(last.sel(controller="pd"))
    icfdl = data["mse"].sel(controller="icfdl")
    assert float(icfdl[-1]) < float(icfdl[0])  # it does fall


def test_the_bound_scales_with_the_force_unit():
    data = campaign({"icfdl": ICFDL(force_unit=100.0)}, trials=20)
    bound = 100 * RHO / (2 * math.sqrt(LAM))
    largest = gains(data, "icfdl").max()
    assert 0.9 * bound < largest <= bound * (1 + 1e-9)


def last_mse(line, law, trials=150):
    return float(campaign({"law": law}, trials=trials, line=line)["mse"][0, -1])


@pytest.mark.parametrize(
    ("line", "law", "about", "within"),
    [
        ("flat", PD(), 63, 5),
        ("flat", ICFDL(), 10, 1),
        ("hilly", PD(), 67, 5),
        ("hilly", ICFDL(), 10, 1),
    ],
)
def test_magnitudes_at_trial_150(line, law, about, within):
    assert last_mse(line, law) == pytest.approx(about, abs=within)


def test_default_study_orders_as_the_paper_says():
    data = run(dataclasses.replace(STUDY, sweeps=()), show_progress=False).data
    icfdl, pd = (data["mse"].sel(controller=name).values for name in ("icfdl", "pd"))
    assert icfdl[-1] < 0.25 * pd[-1]
    assert (icfdl[10:] < pd[10:]).all()  # Fig. 7
    for mse in (icfdl, pd):
        assert mse[149] < mse[99] < mse[49] < mse[9] < mse[0]


def test_force_units_decide():
    diverging = {"icfdl": ICFDL(force_unit=1000.0), "pd10": PD(force_unit=10.0), "pd100": PD(force_unit=100.0)}
    data = campaign({**diverging, "icfdl100": ICFDL(), "pd": PD(), "pd5": PD(force_unit=5.0)}, trials=150)
    gone = data["diverged_at_trial"]
    for name in diverging:
        at = int(gone.sel(controller=name))
        assert 2 < at < 150
        one = data.sel(controller=name)
        assert one["mse"][at:].isnull().all() and one["mse"][: at - 1].notnull().all()
        said = str(one["stopped"].item())
        assert said.startswith(f"diverged at trial {at}: ")
        assert "exceeds 7.2e+04 (1000 x the reference)" in said or "no longer finite" in said
    for name in ("icfdl100", "pd", "pd5"):
        assert np.isnan(gone.sel(controller=name))
        assert str(data["stopped"].sel(controller=name).item()) == ""


def test_printed_reading_in_kilonewtons():
    """There icfdl ends well below pd after a transient of about 9e4."""
    data = campaign({"icfdl": ICFDL(force_unit=1000.0), "pd": PD()}, trials=150, reading="printed", line="flat")
    icfdl, pd = data["mse"].sel(controller="icfdl"), data["mse"].sel(controller="pd")
    assert 10 < float(icfdl[-1]) < 30 and float(icfdl.max()) == pytest.approx(9e4, rel=0.1)
    assert 90 < float(pd[-1]) < 115


def test_first_trials_are_counted_as_stated():
    """Trial 1 runs the initial input, trial 2 learns with phi0, the estimator starts with trial 3."""
    data = campaign({"icfdl": ICFDL(phi0=0.02, initial_input=2000.0)}, trials=4, lengths="fixed").isel(controller=0)
    u, estimate = data["input"].values[:, :-1], data["ppd_estimate"].values[:, :-1]
    assert (u[0] == 2000.0).all()
    np.testing.assert_allclose(estimate[:2], 0.02 / 100, rtol=1e-15)
    gain = RHO * 0.02 / (LAM + 0.02**2) * 100
    np.testing.assert_allclose(u[1] - u[0], gain * data["error"].values[0, 1:], rtol=1e-10, atol=1e-9)
    assert (estimate[2] != 0.02 / 100).any()
    assert data.sizes["trial"] == 4


class Plan(NamedTuple):
    u: object


@declared
class MultipliesByGamma(Law):
    """Wrong on purpose: 0 x missing is missing."""

    source: ClassVar[str] = "wrong on purpose, 0"
    learns_on: ClassVar[LearnedSignal | None] = "output"

    def start(self, task):
        return Plan(constant_row(1500.0, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        return Plan(memory.u + 1000 * trial.reached[1:] * trial.e[1:])


def test_a_law_that_multiplies_by_gamma_fails_visibly():
    data = campaign({"bad": MultipliesByGamma(), "pd": PD()}, trials=30)
    lengths = data["trial_length"].values
    first = next(i for i in range(1, 30) if lengths[i] > lengths[:i].min())
    assert int(data["diverged_at_trial"].sel(controller="bad")) == first + 1
    assert "no longer finite" in str(data["stopped"].sel(controller="bad").item())
    assert np.isfinite(data["input"].sel(controller="pd").values[:, :-1]).all()


@pytest.mark.parametrize("law", [ICFDL(), PD(), MultipliesByGamma()], ids=lambda law: type(law).__name__)
def test_laws_never_read_what_a_trial_did_not_reach(law):
    """Poison every sample after the end: the next plan must not change."""
    n, length = 300, 271
    fold = build(PointMass(), law, n)
    r = MetroProfile(horizon=n).samples(PointMass())
    rng = np.random.default_rng(1)
    noise = 0.1 * rng.normal(size=(1, n + 1))

    def plans(poison):
        noisy = noise.copy()
        noisy[0, length + 1 :] = poison
        memory = fold.start.call({"r": r, "sampling_time": 0.1, "p": ca.DM(fold.values)})
        seen = []
        for _ in range(4):
            given = {name: memory[name] for name in fold.memory}
            left = fold.trial.call(
                {**given, "x0": [0, 0], "length": length, "r": r, "w": ca.DM(0, n), "noise": noisy, "p": fold.values}
            )
            memory = {name: left[f"{name}_next"] for name in fold.memory}
            seen.append(memory["memory_u"].full())
        return np.array(seen)

    clean, poisoned = plans(0.0), plans(np.nan)
    if isinstance(law, MultipliesByGamma):
        assert not np.isfinite(poisoned).all()
    else:
        assert np.isfinite(poisoned).all()
        np.testing.assert_array_equal(clean, poisoned)
        np.testing.assert_array_equal(plans(1e9), clean)


@pytest.mark.parametrize(
    ("law", "fields", "message"),
    [
        (ICFDL, {"rho": 1.4}, r"rho must lie in \(0, 1\], got 1.4"),
        (ICFDL, {"eta": 0}, r"eta must lie in \(0, 1\], got 0"),
        (ICFDL, {"lam": -1e-5}, "lam must lie in"),
        (ICFDL, {"mu": 0}, "mu must lie in"),
        (ICFDL, {"eps": 0}, "eps must lie in"),
        (ICFDL, {"phi0": 0.0}, "phi0 must not be 0"),
        (CFDL, {"phi0": 0.0}, "phi0 must not be 0"),
        (CFDL, {"force_unit": 0}, "force_unit must lie in"),
        (CFDL, {"initial_input": float("inf")}, "initial_input must be a finite number"),
        (PD, {"kp": "big"}, "kp must be a number"),
        (PD, {"kd": None}, "kd must be a number"),
    ],
)
def test_parameters_are_validated(law, fields, message):
    with pytest.raises(InvalidValue, match=message):
        law(**fields)


def test_defaults_are_table_1():
    for law in (CFDL(), ICFDL()):
        assert (law.eta, law.rho, law.lam, law.mu, law.eps) == (1.0, 0.245, 5e-5, 0.1, 1e-5)
        assert (law.force_unit, law.initial_input, law.phi0) == (100.0, 1500.0, None)
    assert (PD().kp, PD().kd, PD().force_unit, PD().initial_input) == (4.46, 1000.0, 1.0, 1500.0)
    assert STUDY.trials == 150
