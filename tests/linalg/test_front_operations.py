"""The kernels in C of the multifrontal factorisation, against dense matrices."""

import numpy as np
import pytest
import scipy.sparse

from benchmarks.block import block
from coulomb.linalg.factors.frontal_factors import FrontalFactors
from coulomb.linalg.factors.nested_dissection import dissect, dissect_part
from coulomb.linalg.petsc_arrays import NodalRows, nodal_blocks


def rows_and_fronts(what):
    """K of a small block, and its fronts: to the end, or of the first nodes only, with a border."""
    problem = block(3, cell="tetrahedron")
    K, x = nodal_blocks(problem.elasticity.K), problem.elasticity.x
    if what == "part":
        K.data[K.indptr[60] :] = 0.0
        K.eliminate_zeros()
    graph = scipy.sparse.csr_matrix((np.ones(len(K.indices)), K.indices, K.indptr), shape=(len(x),) * 2)
    fronts = dissect(graph, x, np.sort(problem.surface.nodes), 7) if what == "whole" else dissect_part(graph, x, 60, 7)
    return NodalRows(K), fronts, K.toarray()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("what", ["whole", "part"])
def test_factors_substitutions_and_what_is_left(what, dtype):
    """Against dense matrices: L L^T = K, the Schur complement on the border, substitutions with L."""
    rows, fronts, K = rows_and_fronts(what)
    assert len(fronts) > 5 and (len(fronts[-1].border) > 0) == (what == "part")
    factors = FrontalFactors(rows, fronts, dtype)
    unknowns = (3 * factors.order[:, None] + np.arange(3)).ravel()
    count = 3 * sum(len(front.own) for front in fronts)
    dense = K[np.ix_(unknowns, unknowns)].astype(np.float64)
    limit = 200 * np.finfo(dtype).eps
    L = np.linalg.cholesky(dense[:count, :count])
    below = np.linalg.solve(L, dense[:count, count:]).T
    if what == "part":
        update = np.tril(factors.update)
        assert np.abs(update - np.tril(-below @ below.T)).max() <= limit * np.abs(dense).max()
    for alone in (False, True):  # forces everywhere, and on the nodes of the last front alone
        x = np.random.default_rng(3).standard_normal(len(unknowns)).astype(dtype)
        if alone:
            x[: count - 3 * len(fronts[-1].own)] = 0.0
        given = x.astype(np.float64)
        factors.forward(x)
        size = np.abs(L).max() * np.abs(x).max()
        assert np.abs(L @ x[:count] - given[:count]).max() <= limit * size
        if what == "part":
            assert np.abs(x[count:] + below @ x[:count] - given[count:]).max() <= limit * size
        given = x.astype(np.float64)
        factors.backward(x)
        size = np.abs(L).max() * np.abs(x).max()
        assert np.abs(L.T @ x[:count] + below.T @ given[count:] - given[:count]).max() <= limit * size


def test_fronts_separate_also_obliquely_and_where_nodes_coincide():
    """Two bodies that are not coupled; the fronts' borders are what elimination of their nodes couples."""
    problem = block(4, cell="tetrahedron")
    K, x = nodal_blocks(problem.elasticity.K), problem.elasticity.x
    graph = scipy.sparse.csr_matrix((np.ones(len(K.indices)), K.indices, K.indptr), shape=(len(x),) * 2)
    pair = scipy.sparse.block_diag([graph, graph], format="csr")
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    for places in ((x + 0.1 * rng.random(x.shape)) @ turn, np.round(x), rng.random(x.shape)):
        points, last = np.vstack([x, places + 9.0]), np.arange(3, 2 * len(x), 7)
        fronts = dissect(pair, points, last, leaf=9)
        assert len(fronts) > 20
        eliminated = np.concatenate([front.own for front in fronts])
        assert np.array_equal(np.sort(eliminated), np.arange(len(points)))
        left = np.ones(len(points), dtype=bool)
        for front in fronts:
            left[front.own] = False
            reached = np.unique(pair[front.own].indices)
            children = [fronts[child].border for child in front.children]
            coupled = np.unique(np.concatenate([reached, *children]))
            assert np.array_equal(np.sort(front.border), coupled[left[coupled]])
