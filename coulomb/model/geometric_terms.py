"""What forces, gaps and slip owe to the places of bodies and foundations, beyond the linear problem at an answer.

Where bodies move far, and where a foundation under load turns, the equations of contact change with the answer itself:
frames turn, areas and arms of forces change, and pressures follow their surface.  With J their derivative and P that of
the linear problem, whose factors are known, the derivative z of the answer along an input solves P z = r + (P - J) z
for what the input does, r.  J z is the central difference along z, one direction, of the equations themselves with the
states of the contact points left out, which are smooth; the sets of the answer are in P alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from ..solvers.rigid_motions import NO_MOTION
from .discrete_problem import DiscreteProblem
from .turning_terms import far_loads

_STEP: Final = 1e-6
"""Largest displacement of the differences over the size of the bodies: errors of order 1e-9, and of rounding 1e-10."""


_KINK: Final = 0.1
_NO_KINK: Final = 1e-12
"""By how much gaps before and after a change do not add up, over the change and the size of the bodies, from which on
there is a kink."""

_ALONG: Final = np.array([0.0, 1.0, 1.0])
"""Of the components along n, t1, t2 those along the surface."""


@dataclass(frozen=True, eq=False)
class Way:
    """A direction: derivatives of the displacement, shape (k, 3), of the amounts of free motions (q,), of displacement
    and poses (faces, 6) after the load step before, and of factors (faces,) of the motions of foundations."""

    u: FloatArray
    alpha: FloatArray
    before: FloatArray | None = None
    poses_before: FloatArray | None = None
    motions: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Terms:
    """(P - J) z, and what else changes with the places along a way; this rank's part.

    Attributes:
        load: Nodal forces, newtons, shape (k, 3).
        prescribed: Displacements that supports prescribe, metres, shape (k, 3),
        apart: and how far constraints prescribe nodes to be apart from what they follow, of the same shape.
        c: Gap, and the displacements from which slip counts, metres, shape (m, 3).
        bound: Bound of friction at the present normal forces, newtons, shape (m,).
        e: Loads along the free motions of foundations under load, newtons, shape (q,); 0 of others.
        vectors: Contact forces that turn with the normals, as space vectors, newtons, shape (m, 3),
        tangential: their friction,
        components: and along the frames, whose tangents may turn about the normals.
        slip: Likewise slip, space vectors, metres, shape (m, 3).
        turned: Minus the change of the forces of constraints on nodes that follow, beside that of the linear problem,
            newtons, shape (k, 3): their own unknowns move these along ways that turn.
        x: The places of contact points, metres, shape (m, 3).
        area: Areas of contact points, m^2, shape (m,).
    """

    load: FloatArray
    prescribed: FloatArray
    apart: FloatArray
    c: FloatArray
    bound: FloatArray
    e: FloatArray
    vectors: FloatArray
    tangential: FloatArray
    components: FloatArray
    slip: FloatArray
    turned: FloatArray
    x: FloatArray
    area: FloatArray

    def less(self, other: Terms, factor: float) -> Terms:
        """The difference from others times a factor, 0 where one of them is not known."""
        each = ((name, factor * (value - getattr(other, name))) for name, value in vars(self).items())
        return Terms(**{name: np.nan_to_num(value) for name, value in each})


class GeometricTerms:
    """Of an answer with contact forces x (3 m,) in newtons and displacement u (k, 3) in metres.

    Args:
        problem: The linear problem at the answer, whose derivative is P.
        near: Without those of constraints and of loads that turn with their face (`TurningTerms`).
        start: The same problem as it was posed, from which differences are taken forward: half of the work, with
            errors of the order of their step, and of pairs alone where nothing else is owed (`DiscreteProblem.slid`);
            None for central ones.

    Attributes:
        following: In large motions the forces of constraints on nodes that follow, newtons, shape (k, 3).
    """

    def __init__(
        self,
        problem: DiscreteProblem,
        x: FloatArray,
        u: FloatArray,
        near: bool = False,
        start: DiscreteProblem | None = None,
    ):
        self._problem, self._x, self._u = problem, x.reshape(-1, 3), u
        self._large, self._over = problem.body.undeformed is not None, Reductions(problem.comm)
        places, v = problem.elasticity.x, np.zeros_like(u) if self._large else u
        self._slip = problem.surface.displacements(problem.relative_displacement(v) * _ALONG)
        self._extent = max(self._over.max(axis) - self._over.min(axis) for axis in places.T)
        left = problem.surface.at_nodes(x) - problem.loading.load
        constraints = problem.elasticity.constraints
        turns = self._large and bool(constraints.ties)
        self.following = constraints.lacking(left, problem.time) if turns else np.zeros_like(u)
        self._turns, self._near = turns and not near, near
        self._slid = None if start is None else problem.slid
        self._posed, self._start = start, None if start is None else self._in(start)

    def along(self, way: Way) -> Terms:
        """Along a way, to which they are in proportion; collective."""
        problem, body = self._problem, self._problem.elasticity
        moved = [self.relative(way.alpha)]
        moved += [one for one in ((way.u, way.before) if self._large else ()) if one is not None]
        moved += [] if way.poses_before is None else [way.poses_before[:, :3], self._extent * way.poses_before[:, 3:]]
        if way.motions is not None:
            times = (problem.time,) if problem.before is None else (problem.time, problem.before.time)
            given = zip(way.motions, *(problem.body.foundation_motions(time) for time in times), strict=True)
            ways = ((part, one) for part, *each in given for one in each)
            moved += [part * np.append(one.translation, self._extent * one.angle) for part, one in ways]
        size = max(self._over.max(np.abs(one).ravel()) for one in moved)
        h = _STEP * self._extent / size if size > 0.0 else 1.0
        if self._start is None:
            change = self._at(h, way).less(self._at(-h, way), 0.5 / h)
        else:
            change = self._at(h, way).less(self._start, 1.0 / h)
        linear, closed, apart = -change.load, change.c - self.relative(way.alpha), change.apart
        if self._turns:
            linear = linear - body.reduction.on_followed(change.turned)
            apart = apart + body.reduction.left_apart(way.u)
        if self._large:
            closed = closed + problem.surface.rows(way.u)
        if self._slid is not None and self._posed is not None:
            if body is not self._posed.elasticity:  # with springs, or another tangent
                linear = linear + body.internal_force(way.u) - self._posed.elasticity.internal_force(way.u)
        elif self._large:
            linear = linear + body.internal_force(way.u) - body.spring_force(way.u)
            if self._near:
                linear += body.constraints.spring_force(way.u) - body.reduction.bent_force(way.u)
        return replace(change, load=linear, apart=apart, c=closed, e=-change.e)

    def between(self, more: DiscreteProblem, less: DiscreteProblem, h: float) -> Terms:
        """By how much they are larger in one of two problems of small strains than in the other, over h, at the forces
        and displacements of the answer, which is between; collective.

        Raises:
            ValueError: On every rank, if gaps have a kink.
        """
        ends, middle = [self._in(one) for one in (more, less)], self._in(self._problem).c
        found = ends[0].less(ends[1], 1.0 / h)
        bent, change = (self._over.max(np.abs(one).ravel()) for one in (ends[0].c + ends[1].c - 2.0 * middle, found.c))
        if bent > _KINK * h * change + _NO_KINK * self._extent:
            raise ValueError("gaps have a kink along the change of the problem: derivatives are one-sided")
        return replace(found, load=-found.load)

    def relative(self, alpha: FloatArray) -> FloatArray:
        """The displacement of foundations under load at their contact points, along n, t1, t2, metres, (m, 3)."""
        surface, state = self._problem.surface, self._problem.state
        way = np.zeros_like(surface.x)
        for one, amounts in zip(state.loaded, state.of_foundations(alpha), strict=True):
            way += (surface.part == one.number)[:, None] * one.displacement(amounts, surface.x)
        return surface.components(way)

    def _at(self, h: float, way: Way) -> Terms:
        """The equations, and what else is in `Terms`, at h times the way from the answer; collective."""
        problem, state = self._problem, self._problem.state
        if self._slid is not None:
            return self._in(self._slid(h * way.u))
        u = self._u + h * way.u if self._large else self._u
        before: Any = problem.before
        if before is not None and way.before is not None and self._large:
            before = replace(before, displacement=before.displacement + h * way.before)
        if before is not None and way.poses_before is not None:
            before = replace(before, poses=before.poses + h * way.poses_before)
        factors = None if way.motions is None else 1.0 + h * way.motions
        return self._in(problem.elsewhere(u, state.poses_after(h * way.alpha), before, factors))

    def _in(self, there: DiscreteProblem) -> Terms:
        """The same in a problem near to that of the answer; collective."""
        problem, v = self._problem, np.zeros_like(self._u) if self._large else self._u
        surface, count = there.surface, len(self._x)
        here = problem.surface.places_among(surface.nodes, surface.part)
        known, turn = here >= 0, np.zeros((count, 3, 3))
        turn[known] = least_rotations(problem.surface.frames[known, 0], surface.frames[here[known], 0])

        def carried(vectors: FloatArray) -> FloatArray:
            """Space vectors at the answer, which have turned with the normals."""
            return np.einsum("kij,kj->ki", turn, vectors)

        vectors = carried(problem.surface.vectors(self._x))
        on_points = np.zeros((len(surface.nodes), 3))
        on_points[here[known]] = vectors[known]
        x = surface.force_components(on_points)
        closed = there.relative_displacement(v, NO_MOTION)
        w = np.column_stack([surface.gap - closed[:, 0], -closed[:, 1:]])

        def of_points(values: FloatArray) -> FloatArray:
            """At the points of the answer; nan where one has become none."""
            of_all = np.full((count, *values.shape[1:]), np.nan)
            of_all[known] = values[here[known]]
            return of_all

        c = problem.surface.components(np.einsum("kji,kj->ki", turn, of_points(surface.displacements(w))))
        body, e = there.elasticity, np.zeros(0 if problem.rigid is None else problem.rigid.count)
        forces = surface.at_nodes(x.ravel()) - body.spring_force(v) - there.loading.load
        if not self._large:  # else v is 0
            forces += body.internal_force(v)
        apart, turned = np.zeros((2, *forces.shape))
        if self._near:
            forces += far_loads(body, body.x - body.reference)
        if self._turns:
            forces -= body.reduction.on_followed(self.following)
            along = body.reduction.moved_transposed(self.following)
            apart, turned = there.loading.apart + apart, problem.elasticity.reduction.amounts_transposed(along)
        first = 0
        for one in there.state.loaded:
            part = surface.part == one.number
            for motion, load in zip(one.motions, one.load, strict=True):
                e[first] = -self._over.sum(np.sum(motion.at(surface.x[part]) * on_points[part])) - load
                first += 1
        bound, area, places = (of_points(one) for one in (there.slip_bound(x.ravel()), surface.area, surface.x))
        friction, slip = (carried(one) for one in (problem.surface.vectors(self._x * _ALONG), self._slip))
        of_frames = vectors, friction, of_points(x), slip
        return Terms(forces, there.prescribed, apart, c, bound, e, *of_frames, turned, places, area)


def least_rotations(n: FloatArray, m: FloatArray) -> FloatArray:
    """The least rotations from unit vectors to others near to them, both of shape (k, 3), shape (k, 3, 3)."""
    n, m = (one / np.linalg.norm(one, axis=1)[:, None] for one in (n, m))
    axis, cosine = np.cross(n, m), np.einsum("ki,ki->k", n, m)
    cross = np.zeros((len(n), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, k, j], cross[:, j, k] = axis[:, i], -axis[:, i]
    outer = axis[:, :, None] * axis[:, None, :] / (1.0 + cosine)[:, None, None]
    return cosine[:, None, None] * np.eye(3) + cross + outer
