"""Parts with bores, thin walls and open contact faces, by both methods for K: steps, seconds, and the chosen method.

Six parts come with the package, as geometry for gmsh (parts/*.geo) and a case file each (parts/*.toml); a directory of
others may be given.  gmsh makes a mesh of each for every factor of its mesh sizes, and joins its volumes where they
have nodes at the same place (two extruded surfaces with a common curve, for instance), unless the case has pairs of
faces.

Every run has a process of its own (`python -m coulomb.benchmarks.real_parts CASE MESH METHOD TOLERANCE`).
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mpi4py import MPI

from ..case.case import read_case
from ..io.peak_memory import peak_memory
from ..linalg.stiffness import IterativeSolver
from ..ranks import ALONE
from ..solvers.results import NotConverged

PARTS = Path(__file__).parent / "parts"
METHODS = ("direct", "iterative", "auto")
SCALES = (1.0, 0.5)
LIMIT = 120.0
"""Seconds after which a run is ended."""


class Row(NamedTuple):
    """A row of parts.csv; seconds from the assembled K to the certificate, without mesh, assembly and output.

    The processor's seconds are those to compare where the machine has other work.
    """

    part: str
    clscale: float
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
        method: Of METHODS; empty if there is no mesh.
        reason: What happened.
    """

    part: str
    clscale: float
    method: str
    reason: str


def parts_in(directory: Path | None, names: Sequence[str] | None = None) -> list[Path]:
    """The geometries to mesh, NAME.geo with a case file NAME.toml beside it.

    Args:
        directory: Of the user's parts; by default those of the package.
        names: Names of the wanted ones; by default all.

    Raises:
        ValueError: If there are none, or a name is unknown.
    """
    where = directory or PARTS
    found = {path.stem: path for path in sorted(where.glob("*.geo")) if path.with_suffix(".toml").is_file()}
    if not found:
        raise ValueError(f"{where}: there is no part: a geometry NAME.geo with a case file NAME.toml beside it")
    for name in names or ():
        if name not in found:
            raise ValueError(f"there is no part {name!r} in {where}; the parts are {', '.join(found)}")
    return [found[name] for name in names or found]


def measure(
    parts: Sequence[Path],
    scales: Sequence[float],
    methods: Sequence[str],
    tolerance: float = 1e-8,
    limit: float = LIMIT,
) -> Iterator[Row | Failure]:
    """Rows, or failures, as they are measured.

    Args:
        parts: The geometries, see `parts_in`.
        scales: Factors of all mesh sizes of a geometry.
        methods: Of METHODS.
        tolerance: Coulomb residual to stop at.
        limit: Seconds after which a run is ended.

    Raises:
        ValueError: If the program gmsh is not installed, or a case file is wrong.
    """
    gmsh = shutil.which("gmsh")
    if gmsh is None:
        raise ValueError('the program "gmsh" makes the meshes of the parts and is not found: install Debian\'s gmsh')
    environment = {key: value for key, value in os.environ.items() if not key.startswith(tuple(ALONE))}
    environment["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as directory:
        for part in parts:
            case = part.with_suffix(".toml")
            joined = all(contact.against is None for contact in read_case(case).contacts.values())
            for scale in scales:
                mesh = Path(directory) / f"{part.stem}-{scale:g}.msh"
                try:
                    _mesh(gmsh, part, scale, mesh, joined)
                except RuntimeError as failure:
                    yield Failure(part.stem, scale, "", str(failure))
                    continue
                for method in methods:
                    command = [sys.executable, "-m", "coulomb.benchmarks.real_parts"]
                    command += [str(case), str(mesh), method, str(tolerance)]
                    try:
                        said = _done(command, environment, limit)
                    except RuntimeError as failure:
                        yield Failure(part.stem, scale, method, str(failure))
                        continue
                    row = Row(**json.loads(said.strip().splitlines()[-1]))
                    yield row._replace(part=part.stem, clscale=scale)
                mesh.unlink()


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


def run(case: Path, mesh: Path, method: str, tolerance: float) -> Row:
    """One part in this process, on one rank; of a load history its first step."""
    settings = read_case(case, [f'mesh.file="{mesh}"', f'solver.linear_solver="{method}"'])
    problem = settings.problem(MPI.COMM_SELF)
    if settings.history is not None:
        problem = problem.at(settings.history.ends[0])
        problem.body.expect_load_steps(1)
    body = problem.body
    entries = int(body.elasticity.K.getInfo()["nz_used"])
    began, used = time.perf_counter(), time.process_time()
    solver = body.stiffness_solver
    setup = time.process_time() - used
    try:
        solution = problem.solve(tolerance)
    except NotConverged as failure:
        solution = problem.solution(failure.result)
    certified = solution.certificate.passed
    seconds, used = time.perf_counter() - began, time.process_time() - used
    result, nodes = solution.result, solution.at_nodes.numbers()["nodes"]
    return Row(
        part=case.stem,
        clscale=1.0,
        unknowns=problem.unknowns["displacement"],
        contact=problem.unknowns["contact"],
        open=nodes["open"],
        stick=nodes["stick"],
        slip=nodes["slip"],
        method=method,
        path="iterative" if body.linear_solver is IterativeSolver else "direct",
        path_following=result.newton_steps,
        products=result.products,
        multigrid_iterations=solver.iterations,
        seconds=seconds,
        processor_seconds=used,
        setup_processor_seconds=setup,
        peak_memory_bytes=peak_memory(),
        entries=entries,
        residual=result.residual,
        certified=certified and result.residual <= tolerance,
    )


def over_better(row: Row, results: Sequence[Row | Failure]) -> float | None:
    """Processor seconds of a run with the chosen method over those of the faster method; None unless both were tried
    and one has ended."""
    same = [other for other in results if other[:2] == row[:2] and other.method in METHODS[:2]]
    seconds = [other.processor_seconds for other in same if isinstance(other, Row)]
    if row.method != "auto" or len(same) < 2 or not seconds:
        return None
    return row.processor_seconds / min(seconds)


if __name__ == "__main__":
    try:
        _row = run(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], float(sys.argv[4]))
    except ValueError as error:
        sys.exit(str(error))
    sys.stdout.write(json.dumps(_row._asdict()) + "\n")
