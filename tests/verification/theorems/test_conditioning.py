"""Digits of scores, held against plants whose sensitivity is known; the claim, its witness and its replay."""

from __future__ import annotations

import json
import math
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from learning_laws import Planned
from small_plants import small

from models.quantity import declared, quantity
from verification.decide.judge import Judge
from verification.decide.replay import replay
from verification.decide.verify import verify
from verification.report.listing import digit_table
from verification.report.write import write_into
from verification.theorems.conditioning import LEAST, conditioning, well_conditioned
from workbench.contracts.finding import Grounds, Standing
from workbench.contracts.law import Channels, Decision, Law
from workbench.contracts.scenario import From
from workbench.contracts.study import Study
from workbench.contracts.survival import Survival, digits
from workbench.contracts.verdict import NotMade
from workbench.design.comparison import comparison
from workbench.evidence.digits import DRAWS, LARGE, SMALL, Digits, relative_change
from workbench.trials.campaign import Campaign, run

START = 0.3


@declared
class Still(Planned):
    """A law that gives nothing, and none of whose numbers can be anything else."""

    gain: float = quantity(default=0.8, unit="1", doc="learning gain", structural=True)
    first: float = quantity(default=0.0, unit="1", doc="first plan", structural=True)


@declared
class Nothing(Law):
    """No input at all, for two outputs."""

    source: ClassVar[str] = "made for tests, 2026"
    channels: ClassVar[Channels] = Channels(outputs=2)

    def start(self, task):
        return ()

    def act(self, memory_k, state, r, r_next, y):
        return ca.DM(0), state


STEP = quantity(default=1.0, unit="s", doc="sampling time", above=0, structural=True)
LOGISTIC = small("logistic", lambda x, u, k: (4 * x[0] * (1 - x[0]) + 0 * x[0] + u,), sampling_time=STEP)
CALM = small("calm", lambda x, u, k: (0.5 * x[0] + u,), sampling_time=STEP)


def campaign(plant, samples, law=None, **changes):
    fields = {
        "plant": plant,
        "reference": np.zeros(samples + 1),
        "controllers": {"law": Still() if law is None else law},
        "trials": 1,
        "initial": From(state=(START,)),
        **changes,
    }
    return run(Study(**fields), show_progress=False)


def logistic_amplification(samples):
    """Return what a relative change of the start becomes in the mean of x^2: x_k = sin(2^k asin sqrt(x_0))^2."""
    theta = math.asin(math.sqrt(START))
    slope = 1 / (2 * math.sqrt(START * (1 - START)))
    x = [math.sin(2**k * theta) ** 2 for k in range(1, samples + 1)]
    moved = [2**k * math.sin(2 ** (k + 1) * theta) * slope for k in range(1, samples + 1)]
    return abs(START * sum(2 * a * b for a, b in zip(x, moved, strict=True)) / sum(a * a for a in x))


@pytest.mark.parametrize("samples", [3, 8, 15, 20, 25])
def test_a_logistic_map_doubles_what_is_off_at_every_sample(samples):
    of = Digits(campaign(LOGISTIC, samples))
    known = logistic_amplification(samples)
    assert of.varied == 1
    assert of.last("law", SMALL).change / SMALL == pytest.approx(known, rel=0.02)
    assert of.table["law"]["mse_last"].small == of.last("law", SMALL).change
    assert well_conditioned(of, "law").bound == pytest.approx(12 - math.log10(known), abs=0.01)
    if known * LARGE < 1e-3:
        assert of.last("law", LARGE).change / LARGE == pytest.approx(known, rel=0.05)
    single, why = of.in_single("law")
    assert not why and single is not None and single < 100 * known * 2.0**-24


def test_where_doubling_leaves_nothing_the_claim_is_refuted():
    done = campaign(LOGISTIC, 60)
    of = Digits(done)
    verdict = Judge().verdict(conditioning(of, "law"))
    assert verdict.standing is Standing.REFUTED
    assert verdict.replayed == verdict.margin == verdict.bound - LEAST < -1
    assert verdict.witness["digits_in_single_precision"] < 2


@pytest.mark.parametrize("samples", [3, 60, 400])
def test_a_plant_that_forgets_keeps_its_digits(samples):
    of = Digits(campaign(CALM, samples))
    finding = well_conditioned(of, "law")
    assert finding.standing is Standing.SUPPORTED and finding.grounds is Grounds.TRIES and finding.tries == DRAWS
    assert finding.witness["amplification"] == pytest.approx(2.0, rel=1e-3)  # the mean of x^2 is as the start's square
    assert finding.witness["amplification_at_1e-6"] == pytest.approx(2.0, rel=1e-3)
    assert finding.margin == finding.bound - LEAST and finding.bound == pytest.approx(12 - math.log10(2), abs=1e-3)
    assert finding.witness["digits_in_single_precision"] > 6


def test_what_is_least_decides():
    """A margin of 0 is enough: no more than the least is asked for."""
    of = Digits(campaign(CALM, 5))
    of.last = lambda name, relative: Digits.last(of, name, relative)._replace(change=10.0**-LEAST)
    assert well_conditioned(of, "law").standing is Standing.SUPPORTED
    of.last = lambda name, relative: Digits.last(of, name, relative)._replace(change=1.001 * 10.0**-LEAST)
    assert well_conditioned(of, "law").standing is Standing.REFUTED


def test_the_worst_draw_is_meant():
    law = Planned(gain=0.3)
    of = Digits(campaign(CALM, 5, law, trials=4, reference=np.ones(6)))
    changes = [of.again("law", SMALL, draw, ()) for draw in range(DRAWS)]
    found = of.last("law", SMALL)
    assert len(set(changes)) > 1 and found.change == max(changes) and changes[found.draw] == found.change
    assert found.moved == of.varied == 2


def test_scores_that_count_are_exact():
    def counted(study, data):
        return {"law": {"above": float((data["output"] > 0.1).sum()), "largest": float(data["output"].max())}}

    table = Digits(campaign(LOGISTIC, 8, scorers=(counted,))).table["law"]
    assert table["above"].exact and table["above"].shown == "exact" and table["above"].as_json()["exact"] is True
    assert not table["largest"].exact and "exact" not in table["largest"].shown
    assert "diverged_at_trial" not in table


def test_where_no_setting_can_be_anything_else_nothing_is_claimed():
    of = Digits(campaign(CALM, 5, initial=From(state=(0.0,)), law=Still(first=0.5)))
    assert of.varied == 0
    found = Judge().verdict(conditioning(of, "law"))
    assert isinstance(found, NotMade) and "a setting" in found.lacks


def test_where_every_change_is_refused_it_is_left_open():
    @declared
    class Pinned(Still):
        pinned: float = quantity(default=1.0, unit="1", doc="at both ends", least=1.0, most=1.0)

    finding = well_conditioned(Digits(campaign(CALM, 5, Pinned(first=0.5), initial=From(state=(0.0,)))), "law")
    assert finding.standing is Standing.UNDECIDED and "would decide" in finding.reason


def test_digits_are_the_same_in_other_units():
    made = small("metres", lambda x, u, k: (3.7 * x[0] * (1 - x[0]) + u,), sampling_time=STEP)
    in_mm = small("millimetres", lambda x, u, k: (3.7 * x[0] * (1 - x[0] / 1000) + u,), sampling_time=STEP)
    one, other = (
        Digits(campaign(plant, 20, initial=From(state=(start,)))).table["law"]
        for plant, start in ((made, START), (in_mm, 1000 * START))
    )
    for metric in one:
        assert digits(one[metric].small) == pytest.approx(digits(other[metric].small), abs=0.02), metric
        assert digits(one[metric].large) == pytest.approx(digits(other[metric].large), abs=0.02), metric


def test_the_same_campaign_has_the_same_digits():
    done = campaign(LOGISTIC, 20)
    again = campaign(LOGISTIC, 20)
    assert Digits(done).table == Digits(done).table == Digits(again).table


def test_of_several_outputs_the_worst_decides():
    @declared
    class Pair(type(LOGISTIC)):
        states = type(small("pair", lambda x, u, k: x, states=2)).states
        outputs = states

        def step(self, x, u, w, k):
            return 0.5 * x.x0 + u.u, 4 * x.x1 * (1 - x.x1) + 0 * x.x0

        def output(self, x):
            return x.x0, x.x1

    of = Digits(
        campaign(
            Pair(), 15, reference=np.zeros((2, 16)), initial=From(state=(1.0, START)), controllers={"law": Nothing()}
        )
    )
    table = of.table["law"]
    assert of.last("law", SMALL).change == max(table["mse_last_x0"].small, table["mse_last_x1"].small)
    assert table["mse_last_x0"].small < 3e-12 < table["mse_last_x1"].small


def test_of_a_law_that_fell_the_last_trial_that_ran_is_meant():
    done = campaign(CALM, 30, Planned(gain=9.0), reference=np.ones(31), trials=40, initial=From(state=(0.1,)))
    of = Digits(done)
    assert done.stopped and 0 < of.last_trial("law") < 39
    assert well_conditioned(of, "law").standing in (Standing.SUPPORTED, Standing.REFUTED)
    assert "mse_last" not in of.table["law"]


@declared
class Sampled(Law):
    """Nothing too, decided in numbers."""

    source: ClassVar[str] = "made for tests, 2026"

    def start(self, task):
        return ()

    def decide(self, memory, state, seen):
        return Decision(u=np.zeros(1)), state


def test_what_is_stepped_is_drawn_once_and_not_in_single_precision():
    both = {"law": Still(), "sampled": Sampled()}
    of = Digits(campaign(LOGISTIC, 8, controllers=both))
    assert of.draws == 1
    for name in both:
        assert of.last(name, SMALL).change / SMALL == pytest.approx(logistic_amplification(8), rel=0.02)
    assert of.table["law"]["mse_last"].single is not None and of.table["sampled"]["mse_last"].single is None
    finding = well_conditioned(of, "sampled")
    assert finding.tries == 1 and "sample by sample" in finding.witness["digits_in_single_precision"]
    alone = Digits(campaign(LOGISTIC, 8, Sampled()))
    assert alone.table["law"] == of.table["sampled"]


@pytest.mark.parametrize(
    ("one", "other", "change"),
    [
        (2.0, 2.0, 0.0),
        (2.0, 2.5, 0.25),
        (-2.0, -1.0, 0.5),
        (2.0, -2.0, 2.0),
        (0.0, 0.0, 0.0),
        (0.0, 1e-30, math.inf),
        (1.0, None, math.inf),
        (1.0, math.nan, math.inf),
        (math.inf, 1.0, math.inf),
        (None, None, 0.0),
    ],
)
def test_changes_are_relative_to_what_was(one, other, change):
    assert relative_change(one, other) == change


@pytest.mark.parametrize(
    ("change", "left"), [(0.0, 16.0), (1e-20, 16.0), (1e-12, 12.0), (0.03, 1.5229), (1.0, 0.0), (math.inf, 0.0)]
)
def test_digits_of_a_change(change, left):
    assert digits(change) == pytest.approx(left, abs=1e-4)


def test_tuned_laws_are_held_and_not_tuned_again(monkeypatch):
    base = Study(plant=CALM, reference=np.linspace(0, 1, 21), controllers={"law": Planned(gain=0.3)}, trials=5)
    done = run(comparison(base, ["law", "pid"]), show_progress=False)
    of = Digits(done)
    monkeypatch.setattr(type(done.study.tuning), "tuned", lambda *_: pytest.fail("tuned again"))
    assert {"law", "pid"} <= set(of.table)
    assert all(one.small < 1e-9 for row in of.table.values() for one in row.values())
    moved = of._held(1e-3, 0).tuning.laws(done.study, done.data)["pid"]
    was = done.tuned_laws()["pid"]
    found = json.loads(str(done.data["tuned"].sel(controller="pid").values))
    for name in found:
        assert abs(getattr(moved, name) / getattr(was, name) - 1) == pytest.approx(1e-3)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("digits")
    report = verify(campaign(LOGISTIC, 60, name="map"), show_progress=False)
    report.save(folder / "out")
    return report, folder / "out"


def test_what_a_report_shows(written):
    report, folder = written
    content = json.loads((folder / "scores.json").read_text())
    shown = report.digits["law"]["mse_last"]
    assert content["digits"]["law"]["mse_last"] == shown.as_json()
    assert report.campaign.scores()["law"].items() <= content["scores"]["law"].items()
    page = (folder / "report.html").read_text()
    assert '<th scope="colgroup" colspan="2">law</th>' in page
    assert f'<td class="number">{shown.shown}</td>' in page
    header, *rows = digit_table(report)
    assert header == ("digits", "law") and ("mse_last", shown.shown) in rows


def test_without_digits_a_report_has_no_column_for_them(tmp_path):
    report = verify(campaign(CALM, 5), [], show_progress=False)
    write_into(report, tmp_path, show_progress=False)
    assert digit_table(report) == [] and "colgroup" not in (tmp_path / "report.html").read_text()


def test_a_refutation_is_replayed_from_its_draw(written):
    _, folder = written
    study = campaign(LOGISTIC, 60, name="map").study
    found = replay(folder, "conditioning", "law", study=study)
    assert found.stands and found.now == found.then

    entries = json.loads((folder / "verdicts.json").read_text())
    (entry,) = [one for one in entries if one["claim"].endswith("conditioning")]
    claim = conditioning(Digits(Campaign(study, run(study, show_progress=False).data)), "law")
    assert claim.replay(entry["witness"]) == entry["margin"]


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (Survival(0.0, 0.0, 0.0), "exact"),
        (Survival(0.0, 0.0, None), "exact / exact / -"),
        (Survival(0.0, 0.0, 0.02), "exact / exact / 1"),
        (Survival(0.0, 1e-9, 0.0), "exact / 9 / exact"),
        (Survival(4.6e-12, 4.6e-6, 3.2e-6), "11 / 5 / 5"),
        (Survival(math.inf, 2.0, None), "0 / 0 / -"),
    ],
)
def test_digits_in_words(one, words):
    assert one.shown == words
    assert one.exact is (one.small == one.large == 0)
