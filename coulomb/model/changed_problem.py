"""Problems near to that of an answer, of the same nodes and contact points."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import FloatArray
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
    size, apart = float(np.max(over.extent(x))), over.max(np.abs(there - x).ravel())
    if apart > _NEAR * size:
        raise ValueError(
            f"between: nodes are up to {apart:g} m from those of the answer: they are numbered otherwise, or the "
            "problems are not near to each other"
        )
    if problem.time != answer.time or problem.before is not answer.before:
        body = problem.body.at_time(answer.time)
        problem = problem.in_state(body.state(answer.time, answer.before), None, answer.before, body)
    points = [(of.nodes, of.part) for of in (answer.surface, problem.surface)]
    if over.any(not all(np.array_equal(*of) for of in zip(*points, strict=True))):
        raise ValueError("between: the problem has other contact points than that of the answer")
    _refuse_noise(answer, problem, _LOST * size)
    return problem


_LOST: Final = 1e-13
"""Change of distances from a foundation over the size of the bodies, above which gaps change as well."""


def _refuse_noise(answer: DiscreteProblem, problem: DiscreteProblem, least: float) -> None:
    """ValueError on every rank if the problem's distances from a foundation are others by more than `least` metres, but
    are taken for rounding errors of coordinates (`without_noise`): no gap changes."""
    over = Reductions(answer.comm)
    for part, (face, *foundations) in enumerate(
        zip(answer.surface.faces, answer.surface.foundations, problem.surface.foundations, strict=True)
    ):
        here, distances = answer.surface.part == part, list[FloatArray]()
        for of, foundation in zip((answer, problem), foundations, strict=True):
            if foundation is not None and np.any(here):
                distances.append(foundation.signed_distance(of.surface.x[here]))
        change = over.max(np.abs(np.subtract(*distances))) if len(distances) == 2 else over.max(np.zeros(0))
        if change > least and over.max(np.abs(problem.surface.gap - answer.surface.gap)[here]) == 0.0:
            raise ValueError(
                f"between: distances of {face!r} from its foundation change by up to {change:.1g} m, which counts as "
                "rounding errors of coordinates: take a larger change"
            )
