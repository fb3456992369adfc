"""Factors in place of multigrid: the same decision on all ranks."""

import numpy as np
import pytest
from mpi4py import MPI
from test_thin_bodies import CELLS, sheet

from coulomb import DirectSolver, IterativeSolver, NotConverged
from coulomb.linalg.compliance import predicted_cost as methods
from coulomb.linalg.compliance import stiffness
from coulomb.linalg.reductions import Reductions
from coulomb.model import contact_stiffness

RANK = MPI.COMM_WORLD.rank


@pytest.fixture(autouse=True)
def by_multigrid(monkeypatch):
    """Multigrid is chosen, and fails after 30 iterations."""
    monkeypatch.setattr(contact_stiffness, "undecided", lambda _, __, *given: given == (None, None))
    monkeypatch.setattr(contact_stiffness, "factorise", lambda *_: False)
    monkeypatch.setattr(stiffness, "_ITERATIONS", 30)


@pytest.mark.parametrize("slow", [False, True])
def test_all_ranks_change(monkeypatch, slow):
    """Where each rank by itself would allow another number of iterations."""
    if slow:
        monkeypatch.setattr(contact_stiffness, "patience", lambda *_: 20.0 + 300.0 * RANK)
    problem = sheet(CELLS)
    assert problem.body.stiffness.linear_solver is IterativeSolver
    solution = problem.solve()
    assert problem.body.stiffness.linear_solver is DirectSolver and solution.certificate.passed
    assert len(set(MPI.COMM_WORLD.allgather(problem.body.stiffness.changed))) == 1
    assert ("and after 20 factors" in problem.body.stiffness.changed) is slow
    exact, over = sheet(CELLS, linear_solver=DirectSolver).solve(), Reductions(MPI.COMM_WORLD)
    assert over.max(np.abs(solution.displacement - exact.displacement)) < 1e-6 * over.max(np.abs(exact.displacement))


@pytest.mark.parametrize("formed", [True, False])
def test_a_sheet_is_condensed(monkeypatch, formed):
    """After some products by a formed A, or from the beginning, on all ranks."""
    exact, over = sheet(CELLS, linear_solver=DirectSolver).solve(), Reductions(MPI.COMM_WORLD)
    monkeypatch.setattr(contact_stiffness, "_PRODUCTS", 3)
    if not formed:
        monkeypatch.setattr(methods, "EXPLICIT_UP_TO", 0)
    problem = sheet(CELLS, linear_solver=DirectSolver)
    solution = problem.solve()
    assert problem.body.stiffness.condensed and bool(problem.body.stiffness.changed) is formed
    assert solution.certificate.passed and solution.result.method == "interior point"
    assert over.max(np.abs(solution.displacement - exact.displacement)) < 1e-6 * over.max(np.abs(exact.displacement))


def test_no_rank_changes(monkeypatch):
    """The memory is too small in the opinion of the first rank only; the others follow."""
    fits = contact_stiffness.fits
    monkeypatch.setattr(contact_stiffness, "fits", lambda *given: RANK > 0 and fits(*given))
    problem = sheet(CELLS)
    with pytest.raises(NotConverged, match="failed: after 30 iterations"):
        problem.solve()
    assert problem.body.stiffness.linear_solver is IterativeSolver and not problem.body.stiffness.changed
