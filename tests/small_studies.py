"""One law on a small plant, run: what tests of what is proved of it begin with."""

from __future__ import annotations

from typing import Any

from models.plant import Plant
from verification.theorems.dossier import Dossier
from workbench import Study, run
from workbench.contracts.verifying import Verification


def in_plant_units(kind: Any, **changes: Any) -> Any:
    """Return a law in the plants' own unit; l lies between 0.15 and l_max = rho/(2 sqrt(lam)) = 0.25."""
    return kind(**{"force_unit": 1.0, "rho": 0.5, "lam": 1.0, "mu": 1.0, "initial_input": 0.3, **changes})


def gathered(plant: Plant, law: Any, *, lengths: Any, scope: Any = None, limits: Any = None, **changes: Any) -> Dossier:
    """Return the dossier of a law on a plant; ``changes`` are fields of the study."""
    study = Study(
        name="small",
        plant=plant,
        controllers={"law": law},
        trial_length=lengths,
        verify=Verification(scope=scope or {}, limits=limits or {}),
        **changes,
    )
    return Dossier(run(study, show_progress=False), "law")
