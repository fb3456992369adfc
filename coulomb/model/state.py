"""The state after a load step, from which the next begins, and the energies and forces in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray
from ..fem.bodies import Deformable
from ..fem.contact import ContactSurface
from ..linalg.reductions import Reductions
from ..units import amount
from .nodal_answer import Accumulated, NodalAnswer

_IMBALANCE: Final = 0.25  # of the energy dissipated by friction
_OF_ALL: Final = 1e-3  # of all energy


@dataclass(frozen=True)
class Energy:
    """Energies in joules since the start of the history.

    Attributes:
        loads: Work of tractions and body force, and of changes of the stiffness of a `Body` with time.
        prescribed: Work of the reactions at prescribed displacements, and of bolts that are tightened.
        foundation: Work that the moving foundation does on the body.
        elastic: Elastic energy of the body and its springs.
        dissipated: Energy dissipated by friction.
    """

    loads: float = 0.0
    prescribed: float = 0.0
    foundation: float = 0.0
    elastic: float = 0.0
    dissipated: float = 0.0

    @property
    def imbalance(self) -> float:
        """Work minus elastic energy and dissipation: the error of the time discretisation."""
        return self.loads + self.prescribed + self.foundation - self.elastic - self.dissipated

    def warning(self, rounding: float = 0.0, overlap: float = 0.0) -> str:
        """A warning if the imbalance exceeds `rounding` in joules, a quarter of the dissipation, and a thousandth of
        the largest energy, else empty; it names the cause if bodies overlap by `overlap` metres before deformation."""
        work = self.loads + self.prescribed + self.foundation
        turned_over = max(abs(work), self.elastic, self.dissipated)
        small = max(_IMBALANCE * abs(self.dissipated), _OF_ALL * turned_over, rounding)
        if abs(self.imbalance) <= small:  # False for nan
            return ""
        friction = amount(self.dissipated, "J", 2)
        words = f"the energies do not add up, by {amount(self.imbalance, 'J', 2)} against {friction} of friction"
        if overlap > 0.0:
            return (
                f"{words}: the bodies overlap by {amount(overlap)} before deformation, and the first load step presses "
                "them apart at once; an overlap that is meant goes into gap, with gap_amplitude; one of the meshes of "
                "curved faces is removed by finer or second-order meshes, smooth, surface or adjust"
            )
        return f"{words}: use more load steps, and ramp loads, prescribed displacements and motions from 0 (amplitude)"

    def after(
        self,
        then: Forces,
        now: Forces,
        foundation: float,
        dissipated: float,
        over: Reductions,
        coefficients: float = 0.0,
    ) -> Energy:
        """The energy at the end of a step, from the forces at its beginning and end; and the work of the foundation,
        the energy dissipated, and the work of changes of the stiffness (`coefficients`) in it, joules; collective."""
        change = now.displacement - then.displacement
        return Energy(
            loads=self.loads + 0.5 * over.dot(now.load + then.load, change) + coefficients,
            prescribed=self.prescribed + 0.5 * over.dot(then.reaction + now.reaction, change),
            foundation=self.foundation + foundation,
            elastic=0.5 * over.dot(now.displacement, now.kept),
            dissipated=self.dissipated + dissipated,
        )


@dataclass(frozen=True, eq=False)
class Forces:
    """Displacement and forces at this rank's k nodes at one time, shapes (k, 3); metres and newtons.

    Attributes:
        displacement: Displacement.
        load: Load of tractions and body force.
        kept: Internal forces of the stress, and minus the forces of the springs.
        on_body: Forces of contact and ties on the body.
        reaction: Forces of supports, and of ties and rigid faces: those where the motion is prescribed do work.  Those
            of a support that ends become 0 linearly in the load step that follows.
    """

    displacement: FloatArray
    load: FloatArray
    kept: FloatArray
    on_body: FloatArray
    reaction: FloatArray

    @classmethod
    def at(
        cls,
        body: Deformable,
        surface: ContactSurface,
        u: FloatArray,
        kept: FloatArray,
        load: FloatArray,
        on_body: FloatArray,
        time: float,
    ) -> Forces:
        """Those at a time, with the forces of contact `on_body` at the points of a surface (m, 3); collective."""
        of_contact = surface.at_nodes(surface.force_components(on_body))
        of_ties = body.constraints.forces(kept - load - of_contact, time)
        outer = of_contact + of_ties
        return cls(u, load, kept, outer, body.held_at(time).held_part(kept - load - outer) + of_ties)


def coefficients_work(then: Forces, now: Forces, over: Reductions) -> float:
    """Work in joules of a change of the stiffness from K0 to K1 in a step: (u0 . K1 u1 - u1 . K0 u0) / 2;
    collective."""
    return 0.5 * (over.dot(then.displacement, now.kept) - over.dot(now.displacement, then.kept))


@dataclass(frozen=True, eq=False)
class Earlier:
    """Time, `State.force_on_body` and `State.displacement` of the step before the last one: forces are extrapolated
    from there, and the sides of faces in contact with themselves were those of that displacement."""

    time: float
    force_on_body: FloatArray
    displacement: FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """The state after a step, from which the next begins; this rank's part.

    Attributes:
        number: Number of the step, from 1; 0 before the first.
        time: Its end.
        energy: Energies since the start of the history.
        displacement: Metres, shape (k, 3).
        force_on_body: Contact forces on the body at the contact points, space vectors in newtons, shape (m, 3).
        slip_rate: Slip of the step over its duration at the contact points, metres per second, shape (m,).
        accumulated: Slip, friction work and largest pressure at the contact points since the start of the history.
        pending: Ends of the remaining steps, the next one last.
        forces: Displacement and forces at its end; None at the start and where a history was continued from files.
        before: The end of the step before; None at the start.
        temperature_change: Of a problem with heat, from the reference, kelvin, shape (k,); None at the start.
        poses: Of foundations under load (`ContactState.poses`); None at the start, and without any.
        turns: In large motions the rotation vectors of rigid faces, radians, shape (faces, 3); None at the start, and
            without any.
        friction_error: Estimated error of friction by the size of the steps, over the sum of the sizes of the friction
            forces at contact points: the sum of what halving each step has changed (`friction_change`), less the part
            of each step of what has come to touch in it.  None if it was not asked for.
    """

    number: int
    time: float
    energy: Energy
    displacement: FloatArray
    force_on_body: FloatArray
    slip_rate: FloatArray
    accumulated: Accumulated
    pending: tuple[float, ...]
    forces: Forces | None = None
    before: Earlier | None = None
    temperature_change: FloatArray | None = None
    poses: FloatArray | None = None
    turns: FloatArray | None = None
    friction_error: float | None = None

    @classmethod
    def beginning(cls, time: float, nodes: int, points: int, pending: tuple[float, ...] = ()) -> State:
        """At rest, of so many nodes and contact points."""
        still, none, worn = np.zeros((nodes, 3)), np.zeros((points, 3)), Accumulated.none(points)
        return cls(0, time, Energy(), still, none, np.zeros(points), worn, pending)

    def new_part(self, nodes: IntArray, answer: NodalAnswer) -> float:
        """The part of the normal forces of an answer at the end of the next step, with its contact points `at` these
        numbers of those of states, that is at points which are open at its start; collective."""
        over, normal, new = Reductions(answer.comm), answer.force[:, 0], ~np.any(self.force_on_body[nodes], axis=1)
        whole = over.sum(normal)
        return over.sum(normal[new]) / whole if whole > 0.0 else 0.0
