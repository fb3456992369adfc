"""Error bars are the same on any number of ranks."""

import numpy as np
from mpi4py import MPI

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box


def bars(comm):
    mesh = box((2.0, 1.0, 1.0), (6, 3, 3), comm=comm)
    loads, clamps = [Traction("top", (1.0e6, 0.0, -1.0e7))], [Clamp("left")]
    problem = ContactProblem(mesh, Material(2.0e11, 0.3), clamps, Contact("bottom", friction=0.3), loads)
    return problem.solve(1e-10).error().bars


def test_the_bars_are_those_of_one_rank():
    ours, alone = bars(MPI.COMM_WORLD), bars(MPI.COMM_SELF)
    for one, other in zip(ours, alone, strict=True):
        assert one.quantity == other.quantity
        np.testing.assert_allclose(one.bar, other.bar, rtol=1e-5, atol=1e-6 * np.max(np.abs(other.value)))
