"""By which gain a law changes the plan of a sample, shown sample by sample on the graph of what it learns.

The change of the plan is brought into a normal form. Where every product in it holds the error of what is learned on,
the rest is the gain, whatever else that depends on; the error, the output and the reference are held together by
e = r - y. Samples for which the law computes the same are looked at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache

import numpy as np

from verification.checks.form_range import Unbounded
from verification.checks.learned_forms import Column, Forms, ranges
from verification.checks.learned_graph import NEXT, PLAN, Content, Learned, OtherForm
from verification.checks.polynomial import Form, negative, total
from workbench.contracts.law import LearningGain

FREE = float("-inf"), float("inf")
KEPT = 32
"""Answers that are kept: the laws of a study are the same in most of its cases."""


def kinds(learned: Learned, gain: LearningGain) -> int:
    """Return how many samples that differ were looked at. Raises OtherForm where one does not learn as declared."""
    content = learned.content
    found = _counted(learned, gain) if content is None else _known(content, gain)
    if isinstance(found, str):
        raise OtherForm(found)
    return found


@lru_cache(maxsize=KEPT)
def _known(content: Content, gain: LearningGain) -> int | str:
    """Answer from the content alone: what is not in it cannot change the answer."""
    return _counted(content.learned(), gain)


def _counted(learned: Learned, gain: LearningGain) -> int | str:
    try:
        return Shown(learned=learned, gain=gain).samples()
    except OtherForm as error:
        return str(error)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """Shows of every sample of a task by which gain a law learns."""

    learned: Learned
    gain: LearningGain
    fields: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Between which ends fields of the memory lie, those that were asked for."""

    def samples(self) -> int:
        """Return how many samples that differ were looked at. Raises OtherForm where one does not learn as declared."""
        if (missing := self.learned.may_miss()) is not None:
            raise OtherForm(missing)
        seen: set[tuple[object, ...]] = set()
        for k in range(self.learned.samples):
            nodes = self.learned.nodes
            column = Column(learned=self.learned, k=k, targets=(nodes[PLAN][0, k], nodes[NEXT][0, k]))
            if column.content not in seen:
                seen.add(column.content)
                self._kept(column)
                self._moved(column)
        return len(seen)

    def _kept(self, column: Column) -> None:
        """Raise OtherForm unless the plan is kept where the trial did not reach k + 1."""
        if not self.learned.varying_lengths:
            return
        forms = Forms(column=column, reached=False)
        left = forms.apart(_change(forms), lambda powers: False)
        if not left.is_zero:
            raise OtherForm(
                f"where the trial did not reach k + 1 the plan of sample {column.k} is not kept: it changes by "
                f"{forms.words(left)}"
            )
        self._within(forms)

    def _moved(self, column: Column) -> None:
        """Raise OtherForm unless the plan moves by a gain in its range times the error of what is learned on."""
        forms = Forms(column=column, reached=True)
        change = forms.apart(_change(forms), lambda powers: not forms.without_signal(powers))
        besides = {powers: one for powers, one in change.terms.items() if forms.without_signal(powers)}
        if besides:
            raise OtherForm(
                f"the plan of sample {column.k} also changes by {forms.words(Form(besides))}, which has not the error "
                "of what is learned on, at k + 1, as a factor"
            )
        why = self._within(forms, forms.divided(change))
        if why is not None:
            raise OtherForm(
                f"the gain of sample {column.k} is not shown to lie in [{self.gain.low:.9g}, {self.gain.high:.9g}]: "
                f"{why}"
            )

    def _within(self, forms: Forms, gain: Form | None = None) -> str | None:
        """Return why a gain is not shown to lie between its ends, first for any memory, then for what memory may be."""
        why: str | None = None
        for ends in (lambda name: FREE, self._field):
            found = ranges(forms, ends)
            try:
                found.check(forms.divisors)
                why = gain and found.within(gain, Fraction(self.gain.low), Fraction(self.gain.high))
            except Unbounded as error:
                why = str(error)
            if why is None:
                return None
        if gain is None:
            raise OtherForm(f"the plan of sample {forms.column.k} may have no value: {why}")
        return why

    def _field(self, name: str) -> tuple[float, float]:
        """Return between which ends a field of the memory lies: where it begins, and whatever it becomes."""
        if name not in self.fields:
            self.fields[name] = self._becomes(name)
        return self.fields[name]

    def _becomes(self, name: str) -> tuple[float, float]:
        begins = self.learned.memory[name]
        if not np.isfinite(begins).all():
            return FREE
        low, high = float(begins.min()), float(begins.max())
        seen: set[tuple[object, ...]] = set()
        for (_, k), node in self.learned.nodes[f"next_{name}"].items():
            column = Column(learned=self.learned, k=k, targets=(node,))
            if column.content in seen:
                continue
            seen.add(column.content)
            forms = Forms(column=column, reached=None)
            try:
                span = ranges(forms, lambda name: FREE).of(forms.values[0])
            except Unbounded:
                return FREE
            low, high = min(low, float(span.lo[0])), max(high, float(span.hi[0]))
        return low, high


def _change(forms: Forms) -> Form:
    plan, following = forms.values
    return total(following, negative(plan))
