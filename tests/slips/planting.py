"""A slip planted in the source of one function: everything that holds the function runs with it, and runs clean after.

The planted text is compiled in the function's own module and only its code is exchanged, so that it acts wherever the
function went: imported by name, in a table, in a partial, in a class.
"""

from __future__ import annotations
import __future__

import functools
import importlib
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import CodeType, FunctionType

import numpy as np

ROOMS = ("models", "workbench", "verification", "studies")


@dataclass(frozen=True, kw_only=True)
class Slip:
    """One text of one function, as it stands and as it would be."""

    where: str
    """``module:function`` or ``module:Class.method``."""
    stands: str
    slipped: str
    causes: str
    """The false verdict or number that it would cause."""
    check: Callable[[], None]
    """What must turn red, by an assertion."""


def function_of(where: str) -> FunctionType:
    """Return the function that a place means, without what it is wrapped in."""
    module, _, path = where.partition(":")
    found: object = importlib.import_module(module)
    for name in path.split("."):
        found = inspect.getattr_static(found, name)
    match found:
        case property(fget=inner) | functools.cached_property(func=inner):
            return inner
        case staticmethod() | classmethod():
            return found.__func__
        case functools._lru_cache_wrapper():
            return found.__wrapped__
    assert isinstance(found, FunctionType), where
    return found


def slipped_code(slip: Slip) -> CodeType:
    """Return the code of the function with the slip in it."""
    function = function_of(slip.where)
    source = textwrap.dedent(inspect.getsource(function))
    times = source.count(slip.stands)
    assert times == 1, f"{slip.where} has changed, {slip.stands!r} stands in it {times} times: plant it anew"
    futures = function.__code__.co_flags & __future__.annotations.compiler_flag
    planted = source.replace(slip.stands, slip.slipped)
    whole = compile(planted, f"<{slip.where}, slipped>", "exec", flags=futures, dont_inherit=True)
    (code,) = [one for one in whole.co_consts if isinstance(one, CodeType) and one.co_name == function.__name__]
    assert code.co_freevars == function.__code__.co_freevars, f"{slip.where} closes over something: plant it elsewhere"
    return code


def forget() -> None:
    """Empty every cache of the rooms: what was computed with a slip, or without it, is not to be found again."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] not in ROOMS:
            continue
        for thing in list(vars(module).values()):
            for one in (thing, *(vars(thing).values() if inspect.isclass(thing) else ())):
                if isinstance(one, functools._lru_cache_wrapper):
                    one.cache_clear()


@contextmanager
def planted(slip: Slip) -> Iterator[None]:
    """Let the function of a slip run with it."""
    function, code = function_of(slip.where), slipped_code(slip)
    clean = function.__code__
    forget()
    function.__code__ = code
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        function.__code__ = clean
        forget()
