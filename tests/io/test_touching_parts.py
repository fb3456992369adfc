"""Parts of one mesh that touch: their nodes are at the same places, and told apart in the solution and in the files."""

import shutil

import numpy as np
import pytest
from conftest import run_coulomb
from mesh_files import BoxFile
from scipy.spatial import cKDTree

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    NodalField,
    Pressure,
    join,
    moved,
    read_mesh,
)
from coulomb.io import output
from coulomb.io.history_files import HistoryFiles
from coulomb.recheck import check

SIDE, DENSITY, GRAVITY = 0.01, 7800.0, 9.81
WEIGHT = DENSITY * GRAVITY * SIDE  # pascals
STEEL = Material(2.1e11, 0.0, density=DENSITY)


def cubes(far=None, cell="hexahedron", second=False, metre=1.0):
    """Two cubes, one on the other, and perhaps one far away, in one file, in a unit of so many to the metre."""
    file, faces = BoxFile((SIDE, SIDE, SIDE), (2, 2, 2), cell), {}
    points, cells = file.points, file.cells
    for shift in ((0.0, 0.0, 0.0), (0.0, 0.0, SIDE), *([] if far is None else [far])):
        first = len(file.points) if faces else 0
        if faces:
            file.points, file.cells = np.vstack([file.points, points + shift]), np.vstack([file.cells, cells + first])
        faces |= {f"{name}_{first}": rows + first for name, rows in file.faces.items() if name in ("bottom", "top")}
        file.faces = {name: rows for name, rows in file.faces.items() if name in ("bottom", "top")}
    names = ("foot", "lower", "upper", "lid", "base", "end")
    file.faces, file.cell_groups = dict(zip(names, faces.values(), strict=False)), {"all": np.arange(len(file.cells))}
    file.points = metre * file.points
    return file.second_order() if second else file


@pytest.mark.parametrize(
    ("far", "cell", "second", "metre"),
    [
        (None, "hexahedron", False, 1.0),
        ((0.0, 0.0, 10.0), "hexahedron", False, 1e6),
        ((1000.0, 0.0, 0.0), "tetrahedron", True, 1e3),
        ((0.0, 10.0, 0.0), "hexahedron", True, 1e3),
    ],
)
def test_own_weight(far, cell, second, metre, tmp_path):
    """Without a gap between them the lower cube carries rho g L, whatever else is in the file."""
    mesh = read_mesh(cubes(far, cell, second, metre).write(tmp_path / "cubes.msh"), scale=1.0 / metre)
    held = [Clamp("foot"), *([] if far is None else [Clamp("base")])]
    pair = Contact("upper", 0.1, against="lower")
    solution = ContactProblem(mesh, STEEL, held, pair, gravity=(0.0, 0.0, -GRAVITY)).solve()
    answer = solution.at_nodes
    assert solution.valid and np.max(np.abs(answer.gap)) <= 1e-12 * SIDE
    assert answer.pressure == pytest.approx(WEIGHT, rel=1e-6)
    output.write(solution, tmp_path / "results")
    findings = check(tmp_path / "results")
    assert findings.passed, str(findings)


def slit_ring(closed):
    """A ring with a slit of no width, whose two faces are `left` and `right`, or without it."""
    file = BoxFile((1.0, 1.0, 1.0), (12, 1, 1))
    if closed:
        ends = file.points[:, 0] == 1.0
        start = cKDTree(file.points).query(file.points[ends] - [1.0, 0.0, 0.0])[1]
        same = np.arange(len(file.points))
        same[ends] = start
        file.cells, file.faces = same[file.cells], {name: same[rows] for name, rows in file.faces.items()}
        del file.faces["left"], file.faces["right"]
    angle, radius = 2.0 * np.pi * file.points[:, 0], 1.0 + 0.3 * file.points[:, 1]
    file.points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.3 * file.points[:, 2]])
    return file


def test_the_ends_of_a_slit_ring_are_told_apart(tmp_path):
    """One component with two nodes at a place: pressed from outside it moves as the whole ring; a history of it is
    written, continued and checked."""
    steel, load = Material(2e11, 0.3), Pressure("back", 1e7, amplitude=lambda t: t)
    ring = read_mesh(slit_ring(False).write(tmp_path / "slit.msh"))
    whole = read_mesh(slit_ring(True).write(tmp_path / "ring.msh"))
    slit = Contact("left", 0.3, against="right")
    problem = ContactProblem(ring, steel, [Clamp("bottom")], slit, [load])
    history, files = LoadHistory([0.5, 1.0]), HistoryFiles(tmp_path / "out")
    history.run(problem, files, on_step=lambda _: True)
    history.run(problem, HistoryFiles(tmp_path / "out", resume=True))
    solution = problem.at(1.0).solve()
    floor = Contact("top", 0.3, foundation=None, gap=1.0)
    expected = ContactProblem(whole, steel, [Clamp("bottom")], floor, [load]).at(1.0).solve()
    near = cKDTree(expected.problem.elasticity.x).query(problem.elasticity.x)[1]
    u = expected.displacement[near]
    assert solution.valid and np.max(np.abs(solution.displacement - u)) <= 1e-6 * np.max(np.abs(u))
    assert np.min(solution.at_nodes.pressure) > 0.0
    findings = check(tmp_path / "out")
    assert findings.passed, str(findings)


CASE = """\
gravity = [0, 0, -9.81]
mesh = { file = "cubes.msh" }
material = { young = 2.1e11, poisson = 0.0, density = 7800 }
clamp = [{ face = "foot" }, { face = "lid", value = [0, 0, -1e-8], amplitude = [[0, 0], [2, 1]] }]
contact = { face = "upper", against = "lower", friction = 0.1 }
probe = [{ name = "between", point = [0.005, 0.005, 0.01] }]
history = { times = [1, 2] }
output = { picture = false }
"""


def test_on_other_ranks(tmp_path):
    """A history of three ranks is continued on one, where nodes have other numbers, and checked by its case."""
    cubes().write(tmp_path / "cubes.msh")
    (tmp_path / "case.toml").write_text(CASE)
    run_coulomb("run", "case.toml", ranks=3, cwd=tmp_path)
    first = (tmp_path / "results" / "history.csv").read_text().splitlines()
    shutil.rmtree(tmp_path / "results" / "steps" / "0002")
    run_coulomb("resume", "results", cwd=tmp_path)
    second = (tmp_path / "results" / "history.csv").read_text().splitlines()
    column = first[0].split(",").index("normal_force")
    assert float(second[2].split(",")[column]) == pytest.approx(float(first[2].split(",")[column]), rel=1e-6)
    findings = check(tmp_path / "results")
    assert findings.passed, str(findings)


def test_as_in_two_files(tmp_path):
    """The same forces as of two bodies of `join`, also by tetrahedra, in which stress is not uniform."""
    mesh = read_mesh(cubes(cell="tetrahedron").write(tmp_path / "cubes.msh"))
    file = BoxFile((SIDE, SIDE, SIDE), (2, 2, 2), "tetrahedron")
    one = read_mesh(file.write(tmp_path / "one.msh"))
    given = {"gravity": (0.0, 0.0, -GRAVITY)}
    together = ContactProblem(mesh, STEEL, [Clamp("foot")], Contact("upper", 0.1, against="lower"), **given).solve()
    bodies = join(a=one, b=moved(one, (0.0, 0.0, SIDE)))
    pair = Contact("b:bottom", 0.1, against="a:top")
    apart = ContactProblem(bodies, STEEL, [Clamp("a:bottom")], pair, **given).solve()
    near = cKDTree(apart.at_nodes.x).query(together.at_nodes.x)[1]
    force = apart.at_nodes.force[near]
    assert np.max(np.abs(together.at_nodes.force - force)) <= 1e-6 * np.max(np.abs(force))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_each_part_has_its_temperature(cell, tmp_path):
    """A field of a file that jumps where the parts touch, on another mesh of them."""
    mesh = read_mesh(cubes(cell=cell).write(tmp_path / "cubes.msh"))
    field = cubes(cell="tetrahedron")
    of_part = np.where(np.arange(len(field.points)) < len(field.points) // 2, 20.0, 80.0)
    hot = NodalField(field.points, field.cells, of_part)
    warm = Material(2.1e11, 0.3, expansion=1e-5)
    pair = Contact("upper", 0.1, against="lower")
    problem = ContactProblem(mesh, warm, [Clamp("foot"), Clamp("lid")], pair, temperature=hot)
    body = problem.elasticity.alone
    upper = body.in_a_cell()[:, 2] > SIDE
    assert np.sum(body.x[upper, 2] == SIDE) == 9
    change = problem.loading.temperature.change
    assert np.array_equal(change, np.where(upper, 80.0, 20.0))
