"""What proofs are stated for, where that is not what the study meets, and the bounds that are asked of signals."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping

from models.plant import Plant
from models.quantity import InvalidValue, declared, is_declared, nested, ranges, rebuilt, symbolised, walked

PLANT, INITIAL, DISTURBANCE, NOISE = "plant.", "initial.", "disturbance.", "noise."


@declared
class Verification:
    """What proofs are stated for, and which bounds are asked of signals; both change nothing in what is run.

    By default proofs are stated for all that the study may meet, see :func:`workbench.contracts.scope.scope_of`.
    """

    scope: Mapping[str, tuple[float, float]] = ranges(
        default={},
        doc="ranges that proofs hold for in place of what the study meets: of plant.QUANTITY, initial.STATE, "
        "disturbance.NAME and noise.OUTPUT, each in its own unit",
    )
    limits: Mapping[str, tuple[float | None, float | None]] = ranges(
        default={},
        doc="bounds asked of states, inputs and outputs in every trial, by the signal's name, in its own unit",
        open_ends=True,
    )

    def within(self, group: str) -> dict[str, tuple[float, float]]:
        """Return the ranges of the scope that are named in a group (``PLANT`` and so on), by name within it."""
        return {name.removeprefix(group): ends for name, ends in self.scope.items() if name.startswith(group)}


def check_verification(verify: object, plant: Plant) -> None:
    """Raise InvalidValue for what is no Verification, names what a plant does not have, or values it cannot have."""
    if not isinstance(verify, Verification):
        raise InvalidValue(
            f"verify must be a Verification, as in Verification(limits={{'level': (0, 2)}}); got {verify!r}"
        )
    known = [
        *(f"{PLANT}{name}" for name in symbolised(plant).names),
        *(f"{INITIAL}{signal.name}" for signal in plant.states),
        *(f"{DISTURBANCE}{signal.name}" for signal in plant.disturbances),
        *(f"{NOISE}{signal.name}" for signal in plant.outputs),
    ]
    for name in verify.scope:
        if name not in known:
            raise _without_number(plant, name) or _unknown("scope", name, known)
    for name, (low, high) in verify.within(NOISE).items():
        if low != -high:
            raise InvalidValue(f"verify.scope must be -nu to nu for {NOISE}{name}, got [{low:.12g}, {high:.12g}]")
    _admitted(plant, verify.within(PLANT))
    signals = dict.fromkeys(signal.name for signal in (*plant.states, *plant.inputs, *plant.outputs))
    for name in verify.limits:
        if name not in signals:
            raise _unknown("limits", name, signals)


def _admitted(plant: Plant, ends: Mapping[str, tuple[float, float]]) -> None:
    """Raise InvalidValue for an end that a quantity cannot have, the others being at their least and at their largest.

    These are corners of the scope, so what fails there is in it, also where one quantity bounds another.
    """
    for others in (0, 1):
        corner = {name: pair[others] for name, pair in ends.items()}
        for name, pair in ends.items():
            for end in pair:
                try:
                    rebuilt(plant, nested({**corner, name: end}), PLANT)
                except InvalidValue as error:
                    raise InvalidValue(f"verify.scope holds {PLANT}{name} at {end:.12g}, but {error}") from None


def _without_number(plant: Plant, name: str) -> InvalidValue | None:
    """Return why a setting of the plant has no range, or None where there is no such setting."""
    for path, spec, value in walked(plant, lambda spec, value: is_declared(value), PLANT):
        if path == name:
            what = "shapes the equations" if spec.structural else f"is {value!r} here"
            return InvalidValue(f"verify.scope names {name}, which {what}: it has no number that could vary")
    return None


def _unknown(field: str, name: str, known: Iterable[str]) -> InvalidValue:
    known = list(known)
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are: {', '.join(known)}"
    return InvalidValue(f"verify.{field} names {name!r}, which there is not; {hint}")
