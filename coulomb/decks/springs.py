"""Springs of a deck between a node and the ground, as tables of a case."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, IntArray
from .cards import Card
from .reading import Reading

KINDS: Final = ("SPRING1", "SPRING2", "SPRINGA")
"""Types of elements: to the ground along a degree of freedom, between two of these, along the line of two nodes."""

_ALONG: Final = 1e-6
"""Sine of the angle between a spring and an axis up to which it is along that."""


def spring_tables(of: Reading) -> list[dict[str, Any]]:
    """A table for the nodes of each stiffness.

    Raises:
        ValueError: If a spring is not linear, is between two nodes of solid elements, or along no axis, with the line.
    """
    stiffness: dict[int, FloatArray] = {}
    for card in of.model:
        if card.kind == "SPRING":
            for node, k in _of_card(of, card):
                stiffness[node] = stiffness.get(node, np.zeros(3)) + k
    groups: dict[tuple[float, ...], list[int]] = {}
    for node, k in stiffness.items():
        groups.setdefault(tuple(float(one) for one in k), []).append(node)
    tables = []
    for along, nodes in groups.items():
        named = [
            f"{of.body_of(of.elements_at(np.array([n])), '*SPRING')}{n}" if of.bodies else n for n in sorted(nodes)
        ]
        tables.append({"nodes": named, "stiffness": list(along)})
    return tables


def _of_card(of: Reading, card: Card) -> Iterator[tuple[int, FloatArray]]:
    if "NONLINEAR" in card.parameters:
        raise card.fault("only linear springs are read")
    if not card.lines:
        raise card.fault("needs a stiffness")
    k = card.number(card.words(len(card.lines) - 1)[0], len(card.lines) - 1)
    numbers = of.deck.element_sets.members(of.set_name(card))
    for kind in KINDS:
        for block in of.deck.elements.get(kind, []):
            for row in block[np.isin(block[:, 0], numbers)]:
                yield _at(of, card, kind, row[1:], k)


def _at(of: Reading, card: Card, kind: str, nodes: IntArray, k: float) -> tuple[int, FloatArray]:
    """The node of solid elements of a spring, and the stiffness along the axes."""
    mine = nodes[np.isin(nodes, of.nodes_of_cells)]
    if len(mine) != 1:
        raise card.fault(f"springs between {len(mine)} nodes of solid elements are not read, those to the ground are")
    along = np.zeros(3)
    if kind == "SPRINGA":
        ends = of.deck.points[of.deck.places(nodes)]
        way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        along = np.round(np.abs(way))
        if np.linalg.norm(np.abs(way) - along) > _ALONG:
            raise card.fault("springs along a line that is no axis are not read")
    else:
        dofs = card.words(0)
        which = int(np.flatnonzero(nodes == mine[0])[0]) if kind == "SPRING2" and len(dofs) > 1 else 0
        dof = card.whole(dofs[which], 0)
        if dof not in (1, 2, 3):
            raise card.fault(f"nodes of solids have no degree of freedom {dof}", 0)
        along[dof - 1] = 1.0
    return int(mine[0]), k * along
