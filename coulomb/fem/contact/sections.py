"""Sections of bolts: tied faces with one unknown s of their own, u_slave = W u + s n.

A force F of the bolt is the force along s; where s is given, or locked, it is no unknown.  In large motions n turns
with the section (`turned_section`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray, is_number
from ..bodies import Deformable, GivenBolt, Section, Tie
from ..geometry import Amplitude, Point, check_direction
from .ties import Tied

_PLANE: Final = 0.95
"""Length of the mean normal of a section below which it has no direction of its own."""

_ALONG: Final = 1e-6
"""Part of the bolt's direction that supports may hold at nodes of its section; and of its radius that is rounding."""


@dataclass(frozen=True)
class Pretension(Tied, GivenBolt):
    """The section of a bolt, two faces that move alike but for one amount along the bolt: by how much it is shortened.

    The amount is prescribed, or found so that the bolt carries a force.  After the time `lock`, the end of tightening,
    it stays as it is, and the force follows from the other loads.  All other relative motion is prevented as by `Tied`.

    Attributes:
        face, against, slave: As of `Tied`: the two sides of a section through a shank, those of a cut
            (`read_mesh(cuts=)`) or the faces of two parts.
        force: Force of the bolt in newtons, positive where it pulls.
        shortening: In place of it the length taken out of the bolt, metres.
        direction: Direction of the bolt; by default the normal of the section.  In large motions it turns with this.
        amplitude: Factor of force or shortening as a function of time.
        lock: End of tightening; a load step must end there.  By default the bolt is never locked.

    Raises:
        ValueError: If a name is none, both are the same, not exactly one of force and shortening is given as a finite
            number, the direction is zero, or lock is no number.
    """

    force: float | None = None
    shortening: float | None = None
    direction: Point | None = None
    amplitude: Amplitude = 1.0
    lock: float | None = None

    kind = "pretension"

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.shortening if self.force is None else self.force
        if (self.force is None) == (self.shortening is None) or not is_number(given, -np.inf):
            raise ValueError(
                f"{self.what}: give either force in newtons or shortening in metres, a finite number, but they are "
                f"{self.force!r} and {self.shortening!r}"
            )
        if self.direction is not None:
            check_direction(f"{self.what}: direction", self.direction)
        if self.lock is not None and not is_number(self.lock, -np.inf):
            raise ValueError(f"{self.what}: lock must be a time, but is {self.lock!r}")

    def joined(self, body: Deformable, taken: BoolArray) -> Tie:
        """The tie, with the section; collective.

        Raises:
            ValueError: On every rank, as of a tie, if it is not plane and has no direction, or if supports hold it
                along the bolt.
        """
        comm, tie = body.comm, super().joined(body, taken)
        x = body.x[tie.nodes]
        sums = comm.allreduce(np.concatenate([[tie.area.sum()], tie.area @ tie.normal, tie.area @ x]))
        area, mean, centre = float(sums[0]), sums[1:4] / sums[0], sums[4:] / sums[0]
        n = mean if self.direction is None else np.array(self.direction, dtype=np.float64)
        if self.direction is None and np.linalg.norm(mean) < _PLANE:
            raise ValueError(
                f"{self.what}: the section is not plane (its mean normal has the length {np.linalg.norm(mean):.2f}): "
                "give the direction of the bolt"
            )
        n = n / np.linalg.norm(n) * (1.0 if n @ mean >= 0.0 else -1.0)
        whole = body.nodes(tie.face, self.kind)
        if comm.allreduce(bool(np.any(taken[whole])), op=MPI.LOR):
            raise ValueError(
                f"{self.what}: some nodes of {tie.face!r} are tied already: give the pretension before ties"
            )
        if comm.allreduce(bool(np.any(np.abs(body.held.projector_at(whole) @ n) > _ALONG)), op=MPI.LOR):
            raise ValueError(
                f"{self.what}: supports hold nodes of the section along the bolt: end them before the section"
            )
        own = np.tile(n[:, None], (len(tie.nodes), 1, 1))
        radius = float(np.sqrt(area / np.pi))
        rim = _outermost(x - centre, n, radius, comm)
        return replace(tie, own=own, bolt=Section(tie.face, self, centre, n, radius, rim, x[rim] - centre))


def _outermost(r: FloatArray, n: FloatArray, radius: float, comm: MPI.Comm) -> IntArray:
    """Which of this rank's nodes, at r (m, 3) from the middle, are the farthest in one of 8 directions across n;
    collective."""
    across = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    across /= np.linalg.norm(across)
    angles = 0.125 * np.pi * np.arange(1, 16, 2)[:, None]  # askew to edges
    along = r @ (np.cos(angles) * across + np.sin(angles) * np.cross(n, across)).T
    most = np.max(comm.allgather(np.max(along, axis=0, initial=-np.inf)), axis=0)
    return np.flatnonzero(np.any(along >= most - _ALONG * radius, axis=1))
