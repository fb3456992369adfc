"""A body of large displacements, from the user's energy or residual; and what it is at a displacement: a linear body.

At a displacement u the body is that of the small displacements du from there: its stiffness is the tangent, its load
minus the residual, its prescribed displacements are those that are left, and its nodes, areas and normals are those of
the deformed place.  So everything that poses and solves a linear contact problem takes it as it is.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray, Int32Array
from .. import compat
from ..compat import fem, ufl
from ..geometry import Turn
from ..meshes import boundary_facets
from ..ufl_values import in_cells
from .compiled_form import CompiledForm, compiled, integrals_of_kind, terms_without
from .displacement_space import free_earlier_bodies
from .elimination import AddedSprings, Made
from .form_body import BilinearForm, FormBody, FormValues
from .free_motions import FreeMotions, free_motions, names_of_components
from .lasting_supports import End
from .loads import Loading, NodalForces
from .mean_dilatation import CellProducts, tabulated
from .rigid_modes import component_modes


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a body is linearised.

    Attributes:
        u: Displacement of this rank's nodes, metres, shape (k, 3).
        loading: Minus the residual without contact, newtons, and the prescribed displacements that are left.
        prescribed: The whole prescribed displacements, 0 elsewhere, metres, shape (k, 3).
        values: Of the coefficients of the tangent.
        load: Loads in newtons, shape (k, 3); None if they are in the form, with the internal forces.
        spring: Forces of springs in newtons, shape (k, 3); None if they are in the form, beside loads that are known.
    """

    u: FloatArray
    loading: Loading
    prescribed: FloatArray
    values: FormValues
    load: FloatArray | None
    spring: FloatArray | None


class NonlinearBody(FormBody):
    """A body from the user's energy, or residual F(u; v), for large motions: find u with F(u; v) = 0 for all v.

    Displacements are Lagrange vectors of first or second order, as of `Body`; all coordinates in the forms are those
    before deformation.  The tangent is UFL's derivative.  Where a surface load follows the surface the tangent is not
    symmetric; its symmetric part is the stiffness.

    Args:
        energy: Potential energy, a form without arguments: that of the strains less the work of the loads.
        residual: In place of an energy, a linear form: the work of internal forces less that of loads.
        tangent: The derivative of the residual along a trial function; None for UFL's.
        displacement: The function u in it, which is set to the answer.
        bcs: As of `Body`.
        faces: As of `Body`.
        update: As of `Body`.

    Raises:
        ValueError: On every rank, as `Body`; if u is not in the form.
    """

    large = True
    _place: _Place | None = None
    _without_place: NonlinearBody | None = None

    def __init__(
        self,
        energy: Any = None,
        bcs: Sequence[Any] = (),
        faces: Any = None,
        *,
        displacement: Any,
        residual: Any = None,
        tangent: Any = None,
        update: Any = None,
    ):
        if (energy is None) == (residual is None):
            raise ValueError("NonlinearBody: give either energy or residual, one of the two")
        form = residual if energy is None else energy
        if not isinstance(form, ufl.Form) or displacement not in form.coefficients():
            raise ValueError(
                f"NonlinearBody: {'residual' if energy is None else 'energy'} must be a form of UFL in which the "
                "displacement is a coefficient"
            )
        V = displacement.function_space
        F = ufl.derivative(energy, displacement, ufl.TestFunction(V)) if residual is None else residual
        self._displacement = displacement
        # without the integrals that vanish, such as those of dead loads
        derivative = ufl.derivative(F, displacement, ufl.TrialFunction(V)) if tangent is None else tangent
        tangent = ufl.algorithms.expand_derivatives(derivative)
        inside, surface = (integrals_of_kind(tangent, cells) for cells in (True, False))
        self._inside, self._on_facets = inside, None if surface is None else 0.5 * (surface + ufl.adjoint(surface))
        whole = inside if self._on_facets is None else inside + self._on_facets
        with _at(displacement):
            super().__init__(whole, -F, bcs, faces, update=update)
        self._follows = surface is not None and energy is None
        self._undeformed: FloatArray = self.x
        self._function = fem.Function(self.V)
        dead = terms_without(displacement, ufl.algorithms.expand_derivatives(F))
        self._dead = None if dead is None else compiled(-dead, "residual", V.mesh.comm)
        self._potential = None if energy is None else self._at_function(energy)
        self._surface_forms: dict[tuple[bytes, bool], tuple[Any, Any]] = {}

    def _at_function(self, form: Any) -> CompiledForm:
        """A form of the displacement, compiled for `_evaluate_at`; collective."""
        return compiled(ufl.replace(form, {self._displacement: self._function}), "energy", self.comm)

    # --- at a displacement ------------------------------------------------------------------------------------------

    def linearised(
        self, u: FloatArray, time: float, before: End | None = None, previous: FloatArray | None = None
    ) -> NonlinearBody:
        """The body of small displacements from u (k, 3) in metres at a time, in a load step after the end of another,
        where u is the answer of the linear problem at a previous displacement, if one is given (`MeanVolume.ahead`);
        the stiffness is made when it is first asked for; collective."""
        return self.at_time(time)._placed(u, time, before, previous)

    def _placed(self, u: FloatArray, time: float, before: End | None, previous: FloatArray | None) -> NonlinearBody:
        _ = self.not_held, self.boundary  # once, for all places
        there = copy.copy(self)
        there._place, there._without_place, there.x = None, self._without_place or self, self.reference + u
        there._integrals, there.points_of_faces, there._assembled = {}, {}, None
        self._set(time)
        self._displacement.x.array[: u.size] = u.ravel()
        self._displacement.x.scatter_forward()
        loading, load, spring = there._outer_forces(u, time, before, previous)
        if self._products:
            there._a = _WithProducts(self._a, self._products, self.V)
        rest = loading.prescribed - self.held.held_part(u)
        values = self._a.values
        there._made = Made(values)
        there._place = _Place(
            u.copy(), Loading(time, loading.load, rest, loading.temperature), loading.prescribed, values, load, spring
        )
        return there

    def _outer_forces(
        self, u: FloatArray, time: float, before: End | None, previous: FloatArray | None
    ) -> tuple[Loading, FloatArray | None, FloatArray | None]:
        """Minus the residual and the prescribed displacements at the present displacement u; loads and forces of
        springs in it, as of `_Place`; collective."""
        if self._dead is None:
            return super().at(time), None, np.zeros_like(u)
        return super().at(time), self._dead.vector(), None

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        dead = None if self._place is None else self._place.load
        return super().loads_in(loading if dead is None else replace(loading, load=dead))

    def strain_energy(self, u: FloatArray) -> float | None:
        """Of the displacement u (k, 3) from u = 0, in joules: the user's energy without that of dead loads; None if
        there is a residual alone; collective."""
        if self._potential is None:
            return None
        work = 0.0 if self._dead is None else self.comm.allreduce(float(np.sum(self._dead.vector() * u)))
        return self._value_of(self._potential, u) - self._value_of(self._potential, np.zeros_like(u)) + work

    def strain_force(self, u: FloatArray) -> FloatArray:
        outer = (one for one in (self.place.load, self.place.spring) if one is not None)
        return sum(outer, -self.place.loading.load)

    def _value_of(self, energy: CompiledForm, u: FloatArray) -> float:
        self._evaluate_at(u)
        return energy.number(self.comm)

    @property
    def reference(self) -> FloatArray:
        return self._undeformed

    def prescribed_rate(self, start: float | None) -> FloatArray:
        """Derivative of the prescribed displacements along their common factor, in a load step from the time `start`,
        metres, shape (k, 3); collective."""
        return self.place.prescribed

    @property
    def resists_translation(self) -> bool:
        """Whether forces on the surface follow the displacement, so that the tangent times a translation is not 0."""
        return self._on_facets is not None

    @property
    def follows(self) -> bool:
        """Whether loads follow the displacement with a tangent that is not symmetric."""
        return self._follows

    def turns_since(self, start: float, time: float) -> list[Turn]:
        """Rotations in a load step that supports prescribe; not those by the user's own conditions; collective."""
        return []

    @property
    def undeformed(self) -> NonlinearBody:
        return self._without_place or self

    @property
    def _products(self) -> list[CellProducts]:
        """What the tangent has besides its form, at the displacement of the last forces."""
        return []

    @property
    def place(self) -> _Place:
        assert self._place is not None
        return self._place

    def assembled(self) -> PETSc.Mat:
        free_earlier_bodies(self.domain)  # every tangent has one more matrix
        return super().assembled()

    @property
    def _definite(self) -> bool:
        """Of the undeformed body; a deformed one may be unstable on the way to its equilibrium."""
        return not (self._place is not None and self.comm.allreduce(bool(np.any(self._place.u)), op=MPI.LOR))

    @property
    def _values(self) -> FormValues:
        if self._made.values is not None:
            return super()._values
        with _at(self._displacement):
            return super()._values

    def at_time(self, time: float) -> NonlinearBody:
        if self._place is not None:
            return self
        with _at(self._displacement):
            return cast(NonlinearBody, super().at_time(time))

    def at(self, time: float) -> Loading:
        if self._place is not None:
            return self._under_springs(self._place.loading)
        with _at(self._displacement):
            return super().at(time)

    def internal_force(self, u: FloatArray) -> FloatArray:
        return self._with_springs(super().internal_force(u), u)

    @cached_property
    def not_held(self) -> FreeMotions:
        """The rigid motions that conditions allow, at the undeformed place; collective."""
        modes, parts = component_modes(self.x, self.component, self.comm)
        return free_motions(self.x, self.component, names_of_components(parts), self.held.held_part(modes), self.comm)

    @property
    def held_everywhere(self) -> bool:
        return not len(self.not_held)

    @property
    def component_names(self) -> tuple[str, ...]:
        return self.not_held.bodies

    @property
    def free(self) -> FreeMotions:
        return self.not_held if self.held_everywhere else super().free

    def resisted(self, modes: FloatArray) -> FloatArray:
        return np.zeros_like(modes) if self.held_everywhere else super().resisted(modes)

    @property
    def ground(self) -> FloatArray | None:
        return None  # nodal forces of rigid motions are those of the stress, too

    def _works_of(self, u: Any, v: Any) -> list[Any]:
        return [ufl.replace(ufl.action(self._of_ufl[1], v), {self._displacement: self.function(self.place.u)})]

    def _changed(self, loading: Loading) -> bool:
        self._set(loading.time)
        with _at(self._displacement, self.function(self.place.u).x.array):
            return not self._same(self.place.values, self._a.values)

    def outdated(self, loading: Loading) -> bool:
        return self._place is None and super().outdated(loading)

    def blocked_displacement(self, loading: Loading) -> float:
        return super().blocked_displacement(loading) if self._place is None else 0.0

    @cached_property
    def boundary(self) -> Int32Array:
        """This rank's nodes on the boundary, sorted; collective."""
        return self.nodes_of(boundary_facets(self.domain))

    def least_volume_ratio(self, u: FloatArray) -> float:
        """Smallest det(I + grad u) of all cells: negative where one is inside out; at the nodes of each, or of
        hexahedra with the mean dilatation, of which corners may be, at the points of integration; collective."""
        self._evaluate_at(u)
        own = np.arange(self.domain.topology.index_map(3).size_local, dtype=np.int32)
        values = in_cells(self._volume_ratio, self.domain, own)
        return float(np.min(self.comm.allgather(np.min(values, initial=np.inf))))  # nan if one is

    @cached_property
    def _volume_ratio(self) -> Any:
        points = compat.interpolation_points(compat.functionspace(self.domain, self.degree, family="DG"))
        if self.has_mean_dilatation:
            points = 0.5 + (points - 0.5) * (1.0 / 3.0 if self.degree == 1 else 0.6) ** 0.5
        return fem.Expression(ufl.det(ufl.Identity(3) + ufl.grad(self._function)), points)

    # --- deformed surface -------------------------------------------------------------------------------------------

    def on_springs(self, springs: AddedSprings) -> NonlinearBody:
        there = super().on_springs(springs)
        there._assembled = None
        return there

    def made_positive(self) -> NonlinearBody:
        """The same linearised body with the nearest tangent that is positive semidefinite in every cell; collective."""
        there = copy.copy(self)
        products = self._a.products if isinstance(self._a, _WithProducts) else []
        there._a = _PositivePart(self._inside, self._on_facets, products, self.V)
        there._made, there._assembled = Made(self._values), None
        return there

    def points_of_cells(self, cells: Int32Array) -> FloatArray:
        x = super().points_of_cells(cells)
        if self._place is None:
            return x
        self._evaluate_at(self.place.u)
        x += self._function.x.array.reshape(-1, 3)[compat.cell_dofs(self.V)[cells]]
        return x

    def area_of(self, facets: Int32Array) -> FloatArray:
        if self._place is None:
            return super().area_of(facets)
        return self._integral("area", facets, lambda: self._on_surface(facets, False)[0])

    def normal_of(self, facets: Int32Array) -> FloatArray:
        if self._place is None:
            return super().normal_of(facets)
        return self._integral("normal", facets, lambda: self._on_surface(facets, False)[1])

    def positive_weights(self, facets: Int32Array) -> tuple[FloatArray, FloatArray]:
        if self._place is None or self.positive:
            return super().positive_weights(facets)
        area, normal = self.area_of(facets), self.normal_of(facets)
        node = self.vertices.node
        area[node], normal[node] = self._on_surface(facets, True)
        return area, normal

    def _evaluate_at(self, u: FloatArray) -> None:
        """Set the displacement of the forms that are evaluated; collective."""
        self._function.x.array[: u.size] = u.ravel()
        self._function.x.scatter_forward()

    def _on_surface(self, facets: Int32Array, vertices: bool) -> tuple[FloatArray, FloatArray]:
        """Integrals of the deformed area and of its normal against the hat functions, or the linear ones of the
        vertices: n da = J F^-T N dA (Nanson)."""
        key = facets.tobytes(), vertices
        if not self.comm.allreduce(key in self._surface_forms, op=MPI.LAND):
            space = self.vertices.space.V if vertices else self.V
            v, F = ufl.TestFunction(space), ufl.Identity(3) + ufl.grad(self._function)
            n = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(self.domain)
            ds = self.measure(facets)(metadata={"quadrature_degree": 4 * self.degree})
            self._surface_forms[key] = (
                fem.form(ufl.sqrt(ufl.inner(n, n)) * ufl.inner(ufl.as_vector([1.0, 1.0, 1.0]), v) * ds),
                fem.form(ufl.inner(n, v) * ds),
            )
        self._evaluate_at(self.place.u)
        area, normal = map(self._assemble, self._surface_forms[key])
        return area[:, 0].copy(), normal


@contextmanager
def _at(u: Any, values: FloatArray | float = 0.0) -> Iterator[None]:
    """With a function at these values, by default at 0, about which small motions are, in place of its present ones."""
    present = np.array(u.x.array)
    u.x.array[:] = values
    try:
        yield
    finally:
        u.x.array[:] = present


class _WithProducts(BilinearForm):
    """A tangent on V with products of vectors of cells."""

    def __init__(self, tangent: BilinearForm, products: list[CellProducts], V: Any):
        super().__init__(tangent.compiled, V)
        self._tangent, self.products = tangent, products

    def matrix(self, values: FormValues) -> PETSc.Mat:
        K = self._tangent.matrix(values)
        for part in self.products:
            part.add_to(K)
        return K

    def residual(self, values: FormValues, u: FloatArray) -> FloatArray:
        forces = self._tangent.residual(values, u)
        self._u.x.array[: u.size] = u.ravel()
        self._u.x.scatter_forward()
        for part in self.products:
            forces += part.forces(self._u)
        return forces


class _PositivePart(BilinearForm):
    """In place of a tangent the sum of the nearest positive semidefinite matrices of the cells (Higham 1988), and the
    integrals over facets as they are."""

    def __init__(self, inside: Any, on_facets: Any, products: Sequence[CellProducts], V: Any):
        super().__init__(inside if on_facets is None else inside + on_facets, V)
        self._products = products
        self._V, self._inside = V, BilinearForm(inside, V)
        self._on_facets = None if on_facets is None else BilinearForm(on_facets, V)
        self._kept: PETSc.Mat | None = None

    def matrix(self, values: FormValues) -> PETSc.Mat:
        if self._kept is None:
            self._kept = self._assembled(values)
        return self._kept.duplicate(copy=True)

    def residual(self, values: FormValues, u: FloatArray) -> FloatArray:
        return self._product(values, u)

    def _assembled(self, values: FormValues) -> PETSc.Mat:
        with self.with_coefficients(values):  # of the whole tangent
            K = self._inside.matrix(self._inside.values)
            matrices = np.sum([tabulated(part, self._V) for part in self._inside.compiled.parts], axis=0)
            surface = None if self._on_facets is None else self._on_facets.matrix(self._on_facets.values)
        for part in self._products:
            matrices[part.cells] += np.einsum("c,ci,cj->cij", part.k, part.b, part.b)
        sizes, vectors = np.linalg.eigh(matrices)
        matrices = np.einsum("cik,ck,cjk->cij", vectors, np.maximum(sizes, 0.0), vectors)
        K.zeroEntries()
        for nodes, matrix in zip(compat.cell_dofs(self._V), matrices, strict=False):
            K.setValuesBlockedLocal(nodes, nodes, matrix, addv=PETSc.InsertMode.ADD)
        K.assemble()
        if surface is not None:
            K.axpy(1.0, surface)
            surface.destroy()
        return K


def Body(
    a: Any = None,
    L: Any = None,
    bcs: Sequence[Any] = (),
    faces: Any = None,
    *,
    update: Callable[[float], object] | None = None,
    space: Any = None,
    energy: Any = None,
    residual: Any = None,
    tangent: Any = None,
    displacement: Any = None,
) -> FormBody:
    """A body from the user's forms, for contact: find u with a(u, v) = L(v) for all v, where `bcs` hold.

    Any symmetric positive definite a on Lagrange vectors of first or second order on tetrahedra or hexahedra:
    anisotropic, layered, with Robin terms that hold the body.  Lengths are in metres and forces in newtons, or in any
    consistent units.

    Coefficients of the forms and values of the boundary conditions may change.  Each state of a problem keeps the
    values that it was posed with: a later change does not reach into an earlier answer.  `ContactProblem.solve` and
    `.at` take the present values, after `update(time)`; K and A are made anew only if coefficients of a have changed.

    Args:
        a: The bilinear form, of UFL or compiled by `fem.form`.
        L: The linear form; None for no load.
        bcs: `dirichletbc` of DOLFINx on the space of a or its components; where they meet, the later one applies.
        faces: Facets by name: {"sole": facets}, with numbers of this rank, or (MeshTags, value), or a function of x,
            shape (3, k), that is True on the face; or MeshTags, whose values become names such as "3"; or the MeshData
            of dolfinx.io.gmsh, with the names of its physical groups; or a NamedMesh of the same mesh.
        update: Called with the time before anything is evaluated at that time, also for earlier times again; it sets
            coefficients, constants and boundary values, which must depend on the time alone.
        space: The function space of compiled forms, for results in the user's own space.
        energy: Of a body of large motions, in place of a, L and space: see `NonlinearBody`, which it is then.
        residual: As there.
        tangent: As there.
        displacement: As there.

    Raises:
        ValueError: On every rank, if a form, a space, a boundary condition or a face is none that can be used, if a is
            not symmetric, or arguments of both kinds are given.
    """
    if all(one is None for one in (energy, residual, displacement)):
        return FormBody(a, L, bcs, faces, update=update, space=space)
    if any(one is not None for one in (a, L, space)):
        raise ValueError("Body: give a, L and space, or energy or residual with displacement, not both")
    given: dict[str, Any] = {"displacement": displacement, "residual": residual, "tangent": tangent, "update": update}
    return NonlinearBody(energy, bcs, faces, **given)


def nonlinear(body: object) -> NonlinearBody:
    """A body as one of large displacements; ValueError if it is none."""
    if not isinstance(body, NonlinearBody):
        raise ValueError(f"large motions need NonlinearBody, or several joined, but there is a {type(body).__name__}")
    return body
