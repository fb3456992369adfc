"""What a contact problem needs of bodies: K, loads at a time, prescribed displacements, internal forces without K.

`Elasticity` is a body of materials and loads of this package, `Body` one of the user's forms, each on its own mesh;
`JoinedBodies` are several of them together.
"""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from .. import compat
from ..meshes import SEPARATOR, NamedMesh, Slice, boundary_facets
from .constraint_transposes import owed_before
from .constraints import HeldDirections
from .displacement_space import DisplacementSpace
from .elimination import ReducedBodies
from .free_motions import names_of_components
from .lasting_supports import End
from .loads import AppliedLoad, Loading, NodalForces
from .materials import Materials
from .rigid_modes import Wrench, component_modes


@dataclass(frozen=True)
class Member:
    """One of the bodies of a problem, and its nodes among those of this rank; the name is "" if it is the only one."""

    name: str
    body: SingleBody
    nodes: slice

    def called(self, face: str | None) -> str | None:
        """Name of a face of this body in the problem, such as "lower:top"; that of the body for None."""
        if not self.name:
            return face
        return self.name if face is None else f"{self.name}{SEPARATOR}{face}"


class Deformable(ReducedBodies):
    """Linear elastic bodies with their supports and loads.

    Attributes:
        materials: None if they are in the user's forms.
        contradictions: Messages about supports that prescribe different displacements where they meet.
        acting: Which supports and ties act; () if all act at all times.
    """

    acting: tuple[bool, ...] = ()
    contradictions: tuple[str, ...]
    materials: Materials | None
    loads: tuple[AppliedLoad, ...]

    @property
    @abstractmethod
    def members(self) -> tuple[Member, ...]:
        """The bodies; this rank's nodes are those of one after the other."""

    @property
    def slice(self) -> Slice | None:
        """Of what plane or axisymmetric body the meshes are one layer; None of others."""
        return self.members[0].body.mesh.slice

    @property
    def copies(self) -> float:
        """How many such layers make the body that totals are of; 1 where the mesh is the body."""
        return self.members[0].body.mesh.copies

    @property
    def alone(self) -> SingleBody:
        """The only body; ValueError if there are several."""
        if len(self.members) > 1:
            names = ", ".join(member.name for member in self.members)
            raise ValueError(
                f"there are several bodies, {names}: take one of elasticity.members, or of Solution.functions, as "
                f'solution.functions[{self.members[0].name!r}], or a field of it, as ...("pressure")'
            )
        return self.members[0].body

    @abstractmethod
    def face(self, name: str, what: str) -> tuple[Member, Int32Array]:
        """A face: the body that it is on, and this rank's facets of the body's mesh; ValueError, beginning with `what`,
        if there is none."""

    def nodes(self, face: str, what: str) -> Int32Array:
        """This rank's nodes on a face, sorted; errors as of `face`."""
        member, facets = self.face(face, what)
        return (member.nodes.start + member.body.nodes_of(facets)).astype(np.int32)

    @abstractmethod
    def numbers_of(self, member: Member, numbers: IntArray) -> IntArray:
        """Global numbers of nodes, of any rank, from their global numbers in the space of a body alone."""

    @property
    def comm(self) -> MPI.Comm:
        return self.members[0].body.comm

    @property
    def lifetime(self) -> object:
        return tuple(member.body.lifetime for member in self.members)

    def linear_between_vertices(self, values: FloatArray) -> FloatArray:
        """Of bodies of 10-node tetrahedra; on others every node has its value."""
        field = values.copy()
        for member in self.members:
            if not member.body.positive:
                field[member.nodes] = member.body.linear_between_vertices(values[member.nodes])
        return field

    def largest_gradient(self, u: FloatArray) -> float:
        """Largest norm of the displacement gradient of u (k, 3), over all ranks; collective."""
        return float(np.max([member.body.largest_gradient(u[member.nodes]) for member in self.members]))

    @property
    def limits(self) -> tuple[float, ...]:
        """The times at which load steps must end: supports or ties begin or end, tightening ends."""
        return ()

    @abstractmethod
    def internal_force(self, u: FloatArray) -> FloatArray:
        """Internal nodal forces of u in newtons, assembled without K; shapes (k, 3); collective."""

    def at_time(self, time: float) -> Deformable:
        """The body with the supports that act, and the coefficients that its stiffness has, at a time: itself if these
        do not change; collective."""
        return self

    def held_at(self, time: float) -> HeldDirections:
        """The directions that supports hold at a time; collective."""
        return self.held

    def at(self, time: float) -> Loading:
        """Loads and prescribed displacements at a time; ValueError on every rank if they are not finite then;
        collective."""
        return self.after(time, None)

    def refuse_beginning(self, time: float) -> None:
        """Raise ValueError on every rank if what supports prescribe at a time depends on load steps before."""
        return

    def depends_on_steps(self, time: float) -> bool:
        """Whether displacements that supports prescribe at a time depend on load steps before."""
        try:
            self.refuse_beginning(time)
        except ValueError:
            return True
        return False

    def after(self, time: float, before: End | None) -> Loading:
        """Loads and prescribed displacements at a time, after a load step, from the end of which supports that have
        begun move their nodes, and bolts are locked; errors as of `at`; collective."""
        return self.at(time)

    def after_transposed(self, time: float, start: float, owed: FloatArray) -> FloatArray:
        """What a function owes to the displacements after a load step that ended at `start`, per metre, from what it
        owes to those that are prescribed at a time (`after`), ties included; shapes (k, 3); collective."""
        of_nodes, before = self.reduction.transferred(owed), owed_before(self.constraints, time, start, owed)
        for one in self.members:
            before[one.nodes] += one.body.left_transposed(time, start, of_nodes[one.nodes])
        return before

    def left_transposed(self, time: float, start: float, owed: FloatArray) -> FloatArray:
        """As `after_transposed`, by supports that have begun, from what a function owes to what supports prescribe."""
        return np.zeros_like(owed)

    def outdated(self, loading: Loading) -> bool:
        """Whether loads, prescribed displacements or coefficients have been changed by hand since a loading was
        evaluated; collective."""
        return False

    def heated(self, loading: Loading, change: FloatArray) -> Loading:
        """A loading of bodies with a temperature that follows from conduction, at changes of it from the reference (k,)
        in kelvin, in place of those that the loading has; collective."""
        raise NotImplementedError(f"heat: not for {type(self).__name__}")

    @abstractmethod
    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        """The forces of every load by itself; collective."""

    @abstractmethod
    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        """The forces of every support by itself, in the order given: each held direction belongs to the support that
        prescribes it.

        Args:
            reaction: `held_part` of internal forces minus loads, springs and contact forces, newtons, shape (k, 3).
        """

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        """The forces of every spring by itself at displacements u (k, 3), in the order given; collective."""
        yield from ()

    def spring_force(self, u: FloatArray) -> FloatArray:
        """Forces of the springs on the body at displacements u, newtons; shapes (k, 3); collective."""
        return np.zeros_like(u)

    @abstractmethod
    def shifted(self, shift: FloatArray) -> AbstractContextManager[Deformable]:
        """The bodies with nodes shifted by (k, 3) metres, for surfaces: stiffness and loads are not; the meshes have
        other coordinates meanwhile; collective."""

    def blocked_displacement(self, loading: Loading) -> float:
        """Scale in metres of the displacements that loads would cause in one body where contact and supports let
        nothing move; 0 if there is none beside the displacement itself; collective."""
        return 0.0

    def blocked_displacements(self, loading: Loading) -> tuple[float, ...]:
        """`blocked_displacement` of every body; collective."""
        return (self.blocked_displacement(loading),)

    @abstractmethod
    def support_entries(self) -> list[dict[str, Any]]:
        """Kind, face and what it holds, with its `amplitude_entry`, of every support and spring."""

    def forms(self) -> Mapping[str, Any] | None:
        """What is recorded of the user's forms; None for a body without."""
        return None

    def let_go_of_matrix(self) -> None:
        """Free K, where it can be assembled as it is if it is asked for again: not of user's forms, the coefficients of
        which may change, nor of bodies that move on; collective."""
        if self.forms() is None and not any(member.body.large for member in self.members):
            self.reduced.let_go()

    def f(self, loading: Loading) -> PETSc.Vec:
        """The load in newtons, with the prescribed displacements included, so that K u = f; collective."""
        f, forces, g = self.reduced.vector(), loading.load, loading.prescribed
        if self.comm.allreduce(bool(np.any(g)), op=MPI.LOR):
            forces = forces - self.internal_force(g) + self.spring_force(g)
        along = self.reduction.along(forces, loading.tension)
        along[: len(self.x)] += self.reduced.held_diagonal * self.held.held_part(g)
        f.array[:] = along.ravel()
        return f


class SingleBody(DisplacementSpace, Deformable):
    """A body on one mesh; methods of `DisplacementSpace` come before those of `Deformable`.

    Attributes:
        sprung: Whether springs are on its faces; None where what resists rigid motions is in the user's forms.
    """

    mesh: NamedMesh
    large = False

    sprung: bool | None = None

    def force_along_places(self, loading: Loading, u: FloatArray, v: FloatArray) -> FloatArray:
        """Derivatives, along the places of nodes, of the work along v of loads, springs and internal forces at
        displacements u, newtons, all of shape (k, 3), where values at nodes and cells stay; collective.

        Raises:
            ValueError: On every rank, if they are not known of such a body or load.
        """
        raise ValueError(f"derivatives along places are not known of a {type(self).__name__}")

    def turn_of_guides(self) -> float:
        """In large motions the largest angle in degrees by which the directions of supports that are curved guides,
        with normals or a direction by place, turn from nodes before deformation to where these are now; collective."""
        return 0.0

    def strain_energy(self, u: FloatArray) -> float | None:
        """Of the displacement u (k, 3) from u = 0, in joules, without that of springs; None if it is not known;
        collective."""
        return self.comm.allreduce(0.5 * float(np.vdot(u, self.internal_force(u))))

    def strain_force(self, u: FloatArray) -> FloatArray:
        """Its derivative along u, nodal forces in newtons, shape (k, 3); at a deformed place, there; collective."""
        return self.internal_force(u)

    def with_faces(self, faces: Mapping[str, Int32Array]) -> Self:
        """The same with other facets of some faces, this rank's by name, which no load or support is on."""
        there = copy.copy(self)
        there.mesh = replace(self.mesh, faces={**self.mesh.faces, **faces})
        return there

    @contextmanager
    def shifted(self, shift: FloatArray) -> Iterator[SingleBody]:
        points, there = self.domain.geometry.x, copy.copy(self)
        known = points.copy()
        there._integrals, there.points_of_faces = {}, {}
        vars(there).pop("vertices", None)
        try:
            of_nodes = self.function(shift).x.array.reshape(-1, 3)[compat.cell_dofs(self.V)]
            places = compat.cell_geometry(self.domain)
            points[places] = known[places] + of_nodes
            there.x = there._coordinates()
            yield there
        finally:
            points[:] = known

    def turning_loads(self) -> Iterator[tuple[Int32Array, FloatArray, FloatArray]]:
        """As of `HyperelasticBody`; none by default."""
        yield from ()

    def wrenches(self) -> list[Wrench]:
        """In large motions forces and moments at points that move with faces, at the present place; collective."""
        return []

    @property
    def locks(self) -> str:
        """Why cells of the user's forms are far too stiff, in words; empty if they are not; collective."""
        return ""

    @property
    def has_mean_dilatation(self) -> bool:
        """Whether volumes of nearly incompressible cells change by their mean (`mean_dilatation`)."""
        return False

    @property
    def held_everywhere(self) -> bool:
        """Whether supports are known to prevent its rigid motions wherever it is."""
        return False

    @property
    def component_names(self) -> tuple[str, ...]:
        _, parts = component_modes(self.x, self.component, self.comm)
        return names_of_components(parts)

    @property
    def anchor_places(self) -> tuple[BoolArray, ...]:
        """Which of this rank's nodes suit as anchors of free motions, the best first, shapes (k,): those inside, which
        cannot be in contact; those that are not held obliquely; all."""
        everywhere = np.ones(self._owned, dtype=bool)
        along_axes, inside = everywhere.copy(), everywhere.copy()
        along_axes[self.held.nodes[self.held.oblique]] = False
        inside[self.nodes_of(boundary_facets(self.domain))] = False
        return inside & along_axes, along_axes, everywhere

    def suspects(self) -> str:
        """Coefficients that may make its stiffness singular, for the end of a message; collective."""
        return ""

    @property
    def members(self) -> tuple[Member, ...]:
        return (Member("", self, slice(0, self._owned)),)

    @property
    def without_area(self) -> Int32Array:
        """The integral of r N over r is 0 on the axis."""
        of = self.mesh.slice
        if of is None or not of.axis or self.degree == 1:
            return np.empty(0, dtype=np.int32)
        return self.nodes_of(self.mesh.faces["axis"])

    def face(self, name: str, what: str) -> tuple[Member, Int32Array]:
        return self.members[0], self.mesh.facets(name, what)

    def numbers_of(self, member: Member, numbers: IntArray) -> IntArray:
        return numbers

    @abstractmethod
    def cell_fields(self, u: Any, loading: Loading) -> list[Any]:
        """Functions that are constant on every cell, to be written beside u, a Function of V, under a loading."""

    @property
    def numbers_per_cell(self) -> int:
        """How many numbers per cell `cell_fields` has."""
        return 3
