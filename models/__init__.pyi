from models.discretise import RK4 as RK4
from models.discretise import Euler as Euler
from models.discretise import GaussLegendre as GaussLegendre
from models.errors import InvalidValue as InvalidValue
from models.named_signals import Signal as Signal
from models.named_signals import by_role as by_role
from models.named_signals import signal as signal
from models.named_signals import signals as signals
from models.plant import Plant as Plant
from models.point_mass import PointMass as PointMass
from models.quantity import choice as choice
from models.quantity import count as count
from models.quantity import declared as declared
from models.quantity import given as given
from models.quantity import part as part
from models.quantity import quantity as quantity
from models.quantity import ranges as ranges
from models.quantity import switch as switch
from models.quantity import table as table

__all__ = [
    "RK4",
    "Euler",
    "GaussLegendre",
    "InvalidValue",
    "Plant",
    "PointMass",
    "Signal",
    "by_role",
    "choice",
    "count",
    "declared",
    "given",
    "part",
    "quantity",
    "ranges",
    "signal",
    "signals",
    "switch",
    "table",
]
