"""Planes of symmetry on which both faces of a pair end."""

import numpy as np
import pytest
from mesh_files import BoxFile

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    NeoHookean,
    PrescribedDisplacement,
    box,
    join,
    moved,
    read_mesh,
)

WIDTH, CROWN, DOWN = 0.2, 0.5, (0.0, 0.0, -0.02)
MATERIALS = {"pad": NeoHookean(1e6, 0.3), "plate": NeoHookean(1e9, 0.3)}


def pressed(halves, tmp_path):
    """A pad with a crowned face pressed on a plate whose mesh does not match, in two steps; the half of it with x > 0,
    or both halves."""
    file = BoxFile((halves * WIDTH, 0.1, 0.1), (4 * halves, 2, 2))
    x = file.points - ((halves - 1) * WIDTH, 0.0, 0.0)
    x[:, 2] += CROWN * (x[:, 0] ** 2 + 2.0 * x[:, 1] ** 2) * (1.0 - x[:, 2] / 0.1)
    file.points = x
    plate = moved(box((halves * 0.25, 0.1, 0.05), (3 * halves, 1, 1)), (-(halves - 1) * 0.25, 0.0, -0.05))
    mesh = join(pad=read_mesh(file.write(tmp_path / f"{halves}.msh")), plate=plate)
    supports = [
        Clamp("pad:front", "y"),
        Clamp("pad:top", "x"),
        Clamp("plate:bottom"),
        PrescribedDisplacement("pad:top", DOWN, "z", lambda time: time),
    ]
    if halves == 1:
        supports += [Clamp("pad:left", "x"), Clamp("plate:left", "x")]
    contact = Contact("pad:bottom", 0.2, against="plate:top", slave=True)
    problem = ContactProblem(mesh, MATERIALS, supports, contact, kinematics="large")
    *_, end = LoadHistory((0.5, 1.0)).steps(problem)
    return end


def test_half_a_pad_has_half_the_forces_and_half_the_friction_work(tmp_path):
    half, whole = pressed(1, tmp_path), pressed(2, tmp_path)
    one, both = half.solution.at_nodes.totals(), whole.solution.at_nodes.totals()
    assert 2.0 * one["normal_force"] == pytest.approx(both["normal_force"], rel=1e-6)
    assert 2.0 * one["force"][1] == pytest.approx(both["force"][1], rel=1e-6)
    assert 2.0 * half.state.energy.dissipated == pytest.approx(whole.state.energy.dissipated, rel=1e-6)
    on_plane = half.solution.problem.surface.x[:, 0] < 1e-9
    friction = half.solution.force_on_body[on_plane]
    assert np.all(friction[:, 0] == 0.0)
    assert np.all(friction[:, 1] != 0.0)
