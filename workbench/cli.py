"""The command line: list, show, run, verify."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import os
import signal
import sys
import unicodedata
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from models.errors import InvalidValue
from workbench.distribution import HiddenPackageError, unhidden

if TYPE_CHECKING:
    from workbench.contracts.study import Scores, Study

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Written = Annotated[Path, typer.Argument(metavar="OUT", help="a folder that verify wrote")]
Name = Annotated[str, typer.Argument(metavar="STUDY", help="a built-in study, or a .py file that declares one")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="change a setting (may be repeated)")
]
Seed = Annotated[int | None, typer.Option(help="seed of everything random")]
Case = Annotated[str | None, typer.Option("--case", metavar="NAME", help="one of the study's cases (see show)")]
Draws = Annotated[int | None, typer.Option(help="how many campaigns, with seeds of their own")]
Out = Annotated[Path | None, typer.Option(metavar="DIR", help="output folder (default: out/STUDY)")]
Full = Annotated[bool, typer.Option("--full", help="add the long sweeps")]
Strict = Annotated[bool, typer.Option("--strict", help="exit with 3 if a claim departs from what is expected of it")]
Baseline = Annotated[
    Path | None,
    typer.Option("--baseline", metavar="FILE", help="a former verdicts.json: exit with 3 if a claim departs from it"),
]
Json = Annotated[bool, typer.Option("--json", help="print scores.json instead of a table")]


def _print_version(asked: bool) -> None:
    if asked:
        from workbench.distribution import __version__

        print(f"workbench {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Design and verify learning controllers on symbolic plants."""


def _study(
    name: str, assignments: list[str] | None, seed: int | None = None, case: str | None = None, draws: int | None = None
) -> Study:
    from workbench.contracts import settings
    from workbench.trials import find as studies

    besides = [f"{key}={value}" for key, value in (("seed", seed), ("draws", draws)) if value is not None]
    study = settings.assigned(settings.in_case(studies.find(name), case or ""), [*(assignments or []), *besides])
    if name.endswith(".py"):  # those that are installed are looked at by the tests
        for line in _disagreeing(study):
            logging.getLogger("workbench").warning("dimensions do not agree: %s", line)
    return study


@app.command("list")
def list_studies() -> None:
    """Name the built-in studies."""
    from workbench.trials import find as studies

    for name, title in studies.titles().items():
        print(f"{name:16}{title}")


@app.command()
def show(name: Name) -> None:
    """Print the settings that --set takes, with units and ranges."""
    from workbench.contracts import settings

    with _computing():
        from workbench.trials import find as studies

        study = studies.find(name)
    print(f"{study.name}: {study.title}" if study.title else study.name)
    if study.source:
        print(f"Source: {study.source}")
    for case, changes in study.cases.items():
        print(f"Case {case}: {', '.join(f'{path} = {_said(value)}' for path, value in changes.items())}")
    print()
    table: list[tuple[str, ...]] = [("setting", "value", "unit", "range", "meaning")]
    for row in settings.rows(study):
        value = row.value if isinstance(row.value, str) else json.dumps(row.value)
        table.append((row.path, value, "" if row.unit == "1" else row.unit, row.range, row.doc))
    _print_table(table)
    for line in _disagreeing(study):
        print(f"\nDimensions do not agree: {line}")


def _disagreeing(study: Study) -> list[str]:
    """Return where the dimensions of the study's plant do not agree, a line each."""
    from workbench.contracts.dimensions import mismatches

    return mismatches(study.plant)


@app.command()
def run(
    name: Name,
    assignments: Settings = None,
    seed: Seed = None,
    out: Out = None,
    as_json: Json = False,
    case: Case = None,
    draws: Draws = None,
) -> None:
    """Run a study and write run.nc, scores.json and figures/, with several draws draws.nc too."""
    from workbench.trials import campaign
    from workbench.trials.draft import replacing

    with _computing():
        study = _study(name, assignments, seed, case, draws)
        folder = out or Path("out") / campaign.figure_file(study.name)
        with replacing(folder) as draft:
            done = campaign.run(study)
            done.record(draft)
            done.write(draft)
        found, scores = done.scores_json(), done.scores()
    if as_json:
        print(json.dumps(found, indent=2))
        return
    _print_scores(scores)
    _print_lines(f"{controller}: {reason}" for controller, reason in done.stopped)
    print(f"\nRun:      {folder / 'run.nc'}\nScores:   {folder / 'scores.json'}\nFigures:  {folder / 'figures'}/")


@app.command()
def verify(
    name: Name,
    assignments: Settings = None,
    seed: Seed = None,
    out: Out = None,
    full: Full = False,
    strict: Strict = False,
    as_json: Annotated[bool, typer.Option("--json", help="print verdicts.json instead of tables")] = False,
    case: Case = None,
    draws: Draws = None,
    baseline: Baseline = None,
) -> None:
    """Run a study, check its claims and write run.nc, scores.json, figures/, verdicts and report.html.

    Every case of the study is run and checked, or the one that --case names (default: the study as declared).

    Exit status, the first that is true: 70 runs contradict a proof (the program is at fault), 2 bad usage or input,
    3 with --strict a claim departs from what the study expects of it, or with --baseline from that file, 1 a claim is
    UNDECIDED that was not expected to be, 0. A claim of which nothing is expected departs where it is REFUTED.

    Expectations are about a study as shipped: with --set, --seed or --draws only claims that are requirements count
    for 3 and 1, or, where there is a baseline, what it holds.
    """
    unhidden("verification")
    from verification.decide.judge import ContradictionWarning
    from verification.decide.verify import verify_cases
    from verification.report import listing
    from verification.report import write as report
    from verification.report.gate import Gate, baseline_of
    from verification.report.words import SURVIVED
    from workbench.trials import campaign
    from workbench.trials.draft import replacing

    with _computing(), warnings.catch_warnings():
        warnings.simplefilter("ignore", ContradictionWarning)  # they are named below, a line each
        study = _study(name, assignments, seed, draws=draws)
        gate = Gate(
            strict=strict,
            baseline=None if baseline is None else baseline_of(baseline, study.name, case or ""),
            changed=bool(assignments) or seed is not None or draws is not None,
            case=case or "",
        )
        folder = out or Path("out") / campaign.figure_file(study.name)
        with replacing(folder) as draft:
            found = verify_cases(study, draft, only=case, full=full, gate=gate)
        scores = report.all_scores(found)
    fallen, told = listing.fallen(found), listing.told(found)
    if as_json:
        print(json.dumps(report.verdicts_json(found), indent=2))
        for line in [*fallen, *told]:
            print(f"workbench: {_one_line(line)}", file=sys.stderr)
    else:
        _print_lines(fallen)
        _print_scores(scores)
        if table := listing.digit_table(found):
            print(f"\nDigits of these scores: {SURVIVED}.")
            _print_table(table)
        print()
        _print_table(listing.verdict_table(found))
        print(f"\n{listing.tally(found)}\n")
        _print_lines([*told, ""] if told else [])
        print(f"Run:      {folder / 'run.nc'}\nScores:   {folder / 'scores.json'}\nFigures:  {folder / 'figures'}/")
        print(f"Verdicts: {folder / 'verdicts.json'}, verdicts.xml\nReport:   {folder / 'report.html'}")
    raise typer.Exit(report.exit_status(found))


@app.command()
def replay(
    out: Written,
    claim: Annotated[str, typer.Argument(metavar="CLAIM", help="a claim that is REFUTED in it")],
    case: Annotated[str | None, typer.Option("--case", metavar="NAME", help="the case (default: that of OUT)")] = None,
    controller: Annotated[str | None, typer.Option("--controller", metavar="NAME", help="the controller")] = None,
    study: Annotated[
        str | None, typer.Option("--study", metavar="FILE", help="the .py file of a study that is not built in")
    ] = None,
) -> None:
    """Replay the witness of a claim that verify REFUTED, and say whether the refutation stands.

    Exit status: 0 it stands, 1 it does not, 2 bad usage or input.
    """
    unhidden("verification")
    from verification.decide.replay import replay as replay_claim
    from workbench.trials import find as studies

    with _computing():
        found = replay_claim(out, claim, controller, case, study=None if study is None else studies.find(study))
    _print_lines(found.lines())
    raise typer.Exit(0 if found.stands else 1)


@app.command()
def recheck(out: Written) -> None:
    """Check what verify wrote by a program that shares nothing with it; exit status 0 or, if it does not stand, 2."""
    unhidden("verification")
    from verification.decide.recheck import recheck as recheck_folder

    with _computing():
        found = recheck_folder(out)
    _print_lines(found.lines())
    raise typer.Exit(0 if found.stands else 2)


@app.command()
def compare(
    name: Name,
    laws: Annotated[
        str | None,
        typer.Option(metavar="A,B,...", help="laws of the library and of the study (default: all that suit)"),
    ] = None,
    assignments: Settings = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="output folder (default: out/compare-STUDY)")] = None,
    check: Annotated[bool, typer.Option("--verify", help="also check each law's assumptions: report.html")] = False,
    as_json: Json = False,
) -> None:
    """Tune laws alike on a study's plant, run them, and write one table (table.csv), run.nc, scores.json, figures/."""
    from workbench.design import table as comparing
    from workbench.trials import campaign
    from workbench.trials import find as studies
    from workbench.trials.draft import replacing

    named = None if laws is None else [law.strip() for law in laws.split(",") if law.strip()]
    seeded = [f"seed={seed}"] if seed is not None else []
    with _computing():
        study = studies.find(name)
        folder = out or Path("out") / campaign.figure_file(f"compare-{study.name}")
        with replacing(folder) as draft:
            done = comparing.compare(study, named, [*(assignments or []), *seeded])
            done.record(draft)
            times = comparing.times(done)
            comparing.write_tables(done, draft, times)
            if check:
                unhidden("verification")
                from verification.decide.verify import verify as examine
                from verification.report import write as report

                found = examine(done)
                report.write_into(found, draft)
            else:
                done.write(draft)
        scores, table = done.scores_json(), comparing.table(done, times)
    if as_json:
        print(json.dumps(scores, indent=2))
        return
    _print_table(table)
    if check:
        proofs = found.tables[1]
        print(f"\n{proofs.title}")
        _print_table([tuple(proofs.header), *(tuple(row) for row in proofs.rows)])
        print(f"\nReport:   {folder / 'report.html'}")
    print(f"\nTable:    {folder / 'table.csv'} (times: times.csv)\nFigures:  {folder / 'figures'}/")


def _print_scores(scores: Scores) -> None:
    metrics = list(dict.fromkeys(metric for row in scores.values() for metric in row))
    table: list[tuple[str, ...]] = [("metric", *scores)]
    for metric in metrics:
        table.append((metric, *("-" if (one := row.get(metric)) is None else f"{one:.5g}" for row in scores.values())))
    _print_table(table)


def _print_lines(lines: Iterable[str]) -> None:
    for line in lines:
        print(_one_line(line))


def _said(value: object) -> str:
    """Return what a case sets, in a few words."""
    plain = isinstance(value, (bool, int, float, str, list, tuple, dict))
    return json.dumps(value, default=str) if plain else str(value)


def _print_table(table: list[tuple[str, ...]]) -> None:
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    for row in table:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


@contextlib.contextmanager
def _computing() -> Iterator[None]:
    """Send to stderr what is printed within, by a study's own code or by a library: stdout holds our answer only.

    A reader of stdout or stderr who has left does not end the process within, so that nothing is half written.
    """
    _deaf_to_pipes(False)
    kept = None
    with contextlib.suppress(OSError):  # a closed stream has nothing to send or to keep
        kept = os.dup(1)
        os.dup2(2, 1)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        if kept is not None:
            os.dup2(kept, 1)
            os.close(kept)
        _deaf_to_pipes(True)


def _deaf_to_pipes(quiet: bool) -> None:
    """Choose whether a pipe that nobody reads ends the process without a word, as it ends any other program."""
    if sys.platform != "win32":
        signal.signal(signal.SIGPIPE, signal.SIG_DFL if quiet else signal.SIG_IGN)


def _one_line(text: str) -> str:
    """Return text with control characters, line ends among them, written as escapes."""
    return "".join(
        repr(character)[1:-1] if unicodedata.category(character) == "Cc" else character for character in text
    )


def _fail(message: str) -> None:
    with contextlib.suppress(OSError):
        print(f"workbench: {_one_line(message)}", file=sys.stderr)
    sys.exit(2)


def main() -> None:
    """Run the command line; bad input ends with one line and status 2.

    What the terminal's encoding lacks is printed as an escape. A reader who has left (``| head``) ends it quietly.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    logging.basicConfig(level=logging.WARNING, format="workbench: %(message)s", stream=sys.stderr)
    _deaf_to_pipes(True)
    try:
        try:
            app()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except (InvalidValue, HiddenPackageError) as error:
        _fail(str(error))
    except MemoryError as error:
        _fail(f"there is not enough memory ({error}): lower trials or samples")
    except OSError as error:
        if error.filename is None:  # what is still to be written would fail again at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        _fail(f"{error.filename or 'standard output'} cannot be used: {error.strerror or error}")
    except Exception as error:
        from models.users_code import place_of, told

        if place_of(error) is None:
            raise
        _fail(str(told(error, "in the study's own code")))
