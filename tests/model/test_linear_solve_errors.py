"""A solve with K by multigrid that fails: the message, and what is kept of the results."""

import json
import re

import numpy as np
import pytest
from conftest import SMALL_CASE
from mpi4py import MPI
from typer.testing import CliRunner

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, NotConverged, Status, Traction
from coulomb.cli.app import app
from coulomb.linalg.compliance import stiffness
from coulomb.linalg.compliance.stiffness import IterativeSolver
from coulomb.linalg.multigrid.recycled_cg import RecycledCG
from coulomb.linalg.solve_errors import CGNotConverged

SAID = re.compile(
    r"K u = f .*failed: after (\d+) iterations .* is needed; \d+ displacement unknowns, time 0 s, after (\d+) steps.*"
    r'what may help: K factorised \(linear_solver = "direct"\)'
)


def pressed():
    return ContactProblem(
        coulomb.box((2.0, 1.0, 1.0), (10, 5, 5)),
        Material(2e11, 0.3),
        [Clamp("top", "xy"), Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (1e6, 0.0, -1e7))],
        linear_solver=IterativeSolver,
        explicit=False,
    )


def limited(problem, iterations):
    """Solves end after so many iterations from now on."""
    problem.linear.stiffness.solver._cg._limit = iterations


@pytest.mark.parametrize("steps", [0, 5])
@pytest.mark.parametrize("interrupted", [False, True])
def test_the_error_says_what_failed_and_the_last_iterate_is_kept(steps, interrupted):
    """After some steps; if the user then interrupts, the last product, which is to be the most accurate, fails."""
    problem = pressed()

    def progress(progress):
        if progress.path_following == steps:
            limited(problem, 1)
        return interrupted and progress.path_following == steps

    if steps == 0:
        limited(problem, 1)
    with pytest.raises(NotConverged) as failure:
        problem.solve(solver=coulomb.InteriorPoint(), progress=progress)
    said = SAID.search(str(failure.value))
    assert said and int(said[1]) == 1
    result = failure.value.result
    assert result.status is (Status.INTERRUPTED if interrupted and steps else Status.STAGNATED)
    assert result.newton_steps == int(said[2]) == steps
    answer = problem.solution(result)
    assert not answer.valid and np.all(np.isfinite(answer.displacement))
    if steps:  # their forces carry the load
        assert result.residual < 0.1 and result.x[0::3].sum() > 1e6


def test_what_a_solve_has_reached_is_kept():
    """Of K = diag(1..n) without a preconditioner; of one that is not positive definite nothing is taken over."""
    n = 40

    def solved(diagonal, limit):
        def mult(x, y):
            y[:] = diagonal * x

        cg = RecycledCG(MPI.COMM_SELF, n, mult, np.copy, limit=limit)
        u = np.zeros(n)
        with pytest.raises(CGNotConverged) as failure:
            cg.solve(np.ones(n), u, 1e-12)
        return failure.value, u

    diagonal = np.arange(1.0, n + 1.0)
    failure, u = solved(diagonal, 10)
    assert failure.iterations == 10 and not failure.indefinite
    assert np.linalg.norm(1.0 - diagonal * u) == pytest.approx(failure.residual * np.sqrt(n), rel=1e-9)
    failure, u = solved(-diagonal, 10)
    assert failure.indefinite and "not positive definite" in str(failure) and not np.any(u)


@pytest.mark.parametrize("history", [False, True])
def test_on_the_command_line(monkeypatch, tmp_path, history):
    """Exit code, message and the results so far; a history does not halve its step."""
    monkeypatch.setattr(stiffness, "_ITERATIONS", 1)
    (tmp_path / "case.toml").write_text(SMALL_CASE)
    solver = "solver={linear_solver='iterative', compliance='matrix-free'}"
    given = ["mesh.cells=[12,4,4]", solver, *(["history={end=2.0, steps=2}"] if history else [])]
    sets = [word for change in given for word in ("--set", change)]
    run = CliRunner().invoke(app, ["run", str(tmp_path / "case.toml"), *sets, "--output", str(tmp_path / "results")])
    assert run.exit_code == 1, run.output
    said = " ".join(run.output.split())
    assert "error: " in said and "K u = f by conjugate gradients" in said and 'linear_solver = "direct"' in said
    if history:
        assert "halved 0 times" not in said and "the load step from 0 s to 1 s failed" in said
    else:
        assert "K u = f" in json.loads((tmp_path / "results" / "summary.json").read_text())["message"]
