"""The cache of built functions: two builders at once, no compiler, no folder."""

from __future__ import annotations

import logging
import multiprocessing
import os

import casadi as ca
import numpy as np
import pytest

from models.quantity import InvalidValue
from workbench.fold import machine_code as module
from workbench.fold.agreement import agree
from workbench.fold.machine_code import compiled, compiler

needs_compiler = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


def function(factor=2.0):
    x = ca.MX.sym("x", 50)
    return ca.Function("scaled", [x], [factor * ca.sin(x)], ["x"], ["y"])


def build_one(folder, factor, gate, answers):
    os.environ["WORKBENCH_CACHE"] = folder
    gate.wait()
    answers.put(float(compiled(function(factor))(1.0)[0]))


@needs_compiler
@pytest.mark.parametrize("damaged", [False, True])
def test_four_processes_may_build_at_once(damaged, tmp_path, monkeypatch):
    if damaged:
        monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
        compiled(function())
        (library,) = tmp_path.glob("*.so")
        library.unlink()
        library.write_bytes(b"nothing")
    context = multiprocessing.get_context("fork" if os.name == "posix" else "spawn")
    gate, answers = context.Barrier(4), context.Queue()
    workers = [context.Process(target=build_one, args=(str(tmp_path), 2.0, gate, answers)) for _ in range(4)]
    for worker in workers:
        worker.start()
    got = [answers.get(timeout=60) for _ in workers]
    for worker in workers:
        worker.join(60)
        assert worker.exitcode == 0
    assert got == [pytest.approx(float(2 * ca.sin(1.0)), rel=1e-15)] * 4
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".sha256", ".so"]


@needs_compiler
def test_built_once_and_cached_by_content(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    compiled(function())
    (first,) = tmp_path.glob("*.so")
    stamp = first.stat().st_mtime_ns
    compiled(function())
    assert [path.stat().st_mtime_ns for path in tmp_path.glob("*.so")] == [stamp]
    compiled(function(3.0))
    assert len(list(tmp_path.glob("*.so"))) == 2


@needs_compiler
def test_a_broken_library_is_not_left_by_a_failing_compiler(tmp_path, monkeypatch, caplog):
    fake = tmp_path / "brokencc"
    fake.write_text("#!/bin/sh\necho no licence >&2\nexit 1\n")
    fake.chmod(0o755)
    monkeypatch.setenv("CC", str(fake))
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    module._said.clear()
    one = function()
    with caplog.at_level(logging.WARNING, logger="workbench"):
        assert compiled(one) is one
    assert "failed (no licence): running on CasADi's virtual machine" in caplog.text
    assert list((tmp_path / "cache").iterdir()) == []


def test_without_a_compiler_it_says_so_once(monkeypatch, caplog):
    monkeypatch.setenv("CC", "nonexistent-compiler")
    module._said.clear()
    one = function()
    with caplog.at_level(logging.WARNING, logger="workbench"):
        assert compiled(one) is one
        assert compiled(one) is one
    assert caplog.text.count("no C compiler found") == 1


def test_a_cache_folder_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(InvalidValue, match=r"the cache folder .* must be writable, got: .*; set WORKBENCH_CACHE"):
        module.cache_folder()


@needs_compiler
def test_c_that_was_tightened_wrongly_is_not_used(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    wrong = []

    def slipped(source):
        wrong.append(source.replace("sin(", "cos("))
        return wrong[-1]

    monkeypatch.setattr(module, "tightened", slipped)
    with caplog.at_level(logging.WARNING, logger="workbench"):
        made = compiled(function())
    assert wrong[0].count("cos(") and "differs from the virtual machine" in caplog.text
    assert float(made(1.0)[0]) == float(function()(1.0)[0])
    caplog.clear()
    assert float(compiled(function())(1.0)[0]) == float(made(1.0)[0]), "the library that was kept is the right one"
    assert not caplog.text


SLIPS = {  # what is computed, and C that goes wrong only where nobody looks by chance
    "negative numbers": (ca.fabs, "a0=casadi_fabs(a0)", "a0=(a0)"),
    "numbers beyond one": (lambda x: ca.fmin(x, 1.5), "casadi_fmin(a0,a1)", "(a0)"),
    "missing numbers": (lambda x: x <= 1e308, "(a0<=a1)", "!(a0>a1)"),
    "infinite numbers": (lambda x: x <= 1e308, "(a0<=a1)", "(a0<=INFINITY)"),
    "great numbers": (lambda x: x + ca.sin(x * 1e-3), "sin(", "("),
    "small differences": (lambda x: x + 1e-6 * ca.sin(x), "sin(", "cos("),
    "small numbers beside large ones": (lambda x: ca.vertcat(1e12 * x, ca.sin(x)), "sin(", "1.0001*sin("),
}


@needs_compiler
@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_seen_wherever_it_is(slip, tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    value, right, wrong = SLIPS[slip]
    x = ca.SX.sym("x")
    one = ca.Function("one", [x], [value(x)]).map(50)
    changed = []

    def slipped(source):
        head, mark, body = source.partition("/* one:")
        changed.append(head + mark + body.replace(right, wrong))
        assert changed[-1] != source, source
        return changed[-1]

    monkeypatch.setattr(module, "tightened", slipped)
    with caplog.at_level(logging.WARNING, logger="workbench"):
        made = compiled(one)
    assert changed and made is not one and "differs from the virtual machine: built as generated" in caplog.text
    given = np.array([[-2.5, 0.5, np.nan, np.inf, -np.inf, 1e6, *range(44)]])
    np.testing.assert_array_equal(made(given).full(), one(given).full())


@needs_compiler
def test_where_the_plain_c_differs_too_the_virtual_machine_runs(tmp_path, monkeypatch, caplog):
    wrong = tmp_path / "wrongcc"
    swap = 'sed "s/sin(/cos(/" function.c > f && mv f function.c'
    wrong.write_text(f'#!/bin/sh\n{swap} && exec {compiler()} "$@"\n')
    wrong.chmod(0o755)
    monkeypatch.setenv("CC", str(wrong))
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    module._said.clear()
    one = function()
    with caplog.at_level(logging.WARNING, logger="workbench"):
        assert compiled(one) is one
    assert "the machine code of scaled differs from the virtual machine: running on" in caplog.text
    assert list((tmp_path / "cache").iterdir()) == []


def test_agreement_sees_a_difference_and_missing_numbers():
    x = ca.MX.sym("x", 2, 2)
    f = ca.Function("f", [x], [x, x[0, 0]])
    one = np.array([1.0, 1e9, -1.0, np.nan, 1e-9])
    assert agree(f, one, one) and agree(f, one, one * (1 + 1e-12))
    for index, other in ((0, 1.00001), (0, np.nan), (0, np.inf), (2, 1.0), (3, 0.0), (3, np.inf), (4, 1.1e-9), (4, 0)):
        changed = one.copy()
        changed[index] = other
        assert not agree(f, one, changed), (index, other)
    assert agree(f, one, one + np.array([0, 1e-1, 0, 0, 0]))
