"""The contact surface: its nodes, their frames, gaps and areas, and the matrix B from displacements to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from ...nearest import tree_of
from ..bodies import Deformable, DisplacementSpace, at_nodes_of, rows_of, together
from ..geometry import (
    HELD_BELOW,
    FrictionAxes,
    Plane,
    Refused,
    RigidFoundation,
    first_place,
    held_length,
    inverse_frames,
    on_all_ranks,
)
from .contact_points import (
    ContactPoints,
    contact_matrix,
    contact_points,
    free_contact_matrix,
    free_lengths,
    joined_points,
    places_among,
)

Normals = Literal["foundation", "body"]
"""Source of the normals of the contact frames."""


_NEARLY_HELD: Final = 1e-2
"""Length of the free part of a normal below which a contact node would move a hundred times its gap to close it."""

_PERPENDICULAR: Final = 1e-6
"""Cosine of the angle between a face's normal and the foundation's below which they are perpendicular."""

_SAME: Final = 1e-9
"""One minus the cosine of normals, and difference of gaps over the largest coordinate, of the same foundation."""

_NO_GAP = 8.0 * float(np.finfo(float).eps)  # of gaps, over the largest coordinate

_RAY_ROUNDING: Final = 1e-16
"""Steps along a ray that are shorter than this part of the way have only rounding errors."""

_RAY_STEPS: Final = 20
"""Maximum Newton steps along a ray, far more than needed for a ray that meets the foundation."""


@dataclass(frozen=True, eq=False)
class ContactSurface:
    """Contact points of this rank (perhaps none), in the order of their rows in B.

    Displacement and slip at the contact points are B u, and the nodal forces of contact forces x are B^T x: only B
    defines the nodes from which the displacement of a contact point is interpolated.

    Attributes:
        faces: Names of the contact faces.
        part: Which of them a node is on, shape (m,); nodes are in the order of the faces.
        points: Which nodes they are averages of.
        x: Coordinates in metres, shape (m, 3): where a contact force acts.
        frames: Orthogonal rows n, t1, t2 of every point, shape (m, 3, 3), of length 1; t1 and t2 are shorter where
            friction is orthotropic (`FrictionAxes`).  n points into the foundation.
        gap: Distance to the foundation along n before deformation in metres, with the given gap, shape (m,).
        gap_field: The given gap, metres, without its amplitude, shape (m,).
        B: Rows n, t1, t2 of every contact point; columns the displacements.  Shape (3 m, n), distributed.
        free_B: B T, by the unknowns of K: without the parts of its rows along prescribed directions, and with what
            contact nodes follow in their place.  A = free_B K^-1 free_B^T.
        slip_prescribed: Whether the entries of free_B are others than those of B.
        foundations: The foundation of each face, to which gaps are measured; None against a deformable face.
        chord: How far gaps to a face opposite are from linear between a point and those beside it, metres: h^2/(8 R) on
            curved faces, of facets wholly before it, and of those in part; and by how much the face for which the
            facets opposite stand may be nearer; 0 against a foundation; shape (m, 3).
        remarks: What a user should know of it.
    """

    faces: tuple[str, ...]
    part: IntArray
    points: ContactPoints
    x: FloatArray
    frames: FloatArray
    gap: FloatArray
    gap_field: FloatArray
    B: PETSc.Mat
    free_B: PETSc.Mat
    slip_prescribed: bool
    foundations: tuple[RigidFoundation | None, ...]
    chord: FloatArray
    remarks: tuple[str, ...] = ()

    @property
    def nodes(self) -> Int32Array:
        """The nodes that represent the contact points in the files, numbers among this rank's nodes, shape (m,)."""
        return self.points.nodes

    @property
    def area(self) -> FloatArray:
        """Integral of the points' hat functions over the face in m^2, shape (m,)."""
        return self.points.area

    def places_among(self, nodes: npt.NDArray[np.integer[Any]], part: IntArray) -> IntArray:
        """`places_among` of its contact points among those of these nodes and contacts."""
        return places_among((self.nodes, self.part), (nodes, part))

    def components(self, vectors: FloatArray) -> FloatArray:
        """The rows of displacements (m, 3), space vectors at the contact points, as in B u: along n, t1, t2."""
        return np.einsum("kij,kj->ki", self.frames, vectors)

    def vectors(self, components: FloatArray) -> FloatArray:
        """Forces (m, 3) with these components along n, t1, t2 (m, 3), as space vectors, as in B^T x."""
        return np.einsum("kij,ki->kj", self.frames, components)

    def force_components(self, vectors: FloatArray) -> FloatArray:
        """The components along n, t1, t2 of forces, space vectors, both of shape (m, 3): what `vectors` takes."""
        return np.einsum("kij,kj->ki", inverse_frames(self.frames), vectors)

    def displacements(self, rows: FloatArray) -> FloatArray:
        """The space vectors of rows along n, t1, t2, as of B u, both of shape (m, 3): what `components` takes."""
        return np.einsum("kij,ki->kj", inverse_frames(self.frames), rows)

    def joined(self, body: Deformable) -> IntArray:
        """The component of every node, where those of faces that are against each other are one, shape (k,);
        collective."""
        links, (own, opposite) = [], (self.points.weights, self.points.opposite)
        for part, foundation in enumerate(self.foundations):
            if foundation is None and opposite is not None:
                here = self.part == part
                links.append(np.concatenate([own[here].indices, opposite[here].indices]).astype(np.int64))
        return together((), body.component, body.component_names, body.comm, links)[0]

    def rows(self, u: FloatArray) -> FloatArray:
        """B u: displacement of the contact points in n, t1, t2 (m, 3) from u (k, 3) of this rank's nodes, metres;
        collective."""
        return rows_of(self.B, u)

    def at_nodes(self, x: FloatArray) -> FloatArray:
        """B^T x: contact forces x (3 m,) in newtons at this rank's nodes, shape (k, 3); collective."""
        return at_nodes_of(self.B, x)

    @property
    def nodes_in_rows(self) -> IntArray:
        """Global numbers of the nodes in the rows of this rank, ascending: also of nodes that these follow, and of
        unknowns of their own, which come after all nodes."""
        matrices = [self.B, self.free_B] if self.slip_prescribed else [self.B]
        return np.unique(np.concatenate([matrix.getValuesCSR()[1] // 3 for matrix in matrices])).astype(np.int64)


def interpolated_forces(x: FloatArray, coarse: ContactSurface, fine: ContactSurface) -> FloatArray:
    """Forces in newtons (3 m',) at the nodes of the fine surface, as an initial guess, from those (3 m,) on another
    mesh of the same face; collective.

    Tractions are averaged over the four nearest nodes, weighted by the inverse squares of their distances.
    """
    comm = fine.B.getComm().tompi4py()
    tractions = coarse.vectors(x.reshape(-1, 3)) / coarse.area[:, None]
    points, values = (np.concatenate(comm.allgather(part)) for part in (coarse.x, tractions))
    nearest = min(4, len(points))
    distance, near = (of.reshape(len(fine.x), nearest) for of in tree_of(points).query(fine.x, k=nearest))
    weight = 1.0 / np.maximum(distance, 1e-9 * np.max(distance, initial=1e-300)) ** 2
    weight /= weight.sum(axis=1)[:, None]
    averaged = np.einsum("ij,ijk->ik", weight, values[near])
    return (fine.force_components(averaged) * fine.area[:, None]).ravel()


def contact_surface(
    elasticity: Deformable,
    face: str,
    foundation: RigidFoundation | None = None,
    normals: Normals = "foundation",
    axes: FrictionAxes | None = None,
    gap_field: Callable[[FloatArray], FloatArray] | None = None,
    gap_factor: float = 1.0,
    facing: bool = True,
) -> ContactSurface:
    """The contact nodes of a face against a rigid foundation, by default the plane of the face, which must then be
    plane.

    The condition at a node is linear, u_n <= gap.  With the foundation's normals, n = -grad phi at the node and gap =
    phi, the signed distance: exact to first order in u, and the condition itself for a plane.  With the body's, n is
    the mean normal of the facets around the node, weighted by its hat function, and gap is the distance along n to the
    foundation; if that ray misses it, to the tangent plane of the foundation's point nearest to the node.

    Nodes where the face is turned away from the foundation cannot touch it and are no contact points.  Nodes whose
    normal displacement is prescribed, by supports or by what they follow, are no contact nodes: their rows of B T are
    zero; vertices of 10-node tetrahedra only if the other nodes of their average are held as well.  A node whose
    displacement along a tangent is prescribed is one: its slip in that direction is known, and friction acts on the
    support that prescribes it.  So is a node that is held obliquely to its normal, as where a plane of symmetry ends on
    an inclined foundation: contact forces act on its free displacements, and on the support.

    Args:
        elasticity: The body with its clamps.
        normals: Source of the normals, before deformation.
        axes: Orthotropic friction, by which the tangents are rotated and scaled.
        gap_field: A gap in metres that is added to the distance, of nodes of this rank that were at x (k, 3) before
            deformation; collective.
        gap_factor: Its amplitude.
        facing: Whether nodes that face away from the foundation are no contact points; else all are.

    Raises:
        ValueError: On every rank, if the face is unknown, curved without a foundation given, turned away from a
            foundation inside which it is, or wholly, or has no free node.
    """
    comm, (member, facets) = elasticity.comm, elasticity.face(face, "contact")
    body = member.body  # until the end, nodes are those of this body
    points = contact_points(body, facets)
    area, outward = body.positive_weights(facets)
    if comm.allreduce(len(points.nodes)) == 0:
        raise ValueError(f"contact: face {face!r} has no facets")
    on_face = body.nodes_of(facets)
    place = body.x[on_face]
    foundation = foundation or own_plane(elasticity, face)

    if normals not in ("foundation", "body"):
        raise ValueError(f'contact: normals must be "foundation" or "body", but is {normals!r}')
    what = f"contact face {face!r}"
    _refuse(area[on_face] <= 0.0, place, f"{what} has a node without area", comm)
    inwards = _evaluate(foundation.normal, place, 3, comm, face)
    away, gap = np.zeros(len(body.x), dtype=bool), np.zeros(len(body.x))
    away[on_face] = facing & faces_away(inwards, outward[on_face])
    gap[on_face] = _evaluate(foundation.signed_distance, place, 1, comm, face)
    facing = comm.allreduce(int(np.sum(~away[points.nodes])))
    inside = away[on_face] & ((gap[on_face] <= 0.0) | (facing == 0))
    reverse = "reverse the normal, or leave such facets out"
    _refuse(inside, place, f"{what} is turned away from the foundation: {reverse}", comm)
    x = points.average(body.x)
    if normals == "foundation":
        n = -_evaluate(foundation.normal, x, 3, comm, face)
    else:
        mean = outward[on_face] / np.linalg.norm(outward[on_face], axis=1)[:, None]
        way = partial(distance_along, mean, place, gap[on_face], foundation)
        gap[on_face] = on_all_ranks(way, f"{what}: foundation", comm)
        n = outward[points.nodes] / np.linalg.norm(outward[points.nodes], axis=1)[:, None]
    distance = points.gap(gap)

    H, along = body.held.projector_at(points.nodes), held_length(n, points.held(body.held))
    turned = away[points.nodes]
    free = free_lengths(points.of(member, elasticity), n, elasticity) > HELD_BELOW
    keep: BoolArray = free & ~turned
    free_length = np.sqrt(np.maximum(1.0 - along**2, 0.0))
    nearly = "is held at less than 0.6 degrees to the foundation's normal: hold it along the normal, or not"
    _refuse(keep & (free_length < _NEARLY_HELD), x, f"{what} {nearly}", comm)
    if comm.allreduce(int(keep.sum())) == 0:
        raise FullyHeld(f"{what} is fully clamped: none of its nodes can move against the foundation")

    points, x, n, H = points.only(keep), x[keep], n[keep], H[keep]
    distance = without_noise(distance[keep], x, body)
    given = np.zeros(len(body.x))
    if gap_field is not None:
        given[on_face] = gap_field(body.reference[on_face])
    field = points.average(given)
    gaps = without_rounding(distance + gap_factor * field, body.x, comm)
    frames = points.frames(axes, n, H, x, face)
    part = np.zeros(len(x), dtype=np.int64)
    points = points.of(member, elasticity)
    matrices = matrices_of(elasticity, points, frames)
    left_out = comm.allreduce(int(turned.sum()))
    remark = f"{what}: {left_out} of its nodes face away from the foundation and are no contact points"
    remarks = (remark,) if left_out else ()
    return ContactSurface(
        (face,), part, points, x, frames, gaps, field, *matrices, (foundation,), np.zeros((len(x), 3)), remarks
    )


def faces_away(slope: FloatArray, outward: FloatArray) -> BoolArray:
    """Where a face cannot touch its foundation, since its normals (k, 3), of any length, are along the gradients of the
    signed distance (k, 3) or perpendicular to them, shape (k,)."""
    along = np.einsum("ki,ki->k", slope, outward)
    return along >= -_PERPENDICULAR * np.linalg.norm(outward, axis=1)


def without_rounding(gap: FloatArray, x: FloatArray, comm: MPI.Comm) -> FloatArray:
    """Gaps with 0 in place of what may be rounding errors of the coordinates x, (k, 3); collective.

    A body on which nothing acts would otherwise have contact forces that are rounding errors, and these never converge.
    """
    size = float(comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=MPI.MAX))
    return np.where(np.abs(gap) > _NO_GAP * size, gap, 0.0)


NOISE: Final = 1e-8
"""Rounding errors of the coordinates in a file, over the extent of a face: gaps and chords below it are none."""


def without_noise(gap: FloatArray, x: FloatArray, body: DisplacementSpace) -> FloatArray:
    """The distances (m,) of all contact points x (m, 3) of a face from its foundation; 0 if they are rounding errors of
    coordinates, as of planes that touch in a file of ten digits: all are below `NOISE`, on both sides of 0; collective.

    At a deformed place, where an iteration makes them as small, they stay.
    """
    own = np.column_stack([x, gap])
    ends = np.array([own.min(axis=0, initial=np.inf), -own.max(axis=0, initial=-np.inf)])
    still = body.x is body.reference or np.array_equal(body.x, body.reference)
    every = body.comm.allgather((ends, still))
    low, below = np.min([of for of, _ in every], axis=0)
    noisy = low[3] < 0.0 > below[3] and -min(low[3], below[3]) <= NOISE * float(np.max(-below[:3] - low[:3]))
    return np.zeros_like(gap) if noisy and all(one for _, one in every) else gap


def matrices_of(elasticity: Deformable, points: ContactPoints, frames: FloatArray) -> tuple[PETSc.Mat, PETSc.Mat, bool]:
    B = contact_matrix(points, frames)
    return B, *free_contact_matrix(B, points, elasticity)


def with_unknowns(elasticity: Deformable, surface: ContactSurface) -> ContactSurface:
    """A surface with other own unknowns of ties prescribed than before; collective."""
    free_B, slip_prescribed = free_contact_matrix(surface.B, surface.points, elasticity)
    return replace(surface, free_B=free_B, slip_prescribed=slip_prescribed)


def joined(elasticity: Deformable, surfaces: Sequence[ContactSurface]) -> ContactSurface:
    """Several contact faces as one surface: a node on several of them has a contact point in each; ValueError on every
    rank if two foundations are the same plane there, whose forces would be one; collective."""
    if len(surfaces) == 1:
        return surfaces[0]
    points = joined_points([surface.points for surface in surfaces])
    x = np.concatenate([surface.x for surface in surfaces])
    faces = tuple(face for surface in surfaces for face in surface.faces)
    _refuse_twice(elasticity, surfaces)
    frames = np.concatenate([surface.frames for surface in surfaces])
    return ContactSurface(
        faces,
        np.repeat(np.arange(len(surfaces)), [len(surface.nodes) for surface in surfaces]),
        points,
        x,
        frames,
        np.concatenate([surface.gap for surface in surfaces]),
        np.concatenate([surface.gap_field for surface in surfaces]),
        *matrices_of(elasticity, points, frames),
        tuple(foundation for surface in surfaces for foundation in surface.foundations),
        np.concatenate([surface.chord for surface in surfaces]),
        tuple(text for surface in surfaces for text in surface.remarks),
    )


def _refuse_twice(elasticity: Deformable, surfaces: Sequence[ContactSurface]) -> None:
    """Refuse nodes that touch the same plane twice before deformation; collective."""
    comm, rigid = elasticity.comm, [surface for surface in surfaces if surface.foundations[0] is not None]
    if not comm.allreduce(np.array_equal(elasticity.x, elasticity.reference), op=MPI.LAND):
        return
    near = _SAME * float(np.max(np.abs(elasticity.x), initial=0.0))
    for number, one in enumerate(rigid):
        for other in rigid[:number]:
            place, same = one.places_among(other.nodes, other.part), np.zeros(len(one.nodes), dtype=bool)
            (here,), there = np.nonzero(place >= 0), place[place >= 0]
            along = np.einsum("ki,ki->k", one.frames[here, 0], other.frames[there, 0])
            same[here] = (along > 1.0 - _SAME) & (np.abs(one.gap[here] - other.gap[there]) <= near)
            both = f"contact faces {', '.join(map(repr, (*other.faces, *one.faces)))}: a node touches the same plane"
            _refuse(same, one.x, f"{both} on both; end one face before the other", comm)


def _evaluate(
    function: Callable[[FloatArray], FloatArray], x: FloatArray, width: int, comm: MPI.Comm, face: str
) -> FloatArray:
    """Values of a foundation at the points x (k, 3): shape (k,), or (k, 3) for width 3; ValueError on every rank."""

    def evaluate() -> FloatArray:
        values: FloatArray = np.asarray(function(x)) if len(x) else np.empty((0, width)[: 2 if width > 1 else 1])
        if not np.all(np.isfinite(values)):
            raise ValueError("the signed distance or its gradient is not finite at a node")
        return values

    return on_all_ranks(evaluate, f"contact face {face!r}: foundation", comm)


def distance_along(n: FloatArray, x: FloatArray, distance: FloatArray, foundation: RigidFoundation) -> FloatArray:
    """Distance in metres from x along n to the foundation (k,); Newton's method along each ray.

    If a ray misses it, the distance to the tangent plane of the foundation's point nearest to x.
    """
    tangent: FloatArray = distance / -np.einsum("ki,ki->k", n, foundation.normal(x)) if len(x) else distance
    way, missed = tangent.copy(), np.zeros(len(x), dtype=bool)
    size = np.abs(tangent)
    for _ in range(_RAY_STEPS if len(x) else 0):
        point = x + way[:, None] * n
        slope = -np.einsum("ki,ki->k", n, foundation.normal(point))
        missed |= slope <= 0.1
        step = np.where(missed, 0.0, foundation.signed_distance(point) / np.where(missed, 1.0, slope))
        way += step
        missed |= np.abs(way) > 10.0 * size
        if not np.any(np.abs(step) > _RAY_ROUNDING * np.abs(way)):  # at once on a plane
            break
    left = np.abs(foundation.signed_distance(x + way[:, None] * n)) if len(x) else way
    return np.where(missed | (left > 1e-8 * size + 1e-300), tangent, way)


class FullyHeld(Refused):
    """No node of a contact face can move against its foundation."""


def own_plane(elasticity: Deformable, face: str) -> Plane:
    """The plane of a face, with its normal into the body; ValueError on every rank if it is none; collective."""
    member, facets = elasticity.face(face, "contact")
    nodes, (area, outward) = member.body.nodes_of(facets), member.body.positive_weights(facets)
    if elasticity.comm.allreduce(len(nodes)) == 0:
        raise ValueError(f"contact: face {face!r} has no facets")
    return plane_of_face(face, member.body.x[nodes], area[nodes], outward[nodes], elasticity.comm)


def plane_of_face(face: str, x: FloatArray, area: FloatArray, outward: FloatArray, comm: MPI.Comm) -> Plane:
    total = comm.allreduce(float(area.sum()))
    point = comm.allreduce(area @ x) / total
    normal = comm.allreduce(outward.sum(axis=0)) / total
    if not np.linalg.norm(normal) > 1.0 - 1e-8:
        raise ValueError(f"contact face {face!r} is not plane: give its foundation (contact.foundation)")
    normal[np.abs(normal) < 1e-12] = 0.0
    return Plane(tuple(point), tuple(-normal))


def _refuse(where: BoolArray, x: FloatArray, fault: str, comm: MPI.Comm) -> None:
    """ValueError on every rank, with the first such node x (k, 3), if a condition (k,) holds at one of any rank."""

    def check() -> None:
        if np.any(where):
            raise ValueError(f"{fault} (first seen at x = {first_place(x, where)})")

    on_all_ranks(check, "", comm)
