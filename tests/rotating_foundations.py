"""Blocks of rubber on foundations that rotate, for tests."""

import numpy as np

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Cylinder,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Rotation,
    box,
)

RUBBER = Material(young=1e7, poisson=0.3)
CELLS = ("hexahedron", "tetrahedron")
TABLE = Plane((0, 0, 0), (0, 0, 1))
TURNING = [(0, 0.5), (1, 0.5), (2, 4.5)]


def disc(x):
    """A square of edge 2 about the z axis, mapped to the disc of radius 0.05."""
    a, b = 2.0 * x[0] - 1.0, 2.0 * x[1] - 1.0
    return np.array([0.05 * a * np.sqrt(1.0 - b * b / 2.0), 0.05 * b * np.sqrt(1.0 - a * a / 2.0), 0.02 * x[2]])


def puck(friction=0.3, cell="hexahedron", n=6, angle=TURNING, **options):
    """A disc of rubber on a turntable, its top pressed down and kept from moving sideways."""
    press = PrescribedDisplacement("top", (0, 0, -2e-4), "z", [(0, 0), (1, 1)])
    contact = Contact("bottom", friction, foundation=TABLE, rotation=Rotation((0, 0, 0), (0, 0, 2), angle), **options)
    return ContactProblem(
        box((1.0, 1.0, 1.0), (n, n, 2), cell, place=disc), Material(1e7, 0.0), [press, Clamp("top", "xy")], contact
    )


def steps(problem, times, tolerance=1e-9):
    return list(LoadHistory(times, tolerance=tolerance).steps(problem))


def shoe(rotation=None, motion=None, **options):
    """A block of rubber pressed on a drum that its bottom fits roughly, its top held."""
    press = PrescribedDisplacement("top", (0, 0, -3e-3), "z", [(0, 0), (1, 1)])
    drum = Cylinder((0.05, 0.0, -0.5), (0, 1, 0), 0.5)
    contact = Contact("bottom", 0.3, foundation=drum, rotation=rotation, motion=motion)
    return ContactProblem(box((0.1, 0.05, 0.05), (6, 3, 3)), RUBBER, [press, Clamp("top", "xy")], contact, **options)
