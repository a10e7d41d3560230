"""Every operation and lookup table as machine code: the virtual machine's doubles, or the virtual machine itself."""

from __future__ import annotations

import itertools
import logging
import platform

import casadi as ca
import numpy as np
import pytest

from workbench.fold import machine_code as module
from workbench.fold.machine_code import compiled, compiler
from workbench.graph.operations import OPERATIONS

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
VALUES = [0.0, 1.0, 0.5, 2.5, 3.0, 0.1, 7.3, 5e-324, 1e-310, 2.2e-308, 1e-9, 123456.789, 1e6, 1e16, 1e300]
VALUES += [4503599627370497.5, 1.7e308, np.inf]
VALUES = [sign * value for value in VALUES for sign in (1.0, -1.0)] + [np.nan]
PAIRS = np.array(list(itertools.product(VALUES, VALUES))).T
N = PAIRS.shape[1]
WRITTEN = {
    "assign": lambda x: x * 1,
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "neg": lambda x: -x,
    "inv": lambda x: 1 / x,
    "twice": lambda x: 2 * x,
    "sq": lambda x: x**2,
    "pow": lambda x, y: x**y,
    "not": ca.logic_not,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "if_else_zero": lambda x, y: ca.if_else(x, y, 0),
}
UNKNOWN_TO_C = {"erfinv"}
ANY_ZERO = set() if platform.machine() in ("x86_64", "AMD64") else {"fmin", "fmax"}  # the C library's own affair


def applied(op, x, y):
    written = WRITTEN.get(op) or getattr(ca, op)
    return written(x, y) if OPERATIONS[op].arity == 2 else written(x)


def in_a_sample(ops):
    """A trial's form: a scalar function folded over samples."""
    s, x, y = ca.SX.sym("s"), ca.SX.sym("x"), ca.SX.sym("y")
    sample = ca.Function("sample", [s, x, y], [s + 1, *(applied(op, x, y) for op in ops)])
    fold = sample.mapaccum("samples_1_0", N, 1, {"base": 20})
    rows = [ca.MX.sym("x", 1, N), ca.MX.sym("y", 1, N)]
    return ca.Function("trial", rows, list(fold(0, *rows)[1:]), ["x", "y"], list(ops))


def on_rows(ops):
    """A law's form: whole rows."""
    x, y = ca.MX.sym("x", 1, N), ca.MX.sym("y", 1, N)
    return ca.Function("rows", [x, y], [applied(op, x, y) for op in ops], ["x", "y"], list(ops))


def same_doubles(one, other, any_zero=False):
    one, other = np.ravel(one.full()), np.ravel(other.full())
    return (np.isnan(one) & np.isnan(other)) | (one == other) & (any_zero | (np.signbit(one) == np.signbit(other)))


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    module._said.clear()


@pytest.mark.parametrize("form", [in_a_sample, on_rows], ids=lambda form: form.__name__)
def test_every_operation_gives_the_same_doubles(form, own_cache):
    function = form([op for op in OPERATIONS if op not in UNKNOWN_TO_C])
    machine = compiled(function)
    assert machine is not function
    differing = {
        op: PAIRS[:, np.flatnonzero(~same)[0]].tolist()
        for op, one, other in zip(function.name_out(), function(*PAIRS), machine(*PAIRS), strict=True)
        if not (same := same_doubles(one, other, op in ANY_ZERO)).all()
    }
    assert differing == {}


@pytest.mark.parametrize("form", [in_a_sample, on_rows], ids=lambda form: form.__name__)
@pytest.mark.parametrize("op", sorted(UNKNOWN_TO_C))
def test_what_c_does_not_know_runs_on_the_virtual_machine(op, form, own_cache, caplog):
    function = form([op, "add"])
    with caplog.at_level(logging.WARNING, logger="workbench"):
        assert compiled(function) is function
        assert compiled(form(["sub", op])) is not function
    (said,) = caplog.messages
    assert "\n" not in said and op in said and said.endswith(": running on CasADi's virtual machine")


class OfPython(ca.Callback):
    def __init__(self):
        ca.Callback.__init__(self)
        self.construct("of_python", {"enable_fd": True})

    def eval(self, arguments):
        return [2 * arguments[0]]


@pytest.mark.filterwarnings("ignore")
def test_what_casadi_cannot_write_as_c_runs_on_the_virtual_machine(own_cache, caplog):
    x, called = ca.MX.sym("x"), OfPython()
    function = ca.Function("calling", [x], [called(x)])
    with caplog.at_level(logging.WARNING, logger="workbench"):
        assert compiled(function) is function
    assert float(function(3)) == 6 and len(caplog.messages) == 1 and "\n" not in caplog.text.strip()


GRID = [0.0, 1.0, 2.5, 3.0, 4.5, 6.0]
EQUAL = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
HEIGHTS = [1.0, -2.0, 0.5, 3.0, 1e3, -7.0]
TABLES = {
    f"{kind}-{search}": lambda kind=kind, search=search: ca.interpolant(
        "table", kind, [EQUAL if search == "exact" else GRID], HEIGHTS, {"lookup_mode": [search]}
    )
    for kind, search in itertools.product(("linear", "bspline"), ("linear", "exact", "binary"))
    if (kind, search) != ("bspline", "exact")  # its knots are never equally spaced
} | {
    f"{kind}-plane": lambda kind=kind: ca.interpolant("table", kind, [GRID, EQUAL], np.outer(HEIGHTS, HEIGHTS).ravel())
    for kind in ("linear", "bspline")
}
PLACES = [*GRID, *EQUAL, -1.0, -0.0, 1e-310, 0.3, 2.7, 5.9, 6.5, 1e6, -1e6, 1e300, np.inf, -np.inf, np.nan]


@pytest.mark.parametrize("symbol", [ca.SX, ca.MX], ids=["SX", "MX"])
@pytest.mark.parametrize("case", TABLES)
def test_lookup_tables_give_the_same_doubles(case, symbol, own_cache):
    table = TABLES[case]()
    x = symbol.sym("x", table.size1_in(0))
    one = ca.Function("one", [x], [table(x), ca.jacobian(table(x), x)] if symbol is ca.MX else [table(x)])
    places = np.array(list(itertools.product(PLACES, repeat=x.numel()))).T
    many = one.map(places.shape[1])
    machine = compiled(many)
    assert machine is not many
    for a, b in zip(many.call([places]), machine.call([places]), strict=True):
        assert same_doubles(a, b).all()
