"""PETSc's Krylov methods for the Newton systems, with one product by A per iteration."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray

NodalMap = Callable[[FloatArray], FloatArray]


_RESTART = 100  # restart of FGMRES: far beyond the usual iterations of a step


class CarryingKrylov:
    """PETSc's CG or FGMRES on vectors extended by A x: A dx is known at the end without another product.

    Each node has `block` unknowns, the first three of which are x, followed by the three of w = A x.  The product w_z =
    A x_z is computed by the preconditioner for its result z.  Directions and solution of both methods are linear
    combinations of the z's, so that their w is A x, and the operator reads A x from the vector instead of computing it.
    Residuals have w = 0, so that inner products are unchanged.  One product per iteration, none at the end.

    Args:
        comm: The ranks.
        nodes: Contact nodes of this rank.
        block: Unknowns per node, the three of x first.
        apply_A: x (m, 3) -> A x (m, 3).
        operator: (unknowns (m, block), A x (m, 3)) -> image (m, block).
        preconditioner: Residual (m, block) -> unknowns (m, block).
        method: KSP.Type.CG or KSP.Type.FGMRES, which preconditions from the right and keeps its z's.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        nodes: int,
        block: int,
        apply_A: NodalMap,
        operator: Callable[[FloatArray, FloatArray], FloatArray],
        preconditioner: NodalMap,
        method: str = PETSc.KSP.Type.CG,
    ):
        self._block, self._apply_A = block, apply_A
        self._operator, self._preconditioner = operator, preconditioner
        width = block + 3
        sizes = (width * nodes, PETSc.DETERMINE)
        self._matrix = PETSc.Mat().createPython((sizes, sizes), context=self, comm=comm)
        self._matrix.setUp()
        self._rhs = PETSc.Vec().createMPI(sizes, bsize=width, comm=comm)
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
        return array.reshape(-1, self._block + 3)

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        p, q = self._nodewise(x, readonly=True), self._nodewise(y)
        q[:, : self._block] = self._operator(p[:, : self._block], p[:, self._block :])
        q[:, self._block :] = 0.0

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        r, z = self._nodewise(x, readonly=True), self._nodewise(y)
        z[:, : self._block] = self._preconditioner(r[:, : self._block])
        z[:, self._block :] = self._apply_A(z[:, :3])

    def solve(self, rhs: FloatArray, guess: FloatArray, atol: float) -> tuple[FloatArray, FloatArray, int]:
        """Unknowns (m, block), A x (m, 3), iterations.  `guess` must have x = 0."""
        b, s = self._nodewise(self._rhs), self._nodewise(self._solution)
        b[:, : self._block], b[:, self._block :] = rhs, 0.0
        s[:, : self._block], s[:, self._block :] = guess, 0.0
        limit = 100 + 3 * self._rhs.getSize() // (self._block + 3)  # as many as exact arithmetic needs, and some
        self._ksp.setTolerances(rtol=0.0, atol=atol, divtol=1e30, max_it=limit)
        self._ksp.solve(self._rhs, self._solution)
        s = self._nodewise(self._solution, readonly=True).copy()
        return s[:, : self._block], s[:, self._block :], int(self._ksp.getIterationNumber())

    def free(self) -> None:  # not `destroy`: PETSc calls a method of that name on its Python contexts
        for thing in (self._ksp, self._matrix, self._rhs, self._solution):
            thing.destroy()
