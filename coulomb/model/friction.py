"""Friction that depends on time and on the slip rate.

The coefficient of a load step is taken at the end of the step, with the slip rate of the step before: its slip over its
duration (semi-implicit).  So each step has Coulomb's law with a given coefficient per contact point, as without slip
rates; the coefficient lags by one step, an error that falls with the size of the steps.  In the first step, and without
load steps, the slip rate is 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray, is_number
from ..fem.geometry import Coefficient, evaluate_numbers


@runtime_checkable
class FrictionModel(Protocol):
    """A coefficient of friction by place, time and slip rate."""

    def coefficient(self, x: FloatArray, time: float, slip_rate: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F >= 0 at points, shape (k,); collective.

        Args:
            x: The points in metres, shape (k, 3).
            time: Of the end of the load step, seconds.
            slip_rate: In the load step before, metres per second, shape (k,).
            what: What the coefficient is called in errors.
            comm: The ranks.

        Raises:
            ValueError: On every rank, if a value fails, or is negative or not finite on any.
        """
        ...


@dataclass(frozen=True)
class SlipRateFriction:
    """F = kinetic + (static - kinetic) exp(-v / decay_speed) with the slip rate v: exponential decay.

    F is the same in all directions; orthotropic friction does not depend on the slip rate.

    Attributes:
        static: F without slip, >= 0; a number or a function of place.
        kinetic: F of fast slip, >= 0; smaller or larger than static.
        decay_speed: In metres per second, > 0.

    Raises:
        ValueError: If a number is out of its bounds.
    """

    static: Coefficient
    kinetic: Coefficient
    decay_speed: Coefficient

    def __post_init__(self) -> None:
        for name, value in (("static", self.static), ("kinetic", self.kinetic)):
            if not callable(value) and not is_number(value):
                raise ValueError(f"friction: {name} must be a number >= 0, but is {value}")
        if not callable(self.decay_speed) and not (is_number(self.decay_speed) and self.decay_speed > 0.0):
            raise ValueError(f"friction: decay_speed must be a number > 0 (m/s), but is {self.decay_speed}")

    def coefficient(self, x: FloatArray, time: float, slip_rate: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F at points x (k, 3), shape (k,), as `FrictionModel`."""
        static = evaluate_numbers(self.static, x, f"{what}: static", comm)
        kinetic = evaluate_numbers(self.kinetic, x, f"{what}: kinetic", comm)
        speed = evaluate_numbers(self.decay_speed, x, f"{what}: decay_speed", comm)
        ratio = np.divide(slip_rate, speed, out=np.where(slip_rate > 0.0, np.inf, 0.0), where=speed > 0.0)
        friction: FloatArray = kinetic + (static - kinetic) * np.exp(-ratio)
        return friction


@dataclass(frozen=True)
class VariableFriction:
    """F as a function of place, time and slip rate.

    Attributes:
        function: Of x, shape (3, k), in metres, the time in seconds, and the slip rates (k,) of the load step before in
            metres per second; returns k numbers >= 0.
    """

    function: Callable[[FloatArray, float, FloatArray], FloatArray]

    def coefficient(self, x: FloatArray, time: float, slip_rate: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F at points x (k, 3), shape (k,), as `FrictionModel`."""
        return evaluate_numbers(lambda points: self.function(points, time, slip_rate.copy()), x, what, comm)
