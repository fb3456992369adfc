"""Springs of a deck between a node and the ground, and between two nodes, as tables of a case."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, IntArray
from .cards import Card
from .reading import Reading

KINDS: Final = ("SPRING1", "SPRING2", "SPRINGA")
"""Types of elements: to the ground along a degree of freedom, between two of these, along the line of two nodes."""

_ALONG: Final = 1e-6
"""Sine of the angle between a spring and an axis up to which it is along that."""


def spring_tables(of: Reading) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Tables of springs: for the nodes of each stiffness to the ground along axes; and equations with a stiffness, of
    springs between two nodes, and to the ground along other lines.

    Raises:
        ValueError: If a spring is not linear, has no node of a solid element, or one that is neither of these nor held,
            with the line.
    """
    stiffness: dict[int, FloatArray] = {}
    links: list[dict[str, Any]] = []
    for card in of.model:
        if card.kind == "SPRING":
            for ways, k in _of_card(of, card):
                ((node, way), *others) = ways.items()
                if not others and np.sum(np.abs(way) > _ALONG) == 1:
                    stiffness[node] = stiffness.get(node, np.zeros(3)) + k * np.round(np.abs(way))
                else:
                    links.append(_link(of, ways, k))
    groups: dict[tuple[float, ...], list[int]] = {}
    for node, of_node in stiffness.items():
        groups.setdefault(tuple(float(one) for one in of_node), []).append(node)
    tables = [
        {"nodes": [_called(of, node) for node in sorted(nodes)], "stiffness": list(along)}
        for along, nodes in groups.items()
    ]
    return tables, links


def _called(of: Reading, node: int) -> int | str:
    return f"{of.body_of(of.elements_at(np.array([node])), '*SPRING')}{node}" if of.bodies else node


def _link(of: Reading, ways: Mapping[int, FloatArray], k: float) -> dict[str, Any]:
    """The equation of a spring that displacements along the ways (3,) of some nodes stretch."""
    terms = [
        {"nodes": [_called(of, node)], "component": "xyz"[axis], "coefficient": float(way[axis])}
        for node, way in ways.items()
        for axis in range(3)
        if abs(way[axis]) > _ALONG
    ]
    return {"terms": terms, "stiffness": k}


def _of_card(of: Reading, card: Card) -> Iterator[tuple[dict[int, FloatArray], float]]:
    if "NONLINEAR" in card.parameters:
        raise card.fault("only linear springs are read")
    if not card.lines:
        raise card.fault("needs a stiffness")
    k = card.number(card.words(len(card.lines) - 1)[0], len(card.lines) - 1)
    numbers = of.deck.element_sets.members(of.set_name(card))
    for kind in KINDS:
        for block in of.deck.elements.get(kind, []):
            for row in block[np.isin(block[:, 0], numbers)]:
                yield _ways(of, card, kind, row[1:]), k


def _ways(of: Reading, card: Card, kind: str, nodes: IntArray) -> dict[int, FloatArray]:
    """The directions along which displacements of nodes of solid elements stretch a spring, (3,); others are ground."""
    ends = of.deck.points[of.deck.places(nodes)]
    if kind == "SPRINGA":
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if not length:
            raise card.fault("SPRINGA is along the line of its nodes, which are at one place")
        ways = [(ends[0] - ends[1]) / length, (ends[1] - ends[0]) / length]
    else:
        dofs = [card.whole(word, 0) for word in card.words(0) if word]
        if not dofs or any(dof not in (1, 2, 3) for dof in dofs):
            raise card.fault(f"nodes of solids have no degree of freedom {', '.join(map(str, dofs)) or 'none'}", 0)
        ways = [np.eye(3)[dofs[0] - 1], -np.eye(3)[dofs[-1] - 1]]
    both = {int(node): way for node, way in zip(nodes, ways, strict=False)}
    found = {node: way for node, way in both.items() if node in of.nodes_of_cells}
    if not found:
        raise card.fault("a spring has no node of a solid element")
    for node in both.keys() - found.keys():
        if any(abs(part) > _ALONG and (node, k + 1) not in of.grounds for k, part in enumerate(both[node])):
            raise card.fault(f"node {of.deck.called(node)} of a spring is of no solid element, and not held as ground")
    return found
