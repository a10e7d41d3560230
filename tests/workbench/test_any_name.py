"""A plant, a law, its memory, signals, fields and controllers of any name that Python takes."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest

import verification
from models.plant import Plant, Signal, Values, signals
from models.quantity import InvalidValue, declared, quantity
from workbench.contracts.law import Law
from workbench.contracts.study import Study
from workbench.controllers.parts.rows import known
from workbench.trials.campaign import load, run

NAMES = ["小车", "_cart", "cart_", "__cart__", "ca__rt", "null", "Ω_"]


def named_study(name: str, other: str) -> Study:
    """Return y(k+1) = 0.5 y(k) + u(k) under u <- u + 0.5 e(k+1), everything called by one name or the other."""

    def step(self, x, u, w, k):
        return (0.5 * getattr(x, name) + getattr(self, other) * getattr(u, other),)

    fields = {
        other: quantity(default=1.0, unit="1", doc=other),
        "sampling_time": quantity(default=1.0, unit="s", doc="Ts"),
    }
    plant = declared(
        type(
            name,
            (Plant,),
            {
                "__annotations__": dict.fromkeys(fields, float),
                **fields,
                "inputs": (Signal(other, "N"),),
                "states": (Signal(name, "m"),),
                "outputs": (Signal(name, "m"),),
                "step": step,
                "output": lambda self, x: (x[0],),
            },
        )
    )
    memory: Any = NamedTuple(name, [(other.strip("_") + "_", Any)])
    members = {
        "source": "ours",
        "learns_on": "output",
        "__annotations__": {other: float, "source": ClassVar[str], "tells": ClassVar[tuple]},
        other: quantity(default=0.5, unit="1", doc=other),
        "tells": (Signal(name, "N"),),
        "start": lambda self, task: memory(ca.DM.zeros(1, task.samples)),
        "act": lambda self, memory_k, state, r, r_next, y: ((memory_k[0],), state),
        "learn": lambda self, kept, trial: memory(
            kept[0] + getattr(self, other) * known(trial.reached, trial.e)[:, 1:]
        ),
        "tell": lambda self, kept, trial: (kept[0],),
    }
    law = declared(type(other, (Law,), members))
    title = f"{name} under {other}"
    return Study(
        name=f"{name}-",
        title=title,
        plant=plant(),
        reference=np.array([0.0, 1.0, 2.0, 1.0, 0.0]),
        controllers={f"{other}-": law()},
        trials=3,
    )


@pytest.mark.parametrize(("name", "other"), list(itertools.pairwise([*NAMES, NAMES[0]])))
def test_a_study_of_any_names_runs_and_is_verified(name, other, tmp_path):
    study = named_study(name, other)
    done = run(study, show_progress=False)
    r, u = study.reference_samples[0], np.zeros(4)
    for trial in range(1, 4):
        y = [0.0]
        for k in range(4):
            y.append(0.5 * y[-1] + u[k])
        assert np.array_equal(done.data["output"].sel(controller=f"{other}-", trial=trial), y)
        assert np.array_equal(done.data[f"law_{name}"].sel(trial=trial)[0, :-1], u)
        u = u + 0.5 * (r - y)[1:]
    done.save(tmp_path)
    assert load(tmp_path, study).data["output"].equals(done.data["output"])
    report = verification.verify(done)
    report.save(tmp_path)
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("<math")
    plant = study.plant
    assert float(plant.derivative(other)([0.0], 3.0, [], 0)) == 3.0
    first = plant.first_effect()
    assert first is not None and first.slope_at_rest == 1.0
    assert plant.to_control().name == plant.name == name.lower()
    assert plant.linearised(np.zeros(1), np.zeros(1)).B[0, 0] == 1.0
    assert "aligned" in verification.latex(plant)


def test_a_private_name_is_found_as_a_class_spells_it():
    @declared
    class Cart(Plant):
        inputs = signals(force="N")
        states = outputs = signals(__speed="m/s")
        __gain: float = quantity(default=2.0, unit="1", doc="gain")
        sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time")

        def step(self, x, u, w, k):
            return (x.__speed + self.__gain * u.force,)

        def output(self, x):
            return (x.__speed,)

    assert float(Cart().next_output_function()(1.0, 3.0, [], 0)) == 7.0


@pytest.mark.parametrize("name", ["vector", "_names"])
def test_the_names_that_are_taken(name):
    with pytest.raises(InvalidValue, match=f"may have any name but vector and _names, got '{name}'"):
        Values((Signal(name, "1"),), ca.SX.sym("x"))


@pytest.mark.parametrize("text", ["a\0b", "a\x1b[31mb", "a\ud800b", "a\x7f"])
@pytest.mark.parametrize("where", ["title", "source", "unit", "doc", "quantity"])
def test_control_characters_are_refused_where_they_are_declared(text, where):
    study = named_study("cart", "pd")
    with pytest.raises(InvalidValue, match=r"must be text without control characters, got .*: leave them out"):
        if where in ("title", "source"):
            dataclasses.replace(study, **{where: text})
        elif where == "quantity":
            quantity(default=1.0, unit=text, doc="mass")
        else:
            bad = Signal("speed", **{"unit": "m/s", "doc": "speed"} | {where: text})
            plant = type("Moved", (type(study.plant),), {"states": (bad,), "outputs": (bad,)})
            Study(plant=plant(), reference=np.ones(5), controllers=study.controllers)
