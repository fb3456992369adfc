"""Slave surfaces that are given by nodes: the facets of contact, where the nodes make none by themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray, unit_vectors
from ..nearest import tree_of
from .cards import key_of
from .geometry import Geometry
from .sets import Surface

_OPPOSITE: Final = -0.5
"""Cosine of the angle between the normals of two facets up to which one faces the other."""


def facets_with_nodes(deck: Geometry, name: str) -> IntArray | None:
    """The facets with a node of a surface of nodes that face its master, where not every node is on a facet of them
    alone, as for a single node.

    Args:
        deck: The geometry.
        name: The surface.

    Returns:
        Places of the corners among `deck.points`, shape (f, 4), the last one twice of triangles; None if the nodes make
        facets, or are no slaves.
    """
    surface = deck.surfaces.get(key_of(name))
    masters = [one for one in _masters(deck, key_of(name)) if not one.nodes]
    if surface is None or not surface.nodes or not masters:
        return None
    facets = _outside(deck)
    among = np.zeros(len(deck.points), dtype=bool)
    among[deck.places(deck.node_sets.members(surface.name))] = True
    whole = np.all(among[facets], axis=1)
    on_whole = np.zeros(len(deck.points), dtype=bool)
    on_whole[facets[whole]] = True
    touched = np.any(among[facets], axis=1)
    corners = np.zeros(len(deck.points), dtype=bool)
    corners[facets[touched]] = True
    if np.all(on_whole[among & corners]):
        return None
    lines = [line for one in masters for line in one.lines]
    opposite = np.vstack([facets[:0], *(_sides(deck, what, side, facets) for what, side in lines)])
    near: IntArray = facets[touched]
    if len(opposite) and len(near):
        there = tree_of(deck.points[opposite].mean(axis=1)).query(deck.points[near].mean(axis=1))[1]
        facing = np.einsum("fi,fi->f", _normals(deck, near), _normals(deck, opposite)[there]) <= _OPPOSITE
        near = near[facing]
    return near


def _masters(deck: Geometry, slave: str) -> Iterator[Surface]:
    for card in deck.cards:
        if card.kind in ("CONTACTPAIR", "TIE"):
            for _, words in card.rows():
                if len(words) > 1 and key_of(words[0]) == slave and key_of(words[1]) in deck.surfaces:
                    yield deck.surfaces[key_of(words[1])]


def _all_sides(deck: Geometry, elements: IntArray | None = None, side: str = "") -> IntArray:
    """Corners of the sides of all elements, or of some, or of one side of these, shape (f, 4)."""
    found: list[IntArray] = [np.empty((0, 4), dtype=np.int64)]
    for width, rows in deck.solids.items():
        mine = rows if elements is None else rows[np.isin(rows[:, 0], elements)]
        points = deck.places(mine[:, 1:])
        for number, corners in enumerate(deck.sides(width), 1):
            if side in ("", f"S{number}"):
                found.append(points[:, [*corners, corners[-1]][:4]])
    return np.vstack(found)


def _outside(deck: Geometry) -> IntArray:
    """Those that one element alone has."""
    sides = _all_sides(deck)
    _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
    found: IntArray = sides[np.sort(first[count == 1])]
    return found


def _sides(deck: Geometry, what: int | str, side: str, outside: IntArray) -> IntArray:
    """Corners of what a line of a surface names."""
    elements = np.array([what]) if isinstance(what, int) else deck.element_sets.members(what)
    sides = _all_sides(deck, elements, side)
    if side:
        return sides
    both = np.vstack([np.sort(outside, axis=1), np.sort(sides, axis=1)])
    number = np.unique(both, axis=0, return_inverse=True)[1].ravel()
    return sides[np.isin(number[len(outside) :], number[: len(outside)])]


def _normals(deck: Geometry, facets: IntArray) -> FloatArray:
    """Unit normals of facets, outwards, as their corners go round."""
    x = deck.points[facets]
    last = np.where((facets[:, 2] == facets[:, 3])[:, None], x[:, 0], x[:, 3])
    return unit_vectors(np.cross(x[:, 2] - x[:, 0], last - x[:, 1]))
