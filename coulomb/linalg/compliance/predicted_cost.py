"""Which is faster, K factorised or multigrid: a solution by multigrid, with the iterations that factors are worth.

The operations of a factorisation are known exactly from its fronts (`multifrontal.predicted_work`).  The iterations of
multigrid are measured: a load step takes 12 to 37 times as many as the displacements under equal normal forces, to
1e-8, on blocks and parts of any cells and Poisson's ratios up to 0.4999, thin bodies 40 to 100 times.  So this first
solution is computed, unless factors take no longer than the easiest body does by multigrid; where it takes more
iterations than factors are `worth`, in a twentieth of their time, these are made.  So they are where path following by
multigrid has taken twice as many iterations as expected, and as long as factors take (`patience`), as
of sheets and of bodies on soft springs.

In a load history the factors are made once, and a later step costs a third to two thirds of the first path; by
multigrid it takes about as many iterations as the first.

The constants are least squares of processor seconds on one thread over the block (p = 6 to 24) and parts with 2 000 to
80 000 unknowns; their ratios matter (factors-or-multigrid.csv).  What they are fitted to:

    python -m benchmarks parts --method direct --method iterative --clscale 1 --clscale 0.5 --clscale 0.3
    python -m benchmarks scaling --method direct --p 10 --p 16 --p 24                 # and --method iterative
    python -m benchmarks histories --p 10 --p 16 --peer coulomb
"""

from __future__ import annotations

from typing import Final

from ..factors import SINGLE_FROM, Work
from .stiffness import DirectSolver, IterativeSolver

# The choice of solvers for K^-1 and A by size and number of ranks, where the user makes none.
#
# It is made by the first solution where the size leaves it open (`undecided`, `worth`).

DIRECT_UP_TO: Final = 50_000
"""Displacement unknowns up to which K is factorised where it is small, or the user wants A not to be formed."""

PREDICTED_UP_TO: Final = 1_000_000
"""Displacement unknowns beyond which K is not factorised by default: of a block the factors take 20 GB and more."""

_SMALL = (12_000, 3_000)
"""Displacement and contact unknowns up to which K is factorised in any case."""

EXPLICIT_UP_TO: Final = 10_000
"""Contact unknowns up to which A is formed by default, where K is factorised (measured: docs/measurements.md)."""

LinearSolver = type[DirectSolver] | type[IterativeSolver]


def undecided(displacement: int, contact: int, linear_solver: LinearSolver | None, explicit: bool | None) -> bool:
    """Whether the faster method is to be found by one solution; arguments as of `chosen`."""
    small = displacement <= _SMALL[0] and contact <= _SMALL[1]
    return linear_solver is None and explicit is None and displacement <= PREDICTED_UP_TO and not small


def chosen(
    displacement: int, contact: int, ranks: int, linear_solver: LinearSolver | None, explicit: bool | None
) -> tuple[LinearSolver, bool]:
    """The solver for K by displacement and contact unknowns over all ranks, and whether A is formed.

    K is factorised by `MultifrontalSolver` on one rank, and by the first of several for all (`FirstRankSolver`); where
    A is not formed, on several only if the user chooses it.  `linear_solver` and `explicit` are the user's choices, if
    any.

    Raises:
        ValueError: If A is to be formed without a factorisation of K.
    """
    if not (linear_solver is None or callable(linear_solver)):
        raise ValueError(f"linear_solver must be DirectSolver or IterativeSolver, a class, but is {linear_solver!r}")
    if explicit and linear_solver is IterativeSolver:
        raise ValueError(
            'A can be formed (solver.compliance = "explicit", explicit=True) only where K is factorised: set '
            'solver.linear_solver = "direct" (linear_solver=DirectSolver), or leave both to be chosen'
        )
    if linear_solver is None:
        small = displacement <= DIRECT_UP_TO and (ranks == 1 or (explicit is None and contact <= EXPLICIT_UP_TO))
        linear_solver = DirectSolver if explicit or small else IterativeSolver
    if explicit is None:
        explicit = linear_solver is DirectSolver and contact <= EXPLICIT_UP_TO
    return linear_solver, explicit


_OPERATION: Final = 1.1e-11  # seconds per operation of the factorisation, in single precision
_BYTE: Final = 2.7e-9  # the rest of it, per byte of the factors
_SINGLE, _DOUBLE = (1.0, 0.0, 0.6), (3.0, 1.0e-11, 0.3)
"""Precisions: times as long for factors, double after single; per cube of contact unknowns; a later load step over the
first path, as in double the inverses that many solves need are kept."""
_PATH = (0.034, 3.3e-8, 1.3e-9)  # path following: constant, per square of contact unknowns, per byte of the factors
_CONDENSED: Final = 80.0  # path following where A is not formed, over the factorisation

_ITERATION = (2.5e-4, 1.2e-7)  # of multigrid: constant, per displacement unknown
_RANKS: Final = 0.63  # on r ranks it is faster by r to this power: 1.55 on two
_SOLUTIONS: Final = 20.0  # iterations of a load step over those of the first solution
_UNHELD: Final = 1.6  # times as many where contact alone resists a rigid motion
_PATIENCE: Final = 2.0  # times the expected iterations, before factors are made instead

LEAST: Final = 9.5
"""Iterations of the first solution up to which none is tried: the easiest bodies, cubes of 8 nodes, take 10."""


def worth(
    work: Work,
    displacement: int,
    contact: int,
    steps: int = 1,
    single: bool = True,
    formed: bool = True,
    ranks: int = 1,
    unheld: bool = False,
) -> float:
    """Iterations of the first solution by multigrid with which that takes as long as factors, to the last certificate.

    Args:
        work: What the factorisation takes.
        displacement: Displacement unknowns, over all ranks.
        contact: Displacements on which contact forces act.
        steps: Number of load steps.
        single: Whether factors are expected to be in single precision.
        formed: Whether A is formed; where it is not, K with springs is factorised in every step of path following
            (`CondensedSystem`).
        ranks: Number of ranks.
        unheld: Whether contact alone resists a rigid motion.
    """
    constant, square, byte = _PATH
    factors = _OPERATION * work.operations + _BYTE * work.bytes
    times, cube, later = _SINGLE if single else _DOUBLE
    if formed:
        path = constant + square * contact**2 + byte * work.bytes
    else:
        path, cube = _CONDENSED * factors, 0.0
    direct = times * factors + cube * contact**3 + path * (1.0 + later * (steps - 1))
    iteration: float = (_ITERATION[0] + _ITERATION[1] * displacement) / ranks**_RANKS
    return direct / (steps * _SOLUTIONS * (_UNHELD if unheld else 1.0) * iteration)


def patience(taken: float, most: float) -> float:
    """Iterations of multigrid in a load step after which factors are made instead, if they fit into the memory.

    Multigrid then does not contract as expected from the iterations `taken` by the first solution, and has taken as
    long as factors, which were worth `most` of these.
    """
    return _SOLUTIONS * max(_PATIENCE * taken, most)


def fits(work: Work, single: bool, room: float, formed: bool = True) -> bool:
    """Whether factors fit into the memory: of K, and where A is not formed of K with springs, in double precision.

    `single` is whether they are in single precision where that is faster, `room` the free memory in bytes, of all
    ranks.
    """
    copies = (1.0 if single and work.operations >= SINGLE_FROM else 2.0) + (0.0 if formed else 2.0)
    return work.bytes * copies <= room
