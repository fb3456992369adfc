"""The same problem on other meshes, and its answers there."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from ..fem.bodies import Deformable
from ..fem.meshes import JoinedMesh, NamedMesh, coarser_meshes, same_cells, smaller_cells
from ..model.discrete_problem import DiscreteProblem
from ..model.memory import least_room
from ..model.problem import ContactProblem
from ..model.solving import Solving
from ..solvers.results import NotConverged
from .answer import Answer, answer_of
from .locking import needs_second_order


class NoErrorBars(ValueError):
    """An answer cannot be compared with others, with the reason."""


Way = Callable[[NamedMesh | JoinedMesh], Iterator[NamedMesh | JoinedMesh]]


def other_problems(problem: DiscreteProblem, ways: Sequence[Way] = ()) -> Iterator[list[ContactProblem]]:
    """The same problem on up to two coarser meshes, and on the same cells with elements of the other order
    (`same_cells`), or smaller ones where first order locks, if that is needed; one at least, else a NoErrorBars on all
    ranks; collective.

    Others than these two if `ways` are given.  A mesh on which it cannot be posed is left out: supports hold all nodes
    of a single cell, curved cells may become flat, and faces or groups that were added to a box are not on coarser
    ones.
    """
    if not isinstance(problem, ContactProblem) or isinstance(mesh := problem.made_of, Deformable):
        raise NoErrorBars(
            "a Body of your own forms cannot be posed on another mesh from here: solve it on another one too, or in a "
            "space of another degree on the same one, and give the answers: solution.error(other)"
        )
    refusal, posed = "", False
    for others in ways or (coarser_meshes, smaller_cells if needs_second_order(problem.elasticity) else same_cells):
        coarser = []
        with without_remarks():
            try:
                for other in others(mesh):
                    coarser.append(problem.on(other))
            except ValueError as error:
                refusal = f"the problem has no other mesh: {error}"
        if coarser:
            posed = True
            yield coarser
    if not posed:
        raise NoErrorBars(refusal)


def refuse_too_large(problem: ContactProblem) -> None:
    """A ValueError on every rank if a node has too little free memory; collective."""
    needed, fits = problem.body.memory(), least_room(problem.comm)
    if needed > fits:
        raise NoErrorBars(f"it needs about {needed / 1e9:.2g} GB of memory, and {fits / 1e9:.2g} GB are free")


@contextmanager
def without_remarks() -> Iterator[None]:
    """Remarks on input and answer are about the mesh, or the case, of the answer."""
    log = logging.getLogger(__package__.partition(".")[0])
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def answer_on(problem: ContactProblem, solving: Solving) -> Answer:
    """The answer on another mesh; NoErrorBars if there is none; collective."""
    began = time.perf_counter()
    try:
        refuse_too_large(problem)
        with without_remarks():
            answer = problem.solve(solving.tolerance, solving.solver, solving.progress)
    except (NotConverged, ValueError) as error:
        unknowns = problem.unknowns["displacement"]
        raise NoErrorBars(f"on another mesh ({unknowns} unknowns): {error}") from None
    return replace(answer_of(answer, solving.tolerance), seconds=time.perf_counter() - began)
