"""The steel block of the benchmarks: clamped on the left, pressed onto a rigid plane and dragged along it."""

from __future__ import annotations

from typing import Any

from coulomb.fem.bodies import Clamp, Material, Traction
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

SLIP_STRESS = 1e7
"""Slip stress of the Tresca variant, in pascals."""


def block(
    p: int, friction: float | None = 0.3, cell: str = "hexahedron", degree: int = 1, **options: Any
) -> ContactProblem:
    """The block with p cells per metre; friction None is the Tresca variant; `options` are ContactProblem's."""
    return ContactProblem(
        box((3.0, 1.0, 1.0), (3 * p, p, p), cell, degree=degree),
        Material(young=2.119e11, poisson=0.277),
        [Clamp("left")],
        Contact("bottom", friction, SLIP_STRESS if friction is None else None),
        [Traction("top", (0.0, 1e7, -4e7)), Traction("right", (2e7, 0.0, 0.0))],
        **options,
    )
