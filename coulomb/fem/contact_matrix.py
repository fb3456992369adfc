"""The contact matrix B: from the displacements of the nodes to those of the contact points, and back for the forces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc

from ..arrays import FloatArray
from .deformable import Deformable

_ROUNDING = 1e-13
"""A component of a row along the free directions below this is a rounding error of the projection."""


def point_weights(elasticity: Deformable, nodes: npt.NDArray[np.int32]) -> scipy.sparse.csr_matrix:
    """What the displacement at each contact point is made of: one row per contact point of this rank, one column per
    node of all ranks, shape (m, nodes).  Here a contact point is a node, and its displacement that of the node."""
    first, rows = elasticity.K.getOwnershipRange()[0] // 3, np.arange(len(nodes) + 1)
    shape = (len(nodes), elasticity.K.getSize()[0] // 3)
    return scipy.sparse.csr_matrix((np.ones(len(nodes)), first + nodes, rows), shape=shape)


def contact_matrix(elasticity: Deformable, nodes: npt.NDArray[np.int32], frames: FloatArray) -> PETSc.Mat:
    """B: the displacements of contact points, `point_weights` of those of the nodes, in their frames; collective.

    Args:
        elasticity: The body.
        nodes: The node that stands for each contact point, shape (m,).
        frames: Rows n, t1, t2, shape (m, 3, 3).

    Returns:
        Shape (3 m, n), distributed.
    """
    weights, rows = point_weights(elasticity, nodes), 3 * len(nodes)
    axes = np.arange(3)
    columns = (3 * weights.indices[:, None] + axes).astype(PETSc.IntType)
    of = np.repeat(np.arange(len(nodes)), np.diff(weights.indptr))
    entries = weights.data[:, None, None] * frames[of]
    row = np.broadcast_to(3 * of[:, None, None] + axes[:, None], entries.shape)
    present = entries != 0.0
    local = scipy.sparse.csr_matrix(
        (entries[present], (row[present], np.broadcast_to(columns[:, None, :], entries.shape)[present])),
        shape=(rows, elasticity.K.getSize()[1]),
    )
    local.sort_indices()
    B = PETSc.Mat().createAIJ(
        ((rows, PETSc.DETERMINE), elasticity.K.getSizes()[1]),
        csr=(local.indptr.astype(PETSc.IntType), local.indices.astype(PETSc.IntType), local.data),
        comm=elasticity.mesh.comm,
    )
    B.assemble()
    B.setAttr("mesh", elasticity.mesh)  # keeps it alive: see compat.assemble_matrix
    return B


def free_frames(elasticity: Deformable, nodes: npt.NDArray[np.int32], frames: FloatArray) -> FloatArray:
    """The parts of frames (m, 3, 3) along the free directions of their nodes (m,), those that are not prescribed.

    With them in place of the frames the contact matrix is B P, P the projection on the free directions: a contact
    force acts on free displacements only, so that A = B P K^-1 P B^T.  A row along a prescribed direction is zero.
    """
    held = elasticity.held.projector_at(nodes)
    free: FloatArray = frames - np.einsum("kij,kjl->kil", frames, held)
    free[np.abs(free) <= _ROUNDING * np.linalg.norm(frames, axis=2)[:, :, None]] = 0.0
    return free


def rows_of(B: PETSc.Mat, u: FloatArray) -> FloatArray:
    """B u in metres, shape (m, 3), of displacements u of this rank's nodes, shape (k, 3); collective."""
    displacement, image = B.createVecs()
    return _product(B.mult, u, displacement, image)


def at_nodes_of(B: PETSc.Mat, x: FloatArray) -> FloatArray:
    """B^T x in newtons, this rank's nodes, shape (k, 3), of forces x, shape (m, 3) or (3 m,); collective."""
    spread, forces = B.createVecs()
    return _product(B.multTranspose, x, forces, spread)


def _product(
    multiply: Callable[[PETSc.Vec, PETSc.Vec], None], values: FloatArray, given: PETSc.Vec, result: PETSc.Vec
) -> FloatArray:
    """A product of B or B^T with values, shape (rows, 3); the two vectors are destroyed."""
    given.array[:] = values.ravel()
    multiply(given, result)
    product: FloatArray = result.array_r.reshape(-1, 3).copy()
    given.destroy()
    result.destroy()
    return product
