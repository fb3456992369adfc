"""The evidence of a problem, gathered from its input: faces, foundations, motions, coefficients.

The solver's contact surface and slip origin are not used: nodes come from the facets of the contact faces, normals and
gaps from the foundations at their current place, and slip is measured from the displacement after the step before.  So
a node missing in the surface, a foundation that was not moved or a wrong slip origin is detected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray, IntArray
from ..fem.contact import (
    ContactPoints,
    at_nodes_of,
    contact_matrix,
    contact_points,
    faces_away,
    free_lengths,
    joined_points,
    rows_of,
    without_noise,
)
from ..fem.geometry import HELD_BELOW, RigidMotion, inverse_frames, on_all_ranks
from ..linalg.reductions import Reductions, concatenated
from ..solvers.laws import FrictionLaw
from ..solvers.rigid_motions import NO_MOTION
from .certificate import Evidence
from .certificate_scales import at_all_points
from .contact_body import ContactBody
from .foundation_load import LoadedFoundation
from .held_nodes import FoundationFace, OtherNodes
from .linear_problem import ContactState
from .nodal_answer import relative_displacement
from .pair_checks import PairFindings, pair_actions
from .state import State


def gather_evidence(
    body: ContactBody,
    state: ContactState,
    x: FloatArray,
    u: FloatArray,
    compliance: FloatArray,
    before: State | None,
    alpha: FloatArray = NO_MOTION,
    by_lines: bool = True,
) -> Evidence:
    """The evidence for an answer; collective.

    Args:
        body: The body with its contact faces.
        state: The time, the loads, and the contact points to which the forces belong.
        x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2) of its surface.
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        compliance: Diagonal of A (m, 3) at the surface's points, of both tangents the mean, metres per newton.
        before: End of the load step before; None if slip is measured from the state's `slip_origin`.
        alpha: Amounts of free motions, shape (q,), of which those of foundations under load count, by default 0.
        by_lines: Whether gaps and displacements of pairs are found anew by lines from face to face, and gaps of nodes
            that are no contact points.
    """
    elasticity, surface = state.elasticity, state.surface

    def given() -> list[RigidMotion]:
        return [contact.rigid_motion(state.time, f"contact face {contact.face!r}") for contact in body.contacts]

    motions = body.foundation_loads.posed(on_all_ranks(given, "", body.comm), state.poses)
    then = motions if before is None else body.foundation_motions(before.time, before.poses)
    rates, faces = state.slip_rate if before is None else before.slip_rate[body.places(surface)], []
    for number, moved in enumerate(zip(motions, then, strict=True)):
        slip_rate, here = np.zeros(len(u)), surface.part == number
        slip_rate[surface.nodes[here]] = rates[here]
        faces.append(_face(body, number, state.time, *moved, slip_rate, by_lines))
    points = joined_points([face[0] for face in faces])
    frames, gap, carried = (np.concatenate([face[k] for face in faces]) for k in (1, 2, 4))
    law = FrictionLaw.joined([face[3] for face in faces])
    B, nodes = body.kept_matrix.of(points, frames), points.nodes
    parts = np.repeat(np.arange(len(faces)), [len(face[0].nodes) for face in faces])
    judged = surface.places_among(nodes, parts)  # the solver's contact points among those of the evidence
    known = judged >= 0

    def taken(vectors: FloatArray, axes: FloatArray) -> FloatArray:
        """Space vectors at the solver's contact points as components at those of the evidence; 0 elsewhere."""
        there = np.zeros((len(nodes), 3))
        np.add.at(there, judged[known], vectors[known])
        return np.einsum("kij,kj->ki", axes, there)

    x = x.reshape(-1, 3)
    force = taken(surface.vectors(x), inverse_frames(frames))
    on_body = -at_nodes_of(B, force)
    stray = surface.vectors(x)[~known]  # a force where none is possible counts as tensile
    np.subtract.at(on_body, surface.nodes[~known], stray)
    stray_rows = np.any(stray != 0.0, axis=1)
    stray = stray[stray_rows]
    none = np.zeros(len(stray))
    if before is None:
        origin = taken(surface.displacements(state.slip_origin), frames)
    else:
        origin = rows_of(B, before.displacement) + np.einsum("kij,kj->ki", frames, carried)
    rows, places = rows_of(B, u), points.average(elasticity.x)
    closed = relative_displacement(rows, origin)
    loaded = list(zip(state.loaded, state.of_foundations(alpha), strict=True))
    for one, amounts in loaded:
        moved = (parts == one.number)[:, None] * one.displacement(amounts, places)
        closed -= np.einsum("kij,kj->ki", frames, moved)
    bound = law.radius(force[:, 0])
    internal, spring = elasticity.internal_force(u), elasticity.spring_force(u)
    load = state.loading.load
    linked = elasticity.constraints.link_force(u)  # between bodies, as forces of ties
    spring, on_body = spring - linked, on_body + linked
    on_body += elasticity.constraints.forces(internal - load - spring - on_body, state.time)
    component = elasticity.component
    there = np.zeros((len(nodes), 3))  # at points that are none of the solver's
    there[judged[known]] = compliance[known]
    there = np.concatenate([there, compliance[~known][stray_rows]])
    own = at_all_points(there, compliance, Reductions(body.comm))
    strays = surface.nodes[~known][stray_rows]
    others = [one for *_, one in faces if one is not None]
    beside = [number for number, (*_, one) in enumerate(faces) if one is not None]
    held_part = [np.full(len(one.nodes), number) for number, one in zip(beside, others, strict=True)]
    left = [one.remaining(u) for one in others]
    for one, amounts in loaded:
        for k, other in enumerate(others):
            if beside[k] == one.number:
                left[k] += np.einsum("qi,qi->q", other.n, one.displacement(amounts, other.x[other.nodes]))
    return Evidence(
        comm=body.comm,
        x=elasticity.x,
        displacement=u,
        internal=internal,
        load=load,
        spring=spring,
        ground=elasticity.ground,
        component=elasticity.component,
        held=elasticity.held,
        prescribed=state.loading.prescribed,
        on_body=on_body,
        force=np.concatenate([force, np.column_stack([-np.max(np.abs(stray), axis=1, initial=0.0), none, none])]),
        relative_displacement=np.concatenate([closed, np.zeros((len(stray), 3))]),
        gap=np.concatenate([gap, none]),
        bound=np.concatenate([bound, none]),
        rounding=body.stiffness.rounding_forces(elasticity, u),
        stiffness=body.stiffness.of_nodes(elasticity)[np.concatenate([nodes, strays])],
        compliance=own,
        blocked=elasticity.blocked_displacements(state.loading),
        averaged=not points.nodal,
        bodies=tuple(member.nodes for member in elasticity.members) if len(elasticity.members) > 1 else (),
        jump=elasticity.reduction.left_apart(u, state.loading.apart) if elasticity.constraints.ties else None,
        owner=np.concatenate([component[nodes], component[strays]]),
        place=np.concatenate([places, elasticity.x[strays]]),
        part=np.concatenate([parts, np.full(len(stray), -1)]),
        faces=tuple(contact.face for contact in body.contacts),
        opposite=tuple(_opposite(body, contact.against, component) for contact in body.contacts),
        actions=_actions(elasticity.x, points, frames, force, [len(face[0].nodes) for face in faces]),
        pairs=_findings(body, state.time, faces, rows, u) if by_lines else (),
        on_foundations=_on_foundations(state.loaded, parts, places, np.einsum("kij,ki->kj", frames, force)),
        held_gap=np.concatenate([none[:0], *left]),
        held_owner=component[np.concatenate([judged[:0], *(one.nodes for one in others)])],
        held_part=np.concatenate([parts[:0], *held_part]),
        layer=elasticity.slice,
    )


def _on_foundations(
    loaded: Sequence[LoadedFoundation], parts: IntArray, x: FloatArray, forces: FloatArray
) -> FloatArray:
    """`Evidence.on_foundations`, of forces (m, 3) on foundations at points x (m, 3) of these faces (m,)."""
    rows = []
    for one in loaded:
        own = np.where((parts == one.number)[:, None], forces, 0.0)
        size = np.sum(np.linalg.norm(own, axis=1))
        rows += [(np.sum(motion.at(x) * own), size, load) for motion, load in zip(one.motions, one.load, strict=True)]
    return np.reshape(rows, (-1, 3))


def _opposite(body: ContactBody, face: str | None, component: IntArray) -> tuple[int, ...]:
    """The components on the face opposite in a pair; none on a foundation; collective."""
    if face is None:
        return ()
    member, facets = body.elasticity.face(face, "contact")
    own = component[member.nodes][member.body.nodes_of(facets)]
    return tuple(np.unique(concatenated(body.comm, own)).tolist())


def _actions(
    x: FloatArray, points: ContactPoints, frames: FloatArray, force: FloatArray, counts: list[int]
) -> FloatArray | None:
    """`Evidence.actions` of all pairs, from forces (m, 3) along the frames of the contact points, of which each face
    has a count; None without pairs; collective."""
    opposite = points.opposite_average(x)
    if opposite is None:
        return None
    on_slave, on_both = contact_matrix(replace(points, opposite=None), frames), contact_matrix(points, frames)
    points_of, vectors = points.average(x), -np.einsum("kij,ki->kj", frames, force)
    if points.mirrored is not None:
        vectors -= np.einsum("kij,kj->ki", points.mirrored, vectors)
    part, actions = np.repeat(np.arange(len(counts)), counts), []
    comm = points.space.comm
    centre = comm.allreduce(x.sum(axis=0)) / comm.allreduce(len(x))
    paired = np.asarray(np.diff(points.opposite.indptr) > 0) if points.opposite is not None else part < 0
    for number in range(len(counts)):
        here = part == number
        if not comm.allreduce(bool(np.any(paired[here])), op=MPI.LOR):
            continue
        own = np.where(here[:, None], force, 0.0)
        slave = -at_nodes_of(on_slave, own)
        master = -at_nodes_of(on_both, own) - slave
        actions.append(pair_actions(x - centre, slave, master, points_of[here], opposite[here], vectors[here]))
    for matrix in (on_slave, on_both):
        matrix.destroy()
    return np.reshape(actions, (-1, 3, 7))


_Face = tuple[ContactPoints, FloatArray, FloatArray, FrictionLaw, FloatArray, OtherNodes | None]


def _findings(
    body: ContactBody, time: float, faces: Sequence[_Face], rows: FloatArray, u: FloatArray
) -> tuple[PairFindings, ...]:
    """What is off in the pairs among the faces, whose points have displacements `rows` (m, 3) along their frames by
    those of the nodes u (k, 3); collective."""
    findings, comm = [], body.comm
    ends = np.cumsum([0, *(len(face[0].nodes) for face in faces)])
    for number, (_, frames, gap, *_) in enumerate(faces):
        contact = body.contacts[number]
        if contact.against is None:
            continue
        known = body.judged_pair(number)
        place = known.pair.points.before_deformation(known.pair.x)
        given = contact.gap_factor(time, comm) * contact.gap_at(place, comm)
        own = rows[ends[number] : ends[number + 1]]
        far = gap - own[:, 0] > np.sqrt(known.pair.points.area)
        findings.append(known.findings(frames, gap - given, own, u, far))
    return tuple(findings)


def _face(
    body: ContactBody,
    number: int,
    time: float,
    motion: RigidMotion,
    then: RigidMotion,
    slip_rate: FloatArray,
    beside: bool,
) -> _Face:
    """The contact points of a face that face its foundation and are not prescribed along their normal: points, frames
    (m, 3, 3), gap, law of friction, and the foundation's displacement in this step (m, 3), metres, from its motion at
    the start; and the other nodes of the face if `beside` asks for them; collective."""
    contact, comm, foundation = body.contacts[number], body.comm, body.foundations[number]
    if foundation is None:
        return _pair(body, number, time, slip_rate, beside)
    face = FoundationFace(contact, foundation, body.elasticity, time, motion)
    member, elasticity = face.member, face.member.body
    points = contact_points(elasticity, face.facets)
    x, at = points.average(elasticity.x), points.nodes
    n = face.outward[at] if contact.normals == "body" else -face.slope(x)
    gaps, added, H = points.gap(face.gap), points.average(face.given), elasticity.held.projector_at(at)
    facing = ~(contact.facing & faces_away(face.slope(elasticity.x[at]), face.outward[at]))
    free = facing & (free_lengths(points.of(member, body.elasticity), n, body.elasticity) > HELD_BELOW)
    points, n, x, H = points.only(free), n[free], x[free], H[free]
    gaps = without_noise(gaps[free], x, elasticity) + added[free]
    law = contact.law(points.before_deformation(x), points.area, time, slip_rate[points.nodes], comm)
    frames = points.frames(contact.axes, n, H, x, contact.face)
    points = points.of(member, body.elasticity)
    others = face.beside(body.elasticity) if beside else None
    return points, frames, gaps, law, face.motion.since(then, x), others


def _pair(body: ContactBody, number: int, time: float, slip_rate: FloatArray, beside: bool) -> _Face:
    """As `_face`, of a pair of deformable faces: what moves there is in the displacement."""
    contact, comm, pair = body.contacts[number], body.comm, body.pair(number)
    place = pair.points.before_deformation(pair.x)
    gap = pair.gap + contact.gap_factor(time, comm) * contact.gap_at(place, comm)
    law = contact.law(place, pair.points.area, time, slip_rate[pair.points.nodes], comm)
    frames = pair.points.frames(contact.axes, pair.n, pair.held, pair.x, pair.face)
    others = body.held_in_pairs.at(number, time) if beside else None
    return pair.points, frames, gap, law, np.zeros_like(pair.x), others
