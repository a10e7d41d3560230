"""What a study is: a frozen declaration whose fields are its settings. One kind, whatever is studied."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from models.actuator import Actuator
from models.array import Array
from models.expression import as_expression
from models.following import following
from models.plain_text import check_plain
from models.plant import Plant, Signal
from models.quantity import InvalidValue, count, declared, given, nested, part, quantity, rebuilt, symbolised
from models.reference import Given, Reference
from models.trying import tried
from workbench.contracts import drawn
from workbench.contracts.claim import Claim, Expectations, Expected
from workbench.contracts.law import AnyLaw, Law, Task
from workbench.contracts.plainly import as_departure, as_disturbance, as_initial, as_noise, as_plan
from workbench.contracts.prepared import chance_of, prepared, refusal_of
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.contracts.scenario import (
    AtRest,
    Departure,
    Disturbance,
    Initial,
    Noise,
    NormalNoise,
    Undisturbed,
)
from workbench.contracts.trial_length import TrialLength, as_trial_length
from workbench.contracts.tuning import Progress as Progress
from workbench.contracts.tuning import Tuned as Tuned
from workbench.contracts.tuning import Tuning as Tuning
from workbench.contracts.verifying import Verification, check_verification

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")
Scores = dict[str, dict[str, float | None]]
"""Metrics by controller and name; None stands for one that does not exist in a run."""
Draw = Callable[[], "Figure"]
"""Draws and returns a Matplotlib figure."""
Scorer = Callable[["Study", xr.Dataset], Scores]
"""Gives metrics by controller from a study and its record."""
Claimer = Callable[["Study", xr.Dataset], Sequence[Claim]]
"""Makes claims on a campaign from the study and its record."""

NAME = r"\w[\w-]*"  # of studies, cases and controllers: they become names of files and of settings
MOST_RECORDED = 10**8  # samples of every signal kept in memory, about 4 GB in all


class Measures(NamedTuple):
    """What a study measures beyond the common metrics."""

    headings: Mapping[str, str]
    """What a table calls every metric, its unit included, by the metric's name."""
    scores: Scorer
    """Gives these metrics by controller."""


class Folded(NamedTuple):
    """What one controller of a study is made of."""

    plant: Plant
    law: AnyLaw
    samples: int
    """N of the trial: samples are 0..N."""
    task: Task
    """What the law is told."""


@declared
class Sweep:
    """One field of some controllers varied, everything else as in the study: its last MSE is recorded."""

    field: str = given(doc="the field of the controllers")
    values: tuple[float, ...] = given(doc="its values")
    controllers: tuple[str, ...] = given(doc="names of the controllers")
    unit: str = given(default="1", doc="unit of the field")


@declared
class Inverse:
    """A first plan that is a share of what the nominal model needs to follow the reference."""

    share: float = quantity(default=1.0, unit="1", doc="share of the model's inverse", structural=True)


class Scenario(NamedTuple):
    """What a campaign meets, each in its own kind."""

    trial_length: TrialLength
    initial: Initial
    disturbance: Disturbance
    noise: Noise
    truth: Mapping[str, Departure]


@declared
class Study:
    """Plant x task x laws x scenario, run trial after trial.

    Every controller meets the same trial lengths, initial states, disturbances, noise and departures of the true plant,
    all drawn from ``seed``. A controller stops early when it diverges: when a trial leaves the finite numbers, or the
    root mean square error of an output exceeds ``divergence_factor`` times that output's largest reference.

    ``plant`` is the plant as it is believed to be: what laws are told of it as a model. The plant that runs stands
    behind the actuator and differs by ``truth``. ``cases`` are named changes of settings: a paper with several
    experiments is one study with several cases. ``draws`` are repetitions with other random parts: draw d is the
    campaign of seed + d.

    A study whose settings shape several of its parts at once keeps them in ``own``, whose fields are set like those
    of the study, and says in ``compose(own, seed)`` which fields of the study they make (see :func:`composed`).
    """

    name: str = given(default="study", doc="name, used for folders and reports")
    title: str = given(default="", doc="what the study is, in one line")
    source: str = given(default="", doc="paper or report that it follows")
    own: object = part(default=None, doc="settings of the study's own, if it has any", inline=True)
    # it takes the study's own settings, of whatever class they are
    compose: Callable[..., Mapping[str, object]] | None = given(
        default=None, doc="compose(own, seed) gives fields of the study"
    )
    plant: Plant = part(doc="the plant, as it is believed to be")
    reference: Reference | ArrayLike = part(doc="what the outputs should follow")
    controllers: Mapping[str, AnyLaw] = part(doc="the controllers by name")
    trials: int = count(default=150, doc="number of trials, the first included", least=1, most=100_000)
    trial_length: TrialLength | ArrayLike = part(default=TrialLength(law="fixed"), doc="how long trials last")
    noise: Noise | ArrayLike = part(default=NormalNoise(), doc="measurement noise")
    disturbance: Disturbance | ArrayLike = part(default=Undisturbed(), doc="what disturbs the plant")
    initial: Initial | ArrayLike = part(default=AtRest(), doc="where trials begin")
    actuator: Actuator = part(default=Actuator(), doc="what lies between command and plant")
    truth: Mapping[str, Departure | ArrayLike] = part(
        default={}, doc="how quantities of the true plant differ from the declared ones, by their path"
    )
    first_plan: Inverse | ArrayLike | None = part(
        default=None, doc="the inputs that learning laws try first, in the plant's units; None: each law's own"
    )
    verify: Verification = part(default=Verification(), doc="what proofs are stated for, and the bounds asked")
    seed: int = count(default=0, doc="seed of everything random", most=2**53)
    draws: int = count(default=1, doc="campaigns with seeds of their own: seed, seed + 1, ...", least=1, most=100_000)
    divergence_factor: float = quantity(
        default=1000.0,
        unit="1",
        doc="RMS error over largest reference at which a law has diverged",
        above=0,
        structural=True,
    )
    continues: bool = given(default=False, doc="whether a trial begins in the state that the last one ended in")
    cases: Mapping[str, Mapping[str, object]] = given(default={}, doc="changes of settings by path, by the case's name")
    case: str = given(default="", doc="the case that this is; empty for the study as it is declared")
    renamed: Mapping[str, str] = given(default={}, doc="settings that have another path now, by the old one")
    gone: Mapping[str, str] = given(default={}, doc="what replaced a setting that is no more, by its path")
    sweeps: tuple[Sweep, ...] = given(default=(), doc="fields varied besides")
    tuning: Tuning | None = part(default=None, doc="how laws are tuned before the run")
    weights: tuple[float, ...] = given(default=(), doc="weights of the outputs' MSE in a comparison, one an output")
    scorers: tuple[Scorer, ...] = given(default=(), doc="metrics beyond the common ones")
    summary: Callable[[Study, xr.Dataset], Scores] | None = given(
        default=None, doc="metrics over all draws, given the study and their metrics (draws.nc)"
    )
    compared: tuple[Measures, ...] = given(default=(), doc="what a comparison of laws on this plant measures besides")
    watch: Callable[[], Callable[[TrialRecord, Array], str | None]] | None = given(
        default=None, doc="makes a further watch: given a trial and the reference, why the law has diverged, or None"
    )
    derived: Callable[[Study, xr.Dataset], xr.Dataset] | None = given(
        default=None, doc="adds to a run's record what follows from it"
    )
    documents: Callable[[Study, xr.Dataset], Mapping[str, object]] | None = given(
        default=None, doc="what is written besides, JSON by file name"
    )
    drawings: Callable[[Study, xr.Dataset], Mapping[str, Draw]] | None = given(
        default=None, doc="figures by name, given the record, to which draws add their metrics as scores"
    )
    claims: tuple[Claimer, ...] = given(
        default=(), doc="make claims on a campaign from the study and its record, besides those that are installed"
    )
    expected: Expectations = given(
        default={}, doc="how claims are expected to stand, by name without the study's, besides what is installed"
    )

    def check(self) -> None:
        """Raise InvalidValue where plant, reference, scenario and controllers do not fit together."""
        if self.compose is not None:
            for name, value in self.compose(self.own, self.seed).items():
                self._set(name, value)
        self._check_names()
        self._check_expected()
        self._check_plant()
        if not isinstance(self.reference, Reference):
            self._set("reference", Given(values=self.reference))
        self._set_scenario()
        self._check_laws()
        recorded = len(self.controllers) * self.trials * (self.horizon + 1)
        if recorded > MOST_RECORDED:
            raise InvalidValue(
                f"trials must be fewer: {len(self.controllers)} controller(s) x {self.trials} trials x "
                f"{self.horizon + 1} samples exceed the {MOST_RECORDED:.0e} samples that a run may record"
            )

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _check_names(self) -> None:
        for what, name in (("name", self.name), *((f"cases.{case}", case) for case in self.cases)):
            if not re.fullmatch(NAME, name):
                raise InvalidValue(f"{what} must be letters, digits, _ and -, got {name!r}")
        check_plain("title", self.title)
        check_plain("source", self.source, lines=True)

    def _check_expected(self) -> None:
        for claim, said in self.expected.items():
            if not isinstance(said, (list, tuple)) or not all(isinstance(one, Expected) for one in said):
                raise InvalidValue(
                    f"expected[{claim!r}] must be a list of Expected(standing=..., why=...), got {said!r}"
                )
            for one in said:
                if wrong := [case for case in one.cases if case not in ("default", *self.cases)]:
                    raise InvalidValue(f"expected[{claim!r}] speaks of {wrong[0]!r}, which is no case of {self.name}")

    def _check_plant(self) -> None:
        if not isinstance(self.plant, Plant):
            raise InvalidValue(f"plant must be a Plant, made with its settings as in Cart(mass=80); got {self.plant!r}")
        plant = self.plant
        for signal in (*plant.states, *plant.inputs, *plant.outputs, *plant.disturbances):
            _check_signal(signal)
        tried(plant)

    def _set_scenario(self) -> None:
        """Bring what the campaign meets into its own kind, and hold it against the plant."""
        plant, samples = self.plant, self.horizon + 1
        self._set("trial_length", as_trial_length(self.trial_length, self.trials))
        self._set("noise", as_noise(self.noise, plant, samples))
        self._set("disturbance", as_disturbance(self.disturbance, plant, samples - 1))
        self._set("initial", as_initial(self.initial, plant, self.trials))
        self._set("truth", {name: as_departure(name, value) for name, value in self.truth.items()})
        self.scenario.trial_length.least(self.horizon)
        _ = self.plan
        known = symbolised(plant).names
        for name in self.truth:
            if name not in known:
                raise InvalidValue(f"truth.{name} must be a quantity of {plant.name}, one of: {', '.join(known)}")
        _ = self.plant_that_runs
        check_verification(self.verify, plant)

    def _check_laws(self) -> None:
        if not isinstance(self.controllers, Mapping):
            raise InvalidValue(
                f"controllers must be laws by name, as in {{'pd': PD(kp=2.0)}}; got {type(self.controllers).__name__}"
            )
        if not self.controllers:
            raise InvalidValue("controllers must name at least one controller, got none")
        for name, law in self.controllers.items():
            if not re.fullmatch(NAME, str(name)):
                raise InvalidValue(f"controllers must have names of letters, digits, _ and -, got {name!r}")
            if not isinstance(law, Law):
                raise InvalidValue(
                    f"controllers.{name} must be a Law, made with its settings as in PD(kp=2.0); got {law!r}"
                )
            if not law.stepped and type(law).act is Law.act:
                raise InvalidValue(
                    f"controllers.{name}: {type(law).__name__} must give act, as expressions, or decide, in numbers"
                )
            check_plain(f"controllers.{name}.source", law.source, lines=True)
            for signal in law.tells:
                _check_signal(signal)

    @property
    # fields of the study by name: the constructor checks each
    def composed(self) -> frozenset[str]:
        """The fields that are made of the study's own settings, and are no settings themselves."""
        return frozenset() if self.compose is None else frozenset(self.compose(self.own, self.seed))

    @property
    def scenario(self) -> Scenario:
        """What a campaign meets."""
        assert isinstance(self.trial_length, TrialLength) and isinstance(self.noise, Noise)
        assert isinstance(self.disturbance, Disturbance) and isinstance(self.initial, Initial)
        departures = {name: one for name, one in self.truth.items() if isinstance(one, Departure)}
        return Scenario(self.trial_length, self.initial, self.disturbance, self.noise, departures)

    @cached_property
    def reference_samples(self) -> Array:
        """The reference, shape (outputs, N + 1): computed once, and nobody may write into it."""
        assert isinstance(self.reference, Reference)
        samples = Given(values=np.array(self.reference.samples(self.plant), dtype=float)).samples(self.plant)
        samples.flags.writeable = False
        return samples

    @property
    def horizon(self) -> int:
        """N, the last sample (T_d of the papers)."""
        return int(self.reference_samples.shape[1]) - 1

    @cached_property
    def plant_that_runs(self) -> Plant:
        """The true plant behind its actuator; see :attr:`true_plant`."""
        return self.actuator.wrapped(self.true_plant)

    @cached_property
    def true_plant(self) -> Plant:
        """The plant without an actuator, its quantities the true ones where those are the same in every trial."""
        same = {name: one.range[0] for name, one in self.scenario.truth.items() if one.repeats}
        values = dict(zip(*symbolised(self.plant)[1::2], strict=True))
        changes = {name: values[name] * factor for name, factor in same.items() if factor != 1}
        return rebuilt_plant(self.plant, changes)

    @cached_property
    def relative_degree(self) -> int | None:
        """The first d for which some y(k + d) depends on some u(k), for the plant behind its actuator; None: none."""
        return self.plant_that_runs.relative_degree(limit=min(200, self.horizon))

    def task(self, law: AnyLaw | None = None) -> Task:
        """Return what a law is told, in numbers."""
        chance = chance_of(law, self.seed) if law is not None else np.empty(0)
        return Task(
            as_expression(ca.DM(self.reference_samples)),
            as_expression(ca.DM(float(self.plant.sampling_time))),
            self.plant_that_runs.input_limits,
            self.plant,
            self.relative_degree,
            self.scenario.trial_length.varies,
            None if self.plan is None else as_expression(ca.DM(self.plan)),
            as_expression(ca.DM(chance)),
        )

    @cached_property
    def plan(self) -> Array | None:
        """The inputs to try first, (inputs, N), or None where that is left to each law."""
        if self.first_plan is None:
            return None
        inputs, n = len(self.plant.inputs), self.horizon
        if isinstance(self.first_plan, Inverse):
            begin = self.scenario.initial.draw(self.plant, 1, np.random.default_rng(self.seed))[0]
            return self.first_plan.share * following(self.plant, self.reference_samples, begin)
        return as_plan(self.first_plan, inputs, n)

    def refusals(self) -> dict[str, str]:
        """Return why controllers do not suit this study, by name."""
        found = {}
        for name, law in self.controllers.items():
            reason = law.channels.refusal(name, self.plant) or refusal_of(law, self.task(law))
            if reason:
                found[name] = reason
        return found

    def law(self, controller: str) -> AnyLaw:
        """Return a controller's law, ready for the task."""
        law = self.controllers[controller]
        return prepared(law, self.task(law))

    def inputs(self) -> list[TrialInput]:
        """Return what every trial is run with, drawn from the seed: lengths, starts, disturbances, noise, truth."""
        return drawn.inputs(self)

    def factors(self) -> dict[str, Array]:
        """Return the factors of the quantities that are not the same in every trial, (trials,) by path."""
        return drawn.factors(self)

    def folded(self) -> dict[str, Folded]:
        """Return what every controller that suits the study is made of, by name."""
        refused = self.refusals()
        plant, n = self.plant_that_runs, self.horizon
        return {
            name: Folded(plant, self.law(name), n, self.task(law))
            for name, law in self.controllers.items()
            if name not in refused
        }


def composed(own: T, compose: Callable[[T, int], Mapping[str, Any]], **fields: Any) -> Study:
    """Return a study whose parts are made of settings of its own: ``compose(own, seed)`` gives fields of the study.

    ``fields`` are the others. What is composed is no setting itself, and is made again whenever ``own`` or the seed is
    changed.
    """
    seed = int(fields.get("seed", 0))
    return Study(own=own, compose=compose, **{**fields, **compose(own, seed)})


def rebuilt_plant(plant: Plant, changes: Mapping[str, float]) -> Plant:
    """Return a plant with other values of some quantities, by path."""
    return rebuilt(plant, nested(changes))


def _check_signal(signal: Signal) -> None:
    """Raise InvalidValue for a signal whose unit or description cannot be printed."""
    check_plain(f"the unit of {signal.name!r}", signal.unit)
    check_plain(f"the description of {signal.name!r}", signal.doc, lines=True)
