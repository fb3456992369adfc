"""FGMRES on displacements and contact forces together: systems with A = B K^-1 B^T that take no product by A.

With contact forces X z, and w = -B u/a - G^T alpha, the equations are

    K u + B^T X z = f,    P z + Y w = g,    G X z = e

and A of the equations of contact is what is left as u is eliminated.  Each iteration takes one product by K and one
application of an approximation of K^-1, factors in single precision or a few V-cycles: block elimination with it is the
preconditioner.  With factors it gains their digits, three to five, in each iteration; by multigrid it takes a fifth of
the V-cycles of as accurate products by A (docs/sensitivities.md).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from petsc4py import PETSc

from ...arrays import FloatArray
from ..petsc_arrays import configured_ksp
from ..solve_errors import CGNotConverged, TooSlow
from .krylov import Constraints, NodalMap
from .stiffness import StiffnessSolver

_OPTIONS: Final = {
    "pc_type": "none",
    "ksp_norm_type": "unpreconditioned",
    "ksp_gmres_restart": 100,
    "ksp_gmres_cgs_refinement_type": "refine_ifneeded",  # without, residuals stagnate at 1e-9
}

_MOST: Final = 1000
"""Iterations, at most: beyond what systems take that are not singular, nearly."""


class Elimination:
    """K, B, and an approximation of K^-1 in two halves, between which contact forces follow from displacements;
    collective.  Displacements of unknowns are in metres, forces in newtons, this rank's part, shape (n,); those of
    contact points have shape (3 m,).

    Attributes:
        size: n.

    Args:
        solver: Has K.
        B: The rows of the contact points.
        begin: B u of the displacement u under forces f, nearly.
        end: That u, under these and the contact forces x, nearly.
    """

    def __init__(
        self,
        solver: StiffnessSolver,
        B: PETSc.Mat,
        begin: Callable[[FloatArray], FloatArray],
        end: Callable[[FloatArray], FloatArray],
    ):
        self._solver, self._B, self.begin, self.end = solver, B, begin, end
        self._u, self._x = B.createVecs()
        self._forces = self._u.duplicate()
        self.size: int = self._u.getLocalSize()

    def multiply(self, u: FloatArray, x: FloatArray) -> FloatArray:
        """K u + B^T x."""
        self._u.array[:], self._x.array[:] = u, x
        self._solver.multiply(self._u, self._forces)
        self._B.multTransposeAdd(self._x, self._forces, self._forces)
        return self._forces.array_r.copy()

    def rows(self, u: FloatArray) -> FloatArray:
        """B u."""
        self._u.array[:] = u
        self._B.mult(self._u, self._x)
        return self._x.array_r.copy()


class CoupledKrylov:
    """The equations above, at one point.

    Args:
        body: K, B and the approximation of K^-1.
        a: The unit of A, metres per newton.
        constraints: G; its resultant is G X z.
        forces: z -> X z, shapes (m, 3).
        equations: (z, w) -> P z + Y w, shapes (m, 3).
        inverse: (r (m, 3), r3 (q,)) -> z and alpha of [P + Y A X/a, -Y G^T; G X, 0], nearly.
        rows: Weights of the equations of the contact points, shape (m, 1),
        weight: and of those of displacements.
    """

    def __init__(
        self,
        body: Elimination,
        a: float,
        constraints: Constraints,
        forces: NodalMap,
        equations: Callable[[FloatArray, FloatArray], FloatArray],
        inverse: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
        rows: FloatArray,
        weight: float,
    ):
        self._body, self._a, self._constraints, self._forces = body, a, constraints, forces
        self._equations, self._inverse, self._rows, self._weight = equations, inverse, rows, weight
        self._failure: CGNotConverged | TooSlow | None = None

    def solve(
        self, f: FloatArray, g: FloatArray, e: FloatArray, atol: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """u (n,) in metres, z (m, 3), alpha (q,), and the norm of the weighted residual, at most atol if it converges;
        collective.

        Args:
            f, g, e: The right-hand sides, shapes (n,), (m, 3), (q,).
            atol: Tolerance of the weighted residual.
        """
        comm = self._constraints.comm
        self._n, self._m = len(f), len(g)
        extra = self._constraints.count if comm.rank == 0 else 0
        size = self._n + 3 * self._m + extra
        matrix = PETSc.Mat().createPython(((size, PETSc.DETERMINE),) * 2, context=self, comm=comm)
        matrix.setUp()
        solution, rhs = matrix.createVecs()
        self._put(rhs, self._weight * f, self._rows * g, e)
        ksp = configured_ksp(matrix, PETSc.KSP.Type.FGMRES, _OPTIONS)
        ksp.setErrorIfNotConverged(False)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(self)
        ksp.setTolerances(rtol=0.0, atol=atol, divtol=1e30, max_it=_MOST)
        try:
            ksp.solve(rhs, solution)
            return *self._parts(solution), float(ksp.getResidualNorm())
        except PETSc.Error:  # newer versions of petsc4py raise this in place of the exception of a callback
            if self._failure is not None:
                raise self._failure from None
            raise
        finally:
            for thing in (ksp, matrix, solution, rhs):
                thing.destroy()

    def _parts(self, v: PETSc.Vec) -> tuple[FloatArray, FloatArray, FloatArray]:
        """u, z and alpha, which is the same on every rank; collective if there are any."""
        array, ends, comm = v.array_r, (self._n, self._n + 3 * self._m), self._constraints.comm
        shared: FloatArray = np.empty(self._constraints.count)
        if len(shared):
            if comm.rank == 0:
                shared[:] = array[ends[1] :]
            comm.Bcast(shared)
        return array[: ends[0]].copy(), array[slice(*ends)].reshape(-1, 3).copy(), shared

    def _put(self, v: PETSc.Vec, u: FloatArray, z: FloatArray, alpha: FloatArray) -> None:
        array, ends = v.array_w, (self._n, self._n + 3 * self._m)
        array[: ends[0]], array[slice(*ends)] = u, z.ravel()
        if self._constraints.comm.rank == 0:
            array[ends[1] :] = alpha

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        u, z, alpha = self._parts(x)
        w = self._constraints.without(-self._body.rows(u).reshape(-1, 3) / self._a, alpha)
        forces = self._body.multiply(u, self._forces(z).ravel())
        self._put(y, self._weight * forces, self._rows * self._equations(z, w), self._constraints.resultant(z))

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        f, g, e = self._parts(x)
        try:
            w = -self._body.begin(f / self._weight).reshape(-1, 3) / self._a
            z, alpha = self._inverse(g / self._rows - self._equations(np.zeros_like(g), w), e)
            u = self._body.end(self._forces(z).ravel())
        except (CGNotConverged, TooSlow) as failure:
            self._failure = failure
            raise
        self._put(y, u, z, alpha)
