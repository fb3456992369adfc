"""Cattaneo and Mindlin for two like spheres, pressed together, then moved along each other there and back.

The formulas of `cattaneo_mindlin` with the radius R of the summed curvatures and

    1/E* = 2 (1 - nu^2)/E,   1/G* = 2 (2 - nu)/G:   all displacements of one sphere against the other.

Two like bodies shift alike along their common surface: pressing causes no shear, and shear no change of the pressure
(Dundurs' beta is 0), so that the spheres are pressed with friction.  On meshes that do not match, small shears remain.

Halves of both spheres between a plane of symmetry and the far faces, at 16 a: the lower far face is held, the upper one
moves.  Each far face has the displacement that a half space has there, as in `cattaneo_mindlin`.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Clamp, PrescribedDisplacement, join
from ..fem.meshes import NamedMesh, box
from ..model.contact import Contact
from ..model.load_history import LoadHistory
from ..model.problem import ContactProblem
from .cattaneo_mindlin import FRICTION, LOADED, PRESSED, RELOADED, UNLOADED, Experiment, PartialSlip, compared, moment
from .hertz import RADIUS, STEEL, UNIFORM, WIDTH, A, Hertz, grading
from .table import Verified

CELLS = (6, 5)
"""Cells in 4 a/3 of the lower and the upper sphere: the slave and the master."""

_APPROACH = A**2 / RADIUS


def half(cells: int, upper: bool) -> NamedMesh:
    """Half of a sphere of the radius 2 RADIUS, y >= 0, above or below z = 0, with its contact face at the origin."""
    place, outer = grading(cells, 2 * cells, WIDTH), 2 * cells
    sign = 1.0 if upper else -1.0

    def at(k: FloatArray) -> FloatArray:
        x, y, depth = place(k[0] - outer), place(k[1]), place(k[2] if upper else outer - k[2])
        rise = 2.0 * RADIUS - np.sqrt(4.0 * RADIUS**2 - x**2 - y**2)
        return np.stack([x, y, sign * (depth + (1.0 - depth / WIDTH) * rise)])

    return box((2 * outer, outer, outer), (2 * outer, outer, outer), place=at)


def spheres(cells: tuple[int, int], far: float) -> ContactProblem:
    """Both halves; the upper far face goes down until PRESSED, then by `far` there and back."""
    along = [(PRESSED, 0.0), (LOADED, 1.0), (UNLOADED, -1.0), (RELOADED, 1.0)]
    return ContactProblem(
        join(lower=half(cells[0], False), upper=half(cells[1], True)),
        {"upper": STEEL, "lower": STEEL},
        [
            Clamp("upper:front", "y"),
            Clamp("lower:front", "y"),
            Clamp("lower:bottom"),
            Clamp("upper:top", "y"),
            PrescribedDisplacement("upper:top", (0.0, 0.0, -_APPROACH), "z", amplitude=[(0.0, 0.0), (PRESSED, 1.0)]),
            PrescribedDisplacement("upper:top", (far, 0.0, 0.0), "x", amplitude=along),
        ],
        Contact("lower:top", against="upper:bottom", friction=FRICTION),
        time=PRESSED,
    )


def experiment(cells: tuple[int, int] = CELLS, steps: int = 4) -> Experiment:
    """Press, then move right, left and right, with `steps` steps per unit of time."""
    pressed = spheres(cells, 0.0).solve()
    theory = PartialSlip(Hertz(2.0 * float(pressed.contact_force[0::3].sum()), RADIUS, STEEL, STEEL))
    far = 0.85 * theory.d
    problem = spheres(cells, far)
    times = [PRESSED + k / steps for k in range(round((RELOADED - PRESSED) * steps) + 1)]
    moments = []
    for step in LoadHistory(times).steps(problem):
        time = step.state.time
        if time > PRESSED:
            travel = 0.85 * float(np.interp(time, (PRESSED, LOADED, UNLOADED, RELOADED), (0.0, 1.0, -1.0, 1.0)))
            moments.append(moment(time, step.solution, theory, 2.0 * step.state.energy.dissipated, travel))
    surface = pressed.problem.surface
    return Experiment(theory, surface.x / theory.hertz.a, surface.area, moments)


def verify(cells: tuple[int, int] = CELLS, steps: int = 4) -> Verified:
    """The whole loop."""
    size = UNIFORM / A / min(cells)
    even = f"(h/a)^2/6 = {size**2 / 6.0:.2g}: facets that do not match: the pressure of like bodies changes as little"
    return compared(experiment(cells, steps), size, size**2 / 6.0, even, shear=0.5 * size)
