"""K^-1: the stiffness matrix factorised (MUMPS Cholesky), or solved by CG with smoothed-aggregation multigrid."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..factors import NotPositiveDefinite
from ..multigrid import RecycledCG, Stiffness, multigrid, padded, stiffness_in_blocks, symmetric_blocks
from ..petsc_arrays import CHOLESKY, configured_ksp, distributed_entries
from ..reductions import summed
from ..solve_errors import CGNotConverged, TooSlow

# Rigid motions of bodies that soft springs hold, apart from what is elastic in K^-1.
#
# With R the motions that springs alone resist, scaled so that R^T K R = 1,
#
# K^-1 = R R^T + P K^-1 P^T, P = 1 - R (K R)^T, A = B K^-1 B^T = F F^T + A_e, F = B R
#
# exactly, for P is the projection on displacements v without energy in common with the motions, (K R)^T v = 0, and P^T
# takes from forces what the springs carry in the motions.  F F^T may be 1e8 times as large as A_e.  From products by A
# to a few per cent, path following learns nothing but the motions; from products by A_e of that accuracy, with F F^T
# known, it learns A_e (docs/measurements.md).
#
# K R has the forces of the springs only, and is taken from these: as a product by K it would have rounding errors of
# the body's stiffness.  (Solving on the complement of a few directions is deflation: R.  A.  Nicolaides, SIAM J.
# Numer.  Anal.  24, 1987.)


class SoftMotions:
    """The motions R and the forces K R that they cause, this rank's rows, shape (n, q).

    They are scaled so that R^T K R = 1: R is in metres per root of a joule.
    """

    def __init__(self, comm: MPI.Comm, motions: FloatArray, forces: FloatArray):
        self._comm, self.motions = comm, motions
        self._loaded = np.flatnonzero(np.any(forces != 0.0, axis=1))
        self._forces: FloatArray = np.ascontiguousarray(forces[self._loaded])

    def take_from_forces(self, r: FloatArray) -> FloatArray:
        """r <- P^T r, shape (n,): less what the springs carry in the motions, whose amounts R^T r, shape (q,), are
        returned; collective."""
        amounts = summed(self._comm, self.motions.T @ r)
        r[self._loaded] -= self._forces @ amounts
        return amounts

    def take_from(self, u: FloatArray) -> None:
        """u <- P u, displacements of shape (n,); collective."""
        u -= self.motions @ summed(self._comm, self._forces.T @ u[self._loaded])


class StiffnessSolver(Protocol):
    """Solves K u = rhs.

    Attributes:
        name: What the summary calls it.
        tolerance: |K u - rhs| / |rhs| of a solve without a tolerance of its own; 0 for a direct solver.
        iterations: Of all solves so far; 0 for a direct solver.
    """

    tolerance: float
    iterations: int

    @property
    def name(self) -> str: ...

    @property
    def exact(self) -> bool:
        """Whether a solve is as exact as rounding allows, at any tolerance."""
        ...

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        """u <- K^-1 rhs, to |K u - rhs| <= max(tolerance, the solver's tolerance) |rhs|; by multigrid, this is the root
        of the mean square over the parts that K does not couple, each in units of its own forces.

        Raises:
            CGNotConverged: On every rank, if it does not get there; u has what was reached.
        """
        ...

    def approximate(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        """u <- K^-1 rhs, nearly: linear in rhs, and in little time; collective."""
        ...

    def multiply(self, u: PETSc.Vec, product: PETSc.Vec) -> None:
        """product <- K u, in double precision."""
        ...

    def destroy(self) -> None:
        """Free its PETSc objects."""
        ...


class DirectSolver:
    """Cholesky factorisation by MUMPS of K, symmetric positive definite, on all ranks.

    A contact problem that is to be solved with this class takes that by nested dissection instead
    (`MultifrontalSolver`); this one is an independent factorisation for K u = f
    without contact: for verification, the matrices that other programs get, benchmarks with other options of PETSc, and
    tests.
    """

    name = "direct (MUMPS Cholesky)"
    exact = True
    tolerance = 0.0
    iterations = 0

    def __init__(self, K: PETSc.Mat, options: Mapping[str, object] = CHOLESKY):
        self._ksp = configured_ksp(K, "preonly", options)

    @property
    def factor(self) -> PETSc.Mat:
        """The factored matrix, for many right-hand sides at once (MatMatSolve)."""
        return self._ksp.getPC().getFactorMatrix()

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        self._ksp.solve(rhs, u)

    def approximate(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        """By the factors."""
        self._ksp.solve(rhs, u)

    def multiply(self, u: PETSc.Vec, product: PETSc.Vec) -> None:
        self._ksp.getOperators()[0].mult(u, product)

    def destroy(self) -> None:
        self._ksp.destroy()


_DIRECTIONS: Final = 20  # of earlier solutions from which a solve starts
_ITERATIONS: Final = 1000  # of a solve, at most


class IterativeSolver:
    """CG with smoothed-aggregation multigrid on the rigid body modes that K carries as its near-nullspace.

    The grids and products on them are made in C, in blocks and with threads: PETSc's GAMG takes four to five times as
    long and twice the memory of K, and with its grids solves take 1.4 to 1.6 times the iterations.

    In second order K also has an attribute "interpolation", which makes the matrix that interpolates linear
    displacements.  Multigrid then goes from second order to first, and to aggregates from there: by PETSc, on the block
    of 42 000 unknowns, its set-up takes a sixth of the time, and a solve 0.4 of it, with 25 iterations in place of 32
    (hexahedra: 20 for 26).

    Args:
        K: Symmetric positive definite, assembled, block size 3, with a near-nullspace; or what multigrid needs of it.
        tolerance: |K u - rhs| / |rhs|, well below the tolerances of the CG that uses A = B K^-1 B^T.

    Attributes:
        parts: Those that K does not couple; K itself it does not keep.

    Raises:
        NotPositiveDefinite: On every rank, if a diagonal entry of K, or of a coarser grid, is not positive.
        CGNotConverged: From solve, if 1000 iterations are not enough, or K is not positive definite, to rounding.
        TooSlow: From solve, after the iterations of `allow`.
    """

    name = "iterative (CG, multigrid)"
    exact = False

    def __init__(self, K: PETSc.Mat | Stiffness, tolerance: float = 1e-11):
        self.tolerance, self.iterations = tolerance, 0
        self._before, self._allowed = 0, math.inf
        self._soft: SoftMotions | None = None
        given = K if isinstance(K, Stiffness) else stiffness_in_blocks(K)
        try:
            self._cycle = cycle = multigrid(given)
        except CGNotConverged as failure:
            raise NotPositiveDefinite(str(failure)) from None
        self._u, self.parts, comm = padded(cycle.size), given.parts, given.blocks.comm
        self._cg = RecycledCG(comm, cycle.size, cycle.mult, self._precondition, _DIRECTIONS, _ITERATIONS, cycle)

    def _precondition(self, r: FloatArray) -> FloatArray:
        """A cycle for r.

        In motions that are computed apart, products leave only rounding errors, which a cycle would magnify as the
        springs are soft: they are removed from r.  In single precision a cycle leaves some in its result: these are
        removed too, or CG does not converge where few unknowns are on many ranks.
        """
        if self._soft is None:
            return self._cycle(r)
        self._soft.take_from_forces(r)
        z = self._cycle(r)
        self._soft.take_from(z)
        return z

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        soft = self._soft
        if soft is None:
            self._solved(rhs, u, tolerance)
            return
        rest = rhs.copy()
        amounts = soft.take_from_forces(rest.array)
        try:
            self._solved(rest, u, tolerance)
        finally:
            soft.take_from(u.array)
            u.array[:] += soft.motions @ amounts
            rest.destroy()

    def _solved(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float) -> None:
        sizes = self.parts.norms(rhs.array_r)
        if not np.any(sizes):  # a solution 0 among the earlier ones would make the next start undefined
            u.set(0.0)
            return
        left = self._allowed - (self.iterations - self._before)
        if left <= 0.0:
            raise self._too_slow()
        forces = self.parts.scaled(rhs.array_r, 1.0 / np.where(sizes > 0.0, sizes, 1.0))
        try:
            self.iterations += self._cg.solve(forces, self._u, max(tolerance, self.tolerance), left)
        except CGNotConverged as failure:
            self.iterations += failure.iterations
            if failure.iterations >= left:
                raise self._too_slow() from None
            raise
        finally:
            u.array[:] = self.parts.scaled(self._u, sizes)

    def _too_slow(self) -> TooSlow:
        return TooSlow(
            f"solutions of K u = f by conjugate gradients with multigrid took {self.iterations - self._before} "
            f"iterations, and after {self._allowed:.0f} factors of K are expected to be faster"
        )

    def allow(self, iterations: float) -> None:
        """Take no more than so many iterations in all solves from now on, the same number on all ranks; inf for no
        limit, as by default."""
        self._before, self._allowed = self.iterations, iterations

    def separate(self, soft: SoftMotions) -> None:
        """Compute rigid motions on soft springs apart from now on, exactly; tolerances are then relative to the forces
        less what the springs carry in these motions."""
        self._soft = soft

    def approximate(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        """By a V-cycle."""
        r, size = padded(len(self._u)), float(rhs.norm(PETSc.NormType.NORM_INFINITY)) or 1.0
        np.divide(rhs.array_r, size, out=r)
        moved = 0.0 if self._soft is None else self._soft.motions @ self._soft.take_from_forces(r)
        u.array[:] = self._precondition(r) + moved
        u.scale(size)

    def stiffened(self, springs: PETSc.Mat) -> Callable[[FloatArray], FloatArray]:
        """A V-cycle of K with springs, for forces (n,), to be read before the next one; collective."""
        cycle, r = self._cycle.stiffened(symmetric_blocks(distributed_entries(springs), 3)), padded(len(self._u))

        def approximate(forces: FloatArray) -> FloatArray:
            r[:] = forces
            return cycle(r)

        return approximate

    def multiply(self, u: PETSc.Vec, product: PETSc.Vec) -> None:
        self._u[:] = u.array_r
        self._cycle.mult(self._u, product.array)

    def destroy(self) -> None:
        self._cycle.destroy()
