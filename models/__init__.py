"""Plants as symbolic equations, with units."""

from importlib import import_module

_HOME = {
    "InvalidValue": "models.errors",
    "Plant": "models.plant",
    "PointMass": "models.point_mass",
    "Signal": "models.plant",
    "choice": "models.quantity",
    "count": "models.quantity",
    "declared": "models.quantity",
    "part": "models.quantity",
    "quantity": "models.quantity",
    "signals": "models.plant",
}
__all__ = ["InvalidValue", "Plant", "PointMass", "Signal", "choice", "count", "declared", "part", "quantity", "signals"]


def __getattr__(name: str) -> object:
    """Import a name from where it lives when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the names that may be asked for."""
    return sorted({*globals(), *__all__})
