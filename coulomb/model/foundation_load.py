"""Foundations under a given force and moment (`Contact.force`, `Contact.moment`): their motion is a part of the answer.

Such a foundation moves along the axes along which a force is given, and turns about those about which a moment is; in
other directions it has the motion that is given with it.  With its displacement R q at the contact points in its free
motions of amounts q, the relative displacement is B u - R q, and its own equilibrium R^T x + F = 0: rows G = -R^T and e
= F beside those of bodies that contact alone holds (`solvers/rigid_motions.py`).

That is linear in q from the place where the foundation is.  It is put where the answer has moved it, exactly, and the
problem is solved anew until its certificate passes there (Newton's method; a plane that does not turn is there at
once).  The answer is then that of the same foundation with that motion given, and one line of the certificate is
added: forces and moments of contact on the foundation and those given add up to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..arrays import BoolArray, FloatArray, is_number
from ..fem.bodies import Deformable, FreeMotion, FreeMotions, RigidPart
from ..fem.geometry import (
    Amplitude,
    Point,
    RigidMotion,
    Turn,
    check_point,
    evaluate_amplitude,
    on_all_ranks,
    turn_by_change,
)
from ..linalg.reductions import Reductions
from ..units import amount
from .nodal_answer import NodalAnswer
from .resultants import Resultant, RigidFaceMotion

Components = Sequence[float | None]
"""Three numbers along x, y and z, None where the motion of the foundation is given instead."""


@dataclass(frozen=True)
class FoundationLoad:
    """What is given of force and moment on the foundation of a contact face; arguments and errors as of `Contact`."""

    face: str
    force: Components
    moment: Components
    point: Point | None
    amplitude: Amplitude

    def __post_init__(self) -> None:
        for name, given in (("force", self.force), ("moment", self.moment)):
            components = list(given) if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) else []
            if len(components) != 3 or not all(one is None or is_number(one, -np.inf) for one in components):
                raise ValueError(
                    f"contact: {name} on the foundation must be three numbers along x, y and z, None where its motion "
                    f"is given instead, but is {given!r}"
                )
        constant = is_number(self.amplitude, -np.inf) and self.amplitude == 1.0
        if not self and not (self.point is None and constant):
            raise ValueError("contact: force_point and force_amplitude go with a force or moment on the foundation")
        if self.point is not None:
            check_point("contact: force_point", self.point)

    def __bool__(self) -> bool:
        return bool(np.any(self.free))

    def __str__(self) -> str:
        """ "force z -500 N, moment y 0 N m"."""
        given = (("force", self.force, "N"), ("moment", self.moment, "N m"))
        said = ((name, zip("xyz", of, strict=True), unit) for name, of, unit in given)
        parts = (
            (name, [f"{axis} {amount(one, unit)}" for axis, one in of if one is not None]) for name, of, unit in said
        )
        return ", ".join(f"{name} {', '.join(each)}" for name, each in parts if each)

    @property
    def free(self) -> BoolArray:
        """Along and about which axes the foundation moves, shape (6,)."""
        return np.array([one is not None for one in (*self.force, *self.moment)])

    @property
    def turns(self) -> bool:
        """Whether a moment is given."""
        return bool(np.any(self.free[3:]))


@dataclass(frozen=True, eq=False)
class LoadedFoundation:
    """A foundation under load at one time.

    Attributes:
        number: Of its contact.
        name: Of that in files.
        of: What is given.
        pose: How it has moved in addition to the motion given with it: translation of its point in metres, and rotation
            vector in radians, shape (6,).
        motions: Its q free motions from there, each of one metre: translations, and rotations about its point.
        load: Force along each, newtons, shape (q,).
    """

    number: int
    name: str
    of: FoundationLoad
    pose: FloatArray
    motions: tuple[FreeMotion, ...]
    load: FloatArray

    @property
    def point(self) -> FloatArray:
        """Where the force acts now, metres, shape (3,)."""
        return self.motions[0].part.centre

    def displacement(self, amounts: FloatArray, x: FloatArray) -> FloatArray:
        """Of its points x (k, 3) in free motions of amounts (q,), metres, shape (k, 3)."""
        moved = np.zeros_like(x)
        for way, motion in zip(amounts, self.motions, strict=True):
            moved += way * motion.at(x)
        return moved

    def moved(self, amounts: FloatArray) -> FloatArray:
        """Its pose after free motions of amounts (q,), shape (6,)."""
        way = amounts @ np.array([motion.translation for motion in self.motions])
        turn = amounts @ np.array([motion.rotation for motion in self.motions])
        change = np.concatenate([way, np.linalg.solve(turn_by_change(self.pose[3:]), turn)])
        return self.pose + np.where(self.of.free, change, 0.0)


class FoundationLoads:
    """Force and moment on the foundations of several contacts.

    Args:
        loads: What is given for each.
        names: Of the contacts in files (`side_names`).
    """

    def __init__(self, loads: Sequence[FoundationLoad], names: Sequence[str], elasticity: Deformable):
        self._comm, self._copies, self._loads = elasticity.comm, elasticity.copies, dict[int, FoundationLoad]()
        self.names = {number: names[number] for number, load in enumerate(loads) if load}
        self._parts, over = dict[int, RigidPart](), Reductions(elasticity.comm)
        for number, load in enumerate(loads):
            if load:
                member, facets = elasticity.face(load.face, "contact")
                body, area = member.body, member.body.area_of(facets)
                middle = over.total(area @ body.x) / over.sum(area)
                point = middle if load.point is None else np.array(load.point, dtype=np.float64)
                radius = over.max(np.linalg.norm(body.x[body.nodes_of(facets)] - point, axis=1))
                self._loads[number], self._parts[number] = load, RigidPart(point, radius or 1.0)

    @property
    def points(self) -> dict[int, Point]:
        """Where the force on the foundation of each contact acts before any motion, by its number."""
        return {
            number: (float(x), float(y), float(z))
            for number, (x, y, z) in ((k, part.centre) for k, part in self._parts.items())
        }

    def posed(self, given: Sequence[RigidMotion], poses: FloatArray | None) -> tuple[RigidMotion, ...]:
        """The motions of all foundations: those given, and of those under load their poses (faces, 6), by default 0."""
        motions = list(given)
        for number, load in self._loads.items():
            pose, turn = np.zeros(6) if poses is None else poses[number], given[number].turn
            if load.turns:
                angle = float(np.linalg.norm(pose[3:]))
                axis = pose[3:] / angle if angle else np.array([1.0, 0.0, 0.0])
                turn = Turn(self._parts[number].centre, axis, angle)
            motions[number] = RigidMotion(given[number].translation + pose[:3], turn)
        return tuple(motions)

    def at(
        self, time: float, motions: Sequence[RigidMotion], poses: FloatArray | None, components: int
    ) -> tuple[LoadedFoundation, ...]:
        """The foundations under load after these motions, with their poses (faces, 6), by default 0; the bodies have so
        many components; ValueError on every rank if an amplitude fails; collective."""
        loaded, still = list[LoadedFoundation](), np.zeros(3)
        for number, load in self._loads.items():
            what, part = f"contact face {load.face!r}: force", self._parts[number]
            factor = on_all_ranks(partial(evaluate_amplitude, load.amplitude, time, what), "", self._comm)
            here, index = replace(part, centre=part.centre + motions[number].translation), components + len(loaded)
            ways = [FreeMotion(index, here, axis, still) for axis in np.eye(3)]
            ways += [FreeMotion(index, here, still, axis / here.radius) for axis in np.eye(3)]
            given = np.array([one or 0.0 for one in (*load.force, *load.moment)], dtype=np.float64)
            given[3:] /= here.radius
            own = [way for way, free in zip(ways, load.free, strict=True) if free]
            pose = np.zeros(6) if poses is None else poses[number]
            loaded.append(
                LoadedFoundation(
                    number, self.names[number], load, pose, tuple(own), factor / self._copies * given[load.free]
                )
            )
        return tuple(loaded)


def with_foundations(free: FreeMotions, loaded: Sequence[LoadedFoundation]) -> FreeMotions:
    """The free motions of foundations under load, and after them those of bodies, for words and resultants."""
    own = tuple(motion for one in loaded for motion in one.motions)
    names = tuple(f"the foundation of {one.name!r}" for one in loaded)
    return replace(free, motions=own + free.motions, bodies=free.bodies + names)


def on_foundations(at_nodes: NodalAnswer) -> dict[int, Resultant]:
    """Force and moment of contact on the foundation of every contact that has one, by its number; collective."""
    resultant_of, over = dict[int, Resultant](), Reductions(at_nodes.comm, at_nodes.copies)
    for part, face in enumerate(at_nodes.faces):
        if at_nodes.against[part] is None:
            totals = at_nodes.totals(part)
            force, moment = (-np.array(totals[name]) for name in ("force", "moment"))
            nodal = over.sum(np.linalg.norm(at_nodes.on_body[at_nodes.part == part], axis=1))
            resultant_of[part] = Resultant("foundation", face, f"foundation_{face}", force, moment, nodal)
    return resultant_of


def motions_of(loaded: Sequence[LoadedFoundation], at_nodes: NodalAnswer) -> tuple[RigidFaceMotion, ...]:
    """Motions of foundations under load, and what contact does on them, about their points; collective."""
    on = on_foundations(at_nodes) if loaded else {}
    return tuple(
        RigidFaceMotion(
            one.name,
            one.point,
            one.pose[:3],
            one.pose[3:],
            on[one.number].force,
            on[one.number].moment - np.cross(one.point, on[one.number].force),
        )
        for one in loaded
    )
