"""From a case to a problem that may be run: memory and disk suffice."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..case.case import Case
from ..case.scaled import refuse_unknown
from ..io.history_files import steps_left
from ..io.output import refuse_full_disk, size_on_disk
from ..linalg.compliance import DirectSolver, IterativeSolver, LinearSolver
from ..model.memory import least_memory, least_room, most_unknowns
from ..model.problem import ContactProblem
from ..ranks import on_rank_0
from ..regular_file import unwritable


def prepared(settings: Case, target: Path, force: bool, resume: bool = False) -> tuple[Case, ContactProblem]:
    """A case with the contacts that are found (`Case.resolved`), and its problem, after a check of supports against
    foundations and, unless forced, of memory and disk; collective, with a ValueError on every rank.

    To `resume` a few load steps multigrid may be faster.
    """
    comm = MPI.COMM_WORLD
    for name, mesh in settings.meshes.items():
        if isinstance(mesh.cells, tuple):
            refuse_too_many_cells(mesh.cells, mesh.order_of_box(settings.poisson(name)), force, comm)
    settings = settings.resolved(comm)
    problem = settings.problem(comm)
    if not isinstance(settings.output.sensitivity, bool):
        refuse_unknown(settings, settings.output.sensitivity, problem.surface.faces)
    problem.refuse_wrong_supports(() if settings.history is None else settings.history.ends)
    if resume and (left := steps_left(target, comm)) is not None:
        problem.body.stiffness.expect_load_steps(left)
    if not force:
        refuse_too_large(problem, [mesh.raised for mesh in settings.meshes.values() if mesh.raised])
        steps = 1 if settings.history is None else len(settings.history.ends)
        try:
            refuse_full_disk(problem, target, steps)
        except OSError as error:
            raise ValueError(f"output {target}: {error.strerror}; --force runs nevertheless") from None
    return settings, problem


# --- the directory ------------------------------------------------------------------------------------------------


def refuse_unwritable(target: Path) -> None:
    """A ValueError on every rank if a directory cannot be made or written to; collective."""
    if reason := on_rank_0(MPI.COMM_WORLD, lambda: unwritable(target)):
        raise ValueError(f"output {target}: cannot be written: {reason}; choose another (--output)")


# --- memory -------------------------------------------------------------------------------------------------------


def refuse_too_large(problem: ContactProblem, raised: Sequence[str] = ()) -> None:
    """A ValueError on every rank if a node has too little free memory, with what would fit, and the bodies whose order
    was `raised`; collective."""
    needed, fits = problem.body.memory(), least_room(problem.comm)
    if needed <= fits:
        return
    size, body = problem.unknowns, problem.body
    methods = "K factorised" if body.stiffness.linear_solver is DirectSolver else "multigrid"
    methods += ", A formed" if body.stiffness.explicit else ", A matrix-free"
    others: tuple[tuple[str, LinearSolver], ...] = (("direct", DirectSolver), ("iterative", IterativeSolver))
    would = [
        f'solver.linear_solver = "{name}" with solver.compliance = "matrix-free" ({gigabytes(other)})'
        for name, solver in others
        if (other := problem.body.memory((solver, False))) <= fits
    ]
    most = most_unknowns(fits, problem.comm.size, problem.body.nodes_of_cell)
    advice = f"take {' or '.join(would)}" if would else f"by multigrid {most} displacement unknowns would fit"
    raise ValueError(
        f"too little memory: {size['displacement']} displacement and {size['contact']} contact unknowns ({methods}) "
        f"need about {gigabytes(needed)}, and {gigabytes(fits)} are free; {advice}, a coarser mesh, or a larger "
        f"machine; --force tries nevertheless{''.join(f'; {text}' for text in raised)}"
    )


def refuse_too_many_cells(cells: tuple[int, int, int], degree: int, force: bool, comm: MPI.Comm) -> None:
    """As `refuse_too_large` for a box before its mesh is made, with the minimum for any method; collective.

    Raises:
        ValueError: On every rank; with `force` too, if PETSc's integers cannot number the unknowns.
    """
    unknowns, most = unknowns_of_box(cells, degree), int(np.iinfo(PETSc.IntType).max)
    mesh = (
        f"a mesh of {cells[0]} x {cells[1]} x {cells[2]} {'second-order ' if degree == 2 else ''}cells has {unknowns} "
        "displacement unknowns"
    )
    needed, fits = least_memory(unknowns, comm.size), least_room(comm)
    if needed > fits and not force:
        raise ValueError(
            f"too little memory: {mesh}, which need at least {gigabytes(needed)}, and {gigabytes(fits)} are free; take "
            "fewer cells (mesh.cells) or a larger machine; --force tries nevertheless"
        )
    if unknowns > most:
        raise ValueError(
            f"too many unknowns: {mesh}, and the integers of this PETSc reach {most}; take fewer cells (mesh.cells)"
        )


def unknowns_of_box(cells: tuple[int, int, int], degree: int) -> int:
    """Displacement unknowns of a box; of hexahedra and of tetrahedra they are the same."""
    return 3 * (degree * cells[0] + 1) * (degree * cells[1] + 1) * (degree * cells[2] + 1)


def gigabytes(size: float) -> str:
    return f"{size / 1e9:.2g} GB" if size < 99.5e9 else f"{size / 1e9:.0f} GB"


# --- for the user -------------------------------------------------------------------------------------------------


def expected(settings: Case, problem: ContactProblem) -> list[str]:
    """Methods, load steps, memory and disk of a run, in lines; collective."""
    ranks, steps = problem.comm.size, 1
    lines = [f"K {problem.body.stiffness.method}, A {'explicit' if problem.body.stiffness.explicit else 'matrix-free'}"]
    if settings.history is not None:
        steps = len(settings.history.ends)
        wanted = settings.history.friction_error
        inexact = "" if wanted is None else f", or until the error of friction by their size is {wanted:.2g}"
        lines.append(f"{steps} load steps, each halved up to {settings.history.halvings} times if it fails{inexact}")
    disk = steps * size_on_disk(problem)
    lines.append(
        f"about {gigabytes(problem.body.memory())} of memory on {f'{ranks} ranks' if ranks > 1 else 'one rank'}, "
        f"accurate to a factor of two, and {gigabytes(disk)} on disk"
    )
    return lines
