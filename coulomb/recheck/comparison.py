"""Comparison of what is written with what is computed anew: messages for differences beyond rounding.

A run is a tree: its files, in them grids with fields, or tables of JSON.  A number may differ by 1e-9 of itself, so
that a factor of 1 + 1e-6 is detected in every entry, and by the effect of rounding.  This effect is measured: all is
recomputed from data that are `perturbed`, and differences of that size are accepted.  So the tolerance is only as
large as necessary where large numbers cancel (the force balance of a body, the strain of a body with a large
displacement).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from ..arrays import FloatArray, in_words
from ..contact_fields import ANSWER, CONTACT_FIELDS
from ..io.field_files import WHOLE
from ..io.run_directory import FIELDS, SUMMARY

RELATIVE: Final = 1e-9
"""Relative tolerance of a recomputed number: files hold 16 digits, of which sums lose a few."""

OF_LARGEST: Final = 1e-12
"""Rounding of a field relative to its largest entry, at least."""

_OF_SUMS: Final = 1e-13
"""Rounding of a number in JSON relative to the largest of its key: components of one force, forces of all faces, as of
heat, whose nodal forces have no sum."""

_OF_CERTIFICATE: Final = 1e-12
"""Value of a check of the certificate below which it is a rounding error."""


_SOURCE: Final = f"the case and {ANSWER}"

_GIVEN: Final = {
    **{field.name: field.follows for field in CONTACT_FIELDS if field.given},
    **{"time": "the load step, or that of the problem", "points": "the case", "length of normal": "its direction"},
    **dict.fromkeys(("tension", "friction beyond its bound"), "the law of friction"),
}
"""What fields are computed from that are input."""


def perturbed(values: FloatArray, random: np.random.Generator) -> FloatArray:
    """Each entry changed by up to 1e-13 of itself and 1e-14 of the largest: at least a hundred times the rounding
    error, so that its effect is not underestimated by chance."""
    size, by = np.abs(values), random.uniform(-1.0, 1.0, values.shape)
    return values + by * (1e-13 * size + 1e-14 * np.max(size, initial=0.0))


class Field(NamedTuple):
    """The values of a field, shape (k,) or (k, 3), at points x (k, 3); a difference up to `floor` is accepted."""

    values: FloatArray
    x: FloatArray
    floor: float = 0.0


Result = TypeVar("Result")

Place = tuple[str | int, ...]
"""Where an entry is in the tree of a run: its file, then the keys of JSON, or the grid and the name of the field."""


class Comparison:
    """Collects differences, `faults`, a line each, and the places of what is written but not expected, `left`."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self.left: list[Place] = []

    def tree(
        self,
        written: Any,
        expected: Any,
        others: Sequence[Any] = (),
        place: Place = (),
        source: str = _SOURCE,
        scales: Mapping[str, float] | None = None,
    ) -> None:
        """Compare the entries at a place: all expected ones must exist and agree with what follows from a source:
        fields and numbers up to rounding, by `others` from perturbed data; in texts figures may be rounded as there;
        everything else exactly.  `scales` are the largest numbers of the whole tree by their keys."""
        keys, scales = list[Any](), _largest(expected, {}, "") if scales is None else scales
        if isinstance(expected, Mapping) and isinstance(written, Mapping):
            self.faults += [f"{in_files((*place, key))}: is missing" for key in expected if key not in written]
            self.left += [(*place, key) for key in written if key not in expected]
            keys = [key for key in expected if key in written]
        elif isinstance(expected, list) and isinstance(written, list):
            keys = list(range(min(len(expected), len(written))))
            if len(expected) != len(written):
                self.faults.append(
                    f"{in_files(place)}: has {len(written)} entries, but {len(expected)} follow from {source}"
                )
        elif said := _difference(written, expected, others, place, scales):
            of = _GIVEN.get(str(place[-1]), source) if place[0] in FIELDS else source
            self.faults.append(f"{in_files(place)}: {said[0]}, but {said[1]} follows from {of}{said[2]}")
        for key in keys:
            self.tree(written[key], expected[key], [_at(one, key) for one in others], (*place, key), source, scales)


def _difference(
    written: Any, expected: Any, others: Sequence[Any], place: Place, scales: Mapping[str, float]
) -> tuple[str, str, str] | None:
    """Two fields or entries of JSON that differ, in words: what is written, what follows, and in how many values."""
    if isinstance(expected, Field):
        return _difference_of_fields(written, expected, others)
    number = isinstance(written, float | int) and not isinstance(written, bool)
    if isinstance(expected, float) and not np.isfinite(expected):
        same = written is None  # as JSON has it
    elif isinstance(expected, float) and number:
        rounding = max((abs(one - expected) for one in others if isinstance(one, float)), default=0.0)
        key = next((key for key in reversed(place) if isinstance(key, str)), "")  # that of the list if it is in one
        rounding += _OF_SUMS * scales.get(key, 0.0)
        rounding += _OF_CERTIFICATE if key == "value" and "certificate" in place else 0.0
        same = abs(written - expected) <= RELATIVE * abs(expected) + rounding
    else:
        same = written == expected and isinstance(written, bool) == isinstance(expected, bool)
        same = same or (isinstance(written, str) and written in others)
    return None if same else (_shown(written), _shown(expected), "")


def _difference_of_fields(written: Any, expected: Field, others: Sequence[Any]) -> tuple[str, str, str] | None:
    """The values that differ most, in words, and where."""
    values, follows, size = written.values, expected.values, np.abs(expected.values)
    if values.shape != follows.shape:
        return f"has the shape {values.shape}", f"{follows.shape}", ""
    rounding = [np.max(np.abs(one.values - follows), initial=0.0) for one in others if one is not None]
    least = max(*rounding, OF_LARGEST * float(np.max(size, initial=0.0)), expected.floor, 0.0)
    beyond = np.abs(values - follows) - RELATIVE * size - least
    if values.ndim == 2:
        beyond = np.max(beyond, axis=1, initial=-np.inf)
    wrong = ~(beyond <= 0.0)
    if not np.any(wrong):
        return None
    k = int(np.argmax(np.where(wrong, beyond, -np.inf)))
    count = f" ({np.count_nonzero(wrong)} of {len(wrong)} values differ)"
    return f"{_shown(values[k])} at x = {in_words(expected.x[k])}", _shown(follows[k]), count


def in_files(place: Place) -> str:
    """A place in words: "contact.xdmf: gap of upper", "summary.json.totals.force[0]"."""
    file, *keys = place
    if file in FIELDS:
        grid, name = keys
        return f"{file}: {name}" if grid == WHOLE else f"{file}: {name} of {grid}"
    return f"{file}" + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)


def named(places: Sequence[Place]) -> list[str]:
    """The names of entries, each once: of summary.json by the key at the top, or as "key of key at the top"."""
    names_of = []
    for file, *keys in places:
        names = [str(key) for key in keys if isinstance(key, str)]
        top = names[:1] if file == SUMMARY else [str(file)]
        names_of.append(" of ".join(dict.fromkeys([names[-1], *top])))
    return list(dict.fromkeys(names_of))


def complete(folder: Path, read: Callable[[], Result]) -> Result:
    """What a call gives that reads the results in a directory; ValueError if entries have a wrong type or structure."""
    try:
        return read()
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"{folder}: is incomplete, or written by another version of coulomb: {error!r}") from None


def _largest(tree: Any, sizes: dict[str, float], of: str) -> dict[str, float]:
    """Adds the largest numbers by their keys, those of lists by that of the list."""
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            _largest(value, sizes, str(key))
    elif isinstance(tree, list):
        for value in tree:
            _largest(value, sizes, of)
    elif isinstance(tree, float) and np.isfinite(tree):
        sizes[of] = max(sizes.get(of, 0.0), abs(tree))
    return sizes


def _at(tree: Any, key: Any) -> Any:
    """An entry of another tree, None if it has none."""
    try:
        return tree[key]
    except (KeyError, IndexError, TypeError):
        return None


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return "(" + ", ".join(f"{entry:.10g}" for entry in value) + ")" if value.ndim else f"{value:.10g}"
    return f"{value:.10g}" if isinstance(value, float) else repr(value)
