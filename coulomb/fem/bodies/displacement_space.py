"""The space of displacements of a body: its nodes, faces and loads, without a material."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray, Int32Array, IntArray
from .. import compat
from ..compat import fem, ufl
from ..meshes import Exchange, facet_columns, lagrange_points, lagrange_values, owner_of, starts_of
from .constraints import Numbering


@dataclass(frozen=True, eq=False)
class Vertices:
    """The vertices of a mesh: linear displacements on it, and the node of each vertex of this rank, shape (v,)."""

    space: DisplacementSpace
    node: IntArray


class DisplacementFunction(fem.Function):  # type: ignore[misc]
    """A displacement as a Function of DOLFINx, which also gives other fields of an answer by their names.

    `u` is used as any Function; `u("pressure")` is the Function of another field, as `u("+")` is a restriction.
    """

    def __init__(self, V: Any, name: str, fields: Callable[[str], Any]):
        super().__init__(V, name=name)
        self._fields_of_answer = fields

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        if arguments and isinstance(arguments[0], str) and arguments[0] not in ("+", "-"):
            return self._fields_of_answer(*arguments)
        return super().__call__(*arguments, **named)


class DisplacementSpace:
    """Displacements with values at nodes: vertices, and in second order also the middles of edges, faces and cells.

    Attributes:
        V: Lagrange space of vectors (3,) of first or second order on tetrahedra or hexahedra.
        domain: Its DOLFINx mesh, coordinates in metres.
        x: Coordinates of this rank's nodes, the block dofs of V that it owns, in metres, shape (k, 3).
        points_of_faces: The `contact_points` of faces, by their facets.
    """

    def __init__(self, V: Any):
        self.domain, self.V = V.mesh, V
        free_earlier_bodies(self.domain)
        self._test = ufl.TestFunction(self.V)
        self._owned = self.V.dofmap.index_map.size_local
        self.x = self._coordinates()
        self._integrals: dict[tuple[str, bytes], FloatArray] = {}
        self._on_each_cell: dict[tuple[int, ...], Any] = {}
        self._nodes_of: dict[bytes, Int32Array] = {}
        self.points_of_faces: dict[bytes, Any] = {}

    @property
    def comm(self) -> MPI.Comm:
        return self.domain.comm

    @property
    def reference(self) -> FloatArray:
        """Coordinates of this rank's nodes before deformation, in metres, shape (k, 3)."""
        return self.x

    @property
    def undeformed(self) -> DisplacementSpace:
        """The same nodes before deformation."""
        return self

    @property
    def numbering(self) -> Numbering:
        index_map = self.V.dofmap.index_map
        return Numbering(index_map.local_range[0], index_map.size_local, index_map.size_global)

    def global_numbers(self, nodes: npt.NDArray[np.integer[Any]]) -> IntArray:
        """Those of nodes by their numbers on this rank, of any shape."""
        numbers = self.V.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
        return np.asarray(numbers, dtype=np.int64).reshape(nodes.shape)

    @property
    def lifetime(self) -> object:
        return self.domain

    @property
    def degree(self) -> int:
        """Order of the displacements, 1 or 2."""
        return 1 if self.V.dofmap.dof_layout.num_dofs in (4, 8) else 2

    def function(self, u: FloatArray, name: str = "displacement", fields: Callable[[str], Any] | None = None) -> Any:
        """DOLFINx Function of nodal vectors (k, 3) of this rank, one that gives other fields by name if these are
        given; collective."""
        function = fem.Function(self.V, name=name) if fields is None else DisplacementFunction(self.V, name, fields)
        function.x.array[: 3 * self._owned] = u.ravel()
        function.x.scatter_forward()
        return function

    def scalar(self, values: FloatArray, name: str) -> Any:
        """DOLFINx Function of numbers (k,) at this rank's nodes; collective."""
        vectors = self.function(np.repeat(values[:, None], 3, axis=1)).x.array[::3]
        function = fem.Function(compat.functionspace(self.domain, self.degree), name=name)
        function.x.array[compat.cell_dofs(function.function_space)] = vectors[compat.cell_dofs(self.V)]
        return function

    def key_of(self, facets: Int32Array) -> bytes:
        """A key for facets: those of all ranks, since facets of others have nodes here; collective."""
        return b"".join(self.comm.allgather(sha256(facets.tobytes()).digest()))

    def nodes_of(self, facets: Int32Array) -> Int32Array:
        """This rank's nodes on boundary facets of any rank, sorted; collective."""
        key = self.key_of(facets)
        if key not in self._nodes_of:
            dofs = np.unique(fem.locate_dofs_topological(self.V, 2, facets))
            self._nodes_of[key] = dofs[dofs < self._owned].astype(np.int32)
        return self._nodes_of[key].copy()

    def nodes_at(self, points: Int32Array) -> Int32Array:
        """This rank's nodes at nodes of the mesh's geometry, where these are the same, sorted."""
        nodes = self.node_of_point[points]
        return np.sort(nodes[nodes >= 0])

    @cached_property
    def node_of_point(self) -> Int32Array:
        """This rank's node at each node of the mesh's geometry, where these are the same; -1 at those of others."""
        nodes = np.full(len(self.domain.geometry.x), -1, dtype=np.int32)
        nodes[compat.cell_geometry(self.domain)] = compat.cell_dofs(self.V)
        nodes[nodes >= self._owned] = -1
        return nodes

    def in_cells(self, facets: Int32Array) -> tuple[Int32Array, IntArray]:
        """The cells of those boundary facets that this rank owns, ascending, shape (f,), and which nodes of its cell
        are on each, in VTK's order, shape (f, n)."""
        topology = self.domain.topology
        own = np.sort(facets[facets < topology.index_map(2).size_local])
        for dims in ((2, 3), (3, 2)):
            topology.create_connectivity(*dims)
        beside, of_cell = topology.connectivity(2, 3), topology.connectivity(3, 2)
        cell = beside.array[beside.offsets[own]]  # a boundary facet has one
        columns = facet_columns(topology.cell_type, self.degree)
        number = np.argmax(of_cell.array.reshape(-1, len(columns))[cell] == own[:, None], axis=1)
        return cell, np.asarray(columns)[number]

    def points_of_cells(self, cells: Int32Array) -> FloatArray:
        """Coordinates of the nodes of cells (c,) of this rank, in metres, shape (c, n, 3)."""
        domain, cell = self.domain, self.domain.topology.cell_type
        x: FloatArray = domain.geometry.x[compat.cell_geometry(domain)[cells]]
        degree = compat.geometry_degree(domain)
        if degree == self.degree:
            return x
        values = lagrange_values(cell, degree, lagrange_points(cell, self.degree))
        return np.einsum("ac,kci->kai", np.round(values, 12), x)

    def in_cells_of(self, vectors: FloatArray) -> FloatArray:
        """Nodal vectors (k, 3) at the nodes of the cells that this rank owns, shape (c, n, 3); collective."""
        cells = compat.cell_dofs(self.V)[: self.domain.topology.index_map(3).size_local]
        return self.function(vectors).x.array.reshape(-1, 3)[cells]

    def deformation(self, way: FloatArray) -> FloatArray:
        """Deformation gradients at this rank's nodes, moved by `way` (k, 3) in metres from before deformation, shape
        (k, 3, 3): each of the affine map that is nearest to the motion of the cells around the node; collective."""
        nodes = compat.cell_dofs(self.V)[: self.domain.topology.index_map(3).size_local]
        before = self.in_cells_of(self.reference)
        x, y = (of - of.mean(axis=1, keepdims=True) for of in (before, before + self.in_cells_of(way)))
        products = np.stack([np.einsum("cni,cnj->cij", of, x) for of in (x, y)], axis=1)
        here, at = np.unique(nodes, return_inverse=True)
        sums = np.zeros((len(here), 2, 3, 3))
        np.add.at(sums, at.reshape(nodes.shape), products[:, None])
        numbers = self.global_numbers(here)
        exchange = Exchange(self.comm, owner_of(starts_of(self.comm, self.numbering.local), numbers))
        of_all = np.zeros((self._owned, 2, 3, 3))
        np.add.at(of_all, exchange.send(numbers) - self.numbering.first, exchange.send(sums))
        F: FloatArray = np.linalg.solve(of_all[:, 0], of_all[:, 1].transpose(0, 2, 1)).transpose(0, 2, 1)
        return F

    def in_a_cell(self) -> FloatArray:
        """The middle of a cell that each of this rank's nodes belongs to, the mean of its nodes, metres, shape (k, 3):
        by it nodes at one place are told apart."""
        nodes = compat.cell_dofs(self.V)
        middle = self.points_of_cells(np.arange(len(nodes), dtype=np.int32)).mean(axis=1)
        points, mine = np.empty((self._owned, 3)), nodes < self._owned
        points[nodes[mine]] = np.repeat(middle, np.sum(mine, axis=1), axis=0)
        return points

    def area_of(self, facets: Int32Array) -> FloatArray:
        """Integral of every hat function over boundary facets in m^2, this rank's nodes, shape (k,); collective."""

        def area() -> FloatArray:
            one = self.function(np.ones((self._owned, 3)))
            return self._assemble(fem.form(ufl.inner(one, self._test) * self.measure(facets)))[:, 0]

        return self._integral("area", facets, area)

    def normal_of(self, facets: Int32Array) -> FloatArray:
        """Integral of the outward normal against every hat function over boundary facets, m^2, shape (k, 3);
        collective."""

        def normal() -> FloatArray:
            n = ufl.FacetNormal(self.domain)
            return self._assemble(fem.form(ufl.inner(n, self._test) * self.measure(facets)))

        return self._integral("normal", facets, normal)

    def _integral(self, name: str, facets: Int32Array, compute: Callable[[], FloatArray]) -> FloatArray:
        """An integral over boundary facets of the undeformed mesh, kept for later load steps; collective."""
        key = (name, self.key_of(facets))
        if key not in self._integrals:
            self._integrals[key] = compute()
        return self._integrals[key].copy()

    def positive_weights(self, facets: Int32Array) -> tuple[FloatArray, FloatArray]:
        """Area and outward normal around this rank's nodes: integrals over boundary facets in m^2, shapes (k,), (k, 3),
        weighted by hat functions, on 10-node tetrahedra at vertices by linear ones: so they are positive."""
        area, normal = self.area_of(facets), self.normal_of(facets)
        if not self.positive:
            linear, node = self.vertices.space, self.vertices.node
            area[node], normal[node] = linear.area_of(facets), linear.normal_of(facets)
        return area, normal

    @property
    def without_area(self) -> Int32Array:
        """The nodes around which facets have no area: those of second-order wedges on their axis (`SingleBody`)."""
        return np.empty(0, dtype=np.int32)

    @property
    def positive(self) -> bool:
        """Whether the integral of every hat function over facets is positive: not on 10-node tetrahedra."""
        return int(self.V.dofmap.dof_layout.num_dofs) != 10

    @cached_property
    def vertices(self) -> Vertices:
        """The vertices, with linear functions on them."""
        linear = DisplacementSpace(compat.functionspace(self.domain, 1, (3,)))
        of_linear, corners = compat.cell_dofs(linear.V), compat.cell_dofs(self.V)
        node = np.zeros(linear.V.dofmap.index_map.size_local + linear.V.dofmap.index_map.num_ghosts, dtype=np.int64)
        node[of_linear] = corners[:, : of_linear.shape[1]]
        node = node[: len(linear.x)]
        assert np.all(node < self._owned)  # a rank owns the values of the vertices that it owns, in every space
        return Vertices(linear, node)

    def interpolated(self) -> tuple[scipy.sparse.csr_matrix, FloatArray, Numbering]:
        """Displacements by those of the vertices in second order, by themselves in first: this rank's rows, where these
        nodes are, metres, and their numbers; collective."""
        if self.degree == 1:
            sizes = 3 * self._owned, 3 * self.numbering.total, 3 * self.numbering.first
            return scipy.sparse.eye(*sizes, format="csr"), self.x, self.numbering
        linear, cell = self.vertices.space, self.domain.topology.cell_type
        values = np.round(lagrange_values(cell, 1, lagrange_points(cell, 2)), 12)
        nodes, vertices = compat.cell_dofs(self.V), compat.cell_dofs(linear.V)
        _, first = np.unique(nodes, return_index=True)  # every node in one cell: its weights are the same in all
        where, local = np.divmod(first, nodes.shape[1])
        own = nodes[where, local] < self._owned
        where, local = where[own], local[own]
        columns = linear.global_numbers(vertices[where]).ravel()
        rows = np.repeat(np.arange(self._owned), values.shape[1])
        weights = scipy.sparse.csr_matrix(
            (values[local].ravel(), (rows, columns)), shape=(self._owned, linear.numbering.total)
        )
        weights.eliminate_zeros()
        return scipy.sparse.kron(weights, np.eye(3), format="csr"), linear.x, linear.numbering

    def linear_between_vertices(self, values: FloatArray) -> FloatArray:
        if values.ndim == 1:
            return self.linear_between_vertices(values[:, None])[:, 0]
        corners, field = np.zeros((len(self.vertices.node), 3)), fem.Function(self.V)
        corners[:, : values.shape[1]] = values[self.vertices.node]
        field.interpolate(self.vertices.space.function(corners))
        return field.x.array[: 3 * self._owned].reshape(-1, 3)[:, : values.shape[1]].copy()

    def measure(self, facets: Int32Array) -> Any:
        """UFL's measure of boundary facets."""
        tags = compat.meshtags(self.domain, 2, facets, np.ones(len(facets), dtype=np.int32))
        return ufl.Measure("ds", domain=self.domain, subdomain_data=tags, subdomain_id=1)

    def surface_load(self, traction: FloatArray, facets: Int32Array) -> FloatArray:
        """Nodal forces in newtons of tractions in pascals on boundary facets; shapes (k, 3)."""
        return self._assemble(fem.form(ufl.inner(self.function(traction), self._test) * self.measure(facets)))

    def pressure_load(self, pressure: FloatArray, facets: Int32Array) -> FloatArray:
        """Nodal forces in newtons, shape (k, 3), of a pressure (k,) in pascals: the integral of -p n over each facet of
        the undeformed mesh; n varies over a facet with four corners that is not plane."""
        p = self.function(np.repeat(pressure[:, None], 3, axis=1))[0]
        n = ufl.FacetNormal(self.domain)
        return self._assemble(fem.form(-p * ufl.inner(n, self._test) * self.measure(facets)))

    def volume_load(self, force: FloatArray, of_cells: FloatArray | None = None) -> FloatArray:
        """Nodal forces in newtons of forces per volume in N/m^3, shapes (k, 3); or, with densities of own cells (c,) in
        kg/m^3, of accelerations in m/s^2."""
        density = 1.0 if of_cells is None else self._on_cells(of_cells, "density")
        return self._assemble(fem.form(density * ufl.inner(self.function(force), self._test) * ufl.dx))

    def along_places(self, work: Any, measure: Any) -> FloatArray:
        """Derivatives, along the places of this rank's nodes, shape (k, 3), of an integral over cells or boundary
        facets of what stays as the nodes move: of nodal values, and of numbers of cells; collective."""
        way, n = ufl.grad(self._test), ufl.FacetNormal(self.domain)
        stretch = ufl.tr(way)
        if measure.integral_type() != "cell":
            stretch -= ufl.dot(n, ufl.dot(way, n))
        return self._assemble(fem.form(work * stretch * measure))

    def integrals_in_cells(self, integrand: Any, dx: Any) -> FloatArray:
        """Integrals over this rank's own cells, shape (c,); collective."""
        space = self._per_cell(())
        vector = fem.petsc.assemble_vector(fem.form(integrand * ufl.TestFunction(space) * dx))
        found: FloatArray = vector.array_r[compat.cell_dofs(space)[: self.domain.topology.index_map(3).size_local, 0]]
        vector.destroy()
        return found

    def largest_gradient(self, u: FloatArray) -> float:
        """Largest Frobenius norm of the gradient of u (k, 3) over all ranks: at the cells' midpoints in first order, in
        second order at their corners, where bending is largest."""
        displacement, size, expression = self._gradient
        displacement.x.array[: 3 * self._owned] = u.ravel()
        displacement.x.scatter_forward()
        size.interpolate(expression)
        values = size.x.array
        # nan is propagated, which a reduction by MPI.MAX does not guarantee
        return float(np.max(self.domain.comm.allgather(float(np.max(values, initial=0.0)))))

    @cached_property
    def _gradient(self) -> tuple[Any, Any, Any]:
        W, displacement = compat.functionspace(self.domain, self.degree - 1, family="DG"), fem.Function(self.V)
        slope = ufl.grad(displacement)
        size = fem.Expression(ufl.sqrt(ufl.inner(slope, slope)), compat.interpolation_points(W))
        return displacement, fem.Function(W), size

    def _coordinates(self) -> FloatArray:
        """Of this rank's nodes, exactly those of the mesh: DOLFINx's tabulated ones have rounding errors, so that
        functions of place such as sqrt(x) have no value at x = 0."""
        nodes = compat.cell_dofs(self.V)
        in_cells = self.points_of_cells(np.arange(len(nodes), dtype=np.int32))
        x = np.empty((self._owned, 3))
        mine = nodes < self._owned
        x[nodes[mine]] = in_cells[mine]
        return x

    def _assemble(self, form: Any) -> FloatArray:
        return summed(fem.petsc.assemble_vector(form))

    def _added(self, part: FloatArray, form: Any) -> FloatArray:
        """What the cells of all ranks add at this rank's nodes, shape (k, 3), from what its own add there and at its
        ghosts (n,)."""
        if self.comm.size == 1:
            return part.reshape(-1, 3)
        vector = compat.create_vector(form, self.V)
        with vector.localForm() as local:
            local.array[:] = part
        return summed(vector)

    def _on_cells(self, values: FloatArray, name: str) -> Any:
        """Function that is constant on every cell, from this rank's own cells: numbers (c,), or rows (c, n)."""
        width = values.shape[1:]
        function = fem.Function(self._per_cell(width), name=name)
        cells = compat.cell_dofs(function.function_space)[: len(values), 0]
        function.x.array.reshape(-1, *width)[cells] = values
        function.x.scatter_forward()
        return function

    def _per_cell(self, width: tuple[int, ...]) -> Any:
        """The space of functions that are constant on every cell, of numbers or of vectors."""
        if width not in self._on_each_cell:
            self._on_each_cell[width] = compat.functionspace(self.domain, 0, width, family="DG")
        return self._on_each_cell[width]


def summed(vector: PETSc.Vec) -> FloatArray:
    """What all ranks have added at this rank's nodes, shape (k, 3); the vector is destroyed; collective."""
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    values: FloatArray = vector.array.reshape(-1, 3).copy()
    vector.destroy()
    return values


# Frees what earlier bodies left behind, in a process that makes many of them.  A compiled form is in a reference
# cycle (in DOLFINx's `fem.form`) and holds the mesh, its matrices and some ten communicators, of which MPICH has 2046.
# Python collects cycles by the number of small objects, not by these.  PETSc moreover destroys matrices only when all
# ranks ask for it, while their communicator exists (3.18 also on one rank).

_BODIES, _NODES = 16, 100_000  # searching takes 0.1 s: little beside 16 small problems, or beside one of 1e5 nodes


@dataclass
class _Earlier:
    """Bodies on the same ranks since the last search: their number and nodes; and meshes that matrices may have."""

    bodies: int = 0
    nodes: int = 0
    meshes: list[tuple[weakref.ref[Any], Any]] = field(default_factory=list)


_earlier: dict[tuple[int, ...], _Earlier] = {}


def free_earlier_bodies(domain: Any) -> None:
    """Called for each new body, by all ranks of its mesh; after 16 bodies, or 1e5 nodes, frees what nobody uses."""
    comm = domain.comm
    ranks = tuple(MPI.Group.Translate_ranks(comm.group, list(range(comm.size)), MPI.COMM_WORLD.group))
    earlier = _earlier.setdefault(ranks, _Earlier())
    if earlier.bodies >= _BODIES or earlier.nodes >= _NODES:
        gc.collect()
        for _, mesh in earlier.meshes:
            PETSc.garbage_cleanup(mesh.comm)
        used = comm.allreduce([mesh() is not None for mesh, _ in earlier.meshes], lambda a, b: [*map(max, a, b)])
        earlier.meshes = [kept for kept, is_used in zip(earlier.meshes, used, strict=True) if is_used]
        earlier.bodies = earlier.nodes = 0
    earlier.bodies += 1
    earlier.nodes += domain.geometry.index_map().size_global
    if not any(mesh() is domain for mesh, _ in earlier.meshes):
        earlier.meshes.append((weakref.ref(domain), compat.cpp_of(domain)))
