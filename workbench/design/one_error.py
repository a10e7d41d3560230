"""The one error that laws are compared by: an output's, or the weighed sum of several outputs'."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.array import Array
from models.quantity import InvalidValue
from workbench.contracts.study import Study


class Weighed(NamedTuple):
    """Weights of the outputs' mean square errors, and the unit of their sum."""

    weights: Array
    """(outputs,)."""
    unit: str


def weighed(study: Study) -> Weighed:
    """Return how the outputs' errors become one; InvalidValue where a study with several does not say."""
    outputs = study.plant.outputs
    weights = study.weights or ((1.0,) if len(outputs) == 1 else ())
    if not weights:
        units = ", ".join(one.unit for one in outputs)
        dots = ", ".join("..." for _ in outputs)
        raise InvalidValue(f"several outputs with units {units} have no common error: give the study weights=({dots})")
    if len(weights) != len(outputs) or not all(0 <= one < math.inf for one in weights) or not any(weights):
        raise InvalidValue(
            f"weights must be one an output ({len(outputs)}), 0 or more and not all 0, got {tuple(weights)}"
        )
    alone = len(outputs) == 1 and weights[0] == 1
    return Weighed(np.array(weights, dtype=float), f"({outputs[0].unit})^2" if alone else "weighed")


def one_error(study: Study, mse: Array) -> float:
    """Return one error from the outputs' mean square errors, (outputs,)."""
    return float(np.dot(weighed(study).weights, mse))
