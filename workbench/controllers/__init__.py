"""Controllers, one law a file."""

from workbench.controllers.cfdl import CFDL
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.increment import Increment
from workbench.controllers.pd import PD

__all__ = ["CFDL", "ICFDL", "PD", "Increment"]
