"""Sides of elements that surfaces and loads name; facets of slave surfaces of nodes that make none by themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray, as_list, distinct, rows_among, unit_vectors
from ..nearest import tree_of
from .cards import Card, key_of
from .geometry import Geometry
from .sets import Surface

EDGES: Final = {
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    5: ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    8: ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
}
"""Corners of the edges in whose middles second-order cells have their further nodes, in their order (VTK, Abaqus)."""

_OPPOSITE: Final = -0.5
"""Cosine of the angle between the normals of two facets up to which one faces the other."""


def named_sides(
    deck: Geometry, rows: Mapping[int, IntArray], what: int | IntArray | str | None, side: str
) -> Iterator[tuple[IntArray, list[list[int]]]]:
    """Of the elements that a line of a surface names, of each number of nodes that there is.

    Args:
        rows: Elements as `Geometry.solids` has them.
        what: The number of one, of several, or a set; None for all.
        side: S1, S2, ...; "" for all sides.

    Yields:
        Numbers of their nodes, shape (k, width), and in which columns the corners of each side are; none if they have
        no such side.
    """
    for block in rows.values():
        mine = block if what is None else block[np.isin(block[:, 0], deck.elements_of(what))]
        if len(mine):
            table = enumerate(deck.sides(mine.shape[1] - 1), 1)
            yield mine[:, 1:], [list(corners) for number, corners in table if side in ("", f"S{number}")]


def refuse_other_sides(
    deck: Geometry, rows: Mapping[int, IntArray], what: int | IntArray | str, side: str, where: str, kind: str = ""
) -> None:
    """A ValueError, which begins with `where`, if elements that a line of a surface names have no such side."""
    for nodes, table in named_sides(deck, rows, what, side):
        if not table:
            raise ValueError(f"{where}: elements of {nodes.shape[1]} nodes{kind} have no side {side!r}")


def corners_of_sides(
    deck: Geometry, rows: Mapping[int, IntArray], what: int | IntArray | str | None, side: str
) -> IntArray:
    """Places of the corners of these sides among `deck.points`, shape (f, 4), the last one again where there are fewer;
    without a side those that no other element has."""
    sides_of: list[IntArray] = [np.empty((0, 4), dtype=np.int64)]
    for nodes, table in named_sides(deck, rows, what, side):
        sides_of += [deck.places(nodes[:, [*corners, *corners[-1:] * 2][:4]]) for corners in table]
    sides: IntArray = np.vstack(sides_of)
    if side:
        return sides
    if what is not None:
        outside = corners_of_sides(deck, rows, None, "")
        return sides[rows_among(_each_once(outside), _each_once(sides))]
    number = distinct(_each_once(sides))[1]
    return sides[np.bincount(number)[number] == 1]


def _each_once(sides: IntArray) -> IntArray:
    """1 more than the corners of sides (f, 4), ascending, 0 in place of those that are there again."""
    corners = np.sort(sides, axis=1)
    again = corners[:, 1:] == corners[:, :-1]
    corners[:, 1:][again] = -1
    return np.sort(corners, axis=1) + 1


def loads_on_sides(deck: Geometry, card: Card) -> Iterator[tuple[str, tuple[float, ...], list[tuple[int | str, str]]]]:
    """What a *DLOAD, *FILM or *DFLUX card puts on sides of elements: the name of the face of each, the values, and
    elements or sets with their side S1, S2, ...; sides with the same values are one face."""
    letter, count = {"DLOAD": ("P", 1), "FILM": ("F", 2), "DFLUX": ("S", 1)}[card.kind]
    faces: dict[tuple[float, ...], list[tuple[list[tuple[int | str, str]], set[tuple[int, str]]]]] = {}
    for row in range(len(card.lines)):
        words = card.words(row)
        side = key_of(words[1]) if len(words) > 1 else ""
        if words[0] and re.fullmatch(f"{letter}[1-6]", side):
            label = deck.label(words[0])
            values = tuple(card.number(word, row) for word in [*words[2:], "", ""][:count])
            numbers = deck.element_sets.listed(label) if isinstance(label, str) else label
            here = {(int(number), side) for number in as_list(deck.element_sets.once(numbers, card, row))}
            of_values = faces.setdefault(values, [([], set())])
            if not of_values[-1][1].isdisjoint(here):  # what is given twice adds up
                of_values.append(([], set()))
            of_values[-1][0].append((label if isinstance(label, str) else int(label[0]), f"S{side[1]}"))
            of_values[-1][1].update(here)
    given = [(values, sides) for values, of_values in faces.items() for sides, _ in of_values]
    for number, (values, sides) in enumerate(given, 1):
        if len(sides) == 1:
            what, side = sides[0]
            yield f"{what} {side.replace('S', letter)}", values, sides
        else:
            yield f"{card.keyword} line {card.line}" + (f" {number}" if len(given) > 1 else ""), values, sides


def facets_with_nodes(deck: Geometry, name: str) -> IntArray | None:
    """The facets with a node of a surface of nodes that face its master, where not every node is on a facet of them
    alone, as for a single node.

    Returns:
        Places of the corners among `deck.points`, shape (f, 4), the last one twice of triangles; None if the nodes make
        facets, or are no slaves.
    """
    surface = deck.surfaces.get(key_of(name))
    masters = [one for one in _masters(deck, key_of(name)) if not one.nodes]
    if surface is None or not surface.nodes or not masters:
        return None
    facets = corners_of_sides(deck, deck.solids, None, "")
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
    lines = [line for master in masters for line in master.lines]
    opposite = np.vstack([facets[:0], *(corners_of_sides(deck, deck.solids, what, side) for what, side in lines)])
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


def _normals(deck: Geometry, facets: IntArray) -> FloatArray:
    """Unit normals of facets, outwards, as their corners go round."""
    x = deck.points[facets]
    last = np.where((facets[:, 2] == facets[:, 3])[:, None], x[:, 0], x[:, 3])
    return unit_vectors(np.cross(x[:, 2] - x[:, 0], last - x[:, 1]))
