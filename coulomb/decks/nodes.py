"""Supports and forces at the nodes of a deck: *BOUNDARY and *CLOAD, in the frames of *TRANSFORM."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, IntArray, as_list
from .cards import Card, key_of
from .constraints import Constraints
from .heat import is_temperature
from .materials import axes_at, radial_direction, tangential_direction
from .reading import Reading
from .steps import Rows, Step, Track, Tracks

_TYPES: Final = {
    **{"ENCASTRE": (1, 2, 3), "PINNED": (1, 2, 3), "XSYMM": (1,), "YSYMM": (2,), "ZSYMM": (3,)},
    **{"XASYMM": (2, 3), "YASYMM": (1, 3), "ZASYMM": (1, 2)},
}
"""Degrees of freedom of solids that Abaqus' named supports hold."""

_LETTERS: Final = " xyz"

_ON_AXIS: Final = 1e-9
"""Distance of a node from the axis of its frame, over the length of the vector that gives it, up to which it is on
it."""

_SINGLY: Final = 5
"""Nodes with forces of the same course in time that have tables of their own."""

_Key = tuple[int, int]  # node, degree of freedom

_Limits = tuple[float | None, float | None, float | None]
"""When a support begins, ends, and reaches its displacement."""


class NodalTables:
    """What is prescribed at nodes: supports and forces, those of reference points given on to what they belong to."""

    def __init__(self, reading: Reading, constraints: Constraints):
        self._of, self._constraints = reading, constraints
        self._supports, self._forces = Tracks[_Key](support=True), Tracks[_Key](support=False)
        self._labels: dict[str, IntArray] = {}
        self._on_axis: set[int] = set()
        for card in reading.model:
            if card.kind == "TRANSFORM" and card.key("TYPE") == "C":
                nodes, (a, b) = reading.node_numbers(card.needs("NSET"), card, None), np.split(card.vector(0, 6), 2)
                away = np.cross(reading.deck.points[reading.deck.places(nodes)] - a, b - a)
                self._on_axis.update(as_list(nodes[np.linalg.norm(away, axis=1) <= _ON_AXIS * (b - a) @ (b - a)]))

    def take(self) -> None:
        """Read the cards of the model and of all steps."""
        first = self._of.steps[0]
        for card in self._of.model:
            if card.kind == "BOUNDARY":
                self._boundary(card, first, model=True)
        for step in self._of.steps:
            if step is not first:
                self._supports.begin(step)
            self._forces.begin(step)
            self._constraints.begin(step)
            fresh: set[str] = set()
            for card in step.cards:
                if card.kind in ("BOUNDARY", "CLOAD") and card.key("OP") == "NEW" and card.kind not in fresh:
                    fresh.add(card.kind)
                    if card.kind == "BOUNDARY" and step is first:
                        self._supports = Tracks[_Key](support=True)
                        self._constraints.forget()
                if card.kind == "BOUNDARY":
                    self._boundary(card, step, model=False)
                elif card.kind == "CLOAD":
                    self._cload(card, step)
            if "BOUNDARY" in fresh and step is not first:
                self._supports.drop(self._supports.given, step)
                self._constraints.drop("BOUNDARY", step)
            if "CLOAD" in fresh:
                self._forces.drop(self._forces.given, step)
                self._constraints.drop("CLOAD", step)

    def _boundary(self, card: Card, step: Step, model: bool) -> None:
        amplitude = self._of.amplitude(card)
        for row, words in card.rows():
            nodes = self._nodes(words[0], card, row)
            kind = key_of(words[1]) if len(words) > 1 else ""
            value = 0.0
            if kind in _TYPES:
                dofs: Iterable[int] = _TYPES[kind]
            else:
                if not kind:
                    raise card.fault("needs nodes, the first and the last degree of freedom, and a value", row)
                value = card.number(words[3], row) if len(words) > 3 else 0.0
                if is_temperature(card, words):
                    if self._of.heated:
                        continue  # `Heat` has it
                    raise card.fault("temperatures of *BOUNDARY are read where a step conducts heat", row)
                dofs = card.freedoms(words[1:], row)
            for node in as_list(self._of_solids(nodes, dofs, value, card, row, step)):
                if set(dofs) & {1, 2} and (value or not {1, 2, 3} <= set(dofs)):
                    self._refuse_on_axis(node, card, row)
                for dof in dofs:
                    if dof > 3:
                        continue  # solids have no rotations
                    if "FIXED" in card.parameters:
                        self._supports.hold((node, dof), step)
                    else:
                        self._supports.give((node, dof), value, step, amplitude, model)

    def _of_solids(
        self, nodes: IntArray, dofs: Iterable[int], value: float, card: Card, row: int, step: Step
    ) -> IntArray:
        """Those of some nodes that belong to solid elements; the others given on, if a constraint has them."""
        mine = np.isin(nodes, self._of.nodes_of_cells)
        for node in as_list(nodes[~mine]):
            if not self._constraints.support(node, card, row, step):
                self._refuse_stray(node, bool(value) and not np.any(mine), card, row)
                self._of.grounds.update((node, dof) for dof in dofs if not value)
        return nodes[mine]

    def _refuse_stray(self, node: int, moved: bool, card: Card, row: int) -> None:
        """ValueError if a node that nothing follows is moved or loaded, and not among others; it may be held."""
        if moved:
            self._of.point(node)  # it is defined
            called = self._of.deck.called(node)
            raise card.fault(f"node {called} is of no solid element, and nothing that is read follows it", row)

    def _cload(self, card: Card, step: Step) -> None:
        amplitude = self._of.amplitude(card)
        for row, words in card.rows("nodes, a degree of freedom and a force", 3):
            nodes, dof, value = self._nodes(words[0], card, row), card.whole(words[1], row), card.number(words[2], row)
            nodes = self._of.deck.node_sets.once(nodes, card, row)
            mine = np.isin(nodes, self._of.nodes_of_cells)
            for node in as_list(nodes[~mine]):
                if not self._constraints.load(node, dof, value, card, row, step):
                    self._refuse_stray(node, bool(value) and not np.any(mine), card, row)
            if dof not in (1, 2, 3):
                if np.any(mine):
                    raise card.fault(f"nodes of solids have no degree of freedom {dof}", row)
                continue
            for node in as_list(nodes[mine]):
                if dof != 3:
                    self._refuse_on_axis(node, card, row)
                self._forces.give((node, dof), value, step, amplitude)

    def _refuse_on_axis(self, node: int, card: Card, row: int) -> None:
        if node in self._on_axis:
            named = self._of.deck.called(node)
            raise card.fault(f"node {named} is on the axis of its *TRANSFORM: it has no radial direction", row)

    def _nodes(self, word: str, card: Card, row: int) -> IntArray:
        nodes = self._of.node_numbers(word, card, row)
        label = self._of.deck.label(word)
        if isinstance(label, str):
            owner = self._of.deck.owner.get(id(card))
            qualified = f"{owner}.{label}" if owner and f"{owner}.{label}" in self._of.deck.node_sets else label
            known = self._of.deck.node_sets.get(qualified)
            if not known.hidden:
                self._labels.setdefault(known.name, np.unique(nodes))
        return nodes

    # --- tables -------------------------------------------------------------------------------------------------------

    def tables(self) -> dict[str, Any]:
        """The tables of supports and forces."""
        tables: dict[str, Any] = {}
        for nodes, dofs, frame, rows, *limits in self._groups(self._supports, whole=False):
            value, timed = self._of.course(rows)
            lasting = zip(("begin", "end", "reaches"), limits, strict=True)
            more = {"nodes": nodes, **{name: time for name, time in lasting if time is not None}, **timed}
            for table in self._directions(dofs, frame, value):
                tables.setdefault("prescribed_displacement" if value else "clamp", []).append(table | more)
        for nodes, dofs, frame, rows, *_ in self._groups(self._forces, whole=True):
            value, timed = self._of.course(rows)
            force = np.array([value if dof in dofs else 0.0 for dof in (1, 2, 3)])
            for some, along in self._in_space(nodes, force, frame):
                table = {"nodes": some, "force": [float(one) for one in along], **timed}
                tables.setdefault("nodal_force", []).append(table)
        return tables

    def _directions(self, dofs: list[int], frame: Card | None, value: float) -> list[dict[str, Any]]:
        """Components that are held, or directions, each with the displacement."""
        if frame is None:
            held: dict[str, Any] = {"components": "".join(_LETTERS[dof] for dof in dofs)}
            return [held | ({"value": [value if dof in dofs else 0.0 for dof in (1, 2, 3)]} if value else {})]
        if dofs == [1, 2, 3] and not value:
            return [{"components": "xyz"}]
        tables = []
        for dof in dofs:
            along = _axes(frame)[dof - 1]
            table: dict[str, Any] = {"direction": along}
            if value:
                if any(isinstance(one, str) for one in along):
                    length = "sqrt(" + "+".join(f"({one})**2" for one in along) + ")"
                    table["value"] = [f"{float(value)!r}*({one})/{length}" for one in along]
                else:
                    unit = np.array(along, dtype=np.float64) / np.linalg.norm(np.array(along, dtype=np.float64))
                    table["value"] = [float(one) for one in value * unit]
            tables.append(table)
        return tables

    def _in_space(self, nodes: Any, force: FloatArray, frame: Card | None) -> Iterator[tuple[Any, FloatArray]]:
        """Nodes with their force along x, y and z: all with the same, but around the axis of a cylinder each with its
        own."""
        if frame is None:
            yield nodes, force
        elif frame.key("TYPE") != "C":
            yield nodes, force @ axes_at(frame, np.zeros(3))
        else:
            deck = self._of.deck
            body, _, name = nodes.rpartition(":") if isinstance(nodes, str) else ("", "", "")
            each = [f"{body}:{n}" if body else int(n) for n in deck.node_sets.members(name)] if name else nodes
            for node in each:
                yield [node], force @ axes_at(frame, self._of.point(int(str(node).rpartition(":")[2])))

    def _groups(
        self, tracks: Tracks[_Key], whole: bool
    ) -> Iterable[tuple[Any, list[int], Card | None, Rows, *_Limits]]:
        """Nodes, as the name of a set or numbers, with the degrees of freedom that follow the same rows; sets may
        overlap unless they are `whole`."""
        by_track: dict[tuple[Any, ...], list[int]] = {}
        for key, track in tracks.all:
            if whole and not any(value for _, value in track.rows):
                continue
            frame = self._of.frames.get(key[0])
            by_track.setdefault((_same(track), key[1], id(frame) if frame else 0), []).append(key[0])
        frames = {id(card): card for card in self._of.frames.values()}
        left = {key: np.unique(nodes) for key, nodes in by_track.items()}
        every = dict(left)
        for name, nodes in self._labels.items():
            nodes = nodes[np.isin(nodes, self._of.nodes_of_cells)]
            if not len(nodes):
                continue
            fitting: dict[tuple[Any, ...], list[int]] = {}
            for (track, dof, frame), known in (left if whole else every).items():
                if np.all(np.isin(nodes, known)) and np.any(np.isin(nodes, left[track, dof, frame])):
                    fitting.setdefault((track, frame), []).append(dof)
            for (track, frame), dofs in fitting.items():
                for dof in dofs:
                    rest = left[track, dof, frame]
                    left[track, dof, frame] = rest[~np.isin(rest, nodes)]
                for body in self._bodies_of(nodes):
                    yield f"{body}{name}", sorted(dofs), frames.get(frame), *track
        single: dict[tuple[Any, ...], list[int]] = {}
        for (track, dof, frame), nodes in left.items():
            if len(nodes):
                single.setdefault((track, frame, tuple(as_list(nodes))), []).append(dof)
        for (track, frame, numbers), dofs in single.items():
            for body in self._bodies_of(np.array(numbers)):
                here = self._of.bodies.get(body[:-1])
                mine = [n for n in numbers if here is None or n in self._nodes_in(body[:-1])]
                yield [f"{body}{number}" for number in mine] if body else mine, sorted(dofs), frames.get(frame), *track

    def _bodies_of(self, nodes: IntArray) -> list[str]:
        """The names of the bodies with some of these nodes, with a colon; "" for one alone."""
        if not self._of.bodies:
            return [""]
        return [f"{name}:" for name in self._of.bodies if self._nodes_in(name) & set(as_list(nodes))]

    def _nodes_in(self, body: str) -> set[int]:
        return set(as_list(self._of.nodes_of(self._of.bodies[body])))


def together(forces: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Tables of nodal forces, those on more than a few numbered nodes, with the same course in time, as one, with
    the sum for each node."""
    left = [table for table in forces if isinstance(table["nodes"], str)]
    by_course: dict[str, list[dict[str, Any]]] = {}
    for table in forces:
        if not isinstance(table["nodes"], str):
            body = str(table["nodes"][0]).rpartition(":")[0]
            course = {key: value for key, value in table.items() if key not in ("nodes", "force")}
            by_course.setdefault(json.dumps([body, course], sort_keys=True), []).append(table)
    for tables in by_course.values():
        sums: dict[Any, FloatArray] = {}
        for node, force in ((node, table["force"]) for table in tables for node in table["nodes"]):
            sums[node] = sums.get(node, np.zeros(3)) + force
        if len(tables) == 1 or len(sums) <= _SINGLY:
            left += tables
        else:
            nodes = sorted(sums, key=lambda node: int(str(node).rpartition(":")[2]))
            rows = [[float(one) for one in sums[node]] for node in nodes]
            left.append({**tables[0], "nodes": nodes, "force": rows})
    return left


def _same(track: Track) -> tuple[Rows, *_Limits]:
    """What makes two tracks the same; one without a value is held where it is."""
    rows, begin, end, reaches = track.fixed()
    return tuple((time, 0.0 if math.isnan(value) else value) for time, value in rows), begin, end, reaches


def _axes(frame: Card) -> list[list[Any]]:
    """The three directions of a *TRANSFORM, vectors or expressions of place."""
    a, b = np.split(frame.vector(0, 6), 2)
    if frame.key("TYPE") != "C":
        third = np.cross(a, b)
        return [as_list(one) for one in (a, np.cross(third, a), third)]
    return [radial_direction(a, b), tangential_direction(a, b), as_list((b - a) / np.linalg.norm(b - a))]
