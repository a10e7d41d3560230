"""The installed distribution: its name and its version, which pyproject.toml alone says."""

from __future__ import annotations

from importlib.metadata import version

DISTRIBUTION = "learning-control-workbench"
__version__ = version(DISTRIBUTION)
