"""Loads of a deck: pressures, weight and rotation."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, IntArray
from .cards import Card, key_of
from .materials import radial_direction
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
    """The loads of a deck.

    Args:
        reading: The deck.
    """

    def __init__(self, reading: Reading):
        self._of = reading

    def tables(self, materials: _Sections) -> dict[str, Any]:
        """The tables of the loads; `materials` are sections by name, their elements and tables, of which those without
        weight get the density 0."""
        pressures = Tracks[_Sides](support=False)
        volumes = Tracks[_Volume](support=False)
        tractions = Tracks[tuple[str, tuple[float, ...]]](support=False)
        names: dict[Any, str] = {}
        for step in self._of.steps:
            pressures.begin(step)
            volumes.begin(step)
            tractions.begin(step)
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
                        self._refuse_parts(face, pressures, step, card)
                        pressures.give(face, value, step, amplitude)
                    continue
                for name, (value,), sides in self._of.deck.on_sides(card):
                    of_sides = frozenset(sides)
                    elements = np.concatenate([self._of.elements_of(what) for what, _ in sides])
                    names.setdefault(of_sides, f"{self._of.body_of(elements, '*DLOAD')}{name}")
                    self._refuse_parts(of_sides, pressures, step, card)
                    pressures.give(of_sides, value, step, amplitude)
                self._volume_loads(card, volumes, step, amplitude)
            if fresh:
                pressures.drop(pressures.given, step)
                volumes.drop(volumes.given, step)
                tractions.drop(tractions.given, step)
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
        pressure would change."""
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
        return frozenset((int(n), side) for what, side in lines if side for n in self._of.elements_of(what))

    def _volumes(self, volumes: Tracks[_Volume], materials: _Sections) -> dict[str, Any]:
        every = self._of.all_elements
        together: dict[tuple[str, tuple[float, ...], Rows], list[str]] = {}
        for (name, kind, numbers), track in volumes.all:
            together.setdefault((kind, numbers, track.fixed()[0]), []).append(name)
        weights: list[tuple[FloatArray, Rows]] = []
        forces: list[tuple[list[float | str], Rows]] = []
        for (kind, numbers, rows), names in together.items():
            labels = [self._of.deck.label(name) for name in names if name]
            of = [self._of.elements_of(one if isinstance(one, str) else int(one[0])) for one in labels]
            if len(names) > 1 and ("" in names or len(np.unique(np.concatenate(of))) < sum(map(len, of))):
                twice = f"{kind} on {', '.join(map(repr, names))}: some elements have it twice"
                raise ValueError(f"{self._of.deck.place_of(kind)}: {twice}: give one load of both")
            if "" not in names and not np.all(np.isin(every, np.concatenate(of))):
                fault = f"{self._of.deck.place_of(kind)}: {kind} on {', '.join(map(repr, names))}, some of the elements"
                if kind != "GRAV" or len(together) > 1:
                    raise ValueError(f"{fault}: only on all is read")
                self._weigh(np.concatenate(of), materials, fault)
            value, _ = reference(rows)
            if kind == "GRAV":
                weights.append((value * np.array(numbers), rows))
            elif kind == "CENTRIF":
                densities = {table.get("density") for *_, table in materials}
                forces.append((list(self._centrifugal(value, numbers, densities)), rows))
            else:
                forces.append(([value if kind == f"B{axis}" else 0.0 for axis in "XYZ"], rows))
        tables: dict[str, Any] = {}
        if weights:
            tables |= self._timed(
                "gravity",
                [float(one) for one in np.sum([one for one, _ in weights], axis=0)],
                [rows for _, rows in weights],
            )
        if forces:
            parts = zip(*(force for force, _ in forces), strict=True)
            whole = [sum(one) if all(isinstance(k, float) for k in one) else "+".join(map(str, one)) for one in parts]
            tables |= self._timed("body_force", whole, [rows for _, rows in forces])
        return tables

    def _weigh(self, elements: IntArray, materials: _Sections, fault: str) -> None:
        """Density 0 for sections that have no weight; ValueError, beginning with `fault`, if one has it in part."""
        for section, of_section, table in materials:
            weighing = np.isin(of_section, elements)
            if np.any(weighing) and not np.all(weighing):
                raise ValueError(
                    f"{fault}, a part of the section {section!r}: only on all or on whole sections is read"
                )
            if not np.any(weighing):
                table["density"] = 0.0
                self._of.notes.append(f"GRAV does not act on the section {section!r}: its density is 0 here")

    def _timed(self, name: str, value: list[Any], rows: list[Rows]) -> dict[str, Any]:
        """A load in the volume that is the sum of some that follow these rows."""
        factors = [reference(one)[1] for one in rows]
        if any(one != factors[0] for one in factors):
            raise ValueError(f"{self._of.deck.path}: *DLOAD: several loads of {name} with different courses in time")
        timed = factors[0] is not None and not self._of.single(factors[0])
        return {name: value} | ({f"{name}_amplitude": factors[0]} if timed else {})

    def _centrifugal(self, omega2: float, numbers: tuple[float, ...], densities: set[float | None]) -> list[str]:
        density = next(iter(densities)) if len(densities) == 1 else None
        if density is None:
            raise ValueError(f"{self._of.deck.path}: *DLOAD: CENTRIF needs one *DENSITY for all materials")
        a, axis = np.split(np.array(numbers[:6]), 2)
        return [f"{float(density * omega2)!r}*({part})" for part in radial_direction(a, a + axis)]


def _unit(numbers: tuple[float, ...]) -> tuple[float, ...]:
    size = math.hypot(*numbers)
    return tuple(one / size for one in numbers)
