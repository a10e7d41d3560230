"""Trials of a law that is asked sample by sample, in numbers, on the same plant as folded laws run on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from models.array import Array
from models.expression import as_expression
from models.plant import Plant, Signal
from models.quantity import InvalidValue, symbolised
from workbench.contracts.law import AnyLaw, Decision, Seen, Task, Trial
from workbench.contracts.record import TrialInput, TrialRecord
from workbench.fold.answers import asked, decided, kept, placed
from workbench.fold.named import expressions, like


class Stepped:
    """A plant under a stepped law over N samples."""

    def __init__(self, plant: Plant, law: AnyLaw, samples: int, task: Task) -> None:
        self.plant, self.law, self.samples, self.task = plant, law, samples, task
        symbolic = symbolised(plant)
        self.values = np.array(symbolic.values)
        at = plant.symbols()
        thing: Plant = symbolic.thing
        quantities = ca.vertcat(*symbolic.symbols)
        after = thing.next_state(**at)
        acting = thing.applied_input(at["x"], at["u"], at["k"])
        self.step = ca.Function(
            "step",
            [*at.values(), quantities],
            [after, acting, thing.ended_at(after) != 0],
            [*at, "p"],
            ["x_next", "applied", "over"],
        )
        self.output = ca.Function("output", [at["x"], quantities], [thing.measured(at["x"])], ["x", "p"], ["y"])
        self.ended = ca.Function("ended", [at["x"], quantities], [thing.ended_at(at["x"]) != 0], ["x", "p"], ["over"])

    def trials(
        self,
        trials: Iterable[TrialInput],
        *,
        carry_state: bool = False,
        keep_memory: bool = False,
        memory: tuple[Array, ...] | None = None,
    ) -> Iterator[TrialRecord]:
        """Run trials one after the other and yield what each left; ``carry_state`` begins where the last one ended."""
        first = kept(self.law, "start", asked(self.law, "start", self.law.start, self.task))
        memory = first if memory is None else like(first, memory)
        end: Array | None = None
        for one in trials:
            begin = end if carry_state and end is not None else one.x0
            left, trial = self._trial(memory, begin, one)
            used = tuple(np.asarray(ca.DM(field).full()) for field in expressions(memory)) if keep_memory else ()
            yield left._replace(memory=used)
            memory = kept(self.law, "learn", asked(self.law, "learn", self.law.learn, memory, trial))
            end = left.x[:, left.length]

    def _trial(self, memory: tuple[object, ...], begin: Array, one: TrialInput) -> tuple[TrialRecord, Trial[tuple[()]]]:
        plant, n = self.plant, self.samples
        p = self.values if one.truth is None else one.truth
        x0 = placed(self.law, memory, as_expression(ca.DM(begin)))
        now = np.asarray(ca.DM(x0).full()).ravel()
        x, u = np.full((len(plant.states), n + 1), np.nan), np.full((len(plant.inputs), n), np.nan)
        y, applied = np.full((len(plant.outputs), n + 1), np.nan), np.full((len(plant.inputs), n), np.nan)
        told = np.full((len(self.law.tells), n), np.nan)
        state = asked(self.law, "ready", self.law.ready, memory)
        before, note, wrong = np.zeros(len(plant.inputs)), "", ""
        over, last = bool(self.ended(now, p)), 0
        for k in range(one.length + 1):
            x[:, k] = now
            y[:, k] = self.output(now, p).full().ravel()
            last, wrong = k, _not_finite(plant.states, now) or _not_finite(plant.outputs, y[:, k])
            if wrong or over or k == one.length:
                break
            seen_now = Seen(k, y[:, k] + one.noise[:, k], now.copy(), before)
            decision, state = decided(self.law, memory, state, seen_now)
            u[:, k], told[:, k] = self._checked(decision, k)
            note = note or (f"sample {k}: {decision.note}" if decision.note else "")
            wrong = _not_finite(plant.inputs, u[:, k])
            if wrong:
                break
            following, acting, halted = self.step(now, u[:, k], one.w[:, k], k, p)
            now, before, over = following.full().ravel(), u[:, k].copy(), bool(halted)
            applied[:, k] = acting.full().ravel()
        r = np.asarray(ca.DM(self.task.reference).full())
        mse = np.full(len(plant.outputs), np.nan)  # where something is wrong, what comes after is not known
        if wrong:
            note = note or f"sample {last}: {wrong}"
        elif last:
            mse = np.array([_summed(row) for row in (r - y)[:, 1 : last + 1] ** 2]) / last
        acts = applied if type(plant).applied is not Plant.applied else np.zeros((0, n))
        left = TrialRecord(u, x, y, np.zeros((0, n)), mse, acts, told, last, note)
        seen = y + one.noise
        reached = (np.arange(n + 1) <= last).astype(float)[None, :]
        rows = [as_expression(ca.DM(one)) for one in (r, seen, r - seen, u, reached)]
        return left, Trial(rows[0], rows[1], rows[2], rows[3], rows[4], ())

    def _checked(self, decision: Decision, k: int) -> tuple[Array, Array]:
        """Return inputs and what is told as arrays; raise InvalidValue unless there is one number a signal."""
        inputs = self._numbers("give", "input", decision.u, self.plant.inputs, k)
        return inputs, self._numbers("tell", "value", decision.told, self.law.tells, k)

    def _numbers(self, verb: str, what: str, values: ArrayLike, signals: Sequence[Signal], k: int) -> Array:
        names = f" ({', '.join(signal.name for signal in signals)})" if signals else ""
        wanted = f"{type(self.law).__name__}.decide must {verb} {len(signals)} {what}(s){names}"
        try:
            found = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
        except (TypeError, ValueError):
            raise InvalidValue(f"{wanted}, got {' '.join(repr(values).split())} at sample {k}") from None
        if found.shape != (len(signals),):
            raise InvalidValue(f"{wanted}, got {found.size} at sample {k}")
        return found


def _not_finite(signals: Sequence[Signal], values: Array) -> str:
    """Return which signal is not finite, or nothing where all are."""
    return next(
        (f"{one.name} is {value:g}" for one, value in zip(signals, values, strict=True) if not np.isfinite(value)), ""
    )


def _summed(row: Array) -> float:
    """Return the sum of a row, added up in the order of the samples, as the fold does."""
    return float(np.cumsum(row)[-1]) if row.size else 0.0
