"""Is the answer inside the theory?  Contact is linear here: u_n <= gap at nodes that keep their normals.

The certificate says whether the equations of small strains are solved; this, whether they were the right ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .arrays import FloatArray
from .fem.fields import on_all_ranks
from .solvers.reductions import Reductions

if TYPE_CHECKING:
    from .problem import ContactProblem

_PRESSING = 1e-6  # a node presses if its force is above this part of the greatest
_GAP_ERROR = 0.05
_TURN = 3.0
_CELLS = 1.0
_GRADIENT = 0.05


@dataclass(frozen=True)
class SmallStrain:
    """How far an answer has gone from the place where the contact conditions were made linear.

    Attributes:
        gap_error: Greatest distance of a pressing node, where it has moved to, from the foundation as it is, over the
            mean way of the forces that deform the body (as in the certificate).
        turn: Greatest angle in degrees between the foundation's normals at a pressing node before and after.
        slip_over_cell: Greatest way of a pressing node along a foundation that is not plane, over the size of the
            cells there (square root of the nodal area).
        gradient: Greatest norm of the displacement gradient in a cell: strain and rotation.
    """

    gap_error: float
    turn: float
    slip_over_cell: float
    gradient: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is no longer small, in words; empty if all is well."""
        found = (
            (
                self.gap_error > _GAP_ERROR,
                f"the foundation's curvature shows: pressing nodes are {self.gap_error:.0%} of the deformation off it "
                "(smaller load, or smaller load steps with the foundation moved to its new place)",
            ),
            (self.turn > _TURN, f"the foundation's normal turns by {self.turn:.1f} degrees under a moving node"),
            (
                self.slip_over_cell > _CELLS,
                f"nodes move by {self.slip_over_cell:.1f} cells along a curved foundation, but keep their normals",
            ),
            (
                self.gradient > _GRADIENT,
                f"displacement gradients reach {self.gradient:.2g}: strains or rotations are no longer small",
            ),
        )
        return tuple(text for beyond, text in found if beyond)


def small_strain(problem: ContactProblem, x: FloatArray, u: FloatArray) -> SmallStrain:
    """Measure an answer; collective.

    Args:
        problem: The contact problem.
        x: Contact forces in newtons, shape (3 m,).
        u: Displacement in metres, this rank's nodes, shape (k, 3).
    """
    surface, over = problem.surface, Reductions(problem.comm)
    pressing = x[0::3] > _PRESSING * max(over.max(x[0::3]), 0.0)
    before, moved = surface.x[pressing], surface.x[pressing] + u[surface.nodes][pressing]

    def measure() -> tuple[FloatArray, FloatArray]:
        distance, turn = np.zeros(len(before)), np.zeros(len(before))
        for number, foundation in enumerate(surface.foundations):
            at = surface.part[pressing] == number
            if np.any(at):
                cosine = np.einsum("ki,ki->k", foundation.normal(before[at]), foundation.normal(moved[at]))
                turn[at] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
                distance[at] = foundation.signed_distance(moved[at])
        return distance, np.where(turn < 1e-5, 0.0, turn)

    distance, turn = on_all_ranks(measure, "contact: foundation", problem.comm)
    closure = surface.components(u[surface.nodes] - problem.motions[surface.part])[pressing]
    internal = problem.elasticity.internal_force(u)
    forces = over.sum(np.linalg.norm(internal, axis=1))
    deformation = 2.0 * over.dot(u, internal) / forces if forces > 0.0 else 0.0
    along = np.hypot(closure[:, 1], closure[:, 2]) / np.sqrt(surface.area[pressing]) * (turn > 0.0)
    return SmallStrain(
        gap_error=max(over.max(np.abs(distance)), 0.0) / deformation if deformation > 0.0 else 0.0,
        turn=max(over.max(turn), 0.0),
        slip_over_cell=max(over.max(along), 0.0),
        gradient=problem.elasticity.greatest_gradient(u),
    )
