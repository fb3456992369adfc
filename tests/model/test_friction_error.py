"""Load steps in halves, until friction no longer depends on their size."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from case_texts import one_body
from mpi4py import MPI
from shared_problems import RUBBER, FailsAt, rubbed

import coulomb
from coulomb.case.case import read_case
from coulomb.case.record import write_case
from coulomb.io.history_files import HistoryFiles
from coulomb.recheck import check

OBLIQUE = one_body((1.0, 0.4, 0.4), (6, 2, 2), 5e6, 0.4)
OBLIQUE += """\
clamp = [{ face = "top" }]
[contact]
face = "bottom"
friction = 0.4
foundation = {shape = "sphere", centre = [0.4, 0.2, -8.0], radius = 8.0}
motion = [[0, 0, 0, 0], [4, 8e-3, 0, 12e-3]]
[history]
end = 4.0
steps = 2
friction_error = 0.05
"""
"""A ball comes at an angle: in every load step other nodes touch it."""


def friction_of(solution):
    """Its resultant, newtons, shape (3,), and the sum of the sizes of friction forces."""
    at = solution.at_nodes
    forces = at.friction_traction * at.area[:, None]
    return forces.sum(axis=0), np.linalg.norm(forces, axis=1).sum()


@pytest.fixture(scope="module")
def oblique(tmp_path_factory):
    """The case, and its history in files."""
    folder = tmp_path_factory.mktemp("oblique")
    (folder / "case.toml").write_text(OBLIQUE)
    case = read_case(folder / "case.toml")
    files = HistoryFiles(folder / "whole")
    case.load_history().run(case.problem(), files)
    write_case(case, folder / "whole", MPI.COMM_SELF)
    return case, files


def test_the_error_is_that_of_many_steps_and_in_the_files(oblique):
    """Of 2 steps as they are it is larger than what is asked for."""
    case, files = oblique
    history = replace(case.load_history(), friction_error=None)
    *_, few = (step.solution for step in history.steps(case.problem()))
    *_, many = (step.solution for step in replace(history, times=np.arange(1, 33) / 8.0).steps(case.problem()))
    exact, whole = friction_of(many)
    last = files.rows[-1]
    found = np.linalg.norm(exact) - last["friction_force"]
    assert np.linalg.norm(exact - friction_of(few)[0]) > 0.04 * whole
    assert abs(found) <= last["friction_error"] * whole <= 0.1 * whole
    assert 4 <= len(files.rows) < 32 and {2.0, 4.0} < {row["time"] for row in files.rows}
    assert all(row["certified"] for row in files.rows)
    summary = files.directory.read_summary()
    most = max(row["friction_error"] for row in files.rows)
    assert summary["history"]["maximum"]["friction_error"]["value"] == most
    assert summary["history"]["halvings"] == len(files.rows) - 2


def test_it_is_checked_and_continued(oblique, tmp_path):
    case, files = oblique
    found = check(files.directory.path)
    assert not found.faults, found.faults
    part = HistoryFiles(tmp_path / "part")
    case.load_history().run(case.problem(), part, on_step=lambda step: step.state.number == 2)
    rest = HistoryFiles(tmp_path / "part", resume=True)
    case.load_history().run(case.problem(), rest)
    assert [row["time"] for row in rest.rows] == pytest.approx([row["time"] for row in files.rows])
    errors = [[row["friction_error"] for row in one.rows] for one in (rest, files)]
    assert errors[0] == pytest.approx(errors[1], abs=1e-6)


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_steps_that_change_nothing_but_their_size_are_halved_once(kinematics):
    """A block that is pressed straight has no friction along, and one that slides all of it, in any number of steps."""
    material = RUBBER if kinematics == "small" else coulomb.NeoHookean(1e7, 0.3)
    top = coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3), amplitude=[(0.0, 0.0), (1.0, 1.0)])
    block = coulomb.box((0.1, 0.1, 0.1), (2, 2, 2))
    motion = [(1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 1e-2, 0.0), (3.0, 0.0, 2e-2, 0.0)]
    contact = coulomb.Contact("bottom", 0.3, foundation=coulomb.Plane((0, 0, 0), (0, 0, 1)), motion=motion)
    problem = coulomb.ContactProblem(block, material, [top], contact, kinematics=kinematics)
    steps = list(coulomb.LoadHistory([1.0, 3.0], friction_error=0.01).steps(problem))
    assert [step.state.time for step in steps] == [0.5, 1.0, 2.0, 3.0]
    assert [step.halvings for step in steps] == [1, 0, 1, 0]
    assert all(step.solution.valid for step in steps)
    assert steps[-1].state.friction_error < 1e-3
    assert steps[2].solution.problem.time == 2.0 and steps[2].why_halved.startswith("friction changes by ")


def test_halvings_end_it_and_a_half_that_fails_leaves_the_whole(caplog):
    with caplog.at_level(logging.ERROR):
        steps = list(coulomb.LoadHistory([1.0, 2.0], friction_error=1e-9, halvings=2).steps(rubbed()))
    assert [step.state.time for step in steps] == [0.5, 1.0, 1.25, 1.5, 1.75, 2.0]
    assert steps[-1].state.friction_error > 1e-9
    fails = coulomb.LoadHistory([1.0, 2.0], solver=FailsAt((2,)), friction_error=0.5)
    assert [step.state.time for step in fails.steps(rubbed())] == [1.0, 1.5, 2.0]


@pytest.mark.parametrize("wrong", [0.0, 1.0, -0.1, float("nan")])
def test_no_error_is_refused(wrong):
    with pytest.raises(ValueError, match="friction_error must be between 0 and 1"):
        coulomb.LoadHistory([1.0], friction_error=wrong)
