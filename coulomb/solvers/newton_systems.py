"""The linear system of a path-following step, and its preconditioners (Kucera, Machalova, Netuka, Zencak).

A step eliminates dz and leaves, with two multipliers per contact node (linearization.py),

    [J11   J12 ] [dx ]   [r1]
    [J21  -D22 ] [dnu] = [r2]

J_AM is this matrix, P_AM the same with A replaced by its diagonal; J_SC and P_SC are their Schur complements J11 + J12
D22^-1 J21 and D11 + J12 D22^-1 J21.  Both preconditioners are nodal.  With a rank, diag(rest) - V V^T + U U^T from the
products of earlier steps (low_rank.py) replaces diag(A): Theorem 1 holds for it as well, and the eigenvalues that are
not 1 are closer together.

Without slope J_SC is positive definite and J_AM symmetric; both are solved by CG.  CG on J_AM, started at dx = 0,
dnu = -D22^-1 r2, is CG on J_SC (Theorem 1 and what follows it): the second block of the residual is zero at the start
and stays so, and on such residuals P_AM^-1 acts as P_SC^-1.

With slope J_SC is unsymmetric and solved by FGMRES, preconditioned from the right.  P is triangular by nodal blocks,
plus U U^T - V V^T: J_SC P^-1 - 1 = (A - rest + V V^T - U U^T) P^-1, so the quality of P is that of the approximation of
A, independent of friction.

Rigid motions border the system, [J, -G^T; G, 0]; a constraint preconditioner made of P eliminates them.

For small problems on which these methods fail, `DenseSystem` factorises J_AM or J_SC.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
import scipy.linalg
from petsc4py import PETSc

from ..arrays import FloatArray
from ..linalg.compliance import (
    REPLACED,
    CarryingKrylov,
    ConstraintPreconditioner,
    LowRankApproximation,
    LowRankUpdate,
    NodalMap,
)
from ..linalg.reductions import Reductions
from .linearization import Linearization, NodalInverse, disc_inverse, like
from .rigid_motions import NO_MOTION
from .scaled_problem import IterateProducts, ScaledCompliance
from .settings import Settings, within

ROUNDING: Final = 1e-15
"""Relative residual of a Krylov method at the level of rounding errors in double precision."""

_FEW: Final = 12
"""With slope, products along the rigid motions are made at the start only for so many motions: for one or two bodies
they save 5 to 15 % of all products, for five they cost 15 %.  Without slope they always are: they save 20 %."""


class NewtonStep(NamedTuple):
    """Solution of the Newton system: dx (m, 3), dnu (m, 2), A dx (m, 3), Krylov iterations, and dalpha (r,)."""

    dx: FloatArray
    dnu: FloatArray
    A_dx: FloatArray
    iterations: int
    dalpha: FloatArray = NO_MOTION


class NewtonEquations(NamedTuple):
    """The equations of a step and the accuracy of its solution.

    |W residual| <= min(tolerance |W right-hand side|, cap), residual and right-hand side those of J_SC.

    Attributes:
        at: The linearisation.
        r1: Shape (m, 3).
        r2: Shape (m, 2).
        weight: W, of the rows, shape (m, 3); 1 if no node has a slope.
        tolerance: Relative tolerance.
        cap: Absolute tolerance.
        r3: What lacks for equilibrium along the rigid motions, shape (r,).
    """

    at: Linearization
    r1: FloatArray
    r2: FloatArray
    weight: FloatArray
    tolerance: float
    cap: float
    r3: FloatArray = NO_MOTION


class NewtonSystem(Protocol):
    """Solves the systems of all steps; made once per problem.

    Attributes:
        products: A x of the iterates.
    """

    products: IterateProducts

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        """The step, as accurate as asked for."""
        ...

    def correction(self, r2: FloatArray) -> NewtonStep | None:
        """The solution of the last system for r1 = 0, r2 (m, 2) with an approximation of A, without a product; None if
        there is none."""
        return None

    def tighten(self) -> None:
        """Make inexact products ten times as accurate from now on."""
        self.products.tighten()

    def learn(self, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        """Take note of products made elsewhere, pairs of x and A x, each (m, 3)."""
        return

    def keep(self) -> None:
        """Leave what was found of A with A, for other methods and problems to come."""
        return

    def destroy(self) -> None:
        """Free its PETSc objects."""
        return


class NewtonChoice(Protocol):
    """Choice of the Newton system, as a value."""

    def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
        """The system for a problem; `sloped` is whether friction grows with pressure anywhere.

        Raises:
            ValueError: On every rank, if it does not support the compliance or the law.
        """
        ...


@dataclass(frozen=True)
class SchurComplementSystem(Settings):
    """J_SC with P_SC: the multipliers eliminated, three unknowns per node; CG without slope, else FGMRES.

    Attributes:
        rank: Columns of U, the low-rank approximation of A in the preconditioner; 0 is the paper's P_SC.
        product: Bounds of the accuracy of a product that is a solve; within them it is the tolerance of the step, and
            ten times as accurate after every step from which the gradient grows (`InteriorPoint.growth`).
    """

    rank: int = within("[0, inf)", 100)
    product: tuple[float, float] = within("(0, 1]", (0.03, 0.1))

    def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
        """See `NewtonChoice`."""
        return _SchurComplement(A, self.rank, self.product, 3, sloped)


@dataclass(frozen=True)
class AugmentedSystem(Settings):
    """J_AM with P_AM: five unknowns per node, CG on the symmetric indefinite system; for problems without slope.

    Attributes:
        rank: Columns of U, the low-rank approximation of A in the preconditioner; 0 is the paper's P_AM.
        product: As of SchurComplementSystem.
    """

    rank: int = within("[0, inf)", 100)
    product: tuple[float, float] = within("(0, 1]", (0.01, 1.0))

    def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
        """See `NewtonChoice`."""
        if sloped:
            raise ValueError(
                "newton: J_AM with P_AM is for given slip bounds; where friction grows with pressure use "
                "SchurComplementSystem() or SuccessiveTresca()"
            )
        return _Augmented(A, self.rank, self.product, 5, sloped)


class _Krylov(NewtonSystem):
    """The common part of J_AM/P_AM and J_SC/P_SC: products, and the low-rank approximation of A made from them."""

    def __init__(self, A: ScaledCompliance, rank: int, product: tuple[float, float], block: int, sloped: bool) -> None:
        self.products = IterateProducts(A)
        self._scaled = A
        self._comm, self._product, self._accuracy = A.comm, product, 0.0
        known = A.known()
        self._A = LowRankApproximation(
            A.comm, A.diagonal, rank, A.A.exact, REPLACED, known=known, rigid=A.rigid, local=A.rest
        )
        self._block = block
        self._weight: FloatArray = np.ones((A.nodes, block))

        def recorded(x: FloatArray, accuracy: float) -> FloatArray:
            y = A.mult(x, accuracy)
            self._A.record(x, y)
            return y

        def enough(x: FloatArray) -> FloatArray:
            return recorded(x, self._krylov.allowed(self._accuracy, self.products.sharper))

        if rank > 0 and (not sloped or A.G.shape[2] <= _FEW):  # A is large along motions that few springs prevent
            for G in np.moveaxis(A.G, 2, 0):
                recorded(np.ascontiguousarray(G), product[0])
            self._A.update()
        method = PETSc.KSP.Type.FGMRES if sloped else PETSc.KSP.Type.CG
        self._constraints = A.constraints
        self._krylov = CarryingKrylov(
            self._constraints, block, enough, self._weighted_operator, self._precondition, method
        )

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        raise NotImplementedError

    def _solve(
        self,
        inverse: NodalMap,
        rhs: FloatArray,
        guess: FloatArray,
        size: float,
        tolerance: float,
        cap: float,
        r3: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Unknowns (m, block), A dx (m, 3), dalpha (r,) and iterations, to min(tolerance |(size, r3)|, cap)."""
        columns = self._A.nodal_columns(self._block, self._at.frictional)
        self._preconditioner = LowRankUpdate(self._comm, inverse, columns, self._A.signs)
        self._bordered = ConstraintPreconditioner(self._preconditioner, self._constraints, self._block)
        self._accuracy = self.products.sharper * min(max(tolerance, self._product[0]), self._product[1])
        size = float(np.hypot(size, np.linalg.norm(r3))) if len(r3) else size
        atol = max(min(tolerance * size, cap), ROUNDING * size)
        unknowns, moved, dalpha, iterations = self._krylov.solve(self._weight * rhs, guess, atol, r3)
        self._A.update()
        return unknowns, self._constraints.without(moved, -dalpha), dalpha, iterations

    def _weighted_operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        image = self._operator(p, A_p)
        image[~self._at.frictional, 1:3] = 0.0
        return self._weight * image

    def _precondition(self, r: FloatArray, r3: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._bordered(r / self._weight, r3)

    def _norm(self, r: FloatArray) -> float:
        return float(np.sqrt(Reductions(self._comm).dot(r, r)))

    def tighten(self) -> None:
        super().tighten()
        self._A.replace_nothing()  # once products have to be more accurate, less is made of what they show

    def learn(self, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        for x, A_x in pairs:
            self._A.record(x, A_x)
        self._A.update()

    def keep(self) -> None:
        self._scaled.keep(self._A.learnt)

    def destroy(self) -> None:
        self._krylov.free()

    _at: Linearization


class _SchurComplement(_Krylov):
    """J_SC with P_SC."""

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        nodal, r1, r2, weight, tolerance, cap, r3 = equations
        self._at, self._weight = nodal, weight
        rhs = r1 + nodal.J12(r2 / nodal.D22)
        size = self._norm(weight * rhs)
        dx, A_dx, dalpha, iterations = self._solve(
            NodalInverse(nodal, self._A.rest), rhs, np.zeros_like(rhs), size, tolerance, cap, r3
        )
        return NewtonStep(dx, nodal.multipliers(dx, r2), A_dx, iterations, dalpha)

    def correction(self, r2: FloatArray) -> NewtonStep | None:
        if self._scaled.rigid.shape[1]:  # on soft springs A x and b nearly cancel: too much for an approximation of A
            return None
        nodal = self._at
        dx, dalpha = self._bordered(nodal.J12(r2 / nodal.D22), np.zeros(self._constraints.count))
        return NewtonStep(dx, nodal.multipliers(dx, r2), self._A.mult(dx), 0, dalpha)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        return A_p + self._at.schur(p)


class _Augmented(_Krylov):
    """J_AM with P_AM, without slope."""

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        self._at = nodal = equations.at
        r1, r2 = equations.r1, equations.r2
        self._D11 = self._A.rest + np.column_stack([np.zeros_like(nodal.h), nodal.h, nodal.h])
        self._D11[~nodal.frictional, 1:] = 1.0
        self._S22 = nodal.D22 + np.column_stack([1.0 / self._D11[:, 0], np.sum(nodal.y**2 / self._D11[:, 1:], axis=1)])
        guess = np.hstack([np.zeros_like(r1), -r2 / nodal.D22])
        size = self._norm(r1 - nodal.J12(guess[:, 3:]))
        rhs = np.hstack([r1, r2])
        unknowns, A_dx, dalpha, iterations = self._solve(
            self._nodal_inverse, rhs, guess, size, equations.tolerance, equations.cap, equations.r3
        )
        return NewtonStep(unknowns[:, :3], unknowns[:, 3:], A_dx, iterations, dalpha)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        nodal, dx, dnu = self._at, p[:, :3], p[:, 3:]
        return np.hstack([A_p + nodal.C(dx) + nodal.J12(dnu), nodal.J21(dx) - nodal.D22 * dnu])

    def _nodal_inverse(self, r: FloatArray) -> FloatArray:
        """P_AM^-1 on (m, 5, ...): a 2 x 2 block for the normal pair, a 3 x 3 one for the tangential triple."""
        nodal, D, D22, S22 = self._at, like(self._D11, r), like(self._at.D22, r), like(self._S22, r)
        r1, r2 = r[:, :3], r[:, 3:]
        z = np.empty_like(r)
        z[:, 3:] = (nodal.J21(r1 / D) - r2) / S22
        # dx = (r1 - J12 dnu) / D11 would cancel for an active constraint (D22 -> 0), and CG would stall: expanded
        z[:, 0] = (D22[:, 0] * r1[:, 0] - r2[:, 0]) / (D[:, 0] * S22[:, 0])
        y = like(nodal.y, r)
        z[:, 1:3] = disc_inverse(D[:, 1:], y, D22[:, 1:], S22[:, 1:], r1[:, 1:])
        z[:, 1:3] += y / D[:, 1:] * (r2[:, 1:] / S22[:, 1:])
        return z


@dataclass(frozen=True)
class DenseSystem:
    """J_AM factorised (LU, scaled), with slope J_SC; on one rank, 3 m products to get A and (5 m)^3 or (3 m)^3 work per
    step.

    Slower than a Krylov method that converges, but independent of the condition of A: rank-deficient problems with
    slip bounds over many orders of magnitude are solved only by this system.
    """

    def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
        """See `NewtonChoice`; a ValueError on more than one rank."""
        return _Dense(A, sloped)


class _Dense(NewtonSystem):
    def __init__(self, A: ScaledCompliance, sloped: bool):
        self._scaled, self._sloped, self.products = A, sloped, IterateProducts(A)
        if A.comm.size > 1:
            raise ValueError("dense Newton systems work on one rank; use a Krylov one: solver.newton of the case file")
        self._A: FloatArray = A.dense()

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        """The step to rounding accuracy; weight, tolerance and cap are not used."""
        nodal, r1, r2, r3 = equations.at, equations.r1, equations.r2, equations.r3
        if self._sloped:  # J_AM is as accurate, and takes three times as long (block, p = 10, F = 0.3)
            rhs = r1 + nodal.J12(r2 / nodal.D22)
            rhs[~nodal.frictional, 1:] = 0.0
            J = self._bordered(schur_matrix(self._A, nodal))
            rows = 1.0 / np.abs(J).max(axis=1)
            columns = 1.0 / np.abs(rows[:, None] * J).max(axis=0)
        else:
            rhs = np.concatenate([r1.ravel(), r2.ravel()])
            J = self._bordered(augmented_matrix(self._A, nodal))
            rows, columns = (1.0 / np.sqrt(np.abs(np.diag(J)) + 1e-3 * np.abs(J).max(axis=axis)) for axis in (1, 0))
        with warnings.catch_warnings():  # a singular matrix gives a step that is not finite, which ends the start
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
            factors = scipy.linalg.lu_factor(rows[:, None] * J * columns, overwrite_a=True, check_finite=False)
        solution = columns * scipy.linalg.lu_solve(factors, rows * np.concatenate([rhs.ravel(), r3]))
        dx, dnu, dalpha = np.split(solution, [r1.size, rhs.size])
        dx = dx.reshape(r1.shape)
        dnu = nodal.multipliers(dx, r2) if self._sloped else dnu.reshape(r2.shape)
        return NewtonStep(dx, dnu, (self._A @ dx.ravel()).reshape(dx.shape), 0, dalpha)

    def _bordered(self, M: FloatArray) -> FloatArray:
        """[M, -G^T; G, 0], G on the first unknowns; M without rigid motions."""
        G = self._scaled.G.reshape(3 * self._scaled.nodes, -1)
        n, r = len(M), G.shape[1]
        if r == 0:
            return M
        bordered = np.zeros((n + r, n + r))
        bordered[:n, :n] = M
        bordered[: len(G), n:], bordered[n:, : len(G)] = -G, G.T
        return bordered


def schur_matrix(A: FloatArray, nodal: Linearization) -> FloatArray:
    """J_SC = A + C + J12 D22^-1 J21 with this A, shape (3 m, 3 m); the identity for pairs without friction."""
    M, n = A.copy(), 3 * np.arange(len(nodal.h))
    dropped = (n[~nodal.frictional][:, None] + np.array([1, 2])).ravel()
    M[dropped], M[:, dropped] = 0.0, 0.0
    blocks = np.stack([nodal.schur(np.tile(e, (len(n), 1))) for e in np.eye(3)], axis=2)
    blocks[~nodal.frictional, 1:, 1:] = np.eye(2)
    M[n[:, None, None] + np.arange(3)[:, None], n[:, None, None] + np.arange(3)] += blocks
    return M


def augmented_matrix(A: FloatArray, nodal: Linearization) -> FloatArray:
    """J_AM = [J11 J12; J21 -D22] with this A, shape (5 m, 5 m); with diag(A) in its place, P_AM.

    The tangential pair of a node without friction is replaced by the identity.
    """
    m = len(nodal.h)
    J = np.zeros((5 * m, 5 * m))
    J[: 3 * m, : 3 * m] = A
    n, bound = 3 * np.arange(m), 3 * m + 2 * np.arange(m)
    t, disc = n[:, None] + np.array([1, 2]), bound + 1
    J[t, t] += nodal.h[:, None]
    J[t, n[:, None]] -= (nodal.h * nodal.slope)[:, None] * nodal.y
    J[n, bound] = J[bound, n] = -1.0
    J[t, disc[:, None]] = J[disc[:, None], t] = nodal.y
    J[disc, n] = -nodal.k
    dropped = np.concatenate([t[~nodal.frictional].ravel(), disc[~nodal.frictional]])
    J[dropped], J[:, dropped] = 0.0, 0.0
    J[dropped, dropped] = 1.0
    J[bound, bound], J[disc, disc] = -nodal.D22[:, 0], -nodal.D22[:, 1]
    return J
