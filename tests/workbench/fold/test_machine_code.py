"""The cache of built functions: two builders at once, no compiler, no folder."""

from __future__ import annotations

import logging
import multiprocessing
import os

import casadi as ca
import pytest

from models.quantity import InvalidValue
from workbench.fold import machine_code as module
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
def test_two_processes_may_build_at_once(tmp_path):
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
    assert [path.suffix for path in tmp_path.iterdir()] == [".so"]


@needs_compiler
def test_built_once_and_cached_by_content(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    compiled(function())
    (first,) = tmp_path.iterdir()
    stamp = first.stat().st_mtime_ns
    compiled(function())
    assert [path.stat().st_mtime_ns for path in tmp_path.iterdir()] == [stamp]
    compiled(function(3.0))
    assert len(list(tmp_path.iterdir())) == 2


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


def test_agreement_sees_a_difference_and_missing_numbers():
    x = ca.MX.sym("x", 5)
    right, wrong, missing = (
        ca.Function("f", [x], [value]) for value in (ca.sin(x), ca.sin(x) * (1 + 1e-6), ca.sin(x) + ca.DM.nan(5, 1))
    )
    assert module.agrees(right, right) and module.agrees(missing, missing)
    assert not module.agrees(right, wrong) and not module.agrees(right, missing)
