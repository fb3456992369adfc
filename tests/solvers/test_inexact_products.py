"""Products that are solves with multigrid: accurate enough where small differences of large numbers decide."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Traction
from coulomb.linalg.compliance.krylov import CarryingKrylov, Constraints
from coulomb.solvers import IterativeSolver


def test_steps_between_which_the_load_returns():
    """Most nodes then stick, with friction at its bound and no slip: A dx is small beside dx.  With products of
    a fixed accuracy, the third step needs 16 597 of them and ends in successive Tresca problems."""
    problem = ContactProblem(
        coulomb.box((2.0, 1.0, 0.5), (8, 4, 3), "tetrahedron"),
        Material(2e9, 0.3),
        [Clamp("left")],
        Contact("bottom", 0.3),
        [
            Traction("top", (0.0, 0.0, -1e5), [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0), (1.5, 1.0)]),
            Traction("right", (2000.0, 0.0, 0.0)),
        ],
        (0.0, 0.0, -77e3),
        linear_solver=IterativeSolver,
    )
    for step in LoadHistory([0.5, 1.0, 1.5]).steps(problem):
        result = step.solution.result
        assert step.solution.certificate.passed
        assert "Tresca" not in result.method and result.products <= 1000


@pytest.mark.parametrize("linear_solver", [coulomb.solvers.DirectSolver, IterativeSolver])
@pytest.mark.parametrize("what", ["nothing", "loads", "motion"])
def test_a_step_with_nothing_but_rounding_errors(what, linear_solver):
    """Everything is 0 again: exactly, where a part of the displacement before, however small, would be all there is;
    but for a load of sin(pi) = 1.2e-16; but for 4e-20 m of the foundation, and for the gaps of a block that was moved.
    """
    block, floor, top = coulomb.box((0.6, 0.3, 0.2), (4, 3, 2)), Contact("bottom", friction=0.3), Clamp("top")
    if what == "motion":
        block = coulomb.moved(block, (0.1, 0.7, 0.3), coulomb.Rotation((0.1, 0.0, 0.0), (1.0, 2.0, 0.5), 0.4))
        floor = replace(floor, motion=lambda time: (0.0, 0.0, 3e-4 * np.sin(np.pi * time)))
    else:
        wave = [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0)] if what == "nothing" else lambda time: np.sin(np.pi * time)
        top = coulomb.PrescribedDisplacement("top", (0.0, 0.0, -3e-4), amplitude=wave)
    problem = ContactProblem(block, Material(7e10, 0.33), [top], floor, linear_solver=linear_solver)
    pressed, free = LoadHistory([0.5, 1.0]).steps(problem)
    assert pressed.solution.certificate.passed and np.any(pressed.solution.contact_force)
    assert free.halvings == 0 and free.solution.certificate.passed and not np.any(free.solution.contact_force)


def test_products_lose_accuracy_as_the_residual_falls():
    """Errors of the size that is allowed, in random directions, leave the residual within three times its tolerance;
    errors of a tenth in all products leave ninety times."""
    rng, m, accuracies = np.random.default_rng(29), 40, []
    Q = np.linalg.qr(rng.normal(size=(3 * m, 3 * m)))[0]
    A = Q * np.geomspace(1.0, 10.0, 3 * m) @ Q.T

    def inexact(z):
        accuracies.append(krylov.allowed(1e-3))
        y, error = (A @ z.ravel()).reshape(-1, 3), rng.normal(size=z.shape)
        return y + accuracies[-1] * np.linalg.norm(y) / np.linalg.norm(error) * error

    rhs, none = rng.normal(size=(m, 3)), Constraints(MPI.COMM_SELF, np.zeros((m, 3, 0)))
    atol, method = 1e-3 * np.linalg.norm(rhs), PETSc.KSP.Type.FGMRES
    krylov = CarryingKrylov(none, 3, inexact, lambda p, A_p: 3.0 * p + A_p, lambda r, r3: (r, r3), method)
    x, *_ = krylov.solve(rhs, np.zeros((m, 3)), atol, np.empty(0))
    krylov.free()
    assert np.linalg.norm(rhs - 3.0 * x - (A @ x.ravel()).reshape(-1, 3)) <= 3.0 * atol
    assert accuracies[0] == 1e-3 and np.all(np.diff(accuracies) >= 0.0) and 0.003 < accuracies[-1] <= 0.01
