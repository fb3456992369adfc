"""The certificate of an answer to a contact problem."""

from __future__ import annotations

from ..arrays import FloatArray
from .certificate import Certificate, judge
from .problem import ContactProblem
from .state import Before


def certify(problem: ContactProblem, x: FloatArray, u: FloatArray, before: Before | None = None) -> Certificate:
    """Check an answer; collective.

    Args:
        problem: The contact problem.
        x: Contact forces in newtons, shape (3 m,), point by point (n, t1, t2).
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        before: State after the load step before, such as a `State`, from which slip is measured, moved with the
            foundation since; by default from the problem's `slip_origin`.
    """
    return judge(problem.evidence(x, u, before))
