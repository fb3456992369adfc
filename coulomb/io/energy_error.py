"""The error of the stress as a whole, in the energy norm, from answers on other meshes.

The stresses of two answers differ by d in the energy norm (`fem.bodies.stress_difference`).  Where one space of
displacements contains the other, their errors e have e_2^2 = e_1^2 + d^2 (Galerkin orthogonality; with contact about
so), so that e^2 is extrapolated as totals are: with e = C h^q, on cells of sizes h_1 < h_2 < h_3,

    (d_13^2 - d_12^2)/d_12^2 = (h_3^2q - h_2^2q)/(h_2^2q - h_1^2q),    e_1^2 = d_12^2 h_1^2q/(h_2^2q - h_1^2q)

Where neither contains the other, as with 3 cells and 2, the errors are independent: d^2 = e_1^2 + e_2^2 >= 2 e_1^2.

This sees what recovery from one answer does not: elements that lock, and singular edges.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..fem.bodies import Elasticity, StressedCells, StressError, stress_difference, stress_errors
from ..model.solution import Solution
from .locking import SHARE

SAFETY: Final = 1.25
"""Of an error from answers on other meshes: the root of that of totals, since energies are squares."""

SLOWEST: Final = 0.3
"""Least order q over that of the elements: with few cells at singular edges, and where they lock, answers seem not to
converge at all.  Two meshes do not tell q: then half the order of the elements."""

OF_RECOVERED, OF_FIRST = 1.5, 0.75
"""Where all other answers are of first order and worse by far, the error of second order over the recovered one, but at
most over the difference from first order on the same cells: recovery fails where a few cells have a peak."""

MOST: Final = 2.65
"""Error at most over the recovered one, which is 0.27 of it at worst: where the difference is larger, another answer is
poor for other reasons, as a contact that a coarser mesh misses, or a smooth boundary that does not fit the facets.  Of
fewer than eight cells recovery knows too little."""

ACROSS: Final = 0.1
"""Share of cells that are in several cells of another mesh, up to which they are taken for parts of them."""


@dataclass(frozen=True)
class StressOfAnswer:
    """What is compared of the stress of an answer.

    Attributes:
        cells: Of every body by its name, those of this rank with their displacements.
        size: Relative size of the cells.
        order: Of the elements; the mean of those of the bodies.
        recovered: The error by recovery, `StressError.total`, of all bodies, the root of joules.
        norm: Of the stress, of all bodies, the root of joules.
        of_second: The part of `recovered` of the bodies of second order beside others of first.
        of_first: The largest error by recovery over the stress of a body of first order, of those that have a hundredth
            of the strain energy.
    """

    cells: Mapping[str, StressedCells]
    size: float
    order: float
    recovered: float
    norm: float
    of_second: float = 0.0
    of_first: float = 0.0

    @property
    def relative(self) -> float:
        """The error by recovery over the stress."""
        return self.recovered / self.norm if self.norm > 0.0 else math.nan


def recovered_errors(solution: Solution) -> dict[str, StressError]:
    """`stress_errors` of an answer, with its temperature; collective."""
    temperature = solution.problem.loading.temperature
    change = None if temperature is None else temperature.change
    return stress_errors(solution.problem.elasticity, solution.displacement, change)


def stress_of(solution: Solution, size: float, order: float) -> StressOfAnswer | None:
    """That of an answer; None where no stress is known (bodies of the user's forms, large motions); collective."""
    members = solution.problem.elasticity.members
    if not all(isinstance(member.body, Elasticity) for member in members):
        return None
    errors, u = recovered_errors(solution), solution.displacement
    cells = {one.name: StressedCells(one.body, u[one.nodes], None) for one in members}  # type: ignore[arg-type]
    recovered, norm = (math.hypot(*of) for of in zip(*((e.total, e.norm) for e in errors.values()), strict=True))
    of_second = math.hypot(*(errors[member.name].total for member in members if member.body.degree > order))
    firsts = [errors[member.name] for member in members if member.body.degree == 1]
    of_first = max((one.relative for one in firsts if one.norm**2 > SHARE * norm**2), default=0.0)
    return StressOfAnswer(cells, size, order, recovered, norm, of_second, of_first)


def relative_stress_error(first: StressOfAnswer | None, others: Sequence[StressOfAnswer | None]) -> float | None:
    """Estimated error of the stress of the first answer over its stress, in the energy norm; None if it is not known
    of all answers, or they are of other bodies; collective.

    Best is an answer of second order on the same cells, whose error is small beside the difference; else two coarser
    meshes tell the order of convergence.
    """
    if first is None or first.norm == 0.0:
        return None
    known = [one for one in others if one is not None and one.cells.keys() == first.cells.keys()]
    if len(known) < len(others):
        return None
    known.sort(key=lambda one: one.size)
    coarser = [one for one in known if one.order == first.order and one.size > 1.1 * first.size]
    finer = [one for one in known if one.order == first.order and one.size < 0.9 * first.size]
    if better := [one for one in known if one.order > first.order and one.size < 1.1 * first.size]:
        squared = _difference(better[0], first)[0] + (OF_RECOVERED / SAFETY * first.of_second) ** 2
    elif coarser:
        squared = _extrapolated([first, *coarser[:2]])
    elif finer:
        squared = _difference(finer[0], first)[0] / (1.0 - math.pow(finer[0].size / first.size, first.order))
    else:
        most = OF_FIRST * math.sqrt(_difference(first, known[-1])[0])
        return min(OF_RECOVERED * first.recovered, most) / first.norm
    error = SAFETY * math.sqrt(squared)
    return (min(error, MOST * first.recovered) if first.size <= 0.5 else error) / first.norm


def _extrapolated(chain: Sequence[StressOfAnswer]) -> float:
    """e^2 of the first of two or three answers, from fine to coarse."""
    first, second, last = chain[0], chain[1], chain[-1]
    h1, h2, h3 = first.size, second.size, last.size
    near, contained = _difference(first, second)
    if not contained:  # equally wrong, or more where sizes are so alike that the fastest order leaves more
        return near * max(0.5, 1.0 / (math.pow(h2 / h1, 2.0 * first.order) - 1.0))
    twice_q = float(first.order)
    if (h3 / h2) ** 2 > h2 / h1 and near > 0.0:
        far = _difference(first, last)[0] - near
        orders = np.linspace(2.0 * SLOWEST * first.order, 2.0 * first.order, 500)
        growth = (h3**orders - h2**orders) / (h2**orders - h1**orders)
        twice_q = float(np.interp(far / near, growth, orders))
    return near / (math.pow(h2 / h1, twice_q) - 1.0)


def _difference(fine: StressOfAnswer, coarse: StressOfAnswer) -> tuple[float, bool]:
    """d^2 in joules, and whether nearly all cells of the fine mesh are parts of those of the coarse one; collective."""
    differences = [stress_difference(cells, coarse.cells[name]) for name, cells in fine.cells.items()]
    across = sum(difference.across for difference in differences) / sum(difference.cells for difference in differences)
    return float(sum(difference.squared for difference in differences)), across < ACROSS
