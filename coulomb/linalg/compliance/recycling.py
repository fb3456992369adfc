"""Krylov recycling: pairs of loads and displacements, and of X and A X, that earlier solves have found, kept for later
ones with the same K."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ..reductions import Reductions

MOST = 4
"""Loads kept, each with its displacement: a load history seldom has more amplitudes that differ."""

_SAME = 1e-14
"""A load with less than this part of it outside the kept ones is their combination."""

_NEW = 0.03
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


_LEAST_REST = 0.1  # of the diagonal: what is at least left of it beside the columns


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
