"""Meshes that refine themselves (`coulomb run --refine-to`) beside uniform ones: unknowns and time for the same error.

`hertz` is `verification.hertz` on the quarter of a box of 12 a x 12 a x 6 a, a the contact radius, with even cells.
Since the error depends on where the edge of the contact is in a cell, errors are root mean squares over four loads;
meshes are refined for the third.  The references have second order: on the graded mesh of the verification, and for
the blocks extrapolated from three refined ones (the block's normal force, 104.771 MN, is 104.769 MN on meshes with
planes at powers of the distance from the clamped edges).  Tetrahedra are those of a file, without planes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Deformable, stress_errors
from coulomb.fem.contact import interpolated_forces
from coulomb.fem.meshes import JoinedMesh, NamedMesh, box, finer, second_order
from coulomb.io.accuracy import TOLERANCE
from coulomb.io.answer import answer_of
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution
from verification import error_bars, hertz

from .block import block

WIDTH = 6.0 * hertz.A
LOADS = hertz.LOADS[0], hertz.LOADS[3], hertz.LOADS[5], hertz.LOADS[8]
REFERENCE = 90_000
"""Unknowns, at most, of the meshes of second order for the references of the blocks."""

LAST = 5
"""Uniform meshes, the finest ones, from which larger ones are extrapolated."""

Totals = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Compared:
    """A problem with its meshes.

    Attributes:
        make: The problem on a uniform mesh of some size.
        sizes: Of the uniform meshes.
        start: Size of the mesh that is refined.
        exact: The totals, for every load.
        totals: Those that are compared, places in summary.json.
        loads: Times at which the problem is posed; None if it has none.
    """

    make: Callable[[float], ContactProblem]
    sizes: Sequence[float]
    start: float
    exact: Callable[[], Totals]
    totals: tuple[str, ...]
    loads: tuple[float, ...] | None = None

    def at_load(self, problem: ContactProblem) -> ContactProblem:
        """The one for which meshes are refined and times are measured."""
        return problem if self.loads is None else problem.at(self.loads[2])

    def found(self, problem: ContactProblem, solution: Solution) -> Totals:
        """The totals of all loads; `solution` is that `at_load`."""
        solutions = [solution] if self.loads is None else [problem.at(load).solve() for load in self.loads]
        answers = [answer_of(one, TOLERANCE).totals for one in solutions]
        return {name: np.array([answer[name][0] for answer in answers]) for name in self.totals}


def _sphere(cell: str, cells: float) -> ContactProblem:
    n = int(cells)
    return hertz.problem(2, WIDTH).on(_of_file(box((WIDTH, WIDTH, WIDTH), (n, n, n), cell)))


def _block(cell: str, p: float) -> ContactProblem:
    n = int(p)
    return block(1).on(_of_file(box((3.0, 1.0, 1.0), (3 * n, n, n), cell)))


def _of_file(mesh: NamedMesh) -> NamedMesh:
    return replace(mesh, grid=None) if mesh.domain.topology.cell_type.name == "tetrahedron" else mesh


def _exact_sphere() -> Totals:
    problem = hertz.problem(8, WIDTH)
    mesh = problem.made_of
    assert isinstance(mesh, NamedMesh)
    fine = problem.on(second_order(mesh))
    return SPHERE.found(fine, SPHERE.at_load(fine).solve())


def _extrapolated(problem: ContactProblem) -> Totals:
    """From the last three of the refined meshes with up to REFERENCE unknowns."""
    problems: list[ContactProblem] = []
    while problem.unknowns["displacement"] <= REFERENCE:
        problems.append(problem)
        problem = problem.on(_finer(problem, problem.solve()))
    return error_bars.reference([partial(_itself, one) for one in problems[-3:]])[0]


def _itself(problem: ContactProblem) -> ContactProblem:
    return problem


BLOCK = Compared(
    partial(_block, "hexahedron"),
    (2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 24),
    2,
    lambda: _extrapolated(block(1, degree=2)),
    ("totals.normal_force", "strain_energy", "maximum.displacement"),
)
SPHERE = Compared(
    partial(_sphere, "hexahedron"),
    (4, 6, 8, 10, 12, 14, 16, 18, 20, 24, 28, 32, 36),
    4,
    _exact_sphere,
    ("totals.normal_force", "strain_energy", "totals.contact_area"),
    LOADS,
)
TWO_BLOCKS = Compared(
    error_bars.two_blocks,
    (0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.4, 2.8, 3.4),
    0.5,
    lambda: _extrapolated(error_bars.two_blocks(0.4, 2)),
    ("strain_energy", "maximum.displacement"),
)
PROBLEMS = {
    "block": BLOCK,
    "hertz": SPHERE,
    "two-blocks": TWO_BLOCKS,
    "block-tetrahedra": replace(BLOCK, make=partial(_block, "tetrahedron")),
    "hertz-tetrahedra": replace(SPHERE, make=partial(_sphere, "tetrahedron"), sizes=SPHERE.sizes[:-3]),
}


class Row(NamedTuple):
    """A total on a mesh; times are those of the processor.

    Attributes:
        error: Over the total, root mean square over the loads.
        seconds: Of the mesh: posing the problem and solving it.
        all_seconds: With all meshes before, the estimates of their errors, and refining them.
        fewer: Unknowns of the uniform mesh with this error, the first one, over those of the refined one.
        faster: Its seconds over all seconds.
        extrapolated: Whether no uniform mesh of the series has the error.
    """

    problem: str
    mesh: str
    unknowns: int
    seconds: float
    all_seconds: float
    total: str
    error: float
    fewer: float | None = None
    faster: float | None = None
    extrapolated: bool | None = None


def measure(name: str, unknowns: int = 60_000, sizes: Sequence[float] | None = None) -> Iterator[Row]:
    """Rows as they are measured: first of uniform meshes, then of refined ones up to so many displacement unknowns."""
    one = PROBLEMS[name]
    exact, uniform = one.exact(), []
    for size in sizes or one.sizes:
        began = time.process_time()
        problem = one.make(size)
        solution = one.at_load(problem).solve()
        seconds = time.process_time() - began
        for row in _rows(one, name, "uniform", problem, solution, exact, seconds, seconds):
            uniform.append(row)
            yield row
    problem, before, start, last = one.make(one.start), 0.0, None, None
    mesh = problem.made_of
    while not isinstance(mesh, Deformable):
        began = time.process_time()
        problem = problem.on(mesh)
        if problem.unknowns["displacement"] > unknowns:
            return
        if last is not None:
            start = interpolated_forces(last.contact_force, last.problem.surface, one.at_load(problem).surface)
        last = one.at_load(problem).solve(start=start)
        seconds = time.process_time() - began
        before += seconds
        for row in _rows(one, name, "refined", problem, last, exact, seconds, before):
            yield beside([other for other in uniform if other.total == row.total], row)
        began = time.process_time()
        mesh = _finer(problem, last)
        before += time.process_time() - began


def _finer(problem: ContactProblem, solution: Solution) -> NamedMesh | JoinedMesh:
    """As in `coulomb.io.refinement.refine`."""
    mesh = problem.made_of
    assert not isinstance(mesh, Deformable)
    errors = stress_errors(solution.problem.elasticity, solution.displacement)
    return finer(mesh, {body: of.squared if of.along is None else of.along for body, of in errors.items()})


def _rows(
    one: Compared,
    name: str,
    mesh: str,
    problem: ContactProblem,
    solution: Solution,
    exact: Totals,
    seconds: float,
    all_seconds: float,
) -> Iterator[Row]:
    for total, values in one.found(problem, solution).items():
        error = math.sqrt(np.mean((np.ravel(values) / np.ravel(exact[total]) - 1.0) ** 2))
        yield Row(name, mesh, problem.unknowns["displacement"], seconds, all_seconds, total, error)


def beside(uniform: Sequence[Row], row: Row) -> Row:
    """The row with its ratios, interpolated in the logarithms, or extrapolated by the line of the finest meshes."""
    unknowns, seconds, errors = np.log([(one.unknowns, one.seconds, one.error) for one in uniform]).T
    error = math.log(row.error)
    beyond = error < errors.min()
    if beyond:
        slope, at = np.polyfit(unknowns[-LAST:], errors[-LAST:], 1)
        same = (error - at) / slope
        rate, at = np.polyfit(unknowns[-LAST:], seconds[-LAST:], 1)
        needed = rate * same + at
    else:
        same = np.interp(-error, -np.minimum.accumulate(errors), unknowns)
        needed = np.interp(same, unknowns, seconds)
    return row._replace(
        fewer=math.exp(same) / row.unknowns, faster=math.exp(needed) / row.all_seconds, extrapolated=bool(beyond)
    )
