"""Wrong contact problems of rigid bodies, in FCLIB's formats: rows of the table of wrong_inputs.py."""

import h5py
import numpy as np
import scipy.sparse
from wrong_input import Wrong

from coulomb.io.fclib import FCLIBProblem, write_fclib

_CONTACTS = 8


def contacts():
    """A problem of eight contacts that do not influence each other."""
    size = 3 * _CONTACTS
    return FCLIBProblem(scipy.sparse.identity(size, format="csr"), np.ones(size), np.full(_CONTACTS, 0.5), "stack")


def saved(**changes):
    """problem.npz with some arrays changed."""

    def prepare():
        problem = contacts()
        arrays = {"W_data": problem.W.data, "W_indices": problem.W.indices, "W_indptr": problem.W.indptr}
        np.savez("problem.npz", **(arrays | {"q": problem.q, "mu": problem.mu} | changes))

    return prepare


def without_law():
    write_fclib("problem.hdf5", contacts())
    with h5py.File("problem.hdf5", "a") as file:
        del file["fclib_local/vectors/mu"]


def strange():
    with h5py.File("problem.hdf5", "w") as file:
        file["mesh/nodes"] = np.zeros((4, 3))


NPZ, HDF5 = ("fclib", "problem.npz"), ("fclib", "problem.hdf5")

RIGID = tuple(
    Wrong(what, arguments, message, prepare, alone=True, library=library)
    for what, arguments, message, prepare, library in (
        (
            "a problem that does not exist",
            ("fclib", "none.hdf5"),
            r"none\.hdf5: cannot be read",
            saved(),
            "cannot be read",
        ),
        (
            "a problem in a file of another kind",
            ("fclib", "case.toml"),
            r"case\.toml: cannot be read",
            saved(),
            "cannot be read",
        ),
        (
            "a problem in an HDF5 file of another kind",
            HDF5,
            r"problem\.hdf5: has neither a group fclib_local",
            strange,
            "",
        ),
        ("a problem without friction", HDF5, r"problem\.hdf5: is not complete: ", without_law, "is not complete"),
        ("q of the wrong length", NPZ, r"q \(3,\) and mu \(8,\) have incompatible shapes", saved(q=np.ones(3)), ""),
        (
            "NaN in the free velocities",
            NPZ,
            r"problem\.npz: q has entries that are not finite",
            saved(q=np.full(3 * _CONTACTS, np.nan)),
            "",
        ),
        (
            "a contact with negative friction",
            NPZ,
            r"the coefficient of friction of contact 1 is -0\.2; it must be >= 0",
            saved(mu=np.array([0.5, -0.2, *[0.5] * (_CONTACTS - 2)])),
            "",
        ),
    )
)
