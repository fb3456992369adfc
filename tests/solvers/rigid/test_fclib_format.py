"""FCLIB files written and read, and the command line on them; needs no data from elsewhere."""

import json

import h5py
import numpy as np
import pytest
import scipy.sparse
from conftest import ROOT, random_spd, run_coulomb, solved_block

from coulomb.io.fclib import FCLIBProblem, read_fclib, write_fclib

BLOCK = ROOT / "demos" / "block.toml"


def small(seed=111):
    rng = np.random.default_rng(seed)
    W = scipy.sparse.csr_matrix(random_spd(9, 10.0, rng))
    return FCLIBProblem(W, rng.standard_normal(9), np.array([0.0, 0.3, 0.8]), "small")


def test_round_trip(tmp_path):
    problem = small()
    write_fclib(tmp_path / "small.hdf5", problem, r=np.arange(9.0))
    again = read_fclib(tmp_path / "small.hdf5")
    assert abs(again.W - problem.W).max() <= 1e-15 and again.title == "small"
    assert np.array_equal(again.q, problem.q) and np.array_equal(again.mu, problem.mu)
    with h5py.File(tmp_path / "small.hdf5") as file:
        assert np.allclose(file["solution/u"][()], problem.W @ np.arange(9.0) + problem.q)


def test_a_problem_in_the_plane_is_refused(tmp_path):
    write_fclib(tmp_path / "plane.hdf5", small())
    with h5py.File(tmp_path / "plane.hdf5", "a") as file:
        file["fclib_local/spacedim"][0] = 2
    with pytest.raises(ValueError, match=r"plane\.hdf5: the problem has 2 dimensions, not 3"):
        read_fclib(tmp_path / "plane.hdf5")


@pytest.mark.parametrize("storage", ["triplet", "csr"])
def test_other_storages(tmp_path, storage):
    problem = small()
    write_fclib(tmp_path / "small.hdf5", problem)
    W = scipy.sparse.csr_matrix(problem.W)
    coo = W.tocoo()
    i, p, nz = (coo.row, coo.col, coo.nnz) if storage == "triplet" else (W.indices, W.indptr, -2)
    with h5py.File(tmp_path / "small.hdf5", "a") as file:
        group = file["fclib_local/W"]
        for key, value in (("i", i), ("p", p), ("x", W.data), ("nz", [nz])):
            del group[key]
            group[key] = value
    assert abs(read_fclib(tmp_path / "small.hdf5").W - problem.W).max() <= 1e-15


@pytest.mark.parametrize("storage", ["triplets", "compressed columns", "compressed rows"])
def test_global_form_is_condensed(tmp_path, storage):
    rng = np.random.default_rng(112)
    M, H = random_spd(12, 10.0, rng), rng.standard_normal((12, 6))
    H[rng.uniform(size=H.shape) < 0.3] = 0.0
    f, w = rng.standard_normal(12), rng.standard_normal(6)
    with h5py.File(tmp_path / "global.hdf5", "w") as file:
        group = file.create_group("fclib_global")
        for name, matrix in (("M", scipy.sparse.csc_matrix(M)), ("H", scipy.sparse.csc_matrix(H))):
            for key, value in (("m", matrix.shape[0]), ("n", matrix.shape[1]), ("nz", -1)):
                group[f"{name}/{key}"] = [value]
            group[f"{name}/x"], group[f"{name}/i"], group[f"{name}/p"] = matrix.data, matrix.indices, matrix.indptr
        rows, columns = np.nonzero(H)
        by_rows = scipy.sparse.csr_matrix(H)
        kept = {
            "triplets": {"i": rows, "p": columns, "x": H[rows, columns], "nz": [len(rows)]},
            "compressed columns": {},
            "compressed rows": {"i": by_rows.indices, "p": by_rows.indptr, "x": by_rows.data, "nz": [-2]},
        }[storage]
        for key, value in kept.items():
            del group[f"H/{key}"]
            group[f"H/{key}"] = value
        group["vectors/f"], group["vectors/w"], group["vectors/mu"], group["spacedim"] = f, w, [0.3, 0.4], [3]
    problem = read_fclib(tmp_path / "global.hdf5")
    assert np.allclose(problem.W.toarray(), H.T @ np.linalg.solve(M, H))
    assert np.allclose(problem.q, H.T @ np.linalg.solve(M, f) + w)


def test_residual_by_hand():
    """W = I, q = (-2, -3, -4), mu = 1/2: r = (2, 3/5, 4/5) slides against u_t = -(2.4, 3.2)."""
    problem = FCLIBProblem(scipy.sparse.identity(3, format="csr"), np.array([-2.0, -3.0, -4.0]), np.array([0.5]))
    assert problem.residual(np.array([2.0, 0.6, 0.8])) <= 1e-15
    assert problem.residual(np.array([2.0, -0.6, -0.8])) > 0.1
    assert problem.residual(np.zeros(3)) > 0.1


def test_our_block_as_fclib_file(tmp_path):
    """Exported, solved from the file: the forces and the residual of the block."""
    file = tmp_path / "block.hdf5"
    done = run_coulomb("export", BLOCK, file, "--set", "mesh.cells=[12,4,4]")
    assert "60 contacts" in done.stdout, done.stderr
    solution, problem = solved_block(4), read_fclib(file)
    assert problem.residual(solution.contact_force) <= 1e-8
    done = run_coulomb("fclib", file, "--json")
    report = json.loads(done.stdout)
    assert report["status"] == "converged" and report["contacts"] == 60 and report["title"] == "block"
    assert report["fclib_residual"] <= 1e-7
    assert "fclib_residual" in run_coulomb("fclib", file).stdout


def test_bad_files(tmp_path):
    (tmp_path / "text.hdf5").write_text("no")
    write_fclib(tmp_path / "small.hdf5", small())
    with h5py.File(tmp_path / "small.hdf5", "a") as file:
        del file["fclib_local/vectors/mu"]
    with h5py.File(tmp_path / "empty.hdf5", "w"):
        pass
    write_fclib(tmp_path / "beyond.hdf5", small())
    with h5py.File(tmp_path / "beyond.hdf5", "a") as file:
        file["fclib_local/W/i"][0] = 100_000
    for name, message in (
        ("none.hdf5", "cannot be read as HDF5"),
        ("text.hdf5", "cannot be read as HDF5"),
        ("", "cannot be read as HDF5: it is a directory$"),
        ("small.hdf5", "is not complete"),
        ("beyond.hdf5", "beyond.hdf5: .*ind"),
        ("empty.hdf5", "neither a group fclib_local nor fclib_global"),
    ):
        with pytest.raises(ValueError, match=message):
            read_fclib(tmp_path / name)
    done = run_coulomb("fclib", tmp_path / "empty.hdf5", code=2)
    assert "neither a group" in done.stderr
    done = run_coulomb(
        "export", BLOCK, tmp_path / "x.hdf5", "--set", "contact={face='bottom', slip_stress=1e7}", code=2
    )
    assert "slip stress" in done.stderr
