"""Written numbers against those that follow from others: what differs by more than rounding, in words.

A number may differ by 1e-9 of itself, so that a factor of 1 + 1e-6 is seen in each entry, however many there are; and
by what rounding makes of it.  That is measured, not guessed: everything is computed once more from data that are
rounded otherwise (`Rounding`), and differences of that size are none.  So where large numbers cancel (the force balance
of a body, the strain of one that moves far) the tolerance is as large as it must be and no larger.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray

RELATIVE = 1e-9
"""How far a number may be from what follows, over itself: files hold 16 digits, and sums lose a few."""

_OF_ITSELF, OF_LARGEST = 1e-13, 1e-14


class Rounding:
    """Data rounded otherwise: each entry changed by up to 1e-13 of itself and a part of the largest, 1e-14 or more.

    That is a hundred times and more what rounding does: of several such changes chance makes none as small as that.

    Args:
        seed: Of the changes: two that are the same would cancel in a difference.
        of_largest: The part of the largest.
    """

    def __init__(self, seed: Sequence[int], of_largest: float = OF_LARGEST):
        self._random, self._of_largest = np.random.default_rng(seed), of_largest

    def of(self, values: FloatArray, scale: float = 0.0) -> FloatArray:
        """The same numbers, rounded otherwise; `scale` is the largest number that they were made from."""
        size = np.abs(values)
        by: FloatArray = self._random.uniform(-1.0, 1.0, values.shape)
        by *= _OF_ITSELF * size + self._of_largest * np.max(size, initial=scale)
        return values + by


class Comparison:
    """Collects what does not follow.

    Args:
        of_largest: A difference that is none in any field, over the largest entry of the field.

    Attributes:
        faults: One line each.
    """

    def __init__(self, of_largest: float = OF_LARGEST) -> None:
        self.faults: list[str] = []
        self._of_largest = of_largest

    def fault(self, text: str) -> None:
        """Something is wrong."""
        self.faults.append(text)

    def field(
        self,
        what: str,
        written: FloatArray | npt.NDArray[np.bool_],
        expected: FloatArray | npt.NDArray[np.bool_],
        x: FloatArray,
        source: str,
        others: Sequence[FloatArray] = (),
        floor: float = 0.0,
    ) -> bool:
        """Compare the values of a field, point by point.

        Args:
            what: Its file and name.
            written: Its values, shape (k,) or (k, 3).
            expected: What they must be.
            x: The points, shape (k, 3).
            source: What that follows from, as in "follows from ...".
            others: What they would be with the data rounded otherwise.
            floor: A difference that is none, besides.

        Returns:
            Whether they agree.
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
            place = ", ".join(f"{c:.6g}" for c in x[k])
            self.fault(
                f"{what}: {_shown(written[k])} at x = {place}, but {_shown(expected[k])} follows from {source} "
                f"({np.count_nonzero(wrong)} of {len(wrong)} values differ)"
            )
        return not np.any(wrong)

    def tree(
        self, what: str, written: Any, expected: Any, others: Sequence[Any] = (), source: str = "the fields"
    ) -> None:
        """Compare entries of JSON: all that is expected must be there, and agree; numbers to rounding, others exactly.

        Args:
            what: File and key.
            written: What is there.
            expected: What must be.
            others: What that would be with the data rounded otherwise.
            source: What it follows from.
        """
        if isinstance(expected, Mapping) and isinstance(written, Mapping):
            for key, value in expected.items():
                if key not in written:
                    self.fault(f"{what}.{key}: is missing")
                else:
                    self.tree(f"{what}.{key}", written[key], value, [_at(other, key) for other in others], source)
            return
        if isinstance(expected, list) and isinstance(written, list) and len(expected) == len(written):
            for k, (one, value) in enumerate(zip(written, expected, strict=True)):
                self.tree(f"{what}[{k}]", one, value, [_at(other, k) for other in others], source)
            return
        if _is_float(expected) and (_is_float(written) or isinstance(written, int)) and not isinstance(written, bool):
            if not np.isfinite(expected):
                self.fault(f"{what}: {written!r}, but what follows from {source} is not finite")
                return
            rounding = max((abs(o - expected) for o in others if _is_float(o)), default=0.0)
            if abs(written - expected) <= RELATIVE * abs(expected) + rounding:
                return
        elif written == expected and isinstance(written, bool) == isinstance(expected, bool):
            return
        elif _is_float(expected) and not np.isfinite(expected) and written is None:  # JSON has neither nan nor inf
            return
        self.fault(f"{what}: {_shown(written)}, but {_shown(expected)} follows from {source}")


def _is_float(value: Any) -> bool:
    return isinstance(value, float)


def _at(tree: Any, key: Any) -> Any:
    """An entry of another tree, None where it has none."""
    try:
        return tree[key]
    except (KeyError, IndexError, TypeError):
        return None


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return "(" + ", ".join(f"{entry:.10g}" for entry in value) + ")" if value.ndim else f"{value:.10g}"
    return f"{value:.10g}" if isinstance(value, float) else repr(value)
