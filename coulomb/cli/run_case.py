"""A run from its problem to its exit code: solution, output, report, interruption."""

from __future__ import annotations

import gc
import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, cast

import typer
from mpi4py import MPI
from threadpoolctl import threadpool_limits

from ..case.case import Case
from ..case.record import case_record, case_text, refuse_another_case, write_case
from ..contact_fields import normal_forces
from ..fem.compilation import announce
from ..fem.contact import NothingOpposite
from ..fem.meshes import JoinedMesh, NamedMesh, gathered
from ..fem.meshes import write as write_mesh
from ..io import output
from ..io.accuracy import accuracy
from ..io.atomic_output import PARTIAL, locked, refuse_to_replace
from ..io.history_files import HistoryFiles, read_summary, steps_left, steps_on_disk, whole_history
from ..io.other_formats import write_formats
from ..io.refinement import Refined, refine
from ..io.run_directory import MESH, PICTURE, RunDirectory
from ..io.summary import summary
from ..linalg.factors import NotPositiveDefinite
from ..model.load_history import StepFailed
from ..model.load_step import LoadStep
from ..model.problem import ContactProblem
from ..model.solution import Solution
from ..model.stopping_criterion import failing_at_tolerance
from ..model.times import in_times
from ..pictures import drawing_process, picture_of_run
from ..pictures.drawing_process import DrawingProcess
from ..ranks import on_rank_0
from ..solvers.results import NotConverged, Status
from .bars import Sensitivities, bars_of_steps, error_bars
from .console import FAILED, INTERRUPTED, bad_input, errors, fail
from .picture_commands import write_report
from .preparation import prepared, refuse_unwritable
from .session import Session
from .terminal import (
    Display,
    about,
    changes_in_words,
    forces_in_a_step,
    introduce,
    report,
    report_history,
    show_error_bars,
    show_input,
    show_sensitivity,
    warn,
)

Refinement = tuple[float, list[str], int]
"""What is asked for: error bar over total, the totals, and the largest number of unknowns."""

SOLVED_WHILE_LOADING: Final = 20_000
"""Displacement unknowns up to which a case is solved before the drawing process has loaded its libraries.  On two
processors a second thread of BLAS then delays both: 2.3 s in place of 2.0 s for demos/block.toml."""


def allows_large(settings: Case) -> bool:
    """Whether a deck is solved with small motions first, and with large ones where these are too large for that."""
    return settings.deck is not None and settings.deck.nonlinear and settings.solver.kinematics != "large"


def compute(
    session: Session,
    settings: Case,
    source: Path,
    target: Path,
    force: bool,
    resume: bool = False,
    keep: bool = False,
    renderer: DrawingProcess | None = None,
    refinement: Refinement | None = None,
) -> None:
    """Pose the problem of a case and solve it, or continue its load history from the steps in the directory of the
    results (`resume`); ends the command with its exit code.  Results that are there are replaced, unless the user wants
    to `keep` them.

    `source` is the file or directory of the case as given by the user.  If forced, case.json says that strains outside
    the theory are accepted.  `renderer` is the drawing process, if it has been started already.  With a `refinement`
    the mesh is refined.
    """
    if gc.get_threshold()[0] < 20_000:  # once in a process: what is garbage then stays for ever
        gc.freeze()  # the modules loaded so far, which are no garbage and take long to search
        gc.set_threshold(20_000)
    if force:
        settings = settings.model_copy(update={"small_strain": "warn"})
    with threadpool_limits(limits=1 if MPI.COMM_WORLD.size > 1 else None), _holding(target, MPI.COMM_WORLD):
        announce()
        with bad_input(but=(NothingOpposite,) if allows_large(settings) else ()):
            session.kept = "" if resume else refuse_to_replace(target, not keep, MPI.COMM_WORLD)
            settings, problem = prepared(settings, target, force, resume)
        problem.started = session.started
        introduce(session.console, source, problem)
        with suppress(ValueError):  # a history that cannot be read is replaced as well
            if session.kept and steps_left(target, problem.comm):
                go_on = f"coulomb resume {target}"
                session.console.out(f"{target} has an unfinished load history, which `{go_on}` would continue")
        show_input(session.console, settings, problem)
        with bad_input(NotPositiveDefinite):  # seen when K is factorised
            if settings.history is not None:
                _take_steps(session, settings, problem, target, resume)
            else:
                with threadpool_limits(limits=_threads(problem, renderer)):
                    _solve_once(session, settings, problem, target, renderer, refinement)


def _threads(problem: ContactProblem, renderer: DrawingProcess | None) -> int | None:
    """Threads of BLAS: one processor is left to a drawing process that still loads; None for no limit."""
    if renderer is None or problem.unknowns["displacement"] > SOLVED_WHILE_LOADING:
        return None
    return max(drawing_process.processors() - 1, 1)


@contextmanager
def _holding(target: Path, comm: MPI.Comm) -> Iterator[None]:
    """Lock the directory of the results; ends the command if it is in use or cannot be created."""
    with ExitStack() as stack:
        with bad_input():
            refuse_unwritable(target)
            try:
                stack.enter_context(locked(target, comm))
            except OSError as error:
                raise ValueError(f"output {target}: cannot be written: {error.strerror or error}") from None
        yield


def _solve_once(
    session: Session,
    settings: Case,
    problem: ContactProblem,
    target: Path,
    renderer: DrawingProcess | None,
    refinement: Refinement | None = None,
) -> None:
    """Solve, certify, write and report; ends the command with its exit code."""
    with ExitStack() as stack:
        if refinement is None:
            solution, trouble = _solve(session, settings, problem)
            files, mesh, bars = case_record(settings, problem.comm)["files"], None, dict[str, Any]()
        else:
            refined = _refine(session, settings, problem, refinement, target)
            solution, trouble, bars = refined.solution, refined.trouble, _entry(refined)
            settings, files, mesh = stack.enter_context(refined_case(settings, solution, target))
        _write_and_report(session, settings, solution, trouble, target, renderer, bars, files, mesh)


def _refine(session: Session, settings: Case, problem: ContactProblem, refinement: Refinement, target: Path) -> Refined:
    """The answer on a mesh refined until its error bars are small enough; that on every mesh is written, for a run that
    is killed later."""
    to, totals, unknowns = refinement
    display = Display(session.console, changing=True)

    def so_far(refined: Refined) -> str:
        known = "no error bars yet" if refined.bars is None else f"error bars of {100.0 * refined.largest:.2g} %"
        return f"{known}, {100.0 * to:.2g} % was asked for"

    def say(refined: Refined, stress: float) -> None:
        sizes, bars = refined.solution.problem.unknowns, ""
        if math.isfinite(refined.largest):
            bars = f", error bars up to {100.0 * refined.largest:.2g} % of the totals"
        session.console.out(
            f"mesh of {sizes['displacement']} displacement and {sizes['contact']} contact unknowns: "
            f"error of the stress {100.0 * stress:.2g} %{bars}"
        )
        refined.solution.problem.seconds["total"] = time.perf_counter() - session.began
        with suppress(OSError), refined_case(settings, refined.solution, target) as (case, files, mesh):
            extra = {"message": f"not finished: {so_far(refined)}", "mesh_files": files, **_entry(refined)}
            _write(session, refined.solution, target, extra, case, mesh)

    with display, bad_input():
        solver, progress = settings.contact_solver(), session.progress(display)
        try:
            refined = refine(problem, to, totals, unknowns, settings.solver.tolerance, solver, progress, say)
        except NotConverged as failure:
            return Refined(problem.solution(failure.result), None, math.inf, f"{failure}; no mesh was refined")
    return replace(refined, trouble=f"{so_far(refined)}: {refined.trouble}") if refined.trouble else refined


def _entry(refined: Refined) -> dict[str, Any]:
    """The entry `error` of summary.json, if there are bars."""
    return {} if refined.bars is None else {"error": refined.bars.entry()}


def _write_and_report(
    session: Session,
    settings: Case,
    solution: Solution,
    trouble: str,
    target: Path,
    renderer: DrawingProcess | None,
    bars: dict[str, Any],
    files: dict[str, str],
    mesh: Path | None,
) -> None:
    problem, asked = solution.problem, settings.output.error and not trouble and mesh is None
    interrupted = solution.result.status is Status.INTERRUPTED
    problem.seconds["total"] = time.perf_counter() - session.began
    written = True
    stopped = session.interruption
    try:
        extra = {"message": trouble, **({"mesh_files": files} if files else {}), **bars}
        contents = _write(session, solution, target, extra, settings, mesh)
        if not trouble and (owed := Sensitivities(settings).of(solution)):  # the answer is safe
            extra |= owed
            contents = _write(session, solution, target, extra, settings, mesh)
        if asked and (bars := error_bars(session, settings, solution)):
            problem.seconds["total"] = time.perf_counter() - session.began
            contents = _write(session, solution, target, extra | bars, settings)
        if settings.output.picture and not stopped.asked():
            contents = picture_of_run.add_picture(contents, target, problem.comm, lambda: stopped.requested, renderer)
    except OSError as error:
        contents, written = summary(solution), False
        trouble += f"{'; ' if trouble else ''}{target}: cannot be written: {error.strerror or error}"
    took = time.perf_counter() - session.began
    report(
        session.console, solution, contents, target if written else None, session.kept, took, settings.solver.tolerance
    )
    if written:
        _write_formats(settings, target, problem.comm)
    if written and settings.output.report:
        _draw(session, lambda stop: write_report(target, stop))
    if not trouble and (said := failing_at_tolerance(solution.certificate, settings.solver.tolerance)):
        errors.out(f"warning: {said}")
    if written and interrupted:
        trouble = f"interrupted: {trouble}; the answer so far is in {target}{os.sep}, marked as interrupted"
    elif written and stopped.asked():
        interrupted = True
        finest = f"interrupted: {trouble}; the answer on the finest mesh solved is in {target}{os.sep}"
        trouble = finest if mesh is not None and trouble else _cut_short(settings, target)
    if trouble:
        errors.out(f"error: {trouble}")
    if interrupted:
        raise typer.Exit(INTERRUPTED)
    if trouble or not solution.valid:
        raise typer.Exit(FAILED)


def _write(
    session: Session, solution: Solution, target: Path, extra: dict[str, Any], case: Case, mesh: Path | None = None
) -> dict[str, Any]:
    """Write an answer and its case; results before are kept, but not those of this run."""
    contents = output.write(solution, target, extra, case_text(case), mesh=mesh, keep=not session.written)
    session.written = True
    return contents


@contextmanager
def refined_case(
    settings: Case, solution: Solution, target: Path
) -> Iterator[tuple[Case, dict[str, str], Path | None]]:
    """The case with the meshes of an answer, the digests of their files, and the directory that has them until it is
    moved to its place in the results; collective."""
    comm, made = solution.problem.comm, cast(ContactProblem, solution.problem).made_of
    assert isinstance(made, NamedMesh | JoinedMesh)  # of a case
    meshes = {"": made} if isinstance(made, NamedMesh) else made.bodies

    def begin() -> Path:
        folder = target / f"{PARTIAL}-mesh"
        folder.mkdir(parents=True)
        return folder

    def case_in(place: Path) -> Case:
        tables = settings.model_dump(mode="json", exclude_unset=True)
        named = {name: str((place / f"{name or 'mesh'}.xdmf").absolute()) for name in meshes}
        if settings.mesh is not None:
            tables["mesh"] = {"file": named[""]}
        for table in tables.get("body", ()):
            kept = {key: table[key] for key in ("name", "material", "gravity") if key in table}
            table.clear()
            table.update(kept, file=named[kept["name"]])
        if tables.pop("auto_contact", None) is not None:
            tables["contact"] = [one.model_dump(mode="json", exclude_unset=True) for one in settings.contacts.values()]
        return Case.model_validate_json(json.dumps(tables))

    folder = on_rank_0(comm, begin)
    try:
        for name, one in meshes.items():
            on_rank_0(comm, partial(write_mesh, gathered(one), folder / f"{name or 'mesh'}.xdmf"))
        yield case_in(target / MESH), case_record(case_in(folder), comm)["files"], folder
    finally:
        if comm.rank == 0:
            shutil.rmtree(folder, ignore_errors=True)


def _solve(session: Session, settings: Case, problem: ContactProblem) -> tuple[Solution, str]:
    """The solution, converged or not, and an error message or nothing."""
    display = Display(session.console)
    try:
        with display:
            return problem.solve(solver=settings.contact_solver(), progress=session.progress(display)), ""
    except NotConverged as failure:
        return problem.solution(failure.result), str(failure)


def _take_steps(session: Session, settings: Case, problem: ContactProblem, target: Path, resume: bool) -> None:
    """Run a load history; ends the command with its exit code."""
    console, comm = session.console, problem.comm
    with bad_input():
        record = case_record(settings, comm)
        done = steps_on_disk(target, comm) if resume else 0
        if done and settings.output.sensitivity:
            raise ValueError("output.sensitivity: those of a history follow from its first step on: run it anew")
        changed = refuse_another_case(settings, target, done, comm) if done else []
    for change in changed:
        errors.out(f"warning: from step {done + 1} on {change}")
    began, trouble, then, code = time.perf_counter(), "", "", FAILED
    display = Display(console, changing=True)
    warned: tuple[str, ...] = ()
    taken = 0
    forces: list[float] = []
    history = settings.load_history()
    planned = pairwise((history.start, *history.times))
    wide = min(40, max(len(changes_in_words(settings, start, end)) for start, end in planned))

    def say(step: LoadStep) -> bool:
        nonlocal warned, taken
        row, taken = step.row, taken + 1
        forces.extend(normal_forces(row).values())
        least = accuracy(step.solution.force_balance.entries(), settings.solver.tolerance, forces=forces)
        halved = f", halved {in_times(step.halvings)}: {step.why_halved}" if step.halvings else ""
        problems, start = step.solution.methods.get("linear_problems"), step.solution.problem.before
        assert start is not None  # the state from which the step was computed
        changes, when = changes_in_words(settings, start.time, row["time"]), f"{row['time']:.4g} s"
        linear = "" if problems is None else f"{problems} linear problems, "
        console.out(
            f"step {row['step']:3d}  {when:<8} {changes:<{wide}} "
            f"{forces_in_a_step(row, least['N'])}; open {row['open']}, stick {row['stick']}, slip {row['slip']}; "
            f"{linear}{row['path_following']} steps, "
            f"residual {row['residual']:.1e}"
            f"{'' if row['certified'] else ', certificate FAILED'}"
            f"{', OUTSIDE THE THEORY' if step.solution.outside else ''}{halved}"
        )
        if said := failing_at_tolerance(step.solution.certificate, settings.solver.tolerance):
            errors.out(f"warning: step {row['step']}: {said}")
        warnings = step.solution.small_strain.warnings
        if len(warnings) > len(warned):
            warn(*(f"step {row['step']}: {warning}" for warning in warnings))
        warned = max(warned, warnings, key=len)
        left = len(step.state.pending)
        if left:
            remaining = f"{left} load steps left, about {about(left * (time.perf_counter() - began) / taken)}"
            session.log.line(remaining)
            display.expect(remaining)
        return session.interruption.asked() and left > 0

    bars, write = bars_of_steps(session, settings, problem), partial(write_case, settings, target, comm)
    owed = Sensitivities(settings)
    files = HistoryFiles(
        target, resume=resume, case=record, entries=lambda step: bars(step) | owed.of(step.solution), when_begun=write
    )
    try:
        with display, bad_input():
            progress = session.progress(display)
            history.run(problem, files, progress=progress, on_step=say)
        if files.rows[-1]["time"] < history.times[-1]:
            trouble, code = "interrupted between two load steps", INTERRUPTED
    except StepFailed as failure:
        trouble = str(failure)
        if failure.result.status is Status.INTERRUPTED:
            code = INTERRUPTED
        else:
            trouble += _keep_failed(failure, files)
    except OSError as error:
        trouble = f"{target}: cannot be written: {error.strerror or error}"
        then = f"free some space, then: coulomb resume {target}"
    whole = whole_history(target, comm) if files.rows else None
    if whole is not None:
        _write_formats(settings, target, comm)
        files_of = RunDirectory(target)
        wanted = settings.output.picture and settings.output.report and code != INTERRUPTED
        if wanted and not session.interruption.asked() and _outdated(files_of.picture, comm):
            write_report(target, lambda: session.interruption.requested, "both")  # what it cannot do is tried alone
        if settings.output.picture and code != INTERRUPTED and _outdated(files_of.picture, comm):
            _draw(session, lambda stop: on_rank_0(comm, lambda: picture_of_run.draw(target, stop)), f"{PICTURE} ")
        if settings.output.report and _outdated(files_of.report, comm):
            _draw(session, lambda stop: write_report(target, stop))
        last = files_of.step(whole["steps"])
        contents = read_summary(last.path, comm)
        show_error_bars(console, contents, settings.solver.tolerance)
        show_sensitivity(console, contents)
        report_history(
            console, whole, taken, time.perf_counter() - began, target, session.kept, settings.solver.tolerance
        )
    if not trouble and session.interruption.asked():
        fail(_cut_short(settings, target), INTERRUPTED)
    if trouble:
        if code == INTERRUPTED:
            before = f"the {len(files.rows)} load steps before are in {target}{os.sep}"
            then = f"{before}; to continue: coulomb resume {target}"
        then = then if files.begun else f"{target}{os.sep} has its earlier results"
        errors.out(f"error: {trouble}{f'; {then}' if then else ''}")
    if trouble or not all(row["valid"] for row in files.rows):
        raise typer.Exit(code)


def _write_formats(settings: Case, target: Path, comm: MPI.Comm) -> None:
    """Write the fields in other formats than XDMF; what fails is a warning; collective."""
    try:
        on_rank_0(comm, lambda: write_formats(target, settings.output.format))
    except (OSError, ValueError) as error:
        errors.out(f"warning: {target}: output.format {list(settings.output.format)} cannot be written: {error}")


def _outdated(drawn: Path, comm: MPI.Comm) -> bool:
    """Whether a picture or the report is not there or older than the summary beside it; collective."""

    summary = RunDirectory(drawn.parent).summary
    return on_rank_0(comm, lambda: not drawn.exists() or drawn.stat().st_mtime_ns <= summary.stat().st_mtime_ns)


def _draw(session: Session, draw: Callable[[Callable[[], bool]], str], what: str = "") -> None:
    """Draw a picture or the report unless the run is to stop; its error, after `what`, is a warning; collective."""
    stopped = session.interruption
    if not stopped.asked() and (trouble := draw(lambda: stopped.requested)) and not stopped.asked():
        errors.out(f"warning: {what}{trouble}")


def _cut_short(settings: Case, target: Path) -> str:
    """Message for a run that was stopped after its results were written."""
    asked = {"picture": settings.output.picture, "report": settings.output.report}
    drawn = [name for name, wanted in asked.items() if wanted]
    missing = f", but the {' and the '.join(drawn)} may be missing" if drawn else ""
    return f"interrupted at the end: the results are complete in {target}{os.sep}{missing}"


def _keep_failed(failure: StepFailed, files: HistoryFiles) -> str:
    target = files.directory.failed.path
    try:
        files.begin(failure.problem.comm)
        output.write(failure.problem.solution(failure.result), target, keep=False)
    except OSError as error:
        return f"; the last iterate could not be written: {error.strerror or error}"
    return f"; the last iterate is in {target}"
