"""The command line: `coulomb run CASE.toml`, `coulomb info`.  Only rank 0 speaks.

Exit codes: 0 the certificate passed; 1 it did not, or the solver did not converge (results are written all the same,
marked so); 2 the input is wrong.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from pathlib import Path
from typing import Annotated, Any

import scipy.sparse
import typer
from mpi4py import MPI
from rich.console import Console
from threadpoolctl import threadpool_limits

from . import output
from .benchmarks.commands import benchmark
from .case import Case, read_case, write_case, written_case
from .commands_pictures import register, write_report
from .console import BAD_INPUT, FAILED
from .console import console as _console
from .console import errors as _errors
from .load_history import LoadStep, StepFailed
from .problem import ContactProblem
from .solution import Solution
from .solvers.automatic import Automatic
from .solvers.coulomb import CoulombSolver
from .solvers.dense_system import DenseSystem
from .solvers.fixed_point import SuccessiveTresca
from .solvers.path_following import PathFollowing
from .solvers.results import CoulombResult, NotConverged
from .summary import summary
from .terminal import Display, introduce, report
from .versions import details

app = typer.Typer(help=__doc__, add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
app.add_typer(benchmark, name="benchmark")
register(app)
_comm = MPI.COMM_WORLD


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
    page: Annotated[bool, typer.Option("--report", help="Write report.html too, as output.report = true.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Say nothing but errors.")] = False,
) -> None:
    """Solve a case, certify the answer, write the results."""
    began = time.perf_counter()
    console = Console(quiet=True) if quiet else _console
    with threadpool_limits(limits=1 if _comm.size > 1 else None):
        try:
            settings = read_case(case, [*(changes or ()), *(["output.report=true"] if page else ())], _comm)
            target = directory or Path(settings.output.directory)
            problem = settings.problem(_comm)
        except ValueError as error:
            _errors.print(f"error: {error}", markup=False)
            raise typer.Exit(BAD_INPUT) from None
        introduce(console, case, problem)
        if settings.history is not None:
            _take_steps(console, settings, problem, target, resume=False)
            return
        solution, trouble = _solve(console, settings, problem)
        problem.seconds["total"] = time.perf_counter() - began
        try:
            contents = output.write(solution, target, settings.output.picture, {"message": trouble})
            write_case(settings, target, _comm)
        except OSError as error:
            _errors.print(f"error: {target}: cannot be written: {error.strerror or error}", markup=False)
            contents = summary(solution)
            trouble = trouble or "the results could not be written"
    report(console, solution, contents, target, time.perf_counter() - began)
    _report_page(settings, target)
    if trouble:
        _errors.print(f"error: {trouble}", markup=False)
    if trouble or not solution.certificate.passed:
        raise typer.Exit(FAILED)


@app.command()
def resume(
    directory: Annotated[Path, typer.Argument(help="Where a run with a [history] has left its steps.")],
    quiet: Annotated[bool, typer.Option("--quiet", help="Say nothing but errors.")] = False,
) -> None:
    """Continue a load history that was interrupted, from its last step, on as many ranks as you like."""
    console = Console(quiet=True) if quiet else _console
    with threadpool_limits(limits=1 if _comm.size > 1 else None):
        try:
            settings = written_case(directory, _comm)
            if settings.history is None:
                raise ValueError(f"{directory} holds a single run, no load history: there is nothing to resume")
            problem = settings.problem(_comm)
        except ValueError as error:
            _errors.print(f"error: {error}", markup=False)
            raise typer.Exit(BAD_INPUT) from None
        introduce(console, directory, problem)
        _take_steps(console, settings, problem, directory, resume=True)


@app.command()
def info() -> None:
    """Versions and PETSc's packages, for a bug report."""
    for name, value in details().items():
        _console.print(f"{name:<18}{value}", markup=False, soft_wrap=True)


@app.command()
def fclib(
    file: Annotated[Path, typer.Argument(help="Problem in FCLIB's HDF5 format, local or global.")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object instead of lines.")] = False,
    tolerance: Annotated[float, typer.Option("--tolerance", min=1e-12, help="Coulomb residual to stop at.")] = 1e-8,
    dense: Annotated[bool, typer.Option("--dense", help="Newton systems by dense algebra: hard, small ones.")] = False,
) -> None:
    """Solve a friction problem from elsewhere, and report the residual its community uses."""
    from .fclib import read_fclib
    from .general import solve_coulomb

    if _comm.size > 1:
        _errors.print("error: coulomb fclib runs on one rank", markup=False)
        raise typer.Exit(BAD_INPUT)
    trouble = ""
    solver: CoulombSolver = Automatic(tolerance)
    if dense:
        solver = SuccessiveTresca(tolerance, PathFollowing(newton=DenseSystem))
    try:
        problem = read_fclib(file)
        result = solve_coulomb(problem.W, -problem.q, problem.mu, solver)
    except ValueError as error:
        _errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None
    except NotConverged as failure:
        assert isinstance(failure.result, CoulombResult)
        result, trouble = failure.result, str(failure)
    report = {
        "file": str(file),
        "title": problem.title.strip(),
        "contacts": len(problem.mu),
        "status": result.status.value,
        "residual": result.residual,
        "fclib_residual": problem.residual(result.x),
        "method": result.method,
        "outer": result.iterations,
        "path_following": result.path_following,
        "products": result.products,
    }
    if as_json:
        _console.print(json.dumps(report), markup=False, soft_wrap=True)
    else:
        for name, value in report.items():
            shown = f"{value:.2e}" if isinstance(value, float) else value
            _console.print(f"{name:<16}{shown}", markup=False, soft_wrap=True)
    if trouble:
        _errors.print(f"error: {trouble}", markup=False)
        raise typer.Exit(FAILED)


@app.command()
def export(
    case: Annotated[Path, typer.Argument(help="Case file, TOML, with Coulomb friction.", metavar="CASE.toml")],
    file: Annotated[Path, typer.Argument(help="FCLIB file to write, HDF5.")],
    changes: Annotated[list[str] | None, typer.Option("--set", help="Replace a setting; may be repeated.")] = None,
) -> None:
    """Write the contact problem of a case, condensed to its contact nodes, for other solvers to read."""
    from .fclib import FCLIBProblem, write_fclib
    from .solvers.compliance import ExplicitCompliance

    try:
        if _comm.size > 1:
            raise ValueError("coulomb export runs on one rank")
        problem = read_case(case, changes or (), _comm).problem(_comm)
        if not problem.coulomb:
            raise ValueError("FCLIB's problems have Coulomb friction; this case has a slip stress")
        if not isinstance(problem.A, ExplicitCompliance):
            raise ValueError('A is not formed for a problem of this size; set solver.compliance="explicit"')
        mu = problem.coefficient
        W = problem.A.matrix.getDenseArray()
        write_fclib(file, FCLIBProblem(scipy.sparse.csr_matrix(W), -problem.b, mu, case.stem))
    except (ValueError, OSError) as error:
        _errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None
    _console.print(f"{len(mu)} contacts in {file}", markup=False, soft_wrap=True)


@app.command()
def check(directory: Annotated[Path, typer.Argument(help="Where a run has left its results.")]) -> None:
    """Certify results from their files alone: 0 if the certificate passes, 1 if not, 2 if it cannot be read."""
    from .check import check as check_files
    from .check import recorded

    if _comm.size > 1:
        _errors.print("error: coulomb check runs on one rank", markup=False)
        raise typer.Exit(BAD_INPUT)
    try:
        certificate, before = check_files(directory), recorded(directory)
    except ValueError as error:
        _errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None
    verdict = "had passed" if before else "had FAILED"
    _console.print(f"{certificate}\nrecorded by the run: certificate {verdict}", markup=False, soft_wrap=True)
    if not certificate.passed:
        raise typer.Exit(FAILED)


def _solve(console: Console, settings: Case, problem: ContactProblem) -> tuple[Solution, str]:
    """The solution, converged or not, and what went wrong."""
    display = Display(console)
    try:
        with display:
            return problem.solve(solver=settings.contact_solver(), progress=display), ""
    except NotConverged as failure:
        return problem.solution(failure.result), str(failure)


def _take_steps(console: Console, settings: Case, problem: ContactProblem, target: Path, resume: bool) -> None:
    """Run a load history; ends the command with its exit code."""
    began, trouble, display = time.perf_counter(), "", Display(console, by_step=True)

    warned: tuple[str, ...] = ()

    def say(step: LoadStep) -> None:
        nonlocal warned
        row = step.row
        halved = f", halved {step.halvings} times" if step.halvings else ""
        console.print(
            f"step {row['step']:3d}  time {row['time']:<8.4g} normal {row['normal_force']:.6g} N, force "
            f"({row['force_x']:.6g}, {row['force_y']:.6g}, {row['force_z']:.6g}) N, open {row['open']}, stick "
            f"{row['stick']}, slip {row['slip']}, {row['path_following']} PF steps, residual {row['residual']:.1e}"
            f"{'' if row['certified'] else ', certificate FAILED'}{halved}",
            markup=False,
            soft_wrap=True,
        )
        warnings = step.solution.small_strain.warnings
        for warning in warnings if len(warnings) > len(warned) else ():
            _errors.print(f"warning: step {row['step']}: {warning}", markup=False)
        warned = max(warned, warnings, key=len)

    rows: list[dict[str, Any]] = []
    try:
        if not resume:
            write_case(settings, target, _comm)
        with display:
            rows = settings.load_history().run(problem, target, resume=resume, progress=display, on_step=say)
    except ValueError as error:
        _errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None
    except StepFailed as failure:
        trouble = str(failure)
        try:
            output.write(failure.problem.solution(failure.result), target / "failed", picture=False)
            trouble += f"; what it got to is in {target / 'failed'}"
        except OSError as error:
            trouble += f"; what it got to could not be written: {error.strerror or error}"
    except OSError as error:
        trouble = f"{target}: cannot be written: {error.strerror or error}"
    if rows:
        last = rows[-1]
        if settings.output.picture:
            output.on_rank_0(_comm, lambda: output.draw(target / "steps" / f"{last['step']:04d}", target))
        _report_page(settings, target)
        console.print(
            f"energy in J: loads {last['energy_loads']:.6g}, prescribed displacements {last['energy_prescribed']:.6g}, "
            f"foundation {last['energy_foundation']:.6g}; elastic {last['energy_elastic']:.6g}, friction "
            f"{last['energy_dissipated']:.6g}, error of finite steps {last['energy_imbalance']:.2g}\n"
            f"{len(rows)} steps, {time.perf_counter() - began:.2f} seconds; results in {target}{os.sep}",
            markup=False,
            soft_wrap=True,
        )
    if trouble:
        _errors.print(f"error: {trouble}", markup=False)
    if trouble or not all(row["certified"] for row in rows):
        raise typer.Exit(FAILED)


def _report_page(settings: Case, target: Path) -> None:
    """Write report.html if the case asks for it."""
    if settings.output.report and (trouble := write_report(target, _comm)):
        _errors.print(f"warning: {trouble}", markup=False)


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
