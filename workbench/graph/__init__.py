"""A CasADi Function as plain data: read once, evaluated in many arithmetics, differentiated exactly, kept as JSON."""

from workbench.graph.arithmetic import DOUBLES, RATIONALS, Arithmetic, call, evaluate
from workbench.graph.as_json import from_json, to_json
from workbench.graph.build import Builder
from workbench.graph.derivative import gradient, jacobian
from workbench.graph.graph import Entry, Graph, Node, Port, Result
from workbench.graph.operations import OPERATIONS, Operation
from workbench.graph.reading import Unreadable, read
from workbench.graph.table import Lookup, Table

__all__ = [
    "DOUBLES",
    "OPERATIONS",
    "RATIONALS",
    "Arithmetic",
    "Builder",
    "Entry",
    "Graph",
    "Lookup",
    "Node",
    "Operation",
    "Port",
    "Result",
    "Table",
    "Unreadable",
    "call",
    "evaluate",
    "from_json",
    "gradient",
    "jacobian",
    "read",
    "to_json",
]
