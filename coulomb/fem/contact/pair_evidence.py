"""Gaps, normals, areas and averages of a pair of faces found a second time, to judge those of `mortar_rows`.

Nothing of the mortar integration is used: no clipped polygons, no common parts.  Every slave facet has many points,
whose lines along the facet's normal are met by the master's facets (`closest_points`), and the integrals of the
definition (`mortar`) are sums over these points,

    a_j = int lambda_j dS,    n_j ~ int lambda_j n dS,    gap_j = (1/a_j) int lambda_j g dS    and of displacements

with functions lambda_j that are dual to the slave's own under the same sums.  So what is a combination of the slave's
functions on every facet, as distances of plane faces are, is exact to rounding with any points.  For everything else
the error of the sums is a part of its distance from such a combination, v(q) - sum_k N_k(q) v_k, measured at the points
of the facets: chords of curved faces, and master's edges.  A facet that is not before the master everywhere has its
area to a part of it only (`_EDGE`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse

from ...arrays import BoolArray, FloatArray, IntArray, rows_of, unit_vectors
from ...nearest import tree_of
from ..geometry import RigidFoundation
from .closest_points import (
    FACING,
    PIECES,
    Facets,
    crossed,
    facet_functions,
    facet_rule,
    finer,
    reference_nodes,
)
from .closest_points import (
    opposite as opposite_of,
)
from .facet_heights import risen

_ASLANT: Final = -0.9
"""Cosine between a slave facet and a master facet beside the end of the master above which lines may miss the second:
the side of a disc whose facets lean outwards."""

_KINK: Final = {1: 0.1, 2: 0.25}
"""Error of an average over int |lambda_j| dS/a_j times the largest distance of what is averaged from the functions of
the slave facets, by their degree."""

_SMOOTH: Final = 0.01
"""The same where this distance is that of a quadratic function."""

_EDGE: Final = 0.15
"""Error of the area of a facet that the master covers in part, or not, beside one that it covers, over its own area."""

_UNSEEN: Final = 0.05
_SLIT: Final = 0.01
"""Part of a facet that the master may leave bare between the points, where it ends, and that which moves averages with
functions that are not dual."""

_OF_LENGTHS: Final = 1e-9
"""Of lengths over the size of a facet, of areas over theirs, and of weights."""

_BENT: Final = 0.05
"""Error of areas of facets that are no parallelograms or plane triangles with straight edges, over how far they are
bent: the mortar integration has straight edges.  Between two facets errors cancel but for this part of them, where the
face ends they are those of the slivers beyond the straight edges."""

_LEAST_DUAL: Final = 0.05
"""Covered share of a facet below which its functions are the linear ones of the corners."""

_ROUND: Final = 0.01
"""Bulge of a 6-node triangle over its diameter from which on its functions are halfway from dual to linear ones."""

_PART: Final = 0.05
"""Error of the mean distance of a facet to the master over the largest distance of it from linear."""

_SINGULAR: Final = 1e-4
"""Ratio of the eigenvalues of a mass matrix below which the points before the master are too few for dual functions."""

_LINEAR: Final = 10.0
"""Times that the error of an average is larger where these are not used."""


@dataclass(frozen=True, eq=False)
class Claims:
    """What is to be judged of a pair: this rank's m contact points.

    Attributes:
        node: Numbers of their nodes in the slave's body, over all ranks, shape (m,).
        n: Unit normals, shape (m, 3).
        gap: Distance along them before deformation without given gaps, metres, shape (m,); nan where it is not known.
        area: In m^2, shape (m,).
        held: Projectors on the held directions of the nodes, shape (m, 3, 3).
        adjust: Gaps and penetrations up to these sizes in metres may be 0 instead.
    """

    node: IntArray
    n: FloatArray
    gap: FloatArray
    area: FloatArray
    held: FloatArray
    adjust: tuple[float, float]

    def same(self, other: Claims) -> bool:
        """Whether normals and gaps are those of other claims for the same points."""
        return np.array_equal(self.n, other.n) and np.array_equal(self.gap, other.gap, equal_nan=True)

    def only(self, rows: IntArray) -> Claims:
        """Those for some of the points."""
        n, gap, area, held = (of[rows] for of in (self.n, self.gap, self.area, self.held))
        return Claims(self.node[rows], n, gap, area, held, self.adjust)


@dataclass(frozen=True)
class Surfaces:
    """For what the facets stand where gaps are measured: given surfaces, or smooth ones with mean normals, those at the
    ends within planes of symmetry by the projectors on held directions at the nodes of both faces (f, n, 3, 3); and
    whether distances of first-order facets are their interpolants where these are larger."""

    smooth: bool = False
    slave: RigidFoundation | None = None
    master: RigidFoundation | None = None
    held: tuple[FloatArray, FloatArray] | None = None
    interpolated: bool = True


@dataclass(frozen=True, eq=False)
class Deviations:
    """By how much claims are off beyond what the facets explain, 0 within it, shape (m,) each.

    Attributes:
        gap: Metres.
        normal: Degrees.
        area: Over the area of a point that is covered wholly.
        allowed: The differences of gaps that the facets explain, metres.
    """

    gap: FloatArray
    normal: FloatArray
    area: FloatArray
    allowed: FloatArray

    def each(self) -> tuple[FloatArray, ...]:
        """All of them."""
        return self.gap, self.normal, self.area, self.allowed


class PairSamples:
    """Points of the slave facets around some contact points, and where the master is before them; not collective.

    Args:
        slave, master: The facets of both faces, of all ranks.
        node: Numbers of the nodes of this rank's contact points in the slave's body, shape (m,).
        standing: Those of the contact points of all ranks.
        surfaces: What the facets stand for.
        times: How many times as many points along an edge.
    """

    def __init__(
        self, slave: Facets, master: Facets, node: IntArray, standing: IntArray, surfaces: Surfaces, times: int = 1
    ):
        self._slave, self._master, self._surfaces = slave, master, surfaces
        width = slave.nodes.shape[1]
        columns = np.arange(3 if width == 6 else width)
        bare = ~np.any(np.isin(slave.nodes[:, columns], standing), axis=1)
        chosen, self._around = _around(slave.nodes, columns, node, bare)
        self._chosen, self._bare = chosen, bare[chosen]
        points, weights, piece = facet_rule(slave.corners, slave.degree, times * finer(slave, master))
        corners = reference_nodes(slave.corners, 1)  # are points as well, without weight
        local = np.concatenate([points, corners])
        piece = np.concatenate([piece, np.arange(len(corners))])  # the corner k is on the piece k
        self._at = local
        self._inner, x, sign = len(points), slave.x[chosen], slave.sign[chosen]
        values, along_r, along_s = facet_functions(slave.corners, slave.degree, local)
        place = values @ x
        vectors = sign[:, None, None] * np.cross(along_r @ x, along_s @ x)
        size = np.linalg.norm(vectors, axis=2)
        self._normal = unit_vectors(vectors)
        self._along, self._hits = opposite_of(slave, master, chosen, local, piece)
        self._there = (self._hits.facet >= 0).reshape(size.shape)
        self._values, self._at_all = values[: len(points)], values
        whole = size[:, : len(points)] * weights
        self._size = np.where(self._there[:, : len(points)], whole, 0.0)
        self._area = whole.sum(axis=1)
        self._way = np.where(self._there, self._hits.way.reshape(size.shape), 0.0)
        self._beyond = np.zeros(len(chosen))
        if surfaces.smooth or surfaces.slave is not None or surfaces.master is not None:
            self._to_surfaces(place)
        self._at_corners = facet_functions(slave.corners, 1, points)[0]
        self._functions(node, standing, columns)
        self._missing = self._missed()

    def _functions(self, node: IntArray, standing: IntArray, columns: IntArray) -> None:
        """lambda_j on the facets: dual functions, those of nodes without a contact point shared by the others of the
        facet."""
        slave, chosen, width = self._slave, self._chosen, self._slave.nodes.shape[1]
        self._curves = facet_functions(slave.corners, 2, self._at)[0]
        linear = facet_functions(slave.corners, 1, reference_nodes(slave.corners, slave.degree))[0].T
        self._span = linear if width == 6 else np.eye(width)
        dual = self._values @ self._span.T
        mass = np.einsum("fq,qi,qk->fik", self._size, dual, dual)
        share = self._size.sum(axis=1) / self._area
        eigenvalues = np.linalg.eigvalsh(mass)
        self._dual = (share > _LEAST_DUAL) & (eigenvalues[:, 0] > _SINGULAR * eigenvalues[:, -1])
        functions = np.zeros((len(share), len(columns), width))
        functions[share > 0.0, : slave.corners] = linear
        functions[share > _LEAST_DUAL] = self._span  # with the integrals of the dual ones
        sizes = mass[self._dual].sum(axis=2)
        functions[self._dual] = sizes[:, :, None] * np.linalg.solve(
            mass[self._dual], np.broadcast_to(self._span, (len(sizes), *self._span.shape))
        )
        self._own = np.einsum("fjn,qn,fq->fjq", functions, self._values, self._size)
        own: FloatArray = self._own
        part: FloatArray = np.zeros(len(share))
        self._part_off: FloatArray = np.zeros(len(share))
        if width == 6:
            part, self._part_off = self._halfway()
            whole = np.einsum("jn,qn,fq->fjq", self._span, self._values, self._size)
            own = own + part[:, None, None] * (whole - own)
        integral = own.sum(axis=2)
        nodes = slave.nodes[self._chosen][:, columns]
        gone = ~np.isin(nodes, standing) | (integral <= 0.0)
        loose = (part > 0.0) | np.any(gone, axis=1)  # not exact for linear functions
        kept = np.where(gone, 0.0, integral)
        kept /= np.maximum(kept.sum(axis=1, keepdims=True), 1e-300)
        given = np.where(gone[:, :, None], own, 0.0).sum(axis=1, keepdims=True)
        weight = np.where(gone[:, :, None], 0.0, own + kept[:, :, None] * given)
        self._facet, column = np.nonzero(np.isin(nodes, node) & ~gone)
        self._point, self._weight = rows_of(node, nodes[self._facet, column]), weight[self._facet, column]
        self._count = len(node)
        self.area = self._sums(self._weight.sum(axis=1))
        f, p = self._around
        part = np.where(self._bare, 1.0, np.where(np.all(self._there, axis=1), 0.0, _EDGE))
        bent = np.where(self._slave.bent > 1e-10, _BENT * self._slave.bent, 0.0)[self._chosen]
        self.whole = np.bincount(p, self._area[f] / len(columns), self._count)
        parts = part * self._area + 1.5 * slave.slivers[chosen]
        met = self._hits.facet.reshape(self._there.shape)
        near = crossed(slave, chosen, self._master, met) * self._area
        parts, slits = parts + _SLIT * (near * loose), _UNSEEN * near + bent * self._area
        edge, slit, bend = (np.bincount(p, of[f], self._count) for of in (parts, slits, bent * self._area))
        self._doubt = edge + slit + _OF_LENGTHS * self.whole
        a = np.maximum(self.area, 1e-300)
        self._larger = self._sums(np.abs(self._weight).sum(axis=1)) / a
        self._share = self._larger * (edge + _BENT * bend) / a + _OF_LENGTHS

    def _halfway(self) -> tuple[FloatArray, FloatArray]:
        """How far the functions of 6-node triangles are from the dual ones to the linear ones, as `mortar` defines it,
        by the bulge of a facet over its diameter, and where the distance to the master is nearer to linear than the
        facet is to plane; and how far this may be off by the points; shape (f,) each."""
        x = self._slave.x[self._chosen]
        straight = 0.5 * (x[:, :3] + x[:, [1, 2, 0]])
        bulge = 0.5 * np.linalg.norm(np.sum(x[:, 3:] - straight, axis=1), axis=1)
        diameter = 2.0 * np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2).max(axis=1, initial=0.0)
        ways = self._way[:, :, None] * self._along
        mean = np.einsum("fq,fqi->fi", self._size, ways[:, : self._inner]) / self._area[:, None]
        off = 1.5 * np.linalg.norm(mean - ways[:, self._inner :].mean(axis=1), axis=1)
        off = np.where(np.all(self._there, axis=1), off, 0.0)
        nearer = np.clip(1.0 - off / np.maximum(bulge, 1e-300), 0.0, 1.0)
        most: FloatArray = 0.5 * np.minimum(1.0, (bulge / (_ROUND * diameter)) ** 2)
        off, kink = (of[:, 0] for of in self._away(self._way[:, :, None]))
        unsure = _PART * kink + _SMOOTH * off + self._beyond
        return most * nearer, most * np.minimum(1.0, unsure / np.maximum(bulge, 1e-300))

    def _sums(self, values: FloatArray) -> FloatArray:
        """Sums over the parts of lambda_j of values (k,) or (k, d), shape (m,) or (m, d)."""
        sums = np.zeros((self._count, *values.shape[1:]))
        np.add.at(sums, self._point, values)
        return sums

    def _most(self, values: FloatArray, least: float = 0.0) -> FloatArray:
        """The largest of values of facets (f, d) around each point, and of the least, shape (m, d)."""
        f, p = self._around
        most = np.full((self._count, values.shape[1]), least)
        np.maximum.at(most, p, values[f])
        return most

    def _means(self, values: FloatArray) -> FloatArray:
        """(1/a_j) int lambda_j v dS of values at the points (f, q, d), shape (m, d)."""
        inner = values[:, : self._inner][self._facet]
        means: FloatArray = self._sums(np.einsum("kq,kqd->kd", self._weight, inner))
        return means / np.maximum(self.area, 1e-300)[:, None]

    def _missed(self) -> tuple[IntArray, IntArray]:
        """Pairs of a facet that is not before the master everywhere, by its number among the chosen, and a master facet
        near it that is aslant, of which the strip before the slave may be between the lines."""
        facet = np.flatnonzero(~np.all(self._there, axis=1))
        if not len(facet) or not len(self._master):
            return facet[:0], facet[:0]
        own = self._chosen[facet]
        reach = self._slave.radius[own] + float(self._master.radius.max())
        near = tree_of(self._master.middle).query_ball_point(self._slave.middle[own], reach)
        pair = np.repeat(np.arange(len(facet)), [len(some) for some in near])
        other = np.concatenate([np.asarray(some, dtype=np.int64) for some in near])
        cosine = np.einsum("ki,ki->k", self._slave.normal[own[pair]], self._master.normal[other])
        aslant = (cosine < FACING) & (cosine > _ASLANT)
        return facet[pair[aslant]], other[aslant]

    def _unsure(self, values: FloatArray, missed: FloatArray | None = None) -> FloatArray:
        """How far these may be off, shape (m, d); with the values (k, n, d) at the nodes of the master facets
        that lines may have missed."""
        there = self._there[:, :, None]
        most = np.where(there, values, -np.inf).max(axis=1, initial=-np.inf)
        least = np.where(there, values, np.inf).min(axis=1, initial=np.inf)
        spread = np.where(np.any(there, axis=1), most - least, 0.0)
        off, kink = self._away(values)
        kinked = _KINK[self._slave.degree]
        many = self._there.sum(axis=1) > 2 * self._curves.shape[1]
        error = np.where(many[:, None], np.minimum(kinked * off, 3.0 * kinked * kink + _SMOOTH * off), kinked * off)
        off = error + self._part_off[:, None] * spread
        off = np.where(self._dual[:, None], np.minimum(off, spread), kinked * _LINEAR * spread)
        if missed is not None:
            np.maximum.at(most, self._missing[0], missed.max(axis=1))
            np.minimum.at(least, self._missing[0], missed.min(axis=1))
        f, p = self._around
        high, low = np.full((2, self._count, values.shape[2]), -np.inf)
        np.maximum.at(high, p, most[f])
        np.maximum.at(low, p, -least[f])
        whole = np.maximum(high + low, 0.0)
        edge = self._share[:, None] * np.where(np.isfinite(whole), whole, 0.0)
        return self._larger[:, None] * self._most(off) + edge

    def _away(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Largest distances of values at the points (f, q, d) from the combinations of the facets' functions with their
        averages by dual ones, and from the quadratic functions nearest to them, shape (f, d) each."""
        least = np.maximum(1e-12 * np.abs(self._own).sum(axis=2), 1e-300)  # of nodes with nothing opposite on the facet
        integral = np.maximum(self._own.sum(axis=2), least)[:, :, None]
        nodal = np.einsum("fjq,fqd->fjd", self._own, values[:, : self._inner]) / integral
        there, curves = self._there.astype(np.float64), self._curves
        square = np.einsum("fq,qi,qj->fij", there, curves, curves) + 1e-12 * np.eye(curves.shape[1])
        right = np.einsum("fq,qi,fqd->fid", there, curves, values)
        near = self._at_all @ self._span.T @ nodal, curves @ np.linalg.solve(square, right)
        off, kink = (np.max(there[:, :, None] * np.abs(values - of), axis=1, initial=0.0) for of in near)
        return off, kink

    @property
    def radius(self) -> FloatArray:
        """Of the facets around each point, metres, shape (m,)."""
        return self._most(self._slave.radius[self._chosen, None])[:, 0]

    # --- what is judged -----------------------------------------------------------------------------------------------

    def deviations(self, claims: Claims) -> Deviations:
        """By how much the claims are off, beyond what the facets explain."""
        n, free = claims.n, np.eye(3) - claims.held
        mean, unsure = self._means(self._normal), self._unsure(self._normal)
        within = np.einsum("mij,mj->mi", free, mean)
        inside = np.linalg.norm(n - np.einsum("mij,mj->mi", free, n), axis=1) < 1e-9  # as at planes of symmetry
        mean = unit_vectors(np.where(inside[:, None], within, mean))
        angle = np.linalg.norm(mean - n, axis=1) - np.linalg.norm(unsure, axis=1) - _OF_LENGTHS
        area = (np.abs(claims.area - self.area) - self._doubt) / self.whole
        least, most, allowed = self._gaps(n)
        open_by, overlap = claims.adjust
        closed = (claims.gap == 0.0) & (most >= -overlap - allowed) & (least <= open_by + allowed)
        gap = np.where(closed, 0.0, np.maximum(least - claims.gap, claims.gap - most) - allowed)
        gap = np.where(np.isnan(claims.gap), 0.0, gap)
        return Deviations(np.maximum(gap, 0.0), np.maximum(np.degrees(angle), 0.0), np.maximum(area, 0.0), allowed)

    def _gaps(self, n: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The least and the largest gaps that follow along unit normals n (m, 3), and how far these may be off, in
        metres, shape (m,) each."""
        inner, ways = self._inner, self._way[:, :, None] * self._along
        a = np.maximum(self.area, 1e-300)
        average = np.einsum("mi,mi->m", self._means(ways), n)
        facet, other = self._missing
        one, normal = self._chosen[facet], self._slave.normal[self._chosen[facet]]
        heights = np.einsum("kni,ki->kn", self._master.x[other] - self._slave.middle[one][:, None], normal)
        missed = heights[:, :, None] * normal[:, None]
        off = np.einsum("mi,mi->m", self._unsure(ways, missed), np.abs(n)) + self._most(self._beyond[:, None])[:, 0]
        off += _OF_LENGTHS * self.radius
        least = most = average
        if self._slave.degree == 1 and self._surfaces.interpolated:
            corner, there = self._slave.nodes[self._chosen], self._there[:, inner:].astype(np.float64)
            number, place = np.unique(corner, return_inverse=True)
            place = place.reshape(corner.shape)
            count = np.bincount(place.ravel(), there.ravel(), len(number))
            sums = np.zeros((len(number), 3))
            np.add.at(sums, place, ways[:, inner:] * there[:, :, None])
            way = (sums / np.maximum(count, 1.0)[:, None])[place]
            products = np.einsum("kq,qc->kc", self._weight, self._at_corners)
            vectors = self._sums(np.einsum("kc,kci->ki", products, way[self._facet])) / a[:, None]
            missing = self._sums(np.abs(products * (count == 0.0)[place][self._facet]).sum(axis=1)) > 1e-9 * a
            unsafe = self._sums(np.abs(products * (there == 0.0)[self._facet]).sum(axis=1)) > 1e-9 * a
            nodal = np.where(missing, -np.inf, np.einsum("mi,mi->m", vectors, n))
            most = np.maximum(average, nodal)
            least = np.where(missing | unsafe, average, most)
            off = np.maximum(off, np.where(unsafe & ~missing, self._share * np.abs(nodal - average), 0.0))
        deepest = np.where(self._there, self._way, np.inf).min(axis=1, initial=np.inf)
        overlap = -self._most(np.maximum(-deepest, 0.0)[:, None])[:, 0]
        return np.maximum(least, overlap), np.maximum(most, overlap), off

    def averages(self, own: FloatArray, opposite: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The averages on the slave and on the master of nodal values at the facets of each (f, n, d), and how far they
        may be off, shapes (2, m, d)."""
        both = self._at_points(own, opposite)
        unsure = self._unsure(both[0]), self._unsure(both[1], opposite[self._missing[1]])
        return np.stack([self._means(of) for of in both]), np.stack(unsure)

    def _at_points(self, own: FloatArray, opposite: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nodal values at the facets of both faces (f, n, d) at the points, and at what is opposite, (f, q, d) each."""
        here = np.einsum("qn,fnd->fqd", self._at_all, own[self._chosen])
        shape = self._there.shape
        facet, place = self._hits.facet.reshape(shape), self._hits.place.reshape(*shape, 2)
        there = np.zeros((*facet.shape, own.shape[2]))
        met = facet >= 0
        values = facet_functions(self._master.corners, self._master.degree, place[met])[0]
        there[met] = np.einsum("qn,qnd->qd", values, opposite[facet[met]])
        return here, there

    def depths(self, own: FloatArray, opposite: FloatArray) -> FloatArray:
        """How deep both faces are inside each other at the deepest of the points and nodes of the master around each,
        with displacements at the facets of each (f, n, 3), beyond the chords of the facets, and with these, metres,
        shape (2, m); negative where they are apart."""
        here, there = self._at_points(own, opposite)
        met = self._hits.facet.reshape(self._there.shape)
        chords = (self._slave.kink * self._slave.radius)[self._chosen, None] + np.where(
            met >= 0, (self._master.kink * self._master.radius)[met], 0.0
        )
        nearer = np.einsum("fqi,fqi->fq", here - there, self._along) - self._way
        both = np.stack([nearer - chords, nearer], axis=2)
        both = np.where(self._there[:, :, None], both, -np.inf).max(axis=1, initial=-np.inf)
        np.maximum.at(both, *self._from_master(own, opposite))
        return self._most(both, -np.inf).T

    def _from_master(self, own: FloatArray, opposite: FloatArray) -> tuple[IntArray, FloatArray]:
        """The facets before nodes of the master, and points of it of second order, by their numbers among the chosen,
        and the depths of these, (k, 2), as `depths`: edges of the master are between the points of the slave."""
        slave, master = self._slave, self._master
        if self._surfaces.smooth or self._surfaces.slave is not None or self._surfaces.master is not None:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 2))
        met = np.unique(self._hits.facet[self._hits.facet >= 0])
        near = np.flatnonzero(np.any(np.isin(master.nodes, master.nodes[met]), axis=1))
        points, _, piece = facet_rule(master.corners, master.degree)
        nodes = reference_nodes(master.corners, master.degree)
        first = [next((k for k, of in enumerate(PIECES[master.corners]) if j in of), 0) for j in range(len(nodes))]
        local = np.concatenate([nodes, points]) if master.degree == 2 else nodes
        piece = np.concatenate([np.array(first, dtype=np.int64), piece])[: len(local)] * (master.degree == 2)
        along, hits = opposite_of(master, slave, near, local, piece)
        here = np.flatnonzero(np.isin(hits.facet, self._chosen))
        facet, along = hits.facet[here], along.reshape(-1, 3)[here]
        values = facet_functions(slave.corners, slave.degree, hits.place[here])[0]
        theirs = np.einsum("qn,fni->fqi", facet_functions(master.corners, master.degree, local)[0], opposite[near])
        moved = theirs.reshape(-1, 3)[here] - np.einsum("kn,kni->ki", values, own[facet])
        nearer = np.einsum("ki,ki->k", moved, along) - hits.way[here]
        chords = (slave.kink * slave.radius)[facet]
        return np.searchsorted(self._chosen, facet), np.column_stack([nearer - chords, nearer])

    # --- what the facets stand for ------------------------------------------------------------------------------------

    def _to_surfaces(self, place: FloatArray) -> None:
        """Measure the ways between the surfaces for which the facets stand."""
        there, given, shape = self._there, self._surfaces, self._there.shape
        held, along, start = given.held or (None, None), self._along[there], place[there]
        own, met = np.repeat(self._chosen[:, None], shape[1], axis=1)[there], self._hits.facet.reshape(shape)[there]
        at_own = np.broadcast_to(facet_functions(self._slave.corners, 1, self._at)[0], (*shape, self._slave.corners))
        at_met = facet_functions(self._master.corners, 1, self._hits.place.reshape(*shape, 2)[there])[0]
        end = start + self._way[there][:, None] * along
        sides = (
            (self._slave, given.slave, held[0], own, at_own[there], start),
            (self._master, given.master, held[1], met, at_met, end),
        )
        for sign, (face, surface, directions, facet, at, x) in zip((-1.0, 1.0), sides, strict=True):
            if surface is not None or (given.smooth and face.degree == 1):
                rise, unsure = risen(face, surface, directions, facet, at, x, along)
                self._way[there] += sign * rise
                most = np.zeros(len(place))
                np.maximum.at(most, np.nonzero(there)[0], unsure)
                self._beyond += most


def _around(
    nodes: IntArray, columns: IntArray, node: IntArray, bare: BoolArray
) -> tuple[IntArray, tuple[IntArray, IntArray]]:
    """The facets on which the functions of contact points depend, ascending: those around their nodes, and facets
    without any contact point beside these; and the pairs of such a facet, by its number among them, and a point."""
    f, j = np.nonzero(np.isin(nodes[:, columns], node))
    p = rows_of(node, nodes[:, columns][f, j])
    if np.any(bare) and len(f):
        count = int(nodes.max()) + 1
        rows = np.repeat(np.arange(len(nodes)), nodes.shape[1])
        on = scipy.sparse.csr_matrix((np.ones(nodes.size), (rows, nodes.ravel())), shape=(len(nodes), count))
        points = scipy.sparse.csr_matrix((np.ones(len(f)), (f, p)), shape=(len(nodes), len(node)))
        empty = np.flatnonzero(bare)
        beside = (on[empty] @ on.T @ points).tocoo()
        f, p = np.concatenate([f, empty[beside.row]]), np.concatenate([p, beside.col.astype(np.int64)])
    chosen, number = np.unique(f, return_inverse=True)
    return chosen.astype(np.int64), (number.reshape(-1).astype(np.int64), p.astype(np.int64))
