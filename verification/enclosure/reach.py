"""What is found about the kinks, jumps and poles of a Function."""

from dataclasses import dataclass
from typing import Literal

from verification.enclosure.box import Box

Kind = Literal["kink", "jump", "pole"]
Reachable = Literal["no", "yes", "unknown"]


@dataclass(frozen=True, kw_only=True)
class NonsmoothOperation:
    """An operation that is not smooth everywhere.

    Parameters
    ----------
    name
        What CasADi calls it, such as ``fabs``.
    kind
        What happens at the critical points: kink, jump or pole.
    instruction
        Its place among the nodes of the graph.
    expression
        Its symbolic expression.
    """

    name: str
    kind: Kind
    instruction: int
    expression: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Whether a box reaches the critical set of an operation.

    Parameters
    ----------
    operation
        The operation.
    reachable
        ``"no"`` is proved; ``"yes"`` comes with a point; otherwise ``"unknown"``.
    point
        A point of the box at which the deciding argument provably is critical, or next to which (within rounding)
        it provably changes its sign.
    reason
        A sentence: what was proved at the point, or why nothing was.
    """

    operation: NonsmoothOperation
    reachable: Reachable
    point: Box | None
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Smoothness:
    """What `smooth_on` or `continuous_on` found.

    Parameters
    ----------
    proved
        True if no operation that would spoil it can be reached, but those that are mended. False means "not shown",
        not "false".
    reaches
        The operations that were asked about.
    reason
        None if proved, otherwise a sentence naming what stands in the way.
    mended
        The operations that jump while the Function provably does not: both of its sides are equal there.
    """

    proved: bool
    reaches: tuple[Reach, ...]
    reason: str | None
    mended: tuple[NonsmoothOperation, ...] = ()
