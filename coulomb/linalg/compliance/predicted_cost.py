"""Which is faster, K factorised or multigrid: processor seconds predicted before either is begun.

The operations of a factorisation are known exactly from its fronts (`multifrontal.predicted_work`), whether it has to
be repeated in double precision by a rule (`model.conditioning.ill_conditioned`).  The iterations of multigrid are not
known: they are estimated from what decides the condition of A and the number of its products (`Measures`), and vary by
a factor of up to two around this rule, of thin bodies by more: a run that takes three times as many as expected is
given up for factors (`patience`).  Of sheets more than 22 thicknesses wide they grow with the third power of the width:
one of 0.16 by 0.05 m takes 1018 with a thickness of 4 mm, and more than 14 000 with 2 mm.  Of a body on soft springs
they are three to ten times as many, and it is factorised if that fits into the memory.

On tetrahedra of first order iterations are 1.3 times as many as on hexahedra with the same nodes: the least eigenvalue
of A over its diagonal is half as large (0.018 and 0.037 on the block at p = 6, 0.024 and 0.052 at p = 10), which costs
conjugate gradients up to sqrt(2) times as many products.  Of a curved face most nodes are far from the foundation and
stay open: only those near it take part.

Cells of aspect 8 take 5 times as many iterations as cubes, in first and second order; a beam of length 20 thicknesses
3 to 6 times as many as one of 5; Poisson's ratio 0.49 4 times as many as 0.3, 0.499 15 times and 0.4999 50 times.

In a load history the factors are made once, and a later step costs a third to two thirds of the first path; by
multigrid it takes about as many iterations as the first, which have less to do for contact.  So a block of 41 616
unknowns is left to multigrid for a single problem, and factorised for two load steps.

The constants are least squares over the block (p = 6 to 24) and parts with 2 000 to 80 000 unknowns, of processor time
on one thread; their ratios matter (docs/measurements.md).  What they are fitted to:

    python -m benchmarks parts --method direct --method iterative --clscale 1 --clscale 0.5 --clscale 0.3
    python -m benchmarks scaling --method direct --p 10 --p 16 --p 24                 # and --method iterative
    python -m benchmarks histories --p 10 --p 16 --peer coulomb
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Final, NamedTuple

from ..factors import SINGLE_FROM, Work
from .stiffness import DirectSolver, IterativeSolver

# The choice of solvers for K^-1 and A by size and number of ranks, where the user makes none.
#
# It is made by predicted seconds where the size leaves it open (`undecided`, `predicted_cost`).

DIRECT_UP_TO: Final = 50_000
"""Displacement unknowns up to which K is factorised by default where no cost is predicted, as of the user's forms
(measured: docs/measurements.md)."""

PREDICTED_UP_TO: Final = 1_000_000
"""Displacement unknowns beyond which K is not factorised by default: of a block the factors take 20 GB and more."""

_SMALL = (12_000, 3_000)
"""Displacement and contact unknowns up to which K is factorised in any case."""

EXPLICIT_UP_TO: Final = 10_000
"""Contact unknowns up to which A is formed by default, where K is factorised (measured: docs/measurements.md)."""

LinearSolver = type[DirectSolver] | type[IterativeSolver]


def undecided(displacement: int, contact: int, linear_solver: LinearSolver | None, explicit: bool | None) -> bool:
    """Whether the faster method is to be found by predicted seconds; arguments as of `chosen`."""
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
_PATH = (0.034, 3.3e-8, 1.3e-9)  # path following: constant, per square of contact unknowns, per byte of the factors
_CONDENSED: Final = 40.0  # path following where A is not formed, over a factorisation in double precision

_SET_UP: Final = 2.2e-6  # multigrid, per displacement unknown
_ITERATION = (2.5e-4, 9.2e-8, 1.5e-7)  # constant, per displacement unknown; in the first load step, per contact unknown
_ITERATIONS: Final = 230.0  # of a block of hexahedra with 1000 contact unknowns
_CONTACT: Final = 0.2  # they grow with this power of the contact unknowns,
_NEAR: Final = 0.3  # with this one of the part of the contact face that is near,
_LEAST_NEAR: Final = 0.03
_SLENDER: Final = 0.12  # and with this one of the slenderness
_BLOCK: Final = 1.7  # slenderness of the block
_SHEET: Final = 22.0  # slenderness from which they grow with the third power of it
_TETRAHEDRA: Final = 1.27
_UNHELD: Final = 1.5
_SECOND_ORDER: Final = 1.6
_ASPECT: Final = 0.8  # iterations grow with this power of the aspect of cells,
_LONG: Final = 3.3  # with the elongation of the contact face over that of the block,
_INCOMPRESSIBLE, _STEEL = 0.5, 0.3  # and with this power of 1 / (1 - 2 nu) over that of steel
_LEAST_COMPRESSIBLE: Final = 1e-6

_PATIENCE: Final = 3.0  # times the expected iterations, before factors are made instead

_MULTIGRID_RANKS: Final = 0.63  # of multigrid and its path following; 1.55 on two


class Precision(Enum):
    """Of the factors: their time over that in single precision, seconds per cube of contact unknowns besides, and the
    time of a later load step over the first path.

    In double precision a solve is one substitution, and the inverses that many solves need are kept.
    """

    SINGLE = 1.0, 0.0, 0.6
    DOUBLE = 2.0, 1.0e-11, 0.3
    REPEATED = 3.0, 1.0e-11, 0.3
    """In single precision, and then in double, as that was not accurate enough."""


class Measures(NamedTuple):
    """What is known of a problem before it is solved, and decides how long multigrid takes.

    Attributes:
        displacement: Displacement unknowns.
        contact: Displacements on which contact forces act.
        slenderness: Width of the contact face over the thickness of the body behind it.
        near: Part of the contact face that can touch soon, by its area: whose gap is hardly more than the smallest.
        tetrahedra: Whether a body is of tetrahedra.
        unheld: Whether contact alone resists a rigid motion.
        second_order: Whether displacements are quadratic.
        aspect: Of the cells in the mean, over that of cubes, or of tetrahedra that fill a cube.
        elongation: Square of the diagonal of the contact face over its area: 2 for a square, 40 for a long strip.
        poisson: Largest Poisson's ratio.
    """

    displacement: int
    contact: int
    slenderness: float
    near: float = 1.0
    tetrahedra: bool = False
    unheld: bool = False
    second_order: bool = False
    aspect: float = 1.0
    elongation: float = _LONG
    poisson: float = _STEEL

    @property
    def iterations(self) -> float:
        """Expected of multigrid in the first load step."""
        cells = (_TETRAHEDRA if self.tetrahedra else 1.0) * (_SECOND_ORDER if self.second_order else 1.0)
        stiffer = (1.0 - 2.0 * _STEEL) / max(1.0 - 2.0 * self.poisson, _LEAST_COMPRESSIBLE)
        hard: float = max(self.aspect, 1.0) ** _ASPECT * max(stiffer, 1.0) ** _INCOMPRESSIBLE
        cells *= hard * (_UNHELD if self.unheld else 1.0)
        face: float = (self.contact / 1000.0) ** _CONTACT * max(self.near, _LEAST_NEAR) ** _NEAR
        slender: float = max(self.slenderness / _BLOCK, 1.0) ** _SLENDER * max(self.elongation / _LONG, 1.0)
        slender *= max(self.slenderness / _SHEET, 1.0) ** 3
        return _ITERATIONS * cells * face * slender


def seconds_direct(
    work: Work,
    contact: int,
    steps: int = 1,
    precision: Precision = Precision.SINGLE,
    formed: bool = True,
) -> float:
    """With K factorised and the Schur complement on the contact nodes, to the certificate of the last load step.

    Args:
        work: What the factorisation takes.
        contact: Displacements on which contact forces act.
        steps: Number of load steps.
        precision: Expected of the factors.
        formed: Whether A is formed; where it is not, K with springs is factorised in every step of path following
            (`CondensedSystem`).
    """
    constant, square, byte = _PATH
    factors = _OPERATION * work.operations + _BYTE * work.bytes
    times, cube, later = precision.value
    if formed:
        path = constant + square * contact**2 + byte * work.bytes
    else:
        path, cube = _CONDENSED * Precision.DOUBLE.value[0] * factors, 0.0
    return times * factors + cube * contact**3 + path * (1.0 + later * (steps - 1))


def seconds_multigrid(measures: Measures, steps: int = 1, ranks: int = 1) -> float:
    """With products by multigrid, to the certificate of the last load step."""
    constant, of_all, of_contact = _ITERATION
    shared: float = ranks**_MULTIGRID_RANKS
    iteration = constant + of_all * measures.displacement / shared
    first = iteration + of_contact * measures.contact / shared
    later = (steps - 1) * iteration
    return _SET_UP * measures.displacement / shared + measures.iterations * (first + later)


def factorise(
    work: Work,
    measures: Measures,
    steps: int = 1,
    soft: bool = False,
    precision: Precision = Precision.SINGLE,
    room: float = math.inf,
    ranks: int = 1,
    formed: bool = True,
) -> bool:
    """Whether K should be factorised: it fits into the memory, and takes no longer than multigrid.

    Arguments as of `seconds_direct`; `soft` is whether soft springs alone hold the body, `room` the free memory in
    bytes, of all ranks.
    """
    if not fits(work, not soft and precision is Precision.SINGLE, room, formed):
        return False
    multigrid = seconds_multigrid(measures, steps, ranks)
    return soft or seconds_direct(work, measures.contact, steps, precision, formed) <= multigrid


def fits(work: Work, single: bool, room: float, formed: bool = True) -> bool:
    """Whether factors fit into the memory: of K, and where A is not formed of K with springs, in double precision.

    `single` is whether they are in single precision where that is faster, `room` the free memory in bytes, of all
    ranks.
    """
    copies = (1.0 if single and work.operations >= SINGLE_FROM else 2.0) + (0.0 if formed else 2.0)
    return work.bytes * copies <= room


def patience(
    work: Work,
    measures: Measures,
    steps: int = 1,
    precision: Precision = Precision.SINGLE,
    ranks: int = 1,
    formed: bool = True,
) -> float:
    """Iterations of multigrid in a load step after which factors are made instead, if they fit into the memory.

    Multigrid then does not contract as predicted, and has taken as long as the step takes with factors.  Arguments as
    of `seconds_direct`.
    """
    direct = seconds_direct(work, measures.contact, steps, precision, formed)
    return max(direct / seconds_multigrid(measures, steps, ranks), _PATIENCE) * measures.iterations
