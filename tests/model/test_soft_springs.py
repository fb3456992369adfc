"""A body held by soft springs only: a rigid drift is detected, however large the internal forces."""

import numpy as np
import pytest
from synthetic_evidence import failed

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Spring, Traction, certify


def block(stiffness, friction=0.0, clamps=()):
    """A block of steel pressed on a plane by a load off its middle, on springs all round."""
    return ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (6, 3, 2)),
        Material(2e11, 0.3),
        list(clamps),
        Contact("bottom", friction),
        [Traction("top", lambda x: np.array([0 * x[0], 0 * x[0], -1e6 * (1.0 + 0.2 * x[0])]))],
        springs=[Spring("left", stiffness), Spring("right", stiffness)],
    )


def drifted(problem, way, turn=0.0):
    """The certificate of the answer, moved along the plane by a part of its displacement there, and turned on it."""
    solution = problem.solve(tolerance=1e-10)
    u, x = solution.displacement.copy(), problem.elasticity.x
    along = np.abs(u[:, :2]).max()
    u[:, 0] += way * along - turn * along * (x[:, 1] - 0.5)
    u[:, 1] += turn * along * (x[:, 0] - 1.5)
    return solution, certify(problem, solution.contact_force, u)


@pytest.mark.parametrize("stiffness", [1e5, 1e7])
def test_right_answers_pass(stiffness):
    solution, certificate = drifted(block(stiffness), 0.0)
    assert failed(solution.certificate) <= {"complementarity", "penetration"}  # these need a more accurate solver
    assert certificate["rigid motion"].value <= 1e-7


@pytest.mark.parametrize(("way", "turn"), [(1e-5, 0.0), (0.1, 0.0), (0.0, 1e-5), (0.0, 0.1)])
def test_a_drift_fails(way, turn):
    """Equilibrium and balance of all forces do not detect it."""
    _, certificate = drifted(block(1e5), way, turn)
    assert certificate["rigid motion"].value > 1e-6 and "rigid motion" in failed(certificate)
    assert certificate["equilibrium"].passed and certificate["force balance"].passed


def test_only_free_rigid_motions_are_judged():
    """A clamp along y and z leaves free only the motion along x: the other five move clamped components."""
    problem = block(1e6, clamps=[Clamp("back", "yz")])
    solution, certificate = drifted(problem, 1e-3)
    assert solution.certificate["rigid motion"].value <= 1e-9
    assert "rigid motion" in failed(certificate)
    held = block(1e6, clamps=[Clamp("back")])
    assert held.solve().certificate["rigid motion"].value == 0.0


def test_a_drift_of_a_rubbing_block_fails():
    """With friction as well: errors are relative to the spring forces, not to the contact forces."""
    _, certificate = drifted(block(1e6, friction=0.3), 0.1)
    assert "rigid motion" in failed(certificate)
