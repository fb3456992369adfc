"""Error messages for the tables of a case: key, value, and what is allowed or probably meant."""

from __future__ import annotations

import difflib
import functools
import re
import reprlib
import sys
from collections.abc import Iterator
from types import UnionType
from typing import Annotated, Any, Final, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError
from typing_extensions import TypeAliasType

from .contact import BY_PRESSURE, BY_SLIP_RATE, FACE, FACES
from .curves import CURVE, ROWS_ALONE, CurveTable, columns_of
from .loads import FORCES, ONE_FORCE
from .material import ONE, ONE_NUMBER, SEVERAL, THREE_NUMBERS
from .synonyms import example, in_its_place, right
from .values import EXPRESSION, FIELD, ISOTROPIC, NUMBER, ORTHOTROPIC, TOLERANCE, TWO_NUMBERS

_MOST: Final = 10
"""Maximum number of faults listed."""

_FIRST_KEY = {
    **{"mesh": "file", "output": "directory", "contact": "face", "material": "young", "history": "times"},
    **{"temperature": "file", "units": "length"},
}
"""The probable key if a value is given in place of a table."""

_TAGS = (
    *(ONE, SEVERAL, FACE, FACES, ISOTROPIC, ORTHOTROPIC, BY_SLIP_RATE, BY_PRESSURE, CURVE, ROWS_ALONE),
    *(NUMBER, EXPRESSION, FIELD, ONE_NUMBER, TWO_NUMBERS, THREE_NUMBERS, ONE_FORCE, FORCES),
)
"""Alternatives in the place of an error, which the user does not write."""

_OTHER_TYPES = {
    *("tuple_type", "dict_type", "string_type", "bool_type", "bool_parsing", "float_type", "int_type"),
    *("int_from_float", "missing"),
}
"""Errors of values of another type, and of lists with too few values."""

_OTHER_KINDS: Final = {"literal_error", "model_type", "model_attributes_type"}
"""Errors of values that are none of several, and of those in place of a table."""

_BOUNDS = {
    **{"greater_than": "greater than", "greater_than_equal": "greater than or equal to"},
    **{"less_than": "less than", "less_than_equal": "less than or equal to"},
}
"""Errors of numbers beyond a bound."""

_MEANT = {"auto": "[auto_contact], a table of its own"}
"""What is meant by a key that is a table."""

_Model = type[BaseModel]

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 80
_short.maxlevel, _short.maxdict, _short.maxlist, _short.maxtuple = 3, 4, 6, 6


def fault_of(error: ValidationError, where: str, case: _Model) -> ValueError:
    """All faults found by pydantic in the file `where`, one per line, as one error."""
    entries = _without_consequences(error.errors(include_url=False))
    said = [(entry, _explain(entry, case)) for entry in entries]
    lines = [f"{where}: {text}" for entry, text in said if not _given_otherwise(entry, said)]
    if len(lines) > _MOST:
        lines[_MOST:] = [f"{where}: and {len(lines) - _MOST} more"]
    return ValueError("\n".join(lines))


def _without_consequences(entries: list[Any]) -> list[Any]:
    """Entries without lists that are too short because their values are wrong, and one entry for each list that lacks
    several."""
    wrong = [entry["loc"] for entry in entries if entry["type"] != "too_short"]
    kept, lacking = [], set()
    for entry in entries:
        place = entry["loc"]
        if entry["type"] == "too_short" and any(other[: len(place)] == place for other in wrong):
            continue
        if entry["type"] == "missing" and isinstance(place[-1], int):
            if place[:-1] in lacking:
                continue
            lacking.add(place[:-1])
        kept.append(entry)
    return kept


def _given_otherwise(entry: Any, said: list[tuple[Any, str]]) -> bool:
    """Whether a key is missing since its table has another word for it, which a line among those `said` names."""
    if entry["type"] != "missing":
        return False
    *table, key = entry["loc"]
    key = "degrees" if key == "angle" else key
    return any(list(other["loc"][:-1]) == table and re.search(rf"(: write|,) {key} = ", text) for other, text in said)


@functools.cache
def tables_of_several(case: _Model) -> frozenset[str]:
    """Names of the tables of which a case may have several, [[name]]."""
    return frozenset(name for name, _, several in _tables(case) if several)


def _explain(entry: Any, case: _Model) -> str:
    place = entry["loc"]
    if entry["type"] == "missing" and isinstance(place[-1], int):  # the list that lacks it is its input
        place = place[:-1]
    while place and place[-1] in _TAGS:  # all alternatives are right
        place = place[:-1]
    location = tuple(part for part in place if part not in _TAGS)
    key, given = ".".join(map(str, location)) or "case", entry["input"]
    names = ".".join(part for part in location if isinstance(part, str))
    if entry["type"] == "extra_forbidden":
        return f"{key} = {_shown(given)}: there is no such key{_meant(location, given, case)}"
    other = entry["type"] in {*_OTHER_TYPES, *_OTHER_KINDS} and bool(location)
    name = location[-1] if location and isinstance(location[-1], str) else ""
    better = in_its_place(names.rpartition(".")[0], name, given) if other else ""
    instead = f": write {better}" if better else ""
    usual = example(str(location[0]), str(location[-1])) if location else ""
    for_example = f", for example {usual}" if usual else ""
    if entry["type"] == "missing" and isinstance(location[-1], str) and place == entry["loc"]:
        return f"{key}: is missing{for_example}"
    if key == "case":  # inconsistent parts, named in the message
        return str(entry["msg"]).removeprefix("Value error, ")
    if entry["type"] == "tuple_type" and isinstance(given, dict) and names in tables_of_several(case):
        return f"{key}: there may be several: write [[{names}]], with double brackets, in place of [{names}]"
    if entry["type"] == "float_type" and isinstance(given, int) and abs(given) > sys.float_info.max:
        return f"{key} = {_shown(given)}: is too large: numbers are at most {sys.float_info.max:.1e}"
    if entry["type"] in _OTHER_TYPES and (wanted := expected_value(case, place)):
        return f"{key} = {_shown(given)}: should be {wanted}{', not text' if isinstance(given, str) else ''}{instead}"
    if instead and entry["type"] in _OTHER_KINDS and entry["type"] != "literal_error":
        return f"{key} = {_shown(given)}: is a table{instead}"
    if entry["type"] == "tuple_type":
        return f"{key} = {_shown(given)}: is a list of tables: write [[{names}]], and below it its keys"
    if entry["type"] in ("model_type", "model_attributes_type"):
        if isinstance(given, list) and len(location) == 1:
            return f"{key}: there is only one: write [{names}], with single brackets"
        first = _FIRST_KEY.get(names)
        below = f", for example {first} = {_shown(given)}" if first and isinstance(given, str) else ""
        brackets = f"[[{names}]]" if names in tables_of_several(case) and names not in _FIRST_KEY else f"[{names}]"
        return f"{key} = {_shown(given)}: is a table: write {brackets}, and below it its keys{below}"
    if entry["type"] in _BOUNDS:  # pydantic writes 1e-12 as 0.000000000001
        (bound,) = entry["ctx"].values()
        number = str(bound) if isinstance(bound, int) else f"{bound:g}"
        return f"{key} = {_shown(given)}: should be {_BOUNDS[entry['type']]} {number}{for_example}"
    message = str(entry["msg"]).removeprefix("Value error, ").replace(" after validation", "")
    for subject in ("Input ", "String ", "Tuple "):
        message = message.removeprefix(subject)
    return f"{key} = {_shown(given)}: {message.replace('Input', 'it')}{instead}"


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    try:
        return _short.repr(value)
    except (RecursionError, ValueError):  # nested without end; thousands of digits
        return "..."


def _meant(location: tuple[int | str, ...], given: Any, case: _Model) -> str:
    """The line that is meant, or the table to which a key belongs, or a similar key, and the known keys of its
    table."""
    name = str(location[-1])
    here = ".".join(part for part in location[:-1] if isinstance(part, str))
    tables = list(_tables(case))
    known: dict[str, list[str]] = {}
    for place, model, _ in tables:
        known[place] = list(dict.fromkeys([*known.get(place, []), *model.model_fields]))
    of = name.removesuffix(TOLERANCE)
    if of != name and of in known.get(here, ()):
        return f": it is the tolerance of {of}, which is not given beside it"
    above = here.rpartition(".")[0]
    if not (above and name in known[above]) and (better := right(here, name, given, known.get(here, ()))):
        return f": {better}"
    curves = {place for place, model, _ in tables if issubclass(model, CurveTable)}
    several = tables_of_several(case)
    homes = [place for place, keys in known.items() if name in keys and place != here and place not in curves]
    homes = [place for place in homes if not (place.startswith("body.") and place.removeprefix("body.") in homes)]
    listed = f" (known here: {', '.join(known.get(here, []))})"
    if homes:
        parents = [home for home in homes if home == "" or here.startswith(f"{home}.")]
        if here and parents:
            table = f"[[{here}]]" if here in several else f"[{here}]"
            if (here, name) == ("body", "mesh"):
                return f"; its keys, as box or file, stand in [[body]] itself{listed}"
            if parents[0] == "" and name in known:
                own = f"[[{name}]]" if name in several and name not in _FIRST_KEY else f"[{name}]"
                return f"; {own} is a table of its own{listed}"
            top = "it belongs at the top of the file" if parents[0] == "" else f"it belongs to [{parents[0]}]"
            return f"; {top}, above {'the first table' if parents[0] == '' else table}{listed}"
        shown = [f"[[{home}]]" if home in several and home not in _FIRST_KEY else f"[{home}]" for home in homes[:3]]
        return f"; it belongs to {' or '.join(shown)}{listed}"
    close = difflib.get_close_matches(name, known.get(here, []), n=1)
    meant = _MEANT.get(name) or (close[0] if close else "")
    return f"{f'; did you mean {meant}?' if meant else ''}{listed}"


def _tables(model: _Model, name: str = "", several: bool = False) -> Iterator[tuple[str, _Model, bool]]:
    """Every table of a case: dotted name (empty for the case), model, and whether there may be several."""
    yield name, model, several
    for key, field in model.model_fields.items():
        models = list(_models(field.annotation))
        if models[1:] and all(set(one.model_fields) <= set(models[-1][0].model_fields) for one, _ in models):
            models = models[-1:]  # of alternatives the model for several, which has all keys
        for inner, in_list in models:
            yield from _tables(inner, f"{name}.{key}" if name else key, in_list)


def _models(annotation: Any, in_list: bool = False) -> Iterator[tuple[_Model, bool]]:
    """The tables in an annotation, and whether they are in a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, in_list
        return
    for argument in getattr(annotation, "__args__", ()):
        yield from _models(argument, in_list or getattr(annotation, "__origin__", None) is tuple)


# --- what is expected, from the types of the tables -----------------------------------------------------------------


class ExpectedValue(NamedTuple):
    """Words for one value, with its article, and for several; examples as TOML, none where one is not needed."""

    one: str
    several: str
    examples: tuple[str, ...] = ()


_SINGLE = {
    float: ExpectedValue("a number", "numbers", ("1.0", "2.0", "3.0", "4.0")),
    int: ExpectedValue("a whole number", "whole numbers", ("1", "2", "3", "4")),
    str: ExpectedValue("text in quotation marks", "texts in quotation marks"),
    bool: ExpectedValue("true or false", "true or false"),
}


def expected_value(case: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """What belongs at a place, with an example of a list; empty if it is a table of keys, or there is no such place.

    `location` has keys, numbers in lists, and tags of alternatives, as pydantic gives them.
    """
    place: Any = case
    for part in location:
        place = _inside(place, part)
    for rows, tail in (("a list of rows", location), ("a row", location[:-1])):
        if (columns := _columns(tail)) and (rows != "a row" or isinstance(location[-1], int)):
            return f"{rows} [{columns}]"
    words = _words(place)
    if words is None:
        return ""
    return f"{words.one}, as {words.examples[0]}" if words.examples and "[" in words.examples[0] else words.one


def _columns(location: tuple[int | str, ...]) -> str:
    """Of the table in time at a place, or whose rows are there; empty if there is none."""
    key = next((part for part in reversed(location) if part not in ("table", ROWS_ALONE, CURVE)), "")
    return columns_of(key) if isinstance(key, str) else ""


def _inside(place: Any, part: int | str) -> Any:
    """The type one step further in; None if there is none."""
    bare, _ = _bare(place)
    if get_origin(bare) in (Union, UnionType):
        members = get_args(bare)
        tagged = [_bare(member)[0] for member in members if part in _bare(member)[1]]
        found = (inner for inner in (_inside(member, part) for member in members) if inner is not None)
        return tagged[0] if tagged else next(found, None)
    if isinstance(bare, type) and issubclass(bare, BaseModel):
        field = bare.model_fields.get(str(part))
        return None if field is None else field.annotation
    if get_origin(bare) is tuple and isinstance(part, int):
        items = get_args(bare)
        return items[0] if items[-1] is Ellipsis else items[part] if part < len(items) else None
    return None


def _bare(kind: Any) -> tuple[Any, list[str]]:
    """A type without its annotations and its name, and its tags."""
    tags: list[str] = []
    while get_origin(kind) is Annotated or isinstance(kind, TypeAliasType):
        kind, *notes = (kind.__value__,) if isinstance(kind, TypeAliasType) else get_args(kind)
        tags += [note.tag for note in notes if isinstance(note, Tag)]
    return kind, tags


def _words(kind: Any) -> ExpectedValue | None:
    """None for a table of keys."""
    bare, tags = _bare(kind)
    if EXPRESSION in tags:
        return ExpectedValue("an expression in quotation marks", "expressions in quotation marks")
    if get_origin(bare) in (Union, UnionType):
        expected = list(dict.fromkeys(words for words in map(_words, get_args(bare)) if words is not None))
        if not expected:
            return None
        one, several = " or ".join(words.one for words in expected), " or ".join(words.several for words in expected)
        return ExpectedValue(one, several, next((words.examples for words in expected if words.examples), ()))
    if get_origin(bare) is Literal:
        *most, last = (f'"{one}"' for one in get_args(bare))
        names = f"{', '.join(most)} or {last}" if most else last
        return ExpectedValue(names, f"texts, each {names}", (*most, last))
    if get_origin(bare) is dict:
        return ExpectedValue(
            "a table of names and numbers", "tables of names and numbers", ("{ left = 1, right = 2 }",)
        )
    return _listed(get_args(bare)) if get_origin(bare) is tuple else _SINGLE.get(bare)


def _listed(items: tuple[Any, ...]) -> ExpectedValue | None:
    """For a list of `items`; the last one is an ellipsis if there may be any number."""
    inner = _words(items[0])
    if inner is None:
        return None
    any_number = items[-1] is Ellipsis
    count = 2 if any_number else len(items)
    number = "" if any_number else f"{count} "
    shown = (inner.examples if len(inner.examples) >= count else inner.examples * count)[:count]
    example = (f"[{', '.join(shown)}]",) if shown else ()
    return ExpectedValue(f"a list of {number}{inner.several}", f"lists of {number}{inner.several}", example)
