"""Materials of a deck as tables of a case file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..arrays import FloatArray, as_list
from .cards import Card


def material_of(section: Card, cards: list[Card], ends: tuple[float, float] | None) -> dict[str, Any]:
    """The table of the material of a section, from the cards below *MATERIAL, with constants at the temperature of the
    end; `ends` are those of the start and the end.

    Raises:
        ValueError: If it has no elastic constants, or some that coulomb does not have.
    """
    table: dict[str, Any] = {}
    temperature = None if ends is None else ends[1]
    for card in cards:
        if card.kind == "ELASTIC":
            table |= _elastic(card, temperature)
        elif card.kind == "HYPERELASTIC":
            table |= _hyperelastic(card)
        elif card.kind == "DENSITY":
            table["density"] = float(card.floats([0])[0])
        elif card.kind == "EXPANSION":
            kind = card.key("TYPE") or "ISO"
            row = _expansion(card, 1 if kind.startswith("ISO") else 3, ends)
            if kind.startswith("ANISO"):
                raise card.fault("anisotropic expansion is not read")
            table["expansion"] = float(row[0]) if kind.startswith("ISO") else [float(one) for one in row[:3]]
        elif card.kind == "CONDUCTIVITY":
            if card.key("TYPE") not in ("", "ISO"):
                raise card.fault("only isotropic conductivity is read")
            table["conductivity"] = float(_at(card, 1, temperature)[0])
    if isinstance(table.get("expansion"), list) and isinstance(table.get("young"), float):  # the same, by directions
        young, nu = table["young"], table["poisson"]
        table |= {"young": [young] * 3, "poisson": [nu] * 3, "shear": [young / (2.0 * (1.0 + nu))] * 3}
    if not {"young", "c1", "mu"} & table.keys():
        raise section.fault(f"its material {section.get('MATERIAL')!r} has no *ELASTIC and no *HYPERELASTIC card")
    return table


def has_several(card: Card) -> bool:
    """Whether a card has constants at several temperatures."""
    by_temperature = card.kind in ("ELASTIC", "EXPANSION", "CONDUCTIVITY")
    isotropic = card.kind != "ELASTIC" or (card.key("TYPE") or "ISO").startswith("ISO")
    return by_temperature and len(card.lines) > (1 if isotropic else 2)


def _at(card: Card, count: int, temperature: float | None) -> FloatArray:
    """So many constants at a temperature: linear between the lines, constant outside; without a temperature those of
    the first line."""
    if not card.lines:
        raise card.fault("has no constants")
    lines = -(-count // 8)  # eight numbers on a line
    each = [card.floats(range(k, min(k + lines, len(card.lines)))) for k in range(0, len(card.lines), lines)]
    short = next((k for k, values in enumerate(each) if len(values) < count), None)
    if short is not None:
        raise card.fault(f"needs {count} constants, and a temperature", short * lines)
    rows = np.array([np.append(values, 0.0)[: count + 1] for values in each])
    if temperature is None or len(rows) == 1:
        return np.asarray(rows[0, :count])
    return np.array([np.interp(temperature, rows[:, count], rows[:, k]) for k in range(count)])


def _expansion(card: Card, count: int, ends: tuple[float, float] | None) -> FloatArray:
    """The strain from the start to the end over the change of temperature: coefficients alpha are secants from that of
    ZERO, alpha(T) (T - zero) - alpha(T0) (T0 - zero)."""
    if ends is None or ends[0] == ends[1]:
        return _at(card, count, None if ends is None else ends[1])
    start, end = (_at(card, count, at) * (at - card.setting("ZERO")) for at in ends)
    return (end - start) / (ends[1] - ends[0])


def _elastic(card: Card, temperature: float | None) -> dict[str, Any]:
    kind = card.key("TYPE") or "ISO"
    if kind.startswith("ISO"):
        young, poisson = _at(card, 2, temperature)
        return {"young": float(young), "poisson": float(poisson)}
    if kind.startswith("ORTHO"):
        d11, d12, d22, d13, d23, d33, g12, g13, g23 = _at(card, 9, temperature)
        compliance = np.linalg.inv(np.array([[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]]))
        young = 1.0 / np.diag(compliance)
        ratios = [-compliance[0, 1] * young[0], -compliance[0, 2] * young[0], -compliance[1, 2] * young[1]]
        return {"young": young.tolist(), "poisson": [float(nu) for nu in ratios], "shear": [g12, g13, g23]}
    if kind.startswith("ENGINEERING"):
        given = [float(one) for one in _at(card, 9, temperature)]
        return {"young": given[:3], "poisson": given[3:6], "shear": given[6:]}
    raise card.fault(f"TYPE={card.get('TYPE')} is not read: ISO, ORTHO and ENGINEERING CONSTANTS are")


def _hyperelastic(card: Card) -> dict[str, Any]:
    given = [float(one) for one in card.floats()]
    flags = {name.replace("-", "").replace("_", "") for name in card.parameters}
    order = int(card.setting("N", 1.0))
    if len(given) < (2 * order if "OGDEN" in flags else 1 + ("MOONEYRIVLIN" in flags)):
        raise card.fault(f"has {len(given)} constants, which are too few")
    if flags & {"NEOHOOKE"}:
        c10, d1 = (*given, 0.0)[:2]
        return {"law": "mooney-rivlin", "c1": c10, "c2": 0.0, "bulk": _bulk(d1, 2.0 * c10)}
    if flags & {"MOONEYRIVLIN"} or ("POLYNOMIAL" in flags and order == 1):
        c10, c01, d1 = (*given, 0.0)[:3]
        return {"law": "mooney-rivlin", "c1": c10, "c2": c01, "bulk": _bulk(d1, 2.0 * (c10 + c01))}
    if "REDUCEDPOLYNOMIAL" in flags and order == 1:
        c10, d1 = (*given, 0.0)[:2]
        return {"law": "mooney-rivlin", "c1": c10, "c2": 0.0, "bulk": _bulk(d1, 2.0 * c10)}
    if "OGDEN" in flags:
        moduli, exponents = given[0 : 2 * order : 2], given[1 : 2 * order : 2]
        d1 = given[2 * order] if len(given) > 2 * order else 0.0
        # 2 mu / alpha^2 (sum of stretches^alpha - 3) here, mu / alpha there
        own = [2.0 * mu / alpha for mu, alpha in zip(moduli, exponents, strict=True)]
        return {"law": "ogden", "mu": own, "alpha": exponents, "bulk": _bulk(d1, sum(moduli))}
    raise card.fault("of *HYPERELASTIC, NEO HOOKE, MOONEY-RIVLIN and OGDEN are read")


def moduli_of(cards: Iterable[Card]) -> list[float]:
    """The first constant of every *ELASTIC; of every *HYPERELASTIC three times the shear modulus of small strains."""
    moduli = [_modulus(card) for card in cards if card.kind in ("ELASTIC", "HYPERELASTIC") and card.lines]
    return [one for one in moduli if one > 0.0]


def _modulus(card: Card) -> float:
    if card.kind == "ELASTIC":
        return float(card.floats([0])[0])
    law = _hyperelastic(card)
    if law["law"] == "ogden":
        return float(1.5 * np.dot(law["mu"], law["alpha"]))
    return float(6.0 * (law["c1"] + law["c2"]))


def _bulk(d1: float, shear: float) -> float:
    """2 / D1; where it is 0 that of CalculiX, at which Poisson's ratio is 0.475."""
    return 2.0 / d1 if d1 > 0.0 else shear * 2.0 * 1.475 / (3.0 * (1.0 - 2.0 * 0.475))


def directions_of(card: Card) -> list[list[float | str]]:
    """The first two axes of an *ORIENTATION, as vectors or as expressions of place; turned by an angle in degrees about
    one of them, where a second line says so."""
    a, b = np.split(card.vector(0, 6), 2)
    turn = card.floats([1])[:2] if len(card.lines) > 1 else np.empty(0)
    about, angle = (int(turn[0]) - 1, float(np.radians(turn[1]))) if len(turn) == 2 else (2, 0.0)
    if about not in (0, 1, 2):
        raise card.fault("axes are turned about the axis 1, 2 or 3", 1)
    system = card.key("SYSTEM") or "RECTANGULAR"
    if system.startswith("R"):
        third = np.cross(a, b)
        own = np.array([a, np.cross(third, a), third])
        own /= np.linalg.norm(own, axis=1, keepdims=True)
        first, second = (about + 1) % 3, (about + 2) % 3
        turned = own.copy()
        turned[first] = np.cos(angle) * own[first] + np.sin(angle) * own[second]
        turned[second] = np.cos(angle) * own[second] - np.sin(angle) * own[first]
        return [as_list(a), as_list(b)] if not angle else [as_list(turned[0]), as_list(turned[1])]
    if not system.startswith("C"):
        raise card.fault(f"SYSTEM={card.get('SYSTEM')} is not read, RECTANGULAR and CYLINDRICAL are")
    if angle and about != 2:
        raise card.fault("axes of a cylinder are turned about the third alone", 1)
    x, y = radial_direction(a, b), tangential_direction(a, b)
    if not angle:
        return [list(x), list(y)]
    c, s = float(np.cos(angle)), float(np.sin(angle))
    along = [[f"({float(p)!r})*({x[k]})+({float(q)!r})*({y[k]})" for k in range(3)] for p, q in ((c, s), (-s, c))]
    return [list(along[0]), list(along[1])]


def radial_direction(a: FloatArray, b: FloatArray) -> list[str]:
    """The vector from the axis through a and b to the place, as expressions."""
    axis = (b - a) / np.linalg.norm(b - a)
    along = "+".join(f"({float(axis[k])!r})*({name}-({float(a[k])!r}))" for k, name in enumerate("xyz"))
    return [f"{name}-({float(a[k])!r})-({float(axis[k])!r})*({along})" for k, name in enumerate("xyz")]


def tangential_direction(a: FloatArray, b: FloatArray) -> list[str]:
    """The vector along the circle around that axis, axis x radial, as long as this, as expressions."""
    x, axis = radial_direction(a, b), (b - a) / np.linalg.norm(b - a)
    return [
        f"({float(axis[(k + 1) % 3])!r})*({x[(k + 2) % 3]})-({float(axis[(k + 2) % 3])!r})*({x[(k + 1) % 3]})"
        for k in range(3)
    ]


def axes_at(frame: Card, x: FloatArray) -> FloatArray:
    """The unit directions of the frame of a *TRANSFORM at a place, rows of (3, 3); of a cylinder's the radial,
    tangential and axial one, those across it 0 on its axis."""
    a, b = np.split(frame.vector(0, 6), 2)
    if frame.key("TYPE") == "C":
        axis = (b - a) / np.linalg.norm(b - a)
        radial = x - a - axis * ((x - a) @ axis)
        rows = np.array([radial, np.cross(axis, radial), axis])
    else:
        third = np.cross(a, b)
        rows = np.array([a, np.cross(third, a), third])
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(sizes > 0.0, sizes, 1.0)
