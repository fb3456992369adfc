"""The derivative of one function of an answer along fields of its problem: the adjoint of `sensitivity`.

With K v = g + B^T z, of the multipliers z of the equations of contact, v is what the function owes to nodal forces, and
what it owes to Young's modulus of a cell is the work of the stress there along -v.  In a load history the function owes
to the displacement after the step before, from which slip counts, and so on backwards along the steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Elasticity
from ..fem.contact import row_products
from ..solvers.derivatives import gradient as adjoint
from .discrete_problem import DiscreteProblem
from .sensitivity import refuse, unloaded, with_loading
from .stopping_criterion import directions_on_supports


@dataclass(frozen=True)
class Gradient:
    """What a function J of an answer owes to fields of the problem; this rank's part.

    Attributes:
        friction: Along the coefficient of friction of every contact point, where the bound is F x_n; shape (m,).
        bound: Along the bound of friction of every point, per newton, shape (m,).
        gap: Along the given gap of every point, per metre, shape (m,).
        load: Along nodal forces, per newton, shape (k, 3).
        prescribed: Along prescribed displacements, 0 where none is, per metre, shape (k, 3), with what follows these
            nodes.
        young: Of each body of built-in materials by its name, along the logarithm of Young's modulus of every cell of
            this rank, shape (c,).
        pretension: Along the force of each bolt by its face, per newton; 0 if it is locked.
        before: In a load step, along the displacement after the step before, per metre, shape (k, 3); else None.
    """

    friction: FloatArray
    bound: FloatArray
    gap: FloatArray
    load: FloatArray
    prescribed: FloatArray
    young: dict[str, FloatArray]
    pretension: dict[str, float]
    before: FloatArray | None


def gradient(
    problem: DiscreteProblem,
    x: FloatArray,
    u: FloatArray,
    of_force: FloatArray | None,
    of_u: FloatArray | None,
    later: Gradient | None = None,
) -> Gradient:
    """Of a function J of an answer, by the adjoint equations: one linear system of the contact and two solves with K,
    however many inputs there are (`solvers.derivatives.gradient`); collective.

    Args:
        problem: The problem,
        x: with the contact forces of its answer, newtons, shape (3 m,),
        u: and the displacement, metres, shape (k, 3).
        of_force: dJ/dx, per newton, shape (3 m,),
        of_u: and dJ/du, per metre, shape (k, 3); None is 0.
        later: That of the load step after, by whose `before` J owes to this u as well.

    Raises:
        ValueError: In large motions, with foundations under load, with heat, or in a load step where friction depends
            on the slip rate; where J depends on friction that supports leave undetermined.
    """
    refuse(problem)
    if problem.body.undeformed is not None or problem.state.loaded:
        raise ValueError("gradients are known of small strains with foundations whose motion is given")
    surface, still = problem.surface, unloaded(problem.loading)
    of_u = np.zeros_like(u) if of_u is None else of_u
    if later is not None:
        if later.before is None or later.before.shape != u.shape:
            raise ValueError("later must be the gradient of the load step after, and is that of another problem")
        of_u = of_u + later.before
    of_x = np.zeros_like(x) if of_force is None else of_force

    def response(load: FloatArray) -> tuple[FloatArray, FloatArray]:
        """K^-1 of nodal forces (k, 3), and the forces along rigid motions."""
        loaded = with_loading(problem, replace(still, load=load))
        along = np.zeros(0) if loaded.state.rigid is None else loaded.state.rigid.e
        return loaded.linear.free_displacement, along

    free, along = response(of_u)
    undetermined: FloatArray = np.zeros((len(surface.nodes), 2))
    if surface.slip_prescribed:
        undetermined = directions_on_supports(row_products(surface.free_B, surface.points)[:, 1:, 1:])
    owed = adjoint(problem.friction_problem, x, of_x - surface.rows(free).ravel(), along, undetermined)
    whole = of_u + surface.at_nodes(owed.b)
    v, body, before = response(whole)[0], problem.elasticity, problem.before
    reaction = whole - body.internal_force(v) + body.spring_force(v)
    v = problem.moved(v, owed.e)
    start = None
    if before is not None:  # slip counts from there, and supports that have begun and locked bolts move on from there
        start = body.after_transposed(problem.time, before.time, reaction)
        start -= surface.at_nodes(owed.b.reshape(-1, 3) * [0.0, 1.0, 1.0])
    return Gradient(
        friction=owed.bound * np.maximum(x[0::3], 0.0),
        bound=owed.bound,
        gap=-owed.b[0::3],
        load=v,
        prescribed=body.held.held_part(body.reduction.transferred(reaction)[: len(u)]),
        young={
            member.name: -member.body.work_in_cells(
                u[member.nodes], v[member.nodes], None if part.temperature is None else part.temperature.change
            )
            for member, part in zip(body.members, problem.loading.parts or [problem.loading], strict=True)
            if isinstance(member.body, Elasticity)
        },
        pretension={one.face: 0.0 if one.locked else one.shortening for one in body.constraints.bolts_at(v)},
        before=start,
    )
