"""Displacements under loads that are combinations of earlier ones, without a solve."""

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


class KeptResponses:
    """u(f) for a linear map of loads f to displacements u, solved once for each load that is no combination of others.

    In a load history the loads are a few patterns times amplitudes: after as many solves as there are patterns, K^-1 f
    is a sum of vectors.

    Args:
        comm: The ranks.
    """

    def __init__(self, comm: MPI.Comm):
        self._over = Reductions(comm)
        self._loads: list[FloatArray] = []
        self._responses: list[FloatArray] = []

    def response(self, f: FloatArray, held: FloatArray, solve: Callable[[], FloatArray]) -> FloatArray:
        """The displacement under a load; collective.

        Args:
            f: The load, this rank's part, any shape.
            held: What the displacement contains besides, prescribed displacements that f determines; shape of u.
            solve: Computes the displacement, linear in (f, held).
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
            kept: FloatArray = sums[0]
            return kept
        u = solve()
        if len(self._loads) < MOST and left > _NEW * size:
            self._loads.append(rest / left)
            self._responses.append((np.array([u, held]) - sums) / left)
        return u
