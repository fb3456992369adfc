"""Tied faces: every node of one follows the other, so that they neither open nor slip.

The mortar method's condition int lambda_j (u_slave - u_master o pi) dS = 0, with dual multipliers, gives the
displacement of every slave node as u_s = W u of nodes of the master.

Where the faces are a distance d apart, the chords of curved faces or a film of glue, a row of W carries the moment too:
the node follows the rotation of the master's nodes in its row, u_s = sum w_m u_m + omega x d, so that rigid motions of
both bodies together are free of forces.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray, is_number, unit_vectors
from ...units import amount
from ..bodies import Deformable, Equation, Follower, LastingConstraint, Tie
from ..geometry import Point, Turn, check_direction, check_point, on_all_ranks
from ..meshes import fetched, starts_of
from .contact_points import among_all
from .facet_patch import FacetKind, FacetPatch, facet_patch
from .mortar import LEAST_DUAL, Search, nodal_sums, slave_functions, weak_nodes, without_rounding
from .mortar_parts import Most
from .mortar_segments import segments
from .near_facets import near_pair
from .pair import numbered, slave_side


@dataclass(frozen=True)
class Tied(LastingConstraint):
    """Two faces that are glued to each other: no opening, no slip.

    Attributes:
        face: Name of a face.
        against: Name of the other, of another body ("plate:bottom") or of the same.
        slave: Whether the nodes of `face` follow those of `against`, whatever the meshes; else those of the finer face,
            or of the softer body.
        begin, end, reaches: When it acts (`LastingConstraint`); in large motions only `end`.  A contact of the same
            faces acts before and after.

    Raises:
        ValueError: As `LastingConstraint`, or if a name is none, or both are the same.
    """

    face: str
    against: str
    slave: bool = False

    def __post_init__(self) -> None:
        for name in (self.face, self.against):
            if not isinstance(name, str) or not name:
                raise ValueError(f"tie: a face must be given by its name, but is {name!r}")
        if self.face == self.against:
            raise ValueError(f"tie: face {self.face!r} cannot be tied to itself: give another as against")
        super().__post_init__()
        if type(self) is not Tied and (self.begin is not None or self.end is not None):
            raise ValueError(f"{self.what}: acts at all times: begin and end are for ties")

    kind = "tie"

    @property
    def what(self) -> str:
        return f"{self.kind} of {self.face!r} to {self.against!r}"

    def turn(self, master: FloatArray, slave: FloatArray) -> Turn | None:
        """The rotation that takes the master, with its middle at a place (3,) in metres, onto the slave; None if both
        are where they are."""
        return None

    def as_made(self, tie: Tie) -> Tied:
        """The same, with the slave that a tie has; those that are no ties alone have a slave given."""
        return replace(self, face=tie.face, against=tie.against, slave=True) if type(self) is Tied else self

    def joined(self, body: Deformable, taken: BoolArray) -> Tie:
        """The tie of nodes that are in no other (`taken`, (k,)); collective; errors as of `tie_of`."""
        return tie_of(body, self, taken)


@dataclass(frozen=True)
class CyclicSymmetry(Tied):
    """The two cut faces of one of several equal sectors around an axis: one face moves as the other does, turned.

    Attributes:
        face, against, slave: As of `Tied`; meshes of the two faces need not match.
        point: A point of the axis, metres.
        axis: Its direction; need not have length 1.
        sectors: How many sectors make the whole, at least 2.

    Raises:
        ValueError: If a name is none, both are the same, the axis is zero, or sectors is no such number.
    """

    point: Point = (0.0, 0.0, 0.0)
    axis: Point = (0.0, 0.0, 1.0)
    sectors: int = 2

    kind = "cyclic symmetry"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_point(f"{self.what}: point", self.point)
        check_direction(f"{self.what}: axis", self.axis)
        if not is_number(self.sectors, 2.0) or int(self.sectors) != self.sectors:
            raise ValueError(f"{self.what}: sectors must be a whole number of at least 2, but is {self.sectors!r}")

    def turn(self, master: FloatArray, slave: FloatArray) -> Turn:
        axis, point = np.array(self.axis) / np.linalg.norm(self.axis), np.array(self.point, dtype=np.float64)
        turns = [Turn(point, axis, sign * 2.0 * np.pi / self.sectors) for sign in (1.0, -1.0)]
        off = [float(np.linalg.norm(point + turn.matrix @ (master - point) - slave)) for turn in turns]
        return turns[int(np.argmin(off))]


# Faces that are tied: every slave node follows the master, u_slave = W u.
#
# With multipliers on all nodes, dual to functions N' with positive integrals, the condition
# int lambda_j (u_slave - u_master o pi) dS = 0 is solved for each node by itself (Popp, Wohlmuth, Gee and Wall 2012).
# N' are the functions N, on 6-node triangles those with a part of the middles of edges moved to the corners:
# N'_corner = N_corner + a (N_e1 + N_e2), N'_e = (1 - 2 a) N_e.  A displacement with the values v for N' has the values
# v at corners and (1 - 2 a) v_e + a (v_1 + v_2) in the middles of edges.

_TO_CORNERS: Final = 0.2
"""a: the integrals of N' over a plane triangle are 2/15 of its area at corners, 3/15 at edges."""


def tying_functions(kind: FacetKind) -> FloatArray:
    """N' of a facet as combinations of N, shape (n, n)."""
    span = np.eye(kind.width)
    if kind.width == 6:
        for edge, (one, other) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
            span[[one, other], edge], span[edge, edge] = _TO_CORNERS, 1.0 - 2.0 * _TO_CORNERS
    return span


@dataclass(frozen=True, eq=False)
class TiedRows:
    """What m slave nodes follow: their displacement is `weights` times that of slave nodes that are not tied, plus
    `opposite` times that of master nodes.

    Attributes:
        node: Numbers of the nodes in the patch, ascending, shape (m,).
        area: Integrals of their functions N' over the common part, m^2, shape (m,).
        weights, opposite: Shapes (m, nodes of the slave), (m, nodes of the master); the rows of both together have the
            sum 1.
        traction: Tractions at the nodes by the forces on nodes of the slave, 1/m^2, shape (m, nodes of the slave).
        distance: Mean distance of the faces along the normal, metres, shape (m,); negative where they overlap.
        untied: Numbers of nodes before the master that are not tied, since less than a share of 0.2 of their area is.
    """

    node: IntArray
    area: FloatArray
    weights: scipy.sparse.csr_matrix
    opposite: scipy.sparse.csr_matrix
    traction: scipy.sparse.csr_matrix
    distance: FloatArray
    untied: IntArray


def tied_rows(
    slave: FacetPatch,
    master: FacetPatch,
    left_out: BoolArray,
    search: Search,
    most: Most | None = None,
) -> TiedRows:
    """The rows of all nodes of a slave face but those left out (nodes,), whose functions are added to others; with
    `most` (`nearest_sheets`) collective.  Those of nodes within `RINGS` of the end of the patch are wrong."""
    span, size = tying_functions(slave.kind), slave.size
    weights, opposite = (scipy.sparse.csr_matrix((0, columns)) for columns in (size, master.size))
    no, nothing = np.empty(0, dtype=np.int64), np.empty(0)
    untied = TiedRows(no, nothing, weights, opposite, weights, nothing, no)
    if not len(slave) or not len(master):
        if most is not None:
            most(np.full((master.size, 3), -np.inf))
        return untied
    parts = segments(slave, master, search.depth, search.reach, most)
    full = parts.share > LEAST_DUAL
    mass = span @ parts.mass[full] @ span.T
    dual = np.zeros((len(slave), slave.kind.width, slave.kind.width))
    dual[full] = mass.sum(axis=2)[:, :, None] * np.linalg.solve(mass, np.broadcast_to(span, mass.shape))
    sizes = np.einsum("fjn,fn->fj", dual, parts.mass.sum(axis=2))
    weak = weak_nodes(slave.nodes, sizes, nodal_sums(slave.nodes, slave.whole @ span.T, size), left_out)
    if slave.kind.width == 6:  # the corners of an edge whose middle is not tied are not, either
        corners = slave.nodes[:, [0, 1, 2, 1, 2, 0]].reshape(-1, 2, 3)
        bare = (weak | left_out)[slave.nodes[:, 3:]]
        weak[corners.swapaxes(1, 2)[bare].ravel()] = True
        weak &= ~left_out
    functions = slave_functions(slave, slave.nodes, dual, sizes, left_out | weak)
    facet, of = functions.facet, functions.node
    if not len(of):
        return untied
    products = np.einsum("kn,knm->km", functions.coefficients, parts.mass[facet]) @ span.T
    width = slave.kind.width
    spread = scipy.sparse.csr_matrix(
        (
            functions.coefficients.ravel(),
            (facet[:, None] * width + np.arange(width)).ravel(),
            np.arange(len(of) + 1) * width,
        ),
        (len(of), len(slave) * width),
    )
    node, row = np.unique(of, return_inverse=True)
    summed = scipy.sparse.csr_matrix((np.ones(len(of)), (row, np.arange(len(of)))), (len(node), len(of)))
    entries = (products.ravel(), slave.nodes[facet].ravel(), np.arange(len(of) + 1) * width)
    own = (summed @ scipy.sparse.csr_matrix(entries, (len(of), size))).tocsr()
    area = np.asarray(own[np.arange(len(node)), node]).ravel()
    scale, tied = scipy.sparse.diags(1.0 / area), np.zeros(size, dtype=bool)
    tied[node] = True
    weights = -scale @ own @ scipy.sparse.diags((~tied).astype(np.float64))
    opposite = scale @ summed @ spread @ parts.coupling
    way = scale @ summed @ spread @ np.concatenate([parts.separation, parts.normal], axis=2).reshape(-1, 6)
    distance = np.einsum("mi,mi->m", way[:, :3], way[:, 3:])
    at_nodes, at_values = _between_functions(slave)
    every = scipy.sparse.identity(size, format="csr")
    whole = scipy.sparse.diags((~tied).astype(np.float64)) + every[:, node] @ weights
    weights, opposite = at_nodes[node] @ whole @ at_values, at_nodes[node][:, node] @ opposite
    traction = scale @ at_nodes.T.tocsr()[node]
    weights, opposite, traction = map(without_rounding, (weights, opposite, traction))
    return TiedRows(node, area, weights, opposite, traction, distance, np.flatnonzero(weak))


def _between_functions(slave: FacetPatch) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
    """The displacements of nodes by their values for N', and the values by the displacements, shape (nodes, nodes)."""
    diagonal = np.ones(slave.size)
    middle: IntArray = np.empty(0, dtype=np.int64)
    corner: IntArray = np.empty(0, dtype=np.int64)
    if slave.kind.width == 6:
        ends = [slave.nodes[:, columns].ravel() for columns in ([3, 4, 5], [0, 1, 2], [1, 2, 0])]
        edges = np.unique(np.column_stack([ends[0], np.sort(np.column_stack(ends[1:]), axis=1)]), axis=0)
        diagonal[edges[:, 0]] = 1.0 - 2.0 * _TO_CORNERS
        middle, corner = np.repeat(edges[:, 0], 2), edges[:, 1:].ravel()
    share = scipy.sparse.csr_matrix((np.full(len(middle), _TO_CORNERS), (middle, corner)), (slave.size, slave.size))
    inverse = scipy.sparse.diags(1.0 / diagonal)
    return (scipy.sparse.diags(diagonal) + share).tocsr(), (inverse - inverse @ share).tocsr()


_FAR: Final = 0.2
"""Distance of two tied faces over the root of a node's area from which it is worth a remark, and of those of a sector
an error; beyond 1 it is one of ties."""

_ALL_HELD: Final = 2.5
"""Trace of the projector on the held directions of a node above which all are."""

_TOGETHER: Final = 1e-13
"""Distance between a slave node and the point it follows, over the coordinates, that is a rounding error."""


def with_slaves(given: Iterable[Tied | Equation], made: Iterable[Follower]) -> list[Tied | Equation]:
    """Ties with the slaves that they have, whatever the meshes, as those of `Constraints.as_made`."""
    ties = (one for one in made if type(one) is Tied)
    return [next(ties) if type(one) is Tied else one for one in given]


def tie_of(body: Deformable, given: Tied, taken: BoolArray) -> Tie:
    """A tie of nodes that are not in another one (`taken`, (k,)); collective.

    Raises:
        ValueError: On every rank, if a face is unknown, or nothing of one is before the other.
    """
    comm = body.comm
    face, against, why = given.face, given.against, "it was given as the slave"
    clamped = [_clamped(body, name, taken) for name in (face, against)]
    if not given.slave and np.count_nonzero(clamped) == 1:
        face, against = (against, face) if clamped[0] else (face, against)
        why = "the other is clamped"
    elif not given.slave:
        face, against, why = slave_side(body, face, against)
    (slave, on_slave), (master, on_master) = body.face(face, "tie"), body.face(against, "tie")
    space, starts = slave.body, starts_of(comm, slave.body.numbering.local)
    patches = facet_patch(space, on_slave), facet_patch(master.body, on_master)
    turn = given.turn(_middle(patches[1], comm), _middle(patches[0], comm))
    if turn is not None:
        patches = patches[0], replace(patches[1], x=turn.point + (patches[1].x - turn.point) @ turn.matrix.T)
    near = near_pair(*patches, (space.numbering.local, master.body.numbering.local), comm)
    one, other = near.slave.patch, near.master.patch
    gone = taken[slave.nodes].copy()
    gone[space.held.nodes[np.trace(space.held.projector, axis1=1, axis2=2) > _ALL_HELD]] = True
    on_both: IntArray = np.empty(0, dtype=np.int64)
    if space is master.body:
        on_both = np.intersect1d(space.nodes_of(on_slave), space.nodes_of(on_master)).astype(np.int64)
        gone[on_both] = True
    search = near.search or Search(0.0, 0.0)

    def tied(gone: BoolArray) -> tuple[TiedRows, BoolArray, IntArray]:
        """The rows without the nodes that are gone; which of them are of nodes of this rank, and of which."""
        left_out = fetched(comm, starts, near.slave.numbers, gone)
        tied_to = on_all_ranks(lambda: tied_rows(one, other, left_out, search, near.most), given.what, comm)
        own = (tied_to.node >= near.owned[0]) & (tied_to.node < near.owned[1])
        return tied_to, own, (near.slave.numbers[tied_to.node[own]] - space.numbering.first).astype(np.int64)

    tied_to, own, nodes = tied(gone)
    if comm.allreduce(int(own.sum())) == 0:
        raise ValueError(
            f"{given.what}: no part of one is opposite to the other: they must face each other, with outward normals "
            "in opposite directions, and one must have nodes that are neither clamped nor tied already"
        )
    node, area, distance = tied_to.node[own], tied_to.area[own], tied_to.distance[own]
    parts = [
        (tied_to.weights[own], near.slave.numbers, one.places, slave),
        (tied_to.opposite[own], near.master.numbers, other.places, master),
    ]
    columns = scipy.sparse.hstack([rows for rows, *_ in parts], format="csr")
    none = scipy.sparse.csr_matrix((one.size, one.size))
    beside = scipy.sparse.block_diag([none, _neighbours(other)], format="csr")
    x = np.concatenate([places for *_, places, _ in parts])
    numbers = np.concatenate([body.numbers_of(member, numbers.astype(np.int64)) for _, numbers, _, member in parts])

    def conducting(gone: BoolArray) -> tuple[IntArray, scipy.sparse.csr_matrix]:
        gone = gone[slave.nodes].copy()
        gone[on_both] = True
        tied_to, own, nodes = tied(gone)
        columns = scipy.sparse.hstack([tied_to.weights[own], tied_to.opposite[own]], format="csr")
        entries = columns.data, numbers[columns.indices], columns.indptr
        return slave.nodes.start + nodes, scipy.sparse.csr_matrix(entries, (len(nodes), body.numbering.total))

    at = one.places[node]
    size = float(comm.allreduce(float(np.max(np.abs(body.x), initial=0.0)), op=MPI.MAX))
    offset = at - columns @ x
    columns, blocks = _carrying(columns, beside, x, offset, _TOGETHER * size)
    own_side = columns.indices < one.size
    if turn is not None:
        blocks[~own_side] = blocks[~own_side] @ turn.matrix
    H = space.held.projector_at(nodes)
    rows = _global(blocks, columns, numbers, body.numbering.total, np.eye(3) - H)
    beside_rows = _global(
        np.where(own_side[:, None, None], blocks, 0.0), columns, numbers, rows.shape[1] // 3, np.eye(3) - H
    )
    outward = space.positive_weights(on_slave)[1]
    n = unit_vectors(outward[nodes])
    remarks = []
    if clamped[0] and not clamped[1] and face == given.face:
        remarks.append(
            f"{clamped[0]} nodes of {face!r} are clamped, and {against!r} is free there: give that as the slave"
        )
    far = comm.allreduce(float(np.max(np.abs(distance), initial=0.0)), op=MPI.MAX)
    facet = comm.allreduce(float(np.max(np.sqrt(area), initial=0.0)), op=MPI.MAX)
    if far > (1.0 if turn is None else _FAR) * facet:
        raise ValueError(
            f"{given.what}: the faces are up to {amount(far)} apart, but facets {amount(facet)} long: "
            f"check {'the faces and the unit of the meshes' if turn is None else 'axis, point and sectors'}"
        )
    if far > _FAR * facet:
        remarks.append(f"the faces are up to {amount(far)} apart; nodes are tied across that distance as by rigid arms")
    mine = (tied_to.untied >= near.owned[0]) & (tied_to.untied < near.owned[1])
    untied = comm.allreduce(int(mine.sum()))
    if untied:
        remarks.append(
            f"{untied} nodes of {face!r} have less than a fifth of their area before {against!r} and are free"
        )
    named = tuple(f"{given.what}: {text}" for text in remarks)
    traction = numbered(tied_to.traction[own].tocsr(), near.slave, space.numbering.total)
    traction = among_all(traction, slave, body)
    nodes, directions = slave.nodes.start + nodes, np.broadcast_to(np.eye(3), (len(nodes), 3, 3))
    if turn is not None:  # nodes on the axis move along it
        on_axis = slave.nodes.start + on_both
        count, across = len(on_axis), np.eye(3) - np.outer(turn.axis, turn.axis)
        nodes = np.concatenate([nodes, on_axis])
        directions = np.concatenate([directions, np.tile(across, (count, 1, 1))])
        area, n = np.concatenate([area, np.zeros(count)]), np.concatenate([n, np.zeros((count, 3))])
        rows, beside_rows, traction = (
            scipy.sparse.vstack([of, scipy.sparse.csr_matrix((more * count, of.shape[1]))], format="csr")
            for of, more in ((rows, 3), (beside_rows, 3), (traction, 1))
        )
    return Tie(
        given.kind,
        face,
        against,
        why,
        nodes=nodes,
        area=area,
        normal=n,
        rows=rows,
        beside=beside_rows,
        traction=traction,
        remarks=named,
        directions=directions,
        own=np.zeros((len(nodes), 3, 0)),
        conducting=conducting,
        arm=comm.allreduce(float(np.max(np.linalg.norm(offset, axis=1), initial=0.0)), op=MPI.MAX),
        lasting=given.lasting,
    )


def _clamped(body: Deformable, face: str, taken: BoolArray) -> int:
    """Number of nodes of a face that are held along all directions, or follow others already, over all ranks;
    collective."""
    member, facets = body.face(face, "tie")
    nodes = member.body.nodes_of(facets)
    held = np.trace(member.body.held.projector_at(nodes), axis1=1, axis2=2) > _ALL_HELD
    held |= taken[member.nodes][nodes]
    return int(body.comm.allreduce(int(held.sum())))


def _middle(patch: FacetPatch, comm: MPI.Comm) -> FloatArray:
    """Middle of a face, metres, shape (3,); collective."""
    sums = comm.allreduce(np.append(np.einsum("fn,fni->i", patch.whole, patch.x), patch.areas.sum()))
    return sums[:3] / (sums[3] or 1.0)


def _neighbours(patch: FacetPatch) -> scipy.sparse.csr_matrix:
    """Which nodes are in a facet with each node, shape (nodes, nodes)."""
    width = patch.kind.width
    entries = (np.ones(patch.nodes.size), patch.nodes.ravel(), np.arange(0, patch.nodes.size + 1, width))
    on = scipy.sparse.csr_matrix(entries, (len(patch), patch.size))
    return (on.T @ on).tocsr()


def _carrying(
    rows: scipy.sparse.csr_matrix, beside: scipy.sparse.csr_matrix, x: FloatArray, offset: FloatArray, rounding: float
) -> tuple[scipy.sparse.csr_matrix, FloatArray]:
    """Rows (m, nodes) at nodes x (nodes, 3) with the blocks of their entries, shape (entries, 3, 3), by which slave
    nodes at an offset (m, 3) from there follow the rotation of the nodes in their rows and of those `beside` these
    (nodes, nodes)."""
    apart = np.linalg.norm(offset, axis=1) > rounding
    if np.any(apart):
        wider = (scipy.sparse.diags(apart.astype(np.float64)) @ abs(rows) @ beside).tocoo()
        given = rows.tocoo()
        entries = np.concatenate([given.data, np.zeros(wider.nnz)])
        places = np.concatenate([given.row, wider.row]), np.concatenate([given.col, wider.col])
        rows = scipy.sparse.csr_matrix((entries, places), rows.shape)
    count = np.diff(rows.indptr)
    of = np.repeat(np.arange(len(offset)), count)
    blocks = rows.data[:, None, None] * np.eye(3)
    if not np.any(apart):
        return rows, blocks
    middle = np.zeros_like(offset)
    np.add.at(middle, of, x[rows.indices])
    y = x[rows.indices] - (middle / np.maximum(count, 1)[:, None])[of]
    gram = np.zeros((len(offset), 3, 3))
    np.add.at(gram, of, np.einsum("ei,ei->e", y, y)[:, None, None] * np.eye(3) - y[:, :, None] * y[:, None, :])
    crossing, offsets = (np.cross(np.eye(3), vectors[:, None]) for vectors in (y, offset))  # matrices of y x, offset x
    turn = np.linalg.pinv(gram, rcond=1e-8, hermitian=True)[of] @ crossing  # omega = turn u
    blocks[apart[of]] -= (offsets[of] @ turn)[apart[of]]
    return rows, blocks


def _global(
    blocks: FloatArray, rows: scipy.sparse.csr_matrix, numbers: IntArray, total: int, free: FloatArray
) -> scipy.sparse.csr_matrix:
    """Rows over the displacements of all nodes, along the free directions (m, 3, 3) of the slave nodes."""
    of = np.repeat(np.arange(len(free)), np.diff(rows.indptr))
    entries = free[of] @ blocks, numbers[rows.indices], rows.indptr
    matrix = scipy.sparse.bsr_matrix(entries, (3 * len(free), 3 * total)).tocsr()
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix
