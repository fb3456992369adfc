"""What a run asks of MPI on 1, 2, 4, 8 ranks: messages, reductions and memory of a rank, per step and per iteration.

Counts, which unlike times do not depend on how many cores there are.  Every run is a process group of its own
(`mpirun -n RANKS python -m benchmarks.cluster P`) with `counter.c` before the MPI library: it counts every
call, those of PETSc and DOLFINx as well, by phases that MPI_Pcontrol separates.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from coulomb.linalg.compliance import IterativeSolver
from coulomb.process import peak_memory

from .block import block
from .processes import several

RANKS = (1, 2, 4, 8)
MESH, LINEAR, SOLVE = 1, 2, 3
"""Phases in their order: mesh, assembly and multigrid set-up; one linear solve to 1e-8; the contact problem."""


class Row(NamedTuple):
    """A row of cluster.csv; messages, bytes and memory are the largest of a rank.

    A multigrid iteration is one of CG with K, counted in one linear solve to 1e-8; what is left of the contact problem
    without its multigrid iterations is counted per Newton step and per iteration of its Krylov method.
    """

    ranks: int
    p: int
    unknowns: int
    contact: int
    newton_steps: int
    krylov: int
    multigrid_iterations: int
    messages_per_multigrid_iteration: float
    kilobytes_per_multigrid_iteration: float
    collectives_per_multigrid_iteration: float
    collectives_per_newton_step: float
    largest_collective_bytes: int
    mesh_collectives: int
    mesh_megabytes: float
    largest_mesh_collective_bytes: int
    unknowns_imbalance: float
    contact_imbalance: float
    ranks_without_contact: int
    peak_memory_bytes: int


def cells_per_metre(unknowns: int) -> int:
    """Cells per metre of the block that has about so many displacement unknowns."""
    sizes = {p: 3 * (3 * p + 1) * (p + 1) ** 2 for p in range(2, 200)}
    return min(sizes, key=lambda p: abs(sizes[p] - unknowns))


def measure(runs: Iterable[tuple[int, int]], friction: float = 0.3, tolerance: float = 1e-7) -> Iterator[Row]:
    """Rows as they are counted.

    Args:
        runs: Ranks, and cells per metre of the block.
        friction: Coefficient of friction.
        tolerance: Residual to stop at.

    Raises:
        ValueError: If there is no mpicc or mpirun.
        RuntimeError: If a run fails, with its error output.
    """
    for program in ("mpicc", "mpirun"):
        if shutil.which(program) is None:
            raise ValueError(f"this benchmark needs {program}, with which the MPI library was installed")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "counter.so"
        source = Path(__file__).with_name("counter.c")
        built = subprocess.run(
            ["mpicc", "-O1", "-shared", "-fPIC", "-o", str(library), str(source)],
            capture_output=True,
            text=True,
            check=False,
        )
        if built.returncode != 0:
            raise RuntimeError(f"mpicc: {built.stderr.strip()[-1000:]}")
        for ranks, p in runs:
            yield _row(ranks, p, friction, tolerance, library)


def _row(ranks: int, p: int, friction: float, tolerance: float, library: Path) -> Row:
    counts = library.with_name("counts")
    environment = several() | {
        "LD_PRELOAD": str(library),
        "COULOMB_MPI_COUNTS": str(counts),
        "OMPI_MCA_rmaps_base_oversubscribe": "1",  # counts do not suffer from more ranks than cores
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OMPI_MCA_hwloc_base_binding_policy": "none",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    }
    settings = [str(p), str(friction), str(tolerance)]
    command = ["mpirun", "-n", str(ranks), sys.executable, "-m", "benchmarks.cluster", *settings]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"p = {p} on {ranks} ranks: {done.stderr.strip()[-2000:]}")
    found = json.loads(done.stdout.strip().splitlines()[-1])
    files = [counts.with_name(f"{counts.name}.{rank}") for rank in range(ranks)]
    table = np.array([np.loadtxt(file, dtype=np.int64)[:, 1:] for file in files])  # rank, phase, quantity
    for file in files:
        file.unlink()
    messages, sent, reductions, others, largest = np.moveaxis(table, 2, 0).max(axis=1)
    linear, inner = found.pop("linear_iterations"), found["multigrid_iterations"]
    per_iteration = (reductions[LINEAR] + others[LINEAR]) / linear
    return Row(
        ranks=ranks,
        p=p,
        messages_per_multigrid_iteration=messages[LINEAR] / linear,
        kilobytes_per_multigrid_iteration=sent[LINEAR] / linear / 1000.0,
        collectives_per_multigrid_iteration=per_iteration,
        collectives_per_newton_step=(reductions[SOLVE] + others[SOLVE] - inner * per_iteration) / found["newton_steps"],
        largest_collective_bytes=int(largest[SOLVE]),
        mesh_collectives=int(reductions[MESH] + others[MESH]),
        mesh_megabytes=sent[MESH] / 1e6,
        largest_mesh_collective_bytes=int(largest[MESH]),
        **found,
    )


def run(p: int, friction: float, tolerance: float) -> None:
    """One run, collective; rank 0 prints what the ranks have, as JSON."""
    comm = MPI.COMM_WORLD
    MPI.Pcontrol(1)  # the next phase
    problem = block(p, friction, linear_solver=IterativeSolver, explicit=False)
    stiffness = problem.body.stiffness.solver
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


if __name__ == "__main__":
    run(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]))
