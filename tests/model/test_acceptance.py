"""Solvers stop when the certificate passes, not before; otherwise they report the failing condition."""

import numpy as np
import pytest
from conftest import make_block, solved_block

import coulomb
from coulomb.model import certificate as certificate_module
from coulomb.solvers import IterativeSolver
from coulomb.solvers.friction_problem import FrictionProblem
from coulomb.solvers.results import Goal, Status

COULOMB = [
    coulomb.InteriorPoint(1e-8),
    coulomb.InteriorPoint(1e-8, newton=coulomb.solvers.DenseSystem()),
    coulomb.SuccessiveTresca(1e-8),
    coulomb.solvers.Automatic(1e-8),
]
TRESCA = [
    coulomb.InteriorPoint(),
    coulomb.InteriorPoint(newton=coulomb.solvers.SchurComplementSystem(rank=0)),
    coulomb.solvers.KPRGP(),
]


def soft_block(friction, **options):
    """A steel block dragged over a plane by its top face, held across and upwards by springs that are much softer."""
    return coulomb.ContactProblem(
        coulomb.box((4.0, 1.0, 2.0), (8, 3, 4)),
        coulomb.Material(2.1e11, 0.3),
        [coulomb.PrescribedDisplacement("top", (1e-2, 0.0, 0.0), "x")],
        coulomb.Contact("bottom", friction=friction),
        [coulomb.Traction("top", (0.0, 0.0, -1e6))],
        springs=[coulomb.Spring("top", (0.0, 1e6, 1e6))],
        **options,
    )


FACTORISED = [(0.0, 1e-9, None, 140), (0.1, 1e-8, None, 140), (0.2, 1e-8, None, 140), (0.3, 1e-9, None, 140)]
MULTIGRID = [(friction, 1e-8, IterativeSolver, most) for friction, most in ((0.0, 400), (0.1, 150), (0.3, 150))]


@pytest.mark.parametrize(("friction", "tolerance", "linear_solver", "products"), FACTORISED + MULTIGRID)
def test_soft_springs_are_solved_to_the_certificate(friction, tolerance, linear_solver, products):
    """By the natural residual alone, three of four end with gaps of 1e-5 to 1e-4 of the deformation.

    Of two platforms one takes up to 34 steps, six of them semismooth Newton steps that lead nowhere, and 129 products.
    By multigrid b and A x nearly cancel: without the rigid motions in what the methods know of A it takes 187 products
    and more, of A as a whole 400 to 880.
    """
    solution = soft_block(friction, linear_solver=linear_solver).solve(tolerance=tolerance)
    assert solution.certificate.passed and solution.result.residual <= tolerance
    x = solution.contact_force.reshape(-1, 3)
    pull = np.hypot(x[:, 1].sum(), x[:, 2].sum())
    assert pull / x[:, 0].sum() == pytest.approx(friction, rel=1e-6, abs=1e-12)
    assert linear_solver or solution.result.newton_steps <= 36
    assert solution.result.products <= products


def test_the_residual_alone_would_have_stopped_before():
    """Without the certificate, the solver stops before the condition of the test above holds."""
    problem = soft_block(0.2)
    blind = coulomb.InteriorPoint(1e-8).solve(problem.friction_problem)
    assert blind.status is Status.CONVERGED and not problem.solution(blind).certificate.passed


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (1e6, r"; prescribed displacements reach 1000 km, and the bodies together are 2\.45 m long: check"),
        (1e-4, "ended with a residual of .*"),
    ],
)
def test_where_a_solver_fails_much_too_large_motions_are_named(value, said):
    """By millimetres for metres, for instance; not where motions are small."""
    problem = coulomb.ContactProblem(
        coulomb.box((2.0, 1.0, 1.0), (2, 1, 1)),
        coulomb.Material(2e11, 0.3),
        [coulomb.PrescribedDisplacement("top", (value, 0.0, 0.0))],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.Traction("right", (0.0, 0.0, -1e6))],
    )
    with pytest.raises(coulomb.NotConverged, match=said) as failure:
        problem.solve(solver=coulomb.InteriorPoint(1e-8, max_iterations=1))
    assert ("the bodies together" in str(failure.value)) == (value > 1.0)


def asked(answers):
    """An `accept` that returns these answers, then always the last, and records the forces it was given."""
    seen = []

    def accept(x):
        seen.append(x.copy())
        return answers[min(len(seen), len(answers)) - 1]

    return accept, seen


def block2(law, accept):
    solution = solved_block(2, law)
    problem = solution.problem
    if law == "tresca":
        return coulomb.solvers.FrictionProblem.tresca(problem.A, problem.b, solution.slip_bound, accept=accept)
    return FrictionProblem.coulomb(problem.A, problem.b, problem.law.friction, accept)


SOLVERS = [("coulomb", solver) for solver in COULOMB] + [("tresca", solver) for solver in TRESCA]


@pytest.mark.parametrize(("law", "solver"), SOLVERS, ids=lambda value: getattr(value, "name", None))
def test_iterations_continue_after_a_refused_answer(law, solver):
    accept, seen = asked([False, False, True])
    problem = block2(law, accept)
    result = solver.solve(problem)
    residuals = [problem.residual(x) for x in seen]
    assert len(seen) == 3 and result.status is Status.CONVERGED
    assert residuals[0] <= 1e-8 and residuals[1] <= 0.51 * residuals[0] and residuals[2] <= 0.51 * residuals[1]
    assert np.array_equal(result.x, seen[-1])


@pytest.mark.parametrize(("law", "solver"), SOLVERS, ids=lambda value: getattr(value, "name", None))
def test_an_answer_that_never_passes_is_not_converged(law, solver):
    accept, seen = asked([False])
    with pytest.raises(coulomb.NotConverged, match="below the tolerance, but the certificate fails") as failure:
        solver.solve(block2(law, accept))
    result = failure.value.result
    assert result.status is Status.STAGNATED and result.residual <= 1e-8 and len(seen) >= 2


def test_the_open_contact_is_judged_as_well():
    accept, seen = asked([False])
    problem = solved_block(2).problem
    pulled = FrictionProblem.coulomb(problem.A, -np.abs(problem.b), problem.law.friction, accept)
    with pytest.raises(coulomb.NotConverged):
        coulomb.InteriorPoint(1e-8).solve(pulled)
    assert not np.any(seen[0])


def test_a_stalled_solver_evaluates_the_goal_once_more():
    """The residual stalls between two evaluations, with an answer that passes."""
    accept, seen = asked([False, True])
    goal = Goal(1e-8, accept)
    assert not goal.reached(4e-9, np.zeros(3)) and not goal.reached(3e-9, np.ones(3)) and len(seen) == 1
    assert goal.verdict(3e-9, np.ones(3), Status.STAGNATED) is Status.CONVERGED
    assert len(seen) == 2 and np.array_equal(seen[1], np.ones(3))
    accept, seen = asked([False])
    goal = Goal(1e-8, accept)
    assert not goal.reached(4e-9, np.zeros(3))
    assert goal.verdict(3e-9, np.ones(3), Status.STAGNATED) is Status.STAGNATED
    assert goal.verdict(2e-8, np.ones(3), Status.STAGNATED) is Status.STAGNATED and len(seen) == 2


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_failing_conditions_are_named(monkeypatch, law):
    monkeypatch.setattr(certificate_module, "LIMIT", 1e-30)
    problem = make_block(4, slip_stress=1e7 if law == "tresca" else None)
    with pytest.raises(coulomb.NotConverged, match=r"failing conditions: .*equilibrium .*\(limit 1e-30\)") as failure:
        problem.solve()
    assert "what may help" in str(failure.value) and "springs" not in str(failure.value)
    assert failure.value.result.residual <= 1e-8


def test_advice_on_springs_only_where_there_are_some(monkeypatch):
    monkeypatch.setattr(certificate_module, "LIMIT", 1e-30)
    with pytest.raises(coulomb.NotConverged, match="a clamp or stiffer springs"):
        soft_block(0.2).solve()


def test_a_looser_tolerance_stops_earlier(monkeypatch):
    monkeypatch.setattr(certificate_module, "LIMIT", 1e-30)
    solution = make_block(4).solve(tolerance=1e-6)
    assert solution.result.status is Status.CONVERGED and not solution.certificate.passed
    assert 1e-8 < solution.result.residual <= 1e-6


def test_the_certificate_is_computed_once(monkeypatch):
    """The certificate at which the solver stopped is that of the solution: it is not computed again.

    A displacement, and another one for the forces with exact zeros (`zero_open_forces`).
    """
    problem, calls = make_block(4), []
    displacement = problem.displacement
    monkeypatch.setattr(problem, "displacement", lambda x: calls.append(1) or displacement(x))
    solution = problem.solve()
    assert len(calls) <= 2 and solution.certificate.passed
    spent = problem.seconds
    assert spent["displacement"] > 0.0 and spent["certificate"] > 0.0 and spent["solve"] > 0.0
