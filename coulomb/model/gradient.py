"""The derivative of one function of an answer along fields of its problem: the adjoint of `sensitivity`.

With K v = g + B^T z, of the multipliers z of the equations of contact, v is what the function owes to nodal forces, and
what it owes to Young's modulus of a cell is the work of the stress there along -v (the discrete adjoint: M. B. Giles,
N. A. Pierce, An introduction to the adjoint approach to design, Flow, Turbulence and Combustion 65, 2000, section 2; of
contact with friction: `solvers.derivatives`).  In a load history the function owes
to the displacement after the step before, from which slip counts, and so on backwards along the steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Elasticity, FormBody, HyperelasticBody, owed_before, owed_to_motions
from ..fem.contact import row_products
from ..linalg.reductions import Reductions
from ..solvers.derivatives import AnswerDerivatives, Change, Condition, at_answer
from ..solvers.successive_tresca import Anderson
from .changed_problem import near
from .discrete_problem import DiscreteProblem
from .geometric_terms import GeometricTerms, Way, least_rotations
from .linear_problem import ContactState
from .sensitivity import MOST, NEARLY, refuse, warn_of_several, with_loading
from .sensitivity_inputs import unloaded
from .shape_gradient import contact_along_places
from .stopping_criterion import directions_on_supports
from .transposed_terms import TransposedTerms
from .turning_terms import TurningTerms


@dataclass(frozen=True, eq=False)
class Gradient:
    """What a function J of an answer owes to fields of the problem; this rank's part.

    Attributes:
        friction: Along the coefficient of friction of every contact point, shape (m,); 0 where a limit is reached,
        cohesion: and likewise along its cohesion or slip stress, per pascal, shape (m,).
        bound: Along the bound of friction of every point, per newton, shape (m,).
        gap: Along the given gap of every point, per metre, shape (m,).
        load: Along nodal forces, per newton, shape (k, 3).
        prescribed: Along prescribed displacements, 0 where none is, per metre, shape (k, 3), with what follows these
            nodes.
        young: Of each body of built-in materials by its name, along the logarithm of Young's modulus of every cell of
            this rank, shape (c,); of hyperelastic ones with all their moduli in proportion.
        temperature: Along the change of temperature of every node, per kelvin, shape (k,), 0 of bodies without; None if
            no body has one.
        pretension: Along the force of each bolt by its face, per newton, or its shortening where that is prescribed,
            per metre; 0 if it is locked.
        motions: Along the six components of the motion of each rigid face by its name, per metre and per radian; 0
            where they are not prescribed.
        border: Number of contact points on the border of two states; here they are closed, and stick where they may,
        loose: and in this one open, and slip; None without any.  Along one direction J has a derivative on one side, by
            the states that these points take along it (`Sensitivity`): with one such point it is one of both.
        before: In a load step, along the displacement after the step before, per metre, shape (k, 3); else None.
        lagrangian: For `between`.
        condition: As of `Sensitivity`.
    """

    friction: FloatArray
    cohesion: FloatArray
    bound: FloatArray
    gap: FloatArray
    load: FloatArray
    prescribed: FloatArray
    young: dict[str, FloatArray]
    temperature: FloatArray | None
    pretension: dict[str, float]
    motions: dict[str, FloatArray]
    border: int
    loose: Gradient | None
    before: FloatArray | None
    lagrangian: Lagrangian
    condition: Condition

    def between(self, more: DiscreteProblem, less: DiscreteProblem) -> float:
        """By how much J of one problem is larger than J of another, to first order, both near to that of the answer on
        either side: exact as they come together, and without solving them; collective, the same on every rank.

        Over 2 h it is the derivative along h, of order h^2, whatever h changes: places of nodes (`coulomb.moved`),
        foundations, directions, materials, also in the user's forms.  J is given by its derivatives along contact
        forces and displacements alone: what it owes to areas and places by itself comes in addition.

        Args:
            more, less: Problems on meshes of the same cells, whose nodes and contact points are numbered alike; of a
                load step, of the history.

        Raises:
            ValueError: On every rank, if their nodes are others, or far from those of the answer; if distances from a
                foundation change by rounding errors of coordinates.
        """
        return self.lagrangian.of(more) - self.lagrangian.of(less)

    def along(self, coefficient: Any) -> FloatArray:
        """What J owes to a `dolfinx.fem.Constant` or Function in the user's forms, per unit of it, by UFL's derivative;
        collective.

        Of a Constant it has the shape of its value, and is the same on every rank; of a Function it is along its values
        on this rank, shape (n,) of those that it owns.  In a load history coefficients are those of this step.

        Raises:
            ValueError: On every rank, if it is in none of the forms, these are compiled, or have changed since.
        """
        answer = self.lagrangian.answer
        members = answer.elasticity.members
        each = [
            one.body.force_along(coefficient, part, self.lagrangian.displacement[one.nodes], self.load[one.nodes])
            for one, part in zip(members, answer.loading.parts or [answer.loading], strict=True)
            if isinstance(one.body, FormBody) and one.body.materials is None
        ]
        known = [of for of in each if of is not None]
        if not known:
            raise ValueError("along: the coefficient is in none of the forms of the bodies")
        return np.sum(known, axis=0)

    def places(self) -> FloatArray:
        """What J owes to the places of all nodes, per metre, shape (k, 3): the gradient of a shape; collective.

        What is given stays at nodes and cells, also where it is a function of place: loads per area and volume, total
        forces, prescribed displacements and their directions, friction, gaps and materials.  Foundations stay in space.
        So over a field of velocities of nodes its sum is the derivative that `between` gives along a shape.  Where
        plane facets of a pair do not match it is the mean of the derivatives on both sides, with a warning.

        Raises:
            ValueError: On every rank, with ties, rigid faces, bolts, slices, point loads, or forms that are compiled;
                if contact points come or go as nodes move, as where faces are flat on each other and covered in part.
        """
        return self.lagrangian.along_places()


@dataclass(frozen=True, eq=False)
class Lagrangian:
    """J with the equations of an answer, by their multipliers, as a function of the problem.

    Forces, the unknowns of displacements and the multipliers are those of the answer; what is prescribed, the equations
    and what follows from the unknowns by ties are those of the problem.  Its derivative is that of J.

    Attributes:
        answer: The problem of the answer,
        x: with its contact forces, newtons, shape (3 m,),
        u: and the unknowns of its displacement, metres, shape (k + p, 3).
        of_u: dJ/du, per metre, shape (k, 3).
        v: What J owes to forces along the unknowns, per newton, shape (k + p, 3),
        owed: and to the equations of contact.
    """

    answer: DiscreteProblem
    x: FloatArray
    u: FloatArray
    of_u: FloatArray
    v: FloatArray
    owed: Change

    def of(self, problem: DiscreteProblem) -> float:
        """Its value for a problem near to that of the answer; collective."""
        refuse_moving(problem)
        problem, over = near(self.answer, problem), Reductions(self.answer.comm)
        body, loading = problem.elasticity, problem.loading
        reduction = body.reduction
        u, v = reduction.displacement(self.u) + loading.prescribed, reduction.displacement(self.v)
        forces = loading.load + body.spring_force(u) - body.internal_force(u)
        value = over.sum(float(np.vdot(self.of_u, u) + np.vdot(v, forces)))
        value += over.sum(self.at_points(problem.state, u, v) + self.owed.bound * problem.slip_bound(self.x))
        if loading.tension is not None:
            own = reduction.with_own(np.zeros((0, 3)), loading.tension * reduction.loose)
            value += over.sum(float(np.vdot(own, self.v[len(u) :])))
        return value

    @property
    def displacement(self) -> FloatArray:
        """Of the answer, metres, shape (k, 3); in large motions that of the last linear problem."""
        answer = self.answer
        return answer.elasticity.reduction.displacement(self.u) + answer.loading.prescribed

    def at_points(self, state: ContactState, u: FloatArray, v: FloatArray) -> FloatArray:
        """The terms of contact points, but those of their bounds, shape (m,), at displacements u and multipliers v (k,
        3), in a state near to that of the answer; collective."""
        before, surface = self.answer.surface, state.surface
        x, closed, owed = self.x.reshape(-1, 3).copy(), state.relative_displacement(u), self.owed.b.reshape(-1, 3)
        closed[:, 0] -= surface.gap
        other = np.abs(surface.frames - before.frames).max(axis=(1, 2), initial=0.0) > _TURNED
        turn = least_rotations(before.frames[:, 0], surface.frames[:, 0])
        there = surface.force_components(np.einsum("kij,kj->ki", turn, before.vectors(x)))
        here = before.components(np.einsum("kji,kj->ki", turn, surface.displacements(closed)))
        x[other], closed[other] = there[other], here[other]
        terms: FloatArray = np.einsum("ki,ki->k", owed, closed) - np.einsum("ki,ki->k", x, surface.rows(v))
        return terms

    def along_places(self) -> FloatArray:
        """As of `Gradient.places`."""
        refuse_moving(self.answer)
        answer, x_n = self.answer, self.x[0::3]
        body, surface, loading, law = answer.elasticity, answer.surface, answer.loading, answer.law
        constraints = body.constraints
        if constraints.ties or constraints.sprung or body.slice is not None:
            raise ValueError("derivatives along places are not known with ties, rigid faces, bolts, links and slices")
        u, v = self.displacement, body.reduction.displacement(self.v)
        per_area = self.owed.bound * (answer.slip_bound(self.x) - law.slope(x_n) * x_n) / surface.area

        def terms(state: ContactState) -> FloatArray:
            return self.at_points(state, u, v) + per_area * state.surface.area  # bounds are of stresses

        force = contact_along_places(answer, terms)
        for one, part in zip(body.members, loading.parts or [loading], strict=True):
            force[one.nodes] += one.body.force_along_places(part, u[one.nodes], v[one.nodes])
        return force


_TURNED: Final = 0.1
"""Change of the unit vectors of a frame from which on it is another one: tangents along what holds a node may flip."""


def refuse_moving(problem: DiscreteProblem, large: bool = False) -> None:
    """ValueError for a problem of which gradients are not known, or not in `large` motions; the same on every rank."""
    refuse(problem)
    if problem.body.heat is not None:
        raise ValueError("gradients are not known with heat")
    if problem.body.undeformed is not None and not large:
        raise ValueError("gradients along changes of a problem and along places are known of small strains alone")
    if problem.state.loaded:
        raise ValueError("gradients are known with foundations whose motion is given, not of those under load")


def gradient(
    problem: DiscreteProblem,
    x: FloatArray,
    u: FloatArray,
    of_force: FloatArray | None,
    of_u: FloatArray | None,
    later: Gradient | None = None,
) -> Gradient:
    """Of a function J of an answer, by the adjoint equations: one linear system of contact and displacements, however
    many inputs there are (`AnswerDerivatives.gradient`); collective.

    Args:
        problem: The problem,
        x: with the contact forces of its answer, newtons, shape (3 m,),
        u: and the displacement, metres, shape (k, 3).
        of_force: dJ/dx, per newton, shape (3 m,),
        of_u: and dJ/du, per metre, shape (k, 3); None is 0.
        later: That of the load step after, by whose `before` J owes to this u as well.

    Raises:
        ValueError: With foundations under load, with heat, or in a load step where friction depends
            on the slip rate; where J depends on friction that supports leave undetermined.
    """
    refuse_moving(problem, large=True)
    of_u = np.zeros_like(u) if of_u is None else of_u
    if later is not None:
        if later.before is None or later.before.shape != u.shape:
            raise ValueError("later must be the gradient of the load step after, and is that of another problem")
        of_u = of_u + later.before
    of_x = np.zeros_like(x) if of_force is None else of_force
    if later is not None and later.loose is not None:
        raise ValueError("points are on the border of two states in the load step after: J has no one gradient before")
    large = problem.body.undeformed is not None
    problem = problem.with_factors(x)
    moving = _Moving(problem, x, u) if large else None
    at = at_answer(problem.friction_problem, problem.linear.formed_A, 1.0 / problem.linear.node_stiffness, x)
    result = _gradient(problem, at, x, u, of_x, of_u, True, moving)
    warn_of_several(result.condition, problem.comm)
    return replace(result, loose=_gradient(problem, at, x, u, of_x, of_u, False, moving)) if result.border else result


class _Moving:
    """The geometric terms at an answer of large motions, for their transpose."""

    def __init__(self, problem: DiscreteProblem, x: FloatArray, u: FloatArray):
        terms, still = GeometricTerms(problem, x, u, near=True), np.zeros_like(u)
        self.turning = TurningTerms(problem.elasticity, terms.following)
        alpha = np.zeros(0 if problem.rigid is None else problem.rigid.count)
        self.by_u = TransposedTerms(problem, x, lambda way: terms.along(Way(way, alpha)))
        self.by_before: TransposedTerms | None = None
        if problem.before is not None and Reductions(problem.comm).any(bool(np.any(problem.before.displacement))):
            self.by_before = TransposedTerms(problem, x, lambda way: terms.along(Way(still, alpha, before=way)))


class _Owed(NamedTuple):
    """What J owes to loads, by the equations without free motions and with them, to the equations of contact, and to
    prescribed displacements, with what supports bear of it; and the number of points on a border."""

    response: FloatArray
    load: FloatArray
    contact: Change
    prescribed: FloatArray
    reaction: FloatArray
    border: int


def _with_terms(
    solved: Callable[[FloatArray], _Owed], of_u: FloatArray, of_x: FloatArray, moving: _Moving, over: Reductions
) -> _Owed:
    """With the transposed geometric terms, by the fixed-point iteration of `sensitivity`; collective."""
    point, mixing, left = np.zeros_like(of_u), Anderson(MOST, over), np.inf
    for _ in range(MOST):
        adjoint = solved(of_u + point)
        change = moving.by_u.owed(adjoint.load, adjoint.prescribed, adjoint.contact, of_x) - point
        change += moving.turning.owed(adjoint.load)
        size = over.norm(of_u + point + change)
        left = over.norm(change) / size if size > 0.0 else 0.0
        if left <= _SETTLED:
            break
        point = mixing.next(point.ravel(), change.ravel(), 1.0).reshape(point.shape)
    if left > NEARLY:
        raise ValueError(
            f"the geometric terms of gradients do not settle, by a part of {left:.0e}: the answer is nearly one of "
            "several, or was found with too large a tolerance"
        )
    return adjoint


_SETTLED: Final = 1e-9
"""Change of what J owes to the displacement over itself at which geometric terms are found."""


def _gradient(
    problem: DiscreteProblem,
    derivatives: AnswerDerivatives,
    x: FloatArray,
    u: FloatArray,
    of_x: FloatArray,
    of_u: FloatArray,
    firm: bool,
    moving: _Moving | None,
) -> Gradient:
    """With points on a border closed, sticking where they may (`firm`), or open, and slipping; collective."""
    surface, still = problem.surface, unloaded(problem.loading)
    body, before = problem.elasticity, problem.before
    undetermined: FloatArray = np.zeros((len(surface.nodes), 2))
    if surface.slip_prescribed:
        undetermined = directions_on_supports(row_products(surface.free_B, surface.points)[:, 1:, 1:])

    def solved(of_u: FloatArray) -> _Owed:
        rigid = with_loading(problem, replace(still, load=of_u)).state.rigid
        of_alpha = np.zeros(0) if rigid is None else rigid.e
        owed, border = derivatives.gradient(of_x, body.reduction.along(of_u).ravel(), of_alpha, undetermined, firm)
        assert owed.f is not None
        whole, v = of_u + surface.at_nodes(owed.b), body.reduction.displacement(owed.f.reshape(-1, 3))
        reaction = whole - body.internal_force(v) + body.spring_force(v)
        prescribed = body.held.held_part(body.reduction.transferred(reaction)[: len(u)])
        return _Owed(v, problem.moved(v, owed.e), owed, prescribed, reaction, border)

    adjoint = solved(of_u) if moving is None else _with_terms(solved, of_u, of_x, moving, Reductions(problem.comm))
    v, owed, start = adjoint.load, adjoint.contact, None
    motions, bolts = owed_to_motions(body.constraints, adjoint.reaction, v)
    of_law = np.where(problem.law.below_limit(x[0::3]), owed.bound, 0.0)
    if moving is not None:
        before_terms = moving.by_before
        if before_terms is not None and before is not None:
            start = before_terms.owed(v, adjoint.prescribed, owed, of_x)
            start += owed_before(body.constraints, problem.time, before.time, adjoint.reaction)
    elif before is not None:  # slip counts from there, and supports that have begun and locked bolts move on from there
        start = body.after_transposed(problem.time, before.time, adjoint.reaction)
        start -= surface.at_nodes(owed.b.reshape(-1, 3) * [0.0, 1.0, 1.0])
    return Gradient(
        friction=of_law * np.maximum(x[0::3], 0.0),
        cohesion=of_law * surface.area,
        bound=owed.bound,
        gap=-owed.b[0::3],
        load=v,
        prescribed=adjoint.prescribed,
        temperature=_along_temperatures(problem, u, v),
        young={
            member.name: -member.body.work_in_cells(
                u[member.nodes], v[member.nodes], None if part.temperature is None else part.temperature.change
            )
            for member, part in zip(body.members, problem.loading.parts or [problem.loading], strict=True)
            if isinstance(member.body, Elasticity | HyperelasticBody)
        },
        pretension=bolts,
        motions=motions,
        border=adjoint.border,
        loose=None,
        before=start,
        lagrangian=Lagrangian(
            problem,
            x,
            body.reduction.reduced(u - problem.loading.prescribed),
            of_u,
            body.reduction.reduced(v),
            owed,
        ),
        condition=derivatives.condition,
    )


def _along_temperatures(problem: DiscreteProblem, u: FloatArray, v: FloatArray) -> FloatArray | None:
    """What J owes to the change of temperature of every node, from what it owes to forces v (k, 3); collective."""
    body, loading, work = problem.elasticity, problem.loading, np.zeros(len(u))
    if loading.temperature is None:
        return None
    for member, part in zip(body.members, loading.parts or [loading], strict=True):
        if part.temperature is not None and isinstance(member.body, Elasticity | HyperelasticBody):
            of, along = u[member.nodes], v[member.nodes]
            work[member.nodes] = member.body.thermal_work(of, along, part.temperature.change)
    return work
