"""Which is faster, K factorised or multigrid: processor seconds predicted before either is begun.

The operations of a factorisation are known exactly from its fronts (`multifrontal.predicted_work`), but not whether it
has to be repeated in double precision, at three times the cost.  The iterations of multigrid are not known: they grow
with the slenderness of the body behind its contact face, and vary by a factor of two to three around this rule.  Of a
body on soft springs they are ten to forty times as many, and it is factorised if that fits into the memory.  The
constants are least squares over the block (p = 6 to 24) and seven parts with 2 000 to 75 000 unknowns, of processor
time on one thread; their ratios matter.  What they are fitted to:

    coulomb benchmark parts --method direct --method iterative --clscale 1 --clscale 0.5 --clscale 0.3
    coulomb benchmark scaling --method direct --p 10 --p 16 --p 24                 # and --method iterative
"""

from __future__ import annotations

import math

from .multifrontal import SINGLE_FROM, Work

_OPERATION = 1.3e-11  # seconds per operation of the factorisation, in single precision
_FACTORED = (0.042, 3.7e-8, 5.1e-9)  # the rest: constant, per square of contact unknowns, per byte of the factors

_SET_UP = 1.9e-7  # multigrid, per entry of K
_ITERATION = (2.6e-4, 1.67e-9, 1.47e-7)  # constant, per entry of K, per contact unknown
_ITERATIONS = 328.0  # of the block
_SLENDER = 0.67  # they grow with this power of the slenderness
_BLOCK = 1.7  # slenderness of the block

_AGAIN = 1.1  # time of the factorisation as expected over that in single precision, which may have to be repeated

_FACTOR_RANKS = 0.75  # speed-up of everything but the operations of the fronts: ranks to this power; 1.7 on two
_MULTIGRID_RANKS = 0.5  # of multigrid and its path following; 1.4 on two


def seconds_direct(work: Work, contact: int, ranks: int = 1) -> float:
    """With K factorised and the Schur complement on the contact nodes, to the certificate.

    Args:
        work: What the factorisation takes.
        contact: Displacements on which contact forces act.
        ranks: Number of ranks.
    """
    constant, square, byte = _FACTORED
    shared = square * contact**2 + byte * work.bytes
    seconds: float = _OPERATION * work.longest + constant + shared / ranks**_FACTOR_RANKS
    return seconds


def seconds_multigrid(contact: int, entries: float, slenderness: float, ranks: int = 1) -> float:
    """With products by multigrid, to the certificate.

    Args:
        contact: Displacements on which contact forces act.
        entries: Entries of K.
        slenderness: Width of the contact face over the thickness of the body behind it.
        ranks: Number of ranks.
    """
    constant, entry, unknown = _ITERATION
    iterations = _ITERATIONS * max(slenderness / _BLOCK, 1.0) ** _SLENDER
    shared = _SET_UP * entries + iterations * (entry * entries + unknown * contact)
    seconds: float = iterations * constant + shared / ranks**_MULTIGRID_RANKS
    return seconds


def factorise(
    work: Work,
    contact: int,
    entries: float,
    slenderness: float,
    soft: bool = False,
    free: float = math.inf,
    ranks: int = 1,
) -> bool:
    """Whether K should be factorised: it fits into the memory, and takes no longer than multigrid.

    Args:
        work: What the factorisation takes.
        contact: Displacements on which contact forces act.
        entries: Entries of K.
        slenderness: Width of the contact face over the thickness of the body behind it.
        soft: Whether soft springs alone hold the body.
        free: Free memory in bytes, of all ranks.
        ranks: Number of ranks.
    """
    single = work.operations >= SINGLE_FROM and not soft
    if work.bytes * (1.0 if single else 2.0) > free:
        return False
    multigrid = seconds_multigrid(contact, entries, slenderness, ranks)
    return soft or _AGAIN * seconds_direct(work, contact, ranks) <= multigrid
