"""Products with a symmetric matrix by its lower triangle, and by the columns that a vector with many zeros needs."""

import numpy as np
import pytest

from coulomb.linalg.factors.multifrontal import DenseInverse


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
