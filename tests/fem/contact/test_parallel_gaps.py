"""Press fits, and gaps of curved pairs, on any number of ranks: alone, or with mpirun."""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import by_place, everywhere, same_error
from shared_problems import ring_mesh
from test_curved_pairs import RADIUS, rolled

from coulomb import Contact, ContactProblem, Cylinder, LoadHistory, Material, SymmetryPlane
from coulomb.solvers import DirectSolver, IterativeSolver

comm = MPI.COMM_WORLD


def ring(over, gap=lambda x: -5e-5 * (1.0 + x[2]), degree=1, **more):
    mesh = ring_mesh(0.1, 0.2, (2, 4, 2), cell="tetrahedron", comm=over, degree=degree)
    pin = Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.1)
    way = [(1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 2e-5)]
    fit = Contact("left", 0.2, foundation=pin, gap=gap, gap_amplitude=[(0.0, 0.0), (1.0, 1.0)], motion=way)
    supports = [SymmetryPlane(face) for face in ("front", "back", "bottom", "top")]
    return ContactProblem(mesh, Material(2e11, 0.3), supports, fit, **more)


@pytest.mark.parametrize(("linear_solver", "degree"), [(IterativeSolver, 1), (DirectSolver, 2)])
def test_a_press_fit_that_is_pulled(linear_solver, degree):
    history = LoadHistory(times=[1.0, 2.0], tolerance=1e-10)
    alone = history.steps(ring(MPI.COMM_SELF, degree=degree))
    together = history.steps(ring(comm, degree=degree, linear_solver=linear_solver))
    for one, other in zip(alone, together, strict=True):
        expected, found = (answer.solution.at_nodes.totals() for answer in (one, other))
        assert other.solution.certificate.passed
        assert found["normal_force"] == pytest.approx(expected["normal_force"], rel=1e-8)
        assert np.allclose(found["force"], expected["force"], rtol=0.0, atol=1e-8 * expected["normal_force"])
        assert other.state.energy.foundation == pytest.approx(one.state.energy.foundation, rel=1e-8)


def test_a_bore_is_wider_by_its_interference_at_every_node():
    """A ring on a pin: the bore takes the pin's radius."""
    solution = ring(comm, lambda x: -1e-4 * (1.0 + x[2]), time=1.0).solve()
    surface = solution.problem.surface
    u = solution.displacement[surface.nodes]
    radial = np.einsum("ki,ki->k", u[:, :2], surface.x[:, :2]) / 0.1
    assert radial == pytest.approx(1e-4 * (1.0 + surface.x[:, 2]), rel=1e-6)
    assert solution.small_strain.gap_error <= 1e-2 and solution.valid


def test_wrong_gaps_are_errors_on_all_ranks():
    assert "larger than the body" in same_error(lambda: ring(comm, -3.0, time=1.0))
    nan_at_one_end = lambda x: np.where(x[0] > 0.09, np.nan, 0.0)  # noqa: E731
    assert "not finite" in same_error(lambda: ring(comm, nan_at_one_end))


@pytest.mark.parametrize("given", [{}, {"smooth": True}, {"surface": Cylinder((0, 0, 0), (0, 1, 0), RADIUS)}], ids=str)
@pytest.mark.ranks
def test_ranks_find_the_same_gaps_and_chords_of_a_roller(given):
    """With the facets as they are, smooth, and by the surface; and the same forces."""
    alone, together = (rolled(6, "tetrahedron", 1, 3e5, 0.3, over, **given) for over in (MPI.COMM_SELF, comm))
    x, other = together.surface, alone.surface
    for name in ("gap", "chord"):
        found = by_place(everywhere(x.x), everywhere(getattr(x, name)))
        assert found == pytest.approx(by_place(other.x, getattr(other, name)), rel=1e-9, abs=1e-15)
    forces = [problem.solve().at_nodes.totals()["normal_force"] for problem in (alone, together)]
    assert forces[1] == pytest.approx(forces[0], rel=1e-6)
