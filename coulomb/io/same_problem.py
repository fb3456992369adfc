"""Whether answers are of the same problem, so that their difference is that of their meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from types import FunctionType
from typing import Any, Final

import numpy as np

from ..fem.bodies import Deformable
from ..fem.contact import with_slaves
from ..linalg.reductions import Reductions
from ..model.discrete_problem import DiscreteProblem
from ..model.problem import ContactProblem
from ..model.solution import Solution

_NUMERICAL: Final = ("mesh", "linear_solver", "explicit", "small_strain", "probes")
"""Arguments of a problem that do not change what it asks."""

_SAME_NUMBER: Final = 1e-9
"""Relative difference of numbers that counts as none."""

_OF_MESHES: Final = 0.2
"""Difference of resultants over the sum of the loads, and of extents over that of a body, that coarse meshes of curved
bodies may leave."""


def refuse_another_problem(answer: Solution, others: Sequence[object]) -> None:
    """A ValueError on every rank if what is given is no answer, or one of another problem; collective.

    Compared are the arguments of the problems, those that the mesh changes excepted; functions by their code and the
    values that they hold, where these can be seen; then the bodies' extents and the resultants of loads.
    """
    for number, other in enumerate(others, 1):
        what = f"error: answer {number} of {len(others)}"
        if not isinstance(other, Solution):
            raise ValueError(f"{what} must be a Solution, as problem.on(other_mesh).solve(), but is {other!r}")
        differing = _difference(answer, other)
        if differing:
            raise ValueError(
                f"{what} is of another problem: {differing}; give answers of the same one on other meshes: "
                "solution.problem.on(other_mesh).solve()"
            )


def _difference(answer: Solution, other: Solution) -> str:
    """In what two problems differ, in words; empty if in nothing but the mesh; collective."""
    problem, its = answer.problem, other.problem
    if its.before is not None:
        return "it is that of a load step"
    if type(problem) is not type(its):
        return f"it is a {type(its).__name__}, not a {type(problem).__name__}"
    sides = [[(contact.face, contact.against) for contact in one.contacts] for one in (problem, its)]
    if sides[0] != sides[1] and [set(side) for side in sides[0]] == [set(side) for side in sides[1]]:
        here, there = next((a, b) for a, b in zip(*sides, strict=True) if a != b)
        return f"its contact points are on {there[0]!r}, not on {here[0]!r} (slave = True of the contact says on which)"
    return _unlike(_described(problem), _described(its)) or _by_size(answer, other)


def _described(problem: DiscreteProblem) -> dict[str, Any]:
    """The arguments of a problem by their names, with contacts and ties as they were made."""
    parts: dict[str, Any] = {"time": problem.time, "contact": [replace(one, slave=False) for one in problem.contacts]}
    if isinstance(problem, ContactProblem):
        own = {*parts, *_NUMERICAL, *(("material",) if isinstance(problem.made_of, Deformable) else ())}
        parts |= {name: value for name, value in problem.given.items() if name not in own}
        parts["ties"] = with_slaves(parts["ties"], problem.elasticity.constraints.as_made)
    return parts


def _unlike(a: Any, b: Any, name: str = "") -> str:
    """Where two values differ, in words: "friction of contact 2 is 0.2, not 0.3"; empty if they are equal, or cannot be
    told apart."""
    parts: list[tuple[Any, Any, str]] = []
    equal = a is b
    of = f" of {name}" if name else ""
    if isinstance(a, FunctionType) and isinstance(b, FunctionType):
        return "" if _same_function(a, b) else f"{name} is another function"
    if isinstance(a, Mapping) and isinstance(b, Mapping) and a.keys() == b.keys():
        parts = [(value, b[key], f"{key}{of}") for key, value in a.items()]
    elif is_dataclass(a) and type(a) is type(b):
        names = [field.name for field in fields(a)]
        parts = [(getattr(a, one, None), getattr(b, one, None), f"{one}{of}") for one in names]
    elif isinstance(a, str | None) or isinstance(b, str | None):
        equal = type(a) is type(b) and a == b
    else:
        try:
            left, right = (np.asarray(value, dtype=np.float64) for value in (a, b))
            equal = left.shape == right.shape and bool(np.allclose(left, right, _SAME_NUMBER, 0.0, equal_nan=True))
        except (TypeError, ValueError):
            equal = type(a) is type(b) or (isinstance(a, Sequence) and isinstance(b, Sequence))
            if equal and isinstance(a, Sequence) and (equal := len(a) == len(b)):
                parts = [(one, two, f"{name} {k}") for k, (one, two) in enumerate(zip(a, b, strict=True), 1)]
    if not equal and not parts:
        return f"{name} is {_short(b)}, not {_short(a)}"
    return next((unlike for part in parts if (unlike := _unlike(*part))), "")


def _same_function(a: FunctionType, b: FunctionType) -> bool:
    """By the values that two functions of the same code hold; those of different code cannot be told apart."""
    if a.__code__.co_code != b.__code__.co_code:
        return True
    constants = [[const for const in f.__code__.co_consts if isinstance(const, float | int | tuple)] for f in (a, b)]
    held = [[cell.cell_contents for cell in f.__closure__ or ()] for f in (a, b)]
    defaults = [f.__defaults__ or () for f in (a, b)]
    return not any(_unlike(*values) for values in (constants, held, defaults))


def _by_size(answer: Solution, other: Solution) -> str:
    """Bodies of another name or size, or loads with another resultant, in words; collective."""
    over, ends = Reductions(answer.problem.comm), []
    for one in (answer, other):
        members = one.problem.elasticity.members
        extents = [[over.max(sign * axis) for axis in m.body.x.T for sign in (-1.0, 1.0)] for m in members]
        ends.append(dict(zip([member.name for member in members], np.array(extents), strict=True)))
    here, there = ends
    if here.keys() != there.keys():
        return f"it has the bodies {', '.join(there)}, not {', '.join(here)}"
    for name, extent in here.items():
        if np.max(np.abs(extent - there[name])) > _OF_MESHES * np.max(extent[0::2] + extent[1::2]):
            return f"body {name!r} has another place or size" if name else "the body has another place or size"
    loads = [one.force_balance.loads for one in (answer, other)]
    total = [np.sum([load.force for load in of] or [np.zeros(3)], axis=0) for of in loads]
    size = max(float(sum(np.linalg.norm(load.force) for load in of)) for of in loads)
    if np.linalg.norm(total[0] - total[1]) > _OF_MESHES * size:
        return f"its loads have the resultant {_short(total[1])} N, not {_short(total[0])} N"
    return ""


def _short(value: Any) -> str:
    text = repr(value.tolist() if isinstance(value, np.ndarray) else value)
    return text if len(text) <= 120 else f"{text[:117]}..."
