"""Slip, friction work and largest pressure since the start of a history, against formulas."""

import json

import numpy as np
import pytest
from check_runs import read_grid
from conftest import run_coulomb

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, PrescribedDisplacement
from coulomb.model.nodal_answer import ACCUMULATED, Accumulated
from coulomb.recheck import check

YOUNG, HEIGHT, DOWN, FRICTION, AREA = 1e10, 0.05, 1e-6, 0.4, 0.01
PRESSURE = YOUNG * DOWN / HEIGHT  # no lateral contraction: uniform as long as nothing shears
PRESS = [(0, 0), (1, 1), (5, 1), (6, -1), (7, -1), (8, 0.5), (10, 0.5)]
"""Factor of the depth: pressed, lifted off after 5, from 8 on pressed with half the pressure."""
WAY = [(1, 0.0), (2, 0.01), (4, -0.01), (5, 0.005), (6, 0.005), (7, 0.05), (8, 0.05), (10, 0.03)]
"""Displacement of the top along x, metres: 10, 20 and 15 mm in contact, 45 mm in the air, 20 mm in contact."""
TIMES = [0.5, 1, 1.5, 2, 3, 4, 4.5, 5, 6, 7, 8, 9, 10]
PATH = {2: 0.01, 4: 0.03, 5: 0.045, 8: 0.045, 10: 0.065}
"""Distance in contact until these times, metres; the block lags behind by less than a micrometre."""
STEADY = {2: (0.005, 1.0), 4: (0.01, 1.0), 5: (0.0075, 1.0), 10: (0.01, 0.5)}
"""Distance in the step until these times, all of it sliding, and the part of the pressure."""


def rubbed(cell="hexahedron", press=PRESS, way=WAY, contact=None):
    mesh = coulomb.box((0.1, 0.1, HEIGHT), (4, 4, 3), cell=cell)
    top = [
        PrescribedDisplacement("top", (0.0, 0.0, -DOWN), "z", amplitude=press),
        PrescribedDisplacement("top", (1.0, 0.0, 0.0), "x", amplitude=way),
        Clamp("top", "y"),
    ]
    return ContactProblem(mesh, Material(YOUNG, 0.0), top, contact or Contact("bottom", FRICTION), small_strain="warn")


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_block_dragged_to_and_fro(cell):
    """Accumulated slip is the path in contact; friction works F p s per area, over the face the dissipated energy."""
    last = Accumulated.none(25)
    path, u, pressure = np.zeros(25), np.zeros((25, 3)), np.zeros(25)
    for step in LoadHistory(TIMES, tolerance=1e-10).steps(rubbed(cell)):
        worn, answer, time = step.state.accumulated, step.solution.at_nodes, step.state.time
        assert step.halvings == 0
        assert worn.friction_work @ answer.area == pytest.approx(step.state.energy.dissipated, rel=1e-10, abs=1e-14)
        assert np.all(worn.friction_work >= last.friction_work - 1e-9 * FRICTION * PRESSURE * 0.01)
        now = answer.displacement_vectors.copy()
        now[:, 2] = 0.0
        path += np.where(answer.force[:, 0] > 0.0, np.linalg.norm(now - u, axis=1), 0.0)
        assert worn.slip == pytest.approx(path, rel=1e-12, abs=1e-20)
        u = now
        if time in PATH:
            assert worn.slip == pytest.approx(PATH[time], abs=8e-6)
        if time in STEADY:
            distance, part = STEADY[time]
            assert worn.slip - last.slip == pytest.approx(distance, rel=1e-8)
            mean, done = 0.5 * (pressure + answer.pressure), worn.friction_work - last.friction_work
            assert done == pytest.approx(FRICTION * mean * distance, rel=1e-8)
            assert done @ answer.area == pytest.approx(FRICTION * part * PRESSURE * AREA * distance, rel=1e-8)
        last, pressure = worn, answer.pressure
    assert set(STEADY) | set(PATH) <= set(TIMES)


def test_a_block_that_slides_while_its_pressure_falls_and_leaves():
    """Friction works F p s with the mean pressure in the step in which it falls by half, and in the one in which the
    block leaves until it does, after half of the way: not on the way in the air."""
    press, way = [(2, 1), (3, 0.5), (4, -0.5), (5, -0.5)], [(1, 0.0), (5, 0.04)]
    work = [0.0]
    for step in LoadHistory([1, 2, 3, 4, 5], tolerance=1e-10).steps(rubbed(press=[(0, 0), (1, 1), *press], way=way)):
        work.append(step.state.energy.dissipated / (FRICTION * PRESSURE * AREA * 0.01))
    assert np.diff(work)[:3] == pytest.approx([0.0, 1.0, 0.75], abs=1e-3)
    assert np.diff(work)[3:] == pytest.approx([0.125, 0.0], rel=0.1)  # by the compliance of single nodes


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_the_largest_pressure_of_a_load_up_and_down(cell):
    press = [(0, 0), (1, 0.3), (2, 1), (3, 0.6), (4, -0.5), (5, 0.8)]
    expected = [0.3, 1.0, 1.0, 1.0, 1.0]
    problem = rubbed(cell, press, [(0, 0)])
    for step, factor in zip(LoadHistory([1, 2, 3, 4, 5], tolerance=1e-11).steps(problem), expected, strict=True):
        assert step.state.accumulated.pressure == pytest.approx(factor * PRESSURE, rel=1e-9)
        assert step.state.accumulated.slip == pytest.approx(0.0, abs=1e-6 * DOWN)


def test_a_single_run_has_its_own():
    solution = rubbed().at(1.5).solve(tolerance=1e-10)
    answer = solution.at_nodes
    fields = answer.fields()
    assert fields["accumulated_slip"] == pytest.approx(np.linalg.norm(answer.slip, axis=1), rel=1e-12)
    assert fields["largest_pressure"] == pytest.approx(fields["pressure"], rel=1e-12)
    energy = answer.dissipated_energy
    assert np.sum(fields["friction_work"] * answer.area) == pytest.approx(energy, rel=1e-12)
    assert answer.numbers()["accumulated"]["dissipated_energy"] == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize(
    "contact",
    [
        Contact("bottom", (0.4, 0.1), direction=(1.0, 1.0, 0.0)),
        Contact("bottom", slip_stress=1e5),
        Contact("bottom", 0.2, cohesion=1e4),
    ],
    ids=["orthotropic", "Tresca", "Mohr-Coulomb"],
)
def test_other_laws(contact):
    """Work over the face is the dissipated energy; where friction acts without pressure, on open nodes as well."""
    for step in LoadHistory(TIMES[:8], tolerance=1e-10).steps(rubbed(contact=contact)):
        worn, area = step.state.accumulated, step.solution.at_nodes.area
        assert np.sum(worn.friction_work * area) == pytest.approx(step.state.energy.dissipated, rel=1e-10, abs=1e-14)
    assert np.all(worn.slip > 0.044) and np.all(worn.slip < 0.047)  # not the 45 mm in the air


CASE = f"""
mesh = {{ box = [0.1, 0.1, {HEIGHT}], cells = [4, 4, 3], cell = "tetrahedron" }}
material = {{ young = 1e7, poisson = 0.3 }}
clamp = [{{ face = "top", components = "xy" }}]
history = {{ times = [0.5, 1, 2, 3, 4, 5, 6] }}
output = {{ picture = false }}
[[prescribed_displacement]]
face = "top"
components = "z"
value = [0, 0, -1e-3]
amplitude = [[0, 0], [1, 1], [6, 0.5]]
[contact]
face = "bottom"
friction = 0.4
foundation = {{ point = [0, 0, 0], normal = [0, 0, 1] }}
motion = [[1, 0, 0, 0], [2, 2e-3, 0, 0], [4, -2e-3, 1e-3, 0], [6, 2e-3, 0, 0]]
"""


def accumulated(step):
    """Fields of a step by the coordinates of the nodes, and the area."""
    grid = read_grid(step / "contact.xdmf")
    order = np.lexsort(np.round(grid.points, 9).T)
    return {name: grid.fields[name][order] for name in (*ACCUMULATED, "area")}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("worn")
    (folder / "case.toml").write_text(CASE)
    run_coulomb("run", folder / "case.toml", "--output", folder / "out")
    return folder / "out"


def test_files_and_summary(written):
    summary = json.loads((written / "summary.json").read_text())
    fields = accumulated(written / "steps" / "0007")
    totals = summary["history"]["accumulated"]
    assert totals == summary["last"]["accumulated"]
    assert totals["largest_slip"] == pytest.approx(fields["accumulated_slip"].max(), rel=1e-12)
    assert totals["largest_friction_work"] == pytest.approx(fields["friction_work"].max(), rel=1e-12)
    assert totals["largest_pressure"] == pytest.approx(fields["largest_pressure"].max(), rel=1e-12)
    energy = summary["history"]["energy"]["dissipated"]
    assert totals["dissipated_energy"] == pytest.approx(energy, rel=1e-10)
    assert fields["friction_work"] @ fields["area"] == pytest.approx(energy, rel=1e-10)
    assert check(written).passed
