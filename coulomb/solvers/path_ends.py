"""The ends of path following: problems without a path, and iterates from which another method is faster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from .friction_problem import FrictionProblem, Solver
from .results import Goal, NotConverged, Progress, ProgressCallback, QPStep, SolverResult, Status

_TRIES = 2
_LATER = 0.01  # residual of the second try over that of the first


def smallest(problem: FrictionProblem, goal: Goal, method: str) -> SolverResult | None:
    """The smallest feasible force, if it is the answer: then there is no path to follow."""
    x = problem.completed(problem.project(np.zeros_like(problem.b)))
    w = problem.without_motion(x) if problem.reductions.max(np.abs(x)) > 0.0 else -problem.b
    alpha = problem.rigid_motion(x, w)
    gradient = w if problem.rigid is None else w - problem.rigid.displacement(alpha)
    residual = problem.residual(x, gradient)
    if residual != 0.0 and not goal.reached(residual, x, alpha):  # with 0 there is no other answer, accepted or not
        return None
    status, nothing = goal.verdict(residual, x, Status.MAX_ITERATIONS, alpha), np.zeros((problem.A.nodes, 2))
    return SolverResult(
        x, gradient, problem.slip_bound(x), nothing, status, 0, 0, 0, residual, (), method=method, rigid=alpha
    )


class Finish:
    """Another method from an iterate near the answer.

    Path following converges slowly where a node is at the edge of its disc without slip: the residual falls like the
    square root of theta.  The semismooth Newton method does not need theta.

    Args:
        method: The method; None: there is none.
        below: Residual of the iterates from which it is tried.
        problem: The problem.
        goal: That of path following.
        progress: Called after every step.
        history: The steps so far; those of the method are appended.

    Attributes:
        converged: Whether the method has found the answer.
    """

    def __init__(
        self,
        method: Solver | None,
        below: float,
        problem: FrictionProblem,
        goal: Goal,
        progress: ProgressCallback | None,
        history: list[QPStep],
    ):
        self._method, self._below, self._problem, self._goal = method, below, problem, goal
        self._progress, self._history, self._left, self.converged = progress, history, _TRIES, False

    def wanted(self, residual: float) -> bool:
        """Whether to try it from an iterate with this residual, the same on all ranks.

        Not below the tolerance, and not if the certificate has refused an answer: only path following then has products
        of the accuracy that the certificate needs.
        """
        if self._method is None or self._left == 0 or self._goal.refused:
            return False
        return self._goal.tolerance < residual <= self._below

    def tried(self, x: FloatArray, gradient: FloatArray, name: str) -> SolverResult | None:
        """The result, if the method converges or is interrupted; collective.

        Args:
            x: Forces of the iterate in newtons, shape (3 m,).
            gradient: A x - b in metres, shape (3 m,), without rigid motions.
            name: Name of the solver, for the result.
        """
        assert self._method is not None
        first = len(self._history)
        self._left -= 1

        def reported(at: Progress) -> bool:
            later = Progress(at.outer, first + at.path_following, at.residual)
            return self._progress is not None and bool(self._progress(later))

        tolerance = self._goal.tolerance
        try:
            result = self._method.solve(self._problem, x, gradient=gradient, tolerance=tolerance, progress=reported)
        except NotConverged as failure:
            result = failure.result
        steps = (step for step in result.history if isinstance(step, QPStep))
        self._history += [replace(step, iteration=first + step.iteration) for step in steps]
        self.converged = result.status is Status.CONVERGED
        if self.converged or result.status is Status.INTERRUPTED:
            return replace(result, method=name)
        self._below *= _LATER
        return None
