"""`solve_coulomb` with few contacts, where checks, sweeps and the answer are one call of C: the same as in Python."""

import numpy as np
import pytest
import scipy.sparse
from conftest import random_spd
from petsc4py import PETSc
from shared_problems import residual_of

from coulomb import NotConverged, Status, solve_coulomb, solve_tresca
from coulomb.solvers import KPRGP, ConeInteriorPoint, FrictionLaw, FrictionProblem
from coulomb.solvers.rigid import gauss_seidel, matrix_problems
from coulomb.solvers.rigid.cones import Scales

SPD = np.array([[3.0, 0.2, 0.1], [0.2, 2.0, 0.0], [0.1, 0.0, 2.0]])


def changed(i, j, value, A=SPD):
    A = A.copy()
    A[i, j] = value
    return A


WRONG = [
    (changed(0, 0, np.nan), np.ones(3), 0.3, "A has entries that are not finite"),
    (changed(1, 2, np.inf), np.ones(3), 0.3, "A has entries that are not finite"),
    (changed(1, 2, -np.inf, changed(2, 1, -np.inf)), np.ones(3), 0.3, "A has entries that are not finite"),
    (changed(0, 1, 0.2 + 5e-8), np.ones(3), 0.3, "A must be symmetric"),
    (changed(0, 1, -0.2), np.ones(3), 0.3, "A must be symmetric"),
    (changed(1, 1, -1.0), np.ones(3), 0.3, "A must be positive semidefinite, but has a diagonal entry"),
    (np.diag([3.0, -2.0, -2.0]), np.ones(3), 0.3, "A must be positive semidefinite, but has a diagonal entry"),
    (changed(0, 0, 0.0), np.ones(3), 0.3, "A must be positive semidefinite, but has a diagonal entry"),
    (np.ones((3, 6)), np.ones(3), 0.3, r"A must be square with three rows per contact, but has shape \(3, 6\)"),
    (np.eye(4), np.ones(4), 0.3, r"A must be square with three rows per contact, but has shape \(4, 4\)"),
    (np.zeros((0, 0)), np.ones(0), 0.3, r"A must be square with three rows per contact, but has shape \(0, 0\)"),
    (SPD, np.ones(6), 0.3, r"b must have shape \(3,\), three entries per contact node, but has \(6,\)"),
    (SPD, np.ones((3, 1)), 0.3, r"b must have shape \(3,\), three entries per contact node, but has \(3, 1\)"),
    (SPD, 1.0, 0.3, r"b must have shape \(3,\), three entries per contact node, but has \(\)"),
    (SPD, [1.0, np.nan, 0.0], 0.3, "b has entries that are not finite"),
    (SPD, [1.0, -np.inf, 0.0], 0.3, "b has entries that are not finite"),
    (SPD, "soft", 0.3, "b must be made of numbers"),
    (SPD, [1.0, 10**400, 0.0], 0.3, "b must be made of numbers"),
    (SPD, [1.0, None, {}], 0.3, "b must be made of numbers"),
    (SPD, np.ones(3), -0.3, "friction has entries that are negative or not finite"),
    (SPD, np.ones(3), np.nan, "friction has entries that are negative or not finite"),
    (SPD, np.ones(3), [np.inf], "friction has entries that are negative or not finite"),
    (SPD, np.ones(3), [0.3, 0.3], r"friction must have shape \(1,\), one per contact node, but has \(2,\)"),
    (SPD, np.ones(3), [[0.3]], r"friction must have shape \(1,\), one per contact node, but has \(1, 1\)"),
    (SPD, np.ones(3), "rough", "friction must be made of numbers"),
]


@pytest.mark.parametrize("kind", [np.asarray, np.asfortranarray, scipy.sparse.csr_matrix, scipy.sparse.csc_matrix])
@pytest.mark.parametrize(("A", "b", "friction", "message"), WRONG)
def test_wrong_input_is_named_in_every_format(A, b, friction, message, kind):
    if A.shape == (0, 0) and kind is not np.asarray:
        return  # scipy's constructors refuse it themselves
    with pytest.raises(ValueError, match=message):
        solve_coulomb(kind(A), b, friction)
    if isinstance(b, np.ndarray):  # all contacts open: an answer that no entry of A changes
        with pytest.raises(ValueError, match=message):
            solve_coulomb(kind(A), -b, friction)


@pytest.mark.parametrize("pairs", [[(0, 1)], [(0, 1), (1, 2), (2, 0)], [(1, 0), (2, 1), (0, 2), (1, 2)]])
def test_a_block_on_one_side_of_the_diagonal_alone(pairs):
    A = np.eye(9)
    for i, j in pairs:
        A[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = 0.1
    for kind in (np.asarray, scipy.sparse.csr_matrix):
        with pytest.raises(ValueError, match="A must be symmetric"):
            solve_coulomb(kind(A), -np.ones(9), 0.3)


@pytest.mark.parametrize("A", [np.array(3.0), np.ones(9), np.ones((3, 3, 3)), "stiff", None, [[1.0, {}]]])
def test_what_is_no_matrix(A):
    with pytest.raises(ValueError, match="A must be"):
        solve_coulomb(A, np.ones(3), 0.3)


@pytest.mark.parametrize("indices", [[0, 1, 7], [0, 1, -1], [0, 1, 2**31 - 1]])
def test_entries_outside_the_matrix_are_left_alone(indices):
    """scipy's own constructor checks little: the kernel must not write there."""
    A = scipy.sparse.identity(3, format="csr")
    A.indices = np.array(indices, dtype=np.int32)
    assert gauss_seidel.sweep(A, np.ones(3), 0.3, 1e-8) is None
    for pointers in ([0, 2, 1, 3], [0, 1, 2, 9], [-3, 1, 2, 3]):
        A = scipy.sparse.identity(3, format="csr")
        A.indptr = np.array(pointers, dtype=np.int32)
        assert gauss_seidel.sweep(A, np.ones(3), 0.3, 1e-8) is None


def a_problem(contacts=6, seed=3):
    rng = np.random.default_rng(seed)
    return random_spd(3 * contacts, 30.0, rng), rng.standard_normal(3 * contacts), rng.uniform(0.1, 1.0, contacts)


def formats(A):
    """The same matrix in every form in which a user may have it."""
    csr = scipy.sparse.csr_matrix(A)
    n = len(A)
    backwards = np.concatenate([range(b - 1, a - 1, -1) for a, b in zip(csr.indptr, csr.indptr[1:], strict=False)])
    unsorted = scipy.sparse.csr_matrix((csr.data[backwards], csr.indices[backwards], csr.indptr), shape=A.shape)
    halves = np.repeat(0.5 * csr.data, 2), np.repeat(csr.indices, 2), 2 * csr.indptr
    wide = scipy.sparse.csr_matrix(A)
    wide.indices, wide.indptr = wide.indices.astype(np.int64), wide.indptr.astype(np.int64)
    padded = np.full((2 * n, 3 * n), np.nan)
    padded[::2, ::3] = A
    yield from (A, np.asfortranarray(A), A[::-1, ::-1].copy()[::-1, ::-1], padded[::2, ::3], A.tolist())
    yield from (csr, unsorted, scipy.sparse.csr_matrix(halves, shape=A.shape), wide)
    yield from (scipy.sparse.csc_matrix(A), scipy.sparse.coo_matrix(A), scipy.sparse.bsr_matrix(A, blocksize=(3, 3)))


def test_every_format_and_no_sweeps_give_the_same_forces():
    A, b, friction = a_problem()
    answers = [solve_coulomb(kind, b, friction) for kind in formats(A)]
    assert {answer.newton_steps for answer in answers} == {0}
    plain = solve_coulomb(A, b, friction, ConeInteriorPoint(sweeps=False))
    assert plain.newton_steps > 0
    for answer in answers:
        assert answer.status is Status.CONVERGED and answer.method == f"auto: {plain.method}"
        for name in ("x", "gradient", "slip_bound", "multipliers"):
            ours, theirs = getattr(answer, name), getattr(plain, name)
            assert ours.shape == theirs.shape
            assert np.allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())


def test_all_is_one_call_where_sweeps_converge(monkeypatch):
    """No compliance of PETSc is made, nor any other method asked."""
    monkeypatch.setattr(matrix_problems, "_compliance", None)
    for A in (SPD, scipy.sparse.csr_matrix(SPD), scipy.sparse.csc_matrix(SPD)):
        assert solve_coulomb(A, [-1.0, 5.0, 0.0], 0.3).products == 1
        assert not solve_coulomb(A, np.zeros(3), np.array([0.3])).x.any()
    with pytest.raises(TypeError):
        solve_coulomb(SPD, np.ones(3), 0.3, cohesion=1.0)


@pytest.mark.parametrize("asymmetric", [0.0, 5e-9])
def test_residual_is_that_of_the_matrix_as_given(asymmetric):
    """As the rest of the package and plain numpy compute it; the sweeps, that use symmetry, may differ from it."""
    rng = np.random.default_rng(5)
    for seed in range(30):
        A, b, friction = a_problem(4, seed)
        A += asymmetric * np.linalg.norm(A) * np.triu(rng.choice([-1.0, 1.0], A.shape), 1)
        found = gauss_seidel.sweep(A, b, friction, 1e-8)
        x, w = found.x, A @ found.x - b
        problem = FrictionProblem.coulomb(matrix_problems._compliance(A), b, friction)
        assert found.residual == pytest.approx(Scales.of(problem).residual(problem, x, w), rel=1e-6, abs=1e-15)
        own = residual_of(A, b, FrictionLaw.coulomb(friction).radius, x)
        assert own <= found.residual * (1.0 + 1e-6) + 1e-15
        assert np.allclose(found.gradient, w, atol=1e-13)
        assert np.allclose(found.slip_bound, friction * np.maximum(x[0::3], 0.0))
        slips = np.hypot(*w.reshape(-1, 3)[:, 1:].T)
        assert np.allclose(found.multipliers, np.column_stack([np.maximum(w[0::3], 0.0), slips]), atol=1e-12)


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize("factor", [1e-100, 1e-12, 1e12, 1e200, 1e306])
def test_units_far_from_one(factor):
    """Where numbers would overflow the other way is taken; forces are the same."""
    A, b, friction = a_problem(2)
    expected = solve_coulomb(A, b, friction).x
    assert np.allclose(solve_coulomb(A * min(factor, 1e100), b * min(factor, 1e100), friction).x, expected, rtol=1e-6)
    try:
        x = solve_coulomb(A, b * factor, friction).x
    except (NotConverged, ValueError):
        assert factor > 1e300
    else:
        assert np.allclose(x / factor, expected, rtol=1e-6)


# --- `solve_tresca`, and matrices of PETSc ---


def test_one_contact_by_hand():
    assert np.allclose(solve_tresca(np.eye(3), [2.0, 3.0, 4.0], 1.0).x, [2.0, 0.6, 0.8], atol=1e-7)
    assert np.allclose(solve_tresca(np.eye(3), [2.0, 3.0, 4.0], [1.0], lower=2.5).x, [2.5, 0.6, 0.8], atol=1e-7)
    assert np.allclose(solve_coulomb(np.eye(3), [2.0, 3.0, 4.0], 0.5).x, [2.0, 0.6, 0.8], atol=1e-7)


def test_numpy_scipy_and_petsc_alike():
    rng = np.random.default_rng(81)
    A = random_spd(30, 100.0, rng)
    b, g = rng.standard_normal(30), rng.uniform(0.1, 1.0, 10)
    petsc = PETSc.Mat().createDense(A.shape, array=np.asfortranarray(A), comm=PETSc.COMM_SELF)
    petsc.assemble()
    answers = [solve_tresca(kind, b, g).x for kind in (A, A.tolist(), scipy.sparse.csr_matrix(A), petsc)]
    for x in answers[1:]:
        assert np.allclose(x, answers[0], atol=1e-10)
    assert np.allclose(solve_tresca(A, b, g, solver=KPRGP()).x, answers[0], atol=1e-6)
    assert np.allclose(solve_coulomb(scipy.sparse.csc_matrix(A), b, 0.3).x, solve_coulomb(A, b, np.full(10, 0.3)).x)


@pytest.mark.parametrize(
    ("A", "b", "g", "message"),
    [
        (np.ones((3, 6)), np.zeros(3), 1.0, r"A must be square .* shape \(3, 6\)"),
        (-np.eye(3), np.zeros(3), 1.0, "A must be positive semidefinite"),
        (np.eye(3), np.zeros(6), 1.0, r"b must have shape \(3,\)"),
        (np.eye(3), [0.0, np.nan, 0.0], 1.0, "b has entries that are not finite"),
        (np.eye(3), np.zeros(3), [1.0, 1.0], r"slip_bound must have shape \(1,\)"),
        (np.eye(3), np.zeros(3), -1.0, "slip_bound has negative entries"),
        ("stiff", np.zeros(3), 1.0, "A must be made of numbers"),
    ],
)
def test_wrong_input_of_trescas_problem(A, b, g, message):
    with pytest.raises(ValueError, match=message):
        solve_tresca(A, b, g)


def test_an_open_contact_without_tangential_compliance_and_friction():
    """Alone, and beside three that press: rows without compliance and friction are no unknowns."""
    alone = solve_coulomb(np.diag([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), np.array([0.0]))
    assert not np.any(alone.x) and alone.residual == 0.0
    A = random_spd(9, 10.0, np.random.default_rng(4))
    A[4:6] = A[:, 4:6] = 0.0
    b = np.array([2.0, -1.0, 0.3, -30.0, 0.0, 0.0, 1.5, 0.5, 0.2])
    expected = np.zeros(9)
    pressing = [k for k in (0, 6) if np.linalg.solve(A[::6, ::6], b[::6])[k // 6] > 0.0]
    expected[pressing] = np.linalg.solve(A[np.ix_(pressing, pressing)], b[pressing])
    assert np.all((A @ expected - b)[::3] > -1e-9)
    for solved in (solve_coulomb(A, b, 0.0), solve_tresca(A, b, 0.0)):
        assert solved.x == pytest.approx(expected, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("seed", [2, 3, 6])
def test_contacts_in_units_of_their_own(seed):
    """D A D, D b and g / D, compliances over 16 decades: D times the forces are those of A, b, g."""
    random, m = np.random.default_rng(seed), 12
    G = random.normal(size=(3 * m + 3, 3 * m))
    A = G.T @ G / (3 * m)
    b = A @ random.normal(size=3 * m) - np.tile([2.0, 0.0, 0.0], m) * random.uniform(size=3 * m)
    D = np.repeat(10.0 ** random.uniform(-4, 4, m), 3)
    scaled = D[:, None] * A * D, D * b
    for one, other in (
        (solve_coulomb(A, b, 0.5), solve_coulomb(*scaled, 0.5)),
        (solve_tresca(A, b, 0.2), solve_tresca(*scaled, 0.2 / D[::3])),
    ):
        assert D * other.x == pytest.approx(one.x, abs=1e-7 * np.abs(one.x).max())
        assert other.gradient / D == pytest.approx(one.gradient, abs=1e-7 * np.abs(one.gradient).max())
        assert D[::3] * other.slip_bound == pytest.approx(one.slip_bound, abs=1e-7 * one.slip_bound.max())
