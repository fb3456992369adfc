"""Where the surface of a body is inside a body, its own or another, at the deformed place, or in a rigid foundation.

A node of the surface that is in a deformed cell that it does not belong to has passed through a facet.  The material
that is now at its place was elsewhere before deformation, at a depth below its own surface: so far has the node got in,
less what it was inside before.  The vector between both places is the motion of the two relative to each other.

The nodes and the edges of all facets are looked at: of an edge the middle of its part in each cell, unless one of its
ends is inside.  Cells and facets of second order count as their pieces with straight edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray, unit_vectors
from ...nearest import tree_of
from ..bodies import Member
from ..geometry import RigidFoundation, on_all_ranks
from ..meshes import Exchange, fetched, owner_of
from .body_boundary import BodyBoundary, Face, boxes_of, depths_below, in_boxes, in_tetrahedra, sides_of
from .facet_patch import mean_normals
from .facing import Facets
from .facing import near as near_facets

Rows = npt.NDArray[Any]

_OF_DEFORMATION: Final = 0.5
"""Relative motions below this part of the deformation of the bodies count as so large: where faces stick or are tied
they hardly move relative to each other.  So what is inside by less than 5 % of the deformation does not count, as nodes
at the edge of a contact face that are opposite to another body by a small part only: 1.3 % under the head of a bolt."""

_AT_REST: Final = 1e-11
"""Relative motions below this part of the largest coordinate are rounding errors."""

_SAME: Final = 1e-6
"""Depths and distances that differ by less than this part are the same."""

_LEAST: Final = 0.05
"""Depths below this part of the relative motion are not worth a word."""

_GOES_ON: Final = 0.7
"""Cosine of the angle between a facet and the normal of the face beside it above which that goes on there."""

_OPPOSED: Final = -0.3
"""Cosine of the angle between the normals of a surface and of a facet below which it can get in there: flush sides of
bodies on each other are not opposed, nor those of the halves of a bolt, whose facets may be aslant to the section."""

_BOXES: Final = 64
"""By which each rank describes where its cells are."""

_AT_ONCE: Final = 100_000
"""Pairs of points and cells treated at once, so that memory stays small."""


@dataclass(frozen=True)
class Overlap:
    """The place where a surface is deepest inside a body or a foundation, relative to the motion there.

    Attributes:
        faces: The face that got in, and the one through which.
        place: Where the node was before deformation, metres.
        depth: How deep it is inside, less what it was before, metres.
        approach: How far the two have moved relative to each other, metres, or what counts as that.
    """

    faces: tuple[str, str]
    place: tuple[float, float, float]
    depth: float
    approach: float


class Sides(NamedTuple):
    """Slave and master of a contact pair or of a tie."""

    slave: Face
    master: Face


class Obstacle(NamedTuple):
    """A rigid foundation before any motion and now, its contact face, the name of that, and the largest gap that is
    given beside the distance, metres."""

    name: str
    face: Face
    before: RigidFoundation
    now: RigidFoundation
    gap: float


class _Worst(NamedTuple):
    """The row of a rank whose depth is largest relative to the approach; these in metres, and its place."""

    place: tuple[float, float, float]
    rank: int
    row: int
    depth: float
    approach: float


class _Now(NamedTuple):
    """The facets of a body that this rank owns, after deformation: the rows at their nodes (f, n, w), and their outward
    vectors (f, 3)."""

    rows: FloatArray
    vectors: FloatArray


class Surface:
    """The boundary facets and the cells of bodies before deformation.

    Args:
        parts: The bodies; nodes are those of one after the other.
        sides: The pairs whose slave nodes something else keeps out of the master, or in their place beside it.
    """

    def __init__(self, parts: Sequence[Member], sides: Sequence[Sides], comm: MPI.Comm):
        self._parts, self._sides, self._comm = parts, sides, comm
        self._ends = np.cumsum([0, *(len(part.body.x) for part in parts)])
        self._bodies = [BodyBoundary.of(part) for part in parts]
        largest = max(float(np.max(np.abs(body.patch.x), initial=0.0)) for body in self._bodies)
        self._rounding = _AT_REST * float(comm.allreduce(largest, op=MPI.MAX))
        slaves, masters = [pair.slave for pair in sides], [pair.master for pair in sides]
        none = np.zeros((self._ends[-1], 0), dtype=bool)
        self._slaves, self._masters = (np.column_stack([none, *map(self._on, faces)]) for faces in (slaves, masters))
        self._normals = np.column_stack([none, *map(self._normals_on, masters)])
        self._under = [[self._under_of(number, faces) for number in range(len(parts))] for faces in (slaves, masters)]

    def _on(self, face: Face) -> BoolArray:
        """Which of this rank's nodes are on a face, shape (k,); collective."""
        part, facets = face
        on: BoolArray = np.zeros(self._ends[-1], dtype=bool)
        on[self._ends[part] + self._parts[part].body.nodes_of(facets)] = True
        return on

    def _under_of(self, number: int, faces: Sequence[Face]) -> BoolArray:
        """Which of this rank's cells of a body are `BodyBoundary.under` each of these faces, shape (c, pairs)."""
        body = self._bodies[number]
        none = np.zeros(len(body.numbers), dtype=bool)
        under = [body.under(facets) if part == number else none for part, facets in faces]
        return np.stack(under, axis=1) if under else none[:, None][:, :0]

    def _normals_on(self, face: Face) -> FloatArray:
        """Mean normals of a face at this rank's nodes, 0 off it, shape (k, 3); collective."""
        part, facets = face
        body, comm, normals = self._bodies[part], self._comm, np.zeros((self._ends[-1], 3))
        on = np.isin(body.facet, facets)
        nodes, vectors = body.patch.nodes[on], body.patch.middle_vectors[on]
        to = Exchange(comm, owner_of(body.starts, nodes.ravel()))
        node, vector = to.send(nodes.ravel()), to.send(np.repeat(vectors, nodes.shape[1], axis=0))
        normals[self._own(part)] = mean_normals(node - body.starts[comm.rank], vector, len(self._parts[part].body.x))
        return normals

    def _own(self, part: int) -> slice:
        """This rank's nodes of a body among those of all."""
        return slice(*self._ends[part : part + 2])

    def _at(self, rows: FloatArray, part: int, numbers: IntArray) -> FloatArray:
        """Rows of all ranks' nodes of a body, at these numbers of nodes there; collective."""
        return fetched(self._comm, self._bodies[part].starts, numbers, rows[self._own(part)])

    def deepest(
        self,
        u: FloatArray,
        component: IntArray,
        deformation: FloatArray,
        judged: Sequence[npt.NDArray[np.integer[Any]]],
        gaps: Sequence[float],
        obstacles: Sequence[Obstacle] = (),
        large: bool = False,
    ) -> Overlap | None:
        """The overlap that is largest relative to the motion there; None if there is none worth a word; collective, the
        same on every rank.

        Args:
            u: Displacement of this rank's nodes, metres, shape (k, 3).
            component: The component of the meshes that each is in, shape (k,).
            deformation: Mean displacement of the forces that deform it, metres, shape (k,).
            judged: Of every pair this rank's slave nodes that are kept out.
            gaps: Of every pair the largest gap that is given beside the distance, metres: by so much its bodies may be
                inside each other.
            large: Whether bodies may have moved far: then relative motions count as at most the deformation.
        """
        kept: BoolArray = np.zeros(self._slaves.shape, dtype=bool)
        for number, nodes in enumerate(judged):
            kept[nodes, number] = True
            part = self._sides[number].slave[0]
            space, own = self._parts[part].body, self._own(part)
            if not space.positive:  # of 10-node tetrahedra the middles of edges beside them as well
                kept[own, number] = space.linear_between_vertices(kept[own, number].astype(np.float64)) > 0.0
        rows = np.column_stack([u, deformation, component, self._slaves * (1.0 + kept), self._masters])
        now = [self._now(rows, part) for part in range(len(self._parts))]
        facets = [
            Facets.of(body.patch, at.rows[:, :, :3], at.rows[:, 0, 4], at.vectors)
            for body, at in zip(self._bodies, now, strict=True)
        ]
        low, high = (_least(np.min(of, axis=0, initial=0.0), self._comm) for of in (u, -u))
        near = near_facets(facets, -2.0 * (low + high), self._comm)
        made = [body.points(k, now[k].rows, near[k], bool(obstacles)) for k, body in enumerate(self._bodies)]
        points = np.concatenate(made)
        candidates = [self._in_bodies(rows, now, points, gaps, large)]
        stopped = self._stopped(component, [obstacle.face for obstacle in obstacles])
        candidates += [self._in_obstacle(points, one, on, large) for one, on in zip(obstacles, stopped, strict=True)]
        return max(candidates, key=lambda one: one.depth / one.approach if one else 0.0)

    def _now(self, rows: FloatArray, part: int) -> _Now:
        patch = self._bodies[part].patch
        at = self._at(rows, part, patch.nodes)
        return _Now(at, replace(patch, x=patch.x + at[:, :, :3]).middle_vectors)

    # --- bodies -------------------------------------------------------------------------------------------------------

    def _in_bodies(
        self, rows: FloatArray, now: Sequence[_Now], points: Rows, gaps: Sequence[float], large: bool
    ) -> Overlap | None:
        """The largest overlap of surfaces with bodies; collective."""
        comm = self._comm
        cells = [self._at(rows[:, :5], part, body.numbers) for part, body in enumerate(self._bodies)]
        points, near = self._sent(points, cells), []
        for part, one in enumerate(now):
            several = len(set().union(*comm.allgather(np.unique(one.rows[:, 0, 4]).tolist()))) > 1
            other = points["part"] != part
            use = points["near"][np.arange(len(points)), other.astype(np.int64)] | (~_edges(points) & (other | several))
            near.append(points[use])
        hits = _once(np.concatenate(comm.allgather(self._inside(near, cells, deformed=True))))
        hits = hits[~(_with_an_end_in(hits) | hits["kept"])]
        if not len(hits):
            return None
        vectors = self._vectors_of(hits, now)
        depth, least, behind = self._depths(hits["was"], hits, vectors, now)
        if not np.any(np.isfinite(depth) & (depth >= _noticed(hits))):
            return None
        kept: BoolArray = np.zeros(len(hits), dtype=bool)
        for part, hit, facet in behind:
            slave, master = sides_of(now[part].rows[facet])
            master |= self._beside_masters(part, facet)
            kept[hit[np.any((hits["slave"][hit] & master) | (hits["master"][hit] & slave), axis=1)]] = True
        kept = ~np.isfinite(depth) | (_least(-1.0 * kept, comm) < 0.0)
        others = [hits[~kept & (hits["inside"] == part)] for part in range(len(now))]
        began = np.concatenate(comm.allgather(_keys(self._inside(others, cells, deformed=False))))
        inside = ~kept & np.isin(_keys(hits), began)
        far = ~inside & (depth > (1.0 + _SAME) * _way(hits) + self._rounding)  # nothing can have got in so far away
        before, depth = np.zeros(len(hits)), np.where(far, least, depth)
        before[inside] = self._depths(hits["x"][inside, 0], hits[inside], vectors[inside], now)[0]
        for pair, gap in zip(self._sides, gaps, strict=True):
            of = np.sort([pair.slave[0], pair.master[0]])
            theirs = np.all(np.sort(np.column_stack([hits["part"], hits["inside"]]), axis=1) == of, axis=1)
            depth = np.where(theirs, depth - max(gap, 0.0), depth)
        depth = np.where(kept, 0.0, np.minimum(depth - np.where(np.isfinite(before), before, 0.0), _way(hits)))
        worst = _worst(depth, _way(hits), hits, large, comm)
        if worst is None:
            return None
        through = [(self._bodies[part], row) for part, hit, facet in behind for row in facet[hit == worst.row]]
        named = [(of.name_of(row), *map(float, of.normal(row))) for of, row in through]  # as near as each other
        face, *normal = min(one for ranks in comm.allgather(named) for one in ranks)
        return self._overlap(hits[worst.row], np.array(normal), face, worst)

    def _overlap(self, point: Rows, normal: FloatArray, through: str, worst: _Worst) -> Overlap:
        """Of a place that has got in through a face with this outward normal; collective."""
        part, named = int(point["part"]), []
        body = self._bodies[part]
        for row in body.facets_with(point["nodes"][None])[1]:
            named.append((round(float(body.normal(row) @ normal), 6), body.name_of(row)))
        _, face = min(one for ranks in self._comm.allgather(named) for one in ranks)
        return Overlap((face, through), worst.place, worst.depth, worst.approach)

    def _vectors_of(self, hits: Rows, now: Sequence[_Now]) -> FloatArray:
        """The outward vectors after deformation of all facets that hits are on, and the mean normal of these, which is
        that of a sharp edge, shape (h, most, 3), 0 where there are fewer; collective."""
        of_points = []
        for part, body in enumerate(self._bodies):
            of = np.flatnonzero(hits["part"] == part)
            point, row = body.facets_with(hits["nodes"][of])
            of_points.append(np.column_stack([of[point], now[part].vectors[row]]))
        every = np.concatenate([one for ranks in self._comm.allgather(of_points) for one in ranks])
        every = every[np.argsort(every[:, 0], kind="stable")]
        hit = every[:, 0].astype(np.int64)
        place = np.arange(len(hit)) - np.searchsorted(hit, hit)
        vectors = np.zeros((len(hits), 2 + int(np.max(place, initial=0)), 3))
        vectors[hit, place] = every[:, 1:]
        vectors[:, -1] = unit_vectors(vectors).sum(axis=1)
        return vectors

    def _beside_masters(self, part: int, facet: IntArray) -> BoolArray:
        """Of which pairs facets of this rank have nodes on the master and go on in its direction, so that contact
        points at the edge of the slave, partly before them, are judged there; shape (f, pairs); collective."""
        patch = self._bodies[part].patch
        n = self._at(self._normals, part, patch.nodes[facet]).sum(axis=1).reshape(len(facet), len(self._sides), 3)
        own = patch.middle_vectors[facet]
        sizes = np.linalg.norm(n, axis=2) * np.linalg.norm(own, axis=1)[:, None]
        return np.asarray((np.einsum("fpi,fi->fp", n, own) > _GOES_ON * sizes) & (sizes > 0.0))

    def _sent(self, points: Rows, cells: Sequence[FloatArray]) -> Rows:
        """The points of all ranks that are near this rank's deformed cells; collective."""
        comm = self._comm
        if comm.size == 1:
            return points
        every = [body.x + of[:, :, :3] for body, of in zip(self._bodies, cells, strict=True)]
        low, high = (np.concatenate(of) for of in zip(*map(boxes_of, every), strict=True))
        order = tree_of(low).indices if len(low) else np.empty(0, dtype=np.int64)  # near ones are near in this order
        groups = [some for some in np.array_split(order, _BOXES) if len(some)]
        mine = np.array([(low[some].min(axis=0), high[some].max(axis=0)) for some in groups]).reshape(-1, 2, 3)
        (first, last), number, to = boxes_of(points["x"] + points["u"]), list[IntArray](), list[IntArray]()
        for rank, boxes in enumerate(comm.allgather(mine)):
            near = np.zeros(len(points), dtype=bool)
            for lowest, highest in boxes:
                near |= np.all((last >= lowest) & (first <= highest), axis=1)
            number.append(np.flatnonzero(near))
            to.append(np.full(len(number[-1]), rank))
        return Exchange(comm, np.concatenate(to)).send(points[np.concatenate(number)])

    def _inside(self, points: Sequence[Rows], cells: Sequence[FloatArray], deformed: bool) -> Rows:
        """The points that are in this rank's cells of each body with which they share no node, with the body, the
        component and the place of the material there, if it has moved relative to them, and whether it can have come
        through a face alone out of which their contact keeps them; before deformation those in the component that they
        have."""
        inside = [points[0][:0]]
        for part, (body, of, these) in enumerate(zip(self._bodies, cells, points, strict=True)):
            if not len(these):
                continue
            places = these["x"] + these["u"] if deformed else these["x"]
            nodes = body.x + of[:, :, :3] if deformed else body.x
            point, cell = in_boxes(boxes_of(places), boxes_of(nodes))
            use = _apart(these[point], body.numbers[cell], part)
            if deformed:
                slaves, masters = (of_cells[part][cell] for of_cells in self._under)
                kept = np.any((these["slave"][point] & masters) | (these["master"][point] & slaves), axis=1)
                use &= ~(kept & _edges(these)[point])
            else:
                use &= of[cell, 0, 4] == these["component"][point]
            for some in np.array_split(np.flatnonzero(use), np.count_nonzero(use) // _AT_ONCE + 1):
                pair, at, weights, columns = in_tetrahedra(places[point[some]], nodes[cell[some]], body.tetrahedra)
                hits, there = these[point[some][pair]], cell[some][pair][:, None]
                if deformed:
                    hits["inside"], hits["component"], hits["at"] = part, of[there[:, 0], 0, 4], np.round(at, 6)
                    hits["was"] = np.einsum("pc,pci->pi", weights, body.x[there, columns])
                    hits["kept"] = kept[some[pair]]
                    hits["deformation"] = np.maximum(hits["deformation"], of[there[:, 0], 0, 3])
                    for name in ("x", "u"):  # of an edge the point that is inside
                        hits[name] += at[:, None, None] * (hits[name][:, 1:] - hits[name][:, :1])
                        hits[name][:, 1] = hits[name][:, 0]
                    hits = hits[_way(hits) > np.maximum(self._rounding, _noticed(hits))]
                inside.append(hits)
        return _once(np.concatenate(inside))

    def _depths(
        self, x: FloatArray, hits: Rows, vectors: FloatArray, now: Sequence[_Now]
    ) -> tuple[FloatArray, FloatArray, list[tuple[int, IntArray, IntArray]]]:
        """Depths of places x (h, 3), in the bodies of hits before deformation, behind facets that are opposed to one
        of those of the hits, with vectors (h, n, 3), and behind any facet, metres, inf where there is none; and of
        bodies hits and the rows of this rank's facets that are so near to the first; collective."""
        comm, near = self._comm, []
        depth, every = np.full((2, len(hits)), np.inf)
        for part, number in np.unique(np.column_stack([hits["inside"], hits["component"]]), axis=0):
            body, at = self._bodies[part], np.flatnonzero((hits["inside"] == part) & (hits["component"] == number))
            use = now[part].rows[:, 0, 4] == number
            nodes = body.patch.x[use].reshape(-1, 3)
            nearest = tree_of(nodes).query(x[at])[0] if len(nodes) else np.full(len(at), np.inf)
            most = (1.0 + _SAME) * np.maximum(_way(hits[at]), _least(nearest, comm)) + self._rounding
            some = np.flatnonzero(use[body.row])
            hit, distance, row = depths_below(x[at], most, body.triangles[some], body.row[some])
            least: FloatArray = np.full(len(at), np.inf)
            np.minimum.at(least, hit, distance)
            every[at] = _least(least, comm)
            against, vector = vectors[at[hit]], now[part].vectors[row]
            sizes = np.linalg.norm(against, axis=2) * np.linalg.norm(vector, axis=1)[:, None]
            opposed = np.any(np.einsum("pni,pi->pn", against, vector) < _OPPOSED * sizes, axis=1)
            hit, distance, row = hit[opposed], distance[opposed], row[opposed]
            least = np.full(len(at), np.inf)
            np.minimum.at(least, hit, distance)
            least = depth[at] = _least(least, comm)
            same = distance <= (1.0 + _SAME) * least[hit] + self._rounding
            near.append((int(part), at[hit[same]], row[same]))
        return depth, every, near

    # --- foundations --------------------------------------------------------------------------------------------------

    def _stopped(self, component: IntArray, faces: Sequence[Face]) -> list[BoolArray]:
        """Which of this rank's nodes the foundations of contact faces can stop: those of the face's component, and of
        those that pairs and ties join with it and that have no foundation themselves.  A plane has no end, where the
        machine stands that is beside; collective."""

        def components(*of: Face) -> set[int]:
            here = {int(number) for face in of for number in component[self._on(face)]}
            return set().union(*self._comm.allgather(here))

        joined, own = [components(*pair) for pair in self._sides], [components(face) for face in faces]
        stopped = []
        for one in own:
            reached = set(one)
            for _ in joined:
                reached = reached.union(*(pair for pair in joined if pair & reached))
            stopped.append(np.isin(component, list(one | reached.difference(*own))))
        return stopped

    def _in_obstacle(self, points: Rows, one: Obstacle, stopped: BoolArray, large: bool) -> Overlap | None:
        """The largest overlap with a rigid foundation of what began outside of it, beside its contact face, of nodes
        that it can stop, shape (k,); None where it has no signed distance; collective."""
        comm, rows, on = self._comm, (self._on(one.face) | ~stopped).astype(np.float64), list[BoolArray]()
        for part in range(len(self._parts)):
            on.append(np.any(self._at(rows, part, points["nodes"][points["part"] == part]) > 0.0, axis=1))
        beside = points[~np.concatenate(on)]

        def distances() -> tuple[FloatArray, FloatArray]:
            x, y = beside["x"].mean(axis=1), (beside["x"] + beside["u"]).mean(axis=1)
            if not len(y):
                return np.zeros(0), np.zeros(0)
            return np.asarray(one.before.signed_distance(x)), np.asarray(one.now.signed_distance(y))

        try:
            before, now = (of + max(one.gap, 0.0) for of in on_all_ranks(distances, "", comm))
        except ValueError:
            return None
        in_ = (before >= -self._rounding) & (now < -self._rounding)
        worst = _worst(-now[in_], (before - now)[in_], beside[in_], large, comm)
        if worst is None:
            return None
        point = comm.bcast(beside[in_][worst.row] if comm.rank == worst.rank else None, root=worst.rank)
        outward = on_all_ranks(lambda: one.now.normal((point["x"] + point["u"]).mean(axis=0)[None])[0], "", comm)
        return self._overlap(point, outward, f"the foundation of contact face {one.name}", worst)


def _keys(hits: Rows) -> Rows:
    """What tells hits apart, shape (h,)."""
    places = np.rint(1e6 * hits["at"])
    keys = np.column_stack([hits["part"], hits["nodes"], hits["inside"], hits["component"], places]).astype(np.int64)
    return np.ascontiguousarray(keys).view([("", np.int64)] * keys.shape[1]).ravel()


def _once(hits: Rows) -> Rows:
    """The hits without repetition, in the same order on every rank that has the same."""
    return hits[np.unique(_keys(hits), return_index=True)[1]]


def _apart(points: Rows, numbers: IntArray, part: int) -> BoolArray:
    """Which points (p,) have no node in common with the cell or facet of a body of these numbers (p, n)."""
    apart: BoolArray = points["part"] != part
    mine = np.flatnonzero(~apart)
    nodes = points["nodes"][mine]
    apart[mine] = ~np.any(nodes[:, :, None] == numbers[mine, None], axis=(1, 2))
    return apart


def _edges(points: Rows) -> BoolArray:
    """Which of nodes and edges are edges."""
    return np.asarray(points["nodes"][:, 0] != points["nodes"][:, 1])


def _with_an_end_in(hits: Rows) -> BoolArray:
    """Which of the hits are of edges of which a hit in the same component is an end, shape (h,)."""
    ends_in, ends = np.zeros(len(hits), dtype=bool), hits.copy()
    ends["at"] = 0.5
    for column in hits["nodes"].T:
        ends["nodes"] = column[:, None]
        ends_in |= np.isin(_keys(ends), _keys(hits))
    return ends_in & _edges(hits)


def _least(values: FloatArray, comm: MPI.Comm) -> FloatArray:
    """The least of all ranks, entry by entry; collective."""
    least = np.array(values, dtype=np.float64)
    comm.Allreduce(MPI.IN_PLACE, least, op=MPI.MIN)
    return least


def _way(hits: Rows) -> FloatArray:
    """How far hits and the material at their place have moved relative to each other, metres, shape (h,)."""
    return np.linalg.norm(hits["was"] - hits["x"][:, 0], axis=1)


def _noticed(hits: Rows) -> FloatArray:
    """Depths and relative motions of hits up to which they are not worth a word, metres, shape (h,)."""
    return np.asarray(_LEAST * _OF_DEFORMATION * hits["deformation"])


def _worst(depth: FloatArray, way: FloatArray, points: Rows, large: bool, comm: MPI.Comm) -> _Worst | None:
    """The row, on any rank, with the largest depth relative to the approach, by depths and relative motions in metres,
    shape (p,): of equal ones that with the smallest x, then y, then z; None below `_LEAST`; collective."""
    size = points["deformation"]
    most = np.where(size > 0.0, size, np.inf) if large else np.inf
    approach = np.maximum(np.minimum(way, most), _OF_DEFORMATION * size)
    value = depth / np.maximum(approach, 1e-300)
    largest = float(comm.allreduce(float(np.max(value, initial=0.0)), op=MPI.MAX))
    if largest < _LEAST:
        return None
    candidates = []
    for k in np.flatnonzero(value >= (1.0 - _SAME) * largest):
        x, y, z = map(float, points["x"][k].mean(axis=0))
        candidates.append(_Worst((x, y, z), comm.rank, int(k), float(depth[k]), float(approach[k])))
    return min(one for ranks in comm.allgather(sorted(candidates)[:1]) for one in ranks)
