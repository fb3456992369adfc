"""Comparison of written with recomputed numbers: messages for differences beyond rounding.

A number may differ by 1e-9 of itself, so that a factor of 1 + 1e-6 is detected in every entry, and by the effect of
rounding.  This effect is measured: everything is recomputed from perturbed data (`Rounding`), and differences of that
size are accepted.  So the tolerance is only as large as necessary where large numbers cancel (the force balance of a
body, the strain of a body with a large displacement).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray, in_words

RELATIVE: Final = 1e-9
"""Relative tolerance of a recomputed number: files hold 16 digits, of which sums lose a few."""

OF_LARGEST: Final = 1e-14
"""Rounding of a field relative to its largest entry, at least."""

_OF_ITSELF: Final = 1e-13

_OF_SUMS: Final = 1e-13
"""Rounding of a number in JSON relative to the largest of its key: components of one force, forces of all faces."""


class Rounding:
    """Perturbation of data: each entry is changed by up to 1e-13 of itself and a part of the largest, 1e-14 or more.

    This is at least a hundred times the rounding error, so that the effect of rounding is not underestimated by chance.
    Data with equal seeds would cancel in a difference.
    """

    def __init__(self, seed: Sequence[int], of_largest: float = OF_LARGEST):
        self._random, self._of_largest = np.random.default_rng(seed), of_largest

    def of(self, values: FloatArray, scale: float = 0.0) -> FloatArray:
        """Perturbed numbers; `scale` is the largest number that they were computed from."""
        size = np.abs(values)
        by: FloatArray = self._random.uniform(-1.0, 1.0, values.shape)
        by *= _OF_ITSELF * size + self._of_largest * np.max(size, initial=scale)
        return values + by


class Comparison:
    """Collects differences: `faults`, a line each, and the entries of JSON that were `judged`, by file and key.

    `of_largest` is the accepted difference in any field, relative to its largest entry.
    """

    def __init__(self, of_largest: float = OF_LARGEST) -> None:
        self.faults: list[str] = []
        self.judged: set[str] = set()
        self._of_largest = of_largest

    def fault(self, text: str) -> None:
        self.faults.append(text)

    def share(self, comm: MPI.Comm) -> None:
        """Give all ranks the faults of all; collective."""
        self.faults = [fault for faults in comm.allgather(self.faults) for fault in faults]

    def field(
        self,
        what: str,
        written: FloatArray | npt.NDArray[np.bool_],
        expected: FloatArray | npt.NDArray[np.bool_],
        x: FloatArray,
        source: str,
        others: Sequence[FloatArray] = (),
        floor: float = 0.0,
    ) -> None:
        """Compare the values of a field, shape (k,) or (k, 3), at points x (k, 3).

        `expected` follows from `source`, `others` from perturbed data; `floor` is an additional accepted difference.
        """
        written, expected = np.asarray(written, dtype=float), np.asarray(expected, dtype=float)
        size, scale = np.abs(expected), float(np.max(np.abs(expected), initial=0.0))
        rounding = max((float(np.max(np.abs(other - expected), initial=0.0)) for other in others), default=0.0)
        beyond = np.abs(written - expected) - RELATIVE * size - max(rounding, self._of_largest * scale, floor)
        if written.ndim == 2:
            beyond = np.max(beyond, axis=1, initial=-np.inf)
        wrong = ~(beyond <= 0.0)
        if np.any(wrong):
            k = int(np.argmax(np.where(wrong, beyond, -np.inf)))
            place = in_words(x[k])
            self.fault(
                f"{what}: {_shown(written[k])} at x = {place}, but {_shown(expected[k])} follows from {source} "
                f"({np.count_nonzero(wrong)} of {len(wrong)} values differ)"
            )

    def tree(
        self, what: str, written: Any, expected: Any, others: Sequence[Any] = (), source: str = "the fields"
    ) -> None:
        """Compare JSON entries: all expected ones must exist and agree; numbers up to rounding, others exactly, in
        which a figure may be rounded as in `others`, those recomputed from perturbed data.
        """
        scales = _largest(expected, {}, "")

        def compare(what: str, written: Any, expected: Any, others: Sequence[Any], of: str) -> None:
            """Compare an entry; `of` is its key, that of its list if it is in one."""
            if not isinstance(expected, Mapping | list) or not expected:
                self.judged.add(what)
            if isinstance(expected, Mapping) and isinstance(written, Mapping):
                for key, value in expected.items():
                    if key not in written:
                        self.fault(f"{what}.{key}: is missing")
                    else:
                        compare(f"{what}.{key}", written[key], value, [_at(other, key) for other in others], str(key))
                return
            if isinstance(expected, list) and isinstance(written, list) and len(expected) == len(written):
                for k, (one, value) in enumerate(zip(written, expected, strict=True)):
                    compare(f"{what}[{k}]", one, value, [_at(other, k) for other in others], of)
                return
            if isinstance(expected, float) and isinstance(written, float | int) and not isinstance(written, bool):
                if not np.isfinite(expected):
                    self.fault(f"{what}: {written!r}, but what follows from {source} is not finite")
                    return
                rounding = max((abs(one - expected) for one in others if isinstance(one, float)), default=0.0)
                if abs(written - expected) <= RELATIVE * abs(expected) + rounding + _OF_SUMS * scales.get(of, 0.0):
                    return
            elif written == expected and isinstance(written, bool) == isinstance(expected, bool):
                return
            elif isinstance(written, str) and written in others:
                return
            elif isinstance(expected, float) and not np.isfinite(expected) and written is None:  # as JSON has it
                return
            self.fault(f"{what}: {_shown(written)}, but {_shown(expected)} follows from {source}")

        compare(what, written, expected, others, "")


def _largest(tree: Any, found: dict[str, float], of: str) -> dict[str, float]:
    """Adds the largest numbers by their keys, those of lists by that of the list."""
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            _largest(value, found, str(key))
    elif isinstance(tree, list):
        for value in tree:
            _largest(value, found, of)
    elif isinstance(tree, float) and np.isfinite(tree):
        found[of] = max(found.get(of, 0.0), abs(tree))
    return found


def unjudged(what: str, written: Any, judged: Collection[str]) -> list[str]:
    """The entries of a file of JSON that are not `judged`: by their key at the top, or as "key of key at the top"."""

    def looked(entry: Any, place: str) -> Iterator[str]:
        if place in judged:
            return
        inside = any(one.startswith((f"{place}.", f"{place}[")) for one in judged)
        if isinstance(entry, Mapping) and inside:
            for key, value in entry.items():
                yield from looked(value, f"{place}.{key}")
        elif isinstance(entry, list) and inside:
            for k, value in enumerate(entry):
                yield from looked(value, f"{place}[{k}]")
        else:
            first, *deeper = re.sub(r"\[\d+\]", "", place.removeprefix(f"{what}.")).split(".")
            yield f"{deeper[-1]} of {first}" if deeper else first

    return list(dict.fromkeys(looked(written, what)))


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
