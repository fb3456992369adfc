"""The end of a path by the semismooth Newton method."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from conftest import dense_compliance, make_block, random_spd, solved_block

from coulomb import InteriorPoint
from coulomb.io.output import _write_history
from coulomb.solvers import Automatic, FrictionProblem, IterativeSolver
from coulomb.solvers.automatic import FINISH
from coulomb.solvers.results import InteriorPointStep, NotConverged, SemismoothStep, Status
from coulomb.solvers.semismooth_newton import SemismoothNewton


def at_the_edge(nodes=20, friction=0.4, seed=3):
    """A problem and its answer: at every node |x_t| = F x_n, and there is no slip and no gap."""
    rng = np.random.default_rng(seed)
    A = random_spd(3 * nodes, 100.0, rng)
    x, angle = np.empty((nodes, 3)), rng.uniform(0.0, 2.0 * np.pi, nodes)
    x[:, 0] = rng.uniform(1.0, 2.0, nodes)
    x[:, 1:] = friction * x[:, :1] * np.column_stack([np.cos(angle), np.sin(angle)])
    b = A @ x.ravel()
    return FrictionProblem.coulomb(dense_compliance(A), b, np.full(nodes, friction)), x.ravel()


def test_nodes_at_the_edge_of_their_discs_without_slip():
    """There the residual of path following falls like the square root of theta."""
    problem, x = at_the_edge()
    path, auto = InteriorPoint(1e-10).solve(problem), Automatic(1e-10).solve(problem)
    ended = InteriorPoint(1e-10, finish=SemismoothNewton()).solve(problem)
    assert max(ended.newton_steps, auto.newton_steps) < path.newton_steps
    assert ended.method == path.method and auto.method == f"auto: {path.method}"
    assert np.linalg.norm(auto.x - x) <= 1e-8 * np.linalg.norm(x)


def test_the_steps_of_both_methods_are_recorded(tmp_path):
    problem = solved_block(6).problem.friction_problem
    told = []
    result = Automatic(1e-8).solve(problem, progress=lambda at: told.append(at.path_following))
    path = InteriorPoint(1e-8).solve(problem)
    kinds = [type(step) for step in result.history]
    assert kinds == sorted(kinds, key=[InteriorPointStep, SemismoothStep].index)
    assert len(set(kinds)) == 2 and len(kinds) == result.newton_steps < path.newton_steps
    assert [step.iteration for step in result.history] == told == list(range(1, len(kinds) + 1))
    assert np.linalg.norm(result.x - path.x) <= 1e-6 * np.linalg.norm(path.x)
    assert problem.residual(result.x) <= 1e-8
    _write_history(result.history, tmp_path / "history.csv")
    rows = list(csv.DictReader((tmp_path / "history.csv").open()))
    assert rows[0]["changed"] == rows[-1]["theta"] == "nan" and float(rows[-1]["residual"]) <= 1e-8


@pytest.mark.parametrize("linear_solver", [None, IterativeSolver])
def test_a_finish_that_fails_leaves_the_path_as_it_was(linear_solver):
    """Its products and steps are counted, and it is tried once; products of its own, from which those of the iterates
    then start, leave the path what it was where they are inexact, too."""
    problem = make_block(6, linear_solver=linear_solver).friction_problem
    near = SemismoothNewton(max_iterations=1, forcing=0.9, sharpest=0.9)  # a step that solves next to nothing
    path, result = InteriorPoint(1e-8).solve(problem), InteriorPoint(1e-8, finish=near).solve(problem)
    kinds = [type(step) for step in result.history]
    assert result.status is Status.CONVERGED and kinds.count(SemismoothStep) == 1 and kinds[-1] is InteriorPointStep
    assert kinds.count(InteriorPointStep) <= path.newton_steps + (1 if linear_solver is None else 2)
    assert linear_solver is not None or result.products > path.products
    after = kinds.index(SemismoothStep)
    before, then = result.history[after - 1], result.history[after + 1]
    assert then.gradient <= 0.5 * before.gradient and then.residual < before.residual
    assert np.linalg.norm(result.x - path.x) <= 1e-5 * np.linalg.norm(path.x)


def test_a_finish_whose_residual_falls_steadily_is_not_given_up():
    """Newton systems solved to a half: more than six steps; a limit of six ended it next to the tolerance."""
    problem = make_block(8).friction_problem
    slow = replace(FINISH, forcing=0.5, sharpest=0.5)
    result = InteriorPoint(1e-8, finish=slow).solve(problem)
    kinds = [type(step) for step in result.history]
    assert kinds == sorted(kinds, key=[InteriorPointStep, SemismoothStep].index) and kinds.count(SemismoothStep) > 6
    assert problem.residual(result.x) <= 1e-8


def test_a_finish_is_given_up_where_the_certificate_refuses_an_answer_far_below_the_tolerance():
    problem = make_block(6).friction_problem
    refused = replace(problem, accept=lambda *_: False)
    with pytest.raises(NotConverged) as failure:
        InteriorPoint(1e-8, finish=FINISH).solve(refused)
    residuals = [step.residual for step in failure.value.result.history if isinstance(step, SemismoothStep)]
    assert sum(residual < 1e-12 for residual in residuals) == 1
    assert min(residuals) < 1e-12


def test_an_interruption_of_the_finish_ends_the_solve():
    problem = solved_block(6).problem.friction_problem
    steps = [type(step) for step in Automatic(1e-8).solve(problem).history]
    stop = steps.index(SemismoothStep) + 1
    if stop == len(steps):
        pytest.skip("the finish has one step")
    with pytest.raises(NotConverged) as failure:
        Automatic(1e-8).solve(problem, progress=lambda at: at.path_following >= stop)
    assert failure.value.result.status is Status.INTERRUPTED and failure.value.result.newton_steps == stop


def test_without_forces_there_is_no_other_answer():
    """With a residual of zero it is the answer, though the certificate refuses it; with another it is not."""
    problem = replace(at_the_edge(2)[0], accept=lambda *_: False)
    for b, some in ((problem.b, True), (-np.abs(problem.b), False)):
        with pytest.raises(NotConverged) as failure:
            InteriorPoint(1e-8).solve(replace(problem, b=b))
        result = failure.value.result
        assert bool(result.newton_steps) == some == bool(result.x.any()) and (some or result.residual == 0.0)
