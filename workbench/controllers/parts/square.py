"""Laws that work channel by channel: input i acts on output i, so there must be as many inputs as outputs."""

from __future__ import annotations

from workbench.contracts.law import Task


def unequal(law: object, task: Task) -> str | None:
    """Return the refusal of a task with more inputs than outputs, or fewer; None where they are as many."""
    outputs = int(task.reference.shape[0])
    inputs = outputs if task.model is None else len(task.model.inputs)
    if inputs == outputs:
        return None
    return (
        f"{type(law).__name__} works channel by channel, so it needs as many inputs as outputs; there are {inputs} "
        f"input(s) and {outputs} output(s)"
    )
