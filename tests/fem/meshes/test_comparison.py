"""Meshes on which a problem is solved again: smooth boundaries, smaller cells on the same nodes, coarser boxes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from coulomb import Clamp, Elasticity, Material
from coulomb.fem.meshes import box, coarser_meshes, finer, first_order, polygon, same_cells, second_order, split
from verification.array_mesh import in_layers, quarter_ring

INNER, OUTER, LENGTH = 0.5, 1.0, 0.6
STEEL = Material(2.1e11, 0.3)


def volume(mesh):
    """Of curved cells too."""
    space = Elasticity(mesh, STEEL, [Clamp("left")])
    return space.comm.allreduce(float(space.volume_load(np.tile([1.0, 0.0, 0.0], (len(space.x), 1))).sum()), op=MPI.SUM)


def ring(n, cell):
    return quarter_ring(INNER, OUTER, LENGTH, (2, n, 2), cell)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_smooth_boundaries_have_the_fourth_order(cell):
    exact = 0.25 * math.pi * (OUTER**2 - INNER**2) * LENGTH
    errors = [abs(volume(second_order(ring(n, cell), curved=True)) / exact - 1.0) for n in (4, 16)]
    chords = [abs(volume(ring(n, cell)) / exact - 1.0) for n in (4, 16)]
    assert math.log2(chords[0] / chords[1]) / 2.0 == pytest.approx(2.0, abs=0.05)
    assert math.log2(errors[0] / errors[1]) / 2.0 == pytest.approx(4.0, abs=0.1)
    assert errors[1] < 0.001 * chords[1]


def ball(n, cell):
    """A ball of n^3 cells of unlike sizes, as of a file."""

    def place(k):
        t = 0.25 * math.pi * (2.0 * k - 1.0)
        cube = np.tan(t + 0.1 * np.sin(4.0 * t))
        return cube * np.abs(cube).max(axis=0) / np.maximum(np.linalg.norm(cube, axis=0), 1e-9)

    return replace(box((1.0, 1.0, 1.0), (n, n, n), cell, place=place), grid=None, coarser=None)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_new_nodes_are_on_the_smooth_surface(cell):
    """On the facets the volume would stay.  Nodes that would make a cell flat at the edges of the cube stay there."""
    mesh, exact = ball(4, cell), 4.0 / 3.0 * math.pi
    chords = [1.0 - volume(mesh) / exact]
    for _ in range(2):
        mesh = finer(mesh, {"": np.ones(mesh.domain.topology.index_map(3).size_local)})
        chords.append(1.0 - volume(mesh) / exact)
    assert chords[0] > 3.0 * chords[1] > 9.0 * chords[2]
    if cell == "tetrahedron":
        assert abs(4.0 * chords[2] - chords[1]) < 0.005 * chords[0]  # extrapolated


def test_facets_far_from_the_surface_are_divided():
    """Whatever the error of the stress is, which here is in a single cell; not those that are near enough."""
    mesh = ball(4, "tetrahedron")
    squared = np.zeros(mesh.domain.topology.index_map(3).size_local)
    squared[:1] = 1.0
    assert 0.06 < polygon(mesh) < 0.09
    found = finer(mesh, {"": squared}, 0.01)
    assert polygon(found) < 0.5 * polygon(mesh)
    assert polygon(finer(mesh, {"": squared}, 0.1)) > 0.9 * polygon(mesh)


def test_the_polygon_of_plane_and_of_curved_faces_is_none():
    mesh = ring(8, "tetrahedron")
    exact = 0.25 * math.pi * (OUTER**2 - INNER**2) * LENGTH
    chord = 0.25 * math.pi * (OUTER**2 + INNER**2) * LENGTH * (0.25 * math.pi / 8.0) ** 2 * 2.0 / 3.0
    assert polygon(mesh) == pytest.approx(chord / volume(mesh), rel=0.02)
    assert exact - volume(mesh) < chord  # bore and mantle partly cancel there
    assert polygon(second_order(mesh)) == pytest.approx(polygon(mesh))
    assert polygon(second_order(mesh, curved=True)) < 1e-12
    assert polygon(box((1.0, 2.0, 3.0), (2, 3, 4))) < 1e-12


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_plane_boundaries_stay(cell):
    mesh = box((1.0, 2.0, 3.0), (2, 3, 4), cell)
    curved, straight = second_order(mesh, curved=True), second_order(mesh)
    assert np.abs(curved.domain.geometry.x - straight.domain.geometry.x).max(initial=0.0) < 1e-14


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_eight_cells_in_place_of_each(cell):
    whole = in_layers(box((1.0, 2.0, 3.0), (2, 3, 4), cell, degree=2), 1.5, "below", "above")
    fine = split(whole)
    total = fine.comm.allreduce
    assert fine.degree == 1
    assert fine.domain.topology.index_map(3).size_global == 8 * whole.domain.topology.index_map(3).size_global
    assert volume(fine) == pytest.approx(6.0)
    assert [total(len(fine.cells[name])) for name in ("below", "above")] == [
        8 * total(len(whole.cells[name])) for name in ("below", "above")
    ]
    body = Elasticity(fine, STEEL, [Clamp("left")])
    for face, area in {"left": 6.0, "right": 6.0, "front": 3.0, "back": 3.0, "bottom": 2.0, "top": 2.0}.items():
        assert total(float(body.area_of(fine.facets(face, "test")).sum())) == pytest.approx(area)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_first_order_meshes_of_curved_cells_know_their_faces(cell):
    """Whose chords and facets have their middles there, which are off a circle by less than the fourth power."""
    curved = second_order(ring(6, cell), curved=True)
    for mesh in (first_order(curved), split(curved)):
        at, way = mesh.curved.middles, mesh.curved.off
        x = at - mesh.curved.signed_distance(at)[:, None] * mesh.curved.normal(at)
        assert np.abs(x - at - way).max() < 1e-15
        radii, before = (np.linalg.norm(places[:, :2], axis=1) for places in (x, at))
        on = np.minimum(np.abs(radii - INNER), np.abs(radii - OUTER)) < 2e-4
        assert np.all(on | ((at[:, 2] < 1e-9) | (at[:, 2] > LENGTH - 1e-9)))
        assert np.any(np.abs(before - OUTER) < 0.01) and not np.any(np.abs(before - OUTER) < 1e-3)
    assert first_order(second_order(ring(6, cell))).curved is None


def test_what_is_compared():
    mesh = box((1.0, 1.0, 1.0), (6, 2, 4), "tetrahedron")
    sizes = [one.domain.topology.index_map(3).size_global for one in coarser_meshes(mesh)]
    assert sizes == [6 * 3 * 1 * 2, 6 * 2 * 1 * 1]
    from_file = replace(mesh, coarser=None)
    assert list(coarser_meshes(from_file)) == []
    assert [one.degree for one in same_cells(from_file)] == [2, 1]
    assert [one.degree for one in same_cells(second_order(from_file))] == [1, 1]
    assert [one.degree for one in same_cells(box((1.0, 1.0, 1.0), (2, 2, 2)))] == [2]
