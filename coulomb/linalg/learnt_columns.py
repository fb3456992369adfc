"""Pairs X, A X that the Krylov methods of earlier problems with the same A have found, kept beside it."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray


class LearntColumns:
    """X and U = A X with X^T A X = 1, in the user's units: what `LowRankApproximation` has found of A.

    In a load history A is the same in all steps, except that the frames of the contact nodes turn.

    Attributes:
        X: Forces in newtons, shape (3 m, r), this rank's rows; None as long as nothing is known.
        U: Displacements in metres, shape (3 m, r).
        part: Size of A outside U over its diagonal, in (0, 1].
    """

    def __init__(self) -> None:
        self.X: FloatArray | None = None
        self.U: FloatArray | None = None
        self.part = 1.0

    def keep(self, X: FloatArray, U: FloatArray, part: float) -> None:
        """Replace what is known."""
        self.X, self.U, self.part = X, U, part

    def turned(self, turn: FloatArray) -> LearntColumns:
        """The same for A' = T A T^T with T node by node, shape (m, 3, 3): U' = T U, X' = T^-T X."""
        after = LearntColumns()
        if self.X is not None and self.U is not None:
            back = np.linalg.inv(turn).transpose(0, 2, 1) if len(turn) else turn
            X, U = (
                (by @ columns.reshape(len(turn), 3, -1)).reshape(columns.shape)
                for by, columns in ((back, self.X), (turn, self.U))
            )
            after.keep(X, U, self.part)
        return after
