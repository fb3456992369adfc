"""Problems with friction of bodies that contact alone holds: w = A x - b - G^T alpha, G x = e."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import dense_compliance
from floating_blocks import FRICTION, WEIGHT, FloatingBlock, clamped_problem, floating_problem

from coulomb import (
    Contact,
    ContactProblem,
    InteriorPoint,
    LoadHistory,
    Material,
    NotConverged,
    Plane,
    RigidFace,
    SuccessiveTresca,
    Tied,
    TotalForce,
    Traction,
    box,
    join,
    moved,
    solve_coulomb,
    solve_tresca,
)
from coulomb.solvers import (
    KPRGP,
    AugmentedSystem,
    Automatic,
    CondensedSystem,
    DenseSystem,
    FrictionProblem,
    RigidMotions,
    SchurComplementSystem,
)
from coulomb.solvers.interior_point import newton_step
from coulomb.solvers.scaled_problem import Iterate, ScaledProblem

BLOCK = FloatingBlock()


def arbiter(problem, steps=2000):
    """Forces in newtons by ADMM: compliance and equilibrium by one factorisation, the law by projection."""
    A, b, G, e = problem.A.dense(), problem.b, problem.rigid.G, problem.rigid.e
    a, s, n, q = np.diag(A).mean(), np.abs(e).max() / problem.A.nodes, len(problem.b), len(e)
    M = np.linalg.inv(np.block([[A / a + np.eye(n), -G.T], [G, np.zeros((q, q))]]))[:n]
    z = u = np.zeros(n)
    for _ in range(steps):
        x = M @ np.concatenate([b / (a * s) + z - u, e / s])
        v = (x + u).reshape(-1, 3)
        normal, size = np.maximum(v[:, 0], 0.0), np.hypot(v[:, 1], v[:, 2])
        bound = problem.law.cohesion / s + problem.law.friction * normal
        p = np.column_stack([normal, v[:, 1:] * np.minimum(1.0, bound / np.where(size > 0.0, size, 1.0))[:, None]])
        before, z, u = z, p.ravel(), u + x - p.ravel()
        if max(np.abs(x - z).max(), np.abs(z - before).max()) < 1e-13:
            return s * z
    raise AssertionError("the arbiter does not converge")


def off(result, x):
    return np.linalg.norm(result.x - x) / np.linalg.norm(x)


@pytest.mark.parametrize("ratio", [0.52, 0.87, 0.99])
def test_a_block_on_a_plane(ratio):
    """The forces of the arbiter in at most 20 steps, in equilibrium; alpha closes the contact."""
    problem = floating_problem(BLOCK, ratio, moment=5e3)
    x = arbiter(problem)
    for newton in (DenseSystem(), SchurComplementSystem(), SchurComplementSystem(rank=0)):
        result = InteriorPoint(1e-9, newton=newton).solve(problem)
        assert result.newton_steps <= 20 and off(result, x) <= 1e-6
        assert np.allclose(problem.rigid.G @ result.x, problem.rigid.e, atol=1e-8 * WEIGHT)
        w = problem.A.dense() @ result.x - problem.b - problem.rigid.G.T @ result.rigid
        assert np.allclose(w, result.gradient, atol=1e-12 * np.abs(problem.b).max())
        assert np.abs(w[0::3][x[0::3] > 1e-3 * x.max()]).max() <= 1e-6 * np.abs(w).max()
        assert np.allclose(problem.gradient(result.x), w, atol=1e-6 * np.abs(w).max())  # alpha from x alone


def test_solvers_agree():
    problem = floating_problem(BLOCK, 0.7, moment=2e4)
    x = arbiter(problem)
    for solver in (Automatic(), SuccessiveTresca()):
        result = solver.solve(problem)
        assert off(result, x) <= 1e-6
        w = problem.gradient(result.x, result.rigid)
        assert np.allclose(w, result.gradient, atol=1e-12 * np.abs(problem.b).max())


@pytest.mark.parametrize("newton", [DenseSystem(), SchurComplementSystem(), AugmentedSystem(), AugmentedSystem(rank=0)])
def test_given_slip_bounds(newton):
    """Algorithm PF; two nodes have no friction.

    With diag(A) alone (rank 0) CG stalls on this A, more or less by rounding: 13 steps here, 57 with another PETSc.
    """
    g = np.full(len(BLOCK.bottom), 3e4)
    g[[1, 7]] = 0.0
    problem = floating_problem(BLOCK, 0.87, moment=5e3).with_slip_bound(g)
    x = arbiter(problem)
    cold = InteriorPoint(1e-9, newton=newton).solve(problem)
    assert off(cold, x) <= 1e-6
    if newton == AugmentedSystem(rank=0):
        return
    assert cold.newton_steps <= 20
    near = problem.with_slip_bound(1.001 * g)
    warm = InteriorPoint(1e-8, newton=newton).solve(near, cold.x, gradient=cold.gradient)
    assert warm.newton_steps <= 0.6 * cold.newton_steps and off(warm, arbiter(near)) <= 1e-6


def test_as_many_krylov_iterations_as_with_clamps():
    block = FloatingBlock(cells=(8, 4, 2))
    for ratio in (0.52, 0.87):
        for newton, law in ((SchurComplementSystem(), "coulomb"), (AugmentedSystem(), "tresca")):
            floating, clamped = floating_problem(block, ratio), clamped_problem(block, ratio)
            if law == "tresca":
                floating, clamped = (
                    p.with_slip_bound(np.full(p.A.nodes, FRICTION * WEIGHT / p.A.nodes)) for p in (floating, clamped)
                )
            counts = []
            for problem in (floating, clamped):
                result = InteriorPoint(newton=newton).solve(problem)
                counts.append(np.mean([step.krylov for step in result.history]))
                assert result.products <= sum(step.krylov for step in result.history) + result.newton_steps + 6 + 12
            assert counts[0] <= 1.5 * counts[1]


def test_what_makes_the_stiffness_regular_does_not_matter():
    """Springs or the pseudoinverse of K, other units and combinations of the motions: the same forces."""
    problem = floating_problem(BLOCK, 0.87)
    inverse, f = np.linalg.pinv(BLOCK.K, rcond=1e-10), BLOCK.load((0.8 * 0.87 * 3e5, 0.6 * 0.87 * 3e5, -1e6))
    A = BLOCK.B @ inverse @ BLOCK.B.T
    T = np.random.default_rng(5).standard_normal((7, 6)) * np.geomspace(1.0, 100.0, 7)[:, None]  # one row too many
    rigid = RigidMotions(T @ problem.rigid.G, T @ problem.rigid.e)
    other = FrictionProblem(dense_compliance(0.5 * (A + A.T)), BLOCK.B @ inverse @ f, problem.law, rigid=rigid)
    one, two = (InteriorPoint(1e-10).solve(p) for p in (problem, other))
    assert off(two, one.x) <= 1e-7
    assert np.allclose(two.gradient, one.gradient, atol=1e-6 * np.abs(one.gradient).max())
    scaled = FrictionProblem(
        dense_compliance(1e6 * problem.A.dense()),
        1e3 * problem.b,
        problem.law,
        rigid=RigidMotions(problem.rigid.G, 1e-3 * problem.rigid.e),
    )
    result = InteriorPoint(1e-10).solve(scaled)  # kN and mm
    assert off(result, 1e-3 * one.x) <= 1e-8 and result.newton_steps == one.newton_steps
    assert np.allclose(result.rigid, 1e3 * one.rigid, atol=1e-9 * np.abs(result.rigid).max())


def test_free_motions_are_the_shortest():
    """Without friction nothing resists sliding and spinning."""
    problem = floating_problem(BLOCK, 0.0, friction=0.0)
    for newton in (DenseSystem(), SchurComplementSystem()):
        result = InteriorPoint(1e-9, newton=newton).solve(problem)
        assert off(result, arbiter(problem)) <= 1e-6
        free = np.linalg.svd(problem.rigid.G[:, 0::3])[0][:, 3:]
        assert np.abs(free.T @ result.rigid).max() <= 1e-12 * np.abs(result.rigid).max()


def test_the_height_of_fall_does_not_matter():
    """A body far above the plane: alpha is larger, the steps are the same."""
    near = floating_problem(BLOCK, 0.52)
    gap = np.zeros(len(near.b))
    gap[0::3] = 1e4 * np.abs(near.b).max()
    far = replace(near, b=near.b - gap)
    one, two = InteriorPoint().solve(near), InteriorPoint().solve(far)
    assert off(two, one.x) <= 1e-7 and abs(two.newton_steps - one.newton_steps) <= 1
    assert two.rigid[2] - one.rigid[2] == pytest.approx(-gap.max(), rel=1e-6)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_newton_direction_against_differences(law):
    """Along a step all equations, those of equilibrium as well, change as linearised."""
    problem = floating_problem(BLOCK, 0.52)
    problem = problem if law == "coulomb" else problem.with_slip_bound(np.full(15, 3e4))
    scaled, rng = ScaledProblem(problem), np.random.default_rng(7)
    m, sloped = scaled.nodes, law == "coulomb"
    x_n, y, nu = rng.uniform(0.5, 2.0, m), rng.uniform(-0.5, 0.5, (m, 2)), rng.uniform(0.1, 1.0, (m, 2))
    v = Iterate(x_n, y, nu, scaled.A.mult(scaled.forces(x_n, y)), rng.standard_normal(6))
    unknowns = 3 * m
    parts = scaled.weight(x_n) * scaled.gradient(v), scaled.out_of_balance(v)
    assert unknowns * scaled.infeasibility(v) ** 2 == pytest.approx(sum(np.sum(part**2) for part in parts))

    def equations(v):
        fresh = v._replace(A_x=scaled.A.mult(scaled.forces(v.x_n, v.y)))
        return np.concatenate([scaled.gradient(fresh).ravel(), -scaled.out_of_balance(v)])

    for kind in (DenseSystem(), SchurComplementSystem()) + (() if sloped else (AugmentedSystem(),)):
        newton = kind.system(scaled.A, sloped)
        step = newton_step(scaled, newton, v, 0.1, 1e-12, 1e9)
        change = (equations(step.at(1e-6)) - equations(step.at(-1e-6))) / 2e-6
        assert np.allclose(change, -equations(v), atol=1e-6 * np.abs(change).max())
        newton.destroy()


def test_both_conditions_must_hold():
    """Forces of another load have no natural residual of the law, but are out of balance."""
    problem = floating_problem(BLOCK, 0.5)
    result = InteriorPoint(1e-10).solve(problem)
    assert problem.residual(result.x, result.gradient) <= 1e-10
    heavier = replace(problem, rigid=replace(problem.rigid, e=1.01 * problem.rigid.e))
    assert (
        heavier.law.natural_residual(result.x, result.gradient, heavier.mean_diagonal, heavier.reductions)
        <= 1e-10
        < 1e-3
        < heavier.residual(result.x, result.gradient)
    )


def test_the_certificate_sees_the_motions():
    seen = []

    def accept(x, alpha):
        seen.append(alpha)
        return True

    result = InteriorPoint().solve(replace(floating_problem(BLOCK, 0.5), accept=accept))
    assert np.array_equal(seen[-1], result.rigid) and len(result.rigid) == 6


def test_without_a_mesh():
    problem = floating_problem(BLOCK, 0.5)
    A, friction = problem.A.dense(), problem.law.friction
    x = arbiter(problem)
    assert off(solve_coulomb(A, problem.b, friction, rigid=problem.rigid), x) <= 1e-6
    lists = RigidMotions(problem.rigid.G.tolist(), problem.rigid.e.tolist())
    assert off(solve_tresca(A, problem.b, friction * x[0::3], rigid=lists), x) <= 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: replace(r, G=r.G[:, :-1]), r"rigid: G must have shape \(6, 45\).*but has \(6, 44\)"),
        (lambda r: replace(r, G=r.G[:2]), r"rigid: G must have shape \(6, 45\).*but has \(2, 45\)"),
        (
            lambda r: replace(r, G=r.G[:0], e=r.e[:0]),
            r"rigid: e must have shape \(q,\) with q > 0 .*has \(0,\)",
        ),
        (lambda r: replace(r, G=r.G * np.nan), "rigid: G has entries that are not finite"),
        (lambda r: replace(r, e=r.e + np.inf), "rigid: e has entries that are not finite"),
        (lambda r: replace(r, names=("x", "y")), r"rigid: names must be one per motion \(6\), or none, but are 2"),
    ],
)
def test_wrong_motions_are_refused(change, message):
    good = floating_problem(BLOCK, 0.5)
    with pytest.raises(ValueError, match=message):
        replace(good, rigid=change(good.rigid))


def test_unsupported_combinations_are_refused():
    problem = floating_problem(BLOCK, 0.5)
    A = problem.A.dense().copy()
    A[4], A[:, 4] = 0.0, 0.0
    with pytest.raises(ValueError, match="G must be zero where a row of A is zero"):
        FrictionProblem(dense_compliance(A), problem.b, problem.law, rigid=problem.rigid)
    with pytest.raises(ValueError, match=r"KPRGP solves problems whose bodies are all held by supports.*InteriorPoint"):
        KPRGP().solve(problem.with_slip_bound(np.full(15, 3e4)))
    with pytest.raises(ValueError, match="newton: a condensed system"):
        InteriorPoint(newton=CondensedSystem()).solve(problem)


@pytest.mark.parametrize(("clearance", "pressed"), [(None, False), (2e-4, False), (-5e-5, True)])
def test_a_body_that_nothing_presses_is_moved_out_of_the_way(clearance, pressed):
    """A block without loads on a floor that has risen by 0.1 mm, below a ceiling: no forces unless it is squeezed."""
    walls = [Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, 1e-4), (0.0, 0.0, 1.0)))]
    if clearance is not None:
        walls += [Contact("top", 0.3, foundation=Plane((0.0, 0.0, 1.0 + 1e-4 + clearance), (0.0, 0.0, -1.0)))]
    solution = ContactProblem(box((1.0, 1.0, 1.0), (2, 2, 2)), Material(2e11, 0.0), [], walls).solve()
    assert solution.valid and bool(np.any(solution.contact_force)) == pressed
    up = solution.displacement[:, 2]
    if pressed:
        total = solution.at_nodes.totals(0)["normal_force"]
        assert total == pytest.approx(2e11 * 5e-5, rel=1e-6) and np.ptp(up) == pytest.approx(5e-5, rel=1e-6)
    else:
        assert up == pytest.approx(1e-4, rel=1e-6)


@pytest.mark.parametrize("follows", ["", "tied", "rigid"])
def test_a_body_that_slides_out_between_walls_is_no_answer(follows):
    """The walls press by 10 um and hold F times 4.5 kN, 4.5 N, at most, of 1 kN: the body went 1e11 m without a contact
    force, where rounding errors of its stiffness are larger than its load, and all conditions held."""
    lower = box((0.1, 0.1, 0.05), (3, 3, 2))
    mesh = join(lower=lower, upper=moved(lower, (0.0, 0.0, 0.05))) if follows == "tied" else join(upper=lower)
    walls = {"left": Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), "right": Plane((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0))}
    problem = ContactProblem(
        mesh,
        Material(1e9, 0.3),
        contact=[
            Contact(f"{body}:{side}", 1e-3, foundation=wall, gap=-1e-5)
            for body in mesh.bodies
            for side, wall in walls.items()
        ],
        tractions=[Traction("upper:top", (0.0, 0.0, -1e5))],
        ties=[Tied("upper:bottom", "lower:top")] if follows == "tied" else [],
        rigid_faces=[RigidFace("upper:top")] if follows == "rigid" else [],
        small_strain="warn",
    )
    with pytest.raises(NotConverged, match=r"loads push .*, of which contact holds"):  # along -z, or turned by rounding
        problem.solve()


@pytest.mark.parametrize(
    "solver", [None, InteriorPoint(), SuccessiveTresca()], ids=["auto", "interior point", "successive Tresca"]
)
@pytest.mark.parametrize(("friction", "left"), [(0.3, True), (0.1, False)])
def test_a_wedge_stays_where_friction_holds_it_without_loads(friction, left, solver):
    """Between walls at 12 degrees, as a taper: the force that drove it in is taken away, and T = N tan(12 deg) remains
    if that is within the law of friction, as just before; no forces at all would also be in equilibrium."""
    angle = np.radians(12.0)

    def way(x):
        return np.stack([(x[0] / 0.1 - 1.0) * np.tan(angle) * x[2], 0.0 * x[1], 0.0 * x[2]])

    walls = [
        Contact(face, friction, foundation=Plane((x, 0.0, 0.0), (side * np.cos(angle), 0.0, np.sin(angle))))
        for face, x, side in (("left", 0.0, 1.0), ("right", 0.2, -1.0))
    ]
    drive = TotalForce("top", (0.0, 0.0, -1e5), [(0.0, 0.0), (1.0, 1.0), (2.0, 0.0)])
    problem = ContactProblem(moved(box((0.2, 0.1, 0.1), (4, 1, 2)), way), Material(2.1e11, 0.3), [], walls, [drive])
    near = 1.9 if isinstance(solver, SuccessiveTresca) and not left else 2.0 - 1e-6  # which takes a part of a load
    before, after = [step.solution for step in LoadHistory([1.0, near, 2.0], solver=solver).steps(problem)][1:]
    assert before.valid and after.valid
    for face in ("left", "right"):
        normal, sliding = (after.forces[face][name] for name in ("normal_force", "friction_force"))
        assert normal == pytest.approx(before.forces[face]["normal_force"] if left else 0.0, rel=1e-5, abs=1e-6)
        assert np.linalg.norm(sliding) == pytest.approx(normal * np.tan(angle), rel=1e-6, abs=1e-6)
