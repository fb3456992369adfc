"""Every contact of a matrix problem in units of force of its own, in which all have the same compliance.

With x = D y, w = D^-1 v, D a positive number for each contact, the same along n, t1 and t2:

    v = (D A D) y - D b - (G D)^T alpha,   y_n >= lower/D,   |y_t| <= c/D + F y_n,   (G D) y = e

The problem in y and v is the one in x and w: F is the same, only cohesion, lower bounds and rigid motions have factors.
Solvers have one scale for all contacts; where compliances are decades apart, D makes it that of each.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...linalg.compliance import MatrixCompliance
from ..friction_problem import FrictionProblem, Task
from ..results import SolverResult
from .cones import Scales

_ALIKE: Final = 10.0
"""Compliances of contacts up to this factor apart need no units of their own."""


class OwnUnits(NamedTuple):
    """A problem with a matrix A, and the unit of force of each of its contacts over the common one.

    Attributes:
        given: The problem as given.
        units: D, powers of two, so that no rounding errors are made; shape (3 m,).
    """

    given: FrictionProblem
    units: FloatArray

    @classmethod
    def of(cls, problem: FrictionProblem) -> OwnUnits | None:
        """None where the compliances of all contacts are alike, or one has none; collective."""
        over, d = problem.reductions, problem.A.diagonal().reshape(-1, 3)
        own = d.sum(axis=1) / np.maximum(np.count_nonzero(d, axis=1), 1)
        least, most = over.min(own), over.max(own)
        if not (isinstance(problem.A, MatrixCompliance) and _ALIKE * least < most < np.inf and least > 0.0):
            return None
        return cls(problem, np.repeat(np.exp2(np.round(0.5 * np.log2(problem.mean_diagonal / own))), 3))

    def problem(self, tolerance: float) -> FrictionProblem:
        """The problem in these units; answers have a residual within the tolerance in the given ones, too."""
        given, D = self.given, self.units
        assert isinstance(given.A, MatrixCompliance)
        matrix = given.A.matrix.duplicate(copy=True)
        factors = matrix.createVecLeft()
        factors.array[:] = D
        matrix.diagonalScale(factors, factors)
        factors.destroy()
        law = given.law.scaled(D[::3])
        rigid = given.rigid and replace(given.rigid, G=given.rigid.G * D)
        lower = given.lower if np.ndim(given.lower) == 0 and not given.lower else given.lower / D[::3]

        proportional = given.law.proportional and given.rigid is None and not np.any(given.lower)
        scales = Scales.of(given) if proportional and given.reductions.comm.size == 1 else None

        def accept(y: FloatArray, alpha: FloatArray | None = None) -> bool:
            x, a = D * y, given.mean_diagonal
            if (
                not given.law.natural_residual(x, given.gradient(x, alpha), a, given.reductions, given.lower)
                <= tolerance
            ):
                return False
            if scales is not None and not scales.of_collection(given, x, given.gradient(x)) <= tolerance:
                return False
            return given.accept is None or (given.accept(x) if given.rigid is None else given.accept(x, alpha))

        b, elastic = D * given.b, given.elastic
        return FrictionProblem(MatrixCompliance(matrix), b, law, lower, accept, rigid=rigid, elastic=elastic)

    def task(self, task: Task) -> Task:
        """A task in these units."""
        start = None if task.start is None else task.start / self.units
        return task._replace(start=start, gradient=None if task.gradient is None else task.gradient * self.units)

    def result(self, scaled: SolverResult) -> SolverResult:
        """A result in these units as one of the problem given; its residual is that in these units."""
        D = self.units[::3]
        return replace(
            scaled,
            x=self.units * scaled.x,
            gradient=scaled.gradient / self.units,
            slip_bound=D * scaled.slip_bound,
            multipliers=scaled.multipliers / D[:, None],
        )
