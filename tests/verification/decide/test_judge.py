"""The judge: premises, weakest links, replays, and what nobody may write by hand."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from models.quantity import InvalidValue
from verification.decide.judge import Judge, judge
from workbench.contracts.claim import Claim, Held
from workbench.contracts.finding import Finding, Grounds, Standing, undecided
from workbench.contracts.verdict import NotMade

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
ROOT = Path(__file__).parents[3]


def claim(finding, **more):
    check = finding if callable(finding) else lambda: finding
    return Claim(**{"name": "s.c", "statement": "c", "source": "ours", "check": check, **more})


GOOD = Finding(grounds=Grounds.SETTINGS, margin=1.0, method="good")
SEEN = Finding(grounds=Grounds.RUN, margin=1.0, method="seen")
BAD = Finding(grounds=Grounds.SETTINGS, margin=-1.0, method="bad", witness={"a": 1})
OPEN = undecided("open")


@pytest.mark.parametrize(
    ("grounds", "margin", "weak", "standing"),
    [
        *((one, 1.0, False, PROVED) for one in Grounds if one.proves),
        *((one, 1.0, False, SUPPORTED) for one in Grounds if not one.proves),
        *((one, -1.0, False, REFUTED) for one in Grounds),
        (Grounds.ENCLOSURE, 0.0, False, REFUTED),
        (Grounds.ENCLOSURE, 0.0, True, PROVED),
        (Grounds.ENCLOSURE, float("nan"), False, UNDECIDED),
        (Grounds.RUN, None, False, UNDECIDED),
    ],
)
def test_a_standing_follows_from_grounds_and_margin(grounds, margin, weak, standing):
    assert Finding(grounds=grounds, margin=margin, weak=weak, witness={"a": 1}).standing is standing


PREMISES = [
    # premises, what rests on besides, the conclusion's own finding, how it stands in the end
    ([], [], GOOD, PROVED),
    ([GOOD], [], GOOD, PROVED),
    ([GOOD, SEEN], [], GOOD, SUPPORTED),
    ([GOOD, OPEN], [], GOOD, UNDECIDED),
    ([BAD], [], GOOD, UNDECIDED),
    ([BAD], [], BAD, UNDECIDED),  # the theorem does not apply: it is not refuted
    ([OPEN], [], BAD, UNDECIDED),  # nor where it may not apply
    ([GOOD], [], BAD, REFUTED),
    ([SEEN], [], BAD, REFUTED),
    ([], [BAD], GOOD, UNDECIDED),
    ([], [OPEN], GOOD, UNDECIDED),
    ([], [SEEN], GOOD, SUPPORTED),
    ([], [OPEN], BAD, REFUTED),  # a refutation that is replayed needs nothing besides
]


@pytest.mark.parametrize(("premises", "rests_on", "own", "standing"), PREMISES)
def test_a_conclusion_is_at_most_as_strong_as_its_premises(premises, rests_on, own, standing):
    made = [[claim(one, name=f"s.p{i}") for i, one in enumerate(group)] for group in (premises, rests_on)]
    found = judge(claim(own, premises=made[0], rests_on=made[1]))
    assert found.standing is standing
    if BAD in premises:
        assert found.method.startswith("the theorem does not apply: bad")
    assert len(found.premises) >= len(premises)


def test_a_premise_is_looked_at_once():
    looked = []

    def check():
        looked.append(1)
        return GOOD

    shared = claim(check, name="s.p")
    one = Judge()
    for name in ("s.a", "s.b"):
        one.verdict(claim(GOOD, name=name, premises=[shared]))
    assert len(looked) == 1


def test_a_check_is_not_done_where_the_theorem_does_not_apply():
    def never():
        raise AssertionError("it was done")

    assert judge(claim(never, premises=[claim(BAD, name="s.p")])).standing is UNDECIDED


REPLAYS = [
    # what the replay gives, whether the refutation stands
    (-0.5, True),
    (0.5, False),
    (0.0, True),
    (float("nan"), False),
]


@pytest.mark.parametrize(("margin", "stands"), REPLAYS)
def test_a_refutation_stands_only_if_its_witness_refutes_again(margin, stands):
    met = []

    def replay(witness):
        met.append(witness)
        return margin

    found = judge(claim(BAD, replay=replay))
    assert (found.standing is REFUTED) == stands and met == [{"a": 1}]
    assert found.replayed == (margin if stands else None)
    assert stands or "when it was replayed" in found.method


def test_a_replay_that_cannot_be_done_says_why():
    def replay(witness):
        raise InvalidValue("the witness has no place")

    found = judge(claim(BAD, replay=replay))
    assert found.standing is UNDECIDED and "the witness has no place" in found.method


def test_what_a_run_refutes_is_looked_at_on_another_run():
    seen = Finding(grounds=Grounds.RUN, margin=-1.0, witness={"a": 1})
    for other, standing in ((seen, REFUTED), (SEEN, UNDECIDED)):
        found = Judge(again=lambda one, other=other: other).verdict(claim(seen))
        assert found.standing is standing


def test_a_claim_without_a_meaning_is_not_made():
    found = Judge().verdict(claim(GOOD, lacks="a second output"))
    assert isinstance(found, NotMade) and found.as_json()["not_made"] == "a second output"
    assert found.as_json()["standing"] is None


def test_what_is_proved_says_against_how_much_it_was_held():
    found = judge(claim(GOOD, attack=lambda finding: Held(120, 0.25, {"trial": 3})))
    assert found.standing is PROVED
    assert found.as_json()["evidence"] == {
        "grounds": "settings",
        "checked": False,
        "held_against": 120,
        "least_room": 0.25,
    }


def _calls():
    for room in ("verification", "studies"):
        for file in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding":
                    yield file, node


def test_nobody_writes_a_standing_a_margin_or_an_answer_by_hand():
    assert sum(1 for _ in _calls()) > 50
    for file, node in _calls():
        for word in node.keywords:
            value = word.value.operand if isinstance(word.value, ast.UnaryOp) else word.value
            by_hand = word.arg == "standing" or (word.arg in ("margin", "holds") and isinstance(value, ast.Constant))
            assert not by_hand, f"{file}:{node.lineno} gives {word.arg} by hand"
