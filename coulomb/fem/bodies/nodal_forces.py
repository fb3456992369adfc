"""Nodal forces of one load, support or spring, from which resultants, reactions and their balance are summed."""

from __future__ import annotations

from dataclasses import dataclass

from ...arrays import FloatArray


@dataclass(frozen=True)
class NodalForces:
    """Forces on the body at this rank's k nodes, of one load, support or spring.

    Attributes:
        kind: "traction", "body_force", "clamp", "spring", ...: a word, as in the files.
        face: Where it acts; None for the whole body.
        forces: In newtons, shape (k, 3).
    """

    kind: str
    face: str | None
    forces: FloatArray
