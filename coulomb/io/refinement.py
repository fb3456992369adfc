"""Meshes that refine themselves until the totals that are asked for are known well enough."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np

from ..arrays import is_number
from ..fem.bodies import Deformable, relative_error
from ..fem.contact import interpolated_forces
from ..fem.meshes import finer
from ..model.problem import ContactProblem
from ..model.solution import Solution
from ..model.solving import Solving
from ..solvers.friction_problem import Solver
from ..solvers.results import NotConverged, ProgressCallback
from .accuracy import TOLERANCE
from .answer import FREE, Answer, answer_of
from .energy_error import recovered_errors
from .error_bars import SHAPE, ErrorBar, ErrorBars, bars_of, error_of, with_second_order
from .other_meshes import NoErrorBars, refuse_too_large

SMOOTH: Final = 0.02
"""Volume by which the smooth surface through the nodes of a mesh is wrong, over that between it and the facets:
measured up to 0.014 of shafts and balls with ten chords in a circle (docs/error-bars.md)."""

FLAT: Final = 0.25
"""Part of the bar asked for that facets may have which are not divided."""

UNKNOWNS: Final = 300_000
"""Displacement unknowns that a finer mesh may have by default."""


@dataclass(frozen=True)
class Refined:
    """An answer on a mesh that was refined for it.

    Attributes:
        bars: Its error bars, by the meshes before; None if there are no others.
        largest: The largest error bar of the totals asked for, over the total; inf without bars.
        trouble: Why it is not as small as was asked for; empty if it is.
    """

    solution: Solution
    bars: ErrorBars | None
    largest: float
    trouble: str


def refine(
    problem: ContactProblem,
    to: float,
    totals: Sequence[str] = (),
    unknowns: int = UNKNOWNS,
    tolerance: float = TOLERANCE,
    solver: Solver | None = None,
    progress: ProgressCallback | None = None,
    said: Callable[[Refined, float], None] = lambda *_: None,
) -> Refined:
    """Solve a problem on finer and finer meshes (`fem.meshes.finer`), each started from the forces on the one before,
    until the error bars of some totals, by the last three meshes, are small enough; collective.

    Args:
        problem: The problem, on a coarse mesh.
        to: Error bar over total, at most, as 0.02; over the largest of those in the same unit.
        totals: Places of the totals in summary.json; by default the force on every contact face, the strain energy and
            the largest displacement.
        unknowns: Displacement unknowns that no finer mesh may exceed.
        progress: Called after every step of a solver.
        said: Called on every mesh with the answer on it, and the error of the stress over the stress in the energy norm
            (Zienkiewicz and Zhu).

    Returns:
        The answer on the finest mesh that has one, with the reason if a finer one failed or was interrupted.

    Raises:
        NoErrorBars: If the problem has a body of the user's forms or is a load step, or a total is unknown.
        ValueError: If an argument is wrong, and as of `ContactProblem.solve`.
        NotConverged: As of `ContactProblem.solve`, on the first mesh.
    """
    _refuse(problem, to, totals, unknowns)
    posed, start, solving = problem, None, Solving(tolerance, solver, progress)
    answers: list[Answer] = []
    best: Refined | None = None
    while True:
        try:
            if best is not None:
                refuse_too_large(posed)
            solution = posed.solve(tolerance, solver, progress, start)
        except (NotConverged, NoErrorBars) as failure:
            if best is None:
                raise
            return replace(best, trouble=f"the next mesh, {posed.unknowns['displacement']} unknowns: {failure}")
        stress = recovered_errors(solution)
        answers.insert(0, answer_of(solution, tolerance))
        asked = _asked([name for name in answers[0].totals if name != FREE], totals)
        best = Refined(solution, None, math.inf, "")
        unknown = SMOOTH * answers[-1].polygon

        def with_bars(bars: ErrorBars, best: Refined = best, asked: Sequence[str] = asked) -> Refined:
            return replace(best, bars=bars, largest=_relative([bars[name] for name in asked]))

        if len(answers) > 1:
            best = with_bars(bars_of(answers[:3], unknown))
            if best.largest <= to:
                best = with_bars(with_second_order(solution, answers[:3], solving, unknown))
        said(best, relative_error(stress.values()))
        if best.largest <= to:
            return best
        mesh = posed.made_of
        assert not isinstance(mesh, Deformable)
        of_cells = {name: one.squared if one.along is None else one.along for name, one in stress.items()}
        try:
            posed = problem.on(finer(mesh, of_cells, FLAT * to / SHAPE))
            if (many := posed.unknowns["displacement"]) > unknowns:
                if len(answers) == 1:  # no finer mesh: others tell
                    best = with_bars(error_of(solution, tolerance=tolerance, solver=solver, progress=progress))
                else:
                    best = with_bars(with_second_order(solution, answers[:3], solving, unknown))
                enough = best.largest <= to
                trouble = "" if enough else f"the next mesh would have {many} unknowns, more than {unknowns}"
                return replace(best, trouble=trouble)
        except ValueError as failure:
            return replace(best, trouble=f"there is no other mesh: {failure}")
        start = interpolated_forces(solution.contact_force, solution.problem.surface, posed.surface)


def _refuse(problem: ContactProblem, to: object, totals: object, unknowns: object) -> None:
    """A ValueError on every rank for arguments of `refine` that are wrong."""
    if not is_number(to) or not 0.0 < float(cast(float, to)) < 1.0:
        raise ValueError(f"refine: to must be a part of the totals between 0 and 1, as 0.02 for 2 %, but is {to!r}")
    if isinstance(totals, str) or not isinstance(totals, Sequence) or not all(isinstance(one, str) for one in totals):
        raise ValueError(f'refine: totals must be a list of names, as ["totals.normal_force"], but is {totals!r}')
    if not is_number(unknowns, 1.0):
        raise ValueError(f"refine: unknowns must be a number of displacement unknowns, at least 1, but is {unknowns!r}")
    if isinstance(problem.made_of, Deformable):
        raise NoErrorBars("a Body of your own forms cannot be posed on a finer mesh from here")
    if problem.before is not None:
        raise NoErrorBars("refinement is for single runs: refine the mesh for the loads of one time, problem.at(time)")


def _asked(known: Iterable[str], totals: Sequence[str]) -> list[str]:
    if unknown := [name for name in totals if name not in known]:
        raise NoErrorBars(f"there is no total {unknown[0]!r}; there are {', '.join(known)}")
    forces = [name for name in known if name.startswith(("totals", "faces")) and name.endswith(".force")]
    return list(totals) or [*forces, "strain_energy", "maximum.displacement"]


def _relative(bars: Sequence[ErrorBar]) -> float:
    """The largest error bar, over the largest of the totals in the same unit; inf where one does not converge."""
    sizes: dict[str, float] = {}
    for one in bars:
        sizes[one.unit] = max(sizes.get(one.unit, 0.0), float(np.linalg.norm(one.value)))
    parts = [float(np.linalg.norm(bar.bar)) / (sizes[bar.unit] or 1.0) for bar in bars]
    return max(part if math.isfinite(part) else math.inf for part in parts)
