"""Arguments of a contact problem, checked before anything is made of them, with the same error on every rank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from ..arrays import is_number, short
from ..fem.bodies import Deformable, Equation, PrescribedDisplacement, Support, act_together, nonlinear, vanishes
from ..fem.contact import Tied, two_sides
from ..fem.geometry import same_on_all_ranks
from ..fem.meshes import SEPARATOR, JoinedMesh, NamedMesh, is_mesh_data, with_surfaces
from ..linalg.compliance import DirectSolver, IterativeSolver, LinearSolver
from ..solvers.friction_problem import Solver
from .contact import Contact
from .probes import Probe
from .stopping_criterion import CERTIFIED_FROM

KINEMATICS = ("small", "large")
"""Theories of a problem."""

BRANCHES = ("any", "stable")
"""Equilibria that are taken in large motions."""


def refuse_wrong(given: Mapping[str, object]) -> None:
    """Refuse what is no mesh or body, other arguments that differ between ranks, or that are not what their names say;
    collective.

    Raises:
        ValueError: On every rank.
    """
    mesh = given["mesh"]
    if not isinstance(mesh, NamedMesh | JoinedMesh | Deformable):
        if isinstance(mesh, str | Path):
            advice = f"coulomb.read_mesh({str(mesh)!r}) reads a file"
        elif hasattr(mesh, "topology"):
            advice = (
                "coulomb.NamedMesh(mesh, facet_tags) makes faces '1', '2' of MeshTags, and coulomb.NamedMesh(mesh, "
                "{'sole': (facet_tags, 1), 'top': lambda x: np.isclose(x[2], 1)}) faces with names"
            )
        else:
            advice = "coulomb.box and coulomb.read_mesh make meshes, coulomb.join several bodies"
        raise ValueError(f"mesh must be a mesh with named faces, or a Body, but is {short(mesh)}; {advice}")
    same_on_all_ranks({name: value for name, value in given.items() if name != "mesh"}, mesh.comm)
    if not is_number(given["time"], -np.inf):
        raise ValueError(f"time must be a finite number, but is {given['time']!r}")
    explicit, probes, kinematics = given.get("explicit"), given.get("probes", ()), given.get("kinematics", "small")
    if kinematics not in KINEMATICS:
        raise ValueError(f'kinematics must be "small" or "large", but is {kinematics!r}')
    branch = given.get("branch", "any")
    if branch not in BRANCHES or (branch == "stable" and kinematics == "small"):
        raise ValueError(f'branch must be "any", or in large motions "stable", but is {branch!r}')
    if not isinstance(explicit, bool | np.bool_ | None):
        raise ValueError(f"explicit must be True, False, or None for the choice by size, but is {explicit!r}")
    if not isinstance(probes, Sequence) or not all(isinstance(probe, Probe) for probe in probes):
        raise ValueError(f"probes must be a list of Probe, but is {short(probes)}")
    ties = given.get("ties", ())
    for one in ties if isinstance(ties, Sequence) else ():
        if not isinstance(one, Tied | Equation):
            raise ValueError(f"ties must be a list of Tied, CyclicSymmetry, Pretension and Equation, but has {one!r}")
    earlier: dict[frozenset[str], list[Tied]] = {}
    for one in ties if isinstance(ties, Sequence) else ():
        if isinstance(one, Tied):
            same = earlier.setdefault(frozenset((one.face, one.against)), [])
            if any(act_together(one, other) for other in same):
                pair = " and ".join(map(repr, sorted((one.face, one.against))))
                raise ValueError(f"ties: the pair of {pair} is given twice")
            same.append(one)


def named(given: Any) -> Any:
    """A mesh with names for MeshData of DOLFINx; all else as it is; collective."""
    return NamedMesh(given) if is_mesh_data(given) else given


def certifying(solver: Solver | None) -> Solver | None:
    """A solver with a tolerance at which it asks for the certificate."""
    loose = is_dataclass(solver) and not isinstance(solver, type) and solver.tolerance > CERTIFIED_FROM
    return cast(Solver, replace(cast(Any, solver), tolerance=CERTIFIED_FROM)) if loose else solver


def linear_solver_of(given: object) -> LinearSolver | None:
    """The solver for K^-1 by class or name; None for the choice by size."""
    if given is None or given == "auto":
        return None
    for name, solver in (("direct", DirectSolver), ("iterative", IterativeSolver)):
        if given == name:
            return solver
        if isinstance(given, type) and issubclass(given, solver):
            return given
    raise ValueError(
        f'linear_solver must be "auto", "direct" or "iterative", or one of the classes, but is {short(given)}; these '
        "factors and this multigrid are coulomb's own and take no options of PETSc"
    )


def contacts_given(arguments: Mapping[str, Any]) -> tuple[Contact, ...]:
    """The contacts of a problem, from its arguments: of a `Body`, which has its own material, loads and supports, they
    may be the second one; ValueError on every rank if arguments contradict each other."""
    given, material = arguments["contact"], arguments["material"]
    if len(arguments["heat"]) and arguments["temperature"] is not None:
        raise ValueError("heat: the temperature follows from heat: give heat or temperature, one of the two")
    if isinstance(arguments["mesh"], Deformable):
        lists = [arguments[name] for name in ("clamps", "tractions", "springs", "heat")]
        forces = arguments["body_force"], arguments["gravity"]
        if (
            arguments["temperature"] is not None
            or any(not isinstance(one, Sequence) or len(one) for one in lists)
            or any(isinstance(force, Mapping) or not vanishes(force) for force in forces)
        ):
            raise ValueError("a body has its own loads and supports: give ContactProblem(body, contact) no others")
        if (material is None) == (given is None):
            raise ValueError("a body has its own material: ContactProblem(body, contact)")
        given = material if given is None else given
    elif material is None or isinstance(material, Contact) or given is None:
        raise ValueError("give ContactProblem(mesh, material, clamps, contact), or ContactProblem(body, contact)")
    contacts = (given,) if isinstance(given, Contact) else tuple(given) if isinstance(given, Sequence) else ()
    if not contacts or not all(isinstance(contact, Contact) for contact in contacts):
        raise ValueError(f"contact must be a Contact, or several, but is {short(given)}")
    return contacts_of_large_motions(arguments, contacts) if arguments["kinematics"] == "large" else contacts


def contacts_of_large_motions(arguments: Mapping[str, Any], contacts: Sequence[Contact]) -> tuple[Contact, ...]:
    """The contacts, whose facets that face away from a foundation may turn towards it; ValueError if there is something
    that large motions do not have."""
    if isinstance(arguments["mesh"], Deformable):
        for member in arguments["mesh"].members:
            nonlinear(member.body)
    for one in contacts:
        if any(one.closed) or one.smooth or one.surface or one.against_surface:
            raise ValueError(
                f"contact face {one.face!r}: adjust, smooth and surface describe the undeformed place; large motions "
                "measure gaps between the facets as they are"
            )
    return tuple(replace(contact, facing=False) for contact in contacts)


def on_named_surfaces(
    mesh: NamedMesh | JoinedMesh | Deformable, contacts: Sequence[Contact], supports: Sequence[Support]
) -> NamedMesh | JoinedMesh | Deformable:
    """The mesh with the surfaces that contacts and supports name for its faces; a body of the user's forms as it is."""
    if isinstance(mesh, Deformable):
        return mesh
    pairs = [(support.face, support.surface) for support in supports if isinstance(support, PrescribedDisplacement)]
    for one in contacts:
        pairs += [(one.face, one.surface), (one.against or one.face, one.against_surface)]
    return with_surfaces(mesh, {face: surface for face, surface in pairs if surface is not None})


def on_two_sides(
    mesh: NamedMesh | JoinedMesh | Deformable, contacts: Sequence[Contact], large: bool
) -> tuple[NamedMesh | JoinedMesh | Deformable, tuple[Contact, ...]]:
    """The contacts, those of a face with itself as of its `two_sides`, and the mesh with these as faces, which a body
    of the user's forms is given; ValueError on every rank if there is no such face, or in small motions no part of it
    is opposite to another one; collective."""
    sided = list(contacts)
    for number, one in enumerate(sided):
        if one.against != one.face:
            continue
        if isinstance(mesh, Deformable):
            of, face = mesh.face(one.face, "contact")[0].body.mesh, one.face.split(SEPARATOR)[-1]
        elif isinstance(mesh, JoinedMesh):
            body, face = mesh.split(one.face, "contact")
            of = mesh.bodies[body]
        else:
            of, face = mesh, one.face
        first, second, depth, meet = two_sides(of, of.facets(face, "contact"))
        if not (meet or large):
            raise ValueError(
                f"contact face {one.face!r} against itself: no part of it is before another part before deformation: "
                "make two faces of the parts that will meet, and give one against the other"
            )
        sides = dict(zip(names_of_sides(face), (first, second), strict=True))
        if isinstance(mesh, Deformable):
            of.faces.update(sides)
        elif isinstance(mesh, JoinedMesh):
            mesh = JoinedMesh({**mesh.bodies, body: replace(of, faces={**of.faces, **sides})})
        else:
            mesh = replace(of, faces={**of.faces, **sides})
        known = depth if one.depth is None and np.isfinite(depth) else one.depth
        slave, master = names_of_sides(one.face)
        sided[number] = replace(one, face=slave, against=master, depth=known, slave=one.slave or not meet)
    return mesh, tuple(sided)


def names_of_sides(face: str) -> tuple[str, str]:
    """Of the sides of a face in contact with itself."""
    return f"{face}_facing_itself_1", f"{face}_facing_itself_2"
