"""Coarser meshes of hexahedra, from which every second sheet is taken out."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_files import integral

from coulomb.fem.meshes import coarsened, comparison, corners_of
from coulomb.fem.meshes.comparison import coarser_meshes
from coulomb.fem.meshes.meshes import box, read_mesh, second_order
from verification.array_mesh import cored_box, in_layers, quarter_ring

DEMOS = Path(__file__).parents[3] / "demos"


def cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def sizes(mesh):
    groups = [integral(mesh, cells=name) for name in mesh.cells]
    return np.array([integral(mesh), *groups, *(integral(mesh, face) for face in mesh.faces)])


def planes(mesh):
    return [np.unique(np.round(x, 9)) for x in mesh.domain.geometry.x.T]


def test_an_even_box_is_that_of_half_as_many_cells():
    found = coarsened(box((1.0, 2.0, 3.0), (6, 4, 2)))
    for length, count, plane in zip((1.0, 2.0, 3.0), (3, 2, 1), planes(found), strict=True):
        np.testing.assert_allclose(plane, np.linspace(0.0, length, count + 1), atol=1e-9)


def test_of_an_odd_number_one_stays_as_it_is_inside():
    """Not at the boundary, where contact begins and bodies are held."""
    found = coarsened(box((7.0, 5.0, 3.0), (7, 5, 3)))
    assert [sorted(np.diff(plane)) for plane in planes(found)] == [[1.0, 2.0, 2.0, 2.0], [1.0, 2.0, 2.0], [1.0, 2.0]]
    for plane in planes(found)[:2]:
        assert np.diff(plane)[0] == np.diff(plane)[-1] == 2.0


def test_sheets_are_taken_out_from_the_boundary_inwards():
    """Of half a ring, whose lowest nodes, those with the first numbers, are halfway between its ends."""

    def place(k):
        angle, r = math.pi * (k[0] / 16.0 - 1.0), 1.0 + k[1] / 8.0
        return np.stack([r * np.cos(angle), k[2], r * np.sin(angle)])

    x = coarsened(box((16.0, 4.0, 4.0), (16, 4, 4), place=place)).domain.geometry.x
    angles = np.unique(np.round(np.arctan2(x[:, 0], -x[:, 2]), 9))
    np.testing.assert_allclose(np.diff(angles), math.pi / 8.0, rtol=1e-6)


def test_mirrored_cells():
    """The map of DOLFINx may have a negative Jacobian."""
    mesh = box((1.0, 1.0, 1.0), (4, 4, 4), place=lambda x: x * np.array([[-1.0], [1.0], [1.0]]))
    assert cells(coarsened(mesh)) == 8


def test_faces_and_groups_are_kept():
    """Faces with common facets too; sizes are exact."""
    mesh = in_layers(box((1.0, 2.0, 3.0), (8, 8, 6)), 2.0, "below", "above")
    both = np.union1d(mesh.faces["left"], mesh.faces["top"]).astype(np.int32)
    mesh = replace(mesh, faces={**mesh.faces, "two": both})
    found = coarsened(mesh)
    np.testing.assert_allclose(sizes(found), sizes(mesh), rtol=1e-12)
    assert list(found.faces) == list(mesh.faces) and list(found.cells) == list(mesh.cells)
    assert cells(found) == cells(mesh) // 8


@pytest.mark.parametrize("first", range(1, 6))
def test_a_patch_in_a_face_keeps_its_corners(first):
    """A rectangle of three by two facets of the top, whose corners could move along its sides as far as these go."""
    mesh = box((1.0, 1.0, 1.0), (9, 9, 4))
    facets = mesh.faces["top"]
    x, y = 9.0 * mesh.domain.geometry.x[corners_of(mesh.domain, facets)].mean(axis=1)[:, :2].T
    inside = (x > first) & (x < first + 3) & (y > 2) & (y < 4)
    mesh = replace(mesh, faces={**mesh.faces, "patch": facets[inside]})
    found = coarsened(mesh)
    np.testing.assert_allclose(sizes(found), sizes(mesh), rtol=1e-12)
    assert cells(found) < 0.3 * cells(mesh)


def test_nodes_of_curved_faces_stay_on_them():
    mesh = quarter_ring(0.5, 1.0, 0.6, (4, 16, 4))
    found = coarsened(mesh)
    assert cells(found) == cells(mesh) // 8
    radii = np.unique(np.round(np.hypot(*found.domain.geometry.x.T[:2]), 12))
    np.testing.assert_allclose(radii, [0.5, 0.75, 1.0], rtol=1e-12)


def test_irregular_hexahedra():
    """In two steps, to a single cell of each block."""
    mesh = cored_box((1.0, 1.5, 0.8), 4, 4)
    found = coarsened(mesh)
    last = coarsened(found, again=True)
    assert [cells(one) for one in (mesh, found, last)] == [320, 40, 5]
    np.testing.assert_allclose([sizes(found), sizes(last)], [sizes(mesh)] * 2, rtol=1e-12)


def test_nodes_of_flat_cells_are_moved():
    """A plate with a hole, two irregular layers: with its nodes where they were it keeps a quarter of the cells."""
    mesh = read_mesh(DEMOS / "lap_joint.msh")
    found = coarsened(mesh)
    assert 5 * cells(found) < cells(mesh)
    assert integral(found, "end") == pytest.approx(integral(mesh, "end"), rel=1e-12)
    assert integral(found) == pytest.approx(integral(mesh), rel=0.02)  # the hole has fewer chords


@pytest.mark.parametrize("n", [(8, 1, 1), (8, 4, 1)])
def test_a_body_that_is_a_cell_thick_has_no_coarser_mesh(n):
    """Its bending is wrong by that cell, which meshes with the same thickness would not show."""
    with pytest.raises(ValueError, match="in a single layer"):
        coarsened(box((8.0, 4.0, 0.1), n))


def test_large_meshes_of_files_have_coarser_ones(monkeypatch):
    mesh = cored_box((1.0, 1.0, 1.0), 4, 4)
    assert list(coarser_meshes(mesh)) == []
    monkeypatch.setattr(comparison, "FEW", 100)
    assert [cells(one) for one in coarser_meshes(mesh)] == [40, 5]
    assert list(coarser_meshes(second_order(mesh))) == []
