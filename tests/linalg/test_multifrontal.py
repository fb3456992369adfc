"""Nested dissection and the multifrontal factorisation, against their documented properties and dense algebra."""

import functools

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from conftest import make_block, to_csr
from petsc4py import PETSc

from benchmarks.block import block
from coulomb import Clamp, Contact, ContactProblem, Material, box, join, moved
from coulomb.linalg.compliance import schur_compliance
from coulomb.linalg.compliance.schur_compliance import SchurCompliance
from coulomb.linalg.factors import frontal_factors, multifrontal
from coulomb.linalg.factors.frontal_factors import FrontalFactors
from coulomb.linalg.factors.multifrontal import DenseInverse, MultifrontalSolver
from coulomb.linalg.factors.nested_dissection import dissect
from coulomb.linalg.petsc_arrays import NodalRows, nodal_blocks
from coulomb.solvers import DirectSolver


def grid(*counts):
    """Nodes of a box that are coupled with their up to 26 neighbours, and their coordinates."""
    graph = scipy.sparse.csr_matrix(np.ones((1, 1)))
    for count in counts:
        line = scipy.sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], (count, count))
        graph = scipy.sparse.kron(graph, line, format="csr")
    points = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    return graph, points


def operations(fronts):
    own, border = (3.0 * np.array([len(getattr(front, what)) for front in fronts]) for what in ("own", "border"))
    return float(np.sum(own**3 / 3 + own**2 * border + own * border**2))


def check(graph, fronts, last):
    """The properties that the factorisation requires."""
    position = np.empty(graph.shape[0], dtype=int)
    order = np.concatenate([front.own for front in fronts])
    assert np.array_equal(np.sort(order), np.arange(graph.shape[0]))
    position[order] = np.arange(len(order))
    roots = [front for front in fronts if front.root]
    assert fronts[-1].root and all(len(root.border) == 0 for root in roots)
    assert set(np.concatenate([root.own for root in roots])) == set(last)
    parents = {child: number for number, front in enumerate(fronts) for child in front.children}
    assert sorted(parents) == [number for number, front in enumerate(fronts) if not front.root]
    for number, front in enumerate(fronts):
        below = [fronts[child].border for child in front.children]
        coupled = set(graph[front.own].indices) | {int(node) for border in below for node in border}
        latest = position[front.own].max(initial=-1)
        later = {node for node in coupled if node not in front.own and position[node] > latest}
        assert set(front.border) == later
        if number not in parents:
            continue
        parent = fronts[parents[number]]
        assert parents[number] > number
        both = np.concatenate([parent.own, parent.border])
        places = np.concatenate([np.arange(at, at + count) for _, at, count in front.runs] or [[]]).astype(int)
        assert np.array_equal(both[places], front.border)
        assert front.runs[:, 2].sum() == len(front.border)
        assert all(at >= len(parent.own) or at + count <= len(parent.own) for _, at, count in front.runs)


@pytest.mark.parametrize("leaf", [1, 4, 80])
def test_properties_of_the_fronts(leaf):
    """Of a straight mesh, an oblique one, and one on which nodes coincide or are anywhere."""
    graph, points = grid(9, 4, 5)
    last, rng = np.flatnonzero(points[:, 2] == 0.0), np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    for places in (points, (points + 0.1 * rng.random(points.shape)) @ turn, points // 2, rng.random(points.shape)):
        check(graph, dissect(graph, places, last, leaf), last)


def test_bodies_without_a_separating_plane():
    """Nodes all in one place, none before the last, and two bodies that are not coupled."""
    graph, points = grid(4, 3, 3)
    last = np.arange(5)
    check(graph, dissect(graph, np.zeros_like(points), last, 4), last)
    everything = np.arange(len(points))
    fronts = dissect(graph, points, everything, 4)
    check(graph, fronts, everything)
    assert len(fronts) == 1
    pair = scipy.sparse.block_diag([graph, graph], format="csr")
    last = np.array([0, 1, 2, 40, 50, 60, 70])
    fronts = dissect(pair, np.vstack([points, points + [20.0, 0.0, 0.0]]), last, 4)
    check(pair, fronts, last)
    assert [len(front.own) for front in fronts if front.root] == [3, 4]


def test_separators_do_not_depend_on_orientation():
    """Operations grow like nodes squared, as nested dissection of a cube must (George 1973), also of a turned one."""
    turn, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))
    counts = []
    for n in (8, 16):
        graph, points = grid(n, n, 3 * n)
        last = np.flatnonzero(points[:, 0] == 0.0)
        straight = operations(dissect(graph, points, last))
        assert operations(dissect(graph, points @ turn.T, last)) <= 1.1 * straight
        counts.append(straight)
    assert counts[1] / counts[0] <= 1.1 * 8.0**2


def test_borders_are_few_runs():
    graph, points = grid(30, 10, 10)
    fronts = dissect(graph, points, np.flatnonzero(points[:, 2] == 0.0))
    assert np.mean([len(front.runs) for front in fronts]) <= 12.0


def test_less_work_than_mumps_beside_a_schur_complement():
    """At p = 10 MUMPS takes 6.8e9 operations with AMD, Debian's only ordering, and 1.8e9 without a Schur complement."""
    problem = block(10, explicit=True)
    solver = problem.body.stiffness.solver
    assert operations(solver.fronts) <= 4.5e9
    assert 1.0 < operations(solver.fronts) / DirectSolver(problem.elasticity.K).factor.getMumpsRinfog(3) < 3.0


def test_bodies_are_factorised_by_themselves(monkeypatch):
    """Two bodies of different size, with nodes that are coupled with none: as by dense algebra, each with its front."""
    lower = box((1.0, 1.0, 0.5), (5, 4, 3))
    upper = moved(box((0.8, 0.8, 0.4), (4, 3, 2), "tetrahedron"), (0.1, 0.1, 0.5))
    contact = Contact("upper:bottom", against="lower:top", friction=0.3)
    supports = [Clamp("lower:bottom"), Clamp("upper:top")]
    problem = ContactProblem(join(lower=lower, upper=upper), Material(2e11, 0.3), supports, contact, explicit=True)
    solver, K, A = problem.body.stiffness.solver, problem.elasticity.K, problem.A
    assert [len(L) for L in solver.schur_factors] == [60, 90]
    inverse = np.linalg.inv(to_csr(K).toarray())
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng(4).standard_normal(rhs.getSize())
    solver.solve(rhs, u)
    assert np.linalg.norm(u.array - inverse @ rhs.array) <= 1e-10 * np.linalg.norm(u.array)
    B = to_csr(problem.surface.free_B)
    dense = B @ (B @ inverse).T
    assert np.allclose(A.dense(), dense, rtol=0.0, atol=1e-10 * np.abs(dense).max())
    assert np.diff(A._rows.indptr).max() > 6  # its rows see several nodes of the lower body
    assert np.allclose(A.diagonal(), np.diag(dense), rtol=1e-9, atol=0.0)
    x, y = np.random.default_rng(5).standard_normal(len(dense)), np.empty(len(dense))
    A.mult(x, y)
    assert np.linalg.norm(y - dense @ x) <= 1e-10 * np.linalg.norm(y)
    assert not solver._inverses
    monkeypatch.setattr(schur_compliance, "_FEW", 0)  # as with more contact points
    many = MultifrontalSolver(K, problem.elasticity.x, np.sort(solver.last), many=True)
    for also in (solver, many):
        A = SchurCompliance(problem.surface.free_B, also)
        assert np.allclose(A.diagonal(), np.diag(dense), rtol=1e-9, atol=0.0)
        assert len(also._halves) == 2
        assert np.allclose(A.formed(), dense, rtol=0.0, atol=1e-12 * np.max(dense))
        for _ in range(20):  # 150/8: from the 19th solve on by the inverse of each body's Schur complement
            A.mult(x, y)
            assert np.linalg.norm(y - dense @ x) <= 1e-10 * np.linalg.norm(y)
        assert len(also._inverses) == 2 and not also._halves


def test_a_matrix_that_is_not_positive_definite():
    problem = make_block(2)
    K = problem.elasticity.K.copy()
    K.shift(-2.0 * K.getDiagonal().max()[1])
    with pytest.raises(ValueError, match="not positive definite"):
        MultifrontalSolver(K, problem.elasticity.x, np.sort(problem.surface.nodes))


def test_same_residual_as_mumps_where_stiffnesses_differ():
    """Columns of K scaled over eight decades: backward stable as Cholesky is."""
    problem = make_block(4)
    K, x = problem.elasticity.K.copy(), problem.elasticity.x
    scale = K.createVecLeft()
    scale.array[:] = np.repeat(10.0 ** np.random.default_rng(6).uniform(-4, 4, len(x)), 3)
    K.diagonalScale(scale, scale)
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng(7).standard_normal(rhs.getSize()) * scale.array
    errors = []
    for solver in (MultifrontalSolver(K, x, np.sort(problem.surface.nodes)), DirectSolver(K)):
        solver.solve(rhs, u)
        r = K * u - rhs
        errors.append(np.abs(r.array / scale.array).max())
    assert errors[0] <= 10.0 * errors[1] + 1e-12
    assert K.norm(PETSc.NormType.INFINITY) > 0.0


@pytest.mark.parametrize(
    ("edges", "last"),
    [
        ([(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)], [3, 4, 5]),  # some of the last nodes are coupled with last ones only
        # two parts with no separator between them, below one that has
        ([(0, 1), (2, 3), (1, 4), (3, 4), (4, 5), (5, 6), (6, 7), (8, 0), (8, 2), (8, 7)], [8]),
    ],
)
@pytest.mark.parametrize("single", [False, True])
def test_small_graphs(edges, last, single, monkeypatch):
    """Against dense algebra, with fronts of a node or two; forces of any size, which single precision cannot have."""
    monkeypatch.setattr(multifrontal, "dissect", functools.partial(dissect, leaf=1))
    count = 1 + max(map(max, edges))
    graph = np.eye(count)
    graph[tuple(np.array(edges).T)] = graph[tuple(np.array(edges).T[::-1])] = 1.0
    random = np.random.default_rng(8).standard_normal((3 * count, 3 * count))
    K = (random + random.T) * np.kron(graph, np.ones((3, 3))) + 30.0 * np.eye(3 * count)
    csr = scipy.sparse.csr_matrix(K)
    matrix = PETSc.Mat().createAIJ(K.shape, csr=(csr.indptr, csr.indices, csr.data), bsize=3, comm=PETSc.COMM_SELF)
    points = np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(float)
    with monkeypatch.context() as patch:  # memory is what it was before
        patch.setattr(frontal_factors.np, "empty", lambda shape, dtype=float, **_: np.full(shape, 7.0, dtype))
        solver = MultifrontalSolver(matrix, points, np.array(last), single)
    f, u = matrix.createVecs()
    for size in (1.0, 1e60, 1e-60):
        f.array[:] = size * random[0]
        solver.solve(f, u)
        assert np.allclose(u.array, size * np.linalg.solve(K, random[0]), rtol=1e-11, atol=1e-13 * size)
    rows = (3 * solver.last[:, None] + np.arange(3)).ravel()
    L = np.tril(scipy.linalg.block_diag(*solver.schur_factors))
    inverse = np.linalg.inv(K)[np.ix_(rows, rows)]
    assert np.allclose(L @ L.T @ inverse, np.eye(len(rows)), atol=1e-5 if single else 1e-12)
    assert solver.single == single


def rows_and_fronts():
    """K of a small block, and its fronts."""
    problem = block(3, cell="tetrahedron")
    K, x = nodal_blocks(problem.elasticity.K), problem.elasticity.x
    graph = scipy.sparse.csr_matrix((np.ones(len(K.indices)), K.indices, K.indptr), shape=(len(x),) * 2)
    return NodalRows(K), dissect(graph, x, np.sort(problem.surface.nodes), 7), K.toarray()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_factors_and_substitutions(dtype):
    """Against dense matrices: L L^T = K, substitutions with L."""
    rows, fronts, K = rows_and_fronts()
    assert len(fronts) > 5
    factors = FrontalFactors(rows, fronts, dtype)
    unknowns = (3 * factors.order[:, None] + np.arange(3)).ravel()
    dense = K[np.ix_(unknowns, unknowns)].astype(np.float64)
    limit = 200 * np.finfo(dtype).eps
    L = np.linalg.cholesky(dense)
    several = np.random.default_rng(3).standard_normal((4, len(unknowns))).astype(dtype)
    several[1:3, : len(unknowns) - 3 * len(fronts[-1].own)] = 0.0  # on the nodes of the last front alone
    for x in (several[0], several[1], several):
        given = x.astype(np.float64)
        factors.forward(x)
        size = np.abs(L).max() * np.abs(x).max()
        assert np.abs(x @ L.T - given).max() <= limit * size
        given = x.astype(np.float64)
        factors.backward(x)
        size = np.abs(L).max() * np.abs(x).max()
        assert np.abs(x @ L - given).max() <= limit * size


# --- products with the inverse of a front: by its lower triangle, and by the columns of what is not 0 ---


def triangle(n, seed=1):
    """A symmetric matrix, and its lower triangle with other numbers above the diagonal."""
    rng = np.random.default_rng(seed)
    half = rng.standard_normal((n, n))
    whole = half + half.T
    lower = np.asfortranarray(np.tril(whole) + np.triu(rng.standard_normal((n, n)), 1))
    return whole, lower


@pytest.mark.parametrize("n", [1, 3, 30, 61])
def test_products(n):
    """Whatever is not 0: of earlier products, new, few, many, nothing."""
    whole, lower = triangle(n)
    inverse, rng = DenseInverse(lower), np.random.default_rng(n)
    for part in (0.1, 0.1, 0.2, 1.0, 0.05, 0.3, 0.3, 0.33, 0.33, 0.0, 0.1):
        z = np.where(rng.random(n) < part, rng.standard_normal(n), 0.0)
        assert inverse @ z == pytest.approx(whole @ z, rel=1e-12, abs=1e-12)


def test_columns_are_gathered_once():
    """What is gathered is not read again from the triangle, until there is no more room."""
    whole, lower = triangle(30)
    inverse, z = DenseInverse(lower), np.zeros(30)
    z[[3, 17, 29]] = 1.0, -2.0, 0.5
    expected = whole @ z
    assert inverse @ z == pytest.approx(expected)
    lower[:] = np.nan
    assert inverse @ z == pytest.approx(expected)
    z[4:14] = 1.0
    assert np.isnan(inverse @ z).any()
