"""A deck of CalculiX or Abaqus as the tables of a case file, and what becomes of each of its cards.

Nothing is left out without a word: every card is used, not needed here (what it says of penalties, increments or
print requests has no meaning for this solver), or refused with its line.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import IntArray
from .cards import Card, key_of
from .constraints import Constraints
from .contacts import contact_tables, general_contact, itself
from .fates import REFUSED, Row, fates, refuse_misplaced
from .geometry import SECTION, Geometry
from .geometry_file import read_geometry
from .heat import Heat
from .loads import Loads
from .materials import directions_of, has_several, material_of, moduli_of
from .nodes import NodalTables, together
from .reading import Reading
from .rigid_surfaces import RIGID
from .springs import spring_tables
from .steps import PROCEDURES, Step, steps_of
from .temperatures import Temperatures


@dataclass
class Translation:
    """A deck as a case.

    Attributes:
        tables: As those of a case file; empty if a card is refused.
        cards: What became of each keyword, in the order of the deck.
        notes: What else a user should know, a sentence each.
        nonlinear: Whether a step asks for large motions (NLGEOM).
    """

    nonlinear: bool = False
    tables: dict[str, Any] = field(default_factory=dict)
    cards: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def refused(self) -> list[Row]:
        """The keywords that are refused."""
        return [row for row in self.cards if row.fate == REFUSED]

    def refuse(self, path: str) -> None:
        """Raises ValueError if a card is refused."""
        if self.refused:
            each = "".join(f"\n  *{row.keyword}: {row.why}" for row in self.refused)
            raise ValueError(f"{path}: coulomb cannot follow all of its cards (--ignore CARD leaves one out):{each}")


def translate(path: str, ignore: Iterable[str] = (), large: bool = False) -> Translation:
    """Read a deck as tables of a case.

    Args:
        ignore: Keywords that are left out although coulomb cannot follow them.
        large: For large motions, in load steps.

    Raises:
        OSError: If it, or a file that it includes, cannot be read.
        ValueError: If it is damaged, or says something that contradicts itself, with file and line.
    """
    return _Translator(
        read_geometry(path, again=True), {key_of(name.lstrip("*")) for name in ignore}, large
    ).translation


class _Translator:
    def __init__(self, deck: Geometry, ignore: set[str], large: bool):
        self.translation = Translation()
        surface_elements = [name for name in deck.elements if _names_faces(deck, name)]
        sections = [name for name in deck.elements if SECTION.match(name)] if deck.section else []
        titles = {card.get("TYPE").upper() for card in deck.cards if card.kind == "ELEMENT"}
        sections += [title for title in titles if RIGID.match(title) and title not in deck.elements]
        self.translation.cards = fates(deck.cards, ignore, surface_elements, sections)
        if self.translation.refused:
            return
        model, steps = steps_of([card for card in deck.others if card.kind not in ignore])
        steps = [step for step in steps if _procedure(step) != "SENSITIVITY"]
        refuse_misplaced(model, [card for step in steps for card in step.cards])
        if not steps:
            raise ValueError(f"{deck.path}: has no *STEP with *STATIC")
        asked = [step for step in steps if "NLGEOM" in step.card.parameters and step.card.key("NLGEOM") != "NO"]
        folds = bool(asked) and itself(model)
        large = large or folds or any(card.kind == "HYPERELASTIC" for card in model)
        if large:
            for step in steps:
                step.divide()
        if not any(map(len, deck.solids.values())):
            raise ValueError(f"{deck.path}: has no solid elements")
        self.deck, self.of = deck, Reading(deck, model, steps, large)
        self.notes = self.translation.notes = self.of.notes
        self.translation.nonlinear = bool(asked)
        self.translation.tables = self._tables()
        if folds:
            self.notes.append("NLGEOM and a surface in contact with itself: solved with large motions")

    def _tables(self) -> dict[str, Any]:
        stem = Path(self.deck.path).stem
        self.of.open = bool(contact_tables(self.of)) or any(card.kind == "CONTACT" for card in self.of.model)
        tables: dict[str, Any] = {
            "units": self._units(),
            "output": {"directory": f"results/{stem}", "format": ["xdmf", "frd"]},
        }
        kinds = self.deck.kinds
        bodies, self.temperatures = self.of.bodies, Temperatures(self.of)
        materials = self._materials()
        loads = Loads(self.of).tables(materials)
        if bodies:
            tables["body"] = []
            for body_name, numbers in bodies.items():
                of_body = {"name": body_name, "file": Path(self.deck.path).name, "cells": body_name}
                of_body |= _order(body_name)
                tables["body"].append(of_body | {"material": self._of_cells(materials, numbers)})
            self.notes.append(f"cells are of several kinds, each a [[body]]: {', '.join(bodies)}")
        else:
            tables["mesh"] = {"file": Path(self.deck.path).name, **self._slice(), **_order(*kinds)}
            tables["material"] = self._of_cells(materials, np.concatenate(list(kinds.values())))
        self._note_elements()
        constraints = Constraints(self.of)
        for face in constraints.cuts:
            body, _, name = face.rpartition(":")
            mesh = next((one for one in tables.get("body", ()) if one["name"] == body), tables.get("mesh"))
            mesh.setdefault("cut", []).append(name)  # type: ignore[union-attr]
        nodal = NodalTables(self.of, constraints)
        nodal.take()
        tables |= self.temperatures.tables()
        tables |= Heat(self.of, self.temperatures.start if self.of.heated else None).tables()
        tables |= nodal.tables()
        tables |= loads
        if "temperature" in tables:
            for _, _, table in materials:
                table.setdefault("expansion", 0.0)
        for name, more in constraints.tables().items():
            tables.setdefault(name, []).extend(more)
        if "nodal_force" in tables:
            tables["nodal_force"] = together(tables["nodal_force"])
        springs, links = spring_tables(self.of)
        for name, of_springs in (("spring", springs), ("equation", links)):
            if of_springs:
                tables.setdefault(name, []).extend(of_springs)
        tables["contact"] = contact_tables(self.of)
        if not tables["contact"]:
            del tables["contact"]
        if general := general_contact(self.of):
            tables["auto_contact"] = general
        if not {"contact", "auto_contact"} & tables.keys():
            self._without_contact(tables)
        ends = [end for step in self.of.steps for end in step.ends]
        times = sorted({*ends, *self._kinks(tables)})
        timed = any("amplitude" in key for table in _all_tables(tables) for key in table)
        if len(times) > 1 or timed or self.of.large or not self.of.open:
            tables["history"] = {"times": times}
        if self.of.large:
            tables["solver"] = {"kinematics": "large"}
        elif self.translation.nonlinear:
            self.notes.append(
                "NLGEOM: solved with small motions first, and with large ones if they are too large for that"
            )
        return tables

    def _without_contact(self, tables: dict[str, Any]) -> None:
        """Of a deck in which nothing may open or slide: contact follows where a tie ends, after the last step."""
        if not tables.get("tie"):
            self.notes.append(
                "there is no pair that may open or slide: coulomb solves contact problems, and linear ones are for "
                "other programs"
            )
            return
        tie = tables["tie"][0]
        tie["end"] = self.of.steps[-1].end
        tables["contact"] = [{name: tie[name] for name in ("face", "against", "slave")} | {"friction": 0.0}]
        self.notes.append(f"nothing may open or slide: {tie['face']!r} is tied until the end, and so is all of it")

    def _kinks(self, tables: dict[str, Any]) -> set[float]:
        """Times at which an amplitude has an extreme inside a step, and just after contact pairs are taken out or put
        in: as one step with what follows their forces would do work over the gap that stands for that."""
        last = self.of.steps[-1].end
        kinks: set[float] = set()
        for table in _all_tables(tables):
            kinks.update(time for time, _ in table.get("gap_amplitude", ()) if 0.0 < time < last)
            for key, rows in table.items():
                if key.endswith("amplitude"):
                    for before, row, after in zip(rows, rows[1:], rows[2:], strict=False):
                        if (row[1] - before[1]) * (after[1] - row[1]) < 0.0 and row[0] < last:
                            kinks.add(row[0])
        return kinks

    def _units(self) -> dict[str, str]:
        """By the magnitude of the largest elastic modulus."""
        moduli = [
            float(np.max(card.floats([0])[:1])) for card in self.of.model if card.kind == "ELASTIC" and card.lines
        ]
        largest = max(moduli, default=0.0)
        if largest >= 1e8:
            self.notes.append("units: metres, newtons, pascals, by the elastic modulus")
            return {"length": "m", "stress": "Pa"}
        sure = 2e4 <= largest <= 1e6
        self.notes.append(
            "units: millimetres, newtons, megapascals"
            + (", by the elastic modulus" if sure else ", as is usual; if they are others, say so under [units]")
        )
        return {"length": "mm", "stress": "MPa"}

    def _materials(self) -> list[tuple[str, IntArray, dict[str, Any]]]:
        """Set of elements, their numbers and the material of every section."""
        by_name: dict[str, list[Card]] = {}
        orientations: dict[tuple[str, str], Card] = {}  # each instance has its own
        now: list[Card] | None = None
        for card in self.of.model:
            if card.kind == "MATERIAL":
                now = by_name.setdefault(card.key("NAME"), [])
            elif card.kind == "ORIENTATION":
                orientations[self.deck.owner.get(id(card), ""), card.key("NAME")] = card
            elif card.kind in ("ELASTIC", "HYPERELASTIC", "DENSITY", "EXPANSION", "CONDUCTIVITY") and now is not None:
                now.append(card)
        materials = []
        for card in self.of.model:
            if card.kind != "SOLIDSECTION":
                continue
            if card.key("MATERIAL") not in by_name:
                raise card.lacks("*MATERIAL", card.get("MATERIAL"), by_name)
            cards, elements = by_name[card.key("MATERIAL")], self.deck.element_sets.members(self.of.set_name(card))
            table = material_of(card, cards, self._temperatures_of(elements, cards))
            if self.of.heated:
                table.setdefault("expansion", 0.0)
            else:
                table.pop("conductivity", None)
            if name := card.key("ORIENTATION"):
                own = orientations.get((self.deck.owner.get(id(card), ""), name)) or orientations.get(("", name))
                if own is None:
                    raise card.lacks("*ORIENTATION", card.get("ORIENTATION"), {name for _, name in orientations})
                if isinstance(table.get("young"), list):
                    table["directions"] = directions_of(own)
            name = self.of.set_name(card)
            materials.append((name, self.deck.element_sets.members(name), table))
        for name, numbers in self.deck.rigid.items():
            materials.append((name, numbers, self._of_rigid(materials[0][2])))
        return materials

    def _of_rigid(self, other: dict[str, Any]) -> dict[str, Any]:
        """The material of thin solids that do not deform: without weight, and with what all of a case must have."""
        table = {"young": max(moduli_of(self.of.model)), "poisson": 0.3}
        table |= {key: 0.0 for key in ("density", "expansion") if key in other}
        return table | {key: other[key] for key in ("conductivity",) if key in other}

    def _temperatures_of(self, elements: IntArray, material: list[Card]) -> tuple[float, float] | None:
        """Those of the start and the end at the nodes of some elements, the mean where they differ; None if none is
        given."""
        ends = self.temperatures.ends(elements)
        if ends is None:
            return None
        start, end = ends
        first = next((card.line for card in material if has_several(card)), None)
        if first is not None and np.ptp(end):
            self.notes.append(
                f"line {first}: constants by temperature are those of the mean, {end.mean():g}, of "
                f"{end.min():g} to {end.max():g}"
            )
        times = [time for step in self.of.steps for time in step.ends]
        if first is not None and (self.of.heated or self.temperatures.differ_at(times, elements)):
            which = f"{'start' if self.of.heated else 'end'}, {end.mean():g}"
            self.notes.append(f"line {first}: constants by temperature are those of the {which}, in all load steps")
        return float(start.mean() if np.ptp(start) else start[0]), float(end.mean() if np.ptp(end) else end[0])

    def _of_cells(self, materials: list[tuple[str, IntArray, dict[str, Any]]], numbers: IntArray) -> Any:
        """The table of the material of these cells, or several by set."""
        here = [(name, table) for name, of, table in materials if np.any(np.isin(of, numbers))]
        covered = np.concatenate([of for _, of, _ in materials]) if materials else np.empty(0)
        bare = numbers[~np.isin(numbers, covered)]
        if len(bare):
            first = self.deck.called(int(bare[0]))
            raise ValueError(f"{self.deck.path}: element {first} has no *SOLID SECTION ({len(bare)} elements)")
        if all(table == here[0][1] for _, table in here):
            return here[0][1]
        return [table | {"cells": name} for name, table in here]

    def _slice(self) -> dict[str, Any]:
        """Of a deck in 2D the kind of slice, and the thickness of its sections."""
        kind = self.deck.section
        if not kind:
            return {}
        if kind == "axisymmetric":
            self.notes.append("axisymmetric: concentrated loads and totals are for 360 degrees")
            return {"slice": kind}
        cards = [card for card in self.of.model if card.kind == "SOLIDSECTION"]
        given = {float(card.floats([0])[0]) if card.lines and card.lines[0].strip(", ") else 1.0 for card in cards}
        if len(given) > 1:
            raise cards[1].fault("sections of several thicknesses are not read")
        self.notes.append(f"{kind}: one layer of cells; forces are for the thickness")
        return {"slice": kind, "thickness": given.pop()}

    def _note_elements(self) -> None:
        if self.deck.section:
            return
        widths = set(self.deck.solids)
        if 20 in widths:
            self.notes.append("20-node hexahedra have a node in the middle of each face and of the cell as well")
        if widths & {5, 6, 13, 15}:
            self.notes.append(
                "prisms and pyramids, and hexahedra that share nodes with them, are split into tetrahedra"
            )
        if any(name.startswith(("C3D8R", "C3D8I")) for name in self.deck.elements):
            self.notes.append(
                "8-node hexahedra are fully integrated, without incompatible modes: in bending they are stiff"
            )


def _order(kind: str) -> dict[str, Any]:
    """The key that keeps tetrahedra of first order as they are in the deck, of cells of a kind (`Geometry.kinds`)."""
    return {"degree": 1} if kind == "first_order_tetrahedra" else {}


def _procedure(step: Step) -> str:
    return next((card.kind for card in step.cards if card.kind in PROCEDURES), "")


def _names_faces(deck: Geometry, kind: str) -> bool:
    """Whether elements of a type are on the surface of solids."""
    if (
        deck.section
        or not kind.startswith(("CPS", "CPE", "CAX", "S3", "S4", "S6", "STRI", "M3D", "SFM3D", "R3D"))
        or not deck.solids
    ):
        return False
    of_solids = np.unique(np.concatenate([rows[:, 1:].ravel() for rows in deck.solids.values()]))
    return bool(np.all(np.isin(np.vstack(deck.elements[kind])[:, 1:], of_solids)))


def _all_tables(tables: dict[str, Any]) -> list[dict[str, Any]]:
    """All tables of a case, those in lists too."""
    every = [tables]
    for value in tables.values():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, dict):
                every += _all_tables(one)
    return every
