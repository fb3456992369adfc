"""Slices of sections on several ranks: of files, which rank 0 reads, and of meshes of DOLFINx, which are gathered."""

import numpy as np
import pytest
from mesh_files import integral
from mpi4py import MPI
from sections import rectangle, write

import coulomb
from coulomb.fem.compat import mesh as dolfinx_mesh


def on_right(x):
    return np.isclose(x[0], 2.0)


@pytest.mark.parametrize("kind", ["triangle", "quadrilateral"])
def test_sections_of_dolfinx(kind):
    cell = getattr(dolfinx_mesh.CellType, kind)
    section = dolfinx_mesh.create_rectangle(MPI.COMM_WORLD, [[1.0, 0.0], [2.0, 0.5]], [3, 2], cell)
    section.topology.create_connectivity(1, 2)
    facets = dolfinx_mesh.locate_entities_boundary(section, 1, on_right)
    tags = dolfinx_mesh.meshtags(section, 1, np.sort(facets), np.full(len(facets), 7, dtype=np.int32))
    given = {"right": on_right, "tagged": (tags, 7)}
    mesh = coulomb.slice(section, "axisymmetric", degree=2, faces=given)
    total = [mesh.slice.copies * one for one in (integral(mesh), integral(mesh, "right"), integral(mesh, "tagged"))]
    assert total == pytest.approx([1.5 * np.pi, 2 * np.pi, 2 * np.pi], rel=1e-8)


def test_a_file_that_rank_0_reads(tmp_path):
    path = MPI.COMM_WORLD.bcast(tmp_path / "section.msh")
    if MPI.COMM_WORLD.rank == 0:
        write(path, rectangle((1.0, 0.0), (2.0, 0.5), (2, 1)))
    MPI.COMM_WORLD.Barrier()
    mesh = coulomb.slice(path, "plane strain", 0.25)
    assert integral(mesh) == pytest.approx(0.125, rel=1e-12)
    assert mesh.slice.held == ("front", "back")


def test_what_is_no_section():
    solid = coulomb.box((1.0, 1.0, 1.0), (2, 1, 1)).domain
    with pytest.raises(ValueError, match="has triangles or quadrilaterals, but this one has cells of type hexahedron"):
        coulomb.slice(solid, "plane strain")
