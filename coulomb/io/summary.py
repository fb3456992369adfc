"""The contents of `summary.json` for one answer."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import (
    TEMPERATURE,
    AnyMaterial,
    Deformable,
    HeldDirections,
    Materials,
    OrthotropicMaterial,
    by_group,
    range_of,
)
from ..fem.geometry import of_place
from ..linalg.reductions import Reductions
from ..model.certificate import RESOLUTION, Certificate
from ..model.equilibrium import undetermined
from ..model.input_echo import contacts_of, ties_of
from ..model.nodal_answer import NodalAnswer
from ..model.resultants import ForceBalance
from ..model.solution import Solution
from ..process import peak_memory
from ..solvers.results import Status
from ..units import amount, used
from ..version import __version__
from .environment import versions
from .locking import remarks_on_locking

NOT_UNIQUE = "the equilibrium is not unique"
LOOK_AT_GAP = "check the foundation's position and normal, and the unit of the mesh (scale)"
"""Advice if no node is in contact."""


def summary(solution: Solution) -> dict[str, Any]:
    """Contents of `summary.json`; collective, the same on every rank."""
    problem, result = solution.problem, solution.result
    elasticity, u = problem.elasticity, solution.displacement
    history: Any = result.history
    krylov = sum(step.krylov for step in history)
    strain, forms, temperature = solution.small_strain, elasticity.forms(), problem.loading.temperature
    of_forms, of_temperature = dict[str, Any](), dict[str, Any]()
    if forms is not None:  # what is recorded of the user's forms, and what follows from them alone
        of_forms = {"forms": forms, "blocked_displacement": list(elasticity.blocked_displacements(problem.loading))}
    if temperature is not None:
        change = range_of(temperature.change, problem.comm)
        of_temperature = {"reference_temperature": temperature.reference, TEMPERATURE: change}
    return {
        "coulomb": __version__,
        "status": result.status.value,
        "valid": solution.valid,
        **({} if elasticity.slice is None else {"slice": elasticity.slice.entry()}),
        **derived(
            solution.at_nodes,
            solution.certificate,
            u,
            elasticity.spring_force(u),
            elasticity.held,
            solution.force_balance,
        ),
        "probes": [value.entry() for value in solution.probes],
        "understood": {
            "supports": elasticity.support_entries(),
            "contacts": contacts_of(problem),
            "chosen": list(problem.body.chosen),
            **({"ties": ties_of(problem)} if elasticity.constraints.every else {}),
        },
        "material": materials_of(elasticity),
        **of_temperature,
        **({} if solution.heat is None else {"heat": solution.heat.entry()}),
        **of_forms,
        "mean_compliance": solution.mean_compliance,
        "method": solution.methods,
        "residual": result.residual,
        "unsettled": result.unsettled,
        "contraction": result.contraction if result.outer_steps else None,
        "iterations": {
            "outer": result.outer_steps,
            "path_following": result.newton_steps,
            "products": result.products,
            "krylov": krylov,
        },
        "small_strain": {**strain.entry(), "accepted": problem.small_strain == "warn"},
        "remarks": remarks(solution),
        "units": {
            **{"length": used().length, "stress": used().stress},
            **{"force": used().name("N"), "moment": used().name("N m"), "energy": used().name("J")},
        },
        "versions": versions(),
        "seconds": dict(problem.seconds),
        "peak_memory_bytes": problem.comm.allreduce(peak_memory()),
    }


def derived(
    at_nodes: NodalAnswer,
    certificate: Certificate,
    displacement: FloatArray,
    spring_force: FloatArray,
    held: HeldDirections,
    acting: ForceBalance | None,
) -> dict[str, Any]:
    """The entries of summary.json that follow from displacement and forces; collective, the same on every rank.

    Displacement (metres) and forces of the springs on the body (newtons) are those of this rank's nodes, shape (k, 3);
    `acting` are resultants of loads and supports, None if they are unknown.
    """
    over, numbers = Reductions(at_nodes.comm), at_nodes.numbers()
    return {
        **numbers,
        "unknowns": {
            "displacement": int(over.sum(float(displacement.size - held.number))),
            "contact": 3 * numbers["nodes"]["contact"],
        },
        **(acting.entries() if acting is not None else {}),
        "forces_on_foundations": [
            {"face": face["faces"][0], **{name: [-value for value in face[name]] for name in ("force", "moment")}}
            for face in numbers["faces"]
            if "against" not in face
        ],
        "spring_force_on_body": [at_nodes.copies * over.sum(spring_force[:, k]) for k in range(3)],
        "maximum": {
            "contact_pressure": numbers["totals"]["greatest_pressure"],
            "displacement": over.max(np.linalg.norm(displacement, axis=1)),
            "penetration": certificate.penetration,
        },
        "certificate": certificate_numbers(certificate),
    }


def certificate_numbers(certificate: Certificate) -> dict[str, Any]:
    """Value, limit, unit and meaning of each condition, whether it holds, and whether all do."""
    checks = {
        check.name.replace(" ", "_"): {
            **{"value": check.value, "limit": check.limit, "passed": check.passed},
            **({"resolved": check.mark == "ok"} if check.name == RESOLUTION else {}),
            **{"unit": check.unit, "meaning": check.meaning},
        }
        for check in certificate.checks
    }
    return {**checks, "passed": certificate.passed}


def remarks(solution: Solution) -> list[str]:
    """Remarks on an answer, besides its certificate and strains; collective."""
    over, problem = Reductions(solution.problem.comm), solution.problem
    if solution.result.status is Status.NO_EQUILIBRIUM:  # nothing was solved
        return []
    motions = ", nor that ".join(undetermined(problem, solution.contact_force))
    unique = [f"{NOT_UNIQUE}: nothing resists that {motions}; one of many is given"] * bool(motions)
    if over.max(solution.contact_force[0::3]) > 0.0:
        return [*unique, *remarks_on_locking(solution)]
    least = over.min(problem.surface.gap - problem.relative_displacement(solution.change)[:, 0])
    if any(check.name == "penetration" and not check.passed for check in solution.certificate.checks):
        return [
            f"no contact forces were found, although contact nodes penetrate by up to {amount(-least)}: not the answer"
        ]
    least = max(least, 0.0)  # beyond rounding
    open_ = f"nothing touches: all contact nodes are open, the smallest gap is {amount(least)}; {LOOK_AT_GAP}"
    return [open_, *unique, *remarks_on_locking(solution)]


def material_entries(materials: Materials) -> list[dict[str, Any]]:
    """The material of every group of cells, or of the whole body."""
    return [_material_entry(name, material) for name, material in by_group(materials)]


def materials_of(body: Deformable) -> list[dict[str, Any]]:
    """The materials of all bodies; of several, cells are called "body" or "body:cells"."""
    materials = []
    for member in body.members:
        given = [] if member.body.materials is None else material_entries(member.body.materials)
        materials += [{**entry, "cells": member.called(entry["cells"])} for entry in given]
    return materials


def _material_entry(cells: str | None, material: AnyMaterial) -> dict[str, Any]:
    """A material in summary.json; what it does not have is left out."""
    entry: dict[str, Any] = {"cells": cells, "young": material.young, "poisson": material.poisson}
    if isinstance(material, OrthotropicMaterial):
        directions = ["function of place" if of_place(given) else given for given in material.directions]
        entry |= {"shear": material.shear, "directions": directions}
    given = {"density": material.density, "expansion": material.expansion}
    given |= {"conductivity": material.conductivity}
    entry |= {name: value for name, value in given.items() if value is not None}
    return {name: "function of place" if of_place(value) else _plain(value) for name, value in entry.items()}


def _plain(value: Any) -> Any:
    """Vectors as lists of numbers."""
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(one) for one in value]
    return float(value) if isinstance(value, np.floating) else value
