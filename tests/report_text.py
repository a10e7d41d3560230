"""Everything that a report says in words, and what must not stand in it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from verification import Report
from verification.report.listing import fallen, told, verdict_table
from workbench.contracts.finding import Standing

INTERNAL = re.compile(
    r"\b(nan|NaN|NAN)\b|(?i:\binf(inity)?\b)"  # numbers that are none, as a program writes them; Nan is a name
    r"|Traceback|File \"[^\"]*\", line \d"
    r"|\b\w*(Error|Exception|Warning)\b: "  # with its message: the bare name may stand
    r"|\bobject at 0x|<(function|class|bound method|lambda)|\b0x[0-9a-f]{6,}"
    r"|\bnp\.\w+\(|\bnumpy\.|\barray\(|\bdtype\b|\bDM\(|\bMX\(|\bSX\("
    r"|\.(cpp|hpp|py):\d+|\bcasadi\b.*::|\bNonlinear\w*::"
    r"|[Ee]xactly singular|[Ss]ingular matrix|did not converge after"
    r"|invalid value encountered|divide by zero encountered"
    r"|not aligned|could not be broadcast|unexpected keyword argument|positional argument"
)
"""What a library or an interpreter says of itself."""


def texts(report: Report) -> Iterator[tuple[str, str]]:
    """Give where a text of a report stands, and the text."""
    for one in report.all_verdicts:
        at = f"{one.claim} {one.controller or ''} {one.case}"
        said = [one.statement, one.source, one.method, one.unit, one.bound_unit, one.measured, one.contradiction]
        said += [word for premise in one.premises for word in (premise.statement, premise.method)]
        said += [*one.scope, *(interval.unit for interval in one.scope.values())]
        said += [one.expected.why, one.expected.published] if one.expected else []
        yield from ((at, text) for text in said)
    for lacking in report.all_not_made:
        yield from ((f"{lacking.claim}, not made", text) for text in (lacking.statement, lacking.source, lacking.lacks))
    for case in (report, *report.cases.values()):
        yield from (("conclusion", text) for text in case.conclusion)
        yield from (("a figure", figure.caption) for figure in case.figures.values())
        for table in case.tables:
            rows = [[table.title], table.header, *table.rows]
            yield from ((f"table {table.title}", cell) for row in rows for cell in row)
    yield from (("terminal", text) for text in (*fallen(report), *told(report)))
    yield from (("terminal", cell) for row in verdict_table(report) for cell in row)


def faults(report: Report) -> list[str]:
    """Return every place where a report speaks the words of a program, with what it says."""
    found = [(at, text, INTERNAL.search(text)) for at, text in texts(report)]
    return [f"{at}: {hit.group()!r} in {text!r}" for at, text, hit in found if hit]


def reasons(report: Report) -> list[str]:
    """Return the verdicts that are UNDECIDED because the program met an error, which the log tells."""
    return [
        one.claim for one in report.all_verdicts if one.standing is Standing.UNDECIDED and "see its log" in one.method
    ]
