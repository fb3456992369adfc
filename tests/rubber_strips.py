"""Strips of rubber that are bent, for the tests of contact of a face with itself."""

from dataclasses import replace

import numpy as np

from coulomb import Clamp, ContactProblem, LoadHistory, NamedMesh, NeoHookean, PrescribedDisplacement, box, moved

ARM, THICKNESS, RADIUS = 6.0, 1.0, 1.5
"""Of a strip: its straight parts, and the radius of its middle line where it is bent, metres."""


def strip(comm, arms, cells, kind=("hexahedron", 1)):
    """A strip of arms one above the other, from z = 0 on, with half a turn after each; faces "skin" all around,
    "floor" and "lid" outside, and "low" and "high" inside the first bend."""
    bend = np.pi * RADIUS

    def way(x):
        arm, s = np.divmod(x[0] + 1e-9, ARM + bend)
        side, off = 1.0 - 2.0 * (arm % 2), x[2] - 0.5 * THICKNESS
        angle, r = np.maximum(s - ARM, 0.0) / RADIUS, RADIUS - side * off
        along = np.minimum(s, ARM) + r * np.sin(angle)
        up = RADIUS - np.where(angle > 0.0, r, RADIUS - side * off) * np.cos(angle)
        return np.array([np.where(side > 0.0, along, ARM - along), x[1], 2.0 * RADIUS * arm + up]) - x

    lengths = arms * ARM + (arms - 1) * bend, 1.0, THICKNESS
    made = moved(box(lengths, (cells, 1, 1), kind[0], comm, degree=kind[1]), way)
    top = 2.0 * RADIUS * (arms - 1) + 0.5 * THICKNESS
    at = {
        "floor": lambda x: np.isclose(x[2], -0.5 * THICKNESS) & (x[0] < 0.6 * ARM),
        "lid": lambda x: np.isclose(x[2], top) & (x[0] < 0.6 * ARM),
        "low": lambda x: x[2] < RADIUS + 1e-6,
    }
    faces = {**made.faces, **NamedMesh(made.domain, at).faces}
    faces["skin"] = np.unique(np.concatenate([faces[name] for name in ("left", "right", "top", "bottom")]))
    faces["high"] = np.setdiff1d(faces["top"], faces["low"])
    faces["low"] = np.intersect1d(faces["top"], faces["low"])
    return replace(made, faces=faces)


def pressed(mesh, contact, times=(1.0,)):
    """The answers with the lid pressed down until time 1, then drawn aside."""
    down = PrescribedDisplacement("lid", (0.0, 0.0, -2.1), "xyz", [(0.0, 0.0), (1.0, 1.0)])
    aside = PrescribedDisplacement("lid", (0.4, 0.0, 0.0), "x", [(1.0, 0.0), (2.0, 1.0)])
    supports = [Clamp("floor"), Clamp("front", "y"), Clamp("back", "y"), replace(down, components="z"), aside]
    problem = ContactProblem(mesh, NeoHookean(1e6, 0.3), supports, contact, kinematics="large")
    return [step.solution for step in LoadHistory(times).steps(problem)]
