"""Coulomb friction by successive Tresca problems: g <- F x_n, until the Coulomb problem's own residual says so."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import FloatArray
from .coulomb import CoulombProblem
from .path_following import PathFollowing
from .reductions import Reductions
from .results import (
    CoulombResult,
    NotConverged,
    OuterStep,
    Progress,
    ProgressCallback,
    QPResult,
    Status,
    check_constants,
    verdict,
)
from .tresca import QPSolver


@dataclass(frozen=True)
class SuccessiveTresca:
    """Fixed point g <- F x_n(g), started without friction; every Tresca problem starts from the last answer.

    Attributes:
        tolerance: Coulomb residual at which to stop.
        qp_solver: Solver of the Tresca problems.
        inner_precision: Residual asked of a Tresca problem, as a part of the last Coulomb residual, in (0, 1).
        max_iterations: Tresca problems before the solver gives up.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    tolerance: float = 1e-8
    qp_solver: QPSolver = field(default_factory=PathFollowing)
    inner_precision: float = 1e-2
    max_iterations: int = 60

    def __post_init__(self) -> None:
        bounds = (
            ("tolerance", self.tolerance > 0.0, "> 0"),
            ("inner_precision", 0.0 < self.inner_precision < 1.0, "in (0, 1)"),
            ("max_iterations", self.max_iterations >= 1, "at least 1"),
        )
        check_constants(self, bounds)

    def solve(self, problem: CoulombProblem, *, progress: ProgressCallback | None = None) -> CoulombResult:
        """Solve a Coulomb problem.

        Returns:
            The answer, its Coulomb residual at most the tolerance.

        Raises:
            NotConverged: With the last answer, if the Coulomb residual stays above the tolerance.
        """
        over, A = problem.reductions, problem.A
        products = A.products
        g = np.zeros_like(problem.friction)
        last: QPResult | None = None
        residual, change = 1.0, math.nan
        history: list[OuterStep] = []
        status, message = Status.MAX_ITERATIONS, ""
        for iteration in range(1, self.max_iterations + 1):
            began, before = time.perf_counter(), A.products
            inner = min(max(self.inner_precision * residual, 0.1 * self.tolerance), 1e-2)
            warm = last is not None

            def report(p: Progress, outer: int = iteration) -> None:
                if progress is not None:
                    progress(replace(p, outer=outer))

            try:
                last = self.qp_solver.solve(problem.tresca(g), last, tolerance=inner, progress=report)
            except NotConverged as failure:
                assert isinstance(failure.result, QPResult)
                last, status, message = failure.result, Status.STAGNATED, f"; {failure}"
            wanted = problem.slip_bound(last.x)
            residual = problem.residual(last.x, last.gradient)
            size = over.norm(wanted)
            old_change, change = change, over.norm(wanted - g) / size if size > 0.0 else 0.0
            history.append(
                OuterStep(
                    iteration=iteration,
                    residual=residual,
                    change=change,
                    contraction=change / old_change if old_change > 0.0 and iteration > 2 else math.nan,
                    inner_tolerance=inner,
                    path_following=last.iterations,
                    products=A.products - before,
                    krylov=sum(step.krylov for step in last.history),
                    warm=warm,
                    seconds=time.perf_counter() - began,
                )
            )
            if residual <= self.tolerance or message:
                break
            g = self._without_dust(wanted, g, over)
        assert last is not None
        residual = problem.residual(last.x)
        result = CoulombResult(
            x=last.x,
            gradient=last.gradient,
            slip_bound=g,
            status=verdict(residual, self.tolerance, status),
            contraction=_contraction(history),
            iterations=len(history),
            path_following=sum(step.path_following for step in history),
            products=A.products - products,
            residual=residual,
            history=tuple(history),
        )
        if result.status is not Status.CONVERGED:
            raise NotConverged(
                f"successive Tresca ended with a Coulomb residual of {residual:.1e} after {len(history)} Tresca "
                f"problems ({result.status.value}), above the tolerance {self.tolerance:.1e}; "
                f"the slip bound changes by a factor {result.contraction:.2g} a step" + message,
                result,
            )
        return result

    def _without_dust(self, wanted: FloatArray, g: FloatArray, over: Reductions) -> FloatArray:
        """The next slip bound: nodes that carry next to nothing get none, and keep it while that stays so.

        A node that opens leaves x_n of the size of the tolerance, of no meaning.  Its friction would be dust, its disc
        a point.  A node dropped must come back ten times stronger: nodes going in and out make a cycle of their own.
        """
        dust = 1e-2 * self.tolerance * over.max(wanted)
        return np.where(wanted > np.where(g > 0.0, dust, 10.0 * dust), wanted, 0.0)


def _contraction(history: list[OuterStep]) -> float:
    """Geometric mean of the last three measured rates; nan if there is none."""
    rates = [step.contraction for step in history if step.contraction > 0.0][-3:]
    return math.exp(sum(map(math.log, rates)) / len(rates)) if rates else math.nan
