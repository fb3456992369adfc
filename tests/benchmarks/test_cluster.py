"""The counts of `coulomb benchmark cluster`."""

import shutil

import pytest

from coulomb.benchmarks.cluster import cells_per_metre, measure


def test_blocks_of_a_size():
    assert cells_per_metre(10_000) == 10 and cells_per_metre(41_616) == 16


@pytest.mark.skipif(shutil.which("mpicc") is None, reason="needs mpicc")
def test_counts_of_two_ranks():
    """Conjugate gradients take two products of vectors and a norm per iteration; ranks exchange their boundaries."""
    (row,) = measure([(2, 3)])
    assert (row.unknowns, row.contact) == (480, 108) and row.ranks_without_contact == 0
    assert 2.0 <= row.collectives_per_multigrid_iteration < 8.0  # with those at the start of a solve
    assert row.messages_per_multigrid_iteration >= 1.0 and row.kilobytes_per_multigrid_iteration > 0.1
    assert 10.0 < row.collectives_per_newton_step < 150.0 and 1.0 <= row.contact_imbalance <= 2.0
