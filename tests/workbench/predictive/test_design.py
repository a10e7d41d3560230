"""Tubes designed for a task: by hand on an integrator, on the common train, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from models.actuator import Actuator
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue
from workbench.contracts.study import Study
from workbench.controllers import PD
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.predictive.design import Design
from workbench.trials.campaign import run

COMMON = Actuator(lower=-450e3, upper=450e3, rate=500e3)


def common(laws, **fields):
    given = {"plant": PointMass(), "reference": MetroProfile(), "actuator": COMMON, "trials": 1, **fields}
    return Study(name="common", controllers=laws, **given)


def test_the_tube_is_that_of_the_model_about_the_middle():
    study = common({"rmpc": RMPC()})
    tube, view = Design(unknown=0.01).designed(study.task())
    at = [view.states[:, 1000], view.inputs[1000:1001], [], 1000]
    A = np.eye(3)
    A[:2, :2], A[:2, 2:] = (study.plant.derivative(by)(*at).full() for by in ("x", "u"))
    np.testing.assert_allclose(tube.plant.A, A)
    np.testing.assert_allclose(tube.plant.b, [*A[:2, 2], 1.0])
    np.testing.assert_allclose(tube.plant.W.generators[:, 0], [0.01, 0, 0], atol=1e-15)
    np.testing.assert_allclose(view.states[0], study.reference_samples[0], atol=1e-9)
    box = dict(zip(tube.bounds.labels, tube.bounds.h, strict=True))
    inputs = view.inputs
    found = [value for label, value in box.items() if label.startswith("force")]
    np.testing.assert_allclose(found, [450e3 - inputs.max(), 450e3 + inputs.min()])
    delayed = common({"rmpc": RMPC()}, actuator=Actuator(lower=-450e3, upper=450e3, delay=0.3))
    assert Design().designed(delayed.task())[0].plant.delay == 3 and tube.plant.delay == 0


def test_predictive_laws_follow_the_common_train():
    study = common({"rmpc": RMPC(), "rsmpc": RSMPC(), "pd": PD(kp=20.0)}, truth={"mass": 0.9})
    data = run(study, show_progress=False).data.isel(trial=0)
    assert (data["stopped"] == "").all()
    mse = {str(name): float(data["mse"].sel(controller=name)) for name in data["controller"].values}
    assert mse["rmpc"] < 0.1 and mse["rsmpc"] < 0.15, mse
    assert (data["law_infeasible"].sel(controller=["rmpc", "rsmpc"]).fillna(0) == 0).all()
    assert (np.abs(data["input"].isel(sample=slice(0, -1)).sel(controller=["rmpc", "rsmpc"])) <= 450e3).all()
    qps = {name: float(data["law_qps"].sel(controller=name).sum()) for name in ("rmpc", "rsmpc")}
    assert qps["rmpc"] == study.horizon


def test_where_the_model_is_too_wrong_the_feedback_acts_and_it_is_told():
    data = run(common({"rmpc": RMPC()}, truth={"mass": 1.1}), show_progress=False).data.isel(trial=0, controller=0)
    assert float(data["mse"]) < 0.2 and 0 < float(data["law_infeasible"].sum()) < 100
    assert str(data["stopped"].values).endswith(", feedback acts")


REFUSALS = {
    r"a tube needs limits of force, got \[-inf, inf\]: set actuator.lower and actuator.upper": (
        RMPC(),
        {"actuator": Actuator()},
    ),
    r"the model may miss 0.2 km/h a sample: .* beyond 'force <= 44923.1' by 197393": (
        RMPC(design=Design(unknown=0.2)),
        {},
    ),
    r"needs room round the inputs that follow the reference, -3.366e\+05 to 4.051e\+05 N, the limits are -3e\+05": (
        RSMPC(),
        {"actuator": Actuator(lower=-300e3, upper=300e3)},
    ),
}


@pytest.mark.parametrize("message", REFUSALS)
def test_why_no_tube_can_be_designed_is_told_in_one_line(message):
    law, fields = REFUSALS[message]
    with pytest.raises(InvalidValue, match=message) as told:
        run(common({"law": law}, **fields), show_progress=False)
    assert "\n" not in str(told.value)


def test_a_law_without_a_tube_says_what_it_waits_for():
    with pytest.raises(InvalidValue, match="tube must be given, got None: it is designed by ready_for"):
        RMPC().plan(np.zeros(3))
    with pytest.raises(InvalidValue, match="needs a nominal model"):
        Design().designed(common({"rmpc": RMPC()}).task()._replace(model=None))
