"""What belongs at a place of a case, in words and by an example, from the types of its tables."""

from __future__ import annotations

from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, Tag

from .curves import CURVE, ROWS_ALONE, columns_of
from .place import EXPRESSION


class Wanted(NamedTuple):
    """Words for a value.

    Attributes:
        one: For one, with its article.
        several: For several.
        examples: As TOML; none where one is not needed.
    """

    one: str
    several: str
    examples: tuple[str, ...] = ()


_SINGLE = {
    float: Wanted("a number", "numbers", ("1.0", "2.0", "3.0", "4.0")),
    int: Wanted("a whole number", "whole numbers", ("1", "2", "3", "4")),
    str: Wanted("text in quotation marks", "texts in quotation marks"),
    bool: Wanted("true or false", "true or false"),
}


def wanted(case: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """What belongs at a place, with an example of a list; empty if it is a table of keys, or there is no such place.

    Args:
        case: The model of a whole case.
        location: Keys, numbers in lists, and tags of alternatives, as pydantic gives them.
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
    """A type without its annotations, and its tags."""
    tags: list[str] = []
    while get_origin(kind) is Annotated:
        kind, *notes = get_args(kind)
        tags += [note.tag for note in notes if isinstance(note, Tag)]
    return kind, tags


def _words(kind: Any) -> Wanted | None:
    """None for a table of keys."""
    bare, tags = _bare(kind)
    if EXPRESSION in tags:
        return Wanted("an expression in quotation marks", "expressions in quotation marks")
    if get_origin(bare) in (Union, UnionType):
        found = list(dict.fromkeys(words for words in map(_words, get_args(bare)) if words is not None))
        if not found:
            return None
        one, several = " or ".join(words.one for words in found), " or ".join(words.several for words in found)
        return Wanted(one, several, next((words.examples for words in found if words.examples), ()))
    if get_origin(bare) is dict:
        return Wanted("a table of names and numbers", "tables of names and numbers", ("{ left = 1, right = 2 }",))
    return _listed(get_args(bare)) if get_origin(bare) is tuple else _SINGLE.get(bare)


def _listed(items: tuple[Any, ...]) -> Wanted | None:
    """For a list of `items`; the last one is an ellipsis if there may be any number."""
    inner = _words(items[0])
    if inner is None:
        return None
    any_number = items[-1] is Ellipsis
    count = 2 if any_number else len(items)
    number = "" if any_number else f"{count} "
    shown = (inner.examples if len(inner.examples) >= count else inner.examples * count)[:count]
    example = (f"[{', '.join(shown)}]",) if shown else ()
    return Wanted(f"a list of {number}{inner.several}", f"lists of {number}{inner.several}", example)
