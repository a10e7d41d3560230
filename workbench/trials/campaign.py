"""A study that was run: its Dataset, saving and loading."""

from __future__ import annotations

import dataclasses
import difflib
import json
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar

import xarray as xr

from models.array import Array
from models.function_name import function_name
from models.quantity import InvalidValue
from models.users_code import asking
from workbench.contracts import settings
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import Draw, Progress, Scores, Study
from workbench.distribution import __version__
from workbench.trials import progress
from workbench.trials.draft import PROVENANCE, RECORD, replacing
from workbench.trials.draws import draws, over_draws
from workbench.trials.metrics import scores_of
from workbench.trials.netcdf import packed, unpacked
from workbench.trials.provenance import Provenance, provenance, run_id
from workbench.trials.simulation import Runner, simulate

RUN_ID, SOURCE = "run_id", "provenance"
"""Root attributes of ``run.nc``: the run's digest, and where it comes from as JSON."""
DRAWS = "draws.nc"
"""The metrics of every draw, beside ``run.nc``."""

V = TypeVar("V")
LONGEST = 200  # bytes of a file's name, its ending and a comparison's prefix aside
FORBIDDEN = frozenset('/\\\0<>:"|?*')  # in names of files, on one system or another


class Named(dict[str, V]):
    """Things by name; a name that there is not is answered in one line."""

    def __init__(self, kind: str, things: Mapping[str, V]) -> None:
        super().__init__(things)
        self.kind = kind

    def __missing__(self, name: str) -> V:
        """Raise InvalidValue with the names that are near."""
        near = difflib.get_close_matches(name, list(self), n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(self) or 'none'}"
        raise InvalidValue(f"there is no {self.kind} {name!r}; {hint}")


@dataclasses.dataclass(frozen=True)
class Campaign:
    """A study and the Dataset that running it gave (see ``run.nc``)."""

    study: Study
    data: xr.Dataset
    recorded: Provenance | None = None
    """Where a campaign that was loaded comes from, as it was recorded; None for one that was run here."""
    drawn: xr.Dataset | None = None
    """Metrics of every draw, where the study has several; see ``draws.nc``."""

    @property
    def settings(self) -> dict[str, object]:
        """Every setting of the study, nested, as JSON holds them."""
        return settings.as_json(self.study)

    @property
    def stopped(self) -> list[tuple[str, str]]:
        """The controllers that were refused, stopped or diverged, each with the reason that the run noted."""
        if "stopped" not in self.data:
            return []
        reasons = zip(self.data["controller"].values, self.data["stopped"].values, strict=True)
        return [(str(controller), str(reason)) for controller, reason in reasons if reason]

    @property
    def by_draw(self) -> xr.Dataset:
        """Metrics of every draw, also of a single one (see ``draws.nc``); draws that are not at hand are run again."""
        return draws(self.study, self.data, progress.silent) if self.drawn is None else self.drawn

    def scores(self) -> Scores:
        """Return the metrics of every controller; None where a metric does not exist in this run.

        Where the study has several draws they are medians over the draws, with METRIC_p10 and METRIC_p90 beside them.
        """
        if self.drawn is None:
            return scores_of(self.study, self.data)
        found = over_draws(self.drawn)
        for name, row in (self.study.summary(self.study, self.drawn) if self.study.summary else {}).items():
            found[name].update(row)
        return found

    def figures(self) -> Mapping[str, Draw]:
        """Return the study's figures by name, each a function that draws and returns a Matplotlib figure."""
        if self.study.drawings is not None:
            data = self.data if self.drawn is None else self.data.assign({"scores": self.drawn["scores"]})
            with asking("the figures of the study", self.study.drawings):
                return Named("figure", self.study.drawings(self.study, data))
        from workbench.trials.figures import trial_figures

        return Named("figure", trial_figures(self.study, self.data))

    def documents(self) -> Mapping[str, object]:
        """Return what the study writes besides, JSON by file name."""
        return {} if self.study.documents is None else self.study.documents(self.study, self.data)

    def tuned_laws(self) -> Mapping[str, AnyLaw]:
        """Return the laws that ran, by controller: where the study tunes, with the settings that tuning found."""
        tuning = self.study.tuning
        return self.study.controllers if tuning is None else tuning.laws(self.study, self.data)

    def runner(self, controller: str) -> Runner:
        """Return a controller of the campaign, ready to be run again, with the law that it had."""
        return Runner(self.study, controller, self.tuned_laws()[controller])

    def scores_json(self) -> dict[str, object]:
        """Return the content of ``scores.json``."""
        return {"study": self.study.name, "settings": self.settings, "scores": self.scores()}

    def provenance(self) -> Provenance:
        """Return where the campaign comes from: as it was recorded, or as the study is now."""
        return provenance(self.study) if self.recorded is None else self.recorded

    def record(self, folder: Path) -> None:
        """Write run.nc, draws.nc where there are several, and provenance.json; run.nc appears when it is whole."""
        source = self.provenance()
        digest = run_id(self.data.attrs, source, self.data)
        content = packed(self.data, {RUN_ID: digest, SOURCE: json.dumps(source)})
        if self.drawn is not None:
            (folder / DRAWS).write_bytes(packed(self.drawn, {RUN_ID: digest}))
        part = folder / f"{RECORD}.part"
        part.write_bytes(content)
        os.replace(part, folder / RECORD)
        write_json({"study": self.study.name, RUN_ID: digest, **source}, folder / PROVENANCE)

    def write(self, folder: Path) -> None:
        """Write all that a run writes into a folder, but for the record: scores, the study's documents, figures."""
        write_json(self.scores_json(), folder / "scores.json")
        self.write_documents(folder)
        write_figures(self.figures(), folder / "figures")

    def write_documents(self, folder: Path) -> None:
        """Write what the study writes besides into a folder."""
        for name, content in self.documents().items():
            write_json(content, folder / name)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Replace a folder by all that a run writes, all or nothing; return the folder.

        That is run.nc, provenance.json, scores.json, the study's documents and figures/. Raises InvalidValue where
        the folder cannot be written, or holds what no run wrote.
        """
        with replacing(folder) as draft:
            self.record(draft)
            self.write(draft)
        return Path(folder)


def run(study: Study, *, start: Campaign | None = None, show_progress: bool = True) -> Campaign:
    """Run a study; ``start`` is a campaign to go on from, with the memories that its laws ended with.

    Raises InvalidValue where the study's declarations do not fit together.
    """
    if not isinstance(study, Study):
        raise InvalidValue(f"run takes a Study, as in run(Study(plant=..., ...)); got {repr(study).splitlines()[0]}")
    shown: Progress = progress.bar if show_progress else progress.silent
    memories = None if start is None else {name: ended_with(start, name) for name in start.study.controllers}
    data = _about(study, simulate(study, shown, memories))
    drawn = None
    if study.draws > 1:
        drawn = draws(study, data, shown)
    return Campaign(study, data, drawn=drawn)


def _about(study: Study, data: xr.Dataset) -> xr.Dataset:
    data.attrs = {
        "study": study.name,
        "version": __version__,
        "settings": json.dumps(settings.as_json(study), allow_nan=False),
    }
    if study.case:
        data.attrs["case"] = study.case
    return data


def ended_with(campaign: Campaign, controller: str) -> tuple[Array, ...]:
    """Return the memory with which a controller would begin the trial after a campaign's last one."""
    study = campaign.study
    longer = dataclasses.replace(study, trials=1, compose=None)
    inputs = study.inputs()
    memory: tuple[Array, ...] = ()
    for left in campaign.runner(controller).trials([*inputs, *longer.inputs()], keep_memory=True):
        memory = left.memory
    return memory


def load(path: str | os.PathLike[str], study: Study | None = None) -> Campaign:
    """Load a campaign from ``run.nc``, or from the folder that holds it.

    ``study`` is needed for a study of one's own; a built-in one is found by its name. Its settings are those of
    the run. Raises InvalidValue where the file is missing, cut short, not a run, of another study, or not what its run
    id was taken of: then something in it was changed.
    """
    file = Path(path) / "run.nc" if Path(path).is_dir() else Path(path)
    if not file.is_file():
        raise InvalidValue(f"a run is loaded from an existing run.nc, got {file}: run the study first")
    try:
        data = unpacked(file)
    except Exception as error:
        raise InvalidValue(
            f"{file} must be a complete netCDF-4 file, but could not be read ({_first(error)}): run the study again"
        ) from None
    wanted = ("study", "version", "settings", SOURCE, RUN_ID)
    if missing := [name for name in wanted if not isinstance(data.attrs.get(name), str)]:
        raise InvalidValue(
            f"{file} must carry the attributes {', '.join(wanted)}, got none named {missing[0]}: "
            "it is no run of the workbench, or of an older one; run the study again"
        )
    source_id = data.attrs[RUN_ID]
    source = _trusted(file, data)
    if study is None:
        from workbench.trials.find import find, names

        name = data.attrs["study"]
        if name not in names():
            raise InvalidValue(
                f"{file} is a run of {name!r}, which is not built in: give it, as in load(path, study), "
                "or with --study FILE"
            )
        study = find(name)
    elif study.name != data.attrs["study"]:
        raise InvalidValue(
            f"{file} is a run of the study {data.attrs['study']!r}, got the study {study.name!r}: "
            "give the one that was run"
        )
    study = settings.in_case(study, str(data.attrs.get("case", "")))
    study = settings.changed(study, json.loads(data.attrs["settings"]))
    return Campaign(study, data, source, _drawn(file, study, str(source_id)))


def _drawn(file: Path, study: Study, run: str) -> xr.Dataset | None:
    """Return the metrics of every draw from beside a record; raise where they are missing or of another run."""
    if study.draws == 1:
        return None
    beside = file.with_name(DRAWS)
    try:
        drawn = unpacked(beside)
    except Exception as error:
        raise InvalidValue(
            f"{beside} must hold the draws of {file.name}, but could not be read ({_first(error)}): run the study again"
        ) from None
    if drawn.attrs.pop(RUN_ID, None) != run:
        raise InvalidValue(f"{beside} must be of the same run as {file.name}, got another: run the study again")
    return drawn


def _trusted(file: Path, data: xr.Dataset) -> Provenance:
    """Take run id and provenance off a record's attributes, and return the latter where the id is that of the rest."""
    told, source = data.attrs.pop(RUN_ID), data.attrs.pop(SOURCE)
    try:
        found: Provenance = json.loads(source)
        now = run_id(data.attrs, found, data)
    except (ValueError, KeyError, TypeError) as error:
        now = f"nothing ({_first(error)})"
    if now != told:
        raise InvalidValue(
            f"{file} must hold what its run id {told[:12]} was taken of, but what it holds gives {now[:12]}: "
            "it was edited or damaged; run the study again"
        )
    beside = file.with_name(PROVENANCE)
    if file.name == RECORD and beside.is_file():
        try:
            said = json.loads(beside.read_text(encoding="utf-8")).get(RUN_ID)
        except (ValueError, AttributeError, OSError):
            said = None
        if said != told:
            raise InvalidValue(
                f"{beside} must name the run id {told[:12]} of {file.name} beside it, got {str(said)[:12]}: "
                "the two are of different runs; run the study again"
            )
    return found


def _first(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def write_json(content: object, file: Path) -> None:
    """Write content as JSON."""
    file.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_figures(figures: Mapping[str, Draw], folder: Path) -> None:
    """Draw figures and write each as SVG and PNG: the same figure gives the same bytes on every day."""
    from matplotlib import pyplot

    from workbench.trials.glyphs import said_together, saved

    folder.mkdir(parents=True, exist_ok=True)
    with said_together():
        for name, draw in figures.items():
            with asking(f"the figure {name}", draw):
                figure = draw()
            file = figure_file(name)
            try:
                with pyplot.rc_context({"svg.hashsalt": "workbench"}):
                    saved(figure, partial(figure.savefig, folder / f"{file}.png", dpi=150))
                    figure.set_layout_engine("none")  # laid out once, so that both files show the same
                    saved(figure, partial(figure.savefig, folder / f"{file}.svg", metadata={"Date": None}))
            finally:
                pyplot.close(figure)


def figure_file(name: str) -> str:
    """Return the file name, without its ending, under which a figure is written.

    A name that is too long, or has letters that the locale does not know, becomes ASCII letters and a digest of it.
    """
    plain = "".join("_" if character in FORBIDDEN else character for character in name)
    try:
        return plain if len(os.fsencode(plain)) <= LONGEST else function_name(name)
    except UnicodeEncodeError:
        return function_name(name)
