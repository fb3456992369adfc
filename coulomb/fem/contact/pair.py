"""A pair of deformable faces: contact points on the slave face, and what opposes them on the master face.

    (B u)_j = (1/a_j) int lambda_j  R_j (u_slave - u_master o pi) dS,    a_j = int lambda_j dS,   R_j = (n, t1, t2)

with multipliers lambda_j on the slave face and the projection pi of its points on the master face along the normals
(`mortar`).  Forces on both faces are equal and opposite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ..bodies import Deformable, DisplacementSpace, HeldDirections
from ..geometry import FrictionAxes, RigidFoundation, on_all_ranks, supported_frames
from ..meshes import Exchange, fetched, owner_of, starts_of
from .contact_points import ContactPoints, among_all
from .facet_patch import FacetPatch, facet_patch
from .mortar import LEAST_SHARE, MortarRows, mortar_rows
from .near_facets import NearFace, near_pair
from .slave_side import clamped_nodes
from .surface import ContactSurface, matrices_of
from .symmetric_pair import mirrored, planes_of_symmetry, smooth_normals, within

_ROUNDING = 1e-14
"""Gaps below this part of the coordinates are rounding errors."""


_SEEN = 1e-7
"""Penetrations before deformation below this part of the extent of the slave face are not worth a remark."""


@dataclass(frozen=True)
class Shape:
    """What the facets of a pair stand for, where gaps are measured: surfaces of slave and master; else, if `smooth`,
    first-order facets stand for the smooth surface with the mean normals at their corners; else for themselves."""

    smooth: bool = False
    slave: RigidFoundation | None = None
    master: RigidFoundation | None = None


NO_SHAPE = Shape()
"""Facets stand for themselves."""


def curved_patch(
    space: DisplacementSpace,
    held: HeldDirections,
    facets: npt.NDArray[np.int32],
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


@dataclass(frozen=True)
class Pair:
    """Geometry of a pair of faces before deformation; this rank's m contact points, on the slave face.

    Attributes:
        face: Name of the slave face.
        against: Name of the master face.
        points: Averages over the slave face, and over the master face opposite.
        x: Their coordinates in metres, shape (m, 3).
        n: Unit normals, from the slave body into the master body, shape (m, 3).
        gap: Distance along them before deformation in metres, adjusted, shape (m,).
        held: Projectors on the held directions of the slave nodes, shape (m, 3, 3).
        chord: As `ContactSurface.chord`.
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
    remarks: tuple[str, ...] = ()


def pair_of(
    elasticity: Deformable,
    face: str,
    against: str,
    adjust: float = 0.0,
    taken: npt.NDArray[np.bool_] | None = None,
    shape: Shape = NO_SHAPE,
) -> Pair:
    """The geometry of a pair of a slave and a master face; collective.

    Nodes of the slave face whose displacement along the normal is prescribed, those that nothing opposes, those that
    are contact points of another face already (`taken`), and those that are on the master face as well, are no contact
    points; their parts of the face belong to the nodes beside them.  Gaps and penetrations up to `adjust` in metres are
    taken to be 0.

    Raises:
        ValueError: On every rank, if a face is unknown, its nodes are off the surface given for it, or no part of one
            is opposite to the other.
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
    near = near_pair(patches[0], patches[1], (numbering.local, master.body.numbering.local), comm)
    on_one, on_other = near.slave.patch, near.master.patch
    starts = starts_of(comm, numbering.local)
    on_slave_face = _on_face(patches[0], starts, comm)
    gone = np.zeros(numbering.local, dtype=bool)
    gone[np.union1d(clamped, twice)] = True
    if slave.body is master.body:  # at the tip of a crack the two faces cannot part
        gone |= on_slave_face & _on_face(patches[1], starts, comm)
    left_out = np.flatnonzero(fetched(comm, starts, near.slave.numbers, gone))
    rows = on_all_ranks(
        lambda: mortar_rows(on_one, on_other, near.owned, left_out=left_out, search=near.search),
        f"contact face {face!r}",
        comm,
    )
    if comm.allreduce(len(rows.node), op=MPI.SUM) == 0:
        nodes, left, what = comm.allreduce(on_slave_face.sum()), comm.allreduce(gone.sum()), f"contact face {face!r}"
        if nodes and left == nodes:
            raise ValueError(f"{what}: all of its nodes are clamped, or contact points of another face")
        raise ValueError(
            f"{what}: no part of it is opposite to {against!r}: the two must face each other, with outward normals in "
            "opposite directions"
        )
    local = (near.slave.numbers[rows.node] - numbering.first).astype(np.int32)
    weights = _numbered(rows.weights, near.slave, numbering.total)
    points = ContactPoints(body, local, rows.area, weights, _at_nodes(rows.weights, rows.node, comm))
    theirs = _numbered(rows.opposite, near.master, master.body.numbering.total)
    opposite = among_all(theirs, master, elasticity)
    held = body.held.projector_at(local)
    planes = planes_of_symmetry(rows.normal, held, rows.node, on_one)
    n = within(rows.normal, planes)
    points = points.of(slave, elasticity)
    mirrors = mirrored(points, planes, opposite, elasticity)
    points = points.against(opposite, mirrors)
    x = rows.x
    if mirrors is not None:
        x = x + np.einsum("mij,mj->mi", mirrors, elasticity.x[points.nodes] - x)
    gap = rows.gap(n)
    rounding = _ROUNDING * near.size
    gap = np.where(np.abs(gap) <= max(adjust, rounding), 0.0, gap)
    deepest = -float(comm.allreduce(float(np.min(gap, initial=0.0)), op=MPI.MIN))
    seen = _SEEN * near.extent
    deepest = deepest if deepest > seen else 0.0
    off, between = bulges_at_points(rows, gap, near.slave, near.master)
    uncertain = float(comm.allreduce(float(np.max(off, initial=0.0)), op=MPI.MAX))
    uncertain = uncertain if uncertain > seen else 0.0
    remarks = _remarks(face, against, rows, len(np.setdiff1d(twice, clamped)), deepest, uncertain, comm)
    return Pair(face, against, points, x, n, gap, held, np.max([off, between, rows.chord], axis=0), remarks)


def bulges_at_points(
    rows: MortarRows, gap: FloatArray, slave: NearFace, master: NearFace
) -> tuple[FloatArray, FloatArray]:
    """How far, at every contact point, gaps (m,) are from those between smooth faces for which the facets may stand,
    metres, shape (m,) each: by the largest of the facets there, if the gap is neither 0, as of matching meshes, nor
    larger than what such facets cause; and by the mean, where the curvatures of both faces differ."""
    largest = np.zeros(slave.patch.size), np.zeros(master.patch.size)
    mean = np.zeros((slave.patch.size, 3)), np.zeros((master.patch.size, 3))
    for most, bulge, face in zip(largest, mean, (slave, master), strict=True):
        nodes = face.patch.nodes
        np.maximum.at(most, nodes, np.linalg.norm(face.bulges, axis=1)[:, None])
        np.add.at(bulge, nodes, face.bulges[:, None])
        bulge /= np.maximum(np.bincount(nodes.ravel(), minlength=face.patch.size), 1)[:, None]
    table = rows.opposite
    opposite = scipy.sparse.csr_matrix((largest[1][table.indices], table.indices, table.indptr), shape=table.shape)
    most = np.maximum(largest[0][rows.node], opposite.max(axis=1).toarray().ravel())
    near = (gap != 0.0) & (np.abs(gap) < 2.0 * max(slave.largest_bulge, master.largest_bulge))
    between = mean[0][rows.node] - rows.opposite @ mean[1]
    return np.where(near, most, 0.0), np.abs(np.einsum("mi,mi->m", between, rows.normal))


def _remarks(
    face: str, against: str, rows: MortarRows, twice: int, deepest: float, uncertain: float, comm: MPI.Comm
) -> tuple[str, ...]:
    dropped, layered, shared = comm.allreduce(np.array([len(rows.dropped), rows.layered, twice]), op=MPI.SUM)
    lost = float(comm.allreduce(rows.lost, op=MPI.SUM))
    found = []
    if shared:
        found.append(
            f"{shared} of its nodes are contact points of another face or pair, and count there, not at {against!r}"
        )
    if dropped:
        share = f"less than {100 * LEAST_SHARE:.0f} % of their area"
        found.append(f"{dropped} of its nodes have {share} opposite to {against!r} and are no contact points there")
    if lost > 0.0:
        found.append(
            f"{lost:.3g} m^2 of it bear no contact force, since all nodes near are clamped: {against!r} can pass "
            "through there; end the clamp or the contact face before that part"
        )
    if layered:
        found.append(f"{layered} of its facets have several layers of {against!r} before them: the nearest counts")
    if uncertain > 0.0:
        found.append(
            f"if its facets or those of {against!r} stand for curved faces, they are up to {uncertain:.3g} m off the "
            "curve, and gaps are uncertain by as much: use finer, second-order or matching meshes, or adjust"
        )
    if deepest > uncertain:
        found.append(
            f"it penetrates {against!r} by up to {deepest:.3g} m before deformation, an interference; "
            "where coarse meshes of a curved face are the cause, refine them, or close it by adjust"
        )
    return tuple(f"contact face {face!r}: {text}" for text in found)


def _on_face(patch: FacetPatch, starts: npt.NDArray[np.int64], comm: MPI.Comm) -> npt.NDArray[np.bool_]:
    """Which of this rank's nodes are on facets of any rank; collective."""
    nodes = np.unique(patch.nodes)
    found = np.zeros(int(starts[comm.rank + 1] - starts[comm.rank]), dtype=bool)
    found[Exchange(comm, owner_of(starts, nodes)).send(nodes) - starts[comm.rank]] = True
    return found


def _numbered(rows: scipy.sparse.csr_matrix, face: NearFace, total: int) -> scipy.sparse.csr_matrix:
    """Rows over the nodes of a face near as rows over all nodes of the body."""
    return scipy.sparse.csr_matrix((rows.data, face.numbers[rows.indices], rows.indptr), shape=(rows.shape[0], total))


def _at_nodes(weights: scipy.sparse.csr_matrix, node: npt.NDArray[np.int64], comm: MPI.Comm) -> bool:
    alone = weights.nnz == len(node) and bool(np.all(weights.indices == node))
    return bool(comm.allreduce(alone, op=MPI.LAND))


def pair_surface(
    elasticity: Deformable,
    pair: Pair,
    axes: FrictionAxes | None,
    gap_field: Callable[[FloatArray], FloatArray],
    gap_factor: float,
) -> ContactSurface:
    """The contact points of a pair as a surface; arguments as of `contact_surface`; collective."""
    given = gap_field(pair.x)
    frames = pair_frames(pair, axes, elasticity.comm)
    part = np.zeros(len(pair.x), dtype=np.int64)
    matrices = matrices_of(elasticity, pair.points, frames)
    gap = pair.gap + gap_factor * given
    return ContactSurface(
        (pair.face,), part, pair.points, pair.x, frames, gap, given, *matrices, (None,), pair.chord, pair.remarks
    )


def pair_frames(pair: Pair, axes: FrictionAxes | None, comm: MPI.Comm) -> FloatArray:
    """Rows n, t1, t2 of the contact points, shape (m, 3, 3); collective."""
    if axes is None:
        return supported_frames(pair.n, pair.held)
    return axes.frames(pair.n, pair.held, pair.x, f"contact face {pair.face!r}", comm)
