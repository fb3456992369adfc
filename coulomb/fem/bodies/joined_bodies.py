"""Several bodies as one: what is given for all, distributed to each; joined, with their nodes one after the other."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, TypeVar, cast, overload

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from ...arrays import FloatArray, Int32Array, IntArray
from ..geometry import Amplitude, Field
from ..meshes import SEPARATOR, JoinedMesh, NamedMesh, is_mesh_data
from .constraints import HeldDirections, Numbering, distributed_rows, local_rows
from .deformable import Deformable, Member, SingleBody
from .elasticity import LoadedBody, refuse_others
from .elimination import Made
from .equations import Linked, Links
from .free_motions import FreeMotions
from .joined_numbers import JoinedNumbers, in_joined_numbers
from .lasting_supports import End
from .linear_constraints import Constraints
from .loads import AppliedLoad, Load, Loading, NodalForces, Temperatures, ThermalLoad, VolumeForce, joined_temperatures
from .materials import AnyMaterial, Materials, by_group
from .rigid_modes import rigid_modes
from .supports import Spring, Support
from .ties import Follower

Acting = TypeVar("Acting")
Value = TypeVar("Value")
Kind = TypeVar("Kind", bound=LoadedBody | SingleBody)

NOTHING = (0.0, 0.0, 0.0)


def distributed_bodies(
    mesh: JoinedMesh,
    materials: Materials,
    clamps: Sequence[Support],
    tractions: Sequence[Load] = (),
    body_force: Field | Mapping[str, Field] = NOTHING,
    springs: Sequence[Spring] = (),
    body_force_amplitude: Amplitude = 1.0,
    gravity: Sequence[float] | Mapping[str, Sequence[float]] = NOTHING,
    gravity_amplitude: Amplitude = 1.0,
    temperature: Temperatures | Mapping[str, Temperatures] | None = None,
    reference_temperature: float = 0.0,
    temperature_amplitude: Amplitude = 1.0,
) -> dict[str, dict[str, Any]]:
    """Everything that is given for several bodies, by the name of the body: of each the arguments of `LoadedBody`.

    Materials are one for all, or a mapping of "lower", or of groups of cells as "lower:steel"; supports, loads and
    springs are on faces "body:face"; body force, gravity and temperature of all bodies, or mappings of names of bodies;
    amplitudes and the reference temperature of all.

    Raises:
        ValueError: If a body, face or group is unknown, a body has no material or two, or a list has other entries.
    """
    refuse_others(clamps=clamps, springs=springs, tractions=tractions)
    of_material = _material_of_bodies(mesh, materials)
    held, loaded = _by_body(mesh, clamps, "support"), _by_body(mesh, tractions, "load")
    sprung = _by_body(mesh, springs, "spring")
    forces: dict[str, Field] = _each(mesh, body_force, "body_force")
    weights: dict[str, Sequence[float]] = _each(mesh, gravity, "gravity")
    temperatures: dict[str, Temperatures] = _each(mesh, temperature, "temperature")
    bodies = {}
    for name, one in mesh.bodies.items():
        heat = temperatures.get(name)
        bodies[name] = {
            "mesh": one,
            "materials": of_material[name],
            "clamps": held[name],
            "tractions": loaded[name],
            "body_force": forces.get(name, NOTHING),
            "springs": sprung[name],
            "body_force_amplitude": body_force_amplitude,
            "gravity": weights.get(name, NOTHING),
            "gravity_amplitude": gravity_amplitude,
            "thermal": None if heat is None else ThermalLoad(heat, reference_temperature, temperature_amplitude),
        }
    return bodies


def build_bodies(kind: Callable[..., Kind], bodies: Mapping[str, Mapping[str, Any]]) -> dict[str, Kind]:
    """Every body as an object of a kind, as `Elasticity`; errors with the name of the body; collective."""
    by_name = {}
    for name, given in bodies.items():
        try:
            by_name[name] = kind(**given)
        except ValueError as error:
            raise ValueError(f"body {name!r}: {error}") from None
    return by_name


def _by_body(mesh: JoinedMesh, given: Iterable[Acting], what: str) -> dict[str, list[Acting]]:
    """Supports or loads of every body, with the names that their faces have there."""
    acting_on: dict[str, list[Acting]] = {name: [] for name in mesh.bodies}
    for one in given:
        split = mesh.split_group if isinstance(one, VolumeForce) else mesh.split
        body, name = split(cast(str, getattr(one, "face", None)), getattr(one, "kind", what))
        there = copy.copy(one)
        object.__setattr__(there, "face", name)  # of frozen classes, whose constructors differ
        acting_on[body].append(there)
    return acting_on


def _each(mesh: JoinedMesh, given: Value | Mapping[str, Value] | None, what: str) -> dict[str, Value]:
    """The value of every body that has one: the same for all, or that in a mapping."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        return dict.fromkeys(mesh.bodies, given)
    for name in given:
        mesh.body(name, what)
    return dict(given)


def _material_of_bodies(mesh: JoinedMesh, materials: Materials) -> dict[str, Materials]:
    if not isinstance(materials, Mapping):
        return dict.fromkeys(mesh.bodies, materials)
    whole: dict[str, AnyMaterial] = {}
    groups: dict[str, dict[str, AnyMaterial]] = {name: {} for name in mesh.bodies}
    for name, material in materials.items():
        if isinstance(name, str) and SEPARATOR in name:
            body, group = mesh.split_group(name, "material")
            groups[body][group] = material
        else:
            mesh.body(name, "material")
            whole[name] = material
    for name in mesh.bodies:
        if name in whole and groups[name]:
            both = ", ".join(f"{name}{SEPARATOR}{group}" for group in groups[name])
            raise ValueError(f"material: body {name!r} has one for the whole body, and others for {both}; give either")
        if name not in whole and not groups[name]:
            raise ValueError(
                f"material: body {name!r} has none; materials are given for {', '.join(materials) or '(none)'}"
            )
    return {name: whole[name] if name in whole else groups[name] for name in mesh.bodies}


@overload
def join(bodies: Mapping[str, NamedMesh] | None = None, /, **named: NamedMesh) -> JoinedMesh: ...


@overload
def join(bodies: Mapping[str, SingleBody] | None = None, /, **named: SingleBody) -> JoinedBodies: ...


def join(
    bodies: Mapping[str, NamedMesh] | Mapping[str, SingleBody] | None = None, /, **named: NamedMesh | SingleBody
) -> JoinedMesh | JoinedBodies:
    """Several bodies as one, for a problem of contact between them.

    Their meshes need not match where the bodies touch; they may have cells of different kinds and orders, and each may
    have several components.  Each body is where its mesh was made, or where `coulomb.moved` has put it.

    Args:
        bodies: By name the mesh of each body, then `ContactProblem` takes materials, supports and loads of all; or each
            as a `Body` of your own forms, or an `Elasticity`, which has them already.
        **named: The same, as in `join(lower=..., upper=...)`.

    Raises:
        ValueError: If there is no body, or one is neither mesh nor `Body`, or not what the others are; if a name is no
            identifier or occurs twice, a mesh is given twice, or meshes are on different communicators.

    Examples:
        >>> import coulomb
        >>> block = coulomb.box((0.1, 0.1, 0.05), (4, 4, 2))
        >>> stack = coulomb.join(lower=block, upper=coulomb.moved(block, translate=(0.0, 0.0, 0.05)))
        >>> [name for name in stack.faces if name.endswith("top")]
        ['lower:top', 'upper:top']
    """
    if bodies is not None and not isinstance(bodies, Mapping):
        raise ValueError(f"join: must be join(lower=..., upper=...), or a mapping of names to meshes, not {bodies!r}")
    first: dict[str, NamedMesh | SingleBody] = dict(bodies or {})
    twice = first.keys() & named.keys()
    if twice:
        raise ValueError(f"join: two bodies have the name {min(twice)!r}")
    given = {name: NamedMesh(one) if is_mesh_data(one) else one for name, one in {**first, **named}.items()}
    meshes = {name: one for name, one in given.items() if isinstance(one, NamedMesh)}
    singles = {name: one for name, one in given.items() if isinstance(one, SingleBody)}
    for name, one in given.items():
        if isinstance(one, JoinedMesh | JoinedBodies):
            inner = one.bodies if isinstance(one, JoinedMesh) else [member.name for member in one.members]
            raise ValueError(f"join: {name!r} has several bodies ({', '.join(inner)}) itself; join all of them at once")
        if name not in meshes and name not in singles:
            raise ValueError(
                f"join: {name!r} must be a mesh (coulomb.box, coulomb.read_mesh, NamedMesh) or a Body, but is {one!r}"
            )
    if meshes and singles:
        raise ValueError(
            f"join: {next(iter(meshes))!r} is a mesh, {next(iter(singles))!r} a body with its own loads and supports; "
            "coulomb.Elasticity makes such a body of a mesh"
        )
    return JoinedBodies(singles) if singles else JoinedMesh(meshes)


class JoinedBodies(Deformable):
    """Bodies on the same ranks that contact and constraints connect; `coulomb.join` makes them without constraints.

    On every rank the nodes of the first body come before those of the second, and so on; globally, those of one rank
    before those of the next.  Faces are called "body:face", or as those of the body if there is one alone, named "".

    Args:
        bodies: By their names.
        given: Ties, rigid faces and bolts; of those that meet, a later one may refuse nodes of earlier ones.
        time, links: By which ties act and bolts are locked; springs between nodes.
    """

    def __init__(
        self,
        bodies: Mapping[str, SingleBody],
        given: Sequence[Follower] = (),
        time: float = 0.0,
        links: Linked = (),
    ):
        self._alone = bodies.get("")
        self._mesh = None if self._alone else JoinedMesh({name: body.mesh for name, body in bodies.items()})
        parts = tuple(bodies.values())
        ends = np.cumsum([0, *(len(body.x) for body in parts)])
        slices = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self._members = tuple(map(Member, bodies, parts, slices))
        self._numbers = JoinedNumbers(self.comm, [(body.numbering.first, body.numbering.local) for body in parts])
        self.x: FloatArray = np.concatenate([body.x for body in parts])
        self.held, self.still = (
            HeldDirections(
                len(self.x),
                np.concatenate([one.nodes + own.start for one, own in zip(each, slices, strict=True)]),
                np.concatenate([one.projector for one in each]),
            )
            for each in ([body.held for body in parts], [body.still for body in parts])
        )
        counts = [len(body.component_names) for body in parts]
        self.component = np.concatenate(
            [first + body.component for first, body in zip(np.cumsum([0, *counts]), parts, strict=False)]
        )
        self._made = Made()
        self.contradictions = tuple(
            f"body {name!r}: {text}" if name else text for name, body in bodies.items() for text in body.contradictions
        )
        self.materials = self._alone.materials if self._alone else _materials(bodies)
        self.loads = tuple(self._load_of(member, load) for member in self.members for load in member.body.loads)
        self._made.constraints = Constraints(self, given, time, Links(self, links) if links else None)
        self._at_times, self.acting = list[JoinedBodies](), self._acting()

    # --- nodes ------------------------------------------------------------------------------------------------------

    @property
    def numbering(self) -> Numbering:
        return Numbering(self._numbers.first_of(self.comm.rank), len(self.x), self._numbers.total)

    @property
    def members(self) -> tuple[Member, ...]:
        return self._members

    @cached_property
    def reference(self) -> FloatArray:
        if all(member.body.x is member.body.reference for member in self._members):
            return self.x
        return np.concatenate([member.body.reference for member in self._members])

    def deformation(self, way: FloatArray) -> FloatArray:
        return np.concatenate([member.body.deformation(way[member.nodes]) for member in self._members])

    def face(self, name: str, what: str) -> tuple[Member, Int32Array]:
        if self._mesh is None:
            return self._members[0], self._members[0].body.mesh.facets(name, what)
        of, own = self._mesh.split(name, what)
        member = next(member for member in self._members if member.name == of)
        return member, member.body.mesh.facets(own, what)

    def numbers_of(self, member: Member, numbers: IntArray) -> IntArray:
        return self._numbers.of([one.name for one in self._members].index(member.name), numbers)

    # --- stiffness ----------------------------------------------------------------------------------------------------

    @property
    def free(self) -> FreeMotions:
        if self.constraints.bolts or not all(member.body.held_everywhere for member in self._members):
            return super().free
        component, names = self.moving_together
        return FreeMotions(self.comm, component, (), names)

    def assembled(self) -> PETSc.Mat:
        blocks = []
        for member in self.members:
            K = member.body.assembled()
            blocks.append(in_joined_numbers(local_rows(K), partial(self.numbers_of, member), self.numbering.total))
            K.destroy()
        rows = self.constraints.with_links(scipy.sparse.vstack(blocks, format="csr"))
        return distributed_rows(rows, (3 * len(self.x), 3 * self.numbering.total), self)

    def resisted(self, modes: FloatArray) -> FloatArray:
        forces = np.concatenate([member.body.resisted(modes[member.nodes]) for member in self.members])
        return forces + self._resisted_by_springs(modes) + self.constraints.resisted(modes)

    def interpolated(self) -> tuple[scipy.sparse.csr_matrix, FloatArray, Numbering]:
        blocks, places, numberings = zip(*(member.body.interpolated() for member in self.members), strict=True)
        coarse = JoinedNumbers(self.comm, [(numbering.first, numbering.local) for numbering in numberings])
        rows = [in_joined_numbers(of, partial(coarse.of, place), coarse.total) for place, of in enumerate(blocks)]
        x = np.concatenate(places)
        return (
            scipy.sparse.vstack(rows, format="csr"),
            x,
            Numbering(coarse.first_of(self.comm.rank), len(x), coarse.total),
        )

    @property
    def component_names(self) -> tuple[str, ...]:
        each = [(member.body.component_names, f'body "{member.name}"') for member in self.members]
        return tuple(name.replace("the body", body) if self._mesh else name for names, body in each for name in names)

    # --- loads and forces ---------------------------------------------------------------------------------------------

    def at_time(self, time: float) -> JoinedBodies:
        """Itself, if no body has changed, and the same ties act and bolts are locked; the same for the same ones.
        Constraints are shared unless other supports act."""
        bodies, constraints = [member.body.at_time(time) for member in self._members], self.constraints.at_time(time)
        for known in (self, *self._at_times):
            if known._has(bodies) and known.constraints.same(constraints):
                return known
        if any(one.body.acting != body.acting for one, body in zip(self._members, bodies, strict=True)):
            given = dict(zip([member.name for member in self._members], cast(list[SingleBody], bodies), strict=True))
            other = JoinedBodies(given, constraints.as_made, time, constraints.link_equations)
        else:
            other = self._with(cast(list[SingleBody], bodies), constraints)
        self._at_times[:] = [*(known for known in self._at_times if known._has(bodies)), other]
        return other

    def _acting(self) -> tuple[bool, ...]:
        return (*(one for member in self._members for one in member.body.acting), *self.constraints.acting)

    def _has(self, bodies: Sequence[Deformable]) -> bool:
        return all(one.body is body for one, body in zip(self._members, bodies, strict=True))

    def of(self, bodies: Sequence[SingleBody], u: FloatArray | None = None, before: End | None = None) -> JoinedBodies:
        """The same with other bodies: these with another stiffness, or displaced by u (k, 3) metres, after the end of
        another load step (`Constraints.at_place`); collective."""
        x, constraints = np.concatenate([body.x for body in bodies]), self.constraints
        other = self._with(bodies, constraints if u is None else constraints.at_place(x, u, before))
        other._at_times = []
        return other

    def bent(self, imbalance: FloatArray, time: float) -> JoinedBodies:
        """The same with `Constraints.bent`; itself if that is; collective."""
        if not self.constraints.motions:
            return self
        each = ((member, wrench) for member in self._members for wrench in member.body.wrenches())
        wrenches = [
            replace(of, face=str(one.called(of.face)), forces=self._among_all_nodes(one, of.forces)) for one, of in each
        ]
        constraints = self.constraints.bent(imbalance, time, wrenches)
        if constraints is self.constraints:
            return self
        other = self._with([member.body for member in self._members], constraints)
        other._at_times = []
        return other

    def _with(self, bodies: Sequence[SingleBody], constraints: Constraints) -> JoinedBodies:
        other = copy.copy(self)
        other._members = tuple(replace(one, body=body) for one, body in zip(self._members, bodies, strict=True))
        other.x, other._made = constraints.reduction.x, Made(constraints=constraints)
        other.acting = other._acting()
        return other

    def held_at(self, time: float) -> HeldDirections:
        return self.at_time(time).held

    @property
    def limits(self) -> tuple[float, ...]:
        return (*(time for member in self._members for time in member.body.limits), *self.constraints.limits)

    def refuse_beginning(self, time: float) -> None:
        for member in self._members:
            member.body.refuse_beginning(time)
        self.constraints.refuse_beginning(time)

    def after(self, time: float, before: End | None) -> Loading:
        parts = tuple(member.body.after(time, before and before.of(member.nodes)) for member in self._members)
        return self._under_springs(self.constraints.loading(self._together(time, parts), before))

    def heated(self, loading: Loading, change: FloatArray) -> Loading:
        each = zip(self._members, loading.parts, strict=True)
        return self._together(loading.time, tuple(one.body.heated(part, change[one.nodes]) for one, part in each))

    def _together(self, time: float, parts: tuple[Loading, ...]) -> Loading:
        load, prescribed = (np.concatenate([getattr(part, name) for part in parts]) for name in ("load", "prescribed"))
        temperature = joined_temperatures([part.temperature for part in parts], [one.nodes for one in self._members])
        return Loading(time, load, prescribed, temperature, parts)

    def outdated(self, loading: Loading) -> bool:
        return any([one.body.outdated(part) for one, part in zip(self._members, loading.parts, strict=True)])

    def internal_force(self, u: FloatArray) -> FloatArray:
        of_bodies = np.concatenate([member.body.internal_force(u[member.nodes]) for member in self._members])
        return self._with_springs(of_bodies + self.reduction.bent_force(u), u)

    @contextmanager
    def shifted(self, shift: FloatArray) -> Iterator[JoinedBodies]:
        with ExitStack() as stack:
            bodies = [stack.enter_context(member.body.shifted(shift[member.nodes])) for member in self._members]
            there = self._with(bodies, self.constraints)
            there.x = there.reference = np.concatenate([body.x for body in bodies])
            yield there

    def spring_force(self, u: FloatArray) -> FloatArray:
        of_bodies = np.concatenate([member.body.spring_force(u[member.nodes]) for member in self._members])
        return of_bodies + self.constraints.spring_force(u)

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        for member, part in zip(self.members, loading.parts, strict=True):
            yield from self._named(member, member.body.loads_in(part))

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        for member in self.members:
            yield from self._named(member, member.body.shares(reaction[member.nodes]))

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        for member in self.members:
            yield from self._named(member, member.body.spring_forces(u[member.nodes]))
        yield from self.constraints.spring_forces(u)

    def support_entries(self) -> list[dict[str, Any]]:
        given = [(member, one) for member in self.members for one in member.body.support_entries()]
        return [*({**one, "face": member.called(one["face"])} for member, one in given), *self.constraints.springs]

    def blocked_displacements(self, loading: Loading) -> tuple[float, ...]:
        parts = zip(self._members, loading.parts, strict=True)
        return tuple(one.body.blocked_displacement(part) for one, part in parts)

    def forms(self) -> Mapping[str, Any] | None:
        """By the name of the body; those of a body alone."""
        if self._alone:
            return self._alone.forms()
        return {member.name: forms for member in self._members if (forms := member.body.forms()) is not None} or None

    @property
    def ground(self) -> FloatArray | None:
        parts, sprung = [member.body.ground for member in self._members], self.constraints.sprung
        if all(part is None for part in parts) and not sprung:
            return None
        whole = rigid_modes(self.x, self.comm)
        ground = -sum((one.forces for one in self.constraints.ground_forces(whole)), np.zeros_like(whole))
        for member, part in zip(self.members, parts, strict=True):
            if part is not None:  # a rigid motion of all is one of the body
                own, given = rigid_modes(member.body.x, self.comm).reshape(-1, 6), whole[member.nodes].reshape(-1, 6)
                gram, right = self.comm.allreduce(own.T @ own), self.comm.allreduce(own.T @ given)
                ground[member.nodes] += part @ np.linalg.lstsq(gram, right, rcond=None)[0]
        return ground

    def _among_all_nodes(self, member: Member, values: FloatArray) -> FloatArray:
        lifted = np.zeros((len(self.x), *values.shape[1:]))
        lifted[member.nodes] = values
        return lifted

    def _load_of(self, member: Member, given: AppliedLoad) -> AppliedLoad:
        if self._alone:
            return given
        load = _LoadOfBody(given.load.kind, member.called(given.load.face), given.load.amplitude)
        return AppliedLoad(load, self._among_all_nodes(member, given.nodal_force), given.size)

    def _named(self, member: Member, given: Iterable[NodalForces]) -> Iterator[NodalForces]:
        for one in given:
            yield NodalForces(one.kind, member.called(one.face), self._among_all_nodes(member, one.forces))


@dataclass(frozen=True)
class _LoadOfBody:
    kind: str
    face: str | None
    amplitude: Amplitude


def _materials(bodies: Mapping[str, SingleBody]) -> dict[str, AnyMaterial]:
    """Those of bodies and groups of cells, as "lower" or "lower:steel"; without those of the user's forms."""
    materials: dict[str, AnyMaterial] = {}
    for name, body in bodies.items():
        if body.materials is not None:
            for group, material in by_group(body.materials):
                materials[name if group is None else f"{name}{SEPARATOR}{group}"] = material
    return materials
