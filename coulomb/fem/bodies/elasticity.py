"""A body with all that acts on it except the foundation: supports and loads as functions of time; its stiffness K."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Final, Self, cast

import numpy as np
from petsc4py import PETSc

from ...arrays import FloatArray, Int32Array
from ...native import address, kernels
from .. import compat
from ..compat import fem, ufl
from ..geometry import (
    Amplitude,
    Coefficient,
    Field,
    amplitude_entry,
    evaluate_amplitude,
    evaluate_numbers,
    of_place,
    on_all_ranks,
)
from ..meshes import NamedMesh
from .body import STRESSES, ElasticBody, strain
from .constraints import HeldDirections, HeldNodes, SupportedNodes, contradictions, prescribed_rows
from .deformable import Deformable, SingleBody
from .displacement_space import DisplacementSpace
from .elimination import Made
from .lasting_supports import End, acts, limits_of, share_left
from .loads import (
    AppliedLoad,
    BodyForce,
    Load,
    Loading,
    NodalForces,
    Temperature,
    ThermalLoad,
    Weight,
    range_of,
    shown_range,
    vanishes,
)
from .materials import VECTORS, Materials, by_group, material_of_cells
from .mean_dilatation import LOCKING_ABOVE
from .mesh_components import mesh_components
from .rigid_modes import rigid_modes
from .shape_derivatives import load_along_places
from .supports import Spring, Support, SupportedFace

_KINDS = {
    "clamps": ("directions", "Clamp, PrescribedDisplacement, PrescribedRotation or SymmetryPlane"),
    "springs": ("along_axes", "Spring"),
    "tractions": ("nodal_force", "Traction, Pressure, TotalForce or PointLoad"),
}
"""Arguments of a body, what their entries have, and which types these are."""


class LoadedBody(ElasticBody, HeldNodes):
    """An elastic body with its supports, springs and loads; `at` gives the loading at a time.

    Where supports meet, the later one of those that act (`acting`) applies; `thermal` is its temperature, or None.

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
        self.supports, self._siblings = tuple(clamps), dict[tuple[bool, ...], LoadedBody]()
        self._given = [self._supported_nodes(support) for support in self.supports]
        self._hold(self._acting(-np.inf))
        self.springs, self._sprung_by = tuple(springs), fem.Function(self.V)
        self._by_place = {id(spring): self._at_nodes(spring) for spring in springs if of_place(spring.stiffness)}
        self._spring_forms = [
            None if spring.at_nodes else fem.form(self.spring_form(spring, self._sprung_by)) for spring in springs
        ]
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
        self._complete()

    def _complete(self) -> None:
        """Make what follows from the arguments; collective."""

    def at(self, time: float) -> Loading:
        return self.after(time, None)

    def after(self, time: float, before: End | None) -> Loading:
        load = sum((part.forces for part in self.loads_at(time)), np.zeros((self._owned, 3)))
        values = self.prescribed_values(time)
        acting = self.acting or (True,) * len(self.supports)
        begun = [one for one, on in zip(self.supports, acting, strict=True) if on and one.begin is not None]
        if before is not None and begun:  # on every rank, also on one without nodes of theirs
            values += self._left(before, time)
        return Loading(time, load, self._rows.displacement(values), self._temperature_at(time))

    def prescribed_values(self, time: float) -> FloatArray:
        """The prescribed displacements along the held directions at a time, metres; collective."""
        factors = [self._factor(support.amplitude, time, support.what) for support in self.supports]
        return np.array([0.0, *factors])[1 + self._rows.support] * self._values

    def _left(self, before: End, time: float) -> FloatArray:
        """By how much displacements along the held directions of supports that have begun differ from the given ones,
        from the end of the load step before; metres; collective."""
        along = np.einsum("ri,ri->r", self._rows.direction, before.displacement[self._rows.node])
        return self._shares(before.time, time) * (along - self.prescribed_values(before.time))

    def left_transposed(self, time: float, start: float, owed: FloatArray) -> FloatArray:
        rows, transposed = self._rows, np.zeros_like(owed)
        values = self._shares(start, time) * np.einsum("ri,ri->r", rows.dual, owed[rows.node])
        np.add.at(transposed, rows.node, values[:, None] * rows.direction)
        return transposed

    def _shares(self, then: float, time: float) -> FloatArray:
        """`share_left` of the support of each held direction."""
        shares = [0.0 if support.begin is None else share_left(support, then, time) for support in self.supports]
        return np.array(shares)[self._rows.support]

    # --- supports that begin and end ------------------------------------------------------------------------------

    @property
    def limits(self) -> tuple[float, ...]:
        return limits_of(self.supports)

    def at_time(self, time: float) -> Self:
        """The body with the supports that act at a time: itself if these are its own; collective."""
        acting = self._acting(time)
        if acting == self.acting:
            return self
        if acting not in self._siblings:
            other = copy.copy(self)
            other._hold(acting)
            self._siblings[acting] = other
        return cast(Self, self._siblings[acting])

    def held_at(self, time: float) -> HeldDirections:
        return self.at_time(time).held

    def _acting(self, time: float) -> tuple[bool, ...]:
        return tuple(acts(support, time) for support in self.supports) if self.limits else ()

    def refuse_beginning(self, time: float) -> None:
        for support in self.supports:
            if support.begin is not None and acts(support, time):
                raise ValueError(
                    f"{support.what}: at time {time:g} it moves nodes from where the load steps before have left them "
                    f"(begin = {support.begin:g}): begin at this time or before"
                )

    def blocked_displacement(self, loading: Loading) -> float:
        alone = self.nodal_displacement(self.held.free_part(loading.load))
        return alone if loading.temperature is None else max(alone, loading.temperature.displacement)

    def loads_at(self, time: float, loads: Iterable[AppliedLoad] | None = None) -> Iterator[NodalForces]:
        """The forces of every load, or of others, by itself at a time; ValueError on every rank if an amplitude has no
        finite value; collective."""
        for applied in self.loads if loads is None else loads:
            load = applied.load
            yield NodalForces(load.kind.replace(" ", "_"), load.face, applied.at(time, self.mesh.comm))

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        nodal_force = None if loading.temperature is None else loading.temperature.nodal_force
        for part in self.loads_at(loading.time):
            yield part if nodal_force is None or part.kind != ThermalLoad.kind else replace(part, forces=nodal_force)

    def heated(self, loading: Loading, change: FloatArray) -> Loading:
        assert loading.temperature is not None
        force = self.thermal_force(change)
        of_before = loading.temperature.nodal_force
        load = loading.load + force if of_before is None else loading.load + (force - of_before)
        displacement = self.thermal_displacement(change)
        temperature = Temperature(change, loading.temperature.reference, displacement, force)
        return replace(loading, load=load, temperature=temperature)

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        """Integrals of stiffness times displacement over the faces, or this at nodes; see `Deformable`."""
        for spring, form in zip(self.springs, self._spring_forms, strict=True):
            if form is None:
                yield NodalForces("spring", spring.face, -self._at_sprung_nodes(spring) * u)
                continue
            self._sprung_by.x.array[: 3 * self._owned] = u.ravel()
            self._sprung_by.x.scatter_forward()
            yield NodalForces("spring", spring.face, -self._assemble(form))

    def _at_sprung_nodes(self, spring: Spring) -> FloatArray:
        """Stiffness of springs at nodes along the axes, N/m, shape (k, 3); ValueError on every rank if there is no such
        set of nodes; collective."""
        if spring.face not in self.mesh.node_sets:
            known = ", ".join(self.mesh.node_sets) or "none"
            raise ValueError(f"spring: there is no set of nodes {spring.face!r} (there are {known})")
        stiffness = np.zeros((self._owned, 3))
        nodes = self.nodes_at(self.mesh.node_sets[spring.face])
        stiffness[nodes] = self.mesh.shares_at(self.x[nodes])[:, None] * spring.along_axes
        return stiffness

    def force_along_places(self, loading: Loading, u: FloatArray, v: FloatArray) -> FloatArray:
        change = None if loading.temperature is None else loading.temperature.change
        force = -self.work_along_places(u, v, change)
        for one in self.loads:
            shape = load_along_places(one.load, self, self.mesh, v)
            force += AppliedLoad(one.load, shape).at(loading.time, self.comm)
        on_faces, of, along = (one for one in self.springs if not one.at_nodes), self.function(u), self.function(v)
        for spring in on_faces:
            stiffness = self.spring_stiffness(spring)
            work = -sum(stiffness[k] * of[k] * along[k] for k in range(3))
            force += self.along_places(work, self.measure(self.mesh.facets(spring.face, "spring")))
        return force

    def _temperature_at(self, time: float) -> Temperature | None:
        if self.thermal is None:
            return None
        factor = self._factor(self.thermal.amplitude, time, "temperature")
        displacement = abs(factor) * self._thermal_displacement
        return Temperature(factor * self._temperature_change, self.thermal.reference, displacement)

    def _factor(self, amplitude: Amplitude, time: float, what: str) -> float:
        return on_all_ranks(lambda: evaluate_amplitude(amplitude, time, what), "", self.mesh.comm)

    def _hold(self, acting: tuple[bool, ...]) -> None:
        """Take the supports that act, all if () is given; collective."""
        self.acting, self._made = acting, Made()
        if acting:
            self._siblings[acting] = self
        given = [one if not acting or acting[k] else one.nowhere for k, one in enumerate(self._given)]
        self._rows = prescribed_rows(self._owned, [(one.nodes, one.directions) for one in given])
        self.held = self._rows.held
        self._values = np.zeros(len(self._rows.node))
        for number, one in enumerate(given):
            here = self._rows.support == number
            values = one.displacement[np.searchsorted(one.nodes, self._rows.node[here])]
            self._values[here] = np.einsum("ri,ri->r", self._rows.direction[here], values)
        begun = np.array([False, *(support.begin is not None for support in self.supports)])[1 + self._rows.support]
        self.still = self._rows.along((self._values == 0.0) & ~begun)
        self.contradictions = contradictions(given, self._rows, self._values, self.x, self.mesh.comm)

    def _supported_nodes(self, support: Support) -> SupportedNodes:
        face = self.supported_face(support, self)
        return SupportedNodes(support, face.nodes, support.directions(face), support.displacement(face))

    def supported_face(self, support: Support, place: DisplacementSpace) -> SupportedFace:
        """The face of a support of this body, or of the body at another place; collective."""
        if support.face in self.mesh.node_sets:
            nodes = self.nodes_at(self.mesh.node_sets[support.face])
            return SupportedFace(nodes, place.x[nodes], self.mesh.comm)
        facets = self.mesh.facets(support.face, support.kind)
        nodes = self.nodes_of(facets)

        def integrals() -> tuple[FloatArray, FloatArray]:
            area, normal = place.positive_weights(facets)
            return area[nodes], normal[nodes]

        return SupportedFace(nodes, place.x[nodes], self.mesh.comm, integrals)

    def spring_stiffness(self, spring: Spring) -> Any:
        """Along x, y and z, N/m^3: a Constant, or of a function of place a Function."""
        if id(spring) in self._by_place:
            return self._by_place[id(spring)]
        return fem.Constant(self.domain, np.array(spring.along_axes))

    def _at_nodes(self, spring: Spring) -> Any:
        values, nodes = np.zeros_like(self.x), self.nodes_of(self.mesh.facets(spring.face, "spring"))
        what = f"spring on {spring.face!r}: stiffness"
        values[nodes] = evaluate_numbers(cast(Coefficient, spring.stiffness), self.x[nodes], what, self.comm)[:, None]
        return self.function(values, "stiffness")

    def spring_form(self, spring: Spring, u: Any) -> Any:
        """UFL's form of the integral over its face of a spring's stiffness times u, a Function or trial function."""
        stiffness = self.spring_stiffness(spring)
        sprung = ufl.as_vector([stiffness[k] * u[k] for k in range(3)])
        return ufl.inner(sprung, self._test) * self.measure(self.mesh.facets(spring.face, "spring"))

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        shares = self._rows.shares(reaction, len(self.supports))
        for support, share in zip(self.supports, shares, strict=True):
            yield NodalForces(support.kind.replace(" ", "_"), support.face, share)

    def spring_force(self, u: FloatArray) -> FloatArray:
        return sum((one.forces for one in self.spring_forces(u)), np.zeros_like(u))

    @cached_property
    def ground(self) -> FloatArray | None:
        if not self.springs:
            return None
        modes = rigid_modes(self.x, self.mesh.comm)
        return -np.stack([self.spring_force(modes[:, :, k]) for k in range(6)], axis=2)

    def support_entries(self) -> list[dict[str, Any]]:
        supports = [
            {"kind": support.kind, "face": support.face, "holds": support.holds, **amplitude_entry(support.amplitude)}
            for support in self.supports
        ]
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


def largest_poisson(materials: Materials) -> float:
    """Poisson's ratio of the isotropic material that is nearest to incompressible, 0 without one; of hyperelastic ones
    that of small strains, which the ratio of bulk to shear modulus gives."""
    return max((one.poisson for _, one in by_group(materials) if isinstance(one.poisson, float)), default=0.0)


def locking_by_volume(bodies: Deformable) -> list[str]:
    """Warnings of first-order bodies of a material, or forms, near incompressibility without mean dilatations;
    collective."""
    remarks = []
    for member in bodies.members:
        if member.body.materials is None and member.body.locks:
            remarks.append(f"forms{f' of body {member.name!r}' if member.name else ''}: {member.body.locks}")
        highest = 0.0 if member.body.materials is None else largest_poisson(member.body.materials)
        if highest > LOCKING_ABOVE and member.body.degree == 1 and not member.body.has_mean_dilatation:
            of, table = (f" of body {member.name!r}", "[[body]]") if member.name else ("", "[mesh]")
            remarks.append(
                f"material{of}: poisson = {highest:.7g} is near 0.5: above {LOCKING_ABOVE:g} the first-order elements "
                "lock and give an answer that is far too stiff, although the discrete problem is certified; "
                f"second-order ones do not (degree = 2 in {table}, in Python coulomb.second_order(mesh)), nor do "
                "isotropic hexahedra"
            )
    return remarks


# The stiffness matrix on one rank, from the cells' matrices of FFCx's kernel, without PETSc's insertion of entries.
#
# PETSc searches the place of each entry of each cell: two thirds of the time of DOLFINx's assembly.  Here the places of
# a cell's nodes in the rows are found by one pass over each row, and matrices of cells with the same edges to rounding
# are computed once.  DOLFINx takes 8 to 11 times as long for a box (p = 10 to 24; a seventh more of the whole block at
# p = 16), of distorted cells 1.1 (27-node hexahedra), 1.4 (8-node ones), 2.1 and 2.9 times (10- and 4-node tetrahedra).

_KEPT: Final = 6  # KEPT of native/assembly.c


def assembled_matrix(form: Any, V: Any) -> PETSc.Mat:
    """The matrix of a form with integrals over all cells only, on V x V, without boundary conditions; collective."""
    kernel = compat.cell_kernel(form)
    if kernel is None or V.mesh.comm.size > 1 or np.dtype(PETSc.IntType) != np.int32:
        return compat.assemble_matrix(form)
    nodes, points = _table(compat.cell_dofs(V)), _table(compat.cell_geometry(V.mesh))
    cells, width = nodes.shape
    indptr, indices = _node_graph(nodes, int(V.dofmap.index_map.size_local))
    values = np.zeros(9 * int(indptr[-1]))
    x = np.ascontiguousarray(V.mesh.geometry.x, dtype=np.float64)
    matrices, places = np.empty((_KEPT + 1, (3 * width) ** 2)), np.empty((_KEPT + 1, 3 * points.shape[1]))
    constants, coefficients = kernel.constants, np.ascontiguousarray(kernel.coefficients, dtype=np.float64)
    kernels().assemble_cells(
        cells,
        width,
        address(nodes),
        points.shape[1],
        address(points),
        address(x),
        address(constants),
        coefficients.shape[1],
        address(coefficients),
        kernel.address,
        address(indptr),
        address(indices),
        address(values),
        address(matrices),
        address(places),
    )
    count = len(indptr) - 1
    rows, columns = np.empty(3 * count + 1, dtype=np.int32), np.empty(len(values), dtype=np.int32)
    kernels().displacements(count, *map(address, (indptr, indices, rows, columns)))
    K = PETSc.Mat().createAIJWithArrays((3 * count, 3 * count), (rows, columns, values), comm=V.mesh.comm)
    K.setBlockSize(3)
    K.assemble()
    K.setAttr("mesh", V.mesh)  # keeps the communicator alive
    return K


def _node_graph(nodes: Int32Array, count: int) -> tuple[Int32Array, Int32Array]:
    """The nodes that are in a cell with each node, ascending, in compressed form."""
    cells, width = nodes.shape
    begin, of, mark = np.zeros(count + 1, np.int32), np.empty(nodes.size, np.int32), np.full(count, -1, np.int32)
    indptr = np.empty(count + 1, dtype=np.int32)
    kernels().cells_of_nodes(count, cells, width, *map(address, (nodes, begin, of)))
    given = (count, width, *map(address, (nodes, begin, of, mark, indptr)))
    kernels().neighbours(*given, None)
    indices = np.empty(int(indptr[-1]), dtype=np.int32)
    kernels().neighbours(*given, address(indices))
    return indptr, indices


def _table(rows: Any) -> Int32Array:
    return np.ascontiguousarray(rows, dtype=np.int32)


class Elasticity(LoadedBody, SingleBody):
    """K u = f on hexahedra or tetrahedra of first or second order, with prescribed displacements and springs.

    Held directions are eliminated (`eliminated`); f, which depends on time, has the prescribed values, so that K u = f
    holds them exactly.  Springs (Winkler foundations) are integrated over their faces with the functions
    of the elements: exact for every displacement that these have.

    Raises:
        ValueError: As `LoadedBody`, or if a material is for large motions.
    """

    def _complete(self) -> None:
        for _, material in by_group(self.materials or {}):
            if hasattr(material, "law"):
                raise ValueError(
                    f'material: {material!r} is for large motions: ContactProblem(..., kinematics="large")'
                )
        self.component, self.sprung = mesh_components(self), bool(self.springs)

    def assembled(self) -> PETSc.Mat:
        trial = ufl.TrialFunction(self.V)
        K = assembled_matrix(fem.form(ufl.inner(self._stress(trial), strain(self._test)) * self._dx), self.V)
        if self._mean is not None:
            self._mean.add_to(K)
        at_nodes = [self._at_sprung_nodes(spring) for spring in self.springs if spring.at_nodes]
        if at_nodes:
            diagonal = K.getDiagonal()
            diagonal.array[:] += np.sum(at_nodes, axis=0).ravel()
            K.setDiagonal(diagonal)
            diagonal.destroy()
        for spring in self.springs:
            if spring.at_nodes:
                continue
            S = compat.assemble_matrix(fem.form(self.spring_form(spring, trial)))
            K.axpy(1.0, S, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            S.destroy()
        return K

    def resisted(self, modes: FloatArray) -> FloatArray:
        sprung = np.zeros((self._owned, 3, 1))
        for spring in self.springs:
            if spring.at_nodes:
                sprung[:, :, 0][self._at_sprung_nodes(spring) > 0.0] = 1.0
            else:
                sprung[np.ix_(self.nodes(spring.face, "spring"), spring.along_axes > 0.0)] = 1.0
        return sprung * modes
