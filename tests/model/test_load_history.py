"""Load steps: slip across steps, energy, a step that fails, a run that is killed."""

import csv
import logging
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import ufl
from conftest import ROOT, STEEL, run_coulomb
from shared_problems import RUBBER, UP, FailsAt, rubbed

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Sphere,
    Spring,
    SymmetryPlane,
    Traction,
)
from coulomb.model.load_history import StepFailed
from coulomb.recheck import check


def test_slip_is_kept_between_steps():
    """After slip and return of the plate there is a friction force: the slip has not been undone."""
    cork = Material(1e7, 0.0)  # does not swell sideways: all nodes slip along x
    steps = list(LoadHistory([1, 2, 3, 4, 5]).steps(rubbed(material=cork)))
    assert [step.solution.certificate.passed for step in steps] == [True] * 5
    force = [step.row["force_x"] for step in steps]
    normal = [step.row["normal_force"] for step in steps]
    assert abs(force[0]) <= 1e-6 * normal[0]  # symmetric
    assert force[1] == pytest.approx(-0.4 * normal[1], rel=1e-6)  # slips as a whole: F N
    assert force[3] == pytest.approx(+0.4 * normal[3], rel=1e-6)  # and back
    assert abs(force[2]) < 0.4 * normal[2]  # on the return, with the plate at x = 0, most nodes stick
    at_once = rubbed(material=cork).at(3.0).solve()  # without history, this would be the symmetric answer
    assert abs(coulomb.io.summary.summary(at_once)["force_on_body"]["vector"][0]) <= 1e-6 * normal[2]


def test_few_steps_where_a_tangent_is_held():
    """Contact points in planes of symmetry are held along a tangent: a step from the one before takes as few Newton
    steps as without, and the forces are those of the interior-point method."""
    slice_ = rubbed(held=[SymmetryPlane("front"), SymmetryPlane("back")])
    times = np.linspace(0.5, 3.0, 6)
    found = list(LoadHistory(times).steps(slice_))
    path = list(LoadHistory(times, solver=InteriorPoint(1e-8)).steps(slice_))
    for step, other in zip(found, path, strict=True):
        assert step.solution.certificate.passed
        assert step.row["force_x"] == pytest.approx(other.row["force_x"], rel=1e-6, abs=1e-6 * step.row["normal_force"])
    assert max(step.row["path_following"] for step in found[1:]) <= 5


def test_energy():
    """Friction dissipates in every step; the imbalance is the time-stepping error, of first order at least."""
    imbalance = []
    for n in (1, 2, 4):
        energies = [step.state.energy for step in LoadHistory(np.linspace(0, 5, 5 * n + 1)[1:]).steps(rubbed())]
        dissipated = np.diff([0.0] + [energy.dissipated for energy in energies])
        assert np.all(dissipated >= -1e-8 * energies[-1].dissipated)  # zero where nothing slips, to the residual
        imbalance.append(energies[-1].imbalance / energies[-1].dissipated)
    assert abs(imbalance[1]) <= 0.55 * abs(imbalance[0]) and abs(imbalance[2]) <= 0.55 * abs(imbalance[1])


def test_without_friction_work_is_elastic_energy():
    """Elastic, and linear while no node opens or closes: the trapezoidal rule is exact."""
    last = list(LoadHistory([1, 2, 3]).steps(rubbed(friction=0.0)))[-1].state.energy
    assert last.dissipated == 0.0
    assert last.prescribed == pytest.approx(last.elastic, rel=1e-7)


@pytest.mark.parametrize("springs", [[], [Spring("left", 1e7)]], ids=["clamped", "on springs"])
def test_work_of_loads(springs):
    """A load that grows from zero on a body without contact: half of force times displacement (Clapeyron)."""
    far = Contact("bottom", 0.4, foundation=Plane((0, 0, -1.0), (0, 0, 1)))
    pull, held = [Traction("top", (3e3, 0.0, -1e4), UP)], [] if springs else [Clamp("left")]
    problem = ContactProblem(coulomb.box((0.1, 0.1, 0.05), (3, 3, 3)), RUBBER, held, far, pull, springs=springs)
    *_, last = LoadHistory([0.25, 1.0]).steps(problem)
    energy, u = last.state.energy, last.solution.displacement
    half = 0.5 * np.vdot(last.solution.problem.loading.load, u)
    assert energy.loads == pytest.approx(half, rel=1e-9) and energy.elastic == pytest.approx(half, rel=1e-9)
    in_springs = -0.5 * np.vdot(last.solution.problem.elasticity.spring_force(u), u)
    assert (in_springs > 0.1 * half) == bool(springs)


@pytest.mark.parametrize("foundation", [None, Sphere((0.05, 0.05, -1.0), 1.0)])
def test_moving_the_foundation_is_moving_the_body(foundation):
    """The same relative motion: the same forces; friction does its work on the other side."""
    mesh = coulomb.box((0.1, 0.1, 0.05), (4, 4, 4))
    times = [0.5, 1.0, 1.5, 2.0, 3.0]
    path = [(0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1e-3), (2.0, 2e-3, 1e-3, 1e-3), (3.0, -1e-3, 0.0, 1e-3)]
    moving = ContactProblem(mesh, RUBBER, [Clamp("top")], Contact("bottom", 0.4, foundation=foundation, motion=path))
    shift = [
        PrescribedDisplacement("top", tuple(-np.eye(3)[k]), c, amplitude=[(r[0], r[1 + k]) for r in path])
        for k, c in enumerate("xyz")
    ]
    body = ContactProblem(mesh, RUBBER, shift, Contact("bottom", 0.4, foundation=foundation))
    for one, other in zip(LoadHistory(times).steps(moving), LoadHistory(times).steps(body), strict=True):
        x, y = one.solution.contact_force, other.solution.contact_force
        # a node on the sphere keeps its own normal on a moving body, but meets another place of a moving sphere
        tolerance = 1e-6 if foundation is None else 2e-2
        assert np.linalg.norm(x - y) <= tolerance * np.linalg.norm(x)
        assert one.state.energy.elastic == pytest.approx(other.state.energy.elastic, rel=tolerance)
        assert one.state.energy.foundation == pytest.approx(other.state.energy.prescribed, rel=tolerance)


def test_a_step_that_fails_is_halved(caplog):
    history = LoadHistory([1.0, 2.0], solver=FailsAt((1, 2)))
    with caplog.at_level(logging.INFO, "coulomb.model.load_history"):
        steps = list(history.steps(rubbed()))
    assert [step.state.time for step in steps] == [1.0, 1.25, 1.5, 2.0]
    said = [record.levelname for record in caplog.records if record.name == "coulomb.model.load_history"]
    assert said == ["INFO", "WARNING", "WARNING", "INFO", "INFO", "INFO"]
    assert caplog.messages[-1] == "load step 4 to 2 s: certificate passed"
    assert [step.halvings for step in steps] == [0, 2, 0, 0]
    assert ["fussy" in step.why_halved for step in steps] == [False, True, False, False]


def test_a_step_that_always_fails_keeps_those_before(tmp_path):
    history = LoadHistory([1.0, 2.0], solver=FailsAt(tuple(range(1, 99))), halvings=3)
    with pytest.raises(StepFailed, match=r"load step from 1 s to 1\.125 s failed, halved 3 times: fussy") as failure:
        history.run(rubbed(), coulomb.HistoryFiles(tmp_path))
    assert failure.value.problem.time == 1.125
    assert (tmp_path / "steps" / "0001" / "summary.json").exists() and not (tmp_path / "steps" / "0002").exists()
    files = coulomb.HistoryFiles(tmp_path, resume=True)
    LoadHistory([1.0, 2.0]).run(rubbed(), files)
    assert [row["time"] for row in files.rows] == [1.0, 2.0]


def cube(amplitude=1.0, motion=None):
    top = PrescribedDisplacement("top", (0.0, 0.0, 0.0), amplitude=amplitude)
    return ContactProblem(coulomb.box((1, 1, 1), (1, 1, 1)), STEEL, [top], Contact("bottom", 0.1, motion=motion))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LoadHistory([]), "times has no load step"),
        (lambda: LoadHistory("12"), "times must be a list of numbers, as .*, but is '12'"),
        (lambda: LoadHistory(1.0), "times must be a list of numbers, as .*, but is 1.0"),
        (lambda: LoadHistory(ufl.as_ufl(1.0)), "times must be a list of numbers"),
        (lambda: LoadHistory([1.0], halvings=-1), "halvings must be at least 0"),
        (lambda: cube([(1, 0, 0)]), r"on 'top': amplitude must be a table of rows \[time, factor\]"),
        (lambda: cube(lambda t: 1 / t), "on 'top': the amplitude failed at time 0: (float )?division by zero"),
        (lambda: cube(lambda t: np.nan), "the amplitude at time 0 is nan"),
        (lambda: cube(motion=lambda t: (t, 0)), "contact: foundation: the motion at time 0 must be three finite num"),
        (lambda: cube(motion=[(0, 0, 0)]), r"motion must be a table of rows \[time, x, y, z\]"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


CASE = ROOT / "demos" / "history.toml"
STEPS = 8
SMALL = (
    *("--set", "mesh.cells=[4,4,2]", "--set", f"history={{end=6.0, steps={STEPS}}}"),
    *("--set", "output.picture=false", "--set", "solver.tolerance=1e-11"),
)


def numbers(directory):
    """history.csv without what an answer does not consist of: counts and residuals of the solver."""
    with (directory / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    skip = {"path_following", "residual", "certified", "valid", "gap_error", "energy_imbalance"}
    return np.array([[float(row[key]) for key in row if key not in skip] for row in rows]), rows


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A history in one go."""
    directory = tmp_path_factory.mktemp("whole")
    run_coulomb("run", CASE, *SMALL, "--output", directory)
    return directory


def killed(directory, after):
    """The same, killed without warning once so many steps are there."""
    command = [sys.executable, "-m", "coulomb", "run", str(CASE), *SMALL, "--output", str(directory)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True) as process:
        while not (directory / "steps" / f"{after:04d}" / "summary.json").exists():
            assert process.poll() is None
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)
    left = len(list((directory / "steps").glob("*/summary.json")))
    assert after <= left < STEPS
    return left


def test_a_killed_run_resumes_with_the_same_numbers(whole, tmp_path):
    left = killed(tmp_path, after=2)
    done = run_coulomb("resume", tmp_path)
    assert f"step {left + 1:3d}" in done.stdout and f"step {left:3d}" not in done.stdout
    (ours, rows), (expected, _) = numbers(tmp_path), numbers(whole)
    assert len(rows) == STEPS
    force = np.abs(expected[:, 2:5]).max()
    assert np.abs(ours[:, 2:5] - expected[:, 2:5]).max() <= 1e-10 * force
    for name in ("normal_force", "contact_area", "energy_elastic", "energy_dissipated", "energy_prescribed"):
        column = [[float(row[name]) for row in numbers(d)[1]] for d in (tmp_path, whole)]
        assert np.allclose(*column, rtol=1e-10, atol=1e-10 * np.abs(column).max())
    assert check(tmp_path / "steps" / f"{STEPS:04d}").passed


def test_the_time_series(whole):
    pyvista = pytest.importorskip("pyvista")
    reader = pyvista.get_reader(str(whole / "contact.xdmf"))
    assert np.allclose(reader.time_values, 6.0 / STEPS * np.arange(1, STEPS + 1))
    _, rows = numbers(whole)
    for index in (2, 4, 7):
        reader.set_active_time_point(index)
        grid = reader.read()
        total = np.asarray(grid["contact_force"]).sum(axis=0)
        expected = [float(rows[index][f"force_{axis}"]) for axis in "xyz"]
        assert np.allclose(total, expected, rtol=1e-5, atol=1e-5 * abs(expected[2]))
