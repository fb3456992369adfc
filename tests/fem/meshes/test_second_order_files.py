"""Files of second-order meshes: the order of their nodes, curved cells, faces and groups, and what is refused."""

import h5py
import mesh_writers
import numpy as np
import pytest
from mesh_files import EXODUS, GMSH, VTK, BoxFile, integral
from mpi4py import MPI

import coulomb
from coulomb.fem import compat
from coulomb.fem.compat import io, mesh
from coulomb.fem.meshes.lagrange import corner_geometry, in_dolfinx_order, in_vtk_order

CELLS = ("hexahedron", "tetrahedron")


def bent(x):
    """Quadratic in x, so that second-order cells have exactly this shape: a box whose height grows by x^2."""
    return np.column_stack([x[:, 0], x[:, 1] * (1.0 + x[:, 0] ** 2), x[:, 2]])


VOLUME, OF = 2.0 + 8.0 / 3.0, {"left": 1.0, "right": 5.0, "bottom": 2.0 + 8.0 / 3.0}


def looks_right(read, soft="soft"):
    assert compat.geometry_degree(read.domain) == 2
    assert integral(read) == pytest.approx(VOLUME, rel=1e-12)
    for face, area in OF.items():
        assert integral(read, face) == pytest.approx(area, rel=1e-12)
    assert integral(read, cells=soft) == pytest.approx(1.0 + 1.0 / 3.0, rel=1e-12)


def curved(cell, order=GMSH):
    return BoxFile(cells=(2, 1, 1), cell=cell).second_order(bent, order)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(("version", "binary"), [("2.2", False), ("4.1", True)])
def test_gmsh(cell, version, binary, tmp_path):
    looks_right(coulomb.read_mesh(curved(cell).write(tmp_path / "box.msh", version, binary)))


@pytest.mark.parametrize("cell", CELLS)
def test_formats_with_the_order_of_vtk(cell, tmp_path):
    file, numbers = curved(cell, VTK), {"names": mesh_writers.NUMBERS, "cell_names": mesh_writers.CELL_NUMBERS}
    mesh_writers.vtu(file, tmp_path / "box.vtu")
    looks_right(coulomb.read_mesh(tmp_path / "box.vtu", **numbers))
    mesh_writers.xdmf(file, tmp_path / "box.xdmf")
    looks_right(coulomb.fem.meshes.read_xdmf(tmp_path / "box.xdmf", tmp_path / "facets.xdmf", **numbers))
    mesh_writers.exodus(curved(cell, EXODUS), tmp_path / "box.e")
    looks_right(coulomb.read_mesh(tmp_path / "box.e"))


@pytest.mark.parametrize("faces", ["surfaces", "shells", "nodes"])
def test_abaqus_tetrahedra(faces, tmp_path):
    mesh_writers.abaqus(curved("tetrahedron", VTK), tmp_path / "box.inp", faces)
    looks_right(coulomb.read_mesh(tmp_path / "box.inp"))


def test_node_sets_with_corners_alone(tmp_path):
    file = curved("tetrahedron", VTK)
    file.faces = {name: rows[:, :3] for name, rows in file.faces.items()}
    mesh_writers.abaqus(file, tmp_path / "box.inp", "nodes")
    looks_right(coulomb.read_mesh(tmp_path / "box.inp"))


@pytest.mark.parametrize("nodes", [False, True])
def test_med_tetrahedra(nodes, tmp_path):
    mesh_writers.med(curved("tetrahedron", VTK), tmp_path / "box.med", nodes)
    looks_right(coulomb.read_mesh(tmp_path / "box.med"))


def test_med_hexahedra(tmp_path):
    """As MED orders them, after gmsh's GModelIO_MED.cpp: turned over, and gmsh's columns by this map."""
    file = curved("hexahedron")
    file.cells = file.cells[
        :, [0, 3, 2, 1, 4, 7, 6, 5, 9, 13, 11, 8, 17, 19, 18, 16, 10, 15, 14, 12, 20, 22, 24, 23, 21, 25, 26]
    ]
    with h5py.File(tmp_path / "box.med", "w") as out:
        step = out.create_group("ENS_MAA/mesh/-1")
        out.create_group("FAS/mesh")
        for place, rows in (("NOE/COO", file.points), ("MAI/H27/NOD", file.cells + 1)):
            step[place] = rows.ravel(order="F")
            step[place].attrs["NBR"] = len(rows)
    assert integral(coulomb.read_mesh(tmp_path / "box.med")) == pytest.approx(VOLUME, rel=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_xdmf_of_dolfinx(cell, tmp_path):
    made = coulomb.box((2.0, 1.0, 1.0), (2, 1, 1), cell, MPI.COMM_SELF, lambda x: bent(x.T).T, degree=2)
    facets = np.concatenate([made.faces[name] for name in OF])
    values = np.repeat([1, 2, 3], [len(made.faces[name]) for name in OF])
    facet_tags = compat.meshtags(made.domain, 2, facets, values)
    middle = made.domain.geometry.x[corner_geometry(made.domain)].mean(axis=1)
    numbers = np.where(middle[:, 0] < 1.0, 7, 8).astype(np.int32)
    cell_tags = mesh.meshtags(made.domain, 3, np.arange(len(middle), dtype=np.int32), numbers)
    facet_tags.name, cell_tags.name = "facets", "cells"
    with io.XDMFFile(MPI.COMM_SELF, str(tmp_path / "box.xdmf"), "w") as file:
        file.write_mesh(made.domain)
        for tags in (facet_tags, cell_tags):
            try:
                file.write_meshtags(tags)
            except TypeError:  # newer DOLFINx
                file.write_meshtags(tags, made.domain.geometry)
    names = dict(zip(OF, (1, 2, 3), strict=True))
    path = tmp_path / "box.xdmf"
    looks_right(read := coulomb.fem.meshes.read_xdmf(path, names=names, cell_names={"soft": 7}))
    assert set(read.faces) == set(OF) and set(read.cells) == {"soft", "8"}
    assert set(coulomb.fem.meshes.read_xdmf(path, facets=path, cells=path).faces) == set("123")
    with pytest.raises(ValueError, match=r"box.xdmf: names has 'gone' = 9, but the numbers there are 1, 2, 3"):
        coulomb.fem.meshes.read_xdmf(path, names={"gone": 9})


def test_ball_and_ring_of_gmsh_have_curved_cells(tmp_path):
    """Volumes and areas between quadratic surfaces of gmsh are the true ones to 2e-3; with plane facets to 1e-2."""
    gmsh = pytest.importorskip("gmsh")

    def ball():
        gmsh.model.occ.addSphere(0, 0, 0, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.4)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)

    def ring():
        quarter = gmsh.model.occ.addRectangle(1, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        for curve in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(curve[1], 3)
        gmsh.model.mesh.setTransfiniteSurface(quarter)
        gmsh.model.mesh.setRecombine(2, quarter)
        gmsh.model.occ.revolve([(2, quarter)], 0, 0, 0, 0, 1, 0, np.pi / 2, [4], recombine=True)
        gmsh.model.occ.synchronize()

    for make, volume, area in ((ball, 4.0 / 3.0 * np.pi, 4.0 * np.pi), (ring, 3.0 / 4.0 * np.pi, None)):
        gmsh.initialize()
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            make()
            skin = [tag for _, tag in gmsh.model.getEntities(2)]
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, skin), "skin")
            gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)])
            gmsh.model.mesh.generate(3)
            gmsh.model.mesh.setOrder(2)
            gmsh.write(str(tmp_path / "part.msh"))
        finally:
            gmsh.finalize()
        read = coulomb.read_mesh(tmp_path / "part.msh")
        assert compat.geometry_degree(read.domain) == 2 and integral(read) == pytest.approx(volume, rel=2e-3)
        assert area is None or integral(read, "skin") == pytest.approx(area, rel=2e-3)


def turned(file):
    """A corner moved through its cell."""
    file.points[file.cells[0][0]] = file.points[file.cells[0]].mean(axis=0) + (0.6, 0.6, 0.6)


def too_far(file):
    """A node of a straight edge beyond a quarter of it: the Jacobian is negative at the nearer corner only."""
    a, b = file.points[file.cells[0][0]], file.points[file.cells[0][1]]
    file.points[file.cells[0][len(file.cells[0]) // 27 * 4 + 4]] = 0.85 * a + 0.15 * b


def not_shared(file):
    """A neighbour has a node of its own in the middle of an edge, at the same place."""
    shared = next(node for node in file.cells[0][8:] if node in file.cells[1])
    file.points = np.vstack([file.points, file.points[shared]])
    file.cells[1][file.cells[1] == shared] = len(file.points) - 1


def wrong_order(file):
    file.cells[:, [-5, -4]] = file.cells[:, [-4, -5]]


def flat(file):
    file.points[:, 2] = 0.0


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (turned, r"cells \(first seen at .*\) (has|have) (a Jacobian that changes|no volume)"),
        (too_far, r"(has|have) a Jacobian that changes its sign.*Mesh.HighOrderOptimize"),
        (not_shared, r"cells .* have nodes between its corners that its neighbours do not share"),
        (wrong_order, r"cells .* have nodes between its corners that its neighbours do not share"),
        (flat, "cells .* have no volume"),
    ],
)
def test_faults_of_second_order_cells(spoil, message, cell, tmp_path):
    file = BoxFile(cells=(2, 1, 1), cell=cell).second_order()
    spoil(file)
    with pytest.raises(ValueError, match=f"bad.msh: .*{message}"):
        coulomb.read_mesh(file.write(tmp_path / "bad.msh"))


def test_points_of_no_cell_and_a_face_inside(tmp_path):
    file = BoxFile(cells=(2, 1, 1)).second_order()
    file.points = np.vstack([file.points, [9.0, 9.0, 9.0]])
    file.faces["inside"] = file.interface
    read = coulomb.read_mesh(file.write(tmp_path / "box.msh"))
    assert read.domain.geometry.x.max() == 2.0
    with pytest.raises(ValueError, match=r"'inside' of .*box.msh lies inside the body with 1 of its 1 facets"):
        read.facets("inside", "clamp")


@pytest.mark.parametrize(
    ("kind", "nodes", "message"),
    [
        (14, 14, "14-node pyramids, but coulomb .*mesh the body with tetrahedra alone or hexahedra alone"),
        (29, 20, r"20-node tetrahedra, but coulomb .*Mesh.ElementOrder = 2"),
        (92, 64, r"64-node hexahedra, but coulomb .*Mesh.ElementOrder = 2"),
    ],
)
def test_cells_that_are_refused(kind, nodes, message, tmp_path):
    rows = " ".join(str(k + 1) for k in range(nodes))
    points = "".join(f"{k + 1} {k} {k**2} {k**3}\n" for k in range(nodes))
    text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n{}$EndNodes\n$Elements\n{}\n{}$EndElements\n"
    path = tmp_path / "bad.msh"
    path.write_text(text.format(nodes, points, 1, f"1 {kind} 2 1 1 {rows}\n"))
    with pytest.raises(ValueError, match=f"bad.msh: has {message}"):
        coulomb.read_mesh(path)
    if nodes == 20:
        path.write_text(text.format(nodes, points, 2, f"1 {kind} 2 1 1 {rows}\n2 4 2 1 1 1 2 3 4\n"))
        with pytest.raises(ValueError, match=r"bad.msh: has tetrahedra and 20-node"):
            coulomb.read_mesh(path)
        path.write_text(text.format(nodes, points, 2, f"1 17 2 1 1 {rows}\n2 4 2 1 1 1 2 3 4\n"))
        with pytest.raises(
            ValueError, match=r"bad.msh: one body has cells of first and of second order \(4, 20 nodes\)"
        ):
            coulomb.read_mesh(path)


@pytest.mark.parametrize("width", [4, 8, 10, 27])
def test_orders_are_permutations(width):
    columns = np.arange(width)[None, :]
    assert sorted(in_dolfinx_order(columns)[0]) == list(range(width))
    assert all(sorted(in_vtk_order(columns, of)[0]) == list(range(width)) for of in ("gmsh", "exodus", "med"))
