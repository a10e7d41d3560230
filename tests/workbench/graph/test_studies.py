"""Every function of every study as a graph: the same doubles, the same JSON, slopes that agree."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator

import casadi as ca
import numpy as np
import pytest

from models.plant import Plant
from models.quantity import InvalidValue, is_declared, quantities
from workbench.contracts.study import Study
from workbench.fold.fold import build
from workbench.graph import call, from_json, jacobian, read, to_json
from workbench.trials import find

SAMPLES = 4


def plants(thing: object) -> Iterator[Plant]:
    """Every plant that stands somewhere in a declaration."""
    if isinstance(thing, Plant):
        yield thing
    values = thing.values() if isinstance(thing, dict) else ()
    if is_declared(thing):
        values = [value for _, _, value in quantities(thing)]
    for value in values:
        yield from plants(dict(value) if hasattr(value, "items") else value)


def trials(study: Study) -> Iterator[tuple[str, ca.Function]]:
    """A short trial of every folded law of a study; one that is made for the study's own samples has none."""
    for name, law in study.controllers.items():
        if not law.stepped:
            with contextlib.suppress(InvalidValue, RuntimeError):
                yield name, build(study.plant, study.law(name), SAMPLES).trial.expand()


def functions() -> dict[str, ca.Function]:
    """Every function of every study, by study, plant or law, and what it is."""
    found: dict[str, ca.Function] = {}
    for name in find.names():
        study = find.find(name)
        seen: list[Plant] = []
        for plant in [study.plant_that_runs, *plants(study)]:
            if plant not in seen:
                seen.append(plant)
                label = f"{name}:{plant.name}{len(seen)}"
                made = (plant.step_function(), plant.output_function(), plant.next_output_function())
                found |= {f"{label}:{one.name()}": one for one in made}
        found |= {f"{name}:{law}:trial": trial for law, trial in trials(study)}
    return found


FUNCTIONS = functions()


def given(function: ca.Function, rng: np.random.Generator) -> dict[str, np.ndarray]:
    drawn = {name: rng.uniform(-1, 1, function.size_in(name)) for name in function.name_in()}
    if "length" in drawn:
        drawn["length"] = np.array([[3.0]])
    if "k" in drawn:
        drawn["k"] = np.array([[float(rng.integers(0, 2000))]])
    return drawn


def test_all_studies_have_functions():
    studies = {label.split(":")[0] for label in FUNCTIONS}
    assert studies == set(find.names())
    trials = [label.split(":")[0] for label in FUNCTIONS if label.endswith(":trial")]
    assert len(trials) >= 19 and set(trials) == {"maglev", "metro", "same-plant", "variable-gain"}


@pytest.mark.parametrize("label", FUNCTIONS)
def test_the_same_doubles_in_the_graph_and_from_json(label):
    function = FUNCTIONS[label]
    graph = read(function)
    again = from_json(to_json(graph))
    assert to_json(again) == to_json(graph)
    rng = np.random.default_rng(0)
    for _ in range(3):
        inputs = given(function, rng)
        expected = function.call(inputs)
        found = call(again, inputs)
        for name in function.name_out():
            assert np.array_equal(found[name], expected[name].full(), equal_nan=True), name
            assert (
                np.array_equal(np.signbit(found[name]), np.signbit(expected[name].full()))
                or np.isnan(found[name]).any()
            )


@pytest.mark.parametrize("label", [label for label in FUNCTIONS if not label.endswith(":trial")])
def test_slopes_agree_with_casadi_and_with_differences(label):
    function = FUNCTIONS[label]
    graph, of = read(function), function.name_out(0)
    rng = np.random.default_rng(1)
    for by in function.name_in():
        if not function.numel_in(by):
            continue
        slope = jacobian(graph, of, by)
        symbols = function.sx_in()
        value = function(*symbols) if len(symbols) > 1 else function(symbols[0])
        theirs = ca.Function("d", symbols, [ca.jacobian(value, symbols[function.index_in(by)])])
        for _ in range(5):
            inputs = given(function, rng)
            found = call(slope, inputs)[f"d{of}_d{by}"]
            expected = theirs(*inputs.values()).full()
            assert found == pytest.approx(expected, rel=1e-11, abs=1e-12)
            for column in range(found.shape[1]):
                if by == "k":
                    continue
                h = 1e-6
                moved = []
                for side in (-1, 1):
                    shifted = {name: values.copy() for name, values in inputs.items()}
                    shifted[by].ravel(order="F")[column] += 0
                    flat = shifted[by].reshape(-1, order="F").copy()
                    flat[column] += side * h
                    shifted[by] = flat.reshape(shifted[by].shape, order="F")
                    moved.append(function.call(shifted)[of].full().ravel(order="F"))
                difference = (moved[1] - moved[0]) / (2 * h)
                scale = max(1.0, math.fabs(float(np.max(np.abs(found), initial=0.0))))
                rough = max(1e-6, 1e-9 * float(np.max(np.abs(moved[0]), initial=0.0)) / h)
                assert np.all(np.abs(found[:, column] - difference) <= rough * scale), by
