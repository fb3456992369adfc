"""Mesh files of other programs: the same body with the same faces in every format; wrong files are refused."""

from functools import partial

import h5py
import numpy as np
import pytest
from conftest import STEEL
from mesh_files import BoxFile
from mesh_writers import (
    CELL_NUMBERS,
    NUMBERS,
    abaqus,
    abaqus_by_meshio,
    exodus,
    med,
    medit,
    nastran,
    vtk,
    vtu,
    without_families_of,
    xdmf,
)

import coulomb
from coulomb import Clamp, Elasticity, Material, Pressure
from coulomb.fem.bodies.materials import midpoints

NAMES = {"names": NUMBERS, "cell_names": CELL_NUMBERS}

FORMATS = {
    "gmsh 2.2": ("box.msh", BoxFile.write, {}),
    "gmsh 2.2, binary": ("box.msh", partial(BoxFile.write, binary=True), {}),
    "gmsh 4.1": ("box.msh", partial(BoxFile.write, version="4.1"), {}),
    "gmsh 4.1, binary": ("box.msh", partial(BoxFile.write, version="4.1", binary=True), {}),
    "abaqus, surfaces": ("box.inp", abaqus, {}),
    "abaqus, surface elements": ("box.inp", partial(abaqus, faces="shells"), {}),
    "abaqus, node sets": ("box.inp", partial(abaqus, faces="nodes"), {}),
    "abaqus by meshio": ("box.INP", abaqus_by_meshio, {}),
    "MED": ("box.med", med, {}),
    "MED, groups of nodes": ("box.med", partial(med, nodes=True), {}),
    "Exodus, NetCDF-3": ("box.e", exodus, {}),
    "Exodus, HDF5": ("box.exo", partial(exodus, hdf5=True), {}),
    "Exodus, node sets": ("box.g", partial(exodus, nodes=True), {}),
    "VTU": ("box.vtu", vtu, NAMES),
    "VTK": ("box.vtk", vtk, NAMES),
    "Nastran": ("box.bdf", nastran, NAMES),
    "Medit": ("box.mesh", medit, NAMES),
}


def seen(mesh):
    """At the nodes by place: internal forces of a displacement, with two materials, and the area of every face."""
    body = Elasticity(mesh, {"soft": Material(1e11, 0.3), "stiff": STEEL}, [Clamp("left")])
    u = np.sin(body.x @ np.array([[3.0, 1.0, 2.0], [1.0, 5.0, 4.0], [2.0, 6.0, 1.0]]))
    areas = [body.area_of(mesh.facets(name, "test")) for name in NUMBERS]
    return np.column_stack([body.internal_force(u) / 1e11, *areas])[np.lexsort(body.x.round(9).T)]


@pytest.fixture(scope="module", params=["hexahedron", "tetrahedron"])
def box(request):
    """The box as a file has it, and what is seen of the same box made by DOLFINx."""
    made = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), request.param)
    x = midpoints(made.domain)[:, 0]
    groups = {"soft": np.flatnonzero(x < 1.0).astype(np.int32), "stiff": np.flatnonzero(x > 1.0).astype(np.int32)}
    return BoxFile(cell=request.param), seen(coulomb.NamedMesh(made.domain, made.faces, groups))


def same(mesh, box):
    file, expected = box
    assert not [name for name in (*mesh.faces, *mesh.cells) if name.startswith("_")]  # Abaqus' internal sets
    assert set(file.faces) <= set(mesh.faces) and {"soft", "stiff"} <= set(mesh.cells)
    for name, rows in file.faces.items():
        assert len(mesh.faces[name]) == len(rows), name
    assert np.abs(seen(mesh) - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_box_in_every_format(form, box, tmp_path):
    name, write, options = FORMATS[form]
    write(box[0], tmp_path / name)
    same(coulomb.read_mesh(tmp_path / name, **options), box)


@pytest.mark.parametrize("form", FORMATS)
def test_one_group_of_cells_is_read_alone(form, box, tmp_path):
    """With what faces have on it; not of Exodus files."""
    name, write, options = FORMATS[form]
    write(box[0], tmp_path / name)
    if "Exodus" in form:
        with pytest.raises(ValueError, match="one group of cells is read from"):
            coulomb.read_mesh(tmp_path / name, **options, only="soft")
        return
    half = coulomb.read_mesh(tmp_path / name, **options, only="soft")
    assert coulomb.fem.meshes.volume(half) == pytest.approx(1.0)
    sides = {name for name in half.faces if not name.startswith("of_")}  # sets of surface elements of .inp files
    assert sides == {"left", "front", "back", "bottom", "top"} and "stiff" not in half.cells
    assert len(half.faces["left"]) == len(box[0].faces["left"])
    assert len(half.faces["top"]) == len(box[0].faces["top"]) // 2
    if not name.endswith(("inp", "INP")):  # which says it by its sets
        with pytest.raises(ValueError, match="has no group of cells 'hard' with any cells; its groups of cells are"):
            coulomb.read_mesh(tmp_path / name, **options, only="hard")


def test_a_group_of_hexahedra_beside_tetrahedra_stays_hexahedra(tmp_path):
    import meshio

    x = np.array([*np.ndindex(2, 2, 2), [3, 0, 0], [4, 0, 0], [3, 1, 0], [3, 0, 1]], dtype=float)
    cells = [("hexahedron", [[0, 4, 6, 2, 1, 5, 7, 3]]), ("tetra", [[8, 9, 10, 11]])]
    meshio.Mesh(x, cells, cell_data={"tag": [np.array([1]), np.array([2])]}).write(tmp_path / "a.vtu")
    one, other = (coulomb.read_mesh(tmp_path / "a.vtu", only=number) for number in "12")
    kinds = [mesh.domain.topology.cell_type.name for mesh in (one, other)]
    assert kinds == ["hexahedron", "tetrahedron"] and {*one.cells} == {"1"} and {*other.cells} == {"2"}
    assert coulomb.fem.meshes.volume(one) == pytest.approx(1.0)


def test_one_group_of_a_section(tmp_path):
    import meshio

    x = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]], dtype=float)
    cells = [("quad", [[0, 1, 4, 3]]), ("triangle", [[1, 2, 5], [1, 5, 4]]), ("line", [[0, 1], [1, 2]])]
    numbers = {"tag": [np.array([1]), np.array([2, 2]), np.array([5, 5])]}
    meshio.Mesh(x, cells, cell_data=numbers).write(tmp_path / "a.vtu")
    made = coulomb.slice(tmp_path / "a.vtu", "plane strain", names={"foot": 5}, only="1")
    assert coulomb.fem.meshes.volume(made) == pytest.approx(1.0)
    assert {*made.faces} == {"foot", "front", "back"} and len(made.faces["foot"]) == 1
    with pytest.raises(ValueError, match="no group of cells '3' with any cells; its groups of cells are: 1, 2"):
        coulomb.slice(tmp_path / "a.vtu", "plane strain", only="3")


def test_xdmf_of_meshio(box, tmp_path):
    xdmf(box[0], tmp_path / "box.xdmf")
    same(coulomb.fem.meshes.read_xdmf(tmp_path / "box.xdmf", facets=tmp_path / "facets.xdmf", **NAMES), box)


def test_groups_without_names_are_called_by_their_numbers(tmp_path):
    file = BoxFile()
    vtu(file, tmp_path / "box.vtu")
    exodus(file, tmp_path / "box.exo", hdf5=True)
    with h5py.File(tmp_path / "box.exo", "a") as data:
        data["ss_names"][...] = b""
    read = coulomb.read_mesh(tmp_path / "box.vtu", scale=2.0)
    assert set(read.faces) == set("123456") and set(read.cells) == set("78")
    assert read.domain.geometry.x.max() == 4.0
    assert set(coulomb.read_mesh(tmp_path / "box.exo").faces) == {str(number) for number in range(100, 106)}


def test_volumes_in_no_group_of_a_med_file(tmp_path):
    """Salome leaves their families out; meshio then fails."""
    med(BoxFile(), tmp_path / "box.med")
    without_families_of(tmp_path / "box.med", "HE8")
    read = coulomb.read_mesh(tmp_path / "box.med")
    assert set(read.faces) == set(NUMBERS) and read.cells == {}


NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(np.ndindex(3, 2, 2), start=1))
CELLS = ["1, 1, 5, 7, 3, 2, 6, 8, 4", "2, 5, 9, 11, 7, 6, 10, 12, 8"]
TWO = NODES + "*ELEMENT, TYPE=C3D8R, ELSET=all\n" + "\n".join(CELLS) + "\n"
"""Two cubes in a row along x."""


def read_text(tmp_path, text, name="part.inp"):
    (tmp_path / name).write_text(text)
    return coulomb.read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "cells", "faces"),
    [
        # Each of the following is what meshio loses or assigns to the wrong elements.
        (NODES + "*ELEMENT, TYPE=T3D2\n9, 1, 2\n" + TWO.removeprefix(NODES), {"all": 2}, {}),
        (TWO + "*ELSET, ELSET=one\n1\n*ELSET, ELSET=two\n2\n*ELSET, ELSET=both\nONE, two\n", {"both": 2}, {}),
        (TWO.replace("*ELEMENT", "*NODE, NSET=far\n99, 9, 9, 9\n*ELEMENT"), {"all": 2}, {}),
        (TWO + "*NSET, NSET=end, GENERATE\n1, 2, 1\n3, 4\n", {}, {"end": 1}),
        (TWO + "*ELSET, ELSET=one\n 1,\n*SURFACE, NAME=end\none, S6\n", {"one": 1}, {"end": 1}),
        (TWO + "*SURFACE, NAME=ends, TYPE=ELEMENT\n1, S6\n2, S4\n", {}, {"ends": 2}),
        (TWO + "*ELSET, ELSET=one\n 1,\n*SURFACE, NAME=skin\none\n", {}, {"skin": 5}),
        (TWO + "*NSET, NSET=n\n1, 2, 3, 4\n*SURFACE, NAME=end, TYPE=NODE\nn, 1.0\n", {}, {"end": 1}),
        # Further forms of the same.
        (TWO.replace("2, 5, 9, 11, 7,", "2, 5, 9, 11,\n 7,").replace("*ELEMENT, ", "*ELEMENT,\n"), {"all": 2}, {}),
        (TWO.replace("1, 0, 0, 0", "1").replace("5, 1, 0, 0", "5, 1.0D+00"), {"all": 2}, {}),
        ("*PART, NAME=p\n" + TWO + "*END PART\n*INSTANCE, NAME=i, PART=p\n*END INSTANCE\n", {"all": 2}, {}),
        (TWO + "*NSET, NSET=same, GENERATE\n1, 12\n*SURFACE, NAME=same\n1, S6\n", {}, {"same": 1}),
    ],
)
def test_abaqus_sets_and_surfaces(text, cells, faces, tmp_path):
    read = read_text(tmp_path, text)
    assert len(read.domain.geometry.x) == 12
    assert {name: len(read.cells[name]) for name in cells} == cells
    assert {name: len(read.faces[name]) for name in faces} == faces


def test_abaqus_numbers_of_sides(tmp_path):
    """Where the nodes lie that have a share in the area."""
    read = read_text(tmp_path, TWO + "*SURFACE, NAME=a\n1, S6\n*SURFACE, NAME=b\n2, S4\n*SURFACE, NAME=c\nall, S1\n")
    body = Elasticity(read, STEEL, [Clamp("a")])
    for face, (axis, value, area) in {"a": (0, 0.0, 1.0), "b": (0, 2.0, 1.0), "c": (2, 0.0, 2.0)}.items():
        areas = body.area_of(body.mesh.facets(face, "test"))
        assert np.allclose(body.x[areas > 1e-9, axis], value) and areas.sum() == pytest.approx(area)


def test_abaqus_files_that_include_others(tmp_path):
    (tmp_path / "nodes.txt").write_text(NODES)
    assert set(read_text(tmp_path, "*INCLUDE, INPUT=nodes.txt\n" + TWO.removeprefix(NODES)).cells) == {"all"}
    with pytest.raises(ValueError, match=r"part.inp: line 1: \*INCLUDE: there is no file '.*gone.txt'"):
        read_text(tmp_path, "*Include, input=gone.txt\n")
    with pytest.raises(ValueError, match=r"part.inp: \*INCLUDE: more than 10 files"):
        read_text(tmp_path, "*INCLUDE, INPUT=part.inp\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("solid cube\n", "is no input file of Abaqus or CalculiX: it has no card"),
        (NODES, "has no tetrahedra or hexahedra: export"),
        (NODES + "*ELEMENT, TYPE=S4\n1, 1, 2, 4, 3\n", "no tetrahedra or hexahedra; it has 1 surface elements"),
        (NODES + "*ELEMENT, TYPE=C3D27\n" + ", ".join(["1"] * 28), "has 27-node hexahedra, whose nodes programs"),
        (
            NODES + "*ELEMENT, TYPE=C3D18\n" + ", ".join(["1"] * 19),
            "has 18-node prisms, but coulomb .* tetrahedra alone",
        ),
        (
            TWO
            + "*NODE\n"
            + "".join(f"{k}, {k}, {k % 3}, {k % 2}\n" for k in (21, 22, 23, 25))
            + "*ELEMENT, TYPE=C3D4\n7, 21, 22, 23, 25\n",
            r"has bodies of several kinds of cells: give each a \[\[body\]\] with cells = 'first_order_hexahedra' or",
        ),
        (TWO[:-3], r"\*ELEMENT: damaged: elements of type C3D8R must have a number and 8 nodes each"),
        (TWO.replace("12, 8", "12, 88"), r"line 16: \*ELEMENT: node 88 is not defined"),
        (TWO.replace("12, 8", "12, x"), r"line 16: \*ELEMENT: damaged: 'x' is no number"),
        (TWO.replace("12, 8", "12, 8.5"), r"line 16: \*ELEMENT: damaged: '8.5' should be a whole number"),
        (TWO.replace("2, 5, 9", "1, 5, 9"), r"has two elements of the number 1: .*line 15 and .*line 16"),
        (NODES + TWO, r"has two nodes of the number 1: .*line 2 and .*line \d+, and 11 more such numbers"),
        (TWO + "*ELSET, ELSET=a\nb\n*ELSET, ELSET=b\na\n", "the element set 'a' contains itself"),
        (TWO + "*SURFACE, NAME=s\nnowhere, S1\n", r"line 18: \*SURFACE: the element set 'nowhere' is not defined"),
        (TWO + "*SURFACE, NAME=s\n1, S7\n", r"\*SURFACE s: elements of 8 nodes have no side 'S7'"),
        (TWO + "*NSET, NSET=n, GENERATE\n1\n", r"\*NSET: GENERATE needs first, last and step, but has '1'"),
        (TWO + "*NSET\n1\n", r"\*NSET: NSET is missing"),
        (TWO + "*INSTANCE, NAME=i, PART=p\n5., 0., 0.\n", r"\*INSTANCE: there is no \*PART 'p'"),
        ("*PART, NAME=a\n*PART, NAME=b\n" + TWO, r"has 2 parts \(a, b\), but no \*INSTANCE of them"),
        (TWO.replace("*NODE", "*NODE, SYSTEM=C"), r"\*NODE: coordinates are not Cartesian"),
    ],
)
def test_wrong_abaqus_files(text, message, tmp_path):
    with pytest.raises(ValueError, match=f"part.inp: .*{message}"):
        read_text(tmp_path, text)


def test_wrong_node_sets(tmp_path):
    sets = {"line": "1, 2", "middle": "5, 6, 7, 8", "more": "1, 2, 3, 4, 9", "lost": "1, 2, 3, 4, 99", "none": ""}
    text = "".join(f"*NSET, NSET={name}\n{nodes}\n" for name, nodes in sets.items())
    read = read_text(tmp_path, TWO.replace("*ELEMENT", "99, 9, 9, 9\n*ELEMENT") + text)
    assert {name: len(facets) for name, facets in read.faces.items()} == {"lost": 1}  # node 99 is of no cell: the rest
    for name, message in (
        ("line", "has 2 of 2 nodes that are no corners of boundary facets within the set"),
        ("middle", "has 4 of 4 nodes that are no corners"),
        ("more", "has 1 of 5 nodes that are no corners"),
        ("none", "is empty"),
    ):
        with pytest.raises(ValueError, match=f"pressure: node set '{name}' of .*part.inp {message}"):
            Elasticity(read, STEEL, [], [Pressure(name, 1.0)])
    with pytest.raises(ValueError, match=r"clamp: node set 'none' of .*part.inp "):  # the others may hold nodes
        Elasticity(read, STEEL, [Clamp("none")])


def test_wrong_med_files(tmp_path):
    path = tmp_path / "box.med"
    path.write_text("no HDF5")
    with pytest.raises(ValueError, match=r"box.med: is not a MED file: it is not HDF5"):
        coulomb.read_mesh(path)
    with h5py.File(path, "w") as data:
        data["else"] = 1
    with pytest.raises(ValueError, match=r"box.med: is not a MED file, or damaged: .*ENS_MAA"):
        coulomb.read_mesh(path)
    med(BoxFile(), path)
    with h5py.File(path, "a") as data:
        step = next(iter(data["ENS_MAA"]["mesh"].values()))
        data.copy(step, data["ENS_MAA"]["mesh"], "later")
    with pytest.raises(ValueError, match=r"box.med: has 2 time steps of the mesh \(.*\), but needs one"):
        coulomb.read_mesh(path)
    with h5py.File(path, "a") as data:
        data.copy(data["ENS_MAA"]["mesh"], data["ENS_MAA"], "other")
    with pytest.raises(ValueError, match=r"box.med: has 2 meshes \(mesh, other\), but needs one"):
        coulomb.read_mesh(path)


def test_wrong_exodus_files(tmp_path):
    path = tmp_path / "box.e"
    for content, message in (
        (b"CDF\5 and so on", "is NetCDF of the kind CDF-5; convert it: nccopy"),
        (b"anything else", "is not an Exodus file, or damaged"),
        (b"CDF\1", "is not an Exodus file, or damaged|is damaged"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=f"box.e: ({message})"):
            coulomb.read_mesh(path)
    exodus(BoxFile(), path, hdf5=True)
    with h5py.File(path, "a") as data:
        data["side_ss2"][0] = 7
    with pytest.raises(ValueError, match=r"box.e: the side set 'right' has sides that are no facets of its elements"):
        coulomb.read_mesh(path)


def test_shells_in_exodus_files(tmp_path):
    """A block of shells is a face, and so is a side set of either of their faces; the side 3 is an edge."""
    file = BoxFile()
    path = tmp_path / "box.exo"
    exodus(file, path, hdf5=True)
    first = len(file.cells) + 1
    with h5py.File(path, "a") as data:
        data["connect3"] = (file.faces["left"] + 1).astype("i4")
        data["connect3"].attrs["elem_type"] = "SHELL4"
        data["eb_prop1"][...], names = [100, 101], data["eb_names"][...]
        del data["eb_names"], data["eb_prop1"]
        data["eb_names"] = np.vstack([names, np.full((1, 33), b"")]).astype("S1")
        data["eb_prop1"] = np.array([100, 101, 42])
        data["elem_ss1"][...] = np.arange(first, first + len(file.faces["left"]))
        data["side_ss1"][...] = 2
    read = coulomb.read_mesh(path)
    assert sorted(read.faces["42"]) == sorted(read.faces["left"]) and len(read.faces["42"]) == len(file.faces["left"])
    with h5py.File(path, "a") as data:
        data["side_ss1"][...] = 3
    with pytest.raises(ValueError, match="the side set 'left' has sides that are no facets"):
        coulomb.read_mesh(path)


def test_files_that_meshio_cannot_read_or_would_misread(tmp_path):
    for name, text, message in (
        ("a.vtu", "<VTKFile", r"cannot be read as vtu \(by meshio "),
        ("a.vtk", "no VTK\n", "cannot be read as vtk .*Illegal VTK header"),
        ("a.mesh", "MeshVersionFormatted\n", "cannot be read as medit"),
        ("a.bdf", "GRID,1,,0.,0.,0.\n", "cannot be read as nastran .*Premature EOF"),
        ("a.nas", "CHEXA*  1\n", "has elements in large fields"),
        ("a.nas", "INCLUDE 'b.nas'\n", "refers to other files by INCLUDE"),
        ("a.bdf", "GRID,1,7,0.,0.,0.\nENDDATA\n", "GRID points in a local coordinate system"),
        ("a.bdf", "GRID,1,,0.,0.,0.\nENDDATA\n", "has no tetrahedra or hexahedra: export"),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(ValueError, match=f"{name}: .*{message}"):
            coulomb.read_mesh(tmp_path / name)


def test_wrong_names_and_formats(tmp_path):
    file = BoxFile()
    vtu(file, tmp_path / "box.vtu")
    with pytest.raises(ValueError, match=r"box.vtu: names has 'gone' = 9, but the numbers there are 1, 2, 3, 4, 5, 6"):
        coulomb.read_mesh(tmp_path / "box.vtu", names={"gone": 9})
    with pytest.raises(ValueError, match=r"box.inp: names and cell_names are for formats with numbered groups"):
        coulomb.read_mesh(tmp_path / "box.inp", names={"gone": 9})
    with pytest.raises(ValueError, match=r"box.stl: the name of a mesh file must end in one of .msh \(gmsh\), .*Medit"):
        coulomb.read_mesh(tmp_path / "box.stl")
    with pytest.raises(ValueError, match=r"none.med: cannot be read: No such file"):
        coulomb.read_mesh(tmp_path / "none.med")


def test_second_order_and_mixed_cells_by_meshio(tmp_path):
    import meshio

    x = np.random.default_rng(1).random((20, 3))
    for kind, nodes, message in (
        ("wedge18", 18, "has 18-node prisms, but coulomb .*: mesh the body with tetrahedra alone or hexahedra alone"),
    ):
        meshio.vtu.write(tmp_path / "a.vtu", meshio.Mesh(x, [(kind, np.arange(nodes)[None, :])]))
        with pytest.raises(ValueError, match=f"a.vtu: {message}"):
            coulomb.read_mesh(tmp_path / "a.vtu")
    two_sets = meshio.Mesh(np.eye(4)[:, :3], [("tetra", [[0, 1, 2, 3]])], cell_data={"a": [[1]], "b": [[2]]})
    meshio.vtu.write(tmp_path / "a.vtu", two_sets)
    with pytest.raises(ValueError, match=r"a.vtu: has several sets of numbers \(a, b\), but needs one"):
        coulomb.read_mesh(tmp_path / "a.vtu")


def test_mixed_cells_of_xdmf(tmp_path):
    """A cube with a prism beside it, a pyramid on it and a tetrahedron at that, as meshio writes them: 12 tetrahedra of
    the same volume, with the numbers on cells and facets."""
    import meshio

    cube = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    x = np.array([*cube, [2, 0, 0], [2, 1, 0], [0.5, 0.5, 1.6], [0.5, -1, 1]], dtype=float)
    cells = [
        ("hexahedron", [[0, 1, 2, 3, 4, 5, 6, 7]]),
        ("wedge", [[1, 8, 5, 2, 9, 6]]),
        ("pyramid", [[4, 5, 6, 7, 10]]),
    ]
    cells += [("tetra", [[4, 11, 5, 10]]), ("quad", [[0, 3, 2, 1]])]
    tags = {"tag": [np.array([number]) for number in (1, 1, 2, 2, 7)]}
    meshio.Mesh(x, cells, cell_data=tags).write(tmp_path / "a.xdmf")
    mesh = coulomb.read_mesh(tmp_path / "a.xdmf", names={"base": 7}, cell_names={"low": 1})
    assert coulomb.fem.meshes.volume(mesh) == pytest.approx(1.0 + 0.5 + 0.2 + 0.1)
    assert len(mesh.faces["base"]) == 2 and len(mesh.cells["low"]) == 9


def test_without_meshio(tmp_path, monkeypatch):
    import sys

    vtu(BoxFile(), tmp_path / "box.vtu")
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(ValueError, match=r"box.vtu: this format is read by meshio, which is not installed: "):
        coulomb.read_mesh(tmp_path / "box.vtu")
