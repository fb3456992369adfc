"""Linear elasticity of one body: stiffness K, load f, near-nullspace."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from . import compat
from .body import strain
from .compat import fem, ufl
from .loaded_body import LoadedBody, Loading
from .loads import Load, Traction
from .materials import Materials
from .named_mesh import NamedMesh
from .supports import Clamp, PrescribedDisplacement, Spring, Support
from .user_values import Amplitude, Field

__all__ = ["Clamp", "Elasticity", "Materials", "PrescribedDisplacement", "Spring", "Support", "Traction"]


class Elasticity(LoadedBody):
    """K u = f on trilinear hexahedra or linear tetrahedra, with prescribed displacements and springs.

    With P, the projector onto the free directions of the nodes, the matrix of the body becomes P K P + m (I - P): where
    a component is held, its row and column are zero except for the diagonal.  The number m is the mean diagonal of the
    free directions (a 1 there would disturb multigrid and all scales); f, which depends on time, has the prescribed
    values, so that K u = f holds them exactly.  Springs act at the nodes, each with the area of its hat function:
    diagonal in K, and exact for a face that moves without tilting.

    Attributes:
        K: Stiffness, N/m; block size 3, symmetric positive definite, with the rigid body modes as its near-nullspace;
            it does not change with time.

    Raises:
        ValueError: As `LoadedBody`, or if the springs that hold the body are too soft in comparison with rounding
            errors.
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
    ):
        super().__init__(
            *(mesh, materials, clamps, tractions, body_force, springs, body_force_amplitude),
            *(gravity, gravity_amplitude),
        )
        trial = ufl.TrialFunction(self.V)
        self.K = compat.assemble_matrix(fem.form(ufl.inner(self._stress(trial), strain(self._test)) * ufl.dx))
        self._add_springs()
        self._diagonal = self._eliminate_held()
        self._attach_rigid_body_modes()

    def f(self, loading: Loading) -> PETSc.Vec:
        """The load in newtons, with the prescribed displacements included, so that K u = f; collective."""
        f, load = self.K.createVecRight(), loading.load
        if self.mesh.comm.allreduce(bool(np.any(loading.prescribed)), op=MPI.LOR):
            g = loading.prescribed
            load = load - self.internal_force(g) + self.spring_force(g)
        f.array[:] = (self.free_part(load) + self._diagonal * loading.prescribed).ravel()
        return f

    def _add_springs(self) -> None:
        comm = self.mesh.comm
        diagonal = self.K.getDiagonal()
        stiff = comm.allreduce(float(np.max(diagonal.array, initial=0.0)), op=MPI.MAX)
        diagonal.array[:] += self.spring.ravel()
        self.K.setDiagonal(diagonal)
        diagonal.destroy()
        count = comm.allreduce(self._owned, op=MPI.SUM)
        free = self._rigid_motions(self.spring / stiff, 1e-12 * count)
        if free:
            raise ValueError(
                f"the springs are too soft in comparison with rounding errors: against {free} the nodes have less than "
                "1e-12 of the body's own stiffness; make the springs stiffer, or hold the body by a clamp"
            )

    def _eliminate_held(self) -> float:
        """K <- P K P + m (I - P); returns m, the mean diagonal entry of the free directions."""
        comm = self.mesh.comm
        if comm.allreduce(bool(np.any(self.held.oblique)), op=MPI.LOR):
            self._project()
        diagonal = self.K.getDiagonal()
        free = diagonal.array[~self.fixed.ravel()]
        count = comm.allreduce(3 * self._owned - self.held.number, op=MPI.SUM)
        if count == 0:
            raise ValueError("the supports hold every node of the body: there is nothing to compute; use a finer mesh")
        mean = float(comm.allreduce(float(free.sum()), op=MPI.SUM) / count)
        diagonal.destroy()
        first = self.K.getOwnershipRange()[0]
        rows = (first + np.flatnonzero(self.fixed)).astype(PETSc.IntType)
        self.K.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.K.zeroRowsColumns(rows, diag=mean)
        oblique = self.held.oblique
        for node, block in zip(self.held.nodes[oblique], self.held.projector[oblique], strict=True):
            along = ~self.fixed[node]
            at = (first + 3 * node + np.flatnonzero(along)).astype(PETSc.IntType)
            self.K.setValues(at, at, mean * block[np.ix_(along, along)], addv=PETSc.InsertMode.ADD)
        self.K.assemble()
        self.K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.K.setOption(PETSc.Mat.Option.SPD, True)
        return mean

    def _project(self) -> None:
        """K <- P K P."""
        first, last = (row // 3 for row in self.K.getOwnershipRange())
        number, blocks = np.arange(last - first), np.broadcast_to(np.eye(3), (last - first, 3, 3)).copy()
        blocks[self.held.nodes] -= self.held.projector
        shape = (3 * len(number), self.K.getSize()[1])
        rows = scipy.sparse.bsr_matrix((blocks, first + number, np.arange(len(number) + 1)), shape=shape).tocsr()
        P = PETSc.Mat().createAIJ(
            self.K.getSizes(),
            bsize=3,
            csr=(rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data),
            comm=self.mesh.comm,
        )
        projected = self.K.PtAP(P)
        projected.setAttr("mesh", self.mesh)  # keeps it alive: see compat.assemble_matrix
        self.K.destroy()
        P.destroy()
        self.K = projected

    def _attach_rigid_body_modes(self) -> None:
        coordinates = self.K.createVecRight()
        coordinates.setBlockSize(3)
        coordinates.array[:] = self.x.ravel()
        modes = PETSc.NullSpace().createRigidBody(coordinates)
        self.K.setNearNullSpace(modes)
        modes.destroy()
        coordinates.destroy()
