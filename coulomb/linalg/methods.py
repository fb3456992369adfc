"""The choice of solvers for K^-1 and A by size, number of ranks and PETSc's packages, where the user makes none."""

from __future__ import annotations

from petsc4py import PETSc

from .stiffness import DirectSolver, IterativeSolver

DIRECT_UP_TO = 50_000
"""Displacement unknowns up to which K is factorised by default on one rank (measured: docs/measurements.md)."""

EXPLICIT_UP_TO = 10_000
"""Contact unknowns up to which A is formed by default, where K is factorised (measured: docs/measurements.md)."""

LinearSolver = type[DirectSolver] | type[IterativeSolver]


def chosen(
    displacement: int, contact: int, ranks: int, linear_solver: LinearSolver | None, explicit: bool | None
) -> tuple[LinearSolver, bool]:
    """The solver for K, and whether A is formed.

    A is formed on one rank only, by `multifrontal.MultifrontalSolver`.  On several ranks it took a solve with K per
    contact unknown; on the block on two ranks that was as fast as multigrid up to 2646 displacement unknowns and 1.2
    to 1.6 times slower from 5832 on (docs/measurements.md), and was removed.

    Args:
        displacement: Displacement unknowns, over all ranks.
        contact: Contact unknowns, over all ranks.
        ranks: Number of ranks.
        linear_solver: The user's choice, if any.
        explicit: The user's choice, if any.

    Raises:
        ValueError: If A is to be formed on several ranks or without a factorisation of K, or if K is to be factorised
            by MUMPS and PETSc was built without it.
    """
    if explicit and linear_solver is IterativeSolver:
        raise ValueError(
            'A can be formed (solver.compliance = "explicit", explicit=True) only where K is factorised: set '
            'solver.linear_solver = "direct" (linear_solver=DirectSolver), or leave both to be chosen'
        )
    if explicit and ranks > 1:
        raise ValueError(
            f'A can be formed (solver.compliance = "explicit", explicit=True) on one rank only, but there are {ranks}: '
            'leave solver.compliance at "auto", which on several ranks is "matrix-free"'
        )
    mumps = PETSc.Sys.hasExternalPackage("mumps")
    asked = linear_solver is DirectSolver
    if linear_solver is None:
        small = ranks == 1 and displacement <= DIRECT_UP_TO
        linear_solver = DirectSolver if explicit or small else IterativeSolver
    if explicit is None:
        explicit = ranks == 1 and linear_solver is DirectSolver and contact <= EXPLICIT_UP_TO
    if linear_solver is DirectSolver and not mumps and not explicit:
        if asked:
            raise ValueError(
                "this PETSc was built without MUMPS, which factorises K on several ranks and where A is not formed: "
                'leave solver.linear_solver and solver.compliance at "auto", which then is multigrid, or use a PETSc '
                "with MUMPS (coulomb info lists its packages)"
            )
        linear_solver, explicit = IterativeSolver, False
    return linear_solver, explicit
