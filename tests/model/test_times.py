"""A problem moved to another time equals the problem made for that time.

On any number of ranks: alone, or as `mpirun -n 3 python -m pytest tests/model/test_times.py`.
"""

import numpy as np
import pytest
from mpi4py import MPI

import coulomb
from coulomb import Contact, ContactProblem, Material, PrescribedDisplacement, Sphere, Spring, Traction
from coulomb.solvers import DirectSolver, IterativeSolver

RUBBER = Material(1e7, 0.3)
MESH = coulomb.box((0.1, 0.1, 0.05), (4, 4, 3))
WAYS = {
    "default": {},
    "products with K^-1": {"linear_solver": DirectSolver, "explicit": False},
    "multigrid": {"linear_solver": IterativeSolver, "explicit": False},
}


def problem(time, **options):
    """Everything changes in time but K: loads, a clamp, and a ball that turns its normals at the nodes."""
    return ContactProblem(
        MESH,
        RUBBER,
        [PrescribedDisplacement("top", (1e-3, 0.0, 0.0), "x", amplitude=[(0.0, 0.0), (1.0, 1.0)])],
        Contact(
            "bottom",
            0.3,
            foundation=Sphere((0.06, 0.05, -0.3), 0.3),
            motion=[(0.0, 0.0, 0.0, 0.0), (1.0, 0.02, 0.01, 1e-3)],
        ),
        [Traction("top", (0.0, 1e4, -5e4), [(0.0, 1.0), (1.0, 2.0)])],
        (0.0, 0.0, -1e5),
        [Spring("top", 1e8)],
        body_force_amplitude=[(0.0, 1.0), (1.0, -1.0)],
        time=time,
        **options,
    )


def norm(values):
    return np.sqrt(MPI.COMM_WORLD.allreduce(float(np.sum(np.square(values))), op=MPI.SUM))


def close(values, expected, accuracy):
    return norm(values - expected) <= accuracy * norm(expected)


def product(A, x):
    y = np.empty_like(x)
    A.mult(x, y)
    return y


@pytest.mark.parametrize("way", WAYS)
def test_a_problem_at_another_time(way):
    """Solved, taken to another time, solved, and the first once more: data and answers are those of fresh problems."""
    first = problem(0.3, **WAYS[way])
    answers = [first.solve(1e-9)]
    later = first.at(1.0)
    answers += [later.solve(1e-9), first.solve(1e-9)]
    turned = np.abs(later.surface.frames - first.surface.frames).max(initial=0.0)
    assert MPI.COMM_WORLD.allreduce(turned, op=MPI.MAX) > 0.01
    for answer, time in zip(answers, (0.3, 1.0, 0.3), strict=True):
        ours, fresh = answer.problem, problem(time, **WAYS[way])
        assert ours.time == time and np.array_equal(ours.motions, fresh.motions)
        assert np.allclose(ours.surface.frames, fresh.surface.frames, rtol=0.0, atol=1e-13)
        assert np.allclose(ours.surface.gap, fresh.surface.gap, rtol=0.0, atol=1e-15)
        x = np.random.default_rng([8, ours.comm.rank]).standard_normal(3 * len(ours.surface.nodes))
        assert close(product(ours.A, x), product(fresh.A, x), 1e-8)
        assert close(ours.b, fresh.b, 1e-8)
        expected = fresh.solve(1e-9)
        assert close(answer.contact_force, expected.contact_force, 1e-6)
        assert close(answer.displacement, expected.displacement, 1e-6)
        assert answer.certificate.passed
    assert close(answers[1].displacement, answers[0].displacement, 10.0)
    assert not close(answers[1].displacement, answers[0].displacement, 0.1)
