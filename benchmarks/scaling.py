"""The block with Coulomb friction in increasing sizes, compared with one linear solve on the same mesh (the yardstick).

The same for two blocks, one on the other: their yardstick is one linear solve of each.

Every size runs in a separate process (`python -m benchmarks.scaling P FRICTION TOLERANCE METHOD CELL DEGREE
PROBLEM`), to measure its peak memory; under mpirun for several ranks.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from coulomb.fem.bodies import Clamp, Elasticity, Member
from coulomb.linalg.compliance import DirectSolver, IterativeSolver
from coulomb.linalg.petsc_arrays import configured_ksp
from coulomb.model.problem import ContactProblem
from coulomb.process import peak_memory
from coulomb.solvers.results import NotConverged

from .block import block
from .petsc_solvers import PETSC
from .processes import several
from .two_blocks import two_blocks

SIZES = (8, 16, 24, 32, 46)
METHODS = ("auto", "direct", "iterative", *PETSC)
CELLS = ("hexahedron", "tetrahedron")
PROBLEMS = ("block", "two-blocks")


_PETSC: dict[str, object] = {"pc_type": "gamg", "ksp_rtol": 1e-8, "ksp_norm_type": "unpreconditioned"}


class Row(NamedTuple):
    """A row of scaling.csv; seconds from the assembled K to the certificate, without mesh, assembly and output.

    The yardstick is one linear solve by algebraic multigrid on the matrix, with the kernels of the contact problem;
    `linear_seconds` is that by multigrid as used here, which in second order goes to linear elements first, and
    `petsc_seconds` that by PETSc alone, as without this package: CG with GAMG on the rigid body modes.
    """

    p: int
    unknowns: int
    contact: int
    ranks: int
    path_following: int
    krylov: int
    seconds: float
    yardstick_seconds: float
    peak_memory_bytes: int
    residual: float
    setup_seconds: float
    multigrid_iterations: int
    certified: bool
    cell: str = "hexahedron"
    degree: int = 1
    linear_seconds: float = 0.0
    problem: str = "block"
    petsc_seconds: float = 0.0


def measure(
    sizes: Iterable[int],
    ranks: Sequence[int],
    friction: float,
    tolerance: float,
    method: str = "auto",
    cell: str = "hexahedron",
    degree: int = 1,
    problem: str = "block",
) -> Iterator[Row]:
    """Rows as they are measured, each in separate processes.

    The two blocks are of hexahedra of first order.

    Raises:
        RuntimeError: If one of them fails, with its error output.
    """
    for p in sizes:
        for count in ranks:
            settings = [str(p), str(friction), str(tolerance), method, cell, str(degree), problem]
            command = [sys.executable, "-m", "benchmarks.scaling", *settings]
            if count > 1:
                command = ["mpirun", "-n", str(count), *command]
            done = subprocess.run(command, env=several(), capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise RuntimeError(f"p = {p} on {count} ranks: {done.stderr.strip()[-2000:]}")
            yield Row(**json.loads(done.stdout.strip().splitlines()[-1]))


def run(p: int, friction: float, tolerance: float, method: str, cell: str, degree: int, problem: str = "block") -> Row:
    """One size in this process; collective."""
    comm = MPI.COMM_WORLD
    options: dict[str, dict[str, Any]] = {
        "auto": {},
        "direct": {"linear_solver": DirectSolver},
        "iterative": {"linear_solver": IterativeSolver, "explicit": False},
        **{name: {"linear_solver": solver, "explicit": False} for name, solver in PETSC.items()},
    }
    if problem == "block":
        body = block(p, friction, cell, degree, **options[method])
    else:
        body = two_blocks(p, friction, **options[method])
    yardstick, linear = _yardsticks(body)
    comm.barrier()
    began = time.perf_counter()
    try:
        solution = body.solve(tolerance)
    except NotConverged as failure:
        solution = body.solution(failure.result)
    comm.barrier()
    seconds = time.perf_counter() - began
    result = solution.result
    row = Row(
        p=p,
        unknowns=body.unknowns["displacement"],
        contact=body.unknowns["contact"],
        ranks=comm.size,
        path_following=result.newton_steps,
        krylov=sum(step.krylov for step in result.history),
        seconds=seconds,
        yardstick_seconds=yardstick,
        peak_memory_bytes=comm.allreduce(peak_memory()),
        residual=result.residual,
        setup_seconds=body.seconds["stiffness"],
        multigrid_iterations=body.body.stiffness.solver.iterations,
        certified=solution.certificate.passed,
        cell=cell,
        degree=degree,
        linear_seconds=linear,
        problem=problem,
    )
    del solution  # and after the peak of memory has been read
    return row._replace(petsc_seconds=sum(_by_petsc(body, member) for member in body.elasticity.members))


def _yardsticks(body: ContactProblem) -> tuple[float, float]:
    """Seconds of one elasticity solve on the same mesh with the contact face held: multigrid set-up and CG to 1e-8.

    Of several bodies the sum of one solve of each: meshes that do not match cannot be glued.

    The first is by algebraic multigrid on the matrix; the second in second order by way of linear elements, as contact
    problems here.
    """
    seconds = np.zeros(2)
    for member in body.elasticity.members:
        seconds += _of_one_body(body, member)
    return float(seconds[0]), float(seconds[1])


def _held(body: ContactProblem, member: Member) -> tuple[Elasticity, PETSc.Mat, PETSc.Vec, PETSc.Vec]:
    """One body with its supports and its contact faces held, without springs: K without the interpolation of linear
    elements, its load and a vector for the displacement."""
    elastic = member.body
    assert isinstance(elastic, Elasticity) and elastic.materials is not None
    touching = {face for contact in body.body.contacts for face in (contact.face, contact.against)}
    clamps = [Clamp(face) for face in elastic.mesh.faces if member.called(face) in touching]
    held = Elasticity(elastic.mesh, elastic.materials, [*elastic.supports, *clamps])
    f, u = held.K.createVecs()
    f.array[:] = held.held.free_part(body.loading.load[member.nodes]).ravel()
    alone = held.K.copy()
    alone.setNearNullSpace(held.K.getNearNullSpace())
    return held, alone, f, u


def _of_one_body(body: ContactProblem, member: Member) -> tuple[float, float]:
    """The seconds of one body."""
    held, alone, f, u = _held(body, member)
    seconds = []
    for K in (alone, held.K) if held.degree == 2 else (alone,):
        u.set(0.0)
        body.comm.barrier()
        began = time.perf_counter()
        solver = IterativeSolver(K, tolerance=1e-8)
        solver.solve(f, u)
        body.comm.barrier()
        seconds.append(time.perf_counter() - began)
        solver.destroy()
        K.destroy()
    for vector in (f, u):
        vector.destroy()
    return seconds[0], seconds[-1]


def _by_petsc(body: ContactProblem, member: Member) -> float:
    """Seconds of the same solve by PETSc."""
    held, alone, f, u = _held(body, member)
    body.comm.barrier()
    began = time.perf_counter()
    ksp = configured_ksp(alone, "cg", _PETSC)
    ksp.solve(f, u)
    body.comm.barrier()
    seconds = time.perf_counter() - began
    for thing in (ksp, alone, held.K, f, u):
        thing.destroy()
    return seconds


def exponent(rows: Sequence[Row]) -> float:
    """Exponent p of seconds ~ unknowns^p by least squares, from the rows with the fewest ranks."""
    alone = [row for row in rows if row.ranks == min(row.ranks for row in rows)]
    n, seconds = (np.log([getattr(row, name) for row in alone]) for name in ("unknowns", "seconds"))
    return float(np.polyfit(n, seconds, 1)[0])


if __name__ == "__main__":
    size, coefficient, tolerance, method, cell, degree, problem = sys.argv[1:8]
    row = run(int(size), float(coefficient), float(tolerance), method, cell, int(degree), problem)
    if MPI.COMM_WORLD.rank == 0:
        sys.stdout.write(json.dumps(row._asdict()) + "\n")
