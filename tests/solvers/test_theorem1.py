"""Theorem 1 of the paper, along a whole path-following run."""

import numpy as np
import pytest
from conftest import make_block, random_tresca

from benchmarks.conditioning import measure
from coulomb import InteriorPoint


def problems():
    yield "random", random_tresca(12, seed=91, condition=1e2)[0]
    block = make_block(2, slip_stress=1e7)
    yield "block", block.friction_problem


@pytest.fixture(scope="module", params=list(problems()), ids=lambda p: p[0])
def run(request):
    _, qp = request.param
    return qp.A.nodes, measure(qp, InteriorPoint(tolerance=1e-8))


def test_eigenvalues_of_the_augmented_system(run):
    """Positive; 1 with multiplicity 2 m; the others those of P_SC^-1 J_SC."""
    m, spectra = run
    assert len(spectra) >= 8
    for step in spectra:
        assert np.abs(step.augmented.imag).max() <= 1e-5
        values = np.sort(step.augmented.real)
        assert values[0] > 0.0
        expected = np.sort(np.concatenate([step.schur, np.ones(2 * m)]))
        rounding = 1e-12 + np.finfo(float).eps * step.cond_J_AM  # of the computed eigenvalues
        assert np.allclose(values, expected, rtol=rounding, atol=0.0)
        assert np.sum(np.abs(values - 1.0) <= 1e-4) >= 2 * m


def test_bounds(run):
    _, spectra = run
    for step in spectra:
        assert step.lower * (1 - 1e-8) <= step.schur[0] and step.schur[-1] <= step.upper * (1 + 1e-8)
        assert step.cond_preconditioned_SC <= step.upper / step.lower
        assert step.cond_preconditioned_AM <= step.upper / step.lower * (1 + 1e-4)


def test_unpreconditioned_systems_become_singular(run):
    """Figure 1: cond(J_AM) and cond(J_SC) grow without bound, the preconditioned ones do not."""
    _, spectra = run
    assert spectra[-1].cond_J_AM > 1e8 and spectra[-1].cond_J_SC > 1e8
    assert spectra[-1].cond_J_AM > 1e3 * spectra[0].cond_J_AM
    preconditioned = [step.cond_preconditioned_SC for step in spectra]
    assert max(preconditioned) <= 20 * min(preconditioned)
