from models.errors import InvalidValue as InvalidValue
from models.plant import Plant as Plant
from models.plant import Signal as Signal
from models.plant import signals as signals
from models.point_mass import PointMass as PointMass
from models.quantity import choice as choice
from models.quantity import count as count
from models.quantity import declared as declared
from models.quantity import part as part
from models.quantity import quantity as quantity

__all__ = ["InvalidValue", "Plant", "PointMass", "Signal", "choice", "count", "declared", "part", "quantity", "signals"]
