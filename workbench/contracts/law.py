"""The contract of a law, what it is told, and what a trial leaves it to learn from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Generic, Literal, NamedTuple, Protocol, Self, TypeAlias, TypeVar, final

from models.array import Array
from models.expression import Expression
from models.limits import Limits
from models.plant import Plant, Signal
from models.quantity import Declaration

M = TypeVar("M", bound=tuple[object, ...])
"""A law's memory between trials: a NamedTuple of expressions, or ()."""
S = TypeVar("S", bound=tuple[object, ...])
"""A law's acting state within a trial: a NamedTuple of columns, or ()."""

LearnedSignal = Literal["output", "increment"]
"""What a law learns on: the output y(k+1), or its increment y(k+1) - y(k)."""


class Channels(NamedTuple):
    """For how many outputs and inputs a law is; None: for any number."""

    outputs: int | None = 1
    inputs: int | None = 1

    def admits(self, outputs: int, inputs: int) -> bool:
        """Tell whether a law is for so many outputs and inputs."""
        return self.outputs in (None, outputs) and self.inputs in (None, inputs)

    def refusal(self, law: str, plant: Plant) -> str | None:
        """Return in one line why a law of this name cannot be used on a plant, or None."""
        if self.admits(len(plant.outputs), len(plant.inputs)):
            return None
        wanted = [f"{'any number of' if n is None else n} {word}(s)" for n, word in zip(self, _ENDS, strict=True)]
        have = [f"{len(named)} ({', '.join(one.name for one in named)})" for named in (plant.outputs, plant.inputs)]
        return (
            f"{law} is for {' and '.join(wanted)}, {plant.name} has {' and '.join(have)}: choose a law for several "
            "channels, or give the plant the outputs and inputs that the law is for"
        )


_ENDS = ("output", "input")


class Task(NamedTuple):
    """What a controller is told before the first trial."""

    reference: Expression
    """The reference, shape (outputs, N + 1)."""
    sampling_time: Expression
    """The sampling time in seconds."""
    limits: Limits = Limits()
    """What limits the plant's inputs, in its units, however it was given; infinite by default."""
    model: Plant | None = None
    """The plant as it is believed to be, without what lies between command and plant; it need not be the true one."""
    relative_degree: int | None = 1
    """y(k + d) is the first output that an input u(k) reaches behind the actuator, for every channel; None: none."""
    varying_lengths: bool = False
    """Whether trials may end early."""
    first_plan: Expression | None = None
    """The inputs to try first, (inputs, N) in the plant's units; None where that is left to the law."""
    chance: Expression = Expression(0, 1)
    """The random numbers that the law asked for (:meth:`Law.chance`), a column."""

    @property
    def samples(self) -> int:
        """N: a trial has the samples 0..N, and inputs at 0..N-1."""
        return int(self.reference.shape[1]) - 1


class Seen(NamedTuple):
    """What a stepped law sees at a sample, in numbers."""

    k: int
    """The sample."""
    y: Array
    """Measured outputs, (outputs,)."""
    x: Array
    """The state of the plant that runs, (states,): for a law that is told it."""
    u: Array
    """The inputs of the last sample, (inputs,); zero at the first one."""


class Decision(NamedTuple):
    """What a stepped law decides at a sample."""

    u: Array
    """Inputs, (inputs,)."""
    told: tuple[float, ...] = ()
    """One value a signal of ``tells``."""
    note: str = ""
    """What there is to say, e.g. why no plan could be made."""


class Trial(NamedTuple, Generic[S]):
    """What a trial left to learn from. Rows are signals, columns samples.

    Samples after the trial's end are missing: y and e are NaN there and ``reached`` is 0, so whatever a law
    computes from them must go through :func:`workbench.controllers.parts.rows.known`.
    """

    r: Expression
    """Reference, (outputs, N + 1)."""
    y: Expression
    """Measured output, (outputs, N + 1)."""
    e: Expression
    """Error r - y, (outputs, N + 1)."""
    u: Expression
    """Input, (inputs, N)."""
    reached: Expression
    """gamma of the papers: 1 where the trial reached the sample, else 0; (1, N + 1)."""
    state: S
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

    def first_estimate(self) -> float:
        """Return the estimate of the first trial."""


class PIDAction(NamedTuple):
    """A law that is a PID of the error, in front of which a gain may stand that changes with the sample.

    Positional: u(k) = unit (kp e + ki Ts sum of e + kd (e(k) - e(k-1))/Ts). Incremental: u(k) = u(k-1) +
    unit gain (kp De + ki e + kd D2e), which has no sampling time in it.
    """

    form: Literal["positional", "incremental"]
    kp: float
    ki: float
    kd: float
    unit: float
    """What the action is counted in, in the plant's input per output."""
    gain: Callable[[Mapping[str, Array]], Array] | None = None
    """The gain by sample from the rows that the law tells, by their names; None: it is 1."""
    stimulus: str | None = None
    """The kind of stimulus that the gain is made of, None for a gain without."""


class SlopeLearning(NamedTuple):
    """Learning from the slope of the error: u <- u + unit lambda de/dt, with lambda between two ends."""

    low: float
    high: float
    unit: float
    """In the plant's input per output unit a second."""


class LearningGain(NamedTuple):
    """The ends between which a law's learning gain l lies, in input units per unit of the signal that it learns on.

    It is declared by a law that plans before the trial and then adds l(k) times the error of what it learns on, where
    the trial reached k + 1, to the plan of sample k, and keeps the plan elsewhere:
    u(k) <- u(k) + l(k) e_s(k+1). l(k) may change from sample to sample and from trial to trial as it likes.
    """

    low: float
    """The least l; 0 where l is known to be positive, and no more."""
    high: float
    """The largest l, rounded up."""


class Law(Declaration, ABC, Generic[M, S]):
    """A law within the trial, and a learning between trials.

    A law is a :func:`models.quantity.declared` dataclass. It gives ``source``, ``start`` and, once, what else it can
    do; all the rest has a neutral default. It is *folded* where it gives ``act``: then every method is a pure
    function of CasADi values, from which one compiled function a trial is made. It is *stepped* where it gives
    ``decide``: then it is asked sample by sample, in numbers, and may do what no expression can, such as optimise.
    """

    source: ClassVar[str]
    """Where it comes from: paper and equations, or "ours", with the year."""
    channels: ClassVar[Channels] = Channels()
    """For how many outputs and inputs it is."""
    told: ClassVar[tuple[str, ...]] = ("reference",)
    """What it uses of what it could be told, for a reader: reference, limits, model, state, delay, plan."""
    learns_on: ClassVar[LearnedSignal | None] = None
    """The signal whose error it learns on between trials; None where it does not learn."""
    tells: ClassVar[tuple[Signal, ...]] = ()
    """What it tells of itself beside its input: what it learned, a gain by sample."""
    solves_per_sample: ClassVar[int] = 0
    """How many optimisation problems it solves at a sample."""
    stepped: ClassVar[bool] = False
    """Whether it is asked sample by sample, in numbers; follows from what it gives."""

    def __init_subclass__(cls) -> None:
        """Raise TypeError for a law that learns or tells and does not say on what, or of what."""
        super().__init_subclass__()
        cls.stepped = cls.decide is not Law.decide
        if cls.stepped and cls.act is not Law.act:
            raise TypeError(f"{cls.__name__} must give act (in expressions) or decide (in numbers), it gives both")
        if cls.learn is not Law.learn and cls.learns_on is None:
            raise TypeError(f'{cls.__name__} has learn, so it must say learns_on = "output" or "increment"')
        if not cls.stepped and cls.tell is not Law.tell and not cls.tells:
            raise TypeError(f"{cls.__name__} has tell, so it must name the signals that it tells: tells = signals(...)")

    def ready_for(self, task: Task) -> Self:
        """Return the law made ready for a task, in numbers: with the model that it wants, with its sets computed."""
        return self

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return (low, high) by path of the numbers that are tuned for a task; nothing by default."""
        return {}

    def scaled_for(self, task: Task) -> Self:
        """Return the law with settings from which tuning it for a task can begin, e.g. in the task's units."""
        return self

    def refusal(self, task: Task) -> str | None:
        """Return why it cannot be used for a task, or None; channels are looked at already."""
        return None

    def chance(self, seed: int) -> Sequence[float]:
        """Return the random numbers that it starts with, drawn from a seed; they come back as ``task.chance``."""
        return ()

    @abstractmethod
    def start(self, task: Task) -> M:
        """Return the memory before the first trial: a NamedTuple of CasADi values.

        A field with N or N + 1 columns holds one column a sample; a field with one column is the same for all.
        """

    def act(
        self, memory_k: M, state: S, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression | Sequence[Expression], S]:
        """Return the input (in the order of the plant's inputs) and the law's next acting state.

        memory_k is the memory at the sample, r and r_next the reference now and next, y the measured output.
        """
        raise NotImplementedError(f"{type(self).__name__} is a stepped law: it decides in numbers")

    def decide(self, memory: M, state: S, seen: Seen) -> tuple[Decision, S]:
        """Return what a stepped law decides at a sample, in numbers, and its next acting state."""
        raise NotImplementedError(f"{type(self).__name__} is a folded law: it acts in expressions")

    def ready(self, memory: M) -> S:
        """Return the acting state at the beginning of a trial, a NamedTuple of columns; () for a law without."""
        return ()  # type: ignore[return-value]  # a law without an acting state has S = ()

    def place(self, memory: M, x0: Expression) -> Expression:
        """Return the initial state, a column, given the one that the study would start from."""
        return x0

    def learn(self, memory: M, trial: Trial[S]) -> M:
        """Return the memory for the next trial."""
        return memory

    def ppd_estimate(self, memory: M) -> Expression | None:
        """Return the estimate that the trial's input is computed with, or None.

        Shape (1, N), in output units per input unit; for several channels (outputs x inputs, N), row by row.
        """
        return None

    def tell(self, memory: M, trial: Trial[S]) -> Sequence[Expression]:
        """Return one row (1, N) a signal of ``tells``, given the memory that the trial ran with."""
        return ()

    @property
    def estimator(self) -> Estimator | None:
        """The parameters of its estimate of the pseudo partial derivative, None for a law without."""
        return None

    @property
    def origin(self) -> str:
        """Where what it computes comes from: its source, or that of the law within for an adapter."""
        return self.source

    @property
    def pid(self) -> PIDAction | None:
        """The PID that it is, None for a law that is none."""
        return None

    @property
    def slope_learning(self) -> SlopeLearning | None:
        """How it learns from the slope of the error, None for a law that does not."""
        return None

    @property
    def learning_gain(self) -> LearningGain | None:
        """The ends of its learning gain, None for a law that learns in another form; see :class:`LearningGain`."""
        return None

    @property
    def filters_plan(self) -> bool:
        """Whether it filters the plan as a whole after it has learned, so that a sample's input is no more its own."""
        return False

    @final
    @property
    def places(self) -> bool:
        """Whether it moves the state in which a trial begins."""
        return type(self).place is not Law.place

    @final
    @property
    def keeps_state(self) -> bool:
        """Whether it acts with a state of its own within the trial (an integral, a filter, weights)."""
        return type(self).ready is not Law.ready


# laws of all kinds stand together here, each with a memory of its own
AnyLaw: TypeAlias = Law[Any, Any]
"""A law, whatever its memory and acting state are: what holds laws of all kinds cannot say more."""
