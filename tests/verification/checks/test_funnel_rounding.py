"""What doubles round of a state is seen by a law: it belongs to what is wanted as to the state."""

import numpy as np
from small_plants import small

from verification.checks.funnel import Carried, Maker
from workbench import Study
from workbench.contracts.law import LearningGain
from workbench.contracts.scope import scope_of
from workbench.controllers import Increment

N = 6
CANCELLING = small("Cancelling", lambda x, u, k: ((3 * (1e9 + 0.5 * x[0]) - 3e9) / 3 + u,))


def test_what_states_round_is_in_what_is_wanted():
    law = Increment(force_unit=1.0, rho=0.5, lam=1.0, mu=1.0, initial_input=0.3)
    study = Study(name="small", plant=CANCELLING, reference=np.sin(np.linspace(0, 1, N + 1)), controllers={"law": law})
    maker = Maker(study, LearningGain(0.0, 0.5), scope_of(study), np.full(N, 0.3))
    plain = maker.question()
    found = maker.carry(plain)
    assert isinstance(found, Carried)
    rounded = maker.question(carried=found)
    assert rounded.jolt[0] > 2.0**-53 * 1e9
    assert np.all(rounded.wanted[:, 1] - plain.wanted[:, 1] >= 0.99 * rounded.jolt[0])
    assert np.all(plain.wanted[:, 0] - rounded.wanted[:, 0] >= 0.99 * rounded.jolt[0])
