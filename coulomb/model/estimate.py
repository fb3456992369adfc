"""Estimates of memory and time before a run, by formulas fitted to measurements of the block.

    python -m benchmarks estimates --p 8 --p 16 --p 24         # estimated and measured

With n displacement and m contact unknowns.  Nested dissection of a body in 3D fills the factor with n^(4/3) numbers and
takes n^2 operations.  The Schur complement on the contact nodes is a dense matrix m x m and takes m^3 more.  Multigrid
is linear in n, and so nearly are its solves (docs/measurements.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..linalg.compliance import DirectSolver, IterativeSolver, LinearSolver
from .conditioning import slenderness_of
from .free_memory import least_room
from .machine import SAME, Slowness
from .problem import ContactProblem

# bytes
_BASE = 1.4e8  # per rank without a mesh: Python, DOLFINx, PETSc
_BODY = 2.3e3  # per displacement unknown: mesh, K, multigrid, fields
_MULTIGRID = 350.0  # per displacement unknown: K in blocks, the last solutions
_FACTOR = 104.0  # over n^(4/3): the factor of K in single precision; in double twice as much
_FRONTS = 132.0  # the same with the contact nodes last, including memory of fronts not yet reused
_DENSE = 6.0  # over m^2: the Schur complement and the inverse of its factor
_COLUMNS = 8.0 / 3.0  # over m^2, in double precision: columns of the inverse for products (`DenseInverse`)

_DOUBLE = 2.0, 2.3  # memory and time of factors in double precision over those in single precision

# seconds on one core of the reference machine (machine.py)
_START = 0.6  # Python, DOLFINx, PETSc
_STEP = 0.04  # per load step of any size: files, rows, sums
_FIELDS = 1.2e-5  # over n: assembly, certificate, output
_OUTPUT = 2e-6  # over n: certificate and output of a later load step
_FACTORISE = 1.5e-10  # over n^2
_COMPLEMENT = 2.0e-11  # over m^3: the Schur complement and its factor
_FILL = 3.6e-7  # over n^(4/3): memory of the factor; with the contact nodes last in the ratio of the memory
_DENSE_STEPS = (3.3e-8, 2.2e-7)  # over m^2 and n^(4/3): path following with A formed
_FACTOR_STEPS = 9.5e-7  # over n^(4/3): path following if a product is a solve with the factor
_MULTIGRID_STEPS = 2.6e-6  # over n^1.2: path following if it is a multigrid solve
_DIRECT_LATER, _MULTIGRID_LATER = 0.3, 0.8  # path following of a later load step over that of the first
_SPEED_UP = 0.75  # exponent of the speed-up over ranks: 1.7 on two

_PICTURE = (1.3, 5e-6)  # picture.png: constant, and over n
_FRAME = (0.3, 5e-6)  # the same of a frame of a film, after the first

_WIDER = 2.4  # rows of K of 27-node hexahedra over those of 8-node ones; of 10-node tetrahedra they are as long
_HARDER = 1.4  # multigrid solves in second order over those in first order

_SQUAT = 1.7  # slenderness of the benchmark block, on which the multigrid steps were measured
_SLENDER = 0.45  # multigrid steps grow with this power of it


@dataclass(frozen=True)
class Estimate:
    """Expected memory and time, within a factor of two for the block and similar bodies.

    Attributes:
        memory: Bytes, over all ranks.
        seconds: Time of a single run with start and output, one core per rank, without pictures.
        seconds_a_step: Time of every further load step, with K already factorised.
        picture: Time of a picture, on one core.
        frame: Time of a frame of a film.
    """

    memory: float
    seconds: float
    seconds_a_step: float
    picture: float
    frame: float


def estimate(
    displacement: int,
    contact: int,
    ranks: int,
    linear_solver: LinearSolver,
    explicit: bool,
    slenderness: float = _SQUAT,
    slowness: Slowness = SAME,
    nodes: int = 8,
    double: bool = False,
) -> Estimate:
    """Estimate for numbers of unknowns and methods.

    Args:
        displacement: Displacement unknowns, over all ranks.
        contact: Contact unknowns, over all ranks.
        ranks: Number of ranks.
        linear_solver: The solver for K.
        explicit: Whether A is formed.
        slenderness: Width of the contact face over the thickness of the body behind it, see `slenderness`.
        slowness: Slowness of this machine.
        nodes: Nodes of a cell: 4 and 8, in second order 10 and 27.
        double: Whether factors are in double precision from the beginning, for a load history.
    """
    n, m = float(displacement), float(contact)
    wider, harder = _wider(nodes), _HARDER if nodes in (10, 27) else 1.0
    memory = _BASE * ranks + _BODY * wider * n
    operations, filled, later = 0.0, 0.0, _DIRECT_LATER
    if linear_solver is DirectSolver:
        fill, (wide, slow) = n ** (4 / 3), _DOUBLE if double else (1.0, 1.0)
        memory += wide * (_FRONTS if explicit else _FACTOR) * fill
        operations += slow * _FACTORISE * n**2
        filled += slow * _FILL * fill * (_FRONTS / _FACTOR if explicit else 1.0)
        if not explicit:
            path = _FACTOR_STEPS * fill
        else:
            memory += (wide * _DENSE + (_COLUMNS if double else 0.0)) * m**2
            operations += slow * _COMPLEMENT * m**3
            path = _DENSE_STEPS[0] * m**2 + _DENSE_STEPS[1] * fill
    else:
        memory += _MULTIGRID * wider * n
        path, later = _MULTIGRID_STEPS * harder * n**1.2 * max(slenderness / _SQUAT, 1.0) ** _SLENDER, _MULTIGRID_LATER
    speed = ranks**_SPEED_UP
    first = (_START + _STEP) * slowness.python
    first += (operations * slowness.dense + (filled + _FIELDS * n + path) * slowness.memory) / speed
    again = _STEP * slowness.python + (_OUTPUT * n + later * path) * slowness.memory / speed
    pictures = (slowness.python * seconds + slowness.memory * of_n * n for seconds, of_n in (_PICTURE, _FRAME))
    return Estimate(memory, first, again, *pictures)


def estimate_of(problem: ContactProblem, slowness: Slowness = SAME) -> Estimate:
    """Estimate for a problem; collective."""
    size = problem.unknowns
    return estimate(
        size["displacement"],
        problem.body.stiffness.interface,
        problem.comm.size,
        problem.body.stiffness.linear_solver,
        problem.body.stiffness.explicit,
        slenderness(problem),
        slowness,
        _nodes_of_cell(problem),
        problem.body.stiffness.in_double,
    )


def slenderness(problem: ContactProblem) -> float:
    """Of the bodies of a problem: see `slenderness_of`; collective."""
    return slenderness_of(problem.surface, problem.elasticity)


def refuse_too_large(problem: ContactProblem) -> None:
    """Compare what the problem needs with the memory that is free, on every node; collective.

    Raises:
        ValueError: On every rank, if a node has too little, with the required and free memory and what would fit.
    """
    comm, size, nodes = problem.comm, problem.unknowns, _nodes_of_cell(problem)
    double = problem.body.stiffness.in_double
    n, m = size["displacement"], problem.body.stiffness.interface
    needed = estimate_of(problem).memory
    fits = least_room(comm)
    if needed <= fits:
        return
    methods = "K factorised" if problem.body.stiffness.linear_solver is DirectSolver else "multigrid"
    methods += ", A formed" if problem.body.stiffness.explicit else ", A matrix-free"
    others = (
        (DirectSolver, False, 'solver.linear_solver = "direct" with solver.compliance = "matrix-free"'),
        (IterativeSolver, False, 'solver.linear_solver = "iterative" with solver.compliance = "matrix-free"'),
    )
    would = [
        f"{how} ({gigabytes(other)})"
        for solver, explicit, how in others
        if (other := estimate(n, m, comm.size, solver, explicit, nodes=nodes, double=double).memory) <= fits
    ]
    most = int(max(fits - _BASE * comm.size, 0.0) / (_wider(nodes) * (_BODY + _MULTIGRID)))
    advice = f"take {' or '.join(would)}" if would else f"by multigrid {most} displacement unknowns would fit"
    raise ValueError(
        f"too little memory: {n} displacement and {size['contact']} contact unknowns ({methods}) need about "
        f"{gigabytes(needed)}, and {gigabytes(fits)} are free; {advice}, a coarser mesh, or a larger machine; --force "
        "tries nevertheless"
    )


def refuse_too_many_cells(cells: tuple[int, int, int], degree: int, comm: MPI.Comm) -> None:
    """As `refuse_too_large` for a box before its mesh is made, with the minimum for any method; collective.

    Raises:
        ValueError: On every rank.
    """
    unknowns = _unknowns(cells, degree)
    needed, fits = _BASE * comm.size + _BODY * unknowns, least_room(comm)
    if needed > fits:
        raise ValueError(
            f"too little memory: a mesh of {_counted(cells, degree)} has {unknowns} displacement "
            f"unknowns, which need at least {gigabytes(needed)}, and {gigabytes(fits)} are free; take fewer cells "
            "(mesh.cells) or a larger machine; --force tries nevertheless"
        )


def refuse_uncountable(cells: tuple[int, int, int], degree: int) -> None:
    """Refuse a box with more unknowns than PETSc's integers can number.

    Raises:
        ValueError: With their number.
    """
    unknowns, most = _unknowns(cells, degree), int(np.iinfo(PETSc.IntType).max)
    if unknowns > most:
        raise ValueError(
            f"too many unknowns: a mesh of {_counted(cells, degree)} has {unknowns} displacement "
            f"unknowns, and the integers of this PETSc reach {most}; take fewer cells (mesh.cells)"
        )


def _wider(nodes: int) -> float:
    """Length of the rows of K with cells of so many nodes, over that of 8-node hexahedra."""
    return _WIDER if nodes == 27 else 1.0


def _nodes_of_cell(problem: ContactProblem) -> int:
    return max(int(member.body.V.dofmap.dof_layout.num_dofs) for member in problem.elasticity.members)


def _unknowns(cells: tuple[int, int, int], degree: int) -> int:
    """Displacement unknowns of a box; of hexahedra and of tetrahedra they are the same."""
    return 3 * (degree * cells[0] + 1) * (degree * cells[1] + 1) * (degree * cells[2] + 1)


def _counted(cells: tuple[int, int, int], degree: int) -> str:
    return f"{cells[0]} x {cells[1]} x {cells[2]} {'second-order ' if degree == 2 else ''}cells"


def gigabytes(size: float) -> str:
    return f"{size / 1e9:.2g} GB" if size < 99.5e9 else f"{size / 1e9:.0f} GB"
