"""The grids of multigrid: from K, and in second order by way of linear displacements, to one that is factorised.

On several ranks the small grids are on each rank as a whole, and their coarser ones are made there.
"""

from __future__ import annotations

from petsc4py import PETSc

from ...arrays import FloatArray, side_by_side
from ..petsc_arrays import DistributedEntries, distributed_entries
from ..reductions import concatenated
from .block_matrix import BlockInterpolation, DistributedBlocks, distributed_blocks, on_every_rank
from .coarsening import coarser, galerkin, with_diagonal
from .multigrid_cycle import (
    DENSE_UP_TO,
    REPLICATED_UP_TO,
    CoarseSolver,
    Level,
    MultigridCycle,
    Replicated,
    exact_solver,
)
from .whole_blocks import WholeBlocks, whole

SECOND_ORDER_STEPS = 1
"""Steps of the smoother in second order; two take 0.9 of the iterations."""

TWICE_FROM = 1000
"""Unknowns per rank from which a visit of a distributed coarse grid after the first is two cycles (W-cycle): on smaller
ones messages take longer than products, and parts take as many iterations without (docs/cluster.md)."""

_STALLED = 0.7  # unknowns over those of the finer grid from which on ranks have a grid as a whole


def multigrid(K: PETSc.Mat, P: PETSc.Mat | None) -> MultigridCycle:
    """Multigrid for K, three rows per node, with a near-nullspace of six rigid motions; collective.

    In second order P is the interpolation of linear displacements, with the motions of these.
    """
    matrix = distributed_entries(K)
    if P is None:
        cycle = _cycle(matrix, 3, _motions(K), finest=True)
        return MultigridCycle(Level(matrix, 3, accurate=True)) if cycle is None else cycle
    level = Level(matrix, 3, SECOND_ORDER_STEPS, accurate=True)
    blocks = distributed_blocks(distributed_entries(P), (3, 3))
    linear = with_diagonal(galerkin(WholeBlocks(matrix, 3), blocks, 3))
    return _cycle_on(level, blocks, (3, 3), _solver(linear, 3, _motions(P)))


def _motions(matrix: PETSc.Mat) -> FloatArray:
    """Its near-nullspace, shape (rows of this rank, 6)."""
    return side_by_side(*(vector.array_r for vector in matrix.getNearNullSpace().getVecs()))


def _cycle(
    matrix: DistributedEntries,
    size: int,
    motions: FloatArray,
    finest: bool = False,
    first: bool = False,
) -> MultigridCycle | None:
    """On a grid with its coarser ones; None if there are none; `first` if it is the first of aggregates."""
    level = Level(matrix, size, accurate=finest or size == 6)
    found = coarser(matrix, size, motions, level.inverse, level.largest)
    if found is None:
        level.blocks.destroy()
        return None
    stalled = found.matrix.starts[-1] > _STALLED * matrix.starts[-1]
    solver = _solver(found.matrix, 6, found.motions, stalled, first=size == 3)
    large = first or matrix.others is None or matrix.starts[-1] >= TWICE_FROM * matrix.comm.size
    return _cycle_on(level, found.P, (size, 6), solver, again=size == 6 and large)


def _cycle_on(
    level: Level,
    P: DistributedBlocks,
    shape: tuple[int, int],
    coarser: CoarseSolver,
    again: bool = False,
) -> MultigridCycle:
    """With the solver on the coarser grid from which P, in blocks of this shape, interpolates."""
    P = on_every_rank(P) if isinstance(coarser, Replicated) else P
    level.interpolation = BlockInterpolation(P, shape)
    return MultigridCycle(level, coarser, again)


def _solver(
    matrix: DistributedEntries,
    size: int,
    motions: FloatArray,
    stalled: bool = False,
    first: bool = False,
) -> CoarseSolver:
    """For a coarse grid; `stalled` if aggregates, each of one rank, are hardly fewer; `first` as of `_cycle`."""
    unknowns = int(matrix.starts[-1])
    cycle = None
    if matrix.others is None:
        if unknowns > DENSE_UP_TO:
            cycle = _cycle(matrix, size, motions)
        return exact_solver(matrix.own) if cycle is None else cycle
    if unknowns > REPLICATED_UP_TO and not stalled:
        cycle = _cycle(matrix, size, motions, first=first)
    if cycle is None:
        solver = _solver(whole(matrix), size, concatenated(matrix.comm, motions))
        return Replicated(matrix.comm, solver)
    return cycle
