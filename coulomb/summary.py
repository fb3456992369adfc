"""The numbers of an answer: what `summary.json` holds."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from .fem.body import Material
from .peak_memory import peak_memory
from .problem import ContactProblem
from .solution import Solution
from .solvers.reductions import Reductions
from .solvers.results import CoulombResult
from .version import __version__
from .versions import versions

OPEN, STICK, SLIP, HELD = 0, 1, 2, 3
"""Status of a node in contact.xdmf; HELD: on the contact face, but clamped, so no contact node (all fields 0)."""

OPEN_BELOW = 1e-6
"""A node is open if its normal force is at most this part of the greatest."""

SLIP_ABOVE = 0.999
"""A node slips if its friction is at least this part of its bound."""


def node_status(solution: Solution) -> npt.NDArray[np.int64]:
    """OPEN, STICK or SLIP of this rank's contact nodes, shape (m,)."""
    open_, slip = _open_and_slip(solution)
    return np.where(open_, OPEN, np.where(slip, SLIP, STICK))


def _open_and_slip(solution: Solution) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    over = Reductions(solution.problem.comm)
    x = solution.contact_force.reshape(-1, 3)
    open_ = x[:, 0] <= OPEN_BELOW * over.max(x[:, 0])
    slip = np.hypot(x[:, 1], x[:, 2]) >= SLIP_ABOVE * solution.problem.slip_bound(solution.contact_force)
    return open_, slip


def summary(solution: Solution) -> dict[str, Any]:
    """What `summary.json` holds; collective, the same on every rank."""
    problem, result = solution.problem, solution.result
    over, surface = Reductions(problem.comm), problem.surface
    x = solution.contact_force.reshape(-1, 3)
    on_body = -surface.vectors(x)
    coulomb = problem.coulomb
    open_, slip = _open_and_slip(solution)
    if coulomb:  # without pressure there is no friction; Tresca friction acts on open nodes too
        slip = slip & ~open_
        stick = ~slip & ~open_
    else:
        stick = ~slip
    history: Any = result.history
    krylov = sum(step.krylov for step in history)
    certificate, strain = solution.certificate, solution.small_strain
    spring_force = problem.elasticity.spring_force(solution.displacement)
    return {
        "coulomb": __version__,
        "status": result.status.value,
        "law": "coulomb" if coulomb else "tresca",
        "friction": _range(problem) if coulomb else None,
        "slip_stress": None if coulomb else _range(problem),
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
            "outer": result.iterations if coulomb else 0,
            "path_following": result.path_following if isinstance(result, CoulombResult) else result.iterations,
            "products": result.products,
            "krylov": krylov,
        },
        "force_on_body": {
            "normal": over.sum(x[:, 0]),
            "tangential": [-over.sum(x[:, 1]), -over.sum(x[:, 2])],
            "vector": [over.sum(on_body[:, k]) for k in range(3)],
        },
        "totals": totals(solution),
        "faces": [totals(solution, part) for part in range(len(surface.faces))],
        "small_strain": {**asdict(strain), "warnings": list(strain.warnings)},
        "spring_force_on_body": [over.sum(spring_force[:, k]) for k in range(3)],
        "nodes": {
            "contact": int(over.sum(float(len(x)))),
            "open": int(over.sum(open_.astype(float))),
            "stick": int(over.sum(stick.astype(float))),
            "slip": int(over.sum(slip.astype(float))),
        },
        "maximum": {
            "contact_pressure": over.max(x[:, 0] / surface.area),
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
    """What the contact does as a whole, or one of its faces; newtons and metres; collective, the same on every rank.

    Force and moment (about the origin) are those on the body.  The centre of pressure is the mean place of the normal
    forces, null without any.  Slip and dissipated energy count from `ContactProblem.slip_origin`.
    """
    problem, surface = solution.problem, solution.problem.surface
    here = surface.part == part if part is not None else np.ones(len(surface.nodes), dtype=bool)
    over, x = Reductions(problem.comm), solution.contact_force.reshape(-1, 3)
    on_body = -surface.vectors(x)[here]
    closed = ~_open_and_slip(solution)[0] & here
    slip = problem.closure(solution.displacement)[:, 1:]
    pressing = over.sum(x[here, 0])
    moving = np.hypot(slip[:, 0], slip[:, 1])
    centre = over.total(x[here, 0] @ surface.x[here]) / pressing if pressing > 0.0 else None
    return {
        "faces": list(surface.faces) if part is None else [surface.faces[part]],
        "force": over.total(on_body.sum(axis=0)).tolist(),
        "moment": over.total(np.cross(surface.x[here], on_body).sum(axis=0)).tolist(),
        "normal_force": pressing,
        "contact_area": over.sum(surface.area[closed]),
        "centre_of_pressure": None if centre is None else centre.tolist(),
        "greatest_slip": max(over.max(moving[closed]), 0.0),
        "greatest_pressure": over.max(x[here, 0] / surface.area[here]),
        "dissipated_energy": over.sum(np.sum((x[:, 1:] * slip)[here], axis=1)),
    }


def _materials(problem: ContactProblem) -> list[dict[str, Any]]:
    """The material of every group of cells; of the whole body, without a group."""
    given = problem.elasticity.materials
    groups = [(None, given)] if isinstance(given, Material) else list(given.items())
    return [{"cells": name, "young": material.young, "poisson": material.poisson} for name, material in groups]


def _range(problem: ContactProblem) -> float | dict[str, float]:
    """Friction or slip stress: a number, or its least and greatest value."""
    over = Reductions(problem.comm)
    least, greatest = over.min(problem.coefficient), over.max(problem.coefficient)
    return least if least == greatest else {"min": least, "max": greatest}
