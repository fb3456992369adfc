"""Contact points whose displacement is a mean over several nodes: slip, gap, forces and work go through B alone.

Mortar elements and second-order faces have such rows.  Here each point takes 0.6 of its node and the rest of its
neighbours on the face; everything is compared with dense algebra of these weights.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from conftest import to_csr

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Plane, Sphere
from coulomb.fem.contact import contact_points, surface
from coulomb.io import output
from coulomb.io.history_files import at_points, points_in_files
from coulomb.io.run_directory import RunDirectory
from coulomb.model import problem_evidence

RUBBER = Material(1e7, 0.3)
PATH = [(0, 0, 0, 0), (1, 0, 0, 1e-3), (2, 2e-3, 0, 1e-3), (3, -1e-3, 5e-4, 1e-3)]
H = 0.025


def several_nodes(elasticity, nodes):
    """The weights of the points at these nodes, shape (m, nodes); on one rank."""
    x, y = elasticity.x, elasticity.x[nodes]
    distance = np.linalg.norm(y[:, None] - x[None], axis=2)
    beside = (np.abs(distance - H) < 1e-9) & (np.abs(x[None, :, 2] - y[:, None, 2]) < 1e-9)
    weights = 0.4 * beside / beside.sum(axis=1, keepdims=True) + 0.6 * (distance < 1e-9)
    return scipy.sparse.csr_matrix(weights)


def averages(space, facets):
    nodal = contact_points(space, facets)
    return replace(nodal, weights=several_nodes(space, nodal.nodes), nodal=False)


@pytest.fixture(autouse=True)
def weights(monkeypatch):
    for module in (surface, problem_evidence):
        monkeypatch.setattr(module, "contact_points", averages)


def dragged(friction=0.4, foundation=None, **ways):
    """A block of rubber that a foundation presses and rubs to and fro; no contact node is clamped."""
    contact = Contact("bottom", friction, foundation=foundation or Plane((0, 0, 0), (0, 0, 1)), motion=PATH)
    return ContactProblem(coulomb.box((0.1, 0.1, 0.05), (4, 4, 2)), RUBBER, [Clamp("top")], contact, **ways)


def weights_of(problem):
    return several_nodes(problem.elasticity, problem.surface.nodes)


WAYS = {
    "Schur complement": {"explicit": True},
    "matrix-free": {"explicit": False},
    "multigrid": {"linear_solver": coulomb.solvers.IterativeSolver, "explicit": False},
}


@pytest.mark.parametrize("ways", WAYS.values(), ids=WAYS)
def test_A_b_and_displacement_are_those_of_the_weights(ways):
    problem = dragged(**ways).at(2.0)
    surface, elasticity = problem.surface, problem.elasticity
    assert surface.points.weights.nnz > 3 * len(surface.nodes)
    B = np.einsum("kij,kl->kilj", surface.frames, weights_of(problem).toarray()).reshape(3 * len(surface.nodes), -1)
    K, f = to_csr(elasticity.K).toarray(), problem.linear.f.array_r
    x = np.random.default_rng(1).normal(size=len(B)) * 10.0
    u = np.linalg.solve(K, f - B.T @ x)
    assert problem.displacement(x).ravel() == pytest.approx(u, abs=1e-9 * np.abs(u).max())
    closed = (B @ u).reshape(-1, 3)
    closed[:, 0] -= surface.gap
    Ax = np.empty_like(x)
    problem.A.mult(x, Ax)
    assert problem.b - Ax == pytest.approx(closed.ravel(), abs=1e-9 * np.abs(closed).max())
    assert surface.at_nodes(x).ravel() == pytest.approx(B.T @ x, abs=1e-12 * np.abs(x).max())


@pytest.mark.parametrize("foundation", [None, Sphere((0.05, 0.05, -0.5), 0.5)], ids=["plane", "ball"])
def test_every_step_is_certified_and_slips_by_the_weights(foundation, tmp_path):
    problem = dragged(foundation=foundation)
    W, motion, before = weights_of(problem), problem.motions[0], np.zeros_like(problem.elasticity.x)
    for step in LoadHistory([1.0, 1.5, 2.0, 3.0]).steps(problem):
        solution, surface = step.solution, step.solution.problem.surface
        assert solution.certificate.passed, solution.certificate
        here = solution.problem.motions[0]
        slip = surface.components(W @ (solution.displacement - before) - (here - motion))
        slip[:, 0] = 0.0
        answer = solution.at_nodes
        assert answer.fields()["slip"] == pytest.approx(surface.vectors(slip), abs=1e-12)
        assert answer.displacement_vectors == pytest.approx(W @ solution.displacement, abs=1e-12)
        gap = surface.gap - surface.components(W @ solution.displacement)[:, 0]
        assert answer.fields()["gap"] == pytest.approx(gap, abs=1e-12)
        assert solution.small_strain.slip_over_cell < 1.0
        motion, before = here, solution.displacement
    assert np.abs(slip).max() > 1e-4  # it does slip
    output.write(solution, tmp_path)
    _, points = points_in_files(RunDirectory(tmp_path), problem)
    written = at_points(tmp_path / "contact.xdmf", "slip", points, problem.comm)
    assert written == pytest.approx(surface.vectors(slip), abs=1e-12)
