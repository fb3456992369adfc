"""A body with everything that acts on it except the foundation: supports and loads as functions of time; without K."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ..compat import fem, ufl
from ..geometry import Amplitude, Field, evaluate_amplitude, on_all_ranks
from ..meshes import NamedMesh
from .body import STRESSES, ElasticBody
from .constraints import prescribed_rows
from .contradictions import SupportedNodes, contradictions
from .deformable import Loading
from .free_motions import FreeMotions, free_motions
from .held_space import HeldSpace
from .loads import AppliedLoad, BodyForce, Load, NodalForces, Weight, vanishes
from .materials import Materials, material_of_cells
from .mesh_components import mesh_components
from .orthotropic import VECTORS
from .rigid_modes import component_modes, rigid_modes
from .supported_face import SupportedFace
from .supports import Spring, Support
from .temperature import Temperature, ThermalLoad, range_of, shown_range

_KINDS = {
    "clamps": ("directions", "Clamp, PrescribedDisplacement, PrescribedRotation or SymmetryPlane"),
    "springs": ("along_axes", "Spring"),
    "tractions": ("nodal_force", "Traction, Pressure or TotalForce"),
}
"""Arguments of a body, what their entries have, and which types these are."""


class LoadedBody(ElasticBody, HeldSpace):
    """An elastic body with its supports, springs and loads; `at` gives the loading at a time.

    Where supports meet, the later one applies; `thermal` is its temperature, None without one.

    Raises:
        ValueError: If a face is unknown, a value not finite, a cell without a material or with two, no density under
            gravity.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        materials: Materials,
        clamps: Sequence[Support],
        tractions: Sequence[Load] = (),
        body_force: Field = (0.0, 0.0, 0.0),
        springs: Sequence[Spring] = (),
        body_force_amplitude: Amplitude = 1.0,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        gravity_amplitude: Amplitude = 1.0,
        thermal: ThermalLoad | None = None,
    ):
        refuse_others(clamps=clamps, springs=springs, tractions=tractions)
        super().__init__(mesh.domain, material_of_cells(mesh, materials, thermal is not None))
        self.mesh = mesh
        self.materials: Materials | None = materials
        self.supports = tuple(clamps)
        self._prescribe()
        self._support(springs)
        volume: list[Load] = [] if vanishes(body_force) else [BodyForce(body_force, body_force_amplitude)]
        volume += [] if vanishes(gravity) else [Weight(gravity, materials, gravity_amplitude)]
        self.thermal, heat = thermal, []
        if thermal is not None:
            self._temperature_change = thermal.change(self, mesh)
            self._thermal_displacement = self.thermal_displacement(self._temperature_change)
            size = shown_range(range_of(self._temperature_change, mesh.comm))
            heat = [AppliedLoad(thermal, self.thermal_force(self._temperature_change), size)]
        in_volume, on_faces = (
            [AppliedLoad(load, load.nodal_force(self, mesh)) for load in loads] for loads in (volume, tractions)
        )
        self.loads = (*in_volume, *heat, *on_faces)
        self._stiffen()

    def _stiffen(self) -> None:
        """Make the stiffness, of a body that has one."""

    def at(self, time: float) -> Loading:
        load = np.zeros((self._owned, 3))
        for part in self.loads_at(time):
            load += part.forces
        factors = [self._factor(support.amplitude, time, support.what) for support in self.supports]
        prescribed = self._rows.displacement(np.array([0.0, *factors])[1 + self._rows.support] * self._values)
        return Loading(time, load, prescribed, self._temperature_at(time))

    def blocked_displacement(self, loading: Loading) -> float:
        return 0.0 if loading.temperature is None else loading.temperature.displacement

    def loads_at(self, time: float) -> Iterator[NodalForces]:
        """The forces of every load by itself at a time; ValueError on every rank if an amplitude has no finite value;
        collective."""
        for applied in self.loads:
            load = applied.load
            yield NodalForces(load.kind.replace(" ", "_"), load.face, applied.at(time, self.mesh.comm))

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        return self.loads_at(loading.time)

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        """Integrals of stiffness times displacement over the faces; see `Deformable`."""
        for spring, form in zip(self.springs, self._spring_forms, strict=True):
            self._sprung_by.x.array[: 3 * self._owned] = u.ravel()
            self._sprung_by.x.scatter_forward()
            yield NodalForces("spring", spring.face, -self._assemble(form))

    def _temperature_at(self, time: float) -> Temperature | None:
        if self.thermal is None:
            return None
        factor = self._factor(self.thermal.amplitude, time, "temperature")
        displacement = abs(factor) * self._thermal_displacement
        return Temperature(factor * self._temperature_change, self.thermal.reference, displacement)

    def _factor(self, amplitude: Amplitude, time: float, what: str) -> float:
        return on_all_ranks(lambda: evaluate_amplitude(amplitude, time, what), "", self.mesh.comm)

    def _prescribe(self) -> None:
        given = [self._supported_nodes(support) for support in self.supports]
        self._rows = prescribed_rows(self._owned, [(one.nodes, one.directions) for one in given])
        self.held = self._rows.held
        self._values = np.zeros(len(self._rows.node))
        for number, one in enumerate(given):
            here = self._rows.support == number
            values = one.displacement[np.searchsorted(one.nodes, self._rows.node[here])]
            self._values[here] = np.einsum("ri,ri->r", self._rows.direction[here], values)
        self.contradictions = contradictions(given, self._rows, self._values, self.x, self.mesh.comm)

    def _supported_nodes(self, support: Support) -> SupportedNodes:
        face = self._supported_face(support)
        return SupportedNodes(support, face.nodes, support.directions(face), support.displacement(face))

    def _supported_face(self, support: Support) -> SupportedFace:
        nodes = self.nodes(support.face, support.kind)
        facets = self.mesh.facets(support.face, support.kind)

        def integrals() -> tuple[FloatArray, FloatArray]:
            area, normal = self.positive_weights(facets)
            return area[nodes], normal[nodes]

        return SupportedFace(nodes, self.x[nodes], self.mesh.comm, integrals)

    def _support(self, springs: Sequence[Spring]) -> None:
        self.springs, self._sprung_by = tuple(springs), fem.Function(self.V)
        self._spring_forms = [fem.form(self.spring_form(spring, self._sprung_by)) for spring in springs]

    def spring_form(self, spring: Spring, u: Any) -> Any:
        """UFL's form of the integral over its face of a spring's stiffness times u, a Function or trial function."""
        stiffness = fem.Constant(self.domain, np.array(spring.along_axes))
        sprung = ufl.as_vector([stiffness[k] * u[k] for k in range(3)])
        return ufl.inner(sprung, self._test) * self.measure(self.mesh.facets(spring.face, "spring"))

    @cached_property
    def free(self) -> FreeMotions:
        """The rigid motions that supports and springs allow: along axes with springs whatever their stiffness, nothing
        moves."""
        sprung = np.zeros((self._owned, 3))
        for spring in self.springs:
            sprung[np.ix_(self.nodes(spring.face, "spring"), spring.along_axes > 0.0)] = 1.0
        count = self.mesh.comm.allreduce(self.held.number + float(sprung.sum()), op=MPI.SUM)
        component = mesh_components(self)
        modes, _ = component_modes(self.x, component, self.mesh.comm)
        return self._motions_without(component, modes, sprung[:, :, None] * modes, 1e-10 * max(count, 1.0))

    def _motions_without(
        self, component: npt.NDArray[np.int64], modes: FloatArray, forces: FloatArray, limit: float
    ) -> FreeMotions:
        """The rigid motions of size 1 without energy, by forces (k, 3, 6) of the `component_modes` and held nodes."""
        against = forces + self.held_part(modes)
        return free_motions(self.x, component, against, limit, self.anchor_places, self.mesh.comm)

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        shares = self._rows.shares(reaction, len(self.supports))
        for support, share in zip(self.supports, shares, strict=True):
            yield NodalForces(support.kind.replace(" ", "_"), support.face, share)

    def spring_force(self, u: FloatArray) -> FloatArray:
        total = np.zeros_like(u)
        for one in self.spring_forces(u):
            total += one.forces
        return total

    @cached_property
    def ground(self) -> FloatArray | None:
        if not self.springs:
            return None
        modes = rigid_modes(self.x, self.mesh.comm)
        return -np.stack([self.spring_force(modes[:, :, k]) for k in range(6)], axis=2)

    def supports_understood(self) -> list[dict[str, Any]]:
        supports = [{"kind": support.kind, "face": support.face, "holds": support.holds} for support in self.supports]
        return supports + [{"kind": "spring", "face": spring.face, "holds": spring.holds} for spring in self.springs]

    def cell_fields(self, u: Any, loading: Loading) -> list[Any]:
        change = None if loading.temperature is None else loading.temperature.change
        return [*self.stresses(u, change), *self.constants.values()]

    @property
    def numbers_per_cell(self) -> int:
        return len(STRESSES) + sum(3 if name in VECTORS else 1 for name in self.constants)


def refuse_others(**arguments: object) -> None:
    """Raises ValueError unless each argument is a list of what belongs there."""
    for name, given in arguments.items():
        has, types = _KINDS[name]
        if not isinstance(given, Iterable):
            raise ValueError(f"{name} must be a list of {types}, but is {given!r}")
        for entry in given:
            if not hasattr(entry, has):
                raise ValueError(f"{name} must be a list of {types}, but an entry is {entry!r}")
