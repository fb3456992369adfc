"""Other meshes of tetrahedra, made by MMG."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mesh_files import integral
from mpi4py import MPI

import coulomb
from coulomb.fem.meshes import comparison, corners_of, finer, remeshed, remeshing
from coulomb.fem.meshes.comparison import coarser_meshes
from coulomb.fem.meshes.meshes import box, second_order
from verification.array_mesh import in_layers, quarter_ring

INNER, OUTER, LENGTH = 0.5, 1.0, 0.6


def factor(mesh, value):
    return np.full(mesh.domain.topology.index_map(3).size_local, value)


def cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def sizes(mesh):
    groups = [integral(mesh, cells=name) for name in mesh.cells]
    return np.array([integral(mesh), *groups, *(integral(mesh, face) for face in mesh.faces)])


@pytest.mark.parametrize(("value", "least", "most"), [(2.0, 0.06, 0.3), (0.5, 5.0, 14.0), (1.0, 0.6, 1.7)])
def test_faces_and_groups_are_kept(value, least, most):
    """Faces with facets in common too, of which a facet may be in none; volumes and areas are exact, all planes."""
    mesh = in_layers(box((1.0, 2.0, 3.0), (4, 6, 8), "tetrahedron"), 1.5, "below", "above")
    faces = {name: mesh.faces[name] for name in ("left", "top", "front")}
    mesh = replace(mesh, faces={**faces, "two": np.union1d(faces["left"], faces["top"]).astype(np.int32)})
    found = remeshed(mesh, factor(mesh, value))
    np.testing.assert_allclose(sizes(found), sizes(mesh), rtol=1e-9)
    assert list(found.faces) == list(mesh.faces) and list(found.cells) == list(mesh.cells)
    assert least * cells(mesh) < cells(found) < most * cells(mesh)


def test_the_mesh_does_not_depend_on_the_number_of_ranks():
    def made(comm):
        mesh = replace(box((1.0, 2.0, 3.0), (4, 6, 8), "tetrahedron", comm=comm), coarser=None, grid=None)
        found = remeshed(mesh, factor(mesh, 0.8))
        return np.concatenate(comm.allgather(found.domain.geometry.x[: found.domain.geometry.index_map().size_local]))

    ours, alone = (one[np.lexsort(one.T)] for one in (made(MPI.COMM_WORLD), made(MPI.COMM_SELF)))
    np.testing.assert_array_equal(ours, alone)


def test_cells_are_smaller_where_they_shall_be():
    mesh = box((2.0, 1.0, 1.0), (8, 4, 4), "tetrahedron")
    own = mesh.domain.topology.index_map(3).size_local
    x = mesh.domain.geometry.x[coulomb.fem.meshes.corner_geometry(mesh.domain)[:own]].mean(axis=1)[:, 0]
    found = remeshed(mesh, np.where(x < 0.5, 0.3, 1.0))
    y = found.domain.geometry.x[coulomb.fem.meshes.corner_geometry(found.domain)].mean(axis=1)[:, 0]
    local = found.domain.topology.index_map(3).size_local
    counts = [found.comm.allreduce(int(np.sum(y[:local] < 0.4))), found.comm.allreduce(int(np.sum(y[:local] > 1.5)))]
    before = [mesh.comm.allreduce(int(np.sum(x < 0.4))), mesh.comm.allreduce(int(np.sum(x > 1.5)))]
    assert counts[0] > 10 * before[0] and counts[1] < 3 * before[1]


def test_finer_meshes_keep_the_corners_and_the_facets_of_curved_faces():
    mesh = quarter_ring(INNER, OUTER, LENGTH, (2, 6, 2), "tetrahedron")
    found = remeshed(mesh, factor(mesh, 0.5))
    np.testing.assert_allclose(sizes(found), sizes(mesh), rtol=2e-3)  # other diagonals of its facets
    assert outside(mesh) <= outside(found) and cells(found) > 5 * cells(mesh)


def outside(mesh):
    x = mesh.domain.geometry.x
    every = np.round(np.concatenate(mesh.comm.allgather(x)), 9)
    return {tuple(one) for one in every[np.hypot(every[:, 0], every[:, 1]) > OUTER - 1e-6]}


def test_coarser_meshes_have_nodes_near_the_surface():
    """As far off as the middles of their edges, at most, which a mesh of a polygon would be."""
    mesh = quarter_ring(INNER, OUTER, LENGTH, (4, 16, 4), "tetrahedron")
    found = remeshed(mesh, factor(mesh, 2.0))
    x = found.domain.geometry.x[np.unique(corners_of(found.domain, found.faces["right"]))]
    off = np.abs(np.hypot(x[:, 0], x[:, 1]) - OUTER)
    assert cells(found) < 0.5 * cells(mesh)
    assert off.max(initial=0.0) < OUTER * (1.0 - math.cos(0.25 * math.pi / 8.0))


def test_second_order_with_straight_edges_keeps_them():
    mesh = quarter_ring(INNER, OUTER, LENGTH, (2, 6, 2), "tetrahedron")
    found = remeshed(second_order(mesh), factor(mesh, 0.6))
    assert found.degree == 2
    np.testing.assert_allclose(sizes(found), sizes(mesh), rtol=2e-3)
    curved = second_order(mesh, curved=True)
    with pytest.raises(ValueError, match="curved"):
        remeshed(curved, factor(mesh, 0.6))
    assert cells(finer(curved, {"": factor(mesh, 1.0)})) > cells(mesh)


def test_large_meshes_of_first_order_have_coarser_ones():
    mesh = replace(box((1.0, 1.0, 1.0), (10, 10, 10), "tetrahedron"), coarser=None, grid=None)
    found = [cells(one) for one in coarser_meshes(mesh)]
    assert len(found) == 2 and 1.3**3 * found[0] < cells(mesh) and 1.3**3 * found[1] < found[0]
    assert list(coarser_meshes(second_order(mesh))) == []


def test_a_body_that_is_a_cell_thick_has_no_coarser_mesh(monkeypatch):
    monkeypatch.setattr(comparison, "FEW", 0)
    mesh = replace(box((8.0, 1.0, 0.1), (8, 1, 1), "tetrahedron"), coarser=None, grid=None)
    with pytest.raises(ValueError, match="no coarser mesh"):
        list(coarser_meshes(mesh))


def test_without_the_program_cells_are_bisected(monkeypatch):
    monkeypatch.setattr(remeshing, "mmg", lambda: None)
    mesh = replace(box((1.0, 1.0, 1.0), (3, 3, 3), "tetrahedron"), coarser=None, grid=None)
    with pytest.raises(ValueError, match="made by MMG"):
        remeshed(mesh, factor(mesh, 2.0))
    squared = factor(mesh, 1.0)
    found = finer(mesh, {"": squared})
    assert cells(found) > cells(mesh)


def test_a_program_that_fails_is_named(monkeypatch, tmp_path):
    program = tmp_path / "bin" / "mmg3d_O3"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho no memory >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(remeshing, "mmg", lambda: program)
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2), "tetrahedron")
    with pytest.raises(ValueError, match="MMG found no other tetrahedra: no memory"):
        remeshed(mesh, factor(mesh, 2.0))
