"""A campaign as a plain loop over trials and samples, in numbers: what the compiled fold must give."""

from __future__ import annotations

import casadi as ca
import numpy as np

from models.quantity import nested, rebuilt, symbolised
from workbench.contracts.law import Trial


def campaign(study, controller):
    """Return inputs, outputs, states (lists over trials) and mse (trials, outputs) of one controller of a study."""
    law, plant, n = study.law(controller), study.plant_that_runs, study.horizon
    r = study.reference_samples
    memory = law.start(study.task(law))
    names = symbolised(plant).names
    left, end = [], None
    for one in study.inputs():
        runs = (
            plant if one.truth is None else rebuilt(plant, nested(dict(zip(names, map(float, one.truth), strict=True))))
        )
        step, output = runs.step_function(), runs.output_function()
        begin = end if study.continues and end is not None else one.x0
        x = [np.asarray(ca.DM(law.place(memory, ca.DM(begin)))).ravel()]
        y, u, states = [np.asarray(output(x[0])).ravel()], [], []
        state, ended = law.ready(memory), runs.ends and bool(ca.DM(runs.ended_at(ca.DM(x[0]))))
        k = 0
        while k < one.length and not ended:
            at = [field[:, k] if field.shape[1] > 1 else field for field in map(ca.DM, flat(memory))]
            memory_k = like(memory, at)
            acted, state = law.act(memory_k, state, ca.DM(r[:, k]), ca.DM(r[:, k + 1]), ca.DM(y[k] + one.noise[:, k]))
            acted = ca.vertcat(*acted) if isinstance(acted, (tuple, list)) else acted
            u.append(np.asarray(ca.DM(acted)).ravel())
            states.append([ca.DM(field) for field in flat(state)])
            x.append(np.asarray(step(x[k], u[k], one.w[:, k], k)).ravel())
            y.append(np.asarray(output(x[k + 1])).ravel())
            ended = runs.ends and bool(ca.DM(runs.ended_at(ca.DM(x[k + 1]))))
            k += 1
        whole_y, whole_u = np.full((r.shape[0], n + 1), np.nan), np.full((len(plant.inputs), n), np.nan)
        whole_y[:, : k + 1], whole_u[:, :k] = np.array(y).T, np.array(u).T
        e = r - whole_y
        mse = np.nansum(e[:, 1:] ** 2, axis=1) / k
        left.append((whole_u, whole_y, np.array(x).T, mse, k))
        reached = (np.arange(n + 1) <= k).astype(float)[None, :]
        rows = [ca.horzcat(*[s[i] for s in states], *[states[-1][i]] * (n - k)) for i in range(len(states[0]))]
        acting = like(state, rows)
        seen = whole_y + one.noise
        memory = law.learn(
            memory, Trial(ca.DM(r), ca.DM(seen), ca.DM(r - seen), ca.DM(whole_u), ca.DM(reached), acting)
        )
        end = x[-1]
    return left


def flat(kept):
    """Return all that a NamedTuple holds, what it holds in further ones in their place."""
    return [leaf for value in kept for leaf in (flat(value) if isinstance(value, tuple) else [value])]


def like(pattern, values):
    """Return values in the types of a pattern."""
    rest = iter(values)

    def made(of):
        parts = [made(value) if isinstance(value, tuple) else next(rest) for value in of]
        return type(of)(*parts) if parts else ()

    return made(pattern)
