"""What temperatures and heat flows of an answer owe to pressures, friction and what heats it.

Conduction is steady, and its temperatures are a smooth function of the pressures at closed contact points, of the power
of friction, and of factors of loads and conductances: differences along one direction, of two solves with the matrix of
conduction each.  Contact and heat are solved in turn, as the answer is.
"""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Loading
from ..fem.geometry import evaluate_amplitude
from ..linalg.reductions import Reductions
from .discrete_problem import DiscreteProblem
from .heat import HeatProblem
from .nodal_answer import OPEN, NodalAnswer

_STEP: Final = 1e-4
_LEAST: Final = 1e-3
"""Change along a direction over what changes, with errors of 1e-8, and the least part of it that is taken where points
open before."""


Flows = dict[str, float]
"""Heat flows by their names, watts."""


@dataclass(frozen=True)
class HeatInput:
    """An input of conduction by its number among the loads, or among the contacts, of which it is the conductance."""

    load: int | None = None
    contact: int | None = None


class HeatDerivatives:
    """Of an answer at its contact points.

    Args:
        problem: With heat.
        at: The answer.
    """

    def __init__(self, problem: DiscreteProblem, answer: NodalAnswer):
        heat, before = problem.state.heat, problem.before
        assert problem.body.heat is not None and heat is not None
        self._problem, self._heat, self._at, self._change = problem, problem.body.heat, answer, heat.change
        self._duration = np.inf if before is None else problem.time - before.time
        self._closed = answer.status != OPEN

    def inputs(self) -> dict[str, HeatInput]:
        """Those that are not 0, by their names; a name that occurs again has a number; collective."""
        conduction, over, inputs = self._heat.conduction, Reductions(self._at.comm), dict[str, HeatInput]()
        factors, seen = conduction.factors(self._problem.time), Counter[str]()
        fixed, heats = conduction.prescribed(factors), conduction.heat(factors)
        for number, load in enumerate(conduction.loads):
            if over.any(bool(np.any(heats[number]) or np.any(fixed[conduction.fixed_by == number]))):
                name = load.title if load.body is None else f"{load.title} of {load.body!r}"
                seen[name] += 1
                inputs[f"{name} ({seen[name]})" if seen[name] > 1 else name] = HeatInput(load=number)
        for number, (contact, face) in enumerate(zip(self._problem.contacts, self._at.faces, strict=True)):
            if contact.thermal.conducts:
                inputs[f"conductance of {face!r}"] = HeatInput(contact=number)
        return inputs

    def along(self, dx: FloatArray, slipping: FloatArray, given: HeatInput | None) -> tuple[FloatArray, Flows]:
        """Derivatives of the temperature, kelvin, shape (k,), and of the flows, watts, along those of contact forces
        and of relative displacements (m, 3), and along the logarithm of an input; collective."""
        answer, over = self._at, Reductions(self._at.comm)
        pressure, power = answer.pressure, answer.work_at_end / self._duration
        along = np.where(self._closed, dx[:, 0] / answer.area, 0.0)
        rubbing = np.sum((dx * answer.relative_displacement + answer.force * slipping)[:, 1:], axis=1) / self._duration
        sizes = [max(over.max(np.abs(of)), 1e-300) for of in (pressure, power)]
        least = np.where(self._closed & (along != 0.0), pressure / np.where(along != 0.0, np.abs(along), 1.0), np.inf)
        fast = max(over.max(np.abs(along)) / sizes[0], over.max(np.abs(rubbing)) / sizes[1], float(given is not None))
        h = max(min(_STEP / fast, -0.5 * over.max(-least)), _LEAST * _STEP / fast) if fast > 0.0 else _STEP
        ends = []
        for step in (h, -h):
            heat = _with(self._heat, given, 1.0 + step)
            pressed = np.maximum(pressure + step * along, _LEAST * pressure)  # closed points stay so
            there = self._problem.surface, self._problem.time, pressed, power + step * rubbing
            change = heat.solve(*there, self._change)
            ends.append((change, {flow.name: flow.power for flow in heat.flows(*there, change).flows}))
        (more, flows), (less, before) = ends
        return (more - less) / (2.0 * h), {name: (flows[name] - before[name]) / (2.0 * h) for name in flows}

    def load(self, loading: Loading, change: FloatArray) -> Loading:
        """A loading with the thermal forces of a change of temperature (k,) besides; collective."""
        body, posed = self._problem.elasticity, self._problem.loading
        forces = body.heated(posed, change).load - body.heated(posed, np.zeros_like(change)).load
        return replace(loading, load=loading.load + forces)


def _with(heat: HeatProblem, given: HeatInput | None, factor: float) -> HeatProblem:
    """With an input times a factor."""
    if given is None:
        return heat
    there = copy.copy(heat)
    if given.load is not None:
        there.conduction = copy.copy(heat.conduction)
        loads, one = list(heat.conduction.loads), heat.conduction.loads[given.load]
        loads[given.load] = replace(
            one, amplitude=lambda time: factor * evaluate_amplitude(one.amplitude, time, one.title)
        )
        there.conduction.loads = tuple(loads)
        return there
    assert given.contact is not None
    contacts, thermal = list(heat.contacts), heat.contacts[given.contact].thermal
    constant = thermal.conductance
    of_place = (lambda x: factor * constant(x)) if callable(constant) else factor * constant
    better = replace(thermal, conductance=of_place, factor=factor * thermal.factor)
    contacts[given.contact] = replace(contacts[given.contact], thermal=better)
    there.contacts = tuple(contacts)
    return there
