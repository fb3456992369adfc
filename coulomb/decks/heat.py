"""Steady heat of a deck: temperatures, films and fluxes on faces, as the tables [[heat]] of a case."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from .cards import Card, key_of
from .node_surfaces import loads_on_sides
from .reading import Reading
from .steps import PROCEDURES, STEADY, Step, Track, Tracks

_TEMPERATURE = (0, 11)
"""The degrees of freedom of *BOUNDARY that are the temperature."""


def is_temperature(card: Card, words: list[str]) -> bool:
    """Whether a *BOUNDARY line prescribes a temperature."""
    return len(words) > 1 and words[1].isdigit() and int(words[1]) in _TEMPERATURE


class Heat:
    """What heats and cools the bodies of a deck whose steps conduct heat.

    Args:
        initial: The temperature of all nodes at the start, which is that of the unstrained bodies.
    """

    def __init__(self, reading: Reading, initial: float | None):
        self._of, self._initial = reading, initial
        self._names: dict[Any, str] = {}

    def tables(self) -> dict[str, Any]:
        """The tables [[heat]] and the reference temperature; nothing of a deck without heat.

        Raises:
            ValueError: If some steps conduct heat and others do not, or something is not read, with the line.
        """
        if not self._of.heated:
            return {}
        procedures = [card for step in self._of.steps for card in step.cards if card.kind in PROCEDURES]
        if not all(card.kind in STEADY for card in procedures):
            static = next(card for card in procedures if card.kind not in STEADY)
            raise static.fault("beside steps that conduct heat, steps without it are not read")
        if self._initial is None:
            raise procedures[0].fault("there is no *INITIAL CONDITIONS, TYPE=TEMPERATURE to begin with")
        kept, films, fluxes, sources = (Tracks[Any](support=support) for support in (True, True, False, False))
        before = [card for card in self._of.model if card.kind == "BOUNDARY"]
        for step in self._of.steps:
            fresh = {card.kind: card for card in step.cards if card.key("OP") == "NEW"}
            for tracks in (kept, films, fluxes, sources):
                tracks.begin(step)
            for card in (*(before if "BOUNDARY" not in fresh else ()), *step.cards):
                if card.kind == "BOUNDARY":
                    for face, value in self._prescribed(card):
                        self._give(kept, face, value, step, card)
                elif card.kind in ("FILM", "DFLUX"):
                    self._on_sides(films if card.kind == "FILM" else fluxes, card, step)
                    self._in_volume(sources, card, step)
            before = []
            for kind, tracks in (("BOUNDARY", kept), ("FILM", films)):
                if kind in fresh and {key for key, _ in tracks.all} - tracks.given:
                    raise fresh[kind].fault("OP=NEW: what ends in a step while others stay is not read: give it again")
            if "DFLUX" in fresh:
                fluxes.drop(fluxes.given, step)
                sources.drop(sources.given, step)
        tables = [{"face": face} | self._changed("temperature", track) for face, track in kept.all]
        tables += [
            {"face": self._names[sides], "film": film} | self._changed("ambient", track)
            for (sides, film), track in films.all
        ]
        tables += [
            {"face": self._names[sides]} | self._of.timed({}, "flux", track.fixed()[0]) for sides, track in fluxes.all
        ]
        tables += [
            self._of.timed({"body": key[0]} if key[0] else {}, "source", track.fixed()[0]) for key, track in sources.all
        ]
        return {"reference_temperature": self._initial, "heat": tables}

    def _prescribed(self, card: Card) -> Iterator[tuple[str, float]]:
        """The set of nodes of every temperature, which must make a face, and the temperature."""
        for row, words in card.rows("nodes and degrees of freedom", 2):
            if not is_temperature(card, words):
                continue
            if not isinstance(self._of.deck.label(words[0]), str):
                raise card.fault("temperatures of single nodes are not read, those of a set that makes a face are", row)
            nodes = np.unique(self._of.node_numbers(words[0], card, row))
            body = self._of.body_of(self._of.elements_at(nodes), "*BOUNDARY of temperature")
            yield f"{body}{words[0]}", card.number(words[3], row) if len(words) > 3 else 0.0

    def _on_sides(self, into: Tracks[Any], card: Card, step: Step) -> None:
        for name, values, sides in loads_on_sides(self._of.deck, card):
            key = frozenset(sides)
            elements = np.concatenate([self._of.deck.elements_of(what) for what, _ in sides])
            self._names[key] = f"{self._of.body_of(elements, f'*{card.keyword}')}{name}"
            if card.kind == "FILM":
                self._give(into, (key, values[1]), values[0], step, card)
            else:
                into.give(key, values[0], step, self._of.amplitude(card))

    def _in_volume(self, sources: Tracks[Any], card: Card, step: Step) -> None:
        """Heat in the volume of bodies (BF); ValueError where it is on a part of one, or of another kind."""
        for row in range(len(card.lines)):
            words = [*card.words(row), ""]
            kind = key_of(words[1])
            if words[0] and re.fullmatch("[FS][1-6]", kind):
                continue
            if card.kind != "DFLUX" or kind != "BF" or len(words) < 4:
                raise card.fault("what is on sides of elements is read, as F1 and S1, and BF in the volume", row)
            label = self._of.deck.label(words[0])
            elements = self._of.deck.elements_of(label if isinstance(label, str) else int(label[0]))
            every = dict(self._of.bodies) or {"": self._of.all_elements}
            for name, of in every.items():
                inside = np.isin(of, elements)
                if np.any(inside) and not np.all(inside):
                    raise card.fault(f"BF on {words[0]!r}, some of the elements of a body: only on all is read", row)
                if np.any(inside):
                    sources.give((name, key_of(words[0])), card.number(words[2], row), step, self._of.amplitude(card))

    def _give(self, into: Tracks[Any], key: Any, value: float, step: Step, card: Card) -> None:
        assert self._initial is not None
        if key not in dict(into.all):
            into.begin_at(key, 0.0, self._initial)
        into.give(key, value, step, self._of.amplitude(card))

    def _changed(self, key: str, track: Track) -> dict[str, Any]:
        """A temperature in time: that of the largest change from the start, with the factor of the change."""
        assert self._initial is not None
        start = self._initial
        change, timed = self._of.course(tuple((time, value - start) for time, value in track.fixed()[0]))
        return {key: start + change, **timed}
