"""Nodes of a face that are opposite to the masters of several pairs: each is a contact point of one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray

_AS_NEAR = 1e-9
"""Distances that differ by less than this part of the coordinates are the same."""


def lost_nodes(
    points: Mapping[int, tuple[npt.NDArray[np.integer[Any]], FloatArray]], count: int, size: float
) -> dict[int, npt.NDArray[np.bool_]]:
    """Which nodes every pair loses to another: a node counts at the nearest master, of equally near ones at that of
    the first pair.

    Args:
        points: By the number of the pair the nodes of its contact points and their gaps in metres, each of shape (m,).
        count: How many nodes there are.
        size: Largest coordinate, metres.

    Returns:
        By the number of the pair which nodes it loses, shape (count,).
    """
    distance = np.full((len(points), count), np.inf)
    for row, (nodes, gap) in zip(distance, points.values(), strict=True):
        row[nodes] = np.abs(gap)
    near = distance <= np.min(distance, axis=0) + _AS_NEAR * size
    first = np.argmax(near, axis=0)
    return {number: np.isfinite(distance[k]) & (first != k) for k, number in enumerate(points)}
