"""Iterates of a load step of large motions: each with its linear contact problem and what judges it there, and contact
forces from one to the next."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..fem.bodies import (
    AddedSprings,
    Deformable,
    End,
    JoinedBodies,
    Member,
    NonlinearBody,
    nonlinear,
    rigid_modes,
    turn_of,
)
from ..fem.contact import ContactSurface, FaceMotion, foot_points, springs_at
from ..fem.geometry import RigidFoundation, Turn, moved, spin
from ..linalg.factors import NotPositiveDefinite
from ..linalg.reductions import Reductions
from ..solvers.friction_problem import FrictionProblem
from ..solvers.rigid_motions import NO_MOTION
from .certificate import Evidence
from .certificate_scales import rounding_of_gaps
from .contact_faces import StatePoints
from .discrete_problem import DiscreteProblem
from .problem_evidence import gather_evidence
from .stability import Stability, stability, without_stiffness
from .state import State

_OPPOSITE: Final = 1e-6
"""One more than the cosine of the angle of two normals, at least: forces are not carried between opposite ones."""


@dataclass(frozen=True, eq=False)
class CarriedForces:
    """Contact forces, space vectors in newtons, and the normals of their places, at this rank's points of states,
    shapes (m, 3); 0 at points without."""

    vectors: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, x: FloatArray, surface: ContactSurface, points: StatePoints) -> CarriedForces:
        """Of forces x (3 m,) at the contact points of a surface."""
        (vectors, normals), places = np.zeros((2, len(points.nodes), 3)), points.places(surface)
        vectors[places], normals[places] = surface.vectors(x.reshape(-1, 3)), surface.frames[:, 0]
        return cls(vectors, normals)

    def at(self, surface: ContactSurface, points: StatePoints) -> FloatArray:
        """Along the frames of a surface, turned as its normals have (parallel transport), shape (3 m,)."""
        places = points.places(surface)
        f, n, m = self.vectors[places], self.normals[places], surface.frames[:, 0]
        axis, cosine = np.cross(n, m), np.einsum("ki,ki->k", n, m)[:, None]
        along = np.einsum("ki,ki->k", axis, f)[:, None] / np.maximum(1.0 + cosine, _OPPOSITE)
        return surface.force_components(cosine * f + np.cross(axis, f) + along * axis).ravel()


_STIFFER: Final = 10.0
"""Stiffness of the springs of `supported` over the mean diagonal of K at their nodes."""

_TOUCHES: Final = 1e-10
"""Gap over the largest coordinate below which a node touches."""

_STICKS: Final = 1.0 - 1e-6
"""Friction over its bound below which a node sticks."""

_STILL: Final = 1e-9
"""Motion of an axis across itself, over its largest motion, up to which it is a rounding error."""

_DIFFERENCE: Final = 1e-4
"""Step of the differences of normals over the size of a face."""


class Linearised(DiscreteProblem):
    """The contact problem of changes du of a displacement u; judged by the scales of u + du.

    Attributes:
        iterate: Of an answer, the `Iterate` of its load step with the arguments of `elsewhere`.
    """

    iterate: Callable[[FloatArray, FloatArray | None, State, FloatArray | None], Iterate]

    def elsewhere(
        self, u: FloatArray, poses: FloatArray | None, before: State | None, motions: FloatArray | None = None
    ) -> DiscreteProblem:
        assert before is not None
        return self.iterate(u, poses, before, motions).problem

    def with_factors(self, x: FloatArray) -> DiscreteProblem:
        """With the tangent, or springs where contact presses (`Iterate.supported`), that is positive definite."""
        assert self.before is not None
        there = self.iterate(self._u, self.state.poses, self.before, None)
        given = there.problem.bent(x)
        there.pose(there.problem.turning(given, x))
        try:
            _ = there.problem.compliances
        except NotPositiveDefinite:
            there.pose(there.supported(given, x))
        there.problem.iterate = self.iterate
        return there.problem

    @property
    def _u(self) -> FloatArray:
        """The displacement from which it is linearised, metres, shape (k, 3)."""
        return np.concatenate([nonlinear(member.body).place.u for member in self.elasticity.members])

    @property
    def friction_problem(self) -> FrictionProblem:
        """Judged body by body: contact by contact by the evidence at the next iterate."""
        return replace(super().friction_problem, together=True)

    def evidence(
        self, x: FloatArray, u: FloatArray, before: State | None = None, alpha: FloatArray = NO_MOTION
    ) -> Evidence:
        """Without what the next iterate is asked: what pairs are by lines, and nodes that are no contact points."""
        return self._evidence(x, u, self.compliances, alpha, by_lines=False)

    @property
    def prescribed(self) -> FloatArray:
        return np.concatenate([nonlinear(member.body).place.prescribed for member in self.elasticity.members])

    def evidence_here(self, x: FloatArray, compliance: FloatArray, by_lines: bool = True) -> Evidence:
        """The evidence of the nonlinear problem for forces x (3 m,) at the displacement from which it is linearised;
        `compliance` is the diagonal of A there (m, 3), 0 where it is not known; `by_lines` as of `gather_evidence`;
        collective."""
        body = self.elasticity
        e = self._evidence(x, np.zeros_like(body.x), compliance, by_lines=by_lines)
        places = [(member.nodes, nonlinear(member.body).place) for member in body.members]
        load = np.concatenate([e.load[nodes] if place.load is None else place.load for nodes, place in places])
        pulled = sum((one.forces for one in body.constraints.spring_forces(self._u)), np.zeros_like(load))
        kept = e.internal - e.load + load + pulled
        in_forms = balanced_load(body, kept, Reductions(body.comm))
        spring = np.concatenate([in_forms[nodes] if place.spring is None else place.spring for nodes, place in places])
        return replace(e, internal=kept + spring, load=load, spring=spring + pulled)

    def geometric(self, x: FloatArray) -> FloatArray:
        """The change of normal forces x (3 m,) as normals turn on curved foundations, N/m, shape (m, 3, 3): -x_n times
        the second derivative of the signed distance, which is symmetric; that of friction, which is not, is left
        out."""
        surface, motions = self.surface, self.state.foundation_motions
        stiffness = np.zeros((len(surface.x), 3, 3))
        for part, (foundation, motion) in enumerate(zip(self.body.foundations, motions, strict=True)):
            here = (surface.part == part) & (x[0::3] > 0.0)
            if foundation is not None and np.any(here):
                bent = curvature(moved(foundation, motion), surface.x[here])
                stiffness[here] = -x[0::3][here, None, None] * bent
        return stiffness

    def turning(self, body: Deformable, x: FloatArray) -> Deformable:
        """The bodies with the stiffness `geometric` of forces x; collective."""
        stiffness = self.geometric(x)
        if Reductions(body.comm).all(not np.any(stiffness)):
            return body
        return body.on_springs(self.springs(stiffness, np.zeros_like(self.surface.x)))

    def bent(self, x: FloatArray) -> Deformable:
        """The bodies with the stiffness of rigid faces by the forces on them (`Constraints.bent`), of contact x (3 m,);
        collective."""
        body, loading = self.elasticity, self.loading
        if not isinstance(body, JoinedBodies):
            return body
        return body.bent(self.surface.at_nodes(x) - loading.load, loading.time)

    def springs(self, stiffness: FloatArray, forces: FloatArray, at_nodes: FloatArray | None = None) -> AddedSprings:
        """`springs_at` the contact points; collective."""
        none = np.zeros((len(self.elasticity.x), 3, 3))
        return springs_at(self.surface.points, stiffness, forces, none if at_nodes is None else at_nodes)

    def stability(self, x: FloatArray) -> Stability | None:
        """By the inertia of the tangent at this place; None if there are too many unknowns."""
        return stability(self.turning(self.bent(x), x), self.surface.free_B, x, self.law.frictional)

    def without_stiffness(self, x: FloatArray, R: FloatArray) -> FloatArray:
        stress = [nonlinear(member.body).strain_force(self._u[member.nodes]) for member in self.elasticity.members]
        return without_stiffness(self.turning(self.bent(x), x), R, np.concatenate(stress))

    def _evidence(
        self,
        x: FloatArray,
        du: FloatArray,
        compliance: FloatArray,
        alpha: FloatArray = NO_MOTION,
        by_lines: bool = True,
    ) -> Evidence:
        """With the residual F(u) + dF(u) du, and loads with the resultants of it (`balanced_load`); collective."""
        e = gather_evidence(self.body, self.state, x, du, compliance, None, alpha, by_lines)
        body = self.elasticity
        here, over = self._u, Reductions(self.comm)
        residual, way = e.internal - e.load, e.relative_displacement.copy()
        error = rounding_of_gaps(e.gap, way[:, 0], np.full(len(way), over.max(np.abs(body.x))), large=True)
        touching = (e.force[:, 0] == 0.0) & (np.abs(e.gap - way[:, 0]) <= error)
        way[touching, 0] = e.gap[touching]
        load, rigid = balanced_load(body, residual, over), rigid_part(body, here, over)
        extent = float(np.max(over.extent(body.x)))  # grad u is added to 1
        return replace(
            e,
            displacement=here + du - rigid,
            relative_displacement=way,
            internal=residual + load,
            load=load,
            prescribed=body.held.held_part(here - rigid) + e.prescribed,
            ground=None,
            rounding=self.body.stiffness.rounding_forces(body, np.maximum(np.abs(here + du), extent)),
        )


def curvature(foundation: RigidFoundation, x: FloatArray) -> FloatArray:
    """Second derivatives of the signed distance at points x (k, 3), 1/m, shape (k, 3, 3), by central differences."""
    h = _DIFFERENCE * float(np.max(np.ptp(x, axis=0), initial=0.0)) or _DIFFERENCE
    columns = [(foundation.normal(x + h * e) - foundation.normal(x - h * e)) / (2.0 * h) for e in np.eye(3)]
    bent: FloatArray = np.stack(columns, axis=2)
    return 0.5 * (bent + bent.transpose(0, 2, 1))


class Iterate:
    """A displacement in a load step, with the linear contact problem of the changes from there.

    Args:
        body: The bodies.
        pose: Poses the linear contact problem of bodies at their deformed place at a time.
        u: Displacement in metres, shape (k, 3).
        time: Of the end of the step.
        before: The state at the start of the step.
        points: The contact points of states.
        start: The faces at the start of the step; None where this is the start.
        previous: The displacement of the iterate from which a linear problem led here; None without one.
    """

    problem: Linearised

    def __init__(
        self,
        body: Deformable,
        pose: Callable[[Deformable, float], Linearised],
        u: FloatArray,
        time: float,
        before: State,
        points: StatePoints,
        start: FaceMotion | None,
        previous: FloatArray | None = None,
    ):
        self.u, self.time = u, time
        end = End(before.time, before.displacement, before.turns)
        self._before, self.body = before, linearised(body, u, time, end, previous)
        posed = pose(self.body, time)
        there, self.foundations = posed.state, posed.body.foundations
        places = points.places(there.surface)
        accumulated, force = before.accumulated.at(places), before.force_on_body[places]
        then = replace(there, slip_rate=before.slip_rate[places], accumulated=accumulated, force_before=force)
        if start is not None:
            given = posed.body.given_gap(there.surface, time)
            turns = [self._turn(face) for face in there.surface.faces]
            drawn = [np.zeros(3) if one.rotation is None else self._drawn(one.face) for one in posed.body.contacts]
            slip = start.slip(self.body, there.surface, given, there.foundation_motions, self.foundations, turns, drawn)
            each_of = zip(posed.body.contacts, there.foundation_motions, start.motions, strict=True)
            spins = (
                None if one.rotation is None else spin(now, at_start, time - before.time)
                for one, now, at_start in each_of
            )
            then = replace(then, slip_origin=-there.surface.components(slip), spins=tuple(spins))
        self.problem = posed.in_state(then, posed.body.seconds, before)
        self._posed, self._start = self.problem, start
        if start is not None and self._pairs_alone:
            self.problem.slid = self.slid

    def _turn(self, face: str) -> Turn | None:
        """The largest of `turns` of the body of a face in the step; collective."""
        of = turns(self.body, self.body.face(face, "contact")[0], self._before.time, self.time)
        return max(of, key=lambda turn: abs(turn.angle), default=None)

    def _drawn(self, face: str) -> FloatArray:
        """The translation in the step that supports and rigid faces prescribe for the body of a face, metres, shape
        (3,), nearest to that of their nodes; 0 along directions that are free, and of a body that they turn;
        collective."""
        if self._turn(face) is not None:
            return np.zeros(3)
        member, way = self.body.face(face, "contact")[0], self.u - self._before.displacement
        held = nonlinear(member.body).held
        along, ways = held.projector.sum(axis=0), held.held_part(way[member.nodes]).sum(axis=0)
        for motion in self.body.constraints.motions:
            if self.body.face(motion.given.face, "rigid face")[0] is member:
                given = motion.given.prescribed[:3]
                along, ways = along + len(motion.nodes) * np.diag(given), ways + given * way[motion.nodes].sum(axis=0)
        total = Reductions(self.body.comm).total(np.concatenate([along.ravel(), ways]))
        drawn: FloatArray = np.linalg.pinv(total[:9].reshape(3, 3), rcond=_STILL) @ total[9:]
        return drawn

    @property
    def _pairs_alone(self) -> bool:
        """Whether what the linear problem leaves out are faces that slide on each other alone."""
        constraints, pairs = self.body.constraints, self.problem.body.pairs
        turning = constraints.ties or constraints.motions or constraints.bolts
        bodies = [member.body for member in self.body.members]
        return (
            len(pairs) == len(self.problem.contacts)
            and not any(any(contact.closed) for contact in self.problem.contacts)
            and all(pair.near.slave.patch.curved is None for pair in pairs)
            and not turning
            and not any(nonlinear(body).follows or body.has_mean_dilatation or list(body.wrenches()) for body in bodies)
        )

    def slid(self, du: FloatArray) -> DiscreteProblem:
        """The problem with the pairs as they are after small displacements du (k, 3) in metres, and all else as it is
        here; collective."""
        problem, state, start = self._posed, self._posed.state, self._start
        assert start is not None
        surface = problem.body.slid(state, du)
        slip = start.between_faces(self.body.x + du, surface, self.foundations)
        law = state.law.at(np.maximum(surface.places_among(state.surface.nodes, state.surface.part), 0))
        there = replace(state, surface=surface, law=law, slip_origin=-surface.components(slip))
        return problem.in_state(there, None, self._before)

    def pose(self, body: Deformable) -> None:
        """The linear problem of these bodies, which are those before with another tangent and load; collective."""
        self.problem.body.replace(body)
        state = replace(self.problem.state, elasticity=body, loading=body.at(self.time))
        self.body, self.problem = body, self.problem.in_state(state, self.problem.seconds, self._before)

    def supported(self, body: Deformable, x: FloatArray, damping: float = 0.0) -> Deformable:
        """The bodies on springs at the contact points that press with forces x (3 m,), along normals, and along
        tangents where they stick, relaxed where the gap is closed and nothing has slipped; between bodies only if
        supports hold all of them.

        What contact holds may be unstable without it.  Where the contact conditions hold as equations springs change
        nothing, and with stiff ones K is positive definite if the body is stable on them (Finsler's lemma).

        Damping, over the mean diagonal of K at each node, resists every change of the displacement: where the body is
        unstable iterates go down in energy as a damped motion does (pseudo-time), and at an equilibrium nothing is left
        of it.
        """
        surface, state, problem = self.problem.surface, self.problem.state, self.problem
        diagonal, over = body.K.getDiagonal(), Reductions(body.comm)
        size = diagonal.array_r[: body.x.size].reshape(-1, 3).mean(axis=1)
        diagonal.destroy()
        x, held = x.reshape(-1, 3), len(body.free) == 0
        stiffened = np.array([foundation is not None or held for foundation in self.foundations])[surface.part]
        pressing = stiffened & (x[:, 0] > 0.0)
        if over.all(not np.any(pressing)):  # at the first touch: what touches
            pressing = stiffened & (np.abs(surface.gap) <= _TOUCHES * over.max(np.abs(body.x).ravel()))
        sticks = pressing & (np.linalg.norm(x[:, 1:], axis=1) < _STICKS * problem.slip_bound(x.ravel()))
        lengths = np.linalg.norm(surface.frames, axis=2)
        G = surface.frames / lengths[:, :, None]
        target = np.column_stack([surface.gap, state.slip_origin[:, 1:] / lengths[:, 1:]])
        stiff = _STIFFER * surface.points.diagonal(size)[:, None] * np.column_stack([pressing, sticks, sticks])
        stiffness = problem.geometric(x.ravel()) + np.einsum("kr,kri,krj->kij", stiff, G, G)
        forces, damped = np.einsum("kr,kri->ki", stiff * target, G), damping * size[:, None, None] * np.eye(3)
        springs = problem.springs(stiffness, forces, damped)
        return body.on_springs(replace(springs, along=stiff / lengths**2))

    def made_positive(self, body: Deformable, x: FloatArray) -> Deformable:
        """The bodies with the nearest tangent that is positive semidefinite in every cell."""
        return each(body, lambda one, nodes: one.made_positive())

    def start(self) -> FaceMotion:
        """The start of a load step from here; collective."""
        surface, motions = self.problem.state.surface, self.problem.state.foundation_motions
        return FaceMotion(
            *foot_points(self.body, surface.faces, motions, self.foundations), surface, motions, self.body.x
        )


def turns(bodies: Deformable, member: Member, start: float, time: float) -> list[Turn]:
    """Rotations of a body in a load step that supports and rigid faces prescribe, about axes that do not move across
    themselves meanwhile; collective."""
    of_body = nonlinear(member.body).turns_since(start, time)
    for motion in bodies.constraints.motions:
        given = motion.given.prescribed
        if np.all(given[3:]) and bodies.face(motion.given.face, "rigid face")[0] is member:
            before, after = (motion.values(at, bodies.comm) for at in (start, time))
            vector, ways = after[3:] - before[3:], np.vstack([after[:3] - before[:3], np.eye(3)[~given[:3]]])
            angle, largest = float(np.linalg.norm(vector)), np.max(np.abs([before[:3], after[:3]]))
            across = np.linalg.norm(np.cross(ways, vector), axis=1)
            if angle and np.all(across <= _STILL * angle * np.append(largest, np.ones(len(ways) - 1))):
                of_body.append(Turn(motion.point + before[:3], vector / angle, angle))
    return of_body


def balanced_load(body: Deformable, residual: FloatArray, over: Reductions) -> FloatArray:
    """Nodal forces with the resultants of the loads in a residual F(u; v), (k, 3), in newtons: internal forces have
    none in any motion of a component as a whole; collective."""
    load = np.zeros_like(residual)
    for here in components(body, over):
        modes = rigid_modes(body.x[here], body.comm).reshape(-1, 6)
        gram = over.total((modes.T @ modes).ravel()).reshape(6, 6)
        sums = over.total(modes.T @ residual[here].ravel())
        load[here] = -(modes @ np.linalg.solve(gram, sums)).reshape(-1, 3)
    return load


def rigid_part(body: Deformable, u: FloatArray, over: Reductions) -> FloatArray:
    """The displacement (k, 3) of the rigid motions, with finite rotations, that are nearest to a displacement u (k, 3)
    of bodies at their deformed place: without it the work of internal forces along a displacement does not depend on
    how far a body has turned; collective.

    The rotations are nearest to the turns of the cells, each about its own middle (Kabsch 1976).  By the places of all
    nodes, an arch that snaps through would have been turned over.
    """
    before, component = body.x - u, body.component
    parts = 1 + int(over.max(component.astype(np.float64)))
    products, rigid = np.zeros((parts, 3, 3)), np.zeros_like(u)
    for member in body.members:
        one, nodes = nonlinear(member.body), member.nodes
        owner = one.in_cells_of(np.repeat(component[nodes][:, None].astype(np.float64), 3, axis=1))[:, 0, 0]
        x, y = (of - of.mean(axis=1, keepdims=True) for of in map(one.in_cells_of, (before[nodes], body.x[nodes])))
        np.add.at(products, owner.astype(np.int64), np.einsum("cni,cnj->cij", x, y))
    turns = map(turn_of, over.total(products.ravel()).reshape(-1, 3, 3))
    for here, turn in zip(components(body, over), turns, strict=True):
        x, y = before[here], body.x[here]
        count, from_, to = over.totals(np.array(float(len(x))), x.sum(axis=0), y.sum(axis=0))
        rigid[here] = to / count + (x - from_ / count) @ turn.T - x
    return rigid


def components(body: Deformable, over: Reductions) -> Iterator[npt.NDArray[np.bool_]]:
    """The nodes of each component of the bodies, shapes (k,); collective."""
    component = body.component
    for number in range(1 + int(over.max(component.astype(np.float64)))):
        yield component == number


def linearised(
    body: Deformable, u: FloatArray, time: float, before: End | None = None, previous: FloatArray | None = None
) -> Deformable:
    """The bodies of small displacements from u (k, 3) at a time, in a load step after another's end, reached from a
    previous displacement; collective."""

    def at(one: NonlinearBody, nodes: slice) -> NonlinearBody:
        of_before = before and before.of(nodes)
        return one.linearised(u[nodes], time, of_before, None if previous is None else previous[nodes])

    return each(body.at_time(time), at, u, before)


def each(
    body: Deformable,
    change: Callable[[NonlinearBody, slice], NonlinearBody],
    u: FloatArray | None = None,
    before: End | None = None,
) -> Deformable:
    """The same bodies, each changed, and displaced by u (k, 3) if it is given (`JoinedBodies.of`); the change is given
    its nodes."""
    changed = [change(nonlinear(member.body), member.nodes) for member in body.members]
    return body.of(changed, u, before) if isinstance(body, JoinedBodies) else changed[0]
