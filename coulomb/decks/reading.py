"""What the parts of a translation share: the steps of a deck, and the names that its cards use."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import FloatArray, IntArray, as_list
from .cards import Card, key_of
from .geometry import Geometry
from .steps import STEADY, Amplitude, Rows, Step, periodic, reference, smooth


class Reading:
    """A deck that is being read.

    Attributes:
        model: The cards outside of steps that say nothing of the geometry.
        notes: What a user should know, a sentence each.
        grounds: Nodes of no solid element and their degrees of freedom that are held, to which springs may lead.
        open: Whether there is a pair that may open or slide; else a load history ends with that of a tie.
        pairs: The table of each contact pair, if it has one, and those of its ties; None until they are read.
    """

    open: bool = True
    pairs: list[tuple[dict[str, Any] | None, list[dict[str, Any]]]] | None = None

    def __init__(self, deck: Geometry, model: list[Card], steps: list[Step], large: bool = False):
        self.deck, self.model, self.steps, self.large = deck, model, steps, large
        self.notes: list[str] = []
        self.grounds: set[tuple[int, int]] = set()

    @property
    def heated(self) -> bool:
        """Whether a step conducts heat."""
        return any(card.kind in STEADY for step in self.steps for card in step.cards)

    @cached_property
    def bodies(self) -> Mapping[str, IntArray]:
        """Numbers of the elements of each body by its name; none if there is one alone."""
        kinds = self.deck.kinds
        return kinds if len(kinds) > 1 else {}

    @cached_property
    def all_elements(self) -> IntArray:
        """Numbers of the solid elements."""
        return np.concatenate([rows[:, 0] for rows in self.deck.solids.values()])

    @cached_property
    def nodes_of_cells(self) -> IntArray:
        """Numbers of the nodes of solid elements, ascending."""
        return np.unique(np.concatenate([rows[:, 1:].ravel() for rows in self.deck.solids.values()]))

    def set_name(self, card: Card) -> str:
        """The name of the set of a section, which may be of a part."""
        owner = self.deck.owner.get(id(card))
        name = card.needs("ELSET")
        if owner and f"{owner}.{name}" in self.deck.element_sets:
            name = f"{owner}.{name}"
        if name not in self.deck.element_sets:
            raise card.lacks("element set", name, self.deck.element_sets.names)
        return self.deck.element_sets.get(name).name

    def node_numbers(self, word: str, card: Card, row: int | None) -> IntArray:
        """The nodes that a word names, a number or a set, in their order, some perhaps twice."""
        label = self.deck.label(word)
        if not isinstance(label, str):
            if not np.all(np.isin(label, self.deck.tags)):
                raise card.fault(f"node {word} is not defined", row)
            return label
        owner = self.deck.owner.get(id(card))
        name = f"{owner}.{label}" if owner and f"{owner}.{label}" in self.deck.node_sets else label
        if name not in self.deck.node_sets:
            raise card.lacks("node set", word, self.deck.node_sets.names, row)
        numbers = self.deck.node_sets.listed(name)
        if not len(numbers):
            raise card.fault(f"the node set {word!r} is empty", row)
        return numbers

    def body_of(self, elements: IntArray, what: str) -> str:
        """ "NAME:" of the body of some elements, "" for one alone."""
        if not self.bodies:
            return ""
        homes = [name for name, numbers in self.bodies.items() if np.any(np.isin(elements, numbers))]
        if len(homes) != 1:
            raise ValueError(
                f"{self.deck.path}: {what} is on {len(homes)} bodies ({', '.join(homes)}): give each its own"
            )
        return f"{homes[0]}:"

    @property
    def surface_names(self) -> list[str]:
        """Those of all surfaces."""
        return [surface.name for surface in self.deck.surfaces.values()]

    def face(self, name: str, card: Card, row: int | None = None) -> str:
        """A surface that a card names as a face of the case."""
        surface = self.deck.surfaces.get(key_of(name))
        if surface is None:
            raise card.lacks("*SURFACE", name, self.surface_names, row)
        if not self.bodies:
            return surface.name
        if surface.nodes:
            elements = self.elements_at(self.deck.node_sets.members(surface.name))
        else:
            elements = np.concatenate([self.deck.elements_of(one) for one, _ in surface.lines])
        return self.body_of(elements, f"*{card.keyword}") + surface.name

    def nodes_of(self, elements: IntArray) -> IntArray:
        """Numbers of the nodes of some solid elements, ascending."""
        parts = [rows[np.isin(rows[:, 0], elements), 1:].ravel() for rows in self.deck.solids.values()]
        return np.unique(np.concatenate(parts))

    def point(self, node: int) -> FloatArray:
        """Where a node is, shape (3,); errors as of `Geometry.places`."""
        return self.deck.points[self.deck.places(np.array([node]))[0]]

    @cached_property
    def frames(self) -> dict[int, Card]:
        """The *TRANSFORM of every node that has one."""
        card_of: dict[int, Card] = {}
        for card in self.model:
            if card.kind == "TRANSFORM":
                if card.key("TYPE") not in ("", "R", "C"):
                    raise card.fault(f"TYPE={card.get('TYPE')} is not read, R and C are")
                card_of.update(dict.fromkeys(as_list(self.node_numbers(card.needs("NSET"), card, None)), card))
        return card_of

    def elements_at(self, nodes: IntArray) -> IntArray:
        """Numbers of the solid elements with one of these nodes."""
        parts = [rows[np.any(np.isin(rows[:, 1:], nodes), axis=1), 0] for rows in self.deck.solids.values()]
        return np.concatenate(parts)

    @cached_property
    def amplitudes(self) -> dict[str, Amplitude]:
        """The curves of *AMPLITUDE cards by name."""
        amplitudes = {}
        for card in self.deck.others:
            if card.kind == "AMPLITUDE":
                kind, meant = card.key("DEFINITION") or "TABULAR", card.key("VALUE") or "RELATIVE"
                if kind not in ("TABULAR", "SMOOTHSTEP", "PERIODIC") or "USER" in card.parameters:
                    raise card.fault("of definitions TABULAR, SMOOTH STEP and PERIODIC are read")
                if meant != "RELATIVE":
                    raise card.fault(f"VALUE={card.get('VALUE')} is not read: give factors of the loads")
                total = card.key("TIME") == "TOTALTIME"
                if kind == "PERIODIC":
                    spans = (step.end - (0.0 if total else step.begin) for step in self.steps)
                    amplitudes[card.key("NAME")] = Amplitude(periodic(card, max(spans)), total)
                    continue
                values = card.floats() if card.lines else np.empty(0)
                if len(values) % 2 or not len(values):
                    raise card.fault("needs pairs of time and factor")
                if np.any(np.diff(values[::2]) < 0.0):
                    raise card.fault("times must not go back")
                shift_x, shift_y = (card.setting(name) for name in ("SHIFTX", "SHIFTY"))
                pairs = values.reshape(-1, 2) + (shift_x, shift_y)
                rows = tuple((float(t), float(v)) for t, v in pairs)
                rows = smooth(rows) if kind == "SMOOTHSTEP" else rows
                amplitudes[card.key("NAME")] = Amplitude(rows, total)
        return amplitudes

    def amplitude(self, card: Card) -> Amplitude | None:
        """The curve that a card names."""
        name = card.key("AMPLITUDE")
        if not name:
            return None
        if name not in self.amplitudes:
            raise card.lacks("*AMPLITUDE", card.get("AMPLITUDE"), self.amplitudes)
        return self.amplitudes[name]

    def _single(self, rows: list[list[float]]) -> bool:
        """Whether factors are those of a single load step from 0 to 1, which need no time."""
        factors = [row[1] for row in rows]
        return (
            not self.large
            and self.open
            and len(self.steps) == 1
            and len(self.steps[0].ends) == 1
            and factors[-1] == 1.0
            and factors == sorted(factors)
            and factors[0] >= 0.0
        )

    def course(self, rows: Rows, key: str = "amplitude") -> tuple[float, dict[str, Any]]:
        """A value, and its factors in time as the entry of a table; none where it needs no time."""
        value, factors = reference(rows)
        return value, {} if factors is None or self._single(factors) else {key: factors}

    def timed(self, table: dict[str, Any], key: str, rows: Rows) -> dict[str, Any]:
        """A table with a value that follows these rows."""
        value, timed = self.course(rows)
        table |= {key: value, **timed}
        return table
