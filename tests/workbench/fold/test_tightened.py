"""The tightened C: recognised where it should be, the same numbers, and untouched where it is not."""

from __future__ import annotations

import subprocess

import casadi as ca
import numpy as np
import pytest

from models.actuator import Saturated
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.point_mass import PointMass
from workbench.controllers import ICFDL, PD
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.shuttle_pid import ShuttlePID
from workbench.controllers.variable_gain import VariableGain
from workbench.fold.fold import build
from workbench.fold.machine_code import FLAGS, SHARED, compiler
from workbench.fold.tightened import tightened

needs_compiler = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
N = 60


def source_of(function, folder):
    generator = ca.CodeGenerator("plain.c", {"with_header": False})
    generator.add(function)
    generator.generate(f"{folder}/")
    return (folder / "plain.c").read_text()


def built(source, name, folder, label):
    (folder / f"{label}.c").write_text(source)
    library = folder / f"{label}.so"
    call = [compiler(), *FLAGS, *SHARED, "-o", str(library), str(folder / f"{label}.c"), "-lm"]
    subprocess.run(call, check=True, capture_output=True)
    return ca.external(name, str(library))


@needs_compiler
@pytest.mark.parametrize(
    ("plant", "law"),
    [
        (PointMass(), ICFDL()),
        (PointMass(), PD()),
        (PointMass(), FIPID()),
        (PointMass(), BPFIPID()),
        (Maglev(), PALC(model=Maglev())),
        (Maglev(), ShuttlePID(model=Maglev())),
        (Saturated(plant=Maglev(), upper=1.0), FilteredPALC(model=Maglev(), lead_s=0.1, limit=1.0)),
        (MetroLine(), VariableGain()),
    ],
    ids=lambda thing: type(thing).__name__,
)
def test_same_bits_as_the_plain_source(plant, law, tmp_path):
    function = build(plant, law, N).trial
    plain = source_of(function, tmp_path)
    tight = tightened(plain)
    assert tight.count("_f3(") < plain.count("_f3(") or "for (k=0; k<60; ++k) {" in tight
    one, other = (built(text, function.name(), tmp_path, label) for text, label in ((plain, "p"), (tight, "t")))
    rng = np.random.default_rng(0)
    for _ in range(20):
        given = [rng.normal(size=function.size_in(i)) for i in range(function.n_in())]
        given[function.index_in("length")] = float(rng.integers(1, N + 1))
        given[function.index_in("p")] = build(plant, law, N).values
        for a, b in zip(one(*given), other(*given), strict=True):
            np.testing.assert_array_equal(a.full(), b.full())


ROWS = {
    "choice": lambda x, y: ca.if_else(x > 0, y, -y),
    "missing": lambda x, y: ca.if_else(x > 0, y, ca.DM.nan(1, 9)),
    "and": lambda x, y: ca.logic_and(x > 0, y > 0),
    "or": lambda x, y: ca.logic_or(x > 0, y > 0),
    "not": lambda x, y: ca.logic_not(x > 0) + y,
    "extremes": lambda x, y: ca.fmax(x, y) - ca.fmin(x, 2 * y),
    "stacked": lambda x, y: ca.vertcat(x, y, x + y),
    "shifted": lambda x, y: ca.horzcat((x + y)[1:] * x[:-1] + ca.fabs(y[1:]), 1),
    "transposed": lambda x, y: ca.reshape(ca.repmat(x > 0, 2, 1).T, 1, 18)[:9] + y,
    "several rows": lambda x, y: ca.sum1(ca.if_else(ca.repmat(x > 0, 2, 1), ca.vertcat(y, -x), ca.DM.nan(2, 9))),
    "long constants": lambda x, y: ca.if_else(x > 0, y, x * y) + ca.DM(range(9)).T * (x <= ca.DM.nan(1, 9)),
    "sign": lambda x, y: ca.sign(x) * ca.sqrt(ca.fabs(y)) + (x == y),
}


@needs_compiler
@pytest.mark.parametrize("case", ROWS)
def test_row_operations_mean_the_same(case, tmp_path):
    x, y = ca.MX.sym("x", 1, 9), ca.MX.sym("y", 1, 9)
    function = ca.Function("rows", [x, y], [ROWS[case](x, y), ROWS[case](y, x + 1)])
    fast = built(tightened(source_of(function, tmp_path)), "rows", tmp_path, "t")
    values = [
        np.array([[0.0, 1, -1, 2, np.nan, 3, -0.0, 5, 1e300]]),
        np.array([[1.0, 0, -1, np.nan, 2, 3, 0, -7, 1e9]]),
    ]
    for a, b in zip(function(*values), fast(*values), strict=True):
        np.testing.assert_array_equal(a.full(), b.full())


def test_other_text_is_untouched():
    text = "int main(void) {\n  for (;;) { break; }\n  return 0;\n}\n"
    assert tightened(text) == text
