"""Meshes that every rank reads a part of.

Run alone, or as `mpirun -n 3 python -m pytest tests/fem/meshes/test_parallel_meshes.py`.
"""

import numpy as np
import pytest
from mesh_files import BoxFile
from mpi4py import MPI
from ranks import same_error
from test_mesh_faults import doubled, flattened, hinge
from typer.testing import CliRunner

import coulomb
from coulomb import Clamp, Elasticity, Material
from coulomb.cli.app import app
from coulomb.fem import compat
from coulomb.fem.compat import io
from coulomb.fem.mesh_formats import BOX_FACES
from coulomb.fem.meshes import coarsened, xdmf_format
from coulomb.fem.meshes.among_ranks import Slabs
from coulomb.fem.meshes.inspection import inspect
from coulomb.fem.meshes.mesh_parts import corners_of
from coulomb.fem.meshes.meshes import read_file
from coulomb.fem.meshes.named_mesh import volume
from coulomb.fem.meshes.xdmf_writing import write

comm = MPI.COMM_WORLD
STEEL = Material(2.1e11, 0.3)
AREAS = {"left": 1.0, "right": 1.0, "front": 2.0, "back": 2.0, "bottom": 2.0, "top": 2.0}


@pytest.fixture
def folder(tmp_path_factory):
    return comm.bcast(tmp_path_factory.mktemp("meshes") if comm.rank == 0 else None)


def shuffled(file):
    """The box with cells and points in a random order: neighbours are on any ranks."""
    random = np.random.default_rng(3)
    points, cells = random.permutation(len(file.points)), random.permutation(len(file.cells))
    number = np.argsort(points)
    file.points, file.cells = file.points[points], number[file.cells[cells]]
    file.faces = {name: number[rows] for name, rows in file.faces.items()}
    at = np.argsort(cells)
    file.cell_groups = {name: at[members] for name, members in file.cell_groups.items()}
    return file


def converted(file, folder, name="part.xdmf"):
    """The file as XDMF."""
    if comm.rank == 0:
        source, target = str(file.write(folder / "part.msh")), folder / name
        if comm.size == 1:
            result = CliRunner().invoke(app, ["convert", source, str(target)])
            assert result.exit_code == 0 and "faces: left, right" in result.output, result.output
        else:  # the command is for one rank
            write(inspect(read_file(source, {}, {}), 1.0, MPI.COMM_SELF), target)
    comm.barrier()
    return folder / name


@pytest.mark.parametrize(("cell", "second"), [("hexahedron", False), ("tetrahedron", True)])
def test_a_converted_mesh_is_read_in_parts(cell, second, folder):
    """Volume, groups and the area of every face are those of the box."""
    file = BoxFile(cells=(4, 2, 2), cell=cell, interface=0.5)
    path = converted(shuffled(file.second_order() if second else file), folder, '<pärt> & "co":2.xdmf')
    part = xdmf_format.read(str(path), None, None, {}, {}, comm)
    for whole, mine in ((file.points, part.points), (file.cells, part.cells)):
        assert len(mine) <= len(whole) // comm.size + 1, "rows of this rank"
    mesh = coulomb.read_mesh(path, scale=2.0)
    assert comm.allreduce(volume(mesh)) == pytest.approx(16.0, rel=1e-13)
    assert list(mesh.faces) == list(file.faces) and list(mesh.cells) == ["soft", "stiff"]
    assert comm.allreduce(len(mesh.cells["soft"])) == len(file.cells) // 4
    soft = mesh.domain.geometry.x[compat.cell_geometry(mesh.domain)[mesh.cells["soft"]]].mean(axis=1)
    assert np.all(soft[:, 0] < 1.0)
    body = Elasticity(mesh, STEEL, [Clamp("left")])
    for name, area in AREAS.items():
        assert comm.allreduce(body.area_of(mesh.faces[name]).sum()) == pytest.approx(4.0 * area, rel=1e-12), name
        axis, end = BOX_FACES[name]
        corners = mesh.domain.geometry.x[corners_of(mesh.domain, mesh.faces[name])]
        assert np.allclose(corners[:, :, axis], 2.0 * end * (2.0, 1.0, 1.0)[axis], atol=1e-12), name
    renamed = coulomb.read_mesh(path, names={"sole": 5})
    assert set(renamed.faces) == {*AREAS, "sole"} - {"bottom"}


def test_dolfinx_reads_a_converted_mesh(folder):
    path = converted(BoxFile(), folder)
    with io.XDMFFile(comm, str(path), "r") as file:
        domain = file.read_mesh(name="mesh")
        cells = file.read_meshtags(domain, name="mesh")
        domain.topology.create_connectivity(2, 3)
        facets = file.read_meshtags(domain, name="facets")
    own = domain.topology.index_map(3).size_local
    assert comm.allreduce(int(np.sum(cells.values[cells.indices < own] == 1))) == 8
    assert set(np.unique(np.concatenate(comm.allgather(facets.values)))) == {1, 2, 3, 4, 5, 6}


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (hinge, r"of 32 cells \(first seen at x = .*\) have edges or corners in common with a part .* share no facet"),
        (flattened, r"16 of 16 cells \(first seen at x = 0.25, 0.25, 0\) have no volume"),
        (doubled, "cells .*(a facet with more than one neighbour|no volume|a Jacobian)"),
    ],
)
def test_faults_of_a_mesh_are_the_same_on_every_rank(spoil, message, folder):
    """Read in parts, and read on one rank."""
    file = BoxFile()
    spoil(file)
    if comm.rank == 0:
        file.write(folder / "bad.msh")
        found = read_file(str(folder / "bad.msh"), {}, {})
        write(found, folder / "bad.xdmf")
    comm.barrier()
    texts = [same_error(lambda path=folder / name: coulomb.read_mesh(path)) for name in ("bad.msh", "bad.xdmf")]
    assert texts[0].replace("bad.msh", "bad.xdmf") == texts[1]
    with pytest.raises(ValueError, match=message):
        coulomb.read_mesh(folder / "bad.xdmf")


def test_faces_inside_the_body_are_refused(folder):
    file = BoxFile(cell="tetrahedron")
    file.faces["inside"] = file.interface
    if comm.rank == 0:
        write(read_file(str(file.write(folder / "part.msh")), {}, {}), folder / "part.xdmf")
    comm.barrier()
    mesh = coulomb.read_mesh(folder / "part.xdmf")
    message = same_error(lambda: Elasticity(mesh, STEEL, [Clamp("inside")]))
    assert f"lies inside the body with {len(file.interface)} of its {len(file.interface)} facets" in message


def test_slabs_near_points():
    """All slabs that begin or end within a distance, and the own one; points of all ranks are shared evenly."""
    x = np.random.default_rng([3, comm.rank]).random((300, 3)) * np.array([1.0, 5.0, 2.0])
    slabs = Slabs(comm, x)
    mine = np.bincount(slabs.of(x), minlength=comm.size)
    assert np.all(np.abs(comm.allreduce(mine) - 300) <= 60)
    there = slabs.of(x + np.array([0.0, 1e9, 0.0]))
    assert np.all(there == comm.size - 1) and not slabs.of(x - np.array([0.0, 1e9, 0.0])).any()
    point, slab = slabs.near(x, 0.7)
    found = set(zip(point.tolist(), slab.tolist(), strict=True))
    for shift in (-0.7, -0.3, 0.0, 0.3, 0.7):
        assert found >= set(enumerate(slabs.of(x + np.array([0.0, shift, 0.0])).tolist()))
    assert len(point) == len(found) and np.all(np.abs(slab - slabs.of(x)[point]) <= max(1, comm.size // 4))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_ranks_without_cells(cell, degree):
    """One hexahedron, or six tetrahedra, on any number of ranks."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), cell, degree=degree)
    body = Elasticity(mesh, STEEL, [Clamp("left")])
    for name in AREAS:
        assert comm.allreduce(body.area_of(mesh.faces[name]).sum()) == pytest.approx(1.0, rel=1e-12), name


def bent(x):
    return np.stack([x[0], x[1], x[2] + 0.2 * x[0] * x[1]])


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_coarser_meshes_do_not_depend_on_the_number_of_ranks(cell):
    def made(comm):
        found = coarsened(coulomb.box((1.0, 2.0, 3.0), (5, 6, 8), cell, place=bent, comm=comm))
        return np.concatenate(comm.allgather(found.domain.geometry.x[: found.domain.geometry.index_map().size_local]))

    ours, alone = (one[np.lexsort(one.T)] for one in (made(comm), made(MPI.COMM_SELF)))
    np.testing.assert_array_equal(ours, alone)
