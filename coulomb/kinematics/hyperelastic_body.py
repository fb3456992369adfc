"""A hyperelastic body from a mesh, materials, supports and loads, as of small strains."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from operator import add
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from ..arrays import FloatArray
from ..fem import compat
from ..fem.bodies import (
    Load,
    LoadedBody,
    Loading,
    Materials,
    NodalForces,
    PrescribedRotation,
    Pressure,
    Spring,
    Support,
    by_group,
    cell_measure,
)
from ..fem.compat import fem, ufl
from ..fem.geometry import Amplitude, Field, evaluate_amplitude
from ..fem.meshes import NamedMesh
from .hyperelastic import hyperelastic, invariants
from .nonlinear_body import NonlinearBody

_NOTHING = (0.0, 0.0, 0.0)


class _Acting(LoadedBody):
    """Supports, springs and dead loads; prescribed rotations turn by finite angles."""

    def prescribed_values(self, time: float) -> FloatArray:
        values = super().prescribed_values(time)
        for number, support in enumerate(self.supports):
            if isinstance(support, PrescribedRotation):
                here, axis = self._rows.support == number, np.array(support.axis) / np.linalg.norm(support.axis)
                angle = support.angle * self._factor(support.amplitude, time, support.what)
                arms = self.x[self._rows.node[here]] - np.array(support.point)
                way = Rotation.from_rotvec(angle * axis).apply(arms) - arms if len(arms) else arms
                values[here] = np.einsum("ri,ri->r", self._rows.direction[here], way)
        return values


class HyperelasticBody(NonlinearBody):
    """A body of hyperelastic materials on a mesh.

    Tractions and total forces keep their direction and are per undeformed area (dead loads), pressures follow the
    surface; prescribed rotations are finite.

    Args:
        As of `Elasticity`; materials are `NeoHookean`, `MooneyRivlin`, `Ogden`, `StVenantKirchhoff`, or `Material`,
        which becomes the last of these.

    Raises:
        ValueError: As `Elasticity`; if there is a temperature, or a material of another kind.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        materials: Materials,
        clamps: Sequence[Support] = (),
        tractions: Sequence[Load] = (),
        body_force: Field = _NOTHING,
        springs: Sequence[Spring] = (),
        body_force_amplitude: Amplitude = 1.0,
        gravity: Sequence[float] = _NOTHING,
        gravity_amplitude: Amplitude = 1.0,
        thermal: Any = None,
    ):
        if thermal is not None:
            raise ValueError("temperature: large motions have no thermal strains yet; leave it out")
        laws = [(group, hyperelastic(material)) for group, material in by_group(materials)]
        several = isinstance(materials, Mapping)
        materials = {str(group): law for group, law in laws} if several else laws[0][1]
        self._follow = [load for load in tractions if isinstance(load, Pressure)]
        dead = [load for load in tractions if not isinstance(load, Pressure)]
        self._loaded = loaded = _Acting(
            *(mesh, materials, clamps, dead, body_force, springs, body_force_amplitude, gravity, gravity_amplitude)
        )
        u, v, w = fem.Function(loaded.V, name="displacement"), ufl.TestFunction(loaded.V), ufl.TrialFunction(loaded.V)
        F, dx = ufl.Identity(3) + ufl.grad(u), cell_measure(loaded.domain)
        # derivatives by the invariants q: terms are then as many as these, however long the law is
        q, J = invariants(F), ufl.det(F)
        known = [ufl.variable(one) for one in q]
        density = self._density(laws, known)
        by_q = [ufl.diff(density, one) for one in known]
        rates = [ufl.derivative(one, u, v) for one in q]
        inside = sum(a * rate for a, rate in zip(by_q, rates, strict=True)) * dx
        tangent = sum(
            ufl.diff(a, other) * rate * ufl.derivative(of, u, w)
            for a, rate in zip(by_q, rates, strict=True)
            for other, of in zip(known, q, strict=True)
        )
        tangent += sum(a * ufl.derivative(rate, u, w) for a, rate in zip(by_q, rates, strict=True))
        gradient = ufl.variable(F)
        stress = sum(a * ufl.diff(one, gradient) for a, one in zip(by_q, invariants(gradient), strict=True))
        self._cauchy = stress * F.T / J
        faces = [mesh.facets(load.face, load.kind) for load in self._follow]
        faces += [mesh.facets(spring.face, "spring") for spring in springs]
        on = _surfaces(loaded, faces)
        normal = J * ufl.inv(F).T * ufl.FacetNormal(loaded.domain)
        self._factors = [fem.Constant(loaded.domain, 0.0) for _ in self._follow]
        pressures = [
            on(k, factor * self._value(load, faces[k]) * ufl.inner(normal, v))
            for k, (load, factor) in enumerate(zip(self._follow, self._factors, strict=True))
        ]
        energy = density * dx
        on_faces = list(pressures)
        for number, spring in enumerate(springs, len(self._follow)):
            stiffness = fem.Constant(loaded.domain, np.array(spring.along_axes))
            sprung = on(number, sum(0.5 * stiffness[i] * u[i] ** 2 for i in range(3)))
            energy += sprung
            on_faces.append(ufl.derivative(sprung, u, v))
        super().__init__(
            residual=reduce(add, on_faces, inside),
            tangent=reduce(add, (ufl.derivative(one, u, w) for one in on_faces), tangent * dx),
            displacement=u,
            faces=mesh,
            update=self._at_time,
        )
        self._energy = fem.form(ufl.replace(energy, {u: self._function}))
        self._pressure_forms = [fem.form(ufl.replace(-one, {u: self._function})) for one in pressures]
        self.held, self.contradictions = loaded.held, loaded.contradictions
        self.materials, self.loads = materials, loaded.loads

    def _density(self, laws: Sequence[tuple[str | None, Any]], of: Sequence[Any]) -> Any:
        """Strain energy per undeformed volume: the sum of those of all laws, each 0 in the cells of others."""
        loaded, found = self._loaded, 0.0
        count = loaded.domain.topology.index_map(3).size_local
        kinds = [(type(material), getattr(material, "alpha", ())) for _, material in laws]
        for kind in dict.fromkeys(kinds):
            mine = [law for law, of in zip(laws, kinds, strict=True) if of == kind]
            values = {name: np.zeros(count) for name in mine[0][1].constants}
            for group, material in mine:
                cells: Any = slice(None) if group is None else loaded.mesh.group(group, "material")
                for name, value in material.constants.items():
                    values[name][cells] = value
            found += mine[0][1].energy(of, *(loaded._on_cells(one, name) for name, one in values.items()))
        return found

    def _value(self, load: Pressure, facets: npt.NDArray[np.int32]) -> Any:
        """The pressure at amplitude 1, a scalar of UFL, from its nodal values."""
        values = load.nodal_values(self._loaded, facets)
        return self._loaded.function(np.repeat(values[:, None], 3, axis=1), "pressure")[0]

    def _at_time(self, time: float) -> None:
        for factor, load in zip(self._factors, self._follow, strict=True):
            factor.value = evaluate_amplitude(load.amplitude, time, f"pressure on {load.face!r}")

    def _acting(self, u: FloatArray, time: float) -> tuple[Loading, FloatArray | None, FloatArray]:
        inside, *_ = super()._acting(u, time)
        dead, load = self._loaded.at(time), sum((one.forces for one in self._following()), np.zeros_like(u))
        spring = self._loaded.spring_force(u)
        return Loading(time, inside.load + dead.load, dead.prescribed), dead.load + load, spring

    def _following(self) -> Iterator[NodalForces]:
        """The forces of pressures at the present displacement."""
        self._evaluate_at(self._displacement.x.array[: self.reference.size])
        for load, form in zip(self._follow, self._pressure_forms, strict=True):
            yield NodalForces("pressure", load.face, self._assemble(form))

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        yield from self._loaded.loads_at(loading.time)
        yield from self._following()

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        return self._loaded.shares(reaction)

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        return self._loaded.spring_forces(u)

    def supports_understood(self) -> list[dict[str, Any]]:
        return self._loaded.supports_understood()

    def forms(self) -> None:
        return None

    def strain_energy(self, u: FloatArray) -> float:
        self._evaluate_at(u)
        return float(self.comm.allreduce(fem.assemble_scalar(self._energy)))

    def cell_fields(self, u: Any, loading: Loading) -> list[Any]:
        """Cauchy stresses at the cells' midpoints, and the constants of the materials."""
        stress = ufl.replace(self._cauchy, {self._displacement: u})
        return [*self._loaded.stress_fields(self._loaded.at_midpoints(stress)), *self._loaded.constants.values()]

    @property
    def numbers_per_cell(self) -> int:
        return self._loaded.numbers_per_cell


def _surfaces(body: LoadedBody, faces: Sequence[npt.NDArray[np.int32]]) -> Callable[[int, Any], Any]:
    """The integral over a face, by its number, of an integrand, as a form.  Faces may overlap: of one set of tags every
    facet has that of the faces that it is on."""
    facets = np.unique(np.concatenate([np.empty(0, dtype=np.int32), *faces])).astype(np.int32)
    tags = np.zeros(len(facets), dtype=np.int32)
    for number, face in enumerate(faces):
        tags += np.isin(facets, face).astype(np.int32) << number
    known = compat.meshtags(body.domain, 2, facets, tags)
    degree = {"quadrature_degree": 4 * body.degree}
    ds = ufl.Measure("ds", domain=body.domain, subdomain_data=known, metadata=degree)
    everywhere = sorted({int(tag) for part in body.comm.allgather(np.unique(tags)) for tag in part})

    def on(number: int, integrand: Any) -> Any:
        return reduce(add, (integrand * ds(tag) for tag in everywhere if tag >> number & 1))

    return on
