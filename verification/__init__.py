"""Claims, evidence and reports."""

from importlib import import_module

_HOME = {
    "Claim": "workbench.contracts.verdict",
    "Examination": "workbench.contracts.examination",
    "Figure": "workbench.contracts.examination",
    "Finding": "workbench.contracts.verdict",
    "Report": "verification.report.write",
    "Standing": "workbench.contracts.verdict",
    "Table": "workbench.contracts.examination",
    "Verdict": "workbench.contracts.verdict",
    "latex": "verification.report.typeset",
    "verify": "verification.decide.verify",
}
__all__ = ["Claim", "Examination", "Figure", "Finding", "Report", "Standing", "Table", "Verdict", "latex", "verify"]


def __getattr__(name: str) -> object:
    """Import a name from where it lives when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the names that may be asked for."""
    return sorted({*globals(), *__all__})
