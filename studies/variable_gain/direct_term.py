"""Whether a learning law that uses dy/dt has a direct term: h_x B of a plant, exactly, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

import casadi as ca
import numpy as np

from models.plant import Plant
from studies.variable_gain.law_equations import LawEquations
from verification.certificates.identity import constant, identity
from verification.certificates.theorem import theorem
from verification.checks.polynomial import Form, forms
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Held, NotCertified
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.graph import jacobian, read

STATE = (450.0, 15.0)
"""Position and speed at which a compiled plant is asked for its direct term again."""
ROUNDING = 1e-9
"""What a difference of two compiled rates may be off by."""


def rates(plant: Plant) -> ca.Function:
    """Return dy/dt of a plant in continuous time as a Function of x, u, w and t."""
    x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", len(plant.inputs))
    w, t = ca.SX.sym("w", len(plant.disturbances)), ca.SX.sym("t")
    rate = ca.jtimes(plant.measured(x), x, plant.slope(x, u, w, t))
    return ca.Function("rates", [x, u, w, t], [rate], ["x", "u", "w", "t"], ["rate"])


def direct_terms(plant: Plant) -> list[list[Form]]:
    """Return d(dy/dt)/du as normal forms, outputs by inputs, in all states, inputs and disturbances at once."""
    slopes = jacobian(read(rates(plant)), "rate", "u")
    return forms(slopes)[slopes.outputs[0].name]


def effect(plant: Plant, output: int) -> ca.Function:
    """Return dy/dt of one output as ``effect`` of x, the input u, w and t. Raises NotCertified for several inputs."""
    if len(plant.inputs) != 1:
        raise NotCertified(f"the theorem is of one input, the plant has {len(plant.inputs)}")
    every = rates(plant)
    x, u, w, t = (ca.SX.sym(name, *every.size_in(name)) for name in every.name_in())
    return ca.Function("direct", [x, u, w, t], [every(x, u, w, t)[output]], ["x", "u", "w", "t"], ["effect"])


def direct_term(says: str, plant: Plant, output: int) -> Certificate:
    """Return the certificate that d(dy/dt)/du of an output is one number, in every state and for every input."""
    of, place = effect(plant, output), ("effect", 0, 0, "u")
    return identity(says, of, [(place, constant(of, place))])


def answered(says: str, plant: Plant, output: int) -> Certificate:
    """Return the certificate that d(dy/dt)/du of an output is a number, and not 0."""
    return theorem("effect", slopes=direct_term(says, plant, output))


def contracting(says: str, plant: Plant, output: int, gain: Certificate) -> Certificate:
    """Return the certificate that |1 - b lambda| is below 1 for every lambda between the ends that ``gain`` shows."""
    return theorem("contraction", slopes=direct_term(says, plant, output), gain=gain)


def measured_term(plant: Plant, output: int, state: Sequence[float] = STATE, u: float = 0.0) -> float:
    """Return d(dy/dt)/du of one output by one more unit of input, computed by the compiled plant in one state."""
    rate, rest = rates(plant), np.zeros(len(plant.disturbances))
    more, less = (float(rate(state, force, rest, 0)[output]) for force in (u + 1.0, u))
    return more - less


def held_terms(plant: Plant, finding: Finding) -> Held:
    """Hold a proved direct term against the compiled plant in a hundred states, with forces of either sign."""
    rng, tries = np.random.default_rng(0), 100
    names = [signal.name for signal in plant.outputs]
    witness = finding.witness or {}
    output, proved = names.index(str(witness["output"])), float(str(witness["d(dy/dt)/dF"]))
    least: float = ROUNDING
    where: dict[str, object] = {}
    for state, u in zip(rng.uniform([-50, -25], [1550, 25], (tries, 2)), rng.uniform(-2, 2, tries), strict=True):
        room = ROUNDING - abs(abs(measured_term(plant, output, state, float(u))) - proved)
        if not where or room < least:
            least, where = room, {"state": state.tolist(), "u": float(u)}
    return Held(tries, least, where)


def spectral_radius(plant: Plant, lam: float) -> Finding:
    """Find the spectral radius of I - h_x B lambda for two outputs and u = [0, F], as the patent has it.

    A plant with two inputs of its own keeps them. With the eigenvalues 1 - lambda d of a triangular h_x B the radius
    is below 1 for every gain in (0, lambda] if it is for lambda itself.
    """
    terms = [[form.constant for form in row] for row in direct_terms(plant)]
    if len(terms) != 2 or any(one is None for row in terms for one in row):
        return undecided("h_x B is no constant matrix of two rows here, so it has no exact eigenvalues")
    direct = [[one or Fraction(0) for one in row] for row in terms]
    direct = [[Fraction(0), *row] if len(row) == 1 else row for row in direct]
    if direct[0][1] != 0 and direct[1][0] != 0:
        return undecided("h_x B is not triangular, so its eigenvalues are not read off its diagonal")
    eigenvalues = [1 - Fraction(lam) * direct[i][i] for i in range(2)]
    radius = max(abs(one) for one in eigenvalues)
    return Finding(
        grounds=Grounds.ALGEBRA,
        method="h_x B from the plant's equations, in rational arithmetic and the same in every state; it is "
        "triangular, so the eigenvalues of I - h_x B lambda stand on its diagonal",
        margin=float(1 - radius),
        unit="1",
        bound=float(radius),
        bound_unit="1",
        witness={
            "lambda": lam,
            "h_x_B": [[float(one) for one in row] for row in direct],
            "eigenvalues": sorted(float(one) for one in eigenvalues),
        },
    )


def contraction(plant: Plant, output: int, law: LawEquations) -> Finding:
    """Bound |1 - b lambda| over all gains that a law can take, b = d(dy/dt)/du of one output."""
    (term,) = direct_terms(plant)[output]
    b, gains = term.constant, law.gains
    if b is None:
        return undecided("the input gain depends on state, input or time: a bound of it over all of them would decide")
    factor = max(abs(1 - b * gains.low), abs(1 - b * gains.high))
    how = "lambda is a setting" if gains.fixed else "lambda from the law's own equations, whatever the errors are"
    method = (
        "dv/dt is affine in F with the factor b, the same in every state, by rational arithmetic; "
        f"{how}; |1 - b lambda| is convex in lambda, so it is largest at an end"
    )
    if factor < 1:
        return Finding(
            grounds=Grounds.ALGEBRA if gains.fixed else Grounds.ENCLOSURE,
            method=method,
            margin=float(1 - factor),
            unit="1",
            bound=float(factor),
            bound_unit="1",
            witness={"b": float(b), "least lambda": float(gains.low), "largest lambda": float(gains.high)},
        )
    tried = {i: law.attained(row) for i, row in enumerate(gains.tried)}
    worst = max(tried, key=lambda i: abs(1 - float(b) * tried[i]))
    reached = abs(1 - b * Fraction(tried[worst]))
    if reached < 1:
        return undecided(
            f"the bound of |1 - b lambda| is {float(factor):.4g}, and no errors were found that reach 1",
            b=float(b),
            factor=float(reached),
        )
    return Finding(
        grounds=Grounds.ALGEBRA if gains.fixed else Grounds.ENCLOSURE,
        method=method,
        margin=float(1 - reached),
        unit="1",
        bound=float(reached),
        bound_unit="1",
        witness={
            "b": float(b),
            "lambda": tried[worst],
            "factor": float(reached),
            "speed_error": gains.tried[worst].tolist() if not gains.fixed else None,
        },
    )


def contracts_at(plant: Plant, output: int, law: LawEquations, witness: Mapping[str, object]) -> float:
    """Return 1 - |1 - b lambda| at a witness, b by the compiled plant and lambda by the compiled law."""
    error = np.asarray(witness["speed_error"] or [], dtype=float)
    return 1 - abs(1 - measured_term(plant, output) * law.attained(error))


def answers_at_once(plant: Plant, outputs: Sequence[str]) -> Finding:
    """Look for outputs whose first derivative by time does not depend on the input.

    That is the relative degree of ``rhs``; the plant's ``relative_degree`` is that of ``step``, where a force held
    over a sample moves the position too.
    """
    direct = dict(zip([signal.name for signal in plant.outputs], direct_terms(plant), strict=True))
    values: dict[str, Fraction] = {}
    for output in outputs:
        found = [form.constant for form in direct[output]]
        if any(one is None for one in found):
            return undecided(
                f"d(d{output}/dt)/dF depends on state, input or time: a bound of it over all of them would decide"
            )
        values[output] = max(abs(one) for one in found if one is not None)
    least = min(outputs, key=lambda output: values[output])
    return Finding(
        grounds=Grounds.ALGEBRA,
        method="d(dy/dt)/dF of every output from the plant's equations, in rational arithmetic and the same in every "
        "state",
        margin=float(values[least]),
        unit="output/s per input unit",
        witness={"output": least, "d(dy/dt)/dF": float(values[least])},
    )


def answers_at(plant: Plant, witness: Mapping[str, object]) -> float:
    """Return how far an output's slope moves with one more unit of input, by the compiled plant."""
    names = [signal.name for signal in plant.outputs]
    return abs(measured_term(plant, names.index(str(witness["output"]))))
