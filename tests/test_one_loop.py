"""Coulomb friction in one path-following loop: its Newton system, its steps, its answers."""

import numpy as np
import pytest
from conftest import dense_compliance, make_block, random_spd, reference, solved_block
from mpi4py import MPI

from coulomb import (
    KPRGP,
    Automatic,
    DenseConeSystem,
    FrictionLaw,
    FrictionProblem,
    KrylovConeSystem,
    NotConverged,
    OneLoop,
    PathFollowing,
    Status,
    SuccessiveTresca,
)
from coulomb.fem.surface import interpolated_forces
from coulomb.linalg.recycling import LowRankUpdate
from coulomb.solvers.cone import ConeIterate, ScaledCoulomb
from coulomb.solvers.cone_systems import cone_matrix

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
    scaled = ScaledCoulomb(problem)
    angle = rng.uniform(0.0, 6.28, NODES)
    y = rng.uniform(0.0, 0.99, NODES)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    y[2] = 0.0
    x_n, nu = 10.0 ** rng.uniform(-1, 1, NODES), 10.0 ** rng.uniform(-2, 1, (NODES, 2))
    return scaled, ConeIterate(x_n, y, nu, scaled.A.mult(scaled.forces(x_n, y)))


def test_newton_direction_against_differences(scaled):
    """Along the step every equation changes as Newton's method demands, the cone's by finite differences."""
    scaled, v = scaled
    target = 0.1 * scaled.theta(v.nu, scaled.slack(v.x_n, v.y))
    newton = DenseConeSystem(scaled.A)
    step = OneLoop()._newton_step(scaled, newton, v, scaled.slack(v.x_n, v.y), target, 1e-12, 1.0)
    e, f = 1e-6, scaled.frictional

    def equations(v):
        z = scaled.slack(v.x_n, v.y)
        fresh = v._replace(A_x=scaled.A.mult(scaled.forces(v.x_n, v.y)))
        return scaled.gradient(fresh), np.where(np.column_stack([f | True, f]), v.nu * z - target, 0.0)

    (r, c), (r_plus, c_plus), (r_minus, c_minus) = (equations(step.at(t)) for t in (0.0, e, -e))
    scale = np.abs(r).max()
    assert np.allclose((r_plus - r_minus) / (2 * e), -r, atol=1e-6 * scale)
    assert np.allclose((c_plus - c_minus) / (2 * e), -c, atol=1e-6 * np.abs(c).max())
    end = step.at(min(0.7, 0.99 * scaled.distance_to_boundary(v, step.dx_n, step.dy, step.dnu)))
    assert np.abs(end.A_x - scaled.A.mult(scaled.forces(end.x_n, end.y))).max() <= 1e-12 * np.abs(end.A_x).max()
    assert np.abs(step.A_bend).max() > 1e-3 * np.abs(step.A_dx).max()


def test_both_systems_solve_the_same(scaled):
    scaled, v = scaled
    at = scaled.linearize(v)
    rhs = np.random.default_rng(72).standard_normal((NODES, 3))
    rhs[2, 1:] = 0.0
    systems = [kind(scaled.A) for kind in (DenseConeSystem, KrylovConeSystem)]
    dense, krylov = (s.solve(at, rhs, scaled.weight(v.x_n), 1e-13, np.inf) for s in systems)
    assert np.allclose(krylov.dx, dense.dx, rtol=1e-7, atol=1e-9 * np.abs(dense.dx).max())
    assert np.allclose(krylov.A_dx, dense.A_dx, rtol=1e-7, atol=1e-9 * np.abs(dense.A_dx).max())
    A = np.array([scaled.A.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * NODES)]).T
    assert np.allclose(cone_matrix(A, at) @ dense.dx.ravel(), rhs.ravel(), atol=1e-8)
    for system in systems:
        system.destroy()


def test_preconditioner_is_the_inverse_it_claims_to_be(scaled):
    """P = rest(A) + C + U U^T, and with that P for A the system is solved in one iteration."""
    scaled, v = scaled
    at = scaled.linearize(v)
    newton = KrylovConeSystem(scaled.A)
    rhs = np.random.default_rng(73).standard_normal((NODES, 3))
    rhs[2, 1:] = 0.0
    newton.solve(at, rhs, np.ones((NODES, 3)), 1e-3, np.inf)
    U = newton._A.nodal_U(3)
    U[2, 1:] = 0.0
    newton._D = newton._A.rest + np.column_stack([np.zeros(NODES), at.h, at.h])
    newton._S = at.D22[:, 1] + np.sum(at.y**2 / newton._D[:, 1:], axis=1)
    apply = LowRankUpdate(MPI.COMM_SELF, newton._nodal_inverse, U)
    P = cone_matrix(np.diag(newton._A.rest.ravel()) + newton._A.U @ newton._A.U.T, at)
    assert U.shape[2] > 3
    assert np.allclose(P @ apply(rhs).ravel(), rhs.ravel(), atol=1e-8)
    newton.destroy()


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.8, 1.5])
@pytest.mark.parametrize("p", [6, 10])
def test_steps_and_answers_on_the_block(p, friction):
    """At most 30 Newton steps from a cold start to 1e-8, and the forces of successive Tresca (p = 16: benchmark)."""
    block = solved_block(p).problem
    problem = FrictionProblem.coulomb(block.A, block.b, np.full(len(block.surface.nodes), friction))
    fixed = SuccessiveTresca(1e-9).solve(problem)
    one = OneLoop(1e-8).solve(problem)
    dense = OneLoop(1e-8, newton=DenseConeSystem).solve(problem) if p == 6 else one
    for result in (one, dense):
        assert result.path_following <= 30
        assert problem.residual(result.x) <= 1e-8
        assert np.linalg.norm(result.x - fixed.x) <= 1e-7 * np.linalg.norm(fixed.x)
    assert one.products <= 0.7 * fixed.products
    assert max(step.krylov for step in one.history) <= 20


def test_against_the_independent_solver():
    totals, _ = reference(10, "coulomb")
    result = OneLoop(1e-8).solve(solved_block(10).problem.friction_problem)
    assert result.x[0::3].sum() == pytest.approx(totals["total_normal_force_N"], rel=1e-6)


def test_krylov_iterations_stay_bounded_to_the_end():
    """The nodal blocks grow without bound as theta goes to 0; the iterations do not."""
    history = OneLoop(1e-10).solve(solved_block(10).problem.friction_problem).history
    assert history[-1].theta < 1e-9 * history[0].theta
    assert max(step.krylov for step in history[-8:]) <= 8


def test_accepted_iterates_decrease_theta_and_the_residual_decides():
    result = OneLoop(1e-8).solve(solved_block(6).problem.friction_problem)
    thetas = [step.theta for step in result.history]
    for before, after, step in zip(thetas, thetas[1:], result.history[1:], strict=False):
        assert after <= (1.0 - step.alpha * 1e-2 * (1.0 - step.sigma)) * before * (1 + 1e-12)
    assert result.history[-1].residual <= 1e-8 < result.history[-2].residual
    assert [step.iteration for step in result.history] == list(range(1, result.path_following + 1))


def test_units_do_not_matter():
    block = solved_block(6).problem
    A = np.array(block.A.dense())
    counts = []
    for force, length in ((1.0, 1.0), (1e-3, 1e3), (1e6, 1e-6)):
        problem = FrictionProblem.coulomb(dense_compliance(A * length / force), block.b * length, block.law.friction)
        result = OneLoop().solve(problem)
        counts.append(result.path_following)
        assert np.linalg.norm(result.x / force - solved_block(6).contact_force) <= 1e-6 * np.linalg.norm(
            solved_block(6).contact_force
        )
    assert max(counts) - min(counts) <= 1


def test_auto_says_what_it_chose():
    result = Automatic(1e-8).solve(solved_block(6).problem.friction_problem)
    assert result.method == "auto: one loop" and result.iterations == 0


def test_auto_falls_back(monkeypatch):
    problem = solved_block(6).problem.friction_problem
    failing = OneLoop(max_iterations=3)

    class Short(OneLoop):
        def solve(self, problem, *, start=None, progress=None):
            return failing.solve(problem, progress=progress)

    class Short12(OneLoop):
        def solve(self, problem, *, start=None, progress=None):
            return OneLoop(max_iterations=12).solve(problem, progress=progress)

    monkeypatch.setattr("coulomb.solvers.automatic.OneLoop", Short)
    result = Automatic(1e-8).solve(problem)
    assert result.method == "auto: successive Tresca, after the one loop had max_iterations"
    assert result.residual <= 1e-8
    spent = SuccessiveTresca(1e-8).solve(problem).products
    assert result.products > spent  # what the one loop spent is counted
    monkeypatch.setattr(
        "coulomb.solvers.automatic.SuccessiveTresca", lambda tolerance: SuccessiveTresca(1e-8, max_iterations=1)
    )
    monkeypatch.setattr("coulomb.solvers.automatic.OneLoop", Short12)
    with pytest.raises(NotConverged, match=r"one loop ended with .*  Then successive Tresca ended with") as failure:
        Automatic(1e-8).solve(problem)
    assert failure.value.result.status is Status.MAX_ITERATIONS
    assert failure.value.result.method == "auto: one loop, the better of both"


def test_giving_up_says_so_and_carries_the_answer():
    problem = solved_block(6).problem.friction_problem
    with pytest.raises(NotConverged, match=r"one loop ended with a Coulomb residual of .* last residuals") as failure:
        OneLoop(max_iterations=4).solve(problem)
    result = failure.value.result
    assert result.status is Status.MAX_ITERATIONS and result.residual > 1e-8
    assert problem.residual(result.x) == pytest.approx(result.residual)
    assert len(result.history) == result.path_following == 16  # four starts of four steps


@pytest.mark.parametrize("field", ["tolerance", "r_tol", "c_fact", "gamma", "beta", "max_iterations"])
def test_constants_outside_their_bounds(field):
    with pytest.raises(ValueError, match=f"OneLoop: {field} must be"):
        OneLoop(**{field: 0})


def test_the_law_decides_which_solvers_fit():
    """Solvers of convex problems refuse friction that grows with pressure; those for that solve the convex ones too."""
    for solver in (PathFollowing(), KPRGP()):
        with pytest.raises(ValueError, match="where friction grows with pressure use "):
            make_block(2).solve(solver=solver)
    best = make_block(3, slip_stress=1e7).solve(1e-10).contact_force
    for other in (OneLoop(1e-10), SuccessiveTresca(1e-10, PathFollowing(tolerance=1e-10)), KPRGP(1e-10)):
        x = make_block(3, slip_stress=1e7).solve(solver=other).contact_force
        assert np.linalg.norm(x - best) <= 1e-8 * np.linalg.norm(best)


def test_start_from_a_coarser_mesh():
    """Forces of half the resolution: the same answer in fewer steps; nonsense as a start does no harm."""
    coarse, fine = solved_block(6), solved_block(12)
    start = interpolated_forces(coarse.contact_force, coarse.problem.surface, fine.problem.surface)
    assert np.linalg.norm(start - fine.contact_force) <= 0.15 * np.linalg.norm(fine.contact_force)
    problem = fine.problem.friction_problem
    cold, warm = OneLoop(1e-8).solve(problem), OneLoop(1e-8).solve(problem, start=start)
    assert np.linalg.norm(warm.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)
    assert warm.path_following < cold.path_following and warm.products < cold.products
    nonsense = 1e3 * np.random.default_rng(1).standard_normal(len(start)) * np.abs(start).max()
    for solver in (OneLoop(1e-8), SuccessiveTresca(1e-8)):
        result = solver.solve(problem, start=nonsense)
        assert np.linalg.norm(result.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)
