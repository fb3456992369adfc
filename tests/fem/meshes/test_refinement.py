"""Other discretisations of a mesh: of first order and coarser."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_files import integral

import coulomb
from coulomb.fem.meshes import first_order
from coulomb.fem.meshes.lagrange import corner_geometry

CELLS = ("hexahedron", "tetrahedron")


def bend(x):
    """Curved in all directions; of third degree, so that no mesh has the shape exactly."""
    return np.array([x[0], x[1] + 0.1 * x[0] ** 2, x[2] * (1.0 + 0.1 * x[0] ** 2) + 0.05 * x[1] ** 3])


def with_group(mesh, end=0.5):
    """The mesh with the group of cells below x = end."""
    x = mesh.domain.geometry.x[corner_geometry(mesh.domain)[: mesh.domain.topology.index_map(3).size_local]]
    return replace(mesh, cells={"root": np.flatnonzero(x[..., 0].mean(axis=1) < end).astype(np.int32)})


def number_of_cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def nodes(mesh):
    return {tuple(x) for x in mesh.domain.geometry.x.round(12) + 0.0}


@pytest.mark.parametrize("cell", CELLS)
def test_first_order_mesh_has_the_corners_of_the_second(cell):
    """It is the first-order box with the same places, found independently."""
    second = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend, degree=2))
    first = first_order(replace(second, refused={"hole": "is inside"}))
    straight = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend))
    assert first.degree == 1 and number_of_cells(first) == number_of_cells(second)
    assert nodes(first) == nodes(straight) and first.refused == {"hole": "is inside"}
    assert integral(first) == pytest.approx(integral(straight), rel=1e-13)
    assert integral(first, cells="root") == pytest.approx(integral(straight, cells="root"), rel=1e-13)
    assert list(first.faces) == list(straight.faces)
    for face in first.faces:
        assert integral(first, face) == pytest.approx(integral(straight, face), rel=1e-13)
    with pytest.raises(ValueError, match="first-order cells already"):
        first_order(first)


@pytest.mark.parametrize("cell", CELLS)
def test_orders_there_and_back(cell):
    mesh = coulomb.box((2.0, 1.0, 1.0), (3, 2, 1), cell, place=bend)
    back = first_order(coulomb.second_order(mesh))
    assert nodes(back) == nodes(mesh)
    for face in mesh.faces:
        assert integral(back, face) == pytest.approx(integral(mesh, face), rel=1e-13)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_coarser_boxes(cell, degree):
    """Half as many cells along an edge, rounded up, down to one, by the same places."""
    mesh = coulomb.box((2.0, 1.0, 1.0), (5, 2, 1), cell, place=bend, degree=degree)
    for cells in ((3, 1, 1), (2, 1, 1), (1, 1, 1)):
        mesh = mesh.coarser()
        made = coulomb.box((2.0, 1.0, 1.0), cells, cell, place=bend, degree=degree)
        assert nodes(mesh) == nodes(made) and mesh.degree == degree
        assert integral(mesh, "top") == pytest.approx(integral(made, "top"), rel=1e-13)
    assert mesh.coarser is None


def test_coarser_boxes_of_other_order_and_at_other_places():
    box = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), place=bend)
    rotation = coulomb.Rotation((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.3)
    half = coulomb.box((2.0, 1.0, 1.0), (2, 1, 1), place=bend)
    moved = coulomb.moved(box, (0.0, 0.0, 3.0), rotation)
    assert nodes(moved.coarser()) == nodes(coulomb.moved(half, (0.0, 0.0, 3.0), rotation))
    assert number_of_cells(moved.coarser().coarser()) == 1 and moved.coarser().coarser().coarser is None
    raised = coulomb.second_order(box).coarser()
    assert raised.degree == 2 and nodes(raised) == nodes(coulomb.second_order(half))
    lowered = first_order(coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), place=bend, degree=2)).coarser()
    assert lowered.degree == 1 and nodes(lowered) == nodes(half)
    assert first_order(coulomb.second_order(half)).coarser().coarser is None
