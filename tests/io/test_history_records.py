"""Start and records of a load step: warm start, energy, slip of the step, small strain."""

import csv
import re
import shutil
from dataclasses import dataclass, field

import numpy as np
import pytest
from conftest import STEEL
from shared_problems import RUBBER, rubbed

import coulomb
from coulomb import Clamp, Contact, ContactProblem, InteriorPoint, LoadHistory, Plane, Sphere, Traction
from coulomb.io import output
from coulomb.io.history_files import at_points, points_in_files
from coulomb.io.run_directory import RunDirectory


@dataclass(frozen=True)
class Noting:
    """The interior-point method; records the forces that it was given to start from."""

    tolerance: float = 1e-8
    starts: list = field(default_factory=list)

    def solve(self, problem, start=None, *, gradient=None, progress=None):
        self.starts.append(start)
        return InteriorPoint(self.tolerance).solve(problem, start=start, progress=progress)


def test_a_step_starts_from_the_forces_before():
    """As physical vectors, in the present frames, which a moved ball has turned."""
    ball = Sphere((0.05, 0.05, -0.5), 0.5)
    contact = Contact("bottom", 0.4, foundation=ball, motion=[(0, 0, 0, 0), (1, 0, 0, 1e-3), (2, 0.02, 0.01, 1e-3)])
    problem = ContactProblem(coulomb.box((0.1, 0.1, 0.05), (4, 4, 3)), RUBBER, [Clamp("top")], contact)
    solver = Noting()
    one, two = (step.solution for step in LoadHistory([1.0, 2.0], solver=solver).steps(problem))
    assert solver.starts[0] is None
    before = one.problem.surface.vectors(one.contact_force.reshape(-1, 3))
    started = two.problem.surface.vectors(solver.starts[1].reshape(-1, 3))
    assert np.abs(two.problem.surface.frames - one.problem.surface.frames).max() > 0.01
    assert np.allclose(started, before, rtol=0.0, atol=1e-12 * np.abs(before).max())


def test_slip_is_written_as_that_of_the_step(tmp_path):
    """From the positions after the step before, moved with the foundation."""
    way = [(0, 0, 0, 0), (1, 0, 0, 1e-3), (2, 2e-3, 0, 1e-3)]
    contact = Contact("bottom", 0.3, foundation=Plane((0, 0, 0), (0, 0, 1)), motion=way)
    problem = ContactProblem(coulomb.box((0.1, 0.1, 0.05), (4, 4, 3)), RUBBER, [Clamp("top")], contact)
    before, step = LoadHistory([1.5, 2.0]).steps(problem)
    output.write(step.solution, tmp_path)
    nodes = step.solution.problem.surface.nodes
    _, points = points_in_files(RunDirectory(tmp_path), problem)
    written = at_points(tmp_path / "contact.xdmf", "slip", points, problem.comm)
    slip = (step.solution.displacement - before.solution.displacement)[nodes] - [1e-3, 0.0, 0.0]
    slip[:, 2] = 0.0
    assert np.allclose(written, slip, rtol=0.0, atol=1e-6 * np.abs(slip).max())
    assert np.abs(before.solution.displacement[nodes, :2]).max() > 0.1 * np.abs(slip).max()
    assert step.row["greatest_slip"] == pytest.approx(np.linalg.norm(slip, axis=1).max(), rel=1e-6)


def test_the_largest_slip_is_that_of_a_closed_node():
    """A beam pressed down near its clamped end; the free end is lifted and moves farther than the closed nodes."""
    pressed = Traction("top", lambda x: np.stack([0 * x[0], 0 * x[0], np.where(x[0] < 0.9, -3e7, 0.0)]))
    solution = ContactProblem(
        coulomb.box((2.0, 0.5, 0.5), (8, 2, 2)),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.1),
        [Traction("right", (0.0, 5e6, 2e6)), pressed],
    ).solve()
    x = solution.contact_force.reshape(-1, 3)
    way = np.linalg.norm(solution.displacement[solution.problem.surface.nodes][:, :2], axis=1)
    closed = x[:, 0] > 1e-6 * x[:, 0].max()
    assert 0 < closed.sum() < len(closed) and way[~closed].max() > 1.5 * way[closed].max()
    assert solution.at_nodes.totals()["greatest_slip"] == pytest.approx(way[closed].max(), rel=1e-9)


def test_columns_without_a_value_are_empty(tmp_path):
    """The centre of pressure without contact, and the pressure of a probe inside the body, also after a resume."""
    far = Contact("bottom", 0.3, foundation=Plane((0, 0, -1.0), (0, 0, 1)))
    probes = [coulomb.Probe("inside", (0.05, 0.05, 0.025))]
    mesh = coulomb.box((0.1, 0.1, 0.05), (2, 2, 2))
    problem = ContactProblem(mesh, RUBBER, [Clamp("top")], far, probes=probes)
    history = LoadHistory([1.0, 2.0])
    history.run(problem, coulomb.HistoryFiles(tmp_path), on_step=lambda step: step.state.number == 1)
    history.run(problem, coulomb.HistoryFiles(tmp_path, resume=True))
    with (tmp_path / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2
    for row in rows:
        assert row["centre_of_pressure_x"] == row["probe_inside_pressure"] == row["probe_inside_slip_z"] == ""
        assert row["probe_inside_displacement_x"] != ""


def test_the_files_of_a_second_run_are_its_own(tmp_path):
    """With the same object, after the results of the first have been removed."""
    files, problem = coulomb.HistoryFiles(tmp_path / "out"), rubbed(cells=2)
    for time in (0.5, 1.0):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        LoadHistory([time]).run(problem, files)
        text = (tmp_path / "out" / "solution.xdmf").read_text()
        assert re.findall(r'<Time Value="(.*?)"', text) == [str(time)] and "steps/0002" not in text
