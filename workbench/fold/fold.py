"""One trial as one Function, a campaign as a fold of trials.

One sample (plant and law, the state frozen once the trial has ended) is an SX Function; a trial is its
``mapaccum`` wrapped, together with the law's learning on whole rows, in an MX Function; a campaign is the trial
folded over trials, either streamed through compiled code or as one symbolic Function.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple, TypeAlias, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from models.array import Array
from models.expression import Expression, as_expression
from models.function_name import function_name
from models.plant import Plant
from models.quantity import InvalidValue, values_of
from workbench.contracts.law import AnyLaw, Task, Trial
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.fold.answers import estimated, learned, tellings
from workbench.fold.equations import MEMORY, Equations, equations
from workbench.fold.named import as_matrix, expressions, flat, like
from workbench.fold.sample import Sample, without_time
from workbench.fold.tightened import SAMPLES

TIMETABLE = f"{MEMORY}timetable"
ROWS = ("u", "x", "y", "estimate", "applied", "told")
TOGETHER = 2**16  # numbers of trials' records that lie together: few, so that they come from memory used before
KEPT = 32  # folds whose Functions a process keeps
UNROLLED = 20  # samples folded into one function; larger saves calls, and costs compile time


@dataclasses.dataclass(frozen=True)
class Fold:
    """The trials of a plant under a controller over N samples, as CasADi Functions.

    ``parameters`` names the float quantities of both (``plant.mass``, ``law.lam``): they are inputs of the
    Functions, so another value needs no new Function.
    """

    plant: Plant
    law: AnyLaw
    samples: int
    parameters: tuple[str, ...]
    values: tuple[float, ...]
    start: ca.Function
    """(r, sampling_time, p[, chance][, plan]) -> memory_*: the memory before the first trial."""
    trial: ca.Function
    """(memory_*, x0, length, r, w, noise, p) -> memory_*_next, x_end, u, x, y, estimate, mse, applied, told, last."""
    told: dict[str, Array] = dataclasses.field(default_factory=dict)
    """What ``start`` is told besides: the random numbers of a law that asked for them, and a first plan."""

    @property
    def memory(self) -> tuple[str, ...]:
        """Names of the trial Function's memory inputs."""
        return tuple(name for name in self.trial.name_in() if name.startswith(MEMORY))

    @property
    def law_memory(self) -> tuple[str, ...]:
        """Names of those that are the law's own: all but the rows that depend on time alone."""
        return tuple(name for name in self.memory if name != TIMETABLE)

    def values_of(self, law: AnyLaw) -> tuple[float, ...]:
        """Return the parameters' values with another law of the same class and structure."""
        return (*values_of(self.plant).values(), *values_of(law).values())

    def campaign(self, trials: int) -> ca.Function:
        """Return the whole campaign as one symbolic Function, so that derivatives through it exist.

        (x0 (nx), length (1, trials), r (ny, N + 1), w (nw, N * trials), noise (ny, (N + 1) * trials), p)
        -> u, y, mse, estimate: the trials' columns side by side.
        """
        plant, n = self.plant, self.samples
        body = self.trial.mapaccum("campaign_fold", trials, len(self.memory)) if self.memory else self.trial.map(trials)
        shapes = {
            "x0": (len(plant.states), 1),
            "length": (1, trials),
            "r": (len(plant.outputs), n + 1),
            "w": (len(plant.disturbances), n * trials),
            "noise": (len(plant.outputs), (n + 1) * trials),
            "p": (len(self.parameters), 1),
        }
        given = {name: ca.MX.sym(name, *shape) for name, shape in shapes.items()}
        handed = {
            name: ca.repmat(value, 1, trials) if name in ("x0", "r", "p") else value for name, value in given.items()
        }
        if self.memory:
            first = self.start.call(
                {"r": given["r"], "sampling_time": plant.sampling_time, "p": given["p"], **self.told}
            )
            handed |= {name: first[name] for name in self.memory}
        result = body.call(handed)
        outputs = ["u", "y", "mse", "estimate"]
        return ca.Function("campaign", list(given.values()), [result[o] for o in outputs], list(given), outputs)


def build(plant: Plant, law: AnyLaw, samples: int, task: Task | None = None) -> Fold:
    """Return the fold of a plant and a controller over N samples, N at least 2.

    ``task`` is what the law is told besides reference, sampling time and limits; by default nothing.
    Raises InvalidValue where step, output, act or learn give values of the wrong shape.
    """
    asked = equations(plant, law, samples, task)
    start, trial = _functions(asked)
    told: dict[str, Array] = {}
    if task is not None and task.chance.numel():
        told["chance"] = _numbers(task.chance)
    if task is not None and task.first_plan is not None:
        told["plan"] = _numbers(task.first_plan)
    values = (*values_of(plant).values(), *values_of(law).values())
    return Fold(plant, law, samples, tuple(asked.symbols), values, start, trial, told)


def _numbers(expression: Expression) -> Array:
    """Return the numbers that an expression without symbols stands for, same shape."""
    return np.asarray(ca.DM(expression).full())


@lru_cache(maxsize=KEPT)
def _functions(asked: Equations) -> tuple[ca.Function, ca.Function]:
    """Return a fold's Functions ``start`` and ``trial``, made once for equations that compute the same."""
    plant, law, samples, given, memory = asked.plant, asked.law, asked.samples, asked.given, asked.memory
    ny, nu = len(plant.outputs), len(plant.inputs)
    first, fields, kept, symbols = list(asked.first), list(asked.kept), list(asked.kept.values()), asked.symbols
    r, p, sampling_time = given["r"], given["p"], given["sampling_time"]
    handed = {name: value for name, value in given.items() if name not in ("sampling_time", "chance", "plan")}
    reached = ca.DM(range(samples + 1)).T <= given["length"]
    rows: dict[str, ca.MX | ca.DM] = {
        "r": r[:, :-1],
        "r_next": r[:, 1:],
        "w": given["w"],
        "noise": given["noise"][:, :-1],
        "k": ca.DM(range(samples)).T,
        "reached_next": reached[1:],
    }
    sample, table = without_time(asked.sample, symbols, p, samples)
    timed = {}
    if table is not None:
        timed[TIMETABLE] = rows["timed"] = ca.MX.sym(TIMETABLE, *table.shape)
        first.append(table)
    besides: dict[str, ca.MX] = {name: given[name] for name in ("chance", "plan") if name in given}
    handed_first: dict[str, ca.MX] = {"r": r, "sampling_time": sampling_time, "p": p, **besides}
    start = ca.Function("start", [*handed_first.values()], first, [*handed_first], [*fields, *timed])
    begin = as_matrix(asked.begin)
    begun = [_with_parameters(plant.ended_at(sample.x) != 0, sample.x, symbols)(begin, p)] if sample.over else []
    ready = [as_matrix(one) for one in expressions(asked.ready)]
    folded = _folded(sample, symbols, begin, kept, ready, begun, rows, p, samples)
    length = given["length"]
    if begun:
        within = ca.logic_and(reached[1:], ca.logic_not(ca.horzcat(begun[0], folded.over[:, :-1])))
        reached = ca.horzcat(1, within)
        length = ca.sum2(within)

    x = ca.horzcat(begin, folded.x)
    last = _with_parameters(plant.measured(sample.x), sample.x, symbols)(folded.x[:, -1], p)
    y = ca.if_else(ca.repmat(reached, ny, 1), ca.horzcat(folded.y, last), ca.DM.nan(ny, samples + 1))
    u = folded.u
    if sample.feeds_back:
        u = ca.if_else(ca.repmat(reached[1:], nu, 1), u, ca.DM.nan(nu, samples))
    squared = ca.if_else(ca.repmat(reached[1:], ny, 1), (r - y)[:, 1:] ** 2, 0)
    seen = y + given["noise"]
    rows_left = [as_expression(one) for one in (r, seen, r - seen, u, reached)]
    state = like(asked.ready, folded.state)
    left = Trial(rows_left[0], rows_left[1], rows_left[2], rows_left[3], rows_left[4], state)
    following = expressions(learned(law, memory, left))
    told = ca.vertcat(*(as_matrix(one) for one in tellings(law, memory, left, samples)))
    estimate = estimated(law, memory, plant, samples)
    results = {
        **{f"{name}_next": ca.densify(as_matrix(value)) for name, value in zip(fields, following, strict=True)},
        **{f"{name}_next": rows_of_time for name, rows_of_time in timed.items()},
        "x_end": folded.x[:, -1],
        "u": ca.densify(u),
        "x": ca.densify(x),
        "y": ca.densify(y),
        "estimate": ca.densify(ca.MX(1, 0) if estimate is None else as_matrix(estimate)),
        "mse": ca.densify(ca.sum2(squared) / length),
        "applied": ca.densify(folded.applied),
        "told": ca.densify(told if law.tells else ca.MX(0, samples)),
        "last": ca.densify(ca.MX(length)),
    }
    trial = ca.Function(
        f"trial_{function_name(plant.name)}_{function_name(type(law).__name__.lower())}",
        [*kept, *timed.values(), *handed.values()],
        list(results.values()),
        [*fields, *timed, *handed],
        list(results),
    )
    return start, trial


class _Folded(NamedTuple):
    """Rows of one trial: state after each sample, acting state after each sample, inputs and output at each."""

    x: ca.MX
    state: list[ca.MX]
    over: ca.MX
    u: ca.MX
    y: ca.MX
    applied: ca.MX


def _folded(
    sample: Sample,
    symbols: dict[str, ca.SX],
    begin: ca.MX,
    memory: Sequence[ca.MX],
    ready: Sequence[ca.MX],
    over: Sequence[ca.MX],
    rows: Mapping[str, ca.MX | ca.DM],
    p: ca.MX,
    samples: int,
) -> _Folded:
    """Fold the sample over a trial; only the inputs that it depends on are handed to it."""
    results = [sample.x_next, *sample.state_next, *sample.over_next, sample.u, sample.y, sample.applied]
    mapped = [(sample.rows[name], rows[name]) for name in rows]
    for symbol, field in zip(sample.memory, memory, strict=True):
        mapped.append((symbol, field if field.shape[1] == 1 else field[:, :samples]))
    mapped += [(symbol, p[index]) for index, symbol in enumerate(symbols.values())]
    everything = ca.vertcat(*(ca.vec(result) for result in results))
    mapped = [(symbol, value) for symbol, value in mapped if symbol.numel() and ca.depends_on(everything, symbol)]
    mapped.sort(key=lambda pair: pair[1].shape[1] == 1)  # those that are the same at every sample come last
    begin_with = [sample.x, *sample.state, *sample.over]
    one = ca.Function("sample", [*begin_with, *(symbol for symbol, _ in mapped)], results, {"cse": True})
    accumulated = len(begin_with)
    fixed = sum(value.shape[1] == 1 for _, value in mapped)
    fold = one.mapaccum(f"{SAMPLES}_{accumulated}_{fixed}", samples, accumulated, {"base": UNROLLED})
    handed = [value if value.shape[1] == samples else ca.repmat(value, 1, samples) for _, value in mapped]
    folded = fold.call([begin, *ready, *over, *handed])
    states = 1 + len(sample.state)
    ended = folded[states] if over else ca.MX(0, samples)
    return _Folded(folded[0], folded[1:states], ended, *folded[-3:])


def _with_parameters(value: ca.SX, x: ca.SX, symbols: dict[str, ca.SX]) -> ca.Function:
    return ca.Function("at_end", [x, ca.vertcat(*symbols.values())], [value])


def stream(
    fold: Fold,
    reference: ArrayLike,
    trials: Iterable[TrialInput],
    *,
    trial: ca.Function | None = None,
    values: Sequence[float] | None = None,
    carry_state: bool = False,
    keep_memory: bool = False,
    memory: tuple[object, ...] | None = None,
) -> Iterator[TrialRecord]:
    """Run trials one after the other and yield what each left.

    reference has shape (ny, N + 1). ``trial`` is the compiled ``fold.trial`` (default: virtual machine), ``values``
    replaces the parameters' values, ``carry_state`` starts a trial where the last one ended, ``keep_memory`` gives each
    record the memory that its trial was run with, ``memory`` (as the law's ``start`` gives it, in numbers) replaces
    the memory before the first trial.
    """
    function = trial or fold.trial
    p = np.array(fold.values if values is None else values, dtype=float)
    r = np.asarray(reference, dtype=float)
    told = {"r": _flat(r), "p": p}  # buffers keep no reference: what they are handed must outlive them
    first = _begun(fold, told)
    own = ((name, first[name]) for name in fold.law_memory)
    for (name, field), start in zip(own, flat(memory or ()), strict=memory is not None):
        given_field = _flat(_numbers(cast(Expression, start)))
        if field.size != given_field.size:
            raise InvalidValue(f"{name} must hold {field.size} number(s), got {given_field.size}")
        field[:] = given_field
    second = {name: np.empty_like(field) for name, field in first.items()}
    given = {name: np.zeros(function.size_in(name)).ravel() for name in ("x0", "length", "w", "noise")}
    shapes = {name: function.size_out(name) for name in (*ROWS, "mse", "last", "x_end")}
    ends = np.cumsum([0, *(rows * columns for rows, columns in shapes.values())])
    left = np.empty(ends[-1])
    parts = {name: slice(*ends[i : i + 2]) for i, name in enumerate(shapes)}
    results = {name: left[part] for name, part in parts.items()}
    together = 1 + TOGETHER // left.size
    shelf = np.empty((0, left.size))
    blocks: list[Array] = []
    triggers = []  # the memory goes to and fro between two sets of arrays
    for now, then in ((first, second), (second, first)):
        buffer, trigger = function.buffer()
        _hand(buffer.set_arg, function.name_in(), {**now, **given, **told})
        _hand(buffer.set_res, function.name_out(), {**{f"{n}_next": a for n, a in then.items()}, **results})
        triggers.append((buffer, trigger))
    handed: dict[str, Array | None] = {}
    for index, one in enumerate(trials):
        if one.truth is not None:
            p[: one.truth.size] = one.truth
            _retimed(fold, told, second if index % 2 else first)
        given["x0"][:] = results["x_end"] if carry_state and index else one.x0
        given["length"][0] = one.length
        for name, drawn in (("w", one.w), ("noise", one.noise)):
            if given[name].size and drawn is not handed.get(name):
                given[name][:] = np.ravel(drawn, order="F")
                unchanging = isinstance(drawn, np.ndarray) and not drawn.flags.writeable
                handed[name] = drawn if unchanging else None
        triggers[index % 2][1]()
        at = index % together
        if at == 0:
            shelf = np.empty((together, left.size))
            blocks = [
                shelf[:, parts[name]].reshape(together, *shapes[name][::-1]).transpose(0, 2, 1)
                for name in (*ROWS, "mse", "last")
            ]
        shelf[at] = left
        *rows, mse, last = [block[at] for block in blocks]
        used: tuple[Array, ...] = ()
        if keep_memory:
            before = second if index % 2 else first
            used = tuple(before[name].reshape(fold.start.size_out(name), order="F").copy() for name in fold.law_memory)
        yield TrialRecord(**dict(zip(ROWS, rows, strict=True)), mse=mse[:, 0], length=int(last[0, 0]), memory=used)


def _retimed(fold: Fold, told: dict[str, Array], memory: dict[str, Array]) -> None:
    """Compute again what depends on time and on the plant's quantities alone, as these have changed."""
    if TIMETABLE in memory:
        memory[TIMETABLE][:] = _begun(fold, told)[TIMETABLE]


def _begun(fold: Fold, told: dict[str, Array]) -> dict[str, Array]:
    """Return the memory before the first trial, flat arrays by name."""
    first = {name: np.zeros(fold.start.numel_out(name)) for name in fold.memory}
    if first:
        sampling_time = np.array([float(fold.plant.sampling_time)])
        buffer, begin = fold.start.buffer()
        besides = {name: _flat(value) for name, value in fold.told.items()}
        _hand(buffer.set_arg, fold.start.name_in(), {**told, "sampling_time": sampling_time, **besides})
        _hand(buffer.set_res, fold.start.name_out(), first)
        begin()
    return first


def _flat(values: ArrayLike) -> Array:
    return np.ascontiguousarray(np.asarray(values, dtype=float).ravel(order="F"))


# CasADi's buffers are untyped
Setter: TypeAlias = Callable[..., None]
"""Takes an index and an array's memory; CasADi's stubs ask for its size too, which the library finds itself."""


def _hand(setter: Setter, names: Sequence[str], arrays: Mapping[str, Array]) -> None:
    """Give a Function's buffer the arrays by name; what is empty stays a null pointer."""
    for name, array in arrays.items():
        if array.size:
            setter(names.index(name), array.data)
