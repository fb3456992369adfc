"""Meshes of Abaqus and CalculiX input files (.inp): elements, element sets, node sets and surfaces (`decks.geometry`).

Our own reader, not meshio's (tried: 5.3.5), which loses or misreads the data of faces: it ignores *SURFACE; an
element set given by the names of others, or on an *ELEMENT after one without a set, goes to the wrong elements, without
a warning; a second *NODE replaces the first; *NODE's NSET, types in lower case and surface elements (SFM3D4, M3D4) are
not read.  Nor meshlane's (tried: 5.5.0), which ignores *SURFACE too, and without a warning reads no elements from lines
that end in a comma, and those of one part of two alone.  Formats with plain numbers on cells are read by meshio
(`meshio_format`).
24 000 hexahedra take 0.38 s here and 0.60 s in meshio.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ...arrays import IntArray
from ...decks.geometry import Geometry
from ...decks.geometry_file import read_geometry
from ...decks.node_surfaces import corners_of_sides, facets_with_nodes, loads_on_sides, refuse_other_sides
from ...decks.rigid_bodies import add_skins
from ...decks.sets import NamedSet, Sets
from .mesh_file import MeshFile, SectionFile, not_empty, solid_nodes
from .one_kind import READ, of_one_kind

_FREE: Final = ("", "SPOS", "SNEG")
"""Sides of surface elements, or free ones of solid ones."""


def read(path: str, cells: str | None = None) -> MeshFile:
    """Read a file on this rank.

    Sets of solid elements become groups of cells; sets of surface elements (S3, S4, CPS3, SFM3D4, ...) and surfaces
    groups of facets; node sets and surfaces of nodes groups of nodes, and of slave nodes that make no facets the facets
    with one of them that face the master (`decks.node_surfaces`).  Loads on sides of elements that belong to no
    surface (*DLOAD P3 on a set) make a group of facets, as "SET P3", and bodies that are rigid as a whole one of their
    surface, "SET skin".

    Args:
        cells: The set of solid elements to read, or one of the kinds of cells of the deck (`Geometry.kinds`); by
            default all.

    Raises:
        OSError: If it, or a file it includes, cannot be read.
        ValueError: If it is damaged, or contains something that this reader does not support and cannot skip.
    """
    return _Mesh(read_geometry(path, again=cells is not None), cells).file


def read_section(path: str, cells: str | None = None) -> SectionFile:
    """Read the elements CPS, CPE or CAX of a file without solid ones, with surfaces and pressed sides as groups of
    lines; arguments and errors as of `read`."""
    deck = read_geometry(path, again=cells is not None)
    if not deck.section:
        raise ValueError(f"{path}: has no section in 2D alone, of elements CPS, CPE or CAX")
    chosen = deck.element_sets.members(cells) if cells not in (None, deck.section) else None
    rows = {
        width: block if chosen is None else block[np.isin(block[:, 0], chosen)] for width, block in deck.solids.items()
    }
    numbers = np.concatenate([block[:, 0] for block in rows.values()])
    blocks = {width: deck.places(block[:, 1:]) for width, block in rows.items()}

    def lines(given: Sequence[tuple[int | str, str]]) -> IntArray:
        for what, side in given:
            refuse_other_sides(deck, rows, what, side, path, " in 2D")
        parts = [corners_of_sides(deck, rows, what, side)[:, :2] for what, side in given]
        return np.sort(np.vstack([np.empty((0, 2), dtype=np.int64), *parts]), axis=1)

    add_skins(deck)
    surfaces = {surface.name: lines(surface.lines) for surface in deck.surfaces.values() if not surface.nodes}
    loads = ("DLOAD", "FILM", "DFLUX")
    pressed = (of for card in deck.others if card.kind in loads for of in loads_on_sides(deck, card))
    surfaces |= {name: lines(sides) for name, _, sides in pressed}
    used = np.zeros(len(deck.points), dtype=bool)
    for points in blocks.values():
        used[points] = True
    nodes = {one.name: deck.places(deck.node_sets.members(one.name)) for one in _given(deck.node_sets)}
    nodes = {name: some[used[some]] for name, some in nodes.items()}
    groups = {one.name: np.isin(numbers, deck.element_sets.members(one.name)) for one in _given(deck.element_sets)}
    of_cells = {name: np.flatnonzero(inside) for name, inside in groups.items() if np.any(inside)}
    return SectionFile(path, deck.points, blocks, of_cells, surfaces, nodes, deck.tags)


def _given(sets: Sets) -> list[NamedSet]:
    return [one for one in sets.all.values() if not one.hidden]


class _Mesh:
    """The solid elements of a deck, or of one of its sets, as cells of one kind."""

    def __init__(self, deck: Geometry, cells: str | None):
        self._deck = deck
        if deck.section:  # its elements of 4 nodes are no tetrahedra
            solid_nodes(deck.path, {}, sum(map(len, deck.solids.values())))
        chosen = None if cells is None else deck.kinds.get(cells)
        if chosen is None and cells is not None:
            chosen = deck.element_sets.members(cells)
        rows = {
            width: block if chosen is None else block[np.isin(block[:, 0], chosen)]
            for width, block in deck.solids.items()
        }
        self._rows = {width: block for width, block in rows.items() if len(block)}
        strange = {width: len(block) for width, block in self._rows.items() if width not in READ}
        if cells is None and len(deck.solids) > 1 and len(deck.kinds) > 1:
            raise ValueError(
                f"{deck.path}: has bodies of several kinds of cells: give each a [[body]] with cells = "
                f"{' or '.join(repr(name) for name in deck.kinds)}, or with the name of a set of elements"
            )
        if 27 in strange:
            raise ValueError(
                f"{deck.path}: has 27-node hexahedra, whose nodes programs order differently in this format; export "
                "them to .msh (gmsh), .med, .e (Exodus II) or .vtu"
            )
        if strange or not self._rows:
            solid_nodes(deck.path, strange, sum(map(len, deck.flats.values())))
        blocks = {width: deck.places(block[:, 1:]) for width, block in self._rows.items()}
        numbers = np.concatenate([block[:, 0] for block in self._rows.values()])
        kind = of_one_kind(deck.path, deck.points, blocks)
        used = np.zeros(len(deck.points), dtype=bool)
        for block in blocks.values():
            used[block] = True
        self._used = used
        kind.used = None if cells is None else used
        sets = {one.name: deck.element_sets.members(one.name) for one in _given(deck.element_sets)}
        groups = {name: np.flatnonzero(np.isin(numbers, members)) for name, members in sets.items()}
        nodes = {one.name: deck.places(deck.node_sets.members(one.name)) for one in _given(deck.node_sets)}
        nodes = {name: some[used[some]] for name, some in nodes.items()}
        file = kind.file(deck.path, groups, self._face_groups(sets), nodes, deck.tags)
        self.file = replace(file, cell_groups=not_empty(file.cell_groups))

    def _face_groups(self, sets: Mapping[str, IntArray]) -> dict[str, list[IntArray]]:
        deck = self._deck
        groups = {name: facets for name, members in sets.items() if (facets := self._on_flats(members))}
        add_skins(deck)
        for surface in deck.surfaces.values():
            around = facets_with_nodes(deck, surface.name) if surface.nodes else None
            if around is not None:
                groups[surface.name] = _by_shape(around[np.all(self._used[around], axis=1)])
            if not surface.nodes:
                groups[surface.name] = [
                    of for line in _merged(surface.lines) for of in self._sides(surface.name, *line)
                ]
        for card in deck.others:
            for name, _, sides in loads_on_sides(deck, card) if card.kind in ("DLOAD", "FILM", "DFLUX") else ():
                groups[name] = [rows for line in _merged(sides) for rows in self._sides(name, *line)]
        return groups

    def _on_flats(self, numbers: IntArray) -> list[IntArray]:
        """Facets of surface elements of these numbers."""
        places = []
        for width, block in self._deck.flats.items():
            corners = {3: 3, 4: 4, 6: 3}[width]
            mine = block[np.isin(block[:, 0], numbers), 1 : 1 + corners]
            if len(mine):
                places.append(self._deck.places(mine))
        return places

    def _sides(self, name: str, what: IntArray | str, side: str) -> list[IntArray]:
        """Corners of the facets that a line of a surface names."""
        if side in _FREE:
            on_flats, side = self._on_flats(self._deck.elements_of(what)), ""
            if on_flats:
                return on_flats
        refuse_other_sides(self._deck, self._rows, what, side, f"{self._deck.path}: *SURFACE {name}")
        return _by_shape(corners_of_sides(self._deck, self._rows, what, side))


def _merged(lines: Sequence[tuple[int | str, str]]) -> list[tuple[IntArray | str, str]]:
    """Lines of a surface, those of single elements and a side S1, S2, ... together."""
    numbers: dict[str, list[int]] = {}
    others: list[tuple[IntArray | str, str]] = []
    for what, side in lines:
        if isinstance(what, str):
            others.append((what, side))
        elif side in _FREE:
            others.append((np.array([what]), side))
        else:
            numbers.setdefault(side, []).append(what)
    return [*others, *((np.array(some), side) for side, some in numbers.items())]


def _by_shape(facets: IntArray) -> list[IntArray]:
    """Triangles and quadrilaterals among facets of four corners, of which triangles repeat the last."""
    triangular = facets[:, 2] == facets[:, 3]
    return [facets[triangular, :3], facets[~triangular]]
