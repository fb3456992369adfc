"""The numbers of an answer: what `summary.json` holds."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from .fem.body import Material
from .nodal_answer import NodalAnswer
from .peak_memory import peak_memory
from .problem import ContactProblem
from .solution import Solution
from .solvers.reductions import Reductions
from .solvers.results import CoulombResult
from .version import __version__
from .versions import versions


def node_status(solution: Solution) -> npt.NDArray[np.int64]:
    """OPEN, STICK or SLIP of this rank's contact nodes, shape (m,); collective."""
    return NodalAnswer.of(solution).status


def summary(solution: Solution) -> dict[str, Any]:
    """What `summary.json` holds; collective, the same on every rank."""
    problem, result = solution.problem, solution.result
    over, at_nodes = Reductions(problem.comm), NodalAnswer.of(solution)
    history: Any = result.history
    krylov = sum(step.krylov for step in history)
    certificate, strain = solution.certificate, solution.small_strain
    spring_force = problem.elasticity.spring_force(solution.displacement)
    return {
        "coulomb": __version__,
        "status": result.status.value,
        **at_nodes.numbers(),
        "material": _materials(problem),
        "mean_compliance": problem.mean_compliance,
        "unknowns": problem.unknowns,
        "method": {
            "solver": result.method if isinstance(result, CoulombResult) else "path following",
            "stiffness": problem.stiffness_solver.name,
            "compliance": problem.A.name,
            "ranks": problem.comm.size,
        },
        "residual": result.residual,
        "contraction": result.contraction if isinstance(result, CoulombResult) else None,
        "iterations": {
            "outer": result.iterations if problem.coulomb else 0,
            "path_following": result.path_following if isinstance(result, CoulombResult) else result.iterations,
            "products": result.products,
            "krylov": krylov,
        },
        "small_strain": {**asdict(strain), "warnings": list(strain.warnings)},
        "spring_force_on_body": [over.sum(spring_force[:, k]) for k in range(3)],
        "maximum": {
            "contact_pressure": at_nodes.totals()["greatest_pressure"],
            "displacement": over.max(np.linalg.norm(solution.displacement, axis=1)),
            "penetration": certificate.penetration,
        },
        "certificate": {
            **{
                check.name.replace(" ", "_"): {
                    **{"value": check.value, "limit": check.limit, "passed": check.passed},
                    **{"unit": check.unit, "meaning": check.meaning},
                }
                for check in certificate.checks
            },
            "passed": certificate.passed,
        },
        "versions": versions(),
        "seconds": dict(problem.seconds),
        "peak_memory_bytes": problem.comm.allreduce(peak_memory()),
    }


def totals(solution: Solution, part: int | None = None) -> dict[str, Any]:
    """What the contact does as a whole, or one of its faces: `NodalAnswer.totals`; collective."""
    return NodalAnswer.of(solution).totals(part)


def _materials(problem: ContactProblem) -> list[dict[str, Any]]:
    """The material of every group of cells; of the whole body, without a group."""
    given = problem.elasticity.materials
    groups = [(None, given)] if isinstance(given, Material) else list(given.items())
    return [{"cells": name, "young": material.young, "poisson": material.poisson} for name, material in groups]
