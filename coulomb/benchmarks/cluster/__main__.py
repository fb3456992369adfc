"""One run of `coulomb benchmark cluster`: P FRICTION TOLERANCE; prints what the ranks have, as JSON."""

from __future__ import annotations

import json
import sys

import numpy as np
from mpi4py import MPI

from ...linalg.compliance import IterativeSolver
from ...process import peak_memory
from ..block import block


def main(p: int, friction: float, tolerance: float) -> None:
    comm = MPI.COMM_WORLD
    MPI.Pcontrol(1)  # the next phase
    problem = block(p, friction, linear_solver=IterativeSolver, explicit=False)
    stiffness = problem.body.stiffness_solver
    MPI.Pcontrol(1)
    f = problem.elasticity.f(problem.elasticity.at(0.0))
    u = f.duplicate()
    before = stiffness.iterations
    stiffness.solve(f, u, 1e-8)
    linear = stiffness.iterations - before
    MPI.Pcontrol(1)
    before = stiffness.iterations
    result = problem.solve(tolerance).result
    inner = stiffness.iterations - before
    MPI.Pcontrol(0)
    mine = [3 * len(problem.elasticity.x), len(problem.surface.x), peak_memory()]
    unknowns, contact, memory = np.array(comm.allgather(mine)).T
    if comm.rank == 0:
        found = {
            "unknowns": int(unknowns.sum()),
            "contact": int(3 * contact.sum()),
            "newton_steps": result.newton_steps,
            "krylov": sum(step.krylov for step in result.history),
            "multigrid_iterations": inner,
            "linear_iterations": linear,
            "unknowns_imbalance": float(unknowns.max() / unknowns.mean()),
            "contact_imbalance": float(contact.max() / contact.mean()),
            "ranks_without_contact": int(np.sum(contact == 0)),
            "peak_memory_bytes": int(memory.max()),
        }
        sys.stdout.write(json.dumps(found) + "\n")


main(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]))
