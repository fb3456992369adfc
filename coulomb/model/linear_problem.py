"""A contact problem at one time, and what follows from its K: f, K^-1, A and b, thrown away with it."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem.bodies import (
    Deformable,
    Elasticity,
    FreeMotions,
    HyperelasticBody,
    Loading,
    NonlinearBody,
    displacements_of,
)
from ..fem.contact import ContactSurface, rows_of
from ..fem.geometry import RigidMotion, Spin
from ..linalg.compliance import EXPLICIT_UP_TO, BodyCompliance, DirectSolver, StiffnessSolver
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged
from ..solvers.friction_problem import FrictionProblem
from ..solvers.laws import FrictionLaw
from ..solvers.rigid_motions import NO_MOTION, RigidMotions
from .certificate_scales import lengths, rounding_of_gaps
from .conditioning import explained
from .contact_stiffness import FixedStiffness
from .foundation_load import LoadedFoundation, with_foundations
from .heat import Heat
from .nodal_answer import Accumulated, relative_displacement
from .provenance import timed

BALANCED: Final = 1e-13
"""Resultant force and moment of the residual, and 1e-2 of its norm, relative to the forces on the body."""

_ACCURACY: Final = 1e-6
"""Least relative residual of a correction: few more digits are left to gain by each."""

_BEYOND: Final = 0.1
"""Part of BALANCED at which a correction aims: its residual is not distributed like the one before."""

_MOST: Final = 4
"""Maximum number of corrections."""


def iteratively_refined(
    elasticity: Deformable, solver: StiffnessSolver, loading: Loading, on_body: FloatArray, u: FloatArray
) -> FloatArray:
    """The displacement u (k, 3) in metres by iterative refinement (Wilkinson 1963), until loads, springs, reactions and
    the contact forces `on_body` (k, 3) balance; collective.

    A solve with K leaves a residual relative to its right-hand side, which may be far larger than the forces on the
    body (K times a prescribed displacement that carries it along), or enough to move a body on soft springs.  So the
    residual is assembled anew from u and solved for again.  The springs at the anchors of free motions (`FreeMotions`)
    are among the forces in balance; at a solution they are zero.
    """
    over, x = Reductions(elasticity.comm), elasticity.x
    ends = over.ends(x)
    half = np.full(len(x), 0.5 * np.linalg.norm(ends[1] - ends[0]))
    rigid = elasticity.reduction.reduced(displacements_of(x - ends.mean(axis=0), half))

    def left_over(u: FloatArray) -> tuple[FloatArray, float]:
        """The residual at this rank's nodes, and its size relative to the forces on the body."""
        spring, anchored = (
            elasticity.spring_force(u),
            elasticity.anchoring * elasticity.reduction.reduced(u, loading.apart),
        )
        forces = loading.load + spring + on_body - elasticity.internal_force(u)
        residual = elasticity.reduction.along(forces, loading.tension) - anchored
        reaction = elasticity.held.held_part(elasticity.reduction.transferred(forces))
        outer = (loading.load, spring - anchored[: len(u)], on_body, reaction)
        sums = over.total(np.einsum("kcj,kc->j", rigid, residual))
        scale = np.max([over.sum(lengths(part)) for part in outer])
        length = np.max([over.norm(part) for part in outer])
        return residual, float(
            np.max([np.max(np.abs(sums)) / (scale or 1.0), 1e-2 * over.norm(residual) / (length or 1.0)])
        )

    with np.errstate(all="ignore"):  # an answer that overflows fails its certificate
        residual, size = left_over(u)
        for _ in range(_MOST):
            if not BALANCED < size < math.inf:
                break
            accuracy = min(max(_BEYOND * BALANCED / size, _ACCURACY), _BEYOND)
            change, ended = _solved(elasticity, solver, residual, accuracy)
            changed = u + elasticity.reduction.displacement(change)
            after, smaller = left_over(changed)
            if not smaller < size:
                break
            u, residual, size, before = changed, after, smaller, size
            if ended or size > 0.5 * before:  # rounding
                break
    return u


def _solved(
    elasticity: Deformable, solver: StiffnessSolver, residual: FloatArray, accuracy: float
) -> tuple[FloatArray, bool]:
    """K^-1 of a residual (k, 3) to a relative accuracy; and whether the solve ended before."""
    rhs, change = elasticity.reduced.vector(), elasticity.reduced.vector()
    rhs.array[:] = residual.ravel()
    size = float(rhs.norm()) or 1.0  # scaled: solves start from combinations of earlier solutions of like size
    rhs.scale(1.0 / size)
    ended = False
    try:
        solver.solve(rhs, change, accuracy)
    except CGNotConverged:  # what was reached may still be better than before
        ended = True
    values: FloatArray = size * change.array_r.reshape(-1, 3)
    rhs.destroy()
    change.destroy()
    return values, ended


_BEFORE_REFINEMENT: Final = 1e-8
"""Residual of a solve with K that is refined: products by K have rounding errors of 1e-11 of the resultant forces."""


_OF_DIFFERENCES: Final = 2.0**-48
"""Difference, relative to what it is the difference of, that is a rounding error: slip of displacements, and the
resultant of loads of the sum of their magnitudes."""


_UNMOVED: Final = 1e-10
"""Motion of a contact point, in a free motion of a metre, that is a rounding error."""


@dataclass(frozen=True, eq=False)
class ContactState:
    """A contact problem at one time; this rank's m contact points.

    Attributes:
        elasticity: The body with the coefficients of its stiffness at this time.
        loading: Loads and prescribed displacements.
        foundation_motions: Of the foundations of the faces.
        spins: Axis and angular velocity of the foundations of the faces; None where there is no rotation.
        surface: Contact points with their frames, gaps and B, for the foundations at this time.
        law: Of friction at the contact points.
        slip_rate: Slip rate in the load step before, metres per second, shape (m,); 0 without one.
        slip_origin: Displacement of the contact points from which slip is measured, along n, t1, t2, metres, shape (m,
            3): 0 at first, in a later load step that after the step before, moved with the foundation.
        accumulated: Slip, friction work and largest pressure of the load steps before.
        force_before: Contact forces on the body after the load step before, space vectors in newtons, shape (m, 3).
        heat: The temperature by which the bodies are strained, and its heat flows; None in a problem without heat.
        loaded: The foundations under load.
    """

    elasticity: Deformable
    loading: Loading
    foundation_motions: tuple[RigidMotion, ...]
    spins: tuple[Spin | None, ...]
    surface: ContactSurface
    law: FrictionLaw
    slip_rate: FloatArray
    slip_origin: FloatArray
    accumulated: Accumulated
    force_before: FloatArray
    heat: Heat | None = None
    loaded: tuple[LoadedFoundation, ...] = ()

    @property
    def time(self) -> float:
        """The time of loads and foundations in seconds."""
        return self.loading.time

    def relative_displacement(self, u: FloatArray, alpha: FloatArray = NO_MOTION) -> FloatArray:
        """u_n, and slip along t1 and t2, of displacements u (k, 3), metres, shape (m, 3), less those of foundations
        under load in free motions of amounts alpha (q,); collective.

        Where supports prescribe slips, those of the size of rounding errors are exactly 0: friction would be along
        them.
        """
        rows = self.surface.rows(u)
        closed = relative_displacement(rows, self.slip_origin)
        for one, amounts in zip(self.loaded, self.of_foundations(alpha), strict=True):
            there = (self.surface.part == one.number)[:, None]
            closed -= self.surface.components(there * one.displacement(amounts, self.surface.x))
        if not self.surface.slip_prescribed:
            return closed
        size = np.abs(rows).max(axis=1, initial=0.0) + np.abs(self.slip_origin).max(axis=1, initial=0.0)
        closed[:, 1:][np.abs(closed[:, 1:]) <= _OF_DIFFERENCES * size[:, None]] = 0.0
        return closed

    @cached_property
    def free(self) -> FreeMotions:
        """The free motions of foundations under load and, after them, of the bodies: those of `rigid`."""
        return with_foundations(self.elasticity.free, self.loaded) if self.loaded else self.elasticity.free

    @property
    def poses(self) -> FloatArray | None:
        """Of the foundations under load, shape (faces, 6), 0 of others (`LoadedFoundation`); None without any."""
        if not self.loaded:
            return None
        poses = np.zeros((len(self.foundation_motions), 6))
        for one in self.loaded:
            poses[one.number] = one.pose
        return poses

    def poses_after(self, alpha: FloatArray) -> FloatArray | None:
        """The `poses` after free motions of amounts alpha (q,)."""
        poses = self.poses
        for one, amounts in zip(self.loaded, self.of_foundations(alpha), strict=True):
            assert poses is not None
            poses[one.number] = one.moved(amounts)
        return poses

    def of_foundations(self, alpha: FloatArray) -> list[FloatArray]:
        """The amounts among alpha (q,), or 0 if it is empty, of the motions of each foundation under load."""
        counts = [len(one.motions) for one in self.loaded]
        if not counts:
            return []
        return np.split((alpha if len(alpha) else np.zeros(sum(counts)))[: sum(counts)], np.cumsum(counts)[:-1])

    @cached_property
    def rigid(self) -> RigidMotions | None:
        """The motions that contact alone prevents, with the loads along them; None if supports prevent all; collective.

        A resultant below its own rounding is 0, as of the thermal forces of a body that expands freely, and so is the
        motion of contact points on the side of a bolt's section that supports hold.
        """
        elasticity, loading = self.elasticity, self.loading
        if not len(self.free):
            return None
        R = elasticity.free_unknowns
        load = elasticity.reduction.along(loading.load, loading.tension)
        each = [load, *(elasticity.reduction.along(one.forces) for one in elasticity.loads_in(loading))]
        sums = [np.einsum("kcq,kc->q", R, load), np.einsum("kcq,kc->q", np.abs(R), np.sum(np.abs(each), axis=0))]
        e, size = elasticity.comm.allreduce(np.array(sums))
        e = np.where(np.abs(e) <= _OF_DIFFERENCES * size, 0.0, e)
        e = np.concatenate([*(one.load for one in self.loaded), e])
        return RigidMotions(self.motions_at_contact(R), e, tuple(map(str, self.free.motions)))

    def motions_at_contact(self, R: FloatArray) -> FloatArray:
        """G: the motion of every contact point in the motions of foundations under load and, after them, of the bodies,
        of unknowns R (k + p, 3, q), metres, a row each, shape (f + q, 3 m); collective."""
        surface = self.surface
        moved = [(one.number, motion) for one in self.loaded for motion in one.motions]
        away = [-surface.components((surface.part == part)[:, None] * motion.at(surface.x)) for part, motion in moved]
        rows = [rows_of(surface.free_B, R[:, :, number]) for number in range(R.shape[2])]
        G = np.reshape([*away, *rows], (len(moved) + len(rows), -1))
        return np.where(np.abs(G) <= _UNMOVED, 0.0, G)


class LinearProblem:
    """The contact problem of a body in a state, by one K and one method for K^-1; each of f, A, b and the displacement
    without contact is computed when it is first needed.

    Args:
        stiffness: K^-1 and A of the body.
        state: Loads, frames, gaps, law of friction, slip origin.
        seconds: Wall time of each phase, to which more is added.
    """

    def __init__(self, stiffness: FixedStiffness, state: ContactState, seconds: dict[str, float]):
        self.stiffness, self.state, self._seconds = stiffness, state, seconds
        self.elasticity, self.loading, self.surface = state.elasticity, state.loading, state.surface

    @property
    def methods(self) -> dict[str, Any]:
        """By what K^-1 and A are computed, as in summary.json, and why not by what was chosen first."""
        why = self.stiffness.method.why
        names = {"stiffness": self.stiffness.solver.name, "compliance": self.A.name}
        return {**names, **({"changed": why} if why else {}), "ranks": self.elasticity.comm.size}

    @cached_property
    def f(self) -> PETSc.Vec:
        """Load in newtons, with the prescribed displacements included; must not be modified."""
        return self.elasticity.f(self.loading)

    @cached_property
    def A(self) -> BodyCompliance:
        """Compliance B K^-1 B^T of the contact points, metres per newton."""
        return self.stiffness.compliance(self.surface, self._seconds)

    @cached_property
    def b(self) -> FloatArray:
        """B K^-1 f - c in metres, this rank's part, shape (3 m,): penetration of the free body, and its slip.

        c is the gap along n, and along t1 and t2 the displacement from which slip counts.  A penetration that is a
        rounding error is 0: a body that just touches has no forces, else they would be rounding errors.
        """
        free, gap = self.state.relative_displacement(self.free_displacement), self.surface.gap
        component, over = self.elasticity.component[self.surface.nodes], Reductions(self.elasticity.comm)
        size = np.zeros(int(over.max(self.elasticity.component.astype(np.float64))) + 1)
        np.maximum.at(size, component, np.abs(self.surface.x).max(axis=1, initial=0.0))
        large = any(isinstance(member.body, NonlinearBody) for member in self.elasticity.members)
        error = rounding_of_gaps(gap, free[:, 0], over.largest(size)[component], large)
        free[:, 0] -= gap
        free[:, 0][np.abs(free[:, 0]) <= error] = 0.0
        return free.ravel()

    @cached_property
    def friction_problem(self) -> FrictionProblem:
        """A, b and the law, without the body."""
        nodes = self.surface.nodes
        body, group = self.elasticity.component[nodes], self.surface.joined(self.elasticity)[nodes]
        return FrictionProblem(
            self.A, self.b, self.state.law, rigid=self.state.rigid, elastic=True, body=body, group=group
        )

    @cached_property
    def formed_A(self) -> BodyCompliance:
        """A that can be formed, if K has factors and contact points are few enough: on soft springs little else
        preconditions; collective."""
        method, points = self.stiffness.method, self.elasticity.comm.allreduce(len(self.surface.nodes))
        if method.explicit or method.linear_solver is not DirectSolver or 3 * points > EXPLICIT_UP_TO:
            return self.A
        return self.stiffness.with_formed.compliance(self.surface, self._seconds)

    @cached_property
    def node_stiffness(self) -> FloatArray:
        """Mean of the diagonal of K at the node of every contact point, newtons per metre, shape (m,)."""
        diagonal = self.elasticity.reduced.diagonal[: 3 * len(self.elasticity.x)]
        return diagonal.reshape(-1, 3).mean(axis=1)[self.surface.nodes]

    @cached_property
    def compliances(self) -> FloatArray:
        """diag(A) of every contact point, of both tangents the mean, metres per newton, shape (m, 3)."""
        return self.friction_problem.scales.compliance

    def known_relative_displacement(self, x: FloatArray, alpha: FloatArray) -> FloatArray | None:
        """`ContactState.relative_displacement` under forces x (3 m,) in newtons, moved by alpha, if it takes no solve
        with K; None otherwise, and where slips are prescribed; collective."""
        if self.surface.slip_prescribed:
            return None
        product = self.A.known_product(x)
        if product is None:
            return None
        closed = self.b - product
        if self.state.rigid is not None and len(alpha):
            closed += self.state.rigid.displacement(alpha)
        closed = closed.reshape(-1, 3)
        closed[:, 0] += self.surface.gap
        return closed

    def displacement(self, x: FloatArray) -> FloatArray:
        """K^-1 (f - B^T x) in metres, before free motions, this rank's nodes, shape (k, 3); x in newtons, shape (3 m,);
        collective."""
        free_u = self.elasticity.reduction.reduced(self.free_displacement, self.loading.apart)
        u = self.elasticity.reduction.displacement(self.A.displacement(x, self.f, free_u.ravel()).reshape(-1, 3))
        u = u + self.loading.prescribed  # exactly, which a solver holds to its tolerance only
        free = self.A.matrix_free
        if free is not None and free.found:
            return u
        on_body = -self.surface.at_nodes(x)
        return iteratively_refined(self.elasticity, self.stiffness.solver, self.loading, on_body, u)

    def prepare_products(self) -> None:
        """Let the products by A to come be as accurate as the displacement under load and contact forces is, also where
        soft springs alone hold the body; collective."""
        self.A.under_load(self.f, self.elasticity.reduction.reduced(self.free_displacement, self.loading.apart).ravel())

    @cached_property
    def free_displacement(self) -> FloatArray:
        """K^-1 f in metres, this rank's nodes, shape (k, 3): the displacement without contact.

        A body that its supports carry along moves by exactly that, and not to the accuracy of a solve: where it comes
        to touch another, what it lacks or has too much would be its contact forces.
        """
        solver, carried, loading, f = self.stiffness.solver, self._carried, self.loading, self.f
        if carried is not None:
            body = self.elasticity
            left = loading.prescribed - body.held.held_part(carried)
            left[np.any(carried != 0.0, axis=1)] = 0.0
            load = loading.load + body.spring_force(carried)
            nonlinear = (member.body for member in body.members if isinstance(member.body, NonlinearBody))
            if body.added_springs is not None or any(one.resists_translation for one in nonlinear):
                load = load - body.internal_force(carried)
            loading = replace(loading, load=load, prescribed=left)
            f = body.f(loading)

        def solved() -> FloatArray:
            u = self.elasticity.reduced.vector()
            with (
                suppress(CGNotConverged),
                explained(self.elasticity),
            ):  # with products by A its errors cancel (`under_load`)
                solver.solve(f, u, _BEFORE_REFINEMENT if solver.tolerance > 0.0 else 0.0)
            values: FloatArray = self.elasticity.reduction.displacement(u.array.reshape(-1, 3)) + loading.prescribed
            u.destroy()
            if solver.tolerance > 0.0:  # errors of a factorised K cancel with those of A, from the same factors
                values = iteratively_refined(self.elasticity, solver, loading, np.zeros_like(values), values)
            return values

        with timed(self._seconds, "displacement"):
            u = self.stiffness.responses.response(f.array_r, loading.prescribed, solved)
        if carried is not None:
            f.destroy()
            u = u + carried
            u += self.elasticity.held.held_part(self.loading.prescribed - u)
        return u

    @cached_property
    def _carried(self) -> FloatArray | None:
        """The translation of each body whose prescribed displacements are those of one, metres, shape (k, 3); 0 of the
        others, None if there is none; collective."""
        body, given = self.elasticity, self.loading.prescribed
        if body.constraints.ties or not all(
            isinstance(member.body, Elasticity | HyperelasticBody) for member in body.members
        ):
            return None
        held, over = body.held, Reductions(body.comm)
        if not over.any(bool(np.any(given))):
            return None
        count = int(over.max(body.component.astype(np.float64))) + 1
        of, H, way = body.component[held.nodes], np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(H, of, held.projector)
        inverse = np.linalg.pinv(over.total(H), hermitian=True)
        size, off = np.zeros((2, count))
        left: FloatArray = given[held.nodes]
        np.maximum.at(size, of, np.abs(left).max(axis=1, initial=0.0))
        for _ in range(2):  # the second takes away the rounding errors of the sums of the first
            sums = np.zeros((count, 3))
            np.add.at(sums, of, left)
            way += np.einsum("cij,cj->ci", inverse, over.total(sums))
            left = given[held.nodes] - np.einsum("kij,kj->ki", held.projector, way[of])
        np.maximum.at(off, of, np.abs(left).max(axis=1, initial=0.0))
        largest = over.largest(size)
        way[over.largest(off) > _OF_DIFFERENCES * largest] = 0.0
        way[np.abs(way) <= _OF_DIFFERENCES * largest[:, None]] = 0.0
        return way[body.component] if np.any(way) else None
