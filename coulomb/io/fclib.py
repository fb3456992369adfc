"""Friction problems in FCLIB's HDF5 format, to cross-check with Siconos and others.

V. Acary, M. Bremond, T. Koziara, F. Perignon: FCLIB, a collection of discrete 3D frictional contact problems (2014).

    u = W r + q;   per contact, in the order n, t1, t2:   0 <= u_n _|_ r_n >= 0,  |r_t| <= mu r_n,  r_t opposes u_t

In the notation of this package A = W, b = -q, x = r, F = mu.  The global form M v = H r + f, u = H^T v + w is condensed
to W = H^T M^-1 H, q = H^T M^-1 f + w.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ..arrays import FloatArray
from ..regular_file import refuse_irregular, replacing
from ..solvers.rigid import cone_residual

_ASYMMETRIC: Final = 1e-2  # over the largest entry: there are files of the Siconos project with 1e-4


@dataclass(frozen=True, eq=False)
class FCLIBProblem:
    """A local friction problem.

    Attributes:
        W: Delassus matrix, symmetric positive semidefinite, sparse, shape (3 m, 3 m).
        q: Free velocity or displacement, shape (3 m,), contact by contact (n, t1, t2).
        mu: Friction coefficients, shape (m,).
        title: Title in the file.
    """

    W: Any
    q: FloatArray
    mu: FloatArray
    title: str = ""

    def residual(self, r: FloatArray) -> float:
        """FCLIB's residual, |r - P(r - (u + mu |u_t| n))| / (1 + |q|), P the projection on the cones.

        Evaluated for the problem scaled to a mean diagonal of W of 1 and a largest |q| of 1, to be independent of
        units.
        """
        d, size = self.W.diagonal().mean(), np.abs(self.q).max() or 1.0
        q, r = self.q / size, r * d / size
        u = (self.W @ r / d + q).reshape(-1, 3)
        return cone_residual(r.reshape(-1, 3), u, self.mu, float(np.linalg.norm(q)))


def read_fclib(path: str | Path) -> FCLIBProblem:
    """Read a local or a global problem; the global one is condensed.

    Args:
        path: HDF5, or if its name ends with .npz a local problem as numpy arrays: W_data, W_indices, W_indptr
            (compressed rows), q, mu.

    Raises:
        ValueError: If the file cannot be read or contains no three-dimensional friction problem.
    """
    if Path(path).suffix == ".npz":
        return _read_npz(Path(path))
    try:
        refuse_irregular(path)
        with h5py.File(path, "r") as file:
            for group, reader in (("fclib_local", _read_local), ("fclib_global", _read_global)):
                if group in file:
                    return reader(file[group])
    except OSError as error:
        reason = "it is a directory" if Path(path).is_dir() else error.strerror or error
        raise ValueError(f"{path}: cannot be read as HDF5: {reason}") from None
    except KeyError as error:
        raise ValueError(f"{path}: is not complete: {error.args[0]}") from None
    except ValueError as error:
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    raise ValueError(f"{path}: has neither a group fclib_local nor fclib_global")


def _read_npz(path: Path) -> FCLIBProblem:
    try:
        refuse_irregular(path)
        with np.load(path, allow_pickle=False) as file:
            rows = tuple(np.asarray(file[key]) for key in ("W_data", "W_indices", "W_indptr"))
            q, mu = np.asarray(file["q"], dtype=np.float64), np.asarray(file["mu"], dtype=np.float64)
            W = scipy.sparse.csr_matrix(rows, shape=(len(rows[2]) - 1, len(rows[2]) - 1))
            W.check_format(full_check=True)
    except KeyError as error:
        raise ValueError(f"{path}: is not complete: {error.args[0]}") from None
    except (OSError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: cannot be read as numpy arrays: {error}") from None
    return _checked(str(path), _symmetric(str(path), W), q, mu, path.stem)


def _read_local(group: Any) -> FCLIBProblem:
    return _problem(group, _symmetric(group.file.filename, _read_matrix(group["W"])), group["vectors/q"][()])


def _read_global(group: Any) -> FCLIBProblem:
    M, H = _read_matrix(group["M"]), _read_matrix(group["H"])
    factor = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(M))
    W = scipy.sparse.csr_matrix(H.T @ factor.solve(H.toarray()))
    return _problem(group, W, H.T @ factor.solve(group["vectors/f"][()]) + group["vectors/w"][()])


def _problem(group: Any, W: Any, q: FloatArray) -> FCLIBProblem:
    dimension, mu = int(np.ravel(group["spacedim"][()])[0]), np.ravel(group["vectors/mu"][()])
    if dimension != 3:
        raise ValueError(f"{group.file.filename}: the problem has {dimension} dimensions, not 3")
    title = group["info/title"][()] if "info/title" in group else b""
    return _checked(group.file.filename, W, q, mu, title.decode() if isinstance(title, bytes) else str(title))


def _checked(name: str, W: Any, q: FloatArray, mu: FloatArray, title: str) -> FCLIBProblem:
    if mu.ndim != 1 or W.shape != (3 * len(mu), 3 * len(mu)) or q.shape != (3 * len(mu),):
        raise ValueError(f"{name}: W {W.shape}, q {q.shape} and mu {mu.shape} have incompatible shapes")
    if not len(mu):
        raise ValueError(f"{name}: the problem has no contacts")
    for what, values in (("W", W.data), ("q", q), ("mu", mu)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: {what} has entries that are not finite")
    if (negative := np.flatnonzero(mu < 0.0)).size:
        k = int(negative[0])
        raise ValueError(f"{name}: the coefficient of friction of contact {k} is {mu[k]:g}; it must be >= 0")
    return FCLIBProblem(0.5 * (W + W.T), q, mu, title)


def _symmetric(name: str, W: Any) -> Any:
    """W, if it is symmetric; that of a global problem is not asked, since M may be stored as it is assembled."""
    if W.nnz and W.shape[0] == W.shape[1] and abs(W - W.T).max() > _ASYMMETRIC * abs(W).max():
        raise ValueError(f"{name}: W is not symmetric")
    return W


def _read_matrix(group: Any) -> Any:
    """x, i, p, m, n, nz: nz = -1 compressed columns, -2 compressed rows, else nz triplets of row i and column p."""
    m, n, nz = (int(np.ravel(group[key][()])[0]) for key in ("m", "n", "nz"))
    x, i, p = (group[key][()] for key in ("x", "i", "p"))
    if nz >= 0:
        return scipy.sparse.coo_matrix((x[:nz], (i[:nz], p[:nz])), shape=(m, n)).tocsr()
    compressed = scipy.sparse.csc_matrix if nz == -1 else scipy.sparse.csr_matrix
    matrix = compressed((x, i, p), shape=(m, n))
    matrix.check_format(full_check=True)  # an index beyond the matrix would end the process
    return matrix.tocsr()


def write_fclib(path: str | Path, problem: FCLIBProblem, r: FloatArray | None = None) -> None:
    """Write a local problem, and its solution if there is one.

    Args:
        path: File to write; replaced if it exists.
        r: Contact forces of a solution, shape (3 m,).

    Raises:
        OSError: If it cannot be written; no partial file is left then.
    """
    with replacing(Path(path)) as partial:
        partial.write_bytes(_contents(problem, r))


def _contents(problem: FCLIBProblem, r: FloatArray | None) -> bytes:
    """Contents of the file, made in memory: with a full disk HDF5 leaves a damaged file and may end the process."""
    W = scipy.sparse.csc_matrix(problem.W)
    with h5py.File("fclib", "w", driver="core", backing_store=False) as file:
        local = file.create_group("fclib_local")
        local["spacedim"] = np.array([3], dtype=np.int32)
        matrix = local.create_group("W")
        for key, number in (("m", W.shape[0]), ("n", W.shape[1]), ("nz", -1), ("nzmax", W.nnz)):
            matrix[key] = np.array([number], dtype=np.int32)
        matrix["p"], matrix["i"], matrix["x"] = W.indptr.astype(np.int32), W.indices.astype(np.int32), W.data
        local["vectors/q"], local["vectors/mu"] = problem.q, problem.mu
        for key, text in (("title", problem.title), ("description", "written by coulomb"), ("math_info", "")):
            local[f"info/{key}"] = np.bytes_(text or " ")
        if r is not None:
            file["solution/r"], file["solution/u"] = r, problem.W @ r + problem.q
        file.flush()
        return bytes(file.id.get_file_image())
