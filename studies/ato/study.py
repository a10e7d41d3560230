"""Fuzzy immune PID of a train, and its tuning by a network.

The plant is a delayed transfer function; Chu, Yu, Lin, Yuan & Jiang.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import xarray as xr

from models.actuator import delayed
from models.plant import Plant, Signal
from models.quantity import InvalidValue, choice, count, declared, given, part, quantity, switch, table
from models.raised_cosine import RaisedCosines
from models.switched_delay import SwitchedDelay
from models.transfer import Transfer
from studies.ato.scores import indices, median_scores
from workbench.contracts.law import Law, Task
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.contracts.study import Folded, Progress, Scores, Study
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.parts.immune import TOLD
from workbench.fold.fold import Fold, build, stream
from workbench.fold.machine_code import compiled

STEP_SAMPLES, CURVE_SAMPLES = 200, 2175
KICKS = (100, 110)
BRAKING = ((1470, 1560), (1810, 2175))
CURVE = ((0.0, 50.0, 0.0, 26.0), (294.0, 312.0, 26.0, 20.0), (362.0, 432.0, 20.0, 0.0))
SEEDS_APART = 1000


class Setting(NamedTuple):
    """What every law is run on: plant with its dead time, reference, and what is added to u at each sample."""

    plant: Plant
    reference: Any
    added: Any


@declared
class AtoStudy(Study):
    """One run a law and seed, all laws on one plant; the laws that draw weights meet the same seeds.

    Samples are counted from 0 in the record; the paper's sample k is k - 1 there. Run i of ``seeds`` draws its
    weights from 1000 ``seed`` + i. The controllers in ``tuned`` get the gain p1 = p2 of a grid with the least ISE.
    """

    name: str = given(default="ato", doc="name, used for folders and reports")
    title: str = given(default="Fuzzy immune PID of a train, and its tuning by a network", doc="in one line")
    source: str = given(default="Chu, Yu, Lin, Yuan & Jiang (Tongji University)", doc="paper that it follows")
    test: str = choice(default="step", options=("step", "curve"), doc="unit step with disturbances, or speed profile")
    plant: Transfer = part(
        default=Transfer(
            numerator=(0.5,),
            denominator=(1.0, 1.0),
            sampling_time=0.2,
            input_signal=Signal("command", "1", "traction (+) or braking (-) command"),
            output_signal=Signal("speed", "m/s", "speed"),
        ),
        doc="the train without its dead time",
    )
    controllers: Mapping[str, Any] = part(
        default={
            "fipid": FIPID(),
            "fipid-smooth": FIPID(f="smooth"),
            "bp-fipid": BPFIPID(),
            "bp-frozen": BPFIPID(beta=0.0),
            "fixed-best": FIPID(eta=1.0),
        },
        doc="the controllers by name",
    )
    traction_delay: float = quantity(default=1.0, unit="s", doc="dead time in traction", above=0, structural=True)
    braking_delay: float = quantity(default=0.8, unit="s", doc="dead time in braking (curve)", above=0, structural=True)
    disturbance: float = quantity(
        default=0.1, unit="input", doc="added to u at samples 100 and 110 (step)", structural=True
    )
    seeds: int = count(default=50, doc="random starts of the weights", least=1, most=SEEDS_APART)
    seed: int = count(default=0, doc="seed of everything random")
    tune: bool = switch(default=True, doc="give fixed-best the best gain of the grid")
    grid: tuple[float, ...] = table(
        default=tuple(round(0.05 * i, 2) for i in range(1, 31)), unit="input/output", doc="gains p1 = p2 that are tried"
    )
    tuned: tuple[str, ...] = given(default=("fixed-best",), doc="the controllers that are tuned, FIPIDs")

    def check(self) -> None:
        """Raise InvalidValue where a delay is no multiple of the sampling time or a controller does not fit."""
        for name in ("traction_delay", "braking_delay"):
            try:
                delayed(self.plant, getattr(self, name))
            except InvalidValue as error:
                raise InvalidValue(str(error).replace("delay", name, 1)) from None
        if not self.controllers:
            raise InvalidValue("controllers must name at least one controller, got none")
        if self.tune and not self.grid:
            raise InvalidValue("grid must hold at least one gain, got none; or set tune=false")
        for name, law in self.controllers.items():
            if not isinstance(law, Law):
                raise InvalidValue(f"controllers.{name} must be a Law, got {type(law).__name__}")
            if name in self.tuned and not isinstance(law, FIPID):
                raise InvalidValue(f"controllers.{name} is tuned by its gain K and must be a FIPID")

    @property
    def setting(self) -> Setting:
        """The plant with its dead time, the reference (1, N + 1) and what is added to the input (1, N)."""
        late = round(self.traction_delay / self.plant.sampling_time)
        if self.test == "step":
            added = np.zeros((1, STEP_SAMPLES))
            added[0, [kick - 1 for kick in KICKS]] = self.disturbance
            return Setting(delayed(self.plant, self.traction_delay), np.ones((1, STEP_SAMPLES + 1)), added)
        early = round(self.braking_delay / self.plant.sampling_time)
        schedule = [(0, late)]
        for first, last in BRAKING:  # the paper's sample k is the output of step k - 2
            schedule += [(first - 2, early), (last - 1, late)]
        curve = RaisedCosines(horizon=CURVE_SAMPLES, moves=CURVE).samples(self.plant)
        return Setting(SwitchedDelay(plant=self.plant, schedule=tuple(schedule)), curve, np.zeros((1, CURVE_SAMPLES)))

    def folded(self) -> dict[str, Folded]:
        """Return what every controller is folded from, by name."""
        setting = self.setting
        return {name: Folded(setting.plant, law, setting.added.shape[1]) for name, law in self.controllers.items()}

    def simulate(self, progress: Progress) -> xr.Dataset:
        """Run every law with every seed; see :class:`workbench.contracts.study.Study`."""
        setting = self.setting
        folds = {name: build(setting.plant, law, setting.added.shape[1]) for name, law in self.controllers.items()}
        machine = machines(folds)
        seeded = [name for name, law in self.controllers.items() if isinstance(law, BPFIPID)]
        tuned = [name for name in self.controllers if self.tune and name in self.tuned]
        runs = len(self.controllers) + len(seeded) * (self.seeds - 1) + len(tuned) * len(self.grid)
        left: dict[str, list[TrialRecord]] = {}
        grids: dict[str, list[float]] = {}
        used: dict[str, Any] = {}
        with progress(runs, self.name) as advance:
            for name, law in self.controllers.items():
                if name in tuned:
                    ise = []
                    for gain in self.grid:
                        one = self.once(setting, folds[name], machine[name], dataclasses.replace(law, K=gain))
                        ise.append(self._indices(setting, one.y[0])["ise"])
                        advance(1)
                    grids[name] = ise
                    law = dataclasses.replace(law, K=self.grid[int(np.argmin(ise))])
                used[name] = law
                left[name] = []
                for at in range(self.seeds if name in seeded else 1):
                    drawn = (
                        dataclasses.replace(law, weight_seed=SEEDS_APART * self.seed + at) if name in seeded else law
                    )
                    left[name].append(self.once(setting, folds[name], machine[name], drawn))
                    advance(1)
        return self._dataset(setting, left, grids)

    def once(self, setting: Setting, fold: Fold, machine: ca.Function, law: Any) -> TrialRecord:
        """Run a law once through a compiled fold of its structure: its numbers and its memory are inputs there."""
        n = fold.samples
        memory = law.start(Task(ca.DM(setting.reference), self.plant.sampling_time, self.plant.input_limits))
        if "added" in memory._fields:
            memory = memory._replace(added=ca.DM(setting.added / law.input_unit))
        elif np.any(setting.added):
            raise InvalidValue(f"{type(law).__name__} has no input for the disturbance: use test=curve")
        one = TrialInput(n, np.zeros(len(setting.plant.states)), np.zeros((0, n)), np.zeros((1, n + 1)))
        return next(stream(fold, setting.reference, [one], trial=machine, values=fold.values_of(law), memory=memory))

    def _indices(self, setting: Setting, y: Any) -> dict[str, float]:
        kicks = KICKS if self.test == "step" else None
        return indices(setting.reference[0, :-1], y[:-1], float(self.plant.sampling_time), kicks)

    def _dataset(
        self, setting: Setting, left: Mapping[str, list[TrialRecord]], grids: Mapping[str, list[float]]
    ) -> xr.Dataset:
        """Return the record; what a law without weights gave stands under every seed."""
        names, n = list(left), setting.added.shape[1]
        axes = ("controller", "seed", "sample")
        speed = self.plant.output_signal
        kinds = {
            "output": (speed.unit, speed.doc),
            "error": (speed.unit, "reference minus output"),
            "input": (self.plant.input_signal.unit, self.plant.input_signal.doc),
            **{signal.name: (signal.unit, signal.doc) for signal in TOLD},
        }
        rows = {kind: np.full((len(names), self.seeds, n + 1), np.nan) for kind in kinds}
        values: dict[str, Any] = {}
        for i, name in enumerate(names):
            for j in range(self.seeds):
                one = left[name][min(j, len(left[name]) - 1)]
                rows["output"][i, j] = one.y[0]
                rows["error"][i, j] = setting.reference[0] - one.y[0]
                rows["input"][i, j, :-1] = one.u[0]
                for signal, row in zip(self.controllers[name].tells, one.told, strict=True):
                    if signal in TOLD:
                        rows[signal.name][i, j, :-1] = row
                for metric, value in self._indices(setting, one.y[0]).items():
                    values.setdefault(metric, np.full((len(names), self.seeds), np.nan))[i, j] = value
        variables: dict[str, Any] = {
            "reference": (("sample",), setting.reference[0], {"units": speed.unit, "long_name": "reference speed"}),
            "added": (
                ("sample",),
                np.append(setting.added[0], np.nan),
                {"units": self.plant.input_signal.unit, "long_name": "disturbance added to the input"},
            ),
            **{k: (axes, rows[k], {"units": unit, "long_name": text}) for k, (unit, text) in kinds.items()},
            **{
                metric: (axes[:2], value, {"units": UNITS[metric], "long_name": metric.replace("_", " ")})
                for metric, value in values.items()
            },
        }
        coordinates: dict[str, Any] = {
            "controller": ("controller", names, {"units": "", "long_name": "controller"}),
            "seed": ("seed", np.arange(1, self.seeds + 1), {"units": "1", "long_name": "seed of the weights"}),
            "sample": ("sample", np.arange(n + 1), {"units": "1", "long_name": "sample"}),
            "time": ("sample", np.arange(n + 1) * self.plant.sampling_time, {"units": "s", "long_name": "time"}),
        }
        if grids:
            variables["grid_ise"] = (
                ("tuned", "grid"),
                np.array(list(grids.values())),
                {"units": "(m/s)^2 s", "long_name": "ISE against the fixed gain"},
            )
            coordinates["tuned"] = ("tuned", list(grids), {"units": "", "long_name": "tuned controller"})
            coordinates["grid"] = ("grid", list(self.grid), {"units": "1", "long_name": "gain p1 = p2"})
        return xr.Dataset(variables, coordinates)

    def scores(self, data: xr.Dataset) -> Scores:
        """Return every controller's metrics: medians over the seeds, with the 10-90 % range where they differ."""
        seeded = [name for name, law in self.controllers.items() if isinstance(law, BPFIPID)]
        return median_scores(data, seeded)

    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, as functions that draw."""
        from studies.ato.figures import ato_figures

        return ato_figures(self, data)


UNITS = {
    "ise": "(m/s)^2 s",
    "iae": "m",
    "itse": "(m/s)^2 s^2",
    "itae": "m s",
    "rise_time": "s",
    "settling_time": "s",
    "peak_time": "s",
    "overshoot_percent": "%",
    "recovery_time": "s",
    "max_jerk": "m/s^3",
    "energy_index": "m/s^2",
    "gain_max": "1",
}


def machines(folds: Mapping[str, Fold]) -> dict[str, ca.Function]:
    """Return every fold's trial as machine code; folds with equal equations share one."""
    keys = {name: fold.trial.serialize() for name, fold in folds.items()}
    different = {keys[name]: fold.trial for name, fold in folds.items()}
    with ThreadPoolExecutor() as pool:
        built = dict(zip(different, pool.map(compiled, different.values()), strict=True))
    return {name: built[key] for name, key in keys.items()}


STUDY = AtoStudy()
