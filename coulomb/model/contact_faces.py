"""The contact faces of bodies, what they touch, and their common surface at any time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from ..arrays import BoolArray, FloatArray, Int32Array, IntArray
from ..contact_fields import side_names
from ..fem.bodies import Deformable
from ..fem.contact import (
    Candidates,
    ContactSurface,
    Pair,
    contact_surface,
    joined,
    nodes_at_seams,
    own_plane,
    pair_of,
    pair_surface,
    slave_side,
    slid_surface,
)
from ..fem.geometry import RigidFoundation, RigidMotion, moved, on_all_ranks
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw
from ..units import amount
from .contact import Contact
from .foundation_load import FoundationLoads, LoadedFoundation


class StatePoints(NamedTuple):
    """This rank's nodes of contact points, and the numbers of their contact faces, shapes (m,)."""

    nodes: Int32Array
    part: IntArray

    @staticmethod
    def of_faces(elasticity: Deformable, contacts: Sequence[Contact]) -> StatePoints:
        """All nodes of contact faces."""
        faces = [elasticity.nodes(contact.face, "contact") for contact in contacts]
        return StatePoints(np.concatenate(faces), np.repeat(np.arange(len(faces)), [len(nodes) for nodes in faces]))

    def places(self, surface: ContactSurface) -> IntArray:
        """Numbers of the contact points of a surface among these, which have them all."""
        return surface.places_among(self.nodes, self.part)


def slaves_as_faces(elasticity: Deformable, contacts: Sequence[Contact]) -> tuple[tuple[Contact, ...], tuple[str, ...]]:
    """Contacts with the slave of every pair as their face, and what was chosen in words; collective."""
    ordered, words = [], []
    pairs = [{contact.face, contact.against} for contact in contacts if contact.against is not None]
    for number, pair in enumerate(pairs):
        if pair in pairs[:number]:
            raise ValueError(f"contact: the pair of {' and '.join(map(repr, sorted(map(str, pair))))} is given twice")
    for contact in contacts:
        if contact.against is None:
            ordered.append(contact)
            continue
        ties = [tie for tie in elasticity.constraints.lasting if tie.joins(contact.face, contact.against)]
        others = {tie.face for tie in ties} - {contact.face if contact.slave else ties[0].face if ties else ""}
        if others:
            raise ValueError(
                f"contact of {contact.face!r} with {contact.against!r}: their tie has {others.pop()!r} as the slave: "
                "give all the same"
            )
        if ties:
            slave, master, why = ties[0].face, ties[0].against, "it is that of their tie"
        elif contact.slave:
            slave, master, why = contact.face, contact.against, "it was given as the slave"
        else:
            slave, master, why = slave_side(elasticity, contact.face, contact.against)
        ordered.append(contact if slave == contact.face else contact.exchanged())
        words.append(f"contact of {slave!r} with {master!r}: contact points on the first, since {why}")
    return tuple(ordered), tuple(words)


class ContactFaces:
    """The contact faces of a body, their foundations (None of pairs), pairs, and common surface at any time; nodes at
    seams are those of one of them."""

    def __init__(self, contacts: Sequence[Contact], elasticity: Deformable, time: float):
        if not contacts:
            raise ValueError("contact: give one face or several")
        self._contacts, self._comm, self._time = contacts, elasticity.comm, time
        self.foundations: list[RigidFoundation | None] = [
            c.foundation if c.foundation or c.against else own_plane(elasticity, c.face) for c in contacts
        ]
        self._pairs: dict[int, Pair] = {}
        names = [side for side, _ in side_names((contact.face, contact.against) for contact in contacts)]
        self.loads = FoundationLoads([contact.load for contact in contacts], names, elasticity)

    def pair(self, number: int, elasticity: Deformable) -> Pair:
        """The pair of faces of a contact against a deformable face; all are found at once; collective."""
        if number not in self._pairs:
            self._pairs = self._all_pairs(elasticity)
        return self._pairs[number]

    def _all_pairs(self, elasticity: Deformable) -> dict[int, Pair]:
        """Those with nodes at seams anew, without these (`nodes_at_seams`); collective."""

        def found(number: int, taken: BoolArray | None = None) -> Pair:
            one = self._contacts[number]
            assert one.against is not None
            return pair_of(elasticity, one.face, one.against, one.closed, taken, one.shape)

        pairs = {number: found(number) for number, one in enumerate(self._contacts) if one.against is not None}
        if len(self._contacts) == 1:
            return pairs
        contacts, motions = dict[int, Candidates](), self.foundation_motions(self._time)
        for number, (one, rigid) in enumerate(zip(self._contacts, self.foundations, strict=True)):
            if rigid is None:
                pair = pairs[number]
                contacts[number] = Candidates(pair.points.nodes, pair.n, pair.gap, np.sqrt(pair.points.area))
                continue
            there, nodes = moved(rigid, motions[number]), elasticity.nodes(one.face, "contact")
            place = partial(_place_of, there, elasticity.x[nodes])
            n, gap = on_all_ranks(place, f"contact face {one.face!r}: foundation", self._comm)
            contacts[number] = Candidates(nodes, n, gap, np.zeros(len(nodes)))
        size = Reductions(self._comm).max(np.abs(elasticity.x).ravel())
        for number, lost in nodes_at_seams(contacts, list(pairs), len(elasticity.x), size).items():
            if self._comm.allreduce(bool(np.any(lost)), op=MPI.LOR):
                pairs[number] = found(number, lost)
        return pairs

    def foundation_motions(
        self, time: float, poses: FloatArray | None = None, factors: FloatArray | None = None
    ) -> tuple[RigidMotion, ...]:
        """At a time, those given times factors (faces,), by default 1, and of foundations under load their poses;
        collective."""
        given = on_all_ranks(
            lambda: [c.rigid_motion(time, "contact: foundation") for c in self._contacts], "", self._comm
        )
        if factors is not None:
            given = [motion.times(float(factor)) for motion, factor in zip(given, factors, strict=True)]
        return self.loads.posed(given, poses)

    def loaded(
        self, elasticity: Deformable, motions: Sequence[RigidMotion], time: float, poses: FloatArray | None
    ) -> tuple[LoadedFoundation, ...]:
        """The foundations under load after these motions; collective."""
        return self.loads.at(time, motions, poses, len(elasticity.free.bodies))

    def gap_factors(self, time: float) -> FloatArray:
        """Amplitudes of the given gaps of all faces at a time, shape (faces,); collective."""
        return np.array([contact.gap_factor(time, self._comm) for contact in self._contacts])

    def surface(self, elasticity: Deformable, motions: Sequence[RigidMotion], time: float) -> ContactSurface:
        """The contact surface with moved foundations, and gaps at a time; collective."""
        surfaces = []
        over = Reductions(self._comm)
        size = np.linalg.norm(over.extent(elasticity.x))
        for number, (contact, foundation, motion, factor) in enumerate(
            zip(self._contacts, self.foundations, motions, self.gap_factors(time), strict=True)
        ):
            given = partial(contact.gap_at, comm=self._comm)
            if contact.against is not None:
                surface = pair_surface(elasticity, self.pair(number, elasticity), contact.axes, given, factor)
            else:
                there = foundation and moved(foundation, motion)
                axes, facing = contact.axes, contact.facing
                surface = contact_surface(elasticity, contact.face, there, contact.normals, axes, given, factor, facing)
            deepest = over.max(-factor * surface.gap_field)
            if deepest > size:
                raise ValueError(
                    f"contact face {contact.face!r}: gap: an interference of {amount(deepest)} is larger than the "
                    f"body, whose extent is {amount(float(size))}: check the unit of gap"
                )
            surfaces.append(surface)
        return joined(elasticity, surfaces)

    def slid(self, surface: ContactSurface, elasticity: Deformable, u: FloatArray, time: float) -> ContactSurface:
        """The contact surface of faces that are against deformable ones alone after small displacements u (k, 3) in
        metres from where it is (`slid_surface`); collective."""
        given = self.gap_factors(time)[surface.part] * surface.gap_field
        each = (
            slid_surface(elasticity, self.pair(number, elasticity), one.axes, u, given[surface.part == number])
            for number, one in enumerate(self._contacts)
        )
        return joined(elasticity, list(each))

    def law(self, surface: ContactSurface, time: float, slip_rate: FloatArray) -> FrictionLaw:
        """The law of friction at this rank's contact points at a time, slip rates (m,) in m/s; collective."""
        laws, places, x = [], [], surface.points.before_deformation(surface.x)
        for part, contact in enumerate(self._contacts):
            here = np.flatnonzero(surface.part == part)
            laws.append(contact.law(x[here], surface.area[here], time, slip_rate[here], self._comm))
            places.append(here)
        return FrictionLaw.joined(laws).at(np.argsort(np.concatenate(places)))


def _place_of(foundation: RigidFoundation, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normals (k, 3) into a foundation, and distances from it (k,), at points x (k, 3)."""
    return (-foundation.normal(x), foundation.signed_distance(x)) if len(x) else (x, x[:, 0])
