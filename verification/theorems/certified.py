"""Certificates of what is proved of one controller: bounds of slopes, what follows of them, and theorems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.plant import Plant
from verification.certificates.bounds import Ask, bounds, looser
from verification.certificates.funnel import Asked, funnel
from verification.certificates.link import linked
from verification.certificates.numbers import Formula, numbers
from verification.certificates.rows import rows
from verification.certificates.theorem import theorem
from verification.checks.delayed import delayed_box, delayed_step
from verification.checks.increment import largest_gain
from verification.enclosure.box import Box
from verification.enclosure.recursion import step_of
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import NotCertified
from workbench.contracts.finding import Finding
from workbench.graph import Graph, read

if TYPE_CHECKING:
    from verification.theorems.dossier import Dossier

CLOSE = 1e-9
"""Share by which slopes are certified wider that are carried through many samples."""
Premises = Mapping[str, Certificate]


def units(plant: Plant) -> Mapping[str, str]:
    """Return the units of a plant's signals, by name."""
    named = (*plant.states, *plant.inputs, *plant.disturbances, *plant.outputs)
    return {signal.name: signal.unit for signal in named}


class Certified:
    """Makes the certificates of one controller; the graphs they are of are read once."""

    def __init__(self, dossier: Dossier) -> None:
        self.of = dossier

    @property
    def _degree(self) -> int:
        return self.of.study.relative_degree or 1

    def _graph(self, increment: bool) -> Graph:
        function = delayed_step(self.of.plant, self._degree, increment=increment)
        graph = read(function)
        linked(function, graph, self._box)
        return graph

    @cached_property
    def _output(self) -> Graph:
        return self._graph(increment=False)

    @cached_property
    def _learned(self) -> Graph:
        return self._graph(increment=True) if self.of.law.learns_on == "increment" else self._output

    @cached_property
    def _box(self) -> Box:
        return delayed_box(self.of.box, self._degree)

    @cached_property
    def _states(self) -> Sequence[str]:
        return next(port.labels for port in self._learned.inputs if port.name == "x")

    @cached_property
    def _input(self) -> str:
        return next(port.labels[0] for port in self._learned.inputs if port.name == "u")

    def _bounds(self, graph: Graph, *asks: Ask) -> Certificate:
        return bounds(graph, self._box, units(self.of.plant), asks)

    def continuous_slope(self, found: Finding, premises: Premises) -> Certificate:
        """A1: the output is continuous, and so is its derivative by the input."""
        return self._bounds(
            self._output, Ask(("y", 0, 0), None, "continuous"), Ask(("y", 0, 0), self._input, "continuous")
        )

    @cached_property
    def _slope(self) -> Certificate:
        slopes = self.of.slopes
        asks = [
            Ask(("y", 0, 0), self._input, side, looser(bound, side))
            for side, bound in (("at least", slopes.gain_low), ("at most", slopes.gain_high))
        ]
        return self._bounds(self._learned, Ask(("y", 0, 0), None, "continuous"), *asks)

    def slope(self, found: Finding, premises: Premises) -> Certificate:
        """Bounds of the slope of what is learned on by the input, and that it is continuous."""
        return self._slope

    def positive_slope(self, found: Finding, premises: Premises) -> Certificate:
        """A4 for the partial derivative: its least value is above 0."""
        least = looser(found.margin or 0.0, "above")
        if not least > 0:
            raise NotCertified("the least slope is too near 0")
        return self._bounds(
            self._learned,
            Ask(("y", 0, 0), None, "continuous"),
            Ask(("y", 0, 0), self._input, "at least", least),
        )

    def ratio(self, found: Finding, premises: Premises) -> Certificate:
        """A2 as printed, of a plant without memory: its slope by the input is bounded, by that input alone."""
        most = looser(found.bound or 0.0, "at most")
        asks = [Ask(("y", 0, 0), self._input, side, bound) for side, bound in (("at least", -most), ("at most", most))]
        return self._bounds(self._learned, Ask(("y", 0, 0), None, "continuous"), *asks)

    @cached_property
    def _slopes(self) -> Certificate:
        """Bounds of the slopes of next states and of what is learned on, by states and input."""
        s, states = self.of.slopes, self._states
        sizes = {("x_next", i, by): s.a[i, j] for i in range(len(states)) for j, by in enumerate(states)}
        sizes |= {("x_next", i, self._input): s.b[i] for i in range(len(states))}
        sizes |= {("y", 0, by): s.c[j] for j, by in enumerate(states)}
        asks = [Ask(("x_next", i, 0), None, "continuous") for i in range(len(states))]
        asks.append(Ask(("y", 0, 0), None, "continuous"))
        for (of, row, by), size in sizes.items():
            for side, bound in (("at most", float(size)), ("at least", -float(size))):
                asks.append(Ask((of, row, 0), by, side, looser(bound, side, CLOSE)))
        for side, bound in (("at least", s.gain_low), ("at most", s.gain_high)):
            asks.append(Ask(("y", 0, 0), self._input, side, looser(bound, side, CLOSE)))
        return self._bounds(self._learned, *asks)

    def _rows(self, weight: float = 1.0) -> Certificate:
        return rows(self._slopes, self._learned, self.of.study.horizon, weight)

    def row_sums(self, found: Finding, premises: Premises) -> Certificate:
        """A2 repaired: the largest row sum of the lifted plant."""
        return self._rows()

    def lambda_min(self, found: Finding, premises: Premises) -> Certificate:
        """Lambda exceeds what the largest slope asks."""
        return theorem("lambda_min", slopes=self._slope, law=self._law)

    def monotone(self, found: Finding, premises: Premises) -> Certificate:
        """The input error falls, with a weight a to the power of the sample."""
        return self._increments(1.0, premises)

    def weighted(self, found: Finding, premises: Premises) -> Certificate:
        """The input error falls, with the weight that was found."""
        return self._increments(found.bound or 1.0, premises)

    def continuous(self, over: Box | None) -> Certificate:
        """States and outputs are continuous, everywhere or over a box that holds every trial."""
        graph = read(delayed_step(self.of.plant, 1, increment=self.of.law.learns_on == "increment"))
        asks = [
            Ask((result.name, entry.row, 0), None, "continuous everywhere")
            for result in graph.outputs
            for entry in result.entries
        ]
        try:
            return bounds(graph, delayed_box(self.of.box, 1), units(self.of.plant), asks)
        except NotCertified:
            if over is None:
                raise
        asks = [one._replace(side="continuous") for one in asks]
        return bounds(graph, delayed_box(over, 1), units(self.of.plant), asks)

    def follows(self, found: Finding, premises: Premises) -> Certificate:
        """An input follows the reference's increments, and stays in the box with its trajectory."""
        wanted, box, plant = self.of.wanted, self.of.box, self.of.plant
        graph = read(step_of(plant))
        ends = [np.stack([one.ravel() for one in box[name]], axis=-1) for name in ("x", "u")]
        n = wanted.u.size
        return funnel(
            graph,
            Asked(
                start=np.repeat(wanted.x[:, :1], 2, axis=1),
                others={
                    name: np.repeat(wanted.w[i, :n, None], 2, axis=1)
                    for i, name in enumerate(next(port.labels for port in graph.inputs if port.name == "w"))
                },
                plan=wanted.u,
                reference=self.of.study.reference_samples[0][: n + 1],
                noise=0.0,
                gain=0.0,
                targets=np.repeat(wanted.u[:, None], 2, axis=1),
                bands=np.concatenate([ends[0], ends[1][:1]]),
            ),
        )

    def limit(self, found: Finding, premises: Premises) -> Certificate:
        """Increments go to those of the reference."""
        return theorem("increment_limit", **_named(premises))

    def conclusion(self, found: Finding, premises: Premises) -> Certificate:
        """Errors go to 0."""
        low, high = ((found.witness or {}).get(name) for name in ("b_low", "b_high"))
        if not (isinstance(low, float) and isinstance(high, float)):
            raise NotCertified("the slopes that it was shown for are missing")
        asks = [
            Ask(("y", 0, 0), self._input, f"{side} everywhere", looser(bound, side))
            for side, bound in (("at least", low), ("at most", high))
        ]
        return theorem("theorem1.conclusion", slopes=self._bounds(self._learned, *asks), **_named(premises))

    def _increments(self, weight: float, premises: Premises) -> Certificate:
        return theorem("increments", rows=self._rows(weight), law=self._law, **_named(premises))

    @cached_property
    def _law(self) -> Certificate:
        law = self.of.estimator
        times: Formula = ("*", "rho", "unit")
        return numbers(
            f"The settings of {self.of.controller}.",
            {
                "lambda": (law.lam, ""),
                "rho": (law.rho, ""),
                "unit": (law.force_unit, ""),
                "l_max": (largest_gain(law), ""),
            },
            (">", "lambda", 0),
            (">", "rho", 0),
            (">", "unit", 0),
            (
                ">=",
                ("*", ("*", 4, "lambda"), ("*", "l_max", "l_max")),
                ("*", times, times),
            ),
        )


def _named(premises: Premises) -> dict[str, Certificate]:
    """Return premises by the last part of their claims' names."""
    return {name.rsplit("premise.", 1)[-1].rsplit(".", 1)[-1]: one for name, one in premises.items()}
