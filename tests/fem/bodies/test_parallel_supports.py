"""Supports along any direction, on any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI
from ranks import by_place, everywhere, same_error
from test_oblique_supports import HISTORY, TURN, rubbed, wedged

import coulomb
from coulomb import Clamp, Elasticity, SymmetryPlane
from coulomb.solvers import DirectSolver, IterativeSolver

comm = MPI.COMM_WORLD


@pytest.mark.parametrize(("cell", "linear_solver"), [("tetrahedron", DirectSolver), ("hexahedron", IterativeSolver)])
def test_a_plane_of_symmetry_across_a_contact_face(cell, linear_solver):
    alone = HISTORY.steps(rubbed(TURN, cell, comm=MPI.COMM_SELF))
    together = HISTORY.steps(rubbed(TURN, cell, linear_solver=linear_solver))
    for one, other in zip(alone, together, strict=True):
        expected = by_place(one.solution.problem.surface.x, one.solution.force_on_body)
        x = everywhere(other.solution.problem.surface.x)
        found = by_place(x, everywhere(other.solution.force_on_body))
        assert other.solution.certificate.passed and len(x) == 20
        assert np.abs(found - expected).max() <= 1e-8 * np.abs(expected).max()
        for mine, theirs in zip(one.solution.reactions, other.solution.reactions, strict=True):
            assert np.abs(np.array(mine.force) - theirs.force).max() <= 1e-8 * np.abs(expected).sum()


@pytest.mark.parametrize("linear_solver", [DirectSolver, IterativeSolver])
def test_an_inclined_guide_that_meets_the_floor(linear_solver):
    problem, p = wedged("tetrahedron", 0.0, TURN, linear_solver=linear_solver)
    solution = problem.solve(1e-9)
    assert solution.certificate.passed
    assert np.allclose(solution.contact_force[0::3], p * problem.surface.area, rtol=1e-6)


def test_wrong_faces_are_errors_on_all_ranks():
    box = coulomb.box((1.0, 1.0, 1.0), (3, 3, 3))
    corner = np.unique(np.concatenate([box.faces["left"], box.faces["front"]]))
    mesh = coulomb.NamedMesh(box.domain, {**box.faces, "corner": corner})
    assert "must be plane" in same_error(lambda: Elasticity(mesh, STEEL, [SymmetryPlane("corner")]))
    assert "has an edge" in same_error(lambda: Elasticity(mesh, STEEL, [Clamp("corner", "normal")]))
    assert "must not be zero" in same_error(
        lambda: Elasticity(mesh, STEEL, [Clamp("left", direction=lambda x: np.where(x[2] > 0.9, 0.0, 1.0) + 0.0 * x)])
    )


def test_nodes_of_faces_in_turn():
    """Of facets of other ranks, too, whichever face was asked for before."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 3, 4), "tetrahedron", degree=2)
    body = Elasticity(mesh, STEEL, [])
    ends = {"bottom": (2, 0.0), "top": (2, 1.0), "left": (0, 0.0)}
    for face in ("bottom", "top", "left", "bottom", "top"):
        axis, place = ends[face]
        expected = np.flatnonzero(np.abs(body.x[:, axis] - place) < 1e-12)
        found = body.nodes_of(mesh.faces[face])
        assert not comm.allreduce(not np.array_equal(found, expected), op=MPI.LOR), face
        area, normal = body.area_of(mesh.faces[face]), body.normal_of(mesh.faces[face])
        assert comm.allreduce(area.sum(), op=MPI.SUM) == pytest.approx(1.0, rel=1e-12), face
        assert comm.allreduce(abs(normal[:, axis].sum()), op=MPI.SUM) == pytest.approx(1.0, rel=1e-12), face
