"""The default solver: the interior-point method, and successive Tresca if it fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..arrays import FloatArray
from .friction_problem import FrictionProblem
from .interior_point import InteriorPoint
from .results import NotConverged, ProgressCallback, SolverResult, Status, check_constants
from .successive_tresca import SuccessiveTresca


@dataclass(frozen=True)
class Automatic:
    """The interior-point method on the whole problem; if it fails and friction grows with pressure, successive Tresca.

    On the block the first needs a quarter of the products of the second, for all sizes and friction coefficients
    (`coulomb benchmark friction`).  Of random ill-conditioned problems, each solves some that the other does not.
    `SolverResult.method` records the choice.

    Attributes:
        tolerance: Residual at which to stop.

    Raises:
        ValueError: If the tolerance is not positive.
    """

    tolerance: float = 1e-8

    name = "auto"

    def __post_init__(self) -> None:
        check_constants(self, (("tolerance", self.tolerance > 0.0, "> 0"),))

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """Solve a problem with friction; arguments and errors as those of `Solver.solve`, `start` for both methods.

        Raises:
            NotConverged: With the better answer of the two, and the messages of both, if neither converges.
        """
        products, tolerance = problem.A.products, self.tolerance if tolerance is None else tolerance
        first, second = InteriorPoint(tolerance), SuccessiveTresca(tolerance)
        try:
            return _chosen(first.solve(problem, start, gradient=gradient, progress=progress), first.name)
        except NotConverged as failure:
            one = failure.result
            if (
                one.status in (Status.INTERRUPTED, Status.NO_EQUILIBRIUM)
                or one.residual <= tolerance
                or not problem.sloped
            ):
                raise NotConverged(str(failure), _chosen(one, first.name)) from None
        try:
            other = second.solve(problem, start, progress=progress)
        except NotConverged as failure:
            better = min((one, failure.result), key=lambda result: result.residual)
            message = f"{one.message}.  Then {failure.result.message}"
            both = replace(better, products=problem.A.products - products, message=message)
            raise NotConverged(message, _chosen(both, f"{better.method}, the better of both")) from None
        other = replace(other, products=problem.A.products - products)
        return _chosen(other, f"{second.name}, after the {first.name} method had {one.status.value}")


def _chosen(result: SolverResult, choice: str) -> SolverResult:
    return replace(result, method=f"auto: {choice}")
