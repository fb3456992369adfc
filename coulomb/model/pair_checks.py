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

from ..arrays import BoolArray, FloatArray, IntArray, in_words
from ..fem.bodies import Deformable, NonlinearBody
from ..fem.contact import (
    Claims,
    Deviations,
    Pair,
    PairSamples,
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


_OF_WEIGHTS: Final = 1e-9
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
    """A pair of faces of a problem with its contact points, judged at points of its own (`PairSamples`); collective."""

    def __init__(self, elasticity: Deformable, contact: Contact, pair: Pair):
        assert contact.against is not None
        self.pair, self._contact, shape = pair, contact, contact.shape
        self._last: tuple[Claims, Deviations] | None = None
        slave, master = (elasticity.face(name, "contact") for name in (contact.face, contact.against))
        self._nodes, self._bodies = (slave[0].nodes, master[0].nodes), (slave[0].body, master[0].body)
        self._on_slave, local = slave[1], pair.points.nodes - slave[0].nodes.start
        self._node = (self._bodies[0].numbering.first + local).astype(np.int64)
        self._held = self._bodies[0].held.projector_at(local)
        (one, here), (other, there) = (facets_of(member.body, facets) for member, facets in (slave, master))
        self._facets = replace(one, depth=shape.depth), replace(other, depth=shape.depth)
        self._of_facets = here, there
        held = (self._projectors(0), self._projectors(1)) if shape.smooth else None
        large = isinstance(self._bodies[0], NonlinearBody)
        surfaces = Surfaces(shape.smooth, shape.slave, shape.master, held, interpolated=not large)
        standing = concatenated(elasticity.comm, self._node)
        self._sample = partial(PairSamples, *self._facets, standing=standing, surfaces=surfaces)
        self._samples = self._sample(self._node)
        self._few, self._closer = self._node[:0], self._sample(self._node[:0])
        self._tied = tied_nodes(elasticity)
        self._left: FloatArray = np.zeros((0, 3))
        fields = probing_fields(elasticity.x, Reductions(elasticity.comm).max(np.abs(elasticity.x)) or 1.0)
        own, opposite = pair.points.average(fields), pair.points.opposite_average(fields)
        assert opposite is not None
        averages = np.stack([own, opposite])
        off = self._off(fields, averages)
        self._few = np.sort(np.argsort(-off)[: min(_FEW, np.count_nonzero(off))])
        self._closer = self._sample(self._node[self._few], times=_CLOSER)
        self._weights = self._off(fields, averages)

    def _projectors(self, side: int) -> FloatArray:
        """On held directions, of the nodes of all facets of a side, (f, n, 3, 3); collective."""
        body, nodes = self._bodies[side], self._of_facets[side]
        held = body.held.projector_at(np.arange(body.numbering.local)).reshape(-1, 9)
        return gathered(body, nodes, held).reshape(-1, nodes.shape[1], 3, 3)

    def _at_facets(self, values: FloatArray) -> list[FloatArray]:
        """Values (k, d) of the nodes of all bodies at those of all facets of slave and master; collective."""
        own = (values[nodes] for nodes in self._nodes)
        return [gathered(*of) for of in zip(self._bodies, self._of_facets, own, strict=True)]

    def _averages(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`PairSamples.averages` of values (k, d) of the nodes of all bodies; collective."""
        at_facets = self._at_facets(values)
        averages, unsure = self._samples.averages(*at_facets)
        averages[:, self._few], unsure[:, self._few] = self._closer.averages(*at_facets)
        return averages, unsure

    def _off(self, fields: FloatArray, averages: FloatArray) -> FloatArray:
        """By how much claimed averages (2, m, 6) of the `probing_fields` are off, shape (m,); collective."""
        expected, unsure = self._averages(fields)
        off = np.abs(averages - expected) - unsure
        off[:, :, 1:4] /= np.maximum(self._samples.radius, 1e-300)[:, None]
        return np.maximum(off.max(axis=(0, 2), initial=0.0) - _OF_WEIGHTS, 0.0)

    def _left_out(self, known: BoolArray) -> FloatArray:
        """Places of slave nodes before the master that must be contact points and are none, metres, shape (q, 3): all
        but `known` ones of this rank's nodes of the body, (k,), those on both faces, those held along the
        normal, and those without area; not collective."""
        (slave, master), body = self._facets, self._bodies[0]
        local = body.nodes_of(self._on_slave)
        local = local[~known[local] & ~np.isin(local, body.without_area)]
        node = body.numbering.first + local.astype(np.int64)
        if body is self._bodies[1]:
            node = node[~np.isin(node, master.nodes)]
        row, x, n = opposite_nodes(slave, master, node)
        held = body.held.projector_at(node[row] - body.numbering.first)
        return x[np.linalg.norm(np.einsum("mij,mj->mi", held, n), axis=1) < _HELD]

    def off_linear(self, u: FloatArray, nodes: npt.NDArray[np.integer[Any]], n: FloatArray) -> FloatArray:
        """`closest_points.off_linear` of this rank's slave `nodes` (m,) among those of all bodies, with displacements u
        (k, 3), along unit normals n (m, 3), metres, shape (m,); collective."""
        there, own = self._at_facets(u)[1], nodes - self._nodes[0].start
        (slave, master), numbers = self._facets, self._bodies[0].numbering.first + own
        kink = np.zeros(1 + int(max(np.max(of, initial=0) for of in (slave.nodes, numbers))))
        np.maximum.at(kink, slave.nodes, slave.kink[:, None])
        return off_linear(master, self._bodies[0].x[own], n, u[nodes], there, kink[numbers])

    def depths(self, u: FloatArray, given: FloatArray) -> FloatArray:
        """Depth of the faces in each other between contact points with given gaps (m,), as `PairSamples.depths`, and
        how far they are apart around each, at least 0, metres, shape (2, m); with displacements u (k, 3) of the nodes
        of all bodies; collective."""
        at_facets = self._at_facets(u)
        depths = self._samples.depths(*at_facets)
        depths[:, self._few] = self._closer.depths(*at_facets)
        deep, near = depths - given
        return np.maximum(np.stack([deep, -near]) - np.array(self._contact.closed[::-1])[:, None], 0.0)

    def _displacement(self, u: FloatArray, frames: FloatArray, rows: FloatArray) -> FloatArray:
        """By how much claimed `rows` (m, 3) of the displacement of a point against the master along `frames` (m, 3, 3)
        are off, metres, shape (m,), by the displacements u (k, 3) of all bodies; collective."""
        averages, unsure = self._averages(u)
        difference, mirrored = averages[0] - averages[1], self.pair.points.mirrored
        if mirrored is not None:
            difference = difference - np.einsum("mij,mj->mi", mirrored, difference)
        off = np.abs(rows - np.einsum("mij,mj->mi", frames, difference))
        off -= np.einsum("mij,mj->mi", np.abs(frames), unsure.sum(axis=0))
        off -= _OF_LARGEST * max(float(np.max(np.abs(u[nodes]), initial=0.0)) for nodes in self._nodes)
        return np.maximum(off.max(axis=1, initial=0.0), 0.0)

    def findings(
        self, frames: FloatArray, gap: FloatArray, rows: FloatArray, u: FloatArray, far: BoolArray
    ) -> PairFindings:
        """What is off with frames (m, 3, 3), gaps (m,) without given ones, and displacements `rows` (m, 3) in the
        frames by those of the nodes u (k, 3), metres; collective.

        Points that are `far` (m,) from the face opposite transmit nothing by their areas and weights: before folds,
        where each line may meet one of several layers, these are others by lines.
        """
        pair = self.pair
        moved = self._displacement(u, frames, rows)
        claims = Claims(self._node, frames[:, 0], gap, pair.points.area, self._held, self._contact.closed)
        if self._last is None or not self._last[0].same(claims):
            off = self._samples.deviations(claims)
            closer = self._closer.deviations(claims.only(self._few))
            for of, better in zip(off.each(), closer.each(), strict=True):
                of[self._few] = better
            self._last, known = (claims, off), np.zeros(len(u), dtype=bool)
            known[pair.points.nodes] = known[pair.elsewhere] = known[self._tied] = True
            self._left = self._left_out(known[self._nodes[0]])
        weights = np.where(far, 0.0, np.maximum(self._weights, self._last[1].area))
        return findings(pair.face, pair.against, pair.x, self._last[1], weights, moved, self._left)


def findings(
    face: str,
    against: str,
    x: FloatArray,
    off: Deviations,
    weights: FloatArray,
    moved: FloatArray,
    left_out: FloatArray,
) -> PairFindings:
    """The worst at contact points x (m, 3), of the claims of a pair and of what is off in areas and weights and in
    displacements; and the places (q, 3) of nodes that must be contact points and are none."""
    worst = np.zeros((5, 4))
    if len(left_out):
        worst[4] = len(left_out), *left_out[0]
    for row, values in zip(worst, (off.gap, moved, off.normal, weights), strict=False):
        if len(values):
            largest = int(np.argmax(np.where(np.isnan(values), np.inf, values)))
            row[:] = values[largest], *x[largest]
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
    x: FloatArray, slave: FloatArray, master: FloatArray, points: FloatArray, opposite: FloatArray, force: FloatArray
) -> FloatArray:
    """Resultants on this rank of nodal forces on slave and master (k, 3) of a pair, and of the couples of its forces
    (m, 3) on the slave `at` and on the master `opposite` across undeformed gaps: shape (3, 7), with three forces, three
    moments about the origin of x, and the sum of magnitudes."""
    couples = np.cross(points - opposite, force)
    none = np.zeros_like(couples)
    rows = ((slave, np.cross(x, slave)), (master, np.cross(x, master)), (none, couples))
    return np.array(
        [[*one.sum(axis=0), *moment.sum(axis=0), np.sum(np.linalg.norm(one, axis=1))] for one, moment in rows]
    )
