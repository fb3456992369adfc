"""The loop that all methods have in common: a step, judge the answer, go on or stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from ..arrays import FloatArray
from .friction_problem import FrictionProblem
from .results import Goal, OuterStep, Progress, ProgressCallback, QPStep, SolverResult, Status
from .rigid_motions import NO_MOTION

Record_co = TypeVar("Record_co", bound=QPStep | OuterStep, covariant=True)


class Answer(NamedTuple):
    """Forces (3 m,) in newtons, A x - b (3 m,) in metres, without rigid motions, and the rigid motions (q,)."""

    x: FloatArray
    without: FloatArray
    rigid: FloatArray = NO_MOTION


class Iteration(Protocol[Record_co]):
    """A method at an iterate; every call is collective."""

    def step(self) -> Record_co | None:
        """One step; its record has the residual of the new answer, computed with the most accurate product where that
        decides.  None if no step can be made."""
        ...

    def answer(self) -> Answer:
        """The present one."""
        ...

    def stop(self) -> Status | None:
        """Why no further step would help, or None."""
        ...


def drive(
    method: Iteration[Record_co],
    goal: Goal,
    history: list[Record_co],
    most: int,
    progress: ProgressCallback | None = None,
    start: float = math.inf,
) -> Status | None:
    """Steps of a method, at most `most`, until the goal is reached: None; else why they have ended.

    Args:
        method: At its start.
        goal: What is wanted.
        history: The record of the steps, which is continued.
        most: Largest number of steps.
        progress: Called after every step.
        start: Residual of the start, if that may be the answer.
    """

    def reached(residual: float) -> bool:
        if not residual <= goal.residual:
            return False
        x, _, rigid = method.answer()
        return goal.reached(residual, x, rigid)

    if reached(start):
        return None
    for _ in range(most):
        record = method.step()
        if record is None:
            return Status.STAGNATED
        history.append(record)
        status = reached(record.residual)
        stop = progress is not None and bool(progress(Progress(0, len(history), record.residual)))
        if status:
            return None
        if stop:
            return Status.INTERRUPTED
        ended = method.stop()
        if ended is not None:
            return ended
    return Status.MAX_ITERATIONS


def result_of(
    problem: FrictionProblem,
    goal: Goal,
    answer: Answer,
    multipliers: FloatArray | None,
    status: Status | None,
    history: Sequence[QPStep],
    measure: Callable[[FloatArray, FloatArray], float] | None = None,
) -> SolverResult:
    """The result of a method that ends with an answer of the most accurate product, judged afresh, by the residual of
    the problem or another measure of x and its gradient; with the shortest rigid motions, and multipliers (m, 2) in
    metres, by default gaps and slips; collective."""
    x, gradient, motion = answer
    if problem.rigid is not None:
        motion = problem.shortest_motion(x, gradient, motion)
        gradient = gradient - problem.rigid.displacement(motion)
    residual, w = (measure or problem.residual)(x, gradient), gradient.reshape(-1, 3)
    return SolverResult(
        x=x,
        gradient=gradient,
        slip_bound=problem.slip_bound(x),
        multipliers=np.column_stack([w[:, 0], np.hypot(w[:, 1], w[:, 2])]) if multipliers is None else multipliers,
        status=goal.verdict(residual, x, status or Status.STAGNATED, motion),
        newton_steps=len(history),
        residual=residual,
        history=tuple(history),
        rigid=motion,
    )
