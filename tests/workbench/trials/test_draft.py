"""A folder is replaced as a whole or not at all, and nothing that is no run of ours is deleted."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from models.errors import InvalidValue
from workbench.trials import draft as drafts
from workbench.trials.campaign import load
from workbench.trials.draft import replacing

OWN = """
import time
import numpy as np
from models.plant import Plant, signals
from models.quantity import declared, quantity
from workbench.controllers import PD
from workbench.contracts.study import Study
from pathlib import Path

@declared
class Cart(Plant):
    inputs = signals(force="N")
    states = outputs = signals(speed="m/s")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.9 * x.speed + 0.1 * u.force,)

    def output(self, x):
        return (x.speed,)

def figures(study, data):
    def draw():
        from matplotlib import pyplot
        Path("drawing").write_text("")
        time.sleep(0.0)
        figure, axes = pyplot.subplots()
        axes.plot([1, 2])
        return figure
    return {"mse": draw}

study = Study(name="own", plant=Cart(), reference=np.sin(np.linspace(0, 3, 2001)),
                   controllers={"pd": PD(kp=0.5, kd=0.0)}, trials=9, drawings=figures)
"""
SLOW = OWN.replace("sleep(0.0)", "sleep(60)")
BROKEN = OWN.replace("time.sleep(0.0)", "1 / 0")


def started(*arguments: str, cwd: Path, **options: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "workbench", *arguments],
        cwd=cwd,
        env=os.environ | {"MPLBACKEND": "Agg"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,  # type: ignore[call-overload]
    )


def done(*arguments: str, cwd: Path, **options: object) -> tuple[int, str]:
    running = started(*arguments, cwd=cwd, **options)
    _, said = running.communicate(timeout=120)
    return running.returncode, said


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def write(folder: Path, **files: str) -> None:
    """Write files of a run into a draft that replaces a folder."""
    with replacing(folder) as draft:
        for name, text in {"run.nc": "", "provenance.json": "{}", **files}.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            (draft / name).write_text(text)


@pytest.fixture(params=["beside", "within"])
def out(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that can be renamed, and one that cannot."""
    folder = tmp_path / "out"
    if request.param == "within":
        folder.mkdir()
        monkeypatch.setattr(drafts, "_stays", lambda target: target == folder)
    return folder


@pytest.mark.parametrize("exchanged", [True, False])
def test_what_an_earlier_run_wrote_is_gone(out: Path, exchanged: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not exchanged:
        monkeypatch.setattr(drafts, "_swapped", lambda one, other: False)
    write(out, **{"report.html": "old", "cases/a/run.nc": "old", "scores.json": "old"})
    write(out, **{"scores.json": "new", "figures/mse.svg": "new"})
    assert set(snapshot(out)) == {"run.nc", "provenance.json", "scores.json", "figures/mse.svg"}
    assert json.loads((out / "provenance.json").read_text())["files"] == ["figures/mse.svg", "run.nc", "scores.json"]
    assert (out / "scores.json").read_text() == "new"
    assert [path.name for path in out.parent.iterdir()] == ["out"]
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("thesis.tex", {"thesis.tex": "x"}),
        ("sub/thesis.tex", {"sub/thesis.tex": "x"}),
        ("report.html", {"report.html": "x"}),
        ("figures/a.svg", {"figures/a.svg": "x"}),
        ("notes.txt", {"run.nc": "x", "scores.json": "x", "notes.txt": "x"}),
        ("figures/mine.txt", {"run.nc": "x", "figures/mine.txt": "x"}),
        ("more.json", {"run.nc": "x", "more.json": "x", "provenance.json": '{"files": ["run.nc"]}'}),
        ("report.html", {"report.html": "x", "provenance.json": '{"files": ["run.nc"]}'}),
        ("other.txt", {"other.txt": "x", "provenance.json": "no json"}),
        ("empty", {"run.nc": "x", "empty/": ""}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_no_run_wrote_is_never_deleted(file: str, content: dict[str, str], out: Path) -> None:
    for name, text in content.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).mkdir() if name.endswith("/") else (out / name).write_text(text)
    before = snapshot(out)
    with pytest.raises(
        InvalidValue, match=f"^the output folder [^ ]*out must (be empty|hold nothing).* {file}"
    ) as caught:
        write(out)
    assert "\n" not in str(caught.value) and "give another" in str(caught.value)
    assert snapshot(out) == before and [path.name for path in out.parent.iterdir()] == ["out"]


def test_what_comes_into_the_folder_meanwhile_is_kept(out: Path) -> None:
    write(out, **{"scores.json": "old"})
    with pytest.raises(InvalidValue, match=r"got notes.txt beside it.*the run is kept in (.*)") as caught:
        with replacing(out) as draft:
            (draft / "run.nc").write_text("new")
            (out / "notes.txt").write_text("mine")
    kept = Path(str(caught.value).rpartition("kept in ")[2])
    assert (kept / "run.nc").read_text() == "new"
    assert (out / "notes.txt").read_text() == "mine" and (out / "scores.json").read_text() == "old"


def test_a_run_of_before_provenance_is_replaced(out: Path) -> None:
    names = ["run.nc", "scores.json", "figures/a.svg", "figures/a.png", "report.html", "verdicts.json", "verdicts.xml"]
    for name in [*names, "table.csv", "times.csv"]:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text("old")
    write(out)
    assert set(snapshot(out)) == {"run.nc", "provenance.json"}


@pytest.mark.parametrize("error", [ZeroDivisionError("x"), KeyboardInterrupt(), InvalidValue("no"), OSError(5, "bad")])
def test_a_failure_leaves_the_old_and_keeps_a_whole_run(error: BaseException, out: Path) -> None:
    write(out, **{"scores.json": "old"})
    before = snapshot(out)
    for recorded in (False, True):
        with pytest.raises((type(error), InvalidValue)) as caught, replacing(out) as draft:
            if recorded:
                (draft / "run.nc").write_text("new")
            raise error
        said = " ".join([str(caught.value), *getattr(caught.value, "__notes__", [])])
        kept = recorded and not isinstance(error, OSError)  # where the disk failed nothing of use is in the draft
        assert draft.is_dir() == kept and (f"the run is kept in {draft}" in said) == kept
        now = {name: one for name, one in snapshot(out).items() if not name.startswith(".draft-")}
        assert now == before


def test_an_interrupt_while_folders_are_exchanged_comes_after(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(out, **{"scores.json": "old"})
    name = "_exchange" if drafts._stays(out) is False else "_exchange_within"
    exchange = getattr(drafts, name)

    def interrupted(*arguments: Path) -> None:
        signal.raise_signal(signal.SIGINT)
        exchange(*arguments)

    monkeypatch.setattr(drafts, name, interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        write(out, **{"scores.json": "new"})
    assert caught.value.__notes__ == ["everything was written"] and (out / "scores.json").read_text() == "new"
    assert not [path for path in (*out.parent.iterdir(), *out.iterdir()) if path.name.startswith(".")]


def test_a_link_and_the_folder_s_rights_stay(tmp_path: Path) -> None:
    real = tmp_path / "real"
    write(real)
    real.chmod(0o750)
    (tmp_path / "link").symlink_to(real)
    write(tmp_path / "link", **{"scores.json": "new"})
    assert (tmp_path / "link").is_symlink() and (real / "scores.json").read_text() == "new"
    assert real.stat().st_mode & 0o777 == 0o750


def test_the_working_folder_is_not_exchanged_under_the_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    inode = tmp_path.stat().st_ino
    for _ in range(2):
        write(Path())
    assert tmp_path.stat().st_ino == inode and set(snapshot(tmp_path)) == {"run.nc", "provenance.json"}


def test_a_command_that_verified_leaves_nothing_to_a_run(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    assert done("verify", "own.py", cwd=tmp_path)[0] in (0, 1)
    assert (tmp_path / "out" / "own" / "report.html").exists()
    assert done("run", "own.py", "--seed", "3", cwd=tmp_path) == (0, "")
    names = {"run.nc", "scores.json", "provenance.json", "figures"}
    assert {path.name for path in (tmp_path / "out" / "own").iterdir()} == names
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["own"]


def waited(*files: Path) -> None:
    until = time.monotonic() + 60
    while not all(file.exists() for file in files):
        assert time.monotonic() < until, files
        time.sleep(0.02)


@pytest.mark.parametrize("command", ["run", "verify"])
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM], ids=lambda sent: sent.name)
def test_a_stopped_command_leaves_the_old_and_a_draft(command: str, sent: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    assert done("run", "own.py", "--out", "out", cwd=tmp_path) == (0, "")
    before = snapshot(tmp_path / "out")
    (tmp_path / "drawing").unlink()
    (tmp_path / "own.py").write_text(SLOW)
    running = started(command, "own.py", "--seed", "1", "--out", "out", cwd=tmp_path)
    waited(tmp_path / "drawing")
    running.send_signal(sent)
    _, said = running.communicate(timeout=60)
    (left,) = tmp_path.glob(".out.draft-*")
    assert snapshot(tmp_path / "out") == before
    if sent is signal.SIGINT:
        assert running.returncode == 130
        assert said == f"workbench: interrupted, the run is kept in {left}\n"
    assert len((left / "run.nc").read_bytes()) > 1000
    (tmp_path / "own.py").write_text(OWN)
    status, said = done("run", "own.py", "--out", "out", cwd=tmp_path)
    assert status == 0 and len(said.splitlines()) == 1 and f"half-way left {left}: keep what you need" in said
    assert left.is_dir()


WAIT = "(Path('drawing').write_text(''), time.sleep(60))"


@pytest.mark.parametrize(
    "text",
    [
        OWN.replace("trials=9,", f"trials=9, watch=lambda: {WAIT},"),
        f"{OWN}\n{WAIT}\n",
        OWN.replace("trials=9,", f"trials=9, scorers=(lambda study, data: {WAIT},),"),
    ],
    ids=["running", "loading the study", "scores"],
)
def test_an_interrupt_anywhere_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(text)
    running = started("run", "own.py", "--out", "some/out", cwd=tmp_path)
    waited(tmp_path / "drawing")
    running.send_signal(signal.SIGINT)
    printed, said = running.communicate(timeout=60)
    assert running.returncode == 130 and printed == ""
    kept = list(tmp_path.glob("some/.out.draft-*"))
    told = f"the run is kept in {kept[0]}" if kept else "nothing was written"
    assert said == f"workbench: interrupted, {told}\n"
    assert (tmp_path / "some").exists() == bool(kept) and not (tmp_path / "some" / "out").exists()


def test_a_failing_figure_keeps_the_run(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(BROKEN)
    status, said = done("run", "own.py", "--out", "out", cwd=tmp_path)
    (left,) = tmp_path.glob(".out.draft-*")
    assert status != 0 and f"the run is kept in {left}" in said and not (tmp_path / "out").exists()


def test_two_processes_never_mix(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN.replace("study = Study(", "study = Study(seed=0, "))
    running = [started("run", "own.py", "--seed", str(i), "--out", "out", cwd=tmp_path) for i in range(4)]
    said = [one.communicate(timeout=120)[1] for one in running]
    assert [one.returncode for one in running] == [0] * 4 and said == [""] * 4
    from workbench.trials.find import find

    whole = load(tmp_path / "out", find(str(tmp_path / "own.py")))
    content = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert content["settings"]["seed"] == whole.settings["seed"]
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith(".")) == []


def many(folder: Path, number: int) -> None:
    for _ in range(100):
        write(folder, **{f"{number}/scores.json": str(number), "scores.json": str(number)})


def test_many_writers_at_once(out: Path) -> None:
    import threading

    failed: list[BaseException] = []

    def writer(number: int) -> None:
        try:
            many(out, number)
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=writer, args=(number,)) for number in range(3)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert not failed, failed
    number = (out / "scores.json").read_text()
    assert set(snapshot(out)) == {"run.nc", "provenance.json", "scores.json", f"{number}/scores.json"}


@pytest.mark.parametrize("size", [0, 10_000, 25_000])
@pytest.mark.parametrize("command", ["run", "verify"])
def test_a_full_disk_is_one_line_and_keeps_the_old(command: str, size: int, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    assert done("run", "own.py", "--out", "out", cwd=tmp_path) == (0, "")
    before = snapshot(tmp_path / "out")

    def limited() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    changed = ["--seed", "1", "--set", "trials=1"]
    status, said = done(command, "own.py", *changed, "--out", "out", cwd=tmp_path, preexec_fn=limited)
    assert status == 2, said
    (line,) = [one for one in said.splitlines() if "Font" not in one]
    assert line.startswith("workbench: writing to out failed: File too large; what it held is as it was: free some")
    assert snapshot(tmp_path / "out") == before and not list(tmp_path.glob(".out.draft-*"))


@pytest.mark.skipif(os.geteuid() != 0 or sys.platform != "linux", reason="only root mounts a small disk")
@pytest.mark.parametrize("out", ["small", "small/out"])
def test_a_small_disk(out: str, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "small").mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(tmp_path / "small")], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("mounting is not allowed here")
    try:
        assert done("run", "own.py", "--out", out, cwd=tmp_path) == (0, "")
        before = snapshot(tmp_path / out)
        status, said = done("run", "own.py", "--set", "trials=400", "--out", out, cwd=tmp_path)
        assert status == 2 and len(said.splitlines()) == 1
        assert said.startswith(f"workbench: writing to {out} failed: No space left on device; what it held is as it")
        assert snapshot(tmp_path / out) == before
        assert not [path for path in (tmp_path / "small").rglob("*") if ".draft-" in path.name]
    finally:
        subprocess.run(["umount", str(tmp_path / "small")], check=True)
