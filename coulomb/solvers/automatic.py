"""The default solver: from given forces semismooth Newton, then the interior-point method, then successive Tresca."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import FloatArray
from .driver import Answer, result_of
from .equilibrium import EXACT
from .friction_problem import FrictionProblem, SolverSettings, Task
from .interior_point import InteriorPoint
from .results import Goal, NotConverged, ProgressCallback, QPStep, SemismoothStep, SolverResult, Status
from .semismooth_newton import SemismoothNewton
from .successive_tresca import OTHER_METHOD, SuccessiveTresca

FINISH: Final = SemismoothNewton(patience=3, refused=1e-4, finer=1.0, forcing=0.03, sharpest=0.01)
"""From the end of a path it takes one to five steps; the residual may grow in the first and fall in the second.  An
answer that the certificate refuses at 1e-4 of the tolerance, on soft springs, it refuses at rounding errors.  Steps to
0.1 do not always open the contact of a body that just touches, the forces of which are all errors of the path."""


_REACHED: Final = 1e-10
"""Residual to which the interior-point method comes in spite of rounding errors of the law; those of successive Tresca
problems, which it solves too, are not smaller."""

_SETTLED: Final = 1e-6
"""Change of a force in a further Newton step, over the largest on its body, up to which an answer is settled."""

_UNSETTLED: Final = 100.0
"""Changes of forces up to this multiple of what rounding errors of displacements are in them do not settle."""

_ACCEPTED: Final = 100.0
"""Changes of forces up to this multiple of these are left to the certificate, which says how much, as by products of
multigrid of bodies on soft springs; those above it are refused."""

_SETTLING: Final = replace(FINISH, sharpest=1e-5, settled=_SETTLED)

_FAR: Final = 2.0
"""Contact points more open than this multiple of the largest displacement without contact are far."""

_FARTHER: Final = 100.0
"""Factor of that distance where forces are at points that were taken as nearer than they are."""

DECISIVE = (Status.INTERRUPTED, Status.NO_EQUILIBRIUM)
"""Ends after which no other method is tried."""


@dataclass(frozen=True)
class Automatic(SolverSettings):
    """The interior-point method on the whole problem; if it fails and friction grows with pressure, successive Tresca.

    From an iterate of the interior-point method with a residual of 3e-3 the semismooth Newton method is tried, which
    takes fewer steps from there, and if it fails the path is followed further.

    From the forces of a load step before, the semismooth Newton method is tried first: it takes a third of the steps of
    the interior-point method, or ends after a few (warm-starts.csv).

    On the block the first needs a quarter of the products of the second, for all sizes and friction coefficients
    (`python -m benchmarks friction`).  Of random ill-conditioned problems, each solves some that the other does not.
    `SolverResult.method` records the choice.

    The start may be several forces, shape (c, 3 m): semismooth Newton takes the best, the other methods the first.  If
    no method converges, NotConverged has the better answer of the last two, and the messages of both.

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

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        """That of the problem in which far contact points are nearer, if none of them touches: an answer of both.

        The path has to leave the products of forces and gaps of far points behind: on a cylinder of 0.3 m under loads
        that move a part by 10 nm it took over 100 steps or ended, and takes 10 to 30 without these gaps.
        """
        over, b, made = problem.reductions, problem.b.reshape(-1, 3), 0
        most = 0.0 if problem.rigid is not None else _FAR * over.max(np.abs(np.maximum(b, [0.0, -np.inf, -np.inf])))
        while most > 0.0 and over.any(bool(np.any(b[:, 0] < -most))):
            nearer = np.zeros_like(b)
            nearer[:, 0] = np.maximum(-most - b[:, 0], 0.0)
            shift = nearer.ravel()
            gradient = None if task.gradient is None else task.gradient - shift
            result = self._followed(_closed(problem, shift), task._replace(gradient=gradient))
            made += result.newton_steps
            gradient = result.gradient + shift
            residual = problem.residual(result.x, gradient)
            right = result.status is Status.CONVERGED and residual <= task.goal.tolerance
            if right or result.status is Status.INTERRUPTED:
                multipliers = result.multipliers + nearer[:, :2]
                return replace(result, gradient=gradient, multipliers=multipliers, residual=residual, newton_steps=made)
            if result.status is not Status.CONVERGED:
                break
            most, task = _FARTHER * most, task._replace(start=result.x, gradient=gradient)
        result = self._followed(problem, task)
        return replace(result, newton_steps=made + result.newton_steps)

    def _followed(self, problem: FrictionProblem, task: Task) -> SolverResult:
        (goal, start, gradient, progress), over = task, problem.reductions
        first = replace(self.interior_point or InteriorPoint(finish=FINISH), tolerance=goal.tolerance)
        second = replace(self.successive_tresca or SuccessiveTresca(), tolerance=goal.tolerance)
        steps = 0

        def called(result: SolverResult, method: str) -> SolverResult:
            return replace(result, products=0, method=f"{self.name}: {method}")  # products by A are counted together

        alpha = open_motion(problem)
        if start is not None and problem.rigid is not None and not over.any(bool(np.any(start))):
            start = None  # without forces nothing says where rigid motions end
        if start is not None:
            near = SemismoothNewton(goal.tolerance)
            result = outcome(lambda: near.solve(problem, start, progress=progress))
            # Without forces a wedge that friction holds would be in equilibrium, too: a jump from the step before
            left = alpha is None or over.max(np.abs(result.x)) > _LEFT * over.max(np.abs(start))
            if result.status is Status.INTERRUPTED or (result.status is Status.CONVERGED and left):
                return called(result, near.name)
            steps, start = result.newton_steps, np.atleast_2d(start)[0]
        if alpha is not None:
            none, open_goal = Answer(np.zeros_like(problem.b), -problem.b, alpha), Goal(goal.tolerance, problem.accept)
            result = result_of(problem, open_goal, none, np.zeros((problem.A.nodes, 2)), None, ())
            if result.status is Status.CONVERGED:
                return called(replace(result, newton_steps=steps), "no forces")
        one = outcome(lambda: first.solve(problem, start, gradient=gradient, progress=progress))
        one = replace(one, newton_steps=steps + one.newton_steps)
        reached = one.residual <= max(goal.tolerance, _REACHED)
        if reached or one.status in (Status.CONVERGED, *DECISIVE) or not problem.sloped:
            return called(one, first.name)
        other = outcome(lambda: second.solve(problem, start, progress=progress))
        if other.status is Status.CONVERGED:
            other = replace(other, newton_steps=steps + other.newton_steps)
            return called(other, f"{second.name}, after the {first.name} method had {one.status.value}")
        better = min((one, other), key=lambda result: result.residual)
        message = f"{one.message}.  Then {other.message.removesuffix(OTHER_METHOD)}"
        return called(replace(better, message=message), f"{better.method}, the better of both")


def _closed(problem: FrictionProblem, shift: FloatArray) -> FrictionProblem:
    """The problem with gaps that are smaller by a shift (3 m,) in metres."""
    w = problem.balanced
    return replace(problem, b=problem.b + shift, balanced=None if w is None else lambda x: w(x) - shift)


def settled(
    problem: FrictionProblem,
    result: SolverResult,
    stiffness: FloatArray,
    tolerance: float,
    progress: ProgressCallback | None = None,
) -> SolverResult:
    """A result after Newton steps, until one leaves all forces as they are, where its residual does not say so; the
    result itself where rounding errors, as of thin sheets, or products of multigrid do not let them settle: how much
    is left is said by the certificate.

    Of a steel block on rubber diag(A) is that of the rubber.  Forces of neighbours that cancel in a facet of the rubber
    move the steel alone: of their errors the residual feels a part of 1/(a k), with the stiffness k of their nodes.
    Rounding errors of displacements d are errors of 2^-52 k d of these forces.

    Args:
        problem: The problem,
        result: with an answer that has converged.
        stiffness: Of the nodes of the contact points, newtons per metre, shape (m,).
        tolerance: Residual at which to stop.
        progress: Called after every step.

    Raises:
        NotConverged: If steps go on to change forces by more than 1e-4, and than 1e4 times their rounding errors.
    """
    hidden = problem.reductions.max(np.append(problem.scales.compliance[:, 0] * stiffness, 0.0))
    if not hidden * result.residual > _SETTLED:
        return result
    after = outcome(lambda: _SETTLING.solve(problem, result.x, tolerance=tolerance, progress=progress))
    steps = [step for step in after.history if isinstance(step, SemismoothStep)]
    before, first = [step for step in result.history if isinstance(step, QPStep)], result.newton_steps
    numbered = [replace(step, iteration=first + step.iteration) for step in steps]
    after = replace(
        after,
        method=result.method,
        outer_steps=result.outer_steps,
        newton_steps=first + len(steps),
        products=result.products + after.products,
        history=(*before, *numbered) if before or not result.history else result.history,
        contraction=result.contraction,
    )
    if after.status is Status.INTERRUPTED:
        return after
    if steps and after.status is Status.CONVERGED and steps[-1].moved <= _SETTLED:
        return replace(after, unsettled=steps[-1].moved)
    closed = np.abs(result.gradient + problem.b).reshape(-1, 3)
    rounding = problem.scales.moved(2.0**-52 * stiffness[:, None] * closed, result.x.reshape(-1, 3))
    moved, explained = steps[0].moved if steps else 0.0, max(_SETTLED, _UNSETTLED * rounding)
    if moved <= _ACCEPTED * explained:
        return replace(result, unsettled=moved) if steps else result
    message = (
        f"forces are unresolved: with a residual of {result.residual:.1e} one is wrong by about {moved:.1e} of the "
        "largest on its body, as where a body is far stiffer than the one it lies on"
    )
    raise NotConverged(message, replace(after, message=message))


def outcome(solve: Callable[[], SolverResult]) -> SolverResult:
    """The result of a method, whether it has converged or not."""
    try:
        return solve()
    except NotConverged as failure:
        return failure.result


# Bodies that contact alone holds and no load presses: where all contacts can be open, no forces are an answer.

_BALANCED: Final = 1e-12
"""Loads along the motions below this part of |b|/a are rounding errors."""

_OPEN: Final = 1e-9
"""Gap that is left open, over the largest |b|."""

_LEFT: Final = 1e-3
"""Forces that friction keeps without loads, over those of the start; smaller ones are rounding errors."""


def open_motion(problem: FrictionProblem) -> FloatArray | None:
    """Amounts alpha (q,) of the rigid motions, the smallest, with which all contact points are open; collective.

    None if supports hold all bodies, loads have to be balanced, nodes have cohesion, or there are no such amounts.
    """
    rigid, over, b = problem.rigid, problem.reductions, problem.b[0::3]
    if rigid is None or over.any(
        bool(np.any(problem.law.radius(np.zeros_like(b)) > 0.0) or np.any(np.asarray(problem.lower) != 0.0))
    ):
        return None
    largest = over.max(np.append(np.abs(problem.b), 0.0))
    if np.max(np.abs(rigid.e)) > _BALANCED * over.norm(problem.b) / problem.mean_diagonal or largest == 0.0:
        return None
    rows = over.comm.gather(np.column_stack([rigid.G[:, 0::3].T, -b / largest - _OPEN]))
    alpha = None
    if rows is not None:
        from scipy.optimize import linprog  # its import takes 0.2 s, and few runs need it

        whole = np.concatenate(rows)
        G, room = whole[:, :-1], whole[:, -1]
        programme = linprog(np.ones(2 * rigid.count), np.hstack([G, -G]), room, method="highs", options=EXACT)
        if programme.success:
            alpha = largest * (programme.x[: rigid.count] - programme.x[rigid.count :])
    return over.comm.bcast(alpha)
