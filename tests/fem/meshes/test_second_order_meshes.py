"""Meshes of 10-node tetrahedra and 27-node hexahedra: boxes, raised meshes, volumes and areas by their curved cells."""

import numpy as np
import pytest
from mesh_files import BoxFile, integral
from mpi4py import MPI

import coulomb
from coulomb.case.bodies import MeshTable
from coulomb.cli.preparation import unknowns_of_box
from coulomb.fem import compat
from coulomb.fem.meshes.lagrange import corner_geometry, jacobians
from coulomb.fem.meshes.meshes import smooth_second_order
from coulomb.fem.meshes.named_mesh import NamedMesh

CELLS = ("hexahedron", "tetrahedron")


@pytest.mark.parametrize("cell", CELLS)
def test_second_order_box_has_curved_cells(cell):
    bent = coulomb.box(
        (2.0, 1.0, 1.0), (2, 1, 1), cell, degree=2, place=lambda x: np.array([x[0], x[1], x[2] * (1.0 + x[0] ** 2)])
    )
    assert compat.geometry_degree(bent.domain) == 2
    assert compat.cell_geometry(bent.domain).shape[1] == {"hexahedron": 27, "tetrahedron": 10}[cell]
    assert corner_geometry(bent.domain).shape[1] == {"hexahedron": 8, "tetrahedron": 4}[cell]
    assert integral(bent) == pytest.approx(2.0 + 8.0 / 3.0, rel=1e-12)  # the places are quadratic: exact
    assert integral(bent, "right") == pytest.approx(5.0, rel=1e-12)
    assert integral(bent, "front") == pytest.approx(2.0 + 8.0 / 3.0, rel=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_raised_mesh_keeps_shape_faces_and_cells(cell):
    mesh = coulomb.box((3.0, 2.0, 1.0), (3, 2, 1), cell, place=lambda x: x + 0.1 * np.sin(5.0 * x[[1, 2, 0]]))
    middle = mesh.domain.geometry.x[compat.cell_geometry(mesh.domain)].mean(axis=1)
    mesh.cells["left half"] = np.flatnonzero(middle[:, 0] < 1.5).astype(np.int32)
    second = coulomb.second_order(mesh)
    assert isinstance(second, NamedMesh)
    assert list(second.faces) == list(mesh.faces)
    for face in mesh.faces:
        assert len(second.faces[face]) == len(mesh.faces[face])
        assert integral(second, face) == pytest.approx(integral(mesh, face), rel=1e-7)
    assert integral(second) == pytest.approx(integral(mesh), rel=1e-12)
    assert integral(second, cells="left half") == pytest.approx(integral(mesh, cells="left half"), rel=1e-12)
    corners = second.domain.geometry.x[corner_geometry(second.domain)].reshape(-1, 3)
    assert {tuple(x) for x in corners} == {tuple(x) for x in mesh.domain.geometry.x}


def test_degree_in_case_files(tmp_path):
    """A box, and a file of first-order cells, with degree = 2; a second-order file says so itself."""
    first, second = BoxFile(), BoxFile().second_order()
    first.write(tmp_path / "first.msh")
    second.write(tmp_path / "second.msh")
    for given, degree in (
        ({"box": (2.0, 1.0, 1.0), "cells": (4, 2, 2), "degree": 2}, 2),
        ({"file": str(tmp_path / "first.msh")}, 1),
        ({"file": str(tmp_path / "first.msh"), "degree": 2}, 2),
        ({"file": str(tmp_path / "second.msh")}, 2),
        ({"file": str(tmp_path / "second.msh"), "degree": 2}, 2),
    ):
        made = MeshTable(**given).mesh(MPI.COMM_WORLD)
        assert made.degree == degree and integral(made) == pytest.approx(2.0, rel=1e-12)
        assert integral(made, "left") == pytest.approx(1.0, rel=1e-12)
        nodes = made.domain.geometry.index_map().size_global
        assert 3 * nodes == unknowns_of_box((4, 2, 2), degree)  # what memory is estimated for


def test_second_order_meshes_are_not_raised_again():
    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), degree=2)
    with pytest.raises(ValueError, match="second-order cells already"):
        coulomb.second_order(mesh)
    with pytest.raises(ValueError, match="degree must be 1 or 2, but is 3"):
        coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), degree=3)


def test_curved_edges_of_cells_of_both_orientations(tmp_path):
    """A quarter of a ring, cut as DOLFINx cuts boxes: half of the cells of the file are mirror images of the others,
    and were taken for turned inside out."""
    file = BoxFile((1.0, 1.0, 1.0), (2, 6, 2), "tetrahedron")
    r, phi = 1.0 + file.points[:, 0], 0.5 * np.pi * file.points[:, 1]
    file.points = np.column_stack([r * np.cos(phi), r * np.sin(phi), file.points[:, 2]])
    mesh = coulomb.read_mesh(file.write(tmp_path / "ring.msh"))
    signs = np.sign(jacobians(mesh.domain.geometry.x[compat.cell_geometry(mesh.domain)])[0][0])
    assert np.sum(signs > 0.0) == np.sum(signs < 0.0) == 72
    curved = coulomb.second_order(mesh, curved=True)
    assert integral(curved) == pytest.approx(0.75 * np.pi, rel=2e-4)
    assert integral(coulomb.second_order(mesh)) == pytest.approx(0.75 * np.pi * np.sinc(15.0 / 180.0), rel=1e-9)
    assert integral(smooth_second_order(mesh)) == integral(curved)  # as error bars take it
