"""The surfaces of bodies that a deck makes rigid as a whole: with all of their surface its inner nodes follow, too."""

from __future__ import annotations

import numpy as np

from .cards import Card, key_of
from .geometry import Geometry
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
    given = card.get("ELSET") or next(filter(None, map(card.get, ("NSET", "TIENSET", "PINNSET"))), "")
    sets = deck.element_sets if card.get("ELSET") else deck.node_sets
    owner = deck.owner.get(id(card))
    given = f"{owner}.{given}" if f"{owner}.{given}" in sets else given
    if card.get("ELSET") and given not in sets:
        raise card.lacks("element set", given, sets.names)
    if given not in sets:
        return None
    members, rows = sets.members(given), list(deck.solids.values())
    if not card.get("ELSET"):
        nodes, members = members, np.concatenate([one[np.all(np.isin(one[:, 1:], members), axis=1), 0] for one in rows])
    mine = [one[np.isin(one[:, 0], members), 1:].ravel() for one in rows]
    inside = np.unique(np.concatenate(mine))
    around = [one[np.any(np.isin(one[:, 1:], inside), axis=1), 0] for one in rows]
    if not len(inside) or len(np.concatenate(around)) > len(members):
        if card.get("ELSET"):
            raise card.fault(f"ELSET={given}: elements outside of it share nodes with it: give the NSET of its face")
        return None
    if not card.get("ELSET") and not np.array_equal(np.intersect1d(nodes, deck.tags), inside):
        return None
    name = f"{sets.get(given).name} skin"
    if key_of(name) not in deck.surfaces:
        deck.element_sets.get(name, hidden=True).members.append(members)
        deck.surfaces[key_of(name)] = Surface(name, [(name, "")])
    return deck.surfaces[key_of(name)]
