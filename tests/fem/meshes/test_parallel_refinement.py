"""Other discretisations of a mesh that is distributed.

Run alone, or as `mpirun -n 3 python -m pytest tests/fem/meshes/test_parallel_refinement.py`.
"""

import pytest
from mesh_files import integral
from mpi4py import MPI
from test_refinement import CELLS, bend, number_of_cells, with_group

import coulomb
from coulomb.fem.meshes import first_order

comm = MPI.COMM_WORLD


def sizes(mesh):
    """Of the whole, its group and every face: the same however the mesh is distributed."""
    return [integral(mesh), integral(mesh, cells="root"), *(integral(mesh, face) for face in mesh.faces)]


@pytest.mark.parametrize("cell", CELLS)
def test_first_order_of_a_distributed_mesh(cell):
    second = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend, degree=2))
    straight = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend))
    first = first_order(second)
    assert first.degree == 1 and number_of_cells(first) == number_of_cells(second)
    assert sizes(first) == pytest.approx(sizes(straight), rel=1e-13)


def test_coarser_boxes_of_a_distributed_mesh():
    """The last have fewer cells than there are ranks."""
    mesh = coulomb.moved(coulomb.second_order(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2))), (1.0, 0.0, 0.0))
    for cells in (4, 1):
        mesh = mesh.coarser()
        assert number_of_cells(mesh) == cells and mesh.degree == 2
        assert integral(mesh) == pytest.approx(2.0, rel=1e-13)
        assert integral(mesh, "right") == pytest.approx(1.0, rel=1e-13)
    assert mesh.coarser is None
