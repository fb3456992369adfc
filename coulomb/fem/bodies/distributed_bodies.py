"""What is given for several bodies at once, distributed to them: materials, supports, loads."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TypeVar, cast

from ..geometry import Amplitude, Coefficient, Field
from ..meshes import SEPARATOR, JoinedMesh, NamedMesh
from .loaded_body import LoadedBody, refuse_others
from .loads import Load
from .materials import AnyMaterial, Materials
from .supports import Spring, Support
from .temperature import ThermalLoad

Acting = TypeVar("Acting")
Value = TypeVar("Value")
Kind = TypeVar("Kind", bound=LoadedBody)

NOTHING = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class GivenBody:
    """What one body is made of: the arguments of `LoadedBody` and of `Elasticity`, in their order."""

    mesh: NamedMesh
    materials: Materials
    clamps: Sequence[Support]
    tractions: Sequence[Load] = ()
    body_force: Field = NOTHING
    springs: Sequence[Spring] = ()
    body_force_amplitude: Amplitude = 1.0
    gravity: Sequence[float] = NOTHING
    gravity_amplitude: Amplitude = 1.0
    thermal: ThermalLoad | None = None


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
    temperature: Coefficient | Mapping[str, Coefficient] | None = None,
    reference_temperature: float = 0.0,
    temperature_amplitude: Amplitude = 1.0,
) -> dict[str, GivenBody]:
    """Everything that is given for several bodies, by the name of the body.

    Materials are one for all, or a mapping of "lower", or of groups of cells as "lower:steel"; supports, loads and
    springs are on faces "body:face"; body force, gravity and temperature of all bodies, or mappings of names of bodies;
    amplitudes and the reference temperature of all.

    Raises:
        ValueError: If a body, face or group is unknown, a body has no material or two, or a list has other entries.
    """
    refuse_others(clamps=clamps, springs=springs, tractions=tractions)
    of_material = _materials(mesh, materials)
    held, loaded = _by_body(mesh, clamps, "support"), _by_body(mesh, tractions, "load")
    sprung = _by_body(mesh, springs, "spring")
    forces: dict[str, Field] = _each(mesh, body_force, "body_force")
    weights: dict[str, Sequence[float]] = _each(mesh, gravity, "gravity")
    temperatures: dict[str, Coefficient] = _each(mesh, temperature, "temperature")
    bodies = {}
    for name, one in mesh.bodies.items():
        heat = temperatures.get(name)
        bodies[name] = GivenBody(
            mesh=one,
            materials=of_material[name],
            clamps=held[name],
            tractions=loaded[name],
            body_force=forces.get(name, NOTHING),
            springs=sprung[name],
            body_force_amplitude=body_force_amplitude,
            gravity=weights.get(name, NOTHING),
            gravity_amplitude=gravity_amplitude,
            thermal=None if heat is None else ThermalLoad(heat, reference_temperature, temperature_amplitude),
        )
    return bodies


def made(kind: type[Kind], bodies: Mapping[str, GivenBody]) -> dict[str, Kind]:
    """Every body as a `LoadedBody` or an `Elasticity`; errors with the name of the body; collective."""
    found = {}
    for name, given in bodies.items():
        try:
            found[name] = kind(*(getattr(given, field.name) for field in fields(given)))
        except ValueError as error:
            raise ValueError(f"body {name!r}: {error}") from None
    return found


def _by_body(mesh: JoinedMesh, given: Iterable[Acting], what: str) -> dict[str, list[Acting]]:
    """Supports or loads of every body, with the names that their faces have there."""
    found: dict[str, list[Acting]] = {name: [] for name in mesh.bodies}
    for one in given:
        face = getattr(one, "face", None)
        body, name = mesh.split(cast(str, face), getattr(one, "kind", what))
        there = copy.copy(one)
        object.__setattr__(there, "face", name)  # of frozen classes, whose constructors differ
        found[body].append(there)
    return found


def _each(mesh: JoinedMesh, given: Value | Mapping[str, Value] | None, what: str) -> dict[str, Value]:
    """The value of every body that has one: the same for all, or that in a mapping."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        return dict.fromkeys(mesh.bodies, given)
    for name in given:
        mesh.body(name, what)
    return dict(given)


def _materials(mesh: JoinedMesh, materials: Materials) -> dict[str, Materials]:
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
