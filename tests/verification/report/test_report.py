"""What ``workbench verify`` writes, from a hand-made examination of a small study."""

from __future__ import annotations

import dataclasses
import html.parser
import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest

from models.quantity import InvalidValue
from verification import Claim, Finding, Standing
from verification.decide.judge import judge
from verification.decide.verify import verify_cases
from verification.report.listing import tally, verdict_table
from verification.report.words import shown, shown_value
from verification.report.write import all_scores, write

EVIL = "<script>alert('a&b')</script>"
FILES = {"run.nc", "provenance.json", "scores.json", "verdicts.json", "verdicts.xml", "report.html", "figures"}


@pytest.fixture
def report(lag_report: Any) -> Any:
    return lag_report


@pytest.fixture
def folder(lag_folder: Path) -> Path:
    return lag_folder


class Page(html.parser.HTMLParser):
    """The elements, their attributes and the text of a page."""

    VOID: ClassVar = {"meta", "img", "br", "wbr"}

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"{tag} closes what it did not open"

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture
def page(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_everything_is_written(folder: Path) -> None:
    assert {entry.name for entry in folder.iterdir()} == FILES
    assert {"evidence_x.svg", "evidence_x.png", "mse.svg", "mse.png"} <= {
        f.name for f in (folder / "figures").iterdir()
    }


def test_verdicts_json(folder: Path) -> None:
    *verdicts, last = json.loads((folder / "verdicts.json").read_text())
    before = {"claim", "case", "controller", "statement", "source", "standing", "margin", "unit", "witness", "method"}
    besides = {"role", "scope", "premises", "expected", "because", "published", "measured", "evidence", "replayed"}
    assert all(before | besides <= one.keys() for one in verdicts)
    assert {one["case"] for one in verdicts} == {"default"}
    assert [one["standing"] for one in verdicts] == ["PROVED", "SUPPORTED", "REFUTED", "UNDECIDED", "UNDECIDED"]
    assert verdicts[0]["controller"] is None and verdicts[0]["margin"] == 1.5e-6
    assert verdicts[2]["witness"]["trial"] == 2 and len(verdicts[2]["witness"][EVIL]) == 2000
    assert verdicts[2]["witness"]["bad"] is None
    assert "RuntimeError" in verdicts[4]["method"] and EVIL not in verdicts[4]["method"]
    assert last["standing"] is None and last["not_made"] == f"a horizon {EVIL}" and last["claim"] == "lag.A5"


def test_scores_json_is_merged(folder: Path, report: Any) -> None:
    content = json.loads((folder / "scores.json").read_text())
    assert content["study"] == report.campaign.study.name
    scores = content["scores"]
    assert scores["icfdl"]["extra"] == 0.25 and scores["icfdl"]["worse"] is None and scores["other"] == {"extra": 1.0}
    for controller, metrics in report.campaign.scores().items():
        assert {name: scores[controller][name] for name in metrics} == metrics
    assert all_scores(report) == content["scores"]


def test_junit(folder: Path, report: Any) -> None:
    root = ET.fromstring((folder / "verdicts.xml").read_bytes())
    assert root.tag == "testsuites"
    [suite] = root
    assert suite.tag == "testsuite" and suite.get("name") == report.campaign.study.name
    for element in (root, suite):
        assert (element.get("tests"), element.get("failures"), element.get("errors")) == ("5", "0", "2")
    properties, *cases = suite
    assert {one.get("name"): one.get("value") for one in properties}["claims not made"] == "1"
    assert [case.get("name") for case in cases] == [
        "lag.A1", "lag.A2[icfdl]", f"lag.A2[{EVIL}]", "lag.A3[icfdl]", "lag.A4",
    ]  # fmt: skip
    assert {case.get("classname") for case in cases} == {report.campaign.study.name}
    assert [[inner.tag for inner in case] for case in cases] == [
        ["system-out"], ["system-out"], ["properties", "system-out"], ["error"], ["error"],
    ]  # fmt: skip
    told, text = cases[2]
    assert {one.get("name"): one.get("value") for one in told} == {"expected": "REFUTED", "because": f"a slip {EVIL}"}
    assert "margin: -2" in text.text and '"trial": 2' in text.text
    open_, crashed = cases[3][0], cases[4][0]
    assert open_.get("message") == "UNDECIDED: budget spent"
    assert crashed.get("type") == "UNDECIDED" and "expected PROVED because by hand" in crashed.get("message")


def test_junit_has_only_what_build_servers_know(folder: Path) -> None:
    known = {
        "testsuites": {"name", "time", "tests", "failures", "errors"},
        "testsuite": {"name", "time", "tests", "failures", "errors", "skipped"},
        "properties": set(),
        "property": {"name", "value"},
        "testcase": {"name", "classname", "time"},
        "failure": {"message", "type"},
        "error": {"message", "type"},
        "skipped": {"message"},
        "system-out": set(),
    }
    for element in ET.parse(folder / "verdicts.xml").iter():
        assert set(element.attrib) == known[element.tag]


def test_notebook_shows_the_verdicts_escaped(report: Any) -> None:
    shown_page = Page(report._repr_html_())
    assert not shown_page.open and not shown_page.all("script")
    assert len(shown_page.all("tr")) == 6
    assert "✗ REFUTED" in shown_page.text and "5 verdicts" in shown_page.text
    assert "? UNDECIDED (departs)" in shown_page.text and "REFUTED (departs)" not in shown_page.text
    assert "departs: lag.A4, case default: expected PROVED because by hand" in shown_page.text


def test_report_saves_itself(report: Any, tmp_path: Path) -> None:
    assert {entry.name for entry in report.save(tmp_path / "out").iterdir()} == FILES


def test_page_has_the_verdicts(page: Page) -> None:
    rows = [row.get("class") for row in page.all("tr") if row.get("class")]
    rows = [row for row in rows if row in list(Standing)]
    assert rows == ["PROVED", "SUPPORTED", "REFUTED", "UNDECIDED", "UNDECIDED"]
    for expected in (
        "✓ PROVED", "✗ REFUTED", "1.5·10⁻⁶ m/N", "−2 <script>", "trial2", "box(x = [0, 1])", "budget spent",
        "[0, 1, 2, …, 1999] (2000 values)", "5 claims <script>", "Do nothing.", "Equations of the plant",
        "1 ✓ PROVED", "2 ? UNDECIDED", "learning-control-workbench", "(the figure broken) ValueError: nothing to draw",
    ):  # fmt: skip
        assert expected in page.text, expected


def test_page_has_what_a_verdict_rests_on(page: Page) -> None:
    for expected in (
        "Role: repaired".replace(": ", ""), f"x{EVIL} in [−1, 2] m; n in [0, ∞)", "0.25 1/s",
        "held against 149 trials and plans, least room 0.125 1/s; no second program has checked this proof",
        f"≈ SUPPORTED lag.first holds {EVIL} lag.first", "the witness was replayed, with the margin −2",
        f"Expected to be REFUTEDa slip {EVIL}", f"Published3 mm {EVIL}", "Roleas printed",
        f"Departsexpected PROVED because by hand {EVIL}, found UNDECIDED",
        "Claims that were not made, for want of a property: 1", f"icfdl lacks a horizon {EVIL}: lag.A5 lag.A5 holds",
    ):  # fmt: skip
        assert expected in page.text, expected


def test_what_departs_stands_on_top(page: Page) -> None:
    top, _, rest = page.text.partition("Verdicts at a glance")
    assert f"lag.A4, case default: expected PROVED because by hand {EVIL}, found UNDECIDED" in top
    assert "lag.A2" not in top.partition("What departs")[2] and rest.count("departs") == 2  # a glance, a row


def test_page_has_settings_tables_scores_and_figures(page: Page, report: Any) -> None:
    for expected in (
        "plant.gain_1",
        "controllers.icfdl.lam",
        "(0, ∞)",
        "gain <b>bold</b>",
        "extra",
        "mse_last",
        "Table",
    ):
        assert expected in page.text, expected
    images = page.all("img")
    assert len(images) == 1 + len(report.campaign.figures())
    for image in images:
        assert image["alt"] and str(image["src"]).startswith("data:image/")
        assert int(str(image["width"])) > 100 and int(str(image["height"])) > 100


def test_page_is_accessible_and_closed(page: Page) -> None:
    assert not page.open
    assert page.all("html")[0]["lang"] == "en"
    assert all(header.get("scope") in ("col", "row") for header in page.all("th"))
    assert len(page.all("h1")) == 1 and len(page.all("title")) == 1
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(set(ids)) == len(ids)
    for link in page.all("a"):
        assert str(link["href"]).removeprefix("#") in ids


def test_page_fetches_and_runs_nothing(page: Page) -> None:
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"script", "link", "iframe", "object", "embed", "form", "base", "b"}
    for tag, attributes in page.elements:
        assert not [name for name in attributes if name.startswith("on")], tag
        for name in ("src", "href", "data", "srcset"):
            assert str(attributes.get(name, "#")).startswith(("#", "data:image/"))
    policy = [meta["content"] for meta in page.all("meta") if meta.get("http-equiv") == "Content-Security-Policy"]
    assert policy == ["default-src 'none'; style-src 'unsafe-inline'; img-src data:"]


def test_same_report_same_bytes(report: Any, folder: Path, tmp_path: Path) -> None:
    again = write(report, tmp_path / "again")
    for name in ("report.html", "verdicts.json", "verdicts.xml", "scores.json", "figures/mse.svg", "figures/mse.png"):
        assert (again / name).read_bytes() == (folder / name).read_bytes(), name


def test_all_or_nothing(report: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out"
    write(report, target)
    before = {file: file.read_bytes() for file in target.rglob("*") if file.is_file()}

    def broken(*_: Any) -> str:
        raise RuntimeError("planted")

    monkeypatch.setattr("verification.report.write.html", broken)
    changed = dataclasses.replace(report, verdicts=report.verdicts[:1])
    with pytest.raises(RuntimeError, match="planted"):
        write(changed, target)
    assert {file: file.read_bytes() for file in target.rglob("*") if file.is_file()} == before
    with pytest.raises(RuntimeError, match="planted"):
        write(changed, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_unwritable_folder_is_bad_input(report: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidValue, match="must be writable"):
        write(report, tmp_path / "file" / "below")


def test_study_without_figures_and_without_claims(report: Any, tmp_path: Path) -> None:
    study = dataclasses.replace(report.campaign.study, name="bare", drawings=lambda study, data: {})
    campaign = dataclasses.replace(report.campaign, study=study)
    bare = dataclasses.replace(report, campaign=campaign, verdicts=(), figures={}, tables=(), scores={})
    page = Page((write(bare, tmp_path) / "report.html").read_text())
    assert "No claim was examined." in page.text and not page.all("img")


@pytest.fixture(scope="session")
def cases_folder(lag_report: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with two further cases, one of which is heavier to reach than the other."""
    study = dataclasses.replace(
        lag_report.campaign.study,
        name="lag",
        cases={"quick": {"plant.gain_1": 0.75}, "again-longer": {"trials": 5, "controllers.icfdl.rho": 0.5}},
        claims=(gain_of_the_case,),
    )
    draft = tmp_path_factory.mktemp("cases")
    verify_cases(study, draft, show_progress=False)
    return draft


def gain_of_the_case(study: Any, data: Any) -> list[Claim]:
    """Say what the gain is: SUPPORTED, with it as margin."""
    return [
        Claim(
            name="lag.gain",
            statement="the gain is there",
            source="ours",
            check=lambda: Finding(method="read", margin=study.plant.gain_1, unit="m/N"),
        )
    ]


def test_every_case_has_its_files_and_its_verdicts(cases_folder: Path) -> None:
    every = {"run.nc", "provenance.json", "scores.json", "figures"}
    whole = {"verdicts.json", "verdicts.xml", "report.html", "cases"}
    assert {entry.name for entry in cases_folder.iterdir()} == every | whole
    assert {entry.name for entry in (cases_folder / "cases").iterdir()} == {"quick", "again-longer"}
    for case, trials, gain in (("", 4, 0.5), ("cases/quick", 4, 0.75), ("cases/again-longer", 5, 0.5)):
        folder = cases_folder / case
        assert every <= {entry.name for entry in folder.iterdir()}
        settings = json.loads((folder / "scores.json").read_text())["settings"]
        assert (settings["trials"], settings["plant"]["gain_1"]) == (trials, gain)
        assert (folder / "figures" / "mse.svg").is_file()
    verdicts = json.loads((cases_folder / "verdicts.json").read_text())
    gains = {one["case"]: one["margin"] for one in verdicts if one["claim"] == "lag.gain"}
    assert gains == {"default": 0.5, "quick": 0.75, "again-longer": 0.5}
    classes = {case.get("classname") for case in ET.parse(cases_folder / "verdicts.xml").iter("testcase")}
    assert classes == {"lag", "lag.quick", "lag.again-longer"}


def test_the_page_has_a_section_a_case(cases_folder: Path) -> None:
    page = Page((cases_folder / "report.html").read_text(encoding="utf-8"))
    told = json.loads((cases_folder / "verdicts.json").read_text())
    verdicts = [one for one in told if one["standing"]]
    assert not page.open
    assert len([row for row in page.all("tr") if row.get("class")]) == len(verdicts)
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(set(ids)) == len(ids)
    assert {"case-quick-case", "case-again-longer-case", "verdict-1", f"verdict-{len(verdicts)}"} <= set(ids)
    for link in page.all("a"):
        assert str(link["href"]).removeprefix("#") in ids
    spoken = [one["aria-label"] for _, one in page.elements if "aria-label" in one and one["aria-label"] != "Signals"]
    assert len(set(spoken)) == len(spoken)
    for expected in ("plant.gain_1 = 0.75", "trials = 5", "Its files are in cases/quick/", "As declared."):
        assert expected in page.text, expected


def test_one_case_alone_stands_at_the_top(lag_report: Any, tmp_path: Path) -> None:
    study = dataclasses.replace(
        lag_report.campaign.study,
        name="lag",
        cases={"quick": {"plant.gain_1": 0.75}},
        claims=(gain_of_the_case,),
    )
    found = verify_cases(study, tmp_path, only="quick", show_progress=False)
    assert {verdict.case for verdict in found.all_verdicts} == {"quick"} and not (tmp_path / "cases").exists()
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "Case quick : plant.gain_1 = 0.75" in page.text.replace("quick:", "quick :")
    assert verdict_table(found)[0][:4] == ("claim", "controller", "standing", "margin")
    with pytest.raises(InvalidValue, match="there is no case 'slow' of lag; its cases are: default, quick"):
        verify_cases(study, tmp_path, only="slow", show_progress=False)


def test_the_terminal_names_the_case_where_there_are_several(report: Any) -> None:
    other = dataclasses.replace(report, verdicts=[dataclasses.replace(report.verdicts[0], case="quick")])
    several = dataclasses.replace(report, cases={"quick": other})
    table = verdict_table(several)
    assert table[0] == ("case", "claim", "controller", "standing", "margin", "")
    assert table[1][:2] == ("default", "lag.A1") and table[-1][:2] == ("quick", "lag.A1")
    assert tally(several).startswith("6 verdicts")


def test_plant_that_cannot_be_typeset_keeps_its_verdicts(report: Any, tmp_path: Path) -> None:
    class Opaque(type(report.campaign.study.plant)):
        def output(self, x: Any) -> Any:
            raise RuntimeError(EVIL)

    study = dataclasses.replace(report.campaign.study, name="lag")
    object.__setattr__(study, "plant", Opaque())
    campaign = dataclasses.replace(report.campaign, study=study)
    page = Page((write(dataclasses.replace(report, campaign=campaign), tmp_path) / "report.html").read_text())
    assert "could not be typeset: RuntimeError: <script>" in page.text
    assert len([row for row in page.all("tr") if row.get("class")]) == 5


def test_terminal_table(report: Any) -> None:
    assert verdict_table(report)[1] == ("lag.A1", "-", "PROVED", "1.5e-06 m/N", "")
    assert [row[-1] for row in verdict_table(report)[1:]] == ["", "", "", "", "departs"]
    assert tally(report) == "5 verdicts: 1 PROVED, 1 SUPPORTED, 1 REFUTED, 2 UNDECIDED; 1 claim not made"


def test_terminal_table_has_no_word_for_what_is_no_number(report: Any) -> None:
    one = dataclasses.replace(report.verdicts[0], margin=float("-inf"))
    assert verdict_table(dataclasses.replace(report, verdicts=[one]))[1][3] == "not finite m/N"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (-0.0, "0"),
        (-1.23456, "−1.235"),
        (1.5e-7, "1.5·10⁻⁷"),
        (-2e10, "−2·10¹⁰"),
        (float("nan"), "not finite"),
    ],
)
def test_numbers_as_shown(value: float | None, text: str) -> None:
    assert shown(value) == text


def test_values_as_shown() -> None:
    assert shown_value(np.float64(0.5)) == "0.5" and shown_value(True) == "true" and shown_value(-3) == "−3"
    assert shown_value(None) == "none" and shown_value([]) == "[]" and shown_value({"a": (1, "b")}) == "(a = [1, b])"


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (np.int64(3), 3),
        (np.array([1.0, np.inf]), [1.0, None]),
        ({1: (True, None)}, {"1": [True, None]}),
        (ca.DM(0.5), 0.5),
        (ca.DM([1, 2]), "[1, 2]"),
        (1 + 2j, "(1+2j)"),
        (Path("a"), "a"),
    ],
)
def test_any_witness_is_kept(value: Any, kept: Any) -> None:
    finding = Finding(holds=False, method="m", witness={"value": value})
    found = judge(Claim(name="a", statement="s", source="s", check=lambda: finding)).as_json()
    assert found["witness"] == {"value": kept}
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("value", [len, ca.Function("f", [], []), {"slope": [1.0, len]}])
def test_a_function_is_no_witness(value: Any) -> None:
    with pytest.raises(ValueError, match="a witness holds values, got the function"):
        Finding(holds=True, method="m", witness={"value": value})
