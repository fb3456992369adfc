"""Factorisation with fronts shared by the ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import itertools
import math

import numpy as np
import pytest
import scipy.sparse
from conftest import make_block, to_csr
from mpi4py import MPI
from petsc4py import PETSc
from ranks import everywhere, same_error

from benchmarks.block import block
from coulomb import Clamp, Contact, ContactProblem, Material, Plane, Traction, box, join, moved
from coulomb.linalg.compliance import predicted_cost as methods
from coulomb.linalg.compliance.schur_compliance import SchurCompliance
from coulomb.linalg.factors import blas, distributed_multifrontal, nested_dissection
from coulomb.linalg.factors.distributed_multifrontal import DistributedMultifrontalSolver, SharedSymbolic
from coulomb.model import contact_stiffness
from coulomb.solvers import DirectSolver, IterativeSolver

comm = MPI.COMM_WORLD


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    """Parts are cut on small meshes, too."""
    monkeypatch.setattr(nested_dissection, "LEAF", 8)


def dense(matrix):
    """All rows of a distributed matrix, on every rank."""
    return np.concatenate(comm.allgather(to_csr(matrix).toarray()))


def two_bodies():
    """Bodies of different size, with held nodes that are coupled with none, and a rank without nodes of the second."""
    lower = box((1.0, 1.0, 0.5), (5, 4, 3))
    upper = moved(box((0.8, 0.8, 0.4), (4, 3, 2), "tetrahedron"), (0.1, 0.1, 0.5))
    contact = Contact("upper:bottom", against="lower:top", friction=0.3)
    supports = [Clamp("lower:bottom"), Clamp("upper:top")]
    return ContactProblem(join(lower=lower, upper=upper), Material(2e11, 0.3), supports, contact)


@pytest.mark.parametrize("make", [lambda: make_block(3), lambda: block(2, cell="tetrahedron"), two_bodies])
@pytest.mark.parametrize("single", [False, True])
def test_against_dense_algebra(make, single):
    """Products with K^-1 to rounding in both precisions; of A by the factors as accurate as these are."""
    problem = make()
    K, B = problem.elasticity.K, problem.surface.free_B
    solver = DistributedMultifrontalSolver(K, problem.elasticity.x, problem.surface.nodes_in_rows, single)
    assert set(solver.last) == set(everywhere(problem.surface.nodes_in_rows))
    inverse = np.linalg.inv(dense(K))
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng([4, comm.rank]).standard_normal(rhs.getLocalSize())
    solver.solve(rhs, u)
    expected = inverse @ everywhere(rhs.array)
    assert np.linalg.norm(everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)
    in_any_order = DistributedMultifrontalSolver(K, problem.elasticity.x, np.empty(0, dtype=np.int64), single)
    in_any_order.solve(rhs, u)
    assert np.linalg.norm(everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)
    tiny = rhs * 1e-60  # single precision has a smaller range
    solver.solve(tiny, u)
    assert np.linalg.norm(1e60 * everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)
    rows = dense(B)
    whole, A = rows @ inverse @ rows.T, SchurCompliance(B, solver)
    assert np.allclose(everywhere(A.diagonal()), np.diag(whole), rtol=1e-3 if single else 1e-9, atol=0.0)
    x = np.random.default_rng([5, comm.rank]).standard_normal(3 * A.nodes)
    y = np.empty_like(x)
    for tolerance, accuracy in ((0.0, 1e-10), (1e-2, 1e-3 if single else 1e-10)):
        A.mult(x, y, tolerance)
        assert np.linalg.norm(everywhere(y) - whole @ everywhere(x)) <= accuracy * np.linalg.norm(whole @ everywhere(x))
    assert solver.single == single and (solver.refinements > 0) == single


@pytest.mark.parametrize("single", [False, True])
def test_without_nodes_to_eliminate_last(single):
    """As of a body that nothing touches: its last front is empty."""
    K = two_bodies().elasticity.K
    points = np.random.default_rng([6, comm.rank]).random((K.getLocalSize()[0] // 3, 3))  # they determine the work only
    solver = DistributedMultifrontalSolver(K, points, np.empty(0, np.int64), single)
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng([4, comm.rank]).standard_normal(rhs.getLocalSize())
    solver.solve(rhs, u)
    expected = np.linalg.solve(dense(K), everywhere(rhs.array))
    assert np.linalg.norm(everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)


def test_bodies_are_cut_into_parts_that_are_not_coupled():
    problem = make_block(4)
    K = problem.elasticity.K
    solver = DistributedMultifrontalSolver(K, problem.elasticity.x, problem.surface.nodes_in_rows)
    found = solver._symbolic.dissection
    assert sorted(part.rank for part in found.parts) == list(range(comm.size))
    assert np.array_equal(
        np.sort(np.concatenate([one.own for one in (*found.parts, *found.fronts)])), range(len(found.label))
    )
    assert max(len(part.own) for part in found.parts) <= 1.5 * len(found.label) / comm.size
    coupled = scipy.sparse.csr_matrix(dense(K)).tocoo()
    row, column = coupled.row // 3, coupled.col // 3
    for number, part in enumerate(found.parts):
        mine = found.label[row] == number
        later = column[mine & (found.label[column] != number)]
        assert np.all(found.label[later] >= len(found.parts)) and set(later) == set(part.border)


def test_parts_go_to_the_ranks_that_have_most_of_their_rows():
    """Of all ways to give each rank a part, that with the fewest rows to send."""
    problem = make_block(4)
    K = problem.elasticity.K
    found = DistributedMultifrontalSolver(K, problem.elasticity.x, problem.surface.nodes_in_rows)._symbolic.dissection
    ranges = K.getOwnershipRanges() // 3
    rows = np.array([np.histogram(part.own, ranges)[0] for part in found.parts])  # of a part, on a rank
    kept = sum(rows[number, part.rank] for number, part in enumerate(found.parts))
    ways = itertools.permutations(range(comm.size), len(found.parts))
    assert kept == max(sum(rows[number, rank] for number, rank in enumerate(way)) for way in ways)


@pytest.mark.parametrize("where", ["part", "contact"])
def test_a_matrix_that_is_not_positive_definite(where):
    """The failure of one rank is an error on all."""
    problem = make_block(2)
    K = problem.elasticity.K.copy()
    nodes = problem.surface.nodes_in_rows if where == "contact" else np.flatnonzero(problem.elasticity.x[:, 2] > 0.9)
    diagonal = K.getDiagonal()
    largest = diagonal.max()[1]
    rows = 3 * nodes + (0 if where == "contact" else K.getOwnershipRange()[0])
    diagonal.setValues(rows.astype(PETSc.IntType), np.full(len(rows), -largest))
    diagonal.assemble()
    K.setDiagonal(diagonal)
    text = same_error(lambda: DistributedMultifrontalSolver(K, problem.elasticity.x, problem.surface.nodes_in_rows))
    assert "not positive definite" in text


def test_the_default_is_shared_on_several_ranks():
    """With the forces of one rank to 1e-8."""

    def cube(comm):
        mesh, pull = box((1.0, 1.0, 1.0), (5, 4, 3), comm=comm), Traction("top", (1e7, 2e7, -4e7))
        return ContactProblem(mesh, Material(2e11, 0.3), [Clamp("left")], Contact("bottom", 0.3), [pull])

    alone, together = cube(MPI.COMM_SELF).solve(1e-10), cube(comm).solve(1e-10)
    assert ("shared fronts" in together.problem.body.stiffness.method) == (comm.size > 1)
    order = np.lexsort(everywhere(together.problem.surface.x).round(9).T)
    forces = everywhere(together.force_on_body)[order]
    expected = alone.force_on_body[np.lexsort(alone.problem.surface.x.round(9).T)]
    assert np.linalg.norm(forces - expected) <= 1e-8 * np.linalg.norm(expected)
    assert together.certificate.passed


def test_work_of_the_ranks_together():
    """Operations and bytes as of the factors that are made; no rank has more than all, or less than its share."""
    problem = make_block(4)
    nodes = problem.surface.nodes_in_rows
    found = SharedSymbolic(problem.elasticity.K, problem.elasticity.x, nodes)
    work = found.work()
    assert comm.allgather(work) == [work] * comm.size
    assert work.operations / comm.size <= work.longest <= work.operations
    solver = DistributedMultifrontalSolver(problem.elasticity.K, problem.elasticity.x, nodes, True, found)
    kept = [part._factors.heads for part in solver._factors._parts]
    parts = comm.allreduce(sum(head.nbytes for heads in kept for head in heads))
    assert parts + 4 * (3 * len(solver.last)) ** 2 <= work.bytes  # and the separators
    if comm.size > 1:
        assert work.longest < work.operations


@pytest.mark.parametrize("direct", [True, False])
def test_the_ranks_choose_together_by_predicted_seconds(monkeypatch, direct):
    """All as the first one, and with the fronts that were found."""
    monkeypatch.setattr(methods, "_SMALL", (0, 0))
    monkeypatch.setattr(contact_stiffness, "factorise", lambda *_: direct == (comm.rank == 0))
    body = make_block(3).body
    assert body.stiffness.explicit is direct and body.stiffness.linear_solver is (
        DirectSolver if direct else IterativeSolver
    )
    monkeypatch.undo()
    monkeypatch.setattr(methods, "_SMALL", (0, 0))
    monkeypatch.setattr(contact_stiffness, "least_room", lambda _: math.inf if direct else 0.0)
    problem = make_block(3)
    assert problem.body.stiffness.explicit is direct
    if direct:
        monkeypatch.setattr(distributed_multifrontal, "dissect_shared", lambda *_: pytest.fail("dissected again"))
        assert problem.solve().certificate.passed


def test_what_is_known_before_is_the_same_on_any_number_of_ranks():
    """A face of which an end is near its plane."""
    both = []
    for ranks in (comm, MPI.COMM_SELF):
        body = box((1.0, 0.1, 0.1), (20, 2, 2), comm=ranks)
        contact = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, -0.1), (5e-3, 0.0, 1.0)))
        both.append(ContactProblem(body, Material(2e11, 0.3), [Clamp("left")], contact).body.stiffness.measures)
    assert both[0] == pytest.approx(both[1], rel=1e-12) and 0.1 < both[0].near < 0.3


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_blas_on_blocks_of_matrices(dtype):
    """Blocks with a stride between columns, against numpy; matrices in C order are refused."""
    W = np.asfortranarray(np.random.default_rng(1).standard_normal((50, 60)).astype(dtype))
    C = W[30:50, 30:55].copy(order="F")
    tolerance = 100 * np.finfo(dtype).eps
    expected = C + 2.0 * W[3:23, 5:15] @ W[10:35, 20:30].T
    blas.gemm(2.0, W[3:23, 5:15], W[10:35, 20:30], 1.0, C, transposed=True)
    assert np.allclose(C, expected, atol=tolerance)
    blas.gemm(-1.0, W[3:23, 5:15], W[20:30, 7:32], 0.0, C)
    assert np.allclose(C, -W[3:23, 5:15] @ W[20:30, 7:32], atol=tolerance)
    S = np.zeros((30, 30), dtype, order="F")
    S[5:25, 5:25] = W[:20, :20] @ W[:20, :20].T + 20.0 * np.eye(20)
    L = np.linalg.cholesky(S[5:25, 5:25].copy())
    assert blas.potrf(S[5:25, 5:25]) == 0 and np.allclose(np.tril(S[5:25, 5:25]), L, atol=tolerance)
    for transposed in (False, True):
        X = W[:10, :20].copy(order="F")
        blas.trsm_right(S[5:25, 5:25], X, transposed)
        assert np.allclose(X @ (L.T if transposed else L), W[:10, :20], atol=tolerance)
    blas.trtri(S[5:25, 5:25])
    assert np.allclose(np.tril(S[5:25, 5:25]) @ L, np.eye(20), atol=tolerance)
    assert blas.potrf(np.asfortranarray(-np.eye(3, dtype=dtype))) == 1
    with pytest.raises(ValueError, match="Fortran"):
        blas.potrf(np.ones((3, 3), dtype)[:, ::-1])
