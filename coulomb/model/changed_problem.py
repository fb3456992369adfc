"""Problems near to that of an answer, of the same nodes and contact points."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..linalg.reductions import Reductions
from .discrete_problem import DiscreteProblem

_NEAR: Final = 0.1
"""Distance of the nodes of near problems over the size of the bodies."""


def near(answer: DiscreteProblem, problem: DiscreteProblem) -> DiscreteProblem:
    """A problem at the time of an answer, after the same load step; collective.

    Raises:
        ValueError: On every rank, if its nodes or contact points are others than those of the answer, or far from them.
    """
    over = Reductions(answer.comm)
    x, there = answer.elasticity.x, problem.elasticity.x
    unknowns = [of.elasticity.reduction.points.shape for of in (answer, problem)]
    if over.any(x.shape != there.shape or unknowns[0] != unknowns[1]):
        raise ValueError("between: the problem has other nodes than that of the answer")
    size, apart = max(over.max(axis) - over.min(axis) for axis in x.T), over.max(np.abs(there - x).ravel())
    if apart > _NEAR * size:
        raise ValueError(
            f"between: nodes are up to {apart:g} m from those of the answer: they are numbered otherwise, or the "
            "problems are not near to each other"
        )
    if problem.time != answer.time or problem.before is not answer.before:
        at = problem.body.at_time(answer.time)
        problem = problem.in_state(at.state(answer.time, answer.before), None, answer.before, at)
    points = [(of.nodes, of.part) for of in (answer.surface, problem.surface)]
    if over.any(not all(np.array_equal(*of) for of in zip(*points, strict=True))):
        raise ValueError("between: the problem has other contact points than that of the answer")
    return problem
