"""Thin bodies, flat cells and nearly incompressible materials: iterations of multigrid, and factors in its place."""

import logging
from dataclasses import replace

import numpy as np
import pytest
import ufl
from user_forms import Script

import coulomb
from coulomb import Clamp, Contact, ContactProblem, InteriorPoint, LoadHistory, Material, NotConverged, Status, Traction
from coulomb.io.summary import remarks, summary
from coulomb.linalg.compliance import predicted_cost as methods
from coulomb.linalg.compliance import stiffness
from coulomb.model import contact_stiffness
from coulomb.model.certificate import judge
from coulomb.solvers import CondensedSystem, DenseSystem, DirectSolver, IterativeSolver
from coulomb.solvers.automatic import Automatic
from coulomb.units import amount

STEEL, CELLS = Material(2.1e11, 0.3), (8, 2, 1)


def sheet(cells=(10, 3, 1), gap=1e-3, amplitude=1.0, **given):
    """A sheet of steel, 0.5 mm thick, clamped at one end, pressed down over a plane 1 mm below: 27-node
    hexahedra."""
    return ContactProblem(
        coulomb.box((0.16, 0.05, 0.0005), cells, degree=2),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.3, gap=gap),
        [Traction("top", (0.0, 0.0, -48.0), amplitude)],
        **given,
    )


def test_a_thin_sheet_wants_factors(monkeypatch):
    """Its first solution takes more iterations than factors are worth, and that of a block with as many does not."""
    monkeypatch.setattr(contact_stiffness, "undecided", lambda _, __, *given: given == (None, None))
    monkeypatch.setattr(contact_stiffness, "worth", lambda *_: 40.0)
    for problem, solver in ((sheet((16, 5, 1)), DirectSolver), (block(), IterativeSolver)):
        body = problem.body
        assert body.stiffness.linear_solver is solver and not body.stiffness.present.why


@pytest.fixture
def by_multigrid(monkeypatch):
    """Multigrid is chosen, wrongly; solves end after 100 iterations."""
    monkeypatch.setattr(contact_stiffness, "undecided", lambda _, __, *given: given == (None, None))
    monkeypatch.setattr(contact_stiffness, "worth", lambda *_: np.inf)
    monkeypatch.setattr(stiffness, "_ITERATIONS", 100)


def changed(problem, caplog):
    """The reason of the change, which is logged once."""
    said = [record.message for record in caplog.records if "K is factorised instead" in record.message]
    assert problem.body.stiffness.linear_solver is DirectSolver and problem.body.stiffness.explicit
    assert said == [problem.body.stiffness.present.why]
    return problem.body.stiffness.present.why


@pytest.fixture
def wide(monkeypatch):
    """Contact faces are too wide for A to be formed, and bodies too large to be factorised without a prediction."""
    for module in (methods, contact_stiffness):
        monkeypatch.setattr(module, "EXPLICIT_UP_TO", 0)
    monkeypatch.setattr(methods, "DIRECT_UP_TO", 0)
    monkeypatch.setattr(methods, "_SMALL", (0, 0))


def test_wide_sheets_want_factors(wide):
    """Sheets of any number of contact unknowns were left to multigrid, which did not solve them; blocks still are."""
    problem = sheet()
    stiffness = problem.body.stiffness
    assert stiffness.linear_solver is DirectSolver and not stiffness.present.why
    assert stiffness.present.newton is CondensedSystem
    assert problem.solve().valid
    assert block().body.stiffness.linear_solver is IterativeSolver


def test_wide_sheets_change_to_factors(monkeypatch, caplog, wide):
    """Multigrid has its patience whatever the number of contact unknowns, and A is not formed then."""
    monkeypatch.setattr(contact_stiffness, "worth", lambda *_: np.inf)
    monkeypatch.setattr(contact_stiffness, "patience", lambda *_: 20.0)
    problem = sheet()
    assert problem.body.stiffness.linear_solver is IterativeSolver
    with caplog.at_level(logging.WARNING, "coulomb"):
        solution = problem.solve()
    assert solution.valid and [record.message for record in caplog.records] == [problem.body.stiffness.present.why]
    stiffness = problem.body.stiffness
    assert "after 20 factors" in stiffness.present.why and not stiffness.explicit
    assert stiffness.present.newton is CondensedSystem


@pytest.mark.parametrize("slow", [False, True])
def test_factors_in_place_of_multigrid(monkeypatch, caplog, by_multigrid, slow):
    """Where a solve fails, or all solves together take too many iterations; the same answer as by factors."""
    if slow:
        monkeypatch.setattr(stiffness, "_ITERATIONS", 1000)
        monkeypatch.setattr(contact_stiffness, "patience", lambda *_: 20.0)
    problem = sheet()
    assert problem.body.stiffness.linear_solver is IterativeSolver
    with caplog.at_level(logging.WARNING, "coulomb"):
        solution = problem.solve()
    why = changed(problem, caplog)
    assert ("and after 20 factors of K are expected to be faster" if slow else "failed: after 100 iterations") in why
    assert solution.valid and solution.problem is problem
    exact = sheet(linear_solver=DirectSolver).solve()
    assert np.allclose(solution.displacement, exact.displacement, rtol=0.0, atol=1e-9)
    method = summary(solution)["method"]
    assert method["changed"] == why and method["compliance"] == "explicit" and "direct" in method["stiffness"]
    assert "changed" not in summary(exact)["method"]


def test_deflection_of_the_free_sheet(caplog, by_multigrid):
    """q L^4 / (8 E I) of a strip, less what the clamp holds of its anticlastic curvature."""
    problem = sheet((16, 5, 1), gap=1e-2)
    with caplog.at_level(logging.WARNING, "coulomb"):
        solution = problem.solve()
    assert changed(problem, caplog) and solution.valid and not np.any(solution.contact_force)
    assert -solution.displacement[:, 2].min() == pytest.approx(
        48.0 * 0.16**4 / (8.0 * 2.1e11 * 0.0005**3 / 12.0), rel=0.05
    )


def test_the_choice_of_the_user_stands(caplog, by_multigrid):
    with caplog.at_level(logging.WARNING, "coulomb"), pytest.raises(NotConverged, match="failed: after 100 iterations"):
        sheet(linear_solver=IterativeSolver).solve()
    assert not caplog.records


def test_factors_that_do_not_fit(monkeypatch, caplog, by_multigrid):
    """Multigrid goes on beyond its patience then, and fails for itself."""
    monkeypatch.setattr(contact_stiffness, "first_room", lambda _: 1.0)
    monkeypatch.setattr(contact_stiffness, "patience", lambda *_: 1.0)
    problem = sheet()
    with caplog.at_level(logging.WARNING, "coulomb"), pytest.raises(NotConverged, match="failed: after 100 iterations"):
        problem.solve()
    assert "factors of K do not fit into the memory" in caplog.text
    assert problem.body.stiffness.linear_solver is IterativeSolver and not problem.body.stiffness.present.why


def block(**given):
    """A block, on which multigrid does as expected."""
    return ContactProblem(
        coulomb.box((2.0, 1.0, 1.0), (10, 5, 5)),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (0.0, 0.0, -1e7))],
        **given,
    )


def test_a_penetration_is_no_open_gap(monkeypatch, by_multigrid):
    """Where no product by A is made: the free sheet is inside the plane, and the remark agrees with the certificate."""
    problem = sheet(linear_solver=IterativeSolver)
    with pytest.raises(NotConverged) as failure:
        problem.solve()
    answer = problem.solution(failure.value.result)
    inside, checks = answer.certificate.penetration, {check.name: check for check in answer.certificate.checks}
    assert not np.any(answer.contact_force) and inside > 1e-4 and not checks["penetration"].passed
    assert remarks(answer) == [
        f"no contact forces were found, although contact nodes penetrate by up to {amount(inside)}: not the answer"
    ]


def test_unbalanced_forces_hide_no_penetration():
    """A displacement that is a micrometre wrong inside the block has internal forces of meganewtons: the scale of the
    certificate is not their work over the load of 1 mN, which was 91 m."""
    problem = ContactProblem(
        coulomb.box((1.0, 0.2, 0.2), (10, 4, 4)),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.3, gap=1e-5),
        [Traction("right", (0.0, 0.0, -0.025))],
    )
    x, u = problem.elasticity.x, np.zeros_like(problem.elasticity.x)
    below, inner = (x[:, 0] > 0.35) & (x[:, 2] < 0.01), (x[:, 0] > 0.35) & (x[:, 2] > 0.06)
    u[below, 2] = -1.1e-5
    u[inner] += 1e-6 * np.random.default_rng(3).standard_normal((int(inner.sum()), 3))
    certificate = judge(problem.evidence(np.zeros_like(problem.b), u))
    assert certificate.penetration == pytest.approx(1e-6, rel=1e-6)
    (check,) = (check for check in certificate.checks if check.name == "penetration")
    assert check.value == pytest.approx(1e-6 / (2.0 * np.sqrt(3.0) * 1.1e-5)) and not check.passed


class Demanding(Automatic):
    """Fails where A is not formed."""

    def solve(self, problem, *arguments, **given):
        result = super().solve(problem, *arguments, **given)
        if problem.A.matrix_free is not None or problem.A.name == "matrix-free":
            raise NotConverged("stagnated", replace(result, status=Status.STAGNATED, message="stagnated"))
        return result


@pytest.mark.parametrize("explicit", [None, False])
def test_a_formed_in_place_of_solves(monkeypatch, caplog, explicit):
    """Where K is factorised and solves with it are not enough; not against the choice of the user."""
    monkeypatch.setattr(methods, "EXPLICIT_UP_TO", 0)
    problem = block(explicit=explicit)
    assert problem.body.stiffness.linear_solver is DirectSolver and not problem.body.stiffness.explicit
    with caplog.at_level(logging.WARNING, "coulomb"):
        if explicit is None:
            solution = problem.solve(solver=Demanding())
            assert solution.valid and summary(solution)["method"]["compliance"] == "explicit"
            assert problem.body.stiffness.present.why == "stagnated; A is formed instead" == caplog.records[0].message
        else:
            with pytest.raises(NotConverged, match="stagnated"):
                problem.solve(solver=Demanding())
            assert not problem.body.stiffness.explicit and not caplog.records


@pytest.mark.parametrize("stop", [False, True])
def test_multigrid_by_choice_is_named_where_it_has_no_answer(stop):
    """As with springs of 1e6 N/m^3 on two ranks; not if the user stops the run."""
    problem = block(linear_solver=IterativeSolver)
    with pytest.raises(NotConverged) as failure:
        problem.solve(solver=Demanding(), progress=lambda _: stop)
    assert (
        str(failure.value).endswith('; with linear_solver = "auto" or "direct" products by A are more accurate') != stop
    )


@pytest.mark.parametrize("linear_solver", [None, IterativeSolver])
def test_a_thin_body_of_forms(monkeypatch, linear_solver):
    """Forms that are positive definite were called wrong where multigrid needs more iterations than it has."""
    monkeypatch.setattr(methods, "DIRECT_UP_TO", 0)
    monkeypatch.setattr(stiffness, "_ITERATIONS", 20)
    script = Script(coulomb.box((0.16, 0.05, 0.001), CELLS, degree=2), 2)
    load = ufl.inner(script.constant((0.0, 0.0, -384.0 / 0.001)), script.v) * ufl.dx
    held = [script.bc((0.0, 0.0, 0.0), "left")]
    body = coulomb.Body(script.elasticity(2.1e11, 0.3), load, held, faces=script.mesh)
    problem = ContactProblem(body, Contact("bottom", 0.3, gap=1e-3), linear_solver=linear_solver)
    assert problem.body.stiffness.linear_solver is IterativeSolver
    if linear_solver is None:
        assert problem.solve().valid and problem.body.stiffness.present.why
    else:
        with pytest.raises(NotConverged, match="K u = f"):
            problem.solve()


@pytest.mark.parametrize("stop", [True, False])
def test_an_interrupted_run_does_not_change(monkeypatch, by_multigrid, stop):
    """Nor does one that converges."""
    problem = block()
    if stop:
        with pytest.raises(NotConverged) as failure:
            problem.solve(progress=lambda _: True)
        assert failure.value.result.status is Status.INTERRUPTED
    else:
        assert problem.solve().valid
    assert problem.body.stiffness.linear_solver is IterativeSolver and not problem.body.stiffness.present.why


def test_patience_is_of_a_solution(monkeypatch, by_multigrid):
    """The next load step has it again, and what the user asks for afterwards is not refused."""
    problem = block()
    solution = problem.solve()
    taken = problem.linear.stiffness.solver.iterations
    monkeypatch.setattr(problem.body.stiffness, "_patience", 1.5 * taken)
    for time in (1.0, 2.0, 3.0):
        assert problem.at(time).solve().valid
    assert problem.linear.stiffness.solver.iterations > 2.0 * taken and not problem.body.stiffness.present.why
    monkeypatch.setattr(problem.body.stiffness, "_patience", 1.0)
    problem.at(4.0).solve()
    assert problem.body.stiffness.present.why
    x, y = solution.contact_force, np.empty_like(solution.contact_force)
    problem.A.mult(x, y)  # of the problem that was solved by multigrid
    gap = (y - problem.b)[0::3]
    assert np.abs(np.where(x[0::3] > 0.0, gap, np.minimum(gap, 0.0))).max() < 1e-6 * np.abs(problem.b).max()


def test_a_history_goes_on_with_factors(caplog, by_multigrid):
    """The first step changes, and the others are solved by the factors."""
    problem = sheet(amplitude=lambda time: time)
    with caplog.at_level(logging.WARNING, "coulomb"):
        steps = list(LoadHistory([0.9, 1.0]).steps(problem))
    assert changed(problem, caplog)
    assert max(step.halvings for step in steps) <= 1  # of the first, by the kernels of BLAS
    assert all(step.solution.certificate.passed for step in steps)


def test_a_history_by_condensed_systems(wide):
    """The second step begins with one of the forces that other methods take the best of."""
    problem = sheet(CELLS, linear_solver=DirectSolver, amplitude=lambda time: time)
    steps = list(LoadHistory([0.9, 1.0]).steps(problem))
    assert problem.body.stiffness.present.newton is CondensedSystem
    assert [step.halvings for step in steps] == [0, 0] and all(step.solution.certificate.passed for step in steps)


CONDENSED, DENSE = InteriorPoint(newton=CondensedSystem()), InteriorPoint(newton=DenseSystem())


def test_rounding_errors_are_not_corrected():
    """Residuals of K u that are rounding errors bend a sheet by more than its answer is wrong."""
    solution = sheet((24, 6, 1), explicit=False, linear_solver=DirectSolver).solve(solver=CONDENSED)
    assert solution.valid and solution.result.newton_steps < 20


@pytest.mark.parametrize("explicit", [False, True])
def test_sheets_without_a_formed_matrix(monkeypatch, explicit):
    """Products by factors have too large rounding errors for a residual of 1e-8; condensed systems form no A either."""
    monkeypatch.setattr(contact_stiffness, "_PRODUCTS", 3)
    problem = sheet(CELLS, explicit=explicit, linear_solver=DirectSolver)
    assert problem.solve().valid
    assert (problem.body.stiffness.present.newton is CondensedSystem) is not explicit
    assert problem.body.stiffness.explicit is explicit


def thin(thickness, angle=0.0):
    """A strip that is pressed onto the plane at its free end, turned in that plane."""
    strip = coulomb.box((0.16, 0.05, thickness), (6, 2, 1), degree=2)
    return ContactProblem(
        coulomb.moved(strip, rotate=coulomb.Rotation((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), angle)),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.3, gap=1e-4),
        [Traction("top", (0.0, 0.0, -48.0 * (thickness / 5e-4) ** 3))],
        small_strain="warn",
    )


def test_what_rounding_may_leave_of_the_forces_of_a_sheet():
    """Of meshes turned in the plane they differ by up to 7e-5, by the kernels of BLAS, and by less than both may be
    wrong by; of 0.2 mm by 2e-4, if there is an answer."""
    answers = [thin(3e-4, angle).solve() for angle in (0.0, 0.3)]
    first, other = (answer.contact_force[0::3] for answer in answers)
    left = [answer.certificate["resolution"].value for answer in answers]
    assert all(answer.valid for answer in answers) and max(left) < 1e-3
    assert np.abs(other - first).max() / first.max() < sum(left)
    entry, check = summary(answers[0])["certificate"]["resolution"], answers[0].certificate["resolution"]
    assert (entry["value"], entry["limit"], entry["resolved"]) == (check.value, 1e-2, False)
    assert "rounding may leave so much" in check.meaning
    assert "; worst at (0.1" in check.meaning and check.meaning.endswith("m of 'bottom'")


def test_unresolved_forces_of_a_thinner_sheet():
    """From mesh to mesh its forces differ by 1 and more."""
    problem = thin(6e-5)
    with pytest.raises(
        NotConverged, match=r"as thin sheets do: forces are unresolved: rounding .* of 'bottom'"
    ) as failure:
        problem.solve(solver=InteriorPoint(max_iterations=15))
    check = problem.solution(failure.value.result).certificate["resolution"]
    assert not check.passed and "forces are unresolved: rounding may leave so much of the largest" in check.meaning


def pressed(cells, **given):
    """A sheet on its plane, whose compression is 2e10 times smaller than the deflection without the plane."""
    return ContactProblem(
        coulomb.box((0.16, 0.05, 0.0005), cells, degree=2),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (0.0, 0.0, -48.0))],
        **given,
    )


def test_a_pressed_sheet():
    """The remaining gap is not a difference of two deflections where the certificate has refused that."""
    problem = pressed((10, 3, 1))
    solution = problem.solve(solver=DENSE)
    assert solution.valid
    lifted = solution.displacement[:, 2].min() / (-48.0 * 0.0005 / 2.1e11)
    assert 0.5 < lifted < 2.0


def test_dense_systems_in_place_of_condensed_ones(monkeypatch):
    """Where these fail, as on a sheet that is pressed onto its plane."""
    monkeypatch.setattr(contact_stiffness, "_PRODUCTS", 3)
    problem = pressed((10, 3, 1))
    assert problem.solve().valid and problem.body.stiffness.present.newton is DenseSystem
