"""Condensed Newton systems: steps against dense ones, answers against the default's, memory."""

import functools

import numpy as np
import pytest
from conftest import make_block, reference, solved_block

from coulomb import InteriorPoint, SuccessiveTresca
from coulomb.case.case import Case
from coulomb.solvers import CondensedSystem, DenseSystem, DirectSolver, IterativeSolver
from coulomb.solvers.friction_problem import FrictionProblem
from coulomb.solvers.interior_point import newton_step
from coulomb.solvers.newton_systems import NewtonEquations
from coulomb.solvers.scaled_problem import Iterate, ScaledProblem

MULTIGRID = {"linear_solver": IterativeSolver, "explicit": False}


def friction(x):
    """A coefficient that is 0 at some nodes."""
    return np.where(x[0] > 2.4, 0.0, 0.3 + 0.2 * x[1])


@functools.cache
def body():
    """The block with the factorised K, but without A: A x is exact, and y is inexact only on request."""
    return make_block(2, friction, linear_solver=DirectSolver, explicit=False)


EXACT = CondensedSystem(loose=1e-14, tight=1e-14, contrast=1e-13)
"""Steps as exact as rounding allows, springs as stiff as they are."""


def lagging(system, x):
    """An image of x by y = 0.7 K^-1 (B^T x - f): A x has an error of three tenths of A x - B K^-1 f, which is in R."""
    system.products.first(x, 0.0)
    system.products.y.scale(0.7)
    return system.products._image(x)


def B_u(A, u):
    v, image = A.B.createVecs()
    v.array[:] = u
    A.B.mult(v, image)
    return image.array


def close(values, expected, accuracy=1e-8):
    return np.abs(values - expected).max() <= accuracy * np.abs(expected).max()


def test_cone_step_is_the_dense_step():
    """From an inexact y, the step equals that of the dense system with the exact A x; y + w is exact afterwards."""
    rng = np.random.default_rng(81)
    body().linear.prepare_products()  # y is kept without the displacement of the load
    scaled = ScaledProblem(body().friction_problem)
    m, f = scaled.nodes, scaled.frictional
    assert 0 < f.sum() < m
    angle = rng.uniform(0.0, 6.28, m)
    y = (f * rng.uniform(0.0, 0.99, m))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    x_n, nu = 10.0 ** rng.uniform(-1, 1, m), 10.0 ** rng.uniform(-2, 1, (m, 2))
    x, target = scaled.forces(x_n, y), 0.3
    dense, system = (kind.system(scaled.A, scaled.sloped) for kind in (DenseSystem(), EXACT))
    v = Iterate(x_n, y, nu, scaled.A.mult(x))
    image = lagging(system, x)
    free = scaled.A.image(B_u(scaled.A.A, body().linear.free_displacement.ravel()))
    assert close(image - free, 0.7 * (v.A_x - free)) and system.products.R.norm() > 0.01 * scaled.A.s
    expected = newton_step(scaled, dense, v, target, 1e-12, 1.0)
    late = v._replace(A_x=image)
    step = newton_step(scaled, system, late, target, 1e-12, 1.0)
    for name in ("dx_n", "dy", "dnu"):
        assert close(getattr(step, name), getattr(expected, name))
    dx = np.column_stack([step.dx_n, scaled.linearize(v).r[:, None] * step.dy])
    dx[:, 1:] += (scaled.law.slope(step.dx_n) * step.dx_n)[:, None] * y
    assert not dx[~f, 1:].any()
    carried = system.products.advance(x + dx, None, 1.0, 0.0)
    assert close(carried, scaled.A.mult(x + dx)) and system.products.R.norm() < 1e-9 * scaled.A.s
    assert close(carried, image + step.A_dx)
    half = x + dx
    half[:, 0] *= 1.5  # a deformation: in R and in the exact product, not in the incremental A x
    bent = system.products.advance(half, None, 0.0, 0.0)
    assert close(bent, carried) and system.products.R.norm() > 1e-3 * scaled.A.s
    assert close(system.products.exact(half), scaled.A.mult(half))
    system.destroy()


@pytest.mark.parametrize(("p", "law"), [(6, "0.3"), (4, "1.5"), (4, "tresca")])
def test_whole_answers(p, law):
    """Those of the method on the factorised body, in as many steps, and no product by A in any of them.

    The springs grow without bound as theta goes to 0; the iterations do not.  C^-1 by differences would lose dnu where
    a node slips, D22 -> 0: the gradient would stay at 1e-6.
    """
    tresca = law == "tresca"
    friction = None if tresca else float(law)
    known = make_block(p, friction, slip_stress=1e7 if tresca else None).solve(solver=InteriorPoint(1e-9))
    solver = InteriorPoint(1e-9, newton=CondensedSystem())
    problem = make_block(p, friction, slip_stress=1e7 if tresca else None, **MULTIGRID)
    solution = problem.solve(solver=solver)
    assert solution.certificate.passed and solution.result.residual <= 1e-8
    assert np.linalg.norm(solution.contact_force - known.contact_force) <= 1e-7 * np.linalg.norm(known.contact_force)
    history = solution.result.history
    assert len(history) <= len(known.result.history) + 3
    assert max(step.krylov for step in history) <= 25 and np.mean([step.krylov for step in history]) <= 15
    assert history[-1].theta < 1e-8 * history[0].theta and history[-1].gradient <= 1e-8 * history[0].gradient
    assert solution.result.products <= 8 + 9  # for diagonal and scale of A, exact ones near the end; those of the start
    if p == 6:
        totals, _ = reference(6, "coulomb")
        assert solution.contact_force[0::3].sum() == pytest.approx(totals["total_normal_force_N"], rel=1e-6)


def test_successive_tresca_without_friction_somewhere():
    problem = make_block(3, friction, **MULTIGRID)
    known = make_block(3, friction).solve(1e-9)
    for solver in (
        InteriorPoint(1e-8, newton=CondensedSystem()),
        SuccessiveTresca(1e-8, InteriorPoint(newton=CondensedSystem())),
    ):
        solution = problem.solve(solver=solver)
        assert solution.certificate.passed
        difference = np.linalg.norm(solution.contact_force - known.contact_force)
        assert difference <= 1e-6 * np.linalg.norm(known.contact_force)


def test_a_compliance_without_stiffness_is_refused():
    block = solved_block(6).problem
    with pytest.raises(ValueError, match=r"explicit compliance does not keep: use ContactProblem\(.*explicit=False"):
        InteriorPoint(newton=CondensedSystem()).solve(block.friction_problem)
    with pytest.raises(ValueError, match="explicit=False"):
        InteriorPoint(newton=CondensedSystem()).solve(block.tresca(np.full(len(block.surface.nodes), 1e4)))


def test_memory_of_condensed_systems():
    """K's nonzeros once more, and vectors: nothing of m x m."""
    problem = make_block(4, **MULTIGRID)
    scaled = ScaledProblem(FrictionProblem.coulomb(problem.A, problem.b, problem.law.friction))
    system, m = CondensedSystem().system(scaled.A, True), scaled.nodes
    K = problem.elasticity.K
    system.products.first(np.ones((m, 3)), 0.1)
    v = Iterate(np.ones(m), np.zeros((m, 2)), np.ones((m, 2)), np.zeros((m, 3)))
    r = np.ones((m, 3))
    system.solve(NewtonEquations(scaled.linearize(v), r, np.zeros((m, 2)), r, 0.1, np.inf))
    assert system._stiffened.getInfo()["nz_used"] == K.getInfo()["nz_used"]
    arrays = [value for value in vars(system).values() if isinstance(value, np.ndarray)]
    assert arrays and max(array.size for array in arrays) == 9 * m
    system.destroy()


def test_case_file():
    tables = {
        "mesh": {"box": (3.0, 1.0, 1.0), "cells": (6, 2, 2)},
        "material": {"young": 2.1e11, "poisson": 0.3},
        "clamp": [{"face": "left"}],
        "traction": [{"face": "top", "value": (0.0, 1e7, -4e7)}],
        "contact": {"face": "bottom", "friction": 0.3},
        "solver": {"newton": "condensed"},
    }
    case = Case.model_validate(tables)
    solver = case.contact_solver()
    assert isinstance(solver, InteriorPoint) and solver.newton == CondensedSystem()
    problem = case.problem()
    assert problem.solve(solver=solver).certificate.passed
    assert problem.A.name == "matrix-free" and isinstance(problem.body.stiffness.solver, IterativeSolver)
    tables["contact"] = {"face": "bottom", "slip_stress": 1e7}
    assert Case.model_validate(tables).contact_solver().newton == CondensedSystem()
    tables["solver"]["compliance"] = "explicit"
    with pytest.raises(ValueError, match='leave compliance at "auto"'):
        Case.model_validate(tables)
