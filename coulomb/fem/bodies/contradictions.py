"""Supports that contradict each other where they meet: displacements that are not what a support prescribes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ..geometry import first_place
from .constraints import DEPENDENT, PrescribedRows
from .supports import Support

_DIFFERENT = 2.0 * DEPENDENT
"""Difference of two displacements, relative to the larger one, below which they are the same: as much as there is
between directions that count as one."""

_MUCH_FARTHER = 5.0
"""How many times as far as prescribed a node is moved by directions at less than 12 degrees."""


@dataclass(frozen=True)
class SupportedNodes:
    """What a support prescribes by itself at this rank's q nodes.

    Attributes:
        nodes: Ascending, shape (q,).
        directions: Orthonormal rows or zeros, shape (q, 3, 3).
        displacement: In metres, of which the parts along the directions are prescribed, shape (q, 3).
    """

    support: Support
    nodes: npt.NDArray[np.int32]
    directions: FloatArray
    displacement: FloatArray


def contradictions(
    given: Sequence[SupportedNodes], rows: PrescribedRows, values: FloatArray, x: FloatArray, comm: MPI.Comm
) -> tuple[str, ...]:
    """Messages about supports that do not get what they prescribe, the same on every rank; collective.

    A face that is held by one support and then moved along some directions by a later one is no contradiction.
    Displacements whose amplitudes are different tables or functions differ, unless they are zero.

    Args:
        given: The supports, in their order.
        rows: The rows that count.
        values: Their values at an amplitude of 1, shape (r,).
        x: Coordinates of this rank's nodes in metres, shape (k, 3).
        comm: The ranks.
    """
    scale = _scales(given)
    u = rows.displacement(scale[rows.support] * values)
    messages = []
    faces = np.array([one.support.face for one in given])
    for number, one in enumerate(given):
        own = scale[number] * one.displacement
        wanted, there = (np.einsum("qai,qi->qa", one.directions, v) for v in (own, u[one.nodes]))
        size = np.maximum(np.linalg.norm(own, axis=1), np.linalg.norm(u[one.nodes], axis=1))
        elsewhere = (rows.support > number) & (faces[rows.support] != one.support.face)
        layered = (wanted == 0.0) & ~np.isin(one.nodes, rows.node[elsewhere])[:, None]
        different = (np.abs(wanted - there) > _DIFFERENT * size[:, None]) & ~layered
        lost = np.any(different, axis=1)
        missed = np.zeros_like(x)
        missed[one.nodes] = np.einsum("qa,qai->qi", np.where(different, wanted - there, 0.0), one.directions)
        along = np.abs(np.einsum("ri,ri->r", rows.direction, missed[rows.node]))
        takes = along > DEPENDENT * np.linalg.norm(missed[rows.node], axis=1)
        others = sorted({int(s) for s in rows.support[takes & (rows.support > number)]})
        count, place, takers = _where(lost, x[one.nodes], others, comm)
        if count:
            by = " and ".join(given[taker].support.what for taker in takers)
            nodes = "1 node" if count == 1 else f"{count} nodes"
            messages.append(
                f"{one.support.what} is overridden at {nodes} by {by}, which prescribes a different displacement there "
                f"(first seen at x = {place}): of two supports the later one counts"
            )
    return (*messages, *_amplified(given, rows, scale[rows.support] * values, u, x, comm))


def _amplified(
    given: Sequence[SupportedNodes],
    rows: PrescribedRows,
    values: FloatArray,
    u: FloatArray,
    x: FloatArray,
    comm: MPI.Comm,
) -> list[str]:
    largest = np.zeros(len(x))
    np.maximum.at(largest, rows.node, np.abs(values))
    moved = np.linalg.norm(u, axis=1)
    far = moved > _MUCH_FARTHER * largest
    supports = sorted({int(s) for s in rows.support[np.isin(rows.node, np.flatnonzero(far))]})
    count, place, involved = _where(far, x, supports, comm)
    if not count:
        return []
    ratio = comm.allreduce(float(np.max(moved[far] / largest[far], initial=0.0)), op=MPI.MAX)
    names = " and ".join(given[number].support.what for number in involved)
    return [
        f"{names} prescribe different displacements along nearly the same direction: together they move a node by up "
        f"to {ratio:.3g} times what each prescribes (first seen at x = {place})"
    ]


def _scales(given: Sequence[SupportedNodes]) -> FloatArray:
    """A factor for each support: its amplitude if this is a number, else one that other amplitudes do not have."""
    known: dict[str, float] = {}
    factors = []
    for one in given:
        amplitude = one.support.amplitude
        if isinstance(amplitude, int | float):
            factors.append(float(amplitude))
        else:
            factors.append(known.setdefault(repr(amplitude), 1.1 + (0.6180339887 * len(known)) % 0.5))
    return np.array(factors)


def _where(
    condition: npt.NDArray[np.bool_], x: FloatArray, supports: Sequence[int], comm: MPI.Comm
) -> tuple[int, str, list[int]]:
    """Number of nodes of all ranks where a condition holds, the first of them, and the supports of all ranks."""
    place = first_place(x, condition) if np.any(condition) else ""
    found = comm.allgather((int(np.count_nonzero(condition)), place, list(supports)))
    places = [place for count, place, _ in found if count]
    return sum(count for count, _, _ in found), places[0] if places else "", sorted({s for *_, of in found for s in of})
