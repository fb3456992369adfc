"""Equations between displacements of nodes in a deck: *EQUATION, *MPC of kind PLANE and STRAIGHT, couplings of some
directions.

Reference nodes, which belong to no solid element, are eliminated: where one is held or moved it is a constant, else it
follows from an equation, and its forces go with it to the nodes of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np

from ..arrays import IntArray, as_list
from .cards import Card, key_of
from .materials import axes_at
from .reading import Reading
from .steps import Rows, value_at

_FIXED_BY: Final = {"PLANE": 3, "STRAIGHT": 2}
"""Kinds of *MPC, by the number of nodes that the others follow."""

LINKS: Final = ("TIE", "PIN", "BEAM")
"""Kinds of *MPC of a node that moves as another one, BEAM as on a rigid arm that turns with that."""

_NOTHING: Final = 1e-12
"""Coefficient over the largest of its equation below which it is a rounding error."""

Dof = tuple[int, int]
"""A node and a degree of freedom: 1 to 3 displacements, of reference nodes 4 to 6 rotations."""

_Terms = dict[Dof, float]


class Equations:
    """The equations of a deck; of each the first displacement is eliminated.

    Attributes:
        references: Numbers of the reference nodes in them.
    """

    def __init__(self, reading: Reading):
        self._of = reading
        self._equations: list[_Terms] = []
        self._means: list[range] = []
        self.references: set[int] = set()

    def take(self, card: Card) -> None:
        """An *EQUATION card, of sets one for each of their nodes."""
        if "REMOVE" in card.parameters:
            raise card.fault("equations are not removed: leave them out")
        rows = iter(card.rows())
        for first, words in rows:
            count, terms = card.whole(words[0], first), list[tuple[IntArray, int, float]]()
            while len(terms) < count:
                row, words = next(rows, (first, []))
                if not words:
                    raise card.fault(f"has {len(terms)} terms of node, direction and coefficient, not {count}", first)
                for k in range(0, len(words) - 2, 3):
                    nodes, dof = self._of.node_numbers(words[k], card, row), card.whole(words[k + 1], row)
                    if dof not in (1, 2, 3):
                        raise card.fault(f"an equation is between displacements 1, 2 and 3, not {dof}", row)
                    terms.append((nodes, dof, card.number(words[k + 2], row)))
            if not terms:
                raise card.fault("needs at least one term", first)
            size = len(terms[0][0])
            if any(len(nodes) not in (1, size) for nodes, _, _ in terms):
                raise card.fault("sets of an equation must have as many nodes as the first, or one", first)
            each = [np.broadcast_to(nodes, size) for nodes, _, _ in terms]
            for of_one in zip(*map(as_list, each), strict=True):
                coefficients: _Terms = {}
                for node, (_, dof, coefficient) in zip(of_one, terms, strict=True):
                    for axis, part in self._along(node, dof):
                        coefficients[node, axis] = coefficients.get((node, axis), 0.0) + coefficient * part
                self._add(coefficients)

    def _along(self, node: int, dof: int) -> list[tuple[int, float]]:
        """The axes and parts of a degree of freedom, of a node with a *TRANSFORM several, the largest first; of
        reference nodes their own, in which they are held and loaded."""
        if node not in self._of.frames or node not in self._inside:
            return [(dof, 1.0)]
        along = axes_at(self._of.frames[node], self._of.point(node))[dof - 1]
        order = sorted(range(3), key=lambda k: -abs(along[k]))
        return [(k + 1, float(along[k])) for k in order if abs(along[k]) > _NOTHING]

    def _add(self, terms: _Terms) -> None:
        self._equations.append(terms)
        nodes = np.array([node for node, _ in terms])
        self.references.update(as_list(nodes[~np.isin(nodes, self._of.nodes_of_cells)]))

    def couple(self, node: int, nodes: IntArray, dofs: set[int]) -> None:
        """Nodes that follow the rigid motion of a reference node along some directions."""
        arms = self._of.deck.points[self._of.deck.places(nodes)] - self._of.point(node)
        for one, arm in zip(as_list(nodes), arms, strict=True):
            for dof in sorted(dofs & {1, 2, 3}):
                i, j = dof % 3, (dof + 1) % 3  # u_k + theta_i r_j - theta_j r_i
                terms = {
                    (one, dof): 1.0,
                    (node, dof): -1.0,
                    (node, i + 4): -float(arm[j]),
                    (node, j + 4): float(arm[i]),
                }
                self._add({key: value for key, value in terms.items() if value})

    def mean_motion(self, node: int, weights: dict[int, float], card: Card) -> None:
        """A reference node that follows the mean motion of others: the rotation theta that fits their displacements
        best, sum w r x (u - theta x r) = 0 with r from their centre, and the mean displacement, carried to the node."""
        nodes, w = list(weights), np.array(list(weights.values())) / sum(weights.values())
        x = self._of.deck.points[self._of.deck.places(np.array(nodes))]
        centre = w @ x
        r, away = x - centre, self._of.point(node) - centre
        inertia = np.einsum("i,ij,ij->", w, r, r) * np.eye(3) - np.einsum("i,ij,ik->jk", w, r, r)
        if np.linalg.matrix_rank(inertia, tol=1e-9 * np.trace(inertia)) < 3:
            raise card.fault("nodes on a line have no mean rotation")
        turned = np.linalg.solve(inertia, w[:, None, None] * np.cross(r[:, None, :], np.eye(3)).transpose(0, 2, 1))
        first = len(self._equations)
        for k in range(3):
            of_nodes = {(n, j + 1): float(turned[i, k, j]) for i, n in enumerate(nodes) for j in range(3)}
            self._add({dof: value for dof, value in of_nodes.items() if value} | {(node, k + 4): -1.0})
            i, j = (k + 1) % 3, (k + 2) % 3
            shift = {(node, i + 4): float(away[j]), (node, j + 4): -float(away[i])}
            mean = {(n, k + 1): float(share) for n, share in zip(nodes, w, strict=True)}
            self._add(mean | {dof: value for dof, value in shift.items() if value} | {(node, k + 1): -1.0})
        self._means.append(range(first, len(self._equations)))

    def mean(self, node: int, weights: dict[int, float], card: Card) -> None:
        """A reference node that follows the weighted mean of others."""
        total = sum(weights.values())
        if not min(weights.values()) >= 0.0 or not total:
            raise card.fault("needs nodes with weights that are not negative, nor all 0")
        for dof in (1, 2, 3):
            self._add({(one, dof): weight for one, weight in weights.items() if weight} | {(node, dof): -total})

    def stay(self, card: Card) -> None:
        """*MPC of kind PLANE and STRAIGHT, of small motions: nodes stay in the plane of the first three, which may move
        and turn, or on the line of the first two; and `LINKS`."""
        none: IntArray = np.empty(0, dtype=np.int64)
        kind, nodes, first = "", none, 0
        for row, words in card.rows("PLANE or STRAIGHT and nodes"):
            if key_of(words[0]) in _FIXED_BY:
                self._stay(kind, nodes, card, first)
                kind, nodes, first, words = key_of(words[0]), none, row, words[1:]
            elif key_of(words[0]) in LINKS:
                self._stay(kind, nodes, card, first)
                kind, nodes = "", none
                self._link(words, card, row)
                continue
            if not kind:
                raise card.fault(f"of kind {words[0]} is not read: {', '.join((*_FIXED_BY, *LINKS))} are", row)
            named = [self._of.node_numbers(word, card, row) for word in words if word]
            nodes = np.concatenate([nodes, *named])
            self._refuse_other_nodes(nodes, card, row)
        self._stay(kind, nodes, card, first)

    def _link(self, words: Sequence[str], card: Card, row: int) -> None:
        """A line of kind, node and the node that it follows, or sets of as many."""
        if len(words) != 3:
            raise card.fault("needs a kind and two nodes, or two sets of them", row)
        of_first, of_other = (self._of.node_numbers(word, card, row) for word in words[1:])
        if len(of_other) not in (1, len(of_first)):
            raise card.fault(f"{words[1]!r} has {len(of_first)} nodes, but {words[2]!r} {len(of_other)}", row)
        self._refuse_other_nodes(of_first, card, row)
        for node, other in zip(of_first, np.broadcast_to(of_other, len(of_first)), strict=True):
            if key_of(words[0]) == "BEAM":
                if other in self._of.nodes_of_cells:
                    said = "nodes of solids have no rotations: let a node of no element be the second, or give PIN"
                    raise card.fault(f"BEAM: {said}", row)
                self.couple(int(other), np.array([node]), {1, 2, 3})
            else:
                for dof in (1, 2, 3):
                    self._add({(int(node), dof): 1.0, (int(other), dof): -1.0})

    def _stay(self, kind: str, nodes: IntArray, card: Card, row: int) -> None:
        """Equations of nodes that stay in a plane or on a line; none without nodes."""
        nodes = nodes[np.sort(np.unique(nodes, return_index=True)[1])]
        count = _FIXED_BY.get(kind, 0)
        if not len(nodes):
            return
        x = self._of.deck.points[self._of.deck.places(nodes)]
        sides = (x[1:count] - x[0]).T
        shares = np.linalg.lstsq(sides, (x[count:] - x[0]).T, rcond=None)[0]
        far = np.linalg.norm(sides @ shares - (x[count:] - x[0]).T, axis=0)
        if len(nodes) < count or np.linalg.matrix_rank(sides, tol=1e-9 * np.ptp(x)) < count - 1:
            raise card.fault(f"the first {count} nodes of {kind} make none", row)
        if np.any(far > 1e-5 * np.ptp(x)):
            raise card.fault(f"{kind}: node {nodes[count + int(np.argmax(far))]} is {far.max():.3g} off", row)
        # directions across: the normal of the plane, or the two axes that are not the main one of the line, less that
        across = [np.cross(*sides.T)] if count == 3 else []
        if count == 2:
            main, way = int(np.argmax(np.abs(sides[:, 0]))), sides[:, 0]
            across = [np.eye(3)[k] - way[k] / way[main] * np.eye(3)[main] for k in range(3) if k != main]
        for direction in across:
            pivot = int(np.argmax(np.abs(direction)))
            order = sorted((k for k in range(3) if direction[k]), key=lambda k: k != pivot)
            for node, share in zip(nodes[count:], shares.T, strict=True):
                weights = [1.0, float(share.sum()) - 1.0, *(-share).tolist()]
                terms = [
                    (int(n), "xyz"[k], float(weight * direction[k] / direction[pivot]))
                    for n, weight in zip([node, *nodes[:count]], weights, strict=True)
                    for k in order
                    if weight
                ]
                self._equations.append({(n, "xyz".index(k) + 1): weight for n, k, weight in terms})

    def _refuse_other_nodes(self, nodes: IntArray, card: Card, row: int) -> None:
        """*MPC of nodes of no solid are not read."""
        other = nodes[~np.isin(nodes, self._of.nodes_of_cells)]
        if len(other):
            raise card.fault(f"node {other[0]} belongs to no solid element: its equation is not read", row)

    def tables(self, held: dict[Dof, Rows], loads: dict[Dof, list[Rows]]) -> dict[str, list[dict[str, Any]]]:
        """The tables of equations, and of the forces that reference nodes give on.

        Args:
            held: What reference nodes are held at, and how they are moved.
            loads: Their forces.

        Raises:
            ValueError: If nothing says where a reference node with a force is.
        """
        forces = {dof: [(rows, 1.0) for rows in given] for dof, given in loads.items() if dof not in held}
        left = self._without_references(held, forces)
        lost = next((dof for dof in forces if dof[0] not in self._inside), None)
        if lost is not None:
            raise ValueError(
                f"{self._of.deck.place_of(str(lost[0]))}: no equation says where node {self._of.deck.called(lost[0])} "
                "is, which has a force"
            )
        kinds: dict[Any, list[list[int]]] = {}
        for terms in left:
            moved = [(held[dof], -value) for dof, value in terms.items() if dof in held]
            times = sorted({time for rows, _ in moved for time, at in rows if any(at for _, at in rows)})
            constant = tuple((time, sum(value * value_at(rows, time) for rows, value in moved)) for time in times)
            kind = tuple(("xyz"[dof - 1], value) for (node, dof), value in terms.items() if (node, dof) not in held)
            key = kind, constant if any(at for _, at in constant) else None
            kinds.setdefault(key, []).append([node for node, dof in terms if (node, dof) not in held])
        tables: dict[str, list[dict[str, Any]]] = {}
        for (kind, moved_by), rows_of_nodes in kinds.items():
            terms_of = [
                {"nodes": [self._called(node) for node in nodes], "component": component, "coefficient": coefficient}
                for nodes, (component, coefficient) in zip(zip(*rows_of_nodes, strict=True), kind, strict=True)
            ]
            table: dict[str, Any] = {"terms": terms_of}
            if moved_by is not None:
                self._of.timed(table, "constant", moved_by)
            tables.setdefault("equation", []).append(table)
        for (node, dof), given in forces.items():
            for rows, factor in given:
                value, timed = self._of.course(rows)
                if value * factor == 0.0:
                    continue
                force = [value * factor if dof == k else 0.0 for k in (1, 2, 3)]
                tables.setdefault("nodal_force", []).append({"nodes": [self._called(node)], "force": force, **timed})
        return tables

    def _without_references(self, held: dict[Dof, Rows], forces: dict[Dof, list[tuple[Rows, float]]]) -> list[_Terms]:
        """The equations in which no reference node is free: each follows from the equation with its largest
        coefficient, which goes; its forces follow.  Terms stay in their order."""
        left = [dict(terms) for terms in self._equations]
        free = dict.fromkeys(dof for terms in left for dof in terms if dof[0] in self.references and dof not in held)
        holders: dict[Dof, set[int]] = {dof: set() for dof in free}
        for k, terms in enumerate(left):
            for dof in terms.keys() & free.keys():
                holders[dof].add(k)
        for dof in free:
            mine = [k for k in holders[dof] if dof in left[k]]
            if not mine:
                continue
            pivot = max(mine, key=lambda k: (abs(left[k][dof]) / max(map(abs, left[k].values())), -k))
            own, rest = left[pivot][dof], {key: value for key, value in left[pivot].items() if key != dof}
            for k in mine:
                if k == pivot:
                    continue
                share, terms = left[k].pop(dof) / own, left[k]
                size = max(map(abs, (*terms.values(), share)))
                for key, value in rest.items():
                    terms[key] = terms.get(key, 0.0) - share * value
                    if key in holders:
                        holders[key].add(k)
                for key in [key for key, value in terms.items() if abs(value) <= _NOTHING * size]:
                    del terms[key]
            left[pivot] = {}
            for rows, factor in forces.pop(dof, []):
                for key, value in rest.items():
                    if key not in held:
                        forces.setdefault(key, []).append((rows, -factor * value / own))
        for group in self._means:
            _reduce([left[k] for k in group], held)
        return [_displacement_first(terms, held) for terms in left if terms.keys() - held.keys()]

    @cached_property
    def _inside(self) -> set[int]:
        """The nodes of solid elements."""
        return set(as_list(self._of.nodes_of_cells))

    def _called(self, node: int) -> int | str:
        return f"{self._homes[node]}:{node}" if self._homes else node

    @cached_property
    def _homes(self) -> dict[int, str]:
        """The bodies of nodes, where there are several."""
        return {
            node: name for name, elements in self._of.bodies.items() for node in as_list(self._of.nodes_of(elements))
        }


def _reduce(rows: list[_Terms], held: dict[Dof, Rows]) -> None:
    """Let equations of the same displacements each have one that the others have not, its first."""
    for own in rows:
        free = own.keys() - held.keys()
        if not free:
            continue
        pivot = max(sorted(free), key=lambda dof: abs(own[dof]))
        for other in rows:
            share = other.pop(pivot, 0.0) / own[pivot] if other is not own else 0.0
            for dof, value in own.items() if share else ():
                if dof != pivot:
                    other[dof] = other.get(dof, 0.0) - share * value
        terms = {pivot: own.pop(pivot)} | own
        own.clear()
        own.update(terms)
    for own in rows:
        size = max(map(abs, own.values()), default=0.0)
        for dof in [dof for dof, value in own.items() if abs(value) <= _NOTHING * size]:
            del own[dof]


def _displacement_first(terms: _Terms, held: dict[Dof, Rows]) -> _Terms:
    """An equation whose first term is no reference node that is held."""
    first = next(iter(terms))
    if first not in held:
        return terms
    largest = max((dof for dof in terms if dof not in held), key=lambda dof: abs(terms[dof]))
    return {largest: terms[largest]} | {dof: value for dof, value in terms.items() if dof != largest}
