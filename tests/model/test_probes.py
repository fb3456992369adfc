"""Displacement, slip and pressure at named points against formulas: run it alone, or on several ranks."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, HistoryFiles, LoadHistory, Plane, PrescribedDisplacement, Probe
from coulomb.io.summary import summary
from coulomb.units import amount

CELLS = ["hexahedron", "tetrahedron"]
FAR = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
GRADIENT = 1e-4 * np.array([[1.0, 2.0, -3.0], [0.5, 0.2, 0.1], [0.3, -0.4, -1.0]])
POINTS = np.array(
    [
        *([0.0, 0.0, 0.0], [2.0, 0.5, 0.5], [1.0, 0.25, 0.25], [0.3, 0.2, 0.1], [1.234, 0.321, 0.456]),
        *([0.7, 0.11, 0.0], [2.0, 0.3, 0.3], [1.9999999, 0.499, 0.001]),
    ]
)
comm = MPI.COMM_WORLD


def bulged(x):
    """Nodes inside a box moved, so that its hexahedra are no longer regular; the boundary stays."""
    by = np.prod(np.sin(np.pi * x / np.array([[2.0], [0.5], [0.5]])), axis=0)
    return x + np.array([[0.05], [0.03], [-0.04]]) * by


def probed(problem, points):
    return problem.solve(1e-10).probed([Probe(f"p{k}", point) for k, point in enumerate(points)])


@pytest.mark.parametrize("field", ["linear", "rigid"])
@pytest.mark.parametrize("cell", CELLS)
def test_linear_displacements_are_interpolated_exactly(cell, field):
    """On distorted cells, inside, at nodes, on edges and faces; the displacement of a rotation is a linear one too."""
    slope = GRADIENT if field == "linear" else 0.5 * (GRADIENT - GRADIENT.T)
    moved = np.array([3e-4, -1e-4, 2e-4])
    mesh = coulomb.box((2.0, 0.5, 0.5), (7, 5, 3), cell, place=bulged)
    solution = ContactProblem(mesh, STEEL, [Clamp("left")], FAR).solve()
    u = solution.problem.elasticity.x @ slope.T + moved
    values = replace(solution, displacement=u).probed([Probe(f"p{k}", x) for k, x in enumerate(POINTS)])
    for value, x in zip(values, POINTS, strict=True):
        assert np.allclose(value.displacement, slope @ x + moved, rtol=0.0, atol=1e-15)
        assert np.array_equal(value.found_at, x)


def pressed(cell, amplitude=1.0, probes=(), degree=1):
    """A cube between smooth walls, pressed by 1e-4 of its height: uniaxial strain."""
    walls = [Clamp("left", "x"), Clamp("right", "x"), Clamp("front", "y"), Clamp("back", "y")]
    press = PrescribedDisplacement("top", (0.0, 0.0, -1e-4), "z", amplitude)
    mesh = coulomb.box((1.0, 1.0, 1.0), (3, 4, 2), cell, degree=degree)
    return ContactProblem(mesh, STEEL, [*walls, press], Contact("bottom", 0.3), probes=probes)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_pressure_of_the_patch_test(cell, degree):
    E, nu = STEEL.young, STEEL.poisson
    pressure = 1e-4 * E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    on, above = probed(pressed(cell, degree=degree), [(0.41, 0.37, 0.0), (0.41, 0.37, 0.6)])
    assert on.face == "bottom" and above.face is None
    assert on.pressure == pytest.approx(pressure, rel=1e-9)
    assert np.allclose(on.slip, 0.0, atol=1e-12) and above.slip is None and above.pressure is None
    assert np.allclose(above.displacement, [0.0, 0.0, -0.6e-4], rtol=0.0, atol=1e-12)


def test_slip_of_a_block_that_slides():
    """Dragged by its walls over a smooth foundation: every point slips by the same."""
    drag = PrescribedDisplacement("top", (2e-3, -1e-3, -1e-6))
    mesh = coulomb.box((1.0, 1.0, 0.1), (4, 4, 1))
    problem = ContactProblem(mesh, STEEL, [drag], Contact("bottom", 0.0), small_strain="warn")
    (value,) = probed(problem, [(0.52, 0.47, 0.0)])
    assert np.allclose(value.slip, [2e-3, -1e-3, 0.0], rtol=1e-3, atol=1e-6)
    assert np.allclose(value.slip[:2], value.displacement[:2], rtol=1e-12)


def test_values_at_nodes_and_between_them():
    """Bilinear on the facets of hexahedra: at a node its value, in the middle of a facet the mean of four."""
    problem = ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (4, 4, 2)),
        STEEL,
        [PrescribedDisplacement("top", (1e-4, 0.0, -1e-4))],
        Contact("bottom", 0.3),
    )
    solution = problem.solve()
    x, fields = np.concatenate(comm.allgather(problem.surface.x)), solution.at_nodes.fields()
    pressure, slip = (np.concatenate(comm.allgather(fields[name])) for name in ("pressure", "slip"))
    corners = np.flatnonzero(np.all(np.abs(x - [0.375, 0.375, 0.0]) < 0.13, axis=1))
    at, between = solution.probed([Probe("at", (0.25, 0.5, 0.0)), Probe("between", (0.375, 0.375, 0.0))])
    node = int(np.argmin(np.linalg.norm(x - [0.25, 0.5, 0.0], axis=1)))
    assert len(corners) == 4 and np.ptp(pressure[corners]) > 0.01 * pressure.max()
    assert at.pressure == pytest.approx(pressure[node], rel=1e-12)
    assert np.allclose(at.slip, slip[node], rtol=0.0, atol=1e-12 * np.abs(slip).max())
    assert between.pressure == pytest.approx(np.mean(pressure[corners]), rel=1e-12)
    assert np.allclose(between.slip, slip[corners].mean(axis=0), rtol=0.0, atol=1e-12 * np.abs(slip).max())


@pytest.mark.parametrize("cell", CELLS)
def test_a_point_beside_the_mesh_is_at_its_boundary(cell):
    """By less than a twentieth of a cell's shortest edge, which here is 0.25 m."""
    (value,) = probed(pressed(cell), [(0.41, 0.37, -0.012)])
    assert np.allclose(value.found_at, [0.41, 0.37, 0.0], rtol=0.0, atol=1e-15) and value.face == "bottom"
    assert value.pressure > 0.0


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(
    ("point", "nearest", "distance"),
    [
        ((0.4, 0.45, -0.2), "0.4, 0.45, 0", "0.2"),
        ((0.63, 0.35, -0.2), "0.63, 0.35, 0", "0.2"),  # in the other half of a quadrilateral
        ((2.0, 1.5, 2.0), "1, 1, 1", "1.5"),
        ((1.3, 0.5, 1.4), "1, 0.5, 1", "0.5"),
    ],
)
def test_a_point_outside_is_refused(cell, point, nearest, distance):
    problem = pressed(cell)
    with pytest.raises(ValueError) as failure:
        problem.body.located([Probe("heel", point)])
    text = str(failure.value)
    assert f"probe 'heel': the point ({', '.join(f'{c:g}' for c in point)}) is outside the body" in text
    assert f"the nearest point of the body is ({nearest}), at a distance of {amount(float(distance))}" in text
    assert len(set(comm.allgather(text))) == 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Probe("", (0, 0, 0)), "probe: the name must be"),
        (lambda: Probe("a", (0, 0)), "probe 'a': the point must be three finite numbers"),
        (lambda: Probe("a", (0, 0, np.nan)), "probe 'a': the point must be three finite numbers"),
        (lambda: Probe("a", "here"), "probe 'a': the point must be three finite numbers"),
    ],
)
def test_wrong_probes_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_columns_of_a_history(tmp_path):
    """Columns of history.csv at every step, empty where a probe is not on a contact face, and the summary."""
    directory = comm.bcast(tmp_path)
    probes = [Probe("on", (0.41, 0.37, 0.0)), Probe("in", (0.41, 0.37, 0.5))]
    problem = pressed("hexahedron", [(0, 0), (2, 1)], probes)
    entries = []
    LoadHistory([1.0, 2.0], tolerance=1e-11).run(
        problem, HistoryFiles(directory), on_step=lambda step: entries.append(summary(step.solution)["probes"])
    )
    with (directory / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row, entry in zip(rows, entries, strict=True):
        assert [value["name"] for value in entry] == ["on", "in"]
        assert float(row["probe_on_pressure"]) == pytest.approx(entry[0]["pressure"], rel=1e-12)
        assert float(row["probe_in_displacement_z"]) == pytest.approx(entry[1]["displacement"][2], rel=1e-12)
        assert row["probe_in_pressure"] == row["probe_in_slip_x"] == ""
    assert float(rows[1]["probe_in_displacement_z"]) == pytest.approx(-0.5e-4, rel=1e-9)
    assert float(rows[1]["probe_on_pressure"]) == pytest.approx(2.0 * float(rows[0]["probe_on_pressure"]), rel=1e-9)
