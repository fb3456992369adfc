"""A body from the user's forms: a(u, v) = L(v) with Dirichlet conditions, as in a script of DOLFINx."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray
from .. import compat
from ..compat import fem, ufl
from ..geometry import first_place, on_all_ranks
from ..meshes import boundary_facets, bounds
from .coefficients import along_coefficient
from .compiled_form import compiled, with_own_degrees
from .constraints import diagonal_of, prescribed_rows, rows_of
from .deformable import SingleBody
from .elimination import Made
from .form_checks import named_mesh, refuse_bcs, refuse_unsymmetric, space_of_forms
from .free_motions import FreeMotions, free_motions, names_of_components
from .loads import Loading, NodalForces
from .mesh_components import mesh_components
from .rigid_modes import component_modes, of_components, rigid_modes


@dataclass(frozen=True, eq=False)
class FormValues:
    """The values of the coefficients of a form at one time, on this rank: functions with ghosts, constants packed."""

    functions: tuple[FloatArray, ...]
    constants: FloatArray

    def same(self, other: FormValues) -> bool:
        pairs = zip(self.functions, other.functions, strict=True)
        equal = all(np.array_equal(one, two) for one, two in pairs)
        return equal and np.array_equal(self.constants, other.constants)


class BilinearForm:
    """A bilinear form, of UFL or compiled, on a space of displacements.

    Of a UFL form the residual is the compiled action a(u, v) for all v; of a compiled form, of which no action can be
    made, it is the product of a matrix that is assembled anew.
    """

    def __init__(self, a: Any, V: Any):
        self.compiled, self._u = compiled(a, "a", V.mesh.comm), fem.Function(V)
        of_ufl = isinstance(a, ufl.Form)
        self._action = compiled(ufl.action(a, self._u), "a", V.mesh.comm) if of_ufl else None

    @property
    def values(self) -> FormValues:
        functions = tuple(np.array(function.x.array) for function in self.compiled.functions)
        return FormValues(functions, self.compiled.constants)

    def suspects(self, values: FormValues) -> str:
        """Which of these values make a vanish or are not finite, for the end of a message; collective."""
        comm = self._u.function_space.mesh.comm
        names = [f"the function {function.name!r}" for function in self.compiled.functions]
        sizes = [float(np.max(np.abs(function), initial=0.0)) for function in values.functions]
        sizes = [float(np.max(comm.allgather(size))) for size in sizes]  # nan is the largest
        names += ["a constant"] * len(values.constants)
        sizes += map(float, np.abs(values.constants))
        wrong = ((name, size) for name, size in zip(names, sizes, strict=True) if not 0.0 < size < np.inf)
        said = (f"; {name} in a is {'0' if size == 0.0 else 'not finite'}" for name, size in wrong)
        return "".join(dict.fromkeys(said))

    def matrix(self, values: FormValues) -> PETSc.Mat:
        """The matrix with these values of the coefficients; collective."""
        with self.with_coefficients(values):
            return self.compiled.matrix(values.constants)

    def residual(self, values: FormValues, u: FloatArray) -> FloatArray:
        """a(u, v) of all hat functions v, for nodal vectors u; shapes (k, 3); collective."""
        if self._action is None:
            return self._product(values, u)
        own = self._u.x.array[: u.size]
        own[:] = u.ravel()
        self._u.x.scatter_forward()
        with self.with_coefficients(values):
            return self._action.vector(values.constants)

    def _product(self, values: FormValues, u: FloatArray) -> FloatArray:
        K = self.matrix(values)
        forces = rows_of(K, u)
        K.destroy()
        return forces

    @contextmanager
    def with_coefficients(self, values: FormValues) -> Iterator[None]:
        """With the user's functions at other values, which are reset afterwards."""
        functions = self.compiled.functions
        present = [np.array(function.x.array) for function in functions]
        for function, taken in zip(functions, values.functions, strict=True):
            function.x.array[:] = taken
        try:
            yield
        finally:
            for function, taken in zip(functions, present, strict=True):
                function.x.array[:] = taken


_BULK: Final = 9.67
"""Bulk over shear modulus at a Poisson's ratio of `LOCKING_ABOVE`."""

_BENDING: Final = 2.0
"""Energy of bending over the exact one from which on cells are said to lock."""

_FREE: Final = 1e-12
"""Energy of a rigid motion below which it is free, per node of that motion and largest diagonal entry of a."""


@dataclass
class _SharedState:
    """What the copies of a body share: the last time of the callable, what was made last of the stiffness, and whether
    its cells lock, in words."""

    time: float | None = None
    made: Made | None = None
    locks: str | None = None


class FormBody(SingleBody):
    """A body of small strains from the user's forms: find u with a(u, v) = L(v) for all v, where `bcs` hold.

    Arguments and errors are those of `Body`.
    """

    def __init__(
        self,
        a: Any,
        L: Any = None,
        bcs: Sequence[Any] = (),
        faces: Any = None,
        *,
        update: Callable[[float], object] | None = None,
        space: Any = None,
    ):
        V = space_of_forms(a, L, space)
        self.mesh = named_mesh(V.mesh, {} if faces is None else faces)
        super().__init__(V)
        self._update, self._present = update, _SharedState()
        self._signatures = {
            name: str(form.signature()) if hasattr(form, "signature") else None for name, form in (("a", a), ("L", L))
        }
        self._degree = compat.lagrange_vectors(V)[1]
        self._of_ufl = a, L
        self._a, self._L = BilinearForm(a, V), None if L is None else compiled(L, "L", V.mesh.comm)
        self._bcs = tuple(refuse_bcs(bcs, V))
        held = [self._held_by(bc) for bc in self._bcs]
        nodes = [np.flatnonzero(np.any(one, axis=1)) for one in held]
        each = [(at, one[at][:, :, None] * np.eye(3)) for at, one in zip(nodes, held, strict=True)]
        self._rows = prescribed_rows(len(self.x), each)
        self.held = self._rows.held
        along = np.einsum("ri,ri->r", self._rows.direction, self._prescribed()[self._rows.node])
        self.still = self._rows.along(along == 0.0)
        self.component, self._made = mesh_components(self), Made()
        self.contradictions, self.materials, self.loads = (), None, ()
        self._assembled: PETSc.Mat | None = None
        if update is None:  # else when the coefficients have been set for a time
            self._assembled = self.assembled()

    def update(self) -> None:
        """Coefficients have been changed by hand: the callable is called again before the next evaluation."""
        self._present.time = None

    @property
    def _values(self) -> FormValues:
        """Of the coefficients of a, those that its stiffness has."""
        if self._made.values is None:
            self._made.values = self._a.values
        return self._made.values

    def assembled(self) -> PETSc.Mat:
        K, self._assembled = self._assembled, None
        if K is None:
            K = self._a.matrix(self._values)
            refuse_unsymmetric(K, self.x, self._a.suspects(self._values), self._definite)
            self._made.diagonal = diagonal_of(K).reshape(-1, 3)
        return K

    @property
    def _definite(self) -> bool:
        """Whether the matrix of a must have a positive diagonal; the same on every rank, collective."""
        return True

    @property
    def _diagonal(self) -> FloatArray:
        """Of the matrix of a, N/m, shape (k, 3)."""
        if self._made.diagonal is None:
            self._assembled = self.assembled()
        assert self._made.diagonal is not None
        return self._made.diagonal

    @property
    def ground(self) -> FloatArray | None:
        return self._grounded[0]

    def resisted(self, modes: FloatArray) -> FloatArray:
        return self._grounded[1].projected(modes, self.x)

    @property
    def _grounded(self) -> tuple[FloatArray | None, FreeMotions]:
        """Nodal forces of the rigid modes, None if they are rounding errors, and the rigid motions that a does not
        resist; collective."""
        if self._made.ground is None:
            comm, modes = self.mesh.comm, rigid_modes(self.x, self.mesh.comm)
            forces = np.stack([self.internal_force(modes[:, :, j]) for j in range(6)], axis=2)
            sizes = np.sqrt(comm.allreduce(np.einsum("kcj,kcj->j", forces, forces)))
            stiff = np.max(comm.allgather(float(np.max(self._diagonal, initial=0.0))))
            noise = 1e-12 * np.sqrt(comm.allreduce(float(np.sum(self._diagonal**2))))
            parts = component_modes(self.x, self.component, comm)[1]
            of_each = of_components(forces / stiff, self.x, self.component, parts, comm)
            free = free_motions(self.x, self.component, names_of_components(parts), of_each, comm, _FREE)
            self._made.ground = forces if np.max(sizes) > noise else None, free
        return self._made.ground

    @property
    def locks(self) -> str:
        """Whether the first-order cells of forms near incompressibility are far too stiff in bending without change of
        volume, (x z, 0, -(x^2 + z^2)/2) along the longest and the shortest axis, in words; collective."""
        if self._present.locks is None:
            bulk, bending = self._stiffer() if self._degree == 1 else (0.0, 0.0)
            self._present.locks = (
                f"bulk modulus {bulk:.3g} times that of shear: first-order cells are {bending:.2g} times too stiff in "
                "bending, although the discrete problem is certified; a space of second order is not, nor hexahedra of "
                "which one point a cell integrates changes of volume (docs/forms.md)"
                if bulk > _BULK and bending > _BENDING
                else ""
            )
        return self._present.locks

    def _stiffer(self) -> tuple[float, float]:
        """Bulk over shear modulus, as means, and the energy of bending over that of this shear modulus; collective."""
        comm, outward = self.mesh.comm, self.normal_of(boundary_facets(self.domain))
        low, high = bounds(comm, self.x)
        x, order = self.x - 0.5 * (low + high), np.argsort(high - low)
        z, along = x[:, order[0]], x[:, order[2]]
        sheared, bent = np.zeros((2, *x.shape))
        sheared[:, order[2]], sheared[:, order[0]] = along, -z
        bent[:, order[2]], bent[:, order[0]] = along * z, -0.5 * (along**2 + z**2)
        sums = [np.vdot(u, self.internal_force(u)) for u in (x, sheared, bent)]
        sums += [np.vdot(outward, x) / 3.0, np.vdot(outward[:, order[0]], z**3) / 3.0]
        of_volume, of_shear, of_bending, volume, second = comm.allreduce(np.array(sums))
        if not (of_shear > 0.0 and second > 0.0):
            return 0.0, 0.0  # forms that are refused
        shear = of_shear / (4.0 * volume)
        return of_volume / (9.0 * volume * shear), of_bending / (4.0 * shear * second)

    def suspects(self) -> str:
        return self._a.suspects(self._values)

    def internal_force(self, u: FloatArray) -> FloatArray:
        return self._a.residual(self._values, u)

    def at_time(self, time: float) -> FormBody:
        self._set(time)
        values = self._a.values
        if self._same(self._values, values):
            return self
        last = self._present.made
        if last is None or not self._same(last.values, values):
            last = self._present.made = Made(values)
        then = copy.copy(self)
        then._made, then._assembled = last, None
        return then

    def _same(self, one: FormValues, values: FormValues) -> bool:
        return self.mesh.comm.allreduce(one.same(values), op=MPI.LAND)

    def at(self, time: float) -> Loading:
        """L and the boundary values at a time; ValueError on every rank if one is not finite, or the user's callable
        fails; collective."""
        self._set(time)
        load = np.zeros_like(self.x) if self._L is None else self._L.vector()

        def finite() -> FloatArray:
            if not np.all(np.isfinite(load)):
                raise ValueError("has values that are not finite: look at its coefficients")
            return load

        return Loading(time, on_all_ranks(finite, "Body: L", self.mesh.comm), self._prescribed())

    def force_along_places(self, loading: Loading, u: FloatArray, v: FloatArray) -> FloatArray:
        """By UFL's derivative along coordinates; u and v are fixed at the nodes, as the coefficients are."""
        x, what = ufl.SpatialCoordinate(self.domain), "the derivative along places"
        shapes = [ufl.derivative(work, x, self._test) for work in self._works(loading, u, v)]
        return np.sum([compiled(shape, what, self.comm).vector() for shape in shapes], axis=0)

    def force_along(self, coefficient: Any, loading: Loading, u: FloatArray, v: FloatArray) -> FloatArray | None:
        """Derivatives, along a Constant or Function in the forms, of the work along v of loads and internal forces at
        displacements u, both (k, 3) (`along_coefficient`); None if it is in none of them; collective.

        Raises:
            ValueError: On every rank, if the forms are compiled, or other coefficients have changed since.
        """
        return along_coefficient(self._works(loading, u, v), coefficient, self._per_cell(()))

    def _works(self, loading: Loading, u: FloatArray, v: FloatArray) -> list[Any]:
        """The work along v of internal forces at u, and of loads, as forms of UFL without arguments, integrated as
        those of the body; ValueError on every rank if they are not known; collective."""
        if any(form is not None and not isinstance(form, ufl.Form) for form in self._of_ufl):
            raise ValueError("derivatives along places and coefficients need forms of UFL, not compiled ones")
        if self._changed(loading):
            raise ValueError("derivatives need the coefficients that the answer has: they have changed")
        return [with_own_degrees(work) for work in self._works_of(self.function(u), self.function(v))]

    def _works_of(self, u: Any, v: Any) -> list[Any]:
        a, L = self._of_ufl
        return [-ufl.action(ufl.action(a, u), v), *([] if L is None else [ufl.action(L, v)])]

    def _changed(self, loading: Loading) -> bool:
        """Whether the coefficients are others than those of the answer; collective."""
        return self.outdated(loading)

    def outdated(self, loading: Loading) -> bool:
        if self.at_time(loading.time) is not self:
            return True
        now = self.at(loading.time)
        same = np.array_equal(now.load, loading.load) and np.array_equal(now.prescribed, loading.prescribed)
        return not self.mesh.comm.allreduce(same, op=MPI.LAND)

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        if self._L is not None:
            yield NodalForces("load", None, loading.load)

    def blocked_displacement(self, loading: Loading) -> float:
        """Mean displacement of the nodes, each alone under its part of L, weighted with these forces; collective."""
        comm = self.mesh.comm
        largest = float(np.max(comm.allgather(float(np.max(np.abs(loading.load), initial=0.0)))))
        load = loading.load / (largest or 1.0)
        work: float = comm.allreduce(float(np.sum(load**2 / self._diagonal)))
        size: float = comm.allreduce(float(np.sum(np.abs(load))))
        return largest * work / (size or 1.0)

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        for share in self._rows.shares(reaction, len(self._bcs)):
            yield NodalForces("dirichlet", None, share)

    def support_entries(self) -> list[dict[str, Any]]:
        entries = []
        for bc in self._bcs:
            mine = self._held_by(bc)
            nodes = self.comm.allreduce(int(np.sum(np.any(mine, axis=1))))
            along = self.comm.allreduce(np.any(mine, axis=0).astype(int))
            letters = ", ".join(letter for letter, held in zip("xyz", along, strict=True) if held)
            entries.append({"kind": "dirichlet", "face": None, "holds": f"{letters or 'nothing'} of {nodes} nodes"})
        return entries

    def _held_by(self, bc: Any) -> BoolArray:
        """Which components of this rank's nodes a condition holds, shape (k, 3)."""
        held = np.zeros(self.x.size, dtype=bool)
        dofs = np.asarray(bc.dof_indices()[0])
        held[dofs[dofs < self.x.size]] = True
        return held.reshape(-1, 3)

    def _prescribed(self) -> FloatArray:
        """The displacements that the conditions prescribe now, 0 elsewhere, metres, shape (k, 3); of those that meet,
        the later one applies; ValueError on every rank if one is not finite; collective."""
        dofs, x = self.V.dofmap.index_map, self.undeformed.x
        values, held = np.zeros(3 * (dofs.size_local + dofs.num_ghosts)), np.zeros_like(x)
        for bc in self._bcs:
            compat.set_values(bc, values)
        components = self._rows.held.components
        held[components] = values[: x.size].reshape(-1, 3)[components]

        def finite() -> FloatArray:
            if not np.all(np.isfinite(held)):
                place = first_place(x, ~np.all(np.isfinite(held), axis=1))
                raise ValueError(f"a prescribed displacement is not finite (first seen at x = {place})")
            return held

        return on_all_ranks(finite, "Body: bcs", self.comm)

    def cell_fields(self, u: Any, loading: Loading) -> list[Any]:
        """None: which stress belongs to a is not known; see `Solution.write`."""
        return []

    def forms(self) -> Mapping[str, Any] | None:
        """What can be recorded of the forms: signatures of those of UFL, degree of the space, constants, conditions."""
        return {
            **self._signatures,
            "degree": self._degree,
            "bcs": len(self._bcs),
            "constants": {
                "a": self._values.constants.tolist(),
                "L": [] if self._L is None else self._L.constants.tolist(),
            },
        }

    def _set(self, time: float) -> None:
        """Call the user's callable for a time, unless it was the last one."""
        if self._update is not None and self._present.time != time:
            update = self._update
            on_all_ranks(lambda: update(time), f"Body: update({time:g})", self.mesh.comm)
            self._present.time = time
