"""The geometry of a deck: nodes, elements, sets and surfaces, parts and their instances put where they are.

Numbers of nodes and elements are those of the deck.  With several instances, as in files of Abaqus/CAE, those of the
second begin at 1e8, those of the third at 2e8, and so on; names of an instance's sets are "Instance.Set", and, where no
other set has the name, "Set" too.

Our own reading of parts, not abq2ccx' (tried: 1.6.0), which writes a deck without them: it places nodes and turns
frames as here, but of a damaged line it warns and goes on without the node, or the elements around, and does not say
where it is in an included file; a set that is given by one of its instance (*NSET, INSTANCE=Up, below it "Foot") is
lost; nodes have other numbers.  A million of them in two instances take 2.5 s and 0.4 GB here, 22 s and 1.5 GB there.
"""

from __future__ import annotations

import math
import re
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..arrays import BoolArray, FloatArray, IntArray, as_list
from .cards import Card, key_of, read_cards
from .sets import NamedSet, Profile, Sets, Surface, unqualified

SOLID = re.compile(r"(?:C3D|DC3D|AC3D|SC)(\d+)")
FLAT = re.compile(r"(?:SFM3D|M3D|R3D|CPS|CPE|CAX|DS|S|STRI)([346])(?!\d)")
"""Those of 4 nodes are on hexahedra, of 3 or 6 on tetrahedra; STRI65 has 6 nodes and 5 degrees of freedom at each."""

SECTION: Final = re.compile(r"(?:CPS|CPE|CAX)(\d+)")
"""Elements of a section in 2D, of a deck without solid ones."""

SLICES: Final = {"CPS": "plane stress", "CPE": "plane strain", "CAX": "axisymmetric"}
"""What they are sections of."""

_EDGES: Final = {3: ((0, 1), (1, 2), (2, 0)), 4: ((0, 1), (1, 2), (2, 3), (3, 0))}
"""Ends of their sides S1, S2, ..., by their number of corners."""

SIDES: Final = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    5: ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
}
"""Corners of the sides S1, S2, ... of a solid element, by its number of corners."""

CORNERS: Final = {4: 4, 10: 4, 8: 8, 20: 8, 27: 8, 6: 6, 15: 6, 18: 6, 5: 5, 13: 5, 14: 5}
"""Corners of a solid element, by its number of nodes."""

_GENERATES = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM"}
_APART: Final = 100_000_000  # between the numbers of two instances
_LABEL = re.compile(r"[+-]?\d+")


@dataclass(eq=False)
class _Instance:
    """An instance of a part, or what is given outside of parts ("")."""

    name: str
    first: int
    turn: FloatArray = field(default_factory=lambda: np.eye(3))
    about: FloatArray = field(default_factory=lambda: np.zeros(3))
    shift: FloatArray = field(default_factory=lambda: np.zeros(3))

    def place(self, x: FloatArray) -> FloatArray:
        """Where points of the part are, shape (k, 3): first moved, then turned."""
        return (x + self.shift - self.about) @ self.turn.T + self.about if self.name else x

    def back(self, x: FloatArray) -> FloatArray:
        """Where points are in the part, shape (k, 3)."""
        return (x - self.about) @ self.turn + self.about - self.shift if self.name else x

    def turn_frame(self, card: Card) -> None:
        """Let the frame of an *ORIENTATION or *TRANSFORM go with the part: the axis of a cylinder as its places, other
        axes with the rotation."""
        points: FloatArray = card.vector(0, 6).reshape(2, 3)
        of_cylinder = (card.key("SYSTEM") or card.key("TYPE")).startswith("C")
        points = self.place(points) if of_cylinder else points @ self.turn.T
        card.lines = [", ".join(map(repr, as_list(points.ravel()))), *card.lines[1:]]


class Geometry:
    """Nodes, elements, sets and surfaces of a deck.

    Attributes:
        cards: All cards, in their order.
        others: Those that say nothing of the geometry.
        elements: By type in upper case: rows of the number of an element and those of its nodes.
        node_sets: Of their numbers, as `element_sets`.
        surfaces: By name as it is compared.
        owner: The instance that a card of `others` is of, by its identity.
        rigid: Numbers of the solids that stand for rigid surfaces (`rigid_surfaces`), by the name of their set.

    Raises:
        OSError: If the file, or one that it includes, cannot be read.
        ValueError: If it is damaged, or contains something that cannot be read and must not be skipped.
    """

    def __init__(self, path: str):
        self.path = path
        self.cards = read_cards(path)
        self.others: list[Card] = []
        self.node_sets, self.element_sets = Sets("node", self.place_of), Sets("element", self.place_of)
        self.surfaces: dict[str, Surface] = {}
        self.elements: dict[str, list[IntArray]] = {}
        self._tags: list[IntArray] = []
        self._points: list[FloatArray] = []
        self._parts: dict[str, tuple[str, list[Card]]] = {}
        self._instances: dict[str, _Instance] = {}
        self.owner: dict[int, str] = {}
        self.rigid: dict[str, IntArray] = {}
        self._outside = _Instance("", 0)
        self._read()

    # --- reading ------------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        part: list[Card] | None = None
        instance: _Instance | None = None
        instanced = any(card.kind == "INSTANCE" for card in self.cards)
        for card in self.cards:
            kind = card.kind
            if kind == "PART":
                part = self._parts.setdefault(card.key("NAME"), (card.get("NAME"), []))[1]
            elif kind == "ENDPART":
                part = None
            elif part is not None and instanced:
                part.append(card)
            elif kind == "INSTANCE":
                instance = self._placed(card)
                for of_part in self._part_of(card):
                    self._take(of_part, instance)
            elif kind == "ENDINSTANCE":
                instance = None
            elif kind == "NODE" and instanced and instance is None and not self._outside.first:
                self._outside.first = _APART * len(self._instances)
                self._take(card, self._outside)
            else:
                self._take(card, instance or self._outside)
        if not instanced and len(self._parts) > 1:
            named = ", ".join(name for name, _ in list(self._parts.values())[:5])
            raise ValueError(f"{self.path}: has {len(self._parts)} parts ({named}), but no *INSTANCE of them")
        self._plain_names()

    def _part_of(self, card: Card) -> list[Card]:
        name = card.key("PART")
        if name not in self._parts:
            raise card.lacks("*PART", card.get("PART"), (part for part, _ in self._parts.values()))
        return self._parts[name][1]

    def _placed(self, card: Card) -> _Instance:
        name = card.needs("NAME")
        if key_of(name) in self._instances:
            raise card.fault(f"there are two instances {name!r}")
        placed = _Instance(name, _APART * len(self._instances))
        self._instances[key_of(name)] = placed
        self.node_sets.of_parts = self.element_sets.of_parts = True
        if card.lines:
            shift = card.floats([0])[:3]
            placed.shift[: len(shift)] = shift
        if len(card.lines) > 1:
            turn = card.floats([1])
            if len(turn) != 7 or not np.any(turn[3:6] - turn[:3]):
                raise card.fault("a rotation needs two points of its axis and an angle in degrees, seven numbers", 1)
            placed.about, placed.turn = turn[:3], _turn(turn[3:6] - turn[:3], math.radians(turn[6]))
        return placed

    def _take(self, card: Card, of: _Instance) -> None:
        kind = card.kind
        if kind in _GENERATES:
            raise card.fault(
                "coulomb does not read it: write the mesh with its nodes and elements in global coordinates"
            )
        if kind == "NODE":
            self._nodes(card, of)
        elif kind == "ELEMENT":
            self._elements(card, of)
        elif kind in ("NSET", "ELSET"):
            sets = self.node_sets if kind == "NSET" else self.element_sets
            name = self._own(card.needs(kind), of)
            self._fill(card, sets.get(name, "INTERNAL" in card.parameters), self._of(card, of))
        elif kind == "SURFACE":
            self._surface(card, of)
        else:
            if of.name:
                card = copy(card)  # a part may have several instances
                self.owner[id(card)] = of.name
                if kind in ("ORIENTATION", "TRANSFORM") and card.lines and "DEFINITION" not in card.parameters:
                    of.turn_frame(card)
            self.others.append(card)

    def _own(self, name: str, of: _Instance) -> str:
        return f"{of.name}.{name}" if of.name and name else name

    def _of(self, card: Card, of: _Instance) -> _Instance:
        """The instance that the numbers of a card are of."""
        name = card.key("INSTANCE")
        if not name:
            return of
        if name not in self._instances:
            raise card.lacks("*INSTANCE", card.get("INSTANCE"), (one.name for one in self._instances.values()))
        return self._instances[name]

    def _nodes(self, card: Card, of: _Instance) -> None:
        if card.key("SYSTEM") not in ("", "R"):
            raise card.fault("coordinates are not Cartesian")
        widths = {line.rstrip(", \t").count(",") for line in card.lines}
        rows = card.floats() if widths == {3} else np.empty(0)
        if len(rows) == 4 * len(card.lines):
            rows = rows.reshape(-1, 4)
        else:  # coordinates that are left out are 0
            each = [card.floats([row])[:4] for row in range(len(card.lines))]
            rows = np.array([np.pad(row, (0, 4 - len(row))) for row in each]).reshape(-1, 4)
        tags = rows[:, 0].astype(np.int64)
        if np.any(tags != rows[:, 0]):
            raise card.fault("damaged: the number of a node should be whole", int(np.argmax(tags != rows[:, 0])))
        self._tags.append(tags + of.first)
        self._points.append(of.place(rows[:, 1:]))
        if card.get("NSET"):
            self.node_sets.get(self._own(card.get("NSET"), of)).members.append(self._tags[-1])

    def _elements(self, card: Card, of: _Instance) -> None:
        kind = card.needs("TYPE").upper()
        solid, flat = SOLID.match(kind), FLAT.match(kind)
        match = solid or flat or SECTION.match(kind)
        width = int(match[1]) if match else 0
        if not width:  # springs, beams, masses: one line each
            lengths = {len(line.rstrip(", \t").split(",")) for line in card.lines}
            width = max(lengths, default=2) - 1
        numbers = card.integers()
        if len(numbers) % (1 + width):
            counts = [len(card.integers([row])) for row in range(len(card.lines))]
            odd = [row for row, count in enumerate(counts) if count != 1 + width and 1 + width in counts]
            said = f"damaged: elements of type {kind} must have a number and {width} nodes each"
            raise card.fault(said, odd[0] if odd else None)
        rows = numbers.reshape(-1, 1 + width) + of.first
        self.elements.setdefault(kind, []).append(rows)
        if card.get("ELSET"):
            self.element_sets.get(self._own(card.get("ELSET"), of)).members.append(rows[:, 0])

    def _fill(self, card: Card, into: NamedSet, of: _Instance) -> None:
        if card.kind == "NSET" and card.get("ELSET"):  # the nodes of elements
            numbers = self.element_sets.members(self._own(card.get("ELSET"), of))
            blocks = [rows for of_type in self.elements.values() for rows in of_type]
            parts: list[IntArray] = [rows[np.isin(rows[:, 0], numbers), 1:].ravel() for rows in blocks]
            into.members.append(np.unique(np.concatenate(parts or [numbers])))
        if "GENERATE" in card.parameters:
            for row, line in enumerate(card.lines):
                given: list[int] = list(map(int, card.integers([row])))
                if len(given) not in (2, 3) or given[-1] < 1:
                    raise card.fault(f"GENERATE needs first, last and step, but has {line.strip()!r}", row)
                step = given[2] if len(given) == 3 else 1
                into.members.append(of.first + np.arange(given[0], given[1] + 1, step, dtype=np.int64))
            return
        run: list[int] = []
        for word in (word for _, words in card.rows() for word in words if word):
            if _LABEL.fullmatch(word):
                run.append(int(word) + of.first)
                continue
            if run:
                into.members.append(np.array(run, dtype=np.int64))
                run = []
            into.members.append(self.label(word, of) if "." in word else self._own(word, of))
        if run:
            into.members.append(np.array(run, dtype=np.int64))

    def label(self, word: str, of: _Instance | None = None) -> IntArray | str:
        """What a word names: the number of a node or element, as `7` or `Instance.7`, in an array; or the name of a
        set."""
        if _LABEL.fullmatch(word):
            return np.array([int(word) + (of or self._outside).first], dtype=np.int64)
        name, dot, number = word.rpartition(".")
        if dot and number.isdigit() and key_of(name) in self._instances:
            return np.array([int(number) + self._instances[key_of(name)].first], dtype=np.int64)
        return word

    def _surface(self, card: Card, of: _Instance) -> None:
        name, kind = self._own(card.needs("NAME"), of), card.key("TYPE") or "ELEMENT"
        if kind in ("SEGMENTS", "CYLINDER", "REVOLUTION"):
            self.surfaces[key_of(name)] = Profile(name, card=card, place=of.place, back=of.back)
            return
        if "COMBINE" in card.parameters or kind not in ("NODE", "ELEMENT"):
            what = "COMBINE" if "COMBINE" in card.parameters else f"TYPE={card.get('TYPE')}"
            raise card.fault(f"surfaces of {what} are not read, those of elements and of nodes are")
        if kind == "NODE":
            into = self.node_sets.get(name)
            for word in (words[0] for _, words in card.rows()):
                label = self.label(word, of)
                if not isinstance(label, str):
                    into.members.append(label)
                elif key_of(label) != key_of(name):
                    into.members.append(self._own(label, of))
            self.surfaces[key_of(name)] = Surface(name, nodes=True)
        elif kind == "ELEMENT":
            lines: list[tuple[int | str, str]] = []
            for _, words in card.rows():
                label = self.label(words[0], of)
                side = key_of(words[1]) if len(words) > 1 else ""
                lines.append((self._own(label, of) if isinstance(label, str) else int(label[0]), side))
            self.surfaces[key_of(name)] = Surface(name, lines)

    def _plain_names(self) -> None:
        """Let sets and surfaces of one instance alone be called without its name."""
        unqualified(self.node_sets.all, self._instances)
        unqualified(self.element_sets.all, self._instances)
        unqualified(self.surfaces, self._instances)

    def place_of(self, name: str) -> str:
        """File and line where a card first has a name or a number, as messages begin; of no card the file."""
        bare = name.rpartition(".")[2]
        places = (card.place_of(word) for word in (name, bare) for card in self.cards if card.kind != "NODE")
        return next(filter(None, places), self.path)

    def called(self, number: int) -> str:
        """The number of a node or an element as the deck has it, with its instance."""
        name = next((one.name for one in self._instances.values() if 0 <= number - one.first < _APART), "")
        return f"{name}.{number % _APART}" if name else str(number % _APART if self._instances else number)

    # --- what is read -------------------------------------------------------------------------------------------------

    @cached_property
    def tags(self) -> IntArray:
        """Numbers of the nodes, in the order of the file."""
        tags = np.concatenate(self._tags) if self._tags else np.empty(0, dtype=np.int64)
        self._refuse_two(tags, "NODE", "nodes")
        return tags

    def _refuse_two(self, numbers: IntArray, kind: str, what: str) -> None:
        """ValueError if a number occurs twice, with the lines where one does, but of parts, which have their own."""
        ordered = np.sort(numbers)
        twice = ordered[1:][ordered[1:] == ordered[:-1]]
        if len(twice):
            number, cards = self.called(int(twice[0])), [card for card in self.cards if card.kind == kind]
            places = [] if self._instances else [place for card in cards for place in card.places_of(number)]
            more = f", and {len(twice) - 1} more such numbers" if len(twice) > 1 else ""
            where = f": {' and '.join(places[:2])}" if places else ""
            raise ValueError(f"{self.path}: has two {what} of the number {number}{where}{more}")

    @cached_property
    def points(self) -> FloatArray:
        """Their coordinates, shape (k, 3)."""
        return np.concatenate(self._points) if self._points else np.empty((0, 3))

    @cached_property
    def _place(self) -> IntArray | None:
        """Where the node of every number is, -1 for none; None where numbers are far apart."""
        largest = int(self.tags.max(initial=0))
        if largest > 10 * len(self.tags) + 1_000_000:
            return None
        place = np.full(largest + 1, -1, dtype=np.int64)
        place[self.tags] = np.arange(len(self.tags))
        return place

    def places(self, numbers: IntArray) -> IntArray:
        """Where nodes of these numbers are in `points`; ValueError if one is not defined."""
        tags = self.tags
        if numbers.size == 0:
            return numbers
        if self._place is not None:
            inside = (numbers >= 0) & (numbers < len(self._place))
            place: IntArray = self._place[np.where(inside, numbers, 0)]
            missing = ~inside | (place < 0)
        else:
            order = np.argsort(tags, kind="stable")
            place = order[np.minimum(np.searchsorted(tags, numbers, sorter=order), len(tags) - 1)]
            missing = tags[place] != numbers
        if np.any(missing):
            node = self.called(int(numbers[missing].flat[0]))
            raise ValueError(f"{self.place_of(node)}: node {node} is not defined; is the file whole?")
        return place

    def rows_of(self, kind: re.Pattern[str]) -> dict[int, IntArray]:
        """Elements of the types that match a pattern by their number of nodes: rows of number and nodes."""
        blocks_of: dict[int, list[IntArray]] = {}
        for name, blocks in self.elements.items():
            match = kind.match(name)
            if match:
                blocks_of.setdefault(int(match[1]), []).extend(blocks)
        return {width: np.vstack(blocks) for width, blocks in blocks_of.items()}

    @cached_property
    def solids(self) -> dict[int, IntArray]:
        """The solid elements by their number of nodes, rows of number and nodes, those without a volume of their own
        left out; of a `section` its elements."""
        rows = self.rows_of(SECTION if self.section else SOLID)
        numbers = np.concatenate([one[:, 0] for one in rows.values()]) if rows else np.empty(0, dtype=np.int64)
        self._refuse_two(numbers, "ELEMENT", "elements")
        return rows

    @cached_property
    def flats(self) -> dict[int, IntArray]:
        """The surface elements by their number of nodes."""
        return {} if self.section else self.rows_of(FLAT)

    @cached_property
    def section(self) -> str:
        """The kind of slice of which a deck without solid elements has the section, "" of others; ValueError if there
        are elements of several kinds."""
        kinds = {SLICES[name[:3]]: name for name in self.elements if SECTION.match(name)}
        if not kinds or any(SOLID.match(name) for name in self.elements):
            return ""
        if len(kinds) > 1:
            raise ValueError(f"{self.path}: has elements of several kinds: {', '.join(kinds.values())}")
        return next(iter(kinds))

    def add_nodes(self, points: FloatArray) -> IntArray:
        """Numbers of further nodes at points (k, 3)."""
        numbers: IntArray = self.tags.max(initial=0) + 1 + np.arange(len(points))
        self._tags.append(numbers)
        self._points.append(points)
        self.forget()
        return numbers

    def forget(self) -> None:
        """Nodes and elements have changed."""
        for name in ("tags", "points", "_place", "solids", "flats", "section", "kinds"):
            vars(self).pop(name, None)

    def are_rigid(self, elements: IntArray) -> BoolArray:
        """Which of some elements (k,) stand for rigid surfaces."""
        return np.isin(elements, np.concatenate([elements[:0], *self.rigid.values()]))

    def elements_of(self, label: int | IntArray | str) -> IntArray:
        """Numbers of an element, of several, or of a set of elements."""
        return self.element_sets.members(label) if isinstance(label, str) else np.atleast_1d(label)

    def sides(self, width: int) -> tuple[tuple[int, ...], ...]:
        """Corners of the sides S1, S2, ... of solid elements by their number of nodes; of a `section` ends of edges."""
        if self.section:
            return _EDGES[3 if width in (3, 6) else 4]
        return SIDES[CORNERS[width]]

    @cached_property
    def kinds(self) -> dict[str, IntArray]:
        """Numbers of the solid elements, by the cells that they can be: those of a component, which shares no node
        with others, are tetrahedra or hexahedra of first or second order, and tetrahedra if they are mixed."""
        widths = np.concatenate([np.full(len(rows), width) for width, rows in self.solids.items()])
        numbers = np.concatenate([rows[:, 0] for rows in self.solids.values()])
        component = self._components()
        cells_of: dict[str, list[IntArray]] = {}
        if self.section:
            return {self.section: numbers}
        hexahedra = np.isin(widths, (8, 20, 27))
        second = ~np.isin(widths, (4, 5, 6, 8))
        count = int(component.max(initial=-1)) + 1
        all_hexahedra = np.bincount(component[~hexahedra], minlength=count) == 0
        any_second = np.bincount(component[second], minlength=count) > 0
        for order, ordered in (("first", ~any_second), ("second", any_second)):
            for shape, shaped in (("hexahedra", all_hexahedra), ("tetrahedra", ~all_hexahedra)):
                mine = (ordered & shaped)[component]
                if np.any(mine):
                    cells_of[f"{order}_order_{shape}"] = [numbers[mine]]
        return {name: np.concatenate(parts) for name, parts in cells_of.items()}

    def _components(self) -> IntArray:
        """The component of every solid element, in the order of `solids`."""
        counts = [len(rows) for rows in self.solids.values()]
        cells = np.concatenate([np.repeat(np.arange(n), w) for n, w in zip(counts, self.solids, strict=True)])
        cells += np.repeat(np.cumsum([0, *counts[:-1]]), [n * w for n, w in zip(counts, self.solids, strict=True)])
        nodes = np.concatenate([self.places(rows[:, 1:]).ravel() for rows in self.solids.values()])
        total = sum(counts)
        graph = coo_matrix(
            (np.ones(len(nodes), dtype=np.int8), (cells, total + nodes)), shape=(total + len(self.tags),) * 2
        )
        label = connected_components(graph, directed=False)[1][:total]
        return np.unique(label, return_inverse=True)[1].astype(np.int64)


def _turn(axis: FloatArray, angle: float) -> FloatArray:
    """The matrix of a rotation about an axis, right-handed."""
    unit = axis / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), unit)
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (np.outer(unit, unit) - np.eye(3))
