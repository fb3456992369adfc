"""From a case to a problem for which memory and disk suffice, and its estimated cost."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from ..case.case import Case
from ..fem.bodies import LOCKING_ABOVE
from ..io.earlier_results import refuse_to_replace
from ..io.history_files import steps_left
from ..io.lock import refuse_in_use
from ..io.output import refuse_full_disk, size_on_disk
from ..model.estimate import estimate_of, gigabytes, refuse_too_large, refuse_too_many_cells, refuse_uncountable
from ..model.machine import measure
from ..model.problem import ContactProblem
from ..ranks import on_rank_0
from ..regular_file import unwritable
from .console import errors
from .time_left import about


def posed(
    settings: Case,
    target: Path,
    force: bool,
    now: bool = True,
    overwrite: bool | None = None,
    resume: bool = False,
) -> ContactProblem:
    """The problem of a case, after a check of memory and disk; collective.

    Args:
        settings: The case.
        target: Directory of the results.
        force: Skip the checks of memory and disk.
        now: Whether the run follows at once, so that the directory must not be in use.
        overwrite: Whether the run may replace any results in the directory, or only those of the same case; None if it
            continues these.
        resume: Whether the load steps in the directory are continued: of a few that are left multigrid may be faster.

    Raises:
        ValueError: On every rank.
    """
    comm = MPI.COMM_WORLD
    refuse_unwritable(target, comm)
    if now:
        refuse_in_use(target, comm)
    if overwrite is not None:
        refuse_to_replace(settings, target, overwrite, comm)
    for mesh in settings.meshes.values():
        if mesh.cells is not None:
            if not force:
                refuse_too_many_cells(mesh.cells, mesh.degree or 1, comm)
            refuse_uncountable(mesh.cells, mesh.degree or 1)
    problem = settings.problem(comm)
    if resume and (left := steps_left(target, comm)) is not None:
        problem.body.stiffness.expect_load_steps(left)
    if not force:
        refuse_too_large(problem)
        steps = 1 if settings.history is None else len(settings.history.ends)
        try:
            refuse_full_disk(problem, target, steps)
        except OSError as error:
            raise ValueError(f"output {target}: {error.strerror}; --force runs nevertheless") from None
    return problem


def refuse_unwritable(target: Path, comm: MPI.Comm) -> None:
    """Check beforehand that results can be written.

    Raises:
        ValueError: On every rank, if the directory or its parent is not a directory or not writable.
    """

    if found := on_rank_0(comm, lambda: unwritable(target)):
        raise ValueError(f"output {target}: cannot be written: {found}; choose another (--output)")


def doubts(settings: Case, problem: ContactProblem) -> None:
    """Warn about settings that are allowed but probably not intended.

    Args:
        settings: The case.
        problem: Its problem.
    """
    given = settings.material_tables
    for member in problem.elasticity.members:
        highest = max((one.poisson for one in given[member.name] if not isinstance(one.poisson, tuple)), default=0.0)
        if highest > LOCKING_ABOVE and member.body.mesh.degree == 1:  # elements of second order do not lock
            of, table = (f" of body {member.name!r}", "[[body]]") if member.name else ("", "[mesh]")
            errors.print(
                f"warning: material{of}: poisson = {highest} is near 0.5: above {LOCKING_ABOVE:g} first-order elements "
                "lock and give an answer that is far too stiff, although the discrete problem is certified; "
                f"second-order ones do not (degree = 2 in {table})",
                markup=False,
            )


def expected(settings: Case, problem: ContactProblem) -> list[str]:
    """Estimated cost of the solution, in lines; collective."""
    taken, ranks = estimate_of(problem, measure(problem.comm)), problem.comm.size
    seconds, steps, drawn = taken.seconds, 1, ""
    lines = [f"K {problem.body.stiffness.method}, A {'explicit' if problem.body.stiffness.explicit else 'matrix-free'}"]
    if settings.history is not None:
        steps = len(settings.history.ends)
        seconds += (steps - 1) * taken.seconds_a_step
        lines.append(f"{steps} load steps, each halved up to {settings.history.halvings} times if it fails")
    if settings.output.picture:
        seconds, drawn = seconds + taken.picture, ", its picture included"
    disk = steps * size_on_disk(problem)
    lines.append(
        f"about {gigabytes(taken.memory)} of memory, {gigabytes(disk)} on disk and {about(seconds)}"
        f"{f' on {ranks} ranks, a core for each' if ranks > 1 else ' on one core'}{drawn}; accurate to a "
        "factor of two, at the present speed of this machine"
    )
    if settings.history is not None:
        lines.append(f"a film of it (coulomb plot --save film.gif): about {about(taken.picture + steps * taken.frame)}")
    return lines
