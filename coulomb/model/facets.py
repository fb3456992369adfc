"""How coarse facets are: their chords where they touch or may, and depths between contact points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..fem.contact import NOISE, FaceSamples
from ..fem.geometry import on_all_ranks
from ..linalg.reductions import Reductions
from ..nearest import among, tree_of
from .certificate_scales import of_half

if TYPE_CHECKING:
    from ..fem.geometry import RigidFoundation
    from .nodal_answer import NodalAnswer

ROUNDING_OF_PLACES: Final = 1e-12
"""Distances below this fraction of the coordinates are rounding errors."""

_CHORDS: Final = 4.0
"""Chords of facets by which a face may be in its foundation: at its ends the estimate is a third of it."""

_AROUND: Final = 8
"""Contact points whose given gaps tell that of a corner beside them, as where they are means around vertices."""

_NEAR: Final = 0.25
"""Radii of a facet within which a contact point is at its node: of 10-node tetrahedra it is beside a corner."""


def deepest(
    answer: NodalAnswer, foundations: Sequence[RigidFoundation | None], between: Sequence[FaceSamples], large: bool
) -> FloatArray:
    """Largest depth in metres of places on each face inside its foundation, beyond what the chord of the facets
    explains, shape (faces,); of faces whose contact points are nodes on facets between these; collective."""
    points, given = (np.concatenate(answer.comm.allgather(of)) for of in (answer.x, answer.given_gap))
    gap, part = (np.concatenate(answer.comm.allgather(of)) for of in (answer.gap, answer.part))

    def depths() -> FloatArray:
        depth = np.zeros(len(foundations))
        for k, (face, of) in enumerate(zip(between, foundations, strict=False)):
            if of is not None and len(face.x) and len(points):
                here, none = points[part == k], np.all(gap[part == k] == given[part == k])
                noise = 2.0 * float(np.max(np.abs(of.signed_distance(here)), initial=0.0)) if none else 0.0
                extent = float(np.max(np.ptp(here, axis=0))) if len(here) else 0.0
                noise = noise if noise <= 2.0 * NOISE * extent else 0.0
                depth[k] = np.max(_depths(face, of, points, given, noise, large), initial=0.0)
        return depth

    try:
        depth = on_all_ranks(depths, "contact: foundation", answer.comm)
    except ValueError:
        return np.full(len(foundations), math.nan)
    return Reductions(answer.comm).largest(depth)


def chords_of(
    answer: NodalAnswer,
    pressing: BoolArray,
    foundations: Sequence[RigidFoundation | None],
    faces: Sequence[FaceSamples],
) -> tuple[FloatArray, FloatArray]:
    """Largest chord in metres of each face at contact points that press, 0 where it is a rounding error of coordinates,
    and the largest of these, shapes (faces,); collective.

    Of foundations it is that of `FaceSamples.bend`, at most what distances differ by between the nodes of a facet: a
    face whose nodes are as far from the foundation as those beside them has its curvature, and its chord is none.
    """
    comm, points, over = answer.comm, answer.x[pressing], Reductions(answer.comm)
    parts = [(answer.x[answer.part == k], points[answer.part[pressing] == k]) for k in range(len(foundations))]
    every, own = ([np.concatenate(comm.allgather(of)) for of in side] for side in zip(*parts, strict=True))

    def bends() -> list[tuple[FloatArray, FloatArray]]:
        ends: list[tuple[FloatArray, FloatArray]] = [(np.zeros(0), np.zeros(0))] * len(foundations)
        for k, (face, of) in enumerate(zip(faces, foundations, strict=False)):
            if of is not None and len(own[k]):
                here = _with_node(face, own[k])
                ends[k] = face.bend(of.signed_distance)[here], face.spread(of.signed_distance)[here]
        return ends

    try:
        ends = on_all_ranks(bends, "contact: foundation", comm)
    except ValueError:
        return np.full(len(foundations), math.nan), np.zeros(len(foundations))
    chords = np.zeros((2, len(foundations)))
    for k, (bend, spread) in enumerate(ends):
        here = pressing & (answer.part == k)
        of_pair = largest(answer.chord[here, 0], over), of_half(answer.chord[here, 1], answer.force[here, 0], over)
        chord = np.max([*of_pair, np.minimum(largest(bend, over), largest(spread, over))])  # nan if one is
        if len(every[k]) and chord <= NOISE * np.max(np.ptp(every[k], axis=0)):
            here = answer.part == k
            known = over.max(np.abs(answer.gap - answer.given_gap)[here]) > 0.0  # else `without_noise`
            chords[1, k] = chord if known else 0.0
        else:
            chords[0, k] = chord
    return chords[0], chords[1]


def missed(
    answer: NodalAnswer,
    pressing: BoolArray,
    foundations: Sequence[RigidFoundation | None],
    faces: Sequence[FaceSamples],
) -> FloatArray:
    """How deep the surfaces for which facets stand may be in what is opposite, of faces that press nowhere: the chord
    beyond the mean gap that is left at the corners of a facet, or by how much what is opposite may be nearer to a
    contact point beyond the gap there, metres, shape (faces,); collective."""
    comm, left = answer.comm, answer.gap - answer.relative_displacement[:, 0]
    parts, x, gaps, chords, pressed = (
        np.concatenate(comm.allgather(of)) for of in (answer.part, answer.x, left, answer.chord, pressing)
    )

    def spreads() -> FloatArray:
        each = zip(faces, foundations, strict=False)
        return np.array(
            [0.0 if of is None else np.max(face.spread(of.signed_distance), initial=0.0) for face, of in each]
        )

    def depths(spread: FloatArray) -> FloatArray:
        depth_of = np.zeros(len(foundations))
        for k, (face, of) in enumerate(zip(faces, foundations, strict=False)):
            chosen = parts == k
            if face.nodal and np.any(chosen) and not np.any(pressed[chosen]):
                here = np.all(among(face.corners, x[chosen]), axis=1)
                node = tree_of(x[chosen]).query(face.corners[here])[1]
                if of is None:
                    chord = chords[chosen, 0][node].min(axis=1, initial=np.inf)
                else:
                    chord = np.minimum(face.bend(of.signed_distance)[here], spread[k])
                nearer = np.max(chords[chosen, 2] - gaps[chosen], initial=0.0, where=chords[chosen, 2] > 0.0)
                depth = np.max(chord - gaps[chosen][node].mean(axis=1), initial=nearer)
                depth_of[k] = depth if depth > NOISE * np.max(np.ptp(x[chosen], axis=0)) else 0.0
        return depth_of

    try:
        most = Reductions(comm).largest(on_all_ranks(spreads, "contact: foundation", comm))
        depth_of = on_all_ranks(lambda: depths(most), "contact: foundation", comm)
    except ValueError:
        return np.full(len(foundations), math.nan)
    return Reductions(comm).largest(depth_of)


def _with_node(face: FaceSamples, points: FloatArray) -> BoolArray:
    """Facets with a node at one of the contact points (k, 3), shape (f,)."""
    if face.nodal:
        touching = among(face.x, points)
    else:
        radius = np.linalg.norm(face.corners - face.corners.mean(axis=1, keepdims=True), axis=2).max(
            axis=1, initial=0.0
        )
        touching = tree_of(points).query(face.x)[0] <= _NEAR * radius[:, None]
    return np.any(touching, axis=1)


def _depths(
    face: FaceSamples,
    foundation: RigidFoundation,
    points: FloatArray,
    given: FloatArray,
    noise: float = 0.0,
    large: bool = False,
) -> FloatArray:
    """Depths of facets, as `deepest`, for the contact points (m, 3) of all ranks with their given gaps (m,); depths up
    to `noise` in metres are rounding errors of coordinates (`without_noise`)."""
    size = float(np.max(np.abs(points)))  # of all ranks
    near = np.ones(len(face.x), dtype=bool)
    if face.nodal:
        near = np.all(among(face.corners, points), axis=1)

    if not np.any(near):
        return np.zeros(0)
    at_corners = np.zeros(face.corners.shape[:2])
    if np.any(given):
        number = tree_of(points).query(face.corners, min(_AROUND, len(points)))[1].reshape(*at_corners.shape, -1)
        nearest, others = points[number[..., :1]], points[number] - points[number[..., :1]]
        slope = np.linalg.pinv(others, rcond=1e-3) @ (given[number] - given[number[..., :1]])[..., None]
        at_corners = given[number[..., 0]] + ((face.corners[:, :, None] - nearest) @ slope)[:, :, 0, 0]
    least = face.least(near, foundation.signed_distance, at_corners)
    chords = face.chord[near] if large else face.chord_on(foundation.signed_distance)[near]
    return np.where(np.abs(least) <= max(ROUNDING_OF_PLACES * size, noise), 0.0, -least) - _CHORDS * chords


def largest(values: FloatArray, over: Reductions) -> float:
    """The largest of values >= 0 on all ranks, 0 if there is none, nan if one is nan."""
    return over.max(np.append(values, 0.0))
