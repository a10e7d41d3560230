"""The folder of built libraries: what is damaged or foreign is never loaded, and nothing there ends a process."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time

import casadi as ca
import numpy as np
import pytest

from workbench.fold import machine_code as module
from workbench.fold import trust
from workbench.fold.machine_code import compiled, compiler

pytestmark = pytest.mark.skipif(
    compiler() is None or sys.platform == "win32", reason="needs a C compiler and a POSIX system"
)
PROGRAM = """
import logging, sys
import casadi as ca
from workbench.fold import machine_code as module
logging.basicConfig(format="%(message)s", stream=sys.stdout)
x = ca.MX.sym("x", 50)
one = ca.Function("scaled", [x], [float(sys.argv[1]) * ca.sin(x)], ["x"], ["y"])
made = module.compiled(one)
assert (made(1.0) == one(1.0)).is_constant() and float(made(1.0)[0]) == float(one(1.0)[0])
print("virtual" if made is one else "machine")
"""


def ran(cache, factor=2.0, before="", timeout=60, **variables):
    """Run a process that asks for a library; return how it ended and the lines that it said."""
    done = subprocess.run(
        [sys.executable, "-c", before + PROGRAM, str(factor)],
        env=os.environ | {"WORKBENCH_CACHE": str(cache)} | variables,
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    return done.returncode, done.stdout.splitlines() or [done.stderr]


def libraries(cache):
    return sorted(cache.glob("*.so"))


def digest_of(library):
    return library.with_name(library.name + ".sha256")


@pytest.fixture
def cache(tmp_path):
    folder = tmp_path / "cache"
    assert ran(folder) == (0, ["machine"])
    return folder


def truncated(library):
    os.truncate(library, library.stat().st_size // 2)


def emptied(library):
    library.write_bytes(b"")


def garbled(library):
    library.write_bytes(os.urandom(5000))


def one_bit_flipped(library):
    data = bytearray(library.read_bytes())
    data[len(data) // 2] ^= 1
    library.write_bytes(data)


def linked(library):
    real = library.with_name("elsewhere")
    library.rename(real)
    library.symlink_to(real)


def dangling(library):
    library.unlink()
    library.symlink_to("nowhere")


def piped(library):
    library.unlink()
    os.mkfifo(library)


def writable_by_all(library):
    library.chmod(0o666)


def digest_emptied(library):
    digest_of(library).write_text("")


def digest_no_text(library):
    digest_of(library).write_bytes(b"\xff\xfe")


def digest_linked(library):
    digest_of(library).rename(library.with_name("digest"))
    digest_of(library).symlink_to(library.with_name("digest"))


DAMAGES = {  # what is said of it
    truncated: "is not what was built",
    emptied: "is not what was built",
    garbled: "is not what was built",
    one_bit_flipped: "is not what was built",
    linked: "is no regular file",
    dangling: "is no regular file",
    piped: "is no regular file",
    writable_by_all: "can be written by other users",
    digest_emptied: "is not what was built",
    digest_no_text: "is not what was built",
    digest_linked: "is no regular file",
}


@pytest.mark.parametrize("damage", DAMAGES, ids=lambda damage: damage.__name__)
def test_a_damaged_library_is_built_again(damage, cache):
    (library,) = libraries(cache)
    damage(library)
    line = f"the library {library} {DAMAGES[damage]}: it is built again"
    assert ran(cache) == (0, [line, "machine"])
    assert ran(cache) == (0, ["machine"])


def test_a_library_without_its_digest_was_never_finished(cache):
    (library,) = libraries(cache)
    truncated(library)
    digest_of(library).unlink()
    assert ran(cache) == (0, ["machine"])
    assert digest_of(library).exists()


@pytest.mark.parametrize("of", [lambda library: library, digest_of], ids=["library", "digest"])
def test_a_folder_where_a_file_should_be(of, cache):
    (library,) = libraries(cache)
    of(library).unlink()
    of(library).mkdir()
    status, said = ran(cache)
    assert (status, said[-1]) == (0, "machine"), said
    assert len(said) == 3 and "is no regular file" in said[0] and "it is built in a temporary one" in said[1]


def test_a_cache_folder_is_private(cache):
    assert cache.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o770])
def test_a_folder_that_others_may_write_is_not_used(mode, cache):
    """A library that somebody put there, digest and all, would run with the user's rights."""
    (library,) = libraries(cache)
    assert ran(cache, 3.0) == (0, ["machine"])
    (other,) = set(libraries(cache)) - {library}
    shutil.copy2(other, library)
    shutil.copy2(digest_of(other), digest_of(library))
    assert ran(cache)[0] == 1, "a library with its digest is believed: it computes another number here"
    before = library.stat().st_mtime_ns
    cache.chmod(mode)
    status, said = ran(cache, before=f"import tempfile; tempfile.tempdir = {str(cache.parent)!r}\n")
    assert (status, said[-1]) == (0, "machine"), said
    assert len(said) == 2 and "can be written by other users and is not used" in said[0] and "mode 700" in said[0]
    assert library.stat().st_mtime_ns == before
    assert list(cache.parent.iterdir()) == [cache], "the temporary folder is removed at the end"


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="only root gives files away")
def test_what_belongs_to_others_is_not_used(cache):
    (library,) = libraries(cache)
    os.chown(library, 65534, 65534)
    status, said = ran(cache)
    assert status == 0 and "belongs to another user: it is built again" in said[0] and said[1:] == ["machine"]
    os.chown(cache, 65534, 65534)
    status, said = ran(cache)
    assert status == 0 and "belongs to another user and is not used" in said[0] and said[1:] == ["machine"]


def test_foreign_is_who_is_neither_the_user_nor_root():
    own = os.geteuid()
    status = [0o40700, 1, 1, 1, own, 0, 0, 0, 0, 0]
    for mode, owner, expected in (
        (0o700, own, None),
        (0o755, own, None),
        (0o755, 0, None),
        (0o700, own + 12345, "another user"),
        (0o720, own, "other users"),
        (0o702, 0, "other users"),
    ):
        status[0], status[4] = 0o40000 | mode, owner
        fault = trust.foreign(os.stat_result(status))
        assert fault is None if expected is None else expected in fault


REFUSING = """
import builtins, pathlib, tempfile
real = tempfile.mkdtemp
def mkdtemp(suffix=None, prefix=None, dir=None):
    if ALL or str(dir).endswith("cache"):
        raise OSError(NUMBER, "No space left on device" if NUMBER == 28 else "Read-only file system")
    return real(suffix, prefix, dir)
tempfile.mkdtemp = mkdtemp
"""


@pytest.mark.parametrize("number", [28, 30])
def test_a_folder_that_takes_nothing(number, cache):
    refusing = REFUSING.replace("NUMBER", str(number)).replace("ALL", "False")
    assert ran(cache, before=refusing) == (0, ["machine"]), "what is there is used"
    status, said = ran(cache, 3.0, before=refusing)
    assert status == 0 and len(said) == 2 and "takes no library (" in said[0] and said[1] == "machine"
    status, said = ran(cache, 3.0, before=refusing.replace("False", "True"))
    assert status == 0 and len(said) == 3 and "no library can be built (" in said[1] and said[2] == "virtual"
    assert len(libraries(cache)) == 1


@pytest.mark.parametrize("size", [0, 2_000, 4_096, 12_000, 14_000])
def test_a_disk_that_is_full_in_the_middle(size, tmp_path):
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))\n"
    status, said = ran(tmp_path / "cache", before=limit, PYTHONDONTWRITEBYTECODE="1")
    assert (
        status == 0 and said[-1] == "virtual" and all("running on" in line or "temporary" in line for line in said[:-1])
    )
    assert len(said) >= 2
    assert ran(tmp_path / "cache") == (0, ["machine"])


def fake_compiler(tmp_path, script):
    fake = tmp_path / "fakecc"
    fake.write_text(f"#!/bin/sh\n{script.replace('cc ', f'{compiler()} ')}\n")
    fake.chmod(0o755)
    return str(fake)


BODY = 'sed "s/return casadi_f0(arg.*/{}/" function.c > edited.c && mv edited.c function.c && cc "$@"'
OUT = 'for a in "$@"; do case "$last" in -o) out="$a";; esac; last="$a"; done\n'
COMPILERS = {  # script: what is said of it
    "kill -SEGV $$": "failed (ended by SIGSEGV)",
    "exit 3": "failed (no message)",
    "exit 0": "failed (no message)",
    OUT + "echo nonsense > $out": "cannot be run (",
    OUT + ": > $out": "cannot be run (",
    OUT + 'cc "$@" && dd if=$out of=$out.2 bs=1000 count=9 2>&1 && mv $out.2 $out': "the machine code of scaled ",
    OUT + "echo 'int main(void) { return 0; }' > m.c && cc -shared -fPIC -o $out m.c": "cannot be run (",
    BODY.format("for (;;) {}"): "did not end within 2 seconds",
    BODY.format("return *(volatile int*)0;"): "ended by SIGSEGV",
    BODY.format("return 1;"): "cannot be run (",
    "sleep 45": "failed (it did not end within 2 seconds)",
    "sleep 45 & wait": "failed (it did not end within 2 seconds)",
}


@pytest.mark.parametrize("script", COMPILERS)
def test_a_compiler_that_crashes_hangs_or_writes_garbage(script, tmp_path):
    hasty = "from workbench.fold import machine_code; machine_code.PATIENCE = 2\n"
    begun = time.monotonic()
    status, said = ran(tmp_path / "cache", before=hasty, CC=fake_compiler(tmp_path, script))
    assert time.monotonic() - begun < 40
    assert (status, said[-1]) == (0, "virtual"), said
    assert COMPILERS[script] in said[-2] and said[-2].endswith(": running on CasADi's virtual machine")
    assert len(said) <= 3 and list((tmp_path / "cache").iterdir()) == []


def test_a_compiler_that_is_no_program(tmp_path):
    fake = tmp_path / "fakecc"
    fake.write_bytes(b"\x7fELF nonsense")
    fake.chmod(0o755)
    status, said = ran(tmp_path / "cache", CC=str(fake))
    assert (status, said[-1]) == (0, "virtual") and "\n".join(said).count("running on") == 1


@pytest.mark.parametrize("moment", ["compiling", "placed"])
def test_a_build_that_was_killed(moment, tmp_path):
    cache = tmp_path / "cache"
    if moment == "compiling":
        variables = {"CC": fake_compiler(tmp_path, f'kill -9 $PPID; sleep 0.2; exec {compiler()} "$@"')}
        before = ""
    else:  # the library is in place, its digest is not
        variables = {}
        before = """
import os, signal
real = os.replace
def replace(one, other):
    if str(other).endswith(".sha256"):
        os.kill(os.getpid(), signal.SIGKILL)
    real(one, other)
os.replace = replace
"""
    assert ran(cache, before=before, **variables)[0] == -signal.SIGKILL
    (left,) = [path for path in cache.iterdir() if path.is_dir()]
    assert ran(cache) == (0, ["machine"])
    assert left.exists(), "it could be another process's"
    os.utime(left, (0, 0))
    assert ran(cache, 3.0) == (0, ["machine"])
    assert not left.exists()


def test_the_cache_is_bounded_and_what_is_used_stays(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    (tmp_path / "mine.so").write_bytes(bytes(100_000))
    os.utime(tmp_path / "mine.so", (0, 0))
    x = ca.MX.sym("x", 50)
    made = {}

    def named(factor):
        return ca.Function(f"scaled_{factor}", [x], [factor * ca.sin(x)])

    for factor in (1, 2, 3, 4):
        made[factor] = compiled(named(factor))
        for file in tmp_path.glob(f"scaled_{factor}-*"):
            os.utime(file, (factor, factor))
    assert len(libraries(tmp_path)) == 5
    compiled(named(1))  # used: now the youngest
    size = max(file.stat().st_size for file in tmp_path.glob("scaled_*.so"))
    monkeypatch.setattr(module, "KEPT_BYTES", 3 * size + size // 2)
    compiled(named(5))
    assert [file.name.partition("-")[0] for file in libraries(tmp_path)] == [
        "mine.so",
        "scaled_1",
        "scaled_4",
        "scaled_5",
    ]
    assert len(list(tmp_path.glob("*.sha256"))) == 3
    for factor, function in made.items():
        np.testing.assert_array_equal(function(1.0), named(factor)(1.0)), "what is loaded stays"


def test_a_long_name_is_a_file_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    x = ca.MX.sym("x", 50)
    one = ca.Function("a" * 300, [x], [2 * ca.sin(x)])
    assert compiled(one) is not one


def test_a_folder_that_may_only_be_read(cache):
    cache.chmod(0o555)
    try:
        assert ran(cache) == (0, ["machine"])
        status, said = ran(cache, 3.0)
        assert status == 0 and said[-1] == "machine"
        assert os.geteuid() == 0 or "takes no library (Permission denied)" in said[0]
    finally:
        cache.chmod(0o700)


def test_what_is_nowhere_defined_is_missed_when_it_is_linked(tmp_path):
    text = "double casadi_erfinv(double x); double f(double x) { return casadi_erfinv(x); }"
    with pytest.raises(module._NotBuiltError, match=r"undefined.*casadi_erfinv"):
        module._made(compiler(), text, tmp_path)


def test_an_interrupt_does_not_wait_for_compilers(tmp_path):
    program = """
import casadi as ca
from workbench.fold.machine_code import all_compiled
x = ca.MX.sym("x")
all_compiled([ca.Function(name, [x], [ca.sin(x)]) for name in "fghi"])
"""
    environment = {"WORKBENCH_CACHE": str(tmp_path / "cache"), "CC": fake_compiler(tmp_path, "sleep 100 & wait")}
    process = subprocess.Popen([sys.executable, "-c", program], env=os.environ | environment, stderr=subprocess.PIPE)
    while not list(tmp_path.glob("cache/*/said")):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert b"KeyboardInterrupt" in process.communicate(timeout=30)[1] and process.returncode != 0
