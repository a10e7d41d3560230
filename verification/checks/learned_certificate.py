"""The certificate of the form in which a law learns: the graph of what it learns, and the ends of its gain."""

from __future__ import annotations

from fractions import Fraction

from verification.certificates.bounds import plain
from verification.certificates.numbers import written
from verification.checks.learned_graph import OtherForm, learned_graph
from workbench.contracts.certificate import Certificate, hashed
from workbench.contracts.claim import NotCertified
from workbench.contracts.law import AnyLaw, Task


def learned(law: AnyLaw, task: Task) -> Certificate:
    """Return the certificate that a law learns as it declares. Raises NotCertified for one without ends of its gain."""
    gain = law.learning_gain
    if gain is None:
        raise NotCertified("the law declares no ends of its learning gain")
    try:
        found = learned_graph(law, task)
        content = plain(found.graph)
    except OtherForm as error:
        raise NotCertified(str(error)) from None
    name = hashed(content)
    never = {field: "0" for field, values in found.memory.items() if not values.any()}
    return Certificate(
        kind="learned",
        statement={
            "graph": name,
            "samples": found.samples,
            "varying": found.varying_lengths,
            "increment": found.increment,
            "least": written(Fraction(gain.low)),
            "most": written(Fraction(gain.high)),
            "begins": never,
        },
        graphs={name: content},
    )
