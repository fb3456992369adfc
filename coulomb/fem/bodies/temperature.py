"""Temperature of a body: a load of its own kind, which causes thermal strain.

Stress = stiffness (strain - alpha (T - T0)).  The part of the temperature moves to the right-hand side as nodal forces
that add up to zero, and have no moment.  T varies over the cells as displacements do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ..geometry import Amplitude, Coefficient, evaluate_signed_numbers
from ..meshes import NamedMesh
from .body import ElasticBody

TEMPERATURE = "temperature_change"
"""Its name in solution.xdmf and summary.json."""


@dataclass(frozen=True)
class Temperature:
    """Temperature of a body at a time; this rank's k nodes.

    Attributes:
        change: Temperature minus that of the unstrained body in kelvin, shape (k,).
        reference: Temperature of the unstrained body, in kelvin or degrees Celsius.
        displacement: Scale of the displacements that it causes, metres (`ElasticBody.thermal_displacement`).
    """

    change: FloatArray
    reference: float
    displacement: float


@dataclass(frozen=True)
class ThermalLoad:
    """A temperature, from that of the unstrained body; `ContactProblem(temperature=...)` makes it.

    Attributes:
        temperature: In kelvin or degrees Celsius: a number, a function of x, or a `NodalField`.
        reference: Temperature of the unstrained body, in the same unit.
        amplitude: Factor of the difference as a function of time: a number, a function, a table or a `LoadCurve`.

    Raises:
        ValueError: If the reference, or a temperature that is no function, is not a finite number.
    """

    temperature: Coefficient
    reference: float = 0.0
    amplitude: Amplitude = 1.0

    kind = "thermal"
    face = None

    def __post_init__(self) -> None:
        given = {"reference_temperature": self.reference}
        if not callable(self.temperature):
            given["temperature"] = self.temperature
        for name, value in given.items():
            if isinstance(value, bool) or not isinstance(value, float | int) or not math.isfinite(value):
                raise ValueError(f"{name} must be a finite number in kelvin or degrees, but is {value!r}")

    def change(self, body: ElasticBody, mesh: NamedMesh) -> FloatArray:
        """Temperature minus reference at this rank's nodes at the factor 1, kelvin, shape (k,); ValueError on every
        rank if one is not finite, or a field does not cover the body; collective."""
        change: FloatArray = evaluate_signed_numbers(self.temperature, body.x, "temperature", mesh.comm)
        return change - self.reference


def range_of(change: FloatArray, comm: MPI.Comm) -> dict[str, float]:
    """Smallest and largest temperature change on all ranks, kelvin; collective."""
    return {
        "min": float(comm.allreduce(float(np.min(change, initial=math.inf)), op=MPI.MIN)),
        "max": float(comm.allreduce(float(np.max(change, initial=-math.inf)), op=MPI.MAX)),
    }


def shown_range(found: Mapping[str, float]) -> str:
    """A range in words, for lists of loads."""
    low, high = found["min"], found["max"]
    same = high - low <= 1e-9 * max(abs(low), abs(high))
    return f"temperature change {low:.6g} K" if same else f"temperature change from {low:.6g} to {high:.6g} K"


def joined_temperatures(parts: Sequence[Temperature | None], slices: Sequence[slice]) -> Temperature | None:
    """The temperatures of all bodies, with no change in those without; None if no body has one."""
    given = [part for part in parts if part is not None]
    if not given:
        return None
    change = np.zeros(slices[-1].stop)
    for part, nodes in zip(parts, slices, strict=True):
        if part is not None:
            change[nodes] = part.change
    return Temperature(change, given[0].reference, max(part.displacement for part in given))
