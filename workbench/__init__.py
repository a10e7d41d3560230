"""Declare a plant once, run controllers on it, and look."""

from importlib import import_module

_HOME = {
    "Campaign": "workbench.trials.campaign",
    "Law": "workbench.contracts.law",
    "TrialLength": "workbench.contracts.trial_length",
    "Study": "workbench.contracts.study",
    "Verification": "workbench.contracts.verifying",
    "__version__": "workbench.distribution",
    "load": "workbench.trials.campaign",
    "run": "workbench.trials.campaign",
}
__all__ = ["Campaign", "Law", "Study", "TrialLength", "Verification", "load", "run"]
_REPLACED = {"TrialStudy": "Study"}


def __getattr__(name: str) -> object:
    """Import a name from where it lives when it is first asked for."""
    if name in _REPLACED:
        # said on import too, which an AttributeError would not be
        raise ImportError(f"workbench.{name} is now workbench.{_REPLACED[name]}: there is one kind of study")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if not _HOME[name].endswith("distribution"):
        import_module("workbench.distribution").unhidden("models")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the names that may be asked for."""
    return sorted({*globals(), *__all__})
