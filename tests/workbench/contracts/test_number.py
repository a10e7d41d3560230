"""What a record may call a number."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
import xarray as xr

from workbench.contracts.number import finite


@pytest.mark.parametrize(
    ("value", "number"),
    [
        (None, None),
        (float("nan"), None),
        (np.float64("inf"), None),
        (-np.inf, None),
        (np.float32(0.1), float(np.float32(0.1))),
        (3, 3.0),
        (True, 1.0),
        (xr.DataArray(2.5), 2.5),
        (ca.DM(0.25), 0.25),
    ],
)
def test_a_number_is_finite_or_none(value, number):
    assert finite(value) == number
    assert number is None or type(finite(value)) is float


def test_what_is_no_number_is_refused():
    with pytest.raises(ValueError, match="could not convert"):
        finite("much")
