"""Plants of dimensionless signals, made from one equation."""

from __future__ import annotations

from typing import Any

from models.plant import Plant, signals
from models.quantity import declared, quantity


def small(name: str, equation: Any, states: int = 1, output: int = 0, **members: Any) -> Plant:
    """Return a plant from x_next = equation(x, u, k), x a tuple of ``states`` numbers; ``members`` are further ones."""

    def step(self: Any, x: Any, u: Any, w: Any, k: Any) -> Any:
        return equation(tuple(x), u.u, k)

    def measure(self: Any, x: Any) -> Any:
        return (x[output],)

    made = {
        "__annotations__": {"sampling_time": float},
        "__doc__": f"A small plant: {name}.",
        "source": "made for tests",
        "sampling_time": quantity(default=1.0, unit="s", doc="sampling time", above=0),
        "states": signals(**{f"x{i}": "1" for i in range(states)}),
        "inputs": signals(u="1"),
        "outputs": signals(**{f"x{output}": "1"}),
        "step": step,
        "output": measure,
        **members,
    }
    return declared(type(name, (Plant,), made))()
