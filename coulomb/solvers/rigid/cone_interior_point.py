"""Coulomb friction where A is a matrix without full rank: stacks of rigid bodies, redundant contacts, large friction.

Sweeps of Gauss-Seidel's method first, as many as promise to be quicker than what follows (gauss_seidel.py).  Then four
methods in turn (cone_run.py), on the same Newton matrices W + nodal blocks (newton_matrix.py), in the variables of
cone_problem.py:

1. nonsmooth Newton steps on the natural map from there, for as long as each of them helps; where few contacts change
   their state this is all;
2. the interior-point path (cone_path.py) until the natural map is small, then nonsmooth Newton steps from there: they
   end in a solution to rounding accuracy, also where forces are not unique or contacts are at the edge between two
   states, where the path alone would come no nearer than the square root of rounding errors;
3. where the path ends elsewhere: the curve of smoothed problems (cone_curve.py), with Newton steps as after the path;
   it turns where the path is blocked;
4. convex problems with given slip, s <- |Z_t(s)|, with Anderson acceleration and Newton steps after each.  The slip of
   each is unique whatever the rank of A, unlike the forces on which successive Tresca iterates.  Where they fail,
   another curve, and at last sweeps again.

Proved: a fixed point of the slip is a solution; the curve has one at its end, in general position and if forces stay
bounded.  Not proved: that the path leads to one, that the fixed point attracts, or how long the curve is.  CONVERGED
means that the natural residual, computed afresh, is below the tolerance, and the collection's own as well
(cones.cone_residual).

Work is limited by counts, not by time, so that a result can be repeated: floating-point operations of the
factorisations with an estimate for the rest, and sweeps.  The first curve, the convex problems, and the last sweeps
spend at most half of what is left when they begin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...linalg.compliance import MatrixCompliance
from ..friction_problem import FrictionProblem
from ..results import Goal, ProgressCallback, SolverResult
from ..settings import SolverSettings, within
from .cone_problem import ConeProblem, Scales
from .cone_run import ConeRun, Limits
from .gauss_seidel import Sweeps, swept


@dataclass(frozen=True)
class ConeInteriorPoint(SolverSettings):
    """The method as a value; for Coulomb's law without cohesion, A given as a matrix, and one rank.

    Attributes:
        tolerance: Residual at which to stop, the larger of `FrictionProblem.residual` and `cones.cone_residual`.
        sweeps: Gauss-Seidel sweeps; whether they come first, and last.
        newton: Nonsmooth Newton steps in a row.
        path: Steps of the interior-point path.
        curve: Steps along a curve of smoothed problems; half as many before the convex problems, all on another curve
            after them.
        convex: Convex problems with given slip.
        proximal: Proximal term of the nonsmooth Newton matrix, over the mean diagonal of A and the size of the natural
            map.
        work: Floating-point operations of all factorisations, and of what takes as long; an estimate.
        systems: Their number.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    sweeps: bool = True
    newton: int = within("[1, inf)", 12)
    path: int = within("[1, inf)", 80)
    curve: int = within("[0, inf)", 500)
    convex: int = within("[0, inf)", 40)
    proximal: float = within("(0, inf)", 0.1)
    work: float = within("(0, inf)", 2e11)
    systems: int = within("[1, inf)", 3000)

    name = "cone interior point"

    def suits(self, problem: FrictionProblem) -> bool:
        """Whether it can solve the problem: Coulomb's law on one rank, A a matrix."""
        law, lower = problem.law, np.asarray(problem.lower)
        return (
            isinstance(problem.A, MatrixCompliance)
            and problem.A.comm.size == 1
            and problem.rigid is None
            and not np.any(law.cohesion)
            and not np.any(lower)
        )

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """Solve a problem with friction; arguments and errors as those of `Solver.solve`.

        Raises:
            ValueError: If the problem does not suit the method (`suits`).
            NotConverged: With the best answer; with the status NO_EQUILIBRIUM if no forces keep the contacts from
                penetrating.
        """
        if not (self.suits(problem) and isinstance(problem.A, MatrixCompliance)):
            raise ValueError(
                f"the {self.name} method is for Coulomb's law without cohesion, lower bounds and rigid motions, with A "
                "as a matrix on one rank; use Automatic()"
            )
        tolerance = self.tolerance if tolerance is None else tolerance
        first = None if start is None else np.ascontiguousarray(start, dtype=np.float64)
        sweeps = swept(problem.A.sparse(), problem.b, problem.law.friction, tolerance, first) if self.sweeps else None
        return self.after(problem, sweeps, start, tolerance=tolerance, progress=progress)

    def after(
        self,
        problem: FrictionProblem,
        sweeps: Sweeps | None,
        start: FloatArray | None = None,
        *,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """As `solve`, after some sweeps for a problem that suits the method, from `start` if there were none."""
        assert isinstance(problem.A, MatrixCompliance)
        goal = Goal(self.tolerance if tolerance is None else tolerance, problem.accept)
        if sweeps is not None and goal.reached(sweeps.residual, sweeps.x):
            return sweeps.result(self.name, goal)
        A, scales = problem.A.sparse(), Scales.of(problem)
        limits = Limits(
            self.name, self.newton, self.path, self.curve, self.convex, self.proximal, self.work, self.systems
        )
        run = ConeRun(limits, problem, ConeProblem(problem, A, scales), scales, goal, progress)
        return run.follow(start, sweeps)
