"""Contact pairs of a deck as tables of a case."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np

from .cards import Card, key_of, number_of
from .materials import moduli_of
from .node_surfaces import facets_with_nodes
from .reading import Reading
from .steps import Step, reference

_SOFT: Final = 1.0
"""Stiffness of an overclosure law below this, over Young's modulus by the size of an element, is meant as a layer."""

_NONE: Final = 1e-9
"""Below this, likewise, there is no contact: only heat crosses."""


_ROUGH: Final = 100.0
"""Friction in place of *FRICTION, ROUGH, under which faces do not slip while they touch."""

_NEAR: Final = 0.02
"""Distance of faces that general contact makes pairs, over the extent of the model."""


_PAIR: Final = "a slave and a master surface, or one in contact with itself"

_CHANGES: Final = {"CHANGEFRICTION": "FRICTION", "CHANGESURFACEBEHAVIOR": "SURFACEBEHAVIOR"}
"""Cards of steps that name an interaction, by the card below that gives what it has from then on."""


class _Interaction:
    """A *SURFACE INTERACTION: its law and its friction, and what steps make of them."""

    def __init__(self) -> None:
        self.friction: Card | None = None
        self.behavior: Card | None = None
        self.conductance: Card | None = None


def contact_tables(of: Reading) -> list[dict[str, Any]]:
    """A table for each contact pair that is not always tied (`tied_pairs`)."""
    return [table for table, _ in _pairs(of) if table is not None]


def general_contact(of: Reading) -> dict[str, Any]:
    """Abaqus' general contact of all faces as the table [auto_contact], in which pairs are found; empty if there is
    none, or surfaces are named."""
    if not any(card.kind == "CONTACT" for card in of.model) or _included(of):
        return {}
    interactions, assigned = _interactions(of), _assigned(of)
    for pair, (card, row, _) in assigned.items():
        if any(pair):
            raise card.fault("a property of some surfaces is read where *CONTACT INCLUSIONS names them", row)
    of_all = assigned.get(("", ""))
    if of_all is not None and of_all[2] not in interactions:
        raise of_all[0].lacks("*SURFACE INTERACTION", of_all[2], interactions, of_all[1])
    interaction = _Interaction() if of_all is None else interactions[of_all[2]]
    if _law(of, interaction.behavior) != "hard" or interaction.conductance is not None or _limit(interaction.friction):
        given = interaction.behavior or interaction.conductance or interaction.friction
        assert given is not None
        raise given.fault("general contact of all faces is read with hard contact and a coefficient of friction alone")
    for card in (card for step in of.steps for card in step.cards if card.kind in _CHANGES):
        raise card.fault("general contact of all faces keeps its property")
    distance = _NEAR * _extent(of)
    of.notes.append(f"general contact: faces within {distance:.3g} of each other become pairs ([auto_contact])")
    return {"distance": distance, "friction": _coefficient(interaction.friction)} | (
        {} if of.large else {"adjust": [0.0, _edge(of)]}
    )


def _included(of: Reading) -> list[tuple[Card, int, list[str], str]]:
    """The pairs of surfaces of Abaqus' general contact: card and line, the two, and the interaction."""
    cards, assigned = [], _assigned(of)
    for card in of.model:
        if card.kind == "CONTACTINCLUSIONS" and "ALLEXTERIOR" not in card.parameters:
            for row in range(len(card.lines)):
                words = _both(card.words(row))
                if not all(words):
                    raise card.fault("needs two surfaces, or one in contact with itself", row)
                keys = key_of(words[0]), key_of(words[1])
                alone = [(keys[0], "")] if keys[0] == keys[1] else []
                own = next((assigned[pair] for pair in (keys, keys[::-1], *alone, ("", "")) if pair in assigned), None)
                cards.append((card, row, words, "" if own is None else own[2]))
    return cards


def _both(words: Sequence[str]) -> list[str]:
    """The two surfaces of a pair: one alone is in contact with itself."""
    return [words[0], words[1] if len(words) > 1 and words[1] else words[0]] if words else [""]


def itself(model: Sequence[Card]) -> bool:
    """Whether a surface is in contact with itself."""
    cards = [card for card in model if card.kind in ("CONTACTPAIR", "CONTACTINCLUSIONS")]
    pairs = [_both(card.words(row)) for card in cards for row in range(len(card.lines))]
    return any(key_of(one) == key_of(other) for one, other in pairs)


def _assigned(of: Reading) -> dict[tuple[str, str], tuple[Card, int, str]]:
    """The interaction of pairs of surfaces of general contact, by their names, of all others by empty ones."""
    return {
        (key_of(words[0]), key_of(words[1])): (card, row, key_of(words[2]))
        for card in of.model
        if card.kind == "CONTACTPROPERTYASSIGNMENT"
        for row, words in ((row, [*card.words(row), "", ""]) for row in range(len(card.lines)))
    }


def _given_pairs(of: Reading) -> Iterator[tuple[Card, int, list[str], str]]:
    """Card and line of every pair, its surfaces, and its interaction."""
    for card in of.model:
        if card.kind == "CONTACTPAIR":
            for row, words in card.rows(_PAIR):
                yield card, row, _both(words), card.key("INTERACTION")
    yield from _included(of)


def tied_pairs(of: Reading) -> list[dict[str, Any]]:
    """A table of a tie for each time in which a contact pair is TIED."""
    return [tie for _, ties in _pairs(of) for tie in ties]


_Pair = tuple[dict[str, Any] | None, list[dict[str, Any]]]


def _pairs(of: Reading) -> list[_Pair]:
    """The table of each contact pair, None if it is never in contact, and those of its ties; read once."""
    if of.pairs is None:
        of.pairs = _read_pairs(of)
    return of.pairs


def _read_pairs(of: Reading) -> list[_Pair]:
    interactions = _interactions(of)
    _refuse_strangers(of, interactions)
    clearances = dict(_clearance(card) for card in of.model if card.kind == "CLEARANCE")
    read: list[_Pair] = []
    for card, row, words, called in _given_pairs(of):
        if called not in interactions and (called or card.kind == "CONTACTPAIR"):
            raise card.lacks("*SURFACE INTERACTION", card.get("INTERACTION", called), interactions)
        interaction = interactions.get(called, _Interaction())
        slave, master = (_surface(of, word, card, row) for word in words[:2])
        names = key_of(words[0]), key_of(words[1])
        clearance = clearances.pop(names, None)
        changed = ((card, _law(of, card)) for _, card in _changes(of, "SURFACEBEHAVIOR", called))
        course = _course(of, names, [(None, _law(of, interaction.behavior)), *changed])
        kinds = {kind for _, kind in course}
        if names[0] == names[1]:
            if "tied" in kinds or clearance is not None:
                raise card.fault("a surface in contact with itself is neither TIED nor has a *CLEARANCE", row)
            of.notes.append(
                f"line {card.line}: {words[0]} in contact with itself: its parts that are before each other are a pair"
            )
        thermal = _conductance(interaction.conductance) if of.heated else {}
        if kinds == {"none"} and thermal:
            raise card.fault("heat through a pair without contact stiffness is not read", row)
        if kinds == {"none"}:
            of.notes.append(f"{words[0]} and {words[1]}: taken out, or of next to no contact stiffness: no contact")
            continue
        if "tied" in kinds and clearance is not None and clearance[1]:
            raise clearance[0].fault("a pair that is TIED has no clearance")
        faces: dict[str, Any] = {"face": of.face(slave, card, row), "against": of.face(master, card, row)}
        if any(np.any(of.deck.are_rigid(of.deck.elements_of(what))) for what, _ in of.deck.surfaces[names[1]].lines):
            faces["slave"] = True
        ties = [faces | {"slave": True} | one for one in _times_of_ties(of, course, card)]
        if ties and "adjust" not in _adjusted(of, card, None if clearance is None else clearance[1]):
            of.notes.append(f"line {card.line}: what is TIED keeps its gaps, which CalculiX pulls shut without ADJUST")
        table = faces | ({"slave": True} if ties else {}) | _friction(of, interaction, called) | thermal
        table |= _adjusted(of, card, None if clearance is None else clearance[1])
        table |= _taken_out(of, course, table.get("gap", 0.0))
        read.append((None if kinds == {"tied"} else table, ties))
    for card, _ in clearances.values():
        raise card.fault("there is no *CONTACT PAIR of these surfaces")
    return read


def _course(
    of: Reading, names: tuple[str, str], laws: Sequence[tuple[Card | None, str]]
) -> list[tuple[Step | None, str]]:
    """What a pair is, "hard", "tied" or "none", at first and from steps on: by its laws and the cards that give them,
    and by *MODEL CHANGE."""
    kinds, law, out = {id(card): kind for card, kind in laws[1:]}, laws[0][1], False
    course: list[tuple[Step | None, str]] = [(None, law)]
    for step in of.steps:
        for card in step.cards:
            goes = _goes_out(card, names)
            law, out = kinds.get(id(card), law), out if goes is None else goes
        now = "none" if out else law
        if not step.begin:
            course = [(None, now)]
        elif now != course[-1][1]:
            course.append((step, now))
    return course


def _times_of_ties(of: Reading, course: Sequence[tuple[Step | None, str]], card: Card) -> Iterator[dict[str, float]]:
    """When a pair is tied.  What has been out is pulled together in the course of the step in which it is put in, as by
    CalculiX' springs, which count from the faces before deformation; what has been in contact is held as it is."""
    ends = [step.begin for step, _ in course[1:] if step is not None]
    for k, (step, kind) in enumerate(course):
        if kind != "tied":
            continue
        times = {"end": ends[k]} if k < len(ends) else {}
        if step is not None:
            times["begin"] = step.begin
            if course[k - 1][1] == "none":
                times["reaches"] = step.end
            else:
                held = f"line {card.line}: tied from {step.begin:g} s on as it is then"
                of.notes.append(f"{held}; where it is open, CalculiX pulls it shut")
        yield times


def _clearance(card: Card) -> tuple[tuple[str, str], tuple[Card, float]]:
    """The surfaces, the card and the gap of a *CLEARANCE."""
    if set(card.parameters) - {"SLAVE", "MASTER", "VALUE"}:
        raise card.fault("is read with SLAVE, MASTER and VALUE alone")
    return (key_of(card.needs("SLAVE")), key_of(card.needs("MASTER"))), (card, card.setting("VALUE"))


def _surface(of: Reading, name: str, card: Card, row: int) -> str:
    """A surface, or in its place a set of nodes or of elements."""
    if key_of(name) not in of.deck.surfaces and name not in of.deck.node_sets:
        raise card.lacks("*SURFACE", name, of.surface_names, row)
    facets = facets_with_nodes(of.deck, name)
    if facets is not None:
        count = len(of.deck.node_sets.members(name))
        said = "slave node makes" if count == 1 else "slave nodes make"
        of.notes.append(f"{name}: its {count} {said} no facets: the slave are the {len(facets)} with one of them")
    return name


def _interactions(of: Reading) -> dict[str, _Interaction]:
    interactions: dict[str, _Interaction] = {}
    now: _Interaction | None = None
    for card in of.model:
        if card.kind == "SURFACEINTERACTION":
            now = interactions.setdefault(card.key("NAME"), _Interaction())
        elif card.kind == "SURFACEBEHAVIOR" and now is not None:
            now.behavior = card
        elif card.kind == "FRICTION" and now is not None:
            now.friction = card
        elif card.kind == "GAPCONDUCTANCE" and now is not None:
            now.conductance = card
    return interactions


def _changes(of: Reading, kind: str, interaction: str) -> Iterator[tuple[Step, Card]]:
    """The cards of a kind, and their steps, that stand below its *CHANGE card for an interaction."""
    for step in of.steps:
        changing = False
        for card in step.cards:
            if card.kind == f"CHANGE{kind}":
                changing = card.key("INTERACTION") == interaction
            elif card.kind == kind and changing:
                yield step, card


def _refuse_strangers(of: Reading, interactions: Collection[str]) -> None:
    """ValueError, with the line, if a card of a step changes an interaction or a pair that the deck does not have."""
    pairs = {(key_of(words[0]), key_of(words[1])) for _, _, words, _ in _given_pairs(of)}
    for step in of.steps:
        changing = ""
        for card in step.cards:
            if card.kind in _CHANGES:
                changing = _CHANGES[card.kind]
                if card.key("INTERACTION") not in interactions:
                    raise card.lacks("*SURFACE INTERACTION", card.needs("INTERACTION"), interactions)
                if set(card.parameters) != {"INTERACTION"}:
                    raise card.fault("is read with INTERACTION alone")
            elif card.kind in _CHANGES.values() and card.kind != changing:
                raise card.fault("stands in a step, but below no *CHANGE card that says of which interaction")
            elif card.kind == "CONTACTINTERFERENCE":
                if set(card.parameters) != {"SHRINK"} or step is not of.steps[0]:
                    raise card.fault("is read with SHRINK alone, in the first step, at whose end it has gone")
                of.notes.append("*CONTACT INTERFERENCE: faces that overlap press each other apart in the first step")
            elif card.kind == "MODELCHANGE" and card.key("TYPE").startswith("CONTACTPAIR"):
                for row, words in card.rows(_PAIR):
                    one, other = map(key_of, _both(words))
                    if (one, other) not in pairs:
                        turned = "; its slave and its master are the other way round" if (other, one) in pairs else ""
                        raise card.fault(f"there is no contact pair of {', '.join(words)}{turned}", row)


def _law(of: Reading, card: Card | None) -> str:
    """What a *SURFACE BEHAVIOR is here: "hard", "tied" or "none"."""
    kind = "HARD" if card is None else card.key("PRESSURE-OVERCLOSURE") or "HARD"
    if card is not None and "NOSEPARATION" in card.parameters:
        raise card.fault("faces that do not part once they touch (NO SEPARATION) are not read")
    if kind == "HARD" or card is None:
        return "hard"
    if kind == "TIED":
        return "tied"
    if not card.lines:
        raise card.fault(f"PRESSURE-OVERCLOSURE={kind} needs constants")
    if kind == "LINEAR":
        stiffness = float(card.floats([0])[0])
    elif kind == "EXPONENTIAL":
        c0, p0 = card.vector(0, 2)
        stiffness = p0 * np.log(100.0) / c0
    elif kind == "TABULAR":
        stiffness = _least_slope(card)
        if stiffness < _SOFT * min(moduli_of(of.model), default=float("inf")) / _edge(of):
            raise card.fault(f"a table whose least slope is {stiffness:.3g} is a layer, which is not read")
    else:
        raise card.fault(f"PRESSURE-OVERCLOSURE={card.get('PRESSURE-OVERCLOSURE')} is a layer, which is not read")
    bound = min(moduli_of(of.model), default=float("inf")) / _edge(of)
    if stiffness < _NONE * bound:
        return "none"
    if stiffness < _SOFT * bound:
        of.notes.append(
            f"line {card.line}: a contact stiffness of {stiffness:.3g} is below Young's modulus over an edge "
            f"({bound:.3g}): a penalty; here contact is hard"
        )
    return "hard"


def _least_slope(card: Card) -> float:
    """Of a table of pressures and overclosures, from touching on."""
    pressure, overclosure = np.array([card.vector(row, 2) for row in range(len(card.lines))]).T
    if len(pressure) < 2 or np.any(np.diff(overclosure) <= 0.0) or np.any(np.diff(pressure) < 0.0):
        raise card.fault("needs lines of pressure and overclosure, both ascending")
    if overclosure[0] < 0.0 or pressure[0] != 0.0:
        raise card.fault("a table that does not begin with no pressure at no overclosure is a layer, which is not read")
    return float(np.min(np.diff(pressure) / np.diff(overclosure)))


def _edge(of: Reading) -> float:
    """A typical edge of the elements."""
    edges = []
    for rows in of.deck.solids.values():
        x = of.deck.points[of.deck.places(rows[~of.deck.are_rigid(rows[:, 0])][:200, 1:3])]
        edges.append(np.linalg.norm(x[:, 1] - x[:, 0], axis=1))
    return float(np.median(np.concatenate(edges)))


def _friction(of: Reading, interaction: _Interaction, name: str) -> dict[str, Any]:
    """Coulomb's coefficient, and how it changes from step to step (*CHANGE FRICTION)."""
    limit = _limit(interaction.friction)
    _note_stick_slope(of, interaction.friction)
    rows: list[tuple[float, float]] = [(0.0, _coefficient(interaction.friction))]
    for step, card in _changes(of, "FRICTION", name):
        value = _coefficient(card)
        if _limit(card) != limit:
            raise card.fault("another TAUMAX than before is not read")
        rows = [*rows, (step.begin, rows[-1][1]), (step.soon, value)] if step.begin > 0.0 else [(0.0, value)]
    table = _in_time("friction", rows)
    return table | ({"friction_limit": limit} if limit is not None and table["friction"] > 0.0 else {})


def _note_stick_slope(of: Reading, card: Card | None) -> None:
    """Say where CalculiX lets surfaces slip that stick: by shear stress over stick slope, half of the first modulus
    where the slope is not given."""
    moduli = moduli_of(of.model)
    if not _coefficient(card) or card is None or not moduli or {"SLIPTOLERANCE", "ROUGH"} & card.parameters.keys():
        return
    words = card.words(0)
    given = len(words) > 1 and bool(words[1])
    slope = card.number(words[1], 0) if given else 0.5 * moduli[0]
    said = (
        f"line {card.line}: a stick slope of {slope:.3g}{'' if given else ', as where none is given'}: in CalculiX "
        "surfaces that stick slip by their shear stress over that; here they stick"
    )
    if slope < _SOFT * min(moduli) / _edge(of) and said not in of.notes:
        of.notes.append(said)


def _conductance(card: Card | None) -> dict[str, Any]:
    """Of a constant, or of two lines at no pressure and at another: linear in pressure."""
    if card is None:
        return {}
    if "USER" in card.parameters:
        raise card.fault("a conductance by a subroutine is not read")
    lines = [[*card.floats([row]), 0.0][:2] for row in range(len(card.lines))]
    if len(lines) == 1:
        return {"thermal": {"conductance": float(lines[0][0])}}
    if len(lines) != 2 or lines[0][1] != 0.0 or lines[1][1] <= 0.0 or lines[1][0] < lines[0][0]:
        raise card.fault("of conductances a constant, or one at no pressure and one at another, are read")
    rise = {"factor": float(lines[1][0] - lines[0][0]), "hardness": float(lines[1][1]), "exponent": 1.0}
    return {"thermal": {"conductance": float(lines[0][0])} | rise}


def _in_time(key: str, rows: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """The entries of a value that follows rows, of which the first of one time counts."""
    value, factors = reference(tuple(row for k, row in enumerate(rows) if k == 0 or row[0] > rows[k - 1][0]))
    return {key: value} | ({} if factors is None else {f"{key}_amplitude": factors})


def _coefficient(card: Card | None) -> float:
    for name in ("EXPONENTIALDECAY", "ANISOTROPIC", "USER", "DEPENDENCIES"):
        if card is not None and name in card.parameters:
            raise card.fault(f"friction of kind {name} is not read: give a coefficient")
    if card is not None and "ROUGH" in card.parameters:
        return _ROUGH
    if card is None or not card.lines:
        return 0.0
    if len(card.lines) > 1:
        raise card.fault("a coefficient that depends on slip rate, pressure or temperature is not read", 1)
    return float(card.floats([0])[0])


def _limit(card: Card | None) -> float | None:
    """Abaqus' TAUMAX."""
    return None if card is None or not card.get("TAUMAX") else card.setting("TAUMAX")


def _adjusted(of: Reading, card: Card, clearance: float | None) -> dict[str, Any]:
    """Gaps that are closed without strain (ADJUST), with all overlaps, or that are given (*CLEARANCE); in large motions
    those of the mesh stay.  Abaqus' general contact closes overlaps alone."""
    if of.large and (clearance is not None or card.get("ADJUST")):
        of.notes.append(f"line {card.line}: large motions measure gaps between the facets as they are: none is closed")
        return {"gap": clearance} if clearance else {}
    if clearance is not None:
        return {"adjust": _extent(of)} | ({"gap": clearance} if clearance else {})
    if card.kind == "CONTACTINCLUSIONS" and not of.large:
        return {"adjust": [0.0, _edge(of)]}
    given = card.get("ADJUST")
    if not given:
        return {}
    try:
        value = number_of(given)
    except ValueError:
        of.notes.append(f"ADJUST={given}: gaps of all nodes of the pair are closed without strain")
        return {"adjust": _extent(of)}
    return {"adjust": [value, _extent(of)]}


def _extent(of: Reading) -> float:
    return float(np.linalg.norm(np.ptp(of.deck.points, axis=0)))


def _taken_out(of: Reading, course: Sequence[tuple[Step | None, str]], clearance: float) -> dict[str, Any]:
    """Where a pair is out, its gap is the size of the model."""
    away = 2.0 * _extent(of)
    rows = [(0.0, away if course[0][1] == "none" else clearance)]
    for (_, before), (step, now) in pairwise(course):
        if step is None or "none" not in (before, now):
            continue
        if now == "none":
            rows += [(step.begin, rows[-1][1]), (step.soon, away)]
        else:  # an overlap comes in the course of the step
            rows += [(step.begin, away), (step.soon, max(clearance, 0.0)), (step.end, clearance)]
    return _in_time("gap", rows) if len({value for _, value in rows}) > 1 else {}


def _goes_out(card: Card, names: tuple[str, str]) -> bool | None:
    """Whether a *MODEL CHANGE takes a pair out, or puts it in; None if it does neither."""
    if card.kind != "MODELCHANGE" or not card.key("TYPE").startswith("CONTACTPAIR"):
        return None
    for _, words in card.rows(_PAIR):
        if tuple(map(key_of, _both(words))) == names:
            return "REMOVE" in card.parameters
    return None
