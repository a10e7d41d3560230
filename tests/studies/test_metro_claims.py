"""The claims on the metro study: their standings, and every refutation replayed from run.nc alone."""

from __future__ import annotations

import dataclasses
import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from studies.metro.published import EXPECTED
from studies.metro.study import STUDY
from verification.checks import convergence
from verification.decide.judge import judge
from verification.theorems.conclusion import boxes, paragraphs
from verification.theorems.learning import Dossier, claims_of, dossiers, examine, scores
from workbench.contracts import settings
from workbench.contracts.claim import expected_of
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import Verdict
from workbench.evidence import ppd
from workbench.trials.campaign import load, run

PROVED, SUPPORTED, REFUTED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED
T_MIN = 1900
LAWS = ("icfdl", "pd", "increment")
M, TS, G, LENGTH = 350_000.0, 0.1, 9.81, 140.0
GRADES = {"flat": [], "hilly": [(600, 6), (1100, -4), (1700, 3), (2300, -8), (3000, 0)]}
CLAIMS = {
    "A1": LAWS,
    "A2.printed": LAWS,
    "A2.lifted": LAWS,
    "A3": LAWS,
    "A4.printed": LAWS,
    "A4.partial": LAWS,
    "lemma1": LAWS,
    "lambda_min.partial": ("icfdl", "increment"),
    "lambda_min.realised": ("icfdl", "increment"),
    "monotone": LAWS,
    "increment_monotone": ("increment",),
    "increment_weighted": ("increment",),
    "theorem1": ("icfdl", "increment"),
}
METRICS = {
    "ppd_partial_min",
    "ppd_partial_max",
    "ppd_ratio_negative_share",
    "ppd_ratio_abs_max",
    "ppd_estimate_median_relative_error",
    "contraction_inside_share",
    "lambda_min_partial",
    "lambda_min_realised",
    "lipschitz_lifted",
}


class Ran:
    """The metro study as run with its defaults on a line, saved and loaded back; claims are judged once."""

    def __init__(self, folder: Path, line: str) -> None:
        self.line, self.file = line, folder / "run.nc"
        run(settings.assigned(STUDY, [f"plant.line={line}"]), show_progress=False).record(folder)
        self.campaign = load(self.file)
        self.files: dict[str, Dossier] = {d.controller: d for d in dossiers(self.campaign)}
        self.verdict = cache(self._verdict)
        self.scores = cache(lambda: scores(self.campaign, list(self.files.values())))

    def _verdict(self, claim: str, law: str) -> Verdict:
        return judge(next(c for c in claims_of(self.files[law]) if c.name == f"metro.{claim}"))

    def mse_always_reached(self, law: str) -> Any:
        error = self.campaign.data["error"].sel(controller=law).values[:, 1 : T_MIN + 1]
        return np.mean(error**2, axis=1)


@pytest.fixture(scope="module", params=["hilly", "flat"])
def ran(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Ran:
    return Ran(tmp_path_factory.mktemp(request.param), request.param)


def mean_grade(line: str, s: Any) -> Any:
    total, rear = 0.0 * s, s - LENGTH
    pieces = GRADES[line]
    for index, (start, grade) in enumerate(pieces):
        end = pieces[index + 1][0] if index + 1 < len(pieces) else math.inf
        total = total + grade * np.maximum(0.0, np.minimum(s, end) - np.maximum(rear, start))
    return total / LENGTH


def speeds(line: str, plans: Any, last: int) -> Any:
    """Run the train from rest under one plan a row, sample by sample; return its speeds at samples 0..last."""
    plans = np.atleast_2d(plans)
    v = s = np.zeros(len(plans))
    result = [v]
    for k in range(last):
        swing = math.sin(0.0037 * k)
        fb = 2977 + 275 * swing + (25.17 + 2.5 * swing) * v + (0.2864 + 0.04 * swing) * v * v
        fa = M * G * mean_grade(line, s) / 1000
        v, s = v + 3.6 * TS / M * (plans[:, k] - fa - fb), s + TS * v / 3.6
        result.append(v)
    return np.array(result).T


def signal(v: Any, k: int, law: str) -> Any:
    """Return what the law learns on at sample k + 1: the speed, or for ``increment`` its increment."""
    return v[..., k + 1] - v[..., k] if law == "increment" else v[..., k + 1]


class Recorded:
    """Nothing but what run.nc holds."""

    def __init__(self, file: Path) -> None:
        with xr.open_dataset(file, engine="h5netcdf") as opened:
            self.data = opened.load()
        self.settings = json.loads(self.data.attrs["settings"])
        self.line = self.settings["plant"]["line"]

    def plan(self, law: str, trial: int) -> Any:
        return self.data["input"].sel(controller=law, trial=trial).values[:-1]

    def difference(self, law: str, trial: int, k: int) -> tuple[float, float]:
        """Replay a trial and the one before; return du(k) and ds(k + 1)."""
        plans = np.stack([self.plan(law, trial - 1), self.plan(law, trial)])
        before, now = signal(speeds(self.line, plans, k + 1), k, law)
        return float(plans[1, k] - plans[0, k]), float(now - before)


STANDINGS = [
    # claim, law, on the hilly line, on the flat line
    ("A1", "icfdl", PROVED, PROVED),
    ("A2.printed", "icfdl", REFUTED, REFUTED),
    ("A2.printed", "increment", REFUTED, REFUTED),
    ("A2.lifted", "icfdl", PROVED, PROVED),
    ("A2.lifted", "increment", PROVED, PROVED),
    ("A3", "icfdl", SUPPORTED, SUPPORTED),
    ("A4.printed", "icfdl", REFUTED, REFUTED),
    ("A4.partial", "icfdl", PROVED, PROVED),
    ("A4.partial", "increment", PROVED, PROVED),
    ("lemma1", "icfdl", REFUTED, REFUTED),
    ("lambda_min.partial", "icfdl", PROVED, PROVED),
    ("lambda_min.partial", "increment", PROVED, PROVED),
    ("lambda_min.realised", "icfdl", REFUTED, REFUTED),
    ("theorem1", "icfdl", REFUTED, REFUTED),
    ("monotone", "icfdl", REFUTED, REFUTED),
    ("monotone", "increment", REFUTED, SUPPORTED),
    ("increment_monotone", "increment", REFUTED, PROVED),
    ("increment_weighted", "increment", PROVED, PROVED),
]


@pytest.mark.parametrize(("claim", "law", "hilly", "flat"), STANDINGS)
def test_standing(ran: Ran, claim: str, law: str, hilly: Standing, flat: Standing) -> None:
    verdict = ran.verdict(claim, law)
    assert verdict.standing is (hilly if ran.line == "hilly" else flat), verdict
    json.dumps(verdict.as_json(), allow_nan=False)


def test_the_claims_are_there(ran: Ran) -> None:
    found = {(claim.name, claim.controller) for claim in examine(ran.campaign).claims}
    assert {(f"metro.{name}", law) for name, laws in CLAIMS.items() for law in laws} <= found


@pytest.mark.parametrize("law", ["icfdl", "increment"])
def test_ratio_without_bound_replays(ran: Ran, law: str) -> None:
    """A2 as printed: one earlier input kept, du(k) ever smaller, and the ratio grows tenfold a step."""
    witness = json.loads(json.dumps(ran.verdict("A2.printed", law).as_json()))["witness"]
    record, k = Recorded(ran.file), witness["sample"]
    plan = record.plan(law, witness["trial"])
    plans = [plan]
    for du in witness["du"]:
        other = plan.copy()
        other[witness["earlier_sample"]] += witness["kept"]
        other[k] += du
        plans.append(other)
    reached = signal(speeds(record.line, np.array(plans), k + 1), k, law)
    ratios = np.abs(reached[1:] - reached[0]) / np.abs(witness["du"])
    np.testing.assert_allclose(ratios, witness["ratios"], rtol=1e-5)
    assert (ratios[-3:] > 8 * ratios[-4:-1]).all() and ratios[-1] > 1e6 * record_gain()
    largest = witness["largest_of_campaign"]
    du, ds = record.difference(law, largest["trial"], largest["sample"])
    assert ds / du == pytest.approx(largest["ratio"], rel=1e-3)


def record_gain() -> float:
    """The gain dv(k+1)/du(k) of the paper's equation (1), in km/h a newton."""
    return 3.6 * TS / M


@pytest.mark.parametrize("law", ["icfdl", "pd", "increment"])
def test_ratio_of_the_wrong_sign_replays(ran: Ran, law: str) -> None:
    witness = ran.verdict("A4.printed", law).as_json()["witness"]
    du, ds = Recorded(ran.file).difference(law, witness["trial"], witness["sample"])
    assert du == pytest.approx(witness["du"], rel=1e-12)
    assert ds == pytest.approx(witness["ds"], rel=1e-6, abs=1e-11)
    assert ds / du <= 0 and witness["partial"] == pytest.approx(record_gain(), rel=1e-12)


def test_factor_outside_replays(ran: Ran) -> None:
    """Theorem 1 and lambda_min: the factor from the recorded estimate, the replayed ratio and the settings."""
    record = Recorded(ran.file)
    law = record.settings["controllers"]["icfdl"]
    witness = ran.verdict("theorem1", "icfdl").as_json()["witness"]
    at = {"controller": "icfdl", "trial": witness["trial"], "sample": witness["sample"]}
    phi = float(record.data["ppd_estimate"].sel(at)) * law["force_unit"]
    du, ds = record.difference("icfdl", witness["trial"], witness["sample"])
    factor = 1 - law["rho"] * phi / (law["lam"] + phi**2) * ds / du * law["force_unit"]
    assert factor == pytest.approx(witness["factor"], rel=1e-6) and abs(factor) > 1
    witness = ran.verdict("lambda_min.realised", "icfdl").as_json()["witness"]
    du, ds = record.difference("icfdl", witness["trial"], witness["sample"])
    needed = (law["rho"] * ds / du * law["force_unit"]) ** 2 / 4
    assert needed == pytest.approx(witness["lambda_min"], rel=1e-6) and needed > law["lam"]


def test_row_that_outweighs_the_diagonal_replays(ran: Ran) -> None:
    """The sup norm of ``increment`` on the hilly line: the row of H by moving one input at a time."""
    if ran.line == "flat":
        return
    witness = ran.verdict("increment_monotone", "increment").as_json()["witness"]
    record, k, step = Recorded(ran.file), witness["sample"], 1.0
    plan = ran.files["increment"].wanted.u
    moved = plan + step * np.eye(k + 1, plan.size)
    back = plan - step * np.eye(k + 1, plan.size)
    row = np.subtract(*(signal(speeds(record.line, one, k + 1), k, "increment") for one in (moved, back))) / 2 / step
    assert abs(row[-1]) == pytest.approx(witness["b"], rel=1e-6)
    assert np.abs(row[:-1]).sum() == pytest.approx(witness["row_sum"], rel=1e-3)
    assert witness["row_sum"] > 5 * witness["b"]


@pytest.mark.parametrize("law", LAWS)
def test_claims_stand_as_is_expected(ran: Ran, law: str) -> None:
    if ran.line == "flat":  # what is written down is for the study as shipped
        return
    made = [claim.name.split(".", 1)[1] for claim in claims_of(ran.files[law]) if not claim.lacks]
    for name in made:
        meant = expected_of(EXPECTED, f"metro.{name}", law, "default")
        assert meant is not None and ran.verdict(name, law).standing is meant.standing, name


@pytest.mark.parametrize("law", LAWS)
def test_repaired_bound_holds_all_along(ran: Ran, law: str) -> None:
    """|ds(k+1)| <= p max over j <= k of |du(j)| for every two consecutive trials on record, with the p proved."""
    p = ran.verdict("A2.lifted", law).bound
    one = Recorded(ran.file).data.sel(controller=law)
    v = one["output"].values
    learned = np.diff(v, axis=1) if law == "increment" else v[:, 1:]
    du = np.abs(np.diff(one["input"].values[:, :-1], axis=0))
    share = np.abs(np.diff(learned, axis=0)) / np.maximum.accumulate(du, axis=1)
    observed = np.nanmax(np.where(du.max(axis=1, keepdims=True) > 1e-3, share, np.nan))
    assert p is not None and 0.3 * record_gain() < observed <= p
    along = ran.verdict("A2.lifted", law).witness
    assert along is not None and along["row_sum"] <= p


@pytest.mark.parametrize("law", LAWS)
def test_proof_box_holds_the_whole_run(ran: Ran, law: str) -> None:
    box = ran.files[law].box
    one = Recorded(ran.file).data.sel(controller=law)
    applied = one["input"].where(one["sample"] < one["trial_length"]).values
    met = {"speed": one["output"].values, "position": one["state_position"].values, "force": applied}
    (low_x, high_x), (low_u, high_u), (low_k, high_k) = box["x"], box["u"], box["k"]
    ends_of = {
        "speed": (low_x[0, 0], high_x[0, 0]),
        "position": (low_x[1, 0], high_x[1, 0]),
        "force": (low_u[0, 0], high_u[0, 0]),
    }
    for name, (low, high) in ends_of.items():
        assert low < np.nanmin(met[name]) and np.nanmax(met[name]) < high, name
    assert low_k[0, 0] <= 0 and high_k[0, 0] >= 1999  # the last step of a trial
    reference = one["reference"].values
    assert low_x[0, 0] < reference.min() and reference.max() < high_x[0, 0]
    assert TS / 3.6 * reference.sum() < high_x[1, 0]  # what the law converges to is inside as well


def test_scores(ran: Ran) -> None:
    found = ran.scores()
    assert set(found) == {"cfdl", *LAWS} and all(set(row) >= METRICS for row in found.values())
    for law in ("icfdl", "increment"):
        assert all(isinstance(found[law][name], float) for name in METRICS)
        assert found[law]["lambda_min_partial"] < ran.campaign.study.controllers[law].lam
        assert found[law]["lambda_min_realised"] > ran.campaign.study.controllers[law].lam
        for name in ("ppd_partial_min", "ppd_partial_max"):
            assert found[law][name] == pytest.approx(record_gain(), rel=1e-12)
    assert set(found["cfdl"].values()) == {None}  # refused: no trial was run
    bad, kept = (found[law]["ppd_ratio_negative_share"] for law in ("icfdl", "increment"))
    assert bad > 0.3 and kept < (bad / 20 if ran.line == "flat" else bad / 2)
    assert found["increment"]["contraction_inside_share"] > found["icfdl"]["contraction_inside_share"] + 0.2
    assert found["increment"]["lipschitz_lifted"] < found["icfdl"]["lipschitz_lifted"] / 100


def test_the_repaired_law_converges(ran: Ran) -> None:
    mse = ran.mse_always_reached("increment")
    assert mse[99] < (1e-9 if ran.line == "flat" else 1e-3)
    assert mse[99] < 1e-3 * ran.mse_always_reached("icfdl")[99]
    if ran.line == "flat":
        assert (np.diff(mse) < 0)[: int(np.argmax(mse < 1e-18))].all()


def test_samples_reached_rarely_converge_last(ran: Ran) -> None:
    """The sample that one trial in a hundred reaches still has an error when the always reached ones have none."""
    one = ran.campaign.data.sel(controller="increment")
    lengths, error = one["trial_length"].values, np.abs(one["error"].values)
    longest = np.flatnonzero(lengths >= 1990)
    assert 5 < longest.size < 30
    trial = longest[longest > 60][0]
    assert error[trial, 1985] > 10 * np.median(error[trial, 1 : T_MIN + 1])


@pytest.mark.parametrize("law", ["icfdl", "increment"])
def test_conclusion_says_what_stands(ran: Ran, law: str) -> None:
    named = [claim for claim in claims_of(ran.files[law]) if claim.name.split(".", 1)[1] in CLAIMS]
    claims = [claim for claim in named if not claim.lacks]
    said = " ".join(paragraphs([ran.files[law]], [ran.verdict(c.name.split(".", 1)[1], law) for c in claims]))
    assert law in said and "A2.printed" in said and "A4.printed" in said
    if law == "increment":
        assert ("the largest input error provably never grows" in said) == (ran.line == "flat")
        assert ("while trials stay in the box a weighted input error provably" in said) == (ran.line == "hilly")
    (table,) = boxes([ran.files[law]])
    assert [len(row) for row in table.rows] == [len(table.header)] == [5]


@pytest.fixture(scope="module")
def estimating() -> Any:
    """Evidence of ``increment`` alone by line, mu and eps."""

    @cache
    def made(line: str, mu: float, eps: float) -> ppd.Evidence:
        changes = [f"plant.line={line}", f"controllers.increment.mu={mu}", f"controllers.increment.eps={eps}"]
        study = settings.assigned(STUDY, [*changes, "trials=100"])
        alone = dataclasses.replace(study, controllers={"increment": study.controllers["increment"]}, sweeps=())
        return ppd.evidence(run(alone, show_progress=False), "increment")

    return made


PUBLISHED, SHARP = (0.1, 1e-5), (1e-4, 1e-7)
ACCURACY = [
    # line, mu and eps, trials, median relative error of the estimate between
    ("flat", PUBLISHED, slice(0, 100), 0.30, 0.32),
    ("hilly", PUBLISHED, slice(0, 100), 0.20, 0.32),
    ("hilly", SHARP, slice(29, 30), 0.0, 0.08),
    ("hilly", SHARP, slice(29, 60), 0.0, 0.08),
    ("flat", SHARP, slice(29, 30), 0.20, 0.30),
]


@pytest.mark.parametrize(("line", "how", "trials", "low", "high"), ACCURACY)
def test_accuracy_of_the_estimate(estimating, line, how, trials, low, high):
    found = estimating(line, *how)
    assert low <= float(np.nanmedian(found.relative_error()[trials])) <= high


def test_published_mu_leaves_the_estimate_at_its_start(estimating):
    """phi(k,1) = sqrt(lambda) is 31 % below b: with no excitation the estimate keeps that distance."""
    found = estimating("flat", *PUBLISHED)
    start = abs(math.sqrt(found.law.lam) / found.law.force_unit / record_gain() - 1)
    assert start == pytest.approx(0.3125, abs=1e-4)
    assert float(np.nanmedian(found.relative_error()[29])) == pytest.approx(start, abs=0.01)
    assert float(np.nanmedian(convergence.adaptation(found).share[29])) < 1e-3


def test_decomposition_explains_the_flat_line(estimating):
    """What earlier inputs carried over sets how far the realised ratio, which the estimate follows, is from b."""
    carried, off = {}, {}
    for line in ("hilly", "flat"):
        found = estimating(line, *SHARP)
        own = np.abs(found.partial_midway * found.du)[29]
        carried[line] = float(np.nanmedian(np.abs(found.carried[29]) / (np.abs(found.carried[29]) + own)))
        off[line] = float(np.nanmedian(np.abs(found.ratio / found.partial - 1)[29]))
        # grades begin and end in kinks, so the hilly line leaves more to no linearisation than drag does
        left = float(np.nanmax(np.abs(found.remainder[29])) / np.nanmax(np.abs(found.ds[29])))
        assert left < (0.1 if line == "hilly" else 1e-3)
    assert carried["flat"] > 0.15 and off["flat"] > 0.15
    assert carried["hilly"] < 0.06 and off["hilly"] < 0.06


def test_reset_returns_the_estimate_as_trials_converge(estimating):
    """By trial 100 du lies below eps nearly everywhere on the flat line: (13) puts phi back to phi(k,1)."""
    found = estimating("flat", *PUBLISHED)
    idle = convergence.adaptation(found).reset_idle[99]
    assert float(idle[np.isfinite(found.du[99])].mean()) > 0.95
    assert float(np.nanmedian(found.relative_error()[99])) == pytest.approx(0.3125, abs=1e-3)


FREE = "controllers.increment.phi_range=[1e-9, 1e9]"


def test_noise_biases_an_estimate_without_ends_until_learning_stalls():
    """With speed noise of 0.05 km/h the data say dz/du = 1/l > 4 phi: phi runs away, which a large mu or ends mend."""

    def made(*changes: str) -> tuple[float, float]:
        study = settings.assigned(STUDY, ["noise.speed_sigma=0.05", *changes])
        alone = dataclasses.replace(study, controllers={"increment": study.controllers["increment"]}, sweeps=())
        data = run(alone, show_progress=False).data.isel(controller=0)
        mse = np.mean(data["error"].values[:, 1 : T_MIN + 1] ** 2, axis=1)
        return float(np.median(mse[100:])), float(np.median(data["ppd_estimate"].values[-1, :T_MIN])) / record_gain()

    spoilt, runaway = made(FREE)
    assert spoilt > 50 and runaway > 50
    filtered, _ = made(FREE, "controllers.increment.q_cutoff_hz=0.5")
    assert filtered < spoilt / 10
    too_low, _ = made(FREE, "controllers.increment.q_cutoff_hz=0.03")
    assert too_low > 5 * filtered
    deaf, kept = made(FREE, "controllers.increment.mu=1e4")
    assert deaf < 1e-2 and 0.6 < kept < 1
    held, most = made()
    assert held < 1e-3 * spoilt and most < 3
    page = " ".join((Path(__file__).resolve().parents[2] / "docs" / "increment.md").read_text().split())
    for said in (
        f"it is {runaway:.0f} b after 150 trials",
        f"stalls (MSE {spoilt:.0f},",
        f"3 phi(k,1): MSE {held:.3f}.",
        f"(mu = 1e4: MSE {deaf:.1e},",
        f"0.5 Hz: MSE {filtered:.1f},",
        f"0.03 Hz: MSE {too_low:.0f})",
    ):
        assert said in page, said
