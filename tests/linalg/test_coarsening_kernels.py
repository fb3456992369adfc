"""The kernels of coarse grids in C, against their formulas."""

import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI

from coulomb.linalg.multigrid.block_matrix import DistributedBlocks, padded, split
from coulomb.linalg.multigrid.coarsening import WholeRows
from coulomb.linalg.multigrid.multigrid_cycle import exact_solver
from coulomb.native import address, kernels


def blocks_of_all_sizes(count, size, rng):
    """Dense blocks of a symmetric pattern, those beside the diagonal of sizes from 1e-3 to 1; two rows are held."""
    pattern = np.triu(rng.random((count, count)) < 0.4)
    pattern |= pattern.T | np.eye(count, dtype=bool)
    K = rng.standard_normal((count, size, count, size))
    K *= 10.0 ** rng.uniform(-3.0, 0.0, (count, 1, count, 1))
    K[np.arange(count), :, np.arange(count)] = rng.standard_normal((count, size, size)) + 3.0 * np.eye(size)
    K *= pattern[:, None, :, None]
    for i in range(count):
        K[i, :, :i] = K[:i, :, i].transpose(2, 0, 1)
        K[i, :, i] = np.tril(K[i, :, i]) + np.tril(K[i, :, i], -1).T
    for row in (0, 1):  # the second is held in the middle of its block
        diagonal = K[row, row, row, row]
        K[row, row] = K[:, :, row, row] = 0.0
        K[row, row, row, row] = diagonal
    columns = [i + np.flatnonzero(row[i:]) for i, row in enumerate(pattern)]
    pointers = np.concatenate([[0], np.cumsum([len(c) for c in columns])]).astype(np.int32)
    blocks = np.concatenate([K[i, :, c, :] for i, c in enumerate(columns)])
    upper = split(pointers, np.concatenate(columns).astype(np.int32), blocks)
    return K, WholeRows(DistributedBlocks(MPI.COMM_SELF, upper, None, np.empty(0), np.array([0, count])), size)


@pytest.mark.parametrize("team", [1, 3])
@pytest.mark.parametrize("size", [3, 6])
def test_strength_of_coupling(size, team):
    rng, count, part = np.random.default_rng(size), 25, 0.1
    K, rows = blocks_of_all_sizes(count, size, rng)
    pointers, columns = rows.own[:2]
    np.testing.assert_array_equal(columns, np.nonzero(np.abs(K).max(axis=(1, 3)))[1])
    norms, loose, strong = np.zeros(count), np.zeros(size * count, np.uint8), np.empty(len(columns), np.uint8)
    kernels()[f"examine_{size}_6"](count, team, *rows.own, norms, loose)
    frobenius = np.sqrt((K**2).sum(axis=(1, 3)))
    np.testing.assert_allclose(norms, np.diag(frobenius) ** 2, rtol=1e-13)
    beside = K.reshape(size * count, -1) * ~np.eye(size * count, dtype=bool)
    np.testing.assert_array_equal(loose, beside.any(axis=1))
    assert 0 < loose.sum() < len(loose)
    kernels()[f"strength_{size}_6"](count, team, *rows.own, norms, part, strong)
    row = np.repeat(np.arange(count), np.diff(pointers))
    ratio = frobenius[row, columns] / np.sqrt(np.diag(frobenius)[row] * np.diag(frobenius)[columns])
    np.testing.assert_array_equal(strong, (ratio > part) & (row != columns))
    assert 0 < strong.sum() < np.sum((ratio > part**2) & (row != columns))


def aggregates_of(edges, count):
    """Of a graph, edges (row, column) in both directions."""
    graph = scipy.sparse.csr_matrix((np.ones(len(edges)), np.array(edges).T), shape=(count, count))
    graph.sort_indices()
    out, strong = np.empty(count, np.int32), np.ones(len(edges), np.uint8)
    arrays = (graph.indptr.astype(np.int32), graph.indices.astype(np.int32), strong, out)
    number = kernels().aggregate(count, *map(address, arrays))
    return number, out


STARS = ((0, 1), (0, 2), (0, 3), (4, 5), (4, 6), (4, 7), (4, 8))
"""Nodes 0 to 3, and 4 to 8."""


@pytest.mark.parametrize(
    ("edges", "expected"),
    [
        # node 9 touches one node of the first star and two of the second, node 10 none; node 2 stays in the first star,
        # though it touches two nodes of the second
        ((*STARS, (9, 1), (9, 5), (9, 6), (2, 7), (2, 8)), [0, 0, 0, 0, 1, 1, 1, 1, 1, 1, -1]),
        # votes of one node are not those of the next: node 9 has two in the first, 10 one there, then two in the second
        ((*STARS, (9, 1), (9, 2), (10, 3), (10, 5), (10, 6)), [0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 1]),
        # of equal votes the first counts
        (((0, 1), (0, 2), (3, 4), (3, 5), (6, 1), (6, 4)), [0, 0, 0, 1, 1, 1, 0]),
    ],
)
def test_a_node_joins_the_aggregate_of_most_of_its_neighbours(edges, expected):
    number, out = aggregates_of([*edges, *((b, a) for a, b in edges)], len(expected))
    assert number == 2 and out.tolist() == expected


@pytest.mark.parametrize("team", [1, 3])
@pytest.mark.parametrize("size", [3, 6])
def test_orthonormal_motions(size, team):
    """Nearly dependent columns, an aggregate of one node, and one with held rows."""
    rng, nodes = np.random.default_rng(size), 12
    given = rng.standard_normal((size * nodes, 6))
    given[:, 1] = given[:, 0] + 1e-6 * given[:, 1]
    given[:, 4] = given[:, 2] - 2.0 * given[:, 3]  # dependent but for rounding
    loose = np.ones(size * nodes, np.uint8)
    loose[-2 * size : -size] = 0
    members = np.arange(nodes, dtype=np.int32)
    begin = np.array([0, 6, 7, nodes], np.int32)
    modes, R = given.copy(), np.zeros((3, 6, 6))
    arrays = map(address, (begin, members, loose, modes, R))
    kernels()[f"orthonormal_{size}_6"](3, team, *arrays)
    for a in range(3):
        rows = slice(size * begin[a], size * begin[a + 1])
        Q, held = modes[rows], loose[rows] == 0
        kept = np.diag(R[a]) > 0.0
        assert kept.sum() == min(size * (begin[a + 1] - begin[a]), 5) and not Q[:, ~kept].any()
        np.testing.assert_allclose(Q.T @ Q, np.diag(kept.astype(float)), atol=1e-14)
        assert not Q[held].any() and not np.tril(R[a], -1).any()
        np.testing.assert_allclose((Q @ R[a])[~held], given[rows][~held], atol=1e-13)


@pytest.mark.parametrize("copies", [1, 3])
def test_a_coarsest_grid_that_nothing_holds(copies):
    """A chain of springs without a support: Cholesky's method fails, the solution exists for forces in equilibrium."""
    n = 6
    chain = np.diag([1.0, *[2.0] * (n - 2), 1.0]) - np.eye(n, k=1) - np.eye(n, k=-1)
    K = scipy.sparse.csr_matrix(np.kron(np.eye(copies), chain))
    forces = np.tile(np.arange(n) - 0.5 * (n - 1), copies)
    solver = exact_solver(K)
    r = padded(len(forces))
    r[:] = forces
    assert np.abs(K @ solver(r) - forces).max() <= 1e-8
    solver.destroy()
