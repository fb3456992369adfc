"""The numbers that a mesh file gives its nodes: in the mesh, and in the files of a run.

Run alone, or as `mpirun -n 3 python -m pytest tests/fem/meshes/test_parallel_node_numbers.py`.
"""

import csv
from functools import partial

import h5py
import numpy as np
import pytest
from mesh_files import BoxFile
from mesh_writers import abaqus, exodus, med, medit, nastran, vtk, vtu
from scipy.spatial import cKDTree
from test_parallel_meshes import comm, converted, folder, shuffled  # noqa: F401

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Traction
from coulomb.fem import compat
from coulomb.fem.compat import ufl
from coulomb.fem.meshes import NODE_NUMBER, first_order, refined, second_order
from coulomb.io.field_files import NODE, read_grids
from coulomb.io.other_formats import write_formats
from coulomb.io.result_grids import node_numbers

STEEL = Material(2.1e11, 0.3)


def med_with_numbers(file, path):
    med(file, path)
    with h5py.File(path, "a") as data:
        next(iter(data["ENS_MAA"]["mesh"].values()))["NOE"]["NUM"] = 10 * np.arange(len(file.points)) + 10


def exodus_with_numbers(file, path):
    exodus(file, path, hdf5=True)
    with h5py.File(path, "a") as data:
        data["node_num_map"] = 10 * np.arange(len(file.points)) + 10


def nastran_with_numbers(file, path):
    """In free format, every second point in fields."""
    lines = ["BEGIN BULK"]
    for i, (x, y, z) in enumerate(file.points):
        free = f"GRID,{10 * i + 10},,{x},{y},{z}"
        lines.append(free if i % 2 else f"GRID    {10 * i + 10:8d}        {x:8.3f}{y:8.3f}{z:8.3f}")
    for i, cell in enumerate(10 * file.cells + 10, start=1):
        lines.append(",".join(map(str, ["CTETRA", i, 1, *cell])))
    path.write_text("\n".join([*lines, "ENDDATA", ""]))


def gmsh_with_numbers(file, path, **form):
    file.step = 10
    file.write(path, **form)


def by_place(x, points, numbers, unknown=0):
    """The numbers (p,) of the points of a file at these places; `unknown` where there is none."""
    distance, at = cKDTree(points).query(x)
    return np.where(distance < 1e-9, numbers[at], unknown)


@pytest.mark.parametrize(
    ("name", "write", "step"),
    [
        ("box.msh", BoxFile.write, 1),
        ("numbered.msh", gmsh_with_numbers, 10),
        ("numbered41.msh", partial(gmsh_with_numbers, version="4.1"), 10),
        ("binary.msh", partial(gmsh_with_numbers, version="4.1", binary=True), 10),
        ("box.inp", abaqus, 10),
        ("box.med", med, 1),
        ("numbered.med", med_with_numbers, 10),
        ("box.e", exodus, 1),
        ("numbered.exo", exodus_with_numbers, 10),
        ("box.vtu", vtu, 1),
        ("box.vtk", vtk, 1),
        ("box.mesh", medit, 1),
        ("box.bdf", nastran, 1),
        ("numbered.bdf", nastran_with_numbers, 10),
    ],
)
def test_numbers_in_every_format(name, write, step, folder):  # noqa: F811
    file = shuffled(BoxFile(cell="tetrahedron"))
    if comm.rank == 0:
        write(file, folder / name)
    comm.barrier()
    mesh = coulomb.read_mesh(folder / name)
    expected = by_place(mesh.domain.geometry.x, file.points, step * np.arange(1, len(file.points) + 1))
    assert np.array_equal(mesh.node_numbers, expected) and len(mesh.node_numbers)
    assert coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)).node_numbers is None


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_numbers_of_meshes_made_of_one(cell, folder):  # noqa: F811
    """Nodes that the file has keep their numbers; of a refined mesh none are known."""
    file = shuffled(BoxFile(cell=cell).second_order())
    file.step = 10
    mesh = coulomb.read_mesh(converted(file, folder))
    numbers = 10 * np.arange(1, len(file.points) + 1)
    for made, known in ((mesh, file.points), (first_order(mesh), file.points), (second_order(first_order(mesh)), None)):
        corners = np.unique(file.cells[:, : 4 if cell == "tetrahedron" else 8])
        points, of = (file.points[corners], numbers[corners]) if known is None else (known, numbers)
        assert np.array_equal(made.node_numbers, by_place(made.domain.geometry.x, points, of))
    there = coulomb.moved(mesh, translate=(1.0, 0.0, 0.0))
    assert np.array_equal(there.node_numbers, mesh.node_numbers)
    assert refined(mesh).node_numbers is None


def test_both_nodes_of_a_cut_have_the_number_of_the_one_in_the_file(folder):  # noqa: F811
    file = BoxFile(cells=(4, 3, 2))
    file.step, file.faces["middle"] = 10, file.interface
    if comm.rank == 0:
        file.write(folder / "box.msh")
    comm.barrier()
    mesh = coulomb.read_mesh(folder / "box.msh", cuts=["middle"])
    expected = by_place(mesh.domain.geometry.x, file.points, 10 * np.arange(1, len(file.points) + 1))
    assert np.array_equal(mesh.node_numbers, expected)
    assert mesh.domain.geometry.index_map().size_global == len(file.points) + 12


def test_every_file_of_a_run_has_them(folder):  # noqa: F811
    """Two bodies, one of them from a file, of which the nodes on its faces, and those of the table, have numbers; and a
    mesh read from the results has them again."""
    file = shuffled(BoxFile(lengths=(1.0, 1.0, 1.0), cells=(2, 2, 2)))
    file.step = 10
    lower = coulomb.read_mesh(converted(file, folder), cell_names={"all": 1})
    upper = coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (3, 3, 1)), translate=(0.0, 0.0, 1.0))
    problem = ContactProblem(
        coulomb.join(lower=lower, upper=upper),
        STEEL,
        [Clamp("lower:bottom")],
        Contact("upper:bottom", 0.3, against="lower:top"),
        [Traction("upper:top", (0.0, 0.0, -1e6))],
    )
    problem.solve().write(folder / "run")
    if comm.rank == 0:
        write_formats(folder / "run", ("csv", "vtkhdf"))
    comm.barrier()
    of_file = 10 * np.arange(1, len(file.points) + 1)
    bodies = read_grids(folder / "run" / "solution.xdmf")
    numbers = bodies["lower"].fields["node_number"]
    assert np.array_equal(numbers, by_place(bodies["lower"].points, file.points, of_file))
    assert "node_number" not in bodies["upper"].fields
    faces = read_grids(folder / "run" / "contact.xdmf")
    top = faces["lower:top"]
    assert np.array_equal(top.fields["node_number"], numbers[top.fields[NODE].astype(int)]) and len(top.points) == 9
    with (folder / "run" / "contact.csv").open(newline="") as table:
        rows = [(row["name"], row["node_number"]) for row in csv.DictReader(table)]
    assert [float(number) for name, number in rows if name == "lower:top"] == list(top.fields["node_number"])
    assert {number for name, number in rows if name == "upper:bottom"} == {""}
    with h5py.File(folder / "run" / "solution.vtkhdf") as data:
        assert np.array_equal(data["VTKHDF/PointData/node_number"][: len(numbers)], numbers)
    again = coulomb.read_mesh(folder / "run" / "solution.xdmf")
    assert np.array_equal(again.node_numbers, by_place(again.domain.geometry.x, file.points, of_file))
    assert coulomb.check(folder / "run", problem).passed


def test_displacements_of_another_order_than_the_mesh(folder):  # noqa: F811
    """Those of the user's forms: the corners have the numbers of the file."""
    file = shuffled(BoxFile(cell="tetrahedron"))
    file.step = 10
    mesh = coulomb.read_mesh(converted(file, folder))
    V = compat.functionspace(mesh.domain, 2, (3,))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    a = 1e11 * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) * ufl.dx
    found = node_numbers(coulomb.Body(a, faces=mesh))[NODE_NUMBER]
    x = coulomb.Body(a, faces=mesh).x
    assert np.array_equal(found, by_place(x, file.points, 10 * np.arange(1, len(file.points) + 1)))
