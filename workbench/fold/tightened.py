"""CasADi's generated C, tightened: the same operations in the same order, in fewer and longer loops.

CasADi turns the fold over samples into nested calls that copy every argument, and every operation on a row into
a loop of its own. Here the fold becomes one loop over samples, whose states and parameters are local, and
neighbouring loops over the same row become one. Text that is not recognised stays as it is.
"""

from __future__ import annotations

import re

SAMPLES = "samples"
"""Name of a fold over samples: ``samples_A_F`` accumulates A inputs, and its last F inputs never change."""

_SAMPLE = re.compile(r"/\* sample:\((?P<ins>.*?)\)->\((?P<outs>.*?)\) \*/\nstatic int (?P<function>\w+)\(")
_FOLD = re.compile(
    rf"/\* {SAMPLES}_(?P<states>\d+)_(?P<fixed>\d+):\(i0.*?\[\d+x(?P<samples>\d+)\].*?\*/\n"
    r"static int (?P<function>\w+)\(.*?\) \{\n(?P<body>.*?)\n\}\n",
    re.DOTALL,
)
_ROW_LOOP = re.compile(
    r"  for \(i=0, rr=(?P<rr>\w+)(?:, cr=(?P<cr>\w+))?(?:, cs=(?P<cs>\w+))?; i<(?P<n>\d+); \+\+i\) "
    r"(?P<body>(?!for ).*);"  # a transpose has a loop in its body
)
_REPEAT = re.compile(
    r"for \(i=0;i<(?P<times>\d+);\+\+i\) \{\n    casadi_copy\(.*?, (?P<rows>\d+), (?P<buffer>w\d+)\+ i\*(?P=rows)\);"
)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_TERM = r"([\w\[\]]+)"
_BRANCHLESS = [  # what C says with branches, said so that the compiler works on several numbers at once
    (re.compile(rf"\({_TERM}&&{_TERM}\)"), r"(\1!=0 ? 1. : 0.)*(\2!=0 ? 1. : 0.)"),
    (re.compile(rf"\({_TERM}\|\|{_TERM}\)"), r"1.-(\1!=0 ? 0. : 1.)*(\2!=0 ? 0. : 1.)"),
    (re.compile(rf"\(! {_TERM} \)"), r"(\1!=0 ? 0. : 1.)"),
    (re.compile(rf"^(.*?)=\s*\({_TERM}\?{_TERM}:0\)$"), r"{ const casadi_real t = \3; \1= \2!=0 ? t : 0.; }"),
]


def tightened(source: str) -> str:
    """Return generated C that does the same with fewer passes over memory."""
    return _fused(_one_loop(_inlined(source)))


def _inlined(source: str) -> str:
    """Replace the library's fmax and fmin, which are calls, by what they mean; NaN stays missing data.

    Of zeros of both signs the first is taken, as by the C library of x86-64: another's result is its own affair.
    """
    source = source.replace("return fmax(x, y);", "return x>=y || y!=y ? x : y;")
    return source.replace("return fmin(x, y);", "return x<=y || y!=y ? x : y;")


def _sizes(arguments: str) -> list[int]:
    """Return the number of values of each argument of ``i0[2],i1,i2[1x20]``."""
    sizes = []
    for argument in arguments.split(","):
        size = 1
        for factor in re.findall(r"\[(.*)\]", argument):
            for number in factor.split("x"):
                size *= int(number)
        sizes.append(size)
    return sizes


def _one_loop(source: str) -> str:
    """Make the fold over samples one loop that calls the sample's function, which the compiler then inlines."""
    sample, fold = _SAMPLE.search(source), _FOLD.search(source)
    if sample is None or fold is None:
        return source
    ins, outs = _sizes(sample["ins"]), _sizes(sample["outs"])
    states, fixed = int(fold["states"]), int(fold["fixed"])
    first_fixed = len(ins) - fixed
    c = [f"  const casadi_real* a[{len(ins)}]; casadi_real* o[{len(outs)}]; casadi_int j, k;"]
    for i in range(states):
        c.append(f"  casadi_real x{i}[{max(1, ins[i])}], n{i}[{max(1, ins[i])}];")
    for i in range(first_fixed, len(ins)):
        c.append(f"  casadi_real p{i}[{max(1, ins[i])}];")
    for i in range(states):
        c.append(f"  for (j=0; j<{ins[i]}; ++j) x{i}[j] = arg[{i}] ? arg[{i}][j] : 0;")
        c.append(f"  a[{i}] = x{i}; o[{i}] = n{i};")
    for i in range(states, first_fixed):
        c.append(f"  a[{i}] = arg[{i}];")
    for i in range(first_fixed, len(ins)):
        c.append(f"  for (j=0; j<{ins[i]}; ++j) p{i}[j] = arg[{i}] ? arg[{i}][j] : 0;")
        c.append(f"  a[{i}] = p{i};")
    for i in range(states, len(outs)):
        c.append(f"  o[{i}] = res[{i}];")
    c.append(f"  for (k=0; k<{fold['samples']}; ++k) {{")
    c.append(f"    if ({sample['function']}(a, o, iw, w, 0)) return 1;")
    for i in range(states):
        c.append(f"    for (j=0; j<{ins[i]}; ++j) x{i}[j] = n{i}[j];")
        c.append(f"    if (res[{i}]) for (j=0; j<{ins[i]}; ++j) res[{i}][k*{ins[i]}+j] = n{i}[j];")
    for i in range(states, first_fixed):
        c.append(f"    if (a[{i}]) a[{i}] += {ins[i]};")
    for i in range(states, len(outs)):
        c.append(f"    if (o[{i}]) o[{i}] += {outs[i]};")
    c += ["  }", "  return 0;"]
    after = _spared(source[fold.end("body") :], fold["function"], list(range(first_fixed, len(ins))))
    return source[: fold.start("body")] + "\n".join(c) + after


def _spared(source: str, function: str, fixed: list[int]) -> str:
    """Write once, instead of once a sample, what the fold reads once: its arguments ``fixed``."""
    call = source.find(f"if ({function}(arg1, res1")
    head, tail = source[: max(call, 0)], source[max(call, 0) :]
    handed = dict(re.findall(r"  arg1\[(\d+)\]=(w\d+);", head[head.rfind("  arg1[0]=") :]))
    buffers = {handed[str(i)] for i in fixed if str(i) in handed}
    last = {repeat["buffer"]: repeat for repeat in _REPEAT.finditer(head) if repeat["buffer"] in buffers}
    for repeat in sorted(last.values(), key=lambda match: -match.start()):
        head = f"{head[: repeat.start('times')]}1{head[repeat.end('times') :]}"
    return head + tail


def _indexed(loop: re.Match[str]) -> str:
    """Return a row loop's body with its running pointers written as rows at the index i."""
    body = loop["body"]
    for pointer in ("rr", "cr", "cs"):
        if loop[pointer]:
            body = re.sub(rf"\(?\*{pointer}\+\+\)?|\b{pointer}\[i\]", f"{loop[pointer]}[i]", body)
    return body


def _row_loop(line: str) -> re.Match[str] | None:
    """Return the match of a loop that reads and writes rows at its own index only, else None."""
    loop = _ROW_LOOP.fullmatch(line)
    if loop is None or re.search(r"\b(for|rr|cr|cs|ss|j)\b", _indexed(loop)):
        return None
    return loop


def _fused(source: str) -> str:
    """Join neighbouring loops over rows of one length: each of them reads and writes at its own index only."""
    done: list[str] = []
    group: list[str] = []
    length = ""
    source = _COMMENT.sub(lambda comment: comment[0].replace("\n", " "), source)  # matrices print on several lines
    for line in source.split("\n"):
        loop = _row_loop(line)
        if loop is None and group and line.startswith("  /* #"):
            continue
        if group and (loop is None or loop["n"] != length):
            done += [f"  for (i=0; i<{length}; ++i) {{", *group, "  }"]
            group = []
        if loop is None:
            done.append(line)
            continue
        length, body = loop["n"], _indexed(loop)
        for written, branchless in _BRANCHLESS:
            body = written.sub(branchless, body)
        group.append(f"    {body};")
    return "\n".join(done)
