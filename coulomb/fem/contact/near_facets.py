"""The facets of a pair of faces that a rank needs: those around its slave nodes, and the master facets before these.

A rank's contact points depend on the facets around its nodes (`mortar.RINGS` rings of them), which it finds ring by
ring from the ranks that own the nodes, and on the master facets that lines along the slave's normals meet.  For these
every rank describes its slave facets by few cones, and the others send what is within one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from ...nearest import tree_of
from ..bodies import DisplacementSpace
from ..meshes import Exchange, bounds, fetched, owner_of, starts_of
from .facet_patch import FacetKind, FacetPatch, facet_patch, mean_normals
from .mortar import RINGS, Search, search_of
from .mortar_parts import FACING, Cells, Most, cells_of

_STEPS: Final = 4
"""Intervals between the first places along an edge."""

_HALVINGS: Final = 8
"""Of the distance between places around the lowest one: an obstacle of a tenth of a facet is found to 1e-4 of it."""


_ON: Final = 0.1
"""Part of the chord by which nodes may be off a foundation on which they are."""


@dataclass(frozen=True, eq=False)
class FaceSamples:
    """The f facets of a face that this rank owns.

    Attributes:
        kind: Triangles or quadrilaterals, of first or second order.
        x: Their nodes, metres, shape (f, n, 3).
        u: The displacements of these, metres, shape (f, n, 3).
        chord: How far the facets are from the smooth face for which they may stand, metres, shape (f,): of first order
            h^2/(8 R), of second order with the square of that over the facet's diameter as a bound.
        middle: The middles of the smooth faces, metres, shape (f, 3).
        nodal: Whether the corners are contact points, if the face can touch there.
    """

    kind: FacetKind
    x: FloatArray
    u: FloatArray
    chord: FloatArray
    middle: FloatArray
    nodal: bool

    @property
    def corners(self) -> FloatArray:
        """Corners of the facets, metres, shape (f, c, 3)."""
        return self.x[:, : self.kind.corners]

    def bend(self, distance: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """How far a distance, a function of places (k, 3) in metres, in the middles of the smooth faces is from the
        mean of those at the corners, before deformation: about h^2/(8 R), R of the gap; shape (f,)."""
        means = distance(self.corners.reshape(-1, 3)).reshape(len(self.x), self.kind.corners).mean(axis=1)
        smooth = distance(self.middle) - means
        bend: FloatArray = np.abs(smooth)
        if self.kind.degree == 1:  # at the ends of a face its own bend is known to a third only
            flat = distance(self.corners.mean(axis=1)) - means
            shared = (flat * smooth > 0.0) & (bend < np.abs(flat))
            bend = np.where(shared, np.maximum(bend - 2.0 * np.abs(flat - smooth), 0.0), bend)
        return bend

    def spread(self, distance: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """By how much a distance, a function of places (k, 3) in metres, differs between the nodes of each facet before
        deformation, shape (f,)."""
        return np.ptp(distance(self.x.reshape(-1, 3)).reshape(self.x.shape[:2]), axis=1)

    def chord_on(self, distance: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """The chord in metres of facets whose nodes are on a foundation by its distance, a function of places (k, 3) in
        metres: these stand for a face of its curvature, though one facet alone does not show it; else `chord`; (f,)."""
        on_nodes = distance(self.x.reshape(-1, 3)).reshape(self.x.shape[:2])
        off = np.abs(distance(self.corners.mean(axis=1)) - on_nodes.mean(axis=1))
        return np.where(np.max(np.abs(on_nodes), axis=1) <= _ON * off, np.maximum(self.chord, off), self.chord)

    def least(self, which: BoolArray, distance: Callable[[FloatArray], FloatArray], given: FloatArray) -> FloatArray:
        """The least in some facets, shape (f,), of a distance, a function of places (k, 3) after deformation, and what
        is given beside it at the corners of all facets, shape (all, c), linear between them; metres."""
        x, u = self.x[which], self.u[which]
        on_nodes = given[which] @ self.kind.vertex_functions
        step = 1.0 / _STEPS
        along = np.arange(_STEPS + 1) * step
        offsets = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        grid = np.array([(i, j) for i in along for j in along])
        local: FloatArray = np.broadcast_to(grid, (len(x), *grid.shape))
        for _ in range(_HALVINGS + 1):
            if self.kind.corners == 3:
                local = local / np.maximum(local.sum(axis=2), 1.0)[:, :, None]
            functions = np.stack(self.kind.values(local[..., 0], local[..., 1]))
            before, way = (np.einsum("nfq,fni->fqi", functions, of) for of in (x, u))
            values = distance((before + way).reshape(-1, 3)).reshape(local.shape[:2])
            if np.any(given):
                values = values + np.einsum("nfq,fn->fq", functions, on_nodes)
            best = np.argmin(values, axis=1)[:, None]
            step *= 0.5
            local = np.clip(np.take_along_axis(local, best[:, :, None], axis=1) + step * offsets, 0.0, 1.0)
        return np.take_along_axis(values, best, axis=1)[:, 0]


def face_samples(space: DisplacementSpace, facets: Int32Array, u: FloatArray) -> FaceSamples:
    """The facets of a face with displacements u (k, 3) of this rank's nodes in metres; collective."""
    patch, comm = facet_patch(space, facets), space.comm
    kind, starts = patch.kind, starts_of(comm, space.numbering.local)
    moved = fetched(comm, starts, patch.nodes, u)
    middle = np.stack(kind.values(*kind.points[: kind.corners].mean(axis=0)[:, None]))[:, 0] @ patch.x
    if kind.degree == 1:
        bulges = patch.bulges_with(normals_at_nodes(patch, starts, comm))
        chord, middle = np.linalg.norm(bulges, axis=1), middle + bulges
    else:
        straight = np.einsum("jn,fji->fni", kind.vertex_functions, patch.x[:, : kind.corners])
        off = np.linalg.norm(patch.x - straight, axis=2).max(axis=1, initial=0.0)
        chord = off**2 / patch.diameters
    return FaceSamples(kind, patch.x, moved, chord, middle, space.positive)


Rows = npt.NDArray[Any]

_CONES: Final = 64
"""By which each rank describes its slave facets."""

_SAMPLES: Final = 256
"""Places in all from which the distance of the two faces is estimated first."""


@dataclass(frozen=True, eq=False)
class NearFace:
    """Facets of one face, of any ranks, with numbers of their nodes among themselves.

    Attributes:
        patch: The facets, in the order of the ranks; `size` is the number of nodes here.
        numbers: Global numbers of these nodes, ascending, shape (patch.size,).
        bulges: Of the facets (`FacetPatch.bulges`), shape (f, 3).
        largest_bulge: The length of the largest of all facets of the face, metres.
    """

    patch: FacetPatch
    numbers: IntArray
    bulges: FloatArray
    largest_bulge: float


@dataclass(frozen=True)
class NearPair:
    """What a rank needs of a pair of faces.

    Attributes:
        slave: The facets around this rank's nodes.
        master: The facets before these.
        owned: First of this rank's nodes among the numbers of `slave`, and the one after the last.
        size: Largest coordinate of the slave face, metres.
        extent: Its largest extent along an axis, metres.
        most: The largest of all ranks of values at the master's nodes here, shape (nodes, d); collective; None on one.
    """

    slave: NearFace
    master: NearFace
    owned: tuple[int, int]
    search: Search | None
    size: float
    extent: float
    most: Most | None = None


def near_pair(
    slave: FacetPatch, master: FacetPatch, nodes: tuple[int, int], comm: MPI.Comm, deepest: float = np.inf
) -> NearPair:
    """What this rank needs of a pair, of the facets and numbers of nodes that it has of the slave and of the master,
    with penetrations up to the deepest in metres; collective."""
    ends = [bounds(comm, patch.x.reshape(-1, 3)) for patch in (slave, master)]
    size = float(np.max(np.abs(ends[0]), initial=0.0, where=np.isfinite(ends[0])))
    extents = [high - low if np.all(np.isfinite(low)) else np.zeros(3) for low, high in ends]
    starts = [starts_of(comm, count) for count in nodes]
    first = int(starts[0][comm.rank])
    if comm.size == 1:
        search = search_of(slave, master, deepest) if len(slave) and len(master) else None
        both = whole_face(slave), whole_face(master)
        return NearPair(both[0], both[1], (0, nodes[0]), search, size, float(np.max(extents[0])))
    one, other = (_rows_with_bulges(patch, at, comm) for patch, at in zip((slave, master), starts, strict=True))
    largest = [float(comm.allreduce(_length(rows["bulge"]), op=MPI.MAX)) for rows in (one, other)]
    around = _face_of_rows(slave, _around(one, starts[0], comm), largest[0])
    counts = [comm.allreduce(len(patch)) for patch in (slave, master)]
    search = None
    there = other[:0]
    if all(counts):
        lengths = [float(np.linalg.norm(extent)) for extent in extents]
        search = Search.of(_distance(slave, master, comm), lengths, deepest)
        there = _before(around.patch, master, other, search, comm)
    own = np.searchsorted(around.numbers, [first, first + nodes[0]])
    extent = float(np.max(extents[0]))
    opposite = _face_of_rows(master, there, largest[1])

    def most(values: FloatArray) -> FloatArray:
        to = Exchange(comm, owner_of(starts[1], opposite.numbers))
        node, rows = to.send(opposite.numbers) - starts[1][comm.rank], to.send(values)
        largest = np.full((nodes[1], values.shape[1]), -np.inf)
        np.maximum.at(largest, node, rows)
        return to.reply(largest[node])

    return NearPair(around, opposite, (int(own[0]), int(own[1])), search, size, extent, most)


def whole_face(patch: FacetPatch) -> NearFace:
    """All facets of a face that is on one rank."""
    return NearFace(patch, np.arange(patch.size), patch.bulges, _length(patch.bulges))


def _length(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


def _face_of_rows(like: FacetPatch, rows: Rows, largest: float) -> NearFace:
    """Facets with numbers of nodes among themselves."""
    numbers, inverse = np.unique(rows["nodes"], return_inverse=True)
    nodes = inverse.reshape(rows["nodes"].shape).astype(np.int64)
    curved = None if like.curved is None else rows["curved"].copy()
    patch = FacetPatch(like.kind, nodes, rows["x"].copy(), len(numbers), curved)
    return NearFace(patch, numbers, rows["bulge"].copy(), largest)


def _rows_with_bulges(patch: FacetPatch, starts: IntArray, comm: MPI.Comm) -> Rows:
    """This rank's facets as rows, with their number over all ranks and their bulges; collective."""
    width = patch.kind.width
    kinds = [("key", "i8"), ("bulge", "f8", (3,)), ("nodes", "i8", (width,)), ("x", "f8", (width, 3))]
    if patch.curved is not None:
        kinds.append(("curved", "f8", (patch.second_order.width, 3)))
    rows = np.zeros(len(patch), dtype=kinds)
    rows["key"] = starts_of(comm, len(patch))[comm.rank] + np.arange(len(patch))
    rows["nodes"], rows["x"] = patch.nodes, patch.x
    if patch.curved is not None:
        rows["curved"] = patch.curved
    elif patch.kind.degree == 1:
        rows["bulge"] = patch.bulges_with(normals_at_nodes(patch, starts, comm))
    return rows


def normals_at_nodes(patch: FacetPatch, starts: IntArray, comm: MPI.Comm) -> FloatArray:
    """`mean_normals` of the facets of all ranks at the nodes of each, shape (f, n, 3);
    `starts` are those of the nodes; collective."""
    nodes = patch.nodes.ravel()
    to = Exchange(comm, owner_of(starts, nodes))
    node = to.send(nodes) - starts[comm.rank]
    vectors = to.send(np.repeat(patch.middle_vectors, patch.kind.width, axis=0))
    normals = mean_normals(node, vectors, int(starts[comm.rank + 1] - starts[comm.rank]))
    return fetched(comm, starts, nodes, normals).reshape(-1, patch.kind.width, 3)


def _around(rows: Rows, starts: IntArray, comm: MPI.Comm) -> Rows:
    """The facets in `RINGS` rings around those with nodes of this rank, ascending; collective."""
    facet, owner = _distinct_pairs(np.arange(len(rows)), owner_of(starts, rows["nodes"]))
    table = Exchange(comm, owner).send(rows[facet])  # all facets with a node of this rank
    first, last = starts[comm.rank], starts[comm.rank + 1]
    mine = np.flatnonzero((table["nodes"].ravel() >= first) & (table["nodes"].ravel() < last))
    order = mine[np.argsort(table["nodes"].ravel()[mine], kind="stable")]
    node, of_node = table["nodes"].ravel()[order], order // table["nodes"].shape[1]
    around, asked = table, np.empty(0, dtype=np.int64)
    for _ in range(RINGS):
        seen = np.unique(around["nodes"])
        seen = seen[(seen < first) | (seen >= last)]
        new, asked = np.setdiff1d(seen, asked), seen
        ask = Exchange(comm, owner_of(starts, new))
        wanted = ask.send(new)
        begin, end = np.searchsorted(node, wanted), np.searchsorted(node, wanted, side="right")
        count = end - begin
        at = np.arange(int(count.sum())) + np.repeat(begin - np.cumsum(count) + count, count)
        facet, source = _distinct_pairs(of_node[at], np.repeat(ask.sources, count)[:, None])
        more = Exchange(comm, source).send(table[facet])
        _, once = np.unique(np.concatenate([around["key"], more["key"]]), return_index=True)
        around = np.concatenate([around, more])[once]
    return around


def _distinct_pairs(facet: IntArray, ranks: IntArray) -> tuple[IntArray, IntArray]:
    """Facets (f,) and the ranks in each row (f, k), every pair once, ascending."""
    pairs = np.unique(np.column_stack([np.repeat(facet, ranks.shape[1]), ranks.ravel()]), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _before(near: FacetPatch, master: FacetPatch, rows: Rows, search: Search, comm: MPI.Comm) -> Rows:
    """The master facets of all ranks that may be before the slave facets near, ascending; collective."""
    cones, others = _cones(near), cells_of(master)
    every = comm.allgather(cones)
    rank_of, cone = np.repeat(np.arange(comm.size), [len(theirs) for theirs in every]), np.concatenate(every)
    pairs = np.empty((0, 2), dtype=np.int64)
    if len(others.facet):
        direction = others.area_vector / np.maximum(others.area, 1e-300)[:, None]
        centre, radius = _sphere(others.centre, others.radius)
        by_rank = []
        for number in np.flatnonzero(_meets(centre, np.array(radius), cone, search)):
            axis, angle = cone[number, 4:7], cone[number, 7]
            hit = _meets(others.centre, others.radius, cone[number], search)
            hit &= np.arccos(np.clip(direction @ axis, -1.0, 1.0)) > np.arccos(FACING) - angle - 1e-6
            facet = np.unique(others.facet[hit])
            by_rank.append(np.column_stack([np.full(len(facet), rank_of[number]), facet]))
        pairs = np.unique(np.concatenate([pairs, *by_rank]), axis=0)
    there = Exchange(comm, pairs[:, 0]).send(rows[pairs[:, 1]])
    return there[np.argsort(there["key"])]


def _meets(centre: FloatArray, around: FloatArray, cone: FloatArray, search: Search) -> BoolArray:
    """Whether lines of a cone can meet spheres with these centres (..., 3) and radii (...).

    The lines begin within the cone's radius of its point, go `search.reach` along its axis or a direction that differs
    from it by up to its angle, and as far as `search.depth` behind.
    """
    point, axis, angle = cone[..., :3], cone[..., 4:7], cone[..., 7]
    near = (1.0 + 1e-6) * (cone[..., 3] + 2.0 * around)
    away = centre - point
    along = np.sum(away * axis, axis=-1)
    across = np.linalg.norm(away - along[..., None] * axis, axis=-1)
    wide = np.linalg.norm(away, axis=-1) <= max(search.depth, search.reach) + near
    within = across <= near + (np.abs(along) + near) * np.tan(np.minimum(angle, 1.2))
    within &= (along >= -search.depth - near) & (along <= search.reach + near)
    return np.where(angle > 1.2, wide, within)


def _cones(patch: FacetPatch) -> FloatArray:
    """Centre, radius, mean normal and largest angle to it of groups of neighbouring facets, shape (at most 64, 8)."""
    cells = cells_of(patch)
    if not len(cells.facet):
        return np.empty((0, 8))
    return np.array([_cone(cells, some) for some in _groups(cells.centre)])


def _groups(x: FloatArray) -> list[IntArray]:
    """Numbers of neighbouring points, in at most 64 groups."""
    order = tree_of(x, 8).indices.astype(np.int64)  # near ones are near in this order
    return [some for some in np.array_split(order, _CONES) if len(some)]


def _cone(cells: Cells, some: IntArray) -> list[float]:
    centre, radius = _sphere(cells.centre[some], cells.radius[some])
    n = cells.frames[some, 2]
    axis = n.sum(axis=0)
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 0.0 else n[0]
    angle = float(np.arccos(np.clip(np.min(n @ axis), -1.0, 1.0)))
    return [*centre, radius, *axis, angle + 1e-7]


def _sphere(centre: FloatArray, radius: FloatArray) -> tuple[FloatArray, float]:
    """Centre and radius of a sphere around spheres."""
    middle = 0.5 * (centre.min(axis=0) + centre.max(axis=0))
    return middle, float(np.max(np.linalg.norm(centre - middle, axis=1) + radius))


def _distance(slave: FacetPatch, master: FacetPatch, comm: MPI.Comm) -> float:
    """Least distance between the middles of facets of the two faces, metres; collective.

    From some places on the slave at first; then only the master's facets as near to the slave's are compared.
    """
    x, there = slave.x.mean(axis=1), master.x.mean(axis=1)
    few = np.concatenate(comm.allgather(x[:: max(1, len(x) * comm.size // _SAMPLES)]))
    tree = tree_of(there) if len(there) else None
    nearest = tree.query(few)[0].min() if tree is not None else np.inf
    bound = float(comm.allreduce(float(nearest), op=MPI.MIN))
    groups = _groups(x) if len(x) else []
    spheres = np.array([[*(found := _sphere(x[some], np.zeros(1)))[0], found[1]] for some in groups]).reshape(-1, 4)
    chosen, ranks = [], []
    for rank, theirs in enumerate(comm.allgather(spheres)):
        near = np.zeros(len(there), dtype=bool)
        if tree is not None:
            for *centre, radius in theirs:
                near[tree.query_ball_point(centre, (1.0 + 1e-9) * (radius + bound))] = True
        chosen.append(np.flatnonzero(near))
        ranks.append(np.full(len(chosen[-1]), rank))
    beside = Exchange(comm, np.concatenate(ranks)).send(there[np.concatenate(chosen)])
    mine = float(np.min(tree_of(beside).query(x)[0], initial=bound)) if len(beside) and len(x) else bound
    return float(comm.allreduce(mine, op=MPI.MIN))
