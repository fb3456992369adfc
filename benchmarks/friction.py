"""Coulomb friction on the block: methods compared over friction and size."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from coulomb.linalg.compliance import DirectSolver
from coulomb.solvers.friction_problem import FrictionProblem, Solver
from coulomb.solvers.interior_point import InteriorPoint
from coulomb.solvers.newton_systems import AugmentedSystem, DenseSystem
from coulomb.solvers.results import NotConverged
from coulomb.solvers.successive_tresca import SuccessiveTresca

from .block import block

FRICTION = (0.1, 0.3, 0.8, 1.5)
DENSE_UP_TO = 10
"""Cells per metre up to which the interior-point method is measured with dense Newton systems."""

TRESCA = "one Tresca problem"


def solvers(tolerance: float) -> dict[str, Solver]:
    """The methods: successive Tresca with every problem solved to full accuracy, with inner accuracy tied to the outer
    residual, and accelerated as well (its default); and the interior-point method on the whole problem."""
    return {
        "plain": SuccessiveTresca(tolerance, inner_precision=1e-12, memory=0, damping=1.0),
        "inexact": SuccessiveTresca(tolerance, memory=0, damping=1.0),
        "accelerated": SuccessiveTresca(tolerance),
        "interior-point": InteriorPoint(tolerance),
        "interior-point dense": InteriorPoint(tolerance, newton=DenseSystem()),
    }


class Row(NamedTuple):
    """A row of friction.csv."""

    method: str
    p: int
    friction: float
    outer: int
    path_following: int
    products: int
    krylov: int
    seconds: float
    residual: float
    status: str


def measure(sizes: Iterable[int], friction: Iterable[float], tolerance: float, repeats: int = 1) -> Iterator[Row]:
    """Rows as they are measured, A formed beforehand; `seconds` is the time of the solver, the minimum of the repeats.

    First of every size and friction, for comparison: one Tresca problem with the slip bounds of the answer, by PF with
    P_AM as in the paper.
    """
    for p in sizes:
        body = block(p, linear_solver=DirectSolver, explicit=True)
        for F in friction:
            problem = FrictionProblem.coulomb(body.A, body.b, np.full(len(body.surface.nodes), F))
            answer, seconds = _least(_tresca, problem, tolerance, repeats)
            krylov = sum(step.krylov for step in answer.history)
            status = answer.status.value
            yield Row(TRESCA, p, F, 0, answer.newton_steps, answer.products, krylov, seconds, answer.residual, status)
            for name, solver in solvers(tolerance).items():
                if name == "interior-point dense" and p > DENSE_UP_TO:
                    continue
                result, seconds = _least(_coulomb, problem, solver, repeats)
                yield Row(
                    method=name,
                    p=p,
                    friction=F,
                    outer=result.outer_steps,
                    path_following=result.newton_steps,
                    products=result.products,
                    krylov=sum(step.krylov for step in result.history),
                    seconds=seconds,
                    residual=result.residual,
                    status=result.status.value,
                )


def _least(
    prepare: Callable[[FrictionProblem, Any], Callable[[], Any]], problem: FrictionProblem, given: Any, repeats: int
) -> tuple[Any, float]:
    """The result, converged or not, and the minimum time."""
    solve, seconds = prepare(problem, given), []
    for _ in range(repeats):
        began = time.perf_counter()
        try:
            result = solve()
        except NotConverged as failure:
            result = failure.result
        seconds.append(time.perf_counter() - began)
    return result, min(seconds)


def _coulomb(problem: FrictionProblem, solver: Solver) -> Callable[[], Any]:
    return lambda: solver.solve(problem)


def _tresca(problem: FrictionProblem, tolerance: float) -> Callable[[], Any]:
    g = problem.slip_bound(InteriorPoint(tolerance).solve(problem).x)
    paper = InteriorPoint(tolerance, newton=AugmentedSystem(rank=0))
    return lambda: paper.solve(problem.with_slip_bound(g))
