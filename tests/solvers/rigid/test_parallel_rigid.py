"""Rigid motions on any number of ranks: alone, or `mpirun -n 2 python -m pytest` with the path of this file."""

from dataclasses import replace

import numpy as np
import pytest
from floating_blocks import FloatingBlock, floating_problem
from mpi4py import MPI
from petsc4py import PETSc

from coulomb import InteriorPoint, NotConverged
from coulomb.linalg.compliance import MatrixCompliance
from coulomb.solvers import AugmentedSystem, FrictionLaw, FrictionProblem, RigidMotions, SchurComplementSystem
from coulomb.solvers.equilibrium import equilibrium

comm = MPI.COMM_WORLD


def shared(problem):
    """The problem with its nodes spread over the ranks; the last of several ranks has none."""
    A, m = problem.A.dense(), problem.A.nodes
    sharing = max(comm.size - 1, 1)
    first, last = (m * min(k, sharing) // sharing for k in (comm.rank, comm.rank + 1))
    rows = slice(3 * first, 3 * last)
    sizes = ((3 * (last - first), 3 * m),) * 2
    matrix = PETSc.Mat().createDense(sizes, array=np.asfortranarray(A[rows]), comm=comm)
    matrix.assemble()
    law = FrictionLaw(problem.law.cohesion[first:last], problem.law.friction[first:last])
    rigid = replace(problem.rigid, G=problem.rigid.G[:, rows])
    return FrictionProblem(MatrixCompliance(matrix), problem.b[rows], law, rigid=rigid)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_ranks_agree(law):
    alone = floating_problem(FloatingBlock(), 0.87)
    if law == "tresca":
        alone = alone.with_slip_bound(np.full(alone.A.nodes, 3e4))
    for newton in (SchurComplementSystem(),) + ((AugmentedSystem(),) if law == "tresca" else ()):
        solver = InteriorPoint(1e-9, newton=newton)
        one, many = solver.solve(alone), solver.solve(shared(alone))
        assert np.allclose(np.concatenate(comm.allgather(many.x)), one.x, atol=1e-8 * np.abs(one.x).max())
        assert len(set(comm.allgather(many.rigid.tobytes()))) == 1  # the same on every rank
        assert np.allclose(many.rigid, one.rigid, atol=1e-7 * np.abs(one.rigid).max())


def test_ranks_agree_on_no_equilibrium():
    alone = floating_problem(FloatingBlock(), 1.05)
    one, many = equilibrium(alone), equilibrium(shared(alone))
    assert not many.exists and np.allclose(many.direction, one.direction, atol=1e-6)
    assert np.allclose([many.load, many.resistance], [one.load, one.resistance], rtol=1e-5)
    with pytest.raises(NotConverged, match=r"no equilibrium: the loads push along") as failure:
        InteriorPoint().solve(shared(alone))
    assert len(set(comm.allgather(str(failure.value)))) == 1


def test_wrong_motions_are_refused_on_every_rank():
    problem = shared(floating_problem(FloatingBlock(), 0.5))
    motions = problem.rigid
    wrong = {
        r"rigid: G must have shape": RigidMotions(motions.G[: 6 - (comm.rank == 0)], motions.e),
        r"rigid: e differs between the ranks": RigidMotions(motions.G, motions.e + comm.rank),
    }
    for message, rigid in wrong.items():
        if comm.size > 1 or "differs" not in message:
            with pytest.raises(ValueError, match=message):
                replace(problem, rigid=rigid)
