"""Pairs of faces: which is the slave, planes of symmetry, geometry before deformation."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, unit_vectors
from ...units import amount
from ..bodies import Deformable, DisplacementSpace, HeldDirections, NonlinearBody, SingleBody
from ..geometry import (
    HELD_BELOW,
    HELD_BEYOND,
    FrictionAxes,
    Refused,
    RigidFoundation,
    held_length,
    on_all_ranks,
)
from ..meshes import Exchange, boundary_facets, fetched, owner_of, starts_of
from .contact_points import ContactPoints, among_all, free_lengths
from .facet_patch import FacetPatch, facet_patch
from .mortar import LEAST_SHARE, MortarRows, mortar_rows
from .near_facets import NearFace, NearPair, near_pair, normals_at_nodes
from .passages import refuse_inside
from .surface import ContactSurface, matrices_of

_AS_NEAR: Final = 1e-9
"""Distances that differ by less than this part of the coordinates are the same."""

_SEAM: Final = 0.9, 0.1
"""Cosine of the normals of a node in two contacts, and part of its size by which its gaps differ, where they meet as at
a seam between two plates: two multipliers there, on a coarser master, leave forces undetermined."""


class Candidates(NamedTuple):
    """Contact points of a contact: nodes (m,), unit normals (m, 3), gaps and sizes, the roots of areas, metres (m,)."""

    nodes: npt.NDArray[np.integer[Any]]
    normals: FloatArray
    gap: FloatArray
    size: FloatArray


def nodes_at_seams(
    contacts: Mapping[int, Candidates], pairs: Collection[int], count: int, size: float
) -> dict[int, BoolArray]:
    """Which of `count` nodes every one of the `pairs` loses to another of the contacts, by their numbers: a node that
    touches several in the same direction, as at a seam, counts on a rigid foundation, else at the nearest master, of
    equally near ones (to a part of the largest coordinate, `size`) at that of the first pair; a node at an edge has a
    contact point in each."""
    lost = dict[int, BoolArray]()
    for number in pairs:
        own, gone = contacts[number], np.zeros(count, dtype=bool)
        for other, there in contacts.items():
            if other == number:
                continue
            _, one, two = np.intersect1d(own.nodes, there.nodes, return_indices=True)
            along = np.einsum("ki,ki->k", own.normals[one], there.normals[two])
            apart = np.abs(own.gap[one] - there.gap[two])
            seam = (along > _SEAM[0]) & (apart <= _SEAM[1] * own.size[one])
            nearer = np.abs(there.gap[two]) - np.abs(own.gap[one])
            near = (nearer < -_AS_NEAR * size) | ((nearer <= _AS_NEAR * size) & (other < number))
            gone[own.nodes[one[seam & (near | (other not in pairs))]]] = True
        lost[number] = gone
    return lost


_FINER: Final = 1.2
"""Ratio of the distances of nodes from which one face is finer than the other."""

_SOFTER: Final = 1.5
"""Ratio of stiffnesses from which one body is softer than the other."""

_STRAINS = np.zeros((5, 3, 3))
for _k in range(3):
    _STRAINS[_k, _k, _k - 1] = _STRAINS[_k, _k - 1, _k] = 1.0
_STRAINS[3:] = np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0])
"""Strains without change of volume."""


@dataclass(frozen=True)
class _Side:
    """A face, over all ranks: mean distance of its contact points if it were the slave, nodes or vertices of 10-node
    tetrahedra, in metres; and the share of its nodes whose displacement along the normal is prescribed."""

    spacing: float
    clamped: float


def slave_side(elasticity: Deformable, face: str, against: str) -> tuple[str, str, str]:
    """Slave and master of a pair of faces, and why; ValueError on every rank if a face is unknown; collective.

    The finer face is the slave, since its nodes are the contact points; of faces as fine that of the softer body.  A
    face that is mostly clamped has too few.
    """
    one, other = _side(elasticity, face), _side(elasticity, against)
    mostly = one.clamped > 0.5, other.clamped > 0.5
    if mostly[0] != mostly[1]:
        exchanged, why = mostly[0], "the other face is clamped"
    elif max(one.spacing, other.spacing) > _FINER * min(one.spacing, other.spacing):
        exchanged, why = other.spacing < one.spacing, "it has the finer mesh"
    else:
        stiffness = [_stiffness(elasticity, name) for name in (face, against)]
        softer = max(stiffness) > _SOFTER * min(stiffness)
        exchanged = softer and stiffness[1] < stiffness[0]
        why = "its body is softer" if softer else "it was named first"
    return (against, face, why) if exchanged else (face, against, why)


def clamped_nodes(body: SingleBody, facets: Int32Array) -> IntArray:
    """This rank's nodes on facets that are held along the normal, or have no area; collective."""
    nodes, outward = body.nodes_of(facets), body.positive_weights(facets)[1]
    held = held_length(unit_vectors(outward[nodes]), body.held.projector_at(nodes))
    return nodes[(held > HELD_BEYOND) | np.isin(nodes, body.without_area)].astype(np.int64)


def _side(elasticity: Deformable, face: str) -> _Side:
    member, facets = elasticity.face(face, "contact")
    body, nodes = member.body, member.body.nodes_of(facets)
    points = np.intersect1d(nodes, body.vertices.node).size if not body.positive else len(nodes)
    mine = [len(nodes), points, body.area_of(facets).sum(), len(clamped_nodes(body, facets))]
    count, number, area, clamped = elasticity.comm.allreduce(np.array(mine, dtype=np.float64))
    return _Side(float(np.sqrt(area / max(number, 1.0))), float(clamped / max(count, 1.0)))


def _stiffness(elasticity: Deformable, face: str) -> float:
    """Twice the shear modulus of a body at a face, in pascals, whatever its mesh, and also of the user's forms;
    collective.

    A uniform strain without change of volume, A, has the stress 2 mu A and the nodal forces 2 mu A n, n the integral of
    the outward normal against the hat functions.  Of anisotropic materials it is a mean over five strains.
    """
    member, facets = elasticity.face(face, "contact")
    body, nodes = member.body, member.body.nodes_of(facets)
    outward = body.normal_of(boundary_facets(body.domain))[nodes]
    work = np.zeros(2)
    for A in _STRAINS:
        forces, expected = body.internal_force(body.x @ A)[nodes], outward @ A
        work += np.vdot(forces, expected), np.vdot(expected, expected)
    done, of_unit = elasticity.comm.allreduce(work)
    return float(done / (of_unit or 1.0))


_OBLIQUE: Final = 0.5
"""Part of a unit normal along held directions beyond which the face does not meet a plane of symmetry."""

_BEYOND: Final = 1e-6
"""Part of the extent of the facets around a node that counts as beyond its plane."""

_HELD_OPPOSITE: Final = 0.1
"""Part of the weight of the opposite nodes that must be held: those of the master's edge have a half and more."""


def planes_of_symmetry(n: FloatArray, held: FloatArray, nodes: IntArray, patch: FacetPatch) -> FloatArray:
    """Projectors on the held directions across which a face ends, shape (m, 3, 3), 0 for other nodes; from unit normals
    n (m, 3), projectors on the held directions, numbers of nodes, and the facets around them."""
    across = np.linalg.norm(np.einsum("mij,mj->mi", held, n), axis=1)
    chosen = np.flatnonzero((np.einsum("mii->m", held) > 0.5) & (across < _OBLIQUE))
    planes = np.zeros_like(held)
    row = np.full(patch.size, -1)
    row[nodes[chosen]] = np.arange(len(chosen))
    facet, corner = np.nonzero(row[patch.nodes] >= 0)
    at = row[patch.nodes[facet, corner]]
    sizes, directions = np.linalg.eigh(held[chosen])
    offset = patch.x[facet] - patch.x[facet, corner][:, None]
    along = np.einsum("kwi,kia->kwa", offset, directions[at])
    lowest, highest, extent = np.zeros((len(chosen), 3)), np.zeros((len(chosen), 3)), np.zeros(len(chosen))
    np.minimum.at(lowest, at, along.min(axis=1))
    np.maximum.at(highest, at, along.max(axis=1))
    np.maximum.at(extent, at, np.abs(along).max(axis=(1, 2)))
    beyond = _BEYOND * extent[:, None]
    ends = np.any((sizes > 0.5) & ((lowest >= -beyond) | (highest <= beyond)), axis=1)
    planes[chosen[ends]] = held[chosen[ends]]
    return planes


def within(n: FloatArray, planes: FloatArray) -> FloatArray:
    """Unit normals n (m, 3) without their parts along the projectors (m, 3, 3)."""
    inside = n - np.einsum("mij,mj->mi", planes, n)
    length = np.linalg.norm(inside, axis=1)[:, None]
    return np.where(np.any(planes != 0.0, axis=(1, 2))[:, None], inside / length, n)


def smooth_normals(patch: FacetPatch, held: HeldDirections, starts: IntArray, comm: MPI.Comm) -> FloatArray:
    """`normals_at_nodes`, within the planes of symmetry on which the face ends, shape (f, n, 3); collective."""
    nodes, width = patch.nodes.ravel(), patch.kind.width
    n = normals_at_nodes(patch, starts, comm).reshape(-1, 3)
    to = Exchange(comm, owner_of(starts, nodes))
    around = replace(
        patch, nodes=to.send(np.repeat(patch.nodes, width, axis=0)), x=to.send(np.repeat(patch.x, width, axis=0))
    )
    node, which = np.unique(to.send(nodes), return_index=True)
    own = unit_vectors(to.send(n)[which])
    local = node - starts[comm.rank]
    planes = np.zeros((int(starts[comm.rank + 1] - starts[comm.rank]), 3, 3))
    planes[local] = planes_of_symmetry(own, held.projector_at(local), node, around)
    return within(n, fetched(comm, starts, nodes, planes)).reshape(-1, width, 3)


def mirrored(
    points: ContactPoints, planes: FloatArray, opposite: scipy.sparse.csr_matrix, elasticity: Deformable
) -> FloatArray | None:
    """The directions among the `planes_of_symmetry` (m, 3, 3) along which these nodes and those opposite never move, by
    averages (m, nodes) over the latter, as projectors of this shape; None if no rank has any; collective."""
    still = elasticity.still.projector_at(points.nodes)
    planes = np.where(np.any(planes, axis=(1, 2))[:, None, None], still, 0.0)
    every = elasticity.still.projector_at(np.arange(len(elasticity.x))).reshape(-1, 9)
    share = replace(points, weights=shares(opposite), nodal=False, opposite=None)
    both = held_on_both(planes, share.average(every).reshape(-1, 3, 3))
    return both if elasticity.comm.allreduce(bool(np.any(both)), op=MPI.LOR) else None


def shares(opposite: scipy.sparse.csr_matrix) -> scipy.sparse.csr_matrix:
    """Sizes of the weights of the master's nodes, every row with the sum 1."""
    size = abs(opposite)
    size.data /= np.repeat(np.maximum(np.asarray(size.sum(axis=1)).ravel(), 1e-300), np.diff(size.indptr))
    return size


def held_on_both(planes: FloatArray, there: FloatArray) -> FloatArray:
    """The directions among `planes` (m, 3, 3) that are held on the master, too, by the means of its projectors there
    (m, 3, 3) with `shares`, as projectors of this shape."""
    sizes, directions = np.linalg.eigh(planes @ there @ planes)
    return np.einsum("mia,ma,mja->mij", directions, (sizes > _HELD_OPPOSITE).astype(np.float64), directions)


_NO_GAP: Final = 1e-14
"""Gaps below this part of the coordinates are rounding errors."""


_ALONE: Final = 0.9
"""Weight of a node opposite from which on it is opposite alone: the facets of both faces have the same edges."""

_SEEN: Final = 1e-7
"""Penetrations before deformation below this part of the extent of the slave face are not worth a remark."""


@dataclass(frozen=True)
class Shape:
    """What the facets of a pair stand for, where gaps are measured: surfaces of slave and master; else, if `smooth`,
    first-order facets stand for the smooth surface with the mean normals at their corners; else for themselves; and the
    largest penetration that is found, metres."""

    smooth: bool = False
    slave: RigidFoundation | None = None
    master: RigidFoundation | None = None
    depth: float = np.inf


NO_SHAPE = Shape()
"""Facets stand for themselves."""


def curved_patch(
    space: DisplacementSpace,
    held: HeldDirections,
    facets: Int32Array,
    surface: RigidFoundation | None,
    smooth: bool,
    what: str,
) -> FacetPatch:
    """The facets of a face that this rank owns, with the surface for which they stand (`Shape`), its normals within
    planes of symmetry, which are `held`; ValueError on every rank, beginning with `what`, if nodes are off the surface;
    collective."""
    patch, comm = facet_patch(space, facets), space.comm
    if surface is not None:
        return on_all_ranks(lambda: patch.on_surface(surface), what, comm)
    if not smooth or patch.kind.degree == 2:
        return patch
    return patch.smoothed(smooth_normals(patch, held, starts_of(comm, space.numbering.local), comm))


@dataclass(frozen=True, eq=False)
class Pair:
    """Geometry of a pair of faces before deformation; this rank's m contact points, on the slave face.

    Attributes:
        points: Averages over the slave face, and over the master face opposite.
        x: Their coordinates in metres, shape (m, 3).
        n: Unit normals, from the slave body into the master body, shape (m, 3).
        gap: Distance along them before deformation in metres, adjusted, shape (m,).
        held: Projectors on the held directions of the slave nodes, shape (m, 3, 3).
        elsewhere: Nodes of the slave face that are contact points of another contact instead (`nodes_at_seams`).
        near: The facets of both faces that are before each other,
        left_out: and which slave nodes among them have no contact point.
        remarks: What a user should know of it.
    """

    face: str
    against: str
    points: ContactPoints
    x: FloatArray
    n: FloatArray
    gap: FloatArray
    held: FloatArray
    chord: FloatArray
    elsewhere: IntArray
    near: NearPair
    left_out: IntArray
    remarks: tuple[str, ...] = ()


class NothingOpposite(Refused):
    """Of two faces no part is opposite to the other before deformation; in large motions they may meet."""


def pair_of(
    elasticity: Deformable,
    face: str,
    against: str,
    adjust: tuple[float, float] = (0.0, 0.0),
    taken: BoolArray | None = None,
    shape: Shape = NO_SHAPE,
    still: BoolArray | None = None,
) -> Pair:
    """The geometry of a pair of a slave and a master face; collective.

    Nodes of the slave face whose displacement along the normal is prescribed, those that nothing opposes, those that
    are contact points of another contact instead (`taken`), and those that are on the master face as well, are no
    contact points; their parts of the face belong to the nodes beside them.  So are those that follow nodes whose
    displacement is prescribed, and are opposite to such nodes alone (`still`, found here), and those that a tie of
    both faces holds at present.  Gaps and penetrations up
    to `adjust` in metres, of each, are taken to be 0.

    Raises:
        ValueError: On every rank, if a face is unknown, its nodes are off the surface given for it, or in small motions
            no part of one is opposite to the other.
    """
    comm = elasticity.comm
    (slave, on_slave), (master, on_master) = elasticity.face(face, "contact"), elasticity.face(against, "contact")
    body, numbering = slave.body, slave.body.numbering
    patches = [
        curved_patch(space, space.held, facets, surface, shape.smooth, f"contact face {name!r}")
        for space, facets, surface, name in (
            (body, on_slave, shape.slave, face),
            (master.body, on_master, shape.master, against),
        )
    ]
    clamped = clamped_nodes(body, on_slave)
    on_face = body.nodes_of(on_slave)
    twice = np.empty(0, dtype=np.int64) if taken is None else on_face[taken[slave.nodes][on_face]].astype(np.int64)
    near = near_pair(patches[0], patches[1], (numbering.local, master.body.numbering.local), comm, shape.depth)
    on_one, on_other = near.slave.patch, near.master.patch
    starts = starts_of(comm, numbering.local)
    gone = np.zeros(numbering.local, dtype=bool)
    gone[np.union1d(clamped, twice)] = True
    if still is not None:
        gone |= still[slave.nodes]
    together = np.zeros(len(elasticity.x), dtype=bool)
    for tie in elasticity.constraints.ties:
        together[tie.nodes] |= tie.joins(face, against)
    gone |= together[slave.nodes]
    glued = comm.allreduce(bool(np.any(together)), op=MPI.LOR)
    if slave.body is master.body:  # at the tip of a crack the two faces cannot part
        gone[np.intersect1d(on_face, body.nodes_of(on_master))] = True
    left_out = np.flatnonzero(fetched(comm, starts, near.slave.numbers, gone))
    large = any(isinstance(member.body, NonlinearBody) for member in elasticity.members)
    rows = on_all_ranks(
        lambda: mortar_rows(on_one, on_other, near.owned, left_out, near.search, not large, near.most),
        f"contact face {face!r}",
        comm,
    )
    apart = comm.allreduce(len(rows.node)) == 0 and not glued
    if apart:
        nodes, left, what = comm.allreduce(len(on_face)), comm.allreduce(gone.sum()), f"contact face {face!r}"
        if nodes and left == nodes:
            raise ValueError(
                f"{what}: all of its nodes are clamped, follow clamped ones, or are contact points of another face, "
                f"and none is left against {against!r}: leave this pair out"
            )
        undeformed = comm.allreduce(np.array_equal(elasticity.x, elasticity.reference), op=MPI.LAND)
        if slave.body is not master.body and undeformed:
            refuse_inside(face, slave, on_slave, against, master)
            refuse_inside(against, master, on_master, face, slave)
        if not large:
            raise NothingOpposite(
                f"{what}: no part of it is opposite to {against!r}: the two must face each other, with outward normals "
                "in opposite directions"
            )
    local = (near.slave.numbers[rows.node] - numbering.first).astype(np.int32)
    weights = numbered(rows.weights, near.slave, numbering.total)
    nodal = comm.allreduce(np.array_equal(rows.weights.indices, rows.node), op=MPI.LAND)
    points = ContactPoints(body, local, rows.area, weights, nodal)
    theirs = numbered(rows.opposite, near.master, master.body.numbering.total)
    opposite = among_all(theirs, master, elasticity)
    held = body.held.projector_at(local)
    planes = planes_of_symmetry(rows.normal, held, rows.node, on_one)
    n = within(rows.normal, planes)
    points = points.of(slave, elasticity)
    mirrors = mirrored(points, planes, opposite, elasticity)
    points = replace(points, opposite=opposite, mirrored=mirrors)
    if elasticity.constraints.ties and still is None:
        still = np.zeros(len(elasticity.x), dtype=bool)
        still[points.nodes[free_lengths(points, n, elasticity) <= HELD_BELOW]] = True
        if comm.allreduce(bool(np.any(still)), op=MPI.LOR):
            return pair_of(elasticity, face, against, adjust, taken, shape, still)
    x = rows.x
    if mirrors is not None:
        x = x + np.einsum("mij,mj->mi", mirrors, elasticity.x[points.nodes] - x)
    gap = rows.gap(n)
    rounding = _NO_GAP * near.size
    closed = (gap <= adjust[0]) & (-gap <= adjust[1])  # what the facets have there is no gap, and shows no curvature
    gap = np.where(closed | (np.abs(gap) <= rounding), 0.0, gap)
    off, between, nearer = bulges_at_points(rows, gap, near.slave, near.master)
    largest = (comm.allreduce(float(np.max(of, initial=0.0)), op=MPI.MAX) for of in (-gap, off))
    deepest, uncertain = (size if size > _SEEN * near.extent else 0.0 for size in largest)
    shared = len(np.setdiff1d(twice, clamped))
    remarks = () if glued else _remarks(face, against, rows, shared, deepest, uncertain, comm)
    if apart:  # in large motions they may come, or have left each other
        remarks = (f"contact face {face!r}: no part of it is opposite to {against!r} yet: nothing touches there",)
    chord = np.maximum(rows.chord, np.column_stack([np.maximum(off, between), np.zeros_like(off), nearer]))
    chord[closed & (max(adjust) > 0.0)] = 0.0
    return Pair(face, against, points, x, n, gap, held, chord, slave.nodes.start + twice, near, left_out, remarks)


def bulges_at_points(
    rows: MortarRows, gap: FloatArray, slave: NearFace, master: NearFace
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far, at every contact point, gaps (m,) are from those between smooth faces for which the facets may stand,
    metres, shape (m,) each: by the largest of the facets there, unless the gap is 0 or a single node is opposite, as of
    matching meshes, or it is larger than what such facets cause; by the mean, where the curvatures of both faces
    differ; and how much nearer the master may be, by its mean and by how far from its nodes the point is."""
    largest = np.zeros(slave.patch.size), np.zeros(master.patch.size)
    mean = np.zeros((slave.patch.size, 3)), np.zeros((master.patch.size, 3))
    for most, bulge, face in zip(largest, mean, (slave, master), strict=True):
        nodes = face.patch.nodes
        np.maximum.at(most, nodes, np.linalg.norm(face.bulges, axis=1)[:, None])
        np.add.at(bulge, nodes, face.bulges[:, None])
        bulge /= np.maximum(np.bincount(nodes.ravel(), minlength=face.patch.size), 1)[:, None]
    at_points, point = largest[0][rows.node], np.repeat(np.arange(len(rows.node)), np.diff(rows.opposite.indptr))
    np.maximum.at(at_points, point, largest[1][rows.opposite.indices])
    alone = np.zeros(len(rows.node))
    np.maximum.at(alone, point, np.abs(rows.opposite.data))
    near = (alone <= _ALONE) & (gap != 0.0) & (np.abs(gap) < 2.0 * max(slave.largest_bulge, master.largest_bulge))
    own, other = (np.einsum("mi,mi->m", of, rows.normal) for of in (mean[0][rows.node], rows.opposite @ mean[1]))
    within = np.clip((1.0 - alone) / (1.0 - 1.0 / master.patch.kind.corners), 0.0, 1.0)
    return np.where(near, at_points, 0.0), np.abs(own - other), np.maximum(-other, 0.0) * within


def _remarks(
    face: str, against: str, rows: MortarRows, twice: int, deepest: float, uncertain: float, comm: MPI.Comm
) -> tuple[str, ...]:
    dropped, layered, shared = comm.allreduce(np.array([len(rows.dropped), rows.layered, twice]))
    lost = float(comm.allreduce(rows.lost))
    remarks = []
    if shared:
        remarks.append(
            f"{shared} of its nodes are contact points of another face or pair, and count there, not at {against!r}"
        )
    if dropped:
        share = f"less than {100 * LEAST_SHARE:.0f} % of their area"
        remarks.append(f"{dropped} of its nodes have {share} opposite to {against!r} and are no contact points there")
    if lost > 0.0:
        remarks.append(
            f"{amount(lost, 'm²')} of it bear no contact force, since all nodes near are clamped: {against!r} can pass "
            "through there; end the clamp or the contact face before that part"
        )
    if layered:
        remarks.append(f"{layered} of its facets have several layers of {against!r} before them: the nearest counts")
    if uncertain > 0.0:
        remarks.append(
            f"if its facets or those of {against!r} stand for curved faces, they are up to {amount(uncertain)} off "
            "the curve, and gaps are uncertain by as much: use finer, second-order or matching meshes, or adjust"
        )
    if deepest > uncertain:
        remarks.append(
            f"it penetrates {against!r} by up to {amount(deepest)} before deformation, an interference; "
            "where coarse meshes of a curved face are the cause, refine them, or close it by adjust"
        )
    return tuple(f"contact face {face!r}: {text}" for text in remarks)


def numbered(rows: scipy.sparse.csr_matrix, face: NearFace, total: int) -> scipy.sparse.csr_matrix:
    """Rows over the nodes of a face near as rows over all nodes of the body."""
    return scipy.sparse.csr_matrix((rows.data, face.numbers[rows.indices], rows.indptr), shape=(rows.shape[0], total))


def pair_surface(
    elasticity: Deformable,
    pair: Pair,
    axes: FrictionAxes | None,
    gap_field: Callable[[FloatArray], FloatArray],
    gap_factor: float,
) -> ContactSurface:
    """The contact points of a pair as a surface; arguments as of `contact_surface`; collective."""
    given = gap_field(pair.points.before_deformation(pair.x))
    frames = pair.points.frames(axes, pair.n, pair.held, pair.x, pair.face)
    part = np.zeros(len(pair.x), dtype=np.int64)
    matrices = matrices_of(elasticity, pair.points, frames)
    gap = pair.gap + gap_factor * given
    return ContactSurface(
        (pair.face,), part, pair.points, pair.x, frames, gap, given, *matrices, (None,), pair.chord, pair.remarks
    )
