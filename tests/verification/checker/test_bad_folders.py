"""What is no folder of certificates: one line each that says what is wrong, exit 2, and no hang."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path

import pytest
from forging import Drawn, Forged, bounds, claim, coordinate, h, hashed, numbers, shown

from verification.checker.reading import FORMAT, LARGEST

ROOT = Path(__file__).parents[3]
SECONDS = 120
"""Within which a folder must be refused; no clock is asserted, a hang ends the run."""


def graph() -> Drawn:
    g = Drawn({"x": ["x"]})
    return g.gives("y", g.put("sin", g.at["x"]))


def honest() -> Forged:
    return bounds(graph().content, [coordinate("x", 0, 1)], [claim("at least", -0.5)], [["m"]])


def written(place: Path, *ones: Forged, index: object = None) -> Path:
    """Write a folder as the program that makes certificates does."""
    for kind in ("graphs", "proofs"):
        (place / kind).mkdir(parents=True, exist_ok=True)
    for one in ones:
        for (kind, name), content in one.files().items():
            (place / kind / f"{name}.json").write_text(json.dumps(content))
    entries = [entry(one.name) for one in ones]
    (place / "index.json").write_text(json.dumps({"format": FORMAT, "claims": entries} if index is None else index))
    return place


def entry(name: str, sentence: str = "", claim: str = "a.b") -> dict:
    return {"claim": claim, "case": "default", "controller": None, "certificate": name, "sentence": sentence}


def checked(*places: Path | str) -> subprocess.CompletedProcess[str]:
    """Run the checker on folders."""
    return subprocess.run(
        [sys.executable, "-m", "verification.checker", *map(str, places)], cwd=ROOT, capture_output=True,
        text=True, timeout=SECONDS, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False,
    )  # fmt: skip


def refused(answer: subprocess.CompletedProcess[str], says: str) -> None:
    """Assert that there is one line about what is wrong, and exit 2."""
    lines = [line for line in (answer.stdout + answer.stderr).splitlines() if not line.endswith("claims accepted")]
    assert answer.returncode == 2, answer
    assert len(lines) == 1 and "Traceback" not in lines[0] and len(lines[0]) < 700, answer
    assert re.search(says, lines[0]), lines[0]


def file_of(place: Path, one: Forged, kind: str = "proofs") -> Path:
    name = one.name if kind == "proofs" else hashed(one.graphs[0])
    return place / kind / f"{name}.json"


def test_an_honest_folder_is_accepted(tmp_path):
    one = honest()
    said = sha256(shown(one).sentence.encode()).hexdigest()
    place = written(tmp_path, one, index={"format": FORMAT, "claims": [entry(one.name, said)]})
    answer = checked(place)
    assert answer.returncode == 0 and answer.stdout.startswith("ACCEPTED a.b [default]: Of the graph"), answer
    other = bounds(graph().content, [coordinate("x", 0, 1)], [claim("at least", -1.0)], [["m"]])
    refused(checked(written(tmp_path / "other", one, other, index={"format": FORMAT, "claims": [
        entry(other.name, said)]})), "must say what its certificate shows")  # fmt: skip


INDEXES = [
    ("[]", "a record of format, claims"),
    ("{}", "a record of format, claims"),
    ('{"format": "workbench-certificate 1", "claims": []}', "there is no claim"),
    ('{"format": "workbench-certificate 2", "claims": []}', "the format must be"),
    ('{"format": "workbench-certificate 1", "claims": [', "must hold JSON"),
    ('{"format": "workbench-certificate 1", "format": "workbench-certificate 1", "claims": []}', "once"),
    ('{"format": "workbench-certificate 1", "claims": NaN}', "must hold JSON"),
    ('{"format": "workbench-certificate 1", "claims": 1e999999}', "a list"),
    ('{"format": "workbench-certificate 1", "claims": ' + "9" * 10_000 + "}", "must hold JSON"),
    ("[" * 200_000, "must hold JSON"),
    ("[" * 900 + "]" * 900, "a record"),
    ('{"a":' * 5_000 + "1" + "}" * 5_000, "must hold JSON|a record"),
    ("\ufeff{}", "must hold JSON|a record"),
    ("", "must hold JSON"),
    ("\x00\xff", "must hold JSON"),
    (json.dumps({"format": FORMAT, "claims": [{"claim": "a"}]}), "a record of claim"),
    (json.dumps({"format": FORMAT, "claims": [entry("\ud800")]}), "REJECTED|a name of one line"),
    (json.dumps({"format": FORMAT, "claims": [entry("0" * 64)]}), "REJECTED.*must be a file"),
    (json.dumps({"format": FORMAT, "claims": [entry("../../etc/passwd")]}), "letters and digits"),
    (json.dumps({"format": FORMAT, "claims": [entry("a" * 390)]}), "must be a file"),
    (json.dumps({"format": FORMAT, "claims": [entry("a" * 4000)]}), "one line"),
    (json.dumps({"format": FORMAT, "claims": [entry("")]}), "letters and digits"),
    (json.dumps({"format": FORMAT, "claims": [entry("0", claim="two\nlines")]}), "one line"),
    (json.dumps({"format": FORMAT, "claims": [entry("0", claim="\ud800")]}), "one line"),
]


@pytest.mark.parametrize(("text", "says"), INDEXES, ids=range(len(INDEXES)))
def test_an_index_that_is_none(tmp_path, text, says):
    (tmp_path / "index.json").write_text(text, errors="surrogatepass")
    refused(checked(tmp_path), says)


def test_a_place_that_is_no_folder(tmp_path):
    refused(checked(tmp_path / "nowhere"), "a folder of certificates must be named")
    (tmp_path / "file").write_text("x")
    refused(checked(tmp_path / "file"), "a folder of certificates must be named")
    refused(checked(tmp_path), "index.json must be a file")
    refused(checked(), "usage")
    (tmp_path / "index.json").mkdir()
    refused(checked(tmp_path), "index.json must be a file")


def vast(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2 * 2**30)


def endless(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def waiting(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def replaced(before: str, after: str):
    def change(path: Path) -> None:
        assert before in path.read_text()
        path.write_text(path.read_text().replace(before, after))

    return change


FILES = [
    ("proofs", vast, "at most"), ("graphs", vast, "at most"), ("index", vast, "at most"),
    ("proofs", endless, "must be a file"), ("graphs", endless, "must be a file"), ("index", endless, "must be a file"),
    ("proofs", waiting, "must be a file"), ("graphs", waiting, "must be a file"), ("index", waiting, "must be a file"),
    ("proofs", truncated, "must hold JSON"), ("graphs", truncated, "must hold JSON"),
    ("index", truncated, "must hold JSON"),
    ("proofs", Path.unlink, "must be a file"), ("graphs", Path.unlink, "must be a file"),
    ("graphs", replaced('"sin"', '"cos"'), "the hash by which it is named"),
    ("proofs", replaced('"at least"', '"at most"'), "the hash by which it is named"),
    ("proofs", replaced('"bounds"', '"limits"'), "the hash by which it is named"),
    ("proofs", replaced("certificate 1", "certificate 0"), "the format must be"),
    ("proofs", replaced('["m"]', "[NaN]"), "must hold JSON"),
    ("proofs", replaced('["m"]', "[Infinity]"), "must hold JSON"),
    ("proofs", replaced('["m"]', "[1e999]"), "a list"),
    ("proofs", replaced('["m"]', "[" * 500 + "]" * 500), "a list of 2"),
    ("proofs", replaced('["m"]', '["m", "m"]'), "goes on behind its end"),
    ("proofs", replaced('["m"]', "[]"), "must cover the set"),
    ("proofs", replaced('{"trees"', '{"trees": [], "trees"'), "once"),
    ("proofs", replaced('"proof"', '"other": 1, "proof"'), "a record of format"),
]  # fmt: skip


@pytest.mark.parametrize(("of", "change", "says"), FILES, ids=range(len(FILES)))
def test_a_file_that_is_none(tmp_path, of, change, says):
    one = honest()
    place = written(tmp_path, one)
    change(place / "index.json" if of == "index" else file_of(place, one, of))
    refused(checked(place), says)


def drawn(*rows: list, labels: tuple[str, ...] = ("x",), **other: object) -> dict:
    g = Drawn({"x": labels})
    for row in rows:
        g.put(*row)
    return g.gives("y", len(g.nodes) - 1).content | other


def over(content: dict, said: dict, tree: object = "m", box: list | None = None) -> Forged:
    return bounds(content, box if box is not None else [coordinate("x", 0, 1)], [said], [[tree]])


LEAST = claim("at least", -2.0)
SQUARES = [["const", h(3)], *(["sq", k + 1] for k in range(60))]
POLYNOMIALS = [["const", h(1)], ["add", 0, 1], *(["sq", k + 2] for k in range(60))]


def same(content: dict) -> Forged:
    content["outputs"] = [*content["outputs"], {"name": "z", "shape": [1, 1], "entries": [[0, 0, 0]]}]
    pair = [["y", 0, 0], ["z", 0, 0]]
    return Forged("identity", {"graph": hashed(content), "says": "It is.", "equal": [pair]}, {}, [content])


def deep(levels: int) -> object:
    formula: object = "1"
    for _ in range(levels):
        formula = ["+", formula, "1"]
    return formula


def large() -> list[tuple[str, Forged, str]]:
    """Return certificates that would take too long, or too much memory."""
    wide = [f"x{i}" for i in range(2000)]
    sums = [["add", 1999 + k if k else 0, k % 2000] for k in range(60_000)]
    box = [coordinate(name, 0, 1) for name in wide]
    big = {"shape": [100_000, 100_000], "name": "z", "entries": []}
    many = [{"shape": [1000, 499], "name": f"z{i}", "entries": []} for i in range(20)]
    learns = {"samples": 10**6, "varying": True, "increment": False, "least": "0", "most": "1", "begins": {}}
    content = drawn(["sin", 0])
    rest = over(content, LEAST)
    sample = {"bounds": rest.name, "samples": 10**7, "weight": h(1), "r": h(1), "p": h(1)}
    power = {"says": "It is.", "matrices": {"A": [["3"]]}, "positive": [["^", ["^", ["^", "A", 2000], 2000], 2000]]}
    return [
        ("a graph of a million nodes", over(drawn(*(["sin", k] for k in range(10**6))), LEAST), "at most 500000 nodes"),
        ("a deep graph", over(drawn(*(["sin", k] for k in range(10**5))), LEAST), "not shown|ACCEPTED|must say"),
        ("nodes of many coordinates", over(drawn(*sums, labels=tuple(wide)), LEAST, box=box), "too many"),
        ("a large result", over(drawn(["sin", 0], outputs=[big]), LEAST), "at most|whole number"),
        ("many results", over(drawn(["sin", 0], outputs=many), LEAST), "at most"),
        ("a power of 10^9", over(drawn(["const", h(1e9)], ["constpow", 0, 1]), LEAST), "not shown|must say"),
        ("an identity to the power of 10^9", same(drawn(["const", h(1e9)], ["constpow", 0, 1])), "differ"),
        ("digits that double", same(drawn(*SQUARES)), "digits"),
        ("terms that double", same(drawn(*POLYNOMIALS)), "terms|degree"),
        ("a degree that doubles", same(drawn(*(["sq", k] for k in range(60)))), "degree"),
        ("powers of powers", same(drawn(["const", h(32)], *(["constpow", k if k else 0, 1] for k in (0, 2, 3, 4, 5)))),
         "degree"),
        ("samples without end", Forged("rows", sample, {}, [], [rest]), "samples|malformed"),
        ("trials without end", Forged("learned", {"graph": hashed(content), **learns}, {}, [content]), "malformed"),
        ("a tree without end", over(content, LEAST, [[0, h(0.0)]] * 300_000), "must stand|at most"),
        ("a long tree", bounds(content, [coordinate("x", 0, 1)], [LEAST], [[[0, h(0.0)]] * 300_000]), "at most"),
        ("a formula that is nested", numbers({"a": "1"}, ["=", "a", deep(400)]), "too deep"),
        ("a number of many digits", numbers({"a": "9" * 100_000}, ["=", "a", "1"]), "hexadecimal"),
        ("powers of a matrix", Forged("definite", power), "too many digits"),
        ("a huge exponent", numbers({"a": "0x1.0000000000000p+999999999"}, ["=", "a", "1"]), "hexadecimal"),
        ("an infinite number", numbers({"a": "inf"}, ["=", "a", "1"]), "hexadecimal"),
        ("an unknown operation", over(drawn(["gamma", 0]), LEAST), "NOT RE-CHECKABLE.*gamma"),
        ("a table", over(drawn(["sin", 0], tables=[1]), LEAST), "NOT RE-CHECKABLE.*table"),
        ("an empty set", over(content, LEAST, box=[coordinate("x", 1, 0)]), "must not be empty"),
        ("a set without coordinates", over(content, LEAST, box=[]), "a list of 1"),
        ("no claim", bounds(content, [coordinate("x", 0, 1)], [], []), "there must be a claim"),
        ("a node that comes later", over(drawn(["sin", 1]), LEAST), "a whole number"),
        ("a kind that is none", Forged("proof", {}), "a known kind"),
        ("a theorem that is none", Forged("theorem", {"theorem": "fermat", "premises": {}}), "a theorem must be"),
    ]  # fmt: skip


LARGE = large()


@pytest.mark.parametrize(("what", "one", "says"), LARGE, ids=[what for what, _, _ in LARGE])
def test_what_is_too_large_or_unknown_ends_soon(tmp_path, what, one, says):
    started = time.monotonic()
    refused(checked(written(tmp_path, one)), says)
    print(f"{what}: {time.monotonic() - started:.1f} s")


def test_a_file_of_empty_lists_is_held(tmp_path):
    one = honest()
    place = written(tmp_path, one)
    file_of(place, one).write_text("[" + "[]," * (LARGEST // 3 - 2) + "[]]")
    refused(checked(place), "a record of format")
