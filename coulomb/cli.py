"""The command line: `coulomb run CASE.toml`, `coulomb info`.  Only rank 0 speaks.

Exit codes: 0 the certificate passed; 1 it did not, or the solver did not converge (results are written all the same,
marked so); 2 the input is wrong.
"""

from __future__ import annotations

import csv
import importlib.metadata
import os
import platform
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from mpi4py import MPI
from petsc4py import PETSc
from rich.console import Console
from threadpoolctl import threadpool_info, threadpool_limits

from . import output
from .case import Case, read_case
from .fem import compat
from .problem import ContactProblem, Solution
from .solvers.results import NotConverged, Progress
from .version import __version__

PASSED, FAILED, BAD_INPUT = 0, 1, 2

app = typer.Typer(help=__doc__, add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
benchmark = typer.Typer(help="Measurements behind the choices.", no_args_is_help=True)
app.add_typer(benchmark, name="benchmark")
_comm = MPI.COMM_WORLD
_console = Console(quiet=_comm.rank != 0, highlight=False)
_errors = Console(quiet=_comm.rank != 0, highlight=False, stderr=True, soft_wrap=True)


@app.command()
def run(
    case: Annotated[Path, typer.Argument(help="Case file, TOML.", metavar="CASE.toml")],
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="Replace a setting, for example mesh.cells=[18,6,6]; may be repeated."),
    ] = None,
    directory: Annotated[
        Path | None, typer.Option("--output", help="Where the results go, in place of the case's output.directory.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Say nothing but errors.")] = False,
) -> None:
    """Solve a case, certify the answer, write the results."""
    began = time.perf_counter()
    console = Console(quiet=True) if quiet else _console
    with threadpool_limits(limits=1 if _comm.size > 1 else None):
        try:
            settings = read_case(case, changes or (), _comm)
            target = directory or Path(settings.output.directory)
            problem = settings.problem(_comm)
        except ValueError as error:
            _errors.print(f"error: {error}", markup=False)
            raise typer.Exit(BAD_INPUT) from None
        _introduce(console, case, problem)
        solution, trouble = _solve(console, settings, problem)
        problem.seconds["total"] = time.perf_counter() - began
        try:
            contents = output.write(solution, target, settings.output.picture)
        except OSError as error:
            _errors.print(f"error: {target}: cannot be written: {error.strerror or error}", markup=False)
            contents = output.summary(solution)
            trouble = trouble or "the results could not be written"
    _report(console, solution, contents, target, time.perf_counter() - began)
    if trouble:
        _errors.print(f"error: {trouble}", markup=False)
    if trouble or not solution.certificate.passed:
        raise typer.Exit(FAILED)


@app.command()
def info() -> None:
    """Versions and PETSc's packages, for a bug report."""
    known = (
        "mumps",
        "scalapack",
        "hypre",
        "superlu_dist",
        "suitesparse",
        "metis",
        "parmetis",
        "scotch",
        "ptscotch",
        "ml",
    )
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    rows = {
        "coulomb": __version__,
        "Python": f"{platform.python_version()} ({sys.executable})",
        "platform": platform.platform(),
        "DOLFINx": compat.VERSION,
        "PETSc": f"{petsc}, {np.dtype(PETSc.ScalarType).name}, {8 * np.dtype(PETSc.IntType).itemsize} bit integers",
        "PETSc's packages": ", ".join(name for name in known if PETSc.Sys.hasExternalPackage(name)),
        "MPI": MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\0"),
        "BLAS": ", ".join(sorted({str(e.get("filepath")) for e in threadpool_info() if e["user_api"] == "blas"})),
        **{name: _version(name) for name in ("numpy", "scipy", "mpi4py", "petsc4py", "h5py", "pyvista", "vtk")},
    }
    for name, value in rows.items():
        _console.print(f"{name:<18}{value}", markup=False, soft_wrap=True)


@benchmark.command()
def compliance(
    sizes: Annotated[list[int] | None, typer.Option("--p", min=1, help="Cells a metre of the block; repeat.")] = None,
) -> None:
    """Three ways to the compliance A on one rank, seconds: what the default choice rests on."""
    from .benchmarks.compliance import measure

    if _comm.size > 1:
        _errors.print("error: this benchmark runs on one rank", markup=False)
        raise typer.Exit(BAD_INPUT)
    _console.print(
        "  p  contact    Schur  many right-hand sides  product explicit  matrix-free  difference", soft_wrap=True
    )
    for p in sizes or (6, 10, 16):
        row = measure(p)
        _console.print(
            f"{row.p:3d}  {row.contact:7d}  {row.schur:7.2f}  {row.right_hand_sides:21.2f}  "
            f"{row.product_explicit:16.5f}  {row.product_matrix_free:11.5f}  {row.difference:10.1e}",
            soft_wrap=True,
        )


@benchmark.command()
def table1(
    sizes: Annotated[list[int] | None, typer.Option("--p", min=1, help="Cells a metre of the block; repeat.")] = None,
    solver: Annotated[list[str] | None, typer.Option("--solver", help="A column, as KPRGP; repeat.")] = None,
    directory: Annotated[Path | None, typer.Option("--output", help="For table1.csv and table1.png.")] = None,
) -> None:
    """Table 1 of the paper: PF and KPRGP on the Tresca block, to the same residual."""
    from .benchmarks.table1 import PAPER, RESIDUAL, SIZES, Row, measure

    _console.print(f"Tresca block to a residual of {RESIDUAL:g}; iterations/products (paper's)", soft_wrap=True)
    rows = []
    try:
        for row in measure(sizes or SIZES, solver):
            rows.append(row)
            theirs = PAPER.get((row.solver, row.p), "-")
            _console.print(
                f"{row.n:7d}/{row.m:<6d} {row.solver:14s} {row.iterations:6d}/{row.products:<6d} ({theirs:>6s})  "
                f"{row.seconds:8.2f} s  residual {row.residual:.1e}",
                markup=False,
                soft_wrap=True,
            )
    except ValueError as error:
        _errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None
    _write_table(directory, "table1", Row._fields, rows)


@benchmark.command()
def conditioning(
    p: Annotated[int, typer.Option("--p", min=1, max=5, help="Cells a metre of the block: dense algebra.")] = 3,
    directory: Annotated[Path | None, typer.Option("--output", help="For conditioning.csv and .png.")] = None,
) -> None:
    """Figure 1 of the paper: condition numbers of the Newton systems along a path-following run."""
    from .benchmarks.block import block
    from .benchmarks.conditioning import measure

    problem = block(p, friction=None)
    spectra = measure(problem.tresca(problem.slip_bound(problem.b)))
    fields = ("iteration", "J_AM", "J_SC", "P_AM^-1 J_AM", "P_SC^-1 J_SC", "bound")
    rows = [
        (s.iteration, s.cond_J_AM, s.cond_J_SC, s.cond_preconditioned_AM, s.cond_preconditioned_SC, s.upper / s.lower)
        for s in spectra
    ]
    _console.print("  ".join(f"{field:>12s}" for field in fields), soft_wrap=True)
    for row in rows:
        _console.print("  ".join([f"{row[0]:12d}", *(f"{value:12.3e}" for value in row[1:])]), soft_wrap=True)
    _write_table(directory, "conditioning", fields, rows)


def _write_table(directory: Path | None, name: str, fields: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """name.csv and its figure name.png, where a directory is given."""
    if directory is None or _comm.rank != 0 or not rows:
        return
    from . import plotting

    directory.mkdir(parents=True, exist_ok=True)
    with (directory / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(fields)
        writer.writerows(rows)
    getattr(plotting, name)(directory / f"{name}.csv")
    _console.print(f"{name}.csv and {name}.png in {directory}{os.sep}", soft_wrap=True)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        try:
            return str(__import__(name).__version__)
        except ImportError:
            return "not installed"


def _introduce(console: Console, case: Path, problem: ContactProblem) -> None:
    unknowns = problem.unknowns
    contact = problem.contact
    coulomb = contact.friction is not None
    law = f"Coulomb friction {contact.friction:g}" if coulomb else f"Tresca friction {contact.slip_stress:g} Pa"
    console.print(
        f"{case}: {unknowns['displacement']} displacement and {unknowns['contact']} contact unknowns, {law}, "
        f"{_comm.size} {'rank' if _comm.size == 1 else 'ranks'}",
        markup=False,
        soft_wrap=True,
    )


def _solve(console: Console, settings: Case, problem: ContactProblem) -> tuple[Solution, str]:
    """The solution, converged or not, and what went wrong."""
    display = _Display(console)
    try:
        with display:
            return problem.solve(solver=settings.contact_solver(), progress=display), ""
    except NotConverged as failure:
        return problem.solution(failure.result), str(failure)


class _Display:
    """Progress: one line that changes on a terminal, a line for each Tresca problem (or PF step) elsewhere."""

    def __init__(self, console: Console):
        self._console = console
        self._status = console.status("K^-1 and A") if console.is_terminal and not console.quiet else None
        self._last: Progress | None = None

    def __enter__(self) -> _Display:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()
        self._line()

    def __call__(self, progress: Progress) -> None:
        if self._status is not None:
            self._status.update(_describe(progress))
        if self._last is not None and (progress.outer != self._last.outer or progress.outer == 0):
            self._line()
        self._last = progress

    def _line(self) -> None:
        if self._last is not None and self._status is None:
            self._console.print(_describe(self._last))


def _describe(progress: Progress) -> str:
    outer = f"outer {progress.outer:3d}  " if progress.outer else ""
    return f"{outer}path following {progress.path_following:3d}  residual {progress.residual:.1e}"


def _report(console: Console, solution: Solution, contents: dict[str, Any], target: Path, total: float) -> None:
    iterations, nodes = contents["iterations"], contents["nodes"]
    force = contents["force_on_body"]
    outer = f"{iterations['outer']} Tresca problems, " if iterations["outer"] else ""
    rate = contents["contraction"]
    contraction = f", contraction {rate:.2g}" if rate is not None and np.isfinite(rate) else ""
    seconds = ", ".join(f"{name} {value:.2f}" for name, value in contents["seconds"].items() if name != "total")
    lines = (
        f"{contents['status']}: residual {contents['residual']:.1e}, {outer}"
        f"{iterations['path_following']} path-following steps, {iterations['products']} products{contraction}",
        f"force on the body: normal {force['normal']:.9g} N, tangential "
        f"({', '.join(f'{value:.9g}' for value in force['tangential'])}) N",
        f"contact nodes {nodes['contact']}: open {nodes['open']}, stick {nodes['stick']}, slip {nodes['slip']}; "
        f"greatest pressure {contents['maximum']['contact_pressure']:.6g} Pa",
        str(solution.certificate),
        f"seconds: {seconds}; {total:.2f} in all",
    )
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
    picture = contents.get("picture", "")
    if "could not" in picture:
        _errors.print(f"warning: picture.png {picture}", markup=False)
    console.print(f"results in {target}{os.sep}", markup=False, soft_wrap=True)


def main() -> None:
    """Entry point; what no rank foresaw ends all of them."""
    try:
        app()
    except Exception:
        if _comm.size == 1:
            raise
        traceback.print_exc()
        sys.stderr.flush()
        _comm.Abort(3)
