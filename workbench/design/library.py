"""The laws that can be compared, by name: each a factory, since what it is scaled to is the task's."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from workbench.contracts.law import AnyLaw
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.odometry import Odometry
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.pid import PID
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.controllers.tracking_mpc import TrackingMPC
from workbench.controllers.variable_gain import VariableGain

LIBRARY: Mapping[str, Callable[[], AnyLaw]] = {
    "pid": PID,
    "fipid": FIPID,
    "fipid-smooth": lambda: FIPID(f="smooth"),
    "bp-fipid": BPFIPID,
    "tracking-mpc": TrackingMPC,
    "cfdl": CFDL,
    "icfdl": ICFDL,
    "pd-ilc": PD,
    "increment": Increment,
    "palc": lambda: Odometry(law=PALC()),
    "palc-filtered": lambda: Odometry(law=FilteredPALC()),
    "rmpc": RMPC,
    "rsmpc": RSMPC,
    "variable-gain": lambda: Odometry(law=VariableGain()),
}
"""How each is made before it is scaled; laws of position and speed are given a plant's speed, and integrate it."""
