"""A study that was run: its Dataset, saving and loading."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from models.function_name import function_name
from models.quantity import InvalidValue
from workbench.contracts.study import Progress, Scores, Study
from workbench.distribution import __version__
from workbench.trials import progress, settings
from workbench.trials.draft import PROVENANCE, RECORD, replacing
from workbench.trials.netcdf import packed, unpacked
from workbench.trials.provenance import Provenance, provenance, run_id

RUN_ID, SOURCE = "run_id", "provenance"
"""Root attributes of ``run.nc``: the run's digest, and where it comes from as JSON."""

LONGEST = 200  # bytes of a file's name, its ending and a comparison's prefix aside
FORBIDDEN = frozenset('/\\\0<>:"|?*')  # in names of files, on one system or another


@dataclasses.dataclass(frozen=True)
class Campaign:
    """A study and the Dataset that running it gave (see ``run.nc``)."""

    study: Any
    data: xr.Dataset
    recorded: Provenance | None = None
    """Where a campaign that was loaded comes from, as it was recorded; None for one that was run here."""

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting of the study, nested, as JSON holds them."""
        return settings.as_json(self.study)

    def scores(self) -> Scores:
        """Return the metrics of every controller; None where a metric does not exist in this run."""
        result: Scores = self.study.scores(self.data)
        return result

    def figures(self) -> Mapping[str, Callable[[], Any]]:
        """Return the study's figures by name, each a function that draws and returns a Matplotlib figure."""
        result: Mapping[str, Callable[[], Any]] = self.study.figures(self.data)
        return result

    def documents(self) -> Mapping[str, Any]:
        """Return what the study writes besides, JSON by file name."""
        result: Mapping[str, Any] = self.study.documents(self.data)
        return result

    def scores_json(self) -> dict[str, Any]:
        """Return the content of ``scores.json``."""
        return {"study": self.study.name, "settings": self.settings, "scores": self.scores()}

    def provenance(self) -> Provenance:
        """Return where the campaign comes from: as it was recorded, or as the study is now."""
        return provenance(self.study) if self.recorded is None else self.recorded

    def record(self, folder: Path) -> None:
        """Write run.nc and provenance.json into a folder; run.nc appears when it is whole."""
        source = self.provenance()
        digest = run_id(self.data.attrs, source, self.data)
        content = packed(self.data, {RUN_ID: digest, SOURCE: json.dumps(source)})
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


def run(study: Study, *, show_progress: bool = True) -> Campaign:
    """Run a study. Raises InvalidValue where its declarations do not fit together."""
    shown: Progress = progress.bar if show_progress else progress.silent
    data = study.simulate(shown)
    data.attrs = {
        "study": study.name,
        "version": __version__,
        "settings": json.dumps(settings.as_json(study), allow_nan=False),
    }
    return Campaign(study, data)


def load(path: str | os.PathLike[str], study: Study | None = None) -> Campaign:
    """Load a campaign from ``run.nc``, or from the folder that holds it.

    ``study`` is needed for a study of one's own; a built-in one is found by its name. Its settings are those of
    the run. Raises InvalidValue where the file is missing, cut short, not a run, or not what its run id was taken of:
    then something in it was changed.
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
    source = _trusted(file, data)
    if study is None:
        from workbench.trials.find import find, names

        name = data.attrs["study"]
        if name not in names():
            raise InvalidValue(f"{file} is a run of {name!r}, which is not built in: give it, as in load(path, study)")
        study = find(name)
    return Campaign(settings.changed(study, json.loads(data.attrs["settings"])), data, source)


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


def write_json(content: Any, file: Path) -> None:
    """Write content as JSON."""
    file.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_figures(figures: Mapping[str, Callable[[], Any]], folder: Path) -> None:
    """Draw figures and write each as SVG and PNG: the same figure gives the same bytes on every day."""
    from matplotlib import pyplot

    from workbench.trials.glyphs import said_together, saved

    folder.mkdir(parents=True, exist_ok=True)
    with said_together():
        for name, draw in figures.items():
            figure = draw()
            file = figure_file(name)
            try:
                with pyplot.rc_context({"svg.hashsalt": "workbench"}):
                    saved(figure, partial(figure.savefig, folder / f"{file}.svg", metadata={"Date": None}))
                    saved(figure, partial(figure.savefig, folder / f"{file}.png", dpi=150))
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
