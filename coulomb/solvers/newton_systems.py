"""The linear system of a path-following step, and its preconditioners (Kucera, Machalova, Netuka, Zencak).

A step eliminates dz and leaves, with every contact node carrying its two multipliers,

    [J11   J12 ] [dx ]   [r1]        J11 = A + diag(0, h, h),  h = nu2/g
    [J21  -D22 ] [dnu] = [r2]        J12 = J21^T: (-1, 0, 0) for the bound, (0, y1, y2) with y = x_t/g for the disc
                                     D22 = z/nu

J_AM is this symmetric indefinite matrix, P_AM the same with A replaced by its diagonal; J_SC and P_SC are their Schur
complements J11 + J12 D22^-1 J21 and D11 + J12 D22^-1 J21, positive definite.  Both preconditioners are nodal.
RecyclingSystem, the default, puts diag(rest) + U U^T in place of diag(A) (recycling.py): what Theorem 1 says of P_AM
and P_SC holds of it word for word, and the eigenvalues that are not 1 lie closer together.

CG on J_AM, started at dx = 0, dnu = -D22^-1 r2, is CG on J_SC (Theorem 1 and what follows it): the second block of the
residual is zero at the start and stays so, and on such residuals P_AM^-1 acts as P_SC^-1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.krylov import CarryingKrylov, NodalMap
from ..linalg.recycling import LearntCompliance, LowRankUpdate
from .scaled_compliance import FreshImages, ScaledCompliance

_LOOSE = 0.01  # accuracy of a product in CG, where it is a solve: no better than the tolerance of the step, or this


class NewtonStep(NamedTuple):
    """Solution of the Newton system: dx (m, 3), dnu (m, 2), A dx (m, 3), and Krylov iterations."""

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
        """Derivative of the constraints along dx (m, 3, ...), shape (m, 2, ...)."""
        return np.stack([-dx[:, 0], np.einsum("ij,ij...->i...", self.y, dx[:, 1:])], axis=1)

    def J12(self, dnu: FloatArray) -> FloatArray:
        """Force balance of the multipliers dnu (m, 2), shape (m, 3)."""
        return np.column_stack([-dnu[:, 0], self.y * dnu[:, 1:]])

    def C(self, dx: FloatArray) -> FloatArray:
        """The nodal part of J11, diag(0, h, h)."""
        return np.column_stack([np.zeros(len(dx)), self.h[:, None] * dx[:, 1:]])


class NewtonSystem(Protocol):
    """Solves the system of one step after another; made once for a QP.

    Args of the constructor:
        A: The scaled compliance.
    """

    def __init__(self, A: ScaledCompliance): ...

    def start(self, x: FloatArray, tolerance: float) -> FloatArray:
        """A x of the first iterate, see FreshImages."""
        ...

    def carry(self, x: FloatArray, predicted: FloatArray | None, alpha: float, tolerance: float) -> FloatArray:
        """A x of the next iterate."""
        ...

    def judge(self, x: FloatArray) -> FloatArray:
        """A x as exact as can be."""
        ...

    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep:
        """Solve to |residual| <= min(tolerance |right-hand side|, cap), the right-hand side that of J_SC."""
        ...

    def destroy(self) -> None:
        """Give back what it holds of PETSc."""
        ...


class _NodalCG(FreshImages, ABC):
    """What J_AM/P_AM and J_SC/P_SC share: the right-hand side of J_SC, by which both measure their residual, and the
    low-rank part of the preconditioner, if there is one."""

    block: int
    rank = 0
    """Columns of U to keep in the preconditioner; 0 is the paper's, with diag(A) alone."""
    _at: Linearization

    def __init__(self, A: ScaledCompliance):
        super().__init__(A)
        self._comm, self._accuracy = A.comm, 0.0
        self._A = LearntCompliance(A.comm, A.diagonal, self.rank, A.A.exact)

        def recorded(x: FloatArray) -> FloatArray:
            y = A.mult(x, self._accuracy)
            self._A.record(x, y)
            return y

        self._cg = CarryingKrylov(A.comm, A.nodes, self.block, recorded, self._operator, self._precondition)

    @abstractmethod
    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep: ...

    @abstractmethod
    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray: ...

    @abstractmethod
    def _nodal_inverse(self, r: FloatArray) -> FloatArray:
        """P_AM^-1 or P_SC^-1 with rest(A) in place of A, of shape (m, block, ...)."""

    def _prepare(self) -> None:
        """The preconditioner of a step, once its nodal numbers are set."""
        U = self._A.nodal_U(self.block)
        U[~self._at.frictional, 1:3] = 0.0
        self._preconditioner: NodalMap = LowRankUpdate(self._comm, self._nodal_inverse, U)

    def _precondition(self, r: FloatArray) -> FloatArray:
        return self._preconditioner(r)

    def _absolute(self, rhs: FloatArray, tolerance: float, cap: float) -> float:
        self._accuracy = max(tolerance, _LOOSE)
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
        self._D11 = self._A.rest + at.C(np.ones_like(self._A.rest))
        self._S22 = at.D22 + np.column_stack([1.0 / self._D11[:, 0], np.sum(at.y**2 / self._D11[:, 1:], axis=1)])
        self._prepare()
        guess = np.hstack([np.zeros_like(r1), -r2 / at.D22])
        atol = self._absolute(r1 - at.J12(guess[:, 3:]), tolerance, cap)
        unknowns, A_dx, iterations = self._cg.solve(np.hstack([r1, r2]), guess, atol)
        self._A.learn()
        return NewtonStep(unknowns[:, :3], unknowns[:, 3:], A_dx, iterations)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        dx, dnu = p[:, :3], p[:, 3:]
        return np.hstack([self._J11(dx, A_p) + self._at.J12(dnu), self._at.J21(dx) - self._at.D22 * dnu])

    def _nodal_inverse(self, r: FloatArray) -> FloatArray:
        """A 2 x 2 block for the normal pair, a 3 x 3 one for the tangential triple."""
        at, D, D22, S22 = self._at, like(self._D11, r), like(self._at.D22, r), like(self._S22, r)
        r1, r2 = r[:, :3], r[:, 3:]
        z = np.empty_like(r)
        z[:, 3:] = (at.J21(r1 / D) - r2) / S22
        # dx = (r1 - J12 dnu) / D11 would cancel where a constraint is active (D22 -> 0), and CG stall: multiplied out
        z[:, 0] = (D22[:, 0] * r1[:, 0] - r2[:, 0]) / (D[:, 0] * S22[:, 0])
        y = like(at.y, r)
        z[:, 1:3] = disc_inverse(D[:, 1:], y, D22[:, 1:], S22[:, 1:], r1[:, 1:])
        z[:, 1:3] += y / D[:, 1:] * (r2[:, 1:] / S22[:, 1:])
        return z


class SchurComplementSystem(_NodalCG):
    """J_SC with P_SC: the multipliers eliminated, CG on the positive definite system, three unknowns a node."""

    block = 3

    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep:
        self._at = at
        self._D11 = self._A.rest + at.C(np.ones_like(self._A.rest))
        self._D11[:, 0] += 1.0 / at.D22[:, 0]
        self._S22 = at.D22[:, 1] + np.sum(at.y**2 / self._D11[:, 1:], axis=1)
        self._prepare()
        rhs = r1 + at.J12(r2 / at.D22)
        dx, A_dx, iterations = self._cg.solve(rhs, np.zeros_like(rhs), self._absolute(rhs, tolerance, cap))
        self._A.learn()
        return NewtonStep(dx, (at.J21(dx) - r2) / at.D22, A_dx, iterations)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        return self._J11(p, A_p) + self._at.J12(self._at.J21(p) / self._at.D22)

    def _nodal_inverse(self, r: FloatArray) -> FloatArray:
        D, D22, S22 = like(self._D11, r), like(self._at.D22, r), like(self._S22[:, None], r)
        z = r / D
        z[:, 1:] = disc_inverse(D[:, 1:], like(self._at.y, r), D22[:, 1:], S22, r[:, 1:])
        return z


class RecyclingSystem(AugmentedSystem):
    """J_AM with P_AM in which diag(A) gives way to what CG has learnt of A in the steps before; the default.

    The same steps as AugmentedSystem, in a third to a half of the products (`coulomb benchmark table1`).
    """

    rank = 100


def like(values: FloatArray, r: FloatArray) -> FloatArray:
    """Nodal numbers (m, k), shaped to work on many right-hand sides (m, k, ...)."""
    return values.reshape(values.shape + (1,) * (r.ndim - 2))


def disc_inverse(D: FloatArray, y: FloatArray, d22: FloatArray, S: FloatArray, r: FloatArray) -> FloatArray:
    """(D + y y^T / d22)^-1 r on the tangential pairs, (m, 2, ...), with S = d22 + y^T D^-1 y.

    Sherman and Morrison's D^-1 - D^-1 y y^T D^-1 / S, with the difference multiplied out so that nothing cancels as
    d22 -> 0: (d22 D^-1 + w w^T / det D) / S, where w = (-y2, y1).
    """
    w = np.stack([-y[:, 1], y[:, 0]], axis=1)
    along = (w[:, :1] * r[:, :1] + w[:, 1:] * r[:, 1:]) / (D[:, :1] * D[:, 1:])
    inverse: FloatArray = (d22 * r / D + along * w) / S
    return inverse
