"""The steps of a deck as one load history: what every load and support is at every time.

CalculiX' rules: a value without an amplitude goes linearly from what it is at the end of the last step to the new one
(or at once, in a step with AMPLITUDE=STEP); what is not given again stays, or goes on, with an amplitude in total
time; with OP=NEW what is not given again goes: loads linearly to 0 in the course of the step, those with an amplitude
in total time and supports at once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

import numpy as np

from .cards import Card

Key = TypeVar("Key", bound=Hashable)

Rows = tuple[tuple[float, float], ...]
"""Times and values, linear between them and constant before and after."""

_SOON: Final = 1e-6  # of a step: in place of a jump


@dataclass
class Step:
    """One step: its cards, and from when to when.

    Attributes:
        number: Counted from 1.
        at_once: Whether its loads act from its beginning (AMPLITUDE=STEP).
        ends: Of the load steps that it is solved in; the last is `end`.
    """

    number: int
    card: Card
    cards: list[Card] = field(default_factory=list)
    begin: float = 0.0
    end: float = 1.0
    at_once: bool = False
    ends: list[float] = field(default_factory=list)

    @property
    def soon(self) -> float:
        """Just after its beginning: the end of a jump there."""
        return self.begin + _SOON * (self.end - self.begin)

    def divide(self) -> None:
        """Into as many load steps as the first increment makes, ten at most."""
        procedure = next((card for card in self.cards if card.kind in PROCEDURES), None)
        first = procedure.floats([0])[0] if procedure is not None and procedure.lines else 1.0
        count = min(max(round((self.end - self.begin) / first), 1), 10) if first > 0.0 else 1
        self.ends = [self.begin + (self.end - self.begin) * (k + 1) / count for k in range(count)]


@dataclass
class Amplitude:
    """A curve of an *AMPLITUDE card: factors by time, of the step or in all."""

    rows: Rows
    total: bool

    def at(self, time: float) -> float:
        """Linear between the rows, constant outside."""
        return value_at(self.rows, time)

    def between(self, begin: float, end: float) -> Iterator[tuple[float, float]]:
        """Times and factors from the beginning to the end of a step, two of one time at a jump."""
        shift = 0.0 if self.total else begin
        yield begin, self.at(begin - shift)
        yield from ((shift + time, factor) for time, factor in self.rows if begin < shift + time < end)
        yield end, self.at(end - shift)


def value_at(rows: Rows, time: float) -> float:
    """Linear between rows, constant before the first and after the last."""
    before = [row for row in rows if row[0] <= time]
    after = [row for row in rows if row[0] > time]
    if not before or not after:
        return (before[-1:] or after[:1])[0][1]
    (t0, v0), (t1, v1) = before[-1], after[0]
    return v0 + (v1 - v0) * (time - t0) / (t1 - t0)


def smooth(rows: Rows) -> Rows:
    """Abaqus' SMOOTH STEP through rows, x^3 (10 - 15 x + 6 x^2) between two of them, in twenty parts."""
    curve = list(rows[:1])
    for (t0, v0), (t1, v1) in itertools.pairwise(rows):
        x = np.arange(1, 21) / 20.0
        risen = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        curve += [(float(t), float(v)) for t, v in zip(t0 + x * (t1 - t0), v0 + risen * (v1 - v0), strict=True)]
    return tuple(curve)


def periodic(card: Card, until: float) -> Rows:
    """Abaqus' PERIODIC, A0 + sum of A_n cos(n w (t - t0)) + B_n sin(n w (t - t0)) from t0 on and A0 before, in forty
    parts of the shortest period up to a time; from the lines N, w, t0, A0 and A_1, B_1, A_2, ..."""
    count, omega, start, mean = card.vector(0, 4)
    given = card.floats(range(1, len(card.lines)))
    if count != len(given) / 2 or count < 1.0 or omega <= 0.0:
        raise card.fault("needs a line of N, frequency, start and mean, and N pairs of coefficients")
    parts = math.ceil(max(until - start, 0.0) * omega * count / (2.0 * math.pi) * 40)
    if parts > 4000:
        raise card.fault(f"has {parts / 40.0:.0f} of its shortest periods in a step: at most 100 are read")
    t = start + np.arange(parts + 1) * (2.0 * math.pi / (40.0 * omega * count))
    angle = np.outer(t - start, np.arange(1, int(count) + 1) * omega)
    at = mean + np.cos(angle) @ given[::2] + np.sin(angle) @ given[1::2]
    before = [(start, float(mean))] if start > 0.0 and at[0] != mean else []
    return (*before, *((float(time), float(value)) for time, value in zip(t, at, strict=True)))


@dataclass
class Track:
    """What one load, or one component of a support, is in the course of time.

    Attributes:
        rows: Times and values so far.
        begin: When a support begins; None from the start.
        end: When it ends; None never.
        reaches: Of one that begins, when its displacement is that of the rows: until then it goes there from where it
            is; None if it stays.
        goes_on: A value and its amplitude in total time, which goes on in later steps; None for others.
    """

    rows: list[tuple[float, float]] = field(default_factory=list)
    begin: float | None = None
    end: float | None = None
    reaches: float | None = None
    goes_on: tuple[float, Amplitude] | None = None

    def value(self, time: float = math.inf) -> float:
        """At a time, by default at the end of what is known."""
        return value_at(tuple(self.rows), time) if self.rows else 0.0

    def goes_to(self, value: float, step: Step, amplitude: Amplitude | None = None) -> None:
        """In the course of a step."""
        self.goes_on = (value, amplitude) if amplitude is not None and amplitude.total else None
        if self.begin is not None and not self.rows:
            self._begins(value, step, amplitude)
            return
        last = self.value(step.begin)
        if amplitude is not None:
            for time, factor in amplitude.between(step.begin, step.end):
                self._put(time, value * factor, step.soon - step.begin)
        elif step.at_once:
            self._put(step.begin, last)
            self._put(step.soon, value)
            self._put(step.end, value)
        else:
            self._put(step.begin, last)
            self._put(step.end, value)

    def _begins(self, value: float, step: Step, amplitude: Amplitude | None) -> None:
        """The first step of a support: from where it is to the value, or at once with an amplitude."""
        rows = [(step.begin, value)] if amplitude is None else []
        if amplitude is not None:
            rows = [(time, value * factor) for time, factor in amplitude.between(step.begin, step.end)]
        for time, at in rows:
            self._put(time, at, step.soon - step.begin)
        if not math.isnan(value):
            self.reaches = step.begin if amplitude is not None or step.at_once else step.end

    def _put(self, time: float, value: float, jump: float = 0.0) -> None:
        """A row; of a time that the last one has a jump, which takes so long."""
        while self.rows and self.rows[-1][0] > time:
            self.rows.pop()
        if self.rows and self.rows[-1][0] == time:
            if self.rows[-1][1] == value:
                return
            time = max(time + jump, math.nextafter(time, math.inf))
        self.rows.append((time, value))

    def fixed(self) -> tuple[Rows, float | None, float | None, float | None]:
        """All of it, in a form that can be compared: without rows that say nothing."""
        rows = self.rows
        while len(rows) > 1 and rows[-1][1] == rows[-2][1]:
            rows = rows[:-1]
        kept = [
            row
            for k, row in enumerate(rows)
            if not (0 < k < len(rows) - 1 and row[1] == rows[k - 1][1] == rows[k + 1][1])
        ]
        return tuple(kept), self.begin, self.end, self.reaches


def reference(rows: Rows) -> tuple[float, list[list[float]] | None]:
    """A value and the table of its factors in time, None where it is constant."""
    values = [value for _, value in rows]
    if len(set(values)) == 1:
        return values[0], None
    largest = max(values, key=abs)
    return largest, [[time, value / largest] for time, value in rows]


def steps_of(cards: list[Card]) -> tuple[list[Card], list[Step]]:
    """The cards before and outside of the steps, and the steps."""
    model: list[Card] = []
    steps: list[Step] = []
    inside = False
    for card in cards:
        if card.kind == "STEP":
            steps.append(Step(len(steps) + 1, card, at_once=card.key("AMPLITUDE") == "STEP"))
            inside = True
        elif card.kind == "ENDSTEP":
            inside = False
        elif inside:
            steps[-1].cards.append(card)
        else:
            model.append(card)
    time = 0.0
    for step in steps:
        procedure = next((card for card in step.cards if card.kind in PROCEDURES), None)
        period = 1.0
        if procedure is not None and procedure.lines:
            given = procedure.floats([0])
            period = float(given[1]) if len(given) > 1 and given[1] > 0.0 else 1.0
        step.begin, step.end = time, time + period
        step.ends = [step.end]
        if procedure is not None and "DIRECT" in procedure.parameters and procedure.lines:
            count = max(round(period / max(float(procedure.floats([0])[0]), 1e-3 * period)), 1)
            step.ends = [step.begin + period * (k + 1) / count for k in range(count)]
        time = step.end
    return model, steps


PROCEDURES: Final = {
    "STATIC": True,
    "SENSITIVITY": False,
    "COUPLEDTEMPERATURE-DISPLACEMENT": True,
    "UNCOUPLEDTEMPERATURE-DISPLACEMENT": True,
    "HEATTRANSFER": True,
    "VISCO": False,
    "DYNAMIC": False,
    "MODALDYNAMIC": False,
    "STEADYSTATEDYNAMICS": False,
    "FREQUENCY": False,
    "BUCKLE": False,
    "COMPLEXFREQUENCY": False,
    "GREEN": False,
    "CFD": False,
    "ELECTROMAGNETICS": False,
    "SUBSTRUCTUREGENERATE": False,
}
"""Cards that say what a step computes, and whether it is something that coulomb does."""

STEADY: Final = ("COUPLEDTEMPERATURE-DISPLACEMENT", "UNCOUPLEDTEMPERATURE-DISPLACEMENT")
"""Those that conduct heat beside, with the parameter STEADY STATE."""


class Tracks(Generic[Key]):
    """Tracks of what is given by cards, by any key.

    Attributes:
        all: Those so far, ended supports among them.
    """

    def __init__(self, support: bool):
        self._support = support
        self.all: list[tuple[Key, Track]] = []
        self._now: dict[Key, Track] = {}
        self._of_step: dict[Key, float] = {}

    def begin(self, step: Step) -> None:
        """Forget what the step before has given; what has an amplitude in total time goes on."""
        self._of_step = {}
        for track in self._now.values():
            if track.goes_on is not None:
                value, amplitude = track.goes_on
                track.goes_to(value, step, amplitude)

    def give(self, key: Key, value: float, step: Step, amplitude: Amplitude | None, model: bool = False) -> None:
        """A value in a step: loads of one step add up, supports replace each other."""
        if not self._support:
            value = self._of_step.get(key, 0.0) + value
        self._of_step[key] = value
        if key in self._now and math.isnan(self._now[key].value(step.begin)) and not math.isnan(value):
            self._now.pop(key).end = step.begin  # it moves again from where it was held
        if key not in self._now:
            self._now[key] = Track(begin=None if model or step.begin == 0.0 or not self._support else step.begin)
            self.all.append((key, self._now[key]))
        self._now[key].goes_to(value, step, amplitude)

    def begin_at(self, key: Key, time: float, value: float) -> None:
        """What something is before the first step that gives it."""
        self._now[key] = Track([(time, value)])
        self.all.append((key, self._now[key]))

    def hold(self, key: Key, step: Step) -> None:
        """*BOUNDARY, FIXED: what it has reached."""
        if key in self._now:
            self.give(key, self._now[key].value(step.begin), step, None)
        else:
            self.give(key, float("nan"), step, None)

    def drop(self, keep: set[Key], step: Step) -> None:
        """OP=NEW: what is not given in this step goes."""
        for key in [key for key in self._now if key not in keep]:
            if self._support and step.begin == 0.0:
                self.all = [(of, track) for of, track in self.all if track is not self._now[key]]
                del self._now[key]
            elif self._support:
                self._now.pop(key).end = step.begin
            elif self._now[key].value(step.begin) or self._now[key].goes_on:
                at_once = self._now[key].goes_on is not None
                self._now[key].goes_to(0.0, Step(step.number, step.card, [], step.begin, step.end, at_once))

    @property
    def given(self) -> set[Key]:
        """Keys that this step has given."""
        return set(self._of_step)
