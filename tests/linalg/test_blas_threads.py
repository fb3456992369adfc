"""Threads of BLAS beside those of multigrid."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from benchmarks.block import block
from coulomb.linalg.compliance.stiffness import DirectSolver, IterativeSolver
from coulomb.model import problem as of_problems


def _counts():
    """Threads of every BLAS in use that can have several."""
    found = [entry for entry in threadpool_info() if entry["user_api"] == "blas"]
    return [entry["num_threads"] for entry in found if entry.get("threading_layer") != "disabled"]


@pytest.mark.parametrize("solver", [DirectSolver, IterativeSolver])
@pytest.mark.parametrize("team", [1, 2])
def test_multigrid_with_threads_has_the_processors_for_itself(monkeypatch, solver, team):
    monkeypatch.setattr(of_problems, "threads", lambda: team)
    seen = []
    options = {"explicit": False} if solver is IterativeSolver else {}
    body = block(4, 0.3, linear_solver=solver, **options)
    with threadpool_limits(limits=2, user_api="blas"):
        before = _counts()
        body.solve(progress=lambda _: seen.append(_counts()) and False)
        after = _counts()
    assert before and set(before) == {2}
    assert after == before
    alone = solver is IterativeSolver and team > 1
    assert seen and all(set(counts) == ({1} if alone else {2}) for counts in seen)


def test_as_many_afterwards_as_before_if_a_solve_fails(monkeypatch):
    monkeypatch.setattr(of_problems, "threads", lambda: 2)
    body = block(4, 0.3, linear_solver=IterativeSolver, explicit=False)
    with threadpool_limits(limits=2, user_api="blas"):
        with pytest.raises(ZeroDivisionError):
            body.solve(progress=lambda _: bool(1 / 0))
        assert set(_counts()) == {2}
