"""Preconditioned conjugate gradients that start from the best combination of earlier solutions (Fischer 1998).

A solve makes a direction, from its start to its solution, and what K makes of it is the change of the residual: no
product is needed for it, nor for the residual of the next start.  (PETSc's KSPGuess takes three products for that in
every solve, which here has three or four in all, and forgets all directions but one when it has as many as it may
have.)  The combination minimises the norm of the residual; directions are replaced by newer ones in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Protocol

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ...native import kernels, threads
from ..reductions import Reductions, summed
from ..solve_errors import CGNotConverged
from .block_matrix import padded

_RECOMPUTED: Final = 1e-4
"""Tolerance below which the residual at the start is computed by a product, since images of directions are kept in
single precision."""

_ROUGH: Final = 1e-3
"""Rounding errors of products in single precision over the tolerance of a solve, at its start, below which its
iterations use them; at its end they may be ten times as large."""

_ALONE: Final = 50_000  # unknowns below which one thread takes less time than several

_DEPENDENT: Final = 1e-8  # part of the largest eigenvalue of the directions' Gram matrix below which they are dependent


class RoughProducts(Protocol):
    """K in single precision; vectors of this rank, padded."""

    def mult_roughly(self, x: FloatArray, y: FloatArray) -> None:
        """y <- K x; collective."""
        ...

    def rounding(self, x: FloatArray) -> float:
        """The square of this rank's part of a bound of the error of that product."""
        ...


class RecycledCG:
    """K u = rhs for many right-hand sides, by conjugate gradients; vectors of this rank, `size` unknowns, padded.

    A solve to a few digits only, not the first, uses products in single precision, which read half as much, where their
    rounding errors are small beside its tolerance.

    Args:
        mult: (x, y): y <- K x; collective.
        precondition: r -> an approximation of K^-1 r, symmetric positive definite, to be read before the next;
            collective; it may correct rounding errors of r.
        directions: Directions kept, at most.
        limit: Iterations of a solve, at most.
        rough: Products in single precision; None if there are none.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        size: int,
        mult: Callable[[FloatArray, FloatArray], None],
        precondition: Callable[[FloatArray], FloatArray],
        directions: int = 20,
        limit: int = 1000,
        rough: RoughProducts | None = None,
    ):
        self._comm, self._over, self._limit = comm, Reductions(comm), limit
        self._mult, self._precondition, self._rough = mult, precondition, rough
        self._r, self._p, self._image, self._moved = (padded(size) for _ in range(4))
        self._directions = np.empty((directions, size))
        self._images = np.empty((directions, size), dtype=np.float32)
        self._gram: FloatArray = np.zeros((directions, directions))
        self._count, self._next = 0, 0
        self._threads, self._length = threads() if size >= _ALONE else 1, size

    def solve(self, rhs: FloatArray, u: FloatArray, tolerance: float, most: float = math.inf) -> int:
        """u <- K^-1 rhs to |rhs - K u| <= tolerance |rhs|; the number of iterations; collective.

        Raises:
            CGNotConverged: On every rank, if the limit or `most` iterations were reached, or K or the preconditioner is
                not positive definite.
        """
        size = self._norm(rhs)
        self._start(rhs, u, size)
        if tolerance < _RECOMPUTED:
            self._recompute(rhs, u)
        left, rounding = self._sizes(self._r, u)
        rough = self._rough is not None and self._count > 0 and tolerance >= _RECOMPUTED
        rough = rough and rounding <= _ROUGH * tolerance * size
        limit = math.ceil(min(self._limit, most))
        iterations = self._iterate(left, size, tolerance, rough, u, limit)
        if iterations > 0:
            u += self._moved
            np.subtract(rhs, self._r, out=self._image)
            image, rounding = self._sizes(self._image, u)
            if rough and rounding > 10.0 * _ROUGH * tolerance * size:
                self._recompute(rhs, u)
                iterations += self._iterate(self._norm(self._r), size, tolerance, False, u, limit)
                u += self._moved
                np.subtract(rhs, self._r, out=self._image)
                image = self._norm(self._image)
            self._remember(u, image)
        return iterations

    def _recompute(self, rhs: FloatArray, u: FloatArray) -> None:
        self._p[:] = u
        self._mult(self._p, self._image)
        np.subtract(rhs, self._image, out=self._r)

    def _sizes(self, r: FloatArray, u: FloatArray) -> tuple[float, float]:
        """|r|, and a bound of the rounding errors of a product in single precision by u."""
        rounding = 0.0 if self._rough is None else self._rough.rounding(u)
        square, rounding = summed(self._comm, np.array([float(r @ r), rounding]))
        return math.sqrt(square), math.sqrt(rounding)

    def _start(self, rhs: FloatArray, u: FloatArray, size: float) -> None:
        """u <- the best combination of the directions, r <- its residual."""
        self._r[:] = rhs
        k = self._count
        if k == 0 or size == 0.0:
            u[:] = 0.0
            return
        products = self._projected(rhs) / size
        sizes, V = np.linalg.eigh(self._gram[:k, :k])
        kept = sizes > _DEPENDENT * sizes[-1]
        c = V[:, kept] @ ((V[:, kept].T @ products) / sizes[kept])
        factors = np.ascontiguousarray(size * c)
        kernels().combine(self._length, self._threads, k, factors, self._directions, self._images, u, self._r)

    def _projected(self, r: FloatArray) -> FloatArray:
        """The inner products of r with the images of all ranks, shape (count,)."""
        products = np.empty(self._count)
        kernels().project(self._length, self._threads, self._count, self._images, r, products)
        return summed(self._comm, products)

    def _iterate(self, left: float, size: float, tolerance: float, rough: bool, u: FloatArray, limit: int) -> int:
        """moved <- K^-1 r approximately, r, whose norm is `left`, <- the residual that is left, at most tolerance size.

        Raises:
            CGNotConverged: If that is not reached; u <- u + moved.
        """
        r, p, image = self._r, self._p, self._image
        mult = self._rough.mult_roughly if rough and self._rough is not None else self._mult
        self._moved[:] = 0.0
        before, goal = 0.0, tolerance * size
        for iteration in range(limit + 1):
            if left <= goal:
                return iteration
            if iteration == limit:
                break
            z = self._precondition(r)
            product = self._dot(r, z)
            if iteration == 0:
                p[:] = z
            else:
                kernels().next_direction(self._length, self._threads, product / before, z, p)
            mult(p, image)
            curvature = self._dot(p, image)
            if rough and not curvature > 0.0:  # rounding errors of a motion that is hardly held
                rough, mult = False, self._mult
                mult(p, image)
                curvature = self._dot(p, image)
            if not (product > 0.0 and curvature > 0.0):  # or NaN
                break
            step = product / curvature
            square = kernels().advance(self._length, self._threads, step, p, image, self._moved, r)
            left, before = math.sqrt(self._over.sum(square)), product
        if math.isfinite(self._norm(self._moved)):
            u += self._moved
        raise CGNotConverged(iteration, left / size if size > 0.0 else math.inf, tolerance, iteration < limit)

    def _remember(self, u: FloatArray, size: float) -> None:
        """A solution and its image, which has this norm, in place of the oldest one."""
        scale = 1.0 / size
        k, most = self._next, len(self._directions)
        into = self._directions[k], self._images[k]
        kernels().keep(self._length, self._threads, scale, u, self._image, *into)
        self._count, self._next = max(self._count, k + 1), (k + 1) % most
        of_new = scale * self._projected(self._image)
        self._gram[k, : self._count] = self._gram[: self._count, k] = of_new

    def _dot(self, a: FloatArray, b: FloatArray) -> float:
        return self._over.sum(float(a @ b))

    def _norm(self, a: FloatArray) -> float:
        return math.sqrt(self._dot(a, a))
