"""Plants as symbolic equations, with units."""

import sys
from importlib import import_module
from types import ModuleType

_HOME = {
    "Euler": "models.discretise",
    "GaussLegendre": "models.discretise",
    "InvalidValue": "models.errors",
    "Plant": "models.plant",
    "PointMass": "models.point_mass",
    "RK4": "models.discretise",
    "Signal": "models.named_signals",
    "by_role": "models.named_signals",
    "choice": "models.quantity",
    "count": "models.quantity",
    "declared": "models.quantity",
    "part": "models.quantity",
    "quantity": "models.quantity",
    "ranges": "models.quantity",
    "signal": "models.named_signals",
    "switch": "models.quantity",
    "table": "models.quantity",
    "given": "models.quantity",
    "signals": "models.named_signals",
}
__all__ = [
    "RK4",
    "Euler",
    "GaussLegendre",
    "InvalidValue",
    "Plant",
    "PointMass",
    "Signal",
    "by_role",
    "choice",
    "count",
    "declared",
    "given",
    "part",
    "quantity",
    "ranges",
    "signal",
    "signals",
    "switch",
    "table",
]


def __getattr__(name: str) -> object:
    """Import a name from where it lives when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the names that may be asked for."""
    return sorted({*globals(), *__all__})


class _FrontDoor(ModuleType):
    """A package whose names stay what they are when a child module of the same name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        """Take everything but a child module under a name of the front door: ``quantity`` is the function."""
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _FrontDoor
