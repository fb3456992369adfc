"""How attempts at a load step of large motions end without an answer."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..fem.geometry import Refused
from ..linalg.factors import NotPositiveDefinite
from ..linalg.solve_errors import CGNotConverged
from ..solvers.results import NotConverged, SolverResult, Status

FAILURES: Final = (CGNotConverged, NotPositiveDefinite, Refused, NotConverged)
"""By which an attempt ends."""


class StepCut(NotConverged):
    """A load step has no answer: why, in words."""


def refuse_interrupted(failure: Exception) -> None:
    """Raise a failure after which there is no other attempt."""
    if isinstance(failure, NotConverged) and failure.result.status is Status.INTERRUPTED:
        raise failure


def without_answer(count: int) -> SolverResult:
    """The result of a step without an answer, of so many contact points on this rank."""
    none = np.zeros(3 * count)
    return SolverResult(none, none, np.zeros(count), np.zeros((count, 2)), Status.STAGNATED, np.inf)
