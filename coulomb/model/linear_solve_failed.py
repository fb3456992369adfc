"""The error of a contact problem in which K u = f is not solved by multigrid."""

from __future__ import annotations

import numpy as np

from ..linalg.reductions import Reductions
from ..linalg.unsolved import Unsolved
from ..solvers.friction_problem import FrictionProblem
from ..solvers.results import NotConverged, Progress, ProgressCallback, SolverResult, Status
from ..solvers.rigid_motions import NO_MOTION
from .discrete_problem import DiscreteProblem


class LinearSolveFailed(NotConverged):
    """K u = f is not solved by multigrid: smaller load steps do not help."""


class CountedProgress:
    """The user's callback, if there is one, with the number of `steps` and whether it has `stopped` the solve."""

    def __init__(self, progress: ProgressCallback | None):
        self._progress, self.steps, self.stopped = progress, 0, False

    def __call__(self, progress: Progress) -> bool:
        self.steps += 1
        self.stopped = self._progress is not None and bool(self._progress(progress))
        return self.stopped


def linear_solve_failed(
    posed: DiscreteProblem, problem: FrictionProblem, failure: Unsolved, progress: CountedProgress, method: str
) -> LinearSolveFailed:
    """The error of a contact problem in which a solve with K failed, with the last iterate; collective."""
    A, rigid = problem.A.matrix_free, NO_MOTION if problem.rigid is None else np.zeros(problem.rigid.count)
    x, gradient, residual = np.zeros_like(problem.b), -problem.b, np.inf
    if A is not None and Reductions(posed.comm).all(A.latest is not None) and A.latest is not None:
        x, gradient = problem.completed(A.latest), A.latest_product() - problem.b
        if problem.rigid is not None:
            rigid = problem.rigid_motion(x, gradient)
            gradient = gradient - problem.rigid.displacement(rigid)
        residual = problem.residual(x, gradient)
    remedies = ['K factorised (linear_solver = "direct")', "better-shaped cells"]
    if posed.elasticity.ground is not None:
        remedies.append("stiffer springs, or a clamp, against rigid motions")
    reached = f", with a residual of {residual:.1e}" if np.isfinite(residual) else ""
    message = (
        f"{failure}; {posed.unknowns['displacement']} displacement unknowns, time {posed.time:g} s, after "
        f"{progress.steps} steps of the contact solver{reached}"
    )
    result = SolverResult(
        x=x,
        gradient=gradient,
        slip_bound=problem.slip_bound(x),
        multipliers=np.zeros((problem.A.nodes, 2)),
        status=Status.INTERRUPTED if progress.stopped else Status.STAGNATED,
        outer_steps=0,
        newton_steps=progress.steps,
        products=problem.A.products,
        residual=residual,
        history=(),
        method=method,
        message=message,
        rigid=rigid,
    )
    return LinearSolveFailed(f"{message}; what may help: {', or '.join(remedies)}", result)
