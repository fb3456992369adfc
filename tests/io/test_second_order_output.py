"""Result files of second-order meshes: cells, facets and values as other programs read them, and `coulomb check`."""

import re
import shutil

import numpy as np
import pytest
from check_runs import change, fields, order, read_grid
from conftest import without_pictures

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, Traction
from coulomb.fem.contact.surface import contact_surface, interpolated_forces
from coulomb.io.output import size_on_disk
from coulomb.linalg.compliance.stiffness import IterativeSolver
from coulomb.model.memory import memory_needed
from coulomb.model.nodal_answer import OPEN
from coulomb.pictures.report.fields import zone_counts
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.grids import first_order
from coulomb.pictures.report.problem import geometry
from coulomb.recheck import check

CELLS = ("hexahedron", "tetrahedron")

STEEL = Material(2.1e11, 0.3)
TOPOLOGY = {"hexahedron": ("Hexahedron_27", "Quadrilateral_9"), "tetrahedron": ("Tetrahedron_10", "Triangle_6")}
EDGES = [(0, 1), (1, 2), (2, 0)]
"""Ends of the edges in whose middle the nodes 3, 4, 5 of a quadratic triangle are: VTK's file formats."""


def bent_block(cell):
    """Clamped at its left end, pressed and pulled along its bottom, whose sides are curved."""
    return ContactProblem(
        coulomb.box(
            (2.0, 1.0, 1.0), (3, 1, 1), cell, degree=2, place=lambda x: x + np.array([0, 0.1, 0])[:, None] * x[0] ** 2
        ),
        STEEL,
        [Clamp("left")],
        Contact("bottom", friction=0.3),
        [Traction("top", (0.0, 1e7, -4e7)), Traction("right", (2e7, 0.0, 0.0))],
    )


@pytest.fixture(scope="module", params=CELLS)
def written(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    solution = bent_block(request.param).solve()
    with without_pictures():
        solution.write(folder)
    return request.param, solution, folder


def test_cells_and_values(written):
    cell, solution, folder = written
    assert solution.certificate.passed and solution.contact_force.any()
    body, face = read_grid(folder / "solution.xdmf"), read_grid(folder / "contact.xdmf")
    assert (body.cell, face.cell) == TOPOLOGY[cell]
    space, surface = solution.problem.elasticity, solution.problem.surface
    assert len(body.points) == len(space.x) and len(face.points) == 7 * 3
    at = fields(folder / "solution.h5")
    assert np.array_equal(at["displacement"][order(at["x"], space.x)], solution.displacement)
    middle = body.points[body.cells]  # nodes 4, 8 are between corners 0 and 1 in both
    place = 8 if cell == "hexahedron" else 4
    assert np.allclose(middle[:, place, 0], middle[:, :2, 0].mean(axis=1))
    at = fields(folder / "contact.h5")
    node = order(at["x"], space.x[surface.nodes])
    assert np.array_equal(at["pressure"][node], solution.contact_force[0::3] / surface.area)
    if cell == "hexahedron":
        assert len(surface.x) == 6 * 3  # all but those of the clamped edge
        return
    for k, (i, j) in enumerate(EDGES, start=3):
        one, other, between = face.cells[:, i], face.cells[:, j], face.cells[:, k]
        for name, values in at.items():
            if name == "status":
                assert np.array_equal(values[between], np.minimum(values[one], values[other]))
            elif name not in ("x", "node"):
                assert np.array_equal(values[between], 0.5 * (values[one] + values[other])), name
    assert OPEN in at["status"] and not np.all(at["status"] == OPEN)


def test_programs_that_show_them(written):
    """VTK's reader, which ParaView has too, finds the cells in its own order: volume and area by their corners."""
    pyvista = pytest.importorskip("pyvista")
    cell, _, folder = written
    for name, width, size in (("solution", {"hexahedron": 27, "tetrahedron": 10}, 2.0), ("contact", None, None)):
        grid = pyvista.read(folder / f"{name}.xdmf")
        if size is not None:
            assert {len(grid.get_cell(k).point_ids) for k in range(grid.n_cells)} == {width[cell]}
            assert grid.compute_cell_sizes()["Volume"].sum() == pytest.approx(size, rel=1e-3)
        else:
            assert grid.compute_cell_sizes()["Area"].sum() == pytest.approx(2.0, rel=0.02)
            assert "pressure" in grid.point_data


def test_check_recomputes_them(written):
    _, solution, folder = written
    found = check(folder, solution.problem)
    assert found.passed, str(found)
    assert check(folder).passed


@pytest.mark.parametrize(
    ("file", "name", "where", "factor", "fault"),
    [
        ("solution", "displacement", "body", 1.001, "equilibrium"),
        ("contact", "pressure", "vertex", 1.001, r"contact.xdmf: pressure: .* displacement and contact forces"),
        ("contact", "gap", "vertex", 1.001, r"contact.xdmf: gap: .* displacement and contact forces"),
        ("contact", "area", "vertex", 1.001, r"contact.xdmf: area: .* follows from the facets"),
        ("contact", "contact_force", "vertex", 1.01, "contact.xdmf: pressure"),
        ("contact", "pressure", "between", 1.001, r"contact.xdmf: pressure.*"),
        ("contact", "slip", "between", 1.001, r"contact.xdmf: slip.*"),
        ("contact", "status", "between", 0.0, r"contact.xdmf: status.*"),
    ],
)
def test_changed_numbers_are_noticed(written, file, name, where, factor, fault, tmp_path):
    """Of a vertex, or of a node in the middle of an edge, of the body or on the contact face."""
    _, solution, folder = written
    for part in folder.iterdir():
        shutil.copy(part, tmp_path)
    grid = read_grid(folder / f"{file}.xdmf")
    corners = {10: 4, 27: 8, 6: 3, 9: 4}[grid.cells.shape[1]]
    vertices = np.isin(np.arange(len(grid.points)), grid.cells[:, :corners])
    size = np.abs(grid.fields[name]) if grid.fields[name].ndim == 1 else np.linalg.norm(grid.fields[name], axis=1)
    changed = np.argmax(np.where(vertices == (where == "vertex"), size, -1.0)) == np.arange(len(size))
    change(tmp_path / f"{file}.h5", name, lambda values: np.where(changed[:, None], factor * values, values))
    found = check(tmp_path, solution.problem)
    assert not found.passed and re.search(fault, str(found)), str(found)


def test_pictures_have_all_nodes_of_first_order_pieces(written):
    """Pieces fill the same volume and area, without overlap, and zones count contact points only."""
    cell, solution, folder = written
    body, face = (first_order(read_grid(folder / f"{name}.xdmf")) for name in ("solution", "contact"))
    assert (body.cut, face.cut) == TOPOLOGY[cell] and (body.pieces, face.pieces) == (8, 4)
    assert len(np.unique(body.cells)) == len(body.points) and len(np.unique(face.cells)) == len(face.points)
    assert len(body.fields["young"]) == len(body.cells) == 8 * len(read_grid(folder / "solution.xdmf").cells)
    x = body.points[body.cells]
    if cell == "tetrahedron":
        volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6.0
    else:
        volume = np.abs(np.linalg.det(x[:, [1, 3, 4]] - x[:, :1]))  # near parallelepipeds
    assert volume.sum() == pytest.approx(2.0, rel=1e-2) and volume.min() > 0.2 * volume.max()
    x = face.points[face.cells]
    area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0]), axis=1) / (2 if cell == "tetrahedron" else 1)
    assert area.sum() == pytest.approx(2.0, rel=1e-2)
    counted = zone_counts(face)
    nodes = solution.at_nodes.numbers()["nodes"]
    assert {name: counted[name] for name in ("open", "stick", "slip")} == {
        name: nodes[name] for name in ("open", "stick", "slip")
    }
    mesh = dict(geometry(read_run(folder)))["mesh"]
    assert mesh in ("3 27-node hexahedra, 63 nodes", "18 10-node tetrahedra, 63 nodes")


def test_forces_of_a_coarser_mesh_of_either_order():
    """As an initial guess: a uniform pressure is one on the other mesh too."""
    surfaces = []
    for cell, degree in (("tetrahedron", 1), ("tetrahedron", 2), ("hexahedron", 2)):
        body = Elasticity(coulomb.box((2.0, 1.0, 1.0), (2, 2, 1), cell, degree=degree), STEEL, [Clamp("top")])
        surfaces.append(contact_surface(body, "bottom"))
    for coarse in surfaces:
        x = np.column_stack([2e6 * coarse.area, np.zeros((len(coarse.area), 2))]).ravel()
        for fine in surfaces:
            found = interpolated_forces(x, coarse, fine).reshape(-1, 3)
            assert np.allclose(found[:, 0], 2e6 * fine.area, rtol=1e-12) and not found[:, 1:].any()


def test_estimates_count_all_nodes(written):
    """Unknowns of all nodes; and the disk space that the results take."""
    cell, solution, folder = written
    problem = solution.problem
    n = problem.unknowns["displacement"]
    assert n == 3 * 6 * 3 * 3  # without those of the clamped end
    wide = memory_needed(10**6, 10**4, 1, IterativeSolver, False, nodes=27)
    assert wide > 2.0 * memory_needed(10**6, 10**4, 1, IterativeSolver, False)
    as_first = memory_needed(
        n, problem.body.stiffness.interface, 1, problem.body.stiffness.linear_solver, problem.body.stiffness.explicit
    )
    assert (problem.body.memory() > as_first) == (cell == "hexahedron")
    taken = sum((folder / f"{name}.h5").stat().st_size for name in ("solution", "contact"))
    assert 0.5 * taken < size_on_disk(problem) < 3.0 * taken + 1.1e5
