"""Error bars are the same on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box


def bars(comm):
    mesh = box((2.0, 1.0, 1.0), (6, 3, 3), comm=comm)
    loads, clamps = [Traction("top", (1.0e6, 0.0, -1.0e7))], [Clamp("left")]
    problem = ContactProblem(mesh, Material(2.0e11, 0.3), clamps, Contact("bottom", friction=0.3), loads)
    return problem.solve(1e-10).error()


@pytest.mark.ranks
def test_the_bars_are_those_of_one_rank():
    ours, alone = bars(MPI.COMM_WORLD), bars(MPI.COMM_SELF)
    np.testing.assert_allclose(ours.relative_stress_error, alone.relative_stress_error, rtol=1e-6)
    for one, other in zip(ours.bars, alone.bars, strict=True):
        assert one.quantity == other.quantity
        np.testing.assert_allclose(one.bar, other.bar, rtol=1e-5, atol=1e-6 * np.max(np.abs(other.value)))


def of_the_other_order(comm):
    """Of tetrahedra, each order beside the other, as for meshes from files."""
    found = []
    for degree in (1, 2):
        mesh = replace(box((1.0, 1.0, 1.0), (2, 3, 2), "tetrahedron", comm=comm, degree=degree), coarser=None)
        loads, clamps = [Traction("top", (1.0e6, 0.0, -1.0e7))], [Clamp("left")]
        posed = ContactProblem(mesh, Material(2.0e11, 0.3), clamps, Contact("bottom", friction=0.3), loads)
        found.append(posed.solve(1e-10).error().relative_stress_error)
    return found


@pytest.mark.ranks
def test_the_error_of_the_stress_by_the_other_order_is_that_of_one_rank():
    np.testing.assert_allclose(of_the_other_order(MPI.COMM_WORLD), of_the_other_order(MPI.COMM_SELF), rtol=1e-6)
