"""The default for Coulomb friction: what the measurements favour, and the other way where that fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..arrays import FloatArray
from .friction_problem import FrictionProblem
from .one_loop import OneLoop
from .path_following import PathFollowing
from .results import CoulombResult, NotConverged, ProgressCallback, Status, check_constants
from .successive_tresca import SuccessiveTresca


@dataclass(frozen=True)
class Automatic:
    """The one loop; and where it does not get there, successive Tresca.

    On the block the one loop needs a quarter of the products of successive Tresca, whatever size and friction
    (`coulomb benchmark friction`).  Of random problems made to be hard, each solves some that the other does not.
    `CoulombResult.method` says which it was.

    Attributes:
        tolerance: Coulomb residual at which to stop.

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
        *,
        start: FloatArray | None = None,
        progress: ProgressCallback | None = None,
    ) -> CoulombResult:
        """Solve a Coulomb problem.

        Args:
            problem: The problem.
            start: Forces in newtons, shape (3 m,), of a nearby problem, for both ways.
            progress: Called after every step.

        Raises:
            NotConverged: With the better answer of the two, and what both have to say, if neither gets there.
        """
        products = problem.A.products
        try:
            return _chosen(OneLoop(self.tolerance).solve(problem, start=start, progress=progress), "one loop")
        except NotConverged as failure:
            assert isinstance(failure.result, CoulombResult)
            first = failure.result
            if first.status is Status.INTERRUPTED or first.residual <= self.tolerance:  # no other way would help
                raise NotConverged(str(failure), _chosen(first, "one loop")) from None
        try:
            result = SuccessiveTresca(self.tolerance).solve(problem, start=start, progress=progress)
        except NotConverged as failure:
            assert isinstance(failure.result, CoulombResult)
            second = failure.result
            better = min((first, second), key=lambda result: result.residual)
            message = f"{first.message}.  Then {second.message}"
            both = replace(better, products=problem.A.products - products, message=message)
            raise NotConverged(message, _chosen(both, f"{better.method}, the better of both")) from None
        result = replace(result, products=problem.A.products - products)
        return _chosen(result, f"successive Tresca, after the one loop had {first.status.value}")


def _chosen(result: CoulombResult, choice: str) -> CoulombResult:
    return replace(result, method=f"auto: {choice}")


def default_solver(problem: FrictionProblem, tolerance: float) -> Automatic | PathFollowing:
    """What solves a problem where nothing else is asked for; collective.

    Where no friction grows with pressure, Algorithm PF: it is the minimum of a convex function.  Else `Automatic`.

    Args:
        problem: The problem.
        tolerance: Residual at which to stop.
    """
    return Automatic(tolerance) if problem.sloped else PathFollowing(tolerance=tolerance)
