"""Loads of a deck: pressures, weight and rotation."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from ..arrays import IntArray
from .cards import Card, key_of
from .materials import radial_direction
from .node_surfaces import loads_on_sides
from .reading import Reading
from .steps import Amplitude, Rows, Step, Tracks, reference

_Sides = str | frozenset[tuple[int | str, str]]
"""What is pressed: a surface, or elements and sets of elements with their sides."""

_Volume = tuple[str, str, tuple[float, ...]]
"""A load in the volume: elements, kind, and its direction or axis."""

_Sections = Sequence[tuple[str, IntArray, dict[str, Any]]]
"""Sections by name, their elements, and the table of their material."""

_NUMBERS: Final = {"GRAV": 3, "CENTRIF": 6, "BX": 0, "BY": 0, "BZ": 0}
"""How many numbers follow the value of loads in the volume, by their kind."""


class Loads:
    """The loads of a deck."""

    def __init__(self, reading: Reading):
        self._of = reading

    def tables(self, materials: _Sections) -> dict[str, Any]:
        """The tables of the loads; `materials` are sections by name, their elements and tables."""
        pressures = Tracks[_Sides](support=False)
        volumes = Tracks[_Volume](support=False)
        tractions = Tracks[tuple[str, tuple[float, ...]]](support=False)
        every: tuple[Tracks[Any], ...] = (pressures, volumes, tractions)
        names: dict[Any, str] = {}
        for step in self._of.steps:
            for tracks in every:
                tracks.begin(step)
            fresh = False
            for card in step.cards:
                if card.kind not in ("DLOAD", "DSLOAD"):
                    continue
                amplitude = self._of.amplitude(card)
                fresh |= card.key("OP") == "NEW"
                if card.kind == "DSLOAD":
                    for row, words in card.rows("a surface, P and a pressure", 3):
                        kind, face = key_of(words[1]), self._of.face(words[0], card, row)
                        value = card.number(words[2], row)
                        if kind == "TRVEC":
                            along = tuple(card.number(word, row) for word in words[3:6])
                            if len(along) < 3 or not any(along):
                                raise card.fault("TRVEC needs a surface, TRVEC, a value and a direction", row)
                            tractions.give((face, _unit(along)), value, step, amplitude)
                            continue
                        if kind != "P":
                            raise card.fault(f"loads of kind {words[1]!r} are not read, P and TRVEC are", row)
                        names.setdefault(face, face)
                        if not fresh:
                            self._refuse_parts(face, pressures, step, card)
                        pressures.give(face, value, step, amplitude)
                    continue
                for name, (value,), sides in loads_on_sides(self._of.deck, card):
                    of_sides = frozenset(sides)
                    elements = np.concatenate([self._of.deck.elements_of(what) for what, _ in sides])
                    names.setdefault(of_sides, f"{self._of.body_of(elements, '*DLOAD')}{name}")
                    if not fresh:
                        self._refuse_parts(of_sides, pressures, step, card)
                    pressures.give(of_sides, value, step, amplitude)
                self._volume_loads(card, volumes, step, amplitude)
            for tracks in every if fresh else ():
                tracks.drop(tracks.given, step)
        tables: dict[str, Any] = {}
        for key, track in pressures.all:
            table = self._of.timed({"face": names[key]}, "value", track.fixed()[0])
            tables.setdefault("pressure", []).append(table)
        for (face, way), track in tractions.all:
            table = self._of.timed({"face": face}, "value", track.fixed()[0])
            table["value"] = [table["value"] * part for part in way]
            tables.setdefault("traction", []).append(table)
        return tables | self._volumes(volumes, materials)

    def _volume_loads(self, card: Card, volumes: Tracks[_Volume], step: Step, amplitude: Amplitude | None) -> None:
        """Loads in the volume; without elements, as Abaqus/CAE writes them, in all of it."""
        for row in range(len(card.lines)):
            words = [*card.words(row), ""]
            kind = key_of(words[1])
            if words[0] and re.fullmatch("P[1-6]", kind):
                continue
            if kind not in _NUMBERS or len(words) < 3:
                on = "" if kind != "P" else ": which side is it on, as P1?"
                raise card.fault(f"loads of kind {words[1]!r} are not read{on}", row)
            numbers = tuple(card.number(word, row) for word in words[3:] if word)[: _NUMBERS[kind]]
            if len(numbers) < _NUMBERS[kind] or (numbers and not any(numbers[-3:])):
                raise card.fault(f"{kind} needs elements, {kind}, a value and a direction or an axis", row)
            numbers = _unit(numbers) if kind == "GRAV" else numbers
            volumes.give((words[0], kind, numbers), card.number(words[2], row), step, amplitude)

    def _refuse_parts(self, key: _Sides, pressures: Tracks[_Sides], step: Step, card: Card) -> None:
        """ValueError if a step presses sides that a step before has pressed together with others: only on these the
        pressure would change.  With OP=NEW the loads of the step before go to zero as those of this one come."""
        mine = self._sides(key)
        for other, track in pressures.all:
            if other != key and other not in pressures.given and track.value() and mine & self._sides(other):
                raise card.fault(
                    "presses some of the sides that a step before presses with others: give the same sets of elements "
                    "or surfaces in both"
                )

    def _sides(self, key: _Sides) -> frozenset[tuple[int, str]]:
        """Numbers of elements with their sides; those of free ones, without a side, do not count."""
        surfaces = self._of.deck.surfaces
        lines = surfaces[key_of(key.rpartition(":")[2])].lines if isinstance(key, str) else key
        return frozenset((int(n), side) for what, side in lines if side for n in self._of.deck.elements_of(what))

    def _volumes(self, volumes: Tracks[_Volume], sections: _Sections) -> dict[str, Any]:
        """Loads in the volume: of all elements, with one course in time, as gravity and body_force; others by groups of
        cells."""
        every = np.sort(self._of.all_elements)
        together: dict[tuple[str, tuple[float, ...], Rows], list[str]] = {}
        for (name, kind, numbers), track in volumes.all:
            together.setdefault((kind, numbers, track.fixed()[0]), []).append(name)
        tables: dict[str, Any] = {}
        whole: dict[str, tuple[Rows, list[Any]]] = {}
        for (kind, numbers, rows), names in together.items():
            of = {name: self._elements(name) for name in names}
            covered = np.sort(np.concatenate(list(of.values())))
            key = "gravity" if kind == "GRAV" else "body_force"
            first = whole.setdefault(key, (rows, []))[0]
            densities = {table.get("density") for *_, table in sections}
            one_law = kind != "CENTRIF" or (len(densities) == 1 and None not in densities)
            if one_law and np.array_equal(covered, every) and reference(first)[1] == reference(rows)[1]:
                density = float(densities.pop() or 0.0) if kind == "CENTRIF" else 1.0
                whole[key][1].append(self._force(kind, numbers, reference(rows)[0], density))
                continue
            for name, elements in of.items():
                tables.setdefault("volume_force", []).extend(
                    self._in_cells(name, elements, sections, (kind, numbers, rows))
                )
        for key, (rows, forces) in whole.items():
            if not forces:
                continue
            parts = [[*one] for one in zip(*forces, strict=True)]
            value = [sum(one) if all(isinstance(k, float) for k in one) else "+".join(map(str, one)) for one in parts]
            tables |= {key: value} | self._of.course(rows, f"{key}_amplitude")[1]
        return tables

    def _elements(self, name: str) -> IntArray:
        """Those of a load, without a name all."""
        if not name:
            return self._of.all_elements
        label = self._of.deck.label(name)
        return self._of.deck.elements_of(label if isinstance(label, str) else int(label[0]))

    def _force(self, kind: str, numbers: tuple[float, ...], value: float, density: float) -> list[float | str]:
        """Of a load of such a value: per volume, with a density per mass for those that are given so."""
        if kind == "GRAV":
            return [density * value * number for number in numbers]
        if kind == "CENTRIF":
            a, axis = np.split(np.array(numbers[:6]), 2)
            return [f"{density * value!r}*({part})" for part in radial_direction(a, a + axis)]
        return [value if kind == f"B{axis}" else 0.0 for axis in "XYZ"]

    def _in_cells(
        self, name: str, elements: IntArray, sections: _Sections, load: tuple[str, tuple[float, ...], Rows]
    ) -> Iterator[dict[str, Any]]:
        """The tables of a load on some elements: on their set, or on sections where it has several."""
        (kind, numbers, rows), deck = load, self._of.deck
        where = f"{deck.place_of(kind)}: {kind} on {name!r}"
        here = [(of, elements_of, one) for of, elements_of, one in sections if np.any(np.isin(elements_of, elements))]
        if len(here) == 1 and name and not np.all(np.isin(here[0][1], elements)):
            here = [(name, elements, here[0][2])]
        elif not all(np.all(np.isin(of, elements)) for _, of, _ in here):
            raise ValueError(f"{where}: on parts of several sections: give a set of elements of each")
        for of, mine, table in here:
            if of not in deck.element_sets or deck.element_sets.get(of).hidden:
                raise ValueError(f"{where}: give the name of a set of elements, not an internal one")
            if kind in ("GRAV", "CENTRIF") and table.get("density") is None:
                raise ValueError(f"{where}: its material has no *DENSITY")
            value, timed = self._of.course(rows)
            force = self._force(kind, numbers, value, float(table.get("density") or 0.0))
            for body, cells in (self._of.bodies or {"": mine}).items():
                if np.any(np.isin(mine, cells)):
                    group = deck.element_sets.get(of).name
                    yield {"cells": f"{body}:{group}" if body else group, "value": force} | timed


def _unit(numbers: tuple[float, ...]) -> tuple[float, ...]:
    size = math.hypot(*numbers)
    return tuple(number / size for number in numbers)
