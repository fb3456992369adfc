"""First-order cells that lock: far too stiff in bending with few of them across, and near incompressibility.

Answers on coarser meshes are then as wrong or more, and their differences tell nothing of the error, which Richardson's
extrapolation finds of answers that converge alone.  Second order on the same cells tells it.  It costs about ten times
the solve, and is asked for where there are signs: an error of the stress of about its size, which bending across a
single cell has, or of the strain energy that is a large part of it; a direction in which a box has a single cell, on
coarser meshes too; and a Poisson's ratio near 0.5 (`mean_dilatation`: not of hexahedra).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, cast

import numpy as np

from ..fem.bodies import (
    LOCKING_ABOVE,
    Deformable,
    Elasticity,
    Member,
    largest_poisson,
    locking_by_volume,
    stress_error,
)
from ..fem.meshes import boundary_facets, corners_of
from ..linalg.reductions import Reductions
from ..model.small_strain import CHORD
from ..model.solution import Solution

ROUGH: Final = 1.0 / 3.0
"""Error of the stress by recovery over the stress, of a body, from which on second order is compared.  Where the strain
energy of first order is less than two thirds of that of second order on the same cells it is 0.5 to 1.3.  In plates two
or three tetrahedra thick that are held at a side it is 0.34 to 0.43, and coarser meshes tell too little.  In demos and
in blocks that are pressed it is 0.07 to 0.4."""

ROUGHER: Final = 0.6
"""The same from which on a remark says so without a comparison."""

WIDE: Final = 1.0 / 3.0
"""Error bar of the strain energy over it from which on second order is compared; and the difference of the strain
energies of both orders, over the larger one, from which on first-order cells are said to be too stiff."""

SHARE: Final = 0.01
"""Share of the strain energy of all bodies that a body needs to count."""

THIN: Final = 0.25
"""Share of the corners of cells that are inside a body, up to which it is taken for one or two cells thick."""


def single_layer(body: Deformable) -> bool:
    """Whether a box of first order has a single cell along an edge, which coarser ones have too."""
    grids = [member.body.mesh.grid for member in _of_first_order(body)]
    return any(grid is not None and min(map(len, grid.planes)) == 2 for grid in grids)


def needs_second_order(body: Deformable) -> bool:
    """Whether tetrahedra of second order would keep their volume in first order: answers of that tell nothing of their
    error."""
    return any(
        member.body.degree == 2
        and member.body.materials is not None
        and member.body.mesh.tetrahedra
        and largest_poisson(member.body.materials) > LOCKING_ABOVE
        for member in body.members
    )


def too_stiff(first: Mapping[str, float], second: Mapping[str, float], chord: float = 0.0) -> tuple[str, ...]:
    """Warnings, from the strain energies in joules of every body by its name in an answer and in one of second order on
    the same cells.  Where the chord of facets in contact is a part of the approach that is worth a word, as of a pin in
    a lug, it is named as the cause: it decides where these touch."""
    total, said = max(sum(first.values()), sum(second.values())), []
    for name, energy in first.items():
        other = second.get(name, energy)
        if abs(other - energy) > WIDE * max(energy, other) and max(energy, other) > SHARE * total:
            of, table = (f" of body {name!r}", "[[body]]") if name else ("", "[mesh]")
            times = other / energy if energy > 0.0 else np.inf
            why = f"the first-order cells{of} are far too stiff, as they lock in bending and near incompressibility"
            if chord > CHORD.warn:
                why = (
                    f"the plane facets of the first-order cells{of}, or of what these touch, stand for a curved face: "
                    f"their chords leave gaps of {chord:.0%} of the approach between contact points"
                )
            said.append(
                f"{why}: with second order (degree = 2 in {table}) the same cells have {times:.2g} times the strain "
                "energy"
            )
    return tuple(said)


def remarks_on_locking(solution: Solution) -> list[str]:
    """Remarks on bodies near incompressibility whose cells keep their volume at every point, and on those of first
    order, one or two cells thick, whose stress has an error of about its size, of those alone since the error costs up
    to a tenth of a small problem; none of the latter where chords of the facets in contact may be the cause, which
    `SmallStrain` says; collective.
    """
    remarks, over = locking_by_volume(solution.problem.elasticity), Reductions(solution.problem.comm)
    if remarks or solution.small_strain.chord > CHORD.warn:
        return remarks
    temperature = solution.problem.loading.temperature
    for member in _of_first_order(solution.problem.elasticity):
        domain = member.body.domain
        on = len(np.unique(corners_of(domain, boundary_facets(domain))))
        if over.sum(float(on)) < (1.0 - THIN) * over.sum(float(domain.topology.index_map(0).size_local)):
            continue
        change = None if temperature is None else temperature.change[member.nodes]
        error = stress_error(cast(Elasticity, member.body), solution.displacement[member.nodes], change)
        if error.relative > ROUGHER:
            of, table = (f" of body {member.name!r}", "[[body]]") if member.name else ("", "[mesh]")
            remarks.append(
                f"the first-order cells{of}, few across, seem far too stiff, as they lock in bending: the error of the "
                f"stress is about {100.0 * error.relative:.0f} % of it; second order (degree = 2 in {table}) does not; "
                "error bars (--error) compare both"
            )
    return remarks


def _of_first_order(body: Deformable) -> list[Member]:
    members = [member for member in body.members if member.body.degree == 1]
    return [member for member in members if isinstance(member.body, Elasticity)]
