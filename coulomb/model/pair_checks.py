"""Evidence of pairs of faces by code that shares nothing with the mortar integration, and its lines of the certificate.

The gaps, normals, areas and averages by which a pair is solved are compared with those of `PairSamples`.  What differs
by more than the facets explain counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import BoolArray, FloatArray, Int32Array, IntArray, in_words
from ..fem.bodies import Deformable, DisplacementSpace, HeldDirections, NonlinearBody
from ..fem.contact import (
    Claims,
    Deviations,
    Pair,
    PairSamples,
    Shape,
    Surfaces,
    facets_of,
    gathered,
    off_linear,
    opposite_nodes,
)
from ..linalg.reductions import Reductions, concatenated
from ..units import amount
from .contact import Contact


@dataclass(frozen=True, eq=False)
class PairFindings:
    """The worst of what is off at this rank's contact points of a pair.

    Attributes:
        worst: Rows gap and displacement in metres, normal in degrees, weights, number of nodes left out; columns the
            value, and the place in metres; shape (5, 4).
        allowed: The largest difference of gaps that facets explain, metres.
    """

    face: str
    against: str
    worst: FloatArray
    allowed: float


def probing_fields(x: FloatArray, size: float) -> FloatArray:
    """Nodal fields by which averages are compared, at coordinates x (k, 3) in metres: one, x, and two rough ones of
    size 1; shape (k, 6)."""
    rough = np.sin(x / size @ np.array([[1e4, 5e4], [2e4, 4e4], [3e4, 7e4]]))
    return np.column_stack([np.ones(len(x)), x, rough])


@dataclass(frozen=True, eq=False)
class Side:
    """A face of a pair: its body, its facets there, and the held directions of the body's nodes."""

    space: DisplacementSpace
    facets: Int32Array
    held: HeldDirections

    def projectors(self, nodes: IntArray) -> FloatArray:
        """Those of the nodes of all facets, (f, n, 3, 3), from the nodes of this rank's facets; collective."""
        held = self.held.projector_at(np.arange(self.space.numbering.local)).reshape(-1, 9)
        return gathered(self.space, nodes, held).reshape(-1, nodes.shape[1], 3, 3)


class PairReference:
    """The points by which a pair is judged (`PairSamples`); collective.

    Args:
        node: Numbers of this rank's contact points in the slave's body, over all ranks, shape (m,).
        shape: What the facets stand for.
    """

    def __init__(self, slave: Side, master: Side, node: IntArray, shape: Shape):
        self._spaces = slave.space, master.space
        (one, here), (other, there) = (facets_of(side.space, side.facets) for side in (slave, master))
        one, other = (replace(face, depth=shape.depth) for face in (one, other))
        self._nodes, self._slave, self._facets = (here, there), slave, (one, other)
        held = (slave.projectors(here), master.projectors(there)) if shape.smooth else None
        large = isinstance(slave.space, NonlinearBody)
        surfaces = Surfaces(shape.smooth, shape.slave, shape.master, held, interpolated=not large)
        standing = concatenated(slave.space.comm, node)
        self._sample = partial(PairSamples, one, other, standing=standing, surfaces=surfaces)
        self._node, self._samples = node, self._sample(node)
        self._few, self._closer = node[:0], self._sample(node[:0])

    def left_out(self, known: BoolArray) -> FloatArray:
        """Places of slave nodes before the master that must be contact points and are none, metres, shape (q, 3): all
        but `known` ones of this rank's nodes of the body, (k,), those on both faces, those held along the
        normal, and those without area; not collective."""
        (slave, master), space = self._facets, self._slave.space
        local = space.nodes_of(self._slave.facets)
        local = local[~known[local] & ~np.isin(local, space.without_area)]
        node = space.numbering.first + local.astype(np.int64)
        if space is self._spaces[1]:
            node = node[~np.isin(node, master.nodes)]
        row, x, n = opposite_nodes(slave, master, node)
        held = self._slave.held.projector_at(node[row] - space.numbering.first)
        return x[np.linalg.norm(np.einsum("mij,mj->mi", held, n), axis=1) < _HELD]

    def off_linear(
        self, nodes: npt.NDArray[np.integer[Any]], n: FloatArray, own: FloatArray, opposite: FloatArray
    ) -> FloatArray:
        """The same of nodes of the slave's body, with the displacements of both bodies; collective."""
        there = gathered(self._spaces[1], self._nodes[1], opposite)
        (slave, master), numbers = self._facets, self._spaces[0].numbering.first + nodes
        kink = np.zeros(1 + int(max(np.max(of, initial=0) for of in (slave.nodes, numbers))))
        np.maximum.at(kink, slave.nodes, slave.kink[:, None])
        return off_linear(master, self._spaces[0].x[nodes], n, own[nodes], there, kink[numbers])

    def _averages(self, values: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """`PairSamples.averages` of values at this rank's nodes of the slave's and of the master's body; collective."""
        at_facets = [gathered(*of) for of in zip(self._spaces, self._nodes, values, strict=True)]
        found, unsure = self._samples.averages(*at_facets)
        found[:, self._few], unsure[:, self._few] = self._closer.averages(*at_facets)
        return found, unsure

    def depths(self, u: tuple[FloatArray, FloatArray]) -> FloatArray:
        """`PairSamples.depths` by the displacements of both bodies; collective."""
        at_facets = [gathered(*of) for of in zip(self._spaces, self._nodes, u, strict=True)]
        found = self._samples.depths(*at_facets)
        found[:, self._few] = self._closer.depths(*at_facets)
        return found

    def weights(self, fields: tuple[FloatArray, FloatArray], averages: FloatArray) -> FloatArray:
        """By how much claimed averages (2, m, 6) of the `probing_fields` of both bodies are off, shape (m,), where they
        are, with more points (`_CLOSER`) from now on; collective."""
        off = self._off(fields, averages)
        self._few = np.sort(np.argsort(-off)[: min(_FEW, np.count_nonzero(off))])
        self._closer = self._sample(self._node[self._few], times=_CLOSER)
        return self._off(fields, averages)

    def _off(self, fields: tuple[FloatArray, FloatArray], averages: FloatArray) -> FloatArray:
        found, unsure = self._averages(fields)
        off = np.abs(averages - found) - unsure
        off[:, :, 1:4] /= np.maximum(self._samples.radius, 1e-300)[:, None]
        return np.maximum(off.max(axis=(0, 2), initial=0.0) - _ROUNDING, 0.0)

    def deviations(self, claims: Claims) -> Deviations:
        """`PairSamples.deviations`."""
        found = self._samples.deviations(claims)
        closer = self._closer.deviations(claims.only(self._few))
        for of, better in zip(found.each(), closer.each(), strict=True):
            of[self._few] = better
        return found

    def displacement(
        self, u: tuple[FloatArray, FloatArray], mirrored: FloatArray | None, frames: FloatArray, rows: FloatArray
    ) -> FloatArray:
        """By how much claimed `rows` (m, 3) of the displacement of a point against the master along `frames` (m, 3, 3)
        are off, metres, shape (m,), by the displacements of both bodies; collective."""
        found, unsure = self._averages(u)
        difference = found[0] - found[1]
        if mirrored is not None:
            difference = difference - np.einsum("mij,mj->mi", mirrored, difference)
        off = np.abs(rows - np.einsum("mij,mj->mi", frames, difference))
        off -= np.einsum("mij,mj->mi", np.abs(frames), unsure.sum(axis=0))
        off -= _OF_LARGEST * max(float(np.max(np.abs(of), initial=0.0)) for of in u)
        return np.maximum(off.max(axis=1, initial=0.0), 0.0)


_ROUNDING: Final = 1e-9
"""Of averages over the size of facets, and of weights."""

_CLOSER: Final = 4
"""Times as many points along an edge where averages are off: before small facets of a master few points miss some."""

_FEW: Final = 3000
"""Contact points of a rank for which there are more points: as many as memory has room for anywhere."""

_HELD: Final = 0.999
"""Held part of a normal from which a node needs no contact point: normals of curved faces are means."""

_OF_LARGEST: Final = 1e-13
"""Rounding errors of averages over the largest displacement."""


def tied_nodes(body: Deformable) -> IntArray:
    """This rank's nodes that ties move, and those that move these: contact points of both may be held; collective."""
    own: list[IntArray] = []
    first = body.numbering.first
    for tie in body.constraints.ties:
        moving = concatenated(body.comm, np.unique(tie.rows.indices // 3).astype(np.int64)) - first
        own += [tie.nodes, moving[(moving >= 0) & (moving < body.numbering.local)]]
    return np.concatenate([np.empty(0, dtype=np.int64), *own])


class JudgedPair:
    """A pair of faces of a problem with its contact points, judged at the points of a `PairReference`; collective."""

    def __init__(self, elasticity: Deformable, contact: Contact, pair: Pair):
        assert contact.against is not None
        self.pair, self._contact = pair, contact
        self._last: tuple[Claims, Deviations] | None = None
        faces = [elasticity.face(name, "contact") for name in (contact.face, contact.against)]
        self._nodes, (slave, _) = (faces[0][0].nodes, faces[1][0].nodes), faces[0]
        local = pair.points.nodes - slave.nodes.start
        self._node = (slave.body.numbering.first + local).astype(np.int64)
        self._held = slave.body.held.projector_at(local)
        one, other = (Side(member.body, facets, member.body.held) for member, facets in faces)
        self._reference = PairReference(one, other, self._node, contact.shape)
        self._tied = tied_nodes(elasticity)
        self._left: FloatArray = np.zeros((0, 3))
        fields = probing_fields(elasticity.x, Reductions(elasticity.comm).max(np.abs(elasticity.x)) or 1.0)
        own, opposite = pair.points.average(fields), pair.points.opposite_average(fields)
        assert opposite is not None
        self._weights = self._reference.weights(self._sides(fields), np.stack([own, opposite]))

    def _sides(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (k, d) of the nodes of all bodies at those of the slave's and of the master's."""
        return values[self._nodes[0]], values[self._nodes[1]]

    def off_linear(self, u: FloatArray, nodes: npt.NDArray[np.integer[Any]], n: FloatArray) -> FloatArray:
        """`closest_points.off_linear` of this rank's slave `nodes` (m,) among those of all bodies, with displacements u
        (k, 3), along unit normals n (m, 3), metres, shape (m,); collective."""
        return self._reference.off_linear(nodes - self._nodes[0].start, n, *self._sides(u))

    def depths(self, u: FloatArray, given: FloatArray) -> FloatArray:
        """Depth of the faces in each other between contact points with given gaps (m,), as `PairSamples.depths`, and
        how far they are apart around each, at least 0, metres, shape (2, m); with displacements u (k, 3) of the nodes
        of all bodies; collective."""
        deep, near = self._reference.depths(self._sides(u)) - given
        return np.maximum(np.stack([deep, -near]) - self._contact.adjust, 0.0)

    def findings(self, frames: FloatArray, gap: FloatArray, rows: FloatArray, u: FloatArray) -> PairFindings:
        """What is off with frames (m, 3, 3), gaps (m,) without given ones, and displacements `rows` (m, 3) in the
        frames by those of the nodes u (k, 3), metres; collective."""
        pair, contact = self.pair, self._contact
        moved = self._reference.displacement(self._sides(u), pair.points.mirrored, frames, rows)
        claims = Claims(self._node, frames[:, 0], gap, pair.points.area, self._held, contact.adjust)
        if self._last is None or not self._last[0].same(claims):
            self._last = claims, self._reference.deviations(claims)
            known = np.zeros(len(u), dtype=bool)
            known[pair.points.nodes] = known[pair.elsewhere] = known[self._tied] = True
            self._left = self._reference.left_out(known[self._nodes[0]])
        return findings(pair.face, pair.against, pair.x, self._last[1], self._weights, moved, self._left)


def findings(
    face: str,
    against: str,
    x: FloatArray,
    off: Deviations,
    weights: FloatArray,
    moved: FloatArray,
    left_out: FloatArray,
) -> PairFindings:
    """The worst at contact points x (m, 3), of the claims of a pair and of what is off in weights and displacements;
    and the places (q, 3) of nodes that must be contact points and are none."""
    worst = np.zeros((5, 4))
    if len(left_out):
        worst[4] = len(left_out), *left_out[0]
    for row, values in zip(worst, (off.gap, moved, off.normal, np.maximum(weights, off.area)), strict=False):
        if len(values):
            at = int(np.argmax(np.where(np.isnan(values), np.inf, values)))
            row[:] = values[at], *x[at]
    return PairFindings(face, against, worst, float(np.max(off.allowed, initial=0.0)))


def pair_lines(
    pairs: tuple[PairFindings, ...], lengths: FloatArray, over: Reductions
) -> list[tuple[str, float, str, str]]:
    """Name, value, unit and meaning of the lines of the certificate; `lengths` are the scales of displacements of the
    pairs, metres."""
    if not pairs:
        return []
    every = concatenated(over.comm, np.array([[pair.worst for pair in pairs]]))  # (ranks, pairs, 5, 4)
    allowed = over.max(np.array([pair.allowed for pair in pairs]))
    lines, ones = [], np.ones(len(pairs))
    for k, (name, unit, scale, words) in enumerate(
        (
            ("pair gap", "", lengths, f"gaps as by lines from face to face, to {amount(allowed)} by the facets"),
            ("pair displacement", "", lengths, "displacements of both faces as at these lines"),
            ("pair normal", "deg", ones, "normals as of the facets around"),
            ("pair weights", "", ones, "areas and averages over both faces as at these lines"),
            ("pair points", "", ones, "nodes before the face opposite are contact points"),
        )
    ):
        values = np.where(np.isnan(every[:, :, k, 0]), np.inf, every[:, :, k, 0]) / scale
        rank, number = np.unravel_index(int(np.argmax(values)), values.shape)
        value, place = float(values[rank, number]), [float(at) for at in every[rank, number, k, 1:]]
        at = f"; worst: {pairs[number].face!r} against {pairs[number].against!r} at x = {in_words(place)}"
        lines.append((name, value, unit, words + (at if value > 0.0 else "")))
    return lines


def pair_actions(
    x: FloatArray, slave: FloatArray, master: FloatArray, at: FloatArray, opposite: FloatArray, force: FloatArray
) -> FloatArray:
    """Resultants on this rank of nodal forces on slave and master (k, 3) of a pair, and of the couples of its forces
    (m, 3) on the slave `at` and on the master `opposite` across undeformed gaps: shape (3, 7), with three forces, three
    moments about the origin of x, and the sum of magnitudes."""
    couples = np.cross(at - opposite, force)
    none = np.zeros_like(couples)
    rows = ((slave, np.cross(x, slave)), (master, np.cross(x, master)), (none, couples))
    return np.array(
        [[*one.sum(axis=0), *moment.sum(axis=0), np.sum(np.linalg.norm(one, axis=1))] for one, moment in rows]
    )
