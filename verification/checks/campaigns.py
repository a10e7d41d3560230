"""Very many learning campaigns made to leave a bound, in plain doubles.

A trial is one compiled Function, a fold over samples; learning and the adversary's choices are rows of numbers. So it
owes nothing to the intervals by which bounds are proved, and whatever it reaches can be reached.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.errors import InvalidValue
from models.expression import Expression
from models.plant import Plant
from models.quantity import symbolised
from verification.checks.adversary import GAINS, Choices, Possible, after, course, fresh, gains, impossible
from verification.checks.envelope import Ends, Envelope, chosen_of
from workbench.fold.fold import Setter
from workbench.fold.machine_code import compiled
from workbench.fold.tightened import SAMPLES

UNROLLED = 20  # samples folded into one function
EXPLORED = 0.4  # share of campaigns that take after no other
ALONE = 20  # campaigns at the beginning that do not
ROOM = 1000  # campaigns whose choices are kept before those that hold no end are forgotten


class PlantEquations(NamedTuple):
    """A plant's sample as expressions of columns of symbols; one input, one output."""

    x: Expression
    u: Expression
    w: Expression
    k: Expression
    p: Expression
    """The parameters that may differ between trials, (np, 1)."""
    x_next: Expression
    y: Expression
    """The output at x."""


class Ran(NamedTuple):
    """A trial as it ran, up to its end."""

    x: Array
    """(nx, length + 1)."""
    u: Array
    """(length,)."""
    y: Array
    """(length + 1,)."""
    seen: Array
    """The output with its noise, (length + 1,)."""
    w: Array
    """(nw, length)."""


def plant_equations(plant: Plant, parameters: Sequence[str] = ()) -> PlantEquations:
    """Return a plant's equations in its own symbols, the named quantities (``mass``, ``line.length``) being symbols.

    Raises InvalidValue for a name that the plant does not have.
    """
    replaced = symbolised(plant, only=frozenset(parameters))
    if missing := set(parameters) - set(replaced.names):
        raise InvalidValue(
            f"parameters must be among {', '.join(symbolised(plant).names)}; got {', '.join(sorted(missing))}"
        )
    by_name = dict(zip(replaced.names, replaced.symbols, strict=True))
    at = plant.symbols()
    p = ca.vertcat(*(by_name[name] for name in parameters)) if parameters else ca.SX(0, 1)
    following, measured = replaced.thing.next_state(**at), replaced.thing.measured(at["x"])
    return PlantEquations(at["x"], at["u"], at["w"], at["k"], p, following, measured)


def campaigns(plant: PlantEquations, possible: Possible, *, count: int, trials: int, seed: int = 0) -> Envelope:
    """Run ``count`` campaigns of ``trials`` trials each and return what they reached.

    The first campaigns learn in each of the ways there are, one way throughout. Of the others, each is made by an
    adversary of its own, or takes after one that reached an end at some sample. The same
    seed gives the same campaigns. Raises InvalidValue where plant and possibilities do not fit each other.
    """
    if count < 1 or trials < 1:
        raise InvalidValue(f"campaigns and trials must be at least 1, got {count} and {trials}")
    rng = np.random.default_rng(seed)
    machine = _Machine(plant, possible)
    n, least = possible.samples, possible.scored_samples
    states, inputs, increments = Ends.none(plant.x.numel(), n + 1), Ends.none(1, n), Ends.none(1, n)
    mse, mse_by = np.zeros(trials), np.full(trials, -1, dtype=np.int64)
    kept: dict[int, tuple[Choices, ...]] = {}
    room = ROOM
    for campaign in range(count):
        if campaign < len(GAINS):
            chosen = fresh(possible, trials, rng, GAINS[campaign])
        elif campaign < ALONE or rng.random() < EXPLORED:
            chosen = fresh(possible, trials, rng)
        else:
            chosen = after(possible, kept[_far(states, inputs, mse_by, rng)], rng)
        kept[campaign] = chosen
        for trial, ran in enumerate(_campaign(machine, possible, chosen)):
            states.take(ran.x, campaign, trial)
            inputs.take(ran.u[None, :], campaign, trial)
            with np.errstate(all="ignore"):
                increments.take(np.diff(ran.y)[None, :], campaign, trial)
                if ran.u.size < least:
                    continue
                error = float(np.mean((possible.reference[1 : least + 1] - ran.y[1 : least + 1]) ** 2))
            if mse_by[trial] < 0 or not error <= mse[trial]:
                mse[trial], mse_by[trial] = (np.inf if np.isnan(error) else error), campaign
        if len(kept) >= room or campaign == count - 1:
            holders = states.holders() | inputs.holders() | increments.holders() | {int(one) for one in mse_by}
            kept = {one: chosen for one, chosen in kept.items() if one in holders}
            room = ROOM + 2 * len(kept)
    return Envelope(
        states=states,
        inputs=inputs,
        increments=increments,
        mse=mse,
        mse_by=mse_by,
        count=count,
        trials=trials,
        seed=seed,
        choices=kept,
    )


def replay(plant: PlantEquations, possible: Possible, chosen: Sequence[Choices]) -> tuple[Ran, ...]:
    """Run one campaign again, of which all choices are told, and return its trials.

    Raises InvalidValue for choices that cannot come.
    """
    if fault := impossible(possible, chosen):
        raise InvalidValue(fault)
    return tuple(_campaign(_Machine(plant, possible), possible, chosen))


def reached_again(plant: PlantEquations, possible: Possible, witness: Mapping[str, object]) -> float:
    """Return the value that a witness of ``held_inside`` tells of, from its choices alone, run again.

    Raises InvalidValue for a witness of something else, and for choices that cannot come.
    """
    ran = replay(plant, possible, chosen_of(witness))
    signal, row, sample, trial = (witness.get(name) for name in ("signal", "row", "sample", "trial"))
    match signal, row, sample, trial:
        case str("state" | "input"), int(), int(), int() if 0 <= trial < len(ran):
            rows = ran[trial].x if signal == "state" else ran[trial].u[None, :]
            if 0 <= row < rows.shape[0] and 0 <= sample < rows.shape[1]:
                return float(rows[row, sample])
    raise InvalidValue(
        "a witness must tell signal (state or input), row, sample and trial of a value that was reached; "
        f"got {signal}, {row}, {sample}, {trial}"
    )


def _far(states: Ends, inputs: Ends, mse_by: NDArray[np.int64], rng: np.random.Generator) -> int:
    """Return a campaign that holds an end of a state or an input at a sample, or the worst error of a trial, drawn."""
    rows = states.low.shape[0]
    row = int(rng.integers(rows + 2))
    if row > rows:
        by = mse_by
    elif rng.random() < 0.5:
        by = inputs.low_by[0, :, 0] if row == rows else states.low_by[row, :, 0]
    else:
        by = inputs.high_by[0, :, 0] if row == rows else states.high_by[row, :, 0]
    by = by[by >= 0]
    return int(by[int(rng.integers(by.size))]) if by.size else int(states.low_by[0, 0, 0])


def _campaign(machine: _Machine, possible: Possible, chosen: Sequence[Choices]) -> Iterator[Ran]:
    """Yield the trials of one campaign; what is past a trial's end is never looked at."""
    plan = np.array(possible.first_plan, dtype=float)
    wanted = np.diff(possible.reference) if possible.learns_on == "increment" else possible.reference[1:]
    n = possible.samples
    for one in chosen:
        rng, disturbing = np.random.default_rng(one.seed), np.random.default_rng(one.disturbance_seed)
        end = one.length
        rows = zip(*(np.asarray(side, dtype=float) for side in possible.disturbance), strict=True)
        for row, ends in enumerate(rows):
            machine.w[:, row] = course(one.disturbance, ends, n, disturbing)
        machine.run(one.start, plan, one.parameters)
        x, y = machine.x[: end + 1].T.copy(), machine.y[: end + 1].copy()
        seen = y
        if possible.noise > 0:
            seen = y + course(one.noise, (-possible.noise, possible.noise), end + 1, rng)
        yield Ran(x, plan[:end].copy(), y, seen, machine.w[:end].T.copy())
        with np.errstate(all="ignore"):  # a plant may leave the numbers: the ends then are infinite
            error = wanted[:end] - (np.diff(seen) if possible.learns_on == "increment" else seen[1:])
            plan[:end] += gains(possible, one, error, rng) * error


class _Machine:
    """One trial of a plant, compiled, with the arrays that it reads and writes."""

    def __init__(self, plant: PlantEquations, possible: Possible) -> None:
        n = possible.samples
        nx, nw, np_ = plant.x.numel(), plant.w.numel(), plant.p.numel()
        for name, size, given in (
            ("start", nx, np.size(possible.start[0])),
            ("parameters", np_, np.size(possible.parameters[0])),
            ("disturbance", nw, len(possible.disturbance[0])),
            ("plant's inputs", 1, plant.u.numel()),
            ("plant's outputs", 1, plant.y.numel()),
        ):
            if size != given:
                raise InvalidValue(f"{name}: {size} value(s) must be told, got {given}")
        self.x, self.y = np.empty((n + 1, nx)), np.empty(n + 1)
        self.w = np.empty((n, nw))
        self._x0, self._u, self._p = np.empty(nx), np.empty(n), np.empty(np_)
        self._function = compiled(_trial(plant, n))
        self._buffer, self._call = self._function.buffer()  # keeps no reference to the arrays: they live here
        _hand(self._buffer.set_arg, (self._x0, self._u, self.w, self._p))
        _hand(self._buffer.set_res, (self.x, self.y))

    def run(self, start: Sequence[float], plan: Array, parameters: Sequence[float]) -> None:
        """Run N samples of a plan under the disturbance in ``w``; states and output then stand in ``x`` and ``y``."""
        self._x0[:], self._u[:], self._p[:] = start, plan, parameters
        self._call()


def _hand(setter: Setter, arrays: Sequence[Array]) -> None:
    """Give a Function's buffer its arrays in their order; what is empty stays a null pointer."""
    for index, array in enumerate(arrays):
        if array.size:
            setter(index, array.data)


def _trial(plant: PlantEquations, samples: int) -> ca.Function:
    """Return a trial (x0, u, w, p) -> (x, y) as a fold that machine code makes one loop of."""
    given = ca.MX.sym("x0", plant.x.numel()), ca.MX.sym("u", 1, samples), ca.MX.sym("w", plant.w.numel(), samples)
    x0, u, w = given
    p = ca.MX.sym("p", plant.p.numel())
    rows = [(plant.u, u), (plant.w, w), (plant.k, ca.MX(ca.DM(range(samples)).T)), (plant.p, p)]
    results = ca.veccat(plant.x_next, plant.y)
    rows = [(symbol, row) for symbol, row in rows if symbol.numel() and ca.depends_on(results, symbol)]
    fixed = sum(symbol is plant.p for symbol, _ in rows)
    sample = ca.Function(
        "sample",
        [plant.x, *(symbol for symbol, _ in rows)],
        [ca.densify(plant.x_next), ca.densify(plant.y)],
        {"cse": True},
    )
    fold = sample.mapaccum(f"{SAMPLES}_1_{fixed}", samples, 1, {"base": UNROLLED})
    handed = [ca.repmat(row, 1, samples) if symbol is plant.p else row for symbol, row in rows]
    x, y = fold.call([x0, *handed])
    last = ca.Function("last", [plant.x, plant.p], [ca.densify(plant.y)])(x[:, -1], p)
    outputs = ca.horzcat(x0, x), ca.horzcat(y, last)
    return ca.Function("campaign_trial", [*given, p], [*outputs], ["x0", "u", "w", "p"], ["x", "y"])
