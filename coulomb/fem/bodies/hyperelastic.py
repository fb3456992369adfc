"""A body of hyperelastic materials with supports and loads, as of small strains."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from typing import Any, Final, Self, cast

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, Int32Array
from .. import compat
from ..compat import fem, ufl
from ..geometry import Amplitude, Field, Turn, evaluate_amplitude
from ..meshes import NamedMesh
from .body import cell_measure
from .compiled_form import CompiledForm, compiled, with_own_degrees
from .constraints import HeldDirections
from .elasticity import LoadedBody
from .elimination import Made
from .hyperelastic_laws import elastic, hyperelastic, invariants
from .lasting_supports import End
from .loads import (
    AppliedLoad,
    Load,
    Loading,
    NodalForces,
    PointLoad,
    Pressure,
    Temperature,
    ThermalLoad,
    load_title,
    range_of,
    shown_range,
)
from .materials import Materials, by_group, material_of_cells
from .mean_dilatation import AT_POINTS, MEAN_ABOVE, CellProducts, MeanVolume, linear_hexahedra
from .nonlinear_body import NonlinearBody
from .rigid_modes import Wrench, nearest_turn
from .supports import PrescribedDisplacement, PrescribedRotation, Spring, Support

_NOTHING = (0.0, 0.0, 0.0)

_STRAIGHT: Final = 1e-7
"""Sine of the angle of two directions below which they are the same."""


class _SupportedBody(LoadedBody):
    """Supports, springs and dead loads; prescribed rotations turn by finite angles."""

    def prescribed_values(self, time: float) -> FloatArray:
        return self._turned(time, lambda turn, arms: arms @ turn.matrix.T - arms)

    def prescribed_rate(self, time: float, start: float | None) -> FloatArray:
        """Derivative of the prescribed displacements along their common factor, in a load step from `start`, metres,
        shape (k, 3); collective."""

        def rates(time: float) -> FloatArray:
            return self._turned(time, lambda turn, arms: np.cross(turn.vector, arms @ turn.matrix.T))

        values = rates(time)
        if start is not None:
            values -= self._shares(start, time) * rates(start)
        return self._rows.displacement(values)

    def _turned(self, time: float, way: Callable[[Turn, FloatArray], FloatArray]) -> FloatArray:
        """Prescribed displacements along the held directions at a time, of a turn those of arms (k, 3); collective."""
        values = super().prescribed_values(time)
        for number, turn in self.turns(time).items():
            here = self._rows.support == number
            moved = way(turn, self.x[self._rows.node[here]] - turn.point)
            values[here] = np.einsum("ri,ri->r", self._rows.direction[here], moved)
        return values

    def turns(self, time: float) -> dict[int, Turn]:
        """Prescribed rotations at a time, by the numbers of their supports; collective."""
        found = dict[int, Turn]()
        for number, support in enumerate(self.supports):
            if isinstance(support, PrescribedRotation):
                axis = np.array(support.axis) / np.linalg.norm(support.axis)
                angle = support.angle * self._factor(support.amplitude, time, support.what)
                found[number] = Turn(np.array(support.point), axis, angle)
        return found


@dataclass(frozen=True, eq=False)
class _Turning:
    """A point load of which the point moves with the nodes of its face: `PointLoad.units`, and the point before."""

    load: PointLoad
    nodes: Int32Array
    units: FloatArray
    point: FloatArray


class HyperelasticBody(NonlinearBody):
    """A body of hyperelastic materials on a mesh.

    Tractions and total forces keep their direction and are per undeformed area (dead loads), pressures follow the
    surface, point loads act at a point that moves with their face; prescribed rotations are finite.  A temperature
    stretches by j = 1 + expansion dT: the strain energy is that of F/j, times j^3 (multiplicative split; S. Vujosevic,
    V. A. Lubarda: Finite-strain thermoelasticity based on multiplicative decomposition of deformation gradient, Theor.
    Appl. Mech. 28-29, 2002).

    Arguments are those of `Elasticity`; materials are `NeoHookean`, `MooneyRivlin`, `Ogden`, `StVenantKirchhoff`, or
    `Material`, which becomes the last of these.

    Raises:
        ValueError: As `Elasticity`; if there is a material of another kind.
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
        thermal: ThermalLoad | None = None,
    ):
        if any(spring.at_nodes for spring in springs):
            raise ValueError("spring: springs at nodes are for small motions: give one on a face")
        laws = [(group, hyperelastic(material)) for group, material in by_group(materials)]
        several = isinstance(materials, Mapping)
        materials = {str(group): law for group, law in laws} if several else laws[0][1]
        self._follow = [load for load in tractions if isinstance(load, Pressure)]
        dead = [load for load in tractions if not isinstance(load, Pressure)]
        self._loaded = loaded = _SupportedBody(
            mesh, materials, clamps, dead, body_force, springs, body_force_amplitude, gravity, gravity_amplitude
        )
        u, v, w = fem.Function(loaded.V, name="displacement"), ufl.TestFunction(loaded.V), ufl.TrialFunction(loaded.V)
        F, dx = ufl.Identity(3) + ufl.grad(u), cell_measure(loaded.domain)
        # derivatives by the invariants q: terms are then as many as these, however long the law is
        J, self.thermal, self._amplitude = ufl.det(F), thermal, fem.Constant(loaded.domain, 1.0)
        stretch = None if thermal is None else self._thermal_stretch(thermal, mesh, materials)
        q = elastic(invariants(F), stretch)
        known = [ufl.variable(one) for one in q]
        density = self._density(laws, known, dx) * (1.0 if stretch is None else stretch**3)
        self._energy_density, energy = density, density * dx
        for volume in self._volumes:
            density += volume.tension * known[volume.invariant]
        by_q = [ufl.diff(density, one) for one in known]
        rates = [ufl.derivative(one, u, v) for one in q]
        power = sum(a * rate for a, rate in zip(by_q, rates, strict=True))
        self._power, self._virtual, self._dx, inside = power, v, dx, power * dx
        tangent = sum(
            ufl.diff(a, other) * rate * ufl.derivative(of, u, w)
            for a, rate in zip(by_q, rates, strict=True)
            for other, of in zip(known, q, strict=True)
        )
        tangent += sum(a * ufl.derivative(rate, u, w) for a, rate in zip(by_q, rates, strict=True))
        for mean in self._volumes:
            tangent += (mean.ahead - mean.tension) * ufl.derivative(ufl.derivative(q[mean.invariant], u, v), u, w)
        gradient = ufl.variable(F)
        stress = sum(
            a * ufl.diff(one, gradient) for a, one in zip(by_q, elastic(invariants(gradient), stretch), strict=True)
        )
        self._cauchy = stress * F.T / J
        faces = [mesh.facets(load.face, load.kind) for load in self._follow]
        faces += [mesh.facets(spring.face, "spring") for spring in springs]
        on = _surfaces(loaded, faces)
        normal = J * ufl.inv(F).T * ufl.FacetNormal(loaded.domain)
        self._turning = {
            id(load): _Turning(
                load,
                loaded.nodes_of(mesh.facets(load.face, load.kind)),
                load.units(loaded, mesh),
                load.acts_at(loaded, mesh),
            )
            for load in dead
            if isinstance(load, PointLoad) and (load.point is not None or np.any(load.moment))
        }  # a force at the middle is spread uniformly however the face has turned
        self._factors = [fem.Constant(loaded.domain, 0.0) for _ in self._follow]
        pressures = [
            on(k, factor * self._value(load, faces[k]) * ufl.inner(normal, v))
            for k, (load, factor) in enumerate(zip(self._follow, self._factors, strict=True))
        ]
        on_faces = list(pressures)
        for number, spring in enumerate(springs, len(self._follow)):
            stiffness = loaded.spring_stiffness(spring)
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
        self._follows = bool(self._follow)
        self._energy = self._at_function(energy)
        self._pressure_forms = [self._at_function(-pressure) for pressure in pressures]
        self._siblings = dict[tuple[bool, ...], HyperelasticBody]()
        self._hold(loaded)
        self.materials, self.loads = materials, loaded.loads
        if thermal is not None:  # its forces are in the internal ones
            size = shown_range(range_of(self._change, self.comm))
            self.loads = (*loaded.loads, AppliedLoad(thermal, np.zeros_like(self.reference), size))

    def _hold(self, loaded: _SupportedBody) -> None:
        """Take the supports that act on these bodies."""
        self._loaded, self.held, self.still, self.contradictions = (
            loaded,
            loaded.held,
            loaded.still,
            loaded.contradictions,
        )
        self.acting, self._made = loaded.acting, Made()
        self.__dict__.pop("not_held", None)
        if self.acting:
            self._siblings[self.acting] = self

    def with_faces(self, faces: Mapping[str, Int32Array]) -> Self:
        there = super().with_faces(faces)
        there._siblings = {there.acting: there}
        return there

    @property
    def limits(self) -> tuple[float, ...]:
        return self._loaded.limits

    def held_at(self, time: float) -> HeldDirections:
        return self._loaded.held_at(time)

    def turns_since(self, start: float, time: float) -> list[Turn]:
        before = self._loaded.turns(start)
        return [replace(now, angle=now.angle - before[k].angle) for k, now in self._loaded.turns(time).items()]

    def at(self, time: float) -> Loading:
        loading = super().at(time)
        return loading if self._place else replace(loading, prescribed=self._loaded.at(time).prescribed)

    def refuse_beginning(self, time: float) -> None:
        if self._place is None:
            self._loaded.refuse_beginning(time)

    def prescribed_rate(self, start: float | None) -> FloatArray:
        return self._loaded.prescribed_rate(self.place.loading.time, start)

    def at_time(self, time: float) -> NonlinearBody:
        super().at_time(time)
        loaded = self._loaded.at_time(time)
        if self._place is not None or loaded is self._loaded:
            return self
        if loaded.acting not in self._siblings:
            copy.copy(self)._hold(loaded)
        return self._siblings[loaded.acting]

    def _density(self, laws: Sequence[tuple[str | None, Any]], of: Sequence[Any], dx: Any) -> Any:
        """Strain energy per undeformed volume: the sum of those of all laws, each 0 in the cells of others."""
        loaded, density, self._volumes = self._loaded, 0.0, list[MeanVolume]()
        count = loaded.domain.topology.index_map(3).size_local
        hexahedra = linear_hexahedra(loaded.domain)
        means = self.thermal is None and (hexahedra or loaded.degree == 2)
        kinds = [(type(material), getattr(material, "alpha", ())) for _, material in laws]
        for kind in dict.fromkeys(kinds):
            mine = [law for law, of in zip(laws, kinds, strict=True) if of == kind]
            values, local = {name: np.zeros(count) for name in mine[0][1].constants}, np.full(count, np.inf)
            for group, material in mine:
                cells: Any = slice(None) if group is None else loaded.mesh.group(group, "material")
                for name, value in material.constants.items():
                    values[name][cells] = value
                if means and material.poisson > MEAN_ABOVE:
                    shear = material.young / (2.0 * (1.0 + material.poisson))
                    local[cells] = 0.0 if hexahedra else AT_POINTS * shear
            part = mine[0][1].volumetric
            moduli = np.maximum(values[part.modulus] - local, 0.0)
            if loaded.comm.allreduce(bool(np.any(moduli)), op=MPI.LOR):
                self._volumes.append(MeanVolume(loaded.V, dx, part.invariant, part.function, moduli))
                values[part.modulus] -= moduli
            density += mine[0][1].energy(of, *(loaded._on_cells(one, name) for name, one in values.items()))
        return density

    def _thermal_stretch(self, thermal: ThermalLoad, mesh: NamedMesh, materials: Materials) -> Any:
        """1 + expansion dT, a scalar of UFL, at the present amplitude; collective."""
        loaded = self._loaded
        expansion = material_of_cells(mesh, materials, heated=True).expansion
        assert expansion is not None
        self._change = thermal.change(loaded, mesh)
        self._kelvin = loaded.function(np.repeat(self._change[:, None], 3, axis=1), "temperature")
        return 1.0 + self._amplitude * loaded._on_cells(expansion, "expansion") * self._kelvin[0]

    def _value(self, load: Pressure, facets: Int32Array) -> Any:
        """The pressure at amplitude 1, a scalar of UFL, from its nodal values."""
        values = load.nodal_values(self._loaded, facets)
        return self._loaded.function(np.repeat(values[:, None], 3, axis=1), "pressure")[0]

    def _at_time(self, time: float) -> None:
        for factor, load in zip(self._factors, self._follow, strict=True):
            factor.value = evaluate_amplitude(load.amplitude, time, f"pressure on {load.face!r}")
        if self.thermal is not None:
            self._amplitude.value = evaluate_amplitude(self.thermal.amplitude, time, "temperature")

    def _outer_forces(
        self, u: FloatArray, time: float, before: End | None, previous: FloatArray | None
    ) -> tuple[Loading, FloatArray, FloatArray]:
        if previous is not None:
            self._evaluate_at(previous)
        for volume in self._volumes:
            volume.move(self._displacement.x.array, None if previous is None else self._function.x.array)
        inside, *_ = super()._outer_forces(u, time, before, previous)
        dead = self._loaded.after(time, before)
        spring = self._loaded.spring_force(u)
        heat = None
        if self.thermal is not None:
            heat = Temperature(float(self._amplitude.value) * self._change, self.thermal.reference, 0.0)
        lasting = sum((one.forces for one in self._keeping_direction(u, time)), np.zeros_like(u))
        following = sum((one.forces for one in self._following(u)), np.zeros_like(u))
        return Loading(time, inside.load + lasting, dead.prescribed, heat), lasting + following, spring

    def resisted(self, modes: FloatArray) -> FloatArray:
        translations = not any(np.any(motion.rotation) for motion in self.not_held.motions)
        if translations and not self.resists_translation and self.added_springs is None:
            return np.zeros_like(modes)  # strains stay as they are
        return super().resisted(modes)

    @property
    def has_mean_dilatation(self) -> bool:
        return bool(self._volumes) and not self._loaded.mesh.tetrahedra

    @property
    def _products(self) -> list[CellProducts]:
        return [volume.products for volume in self._volumes]

    def _following(self, u: FloatArray) -> Iterator[NodalForces]:
        """The forces of pressures at a displacement u (k, 3), at the present time."""
        self._evaluate_at(u)
        for load, form in zip(self._follow, self._pressure_forms, strict=True):
            yield NodalForces("pressure", load.face, form.vector())

    def _keeping_direction(self, u: FloatArray, time: float) -> Iterator[NodalForces]:
        """The forces of all loads but pressures at a displacement u (k, 3); collective."""

        def there(applied: AppliedLoad) -> AppliedLoad:
            if id(applied.load) not in self._turning:
                return applied
            one = self._turning[id(applied.load)]
            x = self.reference[one.nodes]
            R = nearest_turn(x, x + u[one.nodes], self.comm)[2]
            return replace(applied, nodal_force=one.load.turned(one.units, R))

        return self._loaded.loads_at(time, map(there, self._loaded.loads))

    def wrenches(self) -> list[Wrench]:
        wrenches, time = [], self.place.loading.time
        for applied, part in zip(self._loaded.loads, self._keeping_direction(self.place.u, time), strict=True):
            if id(applied.load) in self._turning:
                one = self._turning[id(applied.load)]
                factor = evaluate_amplitude(one.load.amplitude, time, load_title(one.load)) / self.mesh.copies
                force, moment = (factor * np.asarray(of, dtype=np.float64) for of in (one.load.force, one.load.moment))
                wrenches.append(Wrench(one.load.face, one.point, force, moment, part.forces))
        return wrenches

    def turning_loads(self) -> Iterator[tuple[Int32Array, FloatArray, FloatArray]]:
        """Of loads that turn with their face its nodes (m,), and of their derivative C sum(Z^T z) along displacements z
        of these nodes the forces C by rotations, newtons per radian, shape (k, 3, 3), and the rotations, 1/m, shape (m,
        3, 3); collective."""
        u, time = self.place.u, self.place.loading.time
        for one in self._turning.values():
            x, load = self.reference[one.nodes], one.load
            from_, to, R = nearest_turn(x, x + u[one.nodes], self.comm)
            a, b = (x - from_) @ R.T, x + u[one.nodes] - to
            size = self.comm.allreduce(np.sum(a * b) * np.eye(3) - a.T @ b)
            factor, forces = evaluate_amplitude(load.amplitude, time, load_title(load)), load.turned(one.units, R)
            turned = []
            for axis in np.eye(3):
                force, moment = (tuple(np.cross(axis, of)) for of in (load.force, load.moment))
                there = replace(load, force=force, moment=moment).turned(one.units, R)
                turned.append(np.cross(axis, forces) - there)
            rotations = np.cross(np.linalg.inv(size)[None], a[:, None, :]).swapaxes(1, 2)
            yield one.nodes, factor * np.stack(turned, axis=2), rotations

    @property
    def follows(self) -> bool:
        return super().follows or bool(self._turning)

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        u = np.zeros_like(self.x) if self._place is None else self.place.u
        self._set(loading.time)  # others may have been posed since
        yield from self._keeping_direction(u, loading.time)
        yield from self._following(u)

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        return self._loaded.shares(reaction)

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        return self._loaded.spring_forces(u)

    def support_entries(self) -> list[dict[str, Any]]:
        return self._loaded.support_entries()

    def forms(self) -> None:
        return None

    def strain_energy(self, u: FloatArray) -> float:
        if self._place is not None:
            self._set(self.place.loading.time)
        energy = self._value_of(self._energy, u)
        return energy + sum(volume.energy(self._function.x.array) for volume in self._volumes)

    def work_in_cells(self, u: FloatArray, v: FloatArray, change: FloatArray | None = None) -> FloatArray:
        """Work of the stress of u along v in every cell of this rank, joules; u and v (k, 3) in metres, with the
        temperature of the place; collective."""
        self._set(self.place.loading.time)
        of, along = self.function(u), self.function(v)
        for volume in self._volumes:
            volume.move(of.x.array)
        return self.integrals_in_cells(
            ufl.replace(self._power, {self._displacement: of, self._virtual: along}), self._dx
        )

    def thermal_rates(self) -> tuple[FloatArray, float]:
        """Derivatives, along the logarithm of the temperature's change, of the forces that it exerts at the place,
        newtons, shape (k, 3), and of the strain energy there, joules; collective."""
        self._set(self.place.loading.time)
        self._evaluate_at(self.place.u)
        forces, energy = cast(HyperelasticBody, self.undeformed)._of_temperature
        return -forces.vector(), energy.number(self.comm)

    @cached_property
    def _of_temperature(self) -> tuple[CompiledForm, CompiledForm]:
        forms = (with_own_degrees(one * self._dx) for one in (self._power, self._energy_density))
        rates = (self._at_function(ufl.derivative(form, self._kelvin, self._kelvin)) for form in forms)
        return next(rates), next(rates)

    def thermal_work(self, u: FloatArray, v: FloatArray, change: FloatArray) -> FloatArray:
        """Derivatives, along a change of temperature (k,) of this rank's nodes, of the work of the forces that it
        exerts at a displacement u along v (k, 3), joules per kelvin, shape (k,); collective."""
        kelvin = self.function(np.repeat(change[:, None], 3, axis=1))
        at = {self._amplitude: fem.Constant(self.domain, 1.0), self._kelvin: kelvin}
        at |= {self._displacement: self.function(u), self._virtual: self.function(v)}
        work = ufl.replace(with_own_degrees(self._power * self._dx), at)
        per_kelvin = compiled(ufl.derivative(work, kelvin, self._test), "temperature", self.comm)
        return -per_kelvin.vector()[:, 0]

    def cell_fields(self, u: Any, loading: Loading) -> list[Any]:
        """Cauchy stresses at the cells' midpoints, and the constants of the materials."""
        self._set(loading.time)
        for volume in self._volumes:
            volume.move(u.x.array)
        stress = ufl.replace(self._cauchy, {self._displacement: u})
        return [*self._loaded.stress_fields(self._loaded.at_midpoints(stress)), *self._loaded.constants.values()]

    @property
    def numbers_per_cell(self) -> int:
        return self._loaded.numbers_per_cell

    def turn_of_guides(self) -> float:
        sine, loaded, comm = 0.0, self._loaded, self.comm
        for support, acts in zip(loaded.supports, loaded.acting or (True,) * len(loaded.supports), strict=True):
            if not acts or not isinstance(support, PrescribedDisplacement):
                continue
            then = _projections(support.directions(loaded.supported_face(support, loaded)))
            ends = [np.max(of, axis=0, initial=-1.0) for of in (then, -then)]
            if np.max(np.max(comm.allgather(ends), axis=0).sum(axis=0)) < _STRAIGHT:  # it is straight
                continue
            try:
                now = _projections(support.directions(loaded.supported_face(support, self)))
            except ValueError:  # the face has an edge now, or is off the surface
                return 90.0
            off = np.linalg.norm(now - then, axis=(1, 2)) / np.sqrt(2.0)
            sine = max(sine, comm.allreduce(float(np.max(off, initial=0.0)), op=MPI.MAX))
        return float(np.degrees(np.arcsin(min(sine, 1.0)))) if sine > _STRAIGHT else 0.0


def _projections(directions: FloatArray) -> FloatArray:
    """Onto the directions of supports (q, 3, 3), shape (q, 3, 3); of those turned by an angle the difference has the
    Frobenius norm sqrt(2) times its sine."""
    return np.einsum("qri,qrj->qij", directions, directions)


def _surfaces(body: LoadedBody, faces: Sequence[Int32Array]) -> Callable[[int, Any], Any]:
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
