"""Rigid surfaces without a volume as thin solids: elements R3D3 and R3D4 (R2D2 and RAX2 in 2D) that a *RIGID BODY
names, and analytical surfaces, whose profiles are divided into such elements first.

Each element becomes a solid one of the same number, on the side of it that is not in contact.  All nodes of these
follow the reference node, as those of a solid body that is rigid as a whole (`rigid_bodies`): what they are made of
does not matter.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray, unit_vectors
from .cards import Card, key_of
from .geometry import Geometry
from .sets import Profile

RIGID: Final = re.compile(r"(?:R3D([34])|(?:R2D|RAX)(2))(?!\d)")
"""Types of the elements, with their number of corners."""

_SECTIONS: Final = ("CPE", "CPS", "CAX")

_THICK: Final = 0.25
"""Thickness of the solids over the shortest edge at each node, with which those on curved surfaces do not turn over."""

_ARC: Final = {"SEGMENTS": 1.0, "CYLINDER": 1.0, "REVOLUTION": 3.0}
"""Angle in degrees of the pieces of arcs of a profile by the type of its surface; of 1 degree the middles are 4e-5 of
the radius off, of 3 degrees 3e-4."""

_AROUND: Final = 120
"""Pieces around the axis of a REVOLUTION."""

_SAME: Final = 1e-3
"""Part of a radius up to which both ends of an arc have it."""


def add_layers(deck: Geometry) -> None:
    """Let a deck have solids in place of the rigid surfaces without a volume that its *RIGID BODY cards name.

    Raises:
        ValueError: If an analytical surface is not whole, or belongs to no rigid body.
    """
    for card in deck.others:
        if card.kind == "RIGIDBODY" and (name := element_set_of(deck, card)):
            surface = deck.surfaces.get(key_of(name))
            if isinstance(surface, Profile) and card.get("ANALYTICALSURFACE") and not surface.lines:
                _divide(deck, surface)
            if name in deck.element_sets:
                _thicken(deck, name)
    for surface in deck.surfaces.values():
        if isinstance(surface, Profile) and not surface.lines:
            raise surface.card.fault("is analytical: it needs a *RIGID BODY, ANALYTICAL SURFACE, with its REF NODE")


def element_set_of(deck: Geometry, card: Card) -> str:
    """The name of the set of elements of a *RIGID BODY, of an analytical surface that of its own; "" if it has none.

    Raises:
        ValueError: With the line, if there is no analytical surface of the name.
    """
    given, analytical = card.get("ELSET"), card.get("ANALYTICALSURFACE")
    owned = f"{deck.owner.get(id(card))}.{analytical or given}"
    if not analytical:
        return owned if owned in deck.element_sets else given
    surface = deck.surfaces.get(key_of(owned)) or deck.surfaces.get(key_of(analytical))
    if not isinstance(surface, Profile):
        known = [one.name for one in deck.surfaces.values() if isinstance(one, Profile)]
        raise card.lacks("analytical *SURFACE", analytical, known)
    return surface.name


def _thicken(deck: Geometry, name: str) -> None:
    """Make solids of the rigid elements of a set, of which none has a node of a solid."""
    members = deck.element_sets.members(name)
    every = {kind: np.vstack(rows) for kind, rows in deck.elements.items() if RIGID.match(kind)}
    mine = {kind: rows[np.isin(rows[:, 0], members)] for kind, rows in every.items()}
    mine = {kind: rows for kind, rows in mine.items() if len(rows)}
    cells = [rows[:, 1:] for rows in mine.values()]
    of_solids = [rows[:, 1:].ravel() for rows in deck.solids.values()]
    nodes = np.unique(np.concatenate([cell.ravel() for cell in cells])) if cells else np.empty(0, dtype=np.int64)
    if not len(nodes) or np.any(np.isin(nodes, np.concatenate([*of_solids, nodes[:0]]))):
        return
    lines = [
        (surface, k)
        for surface in {id(one): one for one in deck.surfaces.values()}.values()
        for k, (what, side) in enumerate(surface.lines)
        if side in ("", "SPOS", "SNEG") and np.all(np.isin(deck.elements_of(what), members))
    ]
    below = {surface.lines[k][1] for surface, k in lines} != {"SNEG"}
    x = deck.points[deck.places(nodes)]
    shift = _along_normals(x, [np.searchsorted(nodes, cell) for cell in cells])
    if deck.section == "axisymmetric":
        shift[x[:, 0] == 0.0, 0] = 0.0
    beside = deck.add_nodes(x - shift if below else x + shift)
    for kind, rows in mine.items():
        del deck.elements[kind]
        if len(rows) < len(every[kind]):
            deck.elements[kind] = [every[kind][~np.isin(every[kind][:, 0], members)]]
        given, other = rows[:, 1:], beside[np.searchsorted(nodes, rows[:, 1:])]
        first, last = (other, given) if below else (given, other)
        in_2d = rows.shape[1] == 3
        section = next((one[:3] for one in deck.elements if one[:3] in _SECTIONS), _SECTIONS[0])
        solid = f"{section}4" if in_2d else {4: "C3D6", 5: "C3D8"}[rows.shape[1]]
        cell = np.column_stack([rows[:, 0], first, last[:, ::-1] if in_2d else last])
        deck.elements.setdefault(solid, []).append(cell)
    top = "S3" if cells[0].shape[1] == 2 else "S2"
    for surface, k in lines:
        what, side = surface.lines[k]
        surface.lines[k] = (what, top if (side or ("SPOS" if below else "SNEG")) == "SPOS" else "S1")
    deck.rigid[name] = np.concatenate([rows[:, 0] for rows in mine.values()])
    deck.forget()


def _along_normals(x: FloatArray, cells: list[IntArray]) -> FloatArray:
    """Thicknesses at nodes x (k, 3) along the mean normals of their elements, arrays (f, corners) of places in x, to
    the side from which their corners go round anticlockwise, or that is to the left of lines in 2D."""
    normal, edge = np.zeros_like(x), np.full(len(x), np.inf)
    for cell in cells:
        p = x[cell]
        ahead, behind = p[:, 1] - p[:, 0], p[:, -1] - p[:, 0]
        if cell.shape[1] == 4:
            ahead, behind = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
        n = unit_vectors(np.cross((0.0, 0.0, 1.0), ahead) if cell.shape[1] == 2 else np.cross(ahead, behind))
        length = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2)
        for k in range(cell.shape[1]):
            np.add.at(normal, cell[:, k], n)
            np.minimum.at(edge, cell[:, k], np.minimum(length[:, k], np.roll(length, -1, axis=1)[:, k]))
    return unit_vectors(normal) * (_THICK * edge)[:, None]


def _divide(deck: Geometry, surface: Profile) -> None:
    """Give an analytical surface elements, whose outer side is to the left of its profile."""
    card, kind = surface.card, surface.card.key("TYPE")
    start = next((row for row in range(len(card.lines)) if key_of(card.words(row)[0]) == "START"), None)
    if start is None:
        raise card.fault("needs a line START, x, y")
    if "FILLETRADIUS" in card.parameters:
        raise card.fault("FILLET RADIUS is not read: give the fillets as arcs (CIRCL)")
    p = _profile(card, start)
    k = np.arange(len(p))
    if kind == "SEGMENTS":
        x, cells = np.column_stack([p, 0.0 * k]), [np.column_stack([k[:-1], k[1:]])]
    else:
        given = card.floats(range(start)) if start else np.empty(0)
        if len(given) not in (0, 9 if kind == "CYLINDER" else 6):
            raise card.fault("needs the points a, b and c, nine numbers" if kind == "CYLINDER" else "needs a and b", 0)
        made = _swept if kind == "CYLINDER" else _revolved
        inside = deck.points[deck.places(np.unique(np.concatenate([of[:, 1:].ravel() for of in deck.solids.values()])))]
        x, cells = made(p, given, surface.back(inside))
    nodes = deck.add_nodes(surface.place(x))
    number = 1 + max(int(rows[:, 0].max(initial=0)) for blocks in deck.elements.values() for rows in blocks)
    for cell in cells:
        name = "R2D2" if kind == "SEGMENTS" else f"R3D{cell.shape[1]}"
        numbers = number + np.arange(len(cell))
        number += len(cell)
        deck.elements.setdefault(name, []).append(np.column_stack([numbers, nodes[cell]]))
        deck.element_sets.get(surface.name).members.append(numbers)
    surface.lines.append((surface.name, "SPOS"))


def _profile(card: Card, start: int) -> FloatArray:
    """The corners of the profile of an analytical surface, shape (k, 2), arcs in pieces."""
    points: list[FloatArray] = []
    for row in range(start, len(card.lines)):
        kind, *words = card.words(row)
        count = {"START": 2, "LINE": 2, "CIRCL": 4}.get(key_of(kind))
        if count is None or (key_of(kind) == "START") != (row == start):
            raise card.fault(f"after START, LINE and CIRCL are read in profiles, but not {kind}", row)
        values = np.array([card.number(word, row) for word in words if word])
        if len(values) != count:
            raise card.fault(f"{kind} needs {count} numbers, not {len(values)}", row)
        if count == 4:
            end, centre = np.split(values, 2)
            a, b = points[-1] - centre, end - centre
            if abs(np.linalg.norm(a) - np.linalg.norm(b)) > _SAME * np.linalg.norm(a):
                raise card.fault("the ends of the arc are not equally far from its centre", row)
            angle = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
            pieces = max(1, int(np.ceil(np.degrees(abs(angle)) / _ARC[card.key("TYPE")])))
            for part in angle * np.arange(1, pieces) / pieces:
                points.append(centre + a * np.cos(part) + np.array([-a[1], a[0]]) * np.sin(part))
        points.append(values[:2])
    if len(points) < 2:
        raise card.fault("a profile needs a LINE or a CIRCL after START")
    return np.array(points)


def _swept(p: FloatArray, given: FloatArray, inside: FloatArray) -> tuple[FloatArray, list[IntArray]]:
    """Nodes and elements of a profile (k, 2) along the generator, beyond all that is inside (m, 3) by its extent; given
    are the origin and points on the x axis and on the generator, else axes are those of the part."""
    a, b, c = given.reshape(3, 3) if len(given) else np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1.0]])
    along, generator = unit_vectors(b - a), unit_vectors(c - a)
    up = unit_vectors(np.cross(along, generator))
    reach = (inside - a) @ generator
    extent = float(np.linalg.norm(np.ptp(inside, axis=0)))
    ends = np.array([reach.min() - extent, reach.max() + extent])
    on_plane = a + p[:, :1] * along + p[:, 1:] * up
    k, n = np.arange(len(p) - 1), len(p)
    x: FloatArray = np.vstack([on_plane + ends[0] * generator, on_plane + ends[1] * generator])
    return x, [np.column_stack([k, k + 1, n + k + 1, n + k])]


def _revolved(p: FloatArray, given: FloatArray, inside: FloatArray) -> tuple[FloatArray, list[IntArray]]:
    """Nodes and elements of a profile (k, 2) of radius and height around its axis, by two points of it, else the y axis
    of the part; triangles where it meets the axis."""
    a, b = given.reshape(2, 3) if len(given) else np.array([[0, 0, 0], [0, 1.0, 0]])
    axis = unit_vectors(b - a)
    one = unit_vectors(np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis))
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    out = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * np.cross(axis, one)
    x = a + p[:, None, :1] * out + p[:, None, 1:] * axis
    number = np.arange(x[..., 0].size).reshape(x.shape[:2])
    number[p[:, 0] == 0.0] = number[p[:, 0] == 0.0, :1]
    used, number = np.unique(number, return_inverse=True)
    number = number.reshape(x.shape[:2])
    beside = np.roll(number, -1, axis=1)
    cells = np.stack([number[:-1], number[1:], beside[1:], beside[:-1]], axis=-1).reshape(-1, 4)
    starts, ends = cells[:, 0] == cells[:, 3], cells[:, 1] == cells[:, 2]
    triangles = np.vstack([cells[starts & ~ends, :3], cells[ends & ~starts][:, [0, 1, 3]]])
    parts = [triangles, cells[~starts & ~ends]]
    return x.reshape(-1, 3)[used], [part for part in parts if len(part)]
