"""What a report says of every trial: in words and as a table, each number looked up anew; and what it does not say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from judging import standings
from small_plants import small
from small_studies import in_plant_units

from models.plant import Plant
from models.quantity import quantity
from verification.decide.judge import Judge
from verification.theorems import conclusion, learning, safe_words
from verification.theorems.dossier import Dossier
from verification.theorems.funnel import bands, covered
from verification.theorems.pictures import funnel_figures
from workbench import Study, TrialLength, Verification, run
from workbench.contracts.finding import Standing
from workbench.contracts.scenario import Between, NormalNoise, UniformNoise
from workbench.contracts.verdict import Verdict
from workbench.controllers import ICFDL, Increment

N = 12
LEAKING = small("Leaking", lambda x, u, k: (0.5 * x[0] + u,))
SUMMING = small("Summing", lambda x, u, k: (x[0] + u,))
BAND = "No trial of law ever leaves the bands below"


def weighed() -> Plant:
    """Return a plant whose gain may change from trial to trial."""
    gain = quantity(default=1.0, unit="1", doc="gain", above=0)
    made = small("Weighed", None, gain=gain, __annotations__={"gain": float, "sampling_time": float})

    def step(self: Any, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (x[0] + self.gain * u.u,)

    type(made).step = step
    return made


def law(kind: Any = Increment, **changes: Any) -> Any:
    return in_plant_units(kind, **changes)


def gather(plant: Plant = LEAKING, laws: Any = None, **changes: Any) -> list[Dossier]:
    fields = {"trials": 12, "trial_length": TrialLength(law="uniform", minimum=N // 2), **changes}
    study = Study(
        name="small",
        plant=plant,
        reference=np.sin(np.linspace(0, 2, N + 1)),
        controllers=laws or {"law": law()},
        **fields,
    )
    campaign = run(study, show_progress=False)
    return [Dossier(campaign, name) for name in study.controllers]


def said(files: list[Dossier]) -> str:
    verdicts = [one for d in files for one in standings(d).values()]
    return " ".join([*conclusion.paragraphs(files, verdicts), *safe_words.paragraphs(files, verdicts)])


def test_the_numbers_in_words_and_table_are_those_of_the_bands():
    (d,) = files = gather()
    text, (table,) = said(files), safe_words.table(files)
    assert BAND in text and [row[1] for row in table.rows] == [signal.name for signal, _ in bands(d)] == ["x0", "u"]
    for (signal, ends), row in zip(bands(d), table.rows, strict=True):
        assert f"{signal.name} {ends.min():.4g} to {ends.max():.4g}" in text
        (low, i), (high, j), (wide, k) = (cell.split(" at ") for cell in row[3:])
        assert float(low) == pytest.approx(ends[:, 0].min(), rel=1e-4) and ends[int(i), 0] == ends[:, 0].min()
        assert float(high) == pytest.approx(ends[:, 1].max(), rel=1e-4) and ends[int(j), 1] == ends[:, 1].max()
        width = ends[:, 1] - ends[:, 0]
        assert float(wide) == pytest.approx(width.max(), rel=1e-4) and width[int(k)] == width.max()
    taken = d.funnels.taken
    assert np.nanmax(taken.x) <= float(table.rows[0][4].split(" at ")[0]) * (1 + 1e-4)
    curve = d.funnels.curve
    for bound in (f"{curve.common[0]:.4g}", f"{curve.common[-1]:.3g}", f"{curve.final:.3g}"):
        assert f"below {bound} " in text
    assert "its inputs go to those that give the reference's increments" in text
    assert "is not shown" not in text and "no band is known" not in text


SCOPED = Verification(scope={"plant.gain": (0.95, 1.05)})
CASES: dict[str, tuple[Any, list[str], list[str]]] = {
    # what the study is, what must be said, what must not
    "a filter": (
        lambda: gather(laws={"law": law(q_cutoff_hz=0.2)}),
        ["Of law no band is known that every trial stays in (increment_funnel is UNDECIDED)", "filter",
         "that no later trial leaves it is not shown"],
        [BAND, "speak of every trial"],
    ),
    "two laws, one with a filter": (
        lambda: gather(laws={"law": law(), "smooth": law(q_cutoff_hz=0.2)}),
        [BAND, "Of smooth no band is known", "that no later trial of smooth leaves it is not shown",
         "increment_funnel, increment_limit and learning_curve speak of every trial of law)"],
        ["that no later trial leaves it is not shown"],
    ),
    "a law without a funnel": (
        lambda: gather(laws={"law": law(ICFDL)}),
        ["that no later trial leaves it is not shown"],
        [BAND, "no band is known", "speak of every trial"],
    ),
    "bands within the box": (
        lambda: gather(SUMMING, trials=40, trial_length=TrialLength(law="fixed")),
        ["no later trial of law leaves its box, as its bands lie inside"],
        ["reach beyond its box", "is not shown"],
    ),
    "bands beyond the box": (
        lambda: gather(trials=3),
        ["the bands of law reach beyond its box", "so a later trial may leave that"],
        ["leaves its box, as"],
    ),
    "a quantity that changes": (
        lambda: gather(weighed(), truth={"gain": Between(low=0.9, high=1.1)}),
        [f"{BAND} (for plant gain 0.9 to 1.1)", "increment_funnel"],
        ["its inputs go to those", "the same in all trials"],
    ),
    "a scope that is too small": (
        lambda: gather(weighed(), truth={"gain": Between(low=0.9, high=1.1)}, verify=SCOPED),
        ["no band is known", "the study may leave that"],
        [BAND],
    ),
    "noise without a bound": (
        lambda: gather(noise=NormalNoise(sigma=0.01)),
        ["Of law no band is known that every trial stays in (increment_funnel is UNDECIDED): measurement noise has no"],
        [BAND, "the program met"],
    ),
    "noise that hides the last steps": (
        lambda: gather(noise=UniformNoise(largest=0.1)),
        [f"{BAND} (for noise x0 -0.1 to 0.1)", "That its error falls is not shown"],
        ["its inputs go to those"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_is_said_and_what_not(name):
    made, there, absent = CASES[name]
    text = said(made())
    assert [one for one in there if one not in text] == [] and [one for one in absent if one in text] == [], text


@pytest.mark.parametrize(
    ("laws", "kept"),
    [
        ({"law": law()}, ["law"]),
        ({"law": law(q_cutoff_hz=0.2)}, []),
        ({"law": law(ICFDL)}, []),
        ({"law": law(), "smooth": law(q_cutoff_hz=0.2), "other": law(rho=0.4)}, ["law", "other"]),
    ],
)
def test_figures_and_tables_show_no_band_whose_premises_fail(laws, kept):
    files = gather(laws=laws)
    assert [d.controller for d in files if covered(d)] == kept
    found = learning.examine(files[0].campaign)
    tables = [one for one in found.tables() if "Bands" in one.title]
    assert [row[0] for one in tables for row in one.rows] == [name for name in kept for _ in ("x0", "u")]
    drawn = {name for name in found.figures() if name.startswith(("funnel_", "learning_curve_"))}
    assert drawn == {f"{what}_{name}" for what in ("funnel", "learning_curve") for name in kept}


def test_the_caption_says_for_what_the_bands_are():
    (d,) = gather(weighed(), truth={"gain": Between(low=0.9, high=1.1)})
    assert "(for plant gain 0.9 to 1.1)" in funnel_figures([d])["funnel_law"].caption


def test_nothing_is_said_of_a_claim_that_was_not_looked_at():
    files = gather()
    assert safe_words.paragraphs(files, []) == []
    (claim,) = [one for one in learning.claims_of(files[0]) if one.name.endswith("increment_funnel")]
    found = Judge().verdict(claim)
    assert isinstance(found, Verdict) and found.standing is Standing.PROVED
    (alone,) = safe_words.paragraphs(files, [found])
    assert BAND in alone and "(learning_curve)" not in alone and "(increment_limit)" not in alone


def test_a_table_says_for_what_its_bands_are():
    files = gather(weighed(), truth={"gain": Between(low=0.9, high=1.1)})
    (table,) = safe_words.table(files)
    assert table.title.endswith(", for plant gain 0.9 to 1.1")
