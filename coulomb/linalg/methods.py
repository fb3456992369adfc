"""Which way to K^-1 and A is taken: by size, ranks and what this PETSc has, where nobody asks for one."""

from __future__ import annotations

from petsc4py import PETSc

from .stiffness import DirectSolver, IterativeSolver

DIRECT_UP_TO = 50_000
"""Displacement unknowns up to which K is factorised by default on one rank (measured: docs/measurements.md)."""

DIRECT_IN_PARALLEL_UP_TO = 4_000
"""The same on several ranks, where there is no Schur complement and A takes many solves."""

EXPLICIT_UP_TO = 10_000
"""Contact unknowns up to which A is formed by default, where K is factorised (measured: docs/measurements.md)."""

LinearSolver = type[DirectSolver] | type[IterativeSolver]


def contact_last(explicit: bool, ranks: int) -> bool:
    """Whether K is factorised by nested dissection down to the contact nodes: where A is formed, on one rank."""
    return explicit and ranks == 1


def chosen(
    displacement: int, contact: int, ranks: int, linear_solver: LinearSolver | None, explicit: bool | None
) -> tuple[LinearSolver, bool]:
    """The solver for K, and whether A is formed.

    Args:
        displacement: Displacement unknowns, over all ranks.
        contact: Contact unknowns, over all ranks.
        ranks: How many.
        linear_solver: What was asked for, if anything.
        explicit: What was asked for, if anything.

    Raises:
        ValueError: If A is to be formed without a factorisation, or K to be factorised by MUMPS where there is none.
    """
    if explicit and linear_solver is IterativeSolver:
        raise ValueError(
            'A can be formed (solver.compliance = "explicit", explicit=True) only where K is factorised: set '
            'solver.linear_solver = "direct" (linear_solver=DirectSolver), or leave both to be chosen'
        )
    mumps = PETSc.Sys.hasExternalPackage("mumps")
    asked = linear_solver is DirectSolver or bool(explicit)
    if linear_solver is None:
        small = displacement <= (DIRECT_UP_TO if ranks == 1 else DIRECT_IN_PARALLEL_UP_TO)
        linear_solver = DirectSolver if explicit or small else IterativeSolver
    if explicit is None:
        explicit = linear_solver is DirectSolver and contact <= EXPLICIT_UP_TO
    if linear_solver is DirectSolver and not mumps and not contact_last(explicit, ranks):
        if asked:
            raise ValueError(
                "this PETSc was built without MUMPS, which factorises K on several ranks and where A is not formed: "
                'leave solver.linear_solver and solver.compliance at "auto", which then is multigrid, or use a PETSc '
                "with MUMPS (coulomb info lists its packages)"
            )
        linear_solver, explicit = IterativeSolver, False
    return linear_solver, explicit
