"""A case with one of its inputs a little larger, by the name that it has among the sensitivities."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, cast

from .curves import CurveTable
from .files import KeyPath
from .tolerances import called, place_of, tolerances
from .values import Table

if TYPE_CHECKING:
    from .case import Case

_LOADS = {
    "traction": ("traction", ("value",)),
    "pressure": ("pressure", ("value",)),
    "total force": ("total_force", ("force",)),
    "point load": ("point_load", ("force", "moment")),
    "nodal force": ("nodal_force", ("force",)),
    "stiffness of the spring": ("spring", ("stiffness",)),
}
_HEAT = {"temperature": "temperature", "heat flux": "flux", "film": "ambient", "heat source": "source"}
_ONE = ((0.0, 1.0), (1.0, 1.0))
"""The amplitude without one."""

_SEVERAL = "there are several of this name"
_NO_NUMBER = "it is not one number of the case"
_OF_FRICTION = ("friction", "slip stress", "cohesion", "friction limit")
_OF_CONTACTS = (*_OF_FRICTION, "gap", "load on the foundation", "motion of the foundation", "conductance")


class NotScaled(ValueError):
    """An input that is not one number or function of the case, with the reason."""


def inputs_in(case: Case, faces: Sequence[str]) -> list[str]:
    """The names of the inputs of a case that are not 0, as `model.sensitivity.Sensitivity.name`, without the numbers of
    those that occur again; the faces of contacts are called as the problem calls them."""
    whole = [*(f" of {one.name!r}" for one in case.body), ""]
    heated = [(one, *((" on", one.face) if one.face else (" of", one.body))) for one in case.heat]
    names = [
        *(f"{kind} of {face!r}" for face in faces for kind in _OF_CONTACTS),
        *(f"{kind} on {one.face!r}" for kind, (tables, _) in _LOADS.items() for one in getattr(case, tables)),
        *(f"{kind}{of}" for kind in ("body force", "gravity", "temperature change", "young") for of in whole),
        *(f"{kind}{f'{of} {name!r}' if name else ''}" for kind in _HEAT for _, of, name in heated),
        *(f"pretension of {one.face!r}" for one in case.pretension),
        "prescribed displacements",
        *lengths(case),
    ]
    return [name for name in dict.fromkeys(names) if _changes(case, name)]


def refuse_unknown(case: Case, names: Sequence[str], faces: Sequence[str]) -> None:
    """ValueError if one of these is neither the name of an input of a case (`inputs_in`) nor the place of a number."""
    there = inputs_in(case, faces)
    for name in names:
        at = place_of(case, name)
        if not (_changes(case, name) if at else re.sub(r" \(\d+\)$", "", name) in there):
            raise ValueError(
                f"output.sensitivity: there is no input {name!r} that is not 0; there are {', '.join(there)}; or give "
                "the place of a number of the case, as material.poisson"
            )


def _changes(case: Case, name: str) -> bool:
    """Whether there is an input of this name that is not 0."""
    try:
        return scaled(case, name, 2.0) != case
    except NotScaled as reason:
        return str(reason) != _NO_NUMBER


def lengths(case: Case) -> list[str]:
    """The names of the lengths of boxes."""
    tables = [("", case.mesh), *((f" of {one.name!r}", one) for one in case.body)]
    return [f"length {axis}{of}" for of, one in tables if one is not None and one.box is not None for axis in "xyz"]


def single_numbers(case: Case, names: Sequence[str], places: Sequence[KeyPath]) -> dict[str, tuple[str, float]]:
    """Which of the inputs of these names are the one number at one of some places, by this place as it is `called`: the
    input, and the change of the number with the logarithm of the input."""
    before = dict(_numbers(case.model_dump()))
    numbers = dict[str, tuple[str, float]]()
    for name in names if places else ():
        try:
            after = dict(_numbers(scaled(case, name, 2.0).model_dump()))
        except NotScaled:
            continue
        changed = [path for path, value in after.items() if value != before.get(path)]
        for place in places:
            if changed and all(path[: len(place)] == place for path in changed):
                numbers[called(place)] = name, after[changed[0]] - before[changed[0]]
    return numbers


def _numbers(given: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """What is no table and no list in tables and lists, by its place."""
    if isinstance(given, dict | list | tuple):
        for key, value in given.items() if isinstance(given, dict) else enumerate(given):
            yield from _numbers(value, (*path, key))
    else:
        yield path, given


def _with(given: Any, path: KeyPath, change: Callable[[Any], Any]) -> Any:
    """A table or a list in which what is at a place is changed."""
    if not path:
        return change(given)
    key, rest = path[0], path[1:]
    if isinstance(given, tuple):
        return tuple(_with(one, rest, change) if number == key else one for number, one in enumerate(given))
    return given.model_copy(update={key: _with(getattr(given, str(key)), rest, change)})


def scaled(case: Case, name: str, factor: float) -> Case:
    """The case with an input times a factor.

    Args:
        name: Of the input, as `model.sensitivity.Sensitivity.name`: "friction of 'bottom'", "young of 'upper'"; or the
            place of a number, as it is `called`, which grows by its tolerance if it is 0.
        factor: By which it is multiplied.

    Raises:
        NotScaled: If the input is none of the case's, or is one of several on the same face.
    """
    if path := place_of(case, name):
        tolerance = dict(tolerances(case)).get(path, 0.0)
        return cast("Case", _with(case, path, lambda old: _product(old, factor) if old else (factor - 1.0) * tolerance))
    matched = re.fullmatch(r"(.*?)(?: o[fn] '(.*)')?( \(\d+\))?", name)
    assert matched is not None
    kind, face, number = matched[1], matched[2] or "", matched[3]
    if number:
        raise NotScaled(_SEVERAL)
    made = _known(case, kind, face, factor)
    if not made:
        raise NotScaled(_NO_NUMBER)
    return case.model_copy(update=made)


def _known(case: Case, kind: str, face: str, factor: float) -> dict[str, Any]:
    """What is changed in the case."""
    contacts = case.contact if isinstance(case.contact, tuple) else () if case.contact is None else (case.contact,)

    def changed(tables: Sequence[Any], keys: Sequence[str], wanted: Callable[[Any], bool] = lambda _: True) -> Any:
        return tuple(_times(one, keys, factor) if wanted(one) else one for one in tables)

    def here(table: Any) -> bool:
        sides = {table.face, getattr(table, "against", None)}
        return face in sides or set(face.split(" against ")) == sides

    of_contacts = {
        **{name: (name.replace(" ", "_"),) for name in _OF_FRICTION},
        "gap": ("gap",),
        "load on the foundation": ("force", "moment"),
    }
    if kind in of_contacts or kind == "motion of the foundation":
        keys = of_contacts.get(kind, ())
        scaled = changed(contacts, keys, here)
        if kind in _OF_FRICTION:
            scaled = tuple(
                one.model_copy(update={"region": changed(one.region, keys)}) if here(one) else one for one in scaled
            )
        if kind == "motion of the foundation":
            scaled = tuple(_moved(contact, factor) if here(contact) else contact for contact in contacts)
        several = isinstance(case.contact, tuple)
        if sum(map(here, contacts)) > 1:
            raise NotScaled("the face is in several contacts")
        return {"contact": scaled if several else scaled[0]} if any(map(here, contacts)) else {}
    if kind in _HEAT:
        mine = [getattr(one, _HEAT[kind]) is not None and face in (one.face, one.body, "") for one in case.heat]
        if sum(mine) > 1:
            raise NotScaled(_SEVERAL)
        rest = (case.reference_temperature or 0.0) if kind in ("temperature", "film") else 0.0
        warmer = [
            one.model_copy(update={_HEAT[kind]: _product(getattr(one, _HEAT[kind]), factor, rest)}) if here else one
            for one, here in zip(case.heat, mine, strict=True)
        ]
        return {"heat": tuple(warmer)} if any(mine) else {}
    if kind == "conductance":
        scaled = tuple(
            contact.model_copy(update={"thermal": _times(contact.thermal, ("conductance", "factor"), factor)})
            if here(contact) and contact.thermal is not None
            else contact
            for contact in contacts
        )
        return {"contact": scaled if isinstance(case.contact, tuple) else scaled[0]}
    if kind in _LOADS:
        tables, keys = _LOADS[kind]
        given = getattr(case, tables)
        if sum(map(here, given)) > 1:
            raise NotScaled(_SEVERAL)
        return {tables: changed(given, keys, here)} if any(map(here, given)) else {}
    if kind in ("body force", "gravity") and case.body:  # each body has its own
        raise NotScaled(_SEVERAL)
    if kind == "body force":
        return {"body_force": _product(case.body_force, factor)}
    if kind == "gravity":
        return {"gravity": _product(case.gravity, factor)}
    if kind == "prescribed displacements":
        scaled = {key: changed(getattr(case, key), ("value",)) for key in ("clamp", "prescribed_displacement")}
        scaled["prescribed_rotation"] = changed(case.prescribed_rotation, ("angle",))
        scaled["rigid_face"] = changed(case.rigid_face, ("translation", "rotation"))
        scaled["pretension"] = changed(case.pretension, ("shortening",))
        scaled["equation"] = changed(case.equation, ("constant",))
        return scaled
    if kind == "pretension":
        if sum(map(here, case.pretension)) > 1:
            raise NotScaled(_SEVERAL)
        return {"pretension": changed(case.pretension, ("force",), here)} if any(map(here, case.pretension)) else {}
    if kind == "temperature change" and case.temperature is not None:
        if face and face != case.temperature.body:
            raise NotScaled(_SEVERAL)
        amplitude = _rows(case.temperature.amplitude or _ONE, factor)
        return {"temperature": case.temperature.model_copy(update={"amplitude": amplitude})}
    if kind == "young":
        if case.material is not None and not face:
            return {"material": _of_materials(case.material, factor)}
        bodies = tuple(
            one.model_copy(update={"material": _of_materials(one.material, factor)}) if one.name == face else one
            for one in case.body
        )
        return {"body": bodies} if bodies != case.body else {}
    if kind.startswith("length "):
        axis = "xyz".index(kind[-1])

        def stretched(table: Any) -> Any:
            box = tuple(factor * one if k == axis else one for k, one in enumerate(table.box))
            return table.model_copy(update={"box": box})

        if not face:
            return {"mesh": stretched(case.mesh)}
        return {"body": tuple(stretched(one) if one.name == face else one for one in case.body)}
    return {}


def _of_materials(given: Any, factor: float) -> Any:
    tables = given if isinstance(given, tuple) else (given,)
    scaled = tuple(_times(table, ("young", "shear"), factor) for table in tables)
    return scaled if isinstance(given, tuple) else scaled[0]


def _times(table: Any, keys: Sequence[str], factor: float) -> Any:
    """A table with these of its values times a factor."""
    products = {key: _product(getattr(table, key), factor) for key in keys if getattr(table, key, None) is not None}
    return table.model_copy(update=products)


def _moved(table: Any, factor: float) -> Any:
    """A contact with the motion of its foundation, rows of time and translation or angle, times a factor."""
    update = {} if table.motion is None else {"motion": _rows(table.motion, factor)}
    if table.rotation is not None:
        turned = table.rotation.model_copy(update={"angle": _rows(table.rotation.angle, factor)})
        update["rotation"] = turned
    return table.model_copy(update=update)


def _rows(given: Any, factor: float) -> Any:
    """Rows of time and values, or a curve of them, with the values times a factor."""
    curve = isinstance(given, CurveTable)
    rows = tuple((time, *(factor * one for one in values)) for time, *values in (given.table if curve else given))
    return given.model_copy(update={"table": rows}) if curve else rows


def _product(value: Any, factor: float, rest: float = 0.0) -> Any:
    """A number, an expression, or what has several, with the difference from `rest` times a factor."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        return rest + factor * (value - rest)
    if isinstance(value, str):
        return f"{rest!r} + {factor!r} * ({value} - {rest!r})" if rest else f"{factor!r} * ({value})"
    if isinstance(value, tuple):
        return tuple(_product(one, factor) for one in value)
    if isinstance(value, Table) and not isinstance(value, CurveTable):
        return _times(value, [key for key, _ in value if key not in _NOT_FRICTION], factor)
    raise NotScaled(_NO_NUMBER)


_NOT_FRICTION = ("decay_speed", "pressure", "box")
"""Keys of tables of friction that are no friction."""
