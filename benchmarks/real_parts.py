"""Parts with bores, thin walls and open contact faces, by both methods for K: steps, seconds, and the chosen method.

Six parts come with it, as geometry for gmsh (parts/*.geo) and a case file each (parts/*.toml), and blocks,
whose case files have boxes; a directory of others may be given.  gmsh makes a mesh of each for every factor of its mesh
sizes, and joins its volumes where they have nodes at the same place (two extruded surfaces with a common curve, for
instance), unless the case has pairs of faces.  Cells of boxes are divided by the factor.

Every run has a process of its own (`python -m benchmarks.real_parts CASE METHOD TOLERANCE STEPS SETTING...`).
"""

from __future__ import annotations

import itertools
import json
import math
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from unittest import mock

from mpi4py import MPI

from coulomb.case.case import read_case
from coulomb.linalg.compliance import (
    DirectSolver,
    IterativeSolver,
)
from coulomb.model.load_history import LoadHistory
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution
from coulomb.process import peak_memory
from coulomb.solvers.results import NotConverged

from .petsc_solvers import PETSC
from .processes import alone

PARTS = Path(__file__).parent / "parts"
METHODS = ("direct", "iterative", "auto")
"""Those that are compared by default; there are those of PETSC besides."""

SCALES = (1.0, 0.5)
LIMIT = 120.0
"""Seconds after which a run is ended."""

LOADS = ("traction", "pressure", "total_force", "prescribed_displacement")
RAISED = [[0, 0], [4, 1], [9, 1.3], [19, 0.6], [24, 1]]
"""Factor of all loads in time, where several load steps of 1 s are asked for of a case without a history."""


class Row(NamedTuple):
    """A row of parts.csv; seconds from the assembled K to the last certificate, without mesh, assembly and output.

    The processor's seconds are those to compare where the machine has other work.  Nodes are counted, and the residual
    is, after the last load step; path following, products and iterations are those of all.
    """

    part: str
    clscale: float
    load_steps: int
    unknowns: int
    contact: int
    open: int
    stick: int
    slip: int
    method: str
    path: str
    path_following: int
    products: int
    multigrid_iterations: int
    seconds: float
    processor_seconds: float
    setup_processor_seconds: float
    peak_memory_bytes: int
    entries: int
    residual: float
    certified: bool


class Failure(NamedTuple):
    """A run without a row: a mesh that cannot be made, a case that is refused, or a run that did not end.

    Attributes:
        part: Name of the part.
        clscale: Factor of its mesh sizes.
        load_steps: Their number.
        method: Of METHODS or PETSC; empty if there is no mesh.
        reason: What happened.
    """

    part: str
    clscale: float
    load_steps: int
    method: str
    reason: str


def parts_in(directory: Path | None, names: Sequence[str] | None = None) -> list[Path]:
    """The case files of the parts: NAME.toml with a geometry NAME.geo beside it, or with boxes.

    Args:
        directory: Of the user's parts; by default those of the package.
        names: Names of the wanted ones; by default all.

    Raises:
        ValueError: If there are none, or a name is unknown.
    """
    where = directory or PARTS
    cases = sorted(where.glob("*.toml"), key=lambda path: path.stem)
    found = {case.stem: case for case in cases if case.with_suffix(".geo").is_file() or _finer(case, 1.0)}
    if not found:
        raise ValueError(f"{where}: there is no part: a case NAME.toml with boxes, or a geometry NAME.geo beside it")
    for name in names or ():
        if name not in found:
            raise ValueError(f"there is no part {name!r} in {where}; the parts are {', '.join(found)}")
    return [found[name] for name in names or found]


def _finer(case: Path, scale: float) -> list[str]:
    """Settings by which the cells of all boxes of a case are `scale` times as large."""
    tables = tomllib.loads(case.read_text())
    bodies = {"mesh": tables.get("mesh", {})} | {f"body.{k}": body for k, body in enumerate(tables.get("body", ()))}
    return [
        f"{name}.cells={[max(round(number / scale), 1) for number in body['cells']]}"
        for name, body in bodies.items()
        if "cells" in body
    ]


def _raised(case: Path, steps: int) -> list[str]:
    """Settings by which a case without a history gets load steps of 1 s, in which all loads follow RAISED."""
    tables = tomllib.loads(case.read_text())
    if "history" in tables:
        return []
    raised = [f"{name}.{k}.amplitude={RAISED}" for name in LOADS for k in range(len(tables.get(name, ())))]
    return [*raised, f"history.times={[float(k) for k in range(1, steps + 1)]}"]


def measure(
    parts: Sequence[Path],
    scales: Sequence[float],
    methods: Sequence[str],
    tolerance: float = 1e-8,
    limit: float = LIMIT,
    steps: Sequence[int] = (1,),
) -> Iterator[Row | Failure]:
    """Rows, or failures, as they are measured.

    Args:
        parts: The case files, see `parts_in`.
        scales: Factors of all mesh sizes.
        methods: Of METHODS or PETSC.
        tolerance: Coulomb residual to stop at.
        limit: Seconds after which a run is ended.
        steps: Numbers of load steps.

    Raises:
        ValueError: If the program gmsh is needed and not installed, or a case file is wrong.
    """
    gmsh = shutil.which("gmsh")
    if gmsh is None and any(case.with_suffix(".geo").is_file() for case in parts):
        raise ValueError('the program "gmsh" makes the meshes of the parts and is not found: install Debian\'s gmsh')
    with tempfile.TemporaryDirectory() as directory:
        for case in parts:
            joined = all(contact.against is None for contact in read_case(case).contacts.values())
            for scale in scales:
                mesh = Path(directory) / f"{case.stem}-{scale:g}.msh"
                settings = _finer(case, scale)
                if case.with_suffix(".geo").is_file():
                    settings = [f'mesh.file="{mesh}"']
                    try:
                        _mesh(str(gmsh), case.with_suffix(".geo"), scale, mesh, joined)
                    except RuntimeError as failure:
                        yield Failure(case.stem, scale, 1, "", str(failure))
                        continue
                for number, method in itertools.product(steps, methods):
                    command = [sys.executable, "-m", "benchmarks.real_parts"]
                    command += [str(case), method, str(tolerance), str(number), *settings]
                    try:
                        said = _done(command, alone(), limit)
                    except RuntimeError as failure:
                        yield Failure(case.stem, scale, number, method, str(failure))
                        continue
                    row = Row(**json.loads(said.strip().splitlines()[-1]))
                    yield row._replace(part=case.stem, clscale=scale)
                mesh.unlink(missing_ok=True)


def _mesh(gmsh: str, part: Path, scale: float, mesh: Path, joined: bool) -> None:
    """Write a mesh of a part, with one node in place of several at the same place if it is to be joined.

    Raises:
        RuntimeError: If gmsh fails or writes nothing.
    """
    _done([gmsh, "-3", str(part), "-clscale", f"{scale:g}", "-o", str(mesh)])
    if not mesh.is_file():
        raise RuntimeError("no mesh was made by gmsh")
    if joined:
        commands = mesh.with_suffix(".geo")
        commands.write_text(f'Merge "{mesh}";\nCoherence Mesh;\nSave "{mesh}";\n')
        _done([gmsh, "-", str(commands)])


def _done(command: list[str], environment: dict[str, str] | None = None, limit: float | None = None) -> str:
    """The output of a program.

    Raises:
        RuntimeError: If it fails, with the end of its error output, or does not end within the limit, seconds.
    """
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=limit)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"it did not end within {limit:g} s") from None
    if done.returncode != 0:
        raise RuntimeError((done.stderr.strip() or done.stdout.strip())[-2000:])
    return done.stdout


def run(case: Path, settings: Sequence[str], method: str, tolerance: float, steps: int = 1) -> Row:
    """One part in this process, on one rank, with these settings of its case; of a load history its first steps.

    Raises:
        ValueError: If the case is refused, or its history has fewer load steps.
        StepFailed: If one of several load steps fails.
    """
    raised = _raised(case, steps) if steps > 1 else []
    given = read_case(
        case, [*settings, *raised, f'solver.linear_solver="{"iterative" if method in PETSC else method}"']
    )
    times = (0.0,) if given.history is None else given.history.ends
    if len(times) < steps:
        raise ValueError(f"{case}: its history has {len(times)} load steps, fewer than {steps}")
    with mock.patch("coulomb.linalg.compliance.IterativeSolver", PETSC.get(method, IterativeSolver)):
        problem = given.problem(MPI.COMM_SELF)
    body = problem.body
    body.stiffness.expect_load_steps(steps)
    entries = int(body.elasticity.K.getInfo()["nz_used"])
    began, used = time.perf_counter(), time.process_time()
    solver = body.stiffness.solver
    setup = time.process_time() - used
    if steps > 1:
        history = LoadHistory(times[:steps], tolerance=tolerance)
        solutions = [step.solution for step in history.steps(problem)]
    else:
        solutions = [_solved(problem.at(times[0]) if given.history is not None else problem, tolerance)]
    certified = all(solution.certificate.passed for solution in solutions)
    seconds, used = time.perf_counter() - began, time.process_time() - used
    results, nodes = [solution.result for solution in solutions], solutions[-1].at_nodes.numbers()["nodes"]
    residual = max(result.residual for result in results)
    return Row(
        part=case.stem,
        clscale=1.0,
        load_steps=steps,
        unknowns=problem.unknowns["displacement"],
        contact=problem.unknowns["contact"],
        open=nodes["open"],
        stick=nodes["stick"],
        slip=nodes["slip"],
        method=method,
        path="direct" if body.stiffness.linear_solver is DirectSolver else "iterative",
        path_following=sum(result.newton_steps for result in results),
        products=sum(result.products for result in results),
        multigrid_iterations=solver.iterations,
        seconds=seconds,
        processor_seconds=used,
        setup_processor_seconds=setup,
        peak_memory_bytes=peak_memory(),
        entries=entries,
        residual=residual,
        certified=certified and residual <= tolerance,
    )


def _solved(problem: ContactProblem, tolerance: float) -> Solution:
    try:
        return problem.solve(tolerance)
    except NotConverged as failure:
        return problem.solution(failure.result)


def over_better(row: Row, results: Sequence[Row | Failure]) -> float | None:
    """Processor seconds of the chosen method over those of the faster method; None unless both were tried and one has
    ended.  Of the chosen method the least of its two runs counts."""
    same = [other for other in results if other[:3] == row[:3] and other.method in METHODS[:2]]
    seconds = {other.method: other.processor_seconds for other in same if isinstance(other, Row)}
    if row.method != "auto" or len(same) < 2 or not seconds:
        return None
    chosen = min(row.processor_seconds, seconds.get(row.path, math.inf))
    return chosen / min(chosen, *seconds.values())


if __name__ == "__main__":
    try:
        _row = run(Path(sys.argv[1]), sys.argv[5:], sys.argv[2], float(sys.argv[3]), int(sys.argv[4]))
    except ValueError as error:
        sys.exit(str(error))
    sys.stdout.write(json.dumps(_row._asdict()) + "\n")
