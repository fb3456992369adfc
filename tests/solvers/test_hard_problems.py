"""Hard problems on which other codes have failed silently: the right answer, or the right status."""

import dataclasses

import numpy as np
import pytest
from conftest import dense_compliance, make_block

import coulomb
from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca
from coulomb.solvers import Automatic, DenseSystem, FrictionProblem

METHODS = [
    Automatic(),
    InteriorPoint(),
    InteriorPoint(newton=DenseSystem()),
    SuccessiveTresca(),
    SuccessiveTresca(memory=0),
]
NAMES = ["auto", "interior point", "interior point, dense", "successive Tresca", "plain"]
every_method = pytest.mark.parametrize("solver", METHODS, ids=NAMES)


def wedge(slope, friction, load=3.0):
    """One node on a wedge: it slides along t1, and g newtons of friction take g/slope from its normal force.

    Tresca: x_n = load - g/slope, so that Coulomb's x_n = load/(1 + F/slope); plain iteration has the factor -F/slope.
    """
    coupling = 1.0 / slope
    A = np.array([[1.0, coupling, 0.0], [coupling, 2.0 * coupling**2 + 1.0, 0.0], [0.0, 0.0, 1.0]])
    return FrictionProblem.coulomb(dense_compliance(A), np.array([load, 100.0, 0.0]), np.array([friction]))


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.0, 2.0])
@every_method
def test_wedge(solver, friction):
    """Friction below and above the slope s = 0.5: the answer by hand."""
    problem = wedge(0.5, friction)
    x_n = 3.0 / (1.0 + friction / 0.5)
    result = solver.solve(problem)
    assert result.x == pytest.approx([x_n, friction * x_n, 0.0], abs=1e-6)


def test_oscillation_on_a_steep_wedge_is_detected():
    """Without damping it oscillates between x_n = 0 and 3; the answer is 0.6."""
    problem = wedge(0.5, 2.0)
    with pytest.raises(NotConverged, match=r"\(oscillating\).* factor .*oscillates between two states") as failure:
        SuccessiveTresca(memory=0, damping=1.0).solve(problem)
    result = failure.value.result
    assert result.status is Status.OSCILLATING and result.message == str(failure.value)
    assert result.outer_steps <= 12
    assert problem.residual(result.x) > 1e-2


def test_damping_is_chosen_by_the_measured_slope():
    """Factor -F/s = -0.8: with damping 1/(1 + 0.8) only the inner accuracy remains."""
    result = SuccessiveTresca(memory=0).solve(wedge(0.5, 0.4))
    assert result.history[1].slope == pytest.approx(-0.8, rel=0.1)
    assert result.history[1].damping == pytest.approx(1.0 / 1.8, rel=0.1)
    assert result.outer_steps <= 15
    undamped = SuccessiveTresca(1e-5, memory=0, damping=1.0).solve(wedge(0.5, 0.4))
    assert undamped.outer_steps > 40 and undamped.contraction == pytest.approx(0.8, rel=1e-2)


def test_divergence_is_detected():
    """Friction increases the normal force of a rigid body: x_n = 3 + g; for F = 2 the bound doubles for ever."""
    A = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    problem = FrictionProblem.coulomb(dense_compliance(A), np.array([3.0, 5.0, 0.0]), np.array([2.0]))
    with pytest.raises(NotConverged, match=r"\(diverged\).* factor 2; .*diverges:") as failure:
        SuccessiveTresca().solve(problem)
    assert failure.value.result.status is Status.DIVERGED
    for solver in METHODS[:3]:
        with pytest.raises(NotConverged):
            solver.solve(problem)


@every_method
def test_growth_until_the_node_sticks(solver):
    """The same on an elastic body: the bound quadruples until the node sticks; a large solution exists."""
    A = np.array([[1.0, -2.0, 0.0], [-2.0, 10.0, 0.0], [0.0, 0.0, 1.0]])
    problem = FrictionProblem.coulomb(dense_compliance(A), np.array([3.0, 1e4, 0.0]), np.array([2.0]))
    assert solver.solve(problem).x == pytest.approx(np.linalg.solve(A, problem.b), rel=1e-6)


def test_stagnation_is_detected():
    """A slip bound that does not converge because of a coarse inner tolerance."""

    class Restless:
        tolerance = 1e-8

        def solve(self, qp, start=None, *, gradient=None, tolerance=None, progress=None):
            result = coulomb.InteriorPoint().solve(qp)
            factor = 1.0 + 0.1 * np.sin(100.0 * qp.law.cohesion.sum())
            return coulomb.solvers.SolverResult(**{**vars(result), "x": factor * result.x})

    with pytest.raises(NotConverged, match=r"\(stagnated\).*does not converge") as failure:
        SuccessiveTresca(memory=0, qp_solver=Restless()).solve(wedge(3.0, 0.3))
    assert failure.value.result.status is Status.STAGNATED


@pytest.mark.parametrize("friction", [0.0, 0.5, 2.0])
def test_friction_from_0_to_2(friction):
    problem = make_block(3).friction_problem
    problem = FrictionProblem.coulomb(problem.A, problem.b, np.full(problem.A.nodes, friction))
    answers = [solver.solve(problem).x for solver in METHODS]
    for x in answers[1:]:
        assert np.linalg.norm(x - answers[0]) <= 2e-7 * np.linalg.norm(answers[0])


@every_method
def test_slip_everywhere(solver):
    """A stiff push along t1 on every node: friction is F x_n against it, and x_n follows from the normal rows."""
    rng = np.random.default_rng(81)
    m, F = 6, 0.4
    n = rng.standard_normal((m, m))
    A_n = n @ n.T + m * np.eye(m)
    A = np.zeros((3 * m, 3 * m))
    A[0::3, 0::3], A[1::3, 1::3], A[2::3, 2::3] = A_n, A_n, A_n
    b = np.zeros(3 * m)
    b[0::3] = A_n @ rng.uniform(1.0, 2.0, m)
    b[1::3] = 100.0
    result = solver.solve(FrictionProblem.coulomb(dense_compliance(A), b, np.full(m, F)))
    x_n = np.linalg.solve(A_n, b[0::3])
    assert result.x == pytest.approx(np.column_stack([x_n, F * x_n, 0.0 * x_n]).ravel(), abs=1e-6)


@every_method
def test_stick_everywhere(solver):
    """Pressed hard, pushed softly: no bound is active and A x = b."""
    rng = np.random.default_rng(82)
    m = 6
    n = rng.standard_normal((3 * m, 3 * m))
    A = n @ n.T + 3 * m * np.eye(3 * m)
    x = np.column_stack([rng.uniform(1.0, 2.0, m), rng.uniform(-0.2, 0.2, (m, 2))]).ravel()
    result = solver.solve(FrictionProblem.coulomb(dense_compliance(A), A @ x, np.full(m, 0.5)))
    assert result.x == pytest.approx(x, abs=1e-6)


@every_method
def test_opening_completely_and_zero_load(solver):
    for b in (np.array([-1.0, 2, 0, -0.1, 0, 1]), np.zeros(6)):
        result = solver.solve(FrictionProblem.coulomb(dense_compliance(np.eye(6) + 0.1), b, np.full(2, 0.5)))
        assert result.status is Status.CONVERGED and not result.x.any()


@every_method
def test_grazing_contact(solver):
    """A node with neither force nor gap beside one that presses: strict complementarity fails, pushed along or not."""
    A = np.kron(np.array([[2.0, 1.0], [1.0, 2.0]]), np.eye(3))
    for pushed in (0.0, 5.0):
        b = A @ np.array([1.0, 0.2, 0.0, 0.0, 0.0, 0.0]) + np.array([0, 0, 0, 0, pushed, 0])
        result = solver.solve(FrictionProblem.coulomb(dense_compliance(A), b, np.full(2, 0.3)))
        assert result.x == pytest.approx([1.0, 0.2, 0.0, 0.0, 0.0, 0.0], abs=1e-4)  # the force goes with sqrt(residual)
        assert result.residual <= 1e-8


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0])
@every_method
def test_a_single_node(solver, friction):
    result = solver.solve(
        FrictionProblem.coulomb(dense_compliance(np.eye(3)), np.array([2.0, 3.0, 4.0]), np.array([friction]))
    )
    t = min(2.0 * friction, 5.0)
    assert result.x == pytest.approx([2.0, 0.6 * t, 0.8 * t], abs=1e-7)


@every_method
def test_several_solutions(solver):
    """Friction may hold a node that no load presses: open, wedged in, or sliding between the two.  A converged answer
    is one of them, also where they are closer and closer together."""
    for distance in (1.0, 1e-2, 1e-4, 1e-6):
        A = np.array([[1.0, -0.9, 0.0], [-0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
        b = np.array([-0.1 * distance, 0.5 * distance, 0.0])
        A, b = np.kron(np.eye(2), A), np.concatenate([b, [1.0, 0.2, 0.0]])
        problem = FrictionProblem.coulomb(dense_compliance(A), b, np.full(2, 1.5))
        try:
            x = solver.solve(problem).x
        except NotConverged as failure:
            assert problem.residual(failure.result.x) > 1e-8
            continue
        wedged = np.linalg.solve(A[:3, :3], b[:3])
        slides = b[0] / (1.0 - 0.9 * 1.5)
        assert slides > 0.0 and wedged[0] > 0.0 and abs(wedged[1]) < 1.5 * wedged[0]
        answers = (np.zeros(3), wedged, np.array([slides, 1.5 * slides, 0.0]))
        assert min(np.abs(x[:3] - answer).max() for answer in answers) <= 1e-6


def test_a_far_point_that_touches():
    """Open by three times the displacement without contact, a point is pushed closed by the force at another one."""
    A = np.diag([1.0, 1.0, 1.0, 100.0, 1.0, 1.0])
    A[0, 3] = A[3, 0] = -8.0
    problem = FrictionProblem.coulomb(dense_compliance(A), np.array([1.0, 0.0, 0.0, -3.0, 0.0, 0.0]), np.full(2, 0.3))
    result = Automatic().solve(problem)
    assert result.x[[0, 3]] == pytest.approx([1.0 + 8.0 * 5.0 / 36.0, 5.0 / 36.0])
    assert result.gradient == pytest.approx(A @ result.x - problem.b, abs=1e-9)


def test_a_far_point_of_a_body_on_soft_springs():
    """Once a certificate has refused an answer, w is that of the displacement in balance: of gaps as they are."""
    A, b, asked = np.diag([1.0, 1.0, 1.0, 100.0, 1.0, 1.0]), np.array([1.0, 0.2, 0.0, -50.0, 0.0, 0.0]), []

    def accept(x, *_):
        asked.append(x)
        return len(asked) > 1

    problem = FrictionProblem.coulomb(dense_compliance(A), b, np.full(2, 0.3), accept=accept)
    problem = dataclasses.replace(problem, balanced=lambda x: A @ x - b)
    result = Automatic(interior_point=InteriorPoint()).solve(problem)
    assert len(asked) > 1 and result.x[[0, 3]] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert result.gradient == pytest.approx(A @ result.x - b, abs=1e-9)


def test_light_loads_on_a_curved_foundation():
    """A part on a plate, which touches a drum in a line of nodes: forces are in proportion to the load, and the ends of
    the plate are as far away as ever."""
    lower = coulomb.box((0.2, 0.1, 0.05), (4, 2, 2))
    upper = coulomb.moved(coulomb.box((0.1, 0.1, 0.05), (3, 2, 1)), (0.05, 0.0, 0.05))
    drum = coulomb.Cylinder((0.15, 0.0, -0.3), (0.0, 1.0, 0.0), 0.3)

    def under(load):
        problem = coulomb.ContactProblem(
            coulomb.join(a=lower, b=upper),
            coulomb.Material(1e9, 0.3),
            [coulomb.Clamp("a:left")],
            [coulomb.Contact("b:bottom", 0.3, against="a:top"), coulomb.Contact("a:bottom", 0.4, foundation=drum)],
            [coulomb.Traction("b:top", (5e4 * load, -8e4 * load, -1.6e5 * load))],
            springs=[coulomb.Spring("b:right", 1e7)],
        )
        solution = problem.solve()
        w, result = problem.friction_problem.gradient(solution.contact_force.ravel()), solution.result
        assert result.gradient == pytest.approx(w, rel=1e-6, abs=1e-9 * w.max()) and w.max() > 0.01
        assert result.multipliers[:, 0] == pytest.approx(w[0::3], rel=1e-2, abs=1e-5 * w.max())
        assert solution.certificate.passed and result.newton_steps <= 30
        return solution.contact_force / load

    whole = under(1.0)
    for load in (1e-2, 1e-4, 1e-6):
        assert under(load) == pytest.approx(whole, abs=1e-6 * whole.max())


def test_forces_go_on_from_a_body_on_soft_springs():
    """The springs let the upper block turn by a thousand times what contact does: had the plate below a nominal force
    of its own, by its small motions, no method would come to an answer."""
    lower = coulomb.box((0.2, 0.1, 0.05), (4, 2, 2))
    upper = coulomb.moved(coulomb.box((0.1, 0.1, 0.05), (3, 2, 1)), (0.05, 0.0, 0.05))
    problem = coulomb.ContactProblem(
        coulomb.join(a=lower, b=upper),
        coulomb.Material(1e9, 0.3),
        [coulomb.Clamp("a:left")],
        [coulomb.Contact("b:bottom", 0.3, against="a:top"), coulomb.Contact("a:bottom", 0.4, gap=1e-7)],
        [
            coulomb.Traction("b:top", (1e4, -3e3, -2e4)),
            coulomb.PointLoad("a:right", (100.0, 50.0, -80.0), (3.0, -8.0, 2.0)),
        ],
        springs=[coulomb.Spring("b:right", 1e7), coulomb.Spring("a:front", (1e8, 2e8, 3e8))],
        rigid_faces=[coulomb.RigidFace("b:right", (0.2, 0.05, 0.02), (None, None, -2e-6), (None, 1e-5, None))],
    )
    solution = problem.solve()
    assert solution.valid and solution.result.newton_steps <= 35
    assert solution.at_nodes.totals(0)["normal_force"] < solution.at_nodes.totals(1)["normal_force"]
