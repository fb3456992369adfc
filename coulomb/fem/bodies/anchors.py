"""The degrees of freedom at which springs make the stiffness of a body with free rigid motions positive definite."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg
from mpi4py import MPI

from ...arrays import FloatArray

_WORSE = 0.3
"""How much worse the first places may determine the motions than the best."""


@dataclass(frozen=True)
class Anchor:
    """A degree of freedom at which a spring makes K positive definite.

    Attributes:
        rank: The rank that owns its node.
        node: The node, among those of that rank.
        axis: 0, 1 or 2.
        x: The node's place, shape (3,).
    """

    rank: int
    node: int
    axis: int
    x: FloatArray


def anchors_of(
    x: FloatArray,
    places: Sequence[npt.NDArray[np.bool_]],
    rows: Callable[[FloatArray], FloatArray],
    comm: MPI.Comm,
) -> list[Anchor]:
    """As many degrees of freedom of a component as it has free motions, which these determine well; collective.

    They are at the extreme nodes in 26 directions, of the first places that determine the motions nearly as well as the
    best.

    Args:
        x: This rank's nodes, metres, shape (k, 3).
        places: Which nodes suit, the best first, shapes (k,).
        rows: The motions q at points (p, 3), shape (p, 3, q).
        comm: The ranks.
    """
    found: list[list[Anchor]] = []
    quality: list[float] = []
    for suited in places:
        extremes = _extremes(x, np.flatnonzero(suited), comm)
        if len(extremes) == 0:
            continue
        at = np.array([place for place, _, _ in extremes])
        moved = rows(at)
        count = moved.shape[2]
        _, R, order = scipy.linalg.qr(moved.reshape(-1, count).T, mode="economic", pivoting=True)
        chosen = order[:count]
        found.append([])
        for place, axis in (divmod(int(dof), 3) for dof in chosen):
            x_there, rank, node = extremes[place]
            found[-1].append(Anchor(rank, node, axis, x_there))
        quality.append(float(np.abs(R[count - 1, count - 1])) if len(R) >= count else 0.0)
    return next(one for one, good in zip(found, quality, strict=True) if good > _WORSE * max(quality))


def _extremes(x: FloatArray, nodes: npt.NDArray[np.int64], comm: MPI.Comm) -> list[tuple[FloatArray, int, int]]:
    """Place, rank and number of the extreme nodes in 26 directions, the same on every rank; collective."""
    ways = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)])
    ways = ways / np.linalg.norm(ways, axis=1)[:, None] + np.array([3.1e-3, 1.7e-3, 5.3e-3])  # of equals the same one
    heights = x[nodes] @ ways.T
    mine = []
    if len(nodes):
        mine = [(float(heights[k, way]), x[nodes[k]], int(nodes[k])) for way, k in enumerate(heights.argmax(axis=0))]
    gathered = comm.allgather(mine)
    found: dict[tuple[int, int], FloatArray] = {}
    for way in range(len(ways)):
        given = [(*own[way], rank) for rank, own in enumerate(gathered) if own]
        if given:
            _, place, node, rank = max(given, key=lambda one: one[0])
            found[rank, node] = place
    return sorted(
        ((place, rank, node) for (rank, node), place in found.items()),
        key=lambda one: (float(one[0][0]), float(one[0][1]), float(one[0][2])),
    )
