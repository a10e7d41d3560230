"""Tracking MPC of any plant: its linearisation, a condensed problem built once, DAQP at every sample, stepped."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models.plant import Plant
from models.quantity import InvalidValue, count, declared, quantity
from workbench.array import Array, checked
from workbench.fold import TrialInput, TrialRecord
from workbench.predictive.quadratic_program import Infeasible, WarmQP


class Last(NamedTuple):
    """Memory of the law: state and input of the sample before."""

    x: Array
    """Shape (nx,)."""
    u: Array
    """Shape (nu,)."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """A tracking problem on one plant, built once: min over the moves du of the cost, with the input in its range.

    In increments x(k+1) - x(k) = A (x(k) - x(k-1)) + B du(k), y(k+1) = y(k) + C (x(k+1) - x(k)): what the linearisation
    leaves out, a constant disturbance included, drops out of the differences.
    """

    law: TrackingMPC
    by_state: Array
    """What x(k) - x(k-1) adds to y(k+1) ... y(k+N), shape (N ny, nx)."""
    by_moves: Array
    """What the moves add to them, in units of ``scale``, shape (N ny, N nu)."""
    scale: float
    """The move that changes the output by about one: the solver's tolerances are absolute."""
    weight: float
    """The error's weight over the largest entry of the Hessian."""
    outputs: int
    inputs: int
    program: WarmQP

    def decide(self, last: Last, x: Any, y: Any, ahead: Any) -> tuple[Array, Last, str]:
        """Return the input u(k), the memory for the next sample, and why no problem could be solved (empty if one was).

        ``x`` (nx,) is the state, ``y`` (ny,) the measured output, ``ahead`` (ny, N) the reference at k+1 ... k+N. With
        no solution the input stays.
        """
        law, now = self.law, checked("x", x, (len(last.x),))
        seen, wanted = checked("y", y, (self.outputs,)), checked("ahead", ahead, (self.outputs, law.N))
        gap = np.tile(seen, law.N) + self.by_state @ (now - last.x) - wanted.T.ravel()
        f = 2 * self.weight * (self.by_moves.T @ gap)
        room = np.concatenate([np.tile(law.upper - last.u, law.N), np.tile(last.u - law.lower, law.N)])
        answer = self.program.solve(f, room / self.scale)
        if isinstance(answer, Infeasible):
            return last.u, Last(now, last.u), answer.reason
        u = np.clip(last.u + self.scale * answer.u[: self.inputs], law.lower, law.upper)  # the solver's rounding
        return u, Last(now, u), ""


@declared
class TrackingMPC:
    """Model predictive control of the output along a reference that is known N samples ahead.

    It minimises error_weight |y - r|^2 + move_weight |du|^2 over N samples of the linearised plant, with every input in
    [lower, upper], and applies the first input. It sees the state of the plant, which the other laws do not.
    """

    source: ClassVar[str] = "textbook, e.g. Maciejowski 2002, Predictive Control with Constraints, ch. 2-3"
    solves_per_sample: ClassVar[int] = 1

    N: int = count(default=20, doc="horizon in samples", least=1)
    error_weight: float = quantity(
        default=1.0, unit="1/output unit^2", doc="weight of the error", above=0, structural=True
    )
    move_weight: float = quantity(
        default=1e-3, unit="1/input unit^2", doc="weight of the input's increment", above=0, structural=True
    )
    lower: float = quantity(default=-1e12, unit="input unit", doc="least input", structural=True)
    upper: float = quantity(default=1e12, unit="input unit", doc="largest input", structural=True)

    def check(self) -> None:
        """Raise InvalidValue unless the limits are in order."""
        if not self.lower < self.upper:
            raise InvalidValue(f"lower must be below upper, got lower {self.lower:g} and upper {self.upper:g}")

    def prepare(self, plant: Plant, x: Sequence[float], u: Sequence[float]) -> Prepared:
        """Return the problem on a plant linearised at the state x and the input u.

        Raises InvalidValue where no move can be seen in the output within the horizon.
        """
        system = plant.linearised(list(x), list(u))
        nu, ny = len(plant.inputs), len(plant.outputs)
        A, B, C = np.asarray(system.A), np.asarray(system.B)[:, :nu], np.asarray(system.C)
        powers = [np.eye(len(A))]
        for _ in range(self.N):
            powers.append(A @ powers[-1])
        by_state = np.cumsum([C @ power for power in powers[1:]], axis=0)
        steps = np.cumsum([C @ power @ B for power in powers[:-1]], axis=0)  # step responses at 1 ... N
        by_moves = np.zeros((self.N, ny, self.N, nu))
        for i in range(self.N):
            for j in range(i + 1):
                by_moves[i, :, j, :] = steps[i - j]
        if not np.any(by_moves):
            raise InvalidValue(f"horizon N must exceed the dead time of {plant.name}, got {self.N}")
        scale = 1 / float(np.abs(by_moves).max())
        gains = scale * by_moves.reshape(self.N * ny, self.N * nu)
        hessian = 2 * (self.error_weight * gains.T @ gains + self.move_weight * scale**2 * np.eye(self.N * nu))
        size = float(np.abs(hessian).max())
        total = np.kron(np.tril(np.ones((self.N, self.N))), np.eye(nu))
        labels = tuple(f"{signal.name} at k + {i}" for i in range(self.N) for signal in plant.inputs)
        rows, names = np.vstack([total, -total]), [f"{n} <= upper" for n in labels] + [f"{n} >= lower" for n in labels]
        flat = by_state.reshape(self.N * ny, len(A))
        program = WarmQP(hessian / size, rows, tuple(names))
        return Prepared(self, flat, gains, scale, self.error_weight / size, ny, nu, program)


def stepped_trial(
    plant: Plant, law: TrackingMPC, reference: Any, one: TrialInput, *, prepared: Prepared | None = None
) -> TrialRecord:
    """Run one trial sample by sample and return it as the fold does (:class:`workbench.fold.TrialRecord`).

    ``reference`` has shape (ny, N + 1); beyond its end its last value holds. The plant is linearised where the trial
    begins, unless ``prepared`` is given. A sample without a solution keeps the input.
    """
    nu, ny, nx = len(plant.inputs), len(plant.outputs), len(plant.states)
    r, x = np.atleast_2d(np.asarray(reference, dtype=float)), np.array(one.x0, dtype=float)
    samples = r.shape[1] - 1
    made = prepared or law.prepare(plant, list(x), [0.0] * nu)
    step, output = plant.step_function(), plant.output_function()
    beyond = np.concatenate([r, np.repeat(r[:, -1:], law.N, axis=1)], axis=1)
    begin = np.clip(np.zeros(nu), law.lower, law.upper)
    rows = {
        "u": np.full((nu, samples), np.nan),
        "x": np.full((nx, samples + 1), np.nan),
        "y": np.full((ny, samples + 1), np.nan),
    }
    acts = type(plant).applied is not Plant.applied
    applied = np.full((nu if acts else 0, samples), np.nan)
    last = Last(x, begin)
    for k in range(one.length + 1):
        rows["x"][:, k], rows["y"][:, k] = x, output(x).full().ravel()
        if k == one.length:
            break
        u, last, _ = made.decide(last, x, rows["y"][:, k] + one.noise[:, k], beyond[:, k + 1 : k + 1 + law.N])
        rows["u"][:, k] = u
        if acts:
            applied[:, k] = np.asarray(ca.DM(plant.applied_input(ca.DM(x), ca.DM(u), k))).ravel()
        x = step(x, u, one.w[:, k], k).full().ravel()
    error = (r - rows["y"])[:, 1 : one.length + 1]
    mse = float((error**2).sum() / one.length)
    return TrialRecord(
        u=rows["u"],
        x=rows["x"],
        y=rows["y"],
        estimate=np.empty((1, 0)),
        mse=mse,
        applied=applied,
        told=np.empty((0, samples)),
    )
