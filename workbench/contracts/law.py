"""The contract of a law, what it is told, and what a trial leaves it to learn from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, final

from models.limits import Limits
from models.plant import Signal

LearnedSignal = Literal["output", "increment"]
"""What a law learns on: the output y(k+1), or its increment y(k+1) - y(k)."""


class Task(NamedTuple):
    """What a controller is told before the first trial."""

    reference: Any
    """The reference, shape (outputs, N + 1)."""
    sampling_time: Any
    """The sampling time in seconds."""
    limits: Limits = Limits()
    """What limits the plant's inputs, in its units, however it was given; infinite by default."""

    @property
    def samples(self) -> int:
        """N: a trial has the samples 0..N, and inputs at 0..N-1."""
        return int(self.reference.shape[1]) - 1


class Trial(NamedTuple):
    """What a trial left to learn from. Rows are signals, columns samples.

    Samples after the trial's end are missing: y and e are NaN there and ``reached`` is 0, so whatever a law
    computes from them must go through :func:`workbench.controllers.parts.rows.known`.
    """

    r: Any
    """Reference, (outputs, N + 1)."""
    y: Any
    """Measured output, (outputs, N + 1)."""
    e: Any
    """Error r - y, (outputs, N + 1)."""
    u: Any
    """Input, (inputs, N)."""
    reached: Any
    """gamma of the papers: 1 where the trial reached the sample, else 0; (1, N + 1)."""
    state: Any
    """The law's acting state after each sample, a NamedTuple of rows with N columns, or ()."""


class Estimator(Protocol):
    """The parameters of a law that estimates a pseudo partial derivative phi and steps by rho phi/(lam + phi^2).

    phi moves by eta du/(mu + du^2) times the innovation, and is reset where it or du is below eps.
    """

    @property
    def eta(self) -> float:
        """Step of the estimate, 1."""

    @property
    def rho(self) -> float:
        """Step of the input, 1."""

    @property
    def lam(self) -> float:
        """Weight on input changes, (output/force unit)^2."""

    @property
    def mu(self) -> float:
        """Weight on estimate changes, (force unit)^2."""

    @property
    def eps(self) -> float:
        """Reset threshold of estimate and input change, force unit."""

    @property
    def force_unit(self) -> float:
        """The unit that the law computes in."""

    def first_estimate(self) -> Any:
        """Return the estimate of the first trial."""


class Law(ABC):
    """A law within the trial, and a learning between trials.

    A law is a :func:`models.quantity.declared` dataclass. It gives ``source``, ``start`` and ``act``, and once what
    else it can do; all the rest has a neutral default. Every method is a pure function that works on CasADi values:
    the fold turns them into one compiled function a trial.
    """

    source: ClassVar[str]
    """Where it comes from: paper and equations, or "ours", with the year."""
    learns_on: ClassVar[LearnedSignal | None] = None
    """The signal whose error it learns on between trials; None where it does not learn."""
    tells: ClassVar[tuple[Signal, ...]] = ()
    """What it tells of itself beside its input: what it learned, a gain by sample."""
    solves_per_sample: ClassVar[int] = 0
    """How many optimisation problems it solves at a sample."""

    def __init_subclass__(cls) -> None:
        """Raise TypeError for a law that learns or tells and does not say on what, or of what."""
        super().__init_subclass__()
        if cls.learn is not Law.learn and cls.learns_on is None:
            raise TypeError(f'{cls.__name__} has learn, so it must say learns_on = "output" or "increment"')
        if cls.tell is not Law.tell and not cls.tells:
            raise TypeError(f"{cls.__name__} has tell, so it must name the signals that it tells: tells = signals(...)")

    @abstractmethod
    def start(self, task: Task) -> Any:
        """Return the memory before the first trial: a NamedTuple of CasADi values.

        A field with N or N + 1 columns holds one column a sample; a field with one column is the same for all.
        """

    @abstractmethod
    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the input (in the order of the plant's inputs) and the law's next acting state.

        memory_k is the memory at the sample, r and r_next the reference now and next, y the measured output.
        """

    def ready(self, memory: Any) -> Any:
        """Return the acting state at the beginning of a trial, a NamedTuple of columns; () for a law without."""
        return ()

    def place(self, memory: Any, x0: Any) -> Any:
        """Return the initial state, a column, given the one that the study would start from."""
        return x0

    def learn(self, memory: Any, trial: Trial) -> Any:
        """Return the memory for the next trial."""
        return memory

    def ppd_estimate(self, memory: Any) -> Any:
        """Return the estimate that the trial's input is computed with, (1, N), output units per input unit, or None."""
        return None

    def tell(self, memory: Any, trial: Trial) -> Any:
        """Return one row (1, N) a signal of ``tells``, given the memory that the trial ran with."""
        return ()

    def refusal(self, study: Any) -> str | None:
        """Return why it cannot be used in a study, or None."""
        return None

    @property
    def estimator(self) -> Estimator | None:
        """The parameters of its estimate of the pseudo partial derivative, None for a law without."""
        return None

    @final
    @property
    def keeps_state(self) -> bool:
        """Whether it acts with a state of its own within the trial (an integral, a filter, weights)."""
        return type(self).ready is not Law.ready
