"""Where the motions of a load step lead through what a contact keeps out, though they end outside of it: the way of
every node is taken as straight, in the coordinates of a foundation, or beside a facet that moves from its place at the
start to that at the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, Int32Array, IntArray, in_words
from ..bodies import Member, turn_of
from ..geometry import RigidFoundation
from .body_boundary import boxes_of, in_boxes, in_tetrahedra, tetrahedra_of
from .facet_patch import FacetPatch, facet_patch

_STEEP: Final = 0.3
"""Sine of the angle to the surface above which a way leads into it: chords of arcs of less than 35 degrees around a
shaft that touches nothing do not."""

_SHORTEST: Final = 1.0 / 64.0
"""The least part of a way after which the distance from a foundation is found again."""

_ON_SURFACE: Final = 1e-9
"""Heights below this part of a way, or of a facet, are on the surface."""

_WITHIN: Final = 1e-3
"""Least barycentric coordinate of a place that is inside a tetrahedron, and not on its surface."""

_AT_ONCE: Final = 100_000
"""Pairs of nodes and triangles treated at once."""


class Ways(NamedTuple):
    """Places at the start and the end of a step, metres, of nodes (k, 3) or corners of triangles (t, 3, 3)."""

    then: FloatArray
    now: FloatArray


def into_foundation(ways: Ways, foundation: RigidFoundation, gap: float) -> IntArray:
    """Which ways in the coordinates of a foundation lead into it by more than a gap that is given beside the distance,
    metres: their numbers."""
    way, passed = ways.now - ways.then, list[int]()
    length, done = np.linalg.norm(way, axis=1), np.zeros(len(way))
    here = np.flatnonzero(length > 0.0)
    while len(here):
        x = ways.then[here] + done[here, None] * way[here]
        distance = np.asarray(foundation.signed_distance(x)) + gap
        inside = distance < -_ON_SURFACE * length[here]
        entered = inside & (done[here] > 0.0)
        if np.any(entered):
            at = here[entered]
            steep = np.einsum("ki,ki->k", way[at], foundation.normal(x[entered])) < -_STEEP * length[at]
            passed.extend(at[steep])
        done[here] += np.maximum(distance / length[here], _SHORTEST)
        here = here[~inside & (done[here] < 1.0)]
    return np.array(passed, dtype=np.int64)


def into_facets(nodes: Ways, triangles: Ways) -> FloatArray:
    """Where nodes begin whose ways lead through triangles from outside, metres, shape (p, 3)."""
    passed = [nodes.then[:0]]
    if not len(nodes.then):
        return nodes.then
    swept = [np.stack(of, axis=1).reshape(len(of.then), -1, 3) for of in (nodes, triangles)]
    node, triangle = in_boxes(boxes_of(swept[0]), boxes_of(swept[1]))
    for some in np.array_split(np.arange(len(node)), len(node) // _AT_ONCE + 1):
        x, corners = Ways(*(of[node[some]] for of in nodes)), Ways(*(of[triangle[some]] for of in triangles))
        away = [of - corner[:, 0] for of, corner in zip(x, corners, strict=True)]
        then, now = (np.einsum("pi,pi->p", of, _normals(corner)) for of, corner in zip(away, corners, strict=True))
        size = np.linalg.norm(corners.then[:, 1:] - corners.then[:, :1], axis=2).max(axis=1)
        least, fall = -_ON_SURFACE * size, then - now
        through = (then >= least) & (now < least) & (fall > _STEEP * np.linalg.norm(away[1] - away[0], axis=1))
        part = np.clip(then / np.where(through, fall, 1.0), 0.0, 1.0)[:, None]
        at, around = (1.0 - part) * x.then + part * x.now, corners.then + part[:, None] * (corners.now - corners.then)
        beside = np.cross(np.roll(around, -1, axis=1) - around, at[:, None] - around)
        through &= np.all(np.einsum("pki,pi->pk", beside, _normals(around)) >= size[:, None] * least[:, None], axis=1)
        passed.append(x.then[through])
    return np.concatenate(passed)


def _normals(corners: FloatArray) -> FloatArray:
    """Outward unit normals of triangles (t, 3, 3)."""
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit: FloatArray = n / np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
    return unit


def through_each_other(faces: Sequence[tuple[FacetPatch, ...]], comm: MPI.Comm) -> FloatArray:
    """Where nodes of either of two faces begin whose ways, as seen from the other, lead through it; of each its facets
    at the start and at the end, this rank's; metres, shape (p, 3); collective."""
    passed = list[FloatArray]()
    for mine, other in (faces, faces[::-1]):
        pieces, one = other[0].kind.pieces, np.unique(mine[0].nodes, return_index=True)[1]
        three = np.concatenate([pieces[:, [0, k, k + 1]] for k in range(1, pieces.shape[1] - 1)])
        then, now = (np.concatenate(comm.allgather(of.x[:, three].reshape(-1, 3, 3))) for of in other)
        start, end = (of.reshape(-1, 3).mean(axis=0) for of in (then, now))
        turn = turn_of((then - start).reshape(-1, 3).T @ (now - end).reshape(-1, 3))
        ways = Ways(*(of.x.reshape(-1, 3)[one] for of in mine))
        passed.append(
            into_facets(ways._replace(now=(ways.now - end) @ turn + start), Ways(then, (now - end) @ turn + start))
        )
    return np.concatenate(passed)


def inside_of(places: FloatArray, of: Member, least: float = -_WITHIN) -> FloatArray:
    """Those of the places (p, 3) of all ranks that are in this rank's cells of a body, where these are now, metres,
    with barycentric coordinates above the least; collective."""
    body = of.body
    places = np.concatenate(body.comm.allgather(places))[:, None]
    nodes = body.points_of_cells(np.arange(body.domain.topology.index_map(3).size_local, dtype=np.int32))
    place, cell = in_boxes(boxes_of(places), boxes_of(nodes))
    tetrahedra = tetrahedra_of(body.domain.topology.cell_type, body.degree)
    hits, _, weights, _ = in_tetrahedra(places[place], nodes[cell], tetrahedra)
    inside: FloatArray = places[place[hits[weights.min(axis=1, initial=1.0) > least]], 0]
    return inside


def refuse_inside(face: str, of: Member, facets: Int32Array, against: str, other: Member) -> None:
    """ValueError on every rank if parts of a face are inside the body of the face against it, though neither is before
    the other: as deep as that nothing says out of which side; collective."""
    patch, comm = facet_patch(of.body, facets), other.body.comm
    part = np.array([0.37, 0.29, 0.23, 0.11])[: patch.kind.corners]  # a place that is on no diagonal of a grid
    inside = inside_of(np.einsum("n,fni->fi", part / part.sum(), patch.x[:, : len(part)]), other, _WITHIN)
    every = [tuple(map(float, x)) for ranks in comm.allgather(inside) for x in ranks]
    if every:
        raise ValueError(
            f"contact face {face!r}: at x = ({in_words(min(every))}) m it is inside the body of {against!r} before "
            "deformation, too deep for a contact to push it out: move one of the bodies (coulomb.moved; translate)"
        )
