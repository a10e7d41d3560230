"""Figures of runs: one panel an output, every axis labelled with its own unit, nothing empty."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import pyplot

from models.foreign import LinearSystem
from models.plant import Signal
from models.quantity import declared
from workbench.contracts.law import Channels, Law
from workbench.contracts.study import Study, Sweep
from workbench.controllers.pid import PID
from workbench.trials.campaign import run
from workbench.trials.figures import by_output, ran, trial_figures, trials_run

N = 30


@declared
class Idle(Law):
    """No input at all, for any number of channels."""

    source = "ours, 2026"
    channels = Channels(outputs=None, inputs=1)

    def start(self, task):
        return ()

    def act(self, memory_k, state, r, r_next, y):
        return 0.1, state


def plant(outputs):
    return LinearSystem(
        A=((0.9, 0.1), (0.0, 0.8)),
        B=((0.0,), (0.2,)),
        C=((1.0, 0.0), (0.0, 1.0))[:outputs],
        sampling_time=0.1,
        states=(Signal("level", "m"), Signal("flow", "L/s")),
        inputs=(Signal("valve", "%"),),
        outputs=(Signal("level", "m", "level of the tank"), Signal("flow", "L/s", "flow"))[:outputs],
    )


@pytest.mark.parametrize("outputs", [1, 2])
def test_every_output_has_a_panel_with_its_own_unit(outputs):
    laws = {"idle": Idle(), **({"pid": PID()} if outputs == 1 else {})}
    reference = np.ones((outputs, N + 1))
    study = Study(plant=plant(outputs), reference=reference, controllers=laws, trials=3)
    data = run(study, show_progress=False).data
    units = ("(m)", "(L/s)")[:outputs]
    for name, draw in trial_figures(study, data).items():
        figure = draw()
        assert all(axes.has_data() and axes.get_ylabel() for axes in figure.axes), name
        assert figure.axes[-1].get_xlabel(), name
        if name != "trial_lengths":
            assert len(figure.axes) == outputs, name
            for axes, unit in zip(figure.axes, units, strict=True):
                assert (f"({unit}²)" if name == "mse" else unit) in axes.get_ylabel(), name
        if name == "mse" or name.startswith("tracking"):
            assert figure.axes[0].get_legend() is not None
    pyplot.close("all")
    assert ran(data) == list(laws) and trials_run(data, "idle") == 3
    assert len(by_output(data["reference"])) == outputs


def test_a_sweep_of_more_controllers_than_there_are_marks_draws():
    laws = {f"pid{i}": PID(kp=0.1 * (i + 1)) for i in range(9)}
    sweep = Sweep(field="kp", values=(0.1, 1e9), controllers=tuple(laws), unit="%/m")
    study = Study(plant=plant(1), reference=np.ones(N + 1), controllers=laws, trials=1, sweeps=(sweep,))
    figure = trial_figures(study, run(study, show_progress=False).data)["sensitivity_kp"]()
    assert len(figure.legends[0].get_texts()) == 10
    pyplot.close("all")
