"""Echo of the input of a problem, before it is solved: resultants of loads, what supports hold, gaps.

A wrong sign or unit is seen there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, is_number
from ..fem.bodies import AppliedLoad, NodalForces, ThermalLoad, load_title
from ..fem.geometry import (
    Cylinder,
    Plane,
    RigidFoundation,
    Sphere,
    evaluate_amplitude,
    on_all_ranks,
    tangent_lengths,
)
from ..linalg.reductions import Reductions
from .contact import Contact
from .discrete_problem import DiscreteProblem
from .resultants import resultants

_NEGLIGIBLE: Final = 1e-12
"""Part of the sum of all nodal forces up to which a resultant is zero, or of the largest gap, which a gap is."""


@dataclass(frozen=True, eq=False)
class LoadResultant:
    """A load and its resultant at the time of its largest amplitude.

    Attributes:
        what: Kind, face, and size where forces do not show it.
        time: The time, the first of several.
        force: In newtons, shape (3,); rounding errors are 0.
        moment: About the origin in newton metres, shape (3,); rounding errors are 0.
    """

    what: str
    time: float
    force: FloatArray
    moment: FloatArray


def loads_of(problem: DiscreteProblem, times: Sequence[float]) -> list[LoadResultant]:
    """Every load with its resultant at that of the times at which its amplitude is largest; collective."""
    body, over = problem.elasticity, Reductions(problem.comm, problem.elasticity.copies)
    arm = float(np.linalg.norm(np.abs(over.ends(body.x)).max(axis=0)))

    def resultant_of(applied: AppliedLoad) -> LoadResultant:
        load = applied.load
        factors = on_all_ranks(
            lambda: [evaluate_amplitude(load.amplitude, time, load_title(load)) for time in times], "", problem.comm
        )
        largest = int(np.argmax(np.abs(factors)))
        forces = NodalForces(load.kind, load.face, factors[largest] * applied.nodal_force)
        (total,) = resultants([forces], body.x, over)
        small = _NEGLIGIBLE * total.nodal
        force = np.where(np.abs(total.force) <= small, 0.0, total.force)
        moment = np.where(np.abs(total.moment) <= small * arm, 0.0, total.moment)
        size = "temperature by conduction" if load.kind == ThermalLoad.kind and problem.body.heat else applied.size
        what = f"{load_title(load)}, {size}" if size else load_title(load)
        return LoadResultant(what, times[largest], force, moment)

    return [resultant_of(applied) for applied in body.loads]


_APART: Final = 1e-6
"""Distance of tied faces over the root of a node's area from which it is said."""


def ties_of(problem: DiscreteProblem) -> list[dict[str, Any]]:
    """Faces, why the nodes of the first follow, their number, area, when it acts, and how far the faces are apart of
    every tie; collective."""
    over = Reductions(problem.comm)
    return [
        {
            "kind": tie.kind,
            "face": tie.face,
            "against": tie.against,
            "why": tie.why,
            "nodes": int(over.sum(float(len(tie.nodes)))),
            "area": problem.elasticity.copies * over.sum(tie.area),
            **({"acts": tie.lasting} if tie.lasting else {}),
            **({"apart": tie.arm} if tie.arm > _APART * over.max(np.sqrt(tie.area)) else {}),
        }
        for tie in problem.elasticity.constraints.every
    ]


def contacts_of(problem: DiscreteProblem) -> list[dict[str, Any]]:
    """Face, nodes, law, foundation, gap at the problem's time, given gap without amplitude, and motion of every
    contact; collective."""
    over, surface, contacts = Reductions(problem.comm), problem.surface, []
    for part, (contact, foundation) in enumerate(zip(problem.contacts, problem.body.foundations, strict=True)):
        here = surface.part == part
        contacts.append(
            {
                "face": contact.face,
                "nodes": int(over.sum(here.astype(float))),
                **problem.law.at(here).numbers(surface.area[here], tangent_lengths(surface.frames[here]), over),
                "foundation": _foundation(contact, foundation),
                **({} if foundation is not None else {"shape": _shape(contact)}),
                "gap": _ends(surface.gap[here], over),
                "given_gap": _ends(surface.gap_field[here], over),
                "moves": _moves(contact),
            }
        )
    return contacts


def _ends(values: FloatArray, over: Reductions) -> dict[str, float]:
    """The smallest and the largest of values (m,); 0 for rounding errors of the other; collective."""
    ends = np.array([over.min(values), over.max(values)])
    low, high = np.where(np.abs(ends) < _NEGLIGIBLE * np.max(np.abs(ends)), 0.0, ends)
    return {"min": float(low), "max": float(high)}


def _foundation(contact: Contact, foundation: RigidFoundation | None) -> str:
    """Its kind and numbers; for a pair the other face."""
    if foundation is None:
        return f"the face {contact.against!r}"
    kind = type(foundation).__name__.lower()
    if contact.foundation is None:
        return "the plane of the face"
    if not dataclasses.is_dataclass(foundation):
        return kind
    given = {of.name.removesuffix("_vector"): getattr(foundation, of.name) for of in dataclasses.fields(foundation)}
    return ", ".join([kind, *(f"{name} {_shown(value)}" for name, value in given.items() if not callable(value))])


def _shape(contact: Contact) -> dict[str, Any]:
    """What the facets of a pair stand for, in the words of a case: surfaces that no case can name are "a function"."""
    tables: list[dict[str, Any] | str | None] = []
    for surface in (contact.surface, contact.against_surface):
        if isinstance(surface, Plane | Sphere | Cylinder):
            given = {field.name: getattr(surface, field.name) for field in dataclasses.fields(surface)}
            named = {name.removesuffix("_vector"): _plain(value) for name, value in given.items()}
            tables.append({"shape": type(surface).__name__.lower(), **named})
        else:
            tables.append(None if surface is None else "a function")
    return {"smooth": contact.smooth, "surface": tables[0], "against_surface": tables[1]}


def _plain(value: Any) -> Any:
    return value if isinstance(value, bool) else np.asarray(value, dtype=np.float64).tolist()


def _moves(contact: Contact) -> str:
    """Which motions it has, and whether under a force or moment."""
    changing = None if is_number(contact.gap_amplitude, -np.inf) else contact.gap_amplitude
    motions = {"translation": contact.motion, "rotation": contact.rotation, "gap amplitude": changing}
    names = [name for name, motion in motions.items() if motion is not None]
    return " and ".join([*names, *[str(contact.load)] * bool(contact.load)])


def _shown(value: Any) -> str:
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f"{value:g}"
    if isinstance(value, tuple | list | np.ndarray):
        return f"({', '.join(_shown(entry) for entry in value)})"
    return str(value)
