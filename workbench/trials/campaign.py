"""A study that was run: its Dataset, saving and loading."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from models.function_name import function_name
from models.quantity import InvalidValue
from workbench.contracts import settings
from workbench.contracts.study import Progress, Scores, Study
from workbench.distribution import __version__
from workbench.trials import progress

LONGEST = 200  # bytes of a file's name, its ending and a comparison's prefix aside
FORBIDDEN = frozenset('/\\\0<>:"|?*')  # in names of files, on one system or another


@dataclasses.dataclass(frozen=True)
class Campaign:
    """A study and the Dataset that running it gave (see ``run.nc``)."""

    study: Any
    data: xr.Dataset

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
        """Return what the study writes besides, JSON by file name: a study may have ``documents(data)``."""
        own = getattr(self.study, "documents", None)
        result: Mapping[str, Any] = own(self.data) if own is not None else {}
        return result

    def scores_json(self) -> dict[str, Any]:
        """Return the content of ``scores.json``."""
        return {"study": self.study.name, "settings": self.settings, "scores": self.scores()}

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write run.nc, scores.json, the study's documents and figures/, all or nothing; return the folder.

        Raises InvalidValue where the folder cannot be written.
        """
        with written_together(folder) as draft:
            write_run(self.data, draft / "run.nc")
            (draft / "scores.json").write_text(json.dumps(self.scores_json(), indent=2, allow_nan=False) + "\n")
            for name, content in self.documents().items():
                (draft / name).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
            write_figures(self.figures(), draft / "figures")
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
    the run. Raises InvalidValue where the file is missing, cut short, or not a run.
    """
    file = Path(path) / "run.nc" if Path(path).is_dir() else Path(path)
    if not file.is_file():
        raise InvalidValue(f"a run is loaded from an existing run.nc, got {file}: run the study first")
    try:
        with xr.open_dataset(file, engine="h5netcdf") as opened:
            data = opened.load()
    except Exception as error:
        raise InvalidValue(
            f"{file} must be a complete netCDF-4 file, but could not be read ({_first(error)}): run the study again"
        ) from None
    if not {"study", "settings"} <= set(data.attrs):
        raise InvalidValue(f"{file} must carry the attributes study and settings: it is no run of the workbench")
    if study is None:
        from workbench.trials.find import find, names

        name = data.attrs["study"]
        if name not in names():
            raise InvalidValue(f"{file} is a run of {name!r}, which is not built in: give it, as in load(path, study)")
        study = find(name)
    return Campaign(settings.changed(study, json.loads(data.attrs["settings"])), data)


def _first(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def write_run(data: xr.Dataset, file: Path) -> None:
    """Write a Dataset as netCDF-4, compressed."""
    packed = {"zlib": True, "complevel": 1, "shuffle": True}
    encoding = {name: packed for name, values in data.variables.items() if values.size > 10_000}
    data.to_netcdf(file, engine="h5netcdf", encoding=encoding)


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


@contextmanager
def written_together(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a draft folder whose files move into ``folder`` at the end, or vanish if something fails.

    Raises InvalidValue where the folder cannot be written.
    """
    target = Path(folder)
    made = [parent for parent in [target, *target.parents] if not parent.exists()]
    try:
        target.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=".draft-", dir=target))
    except OSError as error:
        raise InvalidValue(
            f"the output folder {target} must be writable, got: {error.strerror}; give another with --out"
        ) from None
    try:
        yield draft
        for entry in sorted(draft.iterdir()):
            _move(entry, target / entry.name)
    except OSError as error:
        raise InvalidValue(f"writing to {target} failed: {error.strerror or error}") from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        for parent in made:
            if parent.exists() and not any(parent.iterdir()):
                parent.rmdir()


def _move(entry: Path, target: Path) -> None:
    if entry.is_dir() and target.is_dir():
        for inner in entry.iterdir():
            _move(inner, target / inner.name)
    else:
        os.replace(entry, target)
