"""Other discretisations of a mesh that is distributed.

Run alone, or as `mpirun -n 3 python -m pytest tests/fem/meshes/test_parallel_refined_meshes.py`.
"""

from dataclasses import replace

import numpy as np
import pytest
from mesh_files import BoxFile, integral
from mpi4py import MPI
from ranks import same_error
from test_refined_meshes import CELLS, KINDS, bend, near, number_of_cells, sizes, unnamed_facets, with_group

import coulomb
from coulomb import Cylinder
from coulomb.fem.meshes import first_order, refined

comm = MPI.COMM_WORLD


@pytest.mark.parametrize("cell", CELLS)
def test_first_order_of_a_distributed_mesh(cell):
    second = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend, degree=2))
    straight = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend))
    first = first_order(second)
    assert first.degree == 1 and number_of_cells(first) == number_of_cells(second)
    assert np.abs(sizes(first) / sizes(straight) - 1.0).max() < 1e-13


def test_coarser_boxes_of_a_distributed_mesh():
    """The last have fewer cells than there are ranks."""
    mesh = coulomb.moved(coulomb.second_order(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2))), (1.0, 0.0, 0.0))
    for cells in (4, 1):
        mesh = mesh.coarser()
        assert number_of_cells(mesh) == cells and mesh.degree == 2
        assert integral(mesh) == pytest.approx(2.0, rel=1e-13)
        assert integral(mesh, "right") == pytest.approx(1.0, rel=1e-13)
    assert mesh.coarser is None


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_refinement_of_a_distributed_mesh(cell, degree):
    """Uniform, and three times round a point: the cells are as many as on one rank."""
    whole, alone = (
        with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, one, place=bend, degree=degree))
        for one in (comm, MPI.COMM_SELF)
    )
    expected = sizes(whole)
    fine = refined(whole)
    assert number_of_cells(fine) == 8 * number_of_cells(whole) and unnamed_facets(fine) == 0
    assert np.abs(sizes(fine) / expected - 1.0).max() < 1e-12
    for size in (0.5, 0.25, 0.125) if cell == "tetrahedron" else ():
        whole, alone = (refined(one, near(one, (0.7, 0.5, 0.5), size)) for one in (whole, alone))
        assert number_of_cells(whole) == number_of_cells(alone) and unnamed_facets(whole) == 0
        assert np.abs(sizes(whole) / expected - 1.0).max() < 1e-12


def test_cells_of_one_rank_alone_are_marked():
    """And a box has fewer cells than there are ranks; numbers that are no cells of one rank are an error of all."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), "tetrahedron")
    own = mesh.domain.topology.index_map(3).size_local
    last = max(rank for rank, cells in enumerate(comm.allgather(own)) if cells)
    for _ in range(3):
        marked = np.arange(int(comm.rank == last))
        mesh, before = refined(mesh, marked), number_of_cells(mesh)
        assert number_of_cells(mesh) >= before + 7 and unnamed_facets(mesh) == 0
        last = 0
    assert sizes(mesh) == pytest.approx(np.ones(7), rel=1e-12)
    assert "must be this rank's own cells" in same_error(lambda: refined(mesh, np.array([-1] * (comm.rank == 0), int)))


def test_projection_and_cut_of_a_distributed_mesh(tmp_path_factory):
    """The front has the new nodes of the edge of the top on the ranks of other cells, too."""
    folder = comm.bcast(tmp_path_factory.mktemp("cut") if comm.rank == 0 else None)
    file = BoxFile(cells=(4, 2, 2), cell="tetrahedron")
    file.faces["middle"] = file.interface
    if comm.rank == 0:
        file.write(folder / "box.msh")
    comm.barrier()

    centre = np.array([1.0, 1.0 - np.sqrt(24.0)])
    x = np.linspace(0.0, 2.0, 5)
    corners = np.stack([x, centre[1] + np.sqrt(25.0 - (x - 1.0) ** 2)], axis=1)

    mesh = coulomb.read_mesh(folder / "box.msh", cuts=["middle"])
    mesh.domain.geometry.x[:, 2] *= np.interp(mesh.domain.geometry.x[:, 0], *corners.T)
    fine = refined(replace(mesh, surfaces={"top": Cylinder((1.0, 0.0, centre[1]), (0.0, 1.0, 0.0), 5.0)}))
    assert (fine.components, comm.allreduce(len(fine.touching))) == (2, 25)
    assert integral(fine, "middle") == pytest.approx(integral(fine, "middle_opposite"), rel=1e-6)
    middles = 0.5 * (corners[1:] + corners[:-1]) - centre
    middles *= 5.0 / np.linalg.norm(middles, axis=1, keepdims=True)
    x, height = np.insert(corners, range(1, 5), centre + middles, axis=0).T
    assert integral(fine, "front") == pytest.approx(0.5 * np.sum((height[1:] + height[:-1]) * np.diff(x)), rel=1e-9)
    assert unnamed_facets(fine) == 0
