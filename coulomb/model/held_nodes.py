"""Nodes of contact faces that are no contact points, and their gaps.

Where the displacement along the normal is prescribed, by supports or by what the node follows, no contact force can
move the node: if it is inside the foundation, supports and foundation contradict each other.  Nodes that face away from
their foundation are outside of it as long as nothing turns them.  Both are judged like contact points, by their own
place and displacement, also where contact points are averages over several nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ..arrays import BoolArray, FloatArray, Int32Array, unit_vectors
from ..fem.bodies import Deformable
from ..fem.contact import Pair, distance_along, faces_away, facets_of, free_lengths, hits, nodal_points
from ..fem.geometry import HELD_BELOW, RigidFoundation, RigidMotion, first_place, on_all_ranks
from ..linalg.reductions import Reductions
from ..units import amount
from .contact import Contact

SINGLE_PRECISION: Final = 1e-7
"""Depth of held nodes before deformation, over the extent of their body, that coordinates of seven digits leave."""

ROUNDING: Final = 64.0 * float(np.finfo(float).eps)
"""Depth that is a rounding error, over the largest coordinate and displacement."""


class FoundationFace:
    """A contact face and its foundation at a time, by the facets and the foundation alone.

    Attributes:
        facets: This rank's facets of it.
        nodes: Its nodes among those of the body on this rank, shape (q,).
        motion: That of the foundation, by default the one that is given with the contact.
    """

    def __init__(
        self,
        contact: Contact,
        foundation: RigidFoundation,
        elasticity: Deformable,
        time: float,
        motion: RigidMotion | None = None,
    ):
        self.contact, self.time, self.comm = contact, time, elasticity.comm
        self.what = f"contact face {contact.face!r}"
        self.member, self.facets = elasticity.face(contact.face, "contact")
        self.nodes = self.member.body.nodes_of(self.facets)
        self.motion = motion or on_all_ranks(lambda: contact.rigid_motion(time, self.what), "", self.comm)
        self._foundation = foundation

    @cached_property
    def outward(self) -> FloatArray:
        """Unit normals of the face at the body's nodes, shape (k, 3), 0 off the face; collective."""
        _, sums = self.member.body.positive_weights(self.facets)
        outward = np.zeros_like(self.member.body.x)
        outward[self.nodes] = unit_vectors(sums[self.nodes])
        return outward

    def slope(self, x: FloatArray) -> FloatArray:
        """Gradient of the signed distance at points x (m, 3); ValueError on every rank if it fails; collective."""

        def found() -> FloatArray:
            here = self.motion
            return here.turned(self._foundation.normal(here.undone(x))) if len(x) else np.zeros((0, 3))

        return on_all_ranks(found, self.what, self.comm)

    def distance(self, x: FloatArray, moved: bool = True) -> FloatArray:
        """Signed distance of points x (m, 3) to the foundation at the time, or where it is given, metres, shape (m,);
        collective."""
        place = self.motion.undone(x) if moved else x
        return on_all_ranks(
            lambda: self._foundation.signed_distance(place) if len(x) else np.zeros(0), self.what, self.comm
        )

    @cached_property
    def gap(self) -> FloatArray:
        """At the body's nodes, along the contact normals, metres, shape (k,), 0 off the face; collective."""
        x = self.member.body.x[self.nodes]
        distance = self.distance(x)
        if self.contact.normals == "body":
            n, place, there = self.motion.turned_back(self.outward[self.nodes]), self.motion.undone(x), self._foundation
            distance = on_all_ranks(lambda: distance_along(n, place, distance, there), self.what, self.comm)
        return self._at_nodes(distance)

    @cached_property
    def given(self) -> FloatArray:
        """The part of the gap that is given with the contact, metres, shape (k,), 0 off the face; collective."""
        factor = self.contact.gap_factor(self.time, self.comm)
        return self._at_nodes(factor * self.contact.gap_at(self.member.body.reference[self.nodes], self.comm))

    def _at_nodes(self, values: FloatArray) -> FloatArray:
        everywhere = np.zeros(len(self.member.body.x))
        everywhere[self.nodes] = values
        return everywhere

    def beside(self, elasticity: Deformable, moved: FloatArray | float = 0.0) -> OtherNodes:
        """Its nodes that are no contact points; `elasticity` are the bodies with their supports and ties, moved by so
        much, metres, shape (k, 3); collective."""
        body, x, over = self.member.body, elasticity.x + moved, Reductions(self.comm)
        single = nodal_points(body, self.facets).of(self.member, elasticity)
        slope, here = self.slope(x[single.nodes]), self.outward[self.nodes]
        n = here if self.contact.normals == "body" else -slope
        held = free_lengths(single, n, elasticity) <= HELD_BELOW
        which = held | (self.contact.facing & faces_away(slope, here))
        local, nodes, slope, held = self.nodes[which], single.nodes[which], slope[which], held[which]
        before = self.distance(body.reference[local], moved=False)
        extent = float(np.max(over.extent(body.reference)))
        gap = self.distance(x[nodes]) + self.given[local]
        normals = without_slopes(slope, body.held.projector_at(local), held)
        return OtherNodes(self.comm, nodes, x, normals, touching(gap, before, extent, held), held)


def without_slopes(slope: FloatArray, H: FloatArray, held: BoolArray) -> FloatArray:
    """Unit normals into foundations with gradients `slope` of the signed distance, shapes (q, 3); where nodes are held,
    those of the supports, with projectors H (q, 3, 3): at a small angle to them a node slides along its support."""
    along = -np.einsum("kij,kj->ki", H, slope)
    size = np.linalg.norm(along, axis=1)[:, None]
    return np.where(held[:, None] & (size > 0.5), along / np.maximum(size, 0.5), -slope)


def touching(gap: FloatArray, before: FloatArray, extent: float, held: BoolArray) -> FloatArray:
    """Gaps of nodes, shape (q,), less the depths of held ones at the beginning (`before` is the distance then) that
    coordinates of seven digits leave in a body of an extent, metres."""
    rounded = held & (before >= -SINGLE_PRECISION * extent)
    return gap - np.where(rounded, np.minimum(before, 0.0), 0.0)


@dataclass(frozen=True, eq=False)
class OtherNodes:
    """Nodes of a contact face that are no contact points; this rank's q.

    Attributes:
        nodes: Among this rank's k nodes, shape (q,).
        x: Coordinates of all k nodes, metres, shape (k, 3).
        n: Unit normals, into the foundation or the face opposite, shape (q, 3).
        gap: Along them, metres, shape (q,).
        held: Whether the displacement along them is prescribed, shape (q,); others face away from the foundation.
        opposite: In pairs, the averages of nodal vectors (k, 3) on the face opposite, shape (q, 3); collective.
    """

    comm: MPI.Comm
    nodes: Int32Array
    x: FloatArray
    n: FloatArray
    gap: FloatArray
    held: BoolArray
    opposite: Callable[[FloatArray], FloatArray | None] | None = None

    def remaining(self, u: FloatArray) -> FloatArray:
        """The gap that displacements u (k, 3) leave, metres, shape (q,), 0 where it is a rounding error; collective."""
        there = None if self.opposite is None else self.opposite(u)
        moved = u[self.nodes] if there is None else u[self.nodes] - there
        left: FloatArray = self.gap - np.einsum("qi,qi->q", self.n, moved)
        over = Reductions(self.comm)
        size = over.max(np.abs(self.x)) + over.max(np.abs(u))
        return np.where(np.abs(left) <= ROUNDING * size, 0.0, left)


def beside_pair(elasticity: Deformable, pair: Pair, adjust: float, deepest: float) -> OtherNodes | None:
    """Nodes of the slave face of a pair that supports hold along its normal, opposite to nodes of the master that are
    held as well; None if there are none on any rank; collective.

    Found by lines along the normals, not by the mortar integration.  Meshes that overlap before any displacement, by
    their polygons or by an interference, no deeper than the deepest in metres, are taken to touch there.
    """
    comm, (slave, on_slave), (master, on_master) = (
        elasticity.comm,
        *(elasticity.face(name, "contact") for name in (pair.face, pair.against)),
    )
    body, nodes = slave.body, slave.body.nodes_of(on_slave)
    n = unit_vectors(body.positive_weights(on_slave)[1][nodes])
    single = nodal_points(body, on_slave).of(slave, elasticity)
    still = free_lengths(single, n, elasticity) <= HELD_BELOW
    if not comm.allreduce(bool(np.any(still)), op=MPI.LOR):
        return None
    own, face = facets_of(body, on_slave)[0], facets_of(master.body, on_master)[0]
    hit = hits(body.x[nodes], n, face, min(own.extent, deepest), own.extent)
    which = still & (hit.facet >= 0)
    facet, place, gap = hit.facet[which], hit.place[which], np.maximum(hit.way[which], 0.0)
    values, columns = face.at(facet, place)[0], elasticity.numbers_of(master, face.nodes[facet].ravel())
    rows = values.ravel(), columns, values.shape[1] * np.arange(len(facet) + 1)
    opposite = scipy.sparse.csr_matrix(rows, (len(facet), elasticity.numbering.total))
    points = replace(single.only(which), opposite=opposite, nodal=False)
    held, gap = free_lengths(points, n[which], elasticity) <= HELD_BELOW, np.where(gap <= adjust, 0.0, gap)
    if not comm.allreduce(bool(np.any(held)), op=MPI.LOR):
        return None
    points = points.only(held)
    of = points.opposite_average
    return OtherNodes(comm, points.nodes, elasticity.x, n[which][held], gap[held], held[held], of)


class HeldInPairs:
    """Nodes of pairs that supports hold on both sides (`beside_pair`); `pair` gives a pair by its number."""

    def __init__(self, contacts: Sequence[Contact], elasticity: Deformable, pair: Callable[[int], Pair]):
        self._contacts, self._elasticity, self._pair = contacts, elasticity, pair
        self._found: dict[int, OtherNodes | None] = {}

    def at(self, number: int, time: float) -> OtherNodes | None:
        """Those of a pair with their gaps at a time; None if there are none; collective."""
        contact, comm = self._contacts[number], self._elasticity.comm
        if number not in self._found:
            pair, gaps = self._pair(number), contact.closed[0]
            self._found[number] = beside_pair(self._elasticity, pair, gaps, contact.shape.depth)
        nodes = self._found[number]
        if nodes is None:
            return None
        given = contact.gap_factor(time, comm) * contact.gap_at(self._elasticity.reference[nodes.nodes], comm)
        return replace(nodes, gap=nodes.gap + given)


def refuse_held_inside(
    contacts: Sequence[Contact],
    foundations: Sequence[RigidFoundation | None],
    pairs: HeldInPairs,
    elasticity: Deformable,
    time: float,
    prescribed: FloatArray,
    exact: bool = False,
) -> None:
    """Refuse supports that hold nodes of contact faces inside foundations, or inside faces opposite, at a time;
    collective.

    Args:
        foundations: Their foundations; None of pairs.
        pairs: Nodes of pairs that are held on both sides; not asked for if `exact`.
        elasticity: The bodies with their supports and ties.
        time: In seconds.
        prescribed: Displacements where they are prescribed, metres, shape (k, 3).
        exact: Whether gaps are those at the displaced nodes, as in large motions, or linear in the displacement.

    Raises:
        ValueError: On every rank, with face, number of nodes and depth.
    """
    for number, (contact, foundation) in enumerate(zip(contacts, foundations, strict=True)):
        if contact.load:  # it gives way
            continue
        if foundation is not None:
            face = FoundationFace(contact, foundation, elasticity, time)
            nodes, what = face.beside(elasticity, prescribed if exact else 0.0), "the foundation"
        elif exact or (found_in_pair := pairs.at(number, time)) is None:
            continue
        else:
            nodes, what = found_in_pair, repr(contact.against)
        depth = -nodes.remaining(np.zeros_like(prescribed) if exact else prescribed)[nodes.held]
        inside = depth > 0.0
        place = first_place(elasticity.x[nodes.nodes[nodes.held]], inside) if np.any(inside) else ""
        inner = elasticity.comm.allgather((int(inside.sum()), float(np.max(depth, initial=0.0)), place))
        if count := sum(number for number, _, _ in inner):
            where, sign = next(place for number, _, place in inner if number), ""
            if isinstance(contact.gap, int | float) and contact.gap < 0.0:
                sign = f"its gap of {amount(contact.gap)} is an interference, a distance is positive; "
            raise ValueError(
                f"contact face {contact.face!r}: supports, or what its nodes follow, hold {count} of its nodes inside "
                f"{what}, up to {amount(max(depth for _, depth, _ in inner))} deep at time {time:g} (first seen at x = "
                f"{where}), where no contact force can move them: {sign}prescribe displacements that stay outside, "
                "move the foundation less, or end the support or the contact face before these nodes"
            )
