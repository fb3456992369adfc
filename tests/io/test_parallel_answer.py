"""What the tolerance of the solver leaves of totals is the same on any number of ranks."""

import pytest
from mpi4py import MPI

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box
from coulomb.io.answer import answer_of


def algebraic(comm):
    """Of a block that opens in part."""
    loads = [Traction("top", (0.0, 1.0e7, -4.0e7)), Traction("right", (2.0e7, 0.0, 0.0))]
    mesh = box((3.0, 1.0, 1.0), (9, 3, 3), comm=comm)
    problem = ContactProblem(mesh, Material(2.1e11, 0.3), [Clamp("left")], Contact("bottom", friction=0.3), loads)
    return answer_of(problem.solve(1e-10), 1e-3).algebraic  # as if it were loose: some nodes may be open or closed


@pytest.mark.ranks
def test_the_algebraic_parts_are_those_of_one_rank():
    assert algebraic(MPI.COMM_WORLD) == pytest.approx(algebraic(MPI.COMM_SELF), rel=1e-6)
