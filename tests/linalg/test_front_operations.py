"""The kernels in C of the multifrontal factorisation, against numpy's operations."""

import numpy as np
import pytest
import scipy.sparse

from benchmarks.block import block
from coulomb.linalg import native
from coulomb.linalg.factors import front_operations, nested_dissection
from coulomb.linalg.factors.frontal_factors import FrontalFactors
from coulomb.linalg.factors.nested_dissection import dissect, dissect_part
from coulomb.linalg.nodal_blocks import NodalRows, nodal_blocks

pytestmark = pytest.mark.skipif(native.kernels() is None, reason="no C compiler")


def rows_and_fronts(what):
    """K of a small block, and its fronts: to the end, or of the first nodes only, with a border."""
    problem = block(3, cell="tetrahedron")
    K, x = nodal_blocks(problem.elasticity.K), problem.elasticity.x
    if what == "part":
        K.data[K.indptr[60] :] = 0.0
        K.eliminate_zeros()
    graph = scipy.sparse.csr_matrix((np.ones(len(K.indices)), K.indices, K.indptr), shape=(len(x),) * 2)
    fronts = dissect(graph, x, np.sort(problem.surface.nodes), 7) if what == "whole" else dissect_part(graph, x, 60, 7)
    return NodalRows(K), fronts


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("what", ["whole", "part"])
def test_c_and_numpy_have_the_same_factors_and_solutions(monkeypatch, what, dtype):
    """Factors to the last bit, since the sums are made in the same order; substitutions to rounding."""
    rows, fronts = rows_and_fronts(what)
    assert len(fronts) > 5 and (len(fronts[-1].border) > 0) == (what == "part")
    factors = []
    for library in (native.kernels(), None):
        monkeypatch.setattr(front_operations, "kernels", lambda library=library: library)
        factors.append(FrontalFactors(rows, fronts, dtype))
    in_c, by_numpy = factors
    for ours, theirs in zip(in_c.heads, by_numpy.heads, strict=True):
        assert np.array_equal(np.tril(ours), np.tril(theirs))
    for ours, theirs in zip(in_c.below, by_numpy.below, strict=True):
        assert np.array_equal(ours, theirs)
    assert np.array_equal(np.tril(in_c.update), np.tril(by_numpy.update))
    count = 3 * sum(len(front.own) for front in fronts)
    for alone in (False, True):  # forces everywhere, and on the nodes of the last front alone
        x = np.random.default_rng(3).standard_normal(3 * len(in_c.order)).astype(dtype)
        if alone:
            x[: count - 3 * len(fronts[-1].own)] = 0.0
        y, limit = x.copy(), 50 * np.finfo(dtype).eps
        for step in ("forward", "backward"):
            getattr(in_c, step)(x)
            getattr(by_numpy, step)(y)
            assert np.abs(x - y).max() <= limit * np.abs(y).max()


def test_c_and_python_cut_alike(monkeypatch):
    """Also obliquely, two bodies that are not coupled, and many nodes in one place."""
    problem = block(4, cell="tetrahedron")
    K, x = nodal_blocks(problem.elasticity.K), problem.elasticity.x
    graph = scipy.sparse.csr_matrix((np.ones(len(K.indices)), K.indices, K.indptr), shape=(len(x),) * 2)
    pair = scipy.sparse.block_diag([graph, graph], format="csr")
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    for places in ((x + 0.1 * rng.random(x.shape)) @ turn, np.round(x), rng.random(x.shape)):
        points, last = np.vstack([x, places + 9.0]), np.arange(3, 2 * len(x), 7)
        found = []
        for library in (native.kernels(), None):
            monkeypatch.setattr(nested_dissection, "kernels", lambda library=library: library)
            found.append(dissect(pair, points, last, leaf=9))
        assert len(found[0]) == len(found[1]) > 20
        for ours, theirs in zip(*found, strict=True):
            assert ours.children == theirs.children and ours.root == theirs.root
            for name in ("own", "border", "runs"):
                assert np.array_equal(getattr(ours, name), getattr(theirs, name))
