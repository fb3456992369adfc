"""Nearly incompressible first-order hexahedra: the volume changes by its mean over each cell (B-bar).

A hexahedron of first order has 8 integration points and 24 unknowns: with a volume that is kept at every point it
hardly moves (volumetric locking).  With the mean in place of the dilatation at each point,

    div u  ->  D(u) = b . u / V,      b . u = integral of div u over the cell,  V its volume

it keeps its volume as a whole (T. J. R. Hughes: Generalization of selective integration procedures to anisotropic and
nonlinear media, Int. J. Numer. Methods Eng. 15, 1980; J. C. Nagtegaal, D. M. Parks, J. R. Rice 1974).  The stress is
2 mu dev(strain) + kappa D I, and the stiffness of a cell has the product kappa/V b b^T in place of the integral of
kappa div u div v.  b is the integral itself on distorted cells, too, so that patch tests hold, as they do not by the
slopes at the middle of the cell.  It is the Q1-P0 element: pressures are constant in cells, and may alternate from cell
to cell (checkerboard) where a mesh is regular and all its boundary is held; nodal forces and displacements do not.

Of tetrahedra of first order the mean is the value itself: it changes nothing, and they lock all the same.  Cells of
second order have it in large motions beside a part at every point (AT_POINTS).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, IntArray
from .. import compat
from ..compat import fem, ufl
from .displacement_space import summed

MEAN_ABOVE: Final = 0.4
"""Poisson's ratio above which hexahedra of first order have the mean dilatation.  A block twice as wide as high,
pressed by a plate that sticks to it, is too stiff with 4 and 8 cells across its width by 8 and 2.6 % at 0.4 without the
mean, by 17 and 5 % at 0.45, and with it by 3.2 and 0.9 %, 3.5 and 0.7 %; at 0.4999 by 1.1 and -2 % (of second order, on
8 cells).

Beside far stiffer cells that hold nothing but friction, conjugate gradients with multigrid give products by A with
rounding errors of the stiff ones, 2^-49 E u of their rigid motions, with and without the mean.  Steel on a block 1e4
times as soft, nu = 0.45: products differ by 3e-10 where they are repeated (2.4e-10 without the mean), friction takes
12 steps to a residual of 1e-9, and does not reach 1e-10; without the mean it takes 11, and with steel 1e5 times as
stiff 24.  Where the two are equally stiff products repeat to 1e-12."""

AT_POINTS: Final = 10.0
"""Of cells of second order in large motions the modulus of volume over the shear modulus that counts at every point;
the rest counts for the mean of each cell.  Changes of volume at points oscillate, and times 5000 shear moduli (a
Poisson's ratio of 0.4999) they are pressures under which the tangent is indefinite: of 10-node tetrahedra that block is
pressed by 7 % with all of it at points, and by 30 % and more with 5 to 100 shear moduli there, and with the mean alone,
which has 15 % less force at 30 % on 4 cells across.  With 10 it has 8 % more on 4 cells than hexahedra on 10, and 0.4 %
less on 6.  27-node hexahedra on 4 cells are pressed by 30 % in three steps of 4, 4 and 5 linear problems, with all of
it at points in four of up to 20, with 14 % more force at 10 %.  All tend to the same; up to a Poisson's ratio of 0.45
there is no rest."""

LOCKING_ABOVE: Final = 0.45
"""The same of tetrahedra of first order from which on they are said to lock: in that block they are too stiff by 26 and
9 % at 0.45, by 120 and 36 % at 0.49, and 27 times at 0.4999 with 8 cells."""


def linear_hexahedra(domain: Any) -> bool:
    """Whether the cells of a mesh can have the mean dilatation."""
    return domain.topology.cell_type.name == "hexahedron" and compat.geometry_degree(domain) == 1


class CellProducts:
    """The sum over some cells of k b b^T, as a part of a stiffness: b are forces at the nodes of a cell.

    Args:
        V: The space of displacements, of hexahedra of first order.
        cells: This rank's own cells, shape (c,).
        b: At their nodes, shape (c, 24).
        k: Shape (c,).
        volume: Of the cells, m^3, shape (c,).
        form: A compiled linear form on V.
    """

    def __init__(self, V: Any, cells: IntArray, b: FloatArray, k: FloatArray, volume: FloatArray, form: Any):
        self._V, self.cells, self.b, self.k, self.volume, self._form = V, cells, b, k, volume, form
        self._nodes = compat.cell_dofs(V)[cells]

    def of(self, u: FloatArray) -> FloatArray:
        """b . u of each cell, for values at this rank's nodes and ghosts (n,)."""
        return np.einsum("cj,cj->c", self.b, u.reshape(-1, 3)[self._nodes].reshape(self.b.shape))

    def times(self, u: FloatArray) -> FloatArray:
        """The product with values at this rank's nodes and ghosts (n,): what its cells add there, shape (n,)."""
        places = (3 * self._nodes[:, :, None] + np.arange(3)).ravel()
        values = (self.k * self.of(u))[:, None] * self.b
        return np.asarray(np.bincount(places, values.ravel(), minlength=len(u)), dtype=np.float64)

    def forces(self, u: Any) -> FloatArray:
        """The product with a function of V, at this rank's nodes, shape (k, 3); collective."""
        added = compat.create_vector(self._form, self._V)
        with added.localForm() as local:
            local.array[:] = self.times(u.x.array)
        return summed(added)

    def add_to(self, K: PETSc.Mat) -> None:
        """Add k b b^T to a matrix that has these entries; collective."""
        index_map = self._V.dofmap.index_map
        nodes = np.asarray(index_map.local_to_global(self._nodes.ravel().astype(np.int32)), dtype=PETSc.IntType)
        for cell_nodes, b, k in zip(nodes.reshape(self._nodes.shape), self.b, self.k, strict=True):
            K.setValuesBlocked(cell_nodes, cell_nodes, np.outer(k * b, b), addv=PETSc.InsertMode.ADD)
        K.assemble()


def mean_dilatation(V: Any, dx: Any, chosen: BoolArray, bulk: FloatArray) -> CellProducts | None:
    """bulk/V b b^T of the chosen of this rank's own cells (c,), with the bulk modulus of each; None if no rank has one;
    collective."""
    if not V.mesh.comm.allreduce(bool(np.any(chosen)), op=MPI.LOR):
        return None
    cells = np.flatnonzero(chosen)
    form = fem.form(ufl.div(ufl.TestFunction(V)) * dx)
    b = tabulated(form, V)[cells]
    x = V.mesh.geometry.x[compat.cell_geometry(V.mesh)[cells]]
    volume = np.einsum("cj,cj->c", b, x.reshape(b.shape)) / 3.0
    return CellProducts(V, cells, b, bulk[cells] / volume, volume, form)


@dataclass(frozen=True, eq=False)
class _Place:
    """The tension of cells and the products at a displacement of this rank's nodes and ghosts."""

    u: FloatArray
    tension: FloatArray
    products: CellProducts


class MeanVolume:
    """A part of the energy of large motions that depends on the mean of a measure of the volume of each cell.

    In place of the integral of k f(theta) over a cell it is V k f(theta_m), with theta_m the mean of theta, det F or
    the trace of C, and V the undeformed volume (J. C. Simo, R. L. Taylor, K. S. Pister: Variational and projection
    methods for the volume constraint, Comput. Methods Appl. Mech. Eng. 51, 1985).  With the tension p = k f'(theta_m)
    its derivative is that of the integral of p theta, and the second one that with p fixed, and k f''(theta_m)/V b b^T,
    b the derivative of the integral of theta.

    The p of the tangent is the one that the linear problem before gave, p + dp, and not k f'(theta_m) where this led: a
    step along a straight line changes theta_m in second order, too, and k times that is a tension that no equilibrium
    has (D. Magisano, L. Leonetti, G. Garcea: How to improve efficiency and robustness of the Newton method in
    geometrically non-linear structural problem discretized via displacement-based finite elements, Comput. Methods
    Appl. Mech. Eng. 313, 2017).  The residual has k f'(theta_m), so that the answer is the same.  The block takes 4
    linear problems a step in place of 5, and of 10-node tetrahedra pressed by 40 % in two steps 5 in place of 14.

    Args:
        V: The space of displacements, of hexahedra of first order, or of cells of second order.
        dx: Measure of the cells, as of the other part of the energy.
        invariant: 0 for the trace of C = F^T F, 2 for det F.
        function: f and its first two derivatives.
        k: In pascals, of this rank's own cells, 0 without this part; shape (c,).

    Attributes:
        tension: p of the displacement of the last `move`, pascals, 0 in other cells: a function for forms.
        ahead: p as the linear problem at the displacement before has it, for the tangent (`HyperelasticBody`).
        products: The part k f''/V b b^T at that displacement.
    """

    def __init__(self, V: Any, dx: Any, invariant: int, function: Callable[[FloatArray], FloatArray], k: FloatArray):
        self._V, self.invariant, self._cells, self._u = V, invariant, np.flatnonzero(k), fem.Function(V)
        self._function = function
        self._k, W = k[self._cells], compat.functionspace(V.mesh, 0, family="DG")
        self._dofs = compat.cell_dofs(W)[self._cells, 0]
        self.tension, self.ahead = fem.Function(W, name="tension"), fem.Function(W, name="tension_ahead")
        F, v, q = ufl.Identity(3) + ufl.grad(self._u), ufl.TestFunction(V), ufl.TestFunction(W)
        theta = (ufl.tr(F.T * F), None, ufl.det(F))[invariant]
        self._b = fem.form(ufl.derivative(theta, self._u, v) * dx)
        self._integral = fem.form(theta * q * dx)
        self._volume = self._over_cells(fem.form(fem.Constant(V.mesh, 1.0) * q * dx))
        self._places = list[_Place]()
        self.move(self._u.x.array.copy())

    def move(self, u: FloatArray, previous: FloatArray | None = None) -> None:
        """Take a displacement of this rank's nodes and ghosts (n,), reached from a previous one; collective."""
        there = self._place(u)
        before = there if previous is None else self._place(previous)
        self._places = [before, there]
        self.products = there.products
        for function, values in (
            (self.tension, there.tension),
            (self.ahead, before.tension + before.products.k * before.products.of(u - before.u)),
        ):
            function.x.array[self._dofs] = values
            function.x.scatter_forward()

    def _place(self, u: FloatArray) -> _Place:
        """What is known at a displacement, or was; collective."""
        for place in self._places:
            if self._V.mesh.comm.allreduce(bool(np.array_equal(place.u, u)), op=MPI.LAND):
                return place
        _, slope, curvature = self._evaluated(u)
        b, k = tabulated(self._b, self._V)[self._cells], self._k * curvature / self._volume
        products = CellProducts(self._V, self._cells, b, k, self._volume, self._b)
        return _Place(u.copy(), self._k * slope, products)

    def energy(self, u: FloatArray) -> float:
        """Of a displacement of this rank's nodes and ghosts (n,), joules; collective."""
        value, *_ = self._evaluated(u)
        return float(self._V.mesh.comm.allreduce(float(np.sum(self._volume * self._k * value))))

    def _evaluated(self, u: FloatArray) -> FloatArray:
        """f and its derivatives at the mean of each cell, shape (3, c); not finite where a cell is inside out."""
        self._u.x.array[:] = u
        with np.errstate(invalid="ignore", divide="ignore"):
            return self._function(self._over_cells(self._integral) / self._volume)

    def _over_cells(self, form: Any) -> FloatArray:
        vector = fem.petsc.assemble_vector(form)
        with vector.localForm() as local:
            values: FloatArray = local.array[self._dofs]
        vector.destroy()
        return values


def tabulated(form: Any, V: Any) -> FloatArray:
    """What this rank's own cells add to a compiled form over all cells, by FFCx's kernel: matrices, shape (c, n, n), of
    a bilinear form, vectors, shape (c, n), of a linear one.

    Raises:
        ValueError: If the form has integrals over parts, or none of double precision.
    """
    kernel = compat.cell_kernel(form)
    if kernel is None:
        raise ValueError("the matrices of cells are only known of one integral over all cells")
    width = 3 * compat.cell_dofs(V).shape[1]
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 7)(kernel.address)
    cells = int(V.mesh.topology.index_map(3).size_local)
    elements = np.zeros((cells, *[width] * int(form.rank)))
    points = np.ascontiguousarray(V.mesh.geometry.x[compat.cell_geometry(V.mesh)[:cells]])
    constants, coefficients = kernel.constants, np.ascontiguousarray(kernel.coefficients, dtype=np.float64)
    coefficients = coefficients[:cells] if coefficients.size else np.zeros((cells, 1))
    for one, coefficient, corners in zip(elements, coefficients, points, strict=True):
        function(one.ctypes.data, coefficient.ctypes.data, constants.ctypes.data, corners.ctypes.data, 0, 0, 0)
    return elements
