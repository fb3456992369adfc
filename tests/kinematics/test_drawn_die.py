"""A round die is pressed into a softer block and drawn over it: two bodies, some of whose nodes come before the die on
the way."""

from dataclasses import replace

import numpy as np
import pytest
from sections import rectangle, write

import coulomb

SIDES = {"bottom": "front", "top": "back", "front": "bottom", "back": "top", "left": "left", "right": "right"}
"""Of a box whose section is in the plane of x and y: those of a `coulomb.box` along x, z and y."""


def bent(x):
    """The lower side of the die, at y = 1, is round."""
    y = x[:, 1] + 0.6 * (x[:, 0] - 0.4) ** 2 * (1.0 - (x[:, 1] - 1.0) / 0.5)
    return np.column_stack([x[:, 0], y, x[:, 2:]])


def ironed(block, die, supports=()):
    """The force of the die and that of each contact point, of four load steps."""
    supports = [
        *supports,
        coulomb.Clamp("block:bottom"),
        coulomb.PrescribedDisplacement("die:top", (0.0, -0.1, 0.0), "y", amplitude=[(0, 0), (1, 1)]),
        coulomb.PrescribedDisplacement("die:top", (0.6, 0.0, 0.0), "x", amplitude=[(0, 0), (1, 0), (2, 1)]),
    ]
    problem = coulomb.ContactProblem(
        coulomb.join(block=block, die=die),
        {"block": coulomb.NeoHookean(1e6, 0.3), "die": coulomb.NeoHookean(1e8, 0.3)},
        supports,
        coulomb.Contact("block:top", against="die:bottom", friction=0.3, slave=True),
        kinematics="large",
    )
    found = [step.solution for step in coulomb.LoadHistory([0.5, 1.0, 1.25]).steps(problem)]
    assert all(one.valid and one.outer_iterations <= 12 for one in found)
    return np.array([one.forces["force"] for one in found]), found[-1]


def test_a_slice_has_the_forces_of_the_body(tmp_path):
    """Also where a node was before nothing at the start of the step: there friction opposes the way since then, else it
    would be any within its bound."""
    block, die = rectangle((0.0, 0.0), (1.6, 1.0), (8, 4)), rectangle((0.1, 1.0), (0.7, 1.5), (4, 2))
    write(tmp_path / "block.msh", block)
    write(tmp_path / "die.msh", replace(die, points=bent(die.points)))
    sections = [coulomb.slice(tmp_path / f"{name}.msh", "plane strain", thickness=0.1) for name in ("block", "die")]
    forces, last = ironed(*sections)
    lying = [
        coulomb.box((1.6, 1.0, 0.1), (8, 4, 2)),
        coulomb.moved(coulomb.box((0.6, 0.5, 0.1), (4, 2, 2)), translate=(0.1, 1.0, 0.0)),
    ]
    lying[1].domain.geometry.x[:] = bent(lying[1].domain.geometry.x)
    bodies = [replace(one, faces={name: one.faces[side] for name, side in SIDES.items()}) for one in lying]
    planes = [coulomb.SymmetryPlane(f"{body}:{side}") for body in ("block", "die") for side in ("front", "back")]
    in_3d, _ = ironed(*bodies, planes)
    assert forces == pytest.approx(in_3d, abs=1e-7 * np.abs(in_3d).max())
    answer = last.at_nodes
    normal, friction = answer.force[:, 0], np.linalg.norm(answer.force[:, 1:], axis=1)
    come = normal > 0.0
    assert np.all(friction[come] == pytest.approx(0.3 * normal[come]))
    assert np.all(np.linalg.norm(answer.slip[come], axis=1) > 0.05)
