"""A low-rank approximation of A from products already made, to precondition the steps to come.

Every Krylov iteration of a path-following step makes a pair (x, A x).  From pairs X, Y = A X follows Nyström's
approximation Y (X^T Y)^-1 Y^T <= A, U U^T once X^T A X = 1, and with D, the diagonal of the rest, an approximation of A
for the preconditioners,

    A ~ D - V V^T + U U^T,    D = diag(A - U U^T) > 0,    V = D X (X^T D X)^-1/2,

in place of the paper's diag(A).  It is symmetric positive definite, and on the span of X it is A itself, as D - V V^T
is zero there: what a Krylov method has found once, it need not find again.  (It is the block form of the update of
Broyden, Fletcher, Goldfarb and Shanno for D; S. Gratton, A. Sartenaer, J. Tshimanga: On a class of limited memory
preconditioners for large scale linear systems with multiple right-hand sides, SIAM J. Optim. 21, 2011.  D + U U^T,
without V, takes a quarter more products.) Inexact products show too small an A in some directions; there nine tenths of
D are replaced in path following (`replaced`), until the errors show, and the approximation is A plus a tenth of D. A is
the same in every step, only the nodal part of J changes: products of one step serve all later ones. A compliance is
well suited: its few large eigenvalues, the smooth motions of the body, are found first by a Krylov method and are not
in diag(A). (Z. Frangella, J. A. Tropp, M. Udell: Randomized Nyström preconditioning, SIAM J. Matrix Anal. Appl. 44,
2023, for U U^T and its bounds, there with random X.)

Kept for later solves with the same K are such pairs (`RecycledColumns`), and pairs of loads and displacements
(`LinearResponseCache`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ..reductions import Reductions, summed
from .krylov import NodalMap

MOST: Final = 4
"""Loads kept, each with its displacement: a load history seldom has more amplitudes that differ."""

_SAME: Final = 1e-14
"""A load with less than this part of it outside the kept ones is their combination."""

_NEW: Final = 0.03
"""A load with less than this part of it outside the kept ones is not kept: the part would have lost digits."""


class LinearResponseCache:
    """u(f) for a linear map of loads f to displacements u, solved once for each load that is no combination of others.

    In a load history the loads are a few patterns times amplitudes: after as many solves as there are patterns, K^-1 f
    is a sum of vectors.
    """

    def __init__(self, comm: MPI.Comm):
        self._over = Reductions(comm)
        self._loads: list[FloatArray] = []
        self._responses: list[FloatArray] = []

    def response(self, f: FloatArray, held: FloatArray, solve: Callable[[], FloatArray]) -> FloatArray:
        """The displacement under a load, both this rank's part; collective.

        `held` is what it contains besides, prescribed displacements that f determines, shape of u; `solve` computes it,
        linear in (f, held).
        """
        over, rest, sums = self._over, f.ravel().copy(), np.zeros((2, *held.shape))
        size = over.norm(rest)
        for _ in range(2):  # twice is enough against rounding errors
            for load, response in zip(self._loads, self._responses, strict=True):
                part = over.dot(load, rest)
                rest -= part * load
                sums += part * response
        left = over.norm(rest)
        fits = over.max(np.abs(sums[1] - held)) <= _SAME * over.max(np.abs(held))
        if self._loads and left <= _SAME * size and fits:
            return sums[0]
        u = solve()
        if len(self._loads) < MOST and left > _NEW * size:
            self._loads.append(rest / left)
            self._responses.append((np.array([u, held]) - sums) / left)
        return u


class RecycledColumns:
    """X and U = A X with X^T A X = 1, in the user's units: what `LowRankApproximation` has found of A.

    In a load history A is the same in all steps, except that the frames of the contact nodes turn.

    Attributes:
        X, U: Forces in newtons and displacements in metres, shape (3 m, r), this rank's rows; None if nothing is known.
        part: Size of A outside U over its diagonal, in (0, 1].
        prepared: What was made of them, which a later problem with the same A takes as it is; else None.
    """

    def __init__(self) -> None:
        self.X: FloatArray | None = None
        self.U: FloatArray | None = None
        self.part = 1.0
        self.prepared: object | None = None

    def keep(self, X: FloatArray, U: FloatArray, part: float, prepared: object | None = None) -> None:
        self.X, self.U, self.part, self.prepared = X, U, part, prepared

    def turned(self, turn: FloatArray) -> RecycledColumns:
        """The same for A' = T A T^T with T node by node, shape (m, 3, 3): U' = T U, X' = T^-T X."""
        after = RecycledColumns()
        if self.X is not None and self.U is not None:
            back = np.linalg.inv(turn).transpose(0, 2, 1) if len(turn) else turn
            X, U = (
                (by @ columns.reshape(len(turn), 3, columns.shape[1])).reshape(columns.shape)
                for by, columns in ((back, self.X), (turn, self.U))
            )
            after.keep(X, U, self.part)
        return after


_LEAST_REST: Final = 0.1  # of the diagonal: what is at least left of it beside the columns


def turned_diagonal(diagonal: FloatArray, learnt: RecycledColumns, turn: FloatArray) -> FloatArray:
    """diag(T A T^T) from diag(A) and what is known of A, both of shape (3 m,); T node by node, shape (m, 3, 3).

    Of A ~ diag(rest) + U U^T; exact for T = 1.
    """
    before, turned = diagonal.reshape(-1, 3), learnt.turned(turn)
    known, after = np.zeros_like(before), np.zeros_like(before)
    if learnt.U is not None and turned.U is not None:
        known, after = (np.sum(U**2, axis=1).reshape(-1, 3) for U in (learnt.U, turned.U))
        share = np.min((1.0 - _LEAST_REST) * before / np.where(known > 0.0, known, 1.0), axis=1, initial=1.0)
        known, after = share[:, None] * known, share[:, None] * after  # an estimate of the diagonal may be too small
    moved: FloatArray = np.einsum("iab,ib->ia", turn**2, before - known) + after
    return moved.ravel()


REPLACED: Final = 0.9
"""Part of D that is replaced on the span of inexact products in path following (inexact-products.csv)."""

_SEEN: Final = 0.5
"""Least part of the bound of the rest that is left where inexact products show that little of A is new; with all of it,
load steps of a half ring with eleven nodes in contact take twice the products (docs/measurements.md)."""

_LEAST: Final = 0.2  # of `local` that is left in the rest, as far as A is not yet in U
_RANK_DEFICIENT: Final = 1e-10  # eigenvalues below this part of the largest are rounding


class LowRankApproximation:
    """A as diag(rest) - V V^T + U U^T, from pairs (x, A x).

    Args:
        comm: The ranks of A.
        diagonal: diag(A) or an estimate of it, shape (m, 3), this rank's nodes.
        rank: Columns of U to keep, at most; 0 keeps diag(A).
        exact: Whether products are exact; only then is the part of A outside U measured from new pairs without a bound,
            and all of D replaced on the span of X: what inexact products show there of small A is their error, and
            without D a body on soft springs is not solved (tests/solvers/test_inexact_products.py).
        replaced: Part of D that is replaced there if products are not exact, at least 0 and below 1.
        known: Columns with which to begin; None if there are none; the same on all ranks, and then it is collective.
        rigid: Columns F of a part F F^T of A that is known exactly, shape (3 m, q), as of bodies on soft springs
            (`SoftMotions`): the rest is approximated, and F F^T added; None if there are none.
        local: An estimate of diag(A) without the few large eigenvalues of A, shape (m, 3); by default diag(A).

    Attributes:
        exact: The argument.
        rest: Shape (m, 3), positive.
        U: Shape (3 m, r), r <= rank.
        columns: U, V and F side by side, shape (3 m, s).
        signs: Of their products, 1 for U and F, -1 for V, shape (s,).
    """

    def __init__(
        self,
        comm: MPI.Comm,
        diagonal: FloatArray,
        rank: int,
        exact: bool,
        replaced: float = 0.0,
        known: RecycledColumns | None = None,
        rigid: FloatArray | None = None,
        local: FloatArray | None = None,
    ):
        self._comm, self._whole, self._rank, self.exact = comm, diagonal, rank, exact
        self._F: FloatArray = np.empty((diagonal.size, 0)) if rigid is None else rigid
        diagonal = diagonal - np.sum(self._F**2, axis=1).reshape(-1, 3) if self._F.shape[1] else diagonal
        self._diagonal: FloatArray = diagonal
        self._local = diagonal if local is None else local
        self._replaced = 1.0 if exact else replaced
        self._new: list[tuple[FloatArray, FloatArray]] = []
        self._X: FloatArray = np.empty((diagonal.size, 0))
        self._new_part = 1.0
        self.U: FloatArray = np.empty((diagonal.size, 0))
        self.columns: FloatArray = self._F
        self.signs: FloatArray = np.ones(self._F.shape[1])
        self.rest: FloatArray = diagonal
        self._weighted_gram: FloatArray | None = None
        if known is not None and known.X is not None and known.U is not None and rank > 0:
            self._X, self._new_part = known.X[:, :rank], known.part
            self._set(known.U[:, :rank])

    @property
    def learnt(self) -> RecycledColumns:
        known = RecycledColumns()
        if self.U.shape[1] > 0:
            known.keep(self._X, self.U, self._new_part)
        return known

    def fits(self, diagonal: FloatArray, rank: int, exact: bool) -> bool:
        """Whether it was made with these arguments; collective."""
        same = self._rank == rank and self.exact == exact and np.array_equal(self._whole, diagonal)
        return Reductions(self._comm).all(same)

    def forget_new(self) -> None:
        """Discard the products recorded since the last update."""
        self._new.clear()

    def replace_nothing(self) -> None:
        """Keep all of D from now on, if products are not exact: their errors have shown; collective."""
        if not self.exact and self._replaced > 0.0:
            self._replaced = 0.0
            self._set(self.U)

    def record(self, x: FloatArray, A_x: FloatArray) -> None:
        """Record a product, both (m, 3)."""
        if self._rank > 0:
            self._new.append((x.ravel().copy(), A_x.ravel().copy()))

    def update(self) -> None:
        """Bring U and the rest up to date with the recorded products; collective."""
        if not self._new:
            return
        X, Y = (np.column_stack(columns) for columns in zip(*self._new, strict=True))
        self._new.clear()
        if self._F.shape[1]:
            Y = Y - self._F @ summed(self._comm, self._F.T @ X)
        self._new_part = min(max(self._unknown(X, Y), 0.0 if self.exact else _SEEN), 1.0)
        X, Y = np.column_stack([self._X, X]), np.column_stack([self.U, Y])
        G = self._gram(X, X)
        size = np.sqrt(np.maximum(G.diagonal(), 1e-300))
        T = _inverse_root(G / np.outer(size, size)) / size[:, None]  # orthonormal X, ...
        X, Y = X @ T, Y @ T
        T = _inverse_root(self._gram(X, Y))  # ... then X^T A X = I, so that Nyström's is Y Y^T; truncated by its size
        X, Y = X @ T, Y @ T
        size, V = np.linalg.eigh(self._gram(Y, Y))
        V = np.ascontiguousarray(V[:, ::-1][:, : self._rank])  # of a reversed view products take ten times as long
        self._X = X @ V
        self._set(Y @ V)

    def _set(self, U: FloatArray) -> None:
        """U = A X, the rest and V; collective."""
        rest = self._diagonal - np.sum(U**2, axis=1).reshape(-1, 3)
        self.rest = np.maximum(rest, _LEAST * self._new_part * self._local)
        V: FloatArray = np.empty((len(U), 0))
        if self._replaced > 0.0:
            DX = self.rest.reshape(-1, 1) * self._X
            V = math.sqrt(self._replaced) * (DX @ _inverse_root(self._gram(self._X, DX)))
        self.columns = np.hstack([U, V, self._F])
        self.U = self.columns[:, : U.shape[1]]
        self.signs = np.repeat([1.0, -1.0, 1.0], [U.shape[1], V.shape[1], self._F.shape[1]])
        self._weighted_gram = None

    @property
    def weighted_gram(self) -> FloatArray:
        """C^T D^-1 C of the columns C, shape (s, s); collective after a change."""
        if self._weighted_gram is None:
            self._weighted_gram = self._gram(self.columns, self.weighted_columns)
        return self._weighted_gram

    @property
    def weighted_columns(self) -> FloatArray:
        """D^-1 C, shape (3 m, s); 0 in rows of A that are 0 as all of their displacements are prescribed."""
        D = self.rest.reshape(-1, 1)
        return np.divide(self.columns, D, out=np.zeros_like(self.columns), where=D > 0.0)

    def _unknown(self, X: FloatArray, Y: FloatArray) -> float:
        """Size of A on the new part of the pairs (X, Y) relative to diag(A); unchanged without a new part.

        Much less than 1 if diag(A) is dominated by a few motions: rigid motions of a body on soft springs.
        """
        known = summed(self._comm, self.U.T @ X)
        new, A_new = X - self._X @ known, Y - self.U @ known  # A-orthogonal to the range of U
        d = self._diagonal.reshape(-1, 1)
        sizes = [float(np.vdot(v, w)) for v, w in ((new, A_new), (new, d * new), (X, d * X))]
        size, diagonal, whole = summed(self._comm, np.array(sizes))
        return float(max(size / diagonal, 1e-4)) if diagonal > 1e-6 * whole else self._new_part

    def mult(self, x: FloatArray) -> FloatArray:
        """(diag(rest) - V V^T + U U^T + F F^T) x, shapes (m, 3); collective."""
        low_rank: FloatArray = self.columns @ (self.signs * summed(self._comm, self.columns.T @ x.ravel()))
        return self.rest * x + low_rank.reshape(x.shape)

    def nodal_columns(self, block: int, frictional: npt.NDArray[np.bool_]) -> FloatArray:
        """`columns`, shape (m, block, s), with zeros for the unknowns behind the three of x, and for friction except at
        the nodes `frictional`, shape (m,); not to be changed."""
        m, s = len(self._diagonal), self.columns.shape[1]
        nodal: FloatArray = self.columns.reshape(m, 3, s)
        if block == 3 and np.all(frictional):
            return nodal
        padded = np.zeros((m, block, s))
        padded[:, :3] = nodal
        padded[~frictional, 1:3] = 0.0
        return padded

    def _gram(self, X: FloatArray, Y: FloatArray) -> FloatArray:
        """X^T Y over all ranks, symmetrised."""
        G = summed(self._comm, X.T @ Y)
        return 0.5 * (G + G.T)


class LowRankUpdate:
    """(P0 + U S U^T)^-1 from P0^-1, by Woodbury's formula: P0^-1 - P0^-1 U (S + U^T P0^-1 U)^-1 U^T P0^-1, S = S^-1.

    `nodal_inverse` is P0^-1 on (m, block, ...), perhaps unsymmetric; U (m, block, r); `signs` (r,) the diagonal of S, 1
    or -1.
    """

    def __init__(self, comm: MPI.Comm, nodal_inverse: NodalMap, U: FloatArray, signs: FloatArray):
        self._comm, self._nodal_inverse = comm, nodal_inverse
        r = U.shape[2]
        self._U = U.reshape(U.shape[0] * U.shape[1], r)
        self._PU = nodal_inverse(U).reshape(self._U.shape)
        self._core: FloatArray = np.linalg.inv(np.diag(signs) + summed(comm, self._U.T @ self._PU))

    def __call__(self, r: FloatArray) -> FloatArray:
        """The inverse applied to r (m, block) or (m, block, columns); collective."""
        z = self._nodal_inverse(r)
        if self._U.shape[1] > 0:
            columns = z.reshape(len(self._U), *z.shape[2:])
            z -= (self._PU @ (self._core @ summed(self._comm, self._U.T @ columns))).reshape(z.shape)
        return z


def _inverse_root(G: FloatArray) -> FloatArray:
    """T with T^T G T = I on the range of the positive semidefinite G."""
    size, V = np.linalg.eigh(G)
    kept = size > _RANK_DEFICIENT * np.max(size, initial=0.0)  # of products with zeros nothing is left
    return V[:, kept] / np.sqrt(size[kept])
