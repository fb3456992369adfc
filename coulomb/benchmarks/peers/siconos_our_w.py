"""Siconos' nonsmooth Newton method with W formed as coulomb forms A, by a Schur complement."""

from __future__ import annotations

from typing import Any

from ...arrays import FloatArray
from ...model.problem import ContactProblem
from .answer import Answer
from .siconos_newton import solve_with


def solve(p: int) -> Answer:
    """Iterations are Newton's."""
    return solve_with(p, _ours)


def _ours(problem: ContactProblem) -> FloatArray:
    A: Any = problem.A
    W: FloatArray = A.dense()
    return W
