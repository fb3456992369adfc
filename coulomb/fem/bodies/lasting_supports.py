"""Supports and ties that begin and end in the course of a load history."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Protocol

from ...arrays import FloatArray, is_number


@dataclass(frozen=True, eq=False)
class End:
    """The end of a load step: its time, the displacements of this rank's nodes, metres, shape (k, 3), and in large
    motions the rotation vectors of all rigid faces, radians, shape (faces, 3)."""

    time: float
    displacement: FloatArray
    turns: FloatArray | None = None

    def of(self, nodes: slice) -> End:
        """Of some of the nodes."""
        return End(self.time, self.displacement[nodes], self.turns)


class Lasting(Protocol):
    """When a support or a tie acts."""

    @property
    def begin(self) -> float | None:
        """The time from which it acts; None from the start."""
        ...

    @property
    def end(self) -> float | None:
        """The time until which it acts; None if it does not end."""
        ...

    @property
    def reaches(self) -> float | None:
        """Of one that begins, when the displacement is the given one; None: changes count, from where nodes are."""
        ...


_SAME_TIME: Final = 1e-9  # relative difference of times below which they are the same


def limits_of(given: Iterable[Lasting]) -> tuple[float, ...]:
    """The times at which some of these begin or end."""
    return tuple(time for one in given for time in (one.begin, one.end) if time is not None)


def acts(support: Lasting, time: float) -> bool:
    """Whether a support or a tie acts at a time: after `begin`, and at `end` for the last time."""
    begun = support.begin is None or time > support.begin + _SAME_TIME * abs(support.begin)
    return begun and (support.end is None or time <= support.end + _SAME_TIME * abs(support.end))


def act_together(one: Lasting, other: Lasting) -> bool:
    """Whether two constraints act at some time both."""
    begin = max(-math.inf if each.begin is None else each.begin for each in (one, other))
    return begin < min(math.inf if each.end is None else each.end for each in (one, other))


def share_left(support: Lasting, then: float, now: float) -> float:
    """Of a support that has begun: which share of the difference at one time between the displacement and the
    prescribed one is left at a later time."""
    if support.reaches is None:
        return 1.0
    return max(support.reaches - now, 0.0) / (support.reaches - then) if then < support.reaches else 0.0


@dataclass(frozen=True, kw_only=True)
class LastingConstraint:
    """When a support or a tie acts.  Before and after, its nodes are free; load steps end where it begins and ends.

    Attributes:
        begin: The time from which it acts, by default from the start.  From there it moves its nodes, from where they
            are, by the changes of what it prescribes: a clamp holds them there, and a tie where they are to each other.
        end: The time until which it acts, by default always.  In the load step that follows its reaction is gone.
        reaches: The time at which the displacement is the given one, of a tie that of faces together as they were
            before deformation, in place of changes of it: until then what is missing at `begin` is made up for linearly
            in time.

    Raises:
        ValueError: If one is no number, or they are not in this order: begin, reaches, end.
    """

    begin: float | None = None
    end: float | None = None
    reaches: float | None = None

    @property
    def what(self) -> str:
        """Kind and face, for messages."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        for name in ("begin", "end", "reaches"):
            value = getattr(self, name)
            if value is not None and not is_number(value, -math.inf):
                raise ValueError(f"{self.what}: {name} must be a time, but is {value!r}")
        if self.reaches is not None and (self.begin is None or self.reaches < self.begin):
            raise ValueError(f"{self.what}: reaches goes with a begin that is not after it")
        if self.begin is not None and self.end is not None and self.end <= self.begin:
            raise ValueError(f"{self.what}: end = {self.end:g} must be after begin = {self.begin:g}")

    @property
    def lasting(self) -> str:
        """When it acts in words, after what it holds; empty if always."""
        begin = "" if self.begin is None else f", after {self.begin:g} s"
        return begin + ("" if self.end is None else f", until {self.end:g} s")
