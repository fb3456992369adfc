"""Loads of a body: on faces (traction, pressure, total force), and in its volume (body force, weight).

All are integrated on the undeformed body: a pressure keeps the direction of the undeformed face's normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ..geometry import (
    Amplitude,
    Coefficient,
    Field,
    evaluate_amplitude,
    evaluate_signed_numbers,
    evaluate_vectors,
    on_all_ranks,
)
from ..meshes import NamedMesh
from .displacement_space import DisplacementSpace
from .materials import Materials, density_of_cells
from .orthotropic import three


@dataclass(frozen=True)
class NodalForces:
    """Forces on the body at this rank's k nodes, of one load, support or spring.

    Attributes:
        kind: "traction", "body_force", "clamp", "spring", ...: a word, as in the files.
        face: Where it acts; None for the whole body.
        forces: In newtons, shape (k, 3).
    """

    kind: str
    face: str | None
    forces: FloatArray


class Timed(Protocol):
    """What a load is called, and its factor in time."""

    @property
    def kind(self) -> str: ...

    @property
    def face(self) -> str | None:
        """Name of the face; None for a load in the volume."""
        ...

    @property
    def amplitude(self) -> Amplitude:
        """Factor as a function of time."""
        ...


class Load(Timed, Protocol):
    """A load: a kind, perhaps a face, an amplitude, and nodal forces."""

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        """Nodal forces in newtons at the factor 1, this rank's nodes, shape (k, 3); ValueError on every rank if the
        face is unknown, or a value is not finite on any; collective."""
        ...


@dataclass(frozen=True)
class Traction:
    """Surface load on a face.

    Attributes:
        face: Name of the face.
        value: Traction in pascals, a vector or a function of x.
        amplitude: Factor of the value as a function of time: a number, a function, a table or a `LoadCurve`.
    """

    face: str
    value: Field
    amplitude: Amplitude = 1.0

    kind = "traction"

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        facets, values = mesh.facets(self.face, self.kind), np.zeros_like(body.x)
        nodes = body.nodes_of(facets)
        values[nodes] = evaluate_vectors(self.value, body.x[nodes], named(self), mesh.comm)
        return body.surface_load(values, facets)


@dataclass(frozen=True)
class Pressure:
    """Pressure normal to a face, plane or curved.

    It acts along the inward normal of each facet of the undeformed mesh, and does not follow the deformation.

    Attributes:
        face: Name of the face.
        value: Pressure in pascals, positive where it presses on the body; a number or a function of x.
        amplitude: Factor of the value as a function of time: a number, a function, a table or a `LoadCurve`.
    """

    face: str
    value: Coefficient
    amplitude: Amplitude = 1.0

    kind = "pressure"

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        facets, values = mesh.facets(self.face, self.kind), np.zeros(len(body.x))
        nodes = body.nodes_of(facets)
        values[nodes] = evaluate_signed_numbers(self.value, body.x[nodes], named(self), mesh.comm)
        return body.pressure_load(values, facets)


@dataclass(frozen=True)
class TotalForce:
    """A force on a face, spread as a uniform traction over its area.

    Attributes:
        face: Name of the face.
        force: Force in newtons, shape (3,).
        amplitude: Factor of the force as a function of time: a number, a function, a table or a `LoadCurve`.

    Raises:
        ValueError: If the force has not three finite components.
    """

    face: str
    force: Sequence[float]
    amplitude: Amplitude = 1.0

    kind = "total force"

    def __post_init__(self) -> None:
        three(self.force, f"{named(self)}: the force", "numbers, newtons")

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        area = body.area_of(mesh.facets(self.face, self.kind))
        whole = mesh.comm.allreduce(float(area.sum()), op=MPI.SUM)
        nodal: FloatArray = area[:, None] / whole * np.asarray(self.force, dtype=np.float64)
        return nodal


@dataclass(frozen=True)
class BodyForce:
    """Force per volume in N/m^3, a vector or a function of x."""

    value: Field
    amplitude: Amplitude = 1.0

    kind = "body_force"
    face = None

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        return body.volume_load(evaluate_vectors(self.value, body.x, named(self), mesh.comm))


@dataclass(frozen=True)
class Weight:
    """Weight of the body: its density times the acceleration of gravity (3,) in m/s^2; ValueError if this is not
    finite."""

    gravity: Sequence[float]
    materials: Materials
    amplitude: Amplitude = 1.0

    kind = "gravity"
    face = None

    def __post_init__(self) -> None:
        three(self.gravity, "gravity", "numbers, m/s^2, for example (0, 0, -9.81)")

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        density = density_of_cells(mesh, self.materials)
        return body.weight(density, np.asarray(self.gravity, dtype=np.float64))


@dataclass(frozen=True)
class AppliedLoad:
    """A load on a mesh: its nodal forces in newtons at the factor 1, shape (k, 3), and its size in words, where forces
    do not show it."""

    load: Timed
    nodal_force: FloatArray
    size: str = ""

    def at(self, time: float, comm: MPI.Comm) -> FloatArray:
        """Nodal forces at a time in newtons, shape (k, 3); ValueError on every rank if the amplitude is not finite;
        collective."""
        load = self.load
        factor = on_all_ranks(lambda: evaluate_amplitude(load.amplitude, time, named(load)), "", comm)
        return factor * self.nodal_force


def named(load: Timed) -> str:
    return load.kind if load.face is None else f"{load.kind} on {load.face!r}"


def vanishes(value: Field) -> bool:
    return not callable(value) and np.shape(value) == (3,) and not np.any(np.asarray(value, dtype=np.float64))
