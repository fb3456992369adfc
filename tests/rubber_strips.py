"""Strips of rubber that are bent, for the tests of contact of a face with itself."""

from dataclasses import replace

import numpy as np

from coulomb import (
    Clamp,
    ContactProblem,
    LoadHistory,
    NamedMesh,
    NeoHookean,
    PrescribedDisplacement,
    RigidFace,
    box,
    moved,
)

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


OPEN, BENT = np.pi / 3.0, 4.5
"""Of a strip that is folded: the angle of its bend before, and the radius of its middle line there, metres."""


def folded(mesh, contact):
    """The problem of an open strip that is folded until time 1 and pressed shut until 2."""
    half = 0.5 * THICKNESS

    def below(angle):  # the outer side of the second arm, where its held part begins
        r, along = OPEN * BENT / angle + half, 0.4 * ARM
        x, z = ARM + r * np.sin(angle) + along * np.cos(angle), r - half - r * np.cos(angle) + along * np.sin(angle)
        return np.array([x, 0.5, z])

    times, first = np.linspace(0.0, 1.0, 13), below(OPEN)
    angles = OPEN + (np.pi - OPEN) * times
    x, _, z = np.array([below(angle) - first for angle in angles]).T
    ends = zip((x, z, OPEN - angles), (0.0, -2.1, 0.0), strict=True)
    along, down, turned = ([*zip(times, way, strict=True), (2.0, way[-1] + more)] for way, more in ends)
    amplitudes = [along, None, down, None, turned, None]
    arm = RigidFace("arm", tuple(first), (1.0, 0.0, 1.0), (0.0, 1.0, 0.0), amplitudes=amplitudes)
    supports = [Clamp("floor"), Clamp("front", "y"), Clamp("back", "y")]
    return ContactProblem(mesh, NeoHookean(1e6, 0.3), supports, contact, kinematics="large", rigid_faces=[arm])


def open_strip(comm, cells, kind=("hexahedron", 1)):
    """A strip of two arms that no part of which is before another one; faces "skin", "floor", "arm", and inside "low"
    and "high"."""
    bend, c, s = OPEN * BENT, np.cos(OPEN), np.sin(OPEN)
    end, half = (ARM + BENT * s, BENT * (1.0 - c)), BENT * np.sin(0.5 * OPEN)

    def way(x):
        angle, beyond = np.clip((x[0] - ARM) / BENT, 0.0, OPEN), np.maximum(x[0] - ARM - bend, 0.0)
        r = BENT - x[2] + 0.5 * THICKNESS
        along = np.minimum(x[0], ARM) + r * np.sin(angle) + beyond * np.cos(angle)
        return np.array([along, x[1], BENT - r * np.cos(angle) + beyond * np.sin(angle)]) - x

    made = moved(box((2.0 * ARM + bend, 1.0, THICKNESS), (cells, 1, 1), kind[0], comm, degree=kind[1]), way)
    at = {
        "first": lambda x: (x[0] - ARM) * np.cos(0.5 * OPEN) + x[2] * np.sin(0.5 * OPEN) < half + 1e-6,
        "floor": lambda x: np.isclose(x[2], -0.5 * THICKNESS) & (x[0] < 0.6 * ARM),
        "arm": lambda x: (x[0] - end[0]) * c + (x[2] - end[1]) * s > 0.4 * ARM - 1e-6,
    }
    faces = {**made.faces, **NamedMesh(made.domain, at).faces}
    faces["arm"] = np.intersect1d(faces["bottom"], faces["arm"])
    faces["skin"] = np.unique(np.concatenate([faces[name] for name in ("left", "right", "top", "bottom")]))
    faces["low"] = np.intersect1d(faces["top"], faces["first"])
    faces["high"] = np.setdiff1d(faces["top"], faces["first"])
    return replace(made, faces=faces)
