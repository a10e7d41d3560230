"""A campaign of the study and the variants of it that several claims look at."""

from __future__ import annotations

from studies.maglev.period_contraction import Loop
from workbench.evidence.variants import Variants
from workbench.trials import settings

LAGGING = ("actuator.lag=0.4", "actuator.delay=0.6")
NOISY = ("noise.force_psd=1e6",)


class Evidence(Variants):
    """A campaign of the study and its variants, and what predicts a learner's change from period to period."""

    @property
    def learners(self) -> list[str]:
        """The controllers that learn, by name."""
        return [name for name, law in self.study.controllers.items() if hasattr(law, "gamma")]

    def loop(self, name: str, assignments: tuple[str, ...] = ()) -> Loop:
        """Return what predicts a law's change from period to period."""
        study = settings.assigned(self.study, assignments)
        law = study.controllers[name]
        filtered = hasattr(law, "lead_s")
        return Loop(
            alpha=law.alpha,
            lam=law.lam,
            gamma=law.gamma,
            lag=study.actuator.lag,
            delay=study.actuator.delay,
            step=float(study.plant.sampling_time),
            filtered=filtered,
            cutoff_hz=law.q_cutoff_hz if filtered else None,
            lead=law.lead_s if filtered else 0.0,
        )
