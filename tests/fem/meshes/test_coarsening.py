"""Coarser meshes of tetrahedra, made by MMG."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mesh_files import integral

from coulomb import Clamp, Contact, ContactProblem, Cylinder, Material
from coulomb.fem.meshes import coarsened, coarsening, comparison, corners_of
from coulomb.fem.meshes.comparison import coarser_meshes
from coulomb.fem.meshes.meshes import box, second_order
from coulomb.io.other_meshes import other_problems
from verification.array_mesh import in_layers, quarter_ring

INNER, OUTER, LENGTH = 0.5, 1.0, 0.6


def cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def sizes(mesh):
    groups = [integral(mesh, cells=name) for name in mesh.cells]
    return np.array([integral(mesh), *groups, *(integral(mesh, face) for face in mesh.faces)])


def test_faces_and_groups_are_kept():
    """Faces with facets in common too, of which a facet may be in none; volumes and areas are exact, all planes."""
    mesh = in_layers(box((1.0, 2.0, 3.0), (4, 6, 8), "tetrahedron"), 1.5, "below", "above")
    faces = {name: mesh.faces[name] for name in ("left", "top", "front")}
    mesh = replace(mesh, faces={**faces, "two": np.union1d(faces["left"], faces["top"]).astype(np.int32)})
    found = coarsened(mesh)
    np.testing.assert_allclose(sizes(found), sizes(mesh), rtol=1e-9)
    assert list(found.faces) == list(mesh.faces) and list(found.cells) == list(mesh.cells)
    assert 0.06 * cells(mesh) < cells(found) < 0.3 * cells(mesh)


def test_coarser_meshes_have_nodes_near_the_surface():
    """As far off as the middles of their edges, at most, which a mesh of a polygon would be."""
    mesh = quarter_ring(INNER, OUTER, LENGTH, (4, 16, 4), "tetrahedron")
    found = coarsened(mesh)
    x = found.domain.geometry.x[np.unique(corners_of(found.domain, found.faces["right"]))]
    off = np.abs(np.hypot(x[:, 0], x[:, 1]) - OUTER)
    assert cells(found) < 0.5 * cells(mesh)
    assert off.max(initial=0.0) < OUTER * (1.0 - math.cos(0.25 * math.pi / 8.0))


def test_coarser_meshes_have_nodes_on_the_surface_that_is_known():
    mesh = quarter_ring(INNER, OUTER, LENGTH, (2, 10, 4), "tetrahedron")
    off = []
    for surfaces in ({}, {"right": Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), OUTER)}):
        found = coarsened(replace(mesh, surfaces=surfaces))
        x = found.domain.geometry.x[np.unique(corners_of(found.domain, found.faces["right"]))]
        off.append(np.abs(np.hypot(x[:, 0], x[:, 1]) - OUTER).max())
    assert off[0] > 1e-3 and off[1] < 1e-12 and found.surfaces == surfaces


def test_large_meshes_of_first_order_have_coarser_ones():
    mesh = replace(box((1.0, 1.0, 1.0), (10, 10, 10), "tetrahedron"), coarser=None, grid=None)
    found = [cells(one) for one in coarser_meshes(mesh)]
    assert len(found) == 2 and 1.3**3 * found[0] < cells(mesh) and 1.3**3 * found[1] < found[0]
    assert list(coarser_meshes(second_order(mesh))) == []


def test_a_body_that_is_a_cell_thick_has_no_coarser_mesh(monkeypatch):
    monkeypatch.setattr(comparison, "FEW", 0)
    mesh = replace(box((8.0, 1.0, 0.1), (8, 1, 1), "tetrahedron"), coarser=None, grid=None)
    with pytest.raises(ValueError, match="hardly fewer"):
        list(coarser_meshes(mesh))


def test_without_the_program_the_same_cells_are_compared(monkeypatch):
    monkeypatch.setattr(coarsening, "mmg", lambda: None)
    monkeypatch.setattr(comparison, "FEW", 0)
    mesh = replace(box((1.0, 1.0, 0.5), (3, 3, 2), "tetrahedron"), coarser=None, grid=None)
    with pytest.raises(ValueError, match="made by MMG"):
        coarsened(mesh)
    problem = ContactProblem(mesh, Material(2e11, 0.3), [Clamp("top")], Contact("bottom", 0.3))
    assert [one.made_of.degree for one in next(other_problems(problem))] == [2, 1]


def test_a_program_that_fails_is_named(monkeypatch, tmp_path):
    program = tmp_path / "bin" / "mmg3d_O3"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho no memory >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(coarsening, "mmg", lambda: program)
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2), "tetrahedron")
    with pytest.raises(ValueError, match="MMG found no coarser tetrahedra: no memory"):
        coarsened(mesh)
