"""Convex sets for robust control: zonotopes, half-space polytopes, reachable and invariant sets."""

from __future__ import annotations

from workbench.sets.invariant import (
    MinimalRPI,
    maximal_rpi,
    minimal_rpi,
    reachable,
    require_schur,
    rpi_residual,
    spectral_radius,
)
from workbench.sets.linear_program import SolverFailed
from workbench.sets.polytope import Conflict, Polytope, is_redundant
from workbench.sets.zonotope import TOLERANCE, Zonotope

__all__ = [
    "TOLERANCE",
    "Conflict",
    "MinimalRPI",
    "Polytope",
    "SolverFailed",
    "Zonotope",
    "is_redundant",
    "maximal_rpi",
    "minimal_rpi",
    "reachable",
    "require_schur",
    "rpi_residual",
    "spectral_radius",
]
