"""Refinement and the mesh it writes, on any number of ranks."""

import numpy as np
import pytest
from mpi4py import MPI

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box, read_mesh
from coulomb.fem.meshes import gathered, volume, write
from coulomb.ranks import on_rank_0

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.ranks
def test_the_same_meshes_and_bars_as_on_one_rank(cell):
    def refined(comm):
        mesh = box((2.0, 1.0, 1.0), (4, 2, 2), cell, comm=comm)
        loads, clamps = [Traction("top", (1.0e6, 0.0, -1.0e7))], [Clamp("left")]
        problem = ContactProblem(mesh, Material(2.0e11, 0.3), clamps, Contact("bottom", friction=0.3), loads)
        return problem.refine(1e-9, unknowns=2000)

    ours, alone = refined(COMM), refined(MPI.COMM_SELF)
    assert ours.solution.problem.unknowns == alone.solution.problem.unknowns
    for one, other in zip(ours.bars.bars, alone.bars.bars, strict=True):
        np.testing.assert_allclose(one.bar, other.bar, rtol=1e-4, atol=1e-6 * np.max(np.abs(other.value)))


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2), ("hexahedron", 2)])
def test_a_mesh_is_written_and_read_again(tmp_path, cell, degree):
    """With faces and groups; curved."""
    path = COMM.bcast(tmp_path) / "mesh.xdmf"

    def place(x):
        return x + 0.05 * np.sin(x[[1, 2, 0]])

    mesh = box((2.0, 1.0, 1.0), (4, 2, 2), cell, place=place, degree=degree)
    mesh.cells["first"] = np.arange(mesh.domain.topology.index_map(3).size_local, dtype=np.int32)[::2]
    whole = gathered(mesh)
    on_rank_0(COMM, lambda: write(whole, path) or "")
    again = read_mesh(path)
    assert again.degree == degree and set(again.faces) == set(mesh.faces)
    assert COMM.allreduce(volume(again)) == pytest.approx(COMM.allreduce(volume(mesh)), rel=1e-12)
    counts = [COMM.allreduce(len(one.cells["first"])) for one in (mesh, again)]
    assert counts[0] == counts[1]
    owned = [one.domain.geometry.index_map().size_local for one in (mesh, again)]
    sums = [COMM.allreduce(one.domain.geometry.x[:n].sum()) for one, n in zip((mesh, again), owned, strict=True)]
    assert sums[0] == pytest.approx(sums[1], rel=1e-10)
