"""Factors in single precision: accuracy of solves and products, their counts, and where they are not good enough."""

import os
import subprocess
import sys

import numpy as np
import pytest
from conftest import make_block

from benchmarks.block import block
from coulomb import Clamp, Contact, ContactProblem, Material, Spring, Traction, box
from coulomb.linalg.compliance.schur_compliance import SchurCompliance
from coulomb.linalg.factors import multifrontal
from coulomb.linalg.factors.multifrontal import MultifrontalSolver, predicted_work, symbolic


def solver_of(problem, single=True):
    return MultifrontalSolver(problem.elasticity.K, problem.elasticity.x, np.sort(problem.surface.nodes), single)


def residual(K, rhs, u):
    """Relative to |D u| with D = diag(K), in the norm of D^-1/2."""
    root = np.sqrt(K.getDiagonal().array)
    return np.linalg.norm((K * u - rhs).array / root) / np.linalg.norm(u.array * root)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_as_accurate_as_double_precision(cell, degree):
    problem = block(2, cell=cell, degree=degree)
    K, single, double = problem.elasticity.K, solver_of(problem), solver_of(problem, single=False)
    assert "single" in single.name and "single" not in double.name
    assert single.schur_factors[0].dtype == np.float32
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng(4).standard_normal(rhs.getSize())
    errors = []
    for solver in (single, double):
        solver.solve(rhs, u)
        errors.append(residual(K, rhs, u))
    assert errors[0] <= 2.0 * errors[1] + np.finfo(float).eps
    assert 2 <= single.refinements <= 4 and double.refinements == 0
    assert 1e-8 < single.error < 1e-2 and double.error == 0.0


def test_where_single_precision_does_not_suffice():
    """A body on soft springs and nearly incompressible: refinement would be slow, or a pivot fails."""
    for stiffness, poisson in ((1e3, 0.3), (1e10, 0.49999999)):
        problem = ContactProblem(
            box((1.0, 1.0, 1.0), (3, 3, 3), "tetrahedron"),
            Material(2e11, poisson),
            [],
            make_block(1).contacts[0],
            [Traction("top", (0.0, 0.0, -1e4))],
            springs=[Spring("top", stiffness)],
        )
        K, solver = problem.elasticity.K, solver_of(problem)
        rhs, u = K.createVecs()
        rhs.array[:] = np.random.default_rng(4).standard_normal(rhs.getSize())
        solver.solve(rhs, u)
        assert not solver.single and "single" not in solver.name
        assert residual(K, rhs, u) <= 4.0 * np.finfo(float).eps


def test_products_are_as_accurate_as_asked_for():
    """A sequence that converges, as that of the iterates: few solves with K, which a dense A confirms."""
    problem = block(3)
    B, solver = problem.surface.free_B, solver_of(problem)
    dense = SchurCompliance(B, solver_of(problem, single=False)).dense()
    A = SchurCompliance(B, solver)
    assert not A.exact
    random = np.random.default_rng(5)
    limit, away = random.standard_normal((2, len(dense)))
    before, y = np.zeros(len(dense)), np.empty(len(dense))
    for step in range(16):
        x = limit + 0.3**step * away
        A.mult_incremental(x, y, 0.03)
        assert np.linalg.norm(y - dense @ x) <= 0.15 * np.linalg.norm(dense @ (x - before)), step  # a bound of forces
        before = x
    assert 3 <= solver.refinements <= 14 and A.products == 16
    A.mult_incremental(x, y)
    assert np.linalg.norm(y - dense @ x) <= 1e-12 * np.linalg.norm(y)
    spent = solver.refinements
    A.mult(away, y, 0.01)
    assert solver.refinements == spent
    assert np.linalg.norm(y - dense @ away) <= 1e-4 * np.linalg.norm(y)
    A.mult(away, y, 1e-9)
    assert solver.refinements - spent == 2
    assert np.linalg.norm(y - dense @ away) <= 1e-8 * np.linalg.norm(y)
    assert np.allclose(A.diagonal(), np.diag(dense), rtol=1e-4)


def test_many_accurate_products_are_made_in_double_precision():
    problem = block(2)
    solver = solver_of(problem)
    A = SchurCompliance(problem.surface.free_B, solver)
    x, y = np.ones(3 * A.nodes), np.empty(3 * A.nodes)
    for _ in range(20):
        A.mult(x, y)
    assert not A.exact
    A.mult(x, y)
    assert A.exact
    assert np.linalg.norm(y - A.dense() @ x) <= 1e-12 * np.linalg.norm(y)


def test_a_slender_body_is_factorised_in_double_precision_before_the_first_step():
    """Single precision is judged under contact forces: given up in the course of a solution, it would change A."""
    problem = ContactProblem(
        box((20.0, 1.0, 1.0), (40, 2, 2)),
        Material(2e11, 0.3),
        [Clamp("left")],
        Contact("bottom", friction=0.3),
        [Traction("right", (1e6, 0.0, 0.0))],
    )
    solver = solver_of(problem)
    assert solver.single
    assert SchurCompliance(problem.surface.free_B, solver).exact
    stocky = solver_of(block(3))
    assert not SchurCompliance(block(3).surface.free_B, stocky).exact


def test_the_same_answer(monkeypatch):
    answers = []
    for at_least in (0.0, np.inf):
        monkeypatch.setattr(multifrontal, "SINGLE_FROM", at_least)
        solution = block(4).solve(1e-9)
        answers.append(solution.contact_force)
        assert solution.certificate.passed and solution.result.newton_steps <= 25
        assert ("single" in solution.problem.body.stiffness.solver.name) == (at_least == 0.0)
    assert np.linalg.norm(answers[0] - answers[1]) <= 1e-8 * np.linalg.norm(answers[1])


def test_predicted_work():
    """Operations of a dense Cholesky factorisation, if there is one front; bytes of what is allocated."""
    problem = block(4)
    K, x = problem.elasticity.K, problem.elasticity.x
    n = 3.0 * len(x)
    one = predicted_work(symbolic(K, x, np.arange(len(x))))
    assert one.operations == pytest.approx(n**3 / 3) and one.bytes == 4.0 * n**2
    several = predicted_work(symbolic(K, x, np.sort(problem.surface.nodes)))
    assert several.operations < one.operations and several.bytes < one.bytes


def test_inverses_of_odd_size_with_the_kernels_for_processors_that_the_library_does_not_know():
    """OpenBLAS 0.3.21 takes them on processors newer than itself; its strtri ends there in a segmentation fault."""
    script = """
import numpy as np
from coulomb.linalg.factors import inverse_factor, inverse_of
L = np.asfortranarray(np.tril(np.random.default_rng(1).random((303, 303))) + 99.0 * np.eye(303), dtype=np.float32)
for i in range(0, 303, 3):
    L[i, i + 1 : i + 3] = L[i + 1, i + 2] = 0.0
inverse = inverse_factor(L)
assert inverse.dtype == np.float32
assert np.max(np.abs(inverse @ L - np.eye(303))) < 1e-5
whole = inverse_of(L)
assert whole.dtype == np.float32
assert np.max(np.abs(whole @ (L @ L.T) - np.eye(303))) < 1e-5
"""
    environment = os.environ | {"OPENBLAS_CORETYPE": "Prescott"}
    subprocess.run([sys.executable, "-c", script], check=True, env=environment)
