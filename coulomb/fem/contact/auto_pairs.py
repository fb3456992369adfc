"""Pairs of faces that face each other, found by lines along the normals of the outer facets of all bodies.

From sixteen points of every outer facet of a body a line goes along its normal, before and behind it; the nearest facet
that it meets within the distance, and that faces it, is opposite to the point.  What is behind another facet is hidden
by it: the outer sheets of a stack do not face each other through the inner one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, is_number
from ...units import amount
from .. import compat
from ..bodies import DisplacementSpace, mesh_components
from ..geometry import on_all_ranks
from ..meshes import SEPARATOR, JoinedMesh, NamedMesh, boundary_facets, fetched, starts_of
from .facet_patch import FacetKind, facet_patch, functions_at
from .mortar_parts import FACING, Cells
from .sheets import goes_on, sheets_of

_LINES: Final = 4
"""Points along an edge of a facet."""

_SAME: Final = 1e-9
"""Distances that differ by less than this part of the extent of all bodies are the same."""

_AT_ONCE: Final = 1000
"""Facets treated at once, so that memory stays small."""


@dataclass(frozen=True)
class FoundPair:
    """Two faces that face each other.

    Attributes:
        face: Name of the one, of the earlier body, or named earlier there.
        against: Name of the other.
        area: Of what faces the other within the distance, by the points of the finer face, m^2.
        gap: The smallest and the largest distance there along the normals, metres; negative where they overlap.
        bodies: The bodies of both; of meshes with several components these, "" for a mesh that is one.
        groups: The cell groups of the bodies or components, "" where not all cells are in one.
    """

    face: str
    against: str
    area: float
    gap: tuple[float, float]
    bodies: tuple[str, str]
    groups: tuple[str, str]

    def __str__(self) -> str:
        low, high = self.gap
        return f"{self.face!r} and {self.against!r}: {amount(self.area, 'm²')}, gap {amount(low)} to {amount(high)}"


@dataclass(frozen=True)
class FoundPairs:
    """The pairs of faces of a mesh within a distance, and the mesh with the faces that were made for them.

    Attributes:
        mesh: The given mesh; where facets without a name face another body, they are a face of it now.
        pairs: In the order of the bodies and their faces.
        made: Names of the faces that were made.
    """

    mesh: NamedMesh | JoinedMesh
    pairs: tuple[FoundPair, ...]
    made: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join(map(str, self.pairs))


def auto_pairs(mesh: NamedMesh | JoinedMesh, distance: float) -> FoundPairs:
    """All pairs of faces of different bodies, or components of a mesh, that face each other within a distance;
    collective, the same on any number of ranks.

    Facets with a name stand for the whole face of this name, of several for that with fewest facets.  Facets without a
    name that face another body become a face, "lug:facing_pin"; in a mesh with several components "lug_facing_pin" by
    the groups of their cells, without groups "part_1_facing_part_2", numbered by their smallest x, then y, then z.  Two
    sides of one component with a gap between them, as of a slot, are a pair as well; the one without a name becomes
    "facing_jaw" by the other's.  If both have none, or one name, they become the faces "facing_itself_1",
    "facing_itself_2", each as far as it goes on without an edge.  Facets with a common node do not face each other.

    What is outside of all bodies is gathered on every rank: the facets, no cells.

    Args:
        mesh: Of one body with components that share no node, or of several bodies (`join`).
        distance: Largest gap and largest overlap, metres, along the normals of the undeformed facets.

    Returns:
        The pairs, and the mesh that has their faces: `ContactProblem(found.mesh, ..., contact=[Contact(pair.face,
        friction=0.2, against=pair.against) for pair in found.pairs])`.

    Raises:
        ValueError: On every rank, if the distance is not positive, or nothing is within it, with the smallest distance;
            if a second-order facet is folded.
    """
    if not is_number(distance) or distance <= 0.0:
        raise ValueError(f"auto_pairs: distance must be a number of metres > 0, but is {distance!r}")
    if not isinstance(mesh, NamedMesh | JoinedMesh):
        raise ValueError(f"auto_pairs: takes a mesh, or what coulomb.join makes of several, not {mesh!r}")
    given = mesh.bodies if isinstance(mesh, JoinedMesh) else {"": mesh}
    bodies = [_OuterFacets.of(one) for one in given.values()]
    every = _Names(given, [body.groups for body in bodies], mesh.comm)
    sheets = _sheets(every, bodies, distance)
    if sheets:
        given = {name: replace(one, faces={**one.faces}) for name, one in given.items()}
        for body, own, sheet in sheets:
            list(given.values())[body].faces[own] = bodies[body].numbered(sheet)
        bodies = [of.with_faces(one) for of, one in zip(bodies, given.values(), strict=True)]
        every = _Names(given, [body.groups for body in bodies], mesh.comm)
    opposite, facets = _opposite(every, bodies, distance)
    if not opposite:
        raise ValueError(_nothing(every, bodies, distance))
    pairs: dict[frozenset[str], FoundPair] = {}
    made: dict[tuple[int, str], list[IntArray]] = {}
    for first, second, area, low, high in opposite:
        sides = (first, second)
        same = every.side(first)[::2] == every.side(second)[::2]  # one name for faces of two components
        named = []
        for side, against in (sides, sides[::-1]):
            body, _, face = every.side(side)
            if face and not same:
                named.append(every.called(body, face))
                continue
            own = every.facing(side, against)
            of_side = (facets[:, 0] == side) & (facets[:, 1] == against)
            made.setdefault((body, own), []).append(facets[of_side, 2])
            named.append(every.called(body, own))
        known = pairs.get(frozenset(named))
        if known is not None:
            area, low, high = known.area + area, min(known.gap[0], low), max(known.gap[1], high)
            pairs[frozenset(named)] = replace(known, area=area, gap=(low, high))
        else:
            of, groups = ((words(first), words(second)) for words in (every.part, every.group))
            pairs[frozenset(named)] = FoundPair(named[0], named[1], area, (low, high), of, groups)
    with_faces = list(given.values())
    for (body, own), keys in made.items():
        before_it = with_faces[body]
        with_faces[body] = replace(
            before_it, faces={**before_it.faces, own: bodies[body].numbered(np.concatenate(keys))}
        )
    with_all = JoinedMesh(dict(zip(given, with_faces, strict=True))) if given.keys() != {""} else with_faces[0]
    names = [every.called(body, own) for body, own in (*(one[:2] for one in sheets), *made)]
    return FoundPairs(with_all, tuple(pairs.values()), tuple(names))


class _OuterFacets(NamedTuple):
    """The outer facets of a body that this rank owns.

    Attributes:
        x: Their nodes, metres, shape (f, n, 3).
        cells: Their polygons, of second order four of each.
        points: The points of the lines from each polygon, on the facet, metres, shape (c, 16, 3).
        facet: Facet numbers of the mesh, ascending, shape (f,).
        key: Their numbers over all ranks, shape (f,).
        nodes: Numbers over all ranks of their corners, shape (f, 3 or 4).
        component: The component of the mesh of each, shape (f,).
        face: The number of the named face of each, from 1; 0 without a name; shape (f,).
        groups: The group that has all cells of each component, the smallest of several; "" without.
    """

    kind: FacetKind
    x: FloatArray
    cells: Cells
    points: FloatArray
    facet: Int32Array
    key: IntArray
    nodes: IntArray
    component: IntArray
    face: IntArray
    groups: list[str]

    @classmethod
    def of(cls, mesh: NamedMesh) -> _OuterFacets:
        domain, comm = mesh.domain, mesh.comm
        space = DisplacementSpace(compat.functionspace(domain, mesh.degree, (3,)))
        outer = boundary_facets(domain)
        facet = outer[outer < domain.topology.index_map(2).size_local]
        patch = facet_patch(space, facet)
        cells = compat.cell_dofs(space.V)[: domain.topology.index_map(3).size_local, 0]
        in_cells = space.global_numbers(cells)
        starts, of_nodes = starts_of(comm, space.numbering.local), mesh_components(space)
        component, of_cells = (fetched(comm, starts, nodes, of_nodes) for nodes in (patch.nodes[:, 0], in_cells))
        kind, pieces = patch.kind, patch.kind.pieces
        corners = patch.x[:, pieces].reshape(-1, kind.corners, 3)
        start = np.tile(kind.points[pieces].mean(axis=1), (len(facet), 1))
        polygons = Cells(np.repeat(np.arange(len(facet)), len(pieces)), corners, start)
        r, s = np.moveaxis(_points(kind.corners) @ kind.points[pieces], 2, 0)
        points = np.einsum("npq,fni->fpqi", np.stack(kind.values(r, s)), patch.x).reshape(-1, r.shape[1], 3)
        key = starts_of(comm, len(facet))[comm.rank] + np.arange(len(facet))
        nodes, face = patch.nodes[:, : kind.corners], np.zeros(len(facet), dtype=np.int64)
        groups = _groups(mesh, of_cells)
        return cls(kind, patch.x, polygons, points, facet, key, nodes, component, face, groups).with_faces(mesh)

    def with_faces(self, mesh: NamedMesh) -> _OuterFacets:
        """The same with the named faces of a mesh; collective."""
        sizes = [mesh.comm.allreduce(int(np.isin(self.facet, own).sum())) for own in mesh.faces.values()]
        face = np.zeros(len(self.facet), dtype=np.int64)
        for which in np.argsort(sizes, kind="stable")[::-1]:  # the smallest last
            face[np.isin(self.facet, list(mesh.faces.values())[which])] = which + 1
        return self._replace(face=face)

    def numbered(self, keys: IntArray) -> Int32Array:
        """This rank's facets among those with these numbers over all ranks."""
        return self.facet[np.isin(self.key, keys)]


def _groups(mesh: NamedMesh, component: IntArray) -> list[str]:
    """For each component of a mesh, of which this rank's own cells are in these (c,), the smallest of the groups that
    have all of its cells; "" without; collective."""
    count = 1 + mesh.comm.allreduce(int(np.max(component, initial=0)), op=MPI.MAX)

    def sizes(of: IntArray) -> IntArray:
        return mesh.comm.allreduce(np.bincount(of, minlength=count))

    inside = {name: sizes(component[cells]) for name, cells in mesh.cells.items()}
    whole, named = sizes(component), [""] * count
    for name, cells in sorted(inside.items(), key=lambda group: -int(group[1].sum())):
        named = [name if full else before for full, before in zip(cells == whole, named, strict=True)]
    return named


class _Names:
    """Numbers of sides, of which each has one face of one component of a body, or its facets without a name."""

    def __init__(self, meshes: dict[str, NamedMesh], groups: list[list[str]], comm: MPI.Comm):
        self.comm = comm
        self._bodies, self._groups = list(meshes), groups
        self._faces = [("", *mesh.faces) for mesh in meshes.values()]
        self._first = np.concatenate([[0], np.cumsum([len(of) for of in groups])])
        self.width = max(map(len, self._faces))

    def sides(self, body: int, of: _OuterFacets) -> IntArray:
        """The sides of the polygons of a body, shape (c,)."""
        return ((self._first[body] + of.component) * self.width + of.face)[of.cells.facet]

    def side(self, number: int) -> tuple[int, int, str]:
        """Body, component, and name of the face in the body."""
        part, face = divmod(number, self.width)
        body = int(np.searchsorted(self._first, part, side="right")) - 1
        return body, int(part - self._first[body]), self._faces[body][face]

    def called(self, body: int, own: str) -> str:
        """The name of a face among all bodies."""
        return f"{self._bodies[body]}{SEPARATOR}{own}" if self._bodies[body] else own

    def group(self, side: int) -> str:
        """The cell group of the component of a side."""
        body, component, _ = self.side(side)
        return self._groups[body][component]

    def part(self, side: int) -> str:
        """The name of the body of a side, or of its component if there are several."""
        body, component, _ = self.side(side)
        return SEPARATOR.join(filter(None, (self._bodies[body], self._component(body, component))))

    def _component(self, body: int, component: int) -> str:
        """Its group, numbered if several components have that; "part_1" without; "" if it is alone."""
        groups = self._groups[body]
        if len(groups) == 1:
            return ""
        group = groups[component] or "part"
        alike = [k for k, other in enumerate(groups) if (other or "part") == group]
        return group if len(alike) == 1 and group != "part" else f"{group}_{1 + alike.index(component)}"

    def facing(self, side: int, against: int) -> str:
        """The name in its body of a face that is made."""
        (body, component, _), of, other = self.side(side), self.side(against), self.part(against)
        other = of[2] if of[:2] == (body, component) else other
        return "_".join(filter(None, (self._component(body, component), "facing", other.replace(SEPARATOR, "_"))))

    def facing_itself(self, side: int, number: int) -> str:
        """The name in its body of a sheet that is made, opposite to another one of its component."""
        body, component, face = self.side(side)
        return "_".join(filter(None, (self._component(body, component), face, f"facing_itself_{number}")))

    def in_words(self, side: int) -> str:
        """A side in errors: its face, else its body or component."""
        body, _, face = self.side(side)
        return repr(self.called(body, face) if face else self.part(side))


def _sheets(names: _Names, bodies: list[_OuterFacets], distance: float) -> list[tuple[int, str, IntArray]]:
    """What faces the same side, that of a name or of none: body, name there, and numbers over all ranks of the facets
    of one sheet each, by places; collective, the same on every rank."""
    comm, every = names.comm, _all_facets(names, bodies)
    met = on_all_ranks(lambda: list(_met_by_all(names, bodies, every, distance, True)), "auto_pairs", comm)
    mine = np.column_stack([np.concatenate(parts) for parts in list(zip(*met, strict=True))[:4]])
    rows = np.unique(np.concatenate(comm.allgather(mine)), axis=0)
    nodes = [np.concatenate(comm.allgather(body.nodes)) for body in bodies]
    corners = [of[:, : body.kind.corners] for of, body in zip(every.x, bodies, strict=True)]
    numbered, sheets = dict[tuple[int, int], int](), []
    for side in np.unique(rows[:, 0]):
        body, component, _ = names.side(side)
        pairs = rows[rows[:, 0] == side, 2:]
        key, against = np.unique(pairs, return_inverse=True)
        against = against.reshape(-1, 2)
        for rows_of in sheets_of(nodes[body][key], corners[body][key], against):
            number = numbered[body, component] = 1 + numbered.get((body, component), 0)
            sheets.append((body, names.facing_itself(side, number), key[rows_of]))
    return sheets


def _opposite(
    names: _Names, bodies: list[_OuterFacets], distance: float
) -> tuple[list[tuple[int, int, float, float, float]], IntArray]:
    """Pairs of sides within a distance, with area, smallest and largest gap, ascending; and rows (side, side opposite,
    number over all ranks of a facet of the first), shape (k, 3); collective, the same on every rank."""
    comm, every = names.comm, _all_facets(names, bodies)
    met = on_all_ranks(lambda: list(_met_by_all(names, bodies, every, distance, False)), "auto_pairs", comm)
    one, two, facet, there, area, gap = (np.concatenate(parts) for parts in zip(*met, strict=True))
    facets = np.concatenate([np.column_stack([one, two, facet]), np.column_stack([two, one, there])])
    facets = np.unique(np.concatenate(comm.allgather(np.unique(facets, axis=0))), axis=0)
    gap = np.where(np.abs(gap) <= every.same, 0.0, gap)
    rows, inverse, count = np.unique(np.column_stack([one, two]), axis=0, return_inverse=True, return_counts=True)
    total = np.bincount(inverse.ravel(), area, len(rows))
    low, high = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
    np.minimum.at(low, inverse.ravel(), gap)
    np.maximum.at(high, inverse.ravel(), gap)
    sums = np.concatenate(comm.allgather(np.column_stack([rows, count, total, low, high])))
    pairs = []
    for a, b in np.unique(np.sort(sums[:, :2], axis=1), axis=0).astype(np.int64).tolist():
        if goes_on(facets, names.width, b, a):
            continue
        ways = [sums[np.all(sums[:, :2] == way, axis=1), 2:] for way in ((a, b), (b, a))]
        finer = max(ways, key=lambda way: way[:, 0].sum())
        of_both = np.concatenate(ways)
        pairs.append((a, b, float(finer[:, 1].sum()), float(of_both[:, 2].min()), float(of_both[:, 3].max())))
    return pairs, facets


@dataclass(frozen=True, eq=False)
class _AllFacets:
    """The outer facets of all bodies and ranks.

    Attributes:
        cells: Their polygons with four corners, of triangles the last one twice.
        body: The number of the body of each polygon, shape (c,).
        side: Its side, shape (c,).
        key: Its facet, by the number in its body over all ranks, shape (c,).
        nodes: The numbers of the corners of this in its body, of triangles the last one twice, shape (c, 4).
        kinds: Of the facets of each body.
        x: The nodes of the facets of each body, metres, shape (f, n, 3) each.
        same: Distances that differ by less are the same, metres.
        chord: How far facets are from their polygons at most, metres.
    """

    cells: Cells
    body: IntArray
    side: IntArray
    key: IntArray
    nodes: IntArray
    kinds: list[FacetKind]
    x: list[FloatArray]
    same: float
    chord: float

    def heights(self, cells: Cells, one: IntArray, other: IntArray, p: FloatArray) -> FloatArray:
        """Of the facets `other` (k,) before points p (k, 2) in the frames of cells `one` (k,), there, shape (k,)."""
        seen = cells.seen(one, self.cells.corners[other])
        n = np.einsum("kij,kj->ki", cells.frames[one], self.cells.area_vector[other])
        middle = seen.mean(axis=1)
        height: FloatArray = middle[:, 2] - np.einsum("ki,ki->k", p - middle[:, :2], n[:, :2]) / n[:, 2]
        for number, (kind, x) in enumerate(zip(self.kinds, self.x, strict=True)):
            of = np.flatnonzero(self.body[other] == number)
            if kind.degree == 2 and len(of):
                nodes = cells.seen(one[of], x[self.key[other[of]]])
                values, _ = functions_at(kind, nodes, p[of, None], self.cells.start[other[of]], straight=False)
                height[of] = (values @ nodes[:, :, 2:])[:, 0, 0]
        return height


def _all_facets(names: _Names, bodies: list[_OuterFacets]) -> _AllFacets:
    """Gathers those of all ranks; collective."""
    comm = names.comm
    mine = (
        np.concatenate([body.cells.corners[:, [0, 1, 2, -1]] for body in bodies]),
        np.concatenate([body.cells.start for body in bodies]),
        np.repeat(np.arange(len(bodies)), [len(body.cells.facet) for body in bodies]),
        np.concatenate([names.sides(k, body) for k, body in enumerate(bodies)]),
        np.concatenate([body.key[body.cells.facet] for body in bodies]),
        np.concatenate([body.nodes[body.cells.facet][:, [0, 1, 2, -1]] for body in bodies]),
    )
    corners, start, body, side, key, nodes = map(np.concatenate, zip(*comm.allgather(mine), strict=True))
    x = [np.concatenate(comm.allgather(one.x)) for one in bodies]
    chords = [0.0]
    for one, there in zip(bodies, x, strict=True):
        straight = np.einsum("jn,fji->fni", one.kind.vertex_functions, there[:, : one.kind.corners])
        chords.append(float(np.linalg.norm(there - straight, axis=2).max(initial=0.0)))
    same = _SAME * float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    kinds, cells = [one.kind for one in bodies], Cells(np.arange(len(corners)), corners, start)
    return _AllFacets(cells, body, side, key, nodes, kinds, x, same, max(chords))


def _met_by_all(
    names: _Names, bodies: list[_OuterFacets], every: _AllFacets, distance: float, alike: bool
) -> Iterator[tuple[npt.NDArray[Any], ...]]:
    """What the lines of this rank's facets meet: sides of these and opposite, their facets, share of the area, gap; if
    `alike`, of what is on one side."""
    for number, body in enumerate(bodies):
        side = names.sides(number, body)
        for chunk in np.array_split(np.arange(len(side)), len(side) // _AT_ONCE + 1):
            cell, other, gap, share = _met(chunk, body, side, every, names.width, distance, alike)
            area = share * body.cells.area[cell] / _LINES**2
            yield side[cell], every.side[other], body.key[body.cells.facet[cell]], every.key[other], area, gap


def _met(
    chunk: IntArray,
    body: _OuterFacets,
    own: IntArray,
    every: _AllFacets,
    width: int,
    distance: float,
    alike: bool,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """For lines from the points of polygons `at` of a body, of those on the sides `own`: their polygons, what is
    opposite, the gaps in metres, and the share of the line, which may meet an edge of several; shape (k,) each."""
    cells, others, same, side = body.cells, every.cells, every.same, every.side
    far = distance + 2.0 * every.chord
    line, other = every.cells.tree.before(cells.centre[chunk], cells.radius[chunk], cells.frames[chunk, 2], far, far)
    one = chunk[line]
    cosine = np.einsum("ki,ki->k", cells.frames[one, 2], others.area_vector[other]) / others.area[other]
    one, other = one[cosine < FACING], other[cosine < FACING]
    points = cells.seen(one, body.points[one])
    polygon = cells.seen(one, others.corners[other])[:, ::-1, :2]
    edge = np.roll(polygon, -1, axis=1) - polygon
    away = points[:, :, None, :2] - polygon[:, None]
    left = edge[:, None, :, 0] * away[..., 1] - edge[:, None, :, 1] * away[..., 0]
    row, point = np.nonzero(np.all(left >= -_SAME, axis=2))
    one, other, p = one[row], other[row], points[row, point]
    gap = (every.heights(cells, one, other, p[:, :2]) - p[:, 2]) * cells.radius[one]
    within = np.abs(gap) <= distance + same
    gap, one, other, point = gap[within], one[within], other[within], point[within]
    of_line = one * _LINES**2 + point
    own_body = own[one] // width == side[other] // width
    back = gap < -same  # behind the nearest wall of its own body nothing is met
    seen = _nearest(of_line, np.where(back, -gap, np.inf), same) & back
    hidden = np.isin(of_line, of_line[seen & own_body])
    use = ~back | (seen & ~hidden)
    use &= _nearest(of_line, np.where(use, np.abs(gap), np.inf), same)
    notch = np.any(body.nodes[cells.facet[one], :, None] == every.nodes[other, None], axis=(1, 2))
    use &= ((own[one] == side[other]) == alike) & (~own_body | (gap > -same) & ~notch)
    _, line, count = np.unique(of_line[use], return_inverse=True, return_counts=True)
    return one[use], other[use], gap[use], 1.0 / count[line.ravel()]


def _nearest(line: IntArray, size: FloatArray, same: float) -> BoolArray:
    """Which entries are as near as the nearest of their line."""
    lines, inverse = np.unique(line, return_inverse=True)
    least = np.full(len(lines), np.inf)
    np.minimum.at(least, inverse.ravel(), size)
    return np.asarray(size <= least[inverse.ravel()] + same, dtype=bool)


def _points(corners: int) -> FloatArray:
    """Weights of the corners at points of a triangle or a quadrilateral, of equal shares, shape (16, corners)."""
    n = _LINES
    if corners == 3:
        upright = [(i + 1 / 3, j + 1 / 3) for i in range(n) for j in range(n - i)]
        turned = [(i + 2 / 3, j + 2 / 3) for i in range(n - 1) for j in range(n - 1 - i)]
        places = upright + turned
    else:
        places = [(i + 0.5, j + 0.5) for i in range(n) for j in range(n)]
    r, s = np.array(places).T / n
    return np.stack(FacetKind(corners, 1).values(r, s), axis=1)


def _nothing(names: _Names, bodies: list[_OuterFacets], distance: float) -> str:
    """Why nothing was found; collective."""
    x = [body.cells.corners.reshape(-1, 3) for body in bodies]
    ends = np.concatenate(names.comm.allgather(np.concatenate(x)))
    far, _ = _opposite(names, bodies, float(np.linalg.norm(np.ptp(ends, axis=0))))

    def least(low: float, high: float) -> float:
        return 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))

    said = f"auto_pairs: no faces of different bodies face each other within distance = {amount(distance)}"
    if not far:
        return f"{said}, nor at any distance: are the bodies where they should be?"
    one, other, _, low, high = min(far, key=lambda pair: least(*pair[3:]))
    return (
        f"{said}: the nearest that do, {names.in_words(one)} and {names.in_words(other)}, are "
        f"{amount(least(low, high))} apart"
    )
