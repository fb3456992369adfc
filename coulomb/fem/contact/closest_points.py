"""The facets of a face and where straight lines meet them, for the evidence of pairs alone.

Written a second time on purpose: it shares no code with the mortar integration, whose gaps, normals and weights are
judged by it (`pair_evidence`).  The point on a facet is found by Newton's method, of plane triangles in one
step.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, rows_of, unit_vectors
from .. import compat
from ..bodies import DisplacementSpace
from ..cell_search import lagrange
from ..compat import basix, cpp, mesh
from ..meshes import fetched, starts_of
from .sphere_tree import sphere_tree

FACING: Final = -0.2
"""Largest cosine between a line and the normals of the facets that it may meet."""

_INSIDE: Final = 1e-7
"""How far outside a reference facet a point still counts as on it."""

_STEPS: Final = 8
"""Newton steps for the place of a point on a facet."""

_SETTLED: Final = 1e-13
"""Last step in the reference facet."""

_LINES: Final = 50_000
"""Lines searched at once, so that memory stays small."""


@functools.cache
def _element(corners: int, degree: int) -> tuple[Any, IntArray]:
    """Basix's element of a facet, and the numbers of its functions in VTK's order of the nodes."""
    kind = mesh.CellType.triangle if corners == 3 else mesh.CellType.quadrilateral
    element = lagrange(kind.name, degree)
    return element, np.argsort(cpp.io.perm_vtk(kind, len(element.points)))


def facet_functions(corners: int, degree: int, local: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The functions of a facet at reference points (q, 2), and their derivatives along both axes, shapes (q, n)."""
    element, order = _element(corners, degree)
    if not len(local):  # of which basix 0.5 aborts the process
        return (np.empty((0, len(order))),) * 3
    values, along_r, along_s = element.tabulate(1, local)[:, :, order, 0]
    return values, along_r, along_s


def reference_nodes(corners: int, degree: int) -> FloatArray:
    """The nodes of the reference facet in VTK's order, shape (n, 2)."""
    element, order = _element(corners, degree)
    return np.asarray(element.points[order])


def facet_rule(corners: int, degree: int, finer: int = 1) -> tuple[FloatArray, FloatArray, IntArray]:
    """Points (q, 2), weights (q,) and the piece of each (q,) of a reference facet: many small cells with Gauss points,
    whose order is that of the products of the functions; `finer` times as many along an edge."""
    cells = finer * (3 if degree == 1 else 2)
    cell = basix.CellType.triangle if corners == 3 else basix.CellType.quadrilateral
    inner, size = basix.make_quadrature(cell, 2 * degree if corners == 3 else 2 * degree + 1)
    corner = np.moveaxis(np.indices((cells, cells)), 0, -1).reshape(-1, 1, 2)
    parts = corner + inner
    if corners == 3:
        diagonal = corner.sum(axis=(1, 2))
        parts = np.concatenate([parts[diagonal < cells], (corner + 1 - inner)[diagonal < cells - 1]])
    local = parts.reshape(-1, 2) / cells
    r, s = (local > 0.5).T
    pieces = ([r, s, local.sum(axis=1) > 0.5], [1, 2, 3]) if corners == 3 else ([r & s, r, s], [2, 1, 3])
    return local, np.tile(size, len(parts)) / cells**2, np.select(*pieces, 0).astype(np.int64) * (degree == 2)


PIECES: Final = {
    3: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    4: [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]],
}
"""Corners of the four pieces of second-order facets, each with a normal of its own."""


@dataclass(frozen=True, eq=False)
class Facets:
    """The facets of a face, of all ranks.

    Attributes:
        corners: 3 or 4.
        degree: 1 or 2.
        nodes: Numbers of their nodes in the body, over all ranks, in VTK's order, shape (f, n).
        x: Coordinates of these, metres, shape (f, n, 3).
        sign: 1 where the order of the nodes is counterclockwise from outside, else -1, shape (f,).
        depth: How far behind their start lines may meet the face at most, metres.
    """

    corners: int
    degree: int
    nodes: IntArray
    x: FloatArray
    sign: FloatArray
    depth: float = np.inf

    def __len__(self) -> int:
        return len(self.nodes)

    def at(self, facet: IntArray, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The functions (q, n), the points, and the derivatives of these, shapes (q, 3), of reference places (q, 2) on
        facets (q,)."""
        values, along_r, along_s = facet_functions(self.corners, self.degree, place)
        nodes = self.x[facet]
        return values, *(np.einsum("qn,qni->qi", of, nodes) for of in (values, along_r, along_s))

    @cached_property
    def middle(self) -> FloatArray:
        return self.x.mean(axis=1)

    @cached_property
    def radius(self) -> FloatArray:
        """Of a sphere around the middle of each that holds it, metres, shape (f,)."""
        away = np.linalg.norm(self.x - self.middle[:, None], axis=2)
        return (1.0 if self.degree == 1 else 1.2) * away.max(axis=1, initial=0.0)

    @cached_property
    def width(self) -> FloatArray:
        """Areas between the corners over half the diameters, metres, shape (f,)."""
        diameter = 2.0 * np.linalg.norm(self.x - self.middle[:, None], axis=2).max(axis=1, initial=0.0)
        return 2.0 * np.linalg.norm(plane_vectors(self.x[:, : self.corners]), axis=1) / diameter

    @cached_property
    def normal(self) -> FloatArray:
        """Outward unit normals of the planes of the corners, shape (f, 3)."""
        return unit_vectors(self.sign[:, None] * plane_vectors(self.x[:, : self.corners]))

    @cached_property
    def kink(self) -> FloatArray:
        """Largest difference of the unit normals of each and the mean ones at its corners, shape (f,)."""
        corner, means = self.nodes[:, : self.corners], np.zeros((int(self.nodes.max(initial=-1)) + 1, 3))
        _, along_r, along_s = facet_functions(self.corners, self.degree, reference_nodes(self.corners, 1))
        n = unit_vectors(self.sign[:, None, None] * np.cross(along_r @ self.x, along_s @ self.x))
        np.add.at(means, corner, n)
        turn: FloatArray = np.linalg.norm(unit_vectors(means)[corner] - n, axis=2)
        return turn.max(axis=1, initial=0.0)

    @cached_property
    def bent(self) -> FloatArray:
        """How far the nodes of each are from those of a parallelogram or triangle, over its radius, shape (f,)."""
        points = reference_nodes(self.corners, self.degree)
        three = [0, 1, self.corners - 1]
        edges = self.x[:, three[1:]] - self.x[:, :1]
        straight = self.x[:, :1] + np.einsum("nk,fki->fni", points, edges)
        return np.linalg.norm(self.x - straight, axis=2).max(axis=1, initial=0.0) / self.radius

    @cached_property
    def rim(self) -> BoolArray:
        """Which edges of the facets are where the face ends, each named by its first corner, shape (f, corners)."""
        corner = self.nodes[:, : self.corners]
        ends = np.sort(np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        return (count[number.reshape(-1)] == 1).reshape(corner.shape)

    @cached_property
    def slivers(self) -> FloatArray:
        """Areas between the edges where the face ends and straight ones, in the planes of the corners, m^2, shape
        (f,)."""
        if self.degree == 1:
            return np.zeros(len(self))
        start, end = self.x[:, : self.corners], np.roll(self.x[:, : self.corners], -1, axis=1)
        bulge = self.x[:, self.corners : 2 * self.corners] - 0.5 * (start + end)
        inside = bulge - np.einsum("fki,fi->fk", bulge, self.normal)[:, :, None] * self.normal[:, None]
        area = 2.0 / 3.0 * np.linalg.norm(inside, axis=2) * np.linalg.norm(end - start, axis=2)
        return np.asarray(np.sum(area * self.rim, axis=1))

    @property
    def extent(self) -> float:
        return float(np.linalg.norm(np.ptp(self.x.reshape(-1, 3), axis=0))) if len(self) else 0.0


def plane_vectors(corners: FloatArray) -> FloatArray:
    """Normals of facets with these corners (..., 3 or 4, 3), with the length of their area, shape (..., 3)."""
    return 0.5 * np.cross(corners[..., 2, :] - corners[..., 0, :], corners[..., -1, :] - corners[..., 1, :])


def facets_of(space: DisplacementSpace, facets: Int32Array) -> tuple[Facets, IntArray]:
    """The boundary facets of a face, of all ranks, and the nodes of those of this rank, as `gathered` takes them;
    collective."""
    domain, comm = space.domain, space.comm
    cell, columns = space.in_cells(facets)
    dofs = compat.cell_dofs(space.V)[cell[:, None], columns]
    nodes = space.global_numbers(dofs)
    places = space.points_of_cells(cell)
    x = np.take_along_axis(places, columns[:, :, None], axis=1)
    corners = 3 if domain.topology.cell_type.name == "tetrahedron" else 4
    outward = x[:, :corners].mean(axis=1) - places.mean(axis=1)
    sign = np.where(np.einsum("fi,fi->f", plane_vectors(x[:, :corners]), outward) < 0.0, -1.0, 1.0)
    every = [np.concatenate(comm.allgather(of)) for of in (nodes, x, sign)]
    return Facets(corners, space.degree, *every), nodes


def gathered(space: DisplacementSpace, nodes: IntArray, values: FloatArray) -> FloatArray:
    """Values (k, d) of this rank's nodes at those of all facets, shape (f, n, d), from the nodes of this rank's facets
    (`facets_of`); collective."""
    here = fetched(space.comm, starts_of(space.comm, space.numbering.local), nodes, values)
    return np.concatenate(space.comm.allgather(here))


@dataclass(frozen=True, eq=False)
class Hits:
    """Where lines (q,) meet a face first; the nearest place of each, before its start or behind it.

    Attributes:
        facet: -1 where a line meets none, shape (q,).
        place: In the reference facet, shape (q, 2).
        way: From the start of the line, metres, shape (q,); inf where it meets none.
    """

    facet: IntArray
    place: FloatArray
    way: FloatArray


def hits(start: FloatArray, along: FloatArray, face: Facets, depth: float, reach: float) -> Hits:
    """Where lines from points (q, 3) along unit vectors (q, 3) meet a face, no farther than `depth` behind the points
    and `reach` before them, metres; not collective."""
    found = Hits(np.full(len(start), -1), np.zeros((len(start), 2)), np.full(len(start), np.inf))
    if not len(face):
        return found
    tree, depth = sphere_tree(face.middle, face.radius), min(depth, face.depth)
    for at in np.array_split(np.arange(len(start)), len(start) // _LINES + 1):
        line, facet = tree.before(start[at], np.zeros(len(at)), along[at], depth, reach)
        _keep_nearest(found, at[line], facet, *_meet(face, facet, start[at[line]], along[at[line]]), depth, reach)
    return found


_PROBES: Final = 0.8137
_LEVEL: Final = 0.1
_STEP: Final = 2.5
_NEAR: Final = 4.0
"""What is a step, as `mortar_parts.nearest_sheets` defines it."""


def opposite(
    slave: Facets, master: Facets, facet: IntArray, local: FloatArray, piece: IntArray
) -> tuple[FloatArray, Hits]:
    """Lines along the normals of some slave facets (f,), ascending, of second order those of the pieces (q,) on which
    their reference points (q, 2) are, shape (f, q, 3), and where these f q lines meet the master.

    What is beyond a step does not count: farther from a facet of either face than the nearest place before it or the
    facets beside it, by more than `_LEVEL` and `_STEP` explain.
    """
    near = _beside(slave, facet)
    along, found = _lines(slave, master, near, local, piece)
    met = np.isfinite(found.way)
    lines, ways = along.reshape(-1, 3)[met], np.abs(found.way[met])
    if np.max(ways, initial=0.0) > _LEVEL * min(np.min(of.width, initial=np.inf) for of in (slave, master)):
        own, there = np.repeat(near, len(local))[met], found.facet[met]
        normals = master.normal[there]
        cosine = np.einsum("ki,ki->k", lines, normals)[:, None]
        low, high = _levels(slave, near, master)[:, np.repeat(np.arange(len(near)), len(local))[met]]
        rises = _STEP * _rises(slave.x[own], (normals - cosine * lines) / cosine**2)
        gone, heights = (ways < low - rises) | (ways > high + rises), np.abs(cosine[:, 0]) * ways
        far = heights > _LEVEL * master.width[there]
        if np.any(far):
            behind, farthest = _beside(master, there[far]), np.full(len(master), np.inf)
            farthest[behind] = _levels(master, behind, slave)[1]
            rises = _STEP * _rises(master.x[there], (lines - cosine * normals) / cosine**2)
            gone |= heights > farthest[there] + rises
        lost = np.flatnonzero(met)[gone]
        found.facet[lost], found.way[lost] = -1, np.inf
    given = np.isin(near, facet)
    chosen = np.repeat(given, len(local))
    return along[given], Hits(found.facet[chosen], found.place[chosen], found.way[chosen])


def _beside(face: Facets, facet: IntArray) -> IntArray:
    """Some facets and those that share a node with them, ascending."""
    return np.flatnonzero(np.any(np.isin(face.nodes, face.nodes[facet]), axis=1))


def _lines(face: Facets, other: Facets, facet: IntArray, local: FloatArray, piece: IntArray) -> tuple[FloatArray, Hits]:
    """`opposite`, with all that lines meet."""
    x, along = face.x[facet], np.repeat(face.normal[facet][:, None], len(local), axis=1)
    if face.degree == 2:
        along = unit_vectors(face.sign[facet, None, None] * plane_vectors(x[:, PIECES[face.corners]]))[:, piece]
    depth, reach = 0.25 * min(face.extent, other.extent), face.extent + other.extent
    if len(face) and len(other):
        reach += float(np.min(np.linalg.norm(other.middle - face.middle[0], axis=1)))
    start = (facet_functions(face.corners, face.degree, local)[0] @ x).reshape(-1, 3)
    return along, hits(start, along.reshape(-1, 3), other, depth, reach)


def _rises(x: FloatArray, slope: FloatArray) -> FloatArray:
    """How much distances differ over facets x (k, n, 3) along slopes (k, 3), by `mortar_parts`; shape (k,)."""
    steeper = 1.0 + (np.linalg.norm(slope, axis=1) / 3.0) ** 4
    return steeper * np.ptp(np.einsum("kni,ki->kn", x, slope), axis=1)


def _levels(face: Facets, near: IntArray, other: Facets) -> FloatArray:
    """Distances of each of some facets (f,) between which what its lines meet is on the level of the nearest around it,
    shape (2, f), by lines from points of each of its pieces (`mortar_parts.PROBES`)."""
    nodes = reference_nodes(face.corners, face.degree)
    corners = nodes[PIECES[face.corners] if face.degree == 2 else [list(range(face.corners))]]
    middle = corners.mean(axis=1, keepdims=True)
    points = (middle + _PROBES * (corners - middle)).reshape(-1, 2)
    along, found = _lines(face, other, near, points, np.repeat(np.arange(len(corners)), face.corners))
    way, n = np.abs(found.way).reshape(along.shape[:2]), other.normal[found.facet].reshape(along.shape)
    met = np.isfinite(way)[:, :, None]
    cosine = np.where(met, np.einsum("fqi,fqi->fq", along, n)[:, :, None], 1.0)
    slope = np.where(met, (n - cosine * along) / cosine**2, 0.0)
    rises = _rises(np.repeat(face.x[near], len(points), axis=0), slope.reshape(-1, 3)).reshape(way.shape).max(axis=1)
    rows, columns = np.repeat(np.arange(len(near)), face.nodes.shape[1]), face.nodes[near].ravel()
    on = scipy.sparse.csr_matrix((np.ones(len(rows)), (rows, columns)))
    one, other_one = (on @ on.T).nonzero()
    most = np.full((3, len(near)), -np.inf)
    for largest, values in zip(most, (-way.min(axis=1), rises, face.width[near]), strict=True):
        np.maximum.at(largest, one, values[other_one])
    own, width = way.min(axis=1), face.width[near]
    least = np.where(own <= _NEAR * width, own - _LEVEL * width - _STEP * rises, 0.0)
    return np.stack(
        [least, np.where(-most[0] <= _NEAR * most[2], _LEVEL * most[2] + _STEP * most[1] - most[0], np.inf)]
    )


def off_linear(
    face: Facets, x: FloatArray, n: FloatArray, u: FloatArray, there: FloatArray, kink: FloatArray
) -> FloatArray:
    """By how much distances along unit normals n (m, 3) change otherwise than with fixed normals and places opposite,
    between points x (m, 3) and a face, with displacements u (m, 3) and `there` (f, n, 3) at its nodes, metres, shape
    (m,); beyond the chords of the face, and of that of the points, with `kink` (m,) there.  It is 0 where nothing is
    opposite before, and the way along the face, if that is more than a facet, where nothing is opposite after it; not
    collective."""
    error, moved, far = np.zeros(len(x)), replace(face, x=face.x + there), 0.25 * face.extent
    before, after = (hits(at, n, of, far, 4.0 * far) for at, of in ((x, face), (x + u, moved)))
    met = np.flatnonzero(before.facet >= 0)
    facet, opposite = before.facet[met], np.zeros((len(met), 3))
    if len(met):
        values = facet_functions(face.corners, face.degree, before.place[met])[0]
        opposite = np.einsum("qn,qni->qi", values, there[facet])
    relative = u[met] - opposite
    closed = np.einsum("qi,qi->q", relative, n[met])
    slip = np.linalg.norm(relative - closed[:, None] * n[met], axis=1)
    off = after.way[met] - before.way[met] + closed
    explained = (face.kink[facet] + kink[met]) * np.minimum(slip, 0.5 * face.radius[facet])
    off = np.sign(off) * np.maximum(np.abs(off) - explained, 0.0)
    error[met] = np.where(after.facet[met] >= 0, off, np.where(slip > face.radius[facet], slip, 0.0))
    return error


def _meet(
    face: Facets, facet: IntArray, start: FloatArray, along: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Places (c, 2) in facets (c,), the way to them (c,), and whether the line meets the facet there from outside."""
    place = np.full((len(facet), 2), 1.0 / 3.0 if face.corners == 3 else 0.5)
    way = np.zeros(len(facet))
    plane = face.bent[facet] < 1e-12
    c = -along
    with np.errstate(all="ignore"):
        for _ in range(1 if np.all(plane) else _STEPS):
            _, x, a, b = face.at(facet, place)
            rest = start + way[:, None] * along - x
            across = np.cross(b, c)
            scale = 1.0 / np.einsum("ci,ci->c", a, across)
            change = scale[:, None] * np.column_stack(
                [
                    np.einsum("ci,ci->c", rest, across),
                    np.einsum("ci,ci->c", a, np.cross(rest, c)),
                    np.einsum("ci,ci->c", a, np.cross(b, rest)),
                ]
            )
            place, way = np.clip(place + change[:, :2], -2.0, 3.0), way + change[:, 2]
            if not np.any(np.abs(change[:, :2]) > _SETTLED):  # nan on lines along a facet
                break
        if not np.all(plane):
            _, x, a, b = face.at(facet, place)
        n = face.sign[facet, None] * np.cross(a, b)
        facing = np.einsum("ci,ci->c", n, along) < FACING * np.linalg.norm(n, axis=1)
        off = np.linalg.norm(start + way[:, None] * along - x, axis=1) if not np.all(plane) else np.zeros(len(way))
    r, s = place.T
    outer = r + s - 1.0 if face.corners == 3 else np.maximum(r, s) - 1.0
    inside = (np.minimum(r, s) >= -_INSIDE) & (outer <= _INSIDE) & facing & (off <= 1e-9 * face.radius[facet])
    return place, way, inside


def _keep_nearest(
    nearest: Hits,
    line: IntArray,
    facet: IntArray,
    place: FloatArray,
    way: FloatArray,
    meets: BoolArray,
    depth: float,
    reach: float,
) -> None:
    """Enter the nearest of the places (c, 2) where lines (c,) meet facets."""
    meets &= (way > -depth) & (way < reach)
    line, facet, place, way = line[meets], facet[meets], place[meets], way[meets]
    order = np.lexsort((np.abs(way), line))
    line, first = np.unique(line[order], return_index=True)
    best = order[first]
    nearer = np.abs(way[best]) < np.abs(nearest.way[line])
    line, best = line[nearer], best[nearer]
    nearest.facet[line], nearest.place[line], nearest.way[line] = facet[best], place[best], way[best]


def crossed(slave: Facets, chosen: IntArray, master: Facets, met: IntArray) -> BoolArray:
    """Which of some facets (f,) an edge crosses where the master ends, of the master's facets that they are before, by
    their numbers (f, q), -1 for none; shape (f,)."""
    row = np.repeat(np.arange(len(chosen)), met.shape[1])
    pairs = np.unique(np.column_stack([row, met.ravel()])[met.ravel() >= 0], axis=0)
    pair, edge = np.nonzero(master.rim[pairs[:, 1]])
    ends: FloatArray = reference_nodes(master.corners, 1)
    next_ends = ends[np.arange(1, master.corners + 1) % master.corners]
    along = np.linspace(0.0, 1.0, _ALONG_EDGE)[:, None]
    places = ends[:, None] + along * (next_ends - ends)[:, None]
    facet = np.repeat(pairs[pair, 1], _ALONG_EDGE)
    _, x, _, _ = master.at(facet, places[edge].reshape(-1, 2))
    own = np.repeat(pairs[pair, 0], _ALONG_EDGE)
    found = np.zeros(len(chosen), dtype=bool)
    if len(own):
        place, _, inside = _meet(slave, chosen[own], x, -slave.normal[chosen[own]])
        r, s = place.T
        depth = np.minimum(np.minimum(r, s), 1.0 - (r + s if slave.corners == 3 else np.maximum(r, s)))
        found[own[inside & (depth > _CROSSED)]] = True
    return found


_ALONG_EDGE: Final = 9
"""Points of an edge where the master ends."""

_CROSSED: Final = 1e-6
"""How far inside a reference facet such a point must be."""


_SMALLER: Final = 2.0
_FINEST: Final = 32
"""Facets of a slave over those of its master above which it has more points, and how many times as many at most."""

_OPPOSITE: Final = 0.4
"""Share of its part of the face before the master from which a node must be a contact point: twice that from which it
is one."""


def finer(slave: Facets, master: Facets) -> int:
    """How many times as many points along an edge see all facets of a master that are much smaller."""
    if not len(slave) or not len(master):
        return 1
    return int(np.clip(np.ceil(np.median(slave.radius) / (_SMALLER * np.median(master.radius))), 1, _FINEST))


def opposite_nodes(slave: Facets, master: Facets, node: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Those of some slave nodes (k,) that are before the master and must be contact points, rows of them, (m,), with
    places and unit normals (m, 3); not collective."""
    columns = np.arange(3 if slave.nodes.shape[1] == 6 else slave.nodes.shape[1])
    facet = np.flatnonzero(np.any(np.isin(slave.nodes[:, columns], node), axis=1))
    local, weights, piece = facet_rule(slave.corners, slave.degree, finer(slave, master))
    x, sign = slave.x[facet], slave.sign[facet]
    _, along_r, along_s = facet_functions(slave.corners, slave.degree, local)
    vectors = sign[:, None, None] * np.cross(along_r @ x, along_s @ x)
    there = opposite(slave, master, facet, local, piece)[1].facet.reshape(len(facet), len(local)) >= 0
    hats = facet_functions(slave.corners, 1 if len(columns) == 3 else slave.degree, local)[0]
    sizes = np.linalg.norm(vectors, axis=2) * weights
    sums = np.concatenate(
        [
            np.stack([sizes * there @ hats, sizes @ hats], axis=2),
            np.einsum("fqi,q,qk->fki", vectors, weights, hats),
            x[:, columns],
        ],
        axis=2,
    )  # (f, columns, 8)
    nodes, of_node = slave.nodes[facet][:, columns], np.zeros((len(node), 8))
    f, k = np.nonzero(np.isin(nodes, node))
    row = rows_of(node, nodes[f, k])
    np.add.at(of_node, row, sums[f, k])
    of_node[row, 5:] = sums[f, k, 5:]
    chosen = np.flatnonzero(of_node[:, 0] > _OPPOSITE * of_node[:, 1])
    return chosen, of_node[chosen, 5:], unit_vectors(of_node[chosen, 2:5])
