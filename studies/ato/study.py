"""Fuzzy immune PID of a train, and its tuning by a network.

The plant is a delayed transfer function; Chu, Yu, Lin, Yuan & Jiang.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from models.actuator import delayed
from models.array import Array
from models.plant import Plant, Signal
from models.quantity import InvalidValue, declared, part, quantities, quantity, rebuilt, switch, table
from models.raised_cosine import RaisedCosines
from models.reference import Given, Reference
from models.switched_delay import SwitchedDelay
from models.transfer import Transfer
from studies.ato.scores import METRICS, indices, scores, share_over_draws
from workbench.contracts.law import AnyLaw
from workbench.contracts.record import TrialRecord
from workbench.contracts.scenario import Undisturbed
from workbench.contracts.study import Draw, Study, composed
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.design.grid import Grid

STEP_SAMPLES, CURVE_SAMPLES = 200, 2175
KICKS = (100, 110)
"""The paper's samples, counted from 1, at which the input of the step is disturbed."""
BRAKING = ((1470, 1560), (1810, 2175))
CURVE = ((0.0, 50.0, 0.0, 26.0), (294.0, 312.0, 26.0, 20.0), (362.0, 432.0, 20.0, 0.0))


class Setting(NamedTuple):
    """What every law is run on: plant with its dead time, reference, and what is added to u at each sample, (N,)."""

    plant: Plant
    reference: Reference
    added: Array


@declared
class Ato:
    """What shapes several parts of the study at once: the train, its dead times, and the test that it is put to.

    Samples are counted from 0 in the record; the paper's sample k is k - 1 there.
    """

    curve: bool = switch(default=False, doc="the speed curve with its switching dead time, in place of the unit step")
    plant: Transfer = part(
        default=Transfer(
            numerator=(0.5,),
            denominator=(1.0, 1.0),
            sampling_time=0.2,
            input_signal=Signal("command", "1", "traction (+) or braking (-) command"),
            output_signal=Signal("speed", "m/s", "speed", role="speed"),
        ),
        doc="the train without its dead time",
    )
    controllers: Mapping[str, AnyLaw] = part(
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
    tune: bool = switch(default=True, doc="give fixed-best the best gain of the grid")
    grid: tuple[float, ...] = table(
        default=tuple(round(0.05 * i, 2) for i in range(1, 31)), unit="input/output", doc="gains p1 = p2 that are tried"
    )

    def check(self) -> None:
        """Raise InvalidValue where a delay is no multiple of the sampling time or there is nothing to tune by."""
        for name, delay in (("traction_delay", self.traction_delay), ("braking_delay", self.braking_delay)):
            try:
                delayed(self.plant, delay)
            except InvalidValue as error:
                raise InvalidValue(str(error).replace("delay", name, 1)) from None
        if self.tune and not self.grid:
            raise InvalidValue("grid must hold at least one gain, got none; or set tune=false")

    @property
    def setting(self) -> Setting:
        """What every law is run on."""
        if not self.curve:
            added = np.zeros(STEP_SAMPLES)
            added[[kick - 1 for kick in KICKS]] = self.disturbance
            ones = np.ones((1, STEP_SAMPLES + 1))
            return Setting(delayed(self.plant, self.traction_delay), Given(values=ones), added)
        plant = SwitchedDelay(plant=self.plant, schedule=self.schedule)
        return Setting(plant, RaisedCosines(horizon=CURVE_SAMPLES, moves=CURVE), np.zeros(CURVE_SAMPLES))

    @property
    def schedule(self) -> tuple[tuple[int, int], ...]:
        """From which step on which dead time stands, in samples."""
        late = round(self.traction_delay / self.plant.sampling_time)
        if not self.curve:
            return ((0, late),)
        early = round(self.braking_delay / self.plant.sampling_time)
        switches = [(0, late)]
        for first, last in BRAKING:  # the paper's sample k is the output of step k - 2
            switches += [(first - 2, early), (last - 1, late)]
        return tuple(switches)

    @property
    def dead_times(self) -> NDArray[np.int64]:
        """The dead time that stands at every sample k, in samples, (N,)."""
        late = np.zeros(CURVE_SAMPLES if self.curve else STEP_SAMPLES, dtype=np.int64)
        for first, delay in self.schedule:
            late[first:] = delay
        return late


def own(study: Study) -> Ato:
    """Return the settings of the study's own."""
    return cast(Ato, study.own)


def ise(study: Study, left: TrialRecord) -> float:
    """Return the integral of the squared error over a trial, (m/s)^2 s."""
    r, y = study.reference_samples[0, :-1], left.y[0, :-1]
    return indices(r, y, float(study.plant.sampling_time))["ise"]


def compose(own: Ato, seed: int) -> dict[str, object]:
    """Return the fields of the study that its own settings make."""
    plant, reference, added = own.setting
    laws = {name: _disturbed(name, law, added) for name, law in own.controllers.items()}
    grid = Grid(
        controllers=("fixed-best",),
        field="K",
        values=own.grid or (1.0,),
        metric=ise,
        name="ise",
        unit="(m/s)^2 s",
        field_doc="gain p1 = p2",
    )
    return {
        "plant": plant,
        "reference": reference,
        "controllers": laws,
        "tuning": grid if own.tune else None,
        "disturbance": Undisturbed(),  # the setting of this name is what is added to the input
    }


def _disturbed(name: str, law: AnyLaw, added: Array) -> AnyLaw:
    """Return a law to whose input something is added at each sample, (N,)."""
    if not added.any():
        return law
    own = {field: value for field, _, value in quantities(law)}
    if "added" not in own:
        raise InvalidValue(
            f"controllers.{name} must have a field added, for what disturbs its input, as FIPID has; got a "
            f"{type(law).__name__}: set disturbance=0, or run the case curve"
        )
    return law if own["added"] else rebuilt(law, {"added": tuple(added.tolist())})


def with_indices(study: Study, data: xr.Dataset) -> xr.Dataset:
    """Return a record with what is added to the input, what the gain was made of, and the indices of every trial."""
    command = study.plant.inputs[0]
    more = {name: data[f"law_{name}"] for name in ("p1", "p2", "f") if f"law_{name}" in data}
    rows = {name: np.full(data["output"].shape[:2], np.nan) for name in METRICS}
    step, kicks = float(study.plant.sampling_time), None if own(study).curve else KICKS
    for at in np.ndindex(*data["output"].shape[:2]):
        y = data["output"].values[at][:-1]
        if np.isfinite(y).all():
            for name, value in indices(data["reference"].values[:-1], y, step, kicks).items():
                rows[name][at] = value
    added = np.append(own(study).setting.added, np.nan)
    about = {"units": command.unit, "long_name": "disturbance added to the input"}
    return data.assign(
        more
        | {"added": (("sample",), added, about)}
        | {
            name: (("controller", "trial"), row, {"units": METRICS[name], "long_name": name.replace("_", " ")})
            for name, row in rows.items()
        }
    )


def figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures of the study by name."""
    from studies.ato.figures import ato_figures

    return ato_figures(data)


STUDY = composed(
    Ato(),
    compose,
    name="ato",
    title="Fuzzy immune PID of a train, and its tuning by a network",
    source="Chu, Yu, Lin, Yuan & Jiang (Tongji University)",
    trials=1,
    draws=50,
    cases={"curve": {"curve": True}},
    renamed={"seeds": "draws"},
    gone={"test": "the step is the study as declared; run the case curve, or set curve=true"},
    scorers=(scores,),
    summary=share_over_draws,
    derived=with_indices,
    drawings=figures,
)
