"""Derivatives by multigrid of K with springs in place of contact, on any number of ranks: against factors, and how many
V-cycles they take."""

import numpy as np
import pytest
from mpi4py import MPI

import coulomb
from coulomb.linalg.compliance import DirectSolver, IterativeSolver, MatrixFreeCompliance
from coulomb.linalg.compliance.coupled import CoupledKrylov
from coulomb.solvers.semismooth_newton import SemismoothNewton

COMM = MPI.COMM_WORLD


def pair(solver, hard=1.0, degree=1):
    """A block on another, clamped at the back, pressed and drawn."""
    lower = coulomb.box((1.0, 1.0, 0.5), (5, 4, 3), degree=degree)
    upper = coulomb.moved(coulomb.box((0.8, 0.8, 0.4), (4, 3, 2), degree=degree), (0.1, 0.1, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(lower=lower, upper=upper),
        {"lower": coulomb.Material(2e9, 0.3), "upper": coulomb.Material(2e9 * hard, 0.3)},
        [coulomb.Clamp("lower:bottom"), coulomb.Clamp("upper:back")],
        coulomb.Contact("upper:bottom", against="lower:top", friction=0.3),
        [coulomb.Traction("upper:top", (1e5, 0.0, -1e6))],
        small_strain="warn",
        linear_solver=solver,
    )


def sheet(solver):
    """A hundred times as long as it is thick: it bends 1e4 times as easily as it stretches."""
    return coulomb.ContactProblem(
        coulomb.box((10.0, 1.0, 0.1), (20, 2, 1)),
        coulomb.Material(2e11, 0.3),
        [coulomb.Clamp("left")],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.Traction("top", (0.0, 1e4, -1e5))],
        linear_solver=solver,
    )


POSED = {
    "alike": (pair, 1e-10, 15),
    "1e3 times as hard": (lambda solver: pair(solver, 1e3), 1e-10, 15),
}
if COMM.size == 1:
    POSED |= {"second order": (lambda solver: pair(solver, degree=2), 1e-10, 22), "sheet": (sheet, 1e-8, 10)}


def test_semismooth_steps_take_few_cycles_and_one_product(monkeypatch):
    """From the end of the path: a product by A for each of their iterations would take two to three cycles."""
    products, steps, applied, solved = [], [], MatrixFreeCompliance.mult, SemismoothNewton._solved

    def counted(self, *arguments):
        products.append(self)
        applied(self, *arguments)

    def finished(self, problem, task):
        products.clear()
        result = solved(self, problem, task)
        steps.append((result.status, len(products), sum(one.krylov for one in result.history)))
        return result

    monkeypatch.setattr(MatrixFreeCompliance, "mult", counted)
    monkeypatch.setattr(SemismoothNewton, "_solved", finished)
    for hard in (1.0, 1e3, 1e-3):
        steps.clear()
        answer = pair(IterativeSolver, hard).solve(1e-9)
        ((status, made, iterations),) = steps
        assert status is coulomb.Status.CONVERGED and made == 0 and 0 < iterations <= 60
        exact = pair(DirectSolver, hard).solve(1e-11)
        size = COMM.allreduce(np.max(np.abs(exact.displacement), initial=0.0), MPI.MAX)
        assert answer.certificate.passed and np.allclose(answer.displacement, exact.displacement, 0.0, 1e-7 * size)


@pytest.mark.parametrize("name", POSED)
def test_as_by_factors_in_few_cycles(name, monkeypatch):
    """Forward and adjoint; without springs the sheet is refused as singular after 1000 cycles a system.  Half of the
    inputs follow from the others, as forces are in proportion to all loads, and to all stiffnesses and lengths."""
    cycles, applied, totals, (posed, tolerance, most) = [], CoupledKrylov._preconditioned, [], POSED[name]

    def counted(self, v):
        cycles.append(self._body.sprung)
        return applied(self, v)

    monkeypatch.setattr(CoupledKrylov, "_preconditioned", counted)
    for solver in (DirectSolver, IterativeSolver):
        answer = posed(solver).solve(tolerance)
        cycles.clear()
        found = answer.sensitivities()
        assert cycles and all(sprung == (solver is IterativeSolver) for sprung in cycles)
        assert len(cycles) <= most * len(found)
        totals.append([next(iter(one.totals.values()))["force"] for one in found])
        height = answer.displacement * [0.0, 0.0, 1.0]
        gradient, friction = answer.gradient(displacement=height), found[0]
        assert friction.name.startswith("friction")
        along = COMM.allreduce(float(np.vdot(height, friction.displacement)))
        owed = COMM.allreduce(0.3 * float(np.sum(gradient.friction)))
        assert along == pytest.approx(owed, rel=1e-7)
    assert np.allclose(*totals, rtol=0.0, atol=1e4 * tolerance * np.max(np.abs(totals)))
