"""Tubes that several tests share, each made once; interrupts as a terminal sends them."""

from __future__ import annotations

import signal
import threading

import pytest
from brake_tubes import TUBES, brake_tube

from workbench.predictive.tube import Tube

if threading.current_thread() is threading.main_thread():
    # a shell starts background jobs with interrupts ignored, and every process started from them inherits that
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", params=sorted(TUBES))
def tube(request: pytest.FixtureRequest) -> Tube:
    made: Tube = TUBES[request.param]()
    return made


@pytest.fixture(scope="session")
def brake_a() -> Tube:
    return brake_tube("A")
