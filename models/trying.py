"""A plant's equations are tried once, before anything is built of them."""

from __future__ import annotations

import warnings

import casadi as ca

from models.expression import Expression, as_expression
from models.plant import Plant
from models.quantity import InvalidValue, symbolised
from models.users_code import HINTS, asking, place_of_code

LATEST = 200
"""Samples after which an input must have reached an output."""


def tried(plant: Plant) -> None:
    """Ask a plant for its equations, with its quantities as symbols too.

    Raises InvalidValue in one line, with file and line of the plant's code: for equations that ask a symbol for its
    number or its truth, give the wrong number of values or take other arguments, and for an input that reaches no
    output.
    """
    for thing in (plant, symbolised(plant).thing):
        _asked(thing, plant.symbols())
    with warnings.catch_warnings():  # int() of such a symbol warns, and then fails
        warnings.simplefilter("ignore")
        _loud(plant)
    _reached(plant)


def _asked(plant: Plant, at: dict[str, Expression]) -> None:
    kind, name = type(plant), type(plant).__name__
    moves, says = (kind.rhs, "rhs") if plant.continuous else (kind.step, "step")
    with asking(f"{name}.{says}", moves):
        plant.next_state(**at)
    with asking(f"{name}.output", kind.output):
        plant.measured(at["x"])
    with asking(f"{name}.applied", kind.applied):
        plant.applied_input(at["x"], at["u"], at["k"])
    with asking(f"{name}.ended", kind.ended):
        plant.ended_at(at["x"])


def _loud(plant: Plant) -> None:
    """Ask with symbols that refuse to be numbers: others say NaN where a function of math asks them.

    What else such symbols do not admit is nothing to complain of: the equations are not run with them.
    """
    loud = symbolised(plant, ca.MX.sym).thing
    at = {
        name: as_expression(ca.MX.sym(name, len(named)))
        for name, named in (("x", plant.states), ("u", plant.inputs), ("w", plant.disturbances))
    }
    try:
        _asked(loud, {**at, "k": as_expression(ca.MX.sym("k"))})
    except InvalidValue as error:
        if any(key in str(error.__cause__) for key, _ in HINTS):
            raise
    except Exception:  # some function of CasADi that takes scalar expressions only
        return


def _reached(plant: Plant) -> None:
    moves = type(plant).rhs if plant.continuous else type(plant).step
    for one in plant.inputs:
        found = (plant.first_effect(LATEST, output=output.name, input=one.name) for output in plant.outputs)
        if not any(effect is not None for effect in found):
            raise InvalidValue(
                f"{place_of_code(moves)}: the input {one.name!r} of {type(plant).__name__} reaches no output within "
                f"{LATEST} samples: use u.{one.name} in the equations, or leave it out of inputs"
            )
