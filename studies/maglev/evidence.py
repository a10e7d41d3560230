"""A campaign of the study and the variants of it that several claims look at."""

from __future__ import annotations

from typing import Protocol, cast

from models.maglev import Maglev
from models.station_runs import Shuttle
from models.vehicle import Vehicle
from studies.maglev.period_contraction import Loop
from studies.maglev.study import ForceNoise
from workbench.contracts.law import AnyLaw
from workbench.evidence.variants import Variants, in_case


class Shuttling(Protocol):
    """What every law of the shuttle has: the gains of S."""

    @property
    def alpha(self) -> float:
        """Gain on S, 1/s."""

    @property
    def lam(self) -> float:
        """Weight of the position error in S, 1/s."""


class Learner(Shuttling, Protocol):
    """What a law has that learns the line resistance."""

    @property
    def gamma(self) -> float:
        """Learning gain over the mass, 1/s."""

    @property
    def late(self) -> int:
        """Samples by which the period that it assumes is too long."""

    @property
    def model(self) -> Vehicle | None:
        """What it knows of the train."""


class Filtered(Learner, Protocol):
    """What a law has that learns it between periods, filtered."""

    @property
    def q_cutoff_hz(self) -> float | None:
        """Cutoff of the zero-phase filter; None: no filter."""

    @property
    def lead_s(self) -> float:
        """Lead of S, s."""


def learns(law: AnyLaw) -> bool:
    """Tell whether a law learns the line resistance: then it tells it."""
    return any(signal.name == "line_resistance" for signal in law.tells)


def within_the_period(law: AnyLaw) -> bool:
    """Tell whether a learner learns with the S of the same instant: then it keeps what it learns as it acts."""
    return law.keeps_state


class Evidence(Variants):
    """A campaign of the study and its variants, and what predicts a learner's change from period to period."""

    @property
    def learners(self) -> list[str]:
        """The controllers that learn, by name."""
        return [name for name, law in self.study.controllers.items() if learns(law)]

    def learner(self, name: str) -> Learner:
        """Return a controller that learns."""
        return cast(Learner, self.study.controllers[name])

    @property
    def train(self) -> Maglev:
        """The true train on its line, without an actuator."""
        return cast(Maglev, self.study.true_plant)

    @property
    def run(self) -> Shuttle:
        """The run that the train should make."""
        return cast(Shuttle, self.study.reference)

    @property
    def force_psd(self) -> float:
        """Density of the noise on the force, N^2/Hz."""
        return cast(ForceNoise, self.study.disturbance).force_psd

    def loop(self, name: str, case: str = "") -> Loop:
        """Return what predicts a law's change from period to period."""
        study = in_case(self.study, case)
        law = study.controllers[name]
        learner, filtered = cast(Learner, law), None if within_the_period(law) else cast(Filtered, law)
        return Loop(
            alpha=learner.alpha,
            lam=learner.lam,
            gamma=learner.gamma,
            lag=study.actuator.lag,
            delay=study.actuator.delay,
            step=float(study.plant.sampling_time),
            filtered=filtered is not None,
            cutoff_hz=filtered.q_cutoff_hz if filtered else None,
            lead=filtered.lead_s if filtered else 0.0,
        )
