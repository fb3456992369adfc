"""Contact of two faces: averages of their displacements, weighted by functions lambda_j on the first, the slave.

    w_j = (1/a_j) int lambda_j (u_slave - u_master o pi) dS,      a_j = int lambda_j dS

pi projects along the slave's normals.  With the functions N of the nodes, this is a row of D/a over the slave's nodes
and one of M/a over the master's, each with sum 1; a force x_j at the contact point acts as D_j x_j/a_j on the slave and
as -M_j x_j/a_j on the master.  The functions lambda_j add up to 1, so a uniform pressure is transmitted exactly.

The gap before deformation is the same average of the distance g of the two faces.  But lambda_j is negative in part,
and where a curved face touches another at the node, g = s^2/(2 R), the average is -h^2/(12 R) on 10-node tetrahedra of
the size h, an interference that the faces have not.  So

    gap_j = max((1/a_j) int lambda_j g dS, min(g, 0))           min over the facets of lambda_j

On first-order facets g is replaced by its interpolant between the vertices, where these are before the master and that
makes the gap larger: gap_j is then g(x_j), exact where the faces are plane.  Of fitting faces, a shaft in a bore, the
average is larger and stays: it counts the chords of both, the interpolant those of the master alone.  Measured, errors
of the force of pairs of Hertz for three meshes of 4, 8 and 12 cells in 1.2 half axes (averages of g without bound /
with bound / interpolant):

    two spheres of hexahedra       0.94, 0.46, 0.18 %  /  the same            /  0.94, 0.12, 0.03 %
    of 10-node tetrahedra          4.94, 1.15, 0.18 %  /  3.59, 1.08, 0.17 %  /  7.83, 1.79, 1.09 %
    crossed cylinders of these     4.79, 1.01, 0.13 %  /  3.48, 0.94, 0.12 %  /  7.45, 1.78, 1.14 %

and of the pressure of two rings (docs/several-bodies.md) by the interpolant alone about twice those by averages.

The interpolant is known where the master is before all vertices of the facets of lambda_j.  In large motions, where
vertices come before it and leave, the gap would jump, and no displacement might be in equilibrium: there gaps are
averages, which are continuous, and change as D and M say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse

from ...arrays import BoolArray, FloatArray, IntArray, in_words
from ...nearest import tree_of
from .facet_patch import FacetPatch
from .mortar_parts import Most
from .mortar_segments import Segments, segments

# The functions of the contact forces on a slave face.
#
# On every slave facet they are combinations of its functions N (of the vertices' linear functions on 6-node triangles),
#
# lambda_j = sum_k Lambda_jk N_k, sum_j lambda_j = 1
#
# They are dual (biorthogonal, Wohlmuth 2000): int lambda_j N_k = delta_jk int N_k, so Lambda = diag(M 1) M^-1 with the
# mass matrix M of the facet, of the covered part of a partly covered one (Cichosz and Bischoff 2011).  The quadratic
# functions of 9-node quadrilaterals have positive integrals, so theirs are dual as they are; those of 6-node triangles
# have not (Popp, Wohlmuth, Gee and Wall 2012).  With N itself the condition of A is about ten times larger.  Where the
# covered part is so small that dual functions are extrapolations, they are the linear functions of the corners.

#
# A force at the contact point x_j, the average of places, acts there.  On a face with the radius R the average with
# dual functions of 6-node triangles is h^2/(12 R) before the face: too long an arm, and too large an average of
# displacements along normals that turn, 0.5 and 1.4 % of the torque of a press fit with 20 and 12 facets around.
# Functions halfway to the linear ones, 2 at j and -1/2 at the others (`contact_points`), have x_j on the face, but
# three times the error of a contact as small as a few facets (pairs of spheres of Hertz, 3.9 for 0.7 %).  So the facets
# of fitting faces have them, whose distance is much nearer to linear than they are to plane.

ROUND: Final = 0.01
"""Chord of a 6-node triangle, h^2/(8 R), over its diameter from which on its functions are halfway; below, points are
before the face by 7e-4 of its radius at most."""

LEAST_DUAL: Final = 0.05
"""Covered share of a facet below which its functions are the linear ones of the corners."""

_LEAST_COVERED: Final = 1e-6
"""Covered share of a facet below which it counts as uncovered."""


def multipliers(slave: FacetPatch, parts: Segments) -> FloatArray:
    """Lambda of every facet, shape (f, multipliers of a facet, n); zero where a facet is uncovered."""
    kind = slave.kind
    count = len(slave.multiplier_columns)
    span = np.eye(kind.width) if kind.width != 6 else kind.vertex_functions
    functions = np.zeros((len(slave), count, kind.width))
    functions[parts.share > _LEAST_COVERED, : kind.corners] = kind.vertex_functions
    full = parts.share > LEAST_DUAL
    mass = span @ parts.mass[full] @ span.T
    sizes = mass.sum(axis=2)
    functions[full] = sizes[:, :, None] * np.linalg.solve(mass, np.broadcast_to(span, (len(mass), *span.shape)))
    if kind.width == 6:
        functions[full] += _halfway(slave, parts.chord)[full, None, None] * (span - functions[full])
    return functions


def _halfway(slave: FacetPatch, chord: FloatArray) -> FloatArray:
    """How far the functions of 6-node triangles are from the dual ones to the linear ones, shape (f,), by the `chord`
    of the distance to the master (f,): half of the way at most."""
    straight = 0.5 * (slave.x[:, :3] + np.roll(slave.x[:, :3], -1, axis=1))
    own = 0.5 * np.linalg.norm((slave.x[:, 3:] - straight).sum(axis=1), axis=1)
    fitting = np.clip(1.0 - chord / np.maximum(own, 1e-300), 0.0, 1.0)
    return 0.5 * fitting * np.minimum(1.0, (own / (ROUND * slave.diameters)) ** 2)


@dataclass(frozen=True, eq=False)
class SlaveFunctions:
    """The functions lambda_j, on every facet a combination of its functions.

    Attributes:
        facet: Facet of each piece, shape (k,).
        node: The node j that its lambda_j stands for, shape (k,).
        coefficients: Of the facet's functions, shape (k, n).
        lost: Facets before the master on which there is no lambda_j, since all nodes near are left out; shape (l,).
    """

    facet: IntArray
    node: IntArray
    coefficients: FloatArray
    lost: IntArray


def slave_functions(
    slave: FacetPatch, nodes: IntArray, multipliers: FloatArray, sizes: FloatArray, left_out: BoolArray
) -> SlaveFunctions:
    """The functions of all nodes but some, whose functions are added to others: the sum of all stays 1.

    The others are those of the same facet; if it has none, the nearest one of the facets that it shares nodes with.

    Args:
        nodes: The nodes of the multipliers of every facet, shape (f, j).
        found: Lambda, shape (f, j, n).
        sizes: Integrals of the functions, shape (f, j).
        left_out: Which nodes have no multiplier, shape (nodes of all ranks,).
    """
    covered, gone = np.any(sizes > 0.0, axis=1), left_out[nodes] | (sizes <= 0.0)
    own = np.flatnonzero(covered & ~np.all(gone, axis=1))
    weight = np.where(gone[own], 0.0, sizes[own])
    weight /= weight.sum(axis=1, keepdims=True)
    given = np.where(gone[own][:, :, None], multipliers[own], 0.0).sum(axis=1, keepdims=True)
    kept = np.where(gone[own][:, :, None], 0.0, multipliers[own] + weight[:, :, None] * given)
    row, j = np.nonzero(~gone[own])
    bare = np.flatnonzero(covered & np.all(gone, axis=1))
    standing = np.zeros(slave.size, dtype=bool)
    standing[nodes[own[row], j]] = True
    target = _nearest(slave, nodes, bare, standing)
    facet = np.concatenate([own[row], bare[target >= 0]])
    node = np.concatenate([nodes[own[row], j], target[target >= 0]])
    one = np.ones((int(np.count_nonzero(target >= 0)), slave.kind.width))
    return SlaveFunctions(facet, node, np.concatenate([kept[row, j], one]), bare[target < 0])


def _nearest(slave: FacetPatch, nodes: IntArray, bare: IntArray, standing: BoolArray) -> IntArray:
    """For some facets, the nearest of these nodes among those of the facets that they share nodes with; -1 if none."""
    if not len(bare):
        return np.empty(0, dtype=np.int64)
    facets, width = nodes.shape
    ones = np.ones(facets * width)
    on = scipy.sparse.csr_matrix((ones, nodes.ravel(), np.arange(0, facets * width + 1, width)), (facets, slave.size))
    around = (on[bare] @ on.T @ on).tocoo()
    candidate = standing[around.col]
    row, node = around.row[candidate], around.col[candidate].astype(np.int64)
    away = np.linalg.norm(slave.places[node] - slave.x[bare].mean(axis=1)[row], axis=1)
    order = np.lexsort((node, away, row))
    first, at = np.unique(row[order], return_index=True)
    target = np.full(len(bare), -1, dtype=np.int64)
    target[first] = node[order][at]
    return target


LEAST_SHARE: Final = 0.2
"""Covered share of a node's area below which it is no contact point.  Measured at the edge of a master: with 0.05 the
pressure at such nodes is up to ten times that of their neighbours, with 0.2 up to three times."""

RINGS: Final = 5
"""Rings of facets around those of a rank on which its contact points can depend."""

_DEPTH: Final = 0.25
"""Deepest penetration that is found, over the extent of the smaller face."""


@dataclass(frozen=True)
class Search:
    """How far the master is found behind the slave (initial penetration) and before it, metres."""

    depth: float
    reach: float

    @classmethod
    def of(cls, distance: float, extents: Sequence[float], deepest: float) -> Search:
        """For faces at this distance from each other, with these extents, and penetrations up to the deepest."""
        return cls(min(_DEPTH * min(extents), deepest), distance + sum(extents))


def search_of(slave: FacetPatch, master: FacetPatch, deepest: float = np.inf) -> Search:
    """For two faces, neither of them empty, and penetrations up to the deepest."""
    extents = [float(np.linalg.norm(np.ptp(patch.x.reshape(-1, 3), axis=0))) for patch in (slave, master)]
    tree = tree_of(master.x.mean(axis=1))
    return Search.of(float(np.min(tree.query(slave.x.mean(axis=1))[0])), extents, deepest)


@dataclass(frozen=True, eq=False)
class MortarRows:
    """The contact points of a pair of faces on this rank, m of them, in the order of their nodes.

    Attributes:
        node: Global number of the slave node that stands for each, ascending, shape (m,).
        area: a_j in m^2, shape (m,).
        whole: The same over the whole slave face, with the covered share area/whole, shape (m,).
        normal: Mean outward unit normal of the slave, shape (m, 3).
        x: Where the force acts on the slave, metres, shape (m, 3).
        separation: Mean way from the slave to the master before it, metres, shape (m, 3).
        chord: As `ContactSurface.chord`, but 0 for how much nearer it may be, shape (m, 3).
        overlap: The smallest distance of the two on the facets of each point if negative, else 0, metres, shape (m,).
        weights: Averages over the slave's nodes, shape (m, nodes of all ranks); every row has the sum 1.
        opposite: Averages over the master's nodes, likewise.
        dropped: Global numbers of this rank's slave nodes before the master that have no contact point, since less
            than a share of 0.2 of their area is before it.
        lost: Area before the master, m^2, on which no contact force acts since all nodes near are left out; of the
            slave facets whose first node is on this rank.
        layered: Number of these facets before which master facets lie in several layers, of which the nearest counts.
    """

    node: IntArray
    area: FloatArray
    whole: FloatArray
    normal: FloatArray
    x: FloatArray
    separation: FloatArray
    chord: FloatArray
    overlap: FloatArray
    weights: scipy.sparse.csr_matrix
    opposite: scipy.sparse.csr_matrix
    dropped: IntArray
    lost: float
    layered: int

    def gap(self, n: FloatArray) -> FloatArray:
        """Distance of the master before deformation along unit normals n (m, 3), metres, shape (m,); negative where the
        faces overlap."""
        return np.maximum(np.einsum("ki,ki->k", self.separation, n), self.overlap)


def mortar_rows(
    slave: FacetPatch,
    master: FacetPatch,
    owned: tuple[int, int],
    left_out: IntArray | None = None,
    search: Search | None = None,
    interpolated: bool = True,
    most: Most | None = None,
) -> MortarRows:
    """The contact points whose nodes this rank owns; collective with `most` alone.

    Args:
        slave: The facets of the slave, of all ranks, or those in `RINGS` rings around this rank's nodes.
        master: Those of the master, of all ranks, or those before these.
        owned: First number of this rank's nodes, and the one after the last.
        left_out: Numbers of slave nodes without a contact point, such as clamped ones; their functions are added
            to those of other nodes near.
        search: How far before and behind the slave the master is found; by default that of these facets.
        interpolated: Whether distances of first-order facets are their interpolants where these are larger.
        most: The largest of all ranks, of values at the master's nodes (`mortar_parts.nearest_sheets`).

    Raises:
        ValueError: If the outward normals around a contact point cancel.
    """
    near = _around(slave, owned)
    if not len(near) or not len(master):
        if most is not None:
            most(np.full((master.size, 3), -np.inf))
        return _no_rows(slave.size, master.size)
    search = search or search_of(slave, master)
    slave = slave.only(near)
    parts = segments(slave, master, search.depth, search.reach, most)
    nodes = slave.nodes[:, slave.multiplier_columns]
    dual = multipliers(slave, parts)
    mass = parts.mass.sum(axis=2)
    gone = np.zeros(slave.size, dtype=bool)
    if left_out is not None:
        gone[left_out] = True
    hats = slave.whole @ slave.kind.vertex_functions.T if slave.kind.width == 6 else slave.whole
    whole = nodal_sums(nodes, hats, slave.size)
    sizes = np.einsum("fjn,fn->fj", dual, mass)
    weak = weak_nodes(nodes, sizes, whole, gone)
    functions = slave_functions(slave, nodes, dual, sizes, gone | weak)
    return _rows(slave, master, parts, functions, owned, whole, weak, interpolated and slave.kind.degree == 1)


def _around(slave: FacetPatch, owned: tuple[int, int]) -> IntArray:
    """The facets with nodes of this rank, and those near that decide which nodes are left out and what takes their
    part."""
    seen = np.zeros(slave.size, dtype=bool)
    seen[owned[0] : owned[1]] = True
    for _ in range(RINGS):
        seen[slave.nodes[np.any(seen[slave.nodes], axis=1)]] = True
    return np.flatnonzero(np.any(seen[slave.nodes], axis=1))


def weak_nodes(nodes: IntArray, sizes: FloatArray, whole: FloatArray, gone: BoolArray) -> BoolArray:
    """Slave nodes with too small a covered part; of a facet that has no others, the one with the largest part stays."""
    covered = nodal_sums(nodes, sizes, len(whole))
    weak = (covered > 0.0) & (covered < LEAST_SHARE * whole) & ~gone
    alone = np.any(sizes > 0.0, axis=1) & np.all(weak[nodes] | gone[nodes] | (covered[nodes] <= 0.0), axis=1)
    alone &= np.any(weak[nodes], axis=1)
    largest = np.argmax(np.where(weak[nodes[alone]], covered[nodes[alone]], -1.0), axis=1)
    weak[nodes[alone, largest]] = False
    return weak


def _rows(
    slave: FacetPatch,
    master: FacetPatch,
    parts: Segments,
    functions: SlaveFunctions,
    owned: tuple[int, int],
    whole: FloatArray,
    weak: BoolArray,
    interpolated: bool,
) -> MortarRows:
    facet, coefficients = functions.facet, functions.coefficients
    products = np.einsum("kn,knm->km", coefficients, parts.mass[facet])
    area = nodal_sums(functions.node, products.sum(axis=1), slave.size)
    node = owned[0] + np.flatnonzero(area[owned[0] : owned[1]] > 0.0)
    point = np.full(slave.size, -1)
    point[node] = np.arange(len(node))
    own = point[functions.node] >= 0
    facet, coefficients, products, row = facet[own], coefficients[own], products[own], point[functions.node[own]]
    width = slave.kind.width
    columns = facet[:, None] * width + np.arange(width)
    shape = (len(node), len(slave) * width)
    spread = scipy.sparse.csr_matrix((coefficients.ravel(), (np.repeat(row, width), columns.ravel())), shape=shape)
    entries = (products.ravel(), (np.repeat(row, width), slave.nodes[facet].ravel()))
    weights = _averages(scipy.sparse.csr_matrix(entries, shape=(len(node), slave.size)))
    opposite = _averages(spread @ parts.coupling)
    normal = spread @ parts.normal.reshape(-1, 3) / area[node][:, None]
    length = np.linalg.norm(normal, axis=1)
    if np.any(length < 0.1):
        where = in_words(slave.places[node[np.argmin(length)]])
        raise ValueError(f"the outward normals of the facets around x = {where} cancel: no contact normal is defined")
    normal /= length[:, None]
    separation = spread @ parts.separation.reshape(-1, 3) / area[node][:, None]
    if interpolated:
        between, known = _interpolated(slave, parts, products, facet, row, area[node])
        larger = known & (np.einsum("ki,ki->k", between - separation, normal) > 0.0)
        separation = np.where(larger[:, None], between, separation)
    overlap = np.zeros(len(node))
    np.minimum.at(overlap, row, parts.least[facet])
    chord = np.zeros((len(node), 3))
    np.maximum.at(chord[:, :2], row, np.column_stack([parts.chord, parts.bend(slave.kind.vertex_functions)])[facet])
    mine = np.flatnonzero(weak[owned[0] : owned[1]]) + owned[0]
    first = slave.nodes[:, 0]
    counted = (first >= owned[0]) & (first < owned[1])  # every facet on one rank
    lost = float((parts.share * slave.areas)[functions.lost][counted[functions.lost]].sum())
    layered = int(np.count_nonzero(parts.doubled & counted))
    x = weights @ slave.places
    return MortarRows(
        node, area[node], whole[node], normal, x, separation, chord, overlap, weights, opposite, mine, lost, layered
    )


def _interpolated(
    slave: FacetPatch, parts: Segments, products: FloatArray, facet: IntArray, row: IntArray, area: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Averages of the way to the master as its interpolant at the corners of the facets, shape (m, 3), and whether it
    is known at all corners that have a part in them, shape (m,).

    Args:
        parts: The ways at the corners of the slave's facets.
        products: Integrals of lambda_j and the facet's functions, for every piece of one, shape (k, n).
        facet, row: The facet and the contact point j of each piece, shape (k,).
        area: a_j, shape (m,).
    """
    corner = slave.nodes[:, : slave.kind.corners]
    count = nodal_sums(corner, parts.reached.astype(np.float64), slave.size)
    ways = [nodal_sums(corner, part, slave.size) for part in np.moveaxis(parts.at_corners, 2, 0)]
    way = np.stack([*(of / np.maximum(count, 1.0) for of in ways), count == 0.0], axis=1)
    weights = products @ slave.kind.vertex_functions.T / area[row][:, None]
    entries = (weights.ravel(), (np.repeat(row, weights.shape[1]), corner[facet].ravel()))
    rows = scipy.sparse.csr_matrix(entries, shape=(len(area), slave.size))
    rows.sum_duplicates()
    unknown = abs(rows) @ way[:, 3]
    return rows @ way[:, :3], unknown < 1e-9


def without_rounding(rows: scipy.sparse.csr_matrix) -> scipy.sparse.csr_matrix:
    """Rows without entries that are rounding errors."""
    rows = rows.tocsr()
    rows.sum_duplicates()
    largest = abs(rows).max(axis=1).toarray().ravel()
    rows.data[np.abs(rows.data) <= 1e-14 * np.repeat(largest, np.diff(rows.indptr))] = 0.0
    rows.eliminate_zeros()
    return rows


def _averages(rows: scipy.sparse.csr_matrix) -> scipy.sparse.csr_matrix:
    """Rows `without_rounding`, divided by their sums."""
    rows = without_rounding(rows)
    rows.data /= np.repeat(np.asarray(rows.sum(axis=1)).ravel(), np.diff(rows.indptr))
    rows.sort_indices()
    return rows


def nodal_sums(nodes: IntArray, values: FloatArray, size: int) -> FloatArray:
    """Sums over the facets of values (f, j) at their nodes (f, j), shape (size,)."""
    return np.bincount(nodes.ravel(), values.ravel(), size).astype(np.float64)


def _no_rows(slave: int, master: int) -> MortarRows:
    no, none = np.empty(0), np.empty(0, dtype=np.int64)
    rows, opposite = (scipy.sparse.csr_matrix((0, size)) for size in (slave, master))
    places = np.empty((0, 3))
    return MortarRows(none, no, no, places, places, places, np.zeros((0, 3)), no, rows, opposite, none, 0.0, 0)
