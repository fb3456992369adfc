"""Table 1 of the paper: PF(r_tol, c_fact) and KPRGP on the Tresca block, all to the same final residual."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from coulomb.linalg.compliance import DirectSolver, SchurCompliance, estimated_diagonal
from coulomb.linalg.factors import MultifrontalSolver
from coulomb.model.problem import ContactProblem
from coulomb.solvers.friction_problem import Solver
from coulomb.solvers.interior_point import InteriorPoint
from coulomb.solvers.kprgp import KPRGP
from coulomb.solvers.newton_systems import AugmentedSystem
from coulomb.solvers.results import NotConverged

from .block import block

RESIDUAL = 1e-6
ESTIMATED = "PF(0.1,0.9) estimated diag(A)"
SIZES = (10, 12, 14, 16)

PAPER = {
    ("PF(0.3,0.99)", 10): "19/132",
    ("PF(0.1,0.9)", 10): "17/134",
    ("PF(0.01,0.99)", 10): "16/136",
    ("KPRGP", 10): "203",
    ("PF(0.3,0.99)", 12): "16/95",
    ("PF(0.1,0.9)", 12): "13/75",
    ("PF(0.01,0.99)", 12): "16/141",
    ("KPRGP", 12): "230",
    ("PF(0.3,0.99)", 14): "19/128",
    ("PF(0.1,0.9)", 14): "16/120",
    ("PF(0.01,0.99)", 14): "16/133",
    ("KPRGP", 14): "254",
    ("PF(0.3,0.99)", 16): "16/102",
    ("PF(0.1,0.9)", 16): "18/135",
    ("PF(0.01,0.99)", 16): "17/157",
    ("KPRGP", 16): "259",
}
"""Iterations / products as printed in the paper (KPRGP: products); its loads are not given, so only magnitudes can be
compared."""


def solvers() -> dict[str, Solver]:
    """The columns: PF(r_tol, c_fact) with this package's defaults, with the paper's P_AM alone, and KPRGP."""
    constants = ((0.3, 0.99), (0.1, 0.9), (0.01, 0.99))
    columns: dict[str, InteriorPoint] = {
        f"PF({r_tol:g},{c_fact:g})": InteriorPoint(tolerance=RESIDUAL, r_tol=r_tol, c_fact=c_fact)
        for r_tol, c_fact in constants
    }
    columns[ESTIMATED] = InteriorPoint(tolerance=RESIDUAL, r_tol=0.1, c_fact=0.9)
    for name in list(columns)[:3]:
        columns[f"{name} P_AM alone"] = replace(columns[name], newton=AugmentedSystem(rank=0))
    return columns | {"KPRGP": KPRGP(tolerance=RESIDUAL)}


class Row(NamedTuple):
    """A cell of the table and a row of table1.csv; m is the number of contact unknowns, as in the paper."""

    solver: str
    p: int
    n: int
    m: int
    iterations: int
    products: int
    seconds: float
    residual: float


def measure(sizes: Iterable[int] = SIZES, names: Iterable[str] | None = None) -> Iterator[Row]:
    """Rows as they are measured, A formed beforehand; `seconds` is the time of the solver.

    A solver that does not reach the residual gives a row with the residual that it reached.

    Raises:
        ValueError: If a solver's name is unknown.
    """
    columns = solvers()
    chosen = list(names or columns)
    unknown = [name for name in chosen if name not in columns]
    if unknown:
        raise ValueError(f"there is no solver {unknown[0]!r} in the table; it has {', '.join(columns)}")
    for p in sizes:
        problem = block(p, friction=None, linear_solver=DirectSolver, explicit=True)
        assert isinstance(problem.body.stiffness.solver, MultifrontalSolver)
        problem.body.stiffness.solver.use_double()  # the paper's methods have exact products
        qp = problem.friction_problem
        estimated = replace(qp, A=_with_estimated_diagonal(problem)) if ESTIMATED in chosen else qp
        for name in chosen:
            began = time.perf_counter()
            try:
                result = columns[name].solve(estimated if name == ESTIMATED else qp)
            except NotConverged as failure:
                result = failure.result
            seconds = time.perf_counter() - began
            n, m = problem.unknowns["displacement"], problem.unknowns["contact"]
            yield Row(name, p, n, m, len(result.history), result.products, seconds, result.residual)


def _with_estimated_diagonal(problem: ContactProblem) -> SchurCompliance:
    """The same A, with the estimated diagonal of a matrix-free A."""
    assert isinstance(problem.body.stiffness.solver, MultifrontalSolver)
    diagonal = estimated_diagonal(problem.A, problem.surface.free_B, problem.elasticity.reduced.diagonal).whole
    return SchurCompliance(problem.surface.free_B, problem.body.stiffness.solver, diagonal)
