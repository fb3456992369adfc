"""Resultant force and moment of every load and support, and the balance of all forces on the body.

Loads, reactions of the supports and contact forces on the body add up to zero, and so do their moments about any point:
the stress does no work on a rigid motion.  The reactions are the internal forces less loads, springs and contact forces
along the held directions, so that what is left over is the residual at the free nodes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import NodalForces
from ..linalg.reductions import Reductions


@dataclass(frozen=True, eq=False)
class Resultant:
    """Force and moment of a load or a support on the body.

    Attributes:
        kind: Its kind: "traction", "body_force", ..., "clamp", "prescribed_displacement", "spring", ...
        face: Where it acts; None for the whole body.
        name: Kind and face, "clamp_left", as in the columns of history.csv; of several of one kind on one face the
            second is "clamp_left_2".
        force: In newtons, shape (3,).
        moment: About the origin in newton metres, shape (3,).
        nodal: Sum of the magnitudes of its nodal forces, newtons.
    """

    kind: str
    face: str | None
    name: str
    force: FloatArray
    moment: FloatArray
    nodal: float

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        given = {"kind": self.kind, "face": self.face, "name": self.name}
        return {**given, "force": self.force.tolist(), "moment": self.moment.tolist()}


@dataclass(frozen=True)
class BodyBalance:
    """The balance of one of several bodies.

    Attributes:
        contact: Force and moment of all contact on it.
        balance: What its loads, its supports and contact leave over, relative to the largest of them (`balance`).
    """

    name: str
    contact: Resultant
    balance: float

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        force, moment = self.contact.force.tolist(), self.contact.moment.tolist()
        return {"name": self.name, "contact_force": force, "contact_moment": moment, "balance": self.balance}


@dataclass(frozen=True, eq=False)
class RigidFaceMotion:
    """The motion of a rigid face, and what holds it; or of a foundation under load, and what contact does on it.

    Attributes:
        face: Its name.
        point: The reference point in metres, shape (3,); of a foundation, and in large motions, where it has moved to.
        translation: Displacement of the point in metres, shape (3,); of a foundation in addition to the motion given.
        rotation: Rotation about it in radians, of finite rotations the vector, shape (3,).
        force: Force on the face along prescribed components, or of contact on the foundation, newtons, shape (3,).
        moment: The same about the point, newton metres, shape (3,).
    """

    face: str
    point: FloatArray
    translation: FloatArray
    rotation: FloatArray
    force: FloatArray
    moment: FloatArray

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}


@dataclass(frozen=True)
class BoltForce:
    """What a bolt carries across its section.

    Attributes:
        face: The slave face of the section.
        force: Force along the bolt in newtons, positive where it pulls.
        shear: Size of the force across it, newtons.
        bending: Size of the moment about the middle of the section across the bolt, newton metres.
        torsion: Moment about the bolt, newton metres.
        shortening: By how much the bolt has been shortened, metres.
        locked: Whether that is given: prescribed, or locked after tightening.
    """

    face: str
    force: float
    shear: float
    bending: float
    torsion: float
    shortening: float
    locked: bool

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return dict(vars(self))


@dataclass(frozen=True)
class ForceBalance:
    """All that acts on the bodies at one time.

    Attributes:
        reactions: Every clamp, prescribed displacement and spring.
        balance: What they and the contact forces leave over, relative to the largest of them (`balance`).
        bodies: Of several bodies the balance of each; empty for one.
        ties: Force and moment of every tie on its slave face.
    """

    loads: tuple[Resultant, ...]
    reactions: tuple[Resultant, ...]
    balance: float
    bodies: tuple[BodyBalance, ...] = ()
    ties: tuple[Resultant, ...] = ()
    rigid_faces: tuple[RigidFaceMotion, ...] = ()
    bolts: tuple[BoltForce, ...] = ()
    loaded_foundations: tuple[RigidFaceMotion, ...] = ()

    def entries(self) -> dict[str, Any]:
        """As in summary.json."""
        return {
            "loads": [load.entry() for load in self.loads],
            "reactions": [reaction.entry() for reaction in self.reactions],
            "balance": self.balance,
            **({"ties": [tie.entry() for tie in self.ties]} if self.ties else {}),
            **({"rigid_faces": [face.entry() for face in self.rigid_faces]} if self.rigid_faces else {}),
            **({"bolts": [bolt.entry() for bolt in self.bolts]} if self.bolts else {}),
            **({"loaded_foundations": [one.entry() for one in moving]} if (moving := self.loaded_foundations) else {}),
            **({"bodies": [body.entry() for body in self.bodies]} if self.bodies else {}),
        }


def resultants(parts: Iterable[NodalForces], x: FloatArray, over: Reductions) -> tuple[Resultant, ...]:
    """The resultant of each of several nodal forces at nodes x (k, 3), in their order; collective."""
    totals: list[Resultant] = []
    seen: Counter[str] = Counter()
    for part in parts:
        name = part.kind if part.face is None else f"{part.kind}_{part.face}"
        seen[name] += 1
        name = name if seen[name] == 1 else f"{name}_{seen[name]}"
        total = over.total(np.concatenate([part.forces.sum(axis=0), np.cross(x, part.forces).sum(axis=0)]))
        nodal = over.sum(np.linalg.norm(part.forces, axis=1))
        totals.append(Resultant(part.kind, part.face, name, total[:3], total[3:], nodal))
    return tuple(totals)


def resultant_of_ground(
    ground: FloatArray, u: FloatArray, x: FloatArray, over: Reductions, body: str = ""
) -> Resultant:
    """Force and moment on a body of elastic foundations that are terms of its internal forces; collective.

    By symmetry, the work of the internal forces of u (k, 3) on a rigid motion is that of the nodal forces of the
    motion, `ground` (k, 3, 6), on u; the rest of the body does none.
    """
    count = over.sum(float(len(x)))
    centre = np.array([over.sum(axis) for axis in x.T]) / count
    size = float(np.sqrt(over.sum(np.sum((x - centre) ** 2, axis=1)) / count))
    works = -np.einsum("kcj,kc->kj", ground, u)
    total = over.total(works.sum(axis=0))
    force, moment = total[:3], size * total[3:] + np.cross(centre, total[:3])
    name = f"form_{body}" if body else "form"
    return Resultant("form", body or None, name, force, moment, over.sum(np.linalg.norm(works[:, :3], axis=1)))


def balance(outer: Sequence[Resultant], x: FloatArray, over: Reductions) -> float:
    """What all forces on a body leave over, relative to the largest of them; collective.

    The larger of two figures: the sum of the forces, and the sum of their moments about the centre of the nodes x (k,
    3) over the radius of the body, each over the largest sum of nodal forces of a load, support or contact.
    """
    ends = over.ends(x)
    centre, radius = ends.mean(axis=0), 0.5 * float(np.linalg.norm(ends[1] - ends[0]))
    force: FloatArray = np.sum([part.force for part in outer], axis=0)
    moment = np.sum([part.moment for part in outer], axis=0) - np.cross(centre, force)
    left = float(np.max([np.linalg.norm(force), np.linalg.norm(moment) / radius]))
    return left / (float(np.max([part.nodal for part in outer])) or 1.0)
