"""Rigid motions of bodies that contact alone holds: unknowns alpha with their equilibrium equations G x = e.

With R the rigid motions that no support resists, u = K^+ (f - B^T x) + R alpha for a generalised inverse K^+ of the
stiffness, and with A = B K^+ B^T, G = R^T B^T, e = R^T f

    w = A x - b - G^T alpha,    G x = e

alpha is the Lagrange multiplier of the equilibrium of every body as a whole.  (TFETI treats floating bodies in the same
way: Z. Dostal, T. Kozubek, M. Sadowska, V. Vondrak: Scalable Algorithms for Contact Problems, Springer 2016.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions

NO_MOTION: FloatArray = np.empty(0)
"""alpha of a problem whose bodies are all held by supports."""

_FREE: Final = 1e-6
"""Singular values of G below this part of the largest belong to motions that contact does not resist."""


@dataclass(frozen=True, eq=False)
class RigidMotions:
    """Rigid motions, and the loads that contact forces have to balance along them.

    Attributes:
        G: Displacements of the contact nodes under unit motions, this rank's columns, shape (q, 3 m), node by node (n,
            t1, t2); metres per unit of alpha.  Measure rotations by the displacement at the radius of the body, so that
            all rows are of the same size.
        e: Resultants of the loads along the motions, shape (q,), the same on all ranks; newtons.
        names: One name per motion for messages, or none.
    """

    G: FloatArray
    e: FloatArray
    names: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of motions q."""
        return len(self.e)

    def displacement(self, alpha: FloatArray) -> FloatArray:
        """G^T alpha in metres, this rank's nodes, shape (3 m,)."""
        return alpha @ self.G

    def out_of_balance(self, x: FloatArray, over: Reductions) -> FloatArray:
        """e - G x in newtons, shape (q,), of forces x (3 m,) in newtons; collective."""
        return self.e - over.total(self.G @ x)

    def described(self, alpha: FloatArray) -> str:
        """The motions of alpha (q,) by name, the largest first, without those below a hundredth of it."""
        names = self.names or tuple(f"motion {k + 1}" for k in range(self.count))
        largest = float(np.abs(alpha).max())
        order = sorted(range(self.count), key=lambda k: -abs(alpha[k]))
        return ", ".join(f'{alpha[k]:.3g} "{names[k]}"' for k in order if abs(alpha[k]) >= 0.01 * largest)

    def validate(self, nodes: int, over: Reductions) -> None:
        """Check shapes and numbers; collective.

        Raises:
            ValueError: On every rank, if they do not fit a problem with this many contact nodes on this rank.
        """
        q = np.shape(self.e)
        must = f"rigid: e must have shape (q,) with q > 0 motions, but has {q}; without any use rigid=None"
        over.require(len(q) == 1 and q[0] > 0, must)
        must = f"rigid: G must have shape ({q[0]}, {3 * nodes}), one row per motion and three columns per contact node"
        over.require(np.shape(self.G) == (*q, 3 * nodes), f"{must}, but has {np.shape(self.G)}")
        for name, values in (("G", self.G), ("e", self.e)):
            over.require(np.all(np.isfinite(values)), f"rigid: {name} has entries that are not finite")
        same = np.array_equal(over.comm.bcast(self.e, root=0), self.e)
        over.require(same, "rigid: e differs between the ranks; it is the resultant of the loads on all of them")
        count = len(self.names)
        over.require(count in (0, *q), f"rigid: names must be one per motion ({q[0]}), or none, but are {count}")


@dataclass(frozen=True, eq=False)
class MotionBasis:
    """The motions that some of the contact unknowns resist, made orthonormal, and those that none of them does.

    Args:
        G: The rows on these unknowns, zero on the others, this rank's columns, shape (q, 3 m).
        over: Reductions over the ranks.

    Attributes:
        T: Shape (r, q).
        rows: T G, orthonormal, this rank's columns, shape (r, 3 m).
        free: Orthonormal motions without resistance, shape (q, q - r).
        size: The largest singular value of G; 1 if G is zero.
    """

    G: FloatArray
    over: Reductions

    @cached_property
    def _spectrum(self) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        squares, V = np.linalg.eigh(self.over.total(self.G @ self.G.T))
        return np.sqrt(np.maximum(squares, 0.0)), V, squares > _FREE**2 * max(squares[-1], 0.0)

    @cached_property
    def T(self) -> FloatArray:
        values, V, kept = self._spectrum
        return (V[:, kept] / values[kept]).T

    @cached_property
    def rows(self) -> FloatArray:
        return self.T @ self.G

    @cached_property
    def free(self) -> FloatArray:
        _, V, kept = self._spectrum
        return V[:, ~kept]

    @cached_property
    def size(self) -> float:
        return float(self._spectrum[0][-1]) or 1.0

    def amounts(self, displacement: FloatArray) -> FloatArray:
        """Of the motions that are nearest to a displacement (3 m,) in metres, shape (q,); collective."""
        return self.T.T @ self.over.total(self.rows @ displacement)

    def distance(self, out_of_balance: FloatArray) -> float:
        """Length of the smallest change of the forces that restores equilibrium, newtons.

        Along motions without resistance no change does: there the resultant itself is measured, as a nodal force.

        Args:
            out_of_balance: e - G x in newtons, shape (q,).
        """
        resisted, free = self.T @ out_of_balance, self.free.T @ out_of_balance / self.size
        return math.hypot(float(np.linalg.norm(resisted)), float(np.linalg.norm(free)))


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Whether contact can balance the loads of floating bodies.

    Attributes:
        exists: Whether contact forces within the bounds of friction balance the loads.
        x: Such forces in newtons, this rank's part, shape (3 m,); otherwise the nearest that were found.
        motion: The certificate if there are none, |alpha| = 1, shape (q,): loads do more work on this rigid motion than
            any contact forces within their bounds can resist.  Empty if they exist, or if it is not proven.
        direction: Its part that does not open the contact under pressure, |alpha| = 1, shape (q,): how the bodies slide
            or tip; the motion itself if it has no such part, as for a body that the loads lift.
        load: Work of the loads per length of `direction`, newtons.
        resistance: The most that contact forces resist it with, in equilibrium otherwise, newtons; less than `load`.
        proven: Whether this holds for all contact forces within the bounds of friction; otherwise for the pressures at
            which the iteration ended, while the bodies slid away: then there may be an answer that was not found.
    """

    exists: bool
    x: FloatArray
    motion: FloatArray = field(default_factory=lambda: np.empty(0))
    direction: FloatArray = field(default_factory=lambda: np.empty(0))
    load: float = 0.0
    resistance: float = 0.0
    proven: bool = True
