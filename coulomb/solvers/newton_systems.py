"""The linear system of a path-following step, and its preconditioners (Kucera, Machalova, Netuka, Zencak).

A step eliminates dz and leaves, with every contact node carrying its two multipliers,

    [J11   J12 ] [dx ]   [r1]        J11 = A + diag(0, h, h),  h = nu2/g
    [J21  -D22 ] [dnu] = [r2]        J12 = J21^T: (-1, 0, 0) for the bound, (0, y1, y2) with y = x_t/g for the disc
                                     D22 = z/nu

J_AM is this symmetric indefinite matrix, P_AM the same with A replaced by its diagonal; J_SC and P_SC are their Schur
complements J11 + J12 D22^-1 J21 and D11 + J12 D22^-1 J21, positive definite.  Both preconditioners are nodal.

CG on J_AM, started at dx = 0, dnu = -D22^-1 r2, is CG on J_SC (Theorem 1 and what follows it): the second block of the
residual is zero at the start and stays so, and on such residuals P_AM^-1 acts as P_SC^-1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray

NodalMap = Callable[[FloatArray], FloatArray]


class NewtonStep(NamedTuple):
    """Solution of the Newton system: dx (m, 3), dnu (m, 2), A dx (m, 3), and the Krylov iterations it took."""

    dx: FloatArray
    dnu: FloatArray
    A_dx: FloatArray
    iterations: int


class Linearization(NamedTuple):
    """The nodal numbers of J: h (m,), y (m, 2), D22 (m, 2), and which nodes have a disc to move in (m,)."""

    h: FloatArray
    y: FloatArray
    D22: FloatArray
    frictional: npt.NDArray[np.bool_]

    def J21(self, dx: FloatArray) -> FloatArray:
        """Derivative of the constraints along dx (m, 3), shape (m, 2)."""
        return np.stack([-dx[:, 0], np.einsum("ij,ij->i", self.y, dx[:, 1:])], axis=1)

    def J12(self, dnu: FloatArray) -> FloatArray:
        """Force balance of the multipliers dnu (m, 2), shape (m, 3)."""
        return np.column_stack([-dnu[:, 0], self.y * dnu[:, 1:]])

    def C(self, dx: FloatArray) -> FloatArray:
        """The nodal part of J11, diag(0, h, h)."""
        return np.column_stack([np.zeros(len(dx)), self.h[:, None] * dx[:, 1:]])


class NewtonSystem(Protocol):
    """Solves the system of one step after another; made once for a QP.

    Args of the constructor:
        comm: The ranks of A.
        apply_A: x (m, 3) -> A x (m, 3); every call is a product.
        diagonal: diag(A), shape (m, 3).
    """

    def __init__(self, comm: MPI.Comm, apply_A: NodalMap, diagonal: FloatArray): ...

    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep:
        """Solve to |residual| <= min(tolerance |right-hand side|, cap), the right-hand side that of J_SC."""
        ...

    def destroy(self) -> None: ...


class _CarryingCG:
    """PETSc's CG on vectors that carry A x along, so that A dx is known at the end without another product.

    Each node holds `block` unknowns, of which the first three are x, and behind them the three of w = A x.  The product
    is made when the preconditioner has its z: w_z = A x_z.  CG only ever adds and scales z's, so its directions and its
    solution carry their own w, and the operator finds A x in the vector instead of computing it.  Residuals have w = 0,
    so no inner product sees it.  One product an iteration, none at the end.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        nodes: int,
        block: int,
        apply_A: NodalMap,
        operator: Callable[[FloatArray, FloatArray], FloatArray],
        preconditioner: NodalMap,
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
        self._ksp.setType(PETSc.KSP.Type.CG)
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


class _NodalCG(ABC):
    """What J_AM/P_AM and J_SC/P_SC share: the right-hand side of J_SC, by which both measure their residual."""

    block: int
    _at: Linearization

    def __init__(self, comm: MPI.Comm, apply_A: NodalMap, diagonal: FloatArray):
        self._comm = comm
        self._diagonal = diagonal
        self._cg = _CarryingCG(comm, len(diagonal), self.block, apply_A, self._operator, self._preconditioner)

    @abstractmethod
    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep: ...

    @abstractmethod
    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray: ...

    @abstractmethod
    def _preconditioner(self, r: FloatArray) -> FloatArray: ...

    def _absolute(self, rhs: FloatArray, tolerance: float, cap: float) -> float:
        size = float(np.sqrt(self._comm.allreduce(float(np.vdot(rhs, rhs)))))
        return max(min(tolerance * size, cap), 1e-15 * size)

    def _J11(self, dx: FloatArray, A_dx: FloatArray) -> FloatArray:
        """J11 dx on the unknowns: where the disc has no radius, the tangential pair is none."""
        y = A_dx + self._at.C(dx)
        y[~self._at.frictional, 1:] = 0.0
        return y

    def destroy(self) -> None:
        self._cg.free()


class AugmentedSystem(_NodalCG):
    """J_AM with P_AM, the default: CG on the symmetric indefinite system, five unknowns a node."""

    block = 5

    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep:
        self._at = at
        self._D11 = self._diagonal + at.C(np.ones_like(self._diagonal))
        self._S22 = at.D22 + np.column_stack([1.0 / self._D11[:, 0], np.sum(at.y**2 / self._D11[:, 1:], axis=1)])
        guess = np.hstack([np.zeros_like(r1), -r2 / at.D22])
        atol = self._absolute(r1 - at.J12(guess[:, 3:]), tolerance, cap)
        unknowns, A_dx, iterations = self._cg.solve(np.hstack([r1, r2]), guess, atol)
        return NewtonStep(unknowns[:, :3], unknowns[:, 3:], A_dx, iterations)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        dx, dnu = p[:, :3], p[:, 3:]
        return np.hstack([self._J11(dx, A_p) + self._at.J12(dnu), self._at.J21(dx) - self._at.D22 * dnu])

    def _preconditioner(self, r: FloatArray) -> FloatArray:
        """P_AM^-1: a 2 x 2 block for the normal pair, a 3 x 3 one for the tangential triple."""
        r1, r2, at, D = r[:, :3], r[:, 3:], self._at, self._D11
        dnu = (at.J21(r1 / D) - r2) / self._S22
        # dx = (r1 - J12 dnu) / D11 would cancel where a constraint is active (D22 -> 0), and CG stall: multiplied out
        dx = np.empty_like(r1)
        dx[:, 0] = (at.D22[:, 0] * r1[:, 0] - r2[:, 0]) / (D[:, 0] * self._S22[:, 0])
        dx[:, 1:] = _disc_inverse(D[:, 1:], at, self._S22[:, 1], r1[:, 1:])
        dx[:, 1:] += at.y / D[:, 1:] * (r2[:, 1] / self._S22[:, 1])[:, None]
        return np.hstack([dx, dnu])


class SchurComplementSystem(_NodalCG):
    """J_SC with P_SC: the multipliers eliminated, CG on the positive definite system, three unknowns a node."""

    block = 3

    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep:
        self._at = at
        self._D11 = self._diagonal + at.C(np.ones_like(self._diagonal))
        self._D11[:, 0] += 1.0 / at.D22[:, 0]
        self._S22 = at.D22[:, 1] + np.sum(at.y**2 / self._D11[:, 1:], axis=1)
        rhs = r1 + at.J12(r2 / at.D22)
        dx, A_dx, iterations = self._cg.solve(rhs, np.zeros_like(rhs), self._absolute(rhs, tolerance, cap))
        return NewtonStep(dx, (at.J21(dx) - r2) / at.D22, A_dx, iterations)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        return self._J11(p, A_p) + self._at.J12(self._at.J21(p) / self._at.D22)

    def _preconditioner(self, r: FloatArray) -> FloatArray:
        z = r / self._D11
        z[:, 1:] = _disc_inverse(self._D11[:, 1:], self._at, self._S22, r[:, 1:])
        return z


def _disc_inverse(D: FloatArray, at: Linearization, S: FloatArray, r: FloatArray) -> FloatArray:
    """(D + y y^T / d22)^-1 r on the tangential pairs, (m, 2), with S = d22 + y^T D^-1 y.

    Sherman and Morrison's D^-1 - D^-1 y y^T D^-1 / S, with the difference multiplied out so that nothing cancels as
    d22 -> 0: (d22 D^-1 + w w^T / det D) / S, where w = (-y2, y1).
    """
    w = np.column_stack([-at.y[:, 1], at.y[:, 0]])
    along = np.einsum("ij,ij->i", w, r) / (D[:, 0] * D[:, 1])
    inverse: FloatArray = (at.D22[:, 1:] * r / D + along[:, None] * w) / S[:, None]
    return inverse
