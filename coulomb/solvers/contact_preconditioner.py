"""Preconditioner of the semismooth Newton systems P dx + Q dw = r, dw = A dx: A replaced by D - V V^T + U U^T.

With C = (U, V) and S the signs of their products, M = P + Q (D + C S C^T) has by Woodbury's formula the inverse

    M^-1 = N^-1 - R C (S + C^T R C)^-1 C^T N^-1, N = P + Q D, R = N^-1 Q,

N and R nodal.  R = D^-1 where a node sticks, and in the row of the normal force of every closed node: there P = 0.
So C^T R C is C^T D^-1 C, which stays from step to step, and a product with the other rows of C; or it is that of the
point before, and a product with the rows that have changed since.  Where products are exact, and so cheap that these
sums count, nodes where P and Q have changed by less than `_CHANGED` keep theirs: what they do to the iterations is
small beside what the approximation of A does.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs, sgecon, sgetrf, sgetrs

from ..arrays import FloatArray
from ..linalg.compliance import LowRankApproximation, MatrixFreeCompliance
from ..linalg.reductions import Reductions, summed
from .contact_equations import ContactDerivative

_CHANGED: Final = 0.03
"""Change of P, and of Q D, of a node from which on its part is replaced."""

_NO_CHANGE: Final = 1e-13
"""Entries of R D - 1 below this are rounding errors."""

_LARGE: Final = 1e3
"""Entries of R D above this leave rounding errors in the sums, which are then made anew."""

_NOTHING: Final = 1e-9
"""Singular value of Q D up to which it is 0."""

_STIFF: Final = 4.0
"""Stiffness of the springs of multigrid over that of the body at a node: 1 and 16 take a tenth more iterations."""

_SHIFT: Final = (1e-10, 1e-6)
"""Part of diag(A) that is added to it, in double and in single precision."""


class ContactPreconditioner:
    """M^-1 at one point after the other; collective, as every application.

    Attributes:
        A: The approximation of A, not to be changed as long as this is used.
    """

    def __init__(self, comm: MPI.Comm, A: LowRankApproximation):
        self._comm, self.A, m = comm, A, len(A.rest)
        self._changed = _CHANGED if A.exact else 0.0
        self._D: FloatArray = A.rest
        self._P: FloatArray = np.full((m, 3, 3), np.inf)
        self._QD: FloatArray = np.zeros((m, 3, 3))
        self._N_inverse: FloatArray = np.zeros((m, 3, 3))
        self._R: FloatArray = np.zeros((m, 3, 3))
        self._RD: FloatArray = np.zeros((m, 3, 3))
        self._core: FloatArray | None = None

    @cached_property
    def _weighted(self) -> FloatArray:
        """D^-1 C, node by node, shape (m, 3, s)."""
        return self.A.weighted_columns.reshape(*self._D.shape, self.A.columns.shape[1])

    def move(self, derivative: ContactDerivative) -> None:
        """To a point: the equations and their derivative there; collective."""
        QD = derivative.Q * self._D[:, None, :]
        with np.errstate(invalid="ignore"):
            size = np.maximum(np.abs(derivative.P - self._P), np.abs(QD - self._QD)).max(axis=(1, 2))
        new = np.flatnonzero(~(size <= self._changed))  # nan is a change
        self._P[new], self._QD[new] = derivative.P[new], QD[new]
        self._N_inverse[new] = np.linalg.inv(derivative.P[new] + QD[new])
        R = self._N_inverse[new] @ derivative.Q[new]
        RD = R * self._D[new][:, None, :]
        if self.A.columns.shape[1]:
            self._replace(new, RD)
        self._R[new], self._RD[new] = R, RD

    def _replace(self, new: npt.NDArray[np.intp], RD: FloatArray) -> None:
        """C^T R C with R D of the nodes `new`, and its factors."""
        over, one, before = Reductions(self._comm), np.eye(3), self._core
        if before is not None and not over.any(len(new) > 0):
            return
        change, after = RD - self._RD[new], self._RD.copy()
        large = bool(np.any(np.abs(after[new]) > _LARGE))
        after[new] = RD
        others = np.flatnonzero(np.any(np.abs(after - one) > _NO_CHANGE, axis=(1, 2)))
        if before is None or over.any(large or len(others) <= len(new)):
            new, change, before = others, after[others] - one, np.diag(self.A.signs) + self.A.weighted_gram
        s = self.A.columns.shape[1]
        rows = np.flatnonzero(np.any(np.abs(change) > _NO_CHANGE, axis=2).ravel())
        changed = (change @ self._weighted[new]).reshape(-1, s)[rows]
        seen = self.A.columns.reshape(-1, 3, s)[new].reshape(-1, s)[rows]
        self._core = before + summed(self._comm, seen.T @ changed)
        self._factors, self._pivots, _ = dgetrf(self._core)  # a singular one gives no numbers: the method ends

    def __call__(self, r: FloatArray) -> FloatArray:
        """M^-1 applied to r (m, 3) or (m, 3, columns); collective."""
        C, count = self.A.columns, math.prod(r.shape[2:])
        z = self._N_inverse @ r.reshape(len(r), 3, count)
        if C.shape[1] > 0:
            seen = summed(self._comm, C.T @ z.reshape(len(C), count))
            known = dgetrs(self._factors, self._pivots, seen)[0]
            z -= self._R @ (C @ known).reshape(z.shape)
        return z.reshape(r.shape)

    def transposed(self, r: FloatArray) -> FloatArray:
        """M^-T applied to r (m, 3) or (m, 3, columns), N^-T (r - C core^-T C^T R^T r); collective."""
        C, count = self.A.columns, math.prod(r.shape[2:])
        z = r.reshape(len(r), 3, count)
        if C.shape[1] > 0:
            seen = summed(self._comm, C.T @ (self._R.transpose(0, 2, 1) @ z).reshape(len(C), count))
            z = z - (C @ dgetrs(self._factors, self._pivots, seen, trans=1)[0]).reshape(z.shape)
        return (self._N_inverse.transpose(0, 2, 1) @ z).reshape(r.shape)


class SprungInverse:
    """N = (P + Q d)^-1, node by node: the equations of contact with d in place of A (`CoupledKrylov`).

    Args:
        d: What a body gives way around a point, in the unit of A, shape (m,).
    """

    def __init__(self, d: FloatArray):
        self._d = d

    @staticmethod
    def at_points(free: MatrixFreeCompliance, a: float, otherwise: FloatArray) -> SprungInverse:
        """With springs `_STIFF` times as stiff as the body is around a point, in the unit a of A; `otherwise` is d
        where a point is held."""
        gives = free.local.mean(axis=1) / (_STIFF * a)
        return SprungInverse(np.where(gives > 0.0, gives, otherwise))

    def move(self, at: ContactDerivative) -> None:
        """To a point: the equations and their derivative there."""
        self._N: FloatArray = np.linalg.inv(at.P + self._d[:, None, None] * at.Q)

    def springs(self, at: ContactDerivative) -> FloatArray:
        """N Q at this point, symmetric and without negative eigenvalues, shape (m, 3, 3): pressure alone acts along the
        normal."""
        NQ = self._N @ at.Q
        NQ[:, 1:, 0] = NQ[:, 0, 1:] = 0.0
        size, V = np.linalg.eigh(0.5 * (NQ + NQ.transpose(0, 2, 1)))
        springs: FloatArray = (V * np.maximum(size, 0.0)[:, None, :]) @ V.transpose(0, 2, 1)
        return springs

    def __call__(self, r: FloatArray) -> FloatArray:
        """N r of r (m, 3) or (m, 3, columns)."""
        return (self._N @ _columns(r)).reshape(r.shape)

    def transposed(self, r: FloatArray) -> FloatArray:
        """N^T r likewise."""
        return (self._N.transpose(0, 2, 1) @ _columns(r)).reshape(r.shape)


class FormedInverse:
    """M^-1 with A as a matrix, nearly, in place of its approximation, on one rank: for few contact points, and for the
    many right-hand sides of derivatives.

    Combinations of a node's rows in which Q is 0 are conditions on its dx alone: on all of it where it is open, without
    friction on dx_t, and where it slips, on what goes along the bound of friction.  With bases U = (U_1, U_0) of the
    rows, of which U_0^T Q = 0, and N of the dx with U_0^T P dx = 0, of which G r is one where that is U_0^T r,

        M^-1 = G + N (U_1^T M N)^-1 U_1^T (1 - M G)

    and the matrix in the middle is dense: of two rows per node that slips.

    Args:
        A: Shape (3 m, 3 m), in the precision in which M is factorised.
        diagonal: diag(A) or, where that is 0, any positive number, shape (m, 3): that takes its place.  A small part of
            it is added to A, which is singular where contact points are on a rigid face.
    """

    def __init__(self, A: FloatArray, diagonal: FloatArray):
        self._A, self._diagonal = A, diagonal
        there = A.diagonal().reshape(diagonal.shape) > 0.0
        self._extra: FloatArray = np.where(there, _SHIFT[A.dtype == np.float32], 1.0) * diagonal
        self._at: ContactDerivative | None = None

    def move(self, derivative: ContactDerivative) -> None:
        """To a point: the equations and their derivative there."""
        if derivative is self._at:
            return
        self._at = derivative
        U, size, _ = np.linalg.svd(derivative.Q * self._diagonal[:, None, :])
        self._kept = kept = size > _NOTHING  # the first ones of a node
        rows, none = U.transpose(0, 2, 1), np.zeros((1, 1, 1))
        conditions = np.where(kept[:, :, None], none, rows)
        W, size, V = np.linalg.svd(conditions @ derivative.P)
        inverse = np.where(kept[:, ::-1], 0.0, 1.0 / np.where(kept[:, ::-1], 1.0, size))
        self._G = (V.transpose(0, 2, 1) * inverse[:, None, :]) @ (W.transpose(0, 2, 1) @ conditions)
        self._rows, self._free = (np.where(kept[:, :, None], of, none) for of in (rows, V[:, ::-1]))
        self._bases = U, self._free + conditions @ derivative.P
        closed = np.flatnonzero(kept[:, 0])
        count, of, A = len(closed), kept[closed], self._A.reshape(2 * kept.shape)[closed][:, :, closed]
        if not count:
            self._factors = np.empty((0, 0), A.dtype)
            return
        rows, free = self._rows[closed], self._free[closed]
        along = (free.astype(A.dtype) @ A.reshape(count, 3, 3 * count))[of].T.reshape(count, 3, -1)
        M = ((rows @ derivative.Q[closed]).astype(A.dtype) @ along)[of]
        own = rows @ (derivative.P[closed] + derivative.Q[closed] * self._extra[closed, None]) @ free.transpose(0, 2, 1)
        place = np.cumsum(of).reshape(of.shape) - 1
        node, i, j = np.nonzero(of[:, :, None] & of[:, None, :])
        M[place[node, i], place[node, j]] += own[node, i, j]
        self._norm = float(np.max(np.add.reduce(np.abs(M), axis=1)))
        getrf = sgetrf if A.dtype == np.float32 else dgetrf
        # of M^T, whose rows are LAPACK's columns; a singular one gives no numbers
        self._factors, self._pivots, _ = getrf(M.T, overwrite_a=1)

    @property
    def precision(self) -> float:
        """Of the factors."""
        return float(np.finfo(self._A.dtype).eps)

    @property
    def condition(self) -> float:
        """The condition number of the dense matrix in the maximum norm, estimated; at most one over the precision."""
        if not len(self._factors):
            return 1.0
        gecon = sgecon if self._A.dtype == np.float32 else dgecon
        inverse = float(gecon(self._factors, self._norm)[0])
        return 1.0 / max(inverse, self.precision) if math.isfinite(inverse) else math.inf

    @property
    def negative(self) -> bool:
        """Whether the determinant of M is negative."""
        turned = sum(np.count_nonzero(np.linalg.det(of) < 0.0) for of in self._bases)
        if len(self._factors):
            turned += np.count_nonzero(self._factors.diagonal() < 0.0)
            turned += np.count_nonzero(self._pivots != np.arange(len(self._pivots)))
        return bool(turned % 2)

    def __call__(self, r: FloatArray) -> FloatArray:
        """M^-1 applied to r (m, 3) or (m, 3, columns)."""
        assert self._at is not None
        rest = _columns(r)
        z = self._G @ rest
        rest = rest - self._at.P @ z - self._at.Q @ self._product(z)
        return (z + self._solved(self._rows, self._free, rest, 1)).reshape(r.shape)

    def transposed(self, r: FloatArray) -> FloatArray:
        """M^-T applied likewise."""
        assert self._at is not None
        rest, (P, Q) = _columns(r), (of.transpose(0, 2, 1) for of in (self._at.P, self._at.Q))
        z = self._solved(self._free, self._rows, rest, 0)
        rest = rest - P @ z - self._product(Q @ z)
        return (z + self._G.transpose(0, 2, 1) @ rest).reshape(r.shape)

    def _product(self, z: FloatArray) -> FloatArray:
        """A z, of z (m, 3, columns), with what is added to A."""
        flat = z.reshape(-1, z.shape[2]).astype(self._A.dtype)
        return (self._A @ flat).astype(np.float64).reshape(z.shape) + self._extra[:, :, None] * z

    def _solved(self, of: FloatArray, into: FloatArray, r: FloatArray, trans: int) -> FloatArray:
        """By the inverse of the dense matrix (`trans` 1) or of its transpose, from rows to unknowns, (m, 3, 3)."""
        z: FloatArray = np.zeros_like(r)
        if len(self._factors):
            getrs = sgetrs if self._A.dtype == np.float32 else dgetrs
            right = (of @ r)[self._kept].astype(self._A.dtype)
            z[self._kept] = getrs(self._factors, self._pivots, right, trans=trans)[0]
        return into.transpose(0, 2, 1) @ z


def _columns(r: FloatArray) -> FloatArray:
    """(m, 3) or (m, 3, columns), also of a rank without contact points, as (m, 3, columns)."""
    return r.reshape(*r.shape[:2], math.prod(r.shape[2:]))
