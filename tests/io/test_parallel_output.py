"""Results that cannot be written, on any number of ranks: alone, or as `mpirun -n 3 python -m pytest` of this file.

An error of rank 0, which writes, is raised on every rank.
"""

from pathlib import Path
from unittest import mock

import pytest
from conftest import make_block
from mpi4py import MPI

from coulomb.io import output
from coulomb.ranks import on_rank_0

comm = MPI.COMM_WORLD


@pytest.fixture(scope="module")
def solution():
    return make_block(2).solve(tolerance=1e-8)


@pytest.fixture
def folder(tmp_path):
    return Path(comm.bcast(str(tmp_path)))


def forgetful(*_):
    raise KeyError("a fault of the program")


def broken(*_, **__):
    raise RuntimeError("unable to extend the file")


@pytest.mark.parametrize(
    ("place", "action", "error", "said"),
    [
        ("coulomb.io.output.write_json", forgetful, (KeyError, RuntimeError), "a fault of the program"),
        ("h5py.File.create_dataset", broken, OSError, "solution.h5: unable to extend the file"),
        ("h5py.File.close", broken, OSError, "solution.h5: unable to extend the file"),
        ("coulomb.io.grid_file._description", broken, OSError, "unable to extend the file"),
    ],
)
def test_an_error_of_the_rank_that_writes_is_raised_on_all(solution, folder, place, action, error, said):
    with mock.patch(place, action), pytest.raises(error, match=said):
        output.write(solution, folder)
    comm.barrier()
    assert not list(folder.iterdir())  # nothing half done is left
    comm.barrier()
    assert output.write(solution, folder)["certificate"]["passed"] and (folder / "solution.h5").stat().st_size > 0


def test_what_rank_0_raises_is_raised_on_all():
    for given, raised in (
        (OSError(28, "full"), OSError),
        (ValueError("wrong"), ValueError),
        (KeyError("x"), Exception),
    ):

        def action(fault=given):
            raise fault

        with pytest.raises(raised):
            on_rank_0(comm, action)
    assert on_rank_0(comm, lambda: "done") == "done"
