"""Where an input of a plant first reaches an output, read off the plant's equations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca

from models.errors import InvalidValue
from models.function_name import function_name
from models.named_signals import Signal

if TYPE_CHECKING:
    from models.plant import Plant


class FirstEffect(NamedTuple):
    """Where an input first reaches an output of a plant."""

    degree: int
    """y(k + degree) is the first output whose expression contains u(k)."""
    slope: ca.Function
    """(x, u, w) -> (dy_du), dy(k + degree)/du(k); it takes k too where none was chosen.

    The columns of u (nu, degree) and w (nw, degree) are the samples k, ..., k + degree - 1.
    """
    shown: bool
    """Whether two values of u(k) were found between which y(k + degree) differs by more than rounding.

    Where it is False, u(k) may cancel in the expression, or act only far from the points that were tried.
    """

    @property
    def slope_at_rest(self) -> float:
        """The slope where states, inputs and disturbances (and k, where none was chosen) are zero."""
        return float(self.slope()["dy_du"])


def first_effect(
    plant: Plant, limit: int, *, k: int | None, output: str | None, input: str | None
) -> FirstEffect | None:
    """Return what :meth:`models.plant.Plant.first_effect` says."""
    row = position(plant.outputs, output, "output")
    column = position(plant.inputs, input, "input")
    if k is not None and (isinstance(k, bool) or not isinstance(k, int)):
        raise InvalidValue(f"k must be a whole number, or left out for every sample, got {k!r}")
    at = plant.symbols()
    x, first, inputs, disturbances = at["x"], at["u"], [at["u"]], [at["w"]]
    sample = at["k"] if k is None else ca.SX(k)
    for degree in range(1, limit + 1):
        x = plant.next_state(x, inputs[-1], disturbances[-1], sample + degree - 1)
        y = plant.measured(x)[row]
        if ca.depends_on(y, first[column]):
            given = {"x": at["x"], "u": ca.horzcat(*inputs), "w": ca.horzcat(*disturbances)}
            given |= {"k": at["k"]} if k is None else {}
            slope = ca.Function(
                f"{function_name(plant.name)}_slope",
                [*given.values()],
                [ca.jacobian(y, first[column])],
                [*given],
                ["dy_du"],
            )
            reached = ca.Function("reached", [*given.values()], [y], list(given), ["y"])
            return FirstEffect(degree, slope, _differs(reached, column))
        if not ca.depends_on(x, first[column]):
            return None  # no later output can depend on it
        inputs.append(ca.SX.sym("later_u", len(plant.inputs)))
        disturbances.append(ca.SX.sym("later_w", len(plant.disturbances)))
    return None


def position(named: Sequence[Signal], name: str | None, what: str) -> int:
    """Return where a signal stands among its like, the first where no name was given."""
    names = [signal.name for signal in named]
    if not names or (name is not None and name not in names):
        raise InvalidValue(f"{what} must be one of: {', '.join(names) or 'none, the plant has none'}; got {name!r}")
    return 0 if name is None else names.index(name)


def _differs(reached: ca.Function, column: int) -> bool:
    """Tell whether y = reached(x, u, w[, k]) was seen to change with u[column, 0].

    States, inputs and disturbances are small whole numbers, whose sums and products are exact: what cancels does.
    """
    for whole in (0, 1):
        point = {
            name: whole * ca.reshape(ca.DM(range(1, rows * columns + 1)), rows, columns)
            for name, (rows, columns) in zip(
                reached.name_in(), map(reached.size_in, range(reached.n_in())), strict=True
            )
        }
        point["u"][column, 0] = 0
        without = float(reached(**point)["y"])
        for size in (1, -1, 1000, -1000):
            point["u"][column, 0] = size
            change = abs(float(reached(**point)["y"]) - without)
            if 1e-12 * max(size**2, without**2) < change < math.inf:
                return True
    return False
