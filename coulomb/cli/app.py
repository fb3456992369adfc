"""The commands of `coulomb`, except those of cases and pictures.  Output is on rank 0; exit codes:
console.py.

Modules that take time to load are imported by the command that needs them: numpy and the case files', so that help is
immediate; MPI, PETSc and DOLFINx, so that messages about wrong cases are.
"""

from __future__ import annotations

import json
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import process
from ..installation import unusable
from ..io.atomic_output import finish_for_reader
from ..io.run_directory import CASE, RunDirectory
from ..ranks import launched, on_rank_0
from ..version import __version__
from .case_commands import Changes, Ignored, case_of, check_case, contacts, convert, import_deck, named_directory, new
from .console import BAD_INPUT, CRASHED, EXIT_CODES, FAILED, bad_input, fail, refuse_ranks, showing_messages
from .console import console as _console
from .picture_commands import drawing_soon, plot, report

if TYPE_CHECKING:
    from ..case.case import Case
    from ..solvers.friction_problem import Solver

app = typer.Typer(epilog=EXIT_CODES, no_args_is_help=True, pretty_exceptions_enable=False)
app.command()(plot)
app.command()(report)


def _show_version(asked: bool) -> None:
    if asked:
        _console.out(f"coulomb {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    """3D contact with Coulomb friction: solved, certified, written.  Start with: coulomb new block"""
    context.with_resource(showing_messages(_console))


Quiet = Annotated[bool, typer.Option("--quiet", help="Print only warnings and errors.")]
Force = Annotated[
    bool, typer.Option("--force", help="Run with too little memory or disk, and accept strains outside the theory.")
]
LogFile = Annotated[
    Path | None, typer.Option("--log", help="Append all output and every step to this file, with the time.")
]


@app.command()
def run(
    case: Annotated[
        Path,
        typer.Argument(
            help="Case file; an input file of CalculiX or Abaqus (.inp); or the directory of a run, whose case is run "
            "again.",
            metavar="CASE.toml",
        ),
    ],
    changes: Changes = None,
    directory: Annotated[
        Path | None,
        typer.Option(
            "--output",
            parser=named_directory,
            metavar="DIRECTORY",
            help="Directory of the results, in place of the case's output.directory.  Those that are there are kept as "
            "DIRECTORY.previous.",
        ),
    ] = None,
    page: Annotated[bool, typer.Option("--report", help="Write report.html as well, as output.report = true.")] = False,
    error: Annotated[
        bool, typer.Option("--error", help="Error bars: solve on other meshes as well, as output.error = true.")
    ] = False,
    sensitivity: Annotated[
        bool,
        typer.Option("--sensitivity", help="What inputs do to forces, as output.sensitivity = true."),
    ] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Compare sensitivities with answers of the changed case.")
    ] = False,
    refine_to: Annotated[
        str | None,
        typer.Option("--refine-to", help="Refine the mesh until the error bars are this part of the totals, as 2%."),
    ] = None,
    refine_for: Annotated[
        list[str] | None,
        typer.Option("--refine-for", help="A total, as totals.normal_force; by default forces, energy, displacement."),
    ] = None,
    most_unknowns: Annotated[
        int, typer.Option("--most-unknowns", min=1, help="Displacement unknowns that a refined mesh may have.")
    ] = 300_000,
    quiet: Quiet = False,
    log_file: LogFile = None,
    force: Force = False,
    keep: Annotated[bool, typer.Option("--keep", help="Do not run if there are results in the directory.")] = False,
    ignored: Ignored = None,
) -> None:
    """Solve a case, certify the answer, write the results."""
    from ..case.case import read_case
    from ..case.decks import read_deck
    from .session import opened

    with opened(quiet, log_file) as session:
        with bad_input():
            asked = {"output.report=true": page, "output.error=true": error, "output.sensitivity=true": sensitivity}
            asked["output.verify=true"] = verify
            file, there = recorded(case)
            more = [change for change, given in asked.items() if given]
            settings = case_of(file, [*(changes or ()), *more], ignored, session.console)
            wanted = None if refine_to is None else (_part(refine_to), refine_for or [], most_unknowns)
            if wanted is not None and settings.history is not None:
                raise ValueError("--refine-to is for single runs: refine the mesh for the loads of one time")
            if refine_for and wanted is None:
                raise ValueError("--refine-for says which totals --refine-to is about: give both")

        with drawing_soon(settings) as renderer:
            from ..fem.contact import NothingOpposite
            from .run_case import allows_large, compute

            target = directory or there or Path(settings.output.directory)
            try:
                compute(session, settings, case, target, force, keep=keep, renderer=renderer, refinement=wanted)
            except (typer.Exit, NothingOpposite) as end:
                if isinstance(end, NothingOpposite):
                    session.console.out(f"\n{end}; solved as large motions, in which they may meet\n")
                elif end.exit_code != FAILED or not allows_large(settings) or not _too_large(target):
                    raise
                else:
                    session.console.out(
                        "\nmotions are too large for the theory of small strains: solved again as large ones\n"
                    )
                with bad_input():
                    deck = read_deck(file, ignored or (), large=True)
                    settings = read_case(file, [*(changes or ()), *more], deck)
                compute(session, settings, case, target, force, keep=keep)


def _too_large(target: Path) -> bool:
    """Whether an answer does not count since motions are large; the same on every rank."""

    def outside() -> bool:
        with suppress(OSError, ValueError):
            summary = RunDirectory(target).read_summary()
            of = summary["history"]["outside"] if "history" in summary else summary.get("small_strain")
            texts = (of or {}).get("violations", [])
            return any("large" in text or "nodes opposite" in text for text in texts)
        return False

    return on_rank_0(launched(), outside)


def recorded(case: Path) -> tuple[Path, Path | None]:
    """The file of a case, and the directory of the run that has recorded it, None for other files; the same on every
    rank.

    Raises:
        ValueError: On every rank, if a directory has no case.
    """

    def find() -> bool:
        run = RunDirectory(case if case.is_dir() else case.parent)
        if case.is_dir() and not run.case.is_file():
            raise ValueError(f"{case}: has no {CASE}: give a case file, or the directory of a run of one")
        return case.is_dir() or (case.name == CASE and (run.summary.exists() or run.is_history))

    of_run = on_rank_0(launched(), find)
    folder = case.parent if case.name == CASE else case
    return RunDirectory(folder).case if of_run else case, folder if of_run else None


def _part(text: str) -> float:
    """A part of 1, given as in "2%" or "0.02"; ValueError if it is none between 0 and 1."""
    number, percent, rest = text.partition("%")
    try:
        value = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        value = 0.0
    if rest.strip() or not 0.0 < value < 1.0:
        raise ValueError(f'--refine-to {text}: must be a part of the totals as in "2%" or "0.02"')
    return value


@app.command()
def resume(
    directory: Annotated[Path, typer.Argument(help="Directory of a load history.")],
    quiet: Quiet = False,
    log_file: LogFile = None,
    force: Force = False,
) -> None:
    """Continue a load history that was interrupted, from its last step, on any number of ranks."""
    from ..case.record import written_case
    from .session import opened

    with opened(quiet, log_file) as session:
        with bad_input():
            settings = written_case(directory)
            if settings.history is None:
                raise ValueError(f"{directory} contains a single run, not a load history: there is nothing to resume")

        from .run_case import compute

        compute(session, settings, directory, directory, force, resume=True)


app.command("new")(new)
app.command("check-case")(check_case)
app.command("contacts")(contacts)
app.command("convert")(convert)
app.command("import")(import_deck)


@app.command()
def info() -> None:
    """Versions and PETSc's packages, for a bug report."""
    from ..io.environment import details

    for name, value in details().items():
        _console.out(f"{name:<18}{value}")


@app.command()
def fclib(
    file: Annotated[
        Path,
        typer.Argument(
            help="Problem in FCLIB's format, local or global: .hdf5, or .npz with W_data, W_indices, W_indptr, q, mu."
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object instead of lines.")] = False,
    tolerance: Annotated[float, typer.Option("--tolerance", min=1e-12, help="Coulomb residual to stop at.")] = 1e-8,
    dense: Annotated[
        bool, typer.Option("--dense", help="Successive Tresca with dense Newton systems, for small problems.")
    ] = False,
) -> None:
    """Solve a friction problem in FCLIB's format, and report its residual as defined by FCLIB.

    Exit code 1 if it is refused: the reason is on standard error.
    """
    refuse_ranks("coulomb fclib")
    if tolerance > 1.0:
        fail(f"--tolerance must be from 1e-12 to 1, but is {tolerance}")

    from ..io.fclib import read_fclib
    from ..solvers.interior_point import InteriorPoint
    from ..solvers.newton_systems import DenseSystem
    from ..solvers.results import NotConverged
    from ..solvers.rigid import MatrixAutomatic, solve_coulomb
    from ..solvers.successive_tresca import SuccessiveTresca

    trouble = ""
    solver: Solver = MatrixAutomatic(tolerance)
    if dense:
        solver = SuccessiveTresca(tolerance, InteriorPoint(newton=DenseSystem()))
    with bad_input():
        problem = read_fclib(file)
        try:
            result = solve_coulomb(problem.W, -problem.q, problem.mu, solver)
        except NotConverged as failure:
            result, trouble = failure.result, str(failure)
    report = {
        "file": str(file),
        "title": problem.title.strip(),
        "contacts": len(problem.mu),
        "status": result.status.value,
        "residual": result.residual,
        "fclib_residual": problem.residual(result.x),
        "method": result.method,
        "outer": result.outer_steps,
        "path_following": result.newton_steps,
        "products": result.products,
    }
    if as_json:
        _console.out(json.dumps(report))
    else:
        for name, value in report.items():
            shown = f"{value:.2e}" if isinstance(value, float) else value
            _console.out(f"{name:<16}{shown}")
    if trouble:
        fail(trouble, FAILED)


@app.command()
def export(
    case: Annotated[Path, typer.Argument(help="Case file, TOML, with Coulomb friction.", metavar="CASE.toml")],
    file: Annotated[Path, typer.Argument(help="FCLIB file to write, HDF5.")],
    changes: Annotated[list[str] | None, typer.Option("--set", help="Replace a setting; may be repeated.")] = None,
    at: Annotated[
        float | None,
        typer.Option("--time", help="Time of the loads of a load history; by default the end of its last step."),
    ] = None,
) -> None:
    """Write the contact problem of a case, condensed to its contact nodes, in FCLIB's format.

    For a load history it is the problem of a single step, from the undeformed body to the loads at one time.
    """
    refuse_ranks("coulomb export")

    from ..case.case import read_case

    with bad_input():
        settings = read_case(case, changes or ())
        time = _time_of(settings, at)
        if not file.absolute().parent.is_dir():
            raise ValueError(f"{file}: there is no folder {file.parent}; create it first")

    import scipy.sparse

    from ..io.fclib import FCLIBProblem, write_fclib
    from ..linalg.compliance import SchurCompliance
    from ..linalg.reductions import Reductions

    try:
        problem = settings.problem()
        if time is not None:
            problem = problem.at(time)
        problem.body.stiffness.expect_load_steps(problem.unknowns["contact"])  # all of A takes as many products
        if not Reductions(problem.comm).all(problem.law.proportional):
            raise ValueError(
                "FCLIB's problems have Coulomb's law with constant coefficients; this case has a cohesion or a slip "
                "stress, a friction limit or friction by pressure"
            )
        if any(contact.axes is not None for contact in problem.contacts):
            raise ValueError("FCLIB's problems have one coefficient of friction per contact; this case has two")
        if problem.rigid is not None:
            raise ValueError(
                "contact alone holds a body: its equilibrium is not in FCLIB's problems; add a clamp or a [[spring]]"
            )
        if not isinstance(problem.A, SchurCompliance):
            raise ValueError('A is not formed for a problem of this size; set solver.compliance="explicit"')
        mu = problem.law.friction
        W = scipy.sparse.csr_matrix(problem.A.dense())
        write_fclib(file, FCLIBProblem(W, -problem.b, mu, case.stem))
    except ValueError as error:
        fail(str(error))
    except OSError as error:
        fail(f"{file}: cannot be written: {error.strerror or error}", FAILED)
    when = "" if time is None else f", in one step from rest to time {time:g}"
    _console.out(f"{len(mu)} contacts in {file}{when}")


def _time_of(settings: Case, asked: float | None) -> float | None:
    """The time at which a case is exported; None for a case without a history.

    Raises:
        ValueError: If the given time is outside the history.
    """
    if settings.history is None:
        if asked is not None:
            raise ValueError("--time is for load histories: this case has no history")
        return None
    end = settings.history.ends[-1]
    if asked is not None and not 0.0 <= asked <= end:
        raise ValueError(f"--time {asked:g}: must be from 0 to the end of the history, {end:g}")
    return end if asked is None else asked


@app.command()
def check(directory: Annotated[Path, typer.Argument(help="Directory of the results of a run.")]) -> None:
    """Check results by their case, posed anew: 0 if they are certified and agree, 1 if not, 2 if they cannot be read.

    A run, a load history with all its steps, or one of these steps.
    """
    refuse_ranks("coulomb check")

    from ..recheck import check as check_files

    finish_for_reader(directory)
    with bad_input():
        report = check_files(directory, say=_console.out)
    _console.out(report.ending)
    if not report.passed:
        raise typer.Exit(FAILED)


def main() -> None:
    """Run a command (`coulomb.__main__`); an unexpected exception on one rank ends all ranks."""
    code = 0
    try:
        app()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception as error:
        if said := unusable(error):
            sys.stderr.write(f"error: {said}\n")
            process.leave(BAD_INPUT, FAILED)
        sys.stderr.write(traceback.format_exc())
        sys.stderr.flush()
        comm = launched()
        if comm is not None and comm.size > 1:
            time.sleep(0.5)  # MPICH's mpiexec drops on Abort what it has not yet passed on
            comm.Abort(CRASHED)
        code = CRASHED
    process.leave(code, FAILED)
