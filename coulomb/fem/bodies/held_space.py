"""A space of displacements some of which are prescribed, on a mesh with named faces."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from .. import compat
from ..meshes import NamedMesh, lagrange_points, lagrange_values
from .constraints import HeldDirections, HeldNodes, distributed_rows
from .displacement_space import DisplacementSpace

INTERPOLATION = "interpolation"
"""Attribute of a stiffness of second order: makes the matrix that interpolates linear displacements."""


class HeldSpace(DisplacementSpace, HeldNodes):
    """Displacements with held directions, and the faces of their mesh; what a body is made of sets both."""

    mesh: NamedMesh
    held: HeldDirections

    def nodes(self, face: str, what: str) -> npt.NDArray[np.int32]:
        return self.nodes_of(self.mesh.facets(face, what))

    @property
    def anchor_places(self) -> tuple[npt.NDArray[np.bool_], ...]:
        """Which of this rank's nodes suit as anchors of free motions, the best first, shapes (k,): those inside, which
        cannot be in contact; those that are not held obliquely; all."""
        everywhere = np.ones(self._owned, dtype=bool)
        along_axes, inside = everywhere.copy(), everywhere.copy()
        along_axes[self.held.nodes[self.held.oblique]] = False
        self.domain.topology.create_connectivity(2, 3)
        inside[self.nodes_of(compat.mesh.exterior_facet_indices(self.domain.topology))] = False
        return inside & along_axes, along_axes, everywhere

    def eliminated(self, K: PETSc.Mat) -> tuple[PETSc.Mat, FloatArray]:
        """The stiffness K of the free body, which it changes or destroys, with the held directions eliminated and with
        rigid body modes for multigrid; and m, shape (k, 1); collective.

        With P, the projector onto the free directions of the nodes, K becomes P K P + m (I - P): where a component is
        held, its row and column are zero except for the diagonal.  The numbers m are means of the diagonal of the node:
        a 1 there would disturb multigrid and all scales.  So would the same number at all nodes if one material is much
        stiffer than another: multigrid takes the coupling of two nodes for weak where it is small beside their
        diagonals, nodes that are held along one direction in the softer material are then on no coarser grid, and
        motions of the body as a whole are not either.

        Raises:
            ValueError: On every rank, if every direction of every node is held.
        """
        comm = self.mesh.comm
        if comm.allreduce(3 * self._owned - self.held.number, op=MPI.SUM) == 0:
            raise ValueError("the supports hold every node of the body: there is nothing to compute; use a finer mesh")
        diagonal = K.getDiagonal()
        mean: FloatArray = diagonal.array_r.reshape(-1, 3).mean(axis=1, keepdims=True)
        diagonal.destroy()
        typical = comm.allreduce(float(mean.sum()), op=MPI.SUM) / comm.allreduce(len(mean), op=MPI.SUM)
        mean = np.where(mean > 0.0, mean, typical)  # forms may vanish where everything is held
        if comm.allreduce(bool(np.any(self.held.oblique)), op=MPI.LOR):
            K = self._projected(K)
        first = K.getOwnershipRange()[0]
        rows = (first + np.flatnonzero(self.fixed)).astype(PETSc.IntType)
        K.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        K.zeroRowsColumns(rows, diag=1.0)
        diagonal = K.getDiagonal()
        diagonal.array[self.fixed.ravel()] = np.broadcast_to(mean, self.fixed.shape)[self.fixed]
        K.setDiagonal(diagonal)
        diagonal.destroy()
        oblique = self.held.oblique
        for node, block in zip(self.held.nodes[oblique], self.held.projector[oblique], strict=True):
            along = ~self.fixed[node]
            at = (first + 3 * node + np.flatnonzero(along)).astype(PETSc.IntType)
            K.setValues(at, at, mean[node] * block[np.ix_(along, along)], addv=PETSc.InsertMode.ADD)
        K.assemble()
        K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        K.setOption(PETSc.Mat.Option.SPD, True)
        attach_rigid_body_modes(K, self.x)
        if self.degree == 2:
            K.setAttr(INTERPOLATION, self._interpolation)
        return K, mean

    def _projected(self, K: PETSc.Mat) -> PETSc.Mat:
        P = self.projection()
        projected = K.PtAP(P)
        projected.setAttr("mesh", self.mesh)  # keeps it alive: see compat.assemble_matrix
        K.destroy()
        P.destroy()
        return projected

    def _interpolation(self) -> PETSc.Mat:
        """From linear displacements to free ones of second order, with their rigid body modes as near-nullspace; for
        multigrid."""
        linear, cell = self.vertices.space, self.domain.topology.cell_type
        values = np.round(lagrange_values(cell, 1, lagrange_points(cell, 2)), 12)
        nodes, vertices = compat.cell_dofs(self.V), compat.cell_dofs(linear.V)
        _, first = np.unique(nodes, return_index=True)  # every node in one cell: its weights are the same in all
        where, local = np.divmod(first, nodes.shape[1])
        own = nodes[where, local] < self._owned
        where, local = where[own], local[own]
        columns = np.asarray(linear.V.dofmap.index_map.local_to_global(vertices[where].ravel()), dtype=np.int64)
        rows = np.repeat(np.arange(self._owned), values.shape[1])
        weights = scipy.sparse.csr_matrix(
            (values[local].ravel(), (rows, columns)), shape=(self._owned, linear.V.dofmap.index_map.size_global)
        )
        weights.eliminate_zeros()
        local_rows = scipy.sparse.kron(weights, np.eye(3), format="csr")
        P = distributed_rows(local_rows, (3 * len(linear.x), local_rows.shape[1]), self)
        projection = self.projection()
        free = projection.matMult(P)
        for matrix in (P, projection):
            matrix.destroy()
        free.setAttr("mesh", self.mesh)
        attach_rigid_body_modes(free, linear.x)
        return free


def attach_rigid_body_modes(matrix: PETSc.Mat, x: FloatArray) -> None:
    """The near-nullspace of a matrix whose columns are displacements of nodes at x (k, 3)."""
    coordinates = matrix.createVecRight()
    coordinates.setBlockSize(3)
    coordinates.array[:] = x.ravel()
    modes = PETSc.NullSpace().createRigidBody(coordinates)
    matrix.setNearNullSpace(modes)
    modes.destroy()
    coordinates.destroy()
