"""Tubes that several tests share, each made once."""

from __future__ import annotations

import pytest
from brake_tubes import TUBES, brake_tube

from workbench.predictive.tube import Tube


@pytest.fixture(scope="session", params=sorted(TUBES))
def tube(request: pytest.FixtureRequest) -> Tube:
    made: Tube = TUBES[request.param]()
    return made


@pytest.fixture(scope="session")
def brake_a() -> Tube:
    return brake_tube("A")
