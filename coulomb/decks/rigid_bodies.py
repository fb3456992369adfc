"""The surfaces of bodies that a deck makes rigid as a whole: with all of their surface its inner nodes follow, too."""

from __future__ import annotations

import numpy as np

from .cards import Card, key_of
from .geometry import Geometry
from .rigid_surfaces import element_set_of
from .sets import Surface


def add_skins(deck: Geometry) -> None:
    """Let a deck have the surfaces of all its rigid bodies; errors as of `skin_of`."""
    for card in deck.others:
        if card.kind == "RIGIDBODY":
            skin_of(deck, card)


def skin_of(deck: Geometry, card: Card) -> Surface | None:
    """The surface of the bodies of a *RIGID BODY, which the deck has from then on as "SET skin"; None of an NSET of a
    face.

    Raises:
        ValueError: If its ELSET is not known, or elements outside of it share nodes with it.
    """
    given = element_set_of(deck, card)
    of_elements = bool(given)
    sets = deck.element_sets if of_elements else deck.node_sets
    nodal = next(filter(None, map(card.get, ("NSET", "TIENSET", "PINNSET"))), "")
    if of_elements and nodal:
        raise card.fault(f"nodes ({nodal!r}) beside elements or an analytical surface are not read")
    if of_elements and given not in sets:
        raise card.lacks("element set", given, sets.names)
    if not of_elements:
        owned = f"{deck.owner.get(id(card))}.{nodal}"
        given = owned if owned in sets else nodal
    if given not in sets:
        return None
    members, rows = sets.members(given), list(deck.solids.values())
    if not of_elements:
        nodes, members = members, np.concatenate([one[np.all(np.isin(one[:, 1:], members), axis=1), 0] for one in rows])
    mine = [one[np.isin(one[:, 0], members), 1:].ravel() for one in rows]
    inside = np.unique(np.concatenate(mine))
    around = [one[np.any(np.isin(one[:, 1:], inside), axis=1), 0] for one in rows]
    if not len(inside) or len(np.concatenate(around)) > len(members):
        if of_elements:
            raise card.fault(f"ELSET={given}: elements outside of it share nodes with it: give the NSET of its face")
        return None
    if not of_elements and not np.array_equal(np.intersect1d(nodes, deck.tags), inside):
        return None
    name = f"{sets.get(given).name} skin"
    if key_of(name) not in deck.surfaces:
        deck.element_sets.get(name, hidden=True).members.append(members)
        deck.surfaces[key_of(name)] = Surface(name, [(name, "")])
    return deck.surfaces[key_of(name)]
