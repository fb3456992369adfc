"""Frictional contact problems of others: the data of ../shared/fclib, if it is beside the checkout."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from conftest import ROOT

from coulomb import InteriorPoint, SuccessiveTresca, solve_coulomb, solve_tresca
from coulomb.io.fclib import FCLIBProblem, read_fclib
from coulomb.solvers import Automatic, DenseSystem, SchurComplementSystem

FOLDER = ROOT.parent / "shared" / "fclib"
FILES = sorted(FOLDER.glob("*.npz"))
pytestmark = pytest.mark.skipif(not FILES, reason=f"no problems in {FOLDER.name}/ beside the checkout")

NAMES = [path.name for path in FILES] or ["none"]
DENSE = ("Capsules", "Kaplas")
"""Rank 570 of 858 and slip bounds over nine decades, where CG stops at 1e-6 and LU does not; and 1710 unknowns, where
CG takes four times as long."""


def solver(name):
    return InteriorPoint(newton=DenseSystem() if name.startswith(DENSE) else SchurComplementSystem())


def load(name):
    data = np.load(FOLDER / name)
    n = len(data["q"])
    W = scipy.sparse.csr_matrix((data["W_data"], data["W_indices"], data["W_indptr"]), shape=(n, n))
    return data, 0.5 * (W + W.T)


@pytest.mark.parametrize("name", NAMES)
def test_tresca(name):
    """Residual 1e-8; the objective is the reference's, whether or not the forces are unique."""
    data, W = load(name)
    result = solve_tresca(W, -data["q"], data["g_tresca"], solver=solver(name))
    objective = 0.5 * result.x @ (W @ result.x) + data["q"] @ result.x
    assert result.residual <= 1e-8
    assert objective == pytest.approx(float(data["tresca_objective"]), rel=1e-7)
    if data["r_is_unique"]:
        assert np.linalg.norm(result.x - data["r_tresca"]) <= 1e-5 * np.linalg.norm(result.x)


METHODS = ("default", "successive Tresca", "interior point", "auto")


SLOW = {("Capsules-i125-1213.npz", "successive Tresca"), ("Capsules-i125-1213.npz", "auto")}
"""Up to a minute each."""


@pytest.mark.parametrize(("name", "method"), [(n, m) for n in NAMES for m in METHODS if (n, m) not in SLOW])
def test_coulomb(name, method):
    """Coulomb residual 1e-7; where the forces are unique they are the reference's.  Most W are rank-deficient."""
    data, W = load(name)
    ways = {
        "successive Tresca": SuccessiveTresca(1e-7, solver(name)),
        "interior point": replace(solver(name), tolerance=1e-7),
        "auto": Automatic(1e-7),
        "default": None,
    }
    result = solve_coulomb(W, -data["q"], data["mu"], ways[method])
    assert result.residual <= 1e-7
    if data["r_is_unique"]:
        assert np.linalg.norm(result.x - data["r_coulomb"]) <= 1e-5 * np.linalg.norm(result.x)


HDF5 = sorted(FOLDER.glob("*.hdf5")) or [FOLDER / "none.hdf5"]


@pytest.mark.parametrize("path", HDF5, ids=lambda path: path.name)
def test_hdf5_files_hold_the_problems_of_the_npz_files(path):
    problem = read_fclib(path)
    data, W = load(path.with_suffix(".npz").name)
    assert abs(problem.W - W).max() <= 1e-9 * abs(W).max()
    assert np.allclose(problem.q, data["q"], rtol=1e-9, atol=1e-9 * np.abs(data["q"]).max())
    assert np.allclose(problem.mu, data["mu"])


@pytest.mark.parametrize("name", NAMES)
def test_residual_of_the_reference_solutions(name):
    data, W = load(name)
    problem = FCLIBProblem(W, data["q"], data["mu"])
    assert problem.residual(data["r_coulomb"]) <= 1e-12
    assert problem.residual(1.01 * data["r_coulomb"]) > 1e-9
