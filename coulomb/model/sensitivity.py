"""Exact derivatives of an answer of small strains along its inputs, by the sets of its contact points.

At an answer u = K^-1 (f - B^T x), and contact points are open, stick or slip.  While none of them changes its state,
forces follow from the derivative of the equations of contact (`solvers.semismooth_newton.derivatives`): one linear
system per input, with the K^-1 and A of the answer.  What an input does to the displacement without new contact forces
is that of loads: of friction none, of a load itself, of Young's modulus E minus the internal forces K_E u.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import ThermalLoad
from ..linalg.reductions import Reductions
from ..solvers.semismooth_newton import Change, derivatives
from .discrete_problem import DiscreteProblem


@dataclass(frozen=True)
class Sensitivity:
    """What an answer owes to one input.

    Attributes:
        name: "friction of 'bottom'", "pressure on 'top'", "young of 'upper'", "gap of 'bore'", "prescribed".
        contact_force: Derivative of x along the logarithm of the input, newtons, shape (3 m,): a hundredth of it is
            what 1 % more of the input does.
        totals: Of each contact by its name derivatives of "force" and "moment" on the body, "normal_force" and
            "friction_force", newtons and newton metres.
        step: Relative change of the input up to which no contact point opens, closes, sticks or slips anew, to first
            order: so far the answer is linear in it.
    """

    name: str
    contact_force: FloatArray
    totals: dict[str, dict[str, Any]]
    step: float

    def entry(self) -> dict[str, Any]:
        """Of summary.json; a step without end is null."""
        return {"input": self.name, "totals": self.totals, "step": self.step if np.isfinite(self.step) else None}


def sensitivities(problem: DiscreteProblem, x: FloatArray, u: FloatArray, gap: FloatArray) -> list[Sensitivity]:
    """Of an answer of small strains to friction, given gaps, loads, prescribed displacements and Young's moduli;
    collective.

    Args:
        problem: The problem,
        x: with the contact forces of its answer, newtons, shape (3 m,),
        u: and the displacement, metres, shape (k, 3).
        gap: The given gap of every contact point, metres, shape (m,).

    Raises:
        ValueError: In large motions, or with heat.
    """
    if problem.body.undeformed is not None or problem.body.heat is not None:
        raise ValueError("sensitivities are known of small strains without heat, where a problem is one linear system")
    names, changes = zip(*_changes(problem, x, u, gap), strict=True)
    found = derivatives(problem.friction_problem, x, changes)
    return [
        Sensitivity(name, one.x, _totals(problem, x, one.x), one.step) for name, one in zip(names, found, strict=True)
    ]


def _changes(problem: DiscreteProblem, x: FloatArray, u: FloatArray, gap: FloatArray) -> Iterator[tuple[str, Change]]:
    """Every input with the change of the problem along its logarithm."""
    state, surface, loading, body = problem.state, problem.surface, problem.loading, problem.elasticity
    none, no_bound = np.zeros_like(x), np.zeros(len(surface.nodes))
    no_motion = np.zeros(0 if state.rigid is None else len(state.rigid.e))
    parts = [surface.part == part for part in range(len(surface.faces))]
    for face, here in zip(surface.faces, parts, strict=True):
        bound = problem.slip_bound(x)
        if Reductions(problem.comm).any(bool(np.any(bound[here] > 0.0))):
            yield f"friction of {face!r}", Change(none, np.where(here, bound, 0.0), no_motion)
    for face, here in zip(surface.faces, parts, strict=True):
        if Reductions(problem.comm).any(bool(np.any(gap[here] != 0.0))):
            closing = none.copy().reshape(-1, 3)
            closing[here, 0] = -gap[here]
            yield f"gap of {face!r}", Change(closing.ravel(), no_bound, no_motion)

    unmoved, free = np.zeros_like(body.x), None if loading.tension is None else np.zeros_like(loading.tension)

    def posed(load: FloatArray, prescribed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """b and the loads along rigid motions of nodal forces and prescribed displacements, both (k, 3)."""
        changed = replace(loading, load=load, prescribed=prescribed, tension=free, apart=0.0)
        other = problem.in_state(replace(state, loading=changed), None, problem.before)
        return other.b, np.zeros(0) if other.state.rigid is None else other.state.rigid.e

    without = posed(unmoved, unmoved)

    def along(load: FloatArray, prescribed: FloatArray) -> Change:
        b, e = posed(load, prescribed)
        return Change(b - without[0], no_bound, e - without[1])

    for load in body.loads_in(loading):
        where = "" if load.face is None else f" on {load.face!r}"
        yield f"{load.kind.replace('_', ' ')}{where}", along(load.forces, unmoved)
    if Reductions(problem.comm).any(bool(np.any(problem.prescribed))):
        yield "prescribed displacements", along(unmoved, loading.prescribed)
    for member, part in zip(body.members, loading.parts or [loading], strict=True):
        if member.body.materials is None:
            continue
        forces = np.zeros_like(body.x)
        strained = (one.forces for one in member.body.loads_in(part) if one.kind == ThermalLoad.kind)
        forces[member.nodes] = sum(strained) - member.body.internal_force(u[member.nodes])
        yield "young" + (f" of {member.name!r}" if member.name else ""), along(forces, unmoved)


def _totals(problem: DiscreteProblem, x: FloatArray, dx: FloatArray) -> dict[str, dict[str, Any]]:
    """Derivatives of the totals of every contact for a derivative of the forces, both (3 m,); collective."""
    surface, over, found = problem.surface, Reductions(problem.comm), {}
    on_body = -surface.vectors(dx.reshape(-1, 3))
    both = x.reshape(-1, 3), dx.reshape(-1, 3)
    tangential = [-surface.vectors(of * [0.0, 1.0, 1.0]) for of in both]
    for part, face in enumerate(surface.faces):
        here = surface.part == part
        friction, change = (over.total(of[here].sum(axis=0)) for of in tangential)
        size = float(np.linalg.norm(friction))
        found[face] = {
            "force": over.total(on_body[here].sum(axis=0)).tolist(),
            "moment": over.total(np.cross(surface.x[here], on_body[here]).sum(axis=0)).tolist(),
            "normal_force": over.sum(dx[0::3][here]),
            "friction_force": float(friction @ change) / size if size > 0.0 else 0.0,
        }
    return found
