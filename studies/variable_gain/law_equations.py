"""What the patent's equations (3) and (5) say of a study's law, made of the law's own symbols."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.expression import Expression, as_expression
from models.quantity import symbolised
from verification.certificates.anywhere import anywhere
from verification.certificates.numbers import numbers
from verification.certificates.theorem import theorem
from verification.checks.polynomial import Identity
from verification.checks.values import values_of
from workbench.contracts.certificate import Certificate
from workbench.contracts.law import AnyLaw, Task, Trial
from workbench.contracts.study import Study
from workbench.controllers.parts.rows import joined

SAMPLES, AT = 5, 2
"""Samples of the trial in which equations are compared, and the one that is looked at."""
POSITION, SPEED = 0, 1
"""Rows of the outputs."""


class Gains(NamedTuple):
    """Between which values a law's learning gain lies, and rows of speed errors at which it comes close to the ends."""

    low: Fraction
    high: Fraction
    tried: tuple[Array, ...]
    fixed: bool


class LawEquations:
    """The equations of one law of a study whose outputs are position and speed."""

    def __init__(self, study: Study, controller: str) -> None:
        self.study = study
        self.law = study.law(controller)

    @cached_property
    def tells_gain(self) -> bool:
        """Whether the law tells its learning gain, because it varies."""
        return any(signal.name == "learning_gain" for signal in self.law.tells)

    @cached_property
    def learns_initially(self) -> bool:
        """Whether the law has a gain lambda_0."""
        return "lam0" in symbolised(self.law).names

    @property
    def lam0(self) -> Fraction:
        """The gain lambda_0, exactly as it is set."""
        return Fraction(float(dict(zip(*symbolised(self.law)[1::2], strict=True))["lam0"]))

    def ratio(self) -> Identity:
        """Return (5): the initial position error of the next trial is 1 - lambda_0 times that of this one."""
        one = _OneTrial(self.study, self.law, frozenset({"lam0"}))
        lam0 = one.named["lam0"]
        return Identity(
            left=one.start_error(one.after)[POSITION],
            right=(1 - lam0) * one.error[POSITION, 0],
            at=one.at,
            method="initial errors of two trials from the law's own place and learn and the plant's own output, all "
            "that the law remembers being symbols",
        )

    def learning(self) -> Identity:
        """Return (3): the input of the next trial is that of this one and lambda times the slope of the speed error."""
        one = _OneTrial(self.study, self.law, frozenset({"lam"}))
        lam = one.gain[AT] if self.tells_gain else one.named["lam"]
        return Identity(
            left=one.planned(one.after, one.y_after) - one.planned(one.before, one.y),
            right=lam * (one.error[SPEED, AT + 1] - one.error[SPEED, AT]) / one.step,
            at=one.at,
            method="inputs of two trials from the law's own act and learn, all that the law remembers being symbols",
        )

    @cached_property
    def gains(self) -> Gains:
        """Between which values the gain lies, whatever the speed errors of a trial are."""
        silent: Array = np.zeros(self.study.horizon + 1)
        if not self.tells_gain:
            lam = Fraction(float(dict(zip(*symbolised(self.law)[1::2], strict=True))["lam"]))
            return Gains(lam, lam, (silent,), True)
        low, high = values_of(self._told)
        return Gains(Fraction(low), Fraction(high), (silent, self._spike), False)

    def gain_certificate(self) -> Certificate:
        """Return the certificate of ends of the gain: it is a setting, or lies there whatever the speed errors are."""
        if not self.tells_gain:
            lam = self.gains.low
            return numbers("The gain is a setting.", {"low": (lam, "1"), "high": (lam, "1")}, ("<=", "low", "high"))
        return anywhere("The law's gain by sample, of the speed errors of a trial.", self._told, "gain")

    def ratio_certificate(self, says: str) -> Certificate:
        """Return the certificate of (5), and that 1 - lambda_0 is of size below 1."""
        own = numbers(
            "lambda_0 is a setting.", {"low": (self.lam0, "1"), "high": (self.lam0, "1")}, ("<=", "low", "high")
        )
        return theorem("shrinking", identity=self.ratio().certificate(says), gain=own)

    def attained(self, speed_error: Array) -> float:
        """Return the gain at the sample AT, computed by the compiled law from a trial's speed errors."""
        if not self.tells_gain:
            return float(self.gains.low)
        return float(self._told(np.asarray(speed_error, dtype=float))[AT])

    @cached_property
    def _spike(self) -> Array:
        spike = np.zeros(self.study.horizon + 1)
        spike[AT] = 1.0
        return spike

    @cached_property
    def _told(self) -> ca.Function:
        """The gain that the law tells, (1, N), of the speed errors of a trial, (1, N + 1)."""
        n = self.study.horizon
        e_v, nothing = as_expression(ca.SX.sym("e_v", 1, n + 1)), as_expression(ca.SX.zeros(1, n + 1))
        begun = self.law.start(self.study.task(self.law))
        memory = type(begun)(*(as_expression(ca.SX(one)) for one in begun))
        e = ca.vertcat(nothing, e_v)
        trial = Trial(-e, -2 * e, e, nothing[:, 1:], nothing + 1, ())
        return ca.Function("gain", [e_v], [self.law.tell(memory, trial)[0]], ["e_v"], ["gain"])


class _OneTrial:
    """A trial of which everything is a symbol, and the memory before and after it."""

    def __init__(self, study: Study, law: AnyLaw, only: frozenset[str]) -> None:
        gains = symbolised(law, only=only)
        self.plant, self.law = study.plant, gains.thing
        self.named: Mapping[str, Expression] = dict(zip(gains.names, gains.symbols, strict=True))
        self.at: dict[str, tuple[Expression, Array]] = {
            name: (symbol, np.array(value)) for name, symbol, value in zip(*gains[1:], strict=True)
        }
        outputs = len(self.plant.outputs)
        self.step = self._symbol("step", np.array(float(self.plant.sampling_time)))
        self.r = self._symbol("r", np.full((outputs, SAMPLES + 1), 2.0))
        self.x0 = self._symbol("x0", np.full(len(self.plant.states), 0.7))
        later = self._symbol("e", np.outer(np.arange(1.0, outputs + 1), [0.1, 0.3, -0.2, 0.5, 0.2]))
        begun = self.law.start(Task(self.r, self.step))
        self.before = type(begun)(
            *(
                one if self._is_step(one) else self._symbol(f"memory.{i}", _some(one.shape))
                for i, one in enumerate(begun)
            )
        )
        self.error = ca.horzcat(self.start_error(self.before), later)
        self.y = self._symbol("y", np.tile([1.0, 1.5, 1.9, 2.2, 2.4], (outputs, 1)))
        self.y_after = self._symbol("y_after", np.tile([0.9, 1.4, 2.0, 2.1, 2.6], (outputs, 1)))
        u = ca.horzcat(*(self.planned(self.before, self.y, k) for k in range(SAMPLES)))
        trial = Trial(self.r, self.r - self.error, self.error, u, as_expression(ca.SX.ones(1, SAMPLES + 1)), ())
        self.after = self.law.learn(self.before, trial)
        told = self.law.tell(self.before, trial)
        self.gain = told[0] if told else as_expression(ca.SX.zeros(1, SAMPLES))

    def _symbol(self, name: str, value: Array) -> Expression:
        shape = value.shape if value.ndim == 2 else (value.size, 1)
        made = as_expression(ca.SX.sym(name, *shape))
        self.at[name] = (made, value)
        return made

    def start_error(self, memory: tuple[Expression, ...]) -> Expression:
        """Return the outputs' errors where the law places the start."""
        return self.r[:, 0] - self.plant.measured(self.law.place(memory, self.x0))

    def planned(self, memory: tuple[Expression, ...], y: Expression, k: int = AT) -> Expression:
        """Return the input at a sample at which y was measured."""
        now = type(memory)(*(one[:, k] if one.shape[1] == SAMPLES else one for one in memory))
        u, _ = self.law.act(now, (), self.r[:, k], self.r[:, k + 1], y[:, k])
        return joined(u)

    def _is_step(self, one: Expression) -> bool:
        return one.shape == (1, 1) and bool(ca.is_equal(as_expression(one), self.step))


def _some(shape: tuple[int, int]) -> Array:
    return np.linspace(0.4, 1.2, shape[0] * shape[1]).reshape(shape)
