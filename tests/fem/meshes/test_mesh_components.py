"""Meshes with several components: accepted, and what is said where they touch without a contact between them."""

import logging

import numpy as np
import pytest
from conftest import STEEL
from mesh_files import BoxFile

import coulomb
from coulomb import Clamp, Contact, ContactProblem, PointLoad, RigidFace


def torn(shift, second=False, cell="hexahedron"):
    """A box of two halves along x, those of the second half moved by `shift` with nodes of their own."""
    file = BoxFile(cells=(2, 1, 1), cell=cell)
    stiff, count = file.cell_groups["stiff"], len(file.points)
    x = file.points[:, 0]
    file.faces = {
        "left": file.faces["left"],
        "right": count + file.faces["right"],
        "seam": quadrilaterals(file, 1, x),
        "other": count + quadrilaterals(file, 1, x),
    }
    file.cells[stiff] += count
    file.points = np.vstack([file.points, file.points + shift])
    return file.second_order() if second else file


def quadrilaterals(file, at, x):
    return np.array([[n for n in np.flatnonzero(x == at)]])[:, [0, 1, 3, 2]]


def read(file, path):
    return coulomb.read_mesh(file.write(path / "parts.msh"))


@pytest.mark.parametrize("second", [False, True])
def test_components_that_touch_are_known(tmp_path, second):
    mesh = read(torn((0.0, 0.0, 0.0), second), tmp_path)
    assert mesh.components == 2 and set(mesh.faces) == {"left", "right", "seam", "other"}
    places = sorted(map(tuple, np.round(mesh.touching, 6)))
    assert places == [(1.0, y, z) for y in (0.0, 1.0) for z in (0.0, 1.0)], "corners of the faces that coincide"
    up = coulomb.moved(mesh, (0.0, 0.0, 2.0))
    assert up.components == 2 and np.allclose(up.touching, mesh.touching + (0.0, 0.0, 2.0), atol=1e-12)


def test_a_rigid_face_with_a_spring_on_two_components(tmp_path):
    """It joins them: the spring carries the loads of both, by their resultants about its point."""
    file = torn((0.5, 0.0, 0.0))
    file.faces["ends"] = np.vstack([file.faces["left"], file.faces["right"]])
    face = RigidFace("ends", (0.0, 0.0, 0.0), translation_stiffness=(1e9, 1e9, 2e9), rotation_stiffness=(1e9, 3e9, 1e9))
    loads = [
        PointLoad("seam", (1e5, 2e4, 3e4), point=(0, 0, 0)),
        PointLoad("other", (1e5, -2e4, 1e4), (0, 6e3, 0), (0, 0, 0)),
    ]
    far = Contact("other", 0.3, foundation=coulomb.Plane((-9.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    solution = ContactProblem(read(file, tmp_path), STEEL, [], far, loads, rigid_faces=[face]).solve()
    (found,) = solution.rigid_faces
    assert solution.valid and found.translation == pytest.approx((2e-4, 0.0, 2e-5), abs=1e-12)
    assert found.rotation == pytest.approx((0.0, 2e-6, 0.0), abs=1e-13)


def test_components_apart(tmp_path):
    mesh = read(torn((5.0, 0.0, 0.0)), tmp_path)
    assert mesh.components == 2 and len(mesh.touching) == 0
    assert coulomb.second_order(mesh).components == 2


def test_a_tear_is_reported_unless_a_contact_is_there(tmp_path, caplog):
    mesh = read(torn((0.0, 0.0, 0.0)), tmp_path)
    held = [Clamp("left"), Clamp("right")]
    pair, floor = Contact("seam", against="other", friction=0.3), Contact("other", friction=0.3)
    for contact, said in ((pair, 0), (floor, 1)):  # on the first rank
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            ContactProblem(mesh, STEEL, held, contact)
        assert len([r for r in caplog.records if "2 components that touch at 4 places" in r.message]) == said * (
            mesh.comm.rank == 0
        )
