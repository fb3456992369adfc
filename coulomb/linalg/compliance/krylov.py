"""PETSc's Krylov methods for the Newton systems, with one product by A per iteration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..reductions import summed
from ..solve_errors import CGNotConverged, TooSlow

NodalMap = Callable[[FloatArray], FloatArray]
"""Maps unknowns of this rank's nodes, shape (m, block) or (m, block, columns)."""

_RANK_DEFICIENT: Final = 1e-14  # singular values of the constraints' matrix below this part of the largest are rounding


class Constraints:
    """A few dense rows G over all nodes, G^T (m, 3, count) on this rank, and multipliers, the same on all ranks.

    `rows`, likewise, are in place of G in G x: of a system that is not symmetric.
    """

    def __init__(self, comm: MPI.Comm, G: FloatArray, rows: FloatArray | None = None):
        self.comm, self.G, self.count = comm, G, G.shape[2]
        self._rows = G if rows is None else rows

    def resultant(self, x: FloatArray) -> FloatArray:
        """G x of x (m, 3, ...), shape (r, ...); collective if there are any."""
        if not self.count:
            return np.empty((0, *x.shape[2:]))
        return summed(self.comm, np.einsum("iaq,ia...->q...", self._rows, x))

    def without(self, w: FloatArray, multipliers: FloatArray) -> FloatArray:
        """w - G^T multipliers, shape (m, 3)."""
        return w - self.G @ multipliers if self.count else w


class ConstraintPreconditioner:
    """[P, -G^T; G, 0]^-1 by block elimination with the r x r matrix S = G P^-1 G^T.

    (C. Keller, N. I. M. Gould, A. J. Wathen: Constraint preconditioning for indefinite linear systems, SIAM J. Matrix
    Anal. Appl. 21, 2000.)  S may be singular: multipliers without resistance are zero.  `inverse` is P^-1 on (m, block)
    and on (m, block, r), x the first three of `block` unknowns per node; `left` (m, block, r) replaces G^T.
    """

    def __init__(self, inverse: NodalMap, constraints: Constraints, block: int, left: FloatArray | None = None):
        self._inverse, self._constraints = inverse, constraints
        r = constraints.count
        if not r:
            return
        G = left
        if G is None:
            G = np.zeros((len(constraints.G), block, r))
            G[:, :3] = constraints.G
        self._PG = inverse(G)
        S = constraints.resultant(self._PG[:, :3])
        size = np.sqrt(np.abs(S.diagonal()))
        size[size == 0.0] = 1.0
        self._S_inverse: FloatArray = np.linalg.pinv(S / np.outer(size, size), rcond=_RANK_DEFICIENT) / np.outer(
            size, size
        )

    def __call__(self, r: FloatArray, r3: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unknowns (m, block, ...) and multipliers (r, ...) for right-hand sides of these shapes; collective."""
        z = self._inverse(r)
        if not self._constraints.count:
            return z, r3
        multipliers: FloatArray = self._S_inverse @ (r3 - self._constraints.resultant(z[:, :3]))
        return z + self._PG @ multipliers, multipliers


_RESTART: Final = 100  # restart of FGMRES: far beyond the usual iterations of a step
_LOOSEST: Final = 0.01  # accuracy of the last products by A: with 0.1 a thin plate takes 33 steps in place of 18
_NEGLIGIBLE: Final = 0.1  # of the tolerance: constraints violated by less are left to a later step


class CarryingKrylov:
    """PETSc's CG or FGMRES on vectors extended by A x: A dx is known at the end without another product.

    Each node has `block` unknowns, the first three of which are x, followed by the three of w = A x.  The product w_z =
    A x_z is computed by the preconditioner for its result z.  Directions and solution of both methods are linear
    combinations of the z's, so that their w is A x, and the operator reads A x from the vector instead of computing it.
    Residuals have w = 0, so that inner products are unchanged.  One product per iteration, none at the end.

    With constraints G x = r3 and their multipliers alpha, w = A x - G^T alpha, and the multipliers are further entries
    of the vectors of the first rank.  FGMRES solves [J, -G^T; G, 0] as it stands.  CG starts with x that satisfies the
    constraints, and stays on them, since the `ConstraintPreconditioner` makes G z = 0: it is projected CG, and as alpha
    is among the unknowns, its residual goes to zero as a whole and has no part that cancels (the residual update
    strategy of N. I. M. Gould, M. E. Hribar, J. Nocedal, SIAM J. Sci. Comput. 23, 2001).  If r3 is not negligible, the
    start costs CG a product, counted as an iteration.

    Args:
        apply_A: x (m, 3) -> A x (m, 3).
        operator: (unknowns (m, block), A x - G^T alpha (m, 3)) -> image (m, block).
        preconditioner: Residual (m, block) and (r,) -> unknowns (m, block) and multipliers (r,).
        method: KSP.Type.CG or KSP.Type.FGMRES, which preconditions from the right and keeps its z's.
    """

    def __init__(
        self,
        constraints: Constraints,
        block: int,
        apply_A: NodalMap,
        operator: Callable[[FloatArray, FloatArray], FloatArray],
        preconditioner: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
        method: str,
    ):
        comm, nodes = constraints.comm, len(constraints.G)
        self._comm, self._constraints, self._block, self._apply_A = comm, constraints, block, apply_A
        self._operator, self._preconditioner = operator, preconditioner
        self._failure: CGNotConverged | TooSlow | None = None
        self._on_constraints = method == PETSc.KSP.Type.CG
        width = block + 3
        self._nodal = width * nodes
        extra = self._constraints.count if comm.rank == 0 else 0
        sizes = (self._nodal + extra, PETSc.DETERMINE)
        self._limit = 100 + 3 * comm.allreduce(nodes)  # as many as exact arithmetic needs, and some
        self._matrix = PETSc.Mat().createPython((sizes, sizes), context=self, comm=comm)
        self._matrix.setUp()
        self._rhs = PETSc.Vec().createMPI(sizes, comm=comm)
        self._solution = self._rhs.duplicate()
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setOperators(self._matrix)
        self._ksp.setType(method)
        if method == PETSc.KSP.Type.FGMRES:
            self._ksp.setGMRESRestart(_RESTART)
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        self._ksp.setInitialGuessNonzero(True)
        pc = self._ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(self)

    def _nodewise(self, v: PETSc.Vec, readonly: bool = False) -> FloatArray:
        array: FloatArray = v.array_r if readonly else v.array_w
        return array[: self._nodal].reshape(-1, self._block + 3)

    def _shared(self, v: PETSc.Vec) -> FloatArray:
        """The multipliers of a vector, shape (r,), on every rank; collective if there are any."""
        if not self._constraints.count:
            return np.empty(0)
        shared = v.array_r[self._nodal :].copy() if self._comm.rank == 0 else np.empty(self._constraints.count)
        self._comm.Bcast(shared)
        return shared

    def _share(self, v: PETSc.Vec, multipliers: FloatArray) -> None:
        """Set the multipliers of a vector.  Every rank opens the array: PETSc keeps norms until a vector changes, and
        the ranks must agree on whether it has, or some wait for a norm that others know."""
        array: FloatArray = v.array_w
        if self._comm.rank == 0:
            array[self._nodal :] = multipliers

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        p, q = self._nodewise(x, readonly=True), self._nodewise(y)
        q[:, : self._block] = self._operator(p[:, : self._block], p[:, self._block :])
        q[:, self._block :] = 0.0
        self._share(y, self._resultant(p[:, :3]))

    def _resultant(self, x: FloatArray) -> FloatArray:
        """G x; of CG's directions, which satisfy G x = 0 up to rounding, 0."""
        return np.zeros(self._constraints.count) if self._on_constraints else self._constraints.resultant(x)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        r, z = self._nodewise(x, readonly=True), self._nodewise(y)
        z[:, : self._block], alpha = self._preconditioner(r[:, : self._block], self._shared(x))
        try:
            product = self._apply_A(z[:, :3])
        except (CGNotConverged, TooSlow) as failure:
            self._failure = failure
            raise
        z[:, self._block :] = self._constraints.without(product, alpha)
        self._share(y, alpha)

    def allowed(self, accuracy: float, sharper: float = 1.0) -> float:
        """The relative error that a product by A may have now: that of the first ones, and this part of a larger one as
        the residual falls to its tolerance (V. Simoncini, D. B. Szyld: Theory of inexact Krylov subspace methods, SIAM
        J. Sci. Comput. 25, 2003)."""
        residual, atol = float(self._ksp.getResidualNorm()), float(self._ksp.atol)
        return max(accuracy, sharper * (atol / residual if atol < _LOOSEST * residual else _LOOSEST))

    def solve(
        self, rhs: FloatArray, guess: FloatArray, atol: float, r3: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Unknowns (m, block), A x - G^T alpha (m, 3), alpha (r,), iterations.

        `rhs` and `guess` (m, block), the guess with x = 0; `atol` is the tolerance of the residual, r3 (r,) the right-
        hand side of the constraints.
        """
        b, s = self._nodewise(self._rhs), self._nodewise(self._solution)
        b[:, : self._block], b[:, self._block :] = rhs, 0.0
        s[:, : self._block], s[:, self._block :] = guess, 0.0
        start: FloatArray = np.zeros(self._constraints.count)
        before = 0
        if self._on_constraints:
            if np.linalg.norm(r3) > _NEGLIGIBLE * atol:
                z, start = self._preconditioner(rhs - self._operator(guess, np.zeros_like(guess[:, :3])), r3)
                s[:, : self._block] += z
                s[:, self._block :] = self._constraints.without(self._apply_A(z[:, :3]), start)
                before = 1
            r3 = np.zeros_like(r3)
        self._share(self._rhs, r3)
        self._share(self._solution, start)
        self._ksp.setTolerances(rtol=0.0, atol=atol, divtol=1e30, max_it=self._limit)
        self._failure = None
        try:
            self._ksp.solve(self._rhs, self._solution)
        except PETSc.Error:  # newer versions of petsc4py raise this in place of the exception of a callback
            if self._failure is not None:
                raise self._failure from None
            raise
        alpha, s = self._shared(self._solution), self._nodewise(self._solution, readonly=True).copy()
        return s[:, : self._block], s[:, self._block :], alpha, before + int(self._ksp.getIterationNumber())

    @property
    def left(self) -> float:
        """The norm of the residual of the last system."""
        return float(self._ksp.getResidualNorm())

    def free(self) -> None:  # not `destroy`: PETSc calls a method of that name on its Python contexts
        for thing in (self._ksp, self._matrix, self._rhs, self._solution):
            thing.destroy()
