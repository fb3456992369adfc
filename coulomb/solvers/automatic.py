"""The default solver: from given forces semismooth Newton, then the interior-point method, then successive Tresca."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from .friction_problem import FrictionProblem, SolverSettings
from .interior_point import InteriorPoint
from .results import NotConverged, ProgressCallback, SolverResult, Status
from .semismooth_newton import SemismoothNewton
from .successive_tresca import SuccessiveTresca

_FINISH = SemismoothNewton(patience=3, refused=1e-4, finer=1.0, sharpest=0.01)
"""From the end of a path it takes one to five steps; the residual may grow in the first and fall in the second.  An
answer that the certificate refuses at 1e-4 of the tolerance, on soft springs, it refuses at rounding errors."""


DECISIVE = (Status.INTERRUPTED, Status.NO_EQUILIBRIUM)
"""Ends after which no other method is tried."""


@dataclass(frozen=True)
class Automatic(SolverSettings):
    """The interior-point method on the whole problem; if it fails and friction grows with pressure, successive Tresca.

    From an iterate of the interior-point method with a residual of 3e-4 the semismooth Newton method is tried, which
    takes fewer steps from there, and if it fails the path is followed further.

    From the forces of a load step before, the semismooth Newton method is tried first: it takes a third of the steps of
    the interior-point method, or ends after a few (`docs/measurements.md`).

    On the block the first needs a quarter of the products of the second, for all sizes and friction coefficients
    (`python -m benchmarks friction`).  Of random ill-conditioned problems, each solves some that the other does not.
    `SolverResult.method` records the choice.

    Attributes:
        tolerance: Residual at which to stop.
        interior_point: Replaces the settings of the interior-point method, except its tolerance.
        successive_tresca: Likewise.

    Raises:
        ValueError: If the tolerance is not positive.
    """

    interior_point: InteriorPoint | None = None
    successive_tresca: SuccessiveTresca | None = None

    name = "auto"

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """Solve a problem with friction; arguments and errors as those of `Solver.solve`, `start` for all methods.

        `start` may be several forces, shape (c, 3 m): semismooth Newton takes the best, the other methods the first.

        Raises:
            NotConverged: With the better answer of the two, and the messages of both, if neither converges.
        """
        products, tolerance = problem.A.products, self.tolerance if tolerance is None else tolerance
        first = replace(self.interior_point or InteriorPoint(finish=_FINISH), tolerance=tolerance)
        second = replace(self.successive_tresca or SuccessiveTresca(), tolerance=tolerance)
        tried: SolverResult | None = None
        if start is not None:
            near = SemismoothNewton(tolerance)
            try:
                return named(near.solve(problem, start, progress=progress), near.name)
            except NotConverged as failure:
                tried = failure.result
                if tried.status is Status.INTERRUPTED:
                    raise NotConverged(str(failure), named(tried, near.name)) from None
            start = np.atleast_2d(start)[0]
        try:
            result = first.solve(problem, start, gradient=gradient, progress=progress)
            return named(_after(tried, result), first.name)
        except NotConverged as failure:
            one = _after(tried, failure.result)
            if one.status in DECISIVE or one.residual <= tolerance or not problem.sloped:
                raise NotConverged(str(failure), named(one, first.name)) from None
        try:
            other = second.solve(problem, start, progress=progress)
        except NotConverged as failure:
            better = min((one, failure.result), key=lambda result: result.residual)
            message = f"{one.message}.  Then {failure.result.message}"
            both = replace(better, products=problem.A.products - products, message=message)
            raise NotConverged(message, named(both, f"{better.method}, the better of both")) from None
        other = replace(_after(tried, other), products=problem.A.products - products)
        return named(other, f"{second.name}, after the {first.name} method had {one.status.value}")


def _after(tried: SolverResult | None, result: SolverResult) -> SolverResult:
    """A result with the steps and products of another method that was tried before."""
    if tried is None:
        return result
    steps, products = tried.newton_steps + result.newton_steps, tried.products + result.products
    return replace(result, newton_steps=steps, products=products)


def named(result: SolverResult, choice: str = "", products: int = 0) -> SolverResult:
    """A result as that of an automatic choice, after this many products in all; by default of the method it names."""
    own = choice or result.method
    method = own if own.startswith(f"{Automatic.name}: ") else f"{Automatic.name}: {own}"
    return replace(result, method=method, products=max(products, result.products))
