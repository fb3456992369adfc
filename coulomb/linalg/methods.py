"""The choice of solvers for K^-1 and A by size and number of ranks, where the user makes none.

It is made by predicted seconds where the size leaves it open (`undecided`, `predicted_cost`).
"""

from __future__ import annotations

from .stiffness import DirectSolver, IterativeSolver

DIRECT_UP_TO = 50_000
"""Displacement unknowns up to which K is factorised by default where no cost is predicted, as of the user's forms
(measured: docs/measurements.md)."""

PREDICTED_UP_TO = 1_000_000
"""Displacement unknowns beyond which K is not factorised by default: of a block the factors take 20 GB and more."""

_SMALL = (12_000, 3_000)
"""Displacement and contact unknowns up to which K is factorised in any case."""

EXPLICIT_UP_TO = 10_000
"""Contact unknowns up to which A is formed by default, where K is factorised (measured: docs/measurements.md)."""

LinearSolver = type[DirectSolver] | type[IterativeSolver]


def undecided(displacement: int, contact: int, linear_solver: LinearSolver | None, explicit: bool | None) -> bool:
    """Whether the faster method is to be found by predicted seconds; arguments as of `chosen`."""
    small = displacement <= _SMALL[0] and contact <= _SMALL[1]
    return linear_solver is None and explicit is None and displacement <= PREDICTED_UP_TO and not small


def chosen(
    displacement: int, contact: int, ranks: int, linear_solver: LinearSolver | None, explicit: bool | None
) -> tuple[LinearSolver, bool]:
    """The solver for K by size, and whether A is formed.

    K is factorised by `multifrontal.MultifrontalSolver` on one rank and by `DistributedMultifrontalSolver` on several,
    whether A is formed or not; where it is not, on several ranks only if the user chooses it: each solve waits for all
    ranks several times.

    Args:
        displacement: Displacement unknowns, over all ranks.
        contact: Contact unknowns, over all ranks.
        ranks: Number of ranks.
        linear_solver: The user's choice, if any.
        explicit: The user's choice, if any.

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
