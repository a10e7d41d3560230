"""Claims, evidence and reports."""

from importlib import import_module
from pathlib import Path

_HOME = {
    "Claim": "workbench.contracts.claim",
    "Examination": "workbench.contracts.examination",
    "Figure": "workbench.contracts.examination",
    "Finding": "workbench.contracts.finding",
    "Report": "verification.report.write",
    "Standing": "workbench.contracts.finding",
    "Table": "workbench.contracts.examination",
    "Verdict": "workbench.contracts.verdict",
    "Replay": "verification.decide.replay",
    "latex": "verification.report.typeset",
    "replay": "verification.decide.replay",
    "verify": "verification.decide.verify",
}
__all__ = [
    "Claim",
    "Examination",
    "Figure",
    "Finding",
    "Replay",
    "Report",
    "Standing",
    "Table",
    "Verdict",
    "latex",
    "replay",
    "verify",
]


def _unhidden() -> None:
    """Raise an ImportError that says which file hides the packages that this one stands on."""
    ours = Path(__path__[0]).resolve().with_name("workbench")
    other = import_module("workbench")
    about = vars(other)  # a file beside the study has no __path__, a folder no __file__
    places = list(about.get("__path__", []))
    if ours not in [Path(place).resolve() for place in places]:
        place = about.get("__file__") or ", ".join(places)
        raise ImportError(
            f"workbench must be the package in {ours.parent}, but {place} has its name and is found first: "
            "rename that, or start from another folder"
        )
    import_module("workbench.distribution").unhidden("models")


def __getattr__(name: str) -> object:
    """Import a name from where it lives when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    _unhidden()
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the names that may be asked for."""
    return sorted({*globals(), *__all__})
