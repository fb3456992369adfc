"""The temperatures of a deck at its nodes: at the start (*INITIAL CONDITIONS) and in the steps (*TEMPERATURE)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, IntArray, as_list
from .cards import Card
from .reading import Reading
from .steps import Amplitude, Step, Track, value_at

_SAME: Final = 1e-9
"""Part of the largest change up to which temperatures of nodes follow one course in time."""


_MOST: Final = 10_000
"""Numbers of nodes in one table."""


@dataclass(frozen=True)
class _Course:
    """The temperatures that some nodes are given: at the start, and in steps, with what of."""

    start: float
    events: tuple[tuple[Step, float, Amplitude | None], ...] = ()

    def then(self, step: Step, value: float, amplitude: Amplitude | None) -> _Course:
        """With another value from a step on; of one step the last counts."""
        before = tuple(event for event in self.events if event[0] is not step)
        return replace(self, events=(*before, (step, value, amplitude)))

    @cached_property
    def track(self) -> Track:
        track = Track([(0.0, self.start)])
        for step, value, amplitude in self.events:
            track.goes_to(value, step, amplitude)
        return track


class Temperatures:
    """What the cards of a deck give to the nodes of its solid elements.

    Attributes:
        nodes: Their numbers, ascending.
    """

    def __init__(self, reading: Reading):
        self._of, self.nodes = reading, reading.nodes_of_cells

    @cached_property
    def starts(self) -> FloatArray | None:
        """Those of the start at `nodes`; None if none is given.

        Raises:
            ValueError: If some nodes have one and others have none, with the line.
        """
        cards = [card for card in self._of.model if card.kind == "INITIALCONDITIONS"]
        start = np.full(len(self.nodes), np.nan)
        for card in cards:
            if card.key("TYPE") != "TEMPERATURE":
                continue
            _refuse_files(card)
            for row, words in card.rows("nodes and a temperature", 2):
                start[self._mine(words[0], card, row)] = card.number(words[1], row)
        missing = np.flatnonzero(np.isnan(start))
        if len(missing) == len(start):
            return None
        if len(missing):
            first = self._of.deck.called(int(self.nodes[missing[0]]))
            raise cards[-1].fault(f"{len(missing)} nodes of solids, as {first}, have no initial temperature")
        return start

    @property
    def start(self) -> float | None:
        """That of the start of all nodes, None if there is none; ValueError if it is not the same everywhere."""
        if self.starts is not None and np.ptp(self.starts):
            card = next(one for one in self._of.model if one.kind == "INITIALCONDITIONS")
            raise card.fault(
                f"several temperatures ({self.starts.min():g} to {self.starts.max():g}): one is needed here"
            )
        return None if self.starts is None else float(self.starts[0])

    @cached_property
    def _courses(self) -> tuple[list[_Course], IntArray] | None:
        """The different courses, and which of them every node follows; None without *TEMPERATURE."""
        cards = [(step, card) for step in self._of.steps for card in step.cards if card.kind == "TEMPERATURE"]
        if not cards:
            return None
        if self.starts is None:
            raise cards[0][1].fault("there is no *INITIAL CONDITIONS, TYPE=TEMPERATURE to begin with")
        values, of_node = np.unique(self.starts, return_inverse=True)
        courses, of_node = [_Course(float(value)) for value in values], of_node.astype(np.int64)

        def give(where: IntArray, step: Step, value: float | None, amplitude: Amplitude | None) -> None:
            for old in as_list(np.unique(of_node[where])):
                mine = where[of_node[where] == old]
                courses.append(courses[old].then(step, courses[old].start if value is None else value, amplitude))
                of_node[mine] = len(courses) - 1

        fresh: set[int] = set()
        for step, card in cards:
            _refuse_files(card)
            if card.key("OP") == "NEW" and step.number not in fresh:  # back to those of the start
                fresh.add(step.number)
                give(np.flatnonzero([courses[k].events != () for k in of_node]), step, None, None)
            for row, words in card.rows("nodes and a temperature", 2):
                where = np.flatnonzero(self._mine(words[0], card, row))
                give(where, step, card.number(words[1], row), self._of.amplitude(card))
        used, of_node = np.unique(of_node, return_inverse=True)
        return [courses[k] for k in used], of_node.astype(np.int64)

    def ends(self, elements: IntArray) -> tuple[FloatArray, FloatArray] | None:
        """Those of the start and of the end of the last step at the nodes of some elements; None if none is given."""
        if self.starts is None:
            return None
        where = np.searchsorted(self.nodes, self._of.nodes_of(elements))
        start = end = self.starts[where]
        if self._courses is not None:
            courses, of_node = self._courses
            end = np.array([course.track.value() for course in courses])[of_node[where]]
        return start, end

    def differ_at(self, times: Sequence[float], elements: IntArray) -> bool:
        """Whether the nodes of some elements have other temperatures at one of these times than at another."""
        if self._courses is None:
            return False
        courses, of_node = self._courses
        here = np.unique(of_node[np.searchsorted(self.nodes, self._of.nodes_of(elements))])
        return any(len({value_at(tuple(courses[k].track.rows), time) for time in times}) > 1 for k in here)

    def tables(self) -> dict[str, Any]:
        """The table [temperature]; empty where nothing changes.

        Raises:
            ValueError: If temperatures of different nodes do not follow one course in time, with the line.
        """
        if self._courses is None:
            return {}
        courses, of_node = self._courses
        times = sorted({time for course in courses for time, _ in course.track.rows})
        changes = np.array([[value_at(tuple(one.track.rows), time) - one.start for one in courses] for time in times])
        most = int(np.argmax(np.abs(changes).max(axis=1)))
        largest, last = float(np.abs(changes[most]).max()), changes[most]
        if largest == 0.0:
            return {}
        factors = changes @ last / (last @ last)
        if np.abs(changes - factors[:, None] * last).max() > _SAME * largest:
            card = [one for step in self._of.steps for one in step.cards if one.kind == "TEMPERATURE"][-1]
            raise card.fault("temperatures of different nodes do not follow one course in time, which is not read")
        starts = {course.start for course in courses}
        start = next(iter(starts)) if len(starts) == 1 else 0.0
        if len(starts) > 1:
            self._of.notes.append("initial temperatures differ: those shown are the changes since the start")
        value = start + last[np.argmax(np.bincount(of_node))]
        table: dict[str, Any] = {"value": float(value), "reference": start}
        others = [
            {"nodes": nodes, "value": float(start + change)}
            for change in np.unique(last)
            if start + change != value
            for nodes in self._called(self.nodes[np.isin(of_node, np.flatnonzero(last == change))])
        ]
        table |= {"at": others} if others else {}
        if others and any(name.startswith("C3D8") for name in self._of.deck.elements):
            self._of.notes.append("temperatures are linear in 8-node hexahedra; CalculiX takes the mean in each")
        _, timed = self._of.course(tuple((time, float(factor)) for time, factor in zip(times, factors, strict=True)))
        return {"temperature": table | timed}

    def _mine(self, word: str, card: Card, row: int) -> Any:
        """Whether each of `nodes` is among those that a word names."""
        return np.isin(self.nodes, self._of.node_numbers(word, card, row))

    def _called(self, nodes: IntArray) -> list[Any]:
        """Some of the nodes as a set of elements whose nodes they are, or by their numbers, in each body."""
        sets = self._of.deck.element_sets
        names = [one for one in sets.names if one not in self._of.deck.node_sets]
        name = next((one for one in names if np.array_equal(self._of.nodes_of(sets.members(one)), nodes)), None)
        called: list[Any] = []
        for body in self._of.bodies or [""]:
            mine = self._of.nodes_of(self._of.bodies[body]) if body else nodes
            here, of = as_list(nodes[np.isin(nodes, mine)]), f"{body}:" if body else ""
            if name is not None:
                called += [f"{of}{name}"] if here else []
            else:
                parts = [here[k : k + _MOST] for k in range(0, len(here), _MOST)]
                called += [[f"{of}{node}" for node in part] if body else part for part in parts]
        return called


def _refuse_files(card: Card) -> None:
    for name in ("FILE", "USER", "BSTEP", "MIDSIDE"):
        if name in card.parameters:
            raise card.fault(f"temperatures are read from its lines, not by {name}")
