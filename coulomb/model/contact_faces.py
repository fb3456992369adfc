"""The contact faces of a body: their foundations or the faces against them at any time, and their common surface."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.bodies import Deformable
from ..fem.contact import ContactSurface, Pair, contact_surface, joined, lost_nodes, pair_of, pair_surface, slave_side
from ..fem.geometry import RigidFoundation, RigidMotion, moved, on_all_ranks
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw
from .contact import Contact


def oriented(elasticity: Deformable, contacts: Sequence[Contact]) -> tuple[tuple[Contact, ...], tuple[str, ...]]:
    """Contacts with the slave of every pair as their face, and what was chosen in words; collective."""
    found, words = [], []
    pairs = [{contact.face, contact.against} for contact in contacts if contact.against is not None]
    for number, pair in enumerate(pairs):
        if pair in pairs[:number]:
            raise ValueError(f"contact: the pair of {' and '.join(map(repr, sorted(map(str, pair))))} is given twice")
    for contact in contacts:
        if contact.against is None:
            found.append(contact)
            continue
        if contact.slave:
            slave, master, why = contact.face, contact.against, "it was given as the slave"
        else:
            slave, master, why = slave_side(elasticity, contact.face, contact.against)
        found.append(contact if slave == contact.face else contact.exchanged())
        words.append(f"contact of {slave!r} with {master!r}: contact points on the first, since {why}")
    return tuple(found), tuple(words)


class ContactFaces:
    """The contact faces of a body, their foundations (None: the plane of the face), pairs, and common surface at any
    time."""

    def __init__(
        self,
        contacts: Sequence[Contact],
        comm: MPI.Comm,
        foundations: Sequence[RigidFoundation | None] | None = None,
        pairs: dict[int, Pair] | None = None,
    ):
        if not contacts:
            raise ValueError("contact: give one face or several")
        self._contacts, self._comm = contacts, comm
        self.foundations = [contact.foundation for contact in contacts] if foundations is None else foundations
        self._pairs: dict[int, Pair] = {} if pairs is None else pairs

    def against(self, foundations: Sequence[RigidFoundation | None]) -> ContactFaces:
        return ContactFaces(self._contacts, self._comm, foundations, self._pairs)

    def pair(self, number: int, elasticity: Deformable) -> Pair:
        """The pair of faces of a contact against a deformable face; all are found at once; collective.

        Nodes of a face against a foundation are contact points there, others at the nearest master (`lost_nodes`).
        """
        if number not in self._pairs:
            self._pairs |= self._all_pairs(elasticity)
        return self._pairs[number]

    def _all_pairs(self, elasticity: Deformable) -> dict[int, Pair]:
        taken: npt.NDArray[np.bool_] = np.zeros(len(elasticity.x), dtype=bool)
        for contact in self._contacts:
            if contact.against is None:
                taken[elasticity.nodes(contact.face, "contact")] = True
        left_out = {number: taken for number, contact in enumerate(self._contacts) if contact.against is not None}
        over, found, changed = Reductions(self._comm), {}, list(left_out)
        size = over.max(np.abs(elasticity.x).ravel())
        while changed:
            for each in changed:
                contact = self._contacts[each]
                assert contact.against is not None
                found[each] = pair_of(
                    elasticity, contact.face, contact.against, contact.adjust, left_out[each], contact.shape
                )
            points = {each: (pair.points.nodes, pair.gap) for each, pair in found.items()}
            lost = lost_nodes(points, len(taken), size)
            changed = [each for each in lost if self._comm.allreduce(bool(np.any(lost[each])), op=MPI.LOR)]
            left_out |= {each: left_out[each] | lost[each] for each in changed}
        return found

    def rigid_motions(self, time: float) -> tuple[RigidMotion, ...]:
        return on_all_ranks(
            lambda: tuple(c.rigid_motion(time, "contact: foundation") for c in self._contacts), "", self._comm
        )

    def gap_factors(self, time: float) -> FloatArray:
        """Amplitudes of the given gaps of all faces at a time, shape (faces,); collective."""
        return np.array([contact.gap_factor(time, self._comm) for contact in self._contacts])

    def surface(self, elasticity: Deformable, motions: Sequence[RigidMotion], time: float) -> ContactSurface:
        """The contact surface with moved foundations, and gaps at a time; collective."""
        surfaces = []
        over = Reductions(self._comm)
        size = np.linalg.norm([over.max(axis) + over.max(-axis) for axis in elasticity.x.T])
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
                    f"contact face {contact.face!r}: gap: an interference of {deepest:g} m is larger than the body, "
                    f"whose extent is {size:g} m: gap is in metres"
                )
            surfaces.append(surface)
        return joined(elasticity, surfaces)

    def law(self, surface: ContactSurface, time: float, slip_rate: FloatArray) -> FrictionLaw:
        """The law of friction at this rank's contact points at a time, slip rates (m,) in m/s; collective."""
        laws, places = [], []
        for part, contact in enumerate(self._contacts):
            here = np.flatnonzero(surface.part == part)
            laws.append(contact.law(surface.x[here], surface.area[here], time, slip_rate[here], self._comm))
            places.append(here)
        return FrictionLaw.joined(laws).at(np.argsort(np.concatenate(places)))
