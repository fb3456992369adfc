"""Which is faster, K factorised or multigrid: processor seconds predicted before either is begun.

The operations of a factorisation are known exactly from its fronts (`multifrontal.predicted_work`).  The iterations of
multigrid are not: they grow with the slenderness of the body behind its contact face, and vary by a factor of two to
five around this rule.  The constants are least squares of relative errors over the block (p = 6 to 24) and seven parts
with 2 000 to 66 000 unknowns, of processor time on one thread; their ratios matter.  What they are fitted to:

    coulomb benchmark parts --method direct --method iterative --clscale 1 --clscale 0.5 --clscale 0.3
    coulomb benchmark scaling --method direct --p 10 --p 16 --p 24                 # and --method iterative
"""

from __future__ import annotations

import math

from .multifrontal import SINGLE_FROM, Work

_OPERATION = 1.25e-11  # seconds per operation of the factorisation, in single precision
_ENTRY = 1.55e-7  # per entry of K: symbolic factorisation, entries to the fronts
_FACTORED = (0.048, 2.8e-8, 4.1e-9)  # path following: constant, per square of contact unknowns, per byte of the factors

_SET_UP = 1.9e-7  # multigrid, per entry of K
_ITERATION = (3.5e-4, 1.46e-9, 1.3e-7)  # constant, per entry of K, per contact unknown
_ITERATIONS = 350.0  # of the block
_SLENDER = 0.9  # they grow with this power of the slenderness
_BLOCK = 1.7  # slenderness of the block

_FACTOR_RANKS = 0.75  # speed-up of everything but the operations of the fronts: ranks to this power; 1.7 on two
_MULTIGRID_RANKS = 0.5  # of multigrid and its path following; 1.4 on two


def seconds_direct(work: Work, contact: int, entries: float, ranks: int = 1) -> float:
    """With K factorised and the Schur complement on the contact nodes, to the certificate.

    Args:
        work: What the factorisation takes.
        contact: Displacements on which contact forces act.
        entries: Entries of K.
        ranks: Number of ranks.
    """
    constant, square, byte = _FACTORED
    shared = _ENTRY * entries + square * contact**2 + byte * work.bytes
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
    work: Work, contact: int, entries: float, slenderness: float, free: float = math.inf, ranks: int = 1
) -> bool:
    """Whether K should be factorised: it fits into the memory, and takes no longer than multigrid.

    Args:
        work: What the factorisation takes.
        contact: Displacements on which contact forces act.
        entries: Entries of K.
        slenderness: Width of the contact face over the thickness of the body behind it.
        free: Free memory in bytes, of all ranks.
        ranks: Number of ranks.
    """
    needed = work.bytes * (1.0 if work.operations >= SINGLE_FROM else 2.0)
    multigrid = seconds_multigrid(contact, entries, slenderness, ranks)
    return needed <= free and seconds_direct(work, contact, entries, ranks) <= multigrid
