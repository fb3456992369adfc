"""Meshes from files, several materials."""

import json

import numpy as np
import pytest
from conftest import STEEL, run_coulomb
from mesh_files import BoxFile
from shared_problems import solve

import coulomb
from coulomb import Clamp, Elasticity, Material, Traction
from coulomb.recheck import check


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_two_materials_in_tension_are_exact(cell, tmp_path):
    """nu/E alike, so that both contract alike across: u_x = s x/E_1 up to x = 1, then s/E_1 + s (x - 1)/E_2."""
    s, soft, stiff = 1e6, Material(1e11, 0.2), Material(2e11, 0.4)
    domain = coulomb.read_mesh(BoxFile(cell=cell).write(tmp_path / "bar.msh"))
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
    assert np.allclose(elasticity.stresses(elasticity.function(u))[0].x.array, s, rtol=1e-8)


def test_scale_and_groups_without_names(tmp_path):
    file = BoxFile((2000.0, 1000.0, 1000.0))
    domain = coulomb.read_mesh(file.write(tmp_path / "mm.msh", named=False), scale=1e-3)
    assert set(domain.faces) == set("123456") and set(domain.cells) == {"1", "2"}
    assert np.allclose(np.max(domain.domain.geometry.x, axis=0), (2.0, 1.0, 1.0))
    elasticity = Elasticity(domain, STEEL, [Clamp("1")])
    assert elasticity.area_of(elasticity.mesh.facets("5", "test")).sum() == pytest.approx(2.0)


def test_points_of_no_cell_and_elements_in_two_groups(tmp_path):
    file = BoxFile()
    file.points = np.vstack([[[9.0, 9.0, 9.0]], file.points])
    file.cells += 1
    file.faces = {name: rows + 1 for name, rows in file.faces.items()}
    file.faces["both"] = np.vstack([file.faces["left"], file.faces["right"]])
    domain = coulomb.read_mesh(file.write(tmp_path / "box.msh"))
    assert domain.domain.geometry.x.max() == 2.0
    assert sorted([*domain.faces["left"], *domain.faces["right"]]) == sorted(domain.faces["both"])


# --- whole runs ----------------------------------------------------------------------------------------------------

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


def test_case_with_a_file_is_run_and_checked(case, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    run_coulomb("run", case, "--output", tmp_path / "out", cwd=tmp_path / "elsewhere")
    contents = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [entry["cells"] for entry in contents["material"]] == ["soft", "stiff"]
    balance = np.array(contents["force_on_body"]["vector"]) + contents["spring_force_on_body"]
    assert np.allclose(balance, [-2e6, 0.0, 2e7 + 2e5], atol=1.0)
    again = check(tmp_path / "out")
    assert again.passed, str(again)
    for check_ in again.certificate.checks:
        before = contents["certificate"][check_.name.replace(" ", "_")]["value"]
        assert check_.value == pytest.approx(before, rel=1e-3, abs=1e-11), check_.name


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("mesh.file='parts/bra.msh'", "bra.msh: cannot be read: No such file"),
        ("mesh.file='parts/bar.stl'", "file must end in one of .msh .gmsh., .*, .mesh .Medit., but is '.*bar.stl'"),
        ("mesh.cells=[1,1,1]", "cells does not go with a .msh mesh"),
        ("mesh.box=[1,1,1]", "give either box .with cells. or file, one of the two"),
        ("mesh={box=[1,1,1], cells=[1,1,1]}", "material: a box has no groups of cells"),
        ("mesh={box=[1,1,1]}", "mesh = .*: cells is missing: a box needs"),
        ("material.1.cells='soft'", "material: give one for every group of cells, but they are for .*soft.*soft"),
        ("material.0.yuong=0", r"material.0.yuong = 0: there is no such key; did you mean young\? .*cells"),
        ("material={young=1e11, poisson=0.3, cells='soft'}", "material.cells = 'soft': there is no such key"),
        ("spring.0.stiffness=-1", "spring.0.stiffness.0 = -1: should be greater than or equal to 0"),
        ("spring.0.stiffness=[1,1]", r"spring.0.stiffness.2: is missing|spring.0.stiffness = \[1, 1\]"),
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
            domain = coulomb.read_mesh(tmp_path / "box.msh")
            assert set(domain.faces) == {"left", "right"} and set(domain.refused) == {"middle"}
            elasticity = Elasticity(domain, {"one": STEEL, "two": STEEL}, [Clamp("left")])
            assert elasticity.area_of(elasticity.mesh.facets("right", "test")).sum() == pytest.approx(1.0)
        gmsh.write(str(tmp_path / "box.inp"))  # with the names of physical groups, and those of gmsh's own surfaces
        other = coulomb.read_mesh(tmp_path / "box.inp")
        assert (
            {"left", "right"} <= set(other.faces) and {"one", "two"} <= set(other.cells) and "middle" in other.refused
        )
        for name in ("left", "right"):
            assert len(other.faces[name]) == len(domain.faces[name])
        gmsh.option.setNumber("Mesh.Binary", 0)  # meshio does not read its binary VTK files
        for name in ("box.bdf", "box.vtk"):
            gmsh.write(str(tmp_path / name))
            numbered = coulomb.read_mesh(tmp_path / name)
            assert len(numbered.cells) == 2 and sum(map(len, numbered.cells.values())) == sum(
                map(len, domain.cells.values())
            )
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_positions_that_make_cells_flat_are_refused(cell, degree):
    """A map with slope 0 at an end moves the node in the middle of an edge to its quarter: no finite Jacobian there."""

    def at(x):
        return np.stack([np.sin(0.5 * np.pi * x[0]), x[1], x[2]])

    def inside_out(x):
        return np.stack([x[0] - 1.5 * x[0] * (x[0] > 0.9), x[1], x[2]])

    if degree == 1:
        coulomb.box((1.0, 1.0, 1.0), (10, 1, 1), cell, place=at)
    else:
        with pytest.raises(ValueError, match=r"box: place makes the cell at x = 0.9.* flat.*must stay near the middle"):
            coulomb.box((1.0, 1.0, 1.0), (10, 1, 1), cell, place=at, degree=2)
    with pytest.raises(ValueError, match="flat, or turns it inside out"):
        coulomb.box((1.0, 1.0, 1.0), (4, 1, 1), cell, place=inside_out, degree=degree)
    coulomb.box((1.0, 1.0, 1.0), (2, 1, 1), cell, place=lambda x: x * [[-1.0], [1.0], [1.0]], degree=degree)  # mirrored
