"""Where surfaces of a problem run through each other outside of its contacts (`fem.contact.overlaps`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Deformable
from ..fem.contact import ContactSurface, Face, Obstacle, Overlap, Sides, Surface
from ..fem.geometry import RigidFoundation, RigidMotion, moved
from ..linalg.reductions import Reductions
from .contact import Contact


class OutsideContacts:
    """Bodies before deformation with what judges their surfaces where: contact pairs and ties.

    Args:
        contacts: Their contacts, of pairs with the slave as face.
        foundations: Of the contacts, before any motion; None of pairs.
    """

    def __init__(self, body: Deformable, contacts: Sequence[Contact], foundations: Sequence[RigidFoundation | None]):
        self._body, self._contacts, self._foundations = body, contacts, foundations
        self._ties = [tie for tie in body.constraints.ties if tie.of_faces]
        self._pairs = [k for k, contact in enumerate(contacts) if contact.against is not None]
        names = [(contacts[k].face, str(contacts[k].against)) for k in self._pairs]
        names += [(tie.face, tie.against) for tie in self._ties]
        sides = [Sides(self._face(slave), self._face(master)) for slave, master in names]
        self._surface = Surface(body.members, sides, body.comm)

    def _face(self, name: str) -> Face:
        member, facets = self._body.face(name, "contact")
        return [one.name for one in self._body.members].index(member.name), facets

    def overlap(
        self,
        points: ContactSurface,
        given: FloatArray,
        motions: Sequence[RigidMotion],
        u: FloatArray,
        deformation: FloatArray,
        large: bool = False,
    ) -> Overlap | None:
        """Where surfaces run through each other, with these contact points, gaps given there (m,), and motions of the
        foundations; other arguments as of `Surface.deepest`; collective."""
        judged = [*(points.nodes[points.part == k] for k in self._pairs), *(tie.nodes for tie in self._ties)]
        over, count = Reductions(self._body.comm), range(len(self._contacts))
        gaps = [over.max(np.append(given[points.part == k], 0.0)) for k in count]
        obstacles = [
            Obstacle(repr(contact.face), self._face(contact.face), foundation, moved(foundation, motion), gap)
            for contact, foundation, motion, gap in zip(self._contacts, self._foundations, motions, gaps, strict=True)
            if foundation is not None
        ]
        of_pairs = [*(gaps[k] for k in self._pairs), *(0.0 for _ in self._ties)]
        return self._surface.deepest(u, self._body.component, deformation, judged, of_pairs, obstacles, large)
