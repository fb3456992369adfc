"""Results on disk: XDMF fields, summary, history, picture; and the numbers in the summary."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from .arrays import FloatArray
from .fem import compat
from .fem.body import Material
from .fem.compat import fem
from .problem import ContactProblem, Solution
from .solvers.reductions import Reductions
from .solvers.results import CoulombResult, OuterStep, QPStep
from .version import __version__

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
    certificate = solution.certificate
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
                check.name.replace(" ", "_"): {"value": check.value, "limit": check.limit, "passed": check.passed}
                for check in certificate.checks
            },
            "passed": certificate.passed,
        },
        "seconds": dict(problem.seconds),
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


def write(solution: Solution, directory: str | Path, picture: bool = True) -> dict[str, Any]:
    """Write everything into a directory; files already there are replaced only when all new ones are complete.

    Args:
        solution: What to write, converged or not.
        directory: Made if need be.
        picture: Whether to draw picture.png.

    Returns:
        The summary, with the seconds of the output added.

    Raises:
        OSError: On every rank, if the directory cannot be written to.
    """
    comm, problem, began = solution.problem.comm, solution.problem, time.perf_counter()
    target = Path(directory)
    partial = Path(_on_rank_0(comm, lambda: _make_partial(target)))
    try:
        _write_body(solution, str(partial / "solution.xdmf"))
        _write_contact(solution, str(partial / "contact.xdmf"))
        contents = summary(solution)

        def finish() -> str:
            for name in ("solution.xdmf", "contact.xdmf"):
                _one_grid(partial / name)
            _write_history(solution.result.history, partial / "history.csv")
            contents["seconds"]["output"] = time.perf_counter() - began
            contents["picture"] = "not asked for"
            _write_json(contents, partial / "summary.json")
            if picture:
                drawing = time.perf_counter()
                contents["picture"] = _draw(partial) or "picture.png"
                contents["seconds"]["picture"] = time.perf_counter() - drawing
                _write_json(contents, partial / "summary.json")
            for file in sorted(partial.iterdir()):
                os.replace(file, target / file.name)
            return json.dumps(contents)

        contents = dict(json.loads(_on_rank_0(comm, finish)))
    finally:
        comm.barrier()
        if comm.rank == 0:
            shutil.rmtree(partial, ignore_errors=True)
    problem.seconds.update(contents["seconds"])
    return contents


def _on_rank_0(comm: MPI.Comm, action: Callable[[], str]) -> str:
    """Result of an action of rank 0 on every rank; its OSError is raised on every rank."""
    result: str = ""
    fault: OSError | None = None
    if comm.rank == 0:
        try:
            result = action()
        except OSError as error:
            fault = error
    result, fault = comm.bcast((result, fault))
    if fault is not None:
        raise fault
    return result


def _make_partial(target: Path) -> str:
    target.mkdir(parents=True, exist_ok=True)
    return tempfile.mkdtemp(prefix=".partial-", dir=target)


def _write_body(solution: Solution, path: str) -> None:
    elasticity = solution.problem.elasticity
    u = elasticity.function(solution.displacement)
    given = {"load": elasticity.load, "held": elasticity.fixed, "prescribed": elasticity.prescribed}
    given["spring"] = elasticity.spring
    functions = [u, elasticity.von_mises(u), elasticity.young, elasticity.poisson]
    functions += [elasticity.function(values.astype(float), name) for name, values in given.items()]
    compat.write_mesh_and_functions(solution.problem.comm, path, elasticity.mesh.domain, functions)


def contact_fields(solution: Solution) -> dict[str, FloatArray]:
    """Fields on this rank's contact nodes, scalars (m,) and space vectors (m, 3); Pa, m, N.

    Those behind friction_use are what `coulomb check` judges the rest by.
    """
    problem, surface = solution.problem, solution.problem.surface
    x = solution.contact_force.reshape(-1, 3)
    closure = surface.components(solution.displacement[surface.nodes])
    tangential, slip = x.copy(), closure.copy()
    tangential[:, 0] = slip[:, 0] = 0.0
    bound = problem.slip_bound(solution.contact_force)
    used = np.hypot(x[:, 1], x[:, 2])
    return {
        "pressure": x[:, 0] / surface.area,
        "friction_traction": -surface.vectors(tangential) / surface.area[:, None],
        "slip": surface.vectors(slip),
        "gap": surface.gap - closure[:, 0],
        "status": node_status(solution).astype(float),
        "friction_use": np.where(node_status(solution) == OPEN, 0.0, used / np.where(bound > 0.0, bound, np.inf)),
        "contact_force": -surface.vectors(x),
        "normal": surface.frames[:, 0],
        "initial_gap": surface.gap,
        "area": surface.area,
        "coefficient": problem.coefficient,
        "slip_bound": solution.slip_bound,
    }


def _write_contact(solution: Solution, path: str) -> None:
    """The fields of the contact nodes on a mesh of the contact face."""
    problem = solution.problem
    elasticity, domain = problem.elasticity, problem.mesh.domain
    facets = problem.mesh.facets(problem.surface.face, "contact")
    owned = facets[facets < domain.topology.index_map(2).size_local]
    sub, geometry_of = compat.submesh(domain, 2, np.sort(owned))
    node_of_geometry = np.empty(len(domain.geometry.x), dtype=np.int64)
    node_of_geometry[compat.cell_geometry(domain)] = compat.cell_dofs(elasticity.V)
    scalar, vector = compat.functionspace(sub, 1), compat.functionspace(sub, 1, (3,))
    node_of_dof = np.zeros(scalar.dofmap.index_map.size_local + scalar.dofmap.index_map.num_ghosts, dtype=np.int64)
    node_of_dof[compat.cell_dofs(scalar)] = node_of_geometry[geometry_of[compat.cell_geometry(sub)]]
    functions = []
    for name, values in contact_fields(solution).items():
        everywhere = np.full((len(elasticity.x), 3), float(HELD) if name == "status" else 0.0)
        everywhere[problem.surface.nodes] = values if values.ndim == 2 else values[:, None]
        spread = elasticity.function(everywhere).x.array.reshape(-1, 3)[node_of_dof]
        function = fem.Function(vector if values.ndim == 2 else scalar, name=name)
        function.x.array[:] = (spread if values.ndim == 2 else spread[:, 0]).ravel()
        functions.append(function)
    compat.write_mesh_and_functions(problem.comm, path, sub, functions)


def _one_grid(path: Path) -> None:
    """DOLFINx writes a grid for the mesh and one for every function; a reader wants all of it on one."""
    tree = ElementTree.parse(path)
    domain = tree.getroot().find("Domain")
    assert domain is not None
    body, *others = domain.findall("Grid")
    body.extend(list(domain.iter("Time"))[:1])
    for grid in others:
        body.extend(grid.iter("Attribute"))
        domain.remove(grid)
    ElementTree.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)


def _write_history(history: tuple[OuterStep, ...] | tuple[QPStep, ...], path: Path) -> None:
    kind = type(history[0]) if history else OuterStep
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(kind)])
        writer.writeheader()
        writer.writerows(asdict(step) for step in history)


def _write_json(contents: dict[str, Any], path: Path) -> None:
    path.write_text(json.dumps(_finite(contents), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _draw(directory: Path) -> str:
    """Draw picture.png; what went wrong, or nothing.  In a process of its own: a renderer may take it down."""
    script = Path(__file__).with_name("plotting.py")
    launcher = ("OMPI_", "PMIX_", "PMI_", "HYDRA_", "SLURM_")
    environment = {key: value for key, value in os.environ.items() if not key.startswith(launcher)}
    try:
        done = subprocess.run(
            [sys.executable, str(script), str(directory)], env=environment, capture_output=True, text=True, timeout=600
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"could not be drawn: {error}"
    if done.returncode == 0:
        return ""
    last = (done.stderr.strip().splitlines() or [f"the renderer ended with code {done.returncode}"])[-1]
    return f"could not be drawn: {last}"


def _finite(value: Any) -> Any:
    """JSON has no nan and inf: null in their place."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
