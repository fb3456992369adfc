"""Messages about wrong mesh files."""

import numpy as np
import pytest
from conftest import STEEL
from mesh_files import BoxFile

import coulomb
from coulomb import Clamp, Elasticity
from coulomb.fem.meshes.lagrange import jacobians

XDMF = """<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem Dimensions="{points} {dim}" Format="XML">{x}</DataItem></Geometry>
<Topology TopologyType="{kind}">
<DataItem Dimensions="1 {nodes}" NumberType="Int" Format="XML">{rows}</DataItem></Topology>
</Grid></Domain></Xdmf>"""


@pytest.mark.parametrize(
    ("kind", "dim", "rows", "message"),
    [
        ("Triangle", 3, "0 1 2", r"has no cells in 3D \(tetrahedron, hexahedron, .*\); it has triangle"),
        ("Tetrahedron_20", 3, " ".join(["0"] * 20), "cells of kind tetrahedron_20, but coulomb .*ElementOrder = 2"),
        ("Hex_20", 3, " ".join(["0"] * 20), "cells of kind hexahedron_20, but coulomb .*SecondOrderIncomplete = 0"),
        (
            "Wedge",
            3,
            "0 1 2 3 4 5",
            "cells of kind wedge, but coulomb .*mesh the body with tetrahedra alone or hexahedra alone",
        ),
        ("Tetrahedron", 3, "0 1 2 9", "a point that the file does not define"),
        ("Tetrahedron", 3, "0 1 2 x", "a Topology is damaged"),
        ("Tetrahedron", 2, "0 1 2 3", "has points in 2D, but a body in 3D is needed"),
        ("Tetrahedron", 3, "0 1 2 1", "1 of 1 cells .* has no volume"),
    ],
)
def test_wrong_xdmf(kind, dim, rows, message, tmp_path):
    x = " ".join(map(str, np.eye(4)[:, 4 - dim :].ravel()))
    text = XDMF.format(points=4, dim=dim, x=x, kind=kind, nodes=len(rows.split()), rows=rows)
    path = tmp_path / "mesh.xdmf"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"mesh.xdmf: .*{message}"):
        coulomb.fem.meshes.read_xdmf(path)
    path.write_text(text[: len(text) // 2])
    with pytest.raises(ValueError, match=r"mesh.xdmf: is not XDMF, or cut short"):
        coulomb.fem.meshes.read_xdmf(path)
    with pytest.raises(ValueError, match=r"none.xdmf: cannot be read: No such file"):
        coulomb.fem.meshes.read_xdmf(tmp_path / "none.xdmf")


def moved_through(file):
    corner = np.flatnonzero(np.all(file.points == (0.5, 0.5, 0.5), axis=1))
    file.points[corner] = (1.7, 0.5, 0.5)


def mirrored_corner(file):
    file.cells[0, [0, 1]] = file.cells[0, [1, 0]]


def hinge(file):
    """A copy beside the box, joined to it along one edge."""
    count, (x, _, z) = len(file.points), file.points.T
    again = np.arange(count) + count
    edge = np.flatnonzero((x == 0.0) & (z == 0.0))
    turned = file.points * (-1.0, 1.0, -1.0)
    again[edge] = edge
    cells = again[file.cells]
    file.points = np.vstack([file.points, turned])
    file.cells = np.vstack([file.cells, cells])
    file.cell_groups = {"all": np.arange(len(file.cells))}


@pytest.mark.parametrize("width", [4, 8, 10, 27])
def test_a_cell_shrunk_to_a_point_is_flat_wherever_it_is(width):
    determinants, longest = jacobians(np.full((1, width, 3), 0.1234567))
    assert not determinants.any() and not longest.any()


def flattened(file):
    file.points[:, 2] = 0.0


def doubled(file):
    """Two more cells on the same facet."""
    file.points = np.vstack([file.points, [[-1.0, -1.0, -1.0], [-1.0, -2.0, -1.0]]])
    again = file.cells[[0, 0]]
    again[:, -1] = len(file.points) - 2, len(file.points) - 1
    file.cells = np.vstack([file.cells, again])
    file.cell_groups = {"all": np.arange(len(file.cells))}


def not_finite(file):
    file.points[3, 1] = np.nan


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (moved_through, r"cells \(first seen at x = .*\) have (a Jacobian that|been folded|no volume)"),
        (hinge, r"cells \(first seen at x = .*\) have edges or corners in common with a part .* share no facet"),
        (flattened, r"(16 of 16|96 of 96) cells .* have no volume"),
        (doubled, "cells .*(a facet with more than one neighbour|no volume|a Jacobian)"),
        (not_finite, "coordinates that are not finite"),
    ],
)
def test_cells_that_are_wrong(spoil, message, cell, tmp_path):
    file = BoxFile(cell=cell)
    spoil(file)
    with pytest.raises(ValueError, match=f"bad.msh: .*{message}"):
        coulomb.read_mesh(file.write(tmp_path / "bad.msh"))


def test_a_hexahedron_turned_inside_out(tmp_path):
    file = BoxFile()
    mirrored_corner(file)
    with pytest.raises(ValueError, match=r"1 of 16 cells \(first seen at x = 0.25, 0.25, 0.25\) has a Jacobian that"):
        coulomb.read_mesh(file.write(tmp_path / "bad.msh"))


def test_order_of_nodes_in_tetrahedra_does_not_matter(tmp_path):
    """A tetrahedron numbered left-handed is the same one."""
    file = BoxFile(cell="tetrahedron")
    file.cells[::3, [0, 1]] = file.cells[::3, [1, 0]]
    assert len(coulomb.read_mesh(file.write(tmp_path / "box.msh")).cells["soft"]) == 48


NODES = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (NODES.replace("2.2", "4"), "is of MSH version 4; save it as 4.1 or 2.2"),
        (NODES, r"has no section \$Elements; is it whole\?"),
        (NODES[:-20], r"is damaged or cut short, in section \$Nodes"),
        (NODES + "$Elements\n2\n1 4 2 1 1 1 2 3 4\n$EndElements\n", r"damaged or cut short, in section \$Elements"),
        (NODES + "$Elements\n1\n1 4 2 1 1 1 2 3\n$EndElements\n", r"damaged or cut short, in section \$Elements"),
        (NODES + "$Elements\n1\n1 4 2 1 1 1 2 3 5\n$EndElements\n", "a node that the file does not define"),
        (NODES + "$Elements\n1\n1 99 2 1 1 1 2 3 5\n$EndElements\n", "an element of type 99, which is not known"),
        (NODES + "$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n", r"no cells in 3D .*coulomb.slice.*; mesh"),
        (NODES + "$Elements\n0\n$EndElements\n", "no cells in 3D; mesh the volume"),
        (
            NODES + "$Elements\n1\n1 11 2 1 1 1 2 3 4 1 2 3 4 1 2\n$EndElements\n",
            "1 of 1 cells .* has nodes between its corners that its neighbours do not share",
        ),
        (
            NODES + "$Elements\n1\n1 13 2 1 1 1 2 3 4 1 2 3 4 1 2 3 4 1 2 3 4 1 2\n$EndElements\n",
            "has 18-node prisms, but coulomb .*: mesh the body with tetrahedra alone or hexahedra alone",
        ),
    ],
)
def test_wrong_gmsh_files(text, message, tmp_path):
    path = tmp_path / "bad.msh"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"bad.msh: .*{message}"):
        coulomb.read_mesh(path)


@pytest.mark.parametrize(("version", "binary"), [("2.2", False), ("2.2", True), ("4.1", False), ("4.1", True)])
def test_cut_short_anywhere(version, binary, tmp_path):
    whole = BoxFile(cells=(1, 1, 1)).write(tmp_path / "box.msh", version, binary).read_bytes()
    path = tmp_path / "cut.msh"
    for length in range(0, len(whole) - 14, max(1, len(whole) // 60)):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"cut.msh: "):
            coulomb.read_mesh(path)


def test_missing_file_directory_and_wrong_scale(tmp_path):
    with pytest.raises(ValueError, match=r"none.msh: cannot be read: No such file"):
        coulomb.read_mesh(tmp_path / "none.msh")
    with pytest.raises(ValueError, match="cannot be read: Is a directory"):
        coulomb.fem.meshes.read_xdmf(tmp_path)
    with pytest.raises(ValueError, match="scale must be a positive number of metres per unit, but is 0"):
        coulomb.read_mesh(BoxFile().write(tmp_path / "box.msh"), scale=0.0)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_wrong_face_groups(cell, tmp_path):
    file = BoxFile(cell=cell)
    file.faces["inside"] = file.interface
    file.faces["empty"] = file.faces["left"][:0]
    file.points = np.vstack([file.points, file.points[file.faces["left"][0]] - 1.0])
    file.faces["away"] = np.arange(len(file.points) - len(file.faces["left"][0]), len(file.points))[None, :]
    domain = coulomb.read_mesh(file.write(tmp_path / "box.msh"))
    for name, message in (
        ("inside", "clamp: face group 'inside' of .*box.msh lies inside the body with .* facets"),
        ("empty", "clamp: face group 'empty' of .*box.msh is empty"),
        ("away", "clamp: face group 'away' of .*box.msh has facets whose nodes belong to no cell"),
        ("lefd", r"clamp: there is no face 'lefd' on this mesh \(did you mean 'left'\?\); its faces are left, right"),
    ):
        with pytest.raises(ValueError, match=message):
            Elasticity(domain, STEEL, [Clamp(name)])


def test_a_gmsh_file_without_groups_is_told_how_to_name_faces(tmp_path):
    """Alone, and as one of two bodies."""
    file = BoxFile()
    file.faces.clear()
    mesh = coulomb.read_mesh(file.write(tmp_path / "bare.msh"))
    message = r"there is no face 'left' on this mesh; .*bare.msh has no faces: write Physical Surface\(\"left\"\) = "
    with pytest.raises(ValueError, match=message):
        Elasticity(mesh, STEEL, [Clamp("left")])
    with pytest.raises(ValueError, match=r"no face 'a:left'.*; .*bare.msh has no faces: write Physical Surface"):
        coulomb.join({"a": mesh, "b": coulomb.box((1, 1, 1), (1, 1, 1))}).facets("a:left", "clamp")


def test_wrong_materials(tmp_path):
    file = BoxFile()
    file.cell_groups["end"] = file.cell_groups["stiff"][-1:]
    domain = coulomb.read_mesh(file.write(tmp_path / "box.msh"))
    for groups, message in (
        (("soft",), "material: 8 of 16 cells are without a material; materials are given for soft, the mesh .* end"),
        (("soft", "stiff", "end"), "material: 1 of 16 cells are in more than one of these groups"),
        (("soft", "stif"), r"material: there is no cell group 'stif' on this mesh \(did you mean 'stiff'\?\)"),
    ):
        with pytest.raises(ValueError, match=message):
            Elasticity(domain, dict.fromkeys(groups, STEEL), [Clamp("left")])
    with pytest.raises(ValueError, match="material: there is no cell group 'soft' on this mesh; it has no cell groups"):
        Elasticity(coulomb.box((1, 1, 1), (1, 1, 1)), {"soft": STEEL}, [Clamp("left")])
