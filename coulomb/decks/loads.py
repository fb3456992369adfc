"""Loads of a deck: pressures, weight, rotation and temperature."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from .cards import Card, key_of
from .materials import radial_direction
from .reading import Reading
from .steps import Amplitude, Rows, Step, Tracks, reference

_Volume = tuple[str, str, tuple[float, ...]]
"""A load in the volume: elements, GRAV or CENTRIF, and its direction or axis."""


class Loads:
    """The loads of a deck, and its temperature.

    Args:
        reading: The deck.
    """

    def __init__(self, reading: Reading):
        self._of = reading

    @cached_property
    def initial_temperature(self) -> float | None:
        """The one of all nodes, if it is given."""
        values = [
            card.number(words[1], row)
            for card in self._of.model
            if card.kind == "INITIALCONDITIONS" and card.key("TYPE") == "TEMPERATURE"
            for row, words in card.rows("nodes and a temperature", 2)
        ]
        if len(set(values)) > 1:
            raise ValueError(
                f"{self._of.deck.path}: *INITIAL CONDITIONS: several temperatures ({values[:3]}) are not read"
            )
        return values[0] if values else None

    @cached_property
    def temperatures(self) -> Tracks[str] | None:
        """The temperature in the course of the steps."""
        cards = [(step, card) for step in self._of.steps for card in step.cards if card.kind == "TEMPERATURE"]
        if not cards:
            return None
        if self.initial_temperature is None:
            raise cards[0][1].fault("there is no *INITIAL CONDITIONS, TYPE=TEMPERATURE to begin with")
        tracks = Tracks[str](support=True)
        for step, card in cards:
            for row, words in card.rows("nodes and a temperature", 2):
                nodes = self._of.node_numbers(words[0], card, row)
                if not np.all(np.isin(self._of.nodes_of_cells, nodes)):
                    raise card.fault(
                        f"{words[0]!r} are some of the nodes: only one temperature of all of them is read", row
                    )
                if not tracks.all:
                    tracks.begin_at("", 0.0, self.initial_temperature)
                tracks.give("", card.number(words[1], row), step, self._of.amplitude(card))
        return tracks if tracks.all else None

    def temperature(self) -> dict[str, Any]:
        tracks = self.temperatures
        if tracks is None:
            return {}
        assert self.initial_temperature is not None
        rows = [(time, value - self.initial_temperature) for time, value in tracks.all[0][1].rows]
        change, amplitude = reference(tuple(rows))
        if change == 0.0:
            return {}
        start = self.initial_temperature
        table: dict[str, Any] = {"value": start + change, "reference": start}
        if amplitude is not None and not self._of.single(amplitude):
            table["amplitude"] = amplitude
        return {"temperature": table}

    def tables(self, densities: set[float | None]) -> dict[str, Any]:
        pressures = Tracks[str | frozenset[tuple[int | str, str]]](support=False)
        volumes = Tracks[_Volume](support=False)
        names: dict[Any, str] = {}
        for step in self._of.steps:
            pressures.begin(step)
            volumes.begin(step)
            fresh = False
            for card in step.cards:
                if card.kind not in ("DLOAD", "DSLOAD"):
                    continue
                amplitude = self._of.amplitude(card)
                fresh |= card.key("OP") == "NEW"
                if card.kind == "DSLOAD":
                    for row, words in card.rows("a surface, P and a pressure", 3):
                        if key_of(words[1]) != "P":
                            raise card.fault(f"loads of kind {words[1]!r} are not read, pressures P are", row)
                        face = self._of.face(words[0], card, row)
                        names.setdefault(face, face)
                        pressures.give(face, card.number(words[2], row), step, amplitude)
                    continue
                for name, (value,), sides in self._of.deck.on_sides(card):
                    of_sides = frozenset(sides)
                    elements = np.concatenate([self._of.elements_of(what) for what, _ in sides])
                    names.setdefault(of_sides, f"{self._of.body_of(elements, '*DLOAD')}{name}")
                    pressures.give(of_sides, value, step, amplitude)
                self._volume_loads(card, volumes, step, amplitude)
            if fresh:
                pressures.drop(pressures.given, step)
                volumes.drop(volumes.given, step)
        tables: dict[str, Any] = {}
        for key, track in pressures.all:
            table = self._of.timed({"face": names[key]}, "value", track.fixed()[0])
            tables.setdefault("pressure", []).append(table)
        return tables | self._volumes(volumes, densities)

    def _volume_loads(self, card: Card, volumes: Tracks[_Volume], step: Step, amplitude: Amplitude | None) -> None:
        for row, words in card.rows():
            kind = key_of(words[1]) if len(words) > 1 else ""
            if kind.startswith("P"):
                continue
            if kind not in ("GRAV", "CENTRIF"):
                raise card.fault(f"loads of kind {words[1] if len(words) > 1 else ''!r} are not read", row)
            numbers = tuple(card.number(word, row) for word in words[3:] if word)
            if len(words) < 3 or len(numbers) < (3 if kind == "GRAV" else 6) or not any(numbers[-3:]):
                raise card.fault(f"{kind} needs elements, {kind}, a value and a direction or an axis", row)
            volumes.give((words[0], kind, numbers), card.number(words[2], row), step, amplitude)

    def _volumes(self, volumes: Tracks[_Volume], densities: set[float | None]) -> dict[str, Any]:
        every = np.concatenate([rows[:, 0] for rows in self._of.deck.solids.values()])
        tables: dict[str, Any] = {}
        together: dict[tuple[str, tuple[float, ...], Rows], list[str]] = {}
        for (name, kind, numbers), track in volumes.all:
            together.setdefault((kind, numbers, track.fixed()[0]), []).append(name)
        for (kind, numbers, rows), names in together.items():
            labels = [self._of.deck.label(name) for name in names]
            of = [self._of.elements_of(one if isinstance(one, str) else int(one[0])) for one in labels]
            if not np.all(np.isin(every, np.concatenate(of))):
                of_some = f"{kind} on {', '.join(map(repr, names))}, some of the elements"
                raise ValueError(f"{self._of.deck.place_of(kind)}: {of_some}: only on all is read")
            if kind in tables:
                raise ValueError(f"{self._of.deck.path}: *DLOAD: several {kind} loads are not read")
            value, amplitude = reference(rows)
            timed = amplitude is not None and not self._of.single(amplitude)
            tables[kind] = True
            if kind == "GRAV":
                direction = np.array(numbers[:3]) / np.linalg.norm(numbers[:3])
                tables["gravity"] = [float(one) for one in value * direction]
                tables |= {"gravity_amplitude": amplitude} if timed else {}
            else:
                tables["body_force"] = self._centrifugal(value, numbers, densities)
                tables |= {"body_force_amplitude": amplitude} if timed else {}
        return {name: table for name, table in tables.items() if name not in ("GRAV", "CENTRIF")}

    def _centrifugal(self, omega2: float, numbers: tuple[float, ...], densities: set[float | None]) -> list[str]:
        density = next(iter(densities)) if len(densities) == 1 else None
        if density is None:
            raise ValueError(f"{self._of.deck.path}: *DLOAD: CENTRIF needs one *DENSITY for all materials")
        a, axis = np.split(np.array(numbers[:6]), 2)
        return [f"{density * omega2!r}*({part})" for part in radial_direction(a, a + axis)]
