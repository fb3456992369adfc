"""A foundation under a given force and moment on several ranks: its balance, and words."""

import numpy as np
import pytest
from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, NoEquilibrium

comm = MPI.COMM_WORLD


def pressed(**given):
    mesh = coulomb.box((1.0, 1.0, 0.5), (3, 2, 1))
    return ContactProblem(mesh, Material(1e9, 0.3), [Clamp("bottom")], Contact("top", 0.2, **given))


def test_forces_and_moments_balance():
    """On a plane that tilts and slips a little, about the point where the force acts after it has moved."""
    contact = {"force": (1e5, 0.0, -1e6), "moment": (0.0, 0.0, None), "force_point": (0.55, 0.47, 0.5)}
    answer = pressed(**contact).solve(1e-9)
    (found,) = answer.loaded_foundations
    assert answer.valid and abs(found.rotation[1]) > 1e-4
    at, forces = answer.problem.surface.x - found.point, -answer.force_on_body
    sums = comm.allreduce(np.concatenate([forces.sum(axis=0), np.cross(at, forces).sum(axis=0)]), op=MPI.SUM)
    assert np.allclose(sums[:5], [-1e5, 0.0, 1e6, 0.0, 0.0], atol=1e-3)
    assert np.allclose(np.concatenate([found.force, found.moment]), sums, atol=1e-3)


def test_words():
    with pytest.raises(NoEquilibrium, match="the foundation of 'top' along x with 210 kN; friction holds at most 200"):
        pressed(force=(2.1e5, 0.0, -1e6)).solve()
