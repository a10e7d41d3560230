"""Slips planted in copies of the C: every one must turn an oracle red."""

import ctypes
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import carried_sets as sets
import pytest

from verification.enclosure import recursion
from workbench.fold.machine_code import FLAGS, compiler

SOURCE = Path(recursion.__file__).with_suffix(".c").read_text(encoding="utf-8")


def values() -> Iterator[str]:
    """Ranges of boxes as they are."""
    return sets.values_missed(1)


def parts() -> Iterator[str]:
    """Ranges of boxes in parts."""
    return sets.values_missed(6)


Oracle = Callable[[], Iterator[str]]
slopes, passes = sets.slopes_missed, sets.carried_astray
SLIPS: list[tuple[str, str, str, Oracle]] = [
    # name, as it stands, as it would be, what must turn red
    ("no step outwards", "bits += x > 0 ? 1 : -1;", "bits += 0;", values),
    ("a sum rounded the wrong way", "e >= 0 ? s : below(s)", "e <= 0 ? s : below(s)", values),
    ("a product to nearest", "return e <= 0 ? p : above(p);", "return p;", values),
    ("a quotient to nearest", "product_error(q, y, x) == 0 ? q : below(q)", "1 ? q : below(q)", values),
    ("the error of a product beyond its range", "size > 0x1p-900", "size >= 0", values),
    ("one corner of a product", "smaller(product_down(x.lo, y.hi), product_down(x.hi, y.lo))",
     "product_down(x.lo, y.hi)", values),
    ("ends of a divisor swapped", "x.lo >= 0 ? y.hi : y.lo", "x.lo >= 0 ? y.lo : y.hi", values),
    ("a divisor that ends at zero", "return x.lo <= 0 && x.hi >= 0;", "return x.lo < 0 && x.hi > 0;", values),
    ("a magnitude without zero", "holds_zero(x) ? 0.0 : smaller", "0 ? 0.0 : smaller", values),
    ("a root to nearest", "exact_root(x.hi, r.hi)) r.hi = above(r.hi);", "1) r.hi = r.hi;", values),
    ("an odd power as an even one", "if (n % 2 == 0) return", "if (1) return", values),
    ("touching ends of <", "span r = {x.hi < y.lo, x.lo < y.hi};", "span r = {x.hi <= y.lo, x.lo < y.hi};", values),
    ("touching ends of <=", "span r = {x.hi <= y.lo, x.lo <= y.hi};", "span r = {x.hi <= y.lo, x.lo < y.hi};", values),
    ("== of one end", "x.lo == y.hi && x.hi == y.lo,", "x.lo == y.hi || x.hi == y.lo,", values),
    ("the larger for the smaller", "v.lo = smaller(x.lo, y.lo), v.hi = smaller(x.hi, y.hi);",
     "v.lo = larger(x.lo, y.lo), v.hi = smaller(x.hi, y.hi);", values),
    ("a branch that may be taken", "h.lo == 1 ? y : h.hi == 0 ? z : hull(y, z)", "h.lo == 1 ? y : z", values),
    ("a sign that may be either", "v.hi = y.hi < 0 ? -m.lo : m.hi;", "v.hi = y.lo < 0 ? -m.lo : m.hi;", values),
    ("floor to ceil", "v.lo = floor(x.lo), v.hi = floor(x.hi);", "v.lo = ceil(x.lo), v.hi = floor(x.hi);", values),
    ("and for or", "v.lo = larger(x.lo, y.lo), v.hi = larger(x.hi, y.hi); break;",
     "v.lo = larger(x.lo, y.lo), v.hi = smaller(x.hi, y.hi); break;", values),
    ("answers in another order", "v.lo = answer[0], v.hi = answer[1];", "v.lo = answer[2], v.hi = answer[3];", values),
    ("monotone at the worse end", "(slope[i].lo >= 0) == lower", "(slope[i].lo >= 0) != lower", values),
    ("a mean value without slopes", "change = add(change, mul(slope[i], sub(held[i], mid[i])));", ";", values),
    ("a mean value that takes both ends for one", "lower ? larger(best, change.lo) : smaller(best, change.hi)",
     "lower ? larger(best, change.hi) : smaller(best, change.lo)", values),
    ("a part that is lost", "for (i = 1, first = bound[0]; i < count; i++)",
     "for (i = 1, first = bound[0]; i < count - 1; i++)", parts),
    ("parts that leave a gap", "kept[worst][i].hi = kept[count][i].lo = met;",
     "kept[worst][i].hi = met, kept[count][i].lo = met / 2 + kept[count][i].hi / 2;", parts),
    ("slopes of a kink from one side", ": first.hi == 0 && second.hi ? gy : hull(gx, gy);", ": gy;", slopes),
    ("slope of a size from one side", "case FABS: v = magnitude(x), da = signs(x);",
     "case FABS: v = magnitude(x), da = UNIT;", slopes),
    ("slope of a quotient by its divisor", "db = neg(over(v, y));", "db = over(v, y);", slopes),
    ("slope of an inverse", "da = neg(square(v));", "da = square(v);", slopes),
    ("slope of a square", "case SQ: v = square(x), da = add(x, x);", "case SQ: v = square(x), da = x;", slopes),
    ("slope of a root", "da = over(UNIT, add(v, v));", "da = over(UNIT, v);", slopes),
    ("slope of a power", "mul(factor, whole_power(x, e - 1))", "mul(factor, whole_power(x, e))", slopes),
    ("slope of a product by one factor", "v = mul(x, y), da = y, db = x;", "v = mul(x, y), da = y;", slopes),
    ("slope across a jump", "da = v.lo == v.hi ? NOTHING : ALL", "da = NOTHING", slopes),
    ("slope across a choice", "out[i] = p->depends[a] >> i & 1 ? ALL : hull(gy, gz)", "out[i] = hull(gy, gz)", slopes),
    ("slope of one branch", "p->depends[a] >> i & 1 ? ALL : hull(gy, gz)", "p->depends[a] >> i & 1 ? ALL : gy", slopes),
    ("a slope of -1 for 1", "by.hi == -1) return neg(g);", "by.hi == -1) return g;", slopes),
    ("a root of what may be negative", "bad = x.lo < 0;", "bad = x.hi < 0;", passes),
    ("a fault that is not passed on", "fault = p->fault[a] | (b >= 0 ? p->fault[b] : 0);", "fault = 0;", passes),
    ("an input that is not known", "if (!isfinite(v.lo) || !isfinite(v.hi)) bad = 1;",
     "if (!isfinite(v.lo) || !isfinite(v.hi)) v = NOTHING;", passes),
    ("the hull without the plan", ": hull(q->plan[k], t);", ": t;", passes),
    ("the plan without its targets", ": hull(q->plan[k], t);", ": q->plan[k];", passes),
    ("the low slope for the high one", "up > 0 ? b.lo : b.hi", "b.hi", passes),
    ("the high slope for the low one", "down < 0 ? b.lo : b.hi", "b.hi", passes),
    ("one end of what is wanted", "sum_up(wanted.hi, -f.lo)", "sum_up(wanted.lo, -f.lo)", passes),
    ("one end of what is there", "sum_up(wanted.hi, -f.lo)", "sum_up(wanted.hi, -f.hi)", passes),
    ("targets nearer than they are", "quotient_down(left, steep.hi)), found.lo)",
     "quotient_down(left, steep.lo)), found.lo)", passes),
    ("targets that were not sought far enough",
     "if (tries && found.lo >= region.lo && found.hi <= region.hi) break;", "if (tries) break;", passes),
    ("an input that no slope holds", "if (!(b.lo > 0)) return NOT_RISING;", ";", passes),
    ("overshoot forgotten", "if (reach <= 1 || q->mode == GIVEN) break;", "if (reach <= 2 || q->mode == GIVEN) break;",
     passes),
    ("overshoot of one step", "product_up(w, quotient_up(reach, sum_down(2, -reach)))", "product_up(w, reach)", passes),
    ("a gain of two", "if (reach >= 2 || tries == 20) return GAIN;", "if (reach >= 2) break;", passes),
    ("the low slope for the gain", "reach = product_up(q->most_gain, b.hi);", "reach = product_up(q->most_gain, b.lo);",
     passes),
    ("moves by the gain alone", "share = mul(share, b);", ";", passes),
    ("moves of one end", "q->after[k] = i ? hull(q->after[k], to) : to;", "q->after[k] = to;", passes),
    ("moves away from the target", "to = add(mul(rest, u), mul(at[i], t));", "to = add(mul(rest, t), mul(at[i], u));",
     passes),
    ("a jolt to one side", "moved[i].lo = sum_down(moved[i].lo, -q->jolt[i]), ", "", passes),
    ("states of the targets alone", "        box[in] = u;\n        for", "        box[in] = t;\n        for", passes),
    ("parts that stand still", "        fill(p, box, readings);\n        q->y[k]", "        q->y[k]", passes),
    ("readings of the first sample", "q->readings + (size_t)k * p->readings;", "q->readings;", passes),
    ("disturbances of the first sample", "memcpy(box, q->fixed + (size_t)k * n,", "memcpy(box, q->fixed,", passes),
]  # fmt: skip


@pytest.fixture(scope="module")
def command() -> str:
    found = compiler()
    if found is None:
        pytest.skip("no C compiler")
    return found


@pytest.mark.parametrize(("old", "new", "oracle"), [row[1:] for row in SLIPS], ids=[row[0] for row in SLIPS])
def test_no_slip_survives(old, new, oracle, command, tmp_path, monkeypatch):
    assert SOURCE.count(old) >= 1, "the C has changed: plant this slip anew"
    (tmp_path / "slip.c").write_text(SOURCE.replace(old, new, 1))
    library = tmp_path / "slip.so"
    flags = [flag for flag in FLAGS if not flag.startswith("-O")]
    subprocess.run(
        [command, "-O0", *flags, "-shared", "-fPIC", "-w", "-o", library, tmp_path / "slip.c", "-lm"], check=True
    )
    slipped = recursion.declared(ctypes.CDLL(str(library)))
    monkeypatch.setattr(recursion, "_c", lambda: slipped)
    assert next(oracle(), None) is not None


@pytest.mark.parametrize("oracle", [values, parts, slopes, passes], ids=lambda oracle: oracle.__name__)
def test_without_a_slip_no_oracle_is_red(oracle):
    assert next(oracle(), None) is None
