"""Meshes from files, several materials, springs."""

import json

import numpy as np
import pytest
from conftest import STEEL, run_coulomb
from mesh_files import BoxFile
from mpi4py import MPI
from test_elasticity import solve

import coulomb
from coulomb import Clamp, Contact, ContactProblem, DirectSolver, Elasticity, Material, Spring, Traction
from coulomb.fem import compat
from coulomb.fem.compat import fem, io, mesh
from coulomb.io.recheck.directory import check
from coulomb.io.summary import summary


def by_place(x, values):
    return values[np.lexsort(x.round(9).T)]


def block(domain, material=STEEL):
    return ContactProblem(
        domain,
        material,
        [Clamp("left")],
        Contact("bottom", friction=0.3),
        [Traction("top", (0.0, 1e7, -4e7)), Traction("right", (2e7, 0.0, 0.0))],
    )


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize(("version", "binary"), [("2.2", False), ("2.2", True), ("4.1", False), ("4.1", True)])
def test_box_from_a_file_is_the_box(cell, version, binary, tmp_path):
    """Forces equal those on the same mesh made by DOLFINx, node by node."""
    lengths, cells = (2.0, 1.0, 1.0), (4, 2, 2)
    path = BoxFile(lengths, cells, cell).write(tmp_path / "box.msh", version, binary)
    read, made = coulomb.read_gmsh(path), coulomb.box(lengths, cells, cell)
    assert set(read.faces) == set(made.faces) and set(read.cells) == {"soft", "stiff"}
    assert len(read.cells["soft"]) == len(read.cells["stiff"])
    forces = []
    for domain in (read, made):
        solution = block(domain).solve(tolerance=1e-11)
        assert solution.certificate.passed
        surface = solution.problem.surface
        forces.append(by_place(surface.x, -surface.vectors(solution.contact_force.reshape(-1, 3))))
    assert np.linalg.norm(forces[0] - forces[1]) <= 1e-10 * np.linalg.norm(forces[1])


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_two_materials_in_tension_are_exact(cell, tmp_path):
    """nu/E alike, so that both contract alike across: u_x = s x/E_1 up to x = 1, then s/E_1 + s (x - 1)/E_2."""
    s, soft, stiff = 1e6, Material(1e11, 0.2), Material(2e11, 0.4)
    domain = coulomb.read_gmsh(BoxFile(cell=cell).write(tmp_path / "bar.msh"))
    elasticity = Elasticity(
        domain,
        {"stiff": stiff, "soft": soft},
        [Clamp("left", "x"), Clamp("front", "y"), Clamp("bottom", "z")],
        [Traction("right", (s, 0.0, 0.0))],
    )
    x, u = elasticity.x, solve(elasticity)
    along = np.where(x[:, 0] < 1.0, x[:, 0] / 1e11, 1.0 / 1e11 + (x[:, 0] - 1.0) / 2e11)
    exact = s * np.column_stack([along, *(-2e-12 * x[:, 1:].T)])
    assert np.abs(u - exact).max() <= 1e-10 * np.abs(exact).max()
    assert np.allclose(elasticity.von_mises(elasticity.function(u)).x.array, s, rtol=1e-8)


def test_scale_and_groups_without_names(tmp_path):
    file = BoxFile((2000.0, 1000.0, 1000.0))
    domain = coulomb.read_gmsh(file.write(tmp_path / "mm.msh", named=False), scale=1e-3)
    assert set(domain.faces) == set("123456") and set(domain.cells) == {"1", "2"}
    assert np.allclose(np.max(domain.domain.geometry.x, axis=0), (2.0, 1.0, 1.0))
    elasticity = Elasticity(domain, STEEL, [Clamp("1")])
    assert elasticity.nodal_area("5").sum() == pytest.approx(2.0)


def test_points_of_no_cell_and_elements_in_two_groups(tmp_path):
    file = BoxFile()
    file.points = np.vstack([[[9.0, 9.0, 9.0]], file.points])
    file.cells += 1
    file.faces = {name: rows + 1 for name, rows in file.faces.items()}
    file.faces["both"] = np.vstack([file.faces["left"], file.faces["right"]])
    domain = coulomb.read_gmsh(file.write(tmp_path / "box.msh"))
    assert domain.domain.geometry.x.max() == 2.0
    assert sorted([*domain.faces["left"], *domain.faces["right"]]) == sorted(domain.faces["both"])


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_xdmf_of_dolfinx(cell, tmp_path):
    """A mesh with MeshTags on facets and cells, numbers given names, as DOLFINx writes it."""
    made = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), cell)
    domain = made.domain
    facets = [made.faces[name] for name in ("left", "right", "bottom", "top")]
    values = np.repeat(np.arange(1, 5, dtype=np.int32), [len(part) for part in facets])
    order = np.argsort(np.concatenate(facets))
    facet_tags = mesh.meshtags(domain, 2, np.concatenate(facets)[order], values[order])
    count = domain.topology.index_map(3).size_local
    everywhere = np.arange(count, dtype=np.int32)
    midpoints = fem.Function(compat.functionspace(domain, 0, family="DG"))
    midpoints.interpolate(lambda x: x[0])
    cell_tags = mesh.meshtags(domain, 3, everywhere, np.where(midpoints.x.array < 1.0, 7, 8).astype(np.int32))
    facet_tags.name, cell_tags.name = "facets", "cells"
    with io.XDMFFile(MPI.COMM_WORLD, str(tmp_path / "mesh.xdmf"), "w") as file:
        file.write_mesh(domain)
        for tags in (facet_tags, cell_tags):
            try:
                file.write_meshtags(tags)
            except TypeError:  # newer DOLFINx
                file.write_meshtags(tags, domain.geometry)
    path, names = tmp_path / "mesh.xdmf", {"left": 1, "right": 2, "bottom": 3, "top": 4}
    read = coulomb.read_xdmf(path, names=names, cell_names={"soft": 7})
    assert set(read.faces) == set(names) and set(read.cells) == {"soft", "8"}
    assert set(coulomb.read_xdmf(path, facets=path, cells=path).faces) == {"1", "2", "3", "4"}
    materials = {"soft": Material(1e11, 0.3), "8": Material(2e11, 0.3)}
    u = solve(Elasticity(read, materials, [Clamp("left")], [Traction("right", (1e6, 0.0, 1e6))]))
    again = coulomb.read_gmsh(BoxFile(cell=cell).write(tmp_path / "box.msh"))
    other = Elasticity(
        again,
        {"soft": materials["soft"], "stiff": materials["8"]},
        [Clamp("left")],
        [Traction("right", (1e6, 0.0, 1e6))],
    )
    v = solve(other)
    x = Elasticity(read, materials, [Clamp("left")]).x
    assert np.abs(by_place(x, u) - by_place(other.x, v)).max() <= 1e-10 * np.abs(v).max()
    with pytest.raises(ValueError, match=r"mesh.xdmf: names has 'gone' = 9, but the numbers there are 1, 2, 3, 4"):
        coulomb.read_xdmf(path, names={"gone": 9})


XDMF = """<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem Dimensions="{points} {dim}" Format="XML">{x}</DataItem></Geometry>
<Topology TopologyType="{kind}">
<DataItem Dimensions="1 {nodes}" NumberType="Int" Format="XML">{rows}</DataItem></Topology>
</Grid></Domain></Xdmf>"""


@pytest.mark.parametrize(
    ("kind", "dim", "rows", "message"),
    [
        ("Triangle", 3, "0 1 2", r"has no cells in 3D \(tetrahedron, hexahedron\); it has triangle"),
        ("Tetrahedron_10", 3, "0 1 2 3 4 5 6 7 8 9", "cells of kind tetrahedron_10, but contact needs first-order"),
        ("Tet_10", 3, "0 1 2 3 4 5 6 7 8 9", "cells of kind tet_10, but contact needs first-order cells"),
        ("Wedge", 3, "0 1 2 3 4 5", "cells of kind wedge; it must have hexahedra alone or tetrahedra alone"),
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
        coulomb.read_xdmf(path)
    path.write_text(text[: len(text) // 2])
    with pytest.raises(ValueError, match=r"mesh.xdmf: is not XDMF, or cut short"):
        coulomb.read_xdmf(path)
    with pytest.raises(ValueError, match=r"none.xdmf: cannot be read: No such file"):
        coulomb.read_xdmf(tmp_path / "none.xdmf")


def moved_through(file):
    corner = np.flatnonzero(np.all(file.points == (0.5, 0.5, 0.5), axis=1))
    file.points[corner] = (1.7, 0.5, 0.5)


def mirrored_corner(file):
    file.cells[0, [0, 1]] = file.cells[0, [1, 0]]


def two_bodies(file):
    left = file.points.copy()
    count = len(file.points)
    file.points = np.vstack([left, left + (5.0, 0.0, 0.0)])
    file.cells = np.vstack([file.cells, file.cells + count])
    file.cell_groups = {"all": np.arange(len(file.cells))}


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
        (
            moved_through,
            r"cells \(first seen at x = .*\) have (a Jacobian that|been folded|no volume)",
        ),
        (two_bodies, r"its cells make 2 bodies that share no facets \(.* cells\), but coulomb computes one"),
        (flattened, r"(16 of 16|96 of 96) cells .* have no volume"),
        (doubled, "cells .*(a facet with more than one neighbour|no volume|a Jacobian)"),
        (not_finite, "coordinates that are not finite"),
    ],
)
def test_cells_that_are_wrong(spoil, message, cell, tmp_path):
    file = BoxFile(cell=cell)
    spoil(file)
    with pytest.raises(ValueError, match=f"bad.msh: .*{message}"):
        coulomb.read_gmsh(file.write(tmp_path / "bad.msh"))


def test_a_hexahedron_turned_inside_out(tmp_path):
    file = BoxFile()
    mirrored_corner(file)
    with pytest.raises(ValueError, match=r"1 of 16 cells \(first seen at x = 0.25, 0.25, 0.25\) has a Jacobian that"):
        coulomb.read_gmsh(file.write(tmp_path / "bad.msh"))


def test_order_of_nodes_in_tetrahedra_does_not_matter(tmp_path):
    """A tetrahedron numbered left-handed is the same one."""
    file = BoxFile(cell="tetrahedron")
    file.cells[::3, [0, 1]] = file.cells[::3, [1, 0]]
    assert len(coulomb.read_gmsh(file.write(tmp_path / "box.msh")).cells["soft"]) == 48


NODES = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("solid cube\n", "is not a MSH file of gmsh's"),
        (NODES.replace("2.2", "4"), "is of MSH version 4; save it as 4.1 or 2.2"),
        (NODES, r"has no section \$Elements; is it whole\?"),
        (NODES[:-20], r"is damaged or cut short, in section \$Nodes"),
        (NODES + "$Elements\n2\n1 4 2 1 1 1 2 3 4\n$EndElements\n", r"damaged or cut short, in section \$Elements"),
        (NODES + "$Elements\n1\n1 4 2 1 1 1 2 3\n$EndElements\n", r"damaged or cut short, in section \$Elements"),
        (NODES + "$Elements\n1\n1 4 2 1 1 1 2 x 4\n$EndElements\n", r"damaged or cut short, in section \$Elements"),
        (NODES + "$Elements\n1\n1 4 2 1 1 1 2 3 5\n$EndElements\n", "a node that the file does not define"),
        (NODES + "$Elements\n1\n1 99 2 1 1 1 2 3 5\n$EndElements\n", "an element of type 99, which is not known"),
        (
            NODES + "$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n",
            r"no cells in 3D \(it has 1 triangles\); mesh",
        ),
        (NODES + "$Elements\n0\n$EndElements\n", "no cells in 3D; mesh the volume"),
        (
            NODES + "$Elements\n1\n1 11 2 1 1 1 2 3 4 1 2 3 4 1 2\n$EndElements\n",
            "has 10-node tetrahedra, but contact needs first-order cells: the nodal areas .* are zero at the vertices",
        ),
        (
            NODES + "$Elements\n2\n1 4 2 1 1 1 2 3 4\n2 5 2 1 1 1 2 3 4 1 2 3 4\n$EndElements\n",
            "has tetrahedra and hexahedra; it must have hexahedra alone or tetrahedra alone",
        ),
        (NODES + "$Elements\n1\n1 6 2 1 1 1 2 3 4 1 2\n$EndElements\n", "has prisms; it must have hexahedra alone"),
    ],
)
def test_wrong_gmsh_files(text, message, tmp_path):
    path = tmp_path / "bad.msh"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"bad.msh: .*{message}"):
        coulomb.read_gmsh(path)


@pytest.mark.parametrize(("version", "binary"), [("2.2", False), ("2.2", True), ("4.1", False), ("4.1", True)])
def test_cut_short_anywhere(version, binary, tmp_path):
    whole = BoxFile(cells=(1, 1, 1)).write(tmp_path / "box.msh", version, binary).read_bytes()
    path = tmp_path / "cut.msh"
    for length in range(0, len(whole) - 14, max(1, len(whole) // 60)):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"cut.msh: "):
            coulomb.read_gmsh(path)


def test_missing_file_directory_and_wrong_scale(tmp_path):
    with pytest.raises(ValueError, match=r"none.msh: cannot be read: No such file"):
        coulomb.read_gmsh(tmp_path / "none.msh")
    with pytest.raises(ValueError, match="cannot be read: Is a directory"):
        coulomb.read_gmsh(tmp_path)
    with pytest.raises(ValueError, match="scale must be a positive number of metres per unit, but is 0"):
        coulomb.read_gmsh(BoxFile().write(tmp_path / "box.msh"), scale=0.0)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_face_groups_that_are_no_faces(cell, tmp_path):
    file = BoxFile(cell=cell)
    file.faces["inside"] = file.interface
    file.faces["empty"] = file.faces["left"][:0]
    file.points = np.vstack([file.points, file.points[file.faces["left"][0]] - 1.0])
    file.faces["away"] = np.arange(len(file.points) - len(file.faces["left"][0]), len(file.points))[None, :]
    domain = coulomb.read_gmsh(file.write(tmp_path / "box.msh"))
    for name, message in (
        ("inside", "clamp: face group 'inside' of .*box.msh lies inside the body with .* facets"),
        ("empty", "clamp: face group 'empty' of .*box.msh is empty"),
        ("away", "clamp: face group 'away' of .*box.msh has facets whose nodes belong to no cell"),
        ("lefd", r"clamp: there is no face 'lefd' on this mesh \(did you mean 'left'\?\); its faces are left, right"),
    ):
        with pytest.raises(ValueError, match=message):
            Elasticity(domain, STEEL, [Clamp(name)])


def test_materials_that_do_not_fit(tmp_path):
    file = BoxFile()
    file.cell_groups["end"] = file.cell_groups["stiff"][-1:]
    domain = coulomb.read_gmsh(file.write(tmp_path / "box.msh"))
    for groups, message in (
        (
            ("soft",),
            "material: 8 of 16 cells are without a material; materials are given for soft, the mesh .* end",
        ),
        (("soft", "stiff", "end"), "material: 1 of 16 cells are in more than one of these groups"),
        (("soft", "stif"), r"material: there is no cell group 'stif' on this mesh \(did you mean 'stiff'\?\)"),
    ):
        with pytest.raises(ValueError, match=message):
            Elasticity(domain, dict.fromkeys(groups, STEEL), [Clamp("left")])
    with pytest.raises(ValueError, match="material: there is no cell group 'soft' on this mesh; it has no cell groups"):
        Elasticity(coulomb.box((1, 1, 1), (1, 1, 1)), {"soft": STEEL}, [Clamp("left")])


# --- springs --------------------------------------------------------------------------------------------------------


def test_a_bar_on_a_spring_is_exact():
    """Stress s everywhere: u_x = s/k + s x/E."""
    s, k, E, nu = 1e6, 3e9, STEEL.young, STEEL.poisson
    elasticity = Elasticity(
        coulomb.box((2.0, 1.0, 1.5), (4, 2, 3)),
        STEEL,
        [Clamp("front", "y"), Clamp("bottom", "z")],
        [Traction("right", (s, 0.0, 0.0))],
        springs=[Spring("left", (k, 0.0, 0.0))],
    )
    u = solve(elasticity)
    exact = s / E * elasticity.x * np.array([1.0, -nu, -nu]) + np.array([s / k, 0.0, 0.0])
    assert np.abs(u - exact).max() <= 1e-10 * np.abs(exact).max()
    assert np.allclose(elasticity.spring_force(u).sum(axis=0), [-s * 1.5, 0.0, 0.0], atol=1e-6 * s)


def sliding(push, k=1e8, **options):
    return ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (5, 5, 3)),
        STEEL,
        [],
        Contact("bottom", friction=0.3),
        [Traction("top", (push, 0.0, -9e6))],
        (0.0, 0.0, -2e6),
        springs=[Spring("left", k), Spring("right", k)],
        **options,
    )


def test_block_held_by_friction_and_springs_slides():
    """Load -9e6 - 1e6 (weight) down, 4e6 along x: friction is F N, the springs carry the rest and give way by it."""
    solution = sliding(4e6).solve(tolerance=1e-10)
    assert solution.certificate.passed
    told = summary(solution)
    force, spring = np.array(told["force_on_body"]["vector"]), np.array(told["spring_force_on_body"])
    assert told["nodes"]["stick"] == 0
    x = solution.contact_force.reshape(-1, 3)
    assert np.allclose(np.hypot(x[:, 1], x[:, 2]), 0.3 * x[:, 0], rtol=1e-6, atol=1e-8 * x.max())
    assert -force[0] == pytest.approx(0.3 * force[2], rel=1e-5)  # nodes slip across a little: they spread under load
    assert np.allclose(force + spring + [4e6, 0.0, -10e6], 0.0, atol=1.0)
    slip = (4e6 - 0.3 * force[2]) / 1e8  # of two faces of 0.5 m^2
    assert np.mean(solution.displacement[:, 0]) == pytest.approx(slip, rel=0.01)


def test_block_held_by_friction_and_springs_sticks():
    """Pushed less than friction bears, the springs have nothing to carry but what the elastic body gives way."""
    told = summary(sliding(1e6).solve())
    assert told["certificate"]["passed"] and told["nodes"]["stick"] > 0
    assert told["force_on_body"]["vector"][0] == pytest.approx(-1e6, rel=1e-3)
    assert 0.0 < -told["spring_force_on_body"][0] < 1e3


def test_springs_iteratively():
    direct, iterative = (
        sliding(4e6, 1e10, linear_solver=kind).solve() for kind in (DirectSolver, coulomb.IterativeSolver)
    )
    assert np.linalg.norm(direct.contact_force - iterative.contact_force) <= 1e-5 * np.linalg.norm(direct.contact_force)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Spring("left", -1.0), r"spring on 'left': stiffness must be a number or three .* but is -1.0"),
        (lambda: Spring("left", (1.0, 2.0)), "spring on 'left': stiffness must be a number or three"),
        (lambda: Spring("left", 0.0), "spring on 'left': stiffness must be a number or three"),
        (lambda: Spring("left", float("nan")), "spring on 'left': stiffness must be a number or three"),
        (lambda: sprung(Spring("lfet", 1.0)), r"spring: there is no face 'lfet' on this mesh \(did you mean 'left'"),
        (
            lambda: sprung(Spring("left", (1e9, 0.0, 0.0))),
            "floats: its clamps and springs leave it translation along y, translation along z, rotation about x",
        ),
        (lambda: sprung(Spring("left", 1e-6)), "the springs are too soft to be told from rounding errors"),
    ],
)
def test_springs_that_are_wrong(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def sprung(*springs):
    return Elasticity(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), STEEL, [], springs=springs)


# --- the whole way ----------------------------------------------------------------------------------------------------

CASE = """
body_force = [0.0, 0.0, -1e5]
[mesh]
file = "parts/bar.msh"
scale = 1e-3
[[material]]
cells = "soft"
young = 1e11
poisson = 0.2
[[material]]
cells = "stiff"
young = 2e11
poisson = 0.4
[[spring]]
face = "left"
stiffness = [1e10, 1e10, 1e9]
[[spring]]
face = "right"
stiffness = 1e9
[[traction]]
face = "top"
value = [1e6, 0.0, -1e7]
[contact]
face = "bottom"
friction = 0.3
[output]
picture = false
"""


@pytest.fixture
def case(tmp_path):
    (tmp_path / "parts").mkdir()
    BoxFile((2000.0, 1000.0, 1000.0)).write(tmp_path / "parts" / "bar.msh")
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    return path


@pytest.mark.parametrize("ranks", [None, 3])
def test_case_with_a_file_is_run_and_checked(case, tmp_path, ranks):
    (tmp_path / "elsewhere").mkdir()
    done = run_coulomb("run", case, "--output", tmp_path / "out", cwd=tmp_path / "elsewhere", ranks=ranks)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [entry["cells"] for entry in told["material"]] == ["soft", "stiff"]
    balance = np.array(told["force_on_body"]["vector"]) + told["spring_force_on_body"]
    assert np.allclose(balance, [-2e6, 0.0, 2e7 + 2e5], atol=1.0)
    again = check(tmp_path / "out")
    assert again.passed
    for check_ in again.certificate.checks:
        before = told["certificate"][check_.name.replace(" ", "_")]["value"]
        assert check_.value == pytest.approx(before, rel=1e-3, abs=1e-11), check_.name


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("mesh.file='parts/bra.msh'", "bra.msh: cannot be read: No such file"),
        ("mesh.file='parts/bar.stl'", "file must end in .msh .gmsh. or .xdmf, but is '.*bar.stl'"),
        ("mesh.cells=[1,1,1]", "cells does not go with a .msh mesh"),
        ("mesh.names={a=1}", "names does not go with a .msh mesh"),
        ("mesh.box=[1,1,1]", "give either box .with cells. or file, one of the two"),
        ("mesh={box=[1,1,1], cells=[1,1,1]}", "material: a box has no groups of cells"),
        ("mesh={box=[1,1,1], scale=2.0, cells=[1,1,1]}", "mesh = .*: scale does not go with a box mesh"),
        ("mesh={box=[1,1,1]}", "mesh = .*: cells is missing: a box needs"),
        ("mesh.scale=0", "mesh.scale = 0: should be greater than 0"),
        ("contact.face='botom'", r"contact: there is no face 'botom' on this mesh \(did you mean 'bottom'\?\)"),
        ("material.1.cells='stif'", r"there is no cell group 'stif' on this mesh \(did you mean 'stiff'\?\)"),
        ("material.1.cells='soft'", "material: give one for every group of cells, but they are for .*soft.*soft"),
        ("material.1.young=0", "material.1.young = 0: should be greater than 0"),
        ("material.0.yuong=0", r"material.0.yuong = 0: there is no such key; did you mean young\? .*cells"),
        ("material={young=1e11, poisson=0.3, cells='soft'}", "material.cells = 'soft': there is no such key"),
        ("spring.0.stiffness=-1", "spring.0.stiffness.0 = -1: should be greater than or equal to 0"),
        ("spring.0.stiffness=[1,1]", r"spring.0.stiffness.2: is missing|spring.0.stiffness = \[1, 1\]"),
        ("spring=[]", "the body floats: its clamps and springs leave it"),
    ],
)
def test_wrong_cases_with_a_file(case, change, message):
    from coulomb.case.case import read_case

    with pytest.raises(ValueError, match=message):
        read_case(case, [change]).problem()


def test_gmsh_itself(tmp_path):
    """Where gmsh's module is installed: two boxes that share a face, meshed and written by gmsh."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        parts = [gmsh.model.occ.addBox(i, 0, 0, 1, 1, 1) for i in range(2)]
        gmsh.model.occ.fragment([(3, parts[0])], [(3, parts[1])])
        gmsh.model.occ.synchronize()
        for name, place in (("left", 0.0), ("middle", 1.0), ("right", 2.0)):
            boxes = [(tag, gmsh.model.getBoundingBox(2, tag)) for _, tag in gmsh.model.getEntities(2)]
            tags = [tag for tag, b in boxes if abs(b[0] - place) < 1e-3 and abs(b[3] - place) < 1e-3]
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, tags), name)
        for name, (_, tag) in zip(("one", "two"), gmsh.model.getEntities(3), strict=True):
            gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.model.mesh.generate(3)
        for version, binary in ((2.2, 0), (2.2, 1), (4.1, 0), (4.1, 1)):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(tmp_path / "box.msh"))
            domain = coulomb.read_gmsh(tmp_path / "box.msh")
            assert set(domain.faces) == {"left", "right"} and set(domain.refused) == {"middle"}
            elasticity = Elasticity(domain, {"one": STEEL, "two": STEEL}, [Clamp("left")])
            assert elasticity.nodal_area("right").sum() == pytest.approx(1.0)
    finally:
        gmsh.finalize()
