"""The interior-point method where friction grows with pressure: its Newton system, its steps, its answers."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import dense_compliance, make_block, random_spd, solved_block
from mpi4py import MPI

from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca
from coulomb.fem.contact.surface import interpolated_forces
from coulomb.linalg.compliance.low_rank import LowRankUpdate
from coulomb.solvers import (
    KPRGP,
    AugmentedSystem,
    Automatic,
    DenseSystem,
    FrictionLaw,
    FrictionProblem,
    SchurComplementSystem,
)
from coulomb.solvers.interior_point import newton_step
from coulomb.solvers.linearization import NodalInverse
from coulomb.solvers.newton_systems import NewtonEquations, augmented_matrix
from coulomb.solvers.scaled_problem import Iterate, ScaledProblem

NODES = 7


@pytest.fixture
def scaled():
    """A random problem with a node without friction, and an iterate inside."""
    rng = np.random.default_rng(71)
    A = 1e-9 * random_spd(3 * NODES, 1e3, rng)
    friction = rng.uniform(0.1, 1.5, NODES)
    friction[2] = friction[5] = 0.0
    cohesion = np.array([0.0, 0.0, 0.0, 1e5, 2e5, 1e5, 0.0])  # none, Tresca's, Coulomb's and both
    b = 1e-4 * rng.standard_normal(3 * NODES)
    problem = FrictionProblem(dense_compliance(A), b, FrictionLaw(cohesion, friction))
    scaled = ScaledProblem(problem)
    angle = rng.uniform(0.0, 6.28, NODES)
    y = rng.uniform(0.0, 0.99, NODES)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    y[2] = 0.0
    x_n, nu = 10.0 ** rng.uniform(-1, 1, NODES), 10.0 ** rng.uniform(-2, 1, (NODES, 2))
    return scaled, Iterate(x_n, y, nu, scaled.A.mult(scaled.forces(x_n, y)))


def test_newton_direction_against_differences(scaled):
    """Along the step every equation changes as linearised, compared with finite differences for the cone."""
    scaled, v = scaled
    target = 0.1 * scaled.theta(v.nu, scaled.slack(v.x_n, v.y))
    newton = DenseSystem().system(scaled.A, True)
    step = newton_step(scaled, newton, v, target, 1e-12, 1.0)
    e, f = 1e-6, scaled.frictional

    def equations(v):
        z = scaled.slack(v.x_n, v.y)
        fresh = v._replace(A_x=scaled.A.mult(scaled.forces(v.x_n, v.y)))
        return scaled.gradient(fresh), np.where(np.column_stack([f | True, f]), v.nu * z - target, 0.0)

    (r, c), (r_plus, c_plus), (r_minus, c_minus) = (equations(step.at(t)) for t in (0.0, e, -e))
    scale = np.abs(r).max()
    assert np.allclose((r_plus - r_minus) / (2 * e), -r, atol=1e-6 * scale)
    assert np.allclose((c_plus - c_minus) / (2 * e), -c, atol=1e-6 * np.abs(c).max())
    ends = (step.at(t) for t in (1e-2, 1e-3))
    errors = [np.abs(end.A_x - scaled.A.mult(scaled.forces(end.x_n, end.y))).max() for end in ends]
    assert errors[0] > 0.0 and errors[1] == pytest.approx(1e-2 * errors[0], rel=1e-3)  # A x to first order


def schur_matrix(A, at):
    """J_SC = J11 + J12 D22^-1 J21, dense, from J_AM."""
    J, n = augmented_matrix(A, at), 3 * NODES
    return J[:n, :n] - J[:n, n:] @ np.linalg.solve(J[n:, n:], J[n:, :n])


def test_both_systems_solve_the_same(scaled):
    scaled, v = scaled
    at, rng = scaled.linearize(v), np.random.default_rng(72)
    r1, r2 = rng.standard_normal((NODES, 3)), rng.standard_normal((NODES, 2)) * np.minimum(at.D22, 1.0)
    r1[2, 1:] = r2[2, 1] = 0.0
    systems = [kind.system(scaled.A, True) for kind in (DenseSystem(), SchurComplementSystem())]
    dense, krylov = (s.solve(NewtonEquations(at, r1, r2, scaled.weight(v.x_n), 1e-13, np.inf)) for s in systems)
    for name in ("dx", "dnu", "A_dx"):
        value, other = getattr(dense, name), getattr(krylov, name)
        assert np.allclose(other, value, rtol=1e-7, atol=1e-9 * np.abs(value).max())
    A = np.array([scaled.A.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * NODES)]).T
    rhs = r1 + at.J12(r2 / at.D22)
    assert np.allclose(schur_matrix(A, at) @ dense.dx.ravel(), rhs.ravel(), atol=1e-8)
    for system in systems:
        system.destroy()


def test_tolerances_are_of_weighted_rows(scaled):
    """|W residual| <= tolerance |W rhs|, and below the cap."""
    scaled, v = scaled
    at, r1 = scaled.linearize(v), np.random.default_rng(74).standard_normal((NODES, 3))
    r1[2, 1:] = 0.0
    W, r2 = np.ones((NODES, 3)), np.zeros((NODES, 2))
    W[:, 1:] = 10.0 ** np.random.default_rng(75).uniform(-3, 0, NODES)[:, None]
    A = np.array([scaled.A.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * NODES)]).T
    M = schur_matrix(A, at)
    for tolerance, cap in ((1e-3, np.inf), (1e-1, 1e-4)):
        system = SchurComplementSystem(rank=0).system(scaled.A, True)
        step = system.solve(NewtonEquations(at, r1, r2, W, tolerance, cap))
        left = np.linalg.norm(W * (r1 - (M @ step.dx.ravel()).reshape(NODES, 3)))
        aim = min(tolerance * np.linalg.norm(W * r1), cap)
        assert 1e-4 * aim <= left <= (1 + 1e-9) * aim  # as accurate as required, and not much more
        system.destroy()


def test_preconditioner_is_the_inverse_it_claims_to_be(scaled):
    """P = rest(A) + nodal part of J_SC - V V^T + U U^T."""
    scaled, v = scaled
    at = scaled.linearize(v)
    newton = SchurComplementSystem().system(scaled.A, True)
    rhs = np.random.default_rng(73).standard_normal((NODES, 3))
    rhs[2, 1:] = 0.0
    newton.solve(NewtonEquations(at, rhs, np.zeros((NODES, 2)), np.ones((NODES, 3)), 1e-3, np.inf))
    columns, signs = newton._A.nodal_columns(3, np.arange(NODES) != 2), newton._A.signs
    apply = LowRankUpdate(MPI.COMM_SELF, NodalInverse(at, newton._A.rest), columns, signs)
    approximation = np.diag(newton._A.rest.ravel()) + newton._A.columns @ np.diag(signs) @ newton._A.columns.T
    P = schur_matrix(approximation, at)
    assert columns.shape[2] > 6
    assert np.allclose(P @ apply(rhs).ravel(), rhs.ravel(), atol=1e-8)
    x = np.random.default_rng(76).standard_normal((NODES, 3))
    assert np.allclose(newton._A.mult(x).ravel(), approximation @ x.ravel())
    newton.destroy()


def test_augmented_system_is_refused(scaled):
    scaled, _ = scaled
    with pytest.raises(ValueError, match=r"J_AM with P_AM is for given slip bounds.*SuccessiveTresca"):
        AugmentedSystem().system(scaled.A, True)


@pytest.mark.parametrize("friction", [0.1, 1.5])
def test_steps_and_answers_on_the_block(friction):
    """At most 30 Newton steps from a cold start to 1e-8, and the forces of successive Tresca (p = 16: benchmark)."""
    block = solved_block(6).problem
    problem = FrictionProblem.coulomb(block.A, block.b, np.full(len(block.surface.nodes), friction))
    fixed = SuccessiveTresca(1e-9).solve(problem)
    one = InteriorPoint(1e-8).solve(problem)
    dense = InteriorPoint(1e-8, newton=DenseSystem()).solve(problem)
    for result in (one, dense):
        assert result.newton_steps <= 30
        assert problem.residual(result.x) <= 1e-8
        assert np.linalg.norm(result.x - fixed.x) <= 1e-7 * np.linalg.norm(fixed.x)
    assert one.products <= 0.7 * fixed.products
    assert max(step.krylov for step in one.history) <= 20


def test_krylov_iterations_stay_bounded_to_the_end():
    """The nodal blocks grow without bound as theta goes to 0; the iterations do not.

    Where both a multiplier and its bound are nearly 0 the residual goes with the root of theta, to 2e-10 to 5e-10 with
    theta at rounding errors."""
    history = InteriorPoint(1e-9).solve(solved_block(10).problem.friction_problem).history
    assert sum(step.residual > 1e-8 for step in history) < 30
    assert history[-1].theta < 1e-9 * history[0].theta
    assert max(step.krylov for step in history[-8:]) <= 8


def test_auto_takes_no_other_method_at_rounding_errors(monkeypatch):
    """Successive Tresca problems are solved by the same method, and end at the same residual, after minutes."""
    problem = solved_block(4).problem.friction_problem
    near = replace(InteriorPoint().solve(problem), status=Status.STAGNATED, residual=4e-11)

    class Ends(InteriorPoint):
        def solve(self, problem, start=None, *, gradient=None, progress=None):
            raise NotConverged("at rounding errors", near)

    monkeypatch.setattr("coulomb.solvers.automatic.InteriorPoint", Ends)
    monkeypatch.setattr(SuccessiveTresca, "solve", None)
    with pytest.raises(NotConverged) as failure:
        Automatic(1e-11).solve(problem)
    assert failure.value.result.residual == 4e-11


def test_auto_falls_back(monkeypatch):
    problem = solved_block(4).problem.friction_problem
    failing = InteriorPoint(max_iterations=3)

    class Short(InteriorPoint):
        def solve(self, problem, start=None, *, gradient=None, progress=None):
            return failing.solve(problem, progress=progress)

    class Short12(InteriorPoint):
        def solve(self, problem, start=None, *, gradient=None, progress=None):
            return InteriorPoint(max_iterations=12).solve(problem, progress=progress)

    monkeypatch.setattr("coulomb.solvers.automatic.InteriorPoint", Short)
    result = Automatic(1e-8).solve(problem)
    assert result.method == "auto: successive Tresca, after the interior point method had max_iterations"
    assert result.residual <= 1e-8
    spent = SuccessiveTresca(1e-8).solve(problem).products
    assert result.products > spent  # the products of the first solver are counted
    monkeypatch.setattr("coulomb.solvers.automatic.SuccessiveTresca", lambda: SuccessiveTresca(1e-8, max_iterations=1))
    monkeypatch.setattr("coulomb.solvers.automatic.InteriorPoint", Short12)
    with pytest.raises(
        NotConverged, match=r"interior-point method ended with .*  Then successive Tresca ended with"
    ) as failure:
        Automatic(1e-8).solve(problem)
    assert failure.value.result.status is Status.MAX_ITERATIONS
    assert failure.value.result.method == "auto: interior point, the better of both"


def test_failure_reports_why_and_carries_the_answer():
    problem = solved_block(6).problem.friction_problem
    with pytest.raises(
        NotConverged, match=r"interior-point method ended with a residual of .* last residuals"
    ) as failure:
        InteriorPoint(max_iterations=4).solve(problem)
    result = failure.value.result
    assert result.status is Status.MAX_ITERATIONS and result.residual > 1e-8
    assert problem.residual(result.x) == pytest.approx(result.residual)
    assert len(result.history) == result.newton_steps == 12  # three starts of four steps


def test_unsupported_laws_are_named():
    with pytest.raises(ValueError, match=r"KPRGP solves problems with given slip bounds.*SuccessiveTresca\(qp_solver="):
        make_block(2).solve(solver=KPRGP())


def test_start_from_a_coarser_mesh():
    """Forces of half the resolution: the same answer, in no more steps; random starting forces change nothing."""
    coarse, fine = solved_block(3), solved_block(6)
    start = interpolated_forces(coarse.contact_force, coarse.problem.surface, fine.problem.surface)
    assert np.linalg.norm(start - fine.contact_force) <= 0.15 * np.linalg.norm(fine.contact_force)
    problem = fine.problem.friction_problem
    cold, warm = InteriorPoint(1e-8).solve(problem), InteriorPoint(1e-8).solve(problem, start=start)
    even = InteriorPoint(1e-8, start_products=0, starts=(0.1,)).solve(problem)
    for other in (warm, even):
        assert np.linalg.norm(other.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)
    assert max(warm.newton_steps, cold.newton_steps) < even.newton_steps
    nonsense = 1e3 * np.random.default_rng(1).standard_normal(len(start)) * np.abs(start).max()
    for solver in (InteriorPoint(1e-8), SuccessiveTresca(1e-8)):
        result = solver.solve(problem, start=nonsense)
        assert np.linalg.norm(result.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)


def test_a_path_without_room_to_its_bounds_ends(monkeypatch):
    """As from a start that rounding errors have put onto them: PETSc refused a tolerance that was nan."""
    monkeypatch.setattr(ScaledProblem, "theta", lambda self, nu, z: np.nan)
    with pytest.raises(NotConverged) as failure:
        make_block(4).solve(solver=InteriorPoint())
    assert failure.value.result.status is Status.STAGNATED
