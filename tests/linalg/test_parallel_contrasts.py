"""Multigrid where materials are far apart: as if the stiffness were factorised.

Run alone, or as `mpirun -n 2 python -m pytest tests/linalg/test_parallel_contrasts.py`.
"""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import by_place, everywhere

import coulomb
from coulomb import Contact, ContactProblem, Material, Traction
from coulomb.fem.bodies.materials import midpoints
from coulomb.solvers import DirectSolver, IterativeSolver

STEEL = Material(2.1e11, 0.3)


def layered(size, cells, border, comm):
    """A box with a "lower" and an "upper" layer."""
    whole = coulomb.box(size, cells, comm=comm)
    z = midpoints(whole.domain)[: whole.domain.topology.index_map(3).size_local, 2]
    groups = {
        "lower": np.flatnonzero(z < border).astype(np.int32),
        "upper": np.flatnonzero(z > border).astype(np.int32),
    }
    return coulomb.NamedMesh(whole.domain, whole.faces, groups)


def foot(comm, solver):
    """Rubber under steel, held by friction alone."""
    return ContactProblem(
        layered((0.08, 0.06, 0.028), (6, 4, 7), 0.02, comm),
        {"lower": Material(2e7, 0.45), "upper": STEEL},
        [],
        Contact("bottom", 0.6),
        [Traction("top", (1.2e5, 0.0, -3e5))],
        linear_solver=solver,
    )


@pytest.mark.parametrize("make", [foot])
def test_multigrid_against_a_factorised_stiffness(make):
    expected = make(MPI.COMM_SELF, DirectSolver).solve(1e-10)
    found = make(MPI.COMM_WORLD, IterativeSolver).solve(1e-10)
    assert found.certificate.passed
    assert found.problem.stiffness.solver.name.startswith("iterative")
    surface = found.problem.surface
    force = surface.vectors(found.contact_force.reshape(-1, 3))
    known = expected.problem.surface.vectors(expected.contact_force.reshape(-1, 3))
    known = by_place(expected.problem.surface.x, known)
    off = by_place(everywhere(surface.x), everywhere(force)) - known
    assert np.linalg.norm(off) <= 1e-7 * np.linalg.norm(known)
