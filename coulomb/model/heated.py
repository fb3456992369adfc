"""Contact and heat conduction solved in turn until both agree."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..fem.contact import ContactSurface
from ..linalg.reductions import Reductions
from ..solvers.results import NotConverged, Status
from .discrete_problem import DiscreteProblem
from .heat import Heat, HeatProblem
from .solution import Solution
from .solving import Solving, answer_of

AGREEMENT: Final = 1e-9
"""Change of temperature in a round, over the largest, at which contact and heat agree."""

SHORTEST, LONGEST = 0.1, 3.0
"""Bounds of the factor by which the change of temperature of a round is taken (Aitken)."""

ROUNDS: Final = 50
"""Maximum number of rounds of contact and conduction."""


class HeatNotConverged(NotConverged):
    """Contact and heat do not agree, or nothing fixes the temperature of a body."""


def heated(posed: DiscreteProblem, heat: HeatProblem, solving: Solving, start: FloatArray | None) -> Solution:
    """The answer with the temperature that it causes itself: contact and conduction are solved in turn, from the
    temperature of the load step before."""

    def at(change: FloatArray, one: DiscreteProblem = posed, flows: Heat | None = None) -> DiscreteProblem:
        loading = one.elasticity.heated(posed.loading, change)
        return one.in_state(replace(one.state, loading=loading, heat=flows), one.seconds, one.before)

    over, factor, step = Reductions(posed.comm), 1.0, None
    change: FloatArray = np.zeros(len(posed.elasticity.x))
    if posed.before is not None and posed.before.temperature_change is not None:
        change = posed.before.temperature_change
    answer, apart = solving.in_place(at(change), start), np.inf
    steps, products = answer.result.newton_steps, answer.result.products
    for rounds in range(1, ROUNDS + 1):
        try:
            temperature = heat.solve(*at_contact(answer), change)
        except ValueError as error:
            raise HeatNotConverged(str(error), replace(answer.result, status=Status.STAGNATED)) from None
        apart = float(over.max(np.abs(temperature - change)) / (over.max(np.abs(temperature)) or 1.0))
        if apart <= AGREEMENT:
            last = answer_of(at(temperature, answer.problem), answer.result)  # foundations under load where they rest
            flows = heat.flows(*at_contact(last), temperature)
            loose = not answer.certificate.passed  # the solver was not asked for it
            if (last.certificate.passed or loose) and flows.balanced:
                whole = replace(last.result, newton_steps=steps, products=products)  # of all rounds
                there = at(temperature, answer.problem, replace(flows, rounds=rounds, agreement=apart))
                return replace(last, problem=there, result=whole)
        if step is not None:  # Aitken's relaxation
            turn = temperature - change - step
            factor *= -over.dot(step, turn) / (over.dot(turn, turn) or 1.0)
            factor = min(max(factor, SHORTEST), LONGEST)
        step = temperature - change
        change = change + factor * step
        answer = solving.in_place(at(change), answer.contact_force)
        steps, products = steps + answer.result.newton_steps, products + answer.result.products
    missing = heat.flows(*at_contact(answer), change).imbalance
    raise HeatNotConverged(
        f"contact and heat do not agree after {ROUNDS} rounds: the temperature changes by {apart:.1e} of itself, "
        f"and {missing:.1e} W of heat are missing; what may help: smaller load steps, or a smaller conductance, or "
        "one that depends on pressure",
        replace(answer.result, status=Status.STAGNATED),
    )


def at_contact(answer: Solution) -> tuple[ContactSurface, float, FloatArray, FloatArray]:
    """What conduction takes of an answer: contact points, time, pressures in pascals and the power of friction in
    watts at the end of the load step, for which conduction is steady, shapes (m,); without load steps it has none."""
    nodes, problem = answer.at_nodes, answer.problem
    work, before = nodes.work_at_end, problem.before
    power = np.zeros_like(work) if before is None else work / (problem.time - before.time)
    return problem.surface, problem.time, nodes.pressure, power
