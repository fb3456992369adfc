"""Estimate of the remaining time of a run."""

from __future__ import annotations

import math

from ..solvers.results import Progress

_STEPS = 5  # number of last steps from which the rate is computed
_LEAST = 0.2  # decades per step: a slower decrease, as in the first steps, gives no estimate


class TimeLeft:
    """Seconds to the tolerance, while the residual of path following falls geometrically.

    There is no estimate for the first steps, where it does not fall yet, and for successive Tresca, whose residuals
    start again with every problem.

    Args:
        tolerance: Residual at which the solve ends.
    """

    def __init__(self, tolerance: float):
        self._tolerance = tolerance
        self._seen: list[tuple[int, float, float]] = []

    def note(self, progress: Progress, now: float) -> None:
        """Record a step and the time of its end in seconds."""
        if self._seen and progress.path_following <= self._seen[-1][0]:
            self._seen = []
        if progress.outer == 0 and progress.residual > 0.0:
            self._seen.append((progress.path_following, math.log10(progress.residual), now))

    @property
    def seconds(self) -> float | None:
        """The remaining seconds, or None without an estimate."""
        if len(self._seen) <= _STEPS or self._tolerance <= 0.0:
            return None
        (first, high, then), (last, low, now) = self._seen[-_STEPS - 1], self._seen[-1]
        fall = (high - low) / (last - first)
        if fall < _LEAST:
            return None
        return max(low - math.log10(self._tolerance), 0.0) / fall * (now - then) / (last - first)


def about(seconds: float) -> str:
    """Seconds, minutes or hours, to two digits."""
    for unit, size in (("s", 1.0), ("min", 60.0), ("h", 3600.0)):
        if seconds < 99.5 * size or unit == "h":
            value = seconds / size
            return f"{value:.0f} {unit}" if value >= 9.95 or unit == "s" else f"{value:.1f} {unit}"
    raise AssertionError
