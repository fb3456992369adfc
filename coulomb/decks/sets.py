"""Sets and surfaces of a deck by name: of nodes and elements, perhaps those of other sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from ..arrays import FloatArray, IntArray
from .cards import Card, key_of


@dataclass
class NamedSet:
    """Numbers of nodes or elements, and the names of the sets that it contains.

    Attributes:
        name: As it is written where it is first given.
        members: Arrays of numbers and names of sets, in their order.
        hidden: Whether Abaqus/CAE has made it for itself ("internal").
    """

    name: str
    members: list[IntArray | str] = field(default_factory=list)
    hidden: bool = False


class Sets:
    """Sets by name, whose case does not matter.

    Attributes:
        of_parts: Whether the deck has parts, as Abaqus' have.
    """

    of_parts = False

    def __init__(self, kind: str, place: Callable[[str], str]):
        self.kind, self._place = kind, place
        self.all: dict[str, NamedSet] = {}

    def get(self, name: str, hidden: bool = False) -> NamedSet:
        """The set of this name, which is made if there is none."""
        return self.all.setdefault(key_of(name), NamedSet(name, hidden=hidden))

    def __contains__(self, name: str) -> bool:
        return key_of(name) in self.all

    @property
    def names(self) -> list[str]:
        """Those that the user has given."""
        return [one.name for one in self.all.values() if not one.hidden]

    def listed(self, name: str, within: tuple[str, ...] = ()) -> IntArray:
        """The numbers of a set and of those it contains, in their order, those that are given twice twice."""
        key = key_of(name)
        if key not in self.all or key in within:
            fault = "contains itself" if key in within else "is not defined"
            raise ValueError(f"{self._place(name)}: the {self.kind} set {name!r} {fault}")
        parts = [
            self.listed(one, (*within, key)) if isinstance(one, str) else one
            for one in self.all[key].members
            if not isinstance(one, str) or one in self or not within  # an unknown set inside a set is empty in CalculiX
        ]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)

    def members(self, name: str) -> IntArray:
        """The numbers of a set, ascending, each once."""
        return np.unique(self.listed(name))

    def once(self, numbers: IntArray, card: Card, row: int) -> IntArray:
        """What a line of a card loads, each once; ValueError where a number is there twice, but of parts."""
        unique, counts = np.unique(numbers, return_counts=True)
        if np.any(counts > 1) and not self.of_parts:
            twice = f"{card.words(row)[0]!r} has {unique[np.argmax(counts > 1)]} twice"
            raise card.fault(f"{twice}: CalculiX loads it twice, Abaqus once; give it once", row)
        return unique


@dataclass
class Surface:
    """A surface: of every line an element, or a set of elements, and the side, "" for the free ones; or of nodes.

    Attributes:
        lines: Elements as their number or the name of a set, and the side in upper case.
        nodes: Whether it is one of nodes, the node set of the same name.
    """

    name: str
    lines: list[tuple[int | str, str]] = field(default_factory=list)
    nodes: bool = False


@dataclass
class Profile(Surface):
    """An analytical surface, given by a profile: lines once it is divided into elements (`rigid_surfaces`).

    Attributes:
        card: Its *SURFACE.
        place: Where points of its part, shape (k, 3), are.
        back: Where points are in its part.
    """

    card: Card = field(kw_only=True)
    place: Callable[[FloatArray], FloatArray] = field(kw_only=True)
    back: Callable[[FloatArray], FloatArray] = field(kw_only=True)


_Named = TypeVar("_Named", NamedSet, Surface)


def unqualified(known: dict[str, _Named], instances: Iterable[str]) -> None:
    """Let what one instance alone has be called without its name, too."""
    owners: dict[str, list[str]] = {}
    for key in known:
        for instance in instances:
            if key.startswith(f"{instance}."):
                owners.setdefault(key[len(instance) + 1 :], []).append(key)
    for key, qualified in owners.items():
        if len(qualified) == 1 and key not in known:
            one = known.pop(qualified[0])
            one.name = one.name[len(one.name) - len(key) :]
            known[key] = known[qualified[0]] = one
