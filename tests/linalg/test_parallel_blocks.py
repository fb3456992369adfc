"""Products in small dense blocks on any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import contextlib
import ctypes

import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from benchmarks.block import block
from coulomb.linalg.compliance import stiffness
from coulomb.linalg.multigrid import block_matrix, multigrid_cycle
from coulomb.linalg.multigrid.block_matrix import (
    SHAPES,
    BlockInterpolation,
    SymmetricBlocks,
    distributed_blocks,
    in_kernel_blocks,
    padded,
    sum_of,
    symmetric_blocks,
)
from coulomb.linalg.multigrid.recycled_cg import RecycledCG
from coulomb.linalg.petsc_arrays import Entries, distributed_entries

COMM = MPI.COMM_WORLD


def in_blocks(rows, columns, shape, density, rng):
    """A random matrix of dense blocks, the same on all ranks."""
    pattern = scipy.sparse.random(rows, columns, density, random_state=3)
    return scipy.sparse.kron(pattern, np.ones(shape)).multiply(
        rng.standard_normal((rows * shape[0], columns * shape[1]))
    )


def shares(count, size):
    """First rows of the ranks, in whole blocks; the last rank of several has none."""
    parts = max(COMM.size - 1, 1)
    edges = np.append(np.arange(parts + 1) * count // parts, count)[: COMM.size + 1]
    return size * edges


def distributed(matrix, rows, columns):
    csr = scipy.sparse.csr_matrix(matrix)[rows[COMM.rank] : rows[COMM.rank + 1]]
    csr.sort_indices()
    sizes = [(np.diff(edges)[COMM.rank], edges[-1]) for edges in (rows, columns)]
    petsc = PETSc.Mat().createAIJ(sizes, comm=COMM)
    petsc.setPreallocationCSR((csr.indptr.astype(PETSc.IntType), csr.indices.astype(PETSc.IntType), csr.data))
    petsc.assemble()
    return petsc


def part(values, edges):
    v = padded(edges[COMM.rank + 1] - edges[COMM.rank])
    v[:] = values[edges[COMM.rank] : edges[COMM.rank + 1]]
    return v


@pytest.fixture(params=[1, 2, 5])
def team(monkeypatch, request):
    """Threads of a kernel, however small the matrix."""
    monkeypatch.setattr(block_matrix, "threads", lambda: request.param)
    monkeypatch.setattr(block_matrix, "_ALONE", 0)
    return request.param


@pytest.mark.parametrize("size", [3, 6])
def test_symmetric_blocks(size, team):
    rng = np.random.default_rng(size)
    half = in_blocks(40, 40, (size, size), 0.1, rng).tocsr()
    keep = np.repeat(np.arange(40) != 7, size)  # a row and a column without any entry
    K = (half + half.T).multiply(np.outer(keep, keep)).tocsr()
    edges = shares(40, size)
    matrix = distributed(K, edges, edges)
    blocks = SymmetricBlocks(symmetric_blocks(distributed_entries(matrix), size), size)
    vectors = x, b, inverse, d = rng.standard_normal((4, 40 * size))
    mine = [part(v, edges) for v in vectors]
    y, scale = padded(blocks.size), np.abs(K).sum(axis=1).max()
    for _ in range(2):  # the second time with what the first left behind
        blocks.mult(mine[0], y)
        assert np.abs(y - part(K @ x, edges)).max(initial=0.0) <= 1e-13 * scale
        blocks.mult(mine[0], y, accurate=False)
        assert np.abs(y - part(K @ x, edges)).max(initial=1e-9 * scale) <= 1e-6 * scale
        assert COMM.allreduce(np.abs(y - part(K @ x, edges)).sum()) > 1e-10 * scale
    blocks.residual(mine[1], mine[0], y)
    assert np.abs(y - part(b - K @ x, edges)).max(initial=0.0) <= 1e-6 * scale
    direction = 0.3 * d + 0.7 * inverse * (b - K @ x)
    x_mine, b_mine, inverse_mine, d_mine = mine
    blocks.smooth(inverse_mine, b_mine, x_mine, d_mine, np.array([[0.3, 0.7]]))
    assert np.abs(d_mine - part(direction, edges)).max(initial=0.0) <= 1e-5 * scale
    assert np.abs(x_mine - part(x + direction, edges)).max(initial=0.0) <= 1e-5 * scale
    first = 0.5 * inverse * b
    direction = 0.3 * first + 0.7 * inverse * (b - K @ first)
    factors = np.array([[np.nan, 0.5], [0.3, 0.7]])  # from zero the first step has no direction before it
    blocks.smooth(inverse_mine, b_mine, x_mine, d_mine, factors, zero=True)
    assert np.abs(d_mine - part(direction, edges)).max(initial=0.0) <= 1e-5 * scale
    assert np.abs(x_mine - part(first + direction, edges)).max(initial=0.0) <= 1e-5 * scale
    blocks.destroy()


@pytest.mark.parametrize("size", [3, 6])
def test_a_sum_of_blocks(size, team):
    """Blocks of the second matrix are on its diagonal, where the first has some, and where it has none."""
    edges, rng = shares(40, size), np.random.default_rng(size)
    halves = [in_blocks(40, 40, (size, size), density, rng).tocsr() for density in (0.1, 0.02)]
    K, S = (half + half.T + scipy.sparse.eye(40 * size) for half in halves)
    matrices = [distributed(of, edges, edges) for of in (K, S)]  # must outlive their arrays
    parts = (symmetric_blocks(distributed_entries(of), size) for of in matrices)
    blocks, x = SymmetricBlocks(sum_of(*parts), size), rng.standard_normal(40 * size)
    y, whole = padded(blocks.size), (K + S) @ x
    blocks.mult(part(x, edges), y)
    assert np.abs(y - part(whole, edges)).max(initial=0.0) <= 1e-6 * np.abs(whole).max()
    diagonal = part((K + S).diagonal(), edges)
    assert np.abs(blocks.diagonal - diagonal).max(initial=0.0) <= 1e-6 * np.abs(diagonal).max(initial=0.0)
    blocks.destroy()


def test_a_thread_that_adds_to_rows_of_all_later_ones(team):
    """The first row couples with the last, all others with themselves only."""
    size, count = 3, 30
    pattern = scipy.sparse.eye(count).tolil()
    pattern[0, count - 1] = pattern[count - 1, 0] = 0.5
    K, edges = scipy.sparse.kron(pattern, np.eye(size) + 0.1).tocsr(), shares(count, size)
    matrix = distributed(K, edges, edges)
    blocks = SymmetricBlocks(symmetric_blocks(distributed_entries(matrix), size), size)
    x, y = np.arange(1.0, size * count + 1.0), padded(blocks.size)
    for _ in range(2):
        blocks.mult(part(x, edges), y)
        assert np.abs(y - part(K @ x, edges)).max(initial=0.0) <= 1e-13 * np.abs(K @ x).max()
    blocks.destroy()


def test_entries_in_any_order():
    """The blocks of a matrix whose columns do not ascend are those of the same matrix in order."""
    csr = in_blocks(20, 15, (3, 6), 0.3, np.random.default_rng(1)).tocsr()
    csr.sort_indices()
    backwards = [np.concatenate([row[::-1] for row in np.split(a, csr.indptr[1:-1])]) for a in (csr.indices, csr.data)]
    sorted_, unsorted = (
        in_kernel_blocks(Entries(csr.indptr, *arrays), (3, 6), accurate=True)
        for arrays in ((csr.indices, csr.data), backwards)
    )
    for a, b in zip(sorted_, unsorted, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("started", [True, False])
def test_an_error_of_mpi_is_raised(monkeypatch, started):
    """Where the kernels start messages, and where they wait for them."""
    edges, function = shares(40, 3), ctypes.CFUNCTYPE(ctypes.c_int)
    succeed, fail = function(lambda: 0), function(lambda: MPI.ERR_TRUNCATE)
    monkeypatch.setattr(block_matrix, "_start_and_wait", lambda: (succeed, fail) if started else (fail, succeed))
    K = distributed(scipy.sparse.kron(np.ones((40, 40)), np.eye(3)), edges, edges)
    blocks = SymmetricBlocks(symmetric_blocks(distributed_entries(K), 3), 3)
    x, b, y = (part(np.ones(120), edges) for _ in range(3))
    raised = pytest.raises(MPI.Exception) if COMM.size > 1 else contextlib.nullcontext()
    with raised:
        blocks.mult(x, y)
    with raised:
        blocks.residual(b, x, y)
    with raised:
        blocks.smooth(b, b, x, y, np.ones((1, 2)))
    blocks.destroy()


@pytest.mark.parametrize("shape", SHAPES)
def test_block_interpolation(shape, team):
    rng = np.random.default_rng(shape)
    P = in_blocks(50, 12, shape, 0.3, rng).tocsr()
    rows, columns = shares(50, shape[0]), shares(12, shape[1])
    matrix = distributed(P, rows, columns)
    converted = distributed_blocks(distributed_entries(matrix), shape)
    blocks = BlockInterpolation(converted, shape)
    x, r = rng.standard_normal((2, P.shape[0]))
    e = rng.standard_normal(P.shape[1])
    mine = part(x, rows)
    blocks.prolong(part(e, columns), mine)
    assert np.abs(mine - part(x + P @ e, rows)).max(initial=0.0) <= 1e-5
    for _ in range(2):
        b = padded(columns[COMM.rank + 1] - columns[COMM.rank])
        blocks.restrict(part(r, rows), b)
        assert np.abs(b - part(P.T @ r, columns)).max(initial=0.0) <= 1e-5
    blocks.destroy()


def test_coarse_grids_that_every_rank_has(monkeypatch):
    """Multigrid makes the same iterations wherever its coarse grids are."""
    K = block(4).elasticity.K
    f, u = K.createVecs()
    f.array[:] = np.sin(np.arange(*K.getOwnershipRange()))
    iterations = []
    for most in (0, 200, 10**9):
        monkeypatch.setattr(multigrid_cycle, "REPLICATED_UP_TO", most)
        solver = stiffness.IterativeSolver(K, tolerance=1e-10)
        u.set(0.0)
        solver.solve(f, u)
        assert (K * u - f).norm() <= 2e-10 * f.norm()
        iterations.append(solver.iterations)
        solver.destroy()
    assert max(iterations) - min(iterations) <= 1 and max(iterations) <= 30


@pytest.mark.parametrize(("most", "dense"), [(0, 500), (200, 60), (10**9, 500)])
def test_grids_stiffened_by_springs(monkeypatch, most, dense):
    """Springs four times as stiff as K that hold nodes of the first half, and softer ones to nodes of the second, far
    away: conjugate gradients take about as many iterations as by grids of the sum, by those of K four times as many."""
    monkeypatch.setattr(multigrid_cycle, "REPLICATED_UP_TO", most)
    monkeypatch.setattr(multigrid_cycle, "DENSE_UP_TO", dense)
    K = block(4).elasticity.K
    nodes = K.getSize()[0] // 3
    first = scipy.sparse.eye(nodes // 2, nodes, format="csr")
    ties = first - scipy.sparse.eye(nodes // 2, nodes, nodes // 2, format="csr")
    springs = [of[::9].T @ of[::9] for of in (first, ties)]
    rows, typical = K.getOwnershipRanges(), K.getDiagonal().sum() / (3 * nodes)
    S = distributed(typical * scipy.sparse.kron(4.0 * springs[0] + 0.1 * springs[1], np.eye(3)), rows, rows)
    whole, solver = K + S, stiffness.IterativeSolver(K)
    whole.setNearNullSpace(K.getNearNullSpace())
    x, y = K.createVecs()

    def product(v, image):
        x.array[:] = v
        whole.mult(x, y)
        image[:] = y.array_r

    size, iterations = K.getLocalSize()[0], []
    f = part(np.sin(np.arange(rows[-1])), rows)
    for cycle in (solver.stiffened(S), stiffness.IterativeSolver(whole)._cycle, solver._cycle):
        u = padded(size)
        iterations.append(RecycledCG(COMM, size, product, cycle).solve(f, u, 1e-8))
    assert iterations[0] <= iterations[1] + 5 and 3 * iterations[0] <= iterations[2]
    solver.destroy()


def test_small_distributed_grids_have_one_cycle(monkeypatch):
    """A W-cycle on a distributed coarse grid after the first begins at TWICE_FROM unknowns per rank."""
    K = block(12).elasticity.K
    f, u = K.createVecs()
    f.array[:] = np.sin(np.arange(*K.getOwnershipRange()))
    for name in ("REPLICATED_UP_TO", "DENSE_UP_TO"):
        monkeypatch.setattr(multigrid_cycle, name, 60)
    iterations, unknowns = [], 0
    for more, cycles in ((1, 2), (10**9, 2 if COMM.size == 1 else 1)):
        monkeypatch.setattr(multigrid_cycle, "TWICE_FROM", more * unknowns / COMM.size)
        solver = stiffness.IterativeSolver(K, tolerance=1e-10)
        first = solver._cycle._coarser
        second = first._coarser
        assert first._again and second._again == (cycles == 2)
        u.set(0.0)
        solver.solve(f, u)
        assert (K * u - f).norm() <= 2e-10 * f.norm()
        iterations.append(solver.iterations)
        unknowns = COMM.allreduce(second.size)
        solver.destroy()
    assert iterations[0] <= iterations[1] <= 1.3 * iterations[0]
