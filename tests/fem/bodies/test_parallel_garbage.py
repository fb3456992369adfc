"""A process that makes many problems: what nobody uses any more is freed."""

import gc
import weakref

import pytest
from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material
from coulomb.fem.bodies import displacement_space

BODIES = 2
comm = MPI.COMM_WORLD
MPICH = "MPICH" in MPI.Get_library_version()


@pytest.fixture(autouse=True)
def searches_are_frequent(monkeypatch):
    monkeypatch.setattr(displacement_space, "_BODIES", BODIES)


def communicators_left() -> int:
    """How many communicators MPICH has left, of 2046."""
    made = []
    handler = comm.Get_errhandler()
    comm.Set_errhandler(MPI.ERRORS_RETURN)
    try:
        while True:
            made.append(comm.Dup())
    except MPI.Exception:
        return len(made)
    finally:
        comm.Set_errhandler(handler)
        for each in made:
            each.Free()


def test_meshes_and_communicators_of_earlier_problems_are_freed():
    meshes, left = [], []
    gc.collect()
    gc.disable()
    try:
        for _ in range(4 * BODIES):
            mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 1), degree=2)
            problem = ContactProblem(mesh, Material(1e9, 0.3), [Clamp("top")], Contact("bottom", 0.3))
            assert problem.solve().certificate.passed
            meshes.append(weakref.ref(mesh.domain))
            if MPICH and len(meshes) % (2 * BODIES) == 0:
                left.append(communicators_left())
    finally:
        gc.enable()
    assert sum(mesh() is not None for mesh in meshes) <= BODIES + 1
    if MPICH:
        assert left[1] >= left[0] - BODIES  # one communicator a problem


def test_what_is_used_is_kept():
    kept = ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), Material(1e9, 0.3), [Clamp("top")], Contact("bottom", 0.3)
    )
    expected = kept.solve().contact_force
    half = comm.Split(comm.rank % 2)
    for k in range(3 * BODIES):  # of all ranks, of some, of one
        on = (comm, half, MPI.COMM_SELF)[k % 3]
        mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), comm=on)
        ContactProblem(mesh, Material(1e9, 0.3), [Clamp("top")], Contact("bottom", 0.3)).solve()
    assert abs(kept.solve().contact_force - expected).max(initial=0.0) <= 1e-12 * abs(expected).max(initial=1.0)
