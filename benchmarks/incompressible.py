"""Nearly incompressible blocks: forces of linear and quadratic tetrahedra (P1, P2) and hexahedra (Q1, Q2).

A block twice as wide as high is pressed between a plate that sticks to it and a rough floor.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Final

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory, Material, MooneyRivlin, PrescribedDisplacement

ELEMENTS: Final = {"P1": ("tetrahedron", 1), "P2": ("tetrahedron", 2), "Q1": ("hexahedron", 1), "Q2": ("hexahedron", 2)}

RATIOS: Final = (0.3, 0.4, 0.45, 0.49, 0.499, 0.4999)

_HEIGHT, _YOUNG = 0.5, 1e6
"""Metres, and pascals."""


def _steps(
    element: str, across: int, material: Material | MooneyRivlin, parts: tuple[float, ...], kinematics: str
) -> Iterator[coulomb.Solution]:
    """Pressed by parts of its height, in so many load steps."""
    cell, degree = ELEMENTS[element]
    mesh = coulomb.box((1.0, 1.0, _HEIGHT), (across, across, across // 2), cell, degree=degree)
    down = PrescribedDisplacement("top", (0.0, 0.0, -_HEIGHT), amplitude=[(0.0, 0.0), (1.0, 1.0)])
    problem = ContactProblem(mesh, material, [down], Contact("bottom", 0.3), kinematics=kinematics)
    for step in LoadHistory(parts, halvings=0).steps(problem):
        yield step.solution


def small() -> Iterator[Mapping[str, object]]:
    """Forces of small motions, pressed by 1 %, over those of Q2 on 8 cells across, in 4 and 8 cells."""
    for poisson in RATIOS:
        found = {}
        for element, across in [("Q2", 8), *((name, n) for name in ("P1", "P2", "Q1") for n in (4, 8))]:
            (answer,) = _steps(element, across, Material(_YOUNG, poisson), (0.01,), "small")
            found[f"{element} {across}"] = answer.forces["normal_force"]
        yield {"poisson": str(poisson), **{name: f"{force / found['Q2 8']:.3f}" for name, force in found.items()}}


def large() -> Iterator[Mapping[str, object]]:
    """Forces of large motions at Poisson's ratio 0.4999, in steps of 10 %."""
    shear, bulk = _YOUNG / (2.0 * (1.0 + RATIOS[-1])), _YOUNG / (3.0 * (1.0 - 2.0 * RATIOS[-1]))
    rubber = MooneyRivlin(shear / 2.0, 0.0, bulk)
    for element, across in (("P2", 4), ("P2", 6), ("Q1", 10)):
        started, row = time.process_time(), dict[str, object](element=element, across=across)
        for answer in _steps(element, across, rubber, (0.1, 0.2, 0.3), "large"):
            row[f"kN at {answer.problem.time:.0%}"] = round(answer.forces["normal_force"] / 1e3, 1)
            row[f"problems at {answer.problem.time:.0%}"] = answer.outer_iterations
        yield {**row, "cpu s": round(time.process_time() - started, 1)}
