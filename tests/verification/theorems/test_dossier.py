"""What the claims of one verification share is computed once."""

from __future__ import annotations

import gc
from collections import Counter
from weakref import ref

import numpy as np
import pytest
from learning_laws import Second

from verification.decide.verify import examination_of, verify
from verification.theorems import dossier, funnels
from verification.theorems.dossier import dossier_of, dossiers_of
from workbench import Study, run
from workbench.contracts.verdict import Verdict
from workbench.contracts.verifying import Verification
from workbench.controllers import Increment
from workbench.trials.campaign import Campaign

N = 12
SMALL = {"force_unit": 1.0, "lam": 1.0, "rho": 0.5, "initial_input": 0.1, "mu": 1.0}


def campaign(**changes: object) -> Campaign:
    fields = {
        "plant": Second(),
        "reference": np.linspace(0.0, 0.1, N + 1),
        "trials": 6,
        "controllers": {"one": Increment(**SMALL), "other": Increment(**{**SMALL, "rho": 0.4})},
        **changes,
    }
    return run(Study(**fields), show_progress=False)


def test_there_is_one_dossier_of_a_controller_of_a_campaign():
    first, second = campaign(), campaign()
    files = dossiers_of(first)
    assert [one.controller for one in files] == ["one", "other"]
    assert all(dossier_of(first, one.controller) is one and one.campaign is first for one in files)
    assert not set(files) & set(dossiers_of(second)) and dossiers_of(second)[0].campaign is second


def test_a_dossier_that_nobody_has_is_kept_no_longer():
    made = campaign()
    kept = ref(dossier_of(made, "one"))
    gc.collect()
    assert kept() is None and not [place for place in dossier._at_hand if place[0] == id(made)]


def test_a_verification_makes_every_funnel_and_curve_once(monkeypatch: pytest.MonkeyPatch):
    signal = Second().outputs[0].name
    made = campaign(verify=Verification(limits={signal: (-50.0, 50.0), Second().inputs[0].name: (-50.0, 50.0)}))
    made_of = Counter[str]()
    for name in ("funnel", "curve", "with_rounding"):

        def counted(*args: object, name: str = name, kept: object = getattr(funnels, name)) -> object:
            made_of[name] += 1
            return kept(*args)  # type: ignore[operator]

        monkeypatch.setattr(funnels, name, counted)
    report = verify(made, examination_of(made), show_progress=False)
    assert made_of == dict.fromkeys(("funnel", "curve", "with_rounding"), 2)
    told = {one.claim.split(".", 1)[1] for one in report.verdicts if isinstance(one, Verdict)}
    assert {"increment_funnel", "learning_curve", f"limit.{signal}"} <= told
