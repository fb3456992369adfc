"""Slip, friction work and pressure at the contact nodes since the start of a load history: the input of wear laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..contact_fields import names


@dataclass(frozen=True)
class Accumulated:
    """What m contact nodes have gone through since the start of the history; zero at first.

    Friction is that at the end of each step (backward Euler), as in `Energy.dissipated`, so that the work over the face
    is that energy.  A node that is open at the end of a step does not accumulate slip in it: distance covered without
    contact is no wear.  Where friction does not depend on pressure (cohesion, Tresca), it also works at open nodes.

    Attributes:
        slip: Sum of the lengths of the slip increments in contact, metres, shape (m,).
        friction_work: Work of friction per area, J/m^2, shape (m,): the sum of traction times slip increment, positive
            where the node slips, and zero up to the tolerance of the solver where it sticks.
        pressure: Largest pressure at the end of any step, pascals, shape (m,).
    """

    slip: FloatArray
    friction_work: FloatArray
    pressure: FloatArray

    @classmethod
    def none(cls, count: int) -> Accumulated:
        """At the start of a history, at this many nodes."""
        return cls(*np.zeros((3, count)))

    def after(
        self, slip: FloatArray, friction_work: FloatArray, pressure: FloatArray, closed: npt.NDArray[np.bool_]
    ) -> Accumulated:
        """After another step, with the slip in it (space vectors in metres, shape (m, 3)), its friction work per area
        in J/m^2, the pressures in pascals and which nodes are in contact at its end."""
        length = np.where(closed, np.linalg.norm(slip, axis=1), 0.0)
        work: FloatArray = self.friction_work + friction_work
        return Accumulated(self.slip + length, work, np.maximum(self.pressure, pressure))

    def at(self, nodes: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> Accumulated:
        """At some of the nodes."""
        return Accumulated(self.slip[nodes], self.friction_work[nodes], self.pressure[nodes])


ACCUMULATED = names(shown="history")
"""Their names in contact.xdmf."""
