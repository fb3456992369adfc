"""Loads of a body: on faces (traction, pressure, total force), and in its volume (body force, weight).

All are integrated on the undeformed body: a pressure keeps the direction of the undeformed face's normal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, Int32Array, is_number, short
from .. import compat
from ..geometry import (
    Amplitude,
    Coefficient,
    Field,
    evaluate_amplitude,
    evaluate_signed_numbers,
    evaluate_vectors,
    of_place,
    on_all_ranks,
)
from ..meshes import NamedMesh, NodalField, functions_of_nodes, lagrange_points
from .body import ElasticBody
from .displacement_space import DisplacementSpace
from .materials import Materials, constant_of_cells, three
from .rigid_modes import displacements_of


@dataclass(frozen=True, eq=False)
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
        values[nodes] = evaluate_vectors(self.value, body.x[nodes], load_title(self), mesh.comm)
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
        facets = mesh.facets(self.face, self.kind)
        return body.pressure_load(self.nodal_values(body, facets), facets)

    def nodal_values(self, body: DisplacementSpace, facets: Int32Array) -> FloatArray:
        """The pressure at this rank's nodes of the facets, 0 at others, pascals, shape (k,); errors as of
        `nodal_force`; collective."""
        values, nodes = np.zeros(len(body.x)), body.nodes_of(facets)
        values[nodes] = evaluate_signed_numbers(self.value, body.x[nodes], load_title(self), body.comm)
        return values


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
        three(self.force, f"{load_title(self)}: the force", "numbers, newtons")

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        area = body.area_of(mesh.facets(self.face, self.kind))
        whole = mesh.comm.allreduce(float(area.sum()))
        return area[:, None] / (mesh.copies * whole) * np.asarray(self.force, dtype=np.float64)


@dataclass(frozen=True)
class PointLoad:
    """A force and a moment at a reference point, spread over a face as a traction that is linear in place.

    It does not stiffen the face, as a `RigidFace` does.  In large motions the point moves with the face, by the rigid
    motion that is nearest to that of its nodes; force and moment keep their directions in space.

    Attributes:
        face: Name of the face.
        force: Force in newtons, shape (3,).
        moment: Moment about the point in newton metres, shape (3,).
        point: The reference point in metres; by default the middle of the face.
        amplitude: Factor of both as a function of time: a number, a function, a table or a `LoadCurve`.

    Raises:
        ValueError: If force, moment or point have not three finite components.
    """

    face: str
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    point: Sequence[float] | None = None
    amplitude: Amplitude = 1.0

    kind = "point load"

    def __post_init__(self) -> None:
        three(self.force, f"{load_title(self)}: the force", "numbers, newtons")
        three(self.moment, f"{load_title(self)}: the moment", "numbers, newton metres")
        if self.point is not None:
            three(self.point, f"{load_title(self)}: the point", "numbers, metres")

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        return self.turned(self.units(body, mesh), np.eye(3))

    def units(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        """Nodal forces of unit forces along x, y and z at the point, and unit moments, shape (k, 3, 6); collective."""
        facets, comm = mesh.facets(self.face, self.kind), mesh.comm
        middle, point = replace(self, point=None).acts_at(body, mesh), self.acts_at(body, mesh)
        modes = displacements_of(body.x - middle, np.ones(len(body.x)))
        parts = np.array([body.surface_load(mode, facets) for mode in np.moveaxis(modes, 2, 0)])
        resultants = comm.allreduce(np.einsum("pki,kij->pj", parts, modes))
        about_middle = np.eye(6)
        about_middle[3:, :3] = np.cross(point - middle, np.eye(3)).T
        amounts = np.linalg.solve(resultants.T, about_middle)
        return np.einsum("pj,pki->kij", amounts / mesh.copies, parts)

    def acts_at(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        """The point, metres, shape (3,); collective."""
        if self.point is not None:
            return np.array(self.point, dtype=np.float64)
        area = body.area_of(mesh.facets(self.face, self.kind))
        sums: FloatArray = mesh.comm.allreduce(np.append(area @ body.x, area.sum()))
        return sums[:3] / sums[3]

    def turned(self, units: FloatArray, R: FloatArray) -> FloatArray:
        """The nodal forces in newtons of `units` (k, 3, 6) on a face that has turned by R (3, 3), shape (k, 3)."""
        given = np.concatenate([self.force @ R, self.moment @ R])
        return units @ given @ R.T


@dataclass(frozen=True)
class NodalForce:
    """A force at every one of some nodes.

    Attributes:
        face: Name of a set of nodes of the mesh, or of a face, all of whose nodes have the force.
        force: Force at each in newtons, shape (3,), or (q, 3) with numbers.
        amplitude: Factor of the force as a function of time: a number, a function, a table or a `LoadCurve`.
        numbers: Of all nodes of the set in the mesh file, each with a force of its own, shape (q,).

    Raises:
        ValueError: If the force has not three finite components.
    """

    face: str
    force: Sequence[float] | Sequence[Sequence[float]]
    amplitude: Amplitude = 1.0
    numbers: Sequence[int] | None = None

    kind = "nodal force"

    def __post_init__(self) -> None:
        for force in (self.force,) if self.numbers is None else self.force:
            three(force, f"{load_title(self)}: the force", "numbers, newtons")

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        points, given, forces = mesh.node_sets.get(self.face), np.asarray(self.force, dtype=np.float64), body.x * 0.0
        if points is None:
            nodes = body.nodes_of(mesh.facets(self.face, self.kind))
        elif self.numbers is None:
            nodes = body.nodes_at(points)
        else:
            points = points[body.node_of_point[points] >= 0]
            nodes, given = body.node_of_point[points], given[mesh.rows_of(self.numbers)[points]]
        forces[nodes] = mesh.shares_at(body.x[nodes])[:, None] * given
        return forces


@dataclass(frozen=True)
class BodyForce:
    """Force per volume in N/m^3, a vector or a function of x."""

    value: Field
    amplitude: Amplitude = 1.0

    kind = "body_force"
    face = None

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        return body.volume_load(evaluate_vectors(self.value, body.x, load_title(self), mesh.comm))


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
        density = constant_of_cells(mesh, self.materials, "density")
        return body.volume_load(np.broadcast_to(np.asarray(self.gravity, dtype=np.float64), body.x.shape), density)


@dataclass(frozen=True)
class VolumeForce:
    """Force in the volume of some cells.

    Attributes:
        value: Per volume in N/m^3, a vector or a function of x.
        amplitude: Factor as a function of time.
    """

    face: str
    value: Field
    amplitude: Amplitude = 1.0

    kind = "volume force"

    def nodal_force(self, body: DisplacementSpace, mesh: NamedMesh) -> FloatArray:
        inside = np.zeros(mesh.domain.topology.index_map(3).size_local)
        inside[mesh.group(self.face, self.kind)] = 1.0
        return body.volume_load(evaluate_vectors(self.value, body.x, load_title(self), mesh.comm), inside)


@dataclass(frozen=True, eq=False)
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
        factor = on_all_ranks(lambda: evaluate_amplitude(load.amplitude, time, load_title(load)), "", comm)
        return factor * self.nodal_force


def load_title(load: Timed) -> str:
    return load.kind if load.face is None else f"{load.kind} on {load.face!r}"


def vanishes(value: Field) -> bool:
    return not of_place(value) and np.asarray(value).shape == (3,) and not np.any(np.asarray(value))


TEMPERATURE = "temperature_change"
"""Its name in solution.xdmf and summary.json."""


@dataclass(frozen=True, eq=False)
class Temperature:
    """Temperature of a body at a time; this rank's k nodes.

    Attributes:
        change: Temperature minus that of the unstrained body in kelvin, shape (k,).
        reference: Temperature of the unstrained body, in kelvin or degrees Celsius.
        displacement: Scale of the displacements that it causes, metres (`ElasticBody.thermal_displacement`).
        nodal_force: Of one that follows from conduction (`Deformable.heated`), the forces that cause its strain,
            newtons, shape (k, 3); None of one that is given.
    """

    change: FloatArray
    reference: float
    displacement: float
    nodal_force: FloatArray | None = None


@dataclass(frozen=True)
class NodeTemperatures:
    """Temperatures of nodes of the mesh file, in kelvin or degrees Celsius.

    In cells of second order that are those of the file, as 10-node tetrahedra and 20-node hexahedra, they are of second
    order, in others linear between the corners.

    Attributes:
        others: That of all other nodes.
        given: Nodes, as the name of a set or of a group of cells, or some numbers in the file, and their temperature.
            Of a node that is given twice the last one counts.
    """

    others: float
    given: tuple[tuple[str | tuple[int, ...], float], ...]

    def at_nodes(self, body: ElasticBody, mesh: NamedMesh) -> FloatArray:
        """Those at this rank's nodes, shape (k,); ValueError on every rank if the mesh has no such set or number;
        collective."""
        cell, comm, on = body.domain.topology.cell_type, mesh.comm, compat.cell_geometry(body.domain)
        numbers = (
            np.zeros(len(body.domain.geometry.x), dtype=np.int64) if mesh.node_numbers is None else mesh.node_numbers
        )
        at_points = np.full(len(numbers), self.others)
        singly: dict[int, float] = {}
        for nodes, value in self.given:
            if not isinstance(nodes, str):
                singly.update((node, value) for node in nodes)
            elif nodes in mesh.node_sets:
                at_points[mesh.node_sets[nodes]] = value
            elif nodes in mesh.cells:
                at_points[on[mesh.cells[nodes]]] = value
            else:
                known = ", ".join(map(repr, (*mesh.node_sets, *mesh.cells))) or "none at all"
                raise ValueError(f"temperature: there is no set of nodes or group of cells {nodes!r}; there is {known}")
        if singly:
            asked = np.array(list(singly))
            row = np.full(len(numbers), -1) if mesh.node_numbers is None else mesh.rows_of(asked)
            at_points[row >= 0] = np.array(list(singly.values()))[row[row >= 0]]
            if len(missing := asked[comm.allreduce(np.bincount(row[row >= 0], minlength=len(asked))) == 0]):
                raise ValueError(f"temperature: no cell of the mesh file has a node of the number {missing[0]}")
        widths = (count for count in (27, 20, 10) if count <= on.shape[1])
        whole = (w for w in widths if comm.allreduce(bool(np.all(numbers[on[:, :w]] > 0)), op=MPI.LAND))
        count = next(whole, len(lagrange_points(cell, 1)))
        between = functions_of_nodes(cell, count, lagrange_points(cell, body.degree))
        dofs, values = compat.cell_dofs(body.V), np.full(len(body.x), self.others)
        mine = dofs < len(body.x)
        values[dofs[mine]] = (at_points[on[:, :count]] @ between.T)[mine]
        return values


Temperatures = Coefficient | NodeTemperatures


@dataclass(frozen=True)
class ThermalLoad:
    """A temperature, from that of the unstrained body; `ContactProblem(temperature=...)` makes it.

    Attributes:
        temperature: In kelvin or degrees Celsius: a number, a function of x, a `NodalField`, or `NodeTemperatures`.
        reference: Temperature of the unstrained body, in the same unit.
        amplitude: Factor of the difference as a function of time: a number, a function, a table or a `LoadCurve`.

    Raises:
        ValueError: If the reference, or a temperature that is no function, is not a finite number.
    """

    temperature: Temperatures
    reference: float = 0.0
    amplitude: Amplitude = 1.0

    kind = "thermal"
    face = None

    def __post_init__(self) -> None:
        given: dict[str, object] = {"reference_temperature": self.reference}
        if isinstance(self.temperature, NodeTemperatures):
            given |= {"temperature": self.temperature.others}
        elif not of_place(self.temperature):
            given["temperature"] = self.temperature
        for name, value in given.items():
            if isinstance(value, bool) or not is_number(value, -math.inf):
                raise ValueError(f"{name} must be a finite number in kelvin or degrees, but is {short(value)}")

    def change(self, body: ElasticBody, mesh: NamedMesh) -> FloatArray:
        """Temperature minus reference at this rank's nodes at the factor 1, kelvin, shape (k,); ValueError on every
        rank if one is not finite, or a field does not cover the body; collective."""
        field, inside = self.temperature, body.in_a_cell()
        if isinstance(field, NodeTemperatures):
            return field.at_nodes(body, mesh) - self.reference
        given = (lambda x: field.at_nodes(x.T, inside)) if isinstance(field, NodalField) else field
        change: FloatArray = evaluate_signed_numbers(given, body.x, "temperature", mesh.comm)
        return change - self.reference


def range_of(change: FloatArray, comm: MPI.Comm) -> dict[str, float]:
    """Smallest and largest temperature change on all ranks, kelvin; collective."""
    return {
        "min": float(comm.allreduce(float(np.min(change, initial=math.inf)), op=MPI.MIN)),
        "max": float(comm.allreduce(float(np.max(change, initial=-math.inf)), op=MPI.MAX)),
    }


def shown_range(ends: Mapping[str, float]) -> str:
    """A range in words, for lists of loads."""
    low, high = ends["min"], ends["max"]
    same = high - low <= 1e-9 * max(abs(low), abs(high))
    return f"temperature change {low:.6g} K" if same else f"temperature change from {low:.6g} to {high:.6g} K"


@dataclass(frozen=True, eq=False)
class Loading:
    """Loads and prescribed displacements of a body at a time; this rank's k nodes.

    Attributes:
        load: Nodal forces of all loads in newtons, shape (k, 3).
        prescribed: Prescribed displacements in metres, 0 elsewhere, shape (k, 3).
        temperature: None for a body without.
        parts: Of several bodies, the loading of each, in their order.
        apart: By how much tied nodes are prescribed to be apart from what they follow, by own unknowns of the ties that
            are prescribed as well, metres, shape (k, 3).
        tension: The forces of bolts along own unknowns, newtons; None without bolts.
    """

    time: float
    load: FloatArray
    prescribed: FloatArray
    temperature: Temperature | None = None
    parts: tuple[Loading, ...] = ()
    apart: FloatArray | float = 0.0
    tension: FloatArray | None = None


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
