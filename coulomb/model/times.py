"""The ends of load steps, and how often a step may be halved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from ..arrays import is_number, is_of_ufl, short

HALVINGS: Final = 6
"""Default of the maximum number of halvings of a failing load step."""


def in_times(count: int) -> str:
    """Once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def refuse_times(start: float, times: Sequence[float]) -> None:
    """Check that the ends of load steps increase.

    Raises:
        ValueError: If there are none, they are no numbers, or they do not increase from `start`.
    """
    if isinstance(times, str) or is_of_ufl(times) or not hasattr(times, "__iter__"):
        raise ValueError(f"history: times must be a list of numbers, as [0.5, 1.0], but is {short(times)}")
    ends = [start, *times]
    if len(ends) < 2:
        raise ValueError("history: times has no load step: give the time at which each ends, as times = [0.5, 1.0]")
    if not all(is_number(t, -math.inf) for t in ends) or any(b <= a for a, b in pairwise(ends)):
        raise ValueError(f"history: times must increase from start = {start:g}, but are {shortened(list(times))}")


def shortened(values: Sequence[float]) -> str:
    """A list for a message; of a long list only the beginning."""
    listed = ", ".join(map(str, values[:10]))
    return f"[{listed}]" if len(values) <= 10 else f"[{listed}, ...] ({len(values)} of them)"


def refuse_missed(limits: Sequence[float], start: float, ends: Sequence[float]) -> None:
    """Check that a load step ends where bolts are locked, and where supports or ties begin or end."""
    for time in limits:
        if start < time < max(ends) and not any(math.isclose(time, end, rel_tol=1e-9) for end in ends):
            listed = ", ".join(f"{end:g}" for end in sorted(ends)[:6])
            raise ValueError(
                f"history: at time {time:g} a support or a tie begins or ends, or a bolt is locked, but no load step "
                f"ends there (they end at {listed}{', ...' if len(ends) > 6 else ''}): add it to times"
            )
