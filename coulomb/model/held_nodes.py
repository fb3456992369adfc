"""Nodes of contact faces that are no contact points, and their gaps.

Where the displacement along the normal is prescribed, by supports or by what the node follows, no contact force can
move the node: if it is inside the foundation, supports and foundation contradict each other.  Nodes that face away from
their foundation are outside of it as long as nothing turns them.  Both are judged like contact points, by their own
place and displacement, also where contact points are averages over several nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray, unit_vectors
from ..fem.bodies import Deformable
from ..fem.contact import distance_along, faces_away, free_lengths, nodal_points
from ..fem.geometry import HELD_BELOW, RigidFoundation, first_place, on_all_ranks
from ..linalg.reductions import Reductions
from .contact import Contact

SINGLE_PRECISION: Final = 1e-7
"""Depth of held nodes before deformation, over the extent of their body, that coordinates of seven digits leave."""

ROUNDING: Final = 64.0 * float(np.finfo(float).eps)
"""Depth that is a rounding error, over the largest coordinate and displacement."""


class FoundationFace:
    """A contact face and its foundation at a time, by the facets and the foundation alone.

    Attributes:
        what: The face in words.
        member: The body of the face.
        facets: This rank's facets of it.
        nodes: Its nodes among those of the body on this rank, shape (q,).
        motion: That of the foundation.
    """

    def __init__(self, contact: Contact, foundation: RigidFoundation, elasticity: Deformable, time: float):
        self.contact, self.time, self.comm = contact, time, elasticity.comm
        self.what = f"contact face {contact.face!r}"
        self.member, self.facets = elasticity.face(contact.face, "contact")
        self.nodes = self.member.body.nodes_of(self.facets)
        self.motion = on_all_ranks(lambda: contact.rigid_motion(time, self.what), "", self.comm)
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
        return self._at_nodes(factor * self.contact.gap_at(self.member.body.x[self.nodes], self.comm))

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
        extent = max(over.max(axis) + over.max(-axis) for axis in body.reference.T)
        gap = self.distance(x[nodes]) + self.given[local]
        n, gap = without_slopes(slope, body.held.projector_at(local), held), touching(gap, before, extent, held)
        return OtherNodes(self.comm, nodes, x, n, gap, held)


def without_slopes(slope: FloatArray, H: FloatArray, held: npt.NDArray[np.bool_]) -> FloatArray:
    """Unit normals into foundations with gradients `slope` of the signed distance, shapes (q, 3); where nodes are held,
    those of the supports, with projectors H (q, 3, 3): at a small angle to them a node slides along its support."""
    along = -np.einsum("kij,kj->ki", H, slope)
    size = np.linalg.norm(along, axis=1)[:, None]
    return np.where(held[:, None] & (size > 0.5), along / np.maximum(size, 0.5), -slope)


def touching(gap: FloatArray, before: FloatArray, extent: float, held: npt.NDArray[np.bool_]) -> FloatArray:
    """Gaps of nodes, shape (q,), less the depths of held ones at the beginning (`before` is the distance then) that
    coordinates of seven digits leave in a body of an extent, metres."""
    rounded = held & (before >= -SINGLE_PRECISION * extent)
    found: FloatArray = gap - np.where(rounded, np.minimum(before, 0.0), 0.0)
    return found


@dataclass(frozen=True)
class OtherNodes:
    """Nodes of a contact face that are no contact points; this rank's q.

    Attributes:
        comm: The ranks.
        nodes: Among this rank's k nodes, shape (q,).
        x: Coordinates of all k nodes, metres, shape (k, 3).
        n: Unit normals, into the foundation, shape (q, 3).
        gap: Along them, metres, shape (q,).
        held: Whether the displacement along them is prescribed, shape (q,); others face away from the foundation.
    """

    comm: MPI.Comm
    nodes: npt.NDArray[np.int32]
    x: FloatArray
    n: FloatArray
    gap: FloatArray
    held: npt.NDArray[np.bool_]

    def remaining(self, u: FloatArray) -> FloatArray:
        """The gap that displacements u (k, 3) leave, metres, shape (q,), 0 where it is a rounding error; collective."""
        left: FloatArray = self.gap - np.einsum("qi,qi->q", self.n, u[self.nodes])
        over = Reductions(self.comm)
        size = over.max(np.abs(self.x)) + over.max(np.abs(u))
        return np.where(np.abs(left) <= ROUNDING * size, 0.0, left)


def refuse_held_inside(
    contacts: Sequence[Contact],
    foundations: Sequence[RigidFoundation | None],
    elasticity: Deformable,
    time: float,
    prescribed: FloatArray,
    exact: bool = False,
) -> None:
    """Refuse supports that hold nodes of contact faces inside foundations at a time; collective.

    Args:
        contacts: The contact faces.
        foundations: Their foundations where they are given; None of pairs.
        elasticity: The bodies with their supports and ties.
        time: In seconds.
        prescribed: Displacements where they are prescribed, metres, shape (k, 3).
        exact: Whether gaps are those at the displaced nodes, as in large motions, or linear in the displacement.

    Raises:
        ValueError: On every rank, with face, number of nodes and depth.
    """
    for contact, foundation in zip(contacts, foundations, strict=True):
        if foundation is None:
            continue
        face = FoundationFace(contact, foundation, elasticity, time)
        nodes = face.beside(elasticity, prescribed if exact else 0.0)
        depth = -nodes.remaining(np.zeros_like(prescribed) if exact else prescribed)[nodes.held]
        inside = depth > 0.0
        place = first_place(elasticity.x[nodes.nodes[nodes.held]], inside) if np.any(inside) else ""
        found = elasticity.comm.allgather((int(inside.sum()), float(np.max(depth, initial=0.0)), place))
        if count := sum(number for number, _, _ in found):
            where = next(place for number, _, place in found if number)
            raise ValueError(
                f"{face.what}: supports, or what its nodes follow, hold {count} of its nodes inside the foundation, up "
                f"to {max(depth for _, depth, _ in found):.3g} m deep at time {time:g} (first seen at x = {where}), "
                "where no contact force can move them: prescribe displacements that stay outside, move the foundation "
                "less, or end the support or the contact face before these nodes"
            )
